"""What a detector saw in one picture."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class DetectionStatus(IntEnum):
    """Why a picture has marks or not."""

    OK = 0
    TOO_DARK = 1
    TOO_BRIGHT = 2
    PARTLY_VISIBLE = 3
    NOT_SEEN = 4

    @property
    def ok(self) -> bool:
        """Whether the marks may be used."""
        return self is DetectionStatus.OK


SENTENCES = {
    DetectionStatus.OK: "the target was detected",
    DetectionStatus.TOO_DARK: "the picture is too dark: light the target, or expose longer",
    DetectionStatus.TOO_BRIGHT: "the picture is too bright: its light parts saturate; expose shorter",
    DetectionStatus.PARTLY_VISIBLE: "the target is only partly in the picture, or partly covered",
    DetectionStatus.NOT_SEEN: "no whole pattern of this target is in the picture",
}


@dataclass(frozen=True, eq=False)
class Detection:
    """Marks of one picture: names `marks` (n), `corners` (n, 2) u, v [pixel], `sigma` (n,) [pixel] of each coordinate.

    The centre of the first pixel is (0, 0). Without success there are none, and `message` says why.
    """

    status: DetectionStatus
    marks: tuple[str, ...] = ()
    corners: np.ndarray = None  # type: ignore[assignment]
    sigma: np.ndarray = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.corners is None:
            object.__setattr__(self, "corners", np.zeros((0, 2)))
            object.__setattr__(self, "sigma", np.zeros(0))

    @property
    def message(self) -> str:
        """One sentence."""
        return SENTENCES[self.status]
