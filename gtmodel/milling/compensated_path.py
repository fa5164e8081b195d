"""The compensated path of a milling study: offsets against the deflection, and what they leave."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..results import Check, Row, at_most
from ..results.refusal import naming
from ..results.table import csv_text
from .compensation import Compensation, compensate
from .deflection import cutting_force, duration
from .options import PathOffset
from .oscillators import Oscillators
from .task import MillingTask

FILE = "compensation.csv"
WORSE = "the compensation leaves more than it takes away: change compensation.bandwidth_Hz"
RATE = 4000.0  # samples per second of the simulation


class Offset(NamedTuple):
    """Errors of the tool by offset (4,) [m] rms: none, static, dynamic, within the bandwidth; time (t,) [s] and
    deflections without and with each; the path as CSV."""

    rms: list[float]
    time: np.ndarray
    made: Mapping[str, Compensation]
    file: str

    @property
    def rows(self) -> list[Row]:
        """What each offset leaves."""
        names = ["path not compensated", *(f"path offset, {name}" for name in self.made)]
        return [Row(f"{name}, error rms", 1e3 * x, "mm") for name, x in zip(names, self.rms, strict=True)]

    @property
    def check(self) -> Check:
        """What is written must leave less than the path without it."""
        return at_most(1e3 * self.rms[-1], 1e3 * self.rms[0], WORSE)

    def figure(self, title: str) -> Any:
        """Deflection over time."""
        from ..plot.milling import compensation_figure

        after = {name: np.linalg.norm(x.after, axis=1) for name, x in self.made.items()}
        before = np.linalg.norm(list(self.made.values())[-1].before, axis=1)
        return compensation_figure(self.time, before, after, title=f"{title}: compensation, by simulation")


def compensated(task: MillingTask, here: Oscillators, given: PathOffset) -> Offset:
    """The tool enters the work; offsets against that force by both models, then what a robot can follow.

    Raises ArgumentError.
    """
    with naming("compensation.seconds", ValueError):
        seconds = duration(task.speed, given.seconds, given.entry)  # a whole turn after the entry at least
        F, step = cutting_force(task.cutter, task.cut, task.speed, task.feed, up=task.up, seconds=seconds, rate=RATE)
    time = step * np.arange(len(F))
    F = F * np.clip(time / given.entry, 0, 1)[:, None]
    with naming("compensation", ValueError):
        made = {name: compensate(here, F, step, model=name) for name in ("static", "dynamic")}
        made[f"dynamic, up to {given.bandwidth:g} Hz"] = compensate(here, F, step, bandwidth=given.bandwidth)
    followed = list(made.values())[-1]
    at = np.arange(0.0, time[-1], given.cycle)
    offset = np.column_stack([np.interp(at, time, followed.offset[:, j]) for j in range(3)])
    along = task.feed / np.linalg.norm(task.feed)
    fast = task.cut.feed_per_tooth * task.cutter.teeth * task.speed
    path = np.array(task.place) + fast * at[:, None] * along + offset
    # compensated path, and what was added to it
    columns = {"time_s": at, **{f"{c}_m": path[:, j] for j, c in enumerate("xyz")}}
    columns |= {f"offset_{c}_m": offset[:, j] for j, c in enumerate("xyz")}
    rms = [followed.rms()[0], *(x.rms()[1] for x in made.values())]
    return Offset(rms, time, made, csv_text(columns, digits=9))
