"""Diagnostics of pose errors: size against the noise, pattern, offsets that explain them, sessions that differ,
contradicted priors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...inference import (
    FALSE_ALARM,
    BetweenRecordings,
    OverNoise,
    Verdict,
    between_recordings,
    chi_squared_over_noise,
    noise_size,
)
from ...inference.chance import f_test
from ...inference.covariance import RANK
from ...inference.held_out import MATTERS
from ...inference.nonlinear import descend, triangle
from ...inference.residuals import SMALL_P
from ...inference.weighting import prior_rows
from ...lang import ModelError
from ...measurements.inspection.residual_tests import explained_by
from ...results import Estimate
from ...results.suspicion import FIRST
from ..block_rows import BlockRows
from ..calibration import Calibration, calibrate
from ..problem import CalibrationProblem, noise_covariance
from .intervals import WEAK

MOST_SESSIONS = 12  # largest number of sessions that are fitted separately


def between_sessions(c: Calibration) -> BetweenRecordings | None:
    """Robot parameters whose intervals from separate fits of the sessions are disjoint.

    None if the sessions agree, or if fewer than two determine any parameters by themselves."""
    m = c.problem.measurements
    if m.sessions is None or not 2 <= len(m.session_names) <= MOST_SESSIONS or c.estimate is None or c.problem.beside:
        return None
    geometric = [n for n in c.problem.unknowns.names if n.partition("[")[0] in c.problem.closure.flat.bindings]
    estimates: dict[str, Estimate] = {}
    for name in m.session_names:
        rows = np.array([s == name for s in m.sessions])
        try:
            e = calibrate(c.problem.on(m.part(rows)), cost=c.cost, start=c.problem.unknowns.named(c.x)).estimate
        except (ModelError, ValueError, np.linalg.LinAlgError):
            continue
        if e is not None and e.degrees_of_freedom > 0:
            estimates[name] = e
    return between_recordings(estimates, geometric) if len(estimates) > 1 and geometric else None


EXPLAINED = 0.5  # of the squared errors: offsets that explain less are not reported
COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


@dataclass(frozen=True, eq=False)
class Shift:
    """Offsets of a signal, one row (k,) per session, and the `share` of the squared length errors they explain."""

    signal: str
    sessions: tuple[str, ...]
    offsets: np.ndarray
    units: tuple[str, ...]
    share: float
    actuators: bool

    @property
    def message(self) -> str:
        number = self.offsets.size
        sizes = ", ".join(f"{x:.3g}" for x in self.offsets.reshape(-1)[:8]) + (", ..." if number > 8 else "")
        counted = COUNTS[number] if number < len(COUNTS) else str(number)
        what = f"offset{'s' if number > 1 else ''} of {self.signal}"
        per = f" in {len(self.sessions)} sessions" if len(self.sessions) > 1 else ""
        unit = f" {self.units[0]}" if len(set(self.units)) == 1 and self.units[0] not in ("", "1") else ""
        question = "was the robot homed again?" if self.actuators else "was the device moved?"
        return (
            f"{counted} {what}{per} ({sizes}{unit}) explain {100 * self.share:.0f} % of the squared error; {question} "
            f"If so, estimate the {'offset' if self.actuators else 'frame'} of {self.signal} per session"
        )


def shift_of(problem: CalibrationProblem, x: np.ndarray, refitted: bool, position: str = "T") -> Shift | None:
    """Offsets of actuators or position per session that explain over half of the length errors at x, beyond chance.

    `refitted`: whether these poses were fitted; the unknowns may then move too (to first order).
    """
    if problem.implicit:
        return None
    r = problem.residuals(x).reshape(-1)
    J, By, _ = problem.all_jacobians("length", x)
    free = J.reshape(len(r), -1) if refitted else np.zeros((len(r), 0))
    m, best = problem.measurements, None
    names = m.session_names
    sessions = np.array(m.sessions if m.sessions is not None else [""] * len(m))
    for signal in (problem.actuators, position):
        if signal not in problem.reading.places:
            continue
        columns = By[:, :, problem.reading.places[signal]]
        each = np.concatenate([columns * (sessions == s)[:, None, None] for s in names], axis=2).reshape(len(r), -1)
        test = explained_by(free, r, each)
        share = 1 - test.rest / (test.F * test.more + test.rest)
        if not (share > EXPLAINED and test.p < FIRST):
            continue
        if best is None or share > best.share:
            offsets = np.linalg.lstsq(np.hstack([free, each]), -r, rcond=None)[0][free.shape[1] :]
            units = tuple(problem.closure.flat.variables[k].unit or "" for k in _indices(problem, signal))
            rows = -offsets.reshape(len(names), -1)  # sign convention of Correction
            best = Shift(signal, names, rows, units, float(share), signal == problem.actuators)
    return best


def _indices(problem: CalibrationProblem, signal: str) -> list[int]:
    _, indices, _ = problem.closure.flat.lookup(signal)
    return list(indices)


FAR = 5.0  # combined standard deviations of prior and fit
NAMED = 3  # largest number of reported priors
STEPS = 40  # iterations of the fit without priors; if it needs more, the poses do not determine the parameters


def contradicted_priors(c: Calibration) -> list[str]:
    """Sentences on priors that contradict the poses, the worst first.

    Empty if residuals are as small as the noise, or if the poses alone do not determine the parameters well."""
    u = c.problem.unknowns
    if not u.priors or (c.estimate is not None and (c.estimate.noise <= 1 or noise_size(c.estimate).passed)):
        return []
    try:
        without = replace(c.problem, unknowns=replace(u, priors=()))
        alone = calibrate(without, cost=c.cost, start=u.named(c.x), limit=STEPS).estimate
    except (ModelError, ValueError, np.linalg.LinAlgError):
        return []
    if alone is None:
        return []
    contradictions: list[tuple[float, str]] = []
    for prior in u.priors:
        k = u.names.index(prior.name)
        std = float(alone.std[k])
        off = abs(float(alone.values[k]) - prior.value) / float(np.hypot(prior.std, std))
        if std <= WEAK * u.sizes[k] and off > FAR:
            unit = u.units[k] or "1"
            poses = f"which give {alone.values[k]:.6g} +- {std:.2g} without priors; correct or widen the prior"
            known = f"the prior {prior.name} = {prior.value:g} {unit} +- {prior.std:g}"
            contradictions.append((off, f"{known} contradicts the poses, {poses}"))
    return [sentence for _, sentence in sorted(contradictions, key=lambda pair: -pair[0])[:NAMED]]


WAVES, FEWEST = 6, 2  # most and fewest half periods over an actuator's range; the fit absorbs longer waves
SHARE = 1 / 3  # of the spare equations that a pattern may use
PATTERN_POSES = 500  # largest number of poses per file in the test for a pattern, which has many columns


def against_noise(
    c: Calibration,
    held_out: Sequence[CalibrationProblem] = (),
    *,
    false_alarm: float = FALSE_ALARM,
    matters: float = MATTERS,
) -> OverNoise | None:
    """Test the errors of all poses, fitted and held out, against the stated noise.

    The errors are orthogonal distances: the smallest changes of the measured signals that close a pose, in units of
    their covariance. At the unknowns that explain all poses best, their sum of squares is chi-squared distributed, with
    errors and priors less determined unknowns as degrees of freedom, whatever the cost of the fit. These unknowns are
    one Gauss-Newton step away. If errors look too large there, they are fitted to all poses, because a fit of few poses
    may be far off in weakly determined directions. Held-out poses reveal an error that the fit has absorbed, and give
    the test power if the fit has few spare equations. None if a noise is not stated, or if no pose closes.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> rng = np.random.default_rng(1)
    >>> T = rng.uniform([0.0, -1.0, 0.2], [1.0, 0.0, 0.8], (30, 3))
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T + 1e-4 * rng.normal(size=T.shape)}, {"q": 1e-6, "T": 1e-4})
    >>> c = gt.calibrate.calibrate(robot, poses.part(np.arange(20)))
    >>> judged = gt.calibrate.against_noise(c, [c.problem.on(poses.part(np.arange(20, 30)))])
    >>> judged.passed, judged.degrees_of_freedom  # 90 errors, 21 unknowns
    (True, 69)
    """
    every = (*c.problem.parts, *held_out)
    if not _stated(every):
        return None
    judged = _test(c, every, false_alarm, matters)
    if judged is None or judged.passed:
        return judged
    u = c.problem.unknowns
    P, p = prior_rows(u.priors, u.names)

    def all_rows(x: np.ndarray) -> Iterator[np.ndarray]:
        """Rows for unknowns in units of their sizes."""
        return (A for poses in every for A, _ in _rows(replace(c, x=x * u.sizes), poses))

    start = c.x / u.sizes
    closed = [np.isfinite(A[:, -1]) for A in all_rows(start)]  # refuse a step after which one of these does not close

    def rows(x: np.ndarray) -> Iterator[np.ndarray]:
        return (A[good] for A, good in zip(all_rows(x), closed, strict=True))

    best = descend(rows, start, np.ones(len(start)), P=P * u.sizes, p=p, limit=STEPS)
    return _test(replace(c, x=best.x * u.sizes), every, false_alarm, matters)


def _test(c: Calibration, every: Sequence[CalibrationProblem], false_alarm: float, matters: float) -> OverNoise | None:
    """The verdict one Gauss-Newton step away from the calibration."""
    R, errors = triangle(np.zeros((0, 0)), _priors(c)), 0
    for poses in every:
        for A, _ in _rows(c, poses):
            closed = A[np.isfinite(A[:, -1])]
            R = triangle(R, closed)
            errors += len(closed)
    if not errors:
        return None
    squares, rank = _unexplained(R[:, :-1], R[:, -1])
    spare = errors + len(c.problem.unknowns.priors) - rank
    return chi_squared_over_noise(squares, spare, false_alarm=false_alarm, matters=matters)


def pattern(c: Calibration, held_out: Sequence[CalibrationProblem] = ()) -> Verdict | None:
    """Test whether errors are independent of the pose; a pattern shows an effect that the model lacks, at any noise.

    The test fails if smooth functions of the actuators explain more of the errors than chance does. The functions are
    waves cos(pi k u) over each actuator's range u, with k up to 6 (fewer for few poses, at least 2), for each equation
    of a pose. They are fitted with the unknowns to the errors of all poses, and an F test decides whether they are
    significant. The errors are those
    of against_noise(), or length errors if the noise is not stated; these are correlated within a pose, so that p is
    only approximate and must be below 0.1 % instead of 1 %. None for too few poses, for several measurements, and for
    partially measured poses without noise.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> rng = np.random.default_rng(1)
    >>> T = rng.uniform([0.0, -1.0, 0.2], [1.0, 0.0, 0.8], (60, 3))
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> for guideway in (0.0, 2e-4):  # a wave of the first cart's guideway [m]
    ...     wave = np.outer(guideway * np.sin(6.0 * q[:, 0]), [1.0, 0.0, 0.0])
    ...     poses = gt.calibrate.Measurements({"q": q + wave, "T": T + 1e-4 * rng.normal(size=T.shape)})
    ...     gt.calibrate.pattern(gt.calibrate.calibrate(robot, poses)).passed
    True
    False
    """
    every = (c.problem, *held_out)
    if c.problem.beside or (c.problem.implicit and not _stated(every)):
        return None
    chosen = [p.on(p.measurements.part(_evenly(len(p.measurements)))) for p in every]
    q = [np.asarray(p.measurements.values[p.actuators], float) for p in chosen]
    low = np.min(np.vstack(q), axis=0)
    span = np.ptp(np.vstack(q), axis=0)
    places = [np.pi * (rows - low) / np.where(span > 0, span, 1.0) for rows in q]
    errors = [list(_rows(c, p, _stated(every))) for p in chosen]  # by block, few enough poses for one piece
    A = np.vstack([_priors(c), *(rows for each in errors for rows, _ in each)])
    closed = np.isfinite(A[:, -1])
    before, rank = _unexplained(A[closed, :-1], A[closed, -1])
    equations = [k for _, k in errors[0]]
    spare = np.count_nonzero(closed) - rank
    number = min(WAVES, int(SHARE * spare / (sum(equations) * len(low))))
    if number < FEWEST or not before > 0:
        return None
    waves = [np.cos(u[:, :, None] * np.arange(1, number + 1)).reshape(len(u), -1) for u in places]
    columns = np.zeros((len(c.problem.unknowns.priors), sum(equations) * waves[0].shape[1]))
    by_block = [scipy.linalg.block_diag(*(np.kron(w, np.eye(k)) for k in equations)) for w in waves]
    columns = np.vstack([columns, *by_block])
    after, both = _unexplained(np.hstack([A[:, :-1], columns])[closed], A[closed, -1])
    more, rest = both - rank, int(np.count_nonzero(closed)) - both
    if more < 1 or rest < 1:
        return None
    F, p = f_test(before, after, more, rest)
    explained = 1 - after / rest / (before / spare)
    seldom = SMALL_P if _stated(every) else FALSE_ALARM
    message = "residuals show no pattern over the actuator positions"
    if p < seldom:
        part = f"{max(explained, 0.0):.0%}"
        message = f"residuals depend on the actuator positions: smooth functions explain {part} of them"
    return Verdict(F, p, p >= seldom, f"{message} (F = {F:.3g} for {more} and {rest}, p = {p:.2g})")


def _stated(problems: Sequence[CalibrationProblem]) -> bool:
    """Whether the noise of all signals is stated."""
    return all(n in p.measurements.noise for p in problems for n in p.reading.places)


def _evenly(poses: int) -> np.ndarray:
    """Indices of evenly chosen poses; all if there are few."""
    return np.unique(np.linspace(0, poses - 1, min(PATTERN_POSES, poses)).round().astype(int))


def _rows(c: Calibration, poses: CalibrationProblem, stated: bool = True) -> Iterator[tuple[np.ndarray, int]]:
    """Rows [J r] of each block in pieces, with its number of errors per pose, for unknowns in units of their sizes.

    r is NaN if a pose does not close. In units of the stated noise, or lengths."""
    u, S = c.problem.unknowns, noise_covariance(poses, "orthogonal") if stated else None
    n = len(u.names)
    for block in poses.blocks_of("orthogonal" if stated else "length"):
        begin = (None, None) if S is None else poses.begin(block, S)
        for A in BlockRows(block, poses.reading.data, 1.0, S, begin)(c.x[block.columns]):
            full = np.zeros((len(A), n + 1))
            full[:, [*block.columns.tolist(), n]] = A
            yield full * np.append(u.sizes, 1.0), len(block.rows) - len(block.hidden)


def _priors(c: Calibration) -> np.ndarray:
    """Rows [J r] of the priors."""
    u = c.problem.unknowns
    P, p = prior_rows(u.priors, u.names)
    return np.column_stack([P * u.sizes, P @ c.x - p])


def _unexplained(J: np.ndarray, r: np.ndarray) -> tuple[float, int]:
    """Sum of squares of r not explained by the columns of J, and the rank of J."""
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    inside = U[:, s > RANK * s.max(initial=0.0)]
    remainder = r - inside @ (inside.T @ r)
    return float(remainder @ remainder), inside.shape[1]
