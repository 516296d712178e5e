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
# # 0 · Start here: from a drawing of the joint to the whole sensor
#
# *You will see what backlash is, why it shows in the motor speed, and how a log gives it. Run time: 6 s.*
#
# ## Claim
#
# The backlash of a robot's joint can be known from the motor's encoder alone: the method "only relies on data gathered
# from the motor encoder, which is always present in a robotic joint" (abstract).
#
# ## Method
#
# Under gravity the teeth of the gear change flanks twice in each turn of the load. Each change ends in an impact, after
# which the motor speed rings. The larger the [backlash](glossary.md#backlash), the larger the amplitude $A$ [rps] of
# the ring. The sensor takes the motor speed $v(t)$ less the commanded speed $v_t$ (both in rps),
#
# $$r(t) = v(t) - v_t \tag{11}$$
#
# fits damped oscillations to it, and turns the fitted $A$ into the backlash $\delta$ [rad]:
#
# $$\delta = 10^{-6} \left(-0.0018\, A^3 + 0.4323\, A^2 + 9.2524\, A + 34.0313\right)
# \quad\text{with } A \text{ in rpm}. \tag{10}$$
#
# Other methods measure the time in the gap or the speed there: Villwock and Pacas (IEEE Transactions on Industrial
# Electronics, 2009) integrate the motor's speed over the time in the gap. Nordin and Gutman
# ([2002](https://doi.org/10.1016/S0005-1098(02)00047-X)) survey models and control of systems with backlash.
#
# The first run on a machine compiles the simulator and the sensor, which takes two minutes.

# %%
from dataclasses import replace

import numpy as np
import pandas as pd
from IPython.display import HTML
from matplotlib import pyplot as plt
from matplotlib.patches import Circle
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit

import backlash
import workbook
from replication import characteristic, identify, published
from replication.figures import style, teeth
from replication.recording import add_uniform_noise
from replication.simulator.checks import closed_loop_matrix
from replication.simulator.parameters import identified_joint, with_ratios
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import settled_peak_rps, simulate
from replication.table2 import AUTHORS_PROTOCOL
from workbook import Interval

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
backlash_mrad = 0.5  # delta, half of the play; equation 10 was fitted from 0.3 to 2.1
noise_rps = 0.1  # half-amplitude of the uniform noise on the logged speed
seed = 1  # of the noise
friction_share = 0.0  # Coulomb friction on the load, over the largest torque of gravity

# %% tags=["plumbing"]
workbook.check_parameters(
    backlash_mrad=(backlash_mrad, Interval(0.3, 2.1)),
    noise_rps=(noise_rps, Interval(0, 0.5)),
    seed=(seed, Interval(1, 1e6)),
    friction_share=(friction_share, Interval(0, 0.2)),
)
seed = int(seed)

# %% [markdown]
# ## Result
#
# ### What backlash is
#
# A motor turns a load through a gear of ratio $N$. The encoder measures the motor's angle $\theta_m$ [rad]; nothing
# measures the load's angle $\theta_l$ [rad], which is 0 where the arm hangs straight down. The *displacement*
#
# $$\Delta\theta = \theta_m / N - \theta_l \quad \text{[rad]}$$
#
# says where the motor's tooth is between the two flanks of the load. The teeth are free while $|\Delta\theta| \le
# \delta$: the backlash $\delta$ is *half* of the play. The springs stand for the elastic coupling. The paper's
# figures 1, 2, 3 and 8 are sketches of the same.


# %% tags=["plumbing"]
@style.in_style
def draw_joint(delta):
    """Draw the joint: motor with encoder, gear, load on an arm under gravity; and the teeth, delta to each side."""
    figure, ((left,), (right,)) = style.grid(2, 1, height_in=4.2)
    teeth.draw_arm(left, 0.9)
    left.plot([-3.9, -0.8], [0, 0], color=style.INK, linewidth=3, zorder=0)
    for x, radius, colour in ((-0.8, 0.2, style.BLUE), (0, 0.6, "0.5")):
        left.add_patch(
            Circle((x, 0), radius, fill=False, edgecolor=colour, linewidth=3, linestyle=":")
        )
    for x, text, pad in ((-4.1, "encoder", 0.6), (-2.6, "motor\n$J_m, \\theta_m$", 1.2)):
        left.text(
            x,
            0,
            text,
            ha="center",
            va="center",
            bbox={"boxstyle": f"square,pad={pad}", "facecolor": "w"},
        )
    texts = (
        (-0.8, 0.8, "gear $N$ : 1"),
        (1.25, -0.45, "load $J_l$"),
        (0.2, -0.9, "$\\theta_l$"),
        (1.1, -1.3, "$m g$"),
    )
    for x, y, text in texts:
        left.text(x, y, text, ha="center")
    left.set(xlim=(-5, 1.7), ylim=(-1.5, 1.1))
    teeth.draw_teeth(right, 0.0, delta, 2 * delta)
    for x, y, text in (
        (-1.5, 0.95, "$\\delta$"),
        (1.5, 0.95, "$\\delta$"),
        (0, 0.5, "motor"),
        (0, -0.43, "load"),
    ):
        right.text(x * delta, y, text, ha="center", color="k" if x else "w")
    for side in (-delta, delta):
        right.annotate("", (2 * side, 0.9), (side, 0.9), arrowprops={"arrowstyle": "<->"})
    style.letter_panels((left, right))
    return figure


# %%
start_joint = draw_joint(backlash_mrad)

# %% [markdown]
# ### Why there are two impacts a turn
#
# The motor is to turn at a constant speed, and so is the load: its torque balances gravity. With the load's mass $m$
# [kg] on an arm $r$ [m], gravity $g$ [m/s²] and Coulomb friction $\tau_c$ [N m] the coupling has to transmit
#
# $$\tau_l \approx m g r \sin\theta_l + \tau_c.$$
#
# While $\tau_l > 0$ the motor drives the load, on one flank. While $\tau_l < 0$ the load drives the motor, on the
# other. Without friction the sign changes at the top ($\theta_l = \pi$) and at the bottom ($\theta_l = 2 \pi$): twice a
# turn, half a turn apart. Each time the teeth cross the gap $2\delta$ and meet with an impact. At the top the load runs
# ahead and pushes the motor: the speed jumps up. At the bottom the load falls back and brakes the motor: it drops.
#
# The joint is the one that was identified from the published signals
# ([notebook 3](03_identification_of_the_joint.ipynb)); `simulate` integrates its equations of motion.

# %%
delta_rad, joint = 1e-3 * backlash_mrad, identified_joint()
joint = replace(joint, load_coulomb_nm=friction_share * joint.gravity_torque_nm)
run = simulate(joint, delta_rad, duration_s=1.6, sample_s=1e-4, step_s=5e-5)

t, v, v_t = run.time_s, run.motor_speed_rps, joint.commanded_speed_rps
tau_l = joint.gravity_torque_nm * np.sin(run.load_position_rad) + joint.load_coulomb_nm

_, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(8, 4), layout="constrained")
upper.fill_between(t, tau_l, where=tau_l > 0, color="C0", label="the motor drives the load")
upper.fill_between(t, tau_l, where=tau_l < 0, color="C1", label="the load drives the motor")
upper.set(ylabel="torque to transmit [N m]", xlim=(0.4, 1.2))
lower.plot(t, v - v_t)
lower.vlines(run.impact_time_s, *lower.get_ylim(), "0.5", ":", label="impacts")
lower.set(xlabel="time [s]", ylabel="r(t) [rps]")
for axis, place in ((upper, "upper right"), (lower, "lower right")):
    axis.legend(loc=place)

# %% [markdown]
# The impacts of the second turn. The first turn holds a start-up transient: from the second turn on the joint is
# [settled](glossary.md#settled).

# %%
second = (run.impact_time_s >= 0.4) & (run.impact_time_s < 0.8)
impact_time = run.impact_time_s[second]
pd.DataFrame(
    {
        "time of the impact [s]": impact_time,
        "load angle [deg]": np.degrees(np.interp(impact_time, t, run.load_position_rad)) % 360,
        "afterwards": [
            "the motor drives" if side > 0 else "the load drives"
            for side in run.impact_side[second]
        ],
        "largest deviation in the next 20 ms [rps]": [
            max((v - v_t)[(t > start) & (t < start + 0.02)], key=abs) for start in impact_time
        ],
    }
)

# %% [markdown]
# ### The equations of motion
#
# Motor (inertia $J_m$ [kg m²], on the motor's side) and load (inertia $J_l$ [kg m²], on the load's side), with the
# motor's torque $\tau_m$ [N m] and the speeds $\omega = \dot\theta$ [rad/s]:
#
# $$J_m \dot\omega_m = \tau_m - \tau_l / N, \qquad
# J_l \dot\omega_l = \tau_l - m g r \sin\theta_l - \tau_c \, \text{sign}(\omega_l).$$
#
# The coupling, of stiffness $K_s$ [N m/rad], damping $D_s$ [N m s/rad] (0 here) and with the sharpness $\alpha$ [1/rad]
# of the gap's edges, transmits the torque $\tau_l$ [N m] of equations 8 and 9
# ([notebook 2](02_dead_zone_figure9.ipynb)), with $\Delta\omega = \omega_m / N - \omega_l$:
#
# $$K_{BL} = \frac{K_s}{\pi}\left[\pi + \arctan(\alpha(\Delta\theta - \delta))
# - \arctan(\alpha(\Delta\theta + \delta))\right] \tag{8}$$
#
# $$\tau_l = \left[\Delta\theta - \delta \, \text{sign}(\Delta\theta) + \frac{D_s}{K_s}\Delta\omega\right]
# K_{BL} \tag{9}$$
#
# A digital [drive](glossary.md#drive) holds the commanded speed $\Omega$ [rad/s]. Once in each control period $T_c$
# [s], at $t_k = k T_c$, it samples $\theta_m$ and $\omega_m$. A position loop (gain $K_{pos}$ [1/s]) around a speed
# loop gives the error $e_k$ [rad/s]; the speed loop has the gain $K_p$ [N m s/rad], an integral (gain $K_i$
# [N m/rad]), a derivative (gain $K_d$ [N m s²/rad]) and a leaky integral $w$ [rad] (gain $K_w$ [N m/rad], leak $a_w$
# [1/s]):
#
# $$e_k = K_{pos}\left(N\theta_0 + \Omega t_k - \theta_{m,k}\right) + \Omega - \omega_{m,k}$$
#
# $$I_k = I_{k-1} + K_i T_c \, e_k, \qquad w_k = w_{k-1} + T_c \left(\Omega - \omega_{m,k} - a_w w_{k-1}\right)$$
#
# $$u_k = K_p e_k + I_k + K_w w_k - K_d \, \frac{\omega_{m,k} - \omega_{m,k-1}}{T_c}$$
#
# The torque $u_k$ [N m] is applied one period later and held; the current loop follows it with the lag $T_\tau$ [s]:
#
# $$T_\tau \dot\tau_m = u_{k-1} - \tau_m \quad\text{for}\quad t_k \le t < t_{k+1}.$$
#
# $\theta_0$ [rad] is the load's angle at $t = 0$. The leaky integral describes the published signals; what it was in
# the authors' model is not known. The numbers are those of a point load of 5 kg: the signals give ratios only.

# %%
N, J_m, J_l = joint.gear_ratio, joint.motor_inertia_kgm2, joint.load_inertia_kgm2
mgr, tau_c, theta_0 = joint.gravity_torque_nm, joint.load_coulomb_nm, joint.start_angle_rad
K_s, alpha, Omega = joint.stiffness_nm_per_rad, joint.alpha_per_rad, joint.commanded_speed_rad_per_s
K_pos, K_p = joint.position_gain_per_s, joint.speed_gain_nms_per_rad
K_i, K_d = joint.integral_gain_nm_per_rad, joint.derivative_gain_nms2_per_rad
K_w, a_w = joint.leaky_gain_nm_per_rad, joint.leaky_rate_per_s
T_tau, T_c = joint.torque_lag_s, joint.control_period_s

values = [
    ("N", "gear ratio", N, "1"),
    ("J_m", "inertia of the motor", J_m, "kg m²"),
    ("J_l", "inertia of the load", J_l, "kg m²"),
    ("m g r", "largest torque of gravity", mgr, "N m"),
    ("tau_c", "Coulomb friction on the load", tau_c, "N m"),
    ("theta_0", "load angle at t = 0", theta_0, "rad"),
    ("K_s", "stiffness of the coupling", K_s, "N m/rad"),
    ("alpha", "sharpness of the gap's edges", alpha, "1/rad"),
    ("delta", "backlash, half of the play", delta_rad, "rad"),
    ("Omega", "commanded speed of the motor", Omega, "rad/s"),
    ("K_pos", "position gain", K_pos, "1/s"),
    ("K_p", "speed gain", K_p, "N m s/rad"),
    ("K_i", "integral gain", K_i, "N m/rad"),
    ("K_d", "derivative gain", K_d, "N m s²/rad"),
    ("K_w", "gain of the leaky integral", K_w, "N m/rad"),
    ("a_w", "leak of the leaky integral", a_w, "1/s"),
    ("T_tau", "lag of the torque", T_tau, "s"),
    ("T_c", "control period, and delay", T_c, "s"),
]
constants = pd.DataFrame(values, columns=["symbol", "what", "value", "unit"]).set_index("symbol")
constants.assign(value=constants["value"].map("{:.4g}".format))

# %% [markdown]
# ### The same in a few lines of SciPy
#
# `simulate` is compiled, finds each contact exactly and takes milliseconds. Here are the same equations, solved
# with `solve_ivp` from one control period to the next.


# %%
def rates(_, y, u):
    theta_m, omega_m, theta_l, omega_l, tau_m = y
    x = theta_m / N - theta_l
    K_BL = (
        K_s
        / np.pi
        * (np.pi + np.arctan(alpha * (x - delta_rad)) - np.arctan(alpha * (x + delta_rad)))
    )  # equation 8
    tau_l = (x - delta_rad * np.sign(x)) * K_BL  # equation 9
    gravity = mgr * np.sin(theta_l) + tau_c * np.sign(omega_l)
    return omega_m, (tau_m - tau_l / N) / J_m, omega_l, (tau_l - gravity) / J_l, (u - tau_m) / T_tau


def twin(periods):
    first = -round(
        joint.lead_s / T_c
    )  # it starts before the record does, with the teeth in contact
    theta_l = theta_0 + Omega / N * first * T_c
    tau_l = mgr * np.sin(theta_l) + tau_c
    twist = np.sign(tau_l) * delta_rad + tau_l / K_s
    y, speeds = np.array([N * theta_l, Omega, theta_l - twist, Omega / N, tau_l / N]), []
    integral, w, u, omega_before = y[4], 0.0, y[4], Omega
    for k in range(first, periods + 1):
        theta_m, omega_m = y[:2]
        speeds.append(omega_m)
        e = K_pos * (N * theta_0 + Omega * k * T_c - theta_m) + Omega - omega_m
        integral, w = integral + K_i * T_c * e, w + T_c * (Omega - omega_m - a_w * w)
        held, u = (
            u,
            K_p * e + integral + K_w * w - K_d * (omega_m - omega_before) / T_c,
        )  # applied one period later
        y, omega_before = (
            solve_ivp(rates, (0, T_c), y, args=(held,), rtol=1e-9, atol=1e-9).y[:, -1],
            omega_m,
        )
    return np.array(speeds[-first:]) / (2 * np.pi)


v_twin = twin(round(1.2 / T_c))
every = round(T_c / (t[1] - t[0]))
difference = np.abs(v_twin - v[::every][: v_twin.size])[round(0.4 / T_c) :]
print(
    f"turns 2 and 3: at most {difference.max():.1g} rps off `simulate`, of a signal of {np.ptp(v[t >= 0.4]):.2g} rps"
)

# %% [markdown]
# ### Why the motor speed rings near 21 Hz
#
# With the teeth in contact the joint is linear. Let $x_m$ and $x_l$ [rad] be the deviations of $\theta_m / N$ and
# $\theta_l$ from the steady motion. If the drive held the motor fast, the load would swing on the coupling alone, at
# $\sqrt{K_s / J_l}$; without a drive both inertias would swing against each other, at
# $\sqrt{K_s (1 / J_l + 1 / (N^2 J_m))}$ [rad/s]. The drive does neither. The integral of the speed's error is the error
# of the position, so that the gains $K_i$, $K_p K_{pos}$ and $K_w$ hold the motor like a spring:
#
# $$\tau_m \approx -\left(K_i + K_p K_{pos} + K_w\right) N x_m.$$
#
# On the load's side this spring has the stiffness $K_{drive} = N^2 (K_i + K_p K_{pos} + K_w)$ [N m/rad]. The load
# swings on two springs in series:
#
# $$f \approx \frac{1}{2\pi} \sqrt{\frac{1}{J_l} \cdot \frac{K_s K_{drive}}{K_s + K_{drive}}} \quad \text{[Hz]}.$$


# %%
def two_springs_hz(joint):
    gains = joint.integral_gain_nm_per_rad + joint.leaky_gain_nm_per_rad
    K_drive = joint.gear_ratio**2 * (
        gains + joint.speed_gain_nms_per_rad * joint.position_gain_per_s
    )
    K_s = joint.stiffness_nm_per_rad
    return np.sqrt(K_s * K_drive / (K_s + K_drive) / joint.load_inertia_kgm2) / (2 * np.pi)


held_fast_hz = np.sqrt(K_s / J_l) / (2 * np.pi)
no_drive_hz = np.sqrt(K_s * (1 / J_l + 1 / (N**2 * J_m))) / (2 * np.pi)
print(
    f"motor held fast {held_fast_hz:.1f}, no drive {no_drive_hz:.1f}, two springs {two_springs_hz(joint):.1f} Hz"
)

# %% [markdown]
# The formula leaves out the motor's inertia, $K_p$ and $K_d$ on the speed, the leak, the lag and the delay. With all of
# them one control period takes the state $z$ (both angles and speeds, the torque, and the drive's memory) to
#
# $$z_{k+1} = M z_k, \qquad s = \ln(\lambda) / T_c \quad \text{for each eigenvalue } \lambda \text{ of } M,$$
#
# where a mode rings at $\text{Im}(s) / 2\pi$ and decays at the rate $-\text{Re}(s)$. `closed_loop_matrix` gives $M$.


# %%
def ringing_mode(joint):
    eigenvalues = np.linalg.eigvals(closed_loop_matrix(joint)).astype(complex)
    s = np.log(eigenvalues[np.abs(eigenvalues) > 1e-3]) / joint.control_period_s
    return max(s[s.imag > 1], key=lambda mode: mode.real)  # the oscillation that lasts longest


mode = ringing_mode(joint)
ring_hz = mode.imag / (2 * np.pi)
print(f"the joint rings at {ring_hz:.2f} Hz and decays at {-mode.real:.1f} 1/s")
print(f"two springs are {100 * (two_springs_hz(joint) / ring_hz - 1):+.0f} % off")

# %% [markdown]
# Is it what the simulated speed does? A damped oscillation is fitted to it, from 20 ms after an impact until the teeth
# part again; a parabola takes up the slow rest.


# %%
def oscillation(t, decay, omega, a, b, c, d, e):
    return (
        np.exp(-decay * t) * (a * np.cos(omega * t) + b * np.sin(omega * t)) + c + d * t + e * t**2
    )


impact = impact_time[0]
parted = run.separation_time_s[run.separation_time_s > impact][0]
ringing = (t > impact + 0.02) & (t < parted)
fitted, _ = curve_fit(
    oscillation, t[ringing] - impact, (v - v_t)[ringing], [15, 130, 0.1, 0.1, 0, 0, 0]
)
print(f"simulated: {fitted[1] / (2 * np.pi):.2f} Hz, {fitted[0]:.1f} 1/s")

# %% [markdown]
# It is. The two springs say why the frequency depends on the coupling *and* on the drive's settings: the same gear
# rings elsewhere under another drive (exercise 2).
#
# ### The teeth in the gap
#
# One turn of the load. Above, the load on its arm, and the teeth: orange is the flank that is loaded. Below, the motor
# speed. Time passes five times slower while the gap is open.

# %%
animation = workbook.plain_animation(
    teeth.animate_teeth(run, joint), words="arm, teeth and motor speed"
)
HTML(animation)

# %% [markdown]
# ### The sensor in five calls
#
# 1. Simulate a log as the authors' are: 12 turns, sampled every 2 ms.

# %%
(clean,) = simulate_recordings(joint, [delta_rad])
print(f"{clean.v.size} samples, {clean.v.min():.2f} to {clean.v.max():.2f} rps")

# %% [markdown]
# 2. Add noise.

# %%
log = add_uniform_noise(clean, noise_rps, np.random.default_rng(seed))
print(f"noise of SD {np.std(log.v - clean.v):.3f} rps on a signal of SD {np.std(clean.v):.3f} rps")

# %% [markdown]
# 3. Fit the [signature](glossary.md#signature): in each turn two oscillations of opposite sign, each of the form
#
# $$d_b(t - t_0) = A \, e^{-(t - t_0 - T_1)\tau} \sin \omega (t - t_0)
# \quad\text{for}\quad t_0 + T_1 \le t \le t_0 + T_2 \tag{5}$$
#
# with the damping $\tau$ [1/s], the frequency $\omega$ [rad/s] and the instants $t_0$, $T_1$, $T_2$ [s]. The paper's
# search is CMA-ES, which is random: five [runs](glossary.md#run), of which the one with the lowest RMSE counts.

# %%
fits = [identify.paper_fit(log, identify.Protocol(), run_seed) for run_seed in range(1, 6)]
pd.DataFrame(
    [(fit.rmse, fit.amplitude_rps, fit.X[2], fit.X[3] / (2 * np.pi)) for fit in fits],
    columns=["RMSE [rps]", "A [rps]", "damping tau [1/s]", "frequency [Hz]"],
    index=pd.Index(range(1, 6), name="run"),
).round(4)

# %% [markdown]
# 4. Take $A$ from the best fit. Runs of the same RMSE may differ in $A$ by up to 3 %: within one sample of 2 ms the
#    instant $T_1$ does not change the fit, but it changes $A$. Equation 10 was made from another amplitude, the
#    [theoretical](glossary.md#theoretical-a) one: in our reading the peak of the noise-free speed before it is
#    sampled.

# %%
A = min(fits, key=lambda fit: fit.rmse).amplitude_rps
theoretical_A = settled_peak_rps(run, joint)
short_percent = 100 * (A / theoretical_A - 1)
print(
    f"A = {A:.4f} rps = {60 * A:.2f} rpm, {short_percent:+.1f} % off the theoretical {theoretical_A:.4f} rps"
)

# %% [markdown]
# 5. Turn $A$ into the backlash by equation 10. `backlash_rad` takes rps; the polynomial itself takes rpm.

# %%
found_rad = characteristic.equation_10().backlash_rad(A)
error_percent = 100 * (found_rad / delta_rad - 1)
print(f"{1e3 * found_rad:.3f} mrad found, {backlash_mrad:g} mrad true: {error_percent:+.1f} %")

# %% [markdown]
# ### The same log in one call
#
# `backlash.estimate` goes beyond the paper: it fits the whole joint, friction included, and gives a 95 % interval. It
# needs no calibration for a joint under a drive of this kind
# ([notebook 14](beyond/14_the_sensor_that_calibrates_itself.ipynb)).

# %%
answer = backlash.estimate(log.t, log.v, turn_period_s=0.4, unit="rps")
print(answer)

# %% [markdown]
# ### Where to go on
#
# - To learn the paper: [2](02_dead_zone_figure9.ipynb) the gap, [4](04_simulator_figure10.ipynb) the simulator,
#   [5](05_growth_figure11.ipynb) how the disturbance grows, [1](01_signature_figure6.ipynb) the signature,
#   [6](06_characteristic_figure12.ipynb) equation 10, [7](07_protocol_table1.ipynb) CMA-ES step by step,
#   [8](08_noise_table2.ipynb) noise.
# - To measure a joint of your own: [12](beyond/12_your_own_joint.ipynb).
# - To review the replication: the [report](../results/report.html).
#
# How to work: `make lab` opens copies of the notebooks, in `lab/`. Change the cell under *Parameters* and run all
# cells; a wrong value is refused; the message lists valid ones. The exercises' solutions are folded. `python -m
# replication diff --lab` lists the verdicts that a change moved. The [glossary](glossary.md) has the terms.

# %% [markdown]
# ## Verdict

# %%
off = f"{abs(error_percent):.1f} % {'below' if error_percent < 0 else 'above'}"
print(
    f"From the motor speed alone: {1e3 * found_rad:.3f} mrad by the paper's five steps, {off} the true "
    f"{backlash_mrad:g} mrad (half of the play)."
)
if answer.verdict == "backlash":
    low, high = answer.backlash_interval_rad
    print(
        f"The fit of the whole joint finds {1e3 * answer.backlash_rad:.3f} mrad, 95 % interval {1e3 * low:.3f} to "
        f"{1e3 * high:.3f} mrad, which {'holds' if low <= delta_rad <= high else 'misses'} the true one."
    )
else:
    print(f"The fit of the whole joint says: {answer.verdict}.")

# %% tags=["plumbing"]
best = min(fits, key=lambda fit: fit.rmse)
names = ["A", "t0", "tau", "omega", "v_t", "T2", "T1"]
bounds = {"A": (-1.5, 1.5), "t0": (-0.2, 0.6), "T_f": (0.392, 0.412)}
for name in ("tau", "omega", "T1", "T2"):
    bounds[name] = [published.value(f"table1.{name}.{end}") for end in ("min", "max")]
explorer = {
    "record": [float(f"{speed:.6g}") for speed in log.v],
    "dt": round(log.t[-1] / (log.t.size - 1), 9),
    "fitted": dict(
        zip([*names, "T_f"], [float(f"{x:.6g}") for x in (*best.X, log.turn_period_s)], strict=True)
    ),
    "bounds": bounds,
    "turns": AUTHORS_PROTOCOL.turns,
    "population": AUTHORS_PROTOCOL.population,
    "printed_T_f": published.value("table1.T_f.max"),
    "backlash_rad": delta_rad,
}
workbook.export(
    pages={"signature_explorer": explorer},
    figures={
        "start_joint": (
            start_joint,
            "(a) The joint: the encoder measures the motor's angle, and nothing measures the load's. (b) The motor's "
            "tooth between the two flanks of the load: the backlash is the gap to either side, half of the play.",
        )
    },
)

# %% [markdown]
# ## Try changing
#
# 1. `backlash_mrad = 1.5`: the ring is more than twice as large, and equation 10 errs by a few percent only.
# 2. `friction_share = 0.05`: the impacts are no longer half a turn apart, so that the signature does not fit, and
#    equation 10 finds little more than half of the backlash; the fit of the whole joint still holds it.
# 3. `noise_rps = 0.0`: equation 10 errs as much without noise; its error is not the noise's.
#
# ## Exercises
#
# **1.** In the gap no torque holds the load. Suppose that the teeth part at the top without a relative speed, and that
# the motor keeps its speed: how long does it take the load to fall through $2\delta$? How does this time grow with
# $\delta$? Compare it with the simulated one, and say why that is shorter.

# %% tags=["solution"]
# The load's acceleration is about m g r Omega t / (N J_l); twice integrated, 2 delta = m g r Omega t**3 / (6 N J_l).
fall_s = (12 * delta_rad * J_l * N / (mgr * Omega)) ** (1 / 3)  # grows with the cube root of delta
met = impact_time[1]  # at the top
gap_s = met - run.separation_time_s[run.separation_time_s < met][-1]
assert (
    gap_s < fall_s < 1.5 * gap_s
)  # shorter, as the coupling unwinds at the rate m g r Omega / (N K_s) when they part
print(f"{1e3 * fall_s:.1f} ms against {1e3 * gap_s:.1f} ms")

# %% [markdown]
# **2.** Halve the coupling's stiffness $K_s$, then, instead, the gain $K_i$. For which of the two is the formula of the
# two springs still near the eigenvalue?

# %% tags=["solution"]
softer = with_ratios(joint, {"stiffness_per_s2": joint.ratios["stiffness_per_s2"] / 2})
slower = with_ratios(joint, {"integral_gain_per_s2": joint.ratios["integral_gain_per_s2"] / 2})
ratio = [
    two_springs_hz(each) / (ringing_mode(each).imag / (2 * np.pi)) for each in (softer, slower)
]
assert 1 < ratio[0] < 1.05  # a softer coupling moves the motor less
assert (
    ratio[1] > 1.3
)  # the speed gain, which the formula leaves out, now acts more than the drive's spring
print(f"formula over eigenvalue: {ratio[0]:.2f} with K_s / 2, {ratio[1]:.2f} with K_i / 2")

# %% [markdown]
# **3.** How much of the error in step 5 comes from equation 10, and how much from $A$?

# %% tags=["solution"]
from_theoretical_A = characteristic.equation_10().backlash_rad(theoretical_A)
of_equation, of_amplitude = from_theoretical_A - delta_rad, found_rad - from_theoretical_A
assert abs(of_amplitude) > abs(of_equation)
assert np.isclose(of_equation + of_amplitude, found_rad - delta_rad)
print(f"equation 10: {1e6 * of_equation:+.1f} urad, the fitted A: {1e6 * of_amplitude:+.1f} urad")
