"""All results of a calibration before the report: fit, held-out poses, verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from ...inference import BetweenRecordings, HeldOut, Identifiability, OverNoise, Verdict, over_noise
from ...inference.covariance import RANK, listed
from ...lang import ModelError
from ...lang.units import parse_unit
from ...measurements.inspection.data_tests import Data, tested
from ...results import ArgumentError, Check, SolveStatus
from ...results.suspicion import Inspection, Suspicion, suspicion_checks
from ..calibration import Calibration, calibrate
from ..held_out import PosesLeftOut, judge_held_out, leave_out, of_its_own, refitted
from ..measured.options import Refit
from ..measured.poses import SplitPoses
from ..measurements import Measurements
from ..options import Fit
from ..prediction import MAD, Outlier, Prediction, outliers
from ..problem import CalibrationProblem, noise_covariance
from ..sensitivity import Sensitivity, sensitivity
from ..variants import cost_of, too_few
from .device_drift import device_drifts
from .diagnostics import Shift, against_noise, between_sessions, contradicted_priors, pattern, shift_of
from .far_poses import FarPose, far_poses, sentence as far_sentence
from .intervals import Confidence, weighed_over_noise
from .movement import WIDTH, moved_too_far, near_start, undetermined

FAR = 30.0  # times the stated noise: the readings are probably wrong
ITERATIONS = 400  # of a fit; few poses leave flat valleys with slow convergence
HUBER = 1.345  # standard deviations: 95 % efficiency for normal errors
GROSS = 5.0  # times the median error
METRES = 0.1  # m, median error of the fitted poses: the robot and the coordinates do not belong together


@dataclass(frozen=True, eq=False)
class CalibrationFindings:
    """`before`, `after`: identifiability without and with the noise of the data. `fitted`, `held_out`: signal -> errors
    of the calibrated model on these poses; `a_priori`: of the nominal robot on the held-out poses or, without any, the
    fitted ones. Empty if no pose closes. `repeatability`: rms distance [m] of poses at the same actuators from their
    mean, or None. `beside`: findings of other measurements fitted together with these. `refitted`: the calibration
    with the parameters specific to the held-out recording; `kept`: the poses of that recording, with these parameters.
    `left_out`: the
    cross-validation, if any; `held_out` are then its errors, of all poses. `near`: unknowns held near their start
    values because some poses did not close otherwise. `variant`: of the fit.
    """

    problem: CalibrationProblem
    data: SplitPoses
    calibration: Calibration
    before: Identifiability | None
    fitted: dict[str, Prediction]
    held_out: dict[str, Prediction]
    a_priori: dict[str, Prediction]
    outliers: list[Outlier]
    sensitivity: Sensitivity | None
    repeatability: float | None
    loss: str = "linear"
    inspection: Inspection = field(default_factory=Inspection)
    beside: Sequence[CalibrationFindings] = field(default=())
    refitted: Calibration | None = None
    kept: Measurements | None = None
    left_out: PosesLeftOut | None = None
    near: tuple[str, ...] = ()
    variant: str | None = None

    @property
    def parts(self) -> tuple[CalibrationFindings, ...]:
        """The findings of each of the measurements, this one first."""
        return (self, *self.beside)

    @property
    def after(self) -> Identifiability | None:
        return self.calibration.identifiability

    @cached_property
    def far_poses(self) -> list[FarPose]:
        """Outlying poses, fitted or held out, the farthest first."""
        return far_poses(self)

    @property
    def gross(self) -> list[FarPose]:
        """Outlying poses so far off that they may spoil the fit or its tests; errors of a model are smaller."""
        return [p for p in self.far_poses if p.size > GROSS * p.others]

    @cached_property
    def suspect(self) -> str:
        """Words on outliers as a cause of a failed test; empty if there are none."""
        if not self.gross:
            return ""
        one = len(self.gross) == 1
        them, outlier = ("it", "outlier") if one else ("them", "outliers")
        return f"the {outlier} may cause this: repeat the calibration without {them} before you doubt the model"

    @cached_property
    def unseen_frame(self) -> str:
        """A question about the frame of the coordinates if the fit misses the poses by far; empty otherwise."""
        fitted = self.fitted.get(self.position)
        if not self.data.whole or self.data.pose.device or fitted is None or not len(self.calibration.x):
            return ""
        error = float(np.nanmedian(fitted.sizes))
        if error < METRES:
            return ""
        return (
            f"the fitted robot misses half of the poses by more than {error:.2g} m: do the coordinates come from a "
            'tracker at an unknown place? Set measurements.frame = "device"'
        )

    @cached_property
    def priors(self) -> list[str]:
        """Sentences on priors that contradict the poses."""
        return contradicted_priors(self._as_known)

    @property
    def _as_known(self) -> Calibration:
        """The calibration with only the stated priors."""
        c, u = self.calibration, self.calibration.problem.unknowns
        stated = tuple(p for p in u.priors if p.name not in self.near)
        return replace(c, problem=replace(c.problem, unknowns=replace(u, priors=stated))) if self.near else c

    @cached_property
    def confidence(self) -> Confidence:
        return Confidence(self.calibration, self.position, self.loss, bool(self.far))

    @cached_property
    def far(self) -> list[str]:
        """Sentences on parameters that moved too far, unless that alarm is accepted."""
        sentences = moved_too_far(self.calibration)
        if "moved_too_far" not in self.inspection.accepted:
            return sentences
        for sentence in sentences:
            self.inspection.refuse(Suspicion("moved_too_far", sentence), "fit.accept")
        return []

    @cached_property
    def left(self) -> tuple[dict[str, Check], list[str]]:
        """Results of the residual tests of every run: checks and sentences."""
        drifts = device_drifts(self.calibration, self.data.pose, length_covariance(self.calibration, self.loss))
        tests = [*tested(Data(residuals=self.calibration.residuals)), *drifts]
        return suspicion_checks(tests, self.inspection.accepted)

    @cached_property
    def over_noise(self) -> OverNoise | None:
        """Errors of fitted and held-out poses against the stated noise; None if not stated or no degree of freedom is
        left. With parameters specific to the held-out recording, of the fitted poses only. With several measurements,
        of the signals with stated noise, apart from the actuators."""
        c = self.calibration
        if c.estimate is not None and not c.estimate.known_noise:
            return weighed_over_noise(c)
        if c.estimate is None:
            return None
        try:
            judged = against_noise(self._as_known, self._unseen)
        except (ModelError, np.linalg.LinAlgError):
            judged = None
        judged = judged or over_noise(c.estimate)
        return judged if judged.degrees_of_freedom > 0 else None

    @cached_property
    def pattern(self) -> Verdict | None:
        """Test of the same errors for a pattern over the poses; None if there are too few."""
        try:
            return pattern(self._as_known, self._unseen)
        except (ModelError, np.linalg.LinAlgError):
            return None

    @property
    def _unseen(self) -> list[CalibrationProblem]:
        """The problems of the held-out poses; none if they have specific parameters."""
        parts = () if self.refitted is not None else self.parts
        return [p.calibration.problem.on(p.kept) for p in parts if p.kept is not None]

    @property
    def position(self) -> str:
        return self.data.position

    @property
    def lines(self) -> np.ndarray:
        """Lines of the fitted poses."""
        return self.data.lines[~self.data.held_out]

    @property
    def unseen(self) -> np.ndarray:
        """Poses of the errors in `held_out`: the held-out ones, or all with cross-validation."""
        return self.data.held_out if self.left_out is None else np.ones(len(self.data.lines), bool)

    @property
    def lines_held_out(self) -> np.ndarray:
        return self.data.lines[self.unseen]

    @cached_property
    def judged(self) -> HeldOut | None:
        """Held-out over fitted errors against those of a sound model; None if one of them is missing."""
        if self.left_out is not None:
            return self.left_out.judged
        kept = self.data.kept
        if kept is None or self.position not in self.held_out or self.position not in self.fitted:
            return None
        fitted, held_out = ({n: p.errors for n, p in each.items()} for each in (self.fitted, self.held_out))
        confidence = Confidence(self.calibration.alone, self.position, self.loss) if self.beside else self.confidence
        correlated = confidence.correlated
        if self.refitted is not None:  # its refitted parameters have errors, too
            x, p = self.refitted.x, self.refitted.problem
            share = len(x) / max(p.equations * len(p.measurements), 1)
            held_out = {n: e / np.sqrt(1 + share) for n, e in held_out.items()}
        return judge_held_out(self.calibration, kept, fitted, held_out, self.position, correlated=correlated)

    @cached_property
    def held_out_residuals(self) -> np.ndarray | None:
        """Errors (M, m) [m] of the held-out poses, as in the calibration's residuals; None without any."""
        return None if self.kept is None else (self.refitted or self.calibration).on(self.kept)

    @cached_property
    def shift(self) -> Shift | None:
        """Offsets that explain the errors of the held-out poses if these exceed the fitted ones, otherwise those of the
        fitted poses."""
        c = self.refitted or self.calibration
        judged = self.judged if self.kept is not None and len(self.calibration.x) else None
        if judged is not None and not judged.passed and self.kept is not None:
            return shift_of(c.problem.on(self.kept), c.x, False, self.position)
        return shift_of(self.calibration.problem, self.calibration.x, True, self.position)

    @cached_property
    def apart(self) -> BetweenRecordings | None:
        """Parameters on which sessions disagree beyond their noise."""
        return None if self.beside else between_sessions(self.calibration)

    @property
    def lost(self) -> int:
        """Number of held-out poses that do not close with the calibrated parameters."""
        kept = self.held_out.get(self.position)
        return len(self.lines_held_out) if kept is None else kept.lost

    @property
    def headline(self) -> tuple[dict[str, Prediction], np.ndarray, bool]:
        """Errors for the headline, their lines, and whether they are of held-out poses."""
        if self.held_out:
            return self.held_out, self.lines_held_out, True
        return self.fitted, self.lines, False


def findings_of(
    fit: Fit, data: Sequence[SplitPoses], prepared: CalibrationProblem, a_priori: Sequence[Prediction | None],
    stop: Callable[[], bool], inspection: Inspection, refit: Refit | None = None, folds: Sequence[np.ndarray] = (),
) -> CalibrationFindings:  # fmt: skip
    """Fit the parameters and test the fit.

    `a_priori`: errors of the nominal robot at all poses, per measurements; `stop`: see calibrate(); `folds` for
    cross-validation. Raises ArgumentError if cost or loss does not fit the measurements."""
    width = fit.loss_width
    try:
        cost = cost_of(fit, prepared)
        c = calibrate(prepared, cost=cost, stop=stop, limit=ITERATIONS)
        if fit.loss != "linear" and c.status.ok and len(c.x):
            c = calibrate(
                prepared, cost=cost, limit=ITERATIONS, loss=fit.loss, width=width or HUBER * _scale(c), stop=stop,
                start=c.problem.unknowns.named(c.x),
            )  # fmt: skip
        before = prepared.identifiability(sigma=length_noise(prepared)) if len(c.x) else None
    except (ModelError, ValueError) as error:
        option = next((f"fit.{word}" for word in ("loss", "cost") if word in str(error)), "poses")
        raise ArgumentError(str(error), option) from error
    near: tuple[str, ...] = ()
    if fit.loss == "linear" and len(data) == 1:
        c, near = near_start(c, data[0].kept, partial(calibrate, cost=cost, limit=ITERATIONS, stop=stop))
    first, *others = (
        _of_part(fit, c if k == 0 else part, poses, before, prior, inspection, refit)
        for k, (part, poses, prior) in enumerate(zip(c.parts, data, a_priori, strict=True))
    )
    first = replace(first, near=near)
    if not folds or not c.status.ok:
        return replace(first, beside=tuple(others))
    return _without(first, folds, width or (HUBER * _scale(c) if fit.loss != "linear" else 1.0), stop)


def _without(
    f: CalibrationFindings, folds: Sequence[np.ndarray], width: float, stop: Callable[[], bool]
) -> CalibrationFindings:
    """Add the errors of the cross-validation; without them if interrupted."""
    c, name = f.calibration, f.position
    try:
        validation = leave_out(
            c, folds, name, loss=f.loss, width=width, limit=ITERATIONS, correlated=f.confidence.correlated, stop=stop
        )
    except ArgumentError:
        if not stop():
            raise
        stopped = replace(c, status=SolveStatus.INTERRUPTED, message="stopped during the cross-validation")
        return replace(f, calibration=stopped)
    held = {n: Prediction(e) for n, e in validation.errors.items() if n in f.fitted}
    return replace(f, held_out=held, left_out=validation)


def _of_part(
    fit: Fit,
    c: Calibration,
    data: SplitPoses,
    before: Identifiability | None,
    a_priori: Prediction | None,
    inspection: Inspection,
    refit: Refit | None = None,
) -> CalibrationFindings:
    part = data.held_out if data.held_out.any() else ~data.held_out
    held, kept = c, data.kept
    if refit is not None and data.refitting is not None and kept is not None and c.status.ok:
        held, kept = refitted(c, data.refitting, refit), of_its_own(kept, refit, data.actuators)
    prior = {} if a_priori is None else {data.position: Prediction(a_priori.errors[part])}
    if not data.whole:
        as_it_was = replace(c, x=c.problem.unknowns.start)
        prior = _predicted(as_it_was, data.fitted if data.kept is None else data.kept, data)
    return CalibrationFindings(
        c.problem, data, c, before, _predicted(c, data.fitted, data),
        {} if kept is None else _predicted(held, kept, data),
        prior, outliers(c.residuals, _basis(c, fit.loss), length_covariance(c, fit.loss)), _sensitivity(fit, c),
        _repeatability(data), fit.loss, inspection,
        (), None if held is c else held, kept, variant=fit.variant,
    )  # fmt: skip


def _basis(c: Calibration, loss: str) -> np.ndarray | None:
    """Orthonormal columns (N, m, p) of the lengths' Jacobian; None with latent values, which leave the lengths unknown,
    and for a robust loss, in which outliers do not influence the fit."""
    if c.problem.implicit or loss != "linear" or not len(c.x):
        return None
    J = c.problem.jacobian(c.x) * c.problem.unknowns.sizes
    U, s, _ = np.linalg.svd(J.reshape(-1, J.shape[2]), full_matrices=False)
    return U[:, s > RANK * s.max(initial=0.0)].reshape(*J.shape[:2], -1)


def length_covariance(c: Calibration, loss: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Jacobian (N, m, n) of the lengths, without columns for a robust loss, and their covariance (N, m, m) from the
    stated noise; None if it is not fully stated or does not affect every length."""
    p = c.problem
    if p.implicit or not p.weighed or not len(c.x):
        return None
    J, By, _ = p.all_jacobians("length", c.x)
    C = By @ noise_covariance(p, "orthogonal") @ By.swapaxes(1, 2)
    if not np.all(np.linalg.eigvalsh(C)[:, 0] > RANK * np.trace(C, axis1=1, axis2=2)):
        return None
    return J if loss == "linear" else J[:, :, :0], C


def verdict(findings: CalibrationFindings, accuracy: float | None) -> tuple[bool, bool | None, list[str]]:
    """Whether the numerics are sound, whether the prediction is proven (None: not tested), and sentences on both."""
    c = findings.calibration
    sound, sentences = c.status.ok, []
    if not sound:
        return False, None, [f"not solved: {c.message}"]
    sentences += [s for s in (findings.unseen_frame or far_sentence(findings, findings.gross),) if s]
    if not len(c.x):
        sound, proven, others = _as_it_is(findings, accuracy)
        return sound, proven, [*sentences, *others]
    assert findings.after is not None
    sentences.append(f"numerics sound: {c.message}, {findings.after.counts}" if c.estimate is not None else c.message)
    sentences += too_few(c.problem)
    if findings.after.redundant:
        sentences.append(undetermined(c, findings.after))
    if findings.near:
        sentences.append(
            f"{len(findings.near)} unknowns are held near their start values (standard deviation {WIDTH:g} times their "
            "expected size): the poses hardly determine some of them, and without this some poses did not close; "
            "give priors, fix parameters or turn the plate farther"
        )
    if findings.over_noise is not None:
        sentences.append(of_noise(findings))
    elif c.estimate is not None and not c.estimate.known_noise and any(f.held_out for f in findings.parts):
        sentences.append(_of_unstated_noise(findings))
    if c.estimate is not None and c.estimate.degrees_of_freedom > 0:
        sentences.append(findings.confidence.scope)
    lost, kept_in_all = (sum(n) for n in zip(*((f.lost, len(f.lines_held_out)) for f in findings.parts), strict=True))
    if findings.priors:
        sentences.append(f"prediction not proven: {findings.priors[0]}")
        return True, False, sentences
    if lost:
        sentences.append(
            f"prediction not proven: {lost} of {kept_in_all} held-out poses do not close with these "
            "parameters; "
            "two links may coincide: give priors, fix parameters or turn the plate farther"
        )
        return True, False, sentences
    if not any(f.held_out for f in findings.parts):
        sentences.append("prediction not proven: no poses were held out, and errors of fitted poses are optimistic")
        return True, None, sentences
    if findings.far:
        sentences.append(
            f"prediction not proven: held-out poses were read in the same way as fitted ones, and {findings.far[0]}"
        )
        return True, False, sentences
    verdicts = []
    for part in findings.parts:
        if part.held_out:
            proven, sentence = _of_held_out(part, accuracy if part is findings else None)
            verdicts.append(proven)
            sentences.append(f"{part.data.name}: {sentence}" if findings.beside else sentence)
    return True, all(verdicts), sentences


def _of_held_out(findings: CalibrationFindings, accuracy: float | None) -> tuple[bool, str]:
    """Whether the held-out poses of one of the measurements are predicted, and a sentence."""
    name, number = findings.position, len(findings.lines_held_out)
    kept = f"{number} held-out poses"
    if findings.left_out is not None:
        folds = len(findings.left_out.folds)
        kept = f"{number} poses by cross-validation" + (f" in {folds} folds" if folds < number else "")
    outside = findings.held_out[name]
    sizes = f"mean {1e3 * outside.mean:.3g} mm, largest {1e3 * outside.greatest:.3g} mm"
    judged = findings.judged
    assert judged is not None
    over = findings.over_noise
    noisy = over is not None and not over.passed
    if judged.passed and not noisy and (accuracy is None or outside.mean <= accuracy):
        return True, (
            f"prediction proven on {kept}: {sizes}; this holds between these poses and at their load; an error of the "
            "device that makes all readings too long or too short by the same factor stays hidden"
        )
    if accuracy is not None and outside.mean > accuracy:
        missed = f"prediction misses the required {1e3 * accuracy:.3g} mm on {kept}: {sizes}"
        return False, f"{missed}; {findings.suspect}" if findings.suspect else missed
    shifted = "" if findings.shift is None else findings.shift.message
    if judged.passed and over is not None:
        return False, (
            f"prediction not proven on {kept} ({sizes}): residuals are {over.ratio:.3g} times the stated noise, for a "
            f"sound model at most {over.bound:.3g} times; "
            + (
                findings.suspect
                or shifted
                or "the model error may be larger elsewhere: held-out poses are measured like the fitted ones"
            )
        )
    return False, (
        f"prediction not proven on {kept} ({sizes}): {judged.message}; "
        + (findings.suspect or shifted or "measure more poses or free fewer parameters")
    )


def of_noise(findings: CalibrationFindings) -> str:
    """Sentence on the errors relative to the stated noise, their pattern, and the noise that would explain them."""
    over = findings.over_noise
    assert over is not None
    if over.as_stated or over.ratio < 1:
        return over.message
    needed = []
    for part in findings.parts:
        m, suffix = part.problem.measurements, f" of {part.data.name}" if findings.beside else ""
        for name, place in part.problem.reading.places.items():
            if name not in m.noise:  # actuators of several measurements
                continue
            sigma = np.sqrt(np.mean(np.diagonal(m.covariance(name, place.stop - place.start), axis1=1, axis2=2)))
            factor, unit = written(part, name)
            needed.append(f"{name}{suffix} {over.ratio * factor * sigma:.2g} {'' if unit == '1' else unit}".rstrip())
    first = " The usual cause of such large errors is wrong columns, signs or units." if over.ratio > FAR else ""
    return f"{over.extent}; {_probable_cause(findings)}.{first} A noise of {', '.join(needed)} would explain their size"


def _of_unstated_noise(findings: CalibrationFindings) -> str:
    places = [(part.problem.measurements.noise, part.problem.reading.places) for part in findings.parts]
    lacking = list(dict.fromkeys(name for noise, names in places for name in names if name not in noise))
    message = (
        f"the deviation of {listed(lacking)} is not stated, so the errors were not compared with the noise of the "
        "readings: an error of the model that is the same in fitted and held-out poses can pass for noise"
    )
    if findings.pattern is not None and not findings.pattern.passed:
        symptom = findings.pattern.message
    elif findings.confidence.coloured:
        symptom = "residuals are coloured, unlike noise"
    else:
        return message
    return f"{message}; {symptom}" + (f"; {findings.suspect}" if findings.suspect else "")


def _probable_cause(findings: CalibrationFindings) -> str:
    """Probable cause of errors larger than the stated noise, inferred from their pattern."""
    pattern, coloured = findings.pattern, findings.confidence.coloured
    if findings.suspect:
        return findings.suspect
    if pattern is not None and not pattern.passed:
        return f"{pattern.message}: the model lacks an effect"
    if coloured:
        return "they are coloured, unlike noise: the model lacks an effect, or something drifts"
    if pattern is None:
        return "the model lacks an effect, or the stated noise is too small: too few poses to decide"
    return f"{pattern.message}: the stated noise is too small, or the model lacks an effect of another shape"


def written(part: CalibrationFindings, name: str) -> tuple[float, str]:
    """Factor from SI, and unit, for printing errors of a signal."""
    turns = name.partition("@")[0] == part.data.pose.orientation
    units = {parse_unit(u).si_text for u in part.data.columns[name].units} if name in part.data.columns else {"m"}
    if turns or units == {"rad"}:
        return float(np.degrees(1.0)), "deg"
    return (1e3, "mm") if units == {"m"} else (1.0, min(units))


def _as_it_is(findings: CalibrationFindings, accuracy: float | None) -> tuple[bool, bool | None, list[str]]:
    """The verdict if nothing was fitted; fitted and held-out poses are then equivalent."""
    errors = findings.headline[0]
    sentences = ["nothing was fitted: the robot is evaluated as it is"]
    if findings.shift is not None:
        sentences.append(findings.shift.message)
    if findings.position not in errors:
        return True, False, [*sentences, "no pose closes with these parameters"]
    p = errors[findings.position]
    message = f"mean {1e3 * p.mean:.3g} mm, largest {1e3 * p.greatest:.3g} mm on {len(p.sizes)} poses"
    if p.lost:
        return True, False, [*sentences, f"{message}; {p.lost} do not close"]
    if accuracy is None:
        return True, None, [*sentences, f"{message}; set accuracy_mm to the required accuracy to get a verdict"]
    proven = p.mean <= accuracy
    against = "within" if proven else "more than"
    return True, proven, [*sentences, f"{message}: {against} the required {1e3 * accuracy:.3g} mm"]


def _predicted(c: Calibration, m: Measurements, data: SplitPoses) -> dict[str, Prediction]:
    """Errors of position and orientations; of all measured signals if the pose is measured partially.

    Empty if no pose closes."""
    try:
        errors = c.positioning_errors(m)
    except (ModelError, ValueError, np.linalg.LinAlgError):
        return {}
    predictions = {
        n: Prediction(e) for n, e in errors.items() if n == data.position or e.shape[1] == 3 or not data.whole
    }
    return predictions if all(np.any(np.isfinite(p.errors)) for p in predictions.values()) else {}


def _scale(c: Calibration) -> float:
    """Robust standard deviation of the residuals of the cost."""
    p = c.problem
    if c.cost == "squared":
        r = np.concatenate([b.evaluate(p.reading.data, c.x[b.columns])[0].reshape(-1) for b in p.squared])
    elif c.cost == "length":
        r = c.residuals.reshape(-1)
    else:
        r = np.asarray(c.estimate.residuals) if c.estimate is not None else np.ones(1)
    return max(MAD * float(np.median(np.abs(r))), 1e-12)


def length_noise(p: CalibrationProblem) -> float:
    """Noise of a length [m] before the residuals are known: that of the position, default 0.1 mm."""
    for pose in p.measurements.poses:
        if pose.position in p.measurements.noise:
            axes = np.asarray(p.measurements.values[pose.position]).shape[1]
            covariance = p.measurements.covariance(pose.position, axes)
            return float(np.sqrt(np.mean(np.diagonal(covariance, axis1=1, axis2=2))))
    return 1e-4


def _sensitivity(fit: Fit, c: Calibration) -> Sensitivity | None:
    if fit.sensitivity_step == 0 or not c.status.ok or not len(c.x) or c.problem.beside:
        return None
    try:
        return sensitivity(c.problem, c.x, fit.sensitivity_step)
    except ModelError:
        return None


def _repeatability(data: SplitPoses) -> float | None:
    T = data.T
    spread = [T[g] - T[g].mean(axis=0) for g in data.repeated]
    degrees_of_freedom = sum(len(s) - 1 for s in spread)
    return float(np.sqrt(sum(np.sum(s**2) for s in spread) / degrees_of_freedom)) if degrees_of_freedom else None
