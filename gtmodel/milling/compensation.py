"""Path offsets that compensate the deflection of a compliant robot, and the errors that remain."""

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
        """Return the root mean square of the error's norm [m], without and with the offset, from sample `skip` on."""
        a, b = (float(np.sqrt((x[skip:] ** 2).sum(axis=1).mean())) for x in (self.before, self.after))
        return a, b


def path_offset(
    oscillators: Oscillators, F: ArrayLike, step: float, *, model: str = "dynamic", bandwidth: float | None = None
) -> np.ndarray:
    """Return the offset b (t, 3) [m] of the path for a known force F (t, 3) [N], world coordinates, every `step` [s].

    "static": b = -F/k. "dynamic": c b' + k b = -F, which keeps the tool still: spring and damper carry the force, and
    the mass does not move. Before the first sample the force equals the first sample.

    bandwidth [Hz]: of the robot; the force is low-pass filtered forwards and backwards (Butterworth, second order each
    way) before the offset is computed, which is possible as the process is known in advance.

    Raises ValueError for an unknown model or a bandwidth beyond half the sampling rate.

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
            now = (1 - keep) / rate  # exact for a force that is linear between samples
            b[:, j] = scipy.signal.lfilter([1 - now, now - keep], [1, -keep], b[:, j], zi=[b[0, j] * now])[0]
    return b


def tool_error(oscillators: Oscillators, F: ArrayLike, step: float, b: ArrayLike | None = None) -> np.ndarray:
    """Return the error of the tool (t, 3) [m] under F (t, 3) [N] with the path offset by b (t, 3) [m], default zero.

    m y'' + c (y' - b') + k (y - b) = F, linear between samples, starting in equilibrium with the first sample. Raises
    ValueError for wrong shapes.

    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> F = np.outer(np.minimum(np.arange(1000) / 500, 1.0), [100.0, 0.0, 0.0])  # rises to 100 N within 0.5 s
    >>> (1e6 * gt.milling.tool_error(robot, F, step=1e-3)[-1]).round(1)  # [um], without compensation
    array([50.,  0.,  0.])
    """
    F = checked_force(F, step)
    offset = np.zeros_like(F) if b is None else np.asarray(b, float)
    if offset.shape != F.shape:
        raise ValueError(f"the offset has the shape {offset.shape}; expected {F.shape} like the force")
    robot = oscillators[:1]
    y = offset[0] + F[0] / robot.k[0] + next(iter(responses(robot, F - F[0], step)))
    for j in range(3):
        m, c, k = robot.m[0, j], robot.c[0, j], robot.k[0, j]
        # second state y' - (c/m) b: the derivative of the offset is not needed
        A, B = np.array([[0, 1], [-k / m, -c / m]]), np.array([[c / m], [k / m - (c / m) ** 2]])
        b1, a1, _ = recursion(A, B, step)
        y[:, j] += scipy.signal.lfilter(b1, a1, offset[:, j] - offset[0, j])
    return y


def compensate(
    oscillators: Oscillators, F: ArrayLike, step: float, *, model: str = "dynamic", bandwidth: float | None = None,
    true: Oscillators | None = None,
) -> Compensation:  # fmt: skip
    """Return the path offset for a known force, and the simulated error that remains.

    Arguments as in `path_offset`. true: the simulated robot; default: the model itself. Raises ValueError.

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
WORSE = "the compensation increases the error: change compensation.bandwidth_Hz"
RATE = 4000.0  # samples per second of the simulation


class Offset(NamedTuple):
    """Rms errors of the tool by offset (4,) [m]: none, static, dynamic, within the bandwidth; time (t,) [s];
    compensations by name; the path as CSV."""

    rms: list[float]
    time: np.ndarray
    compensations: Mapping[str, Compensation]
    file: str

    @property
    def rows(self) -> list[Row]:
        """Remaining error of each offset."""
        names = ["path not compensated", *(f"path offset, {name}" for name in self.compensations)]
        return [Row(f"{name}, error rms", 1e3 * x, "mm") for name, x in zip(names, self.rms, strict=True)]

    @property
    def check(self) -> Check:
        """The written path must have a smaller error than the original one."""
        return at_most(1e3 * self.rms[-1], 1e3 * self.rms[0], WORSE)

    def figure(self, title: str) -> Any:
        """Deflection over time."""
        from ..plot.milling import compensation_figure

        after = {name: np.linalg.norm(x.after, axis=1) for name, x in self.compensations.items()}
        before = np.linalg.norm(list(self.compensations.values())[-1].before, axis=1)
        return compensation_figure(self.time, before, after, title=f"{title}: simulated compensation")


def compensated(task: MillingTask, oscillators: Oscillators, options: PathOffset) -> Offset:
    """Simulate the entry of the tool into the work; offset its force with both models, and within the bandwidth.

    Raises ArgumentError.
    """
    with naming("compensation.seconds", ValueError):
        seconds = duration(task.speed, options.seconds, options.entry)  # at least a whole turn after the entry
        F, step = cutting_force(task.cutter, task.cut, task.speed, task.feed, up=task.up, seconds=seconds, rate=RATE)
    time = step * np.arange(len(F))
    F = F * np.clip(time / options.entry, 0, 1)[:, None]
    with naming("compensation", ValueError):
        results = {name: compensate(oscillators, F, step, model=name) for name in ("static", "dynamic")}
        limited = compensate(oscillators, F, step, bandwidth=options.bandwidth)
        results[f"dynamic, up to {options.bandwidth:g} Hz"] = limited
    times = np.arange(0.0, time[-1], options.cycle)
    offset = np.column_stack([np.interp(times, time, limited.offset[:, j]) for j in range(3)])
    direction = task.feed / np.linalg.norm(task.feed)
    feed_rate = task.cut.feed_per_tooth * task.cutter.teeth * task.speed
    path = np.array(task.place) + feed_rate * times[:, None] * direction + offset
    columns = {"time_s": times, **{f"{c}_m": path[:, j] for j, c in enumerate("xyz")}}
    columns |= {f"offset_{c}_m": offset[:, j] for j, c in enumerate("xyz")}
    rms = [limited.rms()[0], *(x.rms()[1] for x in results.values())]
    return Offset(rms, time, results, csv_text(columns, digits=9))
