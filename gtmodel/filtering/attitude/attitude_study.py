"""The attitude study: a gyro calibrated against few references, and the attitude between them with and without it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Unpack

import numpy as np
from scipy.spatial.transform import Rotation

from ...inference.chance import chi_squared_bound
from ...measurements.drift import DriftBasis, drift_basis
from ...measurements.inspection.columns import ColumnScan
from ...results import ArgumentError, Check, SolveStatus, Work, at_least, at_most
from ...results.disk import MadeFiles
from ...results.estimate import Estimate
from ...results.refusal import naming
from ...results.suspicion import Suspicion, suspicion_checks
from ...results.work import Interrupted, WorkOptions, study_function
from ..smoother import smooth
from . import gyro_calibration
from .between_references import GapErrors, attitude_filter, gap_errors, gaps_of
from .conventions import (
    ACCELERATION_UNITS,
    ORDERS,
    RATE_UNITS,
    RESTING,
    Convention,
    Resting,
    as_declared,
    clocks_that_meet,
    conventions,
    differing_parts,
    far_from_truth,
    not_mirrored,
    resting,
    rotations,
    started,
)  # fmt: skip
from .gyro_calibration import FEWEST, GyroCalibration, calibrated_on, with_drift
from .gyro_path import BLOCK, gyro_path, picked
from .options import METHODS, AttitudeJudging, AttitudeStudy, SyntheticAttitude
from .recording import AttitudeRecording, sampled_instants, synthetic_attitude

SURE = 10.0  # least gain in log-likelihood of the convention over others with another meaning
SAME = 1.0  # conventions with a smaller difference in log-likelihood fit equally well
UNIT_LENGTH = 1e-3  # a quaternion further from unit length is not an orientation
SPIKE = 10.0  # median residuals: a reference further from both neighbours, while these agree, is left out
COVERED = 0.95
CLOSE = 8.0  # references in the shortest gap: more add nothing, since a gyro's error lasts for seconds
MOST_FILTERED = 20_000  # gyro samples for filter and smoother, about ten seconds of computing


@study_function
def attitude_study(
    recording: AttitudeRecording | SyntheticAttitude,
    judging: AttitudeJudging | None = None,
    **work_options: Unpack[WorkOptions],
) -> AttitudeStudy:
    """Test how well a gyro bridges gaps between reference orientations: calibrate on one part, test on the rest.

    Args:
        recording: of the gyro and the references; or options of a synthetic recording.
        judging: end of the calibration, and gaps to test; gaps of 0.5 and 1 s if left out.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    The unit of the gyro and the order and direction of the quaternion are found by maximum likelihood, and checked with
    gravity if there is an accelerometer. Each reference of the second part starts a gap; the references inside it are
    hidden, and the study reports the mean error there for each method. Raises ArgumentError for missing signals, and
    for parts that are too short.

    >>> made = gt.filtering.SyntheticAttitude(duration=7.0, seed=1)
    >>> judging = gt.filtering.AttitudeJudging(gaps=(0.3,), sample_period=made.sample_period)
    >>> s = gt.filtering.attitude_study(made, judging)
    >>> s.convention
    'gyro in deg/s, quaternion w x y z, world to body'
    >>> carried, corrected = s.below_slerp[0]
    >>> bool(carried > 3), bool(corrected > 6)
    (True, True)
    """
    work = Work(**work_options)
    so_far: dict[str, Any] = {}
    try:
        return _studied(recording, judging or AttitudeJudging(), work.title or "attitude", work, so_far)
    except Interrupted as stopped:
        return AttitudeStudy(
            status=SolveStatus.INTERRUPTED, message=str(stopped), title=work.title or "attitude", **so_far
        )  # fmt: skip


def _studied(
    recording: AttitudeRecording | SyntheticAttitude, o: AttitudeJudging, title: str, work: Work, so_far: dict[str, Any]
) -> AttitudeStudy:
    """Do the study; so_far collects its results for an interruption."""
    truth = None

    def ask() -> None:
        if work.interrupted():
            raise Interrupted("stopped before the end: these are the results so far")

    if isinstance(recording, SyntheticAttitude):
        drawn = synthetic_attitude(recording)
        recording, truth = drawn.recording, drawn.correction
    gyro, references = recording.gyro, recording.reference
    synthetic = gyro.synthetic or references.synthetic
    work.step("finding units and directions", 0.05)
    whole, dropped = _sound(references.time, references["quaternion"])
    at, quaternion = references.time[whole], references["quaternion"][whole]
    tried, time, clock = _clock(gyro.time, gyro["rate"], at, quaternion, list(RATE_UNITS), o, ask)
    clocks_that_meet(tried[0], time, gyro["rate"], at, quaternion, o)
    not_mirrored(tried, SURE)
    tried = as_declared(tried, gyro.unit("rate"), SURE)
    least = tried[0].log_likelihood - SAME
    alike = [c for c in tried if c.log_likelihood >= least]
    others = [c for c in tried if c.log_likelihood < least]
    rest = None
    if "acceleration" in gyro.names:
        forces = list(ACCELERATION_UNITS) if gyro.unit("acceleration") == "1" else ["m/s2"]
        opposite = [c for c in others if c.rate_unit == alike[0].rate_unit]
        rest = resting(time, gyro["acceleration"], at - alike[0].offset, quaternion, [*alike, *opposite], units=forces)
    chosen = _upright(alike, rest)
    so_far |= {
        "convention": chosen.words, "conventions": [c.words for c in tried], "clock": clock, "gravity": _gravity(rest),
        "log_likelihood": [c.log_likelihood for c in tried], "synthetic": synthetic,
    }  # fmt: skip
    reading = gyro["rate"] * RATE_UNITS[chosen.rate_unit]
    turned = rotations(quaternion, chosen.order, chosen.direction)
    spikes = _spikes(time, reading, at, turned, chosen)
    dropped = [*dropped, *at[spikes]]
    at, turned = at[~spikes], picked(turned, ~spikes)
    so_far["left_out"] = [float(t) for t in dropped]
    every = _stride(at, o.gaps)
    total, at, turned = len(at), at[::every], picked(turned, slice(None, None, every))
    until = o.calibrate_until if o.calibrate_until is not None else float(np.median(at))
    parts = [at <= until, at > until]
    _fitting(at, parts, o.gaps)
    basis = _drift(time, gyro, until, o)
    columns = [column for _, _, column in basis.columns()]
    calibrations = list[GyroCalibration]()
    for n, part in enumerate(parts):
        name = f"the {('first', 'second')[n]} part"
        work.step(f"calibrating on {name}", 0.15 + 0.3 * n)
        begin = started(time, reading, at[part], picked(turned, part), chosen.offset)
        turns = picked(turned, part)
        calibrations.append(calibrated_on(name, time, reading, at[part], turns, begin, ask, o.sample_period, basis))
    for calibration in calibrations:
        if calibration.likeliest is None:
            return AttitudeStudy(status=calibration.status, message=calibration.message, title=title, **so_far)
    names, units = with_drift(gyro_calibration.PART_NAMES, gyro_calibration.PART_UNITS, basis)
    estimates = [c.by(names, units, gyro_calibration.parts) for c in calibrations]
    intervals = [[e.interval(name) for name in names] for e in estimates]
    reading = np.column_stack([reading, *columns])
    so_far |= {
        "names": names, "numbers": estimates[0].values.tolist(), "estimate": estimates[0],
        "first_interval": intervals[0], "second_interval": intervals[1],
    }  # fmt: skip
    work.step("bridging gaps", 0.75)
    judged = [
        _judged(time, reading, at[part], picked(turned, part), calibration, o.gaps, ask)
        for part, calibration in zip(parts[::-1], calibrations, strict=True)
    ]
    work.step("filtering and smoothing", 0.9)
    last = np.flatnonzero(parts[1] & (at <= _filtered_until(time, at[parts[1]])))
    bridged = [_bridged(time, reading, at[last], picked(turned, last), calibrations[0], gap, ask) for gap in o.gaps]
    notes = _notes(chosen, alike, rest, gyro, at, calibrations, dropped, o)
    if every > 1:
        notes.append(
            f"every {_ordinal(every)} of {total} references is used, {len(at)} in all: closer ones add no information "
            "on the gyro"
        )
    if len(last) < np.sum(parts[1]):
        notes.append(f"filter and smoother stop at {at[last[-1]]:.1f} s, after {MOST_FILTERED} samples of the gyro")
    return _study(
        title, o, judged, bridged, calibrations, estimates, truth,
        checks={"likelihood_margin": _margin(alike, others)},
        notes=notes, **so_far,
    )  # fmt: skip


# -- units and directions ---------------------------------------------------------------------------------


def _sound(time: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, list[float]]:
    """Mask of references that are orientations, and stamps of the others. Raises ArgumentError if most are others."""
    whole = np.abs(np.linalg.norm(quaternion, axis=1) - 1) < UNIT_LENGTH
    if whole.mean() < 0.5:
        raise ArgumentError(f"{np.sum(~whole)} of {len(whole)} quaternions are not of unit length", "recording")
    return whole, [float(t) for t in time[~whole]]


def _clock(
    stamps: np.ndarray,
    rate: np.ndarray,
    at: np.ndarray,
    quaternion: np.ndarray,
    units: Sequence[str],
    o: AttitudeJudging,
    ask: Callable[[], None],
) -> tuple[list[Convention], np.ndarray, str]:
    """Return candidate conventions, with the gyro's stamps or even instants, whichever are likelier; instants; why."""
    tried = conventions(stamps, rate, at, quaternion, rate_units=units, longest_offset=o.longest_offset)
    if o.sample_period is None:
        return tried, stamps, "as stamped"
    ask()
    even = sampled_instants(stamps, o.sample_period)
    others = conventions(even, rate, at, quaternion, rate_units=units, longest_offset=o.longest_offset)
    gain = others[0].log_likelihood - tried[0].log_likelihood
    late = 1e3 * (stamps - even)
    if gain > 0:
        how = f"sampled evenly, stamped on arrival up to {late.max():.0f} ms late"
        return others, even, f"{how}: log-likelihood {gain:.0f} above the stamps"
    return tried, stamps, f"as stamped: log-likelihood {-gain:.0f} above even samples"


def _upright(alike: Sequence[Convention], rest: Resting | None) -> Convention:
    """Of equally good conventions, the one whose world z axis points up; without an accelerometer, scalar first."""
    if rest is None:
        return min(alike, key=lambda c: ORDERS.index(c.order))
    tilts = {c: g.tilt for c, g in zip(alike, rest.gravity, strict=False)}
    return min(tilts, key=lambda c: tilts[c])


def _margin(alike: Sequence[Convention], others: Sequence[Convention]) -> Check:
    margin = alike[0].log_likelihood - others[0].log_likelihood if others else np.inf
    return at_least(
        float(min(margin, 1e6)), SURE, "the motion does not show units and directions; turn faster, about several axes"
    )


def _spikes(time: np.ndarray, reading: np.ndarray, at: np.ndarray, turned: Rotation, chosen: Convention) -> np.ndarray:
    """References far from both neighbours, while these agree with each other."""
    begin = started(time, reading, at, turned, chosen.offset)
    path = gyro_path(time, reading, at, begin)
    error = [
        (path.turn[:-n].inv() * path.turn[n:]).inv() * (turned[:-n].inv() * turned[n:]) for n in (1, 2)
    ]  # fmt: skip
    neighbour, second = (e.magnitude() for e in error)
    moving = (turned[:-1].inv() * turned[1:]).magnitude() > RESTING
    limit = SPIKE * float(np.median(neighbour[moving])) if moving.any() else np.inf
    spike = np.zeros(len(at), bool)
    spike[1:-1] = (np.minimum(neighbour[:-1], neighbour[1:]) > limit) & (second < limit)
    return spike


def _fitting(at: np.ndarray, parts: Sequence[np.ndarray], gaps: Sequence[float]) -> None:
    """Raise ArgumentError if a part has too few references, or if gaps of some length hide none."""
    if not gaps:
        raise ArgumentError("expected at least one gap; found none", "judging.gaps")
    for name, part in zip(("first", "second"), parts, strict=True):
        if part.sum() < FEWEST:
            sentence = f"expected at least {FEWEST} references in the {name} part; found {part.sum()}"
            raise ArgumentError(sentence, "judging.calibrate_until")
        for gap in gaps:
            if next(gaps_of(at[part], gap), None) is None:
                span = f"{at[part][0]:.2f} .. {at[part][-1]:.2f} s"
                raise ArgumentError(f"no gap of {gap:g} s hides a reference in {span}", "judging.gaps")


def _stride(at: np.ndarray, gaps: Sequence[float]) -> int:
    """Stride over many references, if they are closer than an eighth of the shortest gap."""
    if len(at) <= 2 * BLOCK or not gaps:
        return 1
    return max(1, min(int(min(gaps) / CLOSE / np.median(np.diff(at))), len(at) // (2 * BLOCK)))


def _ordinal(n: int) -> str:
    ending = "th" if n % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(n % 10, "th")
    return f"{n}{ending}"


def _filtered_until(time: np.ndarray, at: np.ndarray) -> float:
    """End of the filter over these references [s], after at most `MOST_FILTERED` samples of the gyro."""
    row = int(np.searchsorted(time, at[0])) + MOST_FILTERED
    return float(max(time[row], at[0] + 0.0)) if row < len(time) else float(at[-1])


def _drift(time: np.ndarray, gyro: Any, until: float, o: AttitudeJudging) -> DriftBasis:
    """Drift of the bias to estimate, relative to the end of the first part. Raises ArgumentError."""
    kelvin = gyro["temperature"] if "temperature" in gyro.names else None
    with naming({"drift": "judging.drift", "temperature": "recording"}):
        kinds = drift_basis(o.drift, len(time), time, None, kelvin, kinds=gyro_calibration.KINDS).kinds
    origin = (until, 0.0 if kelvin is None else float(np.interp(until, time, kelvin)))
    return DriftBasis(kinds, time, None, kelvin, origin=origin)


# -- calibrated, judged -------------------------------------------------------------------------------------


def _judged(
    time: np.ndarray,
    reading: np.ndarray,
    at: np.ndarray,
    turned: Rotation,
    c: GyroCalibration,
    gaps: Sequence[float],
    ask: Callable[[], None],
) -> list[GapErrors]:
    path = gyro_path(time, reading, at, c.correction, derivative=True)
    judged = []
    for gap in gaps:
        errors = gap_errors(at, turned, path, c.noise, c.estimate.covariance, gap, ask)
        assert errors is not None, "gaps that are too long raise an error earlier"
        judged.append(errors)
    return judged


def _bridged(
    time: np.ndarray,
    reading: np.ndarray,
    at: np.ndarray,
    turned: Rotation,
    c: GyroCalibration,
    gap: float,
    ask: Callable[[], None],
) -> tuple[float, float, float]:
    """Mean errors of the causal filter and its smoother at hidden references, and the mean NIS per number."""
    used, last = np.zeros(len(at), bool), -np.inf
    for k, t in enumerate(at):
        if t >= last + gap - 1e-9:
            used[k], last = True, t
    run = attitude_filter(time + c.correction.offset, c.correction(reading), at, turned, c.noise, used, ask)
    ask()
    rows = np.searchsorted(run.time, at[~used])
    truth = picked(turned, ~used)
    means = []
    for estimates in (run, smooth(run)):
        q = Rotation.from_quat(estimates["Q"][rows], scalar_first=True)
        means.append(float(np.mean((q.inv() * truth).magnitude())))
    return means[0], means[1], float(run.nis.sum() / max(run.count.sum(), 1))


def _strongest(calibrations: Sequence[GyroCalibration]) -> list[Suspicion]:
    """Return the tests for a drift, each of the part where it is stronger, with twice its p-value (Bonferroni)."""
    pairs = zip(*(c.doubts for c in calibrations), strict=True)
    return [
        replace(s, evidence=f"{part} part: {s.evidence}", p=min(1.0, 2 * s.p))
        for part, s in (min(zip(("first", "second"), pair, strict=True), key=lambda x: x[1].p) for pair in pairs)
    ]


def _study(
    title: str,
    o: AttitudeJudging,
    judged: Sequence[Sequence[GapErrors]],
    bridged: Sequence[tuple[float, float, float]],
    calibrations: Sequence[GyroCalibration],
    estimates: Sequence[Estimate],
    truth: Any,
    *,
    checks: Mapping[str, Check],
    notes: Sequence[str],
    **quantities: Any,
) -> AttitudeStudy:
    limit = float(chi_squared_bound(1 - COVERED, 3))
    rows, exchanged = judged
    means = [e.mean for e in rows]
    splines = [min(m["spline"], m["slow_spline"]) for m in means]
    checks = dict(checks)
    doubts = [differing_parts(*estimates), *_strongest(calibrations)]
    if truth is not None:
        doubts.append(far_from_truth(estimates[0], gyro_calibration.parts(truth.numbers)))
    alarms, sentences = suspicion_checks(doubts)
    checks |= alarms
    checks["corrected_over_spline"] = at_most(
        max(m["corrected"] / s for m, s in zip(means, splines, strict=True)), 1.0,
        "the gyro does not help here: the references are closer than the motion requires",
    )  # fmt: skip
    return AttitudeStudy(
        status=SolveStatus.SOLVED, title=title, checks=checks, notes=(*notes, *sentences),
        message="; ".join(
            f"gaps of {gap:g} s: {np.degrees(m['carried']):.2f} deg carried, {np.degrees(m['corrected']):.2f} deg "
            f"corrected, {np.degrees(m['slerp']):.1f} deg by slerp"
            for gap, m in zip(o.gaps, means, strict=True)
        ),
        timing=[c.noise.timing for c in calibrations], relative=[c.noise.relative for c in calibrations],
        persistence=[c.noise.persistence for c in calibrations], gaps=o.gaps, starts=[e.gaps for e in rows],
        methods=tuple(METHODS), error=[list(m.values()) for m in means],
        exchanged=[list(e.mean.values()) for e in exchanged],
        below_slerp=[[m["slerp"] / m["carried"], m["slerp"] / m["corrected"]] for m in means],
        below_spline=[s / m["corrected"] for m, s in zip(means, splines, strict=True)],
        covered=[[float(np.mean(squares < limit)) for squares in e.expected.values()] for e in rows],
        filtered=[b[0] for b in bridged], smoothed=[b[1] for b in bridged], nis=[b[2] for b in bridged],
        figures={
            "errors": partial(_figure, o.gaps, rows, title, quantities["synthetic"]),
            "residuals": partial(_residuals, calibrations, title, quantities["synthetic"]),
        },
        files=MadeFiles({"errors.csv": partial(_table, o.gaps, rows, quantities["synthetic"])}), **quantities,
    )  # fmt: skip


# -- in words -------------------------------------------------------------------------------------------------


def _gravity(rest: Resting | None) -> str:
    if rest is None:
        return "none, or never at rest"
    return f"{rest.length:.3f} m/s2 at rest in {rest.places} places, read in {rest.unit}"


def _notes(
    chosen: Convention, alike: Sequence[Convention], rest: Resting | None, gyro: Any, at: np.ndarray,
    calibrations: Sequence[GyroCalibration], dropped: Sequence[float], o: AttitudeJudging,
) -> list[str]:  # fmt: skip
    notes = [
        f"{chosen.words}: with the scale fixed at one, rotations between references agree to "
        f"{np.degrees(chosen.residual):.2f} deg; other units and directions are less likely"
    ]
    if len(alike) > 1:
        fitting = " and ".join(f"{c.order}, {c.direction}" for c in alike)
        notes.append(f"rotations alone cannot distinguish {fitting}: they differ only by the axes of world and body")
    if rest is not None:
        gravity_of = dict(zip([*(c.words for c in alike)], rest.gravity, strict=False))
        opposite = rest.gravity[len(alike) :]
        gravity = gravity_of[chosen.words]
        worse = f", {np.degrees(opposite[0].scatter):.0f} deg in the other direction" if opposite else ""
        notes.append(
            f"the direction of gravity scatters by {np.degrees(gravity.scatter):.1f} deg in the world over "
            f"{rest.places} rests{worse}; its mean is {np.degrees(gravity.tilt):.1f} deg from the world's z axis"
        )
    resolution = _resolution(at)
    if resolution:
        timing = 1e3 * np.mean([c.noise.timing for c in calibrations])
        notes.append(
            f"references are stamped in steps of {1e3 * resolution:g} ms; this alone gives a standard deviation of "
            f"{1e3 * resolution / np.sqrt(12):.2g} ms; the residuals show {timing:.2g} ms"
        )
    for part, c in zip(("first", "second"), calibrations, strict=True):
        if c.white is not None and not c.white.passed:
            notes.append(f"{part} part: {c.white.message}")
        if c.estimate.notes:
            notes.append(
                f"{part} part: leaving out blocks of time changes some numbers more than the estimated noise allows; "
                "their intervals are those of this jackknife"
            )
    if dropped:
        stamps = ", ".join(f"{t:.2f}" for t in dropped)
        notes.append(f"left out, as spikes or not of unit length: references at {stamps} s")
    clipped = _clipped(gyro)
    if clipped:
        notes.append(f"clipped: {clipped}")
    if o.sample_period is None:
        notes.append("if rows are stamped on arrival, give the gyro's sample_period, to compare both clocks")
    return notes


def _clipped(gyro: Any) -> str:
    """Columns that look clipped, with the number of clipped rows."""
    texts = []
    for name in (n for n in gyro.names if gyro[n].ndim == 2):
        scan = ColumnScan([f"{name}[{k}]" for k in range(3)], [])
        scan.add(gyro[name])
        texts += [f"{f.name} in {f.clipped} rows" for f in scan.facts() if f.clipped]
    return ", ".join(texts)


def _resolution(stamps: np.ndarray) -> float:
    """Largest step [s] that divides all stamps; zero if it is below 0.1 ms."""
    for step in (0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001):
        if np.all(np.abs(stamps / step - np.round(stamps / step)) < 1e-4):
            return step
    return 0.0


def _table(gaps: Sequence[float], judged: Sequence[GapErrors], note: str | None) -> str:
    lines = [f"# {note}"] if note else []
    lines.append("gap [s],time [s],since the left end [s]," + ",".join(f"{name} [deg]" for name in METHODS))
    for gap, e in zip(gaps, judged, strict=True):
        columns = np.column_stack([e.time, e.since, *(np.degrees(e.error[name]) for name in METHODS)])
        lines += [f"{gap:g}," + ",".join(f"{v:.6g}" for v in row) for row in columns]
    return "\n".join(lines) + "\n"


def _titled(title: str, note: str | None) -> str:
    return f"{title} (synthetic)" if note and "synthetic" not in title.lower() else title


def _figure(gaps: Sequence[float], judged: Sequence[GapErrors], title: str, note: str | None) -> Any:
    from ...plot.filters import gap_figure

    panels = [(gap, e.since, e.error) for gap, e in zip(gaps, judged, strict=True)]
    return gap_figure(panels, METHODS, title=_titled(title, note))


def _residuals(calibrations: Sequence[GyroCalibration], title: str, note: str | None) -> Any:
    from ...plot.filters import turn_residual_figure

    return turn_residual_figure([(c.time, c.residual) for c in calibrations], title=_titled(title, note))
