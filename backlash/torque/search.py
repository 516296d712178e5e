"""The search: descents from a grid of joints, then from beside the lowest end, until none is lower."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv

from backlash.refusals import Reason, Refusal
from backlash.torque.load import (
    DAMPING,
    DELAY,
    DELTA,
    DRAG,
    FILTER,
    FRICTION,
    LAG,
    SHARE,
    SOFT,
    STIFFNESS,
    Predictions,
)
from backlash.torque.problem import Problem, prior_chi_squared, weigh_prior
from backlash.torque.unknowns import FIRST_STEP
from backlash.turns import TURN
from replication.signature import FloatArray


class Move(NamedTuple):
    """From a joint to one beside it."""

    steps: float = 0.0  # of 6 % of the backlash and 0.02 mrad
    stiffer: float = 0.0  # of ln K
    softer_mrad: float = 0.0  # of the soft part, with which another minimum comes
    low_passed_ms: float = 0.0  # of the torque's log, as many drives'
    usual: tuple[int, ...] = ()  # unknowns that become what is known beforehand


_TIMES = LAG, DELAY, FILTER
# What takes each other's place, and lets a joint of another gap, stiffness and friction fit nearly as well.
_DETAILS = DAMPING, SOFT, SHARE, DRAG, *_TIMES


@dataclass(frozen=True)
class SearchSettings:
    """Where descents start and end, each with its reason."""

    starts_mrad: tuple[float, ...] = (0.0, 0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 1.7, 2.4)
    rings_hz: tuple[float, float] = (10.0, 60.0)  # industrial joints: 8 to 60 Hz
    start_rings: int = 7
    start_damping: float = 0.15  # more than joints have: with fewer bounces valleys are wider
    first_starts: int = 16
    usual_misfit: float = 1.6
    finalists: tuple[int, int] = (5, 20)
    most_prior_residual: float = 3.5
    # Beside the best.
    neighbours: tuple[Move, ...] = (
        *(Move(*step) for step in product((1.0, -1.0), (0.15, -0.15, 0.45))),
        Move(-2.0, 0.8),
        *(Move(softer_mrad=0.3), Move(stiffer=-0.3, softer_mrad=0.3)),
        Move(usual=(SOFT,)),
    )
    most_rounds: int = 4
    # Shares of chi squared, about a hundred, by which a step that ends a descent lowers it: 2, 0.1, and nothing.
    rough_tolerance: float = 2e-2
    tolerance: float = 1e-3
    last_tolerance: float = 1e-10
    rival: float = 9.0  # chi squared beyond the best end's of ends of restarts, three SDs
    # Many minima lie close together, and a soft part beside a stiffer spring winds up as far under gravity: so descents
    # begin again from beside the lowest, mostly from such joints, with usual details.
    restarts: tuple[Move, ...] = (
        Move(softer_mrad=0.5, usual=(SHARE,)),
        Move(stiffer=0.8, softer_mrad=0.5, usual=(SHARE,)),
        Move(stiffer=0.3, softer_mrad=0.15, usual=_DETAILS),
        Move(softer_mrad=0.15, usual=_TIMES),
        Move(stiffer=0.8, usual=_TIMES),
        Move(low_passed_ms=5.0, usual=_DETAILS),
    )
    near_tolerance: float = 1e-5
    same: float = 0.1  # first steps between two ends of one minimum, and where descents were rough
    rough_same: float = 0.5
    most_trials: int = 150  # of a descent; most take 20


SETTINGS = SearchSettings()
_MOST_SIDES = 12  # laws of the prior that are tried for a step
# Steps are rounded, so that another machine's last bits do not lead a descent elsewhere; chi squared by 1e-5.
_GRID = 2.0**-17 * FIRST_STEP
_PER_STEP_2 = FIRST_STEP**-2.0


class Candidate(NamedTuple):
    """A joint of the search: its unknowns, what it predicts, what that leaves of the torque, and its misfit.

    Where the load has no periodic orbit there is no prediction, and chi squared, with the prior's, is infinite.
    """

    theta: FloatArray
    chi2: float
    prior_chi2: float = 0.0
    predicted: Predictions | None = None
    residuals: FloatArray = np.empty(0)

    @property
    def orbit(self) -> Predictions:
        """What it predicts; Refusal without a periodic orbit."""
        if self.predicted is None:
            raise Refusal("under no joint that was tried does the load turn on", Reason.NO_FIT)
        return self.predicted

    @property
    def delta_rad(self) -> float:
        """Half of the play, which is none where the gap is below zero."""
        return 1e-3 * max(float(self.theta[DELTA]), 0.0)


_chi2 = attrgetter("chi2")


def search(problem: Problem, rough: Problem) -> list[Candidate]:
    """The ends of descents from many backlashes, stiffnesses and frictions, the best first."""
    s = SETTINGS
    ends: list[Candidate] = []
    for starts, finalists in zip(rank_starts(rough), s.finalists, strict=True):
        rough_ends = descend_each(rough, starts, s.rough_tolerance)
        best_ends = distinct(rough_ends, s.rough_same)[:finalists]
        begins = [evaluate_beside(problem, each, each.theta) for each in best_ends]
        ends += descend_each(problem, begins, s.tolerance)
        best = descend_beside(problem, ends)
        is_near = np.abs(problem.prior_residuals(best.theta)).max() < s.most_prior_residual
        if is_near and problem.misfit(best.chi2) < s.usual_misfit:
            break
    # An end that fits nearly as well may lie in the best one's valley: all of these go on to their minimum.
    scale, minima = problem.scale(best.chi2), problem.minima
    most = best.chi2 + minima.near * scale
    near = [each for each in distinct(ends, s.rough_same) if each.chi2 < most][: minima.most_near]
    near = [descend(problem, each, s.near_tolerance) for each in near or [best]]
    for restart in s.restarts:
        lowest = min(near, key=_chi2)
        begin = evaluate_beside(problem, lowest, move(problem, lowest.theta, restart))
        near.append(descend(problem, begin, s.near_tolerance, lowest.chi2 + s.rival * scale, near))
    best = descend(problem, min(near, key=_chi2))
    return distinct([best, *near], s.same)


def rank_starts(rough: Problem) -> tuple[list[Candidate], list[Candidate]]:
    """Joints of a grid: the best ring of each gap and friction, ranked; the best friction of each gap and ring."""
    s = SETTINGS
    rings = 2 * np.log(TURN * np.geomspace(*s.rings_hz, s.start_rings))
    grid = [place_each(rough, delta, rings) for delta in s.starts_mrad]
    best_ring = [min(each, key=_chi2) for by_ring in grid for each in zip(*by_ring, strict=True)]
    best_friction = [min(each, key=_chi2) for by_ring in grid for each in by_ring]
    return sorted(best_ring, key=_chi2)[: s.first_starts], best_friction


def place_each(problem: Problem, delta_mrad: float, rings: FloatArray) -> list[list[Candidate]]:
    """The usual joint but for gap, damping, ring and friction; each orbit is looked for from the one beside it."""
    placed: list[list[Candidate]] = []
    theta = problem.prior.mean.copy()
    theta[DELTA], theta[DAMPING] = delta_mrad, math.log(SETTINGS.start_damping)
    frictions = np.array(problem.minima.start_frictions) * min(problem.prior.most_friction, 0.9)
    for ring in rings:
        theta[STIFFNESS] = ring
        beside = placed[-1][0] if placed else None
        placed.append([])
        for friction in frictions:
            theta[FRICTION] = friction
            start = beside and beside.predicted and beside.predicted.start
            each = evaluate(problem, theta.copy(), start)
            if each.predicted is None and start is not None:
                each = evaluate(problem, theta.copy())
            beside = each
            placed[-1].append(each)
    return placed


def evaluate(problem: Problem, theta: FloatArray, start: FloatArray | None = None) -> Candidate:
    """A joint with its misfit, by the orbit near a start or from rest."""
    prior_chi2 = prior_chi_squared(theta, problem.prior)
    predicted = problem.compared.predict(theta, start)
    if predicted is None:
        return Candidate(theta, np.inf, prior_chi2)
    residuals = problem.compared.residuals(predicted)
    chi2 = float(residuals @ residuals) + prior_chi2
    return Candidate(theta, chi2, prior_chi2, predicted, residuals)


def evaluate_beside(problem: Problem, candidate: Candidate, theta: FloatArray) -> Candidate:
    """A joint with its misfit, by the orbit near another joint's."""
    return evaluate(problem, theta, candidate.predicted and candidate.predicted.start)


def descend_each(problem: Problem, begins: list[Candidate], tolerance: float) -> list[Candidate]:
    """The ends of some descents, none of which goes on where it comes near a lower end of another."""
    ends: list[Candidate] = []
    for begin in begins:
        ends.append(descend(problem, begin, tolerance, ends=ends))
    return ends


def descend_beside(problem: Problem, ends: list[Candidate]) -> Candidate:
    """The best end of descents from beside the best one, and from beside a better one that is among them.

    `ends`, in which near ones count as found, receives theirs.
    """
    s = SETTINGS
    best = min(ends, key=_chi2)
    for _ in range(s.most_rounds):
        for step in s.neighbours:
            begin = evaluate_beside(problem, best, move(problem, best.theta, step))
            ends.append(descend(problem, begin, s.tolerance, best.chi2, ends))
        before, best = best, min(ends, key=_chi2)
        if best.chi2 > before.chi2 * (1 - s.tolerance) - 0.1:
            break
    return best


def move(problem: Problem, theta: FloatArray, beside: Move) -> FloatArray:
    """A joint beside another; the gap and the soft part's wind-up beyond the spring's take each other's place."""
    moved = theta.copy()
    moved[[*beside.usual]] = problem.prior.mean[[*beside.usual]]
    moved[SOFT] += beside.softer_mrad
    moved[DELTA] -= (1 - moved[SHARE]) * (moved[SOFT] - theta[SOFT])
    moved[DELTA] += beside.steps * (0.06 * abs(moved[DELTA]) + 0.02)
    moved[STIFFNESS] += beside.stiffer
    moved[FILTER] += beside.low_passed_ms
    return moved


def distinct(candidates: list[Candidate], same: float) -> list[Candidate]:
    """The best first, each but once; `same` is in first steps."""
    chosen: list[Candidate] = []
    for candidate in sorted(candidates, key=_chi2):
        if all(np.abs((candidate.theta - each.theta) / FIRST_STEP).max() > same for each in chosen):
            chosen.append(candidate)
    return chosen


# --------------------------------------------------------------------------------------------------------- a descent


class _Slopes(NamedTuple):
    """Slopes of the residuals and of the orbit's start at a joint, and half those of their sum of squares."""

    residuals: FloatArray
    start: FloatArray
    normal: FloatArray
    downhill: FloatArray


def _differentiate(problem: Problem, here: Candidate) -> _Slopes:
    slopes, start_slopes = problem.compared.differentiate(here.orbit)
    return _Slopes(slopes, start_slopes, slopes.T @ slopes, -(slopes.T @ here.residuals))


def descend(
    problem: Problem,
    here: Candidate,
    tolerance: float = SETTINGS.last_tolerance,
    target: float = np.inf,
    ends: Sequence[Candidate] = (),
    holds_delta: bool = False,
) -> Candidate:
    """Least squares by Levenberg's and Marquardt's method from a joint that is evaluated in this problem.

    The first step is no longer than a bounce of the teeth. It ends where a good step lowers chi squared by less than
    that share, where twenty such steps would stay above a target, or within a first step (a tenth of it, if the
    tolerance is fine) of an end above which three such steps would stay. A step to where the load has no periodic orbit
    is taken back.
    """
    if here.predicted is None:
        return here
    slopes = _differentiate(problem, here)
    reach = SETTINGS.same if tolerance < SETTINGS.tolerance else 1.0
    damping, growth = 1e-3, 2.0
    trials = 0
    # Where two orbits part slopes are not finite.
    while trials < SETTINGS.most_trials and np.isfinite(slopes.normal).all():
        step = _find_step(problem, here.theta, slopes, damping, holds_delta)
        length = math.sqrt(float(step * _PER_STEP_2 @ step))
        if trials == 0 and length > 1:
            damping *= 4
            continue
        if length < 1e-5:
            break
        trials += 1
        start = here.orbit.start + slopes.start @ step[: slopes.start.shape[1]]
        there = evaluate(problem, here.theta + step, start)
        gain = here.chi2 - there.chi2
        linear = here.residuals + slopes.residuals @ step
        expected = here.chi2 - float(linear @ linear) - there.prior_chi2
        if gain > 0:
            here = there
            is_slow = gain < tolerance * here.chi2 or here.chi2 - 20 * gain > target
            if is_slow and gain > 0.25 * expected:
                break
            if _is_near(here.theta, here.chi2 - 3 * gain, ends, reach):
                break
            damping, growth = damping * max(1 / 3, 1 - (2 * gain / expected - 1) ** 3), 2.0
            slopes = _differentiate(problem, here)
        else:
            if expected < 1e-3 * tolerance * here.chi2:
                break
            damping, growth = damping * growth, 2 * growth
    return here


def _is_near(theta: FloatArray, chi2: float, ends: Sequence[Candidate], reach: float) -> bool:
    lower = np.array([each.theta for each in ends if each.chi2 < chi2]).reshape(-1, theta.size)
    return bool((np.abs((lower - theta) / FIRST_STEP).max(axis=1) < reach).any())


def _find_step(
    problem: Problem, theta: FloatArray, slopes: _Slopes, damping: float, holds_delta: bool
) -> FloatArray:
    """A damped step of Gauss's and Newton's method, under the prior's law of the side of zero where it ends."""
    free = slice(1 if holds_delta else 0, None)
    most_friction = problem.prior.most_friction
    step, side = np.zeros(theta.size), theta
    damped = slopes.normal + np.diag(damping * _PER_STEP_2)
    for _ in range(_MOST_SIDES):
        hessian, downhill = weigh_prior(theta, side, problem.prior)
        hessian += damped
        downhill += slopes.downhill
        *_, step[free], _ = dposv(hessian[free, free], downhill[free])
        before, side = side, theta + step
        is_beyond = side[FRICTION] > most_friction, before[FRICTION] > most_friction
        if is_beyond[0] == is_beyond[1] and ((side > 0) == (before > 0)).all():
            break
    return _GRID * np.round(step / _GRID)


def hold_delta(
    problem: Problem, candidate: Candidate, delta_mrad: float, target: float
) -> Candidate:
    """The best joint of a backlash, from another's, or one that is clearly above a target."""
    theta = candidate.theta.copy()
    theta[DELTA] = delta_mrad
    begin = evaluate_beside(problem, candidate, theta)
    return descend(problem, begin, SETTINGS.near_tolerance, target, holds_delta=True)
