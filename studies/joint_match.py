"""The settled waveform of a record matched by simulating the joint: the backlash, and what else is not known."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from backlash.fitting.waveform import drop_first_turn, mean_turn, periodic, samples_a_turn
from replication.arrays import FloatArray
from replication.recording import Recording
from replication.simulator.recordings import SIMULATION_STEP_S
from replication.simulator.simulate import JointParameters, simulate

# What may be unknown besides the backlash: value at which the joint is as identified, bounds, and a step that shows.
NUISANCES = {
    "start_angle": (0.0, (-2 * np.pi, 2 * np.pi), 1e-3),
    "friction": (0.0, (0.0, 0.5), 1e-3),
    "load": (1.0, (0.5, 1.5), 1e-3),
}

# Simulated turns are sampled with the drive and interpolated between: so many in the authors' turn of 0.4 s.
_SAMPLE_S, PHASES = 5e-4, 800
# Backlash in the units that the search steps in, and where it looks first [1e-4 rad].
_UNIT_RAD = 1e-4
_FIRST_LOOK = np.arange(1.0, 42.0, 2.0)
_FIRST_FRICTION = (0.0, 0.1, 0.2, 0.3)


def changed(joint: JointParameters, nuisances: Mapping[str, float]) -> JointParameters:
    """Joint with start angle added [rad], friction as a share of gravity's torque, load mass and inertia scaled."""
    load = nuisances.get("load", 1.0)
    return replace(
        joint,
        start_angle_rad=joint.start_angle_rad + nuisances.get("start_angle", 0.0),
        load_coulomb_nm=joint.load_coulomb_nm + nuisances.get("friction", 0.0) * joint.gravity_torque_nm,
        load_mass_kg=load * joint.load_mass_kg,
        load_inertia_kgm2=load * joint.load_inertia_kgm2,
    )


def settled_turn(joint: JointParameters, delta_rad: float, phases: int) -> FloatArray:
    """Simulated third turn of the motor speed less its mean [rps], at even phases; it repeats from the second on."""
    turn_s = joint.turn_period_s
    duration_s = _SAMPLE_S * np.ceil(3 * turn_s / _SAMPLE_S - 1e-9)
    run = simulate(joint, delta_rad, duration_s=duration_s, sample_s=_SAMPLE_S, step_s=SIMULATION_STEP_S)
    third = run.time_s > 2 * turn_s - 4 * _SAMPLE_S
    turn = CubicSpline(run.time_s[third], run.motor_speed_rps[third])(turn_s * (2 + np.arange(phases) / phases))
    return turn - turn.mean()


def _choose_start(joint: JointParameters, target: FloatArray, free: Sequence[str]) -> dict[str, float]:
    """Where to start from, by name: the simulated turn on a coarse grid that correlates best with the record's."""
    least, best = np.inf, {}
    for friction in _FIRST_FRICTION if "friction" in free else (0.0,):
        for delta in _FIRST_LOOK:
            turn = settled_turn(changed(joint, {"friction": friction}), delta * _UNIT_RAD, target.size)
            overlap = np.fft.irfft(np.fft.rfft(target) * np.conj(np.fft.rfft(turn)), target.size)
            shift = int(overlap.argmax()) if "start_angle" in free else 0
            angle = (np.pi - 2 * np.pi * shift / target.size) % (2 * np.pi) - np.pi
            misfit = turn @ turn - 2 * overlap[shift]
            if misfit < least:
                least, best = misfit, {"delta": delta, "friction": friction, "start_angle": angle, "load": 1.0}
    return best


def match_joint(recording: Recording, joint: JointParameters, free: Sequence[str] = ()) -> dict[str, float]:
    """Find `delta_rad`, and the `free` ones of `NUISANCES`, with which the joint repeats a record's settled turns."""
    turns, v = drop_first_turn(recording)
    centred = v - v.mean()

    def residual(x: FloatArray) -> FloatArray:
        unknown = dict(zip(free, x[1:], strict=True))
        wave = periodic(settled_turn(changed(joint, unknown), x[0] * _UNIT_RAD, PHASES))(turns % 1.0)
        return wave - wave.mean() - centred

    target = mean_turn(recording, min(samples_a_turn(recording), PHASES))
    first = _choose_start(joint, target, free)
    start = [first[name] for name in ("delta", *free)]
    low, high = zip((0.01, 100.0), *(NUISANCES[name][1] for name in free), strict=True)
    scale = [0.1, *(10 * NUISANCES[name][2] for name in free)]
    inside = np.clip(start, np.array(low) + 1e-4, np.array(high) - 1e-4)
    found = least_squares(residual, inside, bounds=(low, high), x_scale=scale, diff_step=1e-3, xtol=1e-7)
    return {"delta_rad": float(_UNIT_RAD * found.x[0])} | dict(zip(free, found.x[1:].tolist(), strict=True))
