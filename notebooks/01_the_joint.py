# %% [markdown]
# # 1 · The joint: its dead zone (figure 9), and why its motor speed rings
#
# *You will see what a dead zone is, what holds the motor, and build up the joint's ring, one term a
# step. Before this: notebook [0](00_the_sensor.ipynb).*

# %% jupyter={"source_hidden": true} tags=["hide-input"]
import numpy as np
import pandas as pd
from scipy.optimize import newton
from scipy.signal import find_peaks

import workbook
from replication import figures
from replication.joint import change, identified_joint, simulate
from studies import claims as measures

workbook.say_times("01_the_joint")

# %% [markdown]
# ## Claim
#
# "A robotic joint is a mechanical system with elastic properties; when properly excited, it
# exhibits oscillations" (section "Proposed approach"). Its [backlash](glossary.md#backlash) is
# modelled by a stiffness $K_s$ outside the gap and 0 inside it, and "unlike the typical dead zone
# models, it does not present discontinuities" (section "Matlab/Simulink model of the robotic joint").
#
# ## Method
#
# The motor (angle $\theta_m$ [rad], speed $\omega_m$ [rad/s], inertia $J_m$ [kg m²], torque
# $\tau_m$ [N m]) turns the load ($\theta_l$, $\omega_l$, $J_l$) through a gear of ratio $N$ and a
# coupling of the torque $\tau_l$ [N m]. $G$ [N m] is the largest torque of gravity, $\theta_l = 0$
# hangs straight down, $\tau_c$ [N m] is Coulomb friction:
#
# $$J_m \dot\omega_m = \tau_m - \tau_l / N, \qquad
# J_l \dot\omega_l = \tau_l - G \sin\theta_l - \tau_c \, \text{sign}(\omega_l)$$
#
# All numbers are identified ([notebook 3](03_simulator_figure10.ipynb)).
#
# ## Parameters

# %% tags=["parameters"]
backlash_mrad = 0.5  # delta, half of the play
friction_share = 0.0  # Coulomb friction on the load, over gravity's largest torque
changes = {}  # factors on ratios of the joint, such as {"K_s/J_l": 0.5}
alphas = [1e3, 1e4, 1e5, 1e6]  # sharpness of the edge, 1/rad

# %% jupyter={"source_hidden": true} tags=["hide-input"]
identified = identified_joint()
workbook.check_parameters(
    globals(),
    backlash_mrad=(0.1, 2.1),
    friction_share=(0, 0.2),
    changes=(changes,),  # applying them says what is wrong
    alphas=[(1, 1e12)],
)

# %% [markdown]
# ## Result
#
# ### Why there are two impacts a turn
#
# At constant speed the coupling carries only gravity and friction,
# $\tau_l \approx G \sin\theta_l + \tau_c$: while this is positive the motor drives the load, on one
# flank; else the load drives the motor, on the other. *Predict:* do the teeth meet when this torque
# changes its sign, before, or after?

# %%
delta = 1e-3 * backlash_mrad
with workbook.explain("changes", changes):
    joint = change(identified, changes)
    # A sharp edge.
    joint = joint._replace(load_coulomb=friction_share * joint.G, clamped=True)
    run = simulate(joint, delta, duration=1.2, sample=1e-4, step=5e-5)
t, r = run.t, run.v - 100
carried = joint.G * np.sin(run.theta_l) + joint.load_coulomb

# %% jupyter={"source_hidden": true} tags=["hide-input"]
impacts = run.impacts[run.impacts >= 0.4]
with workbook.explain("changes", changes):
    second, third = (
        np.abs(r[(t >= each) & (t < each + 0.4)]).max() for each in (0.4, 0.8)
    )
    if third > 1.2 * second:
        raise ValueError(
            f"the ring grows, from {second:.2g} rps in the second turn to "
            f"{third:.2g} in the third: the drive feeds it, as it is unstable"
        )
    if impacts.size < 2 or impacts[1] < impacts[0] + 0.1:
        raise ValueError("the teeth do not meet, or bounce: there is no ring")
apart_s = impacts[1] - impacts[0]
figure, upper, lower = figures.stack(2, 3.8)
upper.fill_between(t, carried, where=carried > 0, label="the motor drives the load")
upper.fill_between(t, carried, where=carried < 0, label="the load drives the motor")
lower.plot(t, r, **figures.FIT)
lower.vlines(run.impacts, r.min(), r.max(), "0.5", ":", label="impacts")
upper.set(ylabel="torque to carry [N m]", xlim=(0.4, 1.2))
lower.set(xlabel="time [s]", ylabel="$r$ [rps]")
signs = t[1:][np.diff(np.sign(carried)) != 0]
after_ms = 1e3 * (impacts[0] - signs[signs <= impacts[0]].max())
workbook.show(
    figures.finish(figure, 2),
    f"After: the first impact shown comes {after_ms:.0f} ms later, because a "
    "torque that begins at zero has to move the load through the gap. The "
    f"next one comes {apart_s:.3f} s after it; half a turn takes "
    f"{joint.turn_period / 2:g} s.",
)

# %% [markdown]
# ### Inside the gap (figure 9)
#
# The teeth are free while the displacement $\Delta\theta = \theta_m / N - \theta_l$ [rad] is within
# $\pm\delta$; with a sharp edge $\tau_l$ is the stiffness $K_s$ [N m/rad] times what exceeds
# $\pm\delta$. The paper smooths the edge with a sharpness $\alpha$ [1/rad], not printed, and adds
# damping $D_s$ [N m s/rad] ($\Delta\omega$ [rad/s] is the rate of $\Delta\theta$):
#
# $$K_{BL}(\Delta\theta, \delta) = \frac{K_s}{\pi}\left[\pi + \arctan(\alpha(\Delta\theta - \delta))
# - \arctan(\alpha(\Delta\theta + \delta))\right] \tag{8}$$
#
# $$\tau_l = \left[\Delta\theta - \delta \cdot \text{sign}(\Delta\theta) + \frac{D_s}{K_s}\Delta\omega\right]
# \cdot K_{BL}(\Delta\theta, \delta) \tag{9}$$
#
# At rest, beside the sharp edge. *Predict:* which part of $K_s$ is left at the edge of the gap,
# and in its middle?


# %%
def K_BL(x, alpha):  # equation 8; x is the displacement
    arctans = np.arctan(alpha * (x - delta)) - np.arctan(alpha * (x + delta))
    return joint.K_s / np.pi * (np.pi + arctans)


def tau_l(x, alpha):  # equation 9
    return (x - delta * np.sign(x)) * K_BL(x, alpha)


# %% jupyter={"source_hidden": true} tags=["hide-input"]
x = np.linspace(-3 * delta, 3 * delta, 1201)
beyond = x - np.clip(x, -delta, delta)
softest = min(alphas)
at_edge, in_middle = K_BL(np.array([delta, 0]), softest) / joint.K_s
figure, stiffness, torque = figures.stack(2, 4.8)
for alpha in alphas:
    label = f"$\\alpha$ = {alpha:.3g} per rad"
    stiffness.plot(1e3 * x, K_BL(x, alpha), label=label, linewidth=2.5)
    torque.plot(1e3 * x, tau_l(x, alpha), linewidth=2.5)
torque.plot(1e3 * x, joint.K_s * beyond, label="clamped dead zone", **figures.FIT)
stiffness.plot(1e3 * x, joint.K_s * (beyond != 0), **figures.FIT)
for axis in (stiffness, torque):
    axis.vlines(1e3 * delta * np.array([-1, 1]), *axis.get_ylim(), "0.5", ":")
stiffness.set(ylabel="stiffness $K_{BL}$ [N m/rad]", yscale="log")
torque.set(
    xlabel="displacement $\\Delta\\theta$ [mrad]", ylabel="torque $\\tau_l$ [N m]"
)
workbook.show_figure(
    "figure09_dead_zone",
    figures.finish(figure, 2),
    "(a) Stiffness of equation 8 and (b) torque of equation 9 by alpha [1/rad], "
    f"and the clamped dead zone, at delta = {backlash_mrad:g} mrad (dotted: its "
    "edges). At "
    f"{softest:,.0f} per rad {100 * at_edge:.3g} % of K_s "
    "are left at the edge, where one of the arctangents is zero, and "
    f"{100 * in_middle:.3g} % in the middle, where they cancel only if alpha "
    "delta is large.",
)

# %% [markdown]
# In the middle equation 8 is about $2 K_s / (\pi\alpha\delta)$: equation 9 jumps by
# $2 \delta K_{BL}(0, \delta)$.
#
# ### The drive
#
# The drive compares, at $t_k = k T_c$ with $T_c$ = 0.5 ms, the motor's angle and speed with those
# commanded, $N\theta_0 + \Omega t_k$ and $\Omega$ = 2π · 100 rad/s ($\theta_0$: the load's angle at
# $t = 0$). The gains $K_\text{pos}$ [1/s] of the position and $K_p$ [N m s] of the speed act on the
# error $e_k$ [rad/s]; $K_i$ [N m] sums it up in $I_k$ [N m]; a derivative $K_d$ [N m s²] damps; a
# leaky integrator $w_k$ [rad] of gain $K_w$ [N m] forgets at the rate $a_w$ [1/s]:
#
# $$e_k = K_\text{pos}\left[N\theta_0 + \Omega t_k - \theta_m(t_k)\right] + \Omega - \omega_m(t_k)$$
#
# $$I_k = I_{k-1} + K_i T_c e_k, \qquad w_k = w_{k-1} + T_c\left[\Omega - \omega_m(t_k) - a_w w_{k-1}\right]$$
#
# $$u_k = K_p e_k + I_k + K_w w_k - K_d \frac{\omega_m(t_k) - \omega_m(t_{k-1})}{T_c}$$
#
# The torque $u_k$ [N m] is applied one period late and held, and the current loop follows with the
# lag $T_\tau$ [s]: $T_\tau \dot\tau_m = u_{k-1} - \tau_m$ for $t_k \le t < t_{k+1}$.
#
# `replication.joint.simulate` solves these equations (`drive`, `rates`); a test compares it with SciPy's
# `solve_ivp`.
#
# ### Why it rings near 21 Hz, and decays
#
# With the teeth in contact the joint is linear: it rings, with the decay $\sigma$ [1/s]. If the
# motor resists a motion $e^{st}$ of its angle with the torque $Z(s)$ [N m/rad], the load swings on
# $K_s$ and, through the gear, on $N^2 Z$:
#
# $$J_l s^2 + \frac{K_s \, N^2 Z(s)}{K_s + N^2 Z(s)} = 0, \qquad s = -\sigma + i\omega.$$
#
# The integral of the speed's error is the error of the position, so the drive holds the motor like
# a spring: $Z \approx K_i + K_p K_{pos} + K_w$, the first step, *two springs*. *Predict:* which
# term makes the ring decay?


# %%
def impedances(j):  # Z(s), a term a step
    spring = j.K_i + j.K_p * j.K_pos + j.K_w

    # The lag, one period of delay, and half a period as the torque is held.
    def late(s):
        return np.exp(-1.5 * j.period * s) / (1 + j.torque_lag * s)

    # The leak of K_w, and the integral of the position's error.
    def leak_and_integral(s):
        return j.K_w * (s / (s + j.w_rate) - 1) + j.K_i * j.K_pos / s

    def lagging(s):
        return j.J_m * s**2 + late(s) * (spring + j.K_p * s + j.K_d * s**2)

    return {
        "two springs": lambda s: spring,
        "+ K_p": lambda s: spring + j.K_p * s,
        "+ J_m": lambda s: spring + j.K_p * s + j.J_m * s**2,
        "+ K_d": lambda s: spring + j.K_p * s + (j.J_m + j.K_d) * s**2,
        "+ lag and delay": lagging,
        "all": lambda s: lagging(s) + late(s) * leak_and_integral(s),
    }


# %%
def ring_modes(j):  # s of each step
    def characteristic(s, Z):  # the equation above without its fraction
        return j.J_l * s**2 * (j.K_s + j.N**2 * Z(s)) + j.K_s * j.N**2 * Z(s)

    steps = impedances(j).values()
    return np.array([newton(characteristic, 140j, args=(Z,)) for Z in steps])


with workbook.explain("changes", changes):
    modes = ring_modes(joint)
ring = pd.DataFrame(
    {"frequency [Hz]": modes.imag / (2 * np.pi), "decay [1/s]": -modes.real},
    index=[*impedances(joint)],
)
ring.round(1) + 0.0  # no -0.0

# %% jupyter={"source_hidden": true} tags=["hide-input"]
gained = ring["decay [1/s]"].diff()
workbook.say(
    f"“{gained.idxmax()}” adds most to the decay, {gained.max():+.0f} 1/s; "
    f"“{gained.idxmin()}” changes it by {gained.min():+.0f} 1/s."
)

# %% [markdown]
# A torque against the speed ($K_p$) takes energy out; a late one opposes it less.
#
# From 20 ms after an impact until the teeth part, the time from crest to crest of the simulated speed
# is a period. *Predict:* does it ring as the terms say?

# %% jupyter={"source_hidden": true} tags=["hide-input"]
free = (t > impacts[0] + 0.02) & (t < impacts[1]) & (run.gap != 0)
crests, _ = find_peaks(r[free])
with workbook.explain("changes", changes):
    period_s, *_ = np.diff(t[free][crests])
ring_hz = 1 / period_s
both = {
    "simulate": (t, r, figures.WIDE),
    "crests": (t[free][crests], r[free][crests], figures.MARKS),
}
springs, whole = ring.iloc[0], ring.iloc[-1]
by_terms = (
    f"all terms together give {whole.iloc[0]:.1f} Hz and {whole.iloc[1]:.0f} 1/s"
)
alike = np.isclose(ring_hz, whole.iloc[0], rtol=0.1)
workbook.show(
    figures.curves(both, "time [s]", "$r$ [rps]", xlim=(0.4, 0.8)),
    f"{'Nearly' if alike else 'No'}: it rings at {ring_hz:.1f} Hz; {by_terms}.",
)

# %% [markdown]
# ## Verdict
#
# Claims are decided at Table 2's backlashes, at $10^5$ and $10^6$ per rad.

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
ALPHA = 1e5
share = K_BL(0.0, ALPHA) / joint.K_s
jump = tau_l(-1e-15, ALPHA) - tau_l(1e-15, ALPHA)
workbook.verdict(
    f"With a backlash of {backlash_mrad:g} mrad the simulated speed rings at "
    f"{ring_hz:.1f} Hz; {by_terms}, two springs alone {springs.iloc[0]:.1f} Hz and "
    f"no decay. At $\\alpha = 10^5$ per rad equation 8 leaves {100 * share:.2g} % "
    "of $K_s$ in the middle of the gap, and equation 9 jumps there by "
    f"{jump:.2g} N "
    "m. Both vanish for no finite $\\alpha$: the paper's sentences are "
    "approximations ([errata E8, E9](../results/report.md#errata)).",
    claims=measures.write_all(measures.measure_dead_zone(joint)),
)

# %% [markdown]
# ## Try changing

# %% jupyter={"source_hidden": true} tags=["hide-input", "promises"]
workbook.try_changing(
    (
        'changes = {"K_s/J_l": 0.5}',
        "a softer coupling rings more slowly, and two springs are nearly right",
        lambda now, was: (
            now.ring_hz < 0.9 * was.ring_hz
            and abs(now.springs.iloc[0] / now.whole.iloc[0] - 1)
            < abs(was.springs.iloc[0] / was.whole.iloc[0] - 1)
        ),
    ),
    (
        "backlash_mrad = 1.5",
        "a gap three times as wide is crossed later, and a third of the stiffness "
        "is left in its middle",
        lambda now, was: (
            now.after_ms > was.after_ms and 0.3 < now.share / was.share < 0.36
        ),
    ),
    (
        "friction_share = 0.05",
        "gravity has to overcome friction first, so the impacts are no longer "
        "half a turn apart",
        lambda now, was: abs(now.apart_s - 0.2) > 2 * abs(was.apart_s - 0.2),
    ),
)

# %% [markdown]
# ## Exercises
#
# Answer by the `name`; the cell below says *right* or *not yet*. Solutions are folded in the
# committed notebooks.

# %%
fall_ms = alpha_1_percent = weak_decay = np.nan  # your answers

# %% [markdown]
# **1.** Suppose that the teeth part at the top without a relative speed, and that the motor keeps
# its speed: how long (`fall_ms` [ms], to 1) does the load take to fall through $2\delta$? Gravity's
# torque is about $G \Omega t / N$. Why does the simulated load need less?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
# The load's acceleration is G Omega t / (N J_l); it is integrated twice:
# 2 delta = G Omega t**3 / (6 N J_l).
cubed = 12 * delta * joint.J_l * joint.N / (joint.G * joint.Omega)
fall_ms = 1e3 * np.cbrt(cubed)
touching = t[(t < impacts[1]) & (run.gap != 0)]
# When the teeth part, the coupling unwinds at the rate G Omega / (N K_s).
print(f"{fall_ms:.1f} ms against {1e3 * (impacts[1] - touching[-1]):.1f} ms")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
cubed = 12 * delta * joint.N * joint.J_l / (joint.G * joint.Omega)
workbook.check_answer(fall_ms, 1e3 * np.cbrt(cubed), to=1)

# %% [markdown]
# **2.** Which $\alpha$ (`alpha_1_percent` [1000/rad], to 0.5) leaves 1 % of $K_s$ in the middle of a
# gap of $\delta$ = 1.5 mrad?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
alpha_1_percent = 1e-3 * np.tan(0.99 * np.pi / 2) / 15e-4
print(f"{alpha_1_percent:.1f} thousand per rad")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(alpha_1_percent, 42.44, to=0.5)

# %% [markdown]
# **3.** Halve the identified joint's $K_p$. At which rate (`weak_decay` [1/s], all terms, with its
# sign, to 0.5) does the ring decay, and what does the sign mean?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
weak_decay = -ring_modes(identified._replace(K_p=identified.K_p / 2))[-1].real
print(f"{weak_decay:.1f} 1/s: below 0 the ring grows, and the drive is unstable")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
halved = change(identified, {"K_p": 0.5})
workbook.check_answer(weak_decay, -ring_modes(halved)[-1].real, to=0.5)

# %% [markdown]
# **What you have learnt**: gravity opens the gap twice a turn, a smooth dead zone leaves stiffness
# in it, and drive and coupling together set the ring. *Next:* [the growth of
# the disturbance](04_growth_figure11.ipynb), or [the simulator](03_simulator_figure10.ipynb).
