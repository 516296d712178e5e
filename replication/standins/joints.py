"""Stand-ins for the logs that were never published: benches drawn around the identified joint, and their encoders.

A bench is the identified joint with other parameters, friction, periodic disturbances, and a log
that comes from its encoder. Every spread is an assumption; the paper gives none. If the bench's or
the robots' logs are ever published, one function beside `authors.load_clean`, from a log's file to
a `Recording`, takes the place of `encoder_log`: nothing that comes after asks where a record is
from.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from replication import published
from replication.parallel import in_parallel
from replication.recording import Recording, add_normal_noise
from replication.simulator.parameters import (
    TURN,
    Disturbance,
    JointParameters,
    changed_joint,
    identified_joint,
)
from replication.simulator.recordings import read_encoder
from replication.simulator.simulate import SimulatedJoint, simulate

SAMPLE_S = 2e-3
TURNS = 12  # of a log
FINE_BITS = 52  # of an encoder whose grid does not show
VARIED_RATIOS = (
    "stiffness_per_s2",
    "gravity_per_s2",
    "inertia_ratio",
    "speed_gain_per_s",
    "integral_gain_per_s2",
)

# Turns of the motor belt per motor turn: a belt of two and a half to five pulleys' circumference.
BELT_ORDER = (0.2, 0.4)

# Such as `backlash.fitting.global_fit`, which the paper does not have.
FitRecord = Callable[[Recording], Any]


@dataclass(frozen=True)
class Spread:
    """How far a bench may be from the identified joint.

    Uniform from zero where nothing else is said.
    """

    ratios: float = 0.05  # relative SD (log-normal) of each of `VARIED_RATIOS`
    # Largest Coulomb, and largest viscous at the commanded speed, over m g r.
    load_friction: float = 0.005
    motor_friction: float = 0.5  # the same on the motor, over m g r / N
    # Largest torque ripple at one and at six periods a motor turn, over m g r / N.
    ripple: float = 0.02
    belt_rad: float = 1e-5  # largest transmission error of the belt's turn, load side
    gear_rad: float = 1e-4  # largest transmission error of the load's turn
    noise_rps: float = 0.08  # largest SD of the measured speed's noise; the smallest is half of it
    dial_gauge_rad: float = 3e-5  # SD of the static measurement of the backlash: 0.01 mm at 0.3 m


@dataclass(frozen=True)
class Bench:
    """A joint with the SDs of its log's white noise and of a static reading of its backlash."""

    joint: JointParameters
    noise_rps: float
    dial_gauge_rad: float


def draw_bench(rng: np.random.Generator, spread: Spread | None = None) -> Bench:
    """Draw a bench around the identified joint.

    Its drive sees the encoder's 19 bits and differences them; it has turned once when its log
    begins.
    """
    spread = spread or Spread()
    joint = identified_joint()
    factors = np.exp(spread.ratios * rng.standard_normal(len(VARIED_RATIOS)))
    joint = changed_joint(joint, dict(zip(VARIED_RATIOS, factors, strict=True)))
    gravity = joint.gravity_torque_nm
    load_speed = joint.commanded_speed_rad_per_s / joint.gear_ratio
    coulomb, viscous = gravity * spread.load_friction * rng.random(2)
    motor_coulomb, motor_viscous = (
        gravity / joint.gear_ratio * spread.motor_friction * rng.random(2)
    )
    joint = replace(
        joint,
        load_coulomb_nm=coulomb,
        load_viscous_nms_per_rad=viscous / load_speed,
        motor_coulomb_nm=motor_coulomb,
        motor_viscous_nms_per_rad=motor_viscous / joint.commanded_speed_rad_per_s,
        encoder_bits=int(published.value("text.encoder_bits")),
        speed_by_differencing=True,
        lead_s=joint.turn_period_s,
        disturbances=_draw_disturbances(joint, spread, rng),
    )
    return Bench(joint, spread.noise_rps * rng.uniform(0.5, 1.0), spread.dial_gauge_rad)


def _draw_disturbances(
    joint: JointParameters, spread: Spread, rng: np.random.Generator
) -> tuple[Disturbance, ...]:
    """Torque ripple at one and six periods a motor turn, eccentricity of the belt's and of the load's turn."""
    ripple = spread.ripple * joint.gravity_torque_nm / joint.gear_ratio
    once, six_times, belt, gear = rng.random(4)
    phases = TURN * rng.random(4)
    return (
        Disturbance(1.0, motor_torque_nm=ripple * once, phase_rad=phases[0]),
        Disturbance(6.0, motor_torque_nm=ripple * six_times, phase_rad=phases[1]),
        Disturbance(
            rng.uniform(*BELT_ORDER),
            transmission_error_rad=spread.belt_rad * belt,
            phase_rad=phases[2],
        ),
        Disturbance(
            1 / joint.gear_ratio, transmission_error_rad=spread.gear_rad * gear, phase_rad=phases[3]
        ),
    )


def run_and_log(
    bench: Bench, delta_rad: float, rng: np.random.Generator, sample_s: float = SAMPLE_S
) -> tuple[SimulatedJoint, Recording]:
    """Run a bench for twelve turns from a random angle, and log its encoder's position, differenced, with noise."""
    joint = replace(bench.joint, start_angle_rad=float(rng.uniform(0, TURN)))
    run = simulate(joint, delta_rad, duration_s=TURNS * joint.turn_period_s, sample_s=sample_s)
    source = f"simulated encoder log, {delta_rad:g} rad"
    log = read_encoder(
        joint, run.time_s, run.motor_position_rad, joint.encoder_bits or FINE_BITS, source
    )
    return run, add_normal_noise(log, bench.noise_rps, rng)


def encoder_log(bench: Bench, delta_rad: float, rng: np.random.Generator) -> Recording:
    """Log of `run_and_log`, sampled every 2 ms."""
    return run_and_log(bench, delta_rad, rng)[1]


def _log_and_fit(
    fit_record: FitRecord, bench: Bench, delta_rad: float, seed: Sequence[int]
) -> dict[str, float]:
    recording = encoder_log(bench, delta_rad, np.random.default_rng(seed))
    fit = fit_record(recording)
    _, t0, _, omega, *_ = fit.X
    low, high = fit.amplitude_interval_rps
    return {
        "delta_rad": delta_rad,
        "A_rps": fit.amplitude_rps,
        "low_rps": low,
        "high_rps": high,
        "frequency_hz": omega / TURN,
        "t0_s": t0,
        "rmse_rps": fit.rmse,
        "sd_rps": recording.v.std(),
    }


def fitted_logs(
    fit_record: FitRecord, cases: Sequence[tuple[Bench, float]], seeds: Sequence[Sequence[int]]
) -> pd.DataFrame:
    """Log each case and fit it, on all cores."""
    calls = [(fit_record, *case, seed) for case, seed in zip(cases, seeds, strict=True)]
    return pd.DataFrame(in_parallel(_log_and_fit, calls, "logs"))
