"""Guesses of a motion: the line with a trapezoidal profile, bare, and bent; further starts that differ in kind."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle
from typing import Literal

import numpy as np

from ..compiler.causal import CausalFunction
from ..results import ArgumentError, Status, Trajectory

GUESS_TIME_S = 1.0


@dataclass(frozen=True, eq=False)
class FurtherStart:
    """A guess, and the barrier strategy that it is tried with where the problem leaves that open."""

    guess: Trajectory
    barrier: Literal["adaptive", "monotone"] = "adaptive"


def trapezoid(rows: int = 201) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], fraction of the way, and its two derivatives: trapezoidal speed (1/4, 1/2, 1/4) over 1 s."""
    t = np.linspace(0.0, GUESS_TIME_S, rows)
    r = t / GUESS_TIME_S
    top = 4.0 / 3.0
    s = np.where(r < 0.25, 2 * top * r**2, np.where(r < 0.75, top * (r - 0.125), 1 - 2 * top * (1 - r) ** 2))
    ds = np.where(r < 0.25, 4 * top * r, np.where(r < 0.75, top, 4 * top * (1 - r))) / GUESS_TIME_S
    dds = np.where(r < 0.25, 4 * top, np.where(r < 0.75, 0.0, -4 * top)) / GUESS_TIME_S**2
    return t, s, ds, dds


def line_guess(
    inverse_dynamics: CausalFunction, start: np.ndarray, goal: np.ndarray, force: float, rows: int = 201
) -> Trajectory:
    """Straight line with a trapezoidal profile (1/4, 1/2, 1/4) of 1 s; forces by inverse dynamics, clipped."""
    t, s, ds, dds = trapezoid(rows)
    step = goal - start
    T, dT, ddT = start + s[:, None] * step, ds[:, None] * step, dds[:, None] * step
    tau, *_, status = inverse_dynamics.along(T, dT, ddT)
    tau[status != Status.OK] = 0.0  # the line may leave the workspace; the optimum need not
    values = {"robot.T": T, "der(robot.T)": dT, "der(robot.T,2)": ddT, "robot.tau": np.clip(tau, -force, force)}
    return Trajectory(t, values, {"robot.T": "m", "der(robot.T)": "m/s", "robot.tau": "N"})


def bare_guess(start: np.ndarray, goal: np.ndarray) -> Trajectory:
    """The straight line at constant speed, nothing said of velocities and forces."""
    return Trajectory([0.0, GUESS_TIME_S], {"robot.T": np.array([start, goal])}, {"robot.T": "m"})


def bent_guess(start: np.ndarray, goal: np.ndarray, rng: np.random.Generator, bend: float) -> Trajectory:
    """The line of `line_guess` bent sideways, in a drawn direction by 0.3 to 1 times `bend` [m]: half a sine wave."""
    t, s, _, _ = trapezoid()
    step = goal - start
    side = np.cross(step, rng.normal(size=3))
    offset = side / np.linalg.norm(side) * rng.uniform(0.3, 1.0) * bend
    T = start + s[:, None] * step + np.sin(np.pi * s)[:, None] * offset
    return Trajectory(t, {"robot.T": T}, {"robot.T": "m"})


def further_starts(
    start: np.ndarray, goal: np.ndarray, line: Trajectory, rng: np.random.Generator, bend: float
) -> Iterator[FurtherStart]:
    """Starts without end: bent to a drawn side and to the other one; the line of the first start, for the other barrier
    strategy; the bare line; then bent by further draws, with one strategy and the other."""
    straight = [FurtherStart(line, "monotone"), FurtherStart(bare_guess(start, goal))]
    for barrier in cycle(("adaptive", "monotone")):
        bent = bent_guess(start, goal, rng, bend)
        _, s, _, _ = trapezoid()
        other = 2 * (start + s[:, None] * (goal - start)) - bent["robot.T"]
        yield FurtherStart(bent, barrier)
        yield FurtherStart(bent.with_values({"robot.T": other}, {"robot.T": "m"}), barrier)
        yield from straight
        straight = []


def progress_of(earlier: Trajectory) -> Trajectory:
    """Of an earlier motion along a path the path coordinate, never back, and its rate. Raises ArgumentError."""
    if "s" not in earlier:
        raise ArgumentError("is a free motion; this problem follows a path", "earlier")
    s = np.maximum.accumulate(earlier["s"])
    return Trajectory(earlier.time, {"s": s, "der(s)": np.gradient(s, earlier.time)}, {"s": earlier.unit("s")})
