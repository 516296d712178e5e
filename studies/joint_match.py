"""The settled waveform of a record matched by simulating the joint, with what is not known of it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from backlash.fitting.waveform import drop_first_turn, mean_turn, periodic, samples_a_turn
from replication.arrays import FloatArray
from replication.records import Recording
from replication.simulator.parameters import JointParameters
from replication.simulator.recordings import SIMULATION_STEP_S
from replication.simulator.simulate import simulate

# What may be unknown besides the backlash, between which bounds.
NUISANCES = {"start_angle": (-2 * np.pi, 2 * np.pi), "friction": (0.0, 0.5), "load": (0.5, 1.5)}

# Simulated turns are sampled with the drive and interpolated between: so many in the authors' turn of 0.4 s.
PHASES = 800
_SAMPLE_S = 5e-4

# The search steps in units of 1e-4 rad, starts inside its bounds, and looks first at these backlashes and frictions.
_UNIT_RAD = 1e-4
_BOUNDS = (0.01, 100.0)
_INSIDE = 1e-4
_FIRST_DELTAS = np.arange(1.0, 42.0, 2.0)
_FIRST_FRICTIONS = (0.0, 0.1, 0.2, 0.3)


def add_nuisances(joint: JointParameters, nuisances: Mapping[str, float]) -> JointParameters:
    """Joint with start angle [rad] and friction (over gravity's torque) added, and its load scaled."""
    load = nuisances.get("load", 1.0)
    return replace(
        joint,
        start_angle_rad=joint.start_angle_rad + nuisances.get("start_angle", 0.0),
        load_coulomb_nm=joint.load_coulomb_nm
        + nuisances.get("friction", 0.0) * joint.gravity_torque_nm,
        load_mass_kg=load * joint.load_mass_kg,
        load_inertia_kgm2=load * joint.load_inertia_kgm2,
    )


def simulate_turn(joint: JointParameters, delta_rad: float, phases: int) -> FloatArray:
    """Simulated third turn of the motor speed less its mean [rps], at even phases; it repeats from the second on."""
    turn_s = joint.turn_period_s
    duration_s = _SAMPLE_S * np.ceil(3 * turn_s / _SAMPLE_S - 1e-9)
    run = simulate(
        joint, delta_rad, duration_s=duration_s, sample_s=_SAMPLE_S, step_s=SIMULATION_STEP_S
    )
    third = run.time_s > 2 * turn_s - 4 * _SAMPLE_S
    turn = CubicSpline(run.time_s[third], run.motor_speed_rps[third])(
        turn_s * (2 + np.arange(phases) / phases)
    )
    return turn - turn.mean()


def _choose_start(
    joint: JointParameters, target: FloatArray, free: Sequence[str]
) -> dict[str, float]:
    """Where to start from: the simulated turn on a coarse grid that fits the record's best."""
    size = target.size
    least, best = np.inf, {}
    for friction, delta in product(
        _FIRST_FRICTIONS if "friction" in free else (0.0,), _FIRST_DELTAS
    ):
        turn = simulate_turn(add_nuisances(joint, {"friction": friction}), delta * _UNIT_RAD, size)
        overlap = np.fft.irfft(np.fft.rfft(target) * np.conj(np.fft.rfft(turn)), size)
        shift = int(overlap.argmax()) if "start_angle" in free else 0
        misfit = turn @ turn - 2 * overlap[shift]
        if misfit < least:
            least = misfit
            angle = (np.pi - 2 * np.pi * shift / size) % (2 * np.pi) - np.pi
            best = {"delta": delta, "friction": friction, "start_angle": angle, "load": 1.0}
    return best


def match_joint(
    recording: Recording, joint: JointParameters, free: Sequence[str] = ()
) -> dict[str, float]:
    """Find `delta_rad`, and the `free` ones of `NUISANCES`, that repeat a record's settled turns."""
    turns, v = drop_first_turn(recording)
    centred = v - v.mean()

    def residual(x: FloatArray) -> FloatArray:
        unknown = dict(zip(free, x[1:], strict=True))
        turn = simulate_turn(add_nuisances(joint, unknown), x[0] * _UNIT_RAD, PHASES)
        wave = periodic(turn)(turns % 1.0)
        return wave - wave.mean() - centred

    target = mean_turn(recording, min(samples_a_turn(recording), PHASES))
    first = _choose_start(joint, target, free)
    low, high = np.array([_BOUNDS, *(NUISANCES[name] for name in free)]).T
    start = np.clip([first[name] for name in ("delta", *free)], low + _INSIDE, high - _INSIDE)
    scale = [0.1, *[1e-2] * len(free)]
    solution = least_squares(
        residual, start, bounds=(low, high), x_scale=scale, diff_step=1e-3, xtol=1e-7
    )
    delta, *nuisances = solution.x.tolist()
    return {"delta_rad": _UNIT_RAD * delta} | dict(zip(free, nuisances, strict=True))
