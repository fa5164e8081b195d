"""Poses of MJCF elements: positions with one of five forms of orientation, in the angles of the compiler."""

from __future__ import annotations

import numpy as np
import scipy

from ...geometry.rotations import rotation_about, shortest_rotation
from ...results.read_bounds import XmlFault
from .described import Array, Pose, XmlElement, vector

TURNED = ("quat", "axisangle", "xyaxes", "zaxis", "euler")


class MjcfPoses:
    """Reads poses; `<compiler>` says whether angles are in degrees, and in which order Euler's angles turn."""

    def __init__(self) -> None:
        self.degrees, self.sequence = True, "xyz"

    def set(self, e: XmlElement) -> None:
        """Take angle and eulerseq of a <compiler>."""
        self.degrees = e.attributes.get("angle", "degree") == "degree"
        self.sequence = e.attributes.get("eulerseq", self.sequence)
        if len(self.sequence) != 3 or set(self.sequence.lower()) - set("xyz"):
            raise XmlFault(f"eulerseq takes three of x, y, z, X, Y, Z; found '{self.sequence}'", e.line)

    def angle(self, value: float) -> float:
        return float(np.radians(value)) if self.degrees else value

    def pose(self, e: XmlElement) -> Pose:
        """Return the pose of an element in its body. Raises XmlFault for two orientations."""
        given = [name for name in TURNED if name in e.attributes]
        if len(given) > 1:
            raise XmlFault(f"<{e.tag}> has the orientations {' and '.join(given)}; expected one", e.line)
        r = vector(e, "pos", [0.0, 0.0, 0.0])
        return (self.turned(e, given[0]) if given else np.eye(3)), r

    def turned(self, e: XmlElement, name: str) -> Array:
        if name == "quat":
            w, x, y, z = vector(e, name, [1.0, 0.0, 0.0, 0.0])
            self.unless(w == x == y == z == 0.0, e, name)
            return scipy.spatial.transform.Rotation.from_quat([x, y, z, w]).as_matrix()
        if name == "axisangle":
            *axis, angle = vector(e, name, [0.0] * 4)
            self.unless(not np.any(axis), e, name)
            return rotation_about(np.array(axis) / np.linalg.norm(axis), self.angle(angle))
        if name == "euler":
            return self.euler([self.angle(a) for a in vector(e, name, [0.0] * 3)])
        if name == "zaxis":
            z = vector(e, name, [0.0, 0.0, 1.0])
            self.unless(not np.any(z), e, name)
            return shortest_rotation(np.array([0.0, 0.0, 1.0]), z / np.linalg.norm(z))
        x, y = np.split(vector(e, name, [0.0] * 6), 2)
        self.unless(np.linalg.norm(np.cross(x, y)) == 0.0, e, name)
        x = x / np.linalg.norm(x)
        y = y - (x @ y) * x
        y = y / np.linalg.norm(y)
        return np.column_stack([x, y, np.cross(x, y)])

    def euler(self, angles: list[float]) -> Array:
        R = np.eye(3)
        for letter, angle in zip(self.sequence, angles, strict=True):
            turn = rotation_about(np.eye(3)["xyz".index(letter.lower())], angle)
            R = R @ turn if letter.islower() else turn @ R  # about the turned axes, or about the fixed ones
        return R

    def unless(self, wrong: bool, e: XmlElement, name: str) -> None:
        if wrong:
            raise XmlFault(f"{name} of <{e.tag}> is no orientation; found '{e.attributes[name]}'", e.line)
