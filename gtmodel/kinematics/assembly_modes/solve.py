"""Compute all assembly modes of platforms on six legs, with a certificate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ...lang.source import ModelError
from ...results.status import ModesStatus
from .modes import AssemblyModes, Certificate, modes_of, without_modes
from .platform import Legs, ScaledLegs, architecturally_singular, fault, read_legs, scale, straight_line
from .sorting import ModesSearch, sort_endpoints
from .start_system import StartSystem, start_systems
from .tracker import track

Progress = Callable[[int, int], bool | None]
POSES_AT_ONCE = 16  # large enough to hide the overhead of numpy, small enough for the cache


def assembly_modes(
    A: ArrayLike,
    B: ArrayLike,
    L: ArrayLike,
    *,
    systems: tuple[StartSystem, ...] | None = None,
) -> AssemblyModes:
    """Compute all assembly modes of a platform on six legs: every (R, T) with |T + R B_i - A_i| = L_i.

    Args:
        A: joints at the base or the carts, (6, 3), in any unit of length, in the base frame.
        B: joints on the platform, (6, 3), in the same unit, in the platform frame.
        L: lengths of the legs, (6,), in the same unit; not their squares.
        systems: start systems to use instead of the stored ones, in this order.

    A general platform has 40 modes over the complex numbers. An even number of them has a real pose, `.R` and `.T` of
    the result. Wrong data, self-motions and lost paths appear in `.status` and `.message`.
    Method: a coefficient-parameter homotopy in Study coordinates from a generic complex platform. It finds all modes
    with probability one; paths that are lost numerically are counted and tracked again from another platform. Modes
    count as infinite if |x.x| < 1e-10 for a point of unit norm: positions beyond about 1e10 leg lengths.

    Raises ModelError for a wrong shape, for several poses, or entries that are not real numbers.

    All modes of a synthetic platform over the complex numbers, and the real ones:

    >>> from gtmodel.kinematics.assembly_modes import assembly_modes, draw
    >>> hands = draw(1, seed=1)
    >>> modes = assembly_modes(hands.A[0], hands.B[0], hands.L[0])
    >>> modes.message, modes.certificate.finite, modes.T.shape
    ('all 40 modes were found', 40, (4, 3))
    """
    legs = read_legs(A, B, L)
    if max(np.ndim(A) - 2, np.ndim(B) - 2, np.ndim(L) - 1) > 0:
        raise ModelError(f"found legs of {len(legs)} poses, expected one; assembly_modes_batch takes several")
    return _solve(legs, systems, None)[0]


def assembly_modes_batch(
    A: ArrayLike,
    B: ArrayLike,
    L: ArrayLike,
    *,
    progress: Progress | None = None,
    systems: tuple[StartSystem, ...] | None = None,
) -> list[AssemblyModes]:
    """Compute all assembly modes of n platforms or poses together, which is faster than one by one.

    Args:
        A, B: (n, 6, 3), or (6, 3) for all poses; L: (n, 6), or (6,) for all. Otherwise as for `assembly_modes`.
        progress: called with (poses done, number of poses); returning True stops the work, and the remaining poses get
            the status interrupted.
        systems: as for `assembly_modes`.

    Returns one result per pose; a wrong pose does not affect the others. Raises ModelError for wrong shapes.

    >>> from gtmodel.kinematics.assembly_modes import assembly_modes_batch, draw
    >>> hands = draw(2, seed=1)
    >>> [modes.certificate.real for modes in assembly_modes_batch(hands.A, hands.B, hands.L)]
    [4, 2]
    """
    return _solve(read_legs(A, B, L), systems, progress)


def _solve(legs: Legs, systems: tuple[StartSystem, ...] | None, progress: Progress | None) -> list[AssemblyModes]:
    systems = start_systems() if systems is None else systems
    results: list[AssemblyModes] = []
    for first in range(0, len(legs), POSES_AT_ONCE):
        results += _solve_some(legs[first : first + POSES_AT_ONCE], systems)
        if progress is not None and progress(len(results), len(legs)):
            break
    stopped = without_modes(ModesStatus.INTERRUPTED, ModesStatus.INTERRUPTED.message, np.nan, Certificate())
    return results + [stopped] * (len(legs) - len(results))


def _solve_some(legs: Legs, systems: tuple[StartSystem, ...]) -> list[AssemblyModes]:
    """Return the results of a few poses that are tracked together."""
    results: dict[int, AssemblyModes] = {}
    for i in range(len(legs)):
        sentence = fault(legs.A[i], legs.B[i], legs.L[i])
        if sentence is not None:
            results[i] = without_modes(ModesStatus.BAD_INPUT, sentence, np.nan, Certificate())
    good = np.array([i for i in range(len(legs)) if i not in results], dtype=np.intp)
    if good.size:
        scaled = scale(legs[good])
        for k, result in zip(good.tolist(), _solve_scaled(scaled, systems), strict=True):
            results[k] = result
    return [results[i] for i in range(len(legs))]


def _solve_scaled(scaled: ScaledLegs, systems: tuple[StartSystem, ...]) -> list[AssemblyModes]:
    parameters = scaled.parameters()
    C = parameters.system()
    searches = [ModesSearch(C[i]) for i in range(len(C))]
    singular = architecturally_singular(scaled)
    pending = np.flatnonzero(~singular)
    for start in systems:
        if not pending.size:
            break
        ends = track(
            straight_line(start.parameters, parameters.of(pending)),
            np.repeat(np.arange(len(pending)), len(start.z)),
            np.tile(start.z, (len(pending), 1)),
        )
        for i, endings in zip(pending.tolist(), sort_endpoints(C[pending], ends), strict=True):
            searches[i].add(endings)
        pending = np.array([i for i in pending.tolist() if not searches[i].settled()], dtype=np.intp)
    return [
        _architecturally_singular(scaled.size[i]) if singular[i] else modes_of(searches[i], scaled.of(i))
        for i in range(len(C))
    ]


def _architecturally_singular(size: float) -> AssemblyModes:
    message = (
        "the platform is architecturally singular: its six legs are linearly dependent in every pose, so that it "
        "either cannot be assembled with these lengths or moves at constant lengths"
    )
    return without_modes(ModesStatus.SELF_MOTION, message, float(size), Certificate())
