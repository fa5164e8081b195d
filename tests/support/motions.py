"""The motions of the shipped problems as objects: the L1 prototype in 0.9 s with 700 N for each motor; the D1."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

from gtmodel.motion import Cost, End, Limits, MotionMesh, MotionProblem, MotionStudy, Solver
from gtmodel.motion.motion_study import solved
from gtmodel.results import Work
from gtmodel.robots import gantry_tau, make

START, GOAL = [0.0, -0.9, 0.1], [0.9, -0.9, 0.45]
UNIT = 112.90322580645162  # N, counts as one in the energy
_KNOWN: dict[str, MotionStudy] = {}


@cache
def l1(payload: float = 0.0, smoothing: str = "tanh", velocity_scale: float = 0.1) -> Any:
    """The robot; friction as problems/l1_min_time.toml has it."""
    return gantry_tau("l1_tape", inertia="model_2", payload=payload, smoothing=smoothing, velocity_scale=velocity_scale)


@cache
def d1(payload: float = 0.0) -> Any:
    """The six-link D1, with declared example masses."""
    return make("d1_six_link", payload=payload)


def asked(**changes: Any) -> MotionProblem:
    """The motion of problems/l1_min_time.toml, with changes such as cost__energy=0.01, path=Line()."""
    return changed(
        MotionProblem(
            robot=l1(), start=End(START), goal=End(GOAL), limits=Limits(force=700.0), cost=Cost(force_unit=UNIT),
            title="Time-optimal motion of the L1 prototype",
        ),
        **changes,
    )  # fmt: skip


def six_link(**changes: Any) -> MotionProblem:
    """The motion of problems/d1_six_link_motion.toml, with changes."""
    return changed(
        MotionProblem(
            robot=d1(), start=End([-1.6, -4.4, -0.1]), goal=End([-1.2, -4.4, 0.15]), limits=Limits(force=700.0),
            cost=Cost(energy=0.01, force_unit=UNIT), mesh=MotionMesh(elements=10), solver=Solver(formulation="dae"),
        ),
        **changes,
    )  # fmt: skip


def changed(problem: MotionProblem, **changes: Any) -> MotionProblem:
    """The problem with other fields; of its parts with two underscores, cost__energy=0.01."""
    for name, value in changes.items():
        part, _, inner = name.partition("__")
        problem = replace(problem, **{part: replace(getattr(problem, part), **{inner: value}) if inner else value})
    return problem


def solution(**changes: Any) -> MotionStudy:
    """Its study, solved once for the same changes."""
    key = repr(sorted((name, id(value) if name == "robot" else value) for name, value in changes.items()))
    if key not in _KNOWN:
        _KNOWN[key] = solved(asked(**changes), Work())
    return _KNOWN[key]
