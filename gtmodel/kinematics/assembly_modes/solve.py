"""All assembly modes of platforms on six legs, with certificates."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from ...lang.source import ModelError
from ...results.status import ModesStatus
from ...workers.mapped import mapped
from .modes import AssemblyModes, Certificate, modes_of, without_modes
from .platform import Legs, ScaledLegs, architecturally_singular, fault, read_legs, scale, straight_line
from .sorting import ModesSearch, sort_endpoints
from .start_system import StartSystem, start_systems
from .tracker import track

Progress = Callable[[int, int], bool | None]
POSES_AT_ONCE = 16  # large enough against NumPy's overhead, small enough for the processor's cache


def assembly_modes(
    A: ArrayLike,
    B: ArrayLike,
    L: ArrayLike,
    *,
    systems: tuple[StartSystem, ...] | None = None,
) -> AssemblyModes:
    """Find all assembly modes of a platform on six legs: every (R, T) with |T + R B_i - A_i| = L_i.

    Args:
        A: joints at the base or the carts, (6, 3), in any unit of length, in the base frame.
        B: joints on the platform, (6, 3), in the same unit, in the platform frame.
        L: lengths of the legs, (6,), in the same unit; lengths, not their squares.
        systems: start systems in the order of their use; default: the stored start systems.

    A general platform has 40 modes over the complex numbers. `.R` and `.T` of the result are the real modes, an even
    number. `.status` and `.message` report invalid data, self-motions and lost paths. The method is a
    coefficient-parameter homotopy in Study coordinates from a generic complex platform. It finds all modes with
    probability one; a numerically lost path is counted and tracked again from another start system. A mode counts as
    infinite if |x.x| < 1e-10 for a point of unit norm, that is for positions beyond about 1e10 leg lengths.

    Raises ModelError for a wrong shape, for several poses, or for entries that are not real numbers.

    One synthetic platform, with all modes over the complex numbers and the real modes:

    >>> from gtmodel.kinematics.assembly_modes import assembly_modes, draw
    >>> hands = draw(1, seed=1)
    >>> modes = assembly_modes(hands.A[0], hands.B[0], hands.L[0])
    >>> modes.message, modes.certificate.finite, modes.T.shape
    ('all 40 modes were found', 40, (4, 3))
    """
    legs = read_legs(A, B, L)
    if max(np.ndim(A) - 2, np.ndim(B) - 2, np.ndim(L) - 1) > 0:
        raise ModelError(f"expected one pose; found {len(legs)}; use assembly_modes_batch for several")
    return _solve(legs, systems, None)[0]


def assembly_modes_batch(
    A: ArrayLike,
    B: ArrayLike,
    L: ArrayLike,
    *,
    progress: Progress | None = None,
    systems: tuple[StartSystem, ...] | None = None,
) -> list[AssemblyModes]:
    """Find all assembly modes of n platforms or poses, faster than one by one.

    Args:
        A, B: (n, 6, 3), or (6, 3) for all poses; L: (n, 6), or (6,) for all. Otherwise as for `assembly_modes`.
        progress: called with (completed poses, total poses); if it returns True, the work stops, and the remaining
            poses have the status INTERRUPTED.
        systems: as for `assembly_modes`.

    Returns one result per pose, in order; an invalid pose does not affect the others. Raises ModelError for wrong
    shapes.

    >>> from gtmodel.kinematics.assembly_modes import assembly_modes_batch, draw
    >>> hands = draw(2, seed=1)
    >>> [modes.certificate.real for modes in assembly_modes_batch(hands.A, hands.B, hands.L)]
    [4, 2]
    """
    return _solve(read_legs(A, B, L), systems, progress)


def _solve(legs: Legs, systems: tuple[StartSystem, ...] | None, progress: Progress | None) -> list[AssemblyModes]:
    systems = start_systems() if systems is None else systems
    results: list[AssemblyModes] = []
    parts = (legs[first : first + POSES_AT_ONCE] for first in range(0, len(legs), POSES_AT_ONCE))
    for part in mapped(partial(_solve_some, systems), parts):
        results += part
        if progress is not None and progress(len(results), len(legs)):
            break
    stopped = without_modes(ModesStatus.INTERRUPTED, ModesStatus.INTERRUPTED.message, np.nan, Certificate())
    return results + [stopped] * (len(legs) - len(results))


def _solve_some(systems: tuple[StartSystem, ...], legs: Legs) -> list[AssemblyModes]:
    """Return the results of a few poses, tracked together."""
    results: dict[int, AssemblyModes] = {}
    for i in range(len(legs)):
        message = fault(legs.A[i], legs.B[i], legs.L[i])
        if message is not None:
            results[i] = without_modes(ModesStatus.BAD_INPUT, message, np.nan, Certificate())
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
        "either cannot be assembled with these lengths or moves although all lengths are fixed"
    )
    return without_modes(ModesStatus.SELF_MOTION, message, float(size), Certificate())
