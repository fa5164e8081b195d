"""Synthetic calibrations of the robots that shipped problems calibrate, drawn by seed: right, with an unmodelled error,
or read with one fault. The robot that was measured is the same for all seeds; drawing, poses and noise are drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from gtmodel.calibrate import CalibrationStudy, Fit, MeasuredPoses, Measurements, Pose, study
from gtmodel.calibrate.measured.column_checks import aligned
from gtmodel.calibrate.measured.misreadings import Witness, witness_of
from gtmodel.calibrate.measured.poses import split
from gtmodel.measurements.signal_table import Columns
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.python_models import resolve
from gtmodel.results import ArgumentError
from tests.calibrate.hexapod import PROBLEMS, hexapod, synthetic
from tests.calibrate.runs import DEPENDENT
from tests.calibrate.synthetic import _turned, disturbed, true_robot
from tests.support import arm_poses

Values = dict[str, np.ndarray]
# of an unmodelled error over the range of a coordinate: half a period, a bow, is mostly what parameters do
PERIODS = (1.0, 2.0, 3.0)
DRAWINGS = 20  # of each kind: which one, is by the seed
HIDDEN = (
    0.02  # of the robot's size: a fault that moves the drawing's poses by less is hidden, by symmetry or small range
)


@dataclass(frozen=True)
class Kind:
    """A robot: what differs by `size` [m] from its drawing, how it is fitted, units and noise of what is measured;
    `spare`: poses that leave some 12 equations beyond the unknowns."""

    names: tuple[str, ...]
    fit: Fit
    noise: dict[str, float]
    units: tuple[str, ...]
    spare: int
    actuators: str = "q"
    size: float = 1e-3
    device: bool = False


GANTRY = {"q": 13e-6, "T": 50e-6}
TURNING = GANTRY | {"e": 1e-4}
KINDS = {
    "three_link": Kind(("A", "v", "L"), Fit(variant="modified", sensitivity_step=0.0), GANTRY, ("mm",) * 3, 11),
    "three_link_device": Kind(
        ("A", "L"), Fit(free=["A", "L"], fixed=["A[2]", "A[1,2]"], sensitivity_step=0.0), GANTRY,
        ("mm",) * 3, 9, device=True,
    ),
    "six_link": Kind(
        ("A", "v", "L"), Fit(variant="six_link", fixed=["B"], sensitivity_step=0.0), TURNING, ("mm",) * 3, 9
    ),
    "f1": Kind(
        ("A0", "v", "L", "A", "B", "r3"), Fit(variant="f1_unit", fixed=list(DEPENDENT), sensitivity_step=0.0), TURNING,
        ("mm",) * 3 + ("deg",) * 3, 13,
    ),
    "hexapod": Kind(
        ("A", "B", "L0"), Fit(sensitivity_step=0.0), {"n": 2e-3, "T": 3e-4, "e": 1e-3}, ("1",) * 6, 10, actuators="n"
    ),
    "delta": Kind(
        ("radius", "arm", "end"), Fit(fixed=["angle[2]"], sensitivity_step=0.0), {"q": 2e-5, "T": 3e-5}, ("mm",) * 3, 7
    ),
    "tracked_arm": Kind(
        ("theta", "d", "a", "alpha"), Fit(variant="serial", sensitivity_step=0.0), {"q": 2e-5, "T": 3e-5},
        ("deg",) * 6, 13, device=True,
    ),
}  # fmt: skip


@cache
def measured_robot(kind: str) -> Any:
    if kind == "tracked_arm":
        return arm_poses.true_arm()
    if kind == "delta":
        return disturbed(
            resolve("models/delta.py:Delta", Context(folder=PROBLEMS), "robot"), KINDS[kind].names, 1e-3, 1
        )
    if kind == "hexapod":
        return disturbed(hexapod(), KINDS[kind].names, 1e-3, 1)
    return true_robot({"f1": "f1_unit", "three_link_device": "three_link"}.get(kind, kind))


@cache
def _causal(kind: str) -> Any:
    robot = measured_robot(kind)
    if kind == "delta":
        return robot.causal(known="T", targets="q")
    return robot.causal(known="q", targets=("T", "e") if "e" in KINDS[kind].noise else ("T",))


def true_poses(kind: str, poses: int, rng: np.random.Generator) -> Values:
    """Poses that the robot really takes, without noise."""
    if kind == "hexapod":
        return synthetic(measured_robot(kind), poses, int(rng.integers(1 << 30)))
    if kind == "delta":
        T = np.column_stack([rng.uniform(-0.1, 0.1, (poses, 2)), rng.uniform(0.005, 0.1, poses)])
        return {"q": _causal(kind)(T)[0], "T": T}
    if kind == "tracked_arm":
        low, high = np.radians([[-100, -50, -60, -150, -100, -170], [100, 60, 45, 150, 100, 170]])
        q = rng.uniform(low, high, (poses, 6))
        return {"q": q, "T": arm_poses.forward(measured_robot(kind), q)[0]}
    more = 2 * poses + 10
    if kind == "f1":
        q = np.array([0.72, 0.26, 0.21, 0, 0, 0]) + rng.uniform(-1, 1, (more, 6)) * np.repeat([0.3, 0.5], 3)
    else:
        q = rng.uniform(-0.6, 0.6, (more, 3))
    *pose, status = _causal(kind)(q)
    reached = np.flatnonzero(status == 0)[:poses]
    assert len(reached) == poses
    return {"q": q[reached], **{n: a[reached] for n, a in zip(("T", "e"), pose, strict=False)}}


def drawn(kind: str, seed: int, poses: int, unmodelled: float = 0.0) -> Values:
    """What was measured, with noise and an error that is a wave over each coordinate, its rms so many times the noise.

    That is before the fit, which takes up a part of it: what is left for the verdict is less, not more.
    """
    rng = np.random.default_rng([seed, sorted(KINDS).index(kind)])
    values, noise = true_poses(kind, poses, rng), KINDS[kind].noise
    for name, sigma in noise.items():
        along = values["T" if name == "e" else name]
        k = along.shape[1]
        phase, order = rng.uniform(0, 2 * np.pi, k), rng.permutation(k)
        turns = PERIODS[seed % len(PERIODS)] * (along - along.min(axis=0)) / np.ptp(along, axis=0)
        wave = np.sin(2 * np.pi * turns + phase)
        off = sigma * (rng.standard_normal(along.shape) + unmodelled * wave[:, order] / np.sqrt(np.mean(wave**2)))
        values[name] = _turned(values[name], off) if name == "e" else values[name] + off
    return values


def drawing(kind: str, seed: int) -> Any:
    """The robot as it was known before; with what was compiled of it, which many draws share."""
    return _drawing(kind, seed % DRAWINGS)


@cache
def _drawing(kind: str, number: int) -> Any:
    return disturbed(measured_robot(kind), KINDS[kind].names, KINDS[kind].size, 1000 + number)


def poses_of(kind: str, values: Values) -> MeasuredPoses:
    k = KINDS[kind]
    m = Measurements(values, k.noise, poses=(Pose("T", "e" if "e" in values else None, device=k.device),))
    names = tuple(f"{k.actuators}[{i}]" for i in range(len(k.units)))
    columns = {k.actuators: Columns(names, k.units), "T": Columns(("T[0]", "T[1]", "T[2]"), ("mm",) * 3)}
    return MeasuredPoses(m, k.actuators, columns=columns)


def judged(kind: str, seed: int, unmodelled: float = 0.0) -> CalibrationStudy:
    """With as many poses held out as are fitted."""
    return study(
        drawing(kind, seed), poses_of(kind, drawn(kind, seed, 2 * KINDS[kind].spare, unmodelled)), KINDS[kind].fit
    )


@dataclass(frozen=True)
class Fault:
    """What was read wrong; a word of each list in `named` is in a message that names it."""

    what: str
    apply: Callable[[Values], Values]
    named: tuple[str, ...]


EXCHANGED = ("look exchanged", "look swapped", "left-handed")
REVERSED = ("look reversed", "looks reversed", "look swapped", "left-handed")
UNIT = ("probably in", "check its unit", "check the units", "check their units", "looks like degrees")


def faults(kind: str, rng: np.random.Generator) -> list[Fault]:
    """One of each sort: an exchange, a unit, a sign."""
    k = KINDS[kind]
    own = [i for i, u in enumerate(k.units) if u == k.units[0]]
    a, b = rng.permutation(own)[:2].tolist()
    x, y = rng.permutation(3)[:2].tolist()
    of_q, thousand = bool(rng.integers(2)), 10.0 ** float(rng.choice([-3, 3]))

    def swapped(values: Values) -> Values:
        name, i, j = (k.actuators, a, b) if of_q else ("T", x, y)
        rows = values[name].copy()
        rows[:, [i, j]] = rows[:, [j, i]]
        return values | {name: rows}

    def scaled(values: Values) -> Values:
        name = k.actuators if of_q and k.units[0] == "mm" else "T"
        rows = values[name].copy()
        rows[:, own if name != "T" else slice(None)] *= thousand
        return values | {name: rows}

    def turned(values: Values) -> Values:
        name, i = (k.actuators, a) if of_q else ("T", x)
        rows = values[name].copy()
        rows[:, i] *= -1
        return values | {name: rows}

    q, pair = k.actuators, (f"{a} and {b}" if of_q else f"{x} and {y}")
    return [
        Fault(f"columns {pair} of {q if of_q else 'T'} exchanged", swapped, EXCHANGED),
        Fault(f"lengths {thousand:g} times", scaled, UNIT),
        Fault(f"column {a if of_q else x} of {q if of_q else 'T'} reversed", turned, REVERSED),
    ]


def hidden(robot: Any, witness: Witness, kind: str, right: Values, wrong: Values) -> bool:
    """Whether the drawing's poses fit the wrong reading about as well as the right one: then no one can see it."""

    def missed(values: Values) -> float:
        if witness.forward is None:  # the actuators that the drawing needs for the position
            q = robot.causal(known="T", targets="q")(values["T"])[0]
            return float(np.sqrt(np.mean(np.sum((values["q"] - q) ** 2, axis=1))))
        T, _, good = witness.positions(values[KINDS[kind].actuators])
        if 2 * len(good) < len(values["T"]):
            return np.inf
        if KINDS[kind].device:
            return aligned(values["T"][good], T)[2]
        return float(np.sqrt(np.mean(np.sum((values["T"][good] - T) ** 2, axis=1))))

    before, after = missed(right), missed(wrong)  # not a number: out of reach
    return after < before + HIDDEN * witness.size


@dataclass
class Seen:
    """Of faults drawn: how many were `named`, were `hidden` and are not counted, and the others in words."""

    named: int = 0
    hidden: int = 0
    missed: list[str] = field(default_factory=list)

    @property
    def counted(self) -> int:
        return self.named + len(self.missed)


def alarm(robot: Any, kind: str, values: Values) -> str:
    """What the study refuses the data for; empty where it does not."""
    try:
        study(robot, poses_of(kind, values), KINDS[kind].fit)
    except ArgumentError as error:
        return str(error)
    return ""


def look(kind: str, seed: int, poses: int, seen: Seen) -> str:
    """Counts a fault of one draw in `seen`, by turns an exchange, a unit, a sign; what is said of the right data."""
    robot, right = drawing(kind, seed), drawn(kind, seed, poses)
    witness = witness_of(robot, split(poses_of(kind, right), robot, 2))
    fault = faults(kind, np.random.default_rng([seed, 7]))[seed % 3]
    wrong = fault.apply(right)
    said = alarm(robot, kind, wrong)
    if any(word in said for word in fault.named):
        seen.named += 1
    elif hidden(robot, witness, kind, right, wrong):
        seen.hidden += 1
    else:
        seen.missed.append(f"{kind} {seed}: {fault.what}: {said or 'nothing said'}")
    return alarm(robot, kind, right)
