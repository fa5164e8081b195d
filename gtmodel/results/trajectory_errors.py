"""Errors of trajectories, and the names that one can ask for."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from .._near import meant
from .refusal import ArgumentError

Array = npt.NDArray[np.float64]
COLUMN = re.compile(r"(?P<base>.+)\[(?P<index>0|[1-9][0-9]*)\]")


class TrajectoryError(ArgumentError):
    """Data that make no trajectory, or a question it cannot answer. The message is one plain sentence."""


class UnknownNameError(KeyError):
    """A signal name that a trajectory does not hold; the sentence gives close matches."""

    def __str__(self) -> str:
        return str(self.args[0])


def columns(name: str, value: Array) -> list[str]:
    """Column names of a signal: itself, or one per component."""
    return [name] if value.ndim == 1 else [f"{name}[{i}]" for i in range(value.shape[1])]


def unknown(name: object, signals: Mapping[str, Array], lead: str) -> str:
    known = [*signals, *(c for n, v in signals.items() if v.ndim == 2 for c in columns(n, v))]
    shown = ", ".join(map(repr, list(signals)[:10]))
    there = f"the trajectory holds {shown}{' and more' if len(signals) > 10 else ''}"
    return f"{lead} {name!r}; {meant(name, known, there, most=3)}"
