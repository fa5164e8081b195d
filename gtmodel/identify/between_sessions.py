"""Whether the recordings of an identification agree: the same fit of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..inference import BetweenRecordings, between_recordings
from ..lang import ModelError
from ..measurements import Session
from ..results.estimate import Estimate
from .inertia import Confidence, Identification, identify
from .rows import Rows

MOST = 12  # recordings that are fitted one by one


@dataclass(frozen=True, eq=False)
class BySession:
    """What each recording gives by itself, by its name, and `apart` where they disagree beyond their noise."""

    estimates: dict[str, Estimate]
    names: tuple[str, ...]
    apart: BetweenRecordings | None

    @property
    def intervals(self) -> dict[str, dict[str, list[float]]]:
        """By parameter and recording: 95 % limits of what the recording determines."""
        return {
            name: {session: list(e.interval(name)) for session, e in self.estimates.items() if name in e.names}
            for name in self.names
        }


def between_sessions(
    identification: Identification,
    sessions: Sequence[Session],
    others: Sequence[tuple[Session, Rows]] = (),
    *,
    nonnegative: bool | Sequence[str] = True,
    confidence: Confidence = "auto",
) -> BySession | None:
    """The same parameters from each recording by itself; None where fewer than two determine any.

    sessions: the recordings of the fit, whose rows begin at `rows.starts`. others: further ones with their rows.
    """  # fmt: skip
    rows = identification.rows
    parts = [(s.name, rows.part(k)) for k, s in enumerate(sessions)] + [(s.name, r) for s, r in others]
    if not 2 <= len(parts) <= MOST:
        return None
    free = (*identification.estimate.names, *identification.estimate.held)
    estimates: dict[str, Estimate] = {}
    for n, (name, part) in enumerate(parts, 1):
        # the offset of another recording's efforts has no row here
        names = [p for p in free if p in part.names and np.any(part.Y[:, :, part.names.index(p)])]
        limited = nonnegative if isinstance(nonnegative, bool) else [p for p in nonnegative if p in names]
        try:
            e = identify(part, names, nonnegative=limited, confidence=confidence, test=[]).estimate
        except ModelError:
            continue
        if e.degrees_of_freedom > 0:
            estimates[name if name not in estimates else f"{name} ({n})"] = e
    if len(estimates) < 2:
        return None
    own = tuple(p for p in free if p not in rows.signed)
    return BySession(estimates, own, between_recordings(estimates, own))
