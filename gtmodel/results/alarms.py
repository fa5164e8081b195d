"""Alarms about how measurements were read: by name, so that each can be accepted, and heard all the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from .refusal import ArgumentError


@dataclass(frozen=True, eq=False)
class Alarms:
    """Which alarms are `accepted`, and in `notes` what those said."""

    accepted: Sequence[str] = ()
    notes: list[str] = field(default_factory=list)

    def raised(self, name: str, sentence: str | None, argument: str) -> None:
        """Raises ArgumentError with the sentence and what accepts it; an accepted one is noted. Nothing for None."""
        if sentence is None:
            return
        if name not in self.accepted:
            raise ArgumentError(f'{sentence}; if it is right, accept = ["{name}"]', argument)
        note = f"accepted ({name}): {sentence}"
        if note not in self.notes:
            self.notes.append(note)
