# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     notebook_metadata_filter: replication
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
#   replication:
#     quick: {}
# ---

# %% [markdown]
# # 2 · Stiffness and torque in the gap (equations 8 and 9, figure 9)
#
# ## Claim
#
# The modified dead zone model has the stiffness $K_s$ outside the backlash gap and 0 inside it, and "unlike the typical
# dead zone models, it does not present discontinuities" (section "Matlab/Simulink model of the robotic joint").
#
# ## Method
#
# Equations 8 and 9 as printed are five lines, below; `dead_zone.stiffness` and `dead_zone.transmitted_torque` are
# the same with damping, as the simulator takes them. The paper does not print $\alpha$, so they are drawn for several,
# beside the plain clamped dead zone.

# %%
import numpy as np
import pandas as pd
from matplotlib import pyplot as plt

from replication import dead_zone, published, workbook
from replication.figures import paper
from replication.simulator.simulate import identified_joint

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
delta_rad = 15e-4  # half the gap
alphas = [1e3, 1e4, 1e5, 1e6]  # sharpness of the edge, 1/rad
criteria = {}  # limits to try in place of those of claims.csv, such as {"stiffness_zero_inside": 1e-3}

# %% [markdown]
# ## Result

# %%
K_s = identified_joint().stiffness_nm_per_rad


def K_BL(x, alpha):  # equation 8; x is the displacement theta_m / N - theta_l
    return K_s / np.pi * (np.pi + (np.arctan(alpha * (x - delta_rad)) - np.arctan(alpha * (x + delta_rad))))


def tau_l(x, alpha):  # equation 9, at rest
    return (x - delta_rad * np.sign(x)) * K_BL(x, alpha)


x = np.linspace(-3 * delta_rad, 3 * delta_rad, 1201)
clamped = dead_zone.transmitted_torque(x, 0.0, delta_rad, K_s, clamped=True)
curves = pd.concat(
    [
        pd.DataFrame({"alpha_per_rad": alpha, "delta_theta_rad": x, "torque_nm": torque, "stiffness_nm_per_rad": K})
        for alpha, torque, K in [
            *((alpha, tau_l(x, alpha), K_BL(x, alpha)) for alpha in alphas),
            (np.inf, clamped, np.where(np.abs(x) > delta_rad, K_s, 0.0)),
        ]
    ],
    ignore_index=True,
)
figure = paper.dead_zone(curves, delta_rad)
workbook.save_figure(
    figure,
    "figure09_dead_zone",
    caption="With a small alpha the stiffness never falls to zero inside the gap, and the torque jumps at zero "
    "displacement; from 1e5 per rad on it is as good as a plain dead zone.",
)

# %% [markdown]
# The same with sliders for $\alpha$ and $\delta$, where the notebook is run by hand with `make lab`.


# %%
def draw(log10_alpha, delta_mrad):
    x, delta = np.linspace(-3e-3, 3e-3, 2001), 1e-3 * delta_mrad
    _, (left, right) = plt.subplots(1, 2, figsize=(7, 2.6), layout="constrained")
    left.plot(1e3 * x, dead_zone.stiffness(x, delta, K_s, 10**log10_alpha))
    left.set(xlabel="displacement [mrad]", ylabel="stiffness [N m/rad]")
    right.plot(1e3 * x, dead_zone.transmitted_torque(x, 0.0, delta, K_s, alpha_per_rad=10**log10_alpha))
    right.set(xlabel="displacement [mrad]", ylabel="torque [N m]")


workbook.sliders(draw, log10_alpha=(4.0, 3.0, 6.0), delta_mrad=(1e3 * delta_rad, 0.3, 2.1))

# %% [markdown]
# At the edge the stiffness is half of $K_s$; in the middle of the gap a share of $2/(\pi\alpha\delta)$ is left, and it
# pulls the wrong way, towards the nearer edge; and the torque jumps at zero displacement, where the sign() of
# equation 9 changes.

# %%
facts = pd.DataFrame(
    [
        {
            "alpha_per_rad": alpha,
            "edge_share": K_BL(delta_rad, alpha) / K_s,
            "middle_share": K_BL(0.0, alpha) / K_s,
            "jump_nm": tau_l(-1e-15, alpha) - tau_l(1e-15, alpha),
        }
        for alpha in alphas
    ]
)
workbook.save_table(facts, "dead_zone_facts")
facts

# %% [markdown]
# ## Verdict
#
# Both sentences are approximately true for a sharp edge, and false as they stand (errata E8 and E9).

# %%
softest, sharpest = facts.iloc[0], facts.iloc[-1]
claims = {
    "stiffness_zero_inside": (
        published.decide("stiffness_zero_inside", facts["middle_share"].max(), criteria),
        f"in mid-gap {100 * softest['middle_share']:.2g} % of K_s for alpha = {softest['alpha_per_rad']:.0e}, "
        f"{100 * sharpest['middle_share']:.2g} % for {sharpest['alpha_per_rad']:.0e}",
    ),
    "no_discontinuity": (
        published.decide("no_discontinuity", facts["jump_nm"].abs().max(), criteria),
        f"the torque jumps at zero by {softest['jump_nm']:.3g} N m for alpha = {softest['alpha_per_rad']:.0e}, "
        f"{sharpest['jump_nm']:.2g} N m for {sharpest['alpha_per_rad']:.0e}",
    ),
}
workbook.record_verdicts(claims=claims)

# %% [markdown]
# ## Try changing
#
# 1. `alphas = [1e8]`: nearly the clamped dead zone; the share left in mid-gap falls below a thousandth of a percent.
# 2. `delta_rad = 3e-4`: in a gap five times narrower five times more stiffness is left in the middle.
# 3. `alphas = [4e5]`: sharp enough for the published signals; a tenth of a percent of the stiffness is left in mid-gap.
