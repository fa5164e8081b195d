"""Unit of a gyro and convention of a quaternion, identified from a recording; errors in it: clock offset, mirrored
axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...geometry.rotations import angle_between, nearest_rotation
from ...inference.chance import f_chance
from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from ...results.suspicion import Suspicion
from .gyro_path import RateCorrection, gyro_path
from .options import AttitudeJudging

DEGREE = np.pi / 180
G = 9.80665  # m/s2
COUNTS = 2.0**15  # of a signed 16-bit reading, over the range of the sensor
# factors to rad/s, for the ranges in data sheets of inertial sensors
RATE_UNITS: Mapping[str, float] = {
    "rad/s": 1.0,
    "deg/s": DEGREE,
    "mrad/s": 1e-3,
    "mdeg/s": 1e-3 * DEGREE,
    **{f"counts of +-{r} deg/s": r / COUNTS * DEGREE for r in (125, 250, 500, 1000, 2000, 4000)},
}
ACCELERATION_UNITS: Mapping[str, float] = {
    "m/s2": 1.0,
    "g": G,
    "mg": 1e-3 * G,
    **{f"counts of +-{r} g": r / COUNTS * G for r in (2, 4, 8, 16)},
}
ORDERS = ("w x y z", "x y z w")
DIRECTIONS = ("body to world", "world to body")
SCALE_OFF = 0.1  # relative scale error of an accelerometer; real sensors are within some per cent
OFFSETS = 201  # clock offsets tried over the range; the best is refined between its neighbours
RESTING = 2e-3  # rad between two references: at rest
SETTLE = 0.15  # s left out at the start of a rest: the arm still vibrates
WIDE_STEP = 0.02  # s, step of offsets beyond the requested range: rotations last some tenths of a second
MOST_OFFSETS = 5000  # of these
# further digits depend on where the search for the offset ended; between equal conventions the first one stays first
LIKELIHOOD_DIGITS = 3
REFINED = 2  # most likely conventions whose clock offset is refined; two may differ by axes only


@dataclass(frozen=True)
class Convention:
    """One interpretation of the numbers: unit of the gyro, order and direction of the quaternion, and its fit.

    log_likelihood: of the rotations between references, for the best mounting rotation and clock offset, with the scale
    fixed at one and normal residuals of maximum-likelihood size. residual, turns: rms of the residuals and of the
    rotations [rad]; numbers: their count. offset: clock offset [s]. mount: mounting rotation, sensor to body, as a
    rotation vector [rad]. mirrored: gain in log-likelihood of the best reflection; mirror: that reflection by rows.
    """

    rate_unit: str
    order: str
    direction: str
    log_likelihood: float
    residual: float
    offset: float
    mount: tuple[float, float, float]
    turns: float = 0.0
    numbers: int = 0
    mirrored: float = 0.0
    mirror: tuple[tuple[float, ...], ...] = ()

    @property
    def either(self) -> float:
        """Log-likelihood of the best rotation or reflection."""
        return self.log_likelihood + max(0.0, self.mirrored)

    @property
    def words(self) -> str:
        """The convention in words."""
        return f"gyro in {self.rate_unit}, quaternion {self.order}, {self.direction}"


def rotations(quaternion: np.ndarray, order: str, direction: str) -> Rotation:
    """Orientations, body to world, from quaternions (n, 4) in this order and direction."""
    scalar_last = quaternion if order == ORDERS[1] else np.roll(quaternion, -1, axis=1)
    turned = Rotation.from_quat(scalar_last)
    return turned if direction == DIRECTIONS[0] else turned.inv()


def conventions(
    time: np.ndarray,
    reading: np.ndarray,
    reference_time: np.ndarray,
    quaternion: np.ndarray,
    *,
    rate_units: Sequence[str],
    orders: Sequence[str] = ORDERS,
    directions: Sequence[str] = DIRECTIONS,
    longest_offset: float = 0.5,
) -> list[Convention]:
    """Return all interpretations of the numbers, the most likely first.

    time (n,), reading (n, 3): raw data of the gyro. reference_time (k,), quaternion (k, 4): raw references. The clock
    offset maximises the correlation of rotation angles of gyro and references, and is then refined by the fit.
    """
    step = 2 * longest_offset / (OFFSETS - 1)
    tried, paths = [], dict[tuple[str, float], np.ndarray]()
    for order in orders:
        angle = _between(rotations(quaternion, order, DIRECTIONS[0])).magnitude()
        offset = _coarse_offset(time, reading, reference_time, angle, longest_offset)
        for direction in directions:
            measured = _between(rotations(quaternion, order, direction)).as_rotvec()
            for unit in rate_units:
                near = _Near(time, reading * RATE_UNITS[unit], reference_time, measured)
                if (unit, offset) not in paths:
                    paths[unit, offset] = near.turned(offset)
                convention = Convention(unit, order, direction, 0.0, 0.0, offset, (0, 0, 0))
                tried.append((near, near.at_offset(convention, paths[unit, offset])))
    tried.sort(key=lambda pair: -round(pair[1].either, LIKELIHOOD_DIGITS))
    best = [near.refined(convention, step) for near, convention in tried[:REFINED]]
    listed = [*best, *(convention for _, convention in tried[REFINED:])]
    return sorted(listed, key=lambda c: -round(c.log_likelihood, LIKELIHOOD_DIGITS))


def started(
    time: np.ndarray, reading: np.ndarray, at: np.ndarray, reference: Rotation, offset: float
) -> RateCorrection:
    """Initial guess of a calibration: least-squares matrix from integrated readings to rotations of the reference."""
    path = gyro_path(time, reading, at, RateCorrection(np.eye(3), np.zeros(3), offset))
    matrix = np.linalg.lstsq(path.between.as_rotvec(), _between(reference).as_rotvec(), rcond=None)[0].T
    return RateCorrection(matrix, np.zeros(3), offset)


def _between(rotation: Rotation) -> Rotation:
    return rotation[:-1].inv() * rotation[1:]


def wide_offset(time: np.ndarray, reading: np.ndarray, at: np.ndarray, reference: Rotation) -> float:
    """Clock offset [s] of best correlation between gyro and references, over all overlaps of at least half."""
    longest = (min(time[-1] - time[0], at[-1] - at[0]) / 2) + abs(time[0] - at[0])
    return _coarse_offset(time, reading, at, _between(reference).magnitude(), longest, step=WIDE_STEP)


def _coarse_offset(
    time: np.ndarray,
    reading: np.ndarray,
    at: np.ndarray,
    angle: np.ndarray,
    longest: float,
    step: float | None = None,
) -> float:
    """Clock offset [s] at which rotation angles and the integral of the gyro's rate magnitude correlate best."""
    speed = np.linalg.norm(reading, axis=1)
    turned = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(time))])
    count = OFFSETS if step is None else min(MOST_OFFSETS, 2 * int(np.ceil(longest / step)) + 1)
    offsets = np.linspace(-longest, longest, count)
    with np.errstate(divide="ignore", invalid="ignore"):
        score = [np.corrcoef(np.diff(np.interp(at - o, time, turned)), angle)[0, 1] for o in offsets]
    if not np.isfinite(score).any():
        raise ArgumentError(
            f"gyro ({time[0]:.4g} .. {time[-1]:.4g} s) and references ({at[0]:.4g} .. {at[-1]:.4g} s) turn at no "
            f"common time within {longest:g} s: the body rests, a log has one row, or the clocks differ; give "
            "recordings that overlap, or a longer longest_offset",
            "recording",
        )
    return float(offsets[int(np.nanargmax(score))])


@dataclass(frozen=True, eq=False)
class _Near:
    """Fit of a gyro to measured rotations (k, 3) with the best mounting rotation."""

    time: np.ndarray
    rate: np.ndarray
    at: np.ndarray
    measured: np.ndarray

    def turned(self, offset: float) -> np.ndarray:
        """Rotations (k, 3) of the gyro between the references at this clock offset."""
        none = RateCorrection(np.eye(3), np.zeros(3), offset)
        return gyro_path(self.time, self.rate, self.at, none).between.as_rotvec()

    def at_offset(self, convention: Convention, turned: np.ndarray | None = None) -> Convention:
        """A convention with its likelihood at its clock offset; turned: rotations of the gyro there, if known."""
        turned = self.turned(convention.offset) if turned is None else turned
        mount = Rotation.from_matrix(nearest_rotation(self.measured.T @ turned))
        size = float(np.sqrt(np.mean((self.measured - mount.apply(turned)) ** 2)))
        logs = -0.5 * self.measured.size * (np.log(2 * np.pi * max(size, 1e-12) ** 2) + 1)
        reflection = nearest_rotation(self.measured.T @ turned, hand=-1)
        mirrored_size = float(np.sqrt(np.mean((self.measured - turned @ reflection.T) ** 2)))
        x, y, z = (float(v) for v in mount.as_rotvec())
        return replace(
            convention, log_likelihood=float(logs), residual=size, mount=(x, y, z),
            turns=float(np.sqrt(np.mean(self.measured**2))), numbers=self.measured.size,
            mirrored=self.measured.size * float(np.log(max(size, 1e-12) / max(mirrored_size, 1e-12))),
            mirror=tuple(map(tuple, reflection.tolist())),
        )  # fmt: skip

    def refined(self, convention: Convention, reach: float) -> Convention:
        """The same convention at the best offset within `reach` [s] of its own."""
        from scipy.optimize import minimize_scalar

        bounds = (convention.offset - reach, convention.offset + reach)
        best: Any = minimize_scalar(
            lambda o: -self.at_offset(replace(convention, offset=float(o))).either,
            bounds=bounds, method="bounded", options={"xatol": 2e-4},
        )  # fmt: skip
        return self.at_offset(replace(convention, offset=float(best.x)))


# -- the accelerometer at rest ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Gravity:
    """Direction of gravity for one convention, from an accelerometer.

    scatter: rms angle between the directions of gravity in the world at all rests [rad]: small for the right direction.
    tilt: angle of their mean to the world's z axis [rad]: small for the right order if that axis points up.
    """

    scatter: float
    tilt: float


@dataclass(frozen=True)
class Resting:
    """Accelerometer at rest. unit: the unit in which it reads 1 g. length: median magnitude [m/s2]. places: number of
    rests. gravity: result for each convention, in their order."""

    unit: str
    length: float
    places: int
    gravity: tuple[Gravity, ...]


def resting(
    time: np.ndarray,
    acceleration: np.ndarray,
    reference_time: np.ndarray,
    quaternion: np.ndarray,
    tried: Sequence[Convention],
    *,
    units: Sequence[str],
) -> Resting | None:
    """Unit of an accelerometer (n, 3) from its magnitude at rest, and the direction of gravity for these conventions.

    The body is at rest while neighbouring references agree, without the start of each rest. None if it never rests, or
    if no unit gives 1 g within a tenth.
    """
    still = _between(rotations(quaternion, tried[0].order, tried[0].direction)).magnitude() < RESTING
    means, rests, k = [], [], 0
    while k < len(still):
        last = k
        while last < len(still) and still[last]:
            last += 1
        rows = (time > reference_time[k] + SETTLE) & (time < reference_time[last] - SETTLE / 3)
        if last > k and rows.sum() >= 5:
            means.append(acceleration[rows].mean(axis=0))
            rests.append(k)
        k = last + 1
    read = float(np.median(np.linalg.norm(means, axis=1))) if means else 0.0
    if not read > 0:
        return None
    unit = min(units, key=lambda u: abs(np.log(read * ACCELERATION_UNITS[u] / G)))
    length = read * ACCELERATION_UNITS[unit]
    if abs(length / G - 1) > SCALE_OFF:
        return None
    gravity = []
    for convention in tried:
        mount = Rotation.from_rotvec(convention.mount)
        up = (rotations(quaternion[rests], convention.order, convention.direction) * mount).apply(means)
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        mean = up.mean(axis=0) / max(float(np.linalg.norm(up.mean(axis=0))), 1e-12)
        scatter = np.sqrt(np.mean(np.arccos(np.clip(up @ mean, -1, 1)) ** 2))
        gravity.append(Gravity(float(scatter), float(np.arccos(np.clip(mean[2], -1, 1)))))
    return Resting(unit, length, len(means), tuple(gravity))


UNRELATED = 0.5  # of the rotations: gyro and references that disagree by more are unrelated
BETTER = 0.5  # of the disagreement: largest rest with another offset, reflection or unit that counts as better
NEAR_AXES = 0.8  # rad; for a sensor mounted further from the axes of the body no sign or order is named
AXES = "xyz"
UNNAMED = "one axis of the gyro has the wrong sign, or two are exchanged"


def clocks_that_meet(
    best: Convention,
    time: np.ndarray,
    rate: np.ndarray,
    at: np.ndarray,
    quaternion: np.ndarray,
    judging: AttitudeJudging,
) -> None:
    """Raise ArgumentError if gyro and references agree only at an offset outside the search range."""
    if min(best.residual, _mirrored_residual(best)) < UNRELATED * best.turns:
        return
    offset = wide_offset(time, rate, at, rotations(quaternion, best.order, best.direction))
    if abs(offset) <= judging.longest_offset:
        return
    shifted = conventions(
        time + offset, rate, at, quaternion, rate_units=list(RATE_UNITS), longest_offset=judging.longest_offset
    )[0]
    if shifted.residual > BETTER * best.residual:
        return
    offset += shifted.offset
    raise ArgumentError(
        f"the clocks of gyro and references are {offset:+.3f} s apart, outside the search range of "
        f"{judging.longest_offset:g} s: there the rotations agree to {np.degrees(shifted.residual):.2g} deg, inside "
        f"the range only to {np.degrees(best.residual):.2g} deg; correct the stamps, or allow more",
        "judging.longest_offset",
    )


def not_mirrored(tried: Sequence[Convention], sure: float) -> None:
    """Raise ArgumentError if a reflection, which no mounting can be, fits the gyro better than any rotation."""
    best = max(tried, key=lambda c: c.either)
    gain = best.either - tried[0].log_likelihood
    # neighbouring errors are correlated, so the likelihood alone is not enough
    if gain <= sure or _mirrored_residual(best) > BETTER * tried[0].residual:
        return
    alike = sorted((c for c in tried if c.either > best.either - sure), key=lambda c: ORDERS.index(c.order))
    words = [mirrored_words(np.array(c.mirror)) for c in alike]  # rotations alone do not show the order
    raise ArgumentError(
        f"{next((w for w in words if w != UNNAMED), UNNAMED)}: mirrored like this it agrees with the references to "
        f"{np.degrees(_mirrored_residual(best)):.2g} deg, with any mounting only to "
        f"{np.degrees(tried[0].residual):.2g} deg (log-likelihood {gain:.0f} higher); correct the columns of the rate",
        "recording",
    )


def mirrored_words(M: np.ndarray) -> str:
    """The fault in the columns of a gyro that corresponds to a reflection (3, 3) from sensor to body, in words.

    >>> mirrored_words(np.diag([1.0, -1.0, 1.0]))
    'the y axis of the gyro has the wrong sign'
    >>> mirrored_words(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    'the axes x and y of the gyro are exchanged'
    """
    for k in range(3):
        signs = np.ones(3)
        signs[k] = -1.0
        if angle_between(M, np.diag(signs)) < NEAR_AXES:
            return f"the {AXES[k]} axis of the gyro has the wrong sign"
    for i, j in ((0, 1), (0, 2), (1, 2)):
        P = np.eye(3)
        P[[i, j]] = P[[j, i]]
        if angle_between(M, P) < NEAR_AXES:
            return f"the axes {AXES[i]} and {AXES[j]} of the gyro are exchanged"
    return UNNAMED


def as_declared(tried: Sequence[Convention], unit: str, sure: float) -> list[Convention]:
    """The conventions with the declared unit, all of them for "1". Raises ArgumentError if another unit fits far
    better."""
    if unit == "1":
        return list(tried)
    same_unit = [c for c in tried if c.rate_unit == unit]
    best, declared = tried[0], same_unit[0]
    if best.log_likelihood > declared.log_likelihood + sure and best.residual < BETTER * declared.residual:
        raise ArgumentError(
            f"the rate is declared in {unit}; it agrees with the references to "
            f"{np.degrees(declared.residual):.2g} deg as declared, but to {np.degrees(best.residual):.2g} deg if its "
            f"numbers are in {best.rate_unit}; correct the unit",
            "recording",
        )
    return same_unit


def differing_parts(first: Estimate, second: Estimate) -> Suspicion:
    """Test whether two parts of a recording give the same numbers: Student's t with Welch's degrees of freedom, with a
    Bonferroni correction."""
    a, b = first.std**2, second.std**2
    dof = (a + b) ** 2 / (a**2 / first.degrees_of_freedom + b**2 / second.degrees_of_freedom)
    p = _of_any((first.values - second.values) / np.sqrt(a + b), dof)
    k = int(np.argmin(p))
    name = first.names[k]
    return Suspicion(
        "parts_agree", f"{name} is {first.values[k]:.4g} in the first part and {second.values[k]:.4g} in the second",
        float(p[k]), f"{name} differs between the parts: the gyro has more faults than a calibration removes",
    )  # fmt: skip


WITHOUT_DRIFT = 13  # numbers of a calibration: mount, scale, misalignment, bias, offset


def far_from_truth(estimate: Estimate, true: np.ndarray) -> Suspicion:
    """Test whether an estimate from synthetic data is further from the truth than its standard deviations allow."""
    both = range(min(len(true), len(estimate.values)))
    drifting = max(len(true), len(estimate.values)) > WITHOUT_DRIFT
    # a bias that drifts is estimated at another time than the true one
    own = np.array([k for k in both if not (drifting and estimate.names[k].startswith("bias["))])
    p = _of_any((estimate.values[own] - true[own]) / estimate.std[own], estimate.degrees_of_freedom)
    k = int(own[np.argmin(p)])
    evidence = f"{estimate.names[k]} is {estimate.values[k]:.4g}; its true value is {true[k]:.4g}"
    return Suspicion("true_numbers", evidence, float(p[k]), "the intervals are too narrow")


def _of_any(t: np.ndarray, dof: np.ndarray | float) -> np.ndarray:
    """Probabilities that any of these numbers is this far off, by Student's t (Bonferroni)."""
    return np.minimum(len(t) * f_chance(t**2, 1, dof), 1.0)


def _mirrored_residual(c: Convention) -> float:
    """Rms of the residuals with the best reflection [rad]."""
    return float(c.residual * np.exp(-c.mirrored / max(c.numbers, 1)))
