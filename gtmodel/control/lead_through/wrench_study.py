"""Study of a force sensor's calibration from measured or synthetic readings, and the lever arm of forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Unpack

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ...geometry.rotations import cross_matrix, rotation_by
from ...inference import coverage, linear_fit
from ...results import ArgumentError, Check, Estimate, SolveStatus, Trajectory, Work
from ...results.options import Within
from ...results.suspicion import suspicion_checks
from ...results.work import WorkOptions, study_function
from .calibration import WrenchCalibration, calibrate_wrench, ends_of_range
from .options import Drift, SyntheticReadings, WrenchAlarm, WrenchStudy
from .wrench import WrenchStatus, axes, rows_of, sigma_of, turns_of

ABOVE_NOISE = 50.0  # least ratio of forces to their noise, which then biases the arm by at most 1/2500
PASSES = 3  # the noise of a moment depends weakly on the arm


@dataclass(frozen=True, eq=False)
class LeverArm:
    """estimate: of arm_x, arm_y, arm_z [m], from the sensor's origin to the point of application, in the sensor's
    frame; None if status is not OK. status: OK, NO_FORCE, or ONE_DIRECTION if the pushes do not determine the arm
    along their direction.
    """

    estimate: Estimate | None
    status: WrenchStatus


def lever_arm(
    forces: ArrayLike,
    moments: ArrayLike,
    *,
    sigma_force: float,
    sigma_moment: float,
    calibration: WrenchCalibration | None = None,
    turns: ArrayLike | None = None,
) -> LeverArm:
    """Fit the point of application of pure forces to wrenches without bias and weight: moment = arm x force.

    Args:
        forces, moments: (pushes, 3) [N], [N m] in the sensor's frame, in at least two directions, for example pushes
            of the tip against a fixed point, from `WrenchCalibration.contact`.
        sigma_force, sigma_moment: standard deviation of one reading [N], [N m].
        calibration: the calibration used to remove bias and weight; turns: (pushes, 3, 3) of the sensor in the world
            frame at each push. The error of the calibration, common to all pushes, then widens the intervals.

    Least squares of the moments, weighted with the noise of moments and, through the arm, of forces. The root mean
    square of the forces, also perpendicular to any direction, must exceed 50 sigma_force; otherwise the status says so.
    Raises ArgumentError if shapes do not fit, if numbers are not finite, if a standard deviation is not positive, or if
    only one of calibration and turns is set.

    >>> pushes = np.array([[20.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, 20.0]])
    >>> arm = gt.control.lead_through.lever_arm(
    ...     pushes, np.cross([0.0, 0.05, 0.2], pushes), sigma_force=0.05, sigma_moment=0.002)
    >>> arm.status.name, arm.estimate.values.round(6)
    ('OK', array([0.  , 0.05, 0.2 ]))
    >>> gt.control.lead_through.lever_arm(pushes[:1], pushes[:1], sigma_force=0.05, sigma_moment=0.002).status.name
    'ONE_DIRECTION'
    """
    f = rows_of(forces, "forces")
    m = rows_of(moments, "moments", len(f))
    sigma_of(sigma_force, "sigma_force")
    sigma_of(sigma_moment, "sigma_moment")
    A = -cross_matrix(f)
    least = len(f) * (ABOVE_NOISE * sigma_force) ** 2
    if np.sum(f**2) < least:
        return LeverArm(None, WrenchStatus.NO_FORCE)
    if np.linalg.eigvalsh(np.einsum("nij,nik->jk", A, A))[0] < least:
        return LeverArm(None, WrenchStatus.ONE_DIRECTION)
    if (calibration is None) != (turns is None):
        raise ArgumentError("calibration and turns must be set together", "turns")
    arm, estimate, white = np.zeros(3), None, np.eye(3)
    for _ in range(PASSES):
        through = cross_matrix(arm)
        white = np.linalg.inv(np.linalg.cholesky(sigma_moment**2 * np.eye(3) + sigma_force**2 * through @ through.T))
        estimate = linear_fit(
            (white @ A).reshape(-1, 3), (m @ white.T).reshape(-1), axes("arm"), sigma=1.0, units=["m"] * 3
        )
        arm = estimate.values
    if calibration is not None and turns is not None and estimate is not None:
        R = turns_of(turns, "turns")
        if len(R) != len(f):
            raise ArgumentError(f"expected {len(f)} matrices, one per push; found {len(R)}", "turns")
        g = R.transpose(0, 2, 1) @ calibration.gravity
        estimate = replace(estimate, covariance=estimate.covariance + _common(calibration, g, A, white, arm))
    return LeverArm(estimate, WrenchStatus.OK)


def _common(known: WrenchCalibration, g: np.ndarray, A: np.ndarray, white: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Covariance (3, 3) of the arm from errors of bias, mass and first moment, to first order."""
    through = cross_matrix(arm)
    by_force = np.concatenate([np.broadcast_to(through, (len(g), 3, 3)), (through @ g.T).T[:, :, None]], axis=2)
    by_moment = np.concatenate([np.broadcast_to(-np.eye(3), (len(g), 3, 3)), cross_matrix(g)], axis=2)
    J = white @ np.concatenate([by_force, by_moment], axis=2)
    B = white @ A
    gain = np.linalg.solve(np.einsum("nij,nik->jk", B, B), np.einsum("nij,nik->jk", B, J))
    covariance = scipy.linalg.block_diag(known.force.covariance[:4, :4], known.moment.covariance[:6, :6])
    return gain @ covariance @ gain.T


LEVEL = 0.95
SIGNALS = {"turn": "rad", "force": "N", "moment": "N.m"}


@study_function
def wrench_study(
    readings: Trajectory | SyntheticReadings,
    pushes: Trajectory | None = None,
    *,
    force_noise: Annotated[float | None, Within(above=0.0)] = None,
    moment_noise: Annotated[float | None, Within(above=0.0)] = None,
    drift: bool | Drift | Sequence[Drift] = "none",
    accept: Sequence[WrenchAlarm] = (),
    **work_options: Unpack[WorkOptions],
) -> WrenchStudy:
    """Calibrate a force sensor: bias, mass and centre of mass of its load, and lever arm of forces, with intervals.

    Args:
        readings: "turn" (rotation vector of the sensor's axes in the world frame) [rad], "force" [N], "moment" [N m],
            a row for each pose at rest without contact, and, if known, "session" (number of the recording) and
            "temperature" [K]; or options of synthetic readings.
        pushes: the same signals during pushes against a fixed point.
        force_noise [N], moment_noise [N m]: standard deviation of a reading; required with pushes, otherwise by
            default from the residuals.
        drift: drifts of the biases to estimate, as in `calibrate_wrench`; the biases are then those at the end.
        accept: names of alarms of the readings that become notes and fail no check, as in `calibrate_wrench`.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError if signals are missing, or if the poses do not determine a parameter.

    >>> L = gt.control.lead_through
    >>> sensor = L.SyntheticSensor(mass=0.9, centre=(0.01, 0.0, 0.1), point=(0.0, 0.0, 0.2))
    >>> s = L.wrench_study(L.SyntheticReadings(sensor, repetitions=0))
    >>> s.status.ok, bool(abs(s.mass - 0.9) < 0.02), s.usable
    (True, True, 'OK')
    """
    work = Work(**work_options)
    title, notes = work.title, list[str]()
    if isinstance(readings, SyntheticReadings):
        for value, name in ((pushes, "pushes"), (drift, "drift"), (accept, "accept")):
            if value and value != "none":
                raise ArgumentError("applies only to measured readings; leave it out", name)
        sensor, seed = readings.sensor, readings.seed
        noise = max(sensor.force_noise, 1e-9), max(sensor.moment_noise, 1e-9)
        known, arm = _synthetic(readings, np.random.default_rng(seed), noise)
        title = _marked(work.title or "wrench calibration")
        notes.append(f"synthetic: seed {seed}, noise {sensor.force_noise:g} N and {sensor.moment_noise:g} N m")
    else:
        if readings.synthetic is not None:
            title = _marked(work.title or "wrench calibration")
            notes.append(f"synthetic: {readings.synthetic}")
        noise = force_noise, moment_noise
        rows = [_signal(readings, name, "readings") for name in SIGNALS]
        known = calibrate_wrench(
            rotation_by(rows[0]), *rows[1:], sigma_force=noise[0], sigma_moment=noise[1], time=readings.time,
            drift=drift, accept=accept, **_conditions(readings),
        )  # fmt: skip
        arm = _measured_arm(known, pushes, force_noise, moment_noise)
        notes += ends_of_range(rows[1], "force") + ends_of_range(rows[2], "moment")
    doubts, sentences = suspicion_checks(known.suspicions, accept)
    notes += [*sentences, *known.notes]
    checks = {"wrench_usable": Check(float(known.status), judged=known.status.ok, advice=known.status.message)} | doubts
    answers: dict[str, Any] = {"usable": known.status.name}
    if isinstance(readings, SyntheticReadings) and readings.repetitions:
        work.step("coverage")
        shares, least = _covered(readings)
        answers["coverage"] = shares
        checks["least_coverage"] = Check(
            min(shares.values()), least, "the intervals contain the truth less often than stated", least=True
        )
    if arm is not None and arm.estimate is None:
        notes.append(f"no lever arm: {arm.status.message}")
    parts = [known.force, known.moment, known.centre, None if arm is None else arm.estimate]
    estimates = [part for part in parts if part is not None]
    bias, moment = known.force.values[:3], known.moment.values[:3]
    names = [(part, name) for part in estimates for name in part.names]
    rest = [  # a fit with known noise has normalised residuals
        (1.0 if sigma is None else sigma) * np.array(part.residuals).reshape(-1, 3)
        for part, sigma in zip((known.force, known.moment), noise, strict=True)
    ]

    def residuals() -> Any:
        from ...plot.lead_through import residuals_figure

        return residuals_figure(*rest, title=title)

    return WrenchStudy(
        status=SolveStatus.SOLVED, title=title, notes=notes, checks=checks, estimate=known.force,
        message=_words(known), figures={"residuals": residuals},
        poses=len(rest[0]), mass=known.force.value("mass"), force_bias=bias.tolist(), moment_bias=moment.tolist(),
        centre=None if known.centre is None else known.centre.values.tolist(),
        force_drift=_drift(known.force), moment_drift=_drift(known.moment),
        force_thermal=_drift(known.force, "thermal_"), moment_thermal=_drift(known.moment, "thermal_"),
        force_changes=_changes(known.force), moment_changes=_changes(known.moment),
        arm=None if arm is None or arm.estimate is None else arm.estimate.values.tolist(),
        half_widths={name: float(np.diff(part.interval(name, LEVEL))[0] / 2) for part, name in names}, **answers,
    )  # fmt: skip


def _conditions(readings: Trajectory) -> dict[str, np.ndarray]:
    if "temperature" in readings.names and readings.units["temperature"] != "K":
        raise ArgumentError(f"'temperature' is in {readings.units['temperature']}; expected K", "readings")
    return {name: readings[name] for name in ("session", "temperature") if name in readings.names}


def _drift(estimate: Estimate, prefix: str = "drift_") -> list[float] | None:
    values = [estimate.value(name) for name in estimate.names if name.startswith(prefix)]
    return values or None


def _changes(estimate: Estimate) -> dict[str, list[float]] | None:
    """Bias of each earlier session or block minus the last, "session_1" or "block_1"."""
    changes = dict[str, list[float]]()
    for name in estimate.names:
        if name.startswith(("session_", "block_")):
            changes.setdefault("_".join(name.split("_")[:2]), []).append(estimate.value(name))
    return changes or None


def _signal(readings: Trajectory, name: str, argument: str) -> np.ndarray:
    if name not in readings.names:
        raise ArgumentError(f"has no '{name}'; it has {', '.join(readings.names)}", argument)
    rows = np.array(readings[name], float)  # scipy needs writable rows
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ArgumentError(f"'{name}' has {rows.size // len(rows)} columns; expected 3", argument)
    if readings.units[name] != SIGNALS[name]:
        raise ArgumentError(f"'{name}' is in {readings.units[name]}; expected {SIGNALS[name]}", argument)
    return rows


def _measured_arm(
    known: WrenchCalibration, pushes: Trajectory | None, force_noise: float | None, moment_noise: float | None
) -> LeverArm | None:
    if pushes is None:
        return None
    for name, value in (("force_noise", force_noise), ("moment_noise", moment_noise)):
        if value is None:
            raise ArgumentError("is needed to weight the pushes", name)
    if known.reversed:
        return LeverArm(None, WrenchStatus.WRONG_SIGN)
    assert force_noise is not None and moment_noise is not None
    turn, force, moment = (_signal(pushes, name, "pushes") for name in SIGNALS)
    wrenches = known.contact(rotation_by(turn), force, moment)
    return lever_arm(
        *wrenches, sigma_force=force_noise, sigma_moment=moment_noise, calibration=known, turns=rotation_by(turn)
    )


def _synthetic(
    options: SyntheticReadings, rng: np.random.Generator, noise: tuple[float, float]
) -> tuple[WrenchCalibration, LeverArm | None]:
    sensor = options.sensor
    turns = scipy.spatial.transform.Rotation.random(options.poses, rng=rng).as_matrix()
    known = calibrate_wrench(turns, *sensor.readings_at_rest(turns, rng), sigma_force=noise[0], sigma_moment=noise[1])
    if options.pushes == 0 or known.reversed:
        return known, None
    force = rng.standard_normal((options.pushes, 3))
    force *= options.push / np.linalg.norm(force, axis=1)[:, None]
    upright = sensor.matrix.T  # of the tool, so that the sensor stands upright
    wrenches = [sensor.reading(f, np.zeros(3), upright, rng) for f in force]
    still = np.tile(np.eye(3), (options.pushes, 1, 1))
    contact = known.contact(still, [w[0] for w in wrenches], [w[1] for w in wrenches])
    return known, lever_arm(*contact, sigma_force=noise[0], sigma_moment=noise[1], calibration=known, turns=still)


def _covered(options: SyntheticReadings) -> tuple[dict[str, float], float]:
    """Share of intervals that contain the truth, by parameter, and the lower bound expected by chance."""
    sensor = options.sensor
    noise = max(sensor.force_noise, 1e-9), max(sensor.moment_noise, 1e-9)
    parts: dict[str, list[Estimate]] = {"force": [], "moment": [], "centre": [], "arm": []}
    for child in np.random.SeedSequence(options.seed + 1).spawn(options.repetitions):
        again, lever = _synthetic(options, np.random.default_rng(child), noise)
        parts["force"].append(again.force)
        parts["moment"].append(again.moment)
        parts["centre"] += [again.centre] if again.centre is not None else []
        parts["arm"] += [lever.estimate] if lever is not None and lever.estimate is not None else []
    truth = {
        "force": ("bias_force", sensor.force_bias), "moment": ("bias_moment", sensor.moment_bias),
        "centre": ("centre", sensor.centre), "arm": ("arm", sensor.point),
    }  # fmt: skip
    shares: dict[str, float] = {}
    least = 1.0
    for part, (word, true) in truth.items():
        if len(parts[part]) < options.repetitions:
            continue
        values = {f"{word}_{axis}": x for axis, x in zip("xyz", true, strict=True)}
        counts = coverage(parts[part], values | ({"mass": sensor.mass} if part == "force" else {}), level=LEVEL)
        shares |= {name: float(hits / counts.runs) for name, hits in zip(counts.names, counts.hits, strict=True)}
        least = min(least, counts.band[0] / counts.runs)
    return shares, least


def _words(known: WrenchCalibration) -> str:
    low, high = known.force.interval("mass", LEVEL)
    text = f"mass {known.force.value('mass'):.4g} kg ({low:.4g} to {high:.4g})"
    if known.centre is not None:
        x, y, z = 1e3 * known.centre.values
        text += f", centre at ({x:.3g}, {y:.3g}, {z:.3g}) mm"
    return text if known.status.ok else f"{text}: {known.status.message}"


def _marked(title: str) -> str:
    return title if "synthetic" in title.lower() else f"{title} (synthetic)"
