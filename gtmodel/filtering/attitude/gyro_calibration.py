"""Calibration of a gyro against few, badly timed reference orientations: matrix with its parts, bias, clock offset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from ...geometry.rotations import cross_matrix
from ...inference.covariance import carried
from ...inference.nonlinear import central, nonlinear_fit
from ...inference.residuals import Verdict, whiteness
from ...measurements.drift import DriftBasis
from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from ...results.status import SolveStatus
from ...results.suspicion import Suspicion
from .gyro_path import START, GyroPath, RateCorrection, ReferenceNoise, factors, gyro_path, likeliest_noise, whitened

KINDS = ("none", "linear", "temperature")
_VECTORS = tuple(f"{what}[{k}]" for what in ("mount", "scale", "misalignment", "bias") for k in range(3))
PART_NAMES = (*_VECTORS, "offset")
PART_UNITS = ("rad",) * 3 + ("1",) * 3 + ("rad",) * 3 + ("rad/s",) * 3 + ("s",)


def parts(numbers: np.ndarray) -> np.ndarray:
    """Convert the numbers of a correction to mount (3,), scale (3,), misalignment (3,), bias (3,), clock offset, drift.

    matrix = turn * stretch, the polar decomposition: `mount` is the rotation vector of the turn from the sensor to the
    body; the stretch is symmetric, with scales on its diagonal and the misalignments yz, zx, xy of the sensor's axes
    off it.
    """
    turn, stretch = scipy.linalg.polar(np.reshape(numbers[:9], (3, 3)))
    misalignment = stretch[[1, 2, 0], [2, 0, 1]]
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), np.diag(stretch), misalignment, numbers[9:]])


NAMES = (*(f"matrix[{i}][{j}]" for i in range(3) for j in range(3)), *(f"bias[{i}]" for i in range(3)), "offset")
UNITS = ("1",) * 9 + ("rad/s",) * 3 + ("s",)
SIZES = (1.0,) * 9 + (1e-2,) * 3 + (1e-2,)
DRIFT_SIZE = 1e-6  # rad/s per unit of a condition: half a degree per second in two hours
ROUNDS = 4  # alternations of noise estimate and fit: the fourth changes no printed digit
FEWEST = 20  # references: sixty numbers for thirteen unknowns and four noise parameters
STRETCHED = 2.0  # a gyro scale above this or below its inverse is not plausible
LEAST_TURN = 0.01  # of the rotations about the strongest axis: below, an axis is known to 10 % at best
RELATED = 0.15  # of the rotations: a larger disagreement of gyro and references is not due to too little rotation
BLOCKS = 4  # of equal rotation angle, left out one by one: longer than a low-cost gyro's error persists, 2 to 3 s


def with_drift(
    names: tuple[str, ...], units: tuple[str, ...], basis: DriftBasis
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names and units with those of the drifts of the bias."""
    columns = basis.columns()
    more = [f"bias_{prefix}[{k}]" for prefix, _, _ in columns for k in range(3)]
    return (*names, *more), (*units, *(f"rad/s{per}" for _, per, _ in columns for _ in range(3)))


NONE = DriftBasis((), np.zeros(0))


@dataclass(frozen=True, eq=False)
class GyroCalibration:
    """Calibration of a gyro against references.

    correction: the estimated correction. likeliest: the same estimate with the covariance for maximum-likelihood noise,
        by the names "matrix[0][0]", "bias[0]", "offset"; None if the fit failed. left_out: change of the numbers
        without each of four blocks (4, 13). noise: disagreement of references and gyro. log_likelihood: of the
        references.
    white: whiteness test of the whitened residuals over time. residual: between neighbouring references (k, 3) [rad],
    in the axes of the body. time: end of each interval (k,) [s]. doubts: tests of the residuals for a drift of the
    bias. basis: drift that was estimated.
    """

    status: SolveStatus
    message: str
    correction: RateCorrection
    likeliest: Estimate | None
    left_out: np.ndarray
    noise: ReferenceNoise
    log_likelihood: float
    white: Verdict | None
    residual: np.ndarray
    time: np.ndarray
    doubts: tuple[Suspicion, ...] = ()
    basis: DriftBasis = NONE

    @cached_property
    def estimate(self) -> Estimate:
        """The numbers with intervals from both covariances. Raises ArgumentError if the fit failed."""
        return self.by(*with_drift(NAMES, UNITS, self.basis), lambda x: x)

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the interval of one of its numbers [SI]. Raises ArgumentError for another name or a failed fit."""
        return self.estimate.interval(name, level)

    def by(
        self, names: tuple[str, ...], units: tuple[str, ...], function: Callable[[np.ndarray], np.ndarray]
    ) -> Estimate:
        """Return the estimate of functions of the thirteen numbers, to first order.

        Each standard deviation is the larger one of maximum-likelihood noise and of a jackknife over the blocks, with
        three degrees of freedom of Student's t. Raises ArgumentError if the fit failed.
        """
        if self.likeliest is None:
            raise ArgumentError(f"the fit has no intervals: {self.message}", "name")
        x = self.likeliest.values
        J = central(function, x)
        covariance = carried(J, self.likeliest.covariance)
        steps = (self.left_out - self.left_out.mean(axis=0)) @ J.T
        jackknife = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum(steps**2, axis=0))
        ratio = np.maximum(1.0, jackknife / np.sqrt(np.diag(covariance)))
        wider = [name for name, wide in zip(names, ratio, strict=True) if wide > 1.0]
        return replace(
            self.likeliest, names=names, units=units, values=function(x),
            covariance=covariance * np.outer(ratio, ratio),
            known_noise=False, degrees_of_freedom=float(BLOCKS - 1),
            notes=(f"wider by the jackknife: {', '.join(wider)}",) if wider else (),
        )  # fmt: skip


def calibrate_gyro(
    time: np.ndarray,
    reading: np.ndarray,
    reference_time: np.ndarray,
    reference: Rotation,
    start: RateCorrection,
    ask: Callable[[], None] = lambda: None,
    basis: DriftBasis = NONE,
) -> GyroCalibration:
    """Fit matrix, bias and clock offset so that integrated rates match the rotations between neighbouring references.

    Args:
        time, reading: of the gyro, (n,) and (n, 3) [rad/s].
        reference_time, reference: (k,) by the reference's clock, and body to world.
        start: initial guess; its offset must be accurate to about one sample of the gyro.
        ask: called at each evaluation; an exception ends the fit.
        basis: drift of the bias, with the conditions of each row of `reading`. The bias is that at its origin.

    Residuals are tested for a drift that is not estimated.

    Nonlinear least squares, with a cost linear in the number of references. The residual covariance, see
    `ReferenceNoise`, is estimated by maximum likelihood in alternation with the fit. Each standard deviation is the
    larger one of that covariance and of a jackknife over four blocks of time, with three degrees of freedom of
    Student's t: gyro errors persist for seconds, so a recording of ten seconds holds few independent ones, and
    intervals from maximum-likelihood noise alone are too narrow.
    Raises ArgumentError for fewer than twenty references.

    >>> made = gt.filtering.synthetic_attitude(gt.filtering.SyntheticAttitude(duration=6.0, relative=0.0))
    >>> gyro, references = made.recording.gyro, made.recording.reference
    >>> time = gt.filtering.sampled_instants(gyro.time, 0.009963)
    >>> from scipy.spatial.transform import Rotation
    >>> body = Rotation.from_quat(references["quaternion"], scalar_first=True).inv()  # written world to body
    >>> start = gt.filtering.RateCorrection(np.eye(3), np.zeros(3))
    >>> fit = gt.filtering.calibrate_gyro(time, np.radians(gyro["rate"]), references.time, body, start)
    >>> low, high = fit.interval("offset")
    >>> low < made.correction.offset < high
    True
    """
    if len(reference_time) < FEWEST:
        raise ArgumentError(f"expected at least {FEWEST} references to calibrate; found {len(reference_time)}", "until")
    columns = [column for _, _, column in basis.columns()]
    problem = _Turns(time, np.column_stack([reading, *columns]), reference_time, reference)
    names, units = with_drift(NAMES, UNITS, basis)
    more = 3 * len(columns)
    x, fit = np.append(start.numbers[: len(NAMES)], np.zeros(more)), None
    noise, logs, roots = ReferenceNoise(*START), -np.inf, list[np.ndarray]()
    for _ in range(ROUNDS):
        path = problem.path(x)
        noise, logs = likeliest_noise(*problem(x), problem.turn, path.rate, reference_time, noise, ask)
        roots = factors(noise, problem.turn, path.rate, reference_time)

        def white_rows(x: np.ndarray, roots: list[np.ndarray] = roots) -> tuple[np.ndarray, np.ndarray]:
            ask()
            r, J = problem(x)
            return whitened(roots, r), whitened(roots, J)

        fit = nonlinear_fit(white_rows, x, names, scale=(*SIZES, *(DRIFT_SIZE,) * more), sigma=1.0, units=units)
        if not fit.status.ok or fit.estimate is None:
            break
        done = float(np.max(np.abs(fit.x - x) / fit.estimate.std)) < 1e-2
        x = fit.x
        if done:
            break
    assert fit is not None
    white, left_out, doubts = None, np.zeros((BLOCKS, len(x))), list[Suspicion]()
    if fit.estimate is not None:
        doubts = _drifts(problem, x, roots, basis, time)
        left_out = _left_out(problem, x, roots)
        white = whiteness(_along(fit.r))
    correction, r = RateCorrection.of(x), problem.residual(x)[0]
    return GyroCalibration(
        fit.status,
        fit.message,
        correction,
        fit.estimate,
        left_out,
        noise,
        logs,
        white,
        r,
        reference_time[1:],
        tuple(doubts),
        basis,
    )


def _drifts(
    problem: _Turns, x: np.ndarray, roots: list[np.ndarray], basis: DriftBasis, time: np.ndarray
) -> list[Suspicion]:
    """Test the residuals for a drift of the bias with time and temperature."""
    r, J = problem(x)
    middle = (problem.at[:-1] + problem.at[1:]) / 2
    temperature = None if basis.temperature is None else np.interp(middle, time, basis.temperature)

    def white(rows: np.ndarray) -> np.ndarray:
        return whitened(roots, rows.reshape(len(r), -1)).reshape(len(middle), 3, -1)

    conditions = DriftBasis(basis.kinds, middle, None, temperature)
    return conditions.suspicions(
        "gyro", "rad/s", white(J), white(r)[:, :, 0], key="judging.drift", kinds=KINDS,
        by=J[:, 9:12].reshape(len(middle), 3, 3), white=white,
    )  # fmt: skip


def turns_enough(
    part: str, time: np.ndarray, reading: np.ndarray, at: np.ndarray, reference: Rotation, offset: float = 0.0
) -> None:
    """Raise ArgumentError if a part of a recording hardly rotates about some axis, so that the matrix is undetermined:
    the gyro explains less than half of the rotations about it, or they are a hundredth of those about others.
    """
    turn = (reference[:-1].inv() * reference[1:]).as_rotvec()
    read = gyro_path(time, reading, at, RateCorrection(np.eye(3), np.zeros(3), offset)).between.as_rotvec()
    fitted = read @ np.linalg.lstsq(read, turn, rcond=None)[0]
    _, size, axes = np.linalg.svd(turn, full_matrices=False)
    residual = turn - fitted
    related = float(np.sqrt(np.mean(residual**2)))
    weak_residual = float(np.sqrt(np.mean((residual @ axes[-1]) ** 2)))
    weak, strong = size[-1] / np.sqrt(len(turn)), size[0] / np.sqrt(len(turn))
    if weak > max(LEAST_TURN * strong, np.sqrt(2) * weak_residual if related < RELATED * strong else 0.0):
        return
    axis = axes[-1] * np.sign(axes[-1][np.argmax(np.abs(axes[-1]))])
    axis_text = ", ".join(f"{v:.2f}" for v in axis)
    raise ArgumentError(
        f"{part}, {at[0]:.4g} .. {at[-1]:.4g} s, hardly turns about the axis ({axis_text}) of the body: "
        f"{np.degrees(weak):.2g} deg between two references, {np.degrees(strong):.2g} deg about others, while gyro and "
        f"references disagree by {np.degrees(weak_residual):.2g} deg about it; calibration needs rotations about all "
        "axes: divide the recording at another time, or record more",
        "judging.calibrate_until",
    )


def calibrated_on(
    part: str,
    time: np.ndarray,
    reading: np.ndarray,
    at: np.ndarray,
    reference: Rotation,
    start: RateCorrection,
    ask: Callable[[], None] = lambda: None,
    period: float | None = None,
    basis: DriftBasis = NONE,
) -> GyroCalibration:
    """As `calibrate_gyro`, on a part of a recording. Raises ArgumentError if the part does not determine the gyro.

    period: sampling period of the sensor [s], if stated. basis: drift of the bias to estimate.
    """
    turns_enough(part, time, reading, at, reference, start.offset)
    try:
        calibration = calibrate_gyro(time, reading, at, reference, start, ask, basis)
    except ArgumentError as fault:
        raise ArgumentError(f"on {part}: {fault.message}", fault.argument or "recording") from None
    matrix = calibration.correction.matrix
    stretch = np.linalg.svd(matrix, compute_uv=False)
    if np.linalg.det(matrix) <= 0 or not (1 / STRETCHED < stretch[-1] and stretch[0] < STRETCHED):
        raise ArgumentError(
            f"on {part} the gyro would have scales of {stretch[-1]:.2g} to {stretch[0]:.2g}, so its stamps do not "
            "match those of the references; "
            + (
                "if rows are stamped on arrival, state the sensor's own period"
                if period is None
                else f"compare the stated period of {1e3 * period:.6g} ms and both columns of time with the devices"
            ),
            "judging.sample_period",
        )
    return calibration


class _Turns:
    """Residuals of the rotations between neighbouring references, and their derivatives."""

    def __init__(self, time: np.ndarray, reading: np.ndarray, at: np.ndarray, reference: Rotation) -> None:
        self.time, self.reading, self.at = time, reading, at
        self.turn = reference[:-1].inv() * reference[1:]

    def path(self, x: np.ndarray, derivative: bool = False) -> GyroPath:
        return gyro_path(self.time, self.reading, self.at, RateCorrection.of(x), derivative=derivative)

    def residual(self, x: np.ndarray, path: GyroPath | None = None) -> tuple[np.ndarray, GyroPath]:
        """Residuals (k, 3) in the axes of the body at the end of each interval: reference relative to gyro."""
        path = path or self.path(x)
        return (path.between.inv() * self.turn).as_rotvec(), path

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, path = self.residual(x, self.path(x, derivative=True))
        assert path.derivative is not None
        moved = np.swapaxes(path.turn[1:].as_matrix(), 1, 2) @ np.diff(path.derivative, axis=0)
        K = cross_matrix(r)  # inverse left Jacobian of r, accurate for residuals up to 0.1 rad
        J = -(np.eye(3) - K / 2 + K @ K / 12) @ moved
        return r.ravel(), J.reshape(-1, len(x))


def _along(white: np.ndarray) -> np.ndarray:
    """Whitened residuals (3 k,), one axis after the other, so that neighbours are adjacent in time."""
    return white.reshape(-1, 3).T.ravel()


def _left_out(problem: _Turns, x: np.ndarray, roots: list[np.ndarray]) -> np.ndarray:
    """Change of the numbers without each block of equal rotation angle (blocks, n): one Gauss-Newton step."""
    r, J = problem(x)
    angle = np.cumsum(problem.turn.magnitude())
    block = np.minimum((BLOCKS * angle / angle[-1]).astype(int), BLOCKS - 1)
    moved = []
    for k in range(BLOCKS):
        remaining, first, factors_kept = np.repeat(block != k, 3), 0, list[np.ndarray]()
        for L in roots:
            rows = remaining[first : first + len(L)]
            factors_kept.append(np.linalg.cholesky((L @ L.T)[np.ix_(rows, rows)]))
            first += len(L)
        A, b = (whitened(factors_kept, v) for v in (J[remaining], r[remaining]))
        size = 1 / np.linalg.norm(A, axis=0)
        moved.append(-size * np.linalg.lstsq(A * size, b, rcond=None)[0])
    return np.array(moved)
