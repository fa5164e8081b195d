"""Alarms about how poses were read; each can be accepted."""

from __future__ import annotations

from typing import Literal

Alarm = Literal[
    "unit", "scale", "exchanged_signals", "stuck_columns", "exchanged_columns", "swapped_axes", "scalar_last",
    "out_of_reach", "moved_too_far",
]  # fmt: skip
