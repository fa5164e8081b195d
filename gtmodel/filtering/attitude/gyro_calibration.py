"""A gyro calibrated against references of orientation that are few and badly timed: matrix with its parts, bias,
delay."""

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
from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from ...results.status import SolveStatus
from .gyro_path import START, GyroPath, RateCorrection, ReferenceNoise, factors, gyro_path, likeliest_noise, whitened

_VECTORS = tuple(f"{what}[{k}]" for what in ("mount", "scale", "misalignment", "bias") for k in range(3))
PART_NAMES = (*_VECTORS, "offset")
PART_UNITS = ("rad",) * 3 + ("1",) * 3 + ("rad",) * 3 + ("rad/s",) * 3 + ("s",)


def parts(numbers: np.ndarray) -> np.ndarray:
    """Mount (3,), scale (3,), misalignment (3,), bias (3,) and offset from the thirteen numbers of a correction.

    matrix = turn * stretch, the polar decomposition: `mount` is the rotation vector of the turn from the sensor to the
    body; the stretch is symmetric, scales on its diagonal, misalignments yz, zx, xy of the sensor's axes beside it.
    """
    turn, stretch = scipy.linalg.polar(np.reshape(numbers[:9], (3, 3)))
    beside = stretch[[1, 2, 0], [2, 0, 1]]
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), np.diag(stretch), beside, numbers[9:]])


NAMES = (*(f"matrix[{i}][{j}]" for i in range(3) for j in range(3)), *(f"bias[{i}]" for i in range(3)), "offset")
UNITS = ("1",) * 9 + ("rad/s",) * 3 + ("s",)
SIZES = (1.0,) * 9 + (1e-2,) * 3 + (1e-2,)
ROUNDS = 4  # of noise and fit in turn: the fourth changes no printed digit
FEWEST = 20  # references: sixty numbers for thirteen unknowns and four sizes of noise
STRETCHED = 2.0  # scales of a gyro beyond this, or below its inverse, are no scales
LEAST_TURN = 0.01  # of the turns about the strongest axis: below, it is known to ten per cent at the best
RELATED = 0.15  # of the turns: where gyro and references disagree by more, that is not for want of turning
BLOCKS = 4  # of equal turned angle, left out one by one: longer than the error of a cheap gyro persists, 2 to 3 s


@dataclass(frozen=True, eq=False)
class GyroCalibration:
    """What a stretch of references says of a gyro.

    correction: the estimate as an object. likeliest: the same with the covariance of the likeliest noise, by the names
        "matrix[0][0]", "bias[0]", "offset"; None where the fit failed. left_out: how the numbers move without each of
        four blocks (4, 13). noise: what references and gyro disagree by. log_likelihood: of the references.
    white: test of the whitened residuals along time. residual: between neighbouring references (k, 3) [rad], in the
    axes of the body. time: where each ends (k,) [s].
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

    @cached_property
    def estimate(self) -> Estimate:
        """The thirteen numbers with intervals that heed both covariances. Raises ArgumentError where the fit failed."""
        return self.by(NAMES, UNITS, lambda x: x)

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Interval of one of its numbers [SI]. Raises ArgumentError for another name, and where the fit failed."""
        return self.estimate.interval(name, level)

    def by(
        self, names: tuple[str, ...], units: tuple[str, ...], function: Callable[[np.ndarray], np.ndarray]
    ) -> Estimate:
        """The estimate of functions of the thirteen numbers, to first order.

        Standard deviations are the larger ones of the likeliest noise and of a jackknife over the blocks; Student's t
        has three degrees of freedom. Raises ArgumentError where the fit failed.
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
) -> GyroCalibration:
    """Matrix, bias and clock offset that bring integrated rates nearest to the turns between neighbouring references.

    Args:
        time, reading: of the gyro, (n,) and (n, 3) [rad/s].
        reference_time, reference: (k,) by the reference's clock, and body to world.
        start: where the fit begins; its offset within about one sample of the gyro.
        ask: called at each evaluation; what it raises ends the fit.

    Nonlinear least squares, at a cost linear in the references; the covariance of its residuals, see `ReferenceNoise`,
    is the most likely one, found in turn with the fit. The standard deviations are the larger ones of that covariance
    and of a jackknife over four blocks of time, with Student's t of three degrees of freedom: few independent errors of
    a gyro that persist for seconds lie in a recording of ten, and intervals of the likeliest noise alone cover too
    little.
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
        raise ArgumentError(f"{len(reference_time)} references are too few to calibrate on; expected {FEWEST}", "until")
    problem = _Turns(time, reading, reference_time, reference)
    x, fit = start.numbers, None
    noise, logs, roots = ReferenceNoise(*START), -np.inf, list[np.ndarray]()
    for _ in range(ROUNDS):
        path = problem.path(x)
        noise, logs = likeliest_noise(*problem(x), problem.turn, path.rate, reference_time, noise, ask)
        roots = factors(noise, problem.turn, path.rate, reference_time)

        def white_rows(x: np.ndarray, roots: list[np.ndarray] = roots) -> tuple[np.ndarray, np.ndarray]:
            ask()
            r, J = problem(x)
            return whitened(roots, r), whitened(roots, J)

        fit = nonlinear_fit(white_rows, x, NAMES, scale=SIZES, sigma=1.0, units=UNITS)
        if not fit.status.ok or fit.estimate is None:
            break
        done = float(np.max(np.abs(fit.x - x) / fit.estimate.std)) < 1e-2
        x = fit.x
        if done:
            break
    assert fit is not None
    white, left_out = None, np.zeros((BLOCKS, len(x)))
    if fit.estimate is not None:
        left_out = _left_out(problem, x, roots)
        white = whiteness(_along(fit.r))
    correction, r = RateCorrection.of(x), problem.residual(x)[0]
    return GyroCalibration(
        fit.status, fit.message, correction, fit.estimate, left_out, noise, logs, white, r, reference_time[1:]
    )


def turns_enough(
    part: str, time: np.ndarray, reading: np.ndarray, at: np.ndarray, reference: Rotation, offset: float = 0.0
) -> None:
    """Raises ArgumentError for a part of a recording that hardly turns about some axis, which leaves the matrix open:
    where the gyro explains less than half of the turns about it, or they are a hundredth of those about others.
    """
    turn = (reference[:-1].inv() * reference[1:]).as_rotvec()
    read = gyro_path(time, reading, at, RateCorrection(np.eye(3), np.zeros(3), offset)).between.as_rotvec()
    fitted = read @ np.linalg.lstsq(read, turn, rcond=None)[0]
    _, size, axes = np.linalg.svd(turn, full_matrices=False)
    off = turn - fitted
    related = float(np.sqrt(np.mean(off**2)))
    apart = float(np.sqrt(np.mean((off @ axes[-1]) ** 2)))
    weak, strong = size[-1] / np.sqrt(len(turn)), size[0] / np.sqrt(len(turn))
    if weak > max(LEAST_TURN * strong, np.sqrt(2) * apart if related < RELATED * strong else 0.0):
        return
    axis = axes[-1] * np.sign(axes[-1][np.argmax(np.abs(axes[-1]))])
    named = ", ".join(f"{v:.2f}" for v in axis)
    raise ArgumentError(
        f"{part}, {at[0]:.4g} .. {at[-1]:.4g} s, hardly turns about the axis ({named}) of the body: "
        f"{np.degrees(weak):.2g} deg between two references, {np.degrees(strong):.2g} deg about others, where gyro and "
        f"references disagree by {np.degrees(apart):.2g} deg about it; a gyro is calibrated where a body turns "
        "about all axes: divide the recording at another time, or record more",
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
) -> GyroCalibration:
    """As `calibrate_gyro`, on a part of a recording. Raises ArgumentError for one that does not determine a gyro.

    period: of the sensor, where it was stated [s].
    """
    turns_enough(part, time, reading, at, reference, start.offset)
    try:
        made = calibrate_gyro(time, reading, at, reference, start, ask)
    except ArgumentError as fault:
        raise ArgumentError(f"on {part}: {fault.message}", fault.argument or "recording") from None
    matrix = made.correction.matrix
    stretch = np.linalg.svd(matrix, compute_uv=False)
    if np.linalg.det(matrix) <= 0 or not (1 / STRETCHED < stretch[-1] and stretch[0] < STRETCHED):
        raise ArgumentError(
            f"on {part} the gyro would have scales of {stretch[-1]:.2g} to {stretch[0]:.2g}, so its stamps do not "
            "belong to those of the references; "
            + (
                "where rows are stamped when they arrive, state the sensor's own period"
                if period is None
                else f"compare the stated period of {1e3 * period:.6g} ms and both columns of time with the devices"
            ),
            "judging.sample_period",
        )
    return made


class _Turns:
    """Residuals of the turns between neighbouring references, and their derivatives."""

    def __init__(self, time: np.ndarray, reading: np.ndarray, at: np.ndarray, reference: Rotation) -> None:
        self.time, self.reading, self.at = time, reading, at
        self.turn = reference[:-1].inv() * reference[1:]

    def path(self, x: np.ndarray, derivative: bool = False) -> GyroPath:
        return gyro_path(self.time, self.reading, self.at, RateCorrection.of(x), derivative=derivative)

    def residual(self, x: np.ndarray, path: GyroPath | None = None) -> tuple[np.ndarray, GyroPath]:
        """(k, 3), in the axes of the body at the end of each interval: zero where the gyro agrees."""
        path = path or self.path(x)
        return (path.between.inv() * self.turn).as_rotvec(), path

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, path = self.residual(x, self.path(x, derivative=True))
        assert path.derivative is not None
        moved = np.swapaxes(path.turn[1:].as_matrix(), 1, 2) @ np.diff(path.derivative, axis=0)
        K = cross_matrix(r)  # inverse left Jacobian of r, to what residuals of a tenth of a radian need
        J = -(np.eye(3) - K / 2 + K @ K / 12) @ moved
        return r.ravel(), J.reshape(-1, len(x))


def _along(white: np.ndarray) -> np.ndarray:
    """Whitened residuals (3 k,) one axis after the other, so that neighbours in the row are neighbours in time."""
    return white.reshape(-1, 3).T.ravel()


def _left_out(problem: _Turns, x: np.ndarray, roots: list[np.ndarray]) -> np.ndarray:
    """How the numbers move without each block of equal turned angle (blocks, n): one step of the fit."""
    r, J = problem(x)
    angle = np.cumsum(problem.turn.magnitude())
    block = np.minimum((BLOCKS * angle / angle[-1]).astype(int), BLOCKS - 1)
    moved = []
    for k in range(BLOCKS):
        kept, first, own = np.repeat(block != k, 3), 0, list[np.ndarray]()
        for L in roots:
            there = kept[first : first + len(L)]
            own.append(np.linalg.cholesky((L @ L.T)[np.ix_(there, there)]))
            first += len(L)
        A, b = (whitened(own, v) for v in (J[kept], r[kept]))
        size = 1 / np.linalg.norm(A, axis=0)
        moved.append(-size * np.linalg.lstsq(A * size, b, rcond=None)[0])
    return np.array(moved)
