# %% [markdown]
# # 1 · The joint: why its motor speed rings
#
# *You will solve the joint's equations of motion with SciPy, and build up the frequency and the
# decay of its ring, one term a step. Run time: 6 s. Before this: notebook
# [0](00_the_sensor.ipynb).*
#
# ## Claim
#
# "A robotic joint is a mechanical system with elastic properties; when properly excited, it
# exhibits oscillations" (section "Proposed approach"). Two impacts in each [turn](glossary.md#turn)
# of the load excite them.
#
# ## Method
#
# The motor (angle $\theta_m$ [rad], speed $\omega_m = \dot\theta_m$ [rad/s], inertia $J_m$ [kg m²])
# turns the load ($\theta_l$, $\omega_l$, $J_l$) through a gear of ratio $N$ and an elastic
# coupling. $\tau_m$ and $\tau_l$ [N m] are the torques of motor and coupling. $G$ [N m] is the
# largest torque of gravity, $\theta_l = 0$ hangs straight down, and $\tau_c$ [N m] is Coulomb
# friction:
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
# A digital [drive](glossary.md#drive) holds the commanded speed $\Omega$ [rad/s]. Its equations,
# and the fit of all numbers to the published signals, stand in [notebook
# 9](09_identification_of_the_joint.ipynb): a speed loop (gains $K_p$, $K_i$, $K_d$, and $K_w$ of an
# integrator that forgets at the rate $a_w$) within a position loop ($K_{pos}$), computed every
# $T_c$ [s], one period late, with the lag $T_\tau$ [s] of the torque. The speed tells only ratios
# such as $K_s/J_l$; the paper's load of 5 kg fixes their size.
#
# The paper writes $\tau$ for the damping of the [signature](glossary.md#signature) too. Here $\tau$
# is a torque, and the decay of the ring is $\sigma$ [1/s].

# %%
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit, newton

import workbook
from replication.simulator.checks import closed_loop_matrix
from replication.simulator.parameters import identified_joint, with_ratios
from replication.simulator.simulate import simulate

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
backlash_mrad = 0.5  # delta, half of the play
friction_share = 0.0  # Coulomb friction on the load, over the largest torque of gravity
changes = {}  # factors on ratios of the joint, such as {"stiffness_per_s2": 0.5}

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    backlash_mrad=(backlash_mrad, workbook.Interval(0.1, 2.1)),
    friction_share=(friction_share, workbook.Interval(0, 0.2)),
    changes=(changes, dict.fromkeys(identified_joint().ratios, workbook.Interval(0))),
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
delta, joint = 1e-3 * backlash_mrad, identified_joint()
joint = with_ratios(joint, {name: changes[name] * joint.ratios[name] for name in changes})
tau_c = friction_share * joint.gravity_torque_nm
joint = replace(joint, load_coulomb_nm=tau_c, clamped=True)  # a sharp edge
run = simulate(joint, delta, duration_s=1.2, sample_s=1e-4, step_s=5e-5)
t, r = run.time_s, run.motor_speed_rps - joint.commanded_speed_rps
carried = joint.gravity_torque_nm * np.sin(run.load_position_rad) + tau_c

# %%
_, (upper, lower) = plt.subplots(2, sharex=True, figsize=(8, 4), layout="constrained")
upper.fill_between(t, carried, where=carried > 0, label="the motor drives the load")
upper.fill_between(t, carried, where=carried < 0, label="the load drives the motor")
lower.plot(t, r)
lower.vlines(run.impact_time_s, r.min(), r.max(), "0.5", ":", label="impacts")
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
N = joint.gear_ratio
J_m, J_l = joint.motor_inertia_kgm2, joint.load_inertia_kgm2
K_s, G = joint.stiffness_nm_per_rad, joint.gravity_torque_nm
T_tau, T_c = joint.torque_lag_s, joint.control_period_s


def rates(_, state, u):
    theta_m, omega_m, theta_l, omega_l, tau_m = state
    x = theta_m / N - theta_l
    tau_l = K_s * (x - np.clip(x, -delta, delta))
    load = G * np.sin(theta_l) + tau_c * np.sign(omega_l)
    return omega_m, (tau_m - tau_l / N) / J_m, omega_l, (tau_l - load) / J_l, (u - tau_m) / T_tau


# %%
Omega, theta_0 = joint.commanded_speed_rad_per_s, joint.start_angle_rad
K_pos, K_p = joint.position_gain_per_s, joint.speed_gain_nms_per_rad
K_i, K_d = joint.integral_gain_nm_per_rad, joint.derivative_gain_nms2_per_rad
K_w, a_w = joint.leaky_gain_nm_per_rad, joint.leaky_rate_per_s


def drive(k, theta_m, omega_m, before, integral, w):  # equations of notebook 9
    e = K_pos * (N * theta_0 + Omega * k * T_c - theta_m) + Omega - omega_m
    integral += K_i * T_c * e
    w += T_c * (Omega - omega_m - a_w * w)
    return K_p * e + integral + K_w * w - K_d * (omega_m - before) / T_c, integral, w


# %%
first = -round(joint.lead_s / T_c)  # it starts before the record does, with the teeth in contact
theta_l = theta_0 + Omega / N * first * T_c
tau_l = G * np.sin(theta_l) + tau_c
twist = np.sign(tau_l) * delta + tau_l / K_s
state = np.array([N * theta_l, Omega, theta_l - twist, Omega / N, tau_l / N])
u = integral = tau_l / N
w, before = 0.0, Omega
speeds = []
for k in range(first, round(0.8 / T_c) + 1):
    theta_m, omega_m = state[:2]
    speeds.append(omega_m)
    held = u  # computed one period ago
    u, integral, w = drive(k, theta_m, omega_m, before, integral, w)
    before = omega_m
    state = solve_ivp(rates, (0, T_c), state, args=(held,), rtol=1e-9, atol=1e-9).y[:, -1]

# %%
r_scipy = (np.array(speeds[-first:]) - Omega) / (2 * np.pi)
t_k, of_simulate = t[::5][: r_scipy.size], r[::5][: r_scipy.size]
difference = np.abs(r_scipy - of_simulate)[t_k >= 0.4]
_, axis = plt.subplots(figsize=(8, 2.5), layout="constrained")
axis.plot(t_k, of_simulate, linewidth=4, color="0.8", label="simulate")
axis.plot(t_k, r_scipy, label="SciPy")
axis.set(xlim=(0.4, 0.8), xlabel="time [s]", ylabel="r(t) [rps]")
axis.legend()
print(f"second turn: at most {difference.max():.1g} rps apart")

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
spring = K_i + K_p * K_pos + K_w


def late(s):  # lag, one period of delay, and half a period because the torque is held
    return np.exp(-1.5 * T_c * s) / (1 + T_tau * s)


def leak_and_integral(s):  # the leak of K_w, and the integral of the position's error
    return K_w * (s / (s + a_w) - 1) + K_i * K_pos / s


# %%
steps = {
    "two springs": lambda s: spring,
    "+ K_p": lambda s: spring + K_p * s,
    "+ J_m": lambda s: spring + K_p * s + J_m * s**2,
    "+ K_d": lambda s: spring + K_p * s + (J_m + K_d) * s**2,
    "+ lag and delay": lambda s: J_m * s**2 + late(s) * (spring + K_p * s + K_d * s**2),
    "all": lambda s: steps["+ lag and delay"](s) + late(s) * leak_and_integral(s),
}


# %%
def characteristic(s, Z):  # the equation above without its fraction
    return J_l * s**2 * (K_s + N**2 * Z(s)) + K_s * N**2 * Z(s)


s = np.array([newton(characteristic, 140j, args=(Z,)) for Z in steps.values()])
ring = pd.DataFrame({"frequency [Hz]": s.imag / (2 * np.pi), "decay [1/s]": -s.real}, list(steps))

# %%
_, axis = plt.subplots(figsize=(7, 3.5), layout="constrained")
axis.plot(ring["decay [1/s]"], ring["frequency [Hz]"], "o-")
for step, (frequency, decay) in ring.iterrows():
    axis.annotate(step, (decay, frequency), xytext=(4, 6), textcoords="offset points")
axis.set(xlabel="decay of the ring [1/s]", ylabel="frequency [Hz]", xlim=(-2, 48))
ring.round(1)

# %% [markdown]
# Two springs alone come near the committed joint's frequency, partly by luck: what they leave out
# is as large as their spring, and cancels. They give no decay at all. The decay is the drive's:
# $K_p$ damps the ring, and what acts late undoes much of it. So the frequency *and* the damping of
# the signature depend on the drive's settings, not on the gear alone.
#
# $K_w$ is negative: it makes the drive's spring softer. It came out of the fit to the signals; we
# do not know why.

# %% [markdown]
# ### Is it what the speed does?
#
# A damped oscillation is fitted to the simulated speed, from 20 ms after an impact until the teeth
# part again; a parabola absorbs gravity's slow change. Beside it the sampled loop without
# approximation: one control period multiplies the state by a matrix, and an eigenvalue $\lambda$ of
# it is a mode $s = \ln(\lambda) / T_c$.


# %%
def oscillation(t, decay, omega, a, b, c, d, e):
    wave = a * np.cos(omega * t) + b * np.sin(omega * t)
    return np.exp(-decay * t) * wave + c + d * t + e * t**2


def ringing_mode(joint):  # the oscillation that lasts longest
    eigenvalues = np.linalg.eigvals(closed_loop_matrix(joint)).astype(complex)
    s = np.log(eigenvalues[np.abs(eigenvalues) > 1e-3]) / joint.control_period_s
    return max(s[s.imag > 1], key=np.real)


# %%
impacts = run.impact_time_s[run.impact_time_s >= 0.4]
parted = run.separation_time_s[run.separation_time_s > impacts[0]][0]
free = (t > impacts[0] + 0.02) & (t < parted)
start = [15, 130, 0.1, 0.1, 0, 0, 0]
fitted, _ = curve_fit(oscillation, t[free] - impacts[0], r[free], start)
mode = ringing_mode(joint)
_, axis = plt.subplots(figsize=(8, 2.5), layout="constrained")
axis.plot(t, r, linewidth=4, color="0.8", label="simulate")
axis.plot(t[free], oscillation(t[free] - impacts[0], *fitted), label="fitted oscillation")
axis.set(xlim=(0.4, 0.8), xlabel="time [s]", ylabel="r(t) [rps]")
_ = axis.legend()

# %% [markdown]
# ## Verdict

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
workbook.verdict(
    f"With a backlash of {backlash_mrad:g} mrad the simulated speed rings at {fitted[1] / (2 * np.pi):.2f} Hz and "
    f"decays at {fitted[0]:.1f} 1/s. The sampled loop has {mode.imag / (2 * np.pi):.2f} Hz and {-mode.real:.1f} 1/s, "
    f"the continuous one {ring.iloc[-1, 0]:.1f} Hz and {ring.iloc[-1, 1]:.0f} 1/s, two springs "
    f"{ring.iloc[0, 0]:.1f} Hz and no decay: they miss the frequency by "
    f"{100 * (ring.iloc[0, 0] / ring.iloc[-1, 0] - 1):+.0f} %. The first two impacts of the second turn lie "
    f"{np.diff(impacts)[0]:.4f} s apart, half a turn is {joint.turn_period_s / 2:g} s."
)

# %% [markdown]
# ## Try changing
#
# 1. `changes = {"stiffness_per_s2": 0.5}`: a softer coupling rings more slowly, and two springs are
#    nearly right.
# 2. `changes = {"leaky_gain_per_s2": 0.0}`: without $K_w$ the drive's spring is stiffer; the joint
#    rings faster, and longer.
# 3. `friction_share = 0.05`: gravity has to overcome friction first, so the impacts are no longer
#    half a turn apart.
#
# ## Exercises
#
# **1.** In the gap no torque holds the load. Suppose that the teeth part at the top without a
# relative speed, and that the motor keeps its speed: how long does it take the load to fall through
# $2\delta$? How does this time grow with $\delta$? Compare it with the simulated one, and say why
# that is shorter.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
# The load's acceleration is about G Omega t / (N J_l); twice integrated, 2 delta = G Omega t**3 / (6 N J_l).
fall_s = (12 * delta * J_l * N / (G * Omega)) ** (1 / 3)  # grows with the cube root of delta
met = impacts[1]  # at the top
gap_s = met - run.separation_time_s[run.separation_time_s < met][-1]
assert gap_s < fall_s  # as the coupling unwinds at the rate G Omega / (N K_s) when they part
print(f"{1e3 * fall_s:.1f} ms against {1e3 * gap_s:.1f} ms")

# %% [markdown]
# **2.** A newer drive has half the lag $T_\tau$. Does the joint ring longer or shorter? Find the
# eigenvalue.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
quicker = ringing_mode(replace(joint, torque_lag_s=T_tau / 2))
assert -quicker.real > -mode.real  # less lag undoes less of the damping
print(f"decay {-quicker.real:.1f} 1/s instead of {-mode.real:.1f} 1/s")

# %% [markdown]
# **3.** Halve the speed gain $K_p$. What happens to the ring?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
weaker = {"speed_gain_per_s": joint.ratios["speed_gain_per_s"] / 2}
weak = ringing_mode(with_ratios(joint, weaker))
assert weak.real > mode.real  # the ring decays more slowly, or grows: the drive is unstable
print(f"decay {-weak.real:.1f} 1/s instead of {-mode.real:.1f} 1/s")

# %% [markdown]
# **What you have learnt**: gravity opens the gap twice a turn, and drive and coupling together set
# the ring's frequency and decay. *Next:* [the dead zone](02_dead_zone_figure9.ipynb).
