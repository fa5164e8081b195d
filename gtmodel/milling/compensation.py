"""A path that is offset so that the tool goes where it should although the robot is compliant, and what the offsets
leave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..results import Check, Row, at_most
from ..results.refusal import naming
from ..results.table import csv_text
from .deflection import checked_force, cutting_force, duration, recursion, responses
from .options import PathOffset
from .oscillators import Oscillators
from .task import MillingTask

MODELS = ("static", "dynamic")


@dataclass(frozen=True, eq=False)
class Compensation:
    """offset (t, 3) [m] to add to the commanded path; error of the tool (t, 3) [m] without and with it."""

    offset: np.ndarray
    before: np.ndarray
    after: np.ndarray

    def rms(self, skip: int = 0) -> tuple[float, float]:
        """Root mean square of the error's norm [m], without and with the offset, from sample `skip` on."""
        a, b = (float(np.sqrt((x[skip:] ** 2).sum(axis=1).mean())) for x in (self.before, self.after))
        return a, b


def path_offset(
    oscillators: Oscillators, F: ArrayLike, step: float, *, model: str = "dynamic", bandwidth: float | None = None
) -> np.ndarray:
    """Offset b (t, 3) [m] of the path for a known force F (t, 3) [N], world coordinates, every `step` [s].

    "static": b = -F/k. "dynamic": c b' + k b = -F, which keeps the tool still: spring and damper alone must carry the
    force then, and the mass does not enter. Before the first sample the force is taken as that sample's.

    bandwidth [Hz]: what the robot can follow; the force is low-passed forwards and backwards (Butterworth, second order
    each way) before the offset is made, because the process is known beforehand.

    Raises ValueError for another model or a bandwidth beyond half the sample rate.

    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> F = np.outer(np.minimum(np.arange(1000) / 500, 1.0), [100.0, 0.0, 0.0])  # rises to 100 N within 0.5 s
    >>> b = gt.milling.path_offset(robot, F, step=1e-3)
    >>> (1e6 * b[-1]).round(1) + 0.0  # [um]: against the force
    array([-50.,   0.,   0.])
    """
    force = checked_force(F, step)
    if model not in MODELS:
        raise ValueError(f"the model is '{model}'; expected one of {', '.join(MODELS)}")
    if bandwidth is not None:
        if not 0 < bandwidth < 0.5 / step:
            raise ValueError(f"the bandwidth is {bandwidth:g} Hz; expected between 0 and {0.5 / step:g} Hz")
        force = np.asarray(
            scipy.signal.sosfiltfilt(scipy.signal.butter(2, bandwidth, fs=1 / step, output="sos"), force, axis=0)
        )
    c, k = oscillators.c[0], oscillators.k[0]
    b = -force / k
    if model == "dynamic":
        for j in range(3):
            rate = k[j] / c[j] * step
            keep = np.exp(-rate)
            now = (1 - keep) / rate  # exact for a force that is straight between samples
            b[:, j] = scipy.signal.lfilter([1 - now, now - keep], [1, -keep], b[:, j], zi=[b[0, j] * now])[0]
    return b


def tool_error(oscillators: Oscillators, F: ArrayLike, step: float, b: ArrayLike | None = None) -> np.ndarray:
    """Error of the tool (t, 3) [m] under F (t, 3) [N] with the path offset by b (t, 3) [m], zero if left out.

    m y'' + c (y' - b') + k (y - b) = F, straight lines between samples, starting in balance with the first of them.
    Raises ValueError for wrong shapes.

    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> F = np.outer(np.minimum(np.arange(1000) / 500, 1.0), [100.0, 0.0, 0.0])  # rises to 100 N within 0.5 s
    >>> (1e6 * gt.milling.tool_error(robot, F, step=1e-3)[-1]).round(1)  # [um], nothing is compensated
    array([50.,  0.,  0.])
    """
    F = checked_force(F, step)
    moved = np.zeros_like(F) if b is None else np.asarray(b, float)
    if moved.shape != F.shape:
        raise ValueError(f"the offset has the shape {moved.shape}; expected {F.shape} like the force")
    robot = oscillators[:1]
    y = moved[0] + F[0] / robot.k[0] + next(iter(responses(robot, F - F[0], step)))
    for j in range(3):
        m, c, k = robot.m[0, j], robot.c[0, j], robot.k[0, j]
        # second state y' - (c/m) b: no derivative of the offset is needed
        A, B = np.array([[0, 1], [-k / m, -c / m]]), np.array([[c / m], [k / m - (c / m) ** 2]])
        b1, a1, _ = recursion(A, B, step)
        y[:, j] += scipy.signal.lfilter(b1, a1, moved[:, j] - moved[0, j])
    return y


def compensate(
    oscillators: Oscillators, F: ArrayLike, step: float, *, model: str = "dynamic", bandwidth: float | None = None,
    true: Oscillators | None = None,
) -> Compensation:  # fmt: skip
    """Offset of the path for a known force, and by simulation the error that it leaves.

    The arguments are those of `path_offset`. true: the robot that is simulated; the model itself if left out. Raises
    ValueError.

    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> F = np.outer(np.minimum(np.arange(1000) / 500, 1.0), [100.0, 0.0, 0.0])  # rises to 100 N within 0.5 s
    >>> static = gt.milling.compensate(robot, F, step=1e-3, model="static")
    >>> (1e6 * np.array(static.rms())).round(2)  # error of the tool without and with the offset [um]
    array([40.8 ,  0.06])
    """
    b = path_offset(oscillators, F, step, model=model, bandwidth=bandwidth)
    robot = oscillators if true is None else true
    return Compensation(b, tool_error(robot, F, step), tool_error(robot, F, step, b))


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
