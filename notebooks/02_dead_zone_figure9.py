# %% [markdown]
# # 2 · Stiffness and torque in the gap (equations 8 and 9, figure 9)
#
# *You will see what a dead zone is, and how much stiffness a smooth formula leaves inside the gap.
# Reading time: 6 min. Run time: 15 s. Before this: notebook [1](01_the_joint.ipynb).*
#
# ## Claim
#
# The modified dead zone model has the stiffness $K_s$ outside the [backlash](glossary.md#backlash)
# gap and 0 inside it, and "unlike the typical dead zone models, it does not present
# discontinuities" (section "Matlab/Simulink model of the robotic joint"). The model is that of
# Papageorgiou et al. ([2019](https://doi.org/10.1109/TCST.2018.2837642)); Nordin and Gutman
# ([2002](https://doi.org/10.1016/S0005-1098(02)00047-X)) compare models of backlash.
#
# ## Method
#
# The displacement $\Delta\theta = \theta_m / N - \theta_l$ [rad] is the motor's angle, divided by
# the gear ratio $N$, less the load's. The teeth are free while $|\Delta\theta| \le \delta$:
# $\delta$ is half of the play. The clamped dead zone gives no torque there, and $K_s$ [N m/rad]
# times the distance from the edge outside. The paper smooths its edges. $\alpha$ [1/rad] sets how
# sharp they are (the paper does not print it), and $D_s$ [N m s/rad] is the coupling's damping:
#
# $$K_{BL}(\Delta\theta, \delta) = \frac{K_s}{\pi}\left[\pi + \arctan(\alpha(\Delta\theta - \delta))
# - \arctan(\alpha(\Delta\theta + \delta))\right] \tag{8}$$
#
# $$\tau_l = \left[\Delta\theta - \delta \cdot \text{sign}(\Delta\theta) + \frac{D_s}{K_s}\Delta\omega\right]
# \cdot K_{BL}(\Delta\theta, \delta) \tag{9}$$

# %%
import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from scipy.integrate import quad

import workbook
from replication import claims, figures, published
from replication.joint import identified_joint

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
backlash_mrad = 1.5  # delta, half of the play
stiffness_factor = 1.0  # on K_s
alphas = [1e3, 1e4, 1e5, 1e6]  # sharpness of the edge, 1/rad

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    backlash_mrad=(backlash_mrad, (1e-3, 100)),
    stiffness_factor=(stiffness_factor, (1e-3, 1e3)),
    alphas=(alphas, [(1, 1e12)]),
)
delta = 1e-3 * backlash_mrad
K_s = stiffness_factor * identified_joint().K_s

# %% [markdown]
# ## Result
#
# ### Figure 9
#
# The equations at rest ($\Delta\omega = 0$), and the clamped dead zone. Predict first: which value
# have the curves at the edge, and which in the middle of the gap?


# %%
def K_BL(x, alpha, delta=delta):  # equation 8; x is the displacement
    return K_s / np.pi * (np.pi + np.arctan(alpha * (x - delta)) - np.arctan(alpha * (x + delta)))


def tau_l(x, alpha, delta=delta):  # equation 9
    return (x - delta * np.sign(x)) * K_BL(x, alpha, delta)


def clamped_tau_l(x, delta=delta):
    return K_s * np.sign(x) * np.maximum(np.abs(x) - delta, 0)


# %%
x = np.linspace(-3 * delta, 3 * delta, 1201)
shapes = {alpha: (tau_l(x, alpha), K_BL(x, alpha)) for alpha in alphas}
shapes[np.inf] = clamped_tau_l(x), np.where(np.abs(x) > delta, K_s, 0.0)
curves = pd.concat(
    pd.DataFrame({"alpha_per_rad": alpha, "delta_theta_rad": x, "torque_nm": torque}).assign(
        stiffness_nm_per_rad=stiffness
    )
    for alpha, (torque, stiffness) in shapes.items()
)
workbook.show_figure(
    "figure09_dead_zone",
    figures.dead_zone(curves, delta),
    f"(a) Stiffness of equation 8 and (b) torque of equation 9 for {len(alphas)} values of alpha, and the clamped "
    f"dead zone, at delta = {backlash_mrad:g} mrad (dotted: its edges); (c) within the gap, the sharp edges alone.",
)

# %% [markdown]
# The torque at one $\alpha$ and $\delta$; grey: the clamped dead zone. In JupyterLab `ipywidgets.interact(draw,
# log10_alpha=(3.0, 6.0), delta_mrad=(0.3, 2.1))` gives them sliders.


# %%
def draw(log10_alpha, delta_mrad):
    x, delta = np.linspace(-3e-3, 3e-3, 2001), 1e-3 * delta_mrad
    _, axis = plt.subplots(figsize=(6, 3), layout="constrained")
    axis.plot(1e3 * x, clamped_tau_l(x, delta), "0.7")
    axis.plot(1e3 * x, tau_l(x, 10**log10_alpha, delta))
    axis.set(xlabel="displacement [mrad]", ylabel="torque [N m]", ylim=(-3e-3 * K_s, 3e-3 * K_s))
    left = 100 * K_BL(0.0, 10**log10_alpha, delta) / K_s
    axis.set_title(f"in the middle {left:.2g} % of $K_s$ left", fontsize=9)


draw(log10_alpha=4.0, delta_mrad=1.5)

# %% [markdown]
# ### What is left in the gap
#
# At the edge, $\Delta\theta = \delta$, the second arctangent is nearly $\pi/2$: half of $K_s$ is
# left. In the middle, $\Delta\theta = 0$, equation 8 is
#
# $$K_{BL}(0, \delta) = K_s \left[1 - \frac{2}{\pi}\arctan(\alpha\delta)\right] \approx \frac{2 K_s}{\pi\alpha\delta}
# \quad\text{for}\quad \alpha\delta \gg 1.$$
#
# This stiffness acts on $\Delta\theta - \delta\,\text{sign}(\Delta\theta)$, which points to the
# nearer edge: inside the gap the teeth are pulled there. Where $\Delta\theta$ changes its sign the
# torque jumps by $2 \delta K_{BL}(0, \delta)$.

# %%
left = pd.DataFrame({"alpha [1/rad]": [f"{alpha:,.0f}" for alpha in alphas]})
left["at the edge [K_s]"] = [K_BL(delta, alpha) / K_s for alpha in alphas]
left["in the middle [K_s]"] = [K_BL(0.0, alpha) / K_s for alpha in alphas]
left["2 / (pi alpha delta)"] = [2 / (np.pi * alpha * delta) for alpha in alphas]
left["jump [N m]"] = [tau_l(-1e-15, alpha) - tau_l(1e-15, alpha) for alpha in alphas]
left.round(5)

# %% [markdown]
# ## Verdict
#
# The two claims are decided at $10^5$ per rad, the smallest $\alpha$ that the public records allow ([notebook
# 3](03_simulator_figure10.ipynb)), and at $10^6$.

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
ALPHA = 1e5
share, jump = K_BL(0.0, ALPHA) / K_s, tau_l(-1e-15, ALPHA) - tau_l(1e-15, ALPHA)
decided = published.decide_all(claims.measure_dead_zone(K_BL, tau_l, K_s))
sharpest = max(alphas)
workbook.verdict(
    f"At {backlash_mrad:g} mrad, $K_s$ = {1e-3 * K_s:.3g} kN m/rad and $\\alpha = 10^5$ per rad equation 8 leaves "
    f"{100 * share:.2g} % of $K_s$ in the middle of the gap, and the torque of equation 9 jumps there by {jump:.2g} "
    f"N m. The sharpest edge tried, {sharpest:,.0f} per rad, leaves {100 * K_BL(0.0, sharpest) / K_s:.2g} %. Both "
    "shrink as $\\alpha$ grows and vanish for no finite one: the paper's sentences are approximations (errata E8, E9).",
    claims=decided,
)

# %% [markdown]
# ## Try changing
#
# 1. `alphas = [1e8]`: nearly the clamped dead zone; the share left in mid-gap falls below a
#    thousandth of a percent.
# 2. `backlash_mrad = 0.3`: a fifth of the gap; five times the stiffness is left in the middle.
# 3. `stiffness_factor = 2.0`: the jump doubles, the share in mid-gap stays.
#
# ## Exercises
#
# Each asks for numbers by a `name`. The cell below your answer says *right* or *not yet*.

# %%
alpha_1_percent = barrier_j = torque_nm = np.nan  # your answers

# %% [markdown]
# **1.** Which $\alpha$ (`alpha_1_percent` [1/rad]) leaves 1 % of $K_s$ in the middle of a gap of
# $\delta$ = 1.5 mrad? Use the exact form.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
alpha_1_percent = np.tan(0.99 * np.pi / 2) / 15e-4
print(f"{alpha_1_percent:,.0f} per rad")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(
    alpha_1_percent, lambda alpha: np.isclose(100 * K_BL(0.0, alpha, 15e-4) / K_s, 1, atol=0.005)
)

# %% [markdown]
# **2.** The torque inside the gap does work. How large is the potential's barrier between the two
# edges at $\alpha = 10^4$ per rad (`barrier_j` [J])? Compare it with the energy that the spring
# stores 0.1 mrad beyond the edge.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
inside = np.linspace(0.0, delta, 20001)
barrier_j = -np.trapezoid(tau_l(inside, 1e4), inside)
print(f"{barrier_j:.2g} J against {K_s * 1e-4**2 / 2:.2g} J")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
work_j, _ = quad(tau_l, delta, 0.0, args=(1e4,))
workbook.check_answer(barrier_j, work_j, rtol=0.02)

# %% [markdown]
# **3.** Without sign() the torque would not jump. Write $\tau_l$ (`torque_nm`, of the displacements
# `x`) as $K_s$ times the displacement less its part clipped to $\pm\delta$. Is it continuous, and
# equal to the clamped dead zone?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
torque_nm = K_s * (x - np.clip(x, -delta, delta))
print(f"largest step {np.abs(np.diff(torque_nm)).max():.2g} N m, as K_s times that of x")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(torque_nm, clamped_tau_l(x))

# %% [markdown]
# **What you have learnt**: a smooth dead zone leaves stiffness in the gap, and equation 9 jumps at
# its middle. *Next:* [the simulator](03_simulator_figure10.ipynb).
