"""Motions of robot, cameras and target that no picture notices, with what takes them away."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ...geometry.quaternions import quaternion_matrix, turn_matrix
from ...inference.bundle import GaugeMotion
from .robot_side import RobotLinks

Values = Mapping[str, np.ndarray]
AXES = "xyz"


def redundancies(side: RobotLinks, q: np.ndarray, on_tool: bool) -> list[GaugeMotion]:
    """Base frame against cameras (6), tool centre point against target (3), and the scale (1)."""

    def with_robot(values: Values, moved: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The parameters of the robot that follow the poses."""
        _, by_x, by_z, _ = side.at(values["robot"][0], values["pose"], q)
        dz = moved["pose"]
        if side.turns:  # increments of a quaternion in its own frame
            e = values["pose"][:, 3:]
            dz = np.column_stack([dz[:, :3], np.einsum("nij,nj->ni", turn_matrix(e), dz[:, 3:])])
        rhs = np.einsum("nmz,nz->nm", by_z, dz).reshape(-1)
        moved["robot"] = -np.linalg.lstsq(by_x.reshape(len(rhs), -1), rhs, rcond=None)[0][None]
        return moved

    def still(values: Values) -> dict[str, np.ndarray]:
        return {"camera": np.zeros((len(values["camera"]), 15)), "target": np.zeros((1, 7)),
                "pose": np.zeros((len(values["pose"]), 6 if side.turns else 3))}  # fmt: skip

    def shifted(k: int) -> Callable[[Values], Values]:
        def direction(values: Values) -> Values:
            out = still(values)
            out["pose"][:, k] = 1.0
            if on_tool:
                out["camera"][:, 12 + k] = 1.0
            else:
                out["target"][:, 3 + k] = 1.0
            return _device(values, with_robot(values, out), shift=np.eye(3)[k])

        return direction

    def turned(k: int) -> Callable[[Values], Values]:
        def direction(values: Values) -> Values:
            w, out = np.eye(3)[k], still(values)
            out["pose"][:, :3] = np.cross(w, values["pose"][:, :3])
            if side.turns:
                out["pose"][:, 3:] = w @ quaternion_matrix(values["pose"][:, 3:])
            if on_tool or not side.turns:
                out["camera"][:, 9:12] = w @ quaternion_matrix(values["camera"][:, 9:13])
                out["camera"][:, 12:] = np.cross(w, values["camera"][:, 13:])
            if not (on_tool and side.turns):
                out["target"][0, :3] = w @ quaternion_matrix(values["target"][0, :4])
                out["target"][0, 3:6] = np.cross(w, values["target"][0, 4:7])
            return _device(values, with_robot(values, out), turn=w)

        return direction

    def centred(k: int) -> Callable[[Values], Values]:
        def direction(values: Values) -> Values:
            d, out = np.eye(3)[k], still(values)
            out["pose"][:, :3] = quaternion_matrix(values["pose"][:, 3:]) @ d if side.turns else d
            if on_tool:
                out["target"][0, 3:6] = -d
            else:
                out["camera"][:, 12:] = -d
            return with_robot(values, out)

        return direction

    def grown(values: Values) -> Values:
        out = still(values)
        out["pose"][:, :3] = values["pose"][:, :3]
        out["camera"][:, 12:] = values["camera"][:, 13:]
        out["target"][0, 3:7] = values["target"][0, 4:8]
        return with_robot(values, out)

    carrier = "the cameras" if on_tool else "the target"
    other = "the target on the tool" if on_tool else "the cameras on the plate"
    base = f"hold what defines the robot's base frame, or {carrier}"
    tool = f"hold the place of {other}"
    motions = [GaugeMotion(f"the robot's base and {carrier} move together along {a}", base, shifted(k))
               for k, a in enumerate(AXES)]  # fmt: skip
    motions += [GaugeMotion(f"the robot's base and {carrier} turn together about {a}", base, turned(k))
                for k, a in enumerate(AXES)]  # fmt: skip
    motions += [GaugeMotion(f"the tool centre point moves along {a} against {other}", tool, centred(k))
                for k, a in enumerate(AXES)]  # fmt: skip
    more = "give one known length: the target's dimensions, an actuator's displacement, or a second device"
    return [*motions, GaugeMotion("everything grows by one factor", more, grown)]


def _device(values: Values, out: dict[str, np.ndarray], shift: np.ndarray | None = None,
            turn: np.ndarray | None = None) -> dict[str, np.ndarray]:  # fmt: skip
    """The second device's frame follows the base."""
    if "device" in values:
        step = np.zeros((1, 6))
        if shift is not None:
            step[0, 3:] = shift
        if turn is not None:
            step[0, :3] = turn @ quaternion_matrix(values["device"][0, :4])
            step[0, 3:] = np.cross(turn, values["device"][0, 4:])
        out["device"] = step
    return out
