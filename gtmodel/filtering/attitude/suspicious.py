"""What a recording shows to be wrong with itself: clocks apart, a mirrored gyro, another unit than was declared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...geometry.rotations import angle_between
from ...inference.chance import f_chance
from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from ...results.suspicion import Suspicion
from .conventions import ORDERS, RATE_UNITS, Convention, conventions, rotations, wide_offset
from .options import AttitudeJudging

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
