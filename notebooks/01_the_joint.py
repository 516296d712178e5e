# %% [markdown]
# # 1 · The joint: why its motor speed rings
#
# *You will solve the equations of the joint and its drive with SciPy, and build up the frequency
# and the decay of its ring, one term a step. Reading time: 11 min. Run time: 15 s. Before this:
# notebook [0](00_the_sensor.ipynb).*
#
# ## Claim
#
# "A robotic joint is a mechanical system with elastic properties; when properly excited, it
# exhibits oscillations" (section "Proposed approach"). Two impacts in each [turn](glossary.md#turn)
# of the load excite them.
#
# ## Method
#
# **The mechanics.** The motor (angle $\theta_m$ [rad], speed $\omega_m = \dot\theta_m$ [rad/s],
# inertia $J_m$ [kg m²]) turns the load ($\theta_l$, $\omega_l$, $J_l$) through a gear of ratio $N$
# and an elastic coupling. $\tau_m$ and $\tau_l$ [N m] are the torques of motor and coupling. $G$ [N
# m] is the largest torque of gravity, $\theta_l = 0$ hangs straight down, and $\tau_c$ [N m] is
# Coulomb friction:
#
# $$J_m \dot\omega_m = \tau_m - \tau_l / N, \qquad
# J_l \dot\omega_l = \tau_l - G \sin\theta_l - \tau_c \, \text{sign}(\omega_l)$$
#
# The coupling, of stiffness $K_s$ [N m/rad], is free while the displacement
# $\Delta\theta = \theta_m / N - \theta_l$ is within the [backlash](glossary.md#backlash)
# $\pm\delta$. This notebook takes a sharp edge; equations 8 and 9 smooth it ([notebook
# 2](02_dead_zone_figure9.ipynb)):
#
# $$\tau_l = K_s \left(\Delta\theta - \delta\,\text{sign}(\Delta\theta)\right) \quad\text{for } |\Delta\theta| > \delta,
# \text{ else } 0$$
#
# **The drive.** Every period $T_c$ = 0.5 ms, at $t_k = k T_c$, it compares the motor's angle and
# speed with those commanded, $N\theta_0 + \Omega t_k$ and $\Omega$ = 2π · 100 rad/s, where
# $\theta_0$ is the load's angle at $t = 0$. A position gain $K_\text{pos}$ and a speed gain $K_p$
# act on the error $e_k$ [rad/s], the integral $I_k$ adds it up, a derivative $K_d$ damps, and a
# leaky integrator $w_k$ [rad] forgets at the rate $a_w$:
#
# $$e_k = K_\text{pos}\left[N\theta_0 + \Omega t_k - \theta_m(t_k)\right] + \Omega - \omega_m(t_k)$$
#
# $$I_k = I_{k-1} + K_i T_c e_k, \qquad w_k = w_{k-1} + T_c\left[\Omega - \omega_m(t_k) - a_w w_{k-1}\right]$$
#
# $$u_k = K_p e_k + I_k + K_w w_k - K_d \frac{\omega_m(t_k) - \omega_m(t_{k-1})}{T_c}$$
#
# The torque is applied one period late and held for a period, and the current loop follows it with
# the lag $T_\tau$ [s]:
#
# $$T_\tau \dot\tau_m = u_{k-1} - \tau_m \quad\text{for}\quad t_k \le t < t_{k+1}$$
#
# The numbers were identified from the published signals ([notebook
# 3](03_simulator_figure10.ipynb)). The speed tells only ratios such as $K_s/J_l$; the paper's load
# of 5 kg fixes their size. The paper writes $\tau$ for the damping of the signature too; here
# $\tau$ is a torque, and the decay of the ring is $\sigma$ [1/s].

# %%
import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit, newton

import workbook
from replication.joint import change, identified_joint, ratios, simulate

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
backlash_mrad = 0.5  # delta, half of the play
friction_share = 0.0  # Coulomb friction on the load, over the largest torque of gravity
changes = {}  # factors on ratios of the joint, such as {"K_s/J_l": 0.5}

# %% jupyter={"source_hidden": true} tags=["hide-input"]
identified = identified_joint()
workbook.check_parameters(
    backlash_mrad=(backlash_mrad, (0.1, 2.1)),
    friction_share=(friction_share, (0, 0.2)),
    changes=(changes, dict.fromkeys(ratios(identified), (0, 10))),
)

# %% [markdown]
# ## Result
#
# ### Why there are two impacts a turn
#
# At constant speed the coupling carries only gravity and friction,
# $\tau_l \approx G \sin\theta_l + \tau_c$. While that is positive the motor drives the load, on one
# flank; while it is negative the load drives the motor, on the other. Without friction the sign
# changes at the top ($\theta_l = \pi$) and at the bottom ($2\pi$). Each time the teeth cross the
# gap $2\delta$ and meet with an impact. At the top the load runs ahead and pushes the motor: its
# speed jumps up. At the bottom the load falls back and brakes the motor: its speed drops.

# %%
delta = 1e-3 * backlash_mrad
with workbook.explain("changes", changes):
    joint = change(identified, changes)
    joint = joint._replace(load_coulomb=friction_share * joint.G, clamped=True)  # a sharp edge
    run = simulate(joint, delta, duration=1.2, sample=1e-4, step=5e-5)
t, r = run.t, run.v - 100
carried = joint.G * np.sin(run.theta_l) + joint.load_coulomb

# %%
_, (upper, lower) = plt.subplots(2, sharex=True, figsize=(8, 4), layout="constrained")
upper.fill_between(t, carried, where=carried > 0, label="the motor drives the load")
upper.fill_between(t, carried, where=carried < 0, label="the load drives the motor")
lower.plot(t, r)
lower.vlines(run.impacts, r.min(), r.max(), "0.5", ":", label="impacts")
upper.set(ylabel="torque to carry [N m]", xlim=(0.4, 1.2))
lower.set(xlabel="time [s]", ylabel="r(t) [rps]")
for axis in (upper, lower):
    axis.legend(loc="upper right")

# %% [markdown]
# ### The same with SciPy
#
# `simulate` is compiled, finds each contact exactly and takes milliseconds. These cells solve the
# equations above with `solve_ivp`, from one control period to the next: mechanics, drive, loop.


# %%
def rates(_, state, u, j):
    theta_m, omega_m, theta_l, omega_l, tau_m = state
    x = theta_m / j.N - theta_l
    tau_l = j.K_s * (x - np.clip(x, -delta, delta))
    load = j.G * np.sin(theta_l) + j.load_coulomb * np.sign(omega_l)
    motor = (tau_m - tau_l / j.N) / j.J_m
    return omega_m, motor, omega_l, (tau_l - load) / j.J_l, (u - tau_m) / j.torque_lag


# %%
def drive(k, theta_m, omega_m, before, integral, w, j):
    commanded = j.N * j.start_angle + j.Omega * k * j.period
    e = j.K_pos * (commanded - theta_m) + j.Omega - omega_m
    integral += j.K_i * j.period * e
    w += j.period * (j.Omega - omega_m - j.w_rate * w)
    derivative = (omega_m - before) / j.period
    return j.K_p * e + integral + j.K_w * w - j.K_d * derivative, integral, w


# %%
def solve_joint(j, seconds):  # motor speed at each period of the drive
    first = -round(j.lead / j.period)  # before the record begins, with the teeth in contact
    theta_l = j.start_angle + j.Omega / j.N * first * j.period
    tau_l = j.G * np.sin(theta_l) + j.load_coulomb
    twist = np.sign(tau_l) * delta + tau_l / j.K_s
    state = np.array([j.N * theta_l, j.Omega, theta_l - twist, j.Omega / j.N, tau_l / j.N])
    u = integral = tau_l / j.N
    w, before, speeds = 0.0, j.Omega, []
    for k in range(first, round(seconds / j.period) + 1):
        theta_m, omega_m = state[:2]
        speeds.append(omega_m)
        held = u  # computed one period ago
        u, integral, w = drive(k, theta_m, omega_m, before, integral, w, j)
        before = omega_m
        state = solve_ivp(rates, (0, j.period), state, args=(held, j), rtol=1e-8, atol=1e-9).y[
            :, -1
        ]
    return np.array(speeds[-first:])


# %%
r_scipy = solve_joint(joint, 0.8) / (2 * np.pi) - 100
t_k, of_simulate = t[::5][: r_scipy.size], r[::5][: r_scipy.size]
apart_rps = np.abs(r_scipy - of_simulate)[t_k >= 0.4].max()
_, axis = plt.subplots(figsize=(8, 2.5), layout="constrained")
axis.plot(t_k, of_simulate, linewidth=4, color="0.8", label="simulate")
axis.plot(t_k, r_scipy, label="SciPy")
axis.set(xlim=(0.4, 0.8), xlabel="time [s]", ylabel="r(t) [rps]")
_ = axis.legend()

# %% [markdown]
# ### Why it rings near 21 Hz, and decays
#
# With the teeth in contact the joint is linear. Let the motor resist a motion $e^{st}$ of its angle
# with the torque $Z(s)$ [N m/rad]. Then the load swings on the coupling $K_s$ and, through the
# gear, on $N^2 Z$, in series:
#
# $$J_l s^2 + \frac{K_s \, N^2 Z(s)}{K_s + N^2 Z(s)} = 0, \qquad s = -\sigma + i\omega.$$
#
# The integral of the speed's error is the error of the position. So the drive holds the motor like
# a spring, with damping: $Z \approx K_i + K_p K_{pos} + K_w$. That is the first step, *two
# springs*. Each further step adds one term.


# %%
def impedances(j):  # Z(s), a term a step
    spring = j.K_i + j.K_p * j.K_pos + j.K_w

    def late(s):  # lag, one period of delay, and half a period because the torque is held
        return np.exp(-1.5 * j.period * s) / (1 + j.torque_lag * s)

    def leak_and_integral(s):  # the leak of K_w, and the integral of the position's error
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

    return np.array([newton(characteristic, 140j, args=(Z,)) for Z in impedances(j).values()])


with workbook.explain("changes", changes):
    modes = ring_modes(joint)
ring = pd.DataFrame({"frequency [Hz]": modes.imag / (2 * np.pi), "decay [1/s]": -modes.real})
ring.index = list(impedances(joint))
ring.round(1)

# %% [markdown]
# Beside them the simulated ring: from 20 ms after an impact until the teeth part again it is a
# damped oscillation on a parabola, which absorbs gravity's slow change.


# %%
def oscillation(t, decay, omega, a, b, c, d, e):
    wave = a * np.cos(omega * t) + b * np.sin(omega * t)
    return np.exp(-decay * t) * wave + c + d * t + e * t**2


impacts = run.impacts[run.impacts >= 0.4]
with workbook.explain("changes", changes):
    if impacts.size < 2:
        raise ValueError("the teeth meet less than twice in two turns: there is no ring")
    parted = t[(t > impacts[0] + 0.02) & (run.gap == 0)]
    free = (t > impacts[0] + 0.02) & (t < (parted[0] if parted.size else t[-1]))
    start = [-modes[-1].real, modes[-1].imag, 0.1, 0.1, 0, 0, 0]
    fitted, _ = curve_fit(oscillation, t[free] - impacts[0], r[free], start)

# %%
_, axis = plt.subplots(figsize=(8, 2.5), layout="constrained")
axis.plot(t, r, linewidth=4, color="0.8", label="simulate")
axis.plot(t[free], oscillation(t[free] - impacts[0], *fitted), label="fitted oscillation")
axis.set(xlim=(0.4, 0.8), xlabel="time [s]", ylabel="r(t) [rps]")
_ = axis.legend()

# %% [markdown]
# ## Verdict

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
springs, whole = ring.iloc[0], ring.iloc[-1]
workbook.verdict(
    f"With a backlash of {backlash_mrad:g} mrad the simulated speed rings at {fitted[1] / (2 * np.pi):.1f} Hz and "
    f"decays at {fitted[0]:.0f} 1/s; all terms together give {whole.iloc[0]:.1f} Hz and {whole.iloc[1]:.0f} 1/s, two "
    f"springs alone {springs.iloc[0]:.1f} Hz and no decay. SciPy's solution and `simulate` are at most "
    f"{max(apart_rps, 1e-5):.5f} rps apart in the second turn. From there on the first two impacts lie "
    f"{np.diff(impacts)[0]:.4f} s apart; half a turn is {joint.turn_period / 2:g} s."
)

# %% [markdown]
# ## Try changing
#
# 1. `changes = {"K_s/J_l": 0.5}`: a softer coupling rings more slowly, and two springs are nearly
#    right.
# 2. `changes = {"K_w/J_m": 0.0}`: without $K_w$ the drive's spring is stiffer; the joint rings
#    faster, and longer.
# 3. `friction_share = 0.05`: gravity has to overcome friction first, so the impacts are no longer
#    half a turn apart.
#
# ## Exercises
#
# Each asks for a number by its `name`. The cell below your answer says *right* or *not yet*.

# %%
fall_s = quick_decay = weak_decay = np.nan  # your answers

# %% [markdown]
# **1.** In the gap no torque holds the load. Suppose that the teeth part at the top without a
# relative speed, and that the motor keeps its speed: how long (`fall_s`) does it take the load to
# fall through $2\delta$? Compare it with the simulated time in the gap, and say why that is shorter.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
fall_s = (12 * delta * joint.J_l * joint.N / (joint.G * joint.Omega)) ** (1 / 3)
# The load's acceleration is about G Omega t / (N J_l); twice integrated, 2 delta = G Omega t**3 / (6 N J_l).
touching = t[(t < impacts[1]) & (run.gap != 0)]
# In the simulation the coupling unwinds at the rate G Omega / (N K_s) when the teeth part.
print(f"{1e3 * fall_s:.1f} ms against {1e3 * (impacts[1] - touching[-1]):.1f} ms")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
cubed = 2 * delta * 6 * joint.N * joint.J_l / (joint.G * joint.Omega)
workbook.check_answer(fall_s, lambda fall: np.isclose(fall**3, cubed, rtol=0.05))

# %% [markdown]
# **2.** A newer drive has half the lag $T_\tau$ of the identified joint's. At which rate
# (`quick_decay` [1/s], all terms) does the ring decay? Does it last longer or shorter?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
quick_decay = -ring_modes(identified._replace(torque_lag=identified.torque_lag / 2))[-1].real
print(f"{quick_decay:.1f} 1/s: less lag undoes less of the damping")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
quick = identified._replace(torque_lag=0.5 * identified.torque_lag)
workbook.check_answer(quick_decay, -ring_modes(quick)[-1].real, rtol=0.01)

# %% [markdown]
# **3.** Halve the identified joint's speed gain $K_p$. At which rate (`weak_decay` [1/s], all terms)
# does the ring decay, and what does its sign mean?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
weak_decay = -ring_modes(identified._replace(K_p=identified.K_p / 2))[-1].real
print(f"{weak_decay:.1f} 1/s: below 0 the ring grows, and the drive is unstable")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
weak = identified._replace(K_p=0.5 * identified.K_p)
workbook.check_answer(weak_decay, -ring_modes(weak)[-1].real, rtol=0.01)

# %% [markdown]
# **What you have learnt**: gravity opens the gap twice a turn, and drive and coupling together set
# the ring's frequency and decay. *Next:* [the dead zone](02_dead_zone_figure9.ipynb).
