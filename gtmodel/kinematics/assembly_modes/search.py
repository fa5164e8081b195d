"""What is known about the modes of one pose after each start system, and whether that settles it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...results.status import ModesStatus
from .kantorovich import Isolation, isolate
from .self_motion import on_a_curve
from .sorting import Endings, merge
from .study import MODES, VARIABLES, Array

CURVES_TRIED = 3  # singular endpoints per search that are tested for a self-motion


def _nothing(C: Array) -> tuple[Array, Isolation]:
    z = np.zeros((0, VARIABLES), dtype=complex)
    return z, isolate(np.zeros((0, *C.shape), dtype=complex), z)


@dataclass
class ModesSearch:
    """The search for the modes of one scaled pose with the system C (7, 18).

    z (k, 8), isolation: all different regular modes so far. last: the endings from the start system used last.
    """

    C: Array
    z: Array = field(init=False)
    isolation: Isolation = field(init=False)
    used: int = 0
    retries: int = 0
    self_motion: bool = False
    last: Endings | None = None
    steps: list[int] = field(default_factory=list)
    _agreed: bool = False

    def __post_init__(self) -> None:
        self.z, self.isolation = _nothing(self.C)

    def add(self, endings: Endings) -> None:
        """Take in what another start system gave."""
        if self.last is None:
            self.z, self.isolation = endings.modes, endings.isolation
        else:
            before = len(self.z)
            self.z, self.isolation = merge(self.z, self.isolation, endings.modes, endings.isolation)
            # fewer than 40 are believed when two searches account for every path and find the same modes
            same = len(self.z) == before == len(endings.modes)
            self._agreed = same and not endings.lost and not self.last.lost
            self.retries += len(endings.steps)
        self.last = endings
        self.used += 1
        self.steps += endings.steps.tolist()
        self.self_motion = any(on_a_curve(self.C, z) for z in endings.singular[:CURVES_TRIED])

    def settled(self) -> bool:
        """True when no further start system is needed."""
        return len(self.z) == MODES or self.self_motion or self._agreed

    def verdict(self) -> tuple[ModesStatus, str]:
        """Status and message, once all start systems that are needed or there have been used."""
        count, last = len(self.z), self.last
        if last is None:
            return ModesStatus.INCOMPLETE, "no start system was used"
        infinite, multiple, lost = len(last.infinite), len(last.singular), last.lost
        tail = f"found {count} finite modes; {infinite} paths ended at infinity"
        if self.self_motion:
            return ModesStatus.SELF_MOTION, (
                f"the modes are not finite in number: {multiple} of {MODES} paths ended on a curve of solutions "
                "(real or complex), along which the platform moves with all lengths fixed"
            )
        if count == MODES:
            return ModesStatus.COMPLETE, f"all {MODES} modes were found"
        if count > MODES:
            return (
                ModesStatus.INCOMPLETE,
                f"found {count} modes where at most {MODES} can be: some are not distinguished",
            )
        if not self._agreed:
            return ModesStatus.INCOMPLETE, (
                f"{tail}, {multiple} in singular modes, and {lost} were lost with {self.used} start systems: "
                "modes may be missing"
            )
        if multiple:
            return ModesStatus.MULTIPLE, (
                f"{tail} and {multiple} in modes that coincide, or nearly: the platform is singular there"
            )
        return ModesStatus.FEWER_FINITE, (
            f"{tail} from each of {self.used} start systems: this platform has fewer than {MODES} finite modes"
        )
