"""Poses of a plan on an F1: tool centre points with a few turns of the plate, each turn a mechanism of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...compiler.causal import CausalFunction, compile_causal
from ...geometry.quaternions import exponential, product, quaternion_matrix
from ...kinematics.mechanism import Mechanism
from ...kinematics.workspace import InverseKinematics, Limit, Poses, limited_mechanism
from ...results import ArgumentError, Status
from ...robots.f1 import LINK_ENDS, link_guideways
from ...robots.links import family_of
from .options import Tracker
from .task import Task

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Turn:
    """The robot with its plate at the quaternion `e` (4,), scalar first; None where T alone gives the pose."""

    robot: Mechanism
    e: Array | None

    def poses(self, T: Array) -> Array:
        """Rows of tool centre points (n, 3), and the quaternion behind (n, 7)."""
        return T if self.e is None else np.hstack([T, np.tile(self.e, (len(T), 1))])


@dataclass(frozen=True)
class Facing:
    """A target on the plate looks along `direction` (3,) and is seen by a tracker within an angle [rad] of it."""

    at: Array
    direction: Array
    acceptance: float
    name: str = "acceptance of the target"
    unit: str = "rad"
    assumes: str = ""
    parts: Sequence[str] = ("way to the tracker",)

    def margins(self, poses: Poses) -> Array:
        """(n, 1) [rad]."""
        way = self.at - poses.T
        u = self.direction / np.linalg.norm(self.direction)
        angle = np.arctan2(np.linalg.norm(np.cross(way, u), axis=1), way @ u)
        return (self.acceptance - angle)[:, None]


def turns_of(task: Task) -> list[Turn]:
    """One for robots that T alone places; of an F1 one for each of room.turns. Raises ArgumentError."""
    turns, model = task.room.turns, task.robot
    if not turns:
        raise ArgumentError("there is none; leave it out, or give at least one turn", "room.turns")
    if family_of(model) != "f1":
        if np.any(np.array(turns)):
            raise ArgumentError("is for an F1, whose plate turns freely; leave it out", "room.turns")
        return [Turn(limited_mechanism(model, task.home, task.bodies), None)]
    if task.bodies.plate_joints is not None:
        raise ArgumentError("is for simplified joints; an F1 has its own", "bodies.plate_joints")
    f1: Any = model
    turned = product(np.array(f1.home_e, float), exponential(turns))
    function = compile_causal(f1, known=["T", "e"], targets=["q", *LINK_ENDS])
    return [Turn(_mechanism(f1, function, task.home, e), e) for e in turned]


def facing(task: Task, turn: Turn) -> list[Limit]:
    """The target's acceptance in this turn of the plate, where it is declared."""
    device = task.device
    if not isinstance(device, Tracker) or device.target_axis is None:
        return []
    plate = np.eye(3) if turn.e is None else quaternion_matrix(turn.e)
    return [Facing(np.array(device.at), plate @ device.target_axis, device.acceptance)]


def _mechanism(f1: Any, function: CausalFunction, place: Sequence[float] | None, e: Array) -> Mechanism:
    def placed(T: Array) -> Any:
        return function(T, np.tile(e, (len(T), 1)))

    inverse = InverseKinematics(placed)
    T = np.array(f1.home if place is None else place, float)
    home = inverse(T[None])
    if home.status[0] != Status.OK:
        shown = ", ".join(f"{x:g}" for x in T)
        turned = ", ".join(f"{x:.3g}" for x in e)
        raise ArgumentError(f"the home pose ({shown}) m cannot be reached with the plate at ({turned})", "room.turns")
    A, v, L, B = link_guideways(f1)
    return Mechanism(f1, inverse, home, A, v, L, np.linalg.norm(B, axis=1), ())
