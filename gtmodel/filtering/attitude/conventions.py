"""In which unit a gyro reads and in which direction a quaternion turns, and what a recording shows to be wrong with
itself: clocks apart, a mirrored gyro."""

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
COUNTS = 2.0**15  # of a signed reading of 16 bits, over the range of the sensor
# factors to rad/s: the ranges are those of data sheets of inertial sensors
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
SCALE_OFF = 0.1  # a gyro's scale is within some per cent; an accelerometer's too
OFFSETS = 201  # clock offsets that are tried over the range; the best is refined between its neighbours
RESTING = 2e-3  # rad between two references: at rest
SETTLE = 0.15  # s of a rest that are left out: the arm swings out
WIDE_STEP = 0.02  # s, of offsets beyond those that were asked for: turns last some tenths
MOST_OFFSETS = 5000  # of these
# beyond them a likelihood says where the search for the clock ended; the convention that was tried first stays first
LIKELIHOOD_DIGITS = 3
REFINED = 2  # of the most likely conventions: their clock offset is refined; two differ by axes only


@dataclass(frozen=True)
class Convention:
    """One reading of the numbers: unit of the gyro, order and direction of the quaternion, and how well it fits.

    log_likelihood: of the turns between references under the best rotation between the two and the best clock offset,
    scale held at one; residuals are normal, of a size that they determine. residual: their size [rad], where the turns
    themselves have the size `turns` [rad], of so many `numbers`. offset: [s]. mount: that rotation, sensor to body, as
    a rotation vector [rad].
    mirrored: log-likelihood of the best reflection above that; mirror: that reflection by rows.
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
        """Log-likelihood under the best rotation or reflection."""
        return self.log_likelihood + max(0.0, self.mirrored)

    @property
    def words(self) -> str:
        """In words."""
        return f"gyro in {self.rate_unit}, quaternion {self.order}, {self.direction}"


def rotations(quaternion: np.ndarray, order: str, direction: str) -> Rotation:
    """Orientations, body to world, from quaternions (n, 4) written in this order and direction."""
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
    """All readings of the numbers, the most likely one first.

    time (n,), reading (n, 3): of the gyro as written. reference_time (k,), quaternion (k, 4): as written. The clock
    offset is that at which angles turned between references and the gyro's correlate best, then refined by the fit.
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
                one = Convention(unit, order, direction, 0.0, 0.0, offset, (0, 0, 0))
                tried.append((near, near.at_offset(one, paths[unit, offset])))
    tried.sort(key=lambda pair: -round(pair[1].either, LIKELIHOOD_DIGITS))
    best = [near.refined(convention, step) for near, convention in tried[:REFINED]]
    listed = [*best, *(convention for _, convention in tried[REFINED:])]
    return sorted(listed, key=lambda c: -round(c.log_likelihood, LIKELIHOOD_DIGITS))


def started(
    time: np.ndarray, reading: np.ndarray, at: np.ndarray, reference: Rotation, offset: float
) -> RateCorrection:
    """Where a calibration begins: the matrix that brings integrated readings nearest to the turns of the reference."""
    path = gyro_path(time, reading, at, RateCorrection(np.eye(3), np.zeros(3), offset))
    matrix = np.linalg.lstsq(path.between.as_rotvec(), _between(reference).as_rotvec(), rcond=None)[0].T
    return RateCorrection(matrix, np.zeros(3), offset)


def _between(rotation: Rotation) -> Rotation:
    return rotation[:-1].inv() * rotation[1:]


def wide_offset(time: np.ndarray, reading: np.ndarray, at: np.ndarray, reference: Rotation) -> float:
    """The clock offset [s] at which gyro and references turn most alike, wherever they overlap by half."""
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
    """The clock offset [s] at which turned angles and the integral of the gyro's absolute rate correlate best."""
    speed = np.linalg.norm(reading, axis=1)
    turned = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(time))])
    count = OFFSETS if step is None else min(MOST_OFFSETS, 2 * int(np.ceil(longest / step)) + 1)
    offsets = np.linspace(-longest, longest, count)
    with np.errstate(divide="ignore", invalid="ignore"):
        score = [np.corrcoef(np.diff(np.interp(at - o, time, turned)), angle)[0, 1] for o in offsets]
    if not np.isfinite(score).any():
        raise ArgumentError(
            f"gyro ({time[0]:.4g} .. {time[-1]:.4g} s) and references ({at[0]:.4g} .. {at[-1]:.4g} s) turn at no "
            f"common time within {longest:g} s: a log of a body that rests, of one row, or of another clock; give "
            "recordings that overlap, or a longer longest_offset",
            "recording",
        )
    return float(offsets[int(np.nanargmax(score))])


@dataclass(frozen=True, eq=False)
class _Near:
    """How near a gyro comes to measured turns (k, 3) under the best rotation between the two."""

    time: np.ndarray
    rate: np.ndarray
    at: np.ndarray
    measured: np.ndarray

    def turned(self, offset: float) -> np.ndarray:
        """Turns (k, 3) of the gyro between the references at this clock offset."""
        none = RateCorrection(np.eye(3), np.zeros(3), offset)
        return gyro_path(self.time, self.rate, self.at, none).between.as_rotvec()

    def at_offset(self, convention: Convention, turned: np.ndarray | None = None) -> Convention:
        """A convention with its likelihood at its own clock offset; turned: of the gyro there, where it is known."""
        turned = self.turned(convention.offset) if turned is None else turned
        mount = Rotation.from_matrix(nearest_rotation(self.measured.T @ turned))
        size = float(np.sqrt(np.mean((self.measured - mount.apply(turned)) ** 2)))
        logs = -0.5 * self.measured.size * (np.log(2 * np.pi * max(size, 1e-12) ** 2) + 1)
        reflection = nearest_rotation(self.measured.T @ turned, hand=-1)
        other = float(np.sqrt(np.mean((self.measured - turned @ reflection.T) ** 2)))
        x, y, z = (float(v) for v in mount.as_rotvec())
        return replace(
            convention, log_likelihood=float(logs), residual=size, mount=(x, y, z),
            turns=float(np.sqrt(np.mean(self.measured**2))), numbers=self.measured.size,
            mirrored=self.measured.size * float(np.log(max(size, 1e-12) / max(other, 1e-12))),
            mirror=tuple(map(tuple, reflection.tolist())),
        )  # fmt: skip

    def refined(self, convention: Convention, reach: float) -> Convention:
        """The same at the best offset within `reach` [s] of its own."""
        from scipy.optimize import minimize_scalar

        bounds = (convention.offset - reach, convention.offset + reach)
        there: Any = minimize_scalar(
            lambda o: -self.at_offset(replace(convention, offset=float(o))).either,
            bounds=bounds, method="bounded", options={"xatol": 2e-4},
        )  # fmt: skip
        return self.at_offset(replace(convention, offset=float(there.x)))


# -- the accelerometer at rest ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Gravity:
    """What an accelerometer says of one reading of the numbers.

    scatter: of the direction of gravity in the world over the places of rest [rad]: small for the right direction.
    tilt: of its mean against the world's z axis [rad]: small for the right order where that axis points up.
    """

    scatter: float
    tilt: float


@dataclass(frozen=True)
class Resting:
    """What an accelerometer reads at rest: the unit in which that is 1 g, its median length [m/s2], at how many places,
    and what it says of each convention, in their order."""

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
    """Unit of an accelerometer (n, 3) by its length at rest, and what gravity says of these conventions.

    It rests where neighbouring references agree, but for the first moments of it. None where it never does, or where no
    unit gives 1 g within a tenth.
    """
    still = _between(rotations(quaternion, tried[0].order, tried[0].direction)).magnitude() < RESTING
    means, where, k = [], [], 0
    while k < len(still):
        last = k
        while last < len(still) and still[last]:
            last += 1
        rows = (time > reference_time[k] + SETTLE) & (time < reference_time[last] - SETTLE / 3)
        if last > k and rows.sum() >= 5:
            means.append(acceleration[rows].mean(axis=0))
            where.append(k)
        k = last + 1
    read = float(np.median(np.linalg.norm(means, axis=1))) if means else 0.0
    if not read > 0:
        return None
    unit = min(units, key=lambda u: abs(np.log(read * ACCELERATION_UNITS[u] / G)))
    length = read * ACCELERATION_UNITS[unit]
    if abs(length / G - 1) > SCALE_OFF:
        return None
    gravity = []
    for one in tried:
        mount = Rotation.from_rotvec(one.mount)
        up = (rotations(quaternion[where], one.order, one.direction) * mount).apply(means)
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        mean = up.mean(axis=0) / max(float(np.linalg.norm(up.mean(axis=0))), 1e-12)
        scatter = np.sqrt(np.mean(np.arccos(np.clip(up @ mean, -1, 1)) ** 2))
        gravity.append(Gravity(float(scatter), float(np.arccos(np.clip(mean[2], -1, 1)))))
    return Resting(unit, length, len(means), tuple(gravity))


UNRELATED = 0.5  # of the turns: gyro and references that disagree by more turn by themselves
BETTER = 0.5  # of the disagreement: what another offset, reflection or unit must leave at the most
NEAR_AXES = 0.8  # rad; a sensor that is mounted further from the axes of the body has no sign or order to name
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
    """Raises ArgumentError where gyro and references turn alike only at another offset than was looked for."""
    if min(best.residual, _mirrored_residual(best)) < UNRELATED * best.turns:
        return
    offset = wide_offset(time, rate, at, rotations(quaternion, best.order, best.direction))
    if abs(offset) <= judging.longest_offset:
        return
    there = conventions(
        time + offset, rate, at, quaternion, rate_units=list(RATE_UNITS), longest_offset=judging.longest_offset
    )[0]
    if there.residual > BETTER * best.residual:
        return
    offset += there.offset
    raise ArgumentError(
        f"the clocks of gyro and references are {offset:+.3f} s apart, where up to {judging.longest_offset:g} s was "
        f"looked for: there the turns agree to {np.degrees(there.residual):.2g} deg, within that to "
        f"{np.degrees(best.residual):.2g} deg only; correct the stamps, or allow more",
        "judging.longest_offset",
    )


def not_mirrored(tried: Sequence[Convention], sure: float) -> None:
    """Raises ArgumentError where the gyro fits by a reflection, which no mounting is, better than by any rotation."""
    best = max(tried, key=lambda c: c.either)
    gain = best.either - tried[0].log_likelihood
    if gain <= sure or _mirrored_residual(best) > BETTER * tried[0].residual:  # neighbours' errors are alike: no chance
        return
    alike = sorted((c for c in tried if c.either > best.either - sure), key=lambda c: ORDERS.index(c.order))
    words = [mirrored_words(np.array(c.mirror)) for c in alike]  # turns alone show no order: as where it is not stated
    raise ArgumentError(
        f"{next((w for w in words if w != UNNAMED), UNNAMED)}: mirrored like that it meets the references to "
        f"{np.degrees(_mirrored_residual(best)):.2g} deg, under any mounting to {np.degrees(tried[0].residual):.2g} "
        f"deg only (log-likelihood {gain:.0f} higher); correct the columns of the rate",
        "recording",
    )


def mirrored_words(M: np.ndarray) -> str:
    """What a reflection (3, 3) from sensor to body says of the columns of a gyro.

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
    """The conventions with the unit that was declared, all of them for "1". Raises ArgumentError where another unit
    fits far better."""
    if unit == "1":
        return list(tried)
    own = [c for c in tried if c.rate_unit == unit]
    best, declared = tried[0], own[0]
    if best.log_likelihood > declared.log_likelihood + sure and best.residual < BETTER * declared.residual:
        raise ArgumentError(
            f"the rate is declared in {unit}, but the turns of the references are met to "
            f"{np.degrees(best.residual):.2g} deg if its numbers were in {best.rate_unit}, and to "
            f"{np.degrees(declared.residual):.2g} deg as declared; correct the unit",
            "recording",
        )
    return own


def differing_parts(first: Estimate, second: Estimate) -> Suspicion:
    """Whether two parts of a recording give the same numbers, by Student's t with Welch's degrees of freedom; any of so
    many (Bonferroni)."""
    a, b = first.std**2, second.std**2
    dof = (a + b) ** 2 / (a**2 / first.degrees_of_freedom + b**2 / second.degrees_of_freedom)
    p = _of_any((first.values - second.values) / np.sqrt(a + b), dof)
    k = int(np.argmin(p))
    name = first.names[k]
    return Suspicion(
        "parts_agree", f"{name} is {first.values[k]:.4g} in the first part and {second.values[k]:.4g} in the second",
        float(p[k]), f"{name} differs between the parts: the gyro has more faults than a calibration removes",
    )  # fmt: skip


def far_from_truth(estimate: Estimate, true: np.ndarray) -> Suspicion:
    """Whether the estimate of what was made lies further from the truth than its deviations say."""
    p = _of_any((estimate.values - true) / estimate.std, estimate.degrees_of_freedom)
    k = int(np.argmin(p))
    evidence = f"{estimate.names[k]} is {estimate.values[k]:.4g} where {true[k]:.4g} was made"
    return Suspicion("true_numbers", evidence, float(p[k]), "the intervals are too narrow")


def _of_any(t: np.ndarray, dof: np.ndarray | float) -> np.ndarray:
    """Probabilities that any of so many numbers lies as far off, by Student's t."""
    return np.minimum(len(t) * f_chance(t**2, 1, dof), 1.0)


def _mirrored_residual(c: Convention) -> float:
    """Size of the residuals under the best reflection [rad]."""
    return float(c.residual * np.exp(-c.mirrored / max(c.numbers, 1)))
