"""The energy that an operator puts into a robot, over any window: whether the robot ever gives more than it stored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError
from .wrench import rows_of


@dataclass(frozen=True, eq=False)
class PassivityBook:
    """energy (n,): what the operator put in up to each instant [J]. stored (n,): what the felt mass holds [J].

    worst: least energy that went in over any window [J], negative where the operator got some; window: its beginning
    and end [s]. deficit: most that the operator got over any window beyond what was stored at its beginning [J]; 0 or
    close to it for a robot that is passive. passed: all that went in or out [J].
    """

    energy: np.ndarray
    stored: np.ndarray
    worst: float
    window: tuple[float, float]
    deficit: float
    passed: float

    @property
    def share(self) -> float:
        """deficit over the most that was ever stored: not less for guiding that goes on for longer."""
        if self.deficit == 0.0:
            return 0.0
        most = float(self.stored.max())
        return self.deficit / most if most > 0 else float("inf")

    def __str__(self) -> str:
        return (
            f"{self.passed:.3g} J passed the handle; the least over any window is {self.worst:.3g} J, "
            f"{self.window[0]:.3g} to {self.window[1]:.3g} s; beyond what was stored {self.deficit:.3g} J"
        )


def passivity_book(
    time: ArrayLike,
    force: ArrayLike,
    moved: ArrayLike,
    stored: ArrayLike,
    *,
    moment: ArrayLike | None = None,
    turned: ArrayLike | None = None,
) -> PassivityBook:
    """Energy at the operator's port over all windows at once.

    Args:
        time: (n,) [s]. force: (n, 3) [N] of the hand on the tool. moved: (n, 3) [m] positions of the tool.
        stored: (n,) [J] at least 0, what the robot may give back.
        moment: (n, 3) [N m] of the hand about that point; turned: (n, 3) [rad] how far it turned up to then.

    Between two rows the work is that of the mean force. Raises ArgumentError for other shapes and what is not finite.

    >>> t = np.linspace(0.0, 1.0, 101)  # a mass of 2 kg is pushed and stopped
    >>> force = np.outer(4.0 * np.cos(np.pi * t), [1.0, 0.0, 0.0])
    >>> moved = np.outer(2.0 / np.pi**2 * (1.0 - np.cos(np.pi * t)), [1.0, 0.0, 0.0])
    >>> speed = 2.0 / np.pi * np.sin(np.pi * t)
    >>> book = gt.control.lead_through.passivity_book(t, force, moved, 0.5 * 2.0 * speed**2)
    >>> round(book.worst, 2), round(book.deficit, 3)  # what it got back was stored
    (-0.41, 0.0)
    """
    f, x = rows_of(force, "force"), rows_of(moved, "moved")
    t, s = (np.asarray(a, float).reshape(-1) for a in (time, stored))
    for name, a in (("time", t), ("moved", x), ("stored", s)):
        if len(a) != len(f) or not np.all(np.isfinite(a)):
            raise ArgumentError(f"expected {len(f)} finite rows, as in force; found {len(a)}", name)
    if np.any(s < 0):
        raise ArgumentError("is below 0; energy that is stored is not", "stored")
    if (moment is None) != (turned is None):
        raise ArgumentError("moment and turned are given together", "turned")
    work = _work(f, x)
    if moment is not None and turned is not None:
        work = work + _work(rows_of(moment, "moment", len(f)), rows_of(turned, "turned", len(f)))
    energy = np.concatenate([[0.0], np.cumsum(work)])
    highest = np.maximum.accumulate(energy)
    end = int(np.argmin(energy - highest))
    begin = int(np.argmax(energy[: end + 1]))
    spare = energy + np.minimum.accumulate(s - energy)
    return PassivityBook(
        energy, s, float(energy[end] - energy[begin]), (float(t[begin]), float(t[end])),
        max(0.0, float(-spare.min())), float(np.abs(work).sum()),
    )  # fmt: skip


def _work(force: np.ndarray, moved: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", (force[1:] + force[:-1]) / 2, np.diff(moved, axis=0))
