"""What errors of measured poses say: their size beside the noise, offsets that explain them, sessions that differ,
priors that they contradict."""

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

MOST_SESSIONS = 12  # sessions that are fitted one by one


def between_sessions(c: Calibration) -> BetweenRecordings | None:
    """Parameters of the robot of which the sessions' own fits give disjoint intervals; None where they agree, and where
    fewer than two sessions determine any by themselves."""
    m = c.problem.measurements
    if m.sessions is None or not 2 <= len(m.session_names) <= MOST_SESSIONS or c.estimate is None or c.problem.beside:
        return None
    own = [n for n in c.problem.unknowns.names if n.partition("[")[0] in c.problem.closure.flat.bindings]
    estimates: dict[str, Estimate] = {}
    for name in m.session_names:
        rows = np.array([s == name for s in m.sessions])
        try:
            e = calibrate(c.problem.on(m.part(rows)), cost=c.cost, start=c.problem.unknowns.named(c.x)).estimate
        except (ModelError, ValueError, np.linalg.LinAlgError):
            continue
        if e is not None and e.degrees_of_freedom > 0:
            estimates[name] = e
    return between_recordings(estimates, own) if len(estimates) > 1 and own else None


EXPLAINED = 0.5  # of the squared errors: offsets that explain less are not what the errors are
COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


@dataclass(frozen=True, eq=False)
class Shift:
    """Offsets of a signal, one row (k,) per session, and the `share` of the squared length errors that they explain."""

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
        of = f"offset{'s' if number > 1 else ''} of {self.signal}"
        per = f" in {len(self.sessions)} sessions" if len(self.sessions) > 1 else ""
        unit = f" {self.units[0]}" if len(set(self.units)) == 1 and self.units[0] not in ("", "1") else ""
        asked = "was the robot homed anew?" if self.actuators else "was the device moved?"
        return (
            f"{counted} {of}{per} ({sizes}{unit}) explain {100 * self.share:.0f} % of the squared error; {asked} Then "
            f"estimate them: {'offset' if self.actuators else 'frame'} of {self.signal} per session"
        )


def shift_of(problem: CalibrationProblem, x: np.ndarray, refitted: bool, position: str = "T") -> Shift | None:
    """The offsets of actuators or position, per session, that explain most of the length errors at x, if that is more
    than half and beyond chance.

    `refitted`: whether these poses were fitted, so that the unknowns, too, may move; to the first order.
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
        own = By[:, :, problem.reading.places[signal]]
        each = np.concatenate([own * (sessions == s)[:, None, None] for s in names], axis=2).reshape(len(r), -1)
        test = explained_by(free, r, each)
        share = 1 - test.rest / (test.F * test.more + test.rest)
        if not (share > EXPLAINED and test.p < FIRST):
            continue
        if best is None or share > best.share:
            offsets = np.linalg.lstsq(np.hstack([free, each]), -r, rcond=None)[0][free.shape[1] :]
            units = tuple(problem.closure.flat.variables[k].unit or "" for k in _indices(problem, signal))
            rows = -offsets.reshape(len(names), -1)  # of the reading, as Correction counts them
            best = Shift(signal, names, rows, units, float(share), signal == problem.actuators)
    return best


def _indices(problem: CalibrationProblem, signal: str) -> list[int]:
    _, indices, _ = problem.closure.flat.lookup(signal)
    return list(indices)


FAR = 5.0  # standard deviations of prior and fit together
NAMED = 3  # are named
STEPS = 40  # of the fit without priors, from the one with them: what needs more is not determined without


def contradicted_priors(c: Calibration) -> list[str]:
    """Sentences on priors far from what the poses say without any, the farthest first; none where residuals are as
    large as the noise, or the poses alone do not determine them, or so weakly that no interval would be given."""
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
            poses = f"which give {alone.values[k]:.6g} +- {std:.2g} without priors; correct or widen it"
            known = f"the prior {prior.name} = {prior.value:g} {unit} +- {prior.std:g}"
            contradictions.append((off, f"{known} contradicts the poses, {poses}"))
    return [sentence for _, sentence in sorted(contradictions, key=lambda pair: -pair[0])[:NAMED]]


WAVES, FEWEST = 6, 2  # over an actuator's range, from half a period to three, or to one: less is taken up by the fit
SHARE = 1 / 3  # of the spare equations that a pattern may take
PATTERN_POSES = 500  # poses of a file that are looked at for a pattern: its columns are many


def against_noise(
    c: Calibration,
    held_out: Sequence[CalibrationProblem] = (),
    *,
    false_alarm: float = FALSE_ALARM,
    matters: float = MATTERS,
) -> OverNoise | None:
    """Judge the errors of all poses, those of the fit and of problems of held-out ones, against the stated noise.

    The errors are orthogonal distances, the smallest changes of all that was measured that close a pose, in units of
    their covariance. Their sum of squares at the unknowns that explain all poses best is chi-squared with as many
    degrees of freedom as errors and priors less determined unknowns, whatever the cost of the fit. These unknowns are
    one Gauss-Newton step away; where errors look too large there, they are fitted to all poses, as a fit of few poses
    may be far off along what these hardly determine. An error that the fit has taken up is found in the held-out poses,
    and few spare equations of the fit are no lack of power. None where a noise is not stated, or no pose closes by it.

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
    judged = _at(c, every, false_alarm, matters)
    if judged is None or judged.passed:
        return judged
    u = c.problem.unknowns
    P, p = prior_rows(u.priors, u.names)

    def all_rows(x: np.ndarray) -> Iterator[np.ndarray]:
        """For unknowns in units of their sizes."""
        return (A for poses in every for A, _ in _rows(replace(c, x=x * u.sizes), poses))

    here = c.x / u.sizes
    closed = [np.isfinite(A[:, -1]) for A in all_rows(here)]  # a step that loses one of these poses is refused

    def rows(x: np.ndarray) -> Iterator[np.ndarray]:
        return (A[good] for A, good in zip(all_rows(x), closed, strict=True))

    best = descend(rows, here, np.ones(len(here)), P=P * u.sizes, p=p, limit=STEPS)
    return _at(replace(c, x=best.x * u.sizes), every, false_alarm, matters)


def _at(c: Calibration, every: Sequence[CalibrationProblem], false_alarm: float, matters: float) -> OverNoise | None:
    """The verdict one Gauss-Newton step away from where the calibration is."""
    R, errors = triangle(np.zeros((0, 0)), _priors(c)), 0
    for poses in every:
        for A, _ in _rows(c, poses):
            closed = A[np.isfinite(A[:, -1])]
            R = triangle(R, closed)
            errors += len(closed)
    if not errors:
        return None
    left, rank = _left(R[:, :-1], R[:, -1])
    spare = errors + len(c.problem.unknowns.priors) - rank
    return chi_squared_over_noise(left, spare, false_alarm=false_alarm, matters=matters)


def pattern(c: Calibration, held_out: Sequence[CalibrationProblem] = ()) -> Verdict | None:
    """Test whether errors are independent of the pose: it fails where smooth functions of the actuators, beside the
    unknowns, explain more of them than chance does. What a model lacks shows so, however large the noise is.

    The functions are waves over each actuator's range, cos(pi k u) with k up to 6, fewer where poses are few, two at
    least, for each of the equations of a pose. They and the unknowns are fitted to errors of all poses at once, and an
    F test judges. The errors are those of against_noise(), or of the lengths where noise is not stated: these hang
    together within a pose, so that p is but nearly right, and must be below 0.1 % instead of 1 %. None where they are
    too few, for several measurements, and for a pose known in part without noise.

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
    before, rank = _left(A[closed, :-1], A[closed, -1])
    equations = [k for _, k in errors[0]]
    spare = np.count_nonzero(closed) - rank
    number = min(WAVES, int(SHARE * spare / (sum(equations) * len(low))))
    if number < FEWEST or not before > 0:
        return None
    waves = [np.cos(u[:, :, None] * np.arange(1, number + 1)).reshape(len(u), -1) for u in places]
    columns = np.zeros((len(c.problem.unknowns.priors), sum(equations) * waves[0].shape[1]))
    by_block = [scipy.linalg.block_diag(*(np.kron(w, np.eye(k)) for k in equations)) for w in waves]
    columns = np.vstack([columns, *by_block])
    after, both = _left(np.hstack([A[:, :-1], columns])[closed], A[closed, -1])
    more, rest = both - rank, int(np.count_nonzero(closed)) - both
    if more < 1 or rest < 1:
        return None
    F, p = f_test(before, after, more, rest)
    explained = 1 - after / rest / (before / spare)
    seldom = SMALL_P if _stated(every) else FALSE_ALARM
    said = "residuals show no pattern over the positions of the actuators"
    if p < seldom:
        part = f"{max(explained, 0.0):.0%}"
        said = f"residuals follow the positions of the actuators, smooth functions explain {part} of them"
    return Verdict(F, p, p >= seldom, f"{said} (F = {F:.3g} for {more} and {rest}, p = {p:.2g})")


def _stated(problems: Sequence[CalibrationProblem]) -> bool:
    """Whether the noise of all signals is."""
    return all(n in p.measurements.noise for p in problems for n in p.reading.places)


def _evenly(poses: int) -> np.ndarray:
    """Indices of some poses, all where they are few."""
    return np.unique(np.linspace(0, poses - 1, min(PATTERN_POSES, poses)).round().astype(int))


def _rows(c: Calibration, poses: CalibrationProblem, stated: bool = True) -> Iterator[tuple[np.ndarray, int]]:
    """Of each block, in pieces: rows [J r] of so many errors a pose, for unknowns in units of their sizes; r is no
    number where a pose does not close. In units of the stated noise, or lengths."""
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


def _left(J: np.ndarray, r: np.ndarray) -> tuple[float, int]:
    """Squares of r that the columns of J leave, and their rank."""
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    inside = U[:, s > RANK * s.max(initial=0.0)]
    left = r - inside @ (inside.T @ r)
    return float(left @ left), inside.shape[1]
