"""Synthetic contacts (flat, tilted or curved surface, hole for a peg) and force sensors with bias, load and noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Protocol

import numpy as np

from ...results.options import Options, Unit, Within
from .gains import ZEROS, Three
from .wrench import cross, crossed

GRAVITY = (0.0, 0.0, -9.81)  # [m/s2], in the world frame, z up


@dataclass(frozen=True)
class SyntheticSensor(Options):
    """The true parameters of a force sensor on the tool, which reads the wrench on its load, about its origin.

    Inertial forces are neglected: the load is light or moves slowly.

    >>> sensor = gt.control.lead_through.SyntheticSensor(mass=1.0, force_noise=0.0, moment_noise=0.0)
    >>> rng, upright = np.random.default_rng(0), np.eye(3)
    >>> sensor.reading(np.zeros(3), np.zeros(3), upright, rng)[0].round(2)
    array([ 0.  ,  0.  , -9.81])
    """

    turn: Annotated[Three, Unit("rad", written="deg"), Within(), "rotation vector, tool's frame to sensor's"] = ZEROS
    point: Annotated[
        Three, Unit("m", written="mm"), Within(), "from its origin to the tool centre point, in its frame"
    ] = ZEROS
    force_bias: Annotated[Three, Unit("N"), Within(), "reading without force"] = ZEROS
    moment_bias: Annotated[Three, Unit("N.m"), Within(), "reading without moment"] = ZEROS
    mass: Annotated[float, Unit("kg"), Within(least=0.0), "of its load"] = 0.8
    centre: Annotated[Three, Unit("m", written="mm"), Within(), "of mass, from its origin, in its frame"] = ZEROS
    force_noise: Annotated[float, Unit("N"), Within(least=0.0), "standard deviation of the white noise"] = 0.1
    moment_noise: Annotated[float, Unit("N.m"), Within(least=0.0), "standard deviation of the white noise"] = 0.005
    sign: Annotated[float, Within(least=-1.0, most=1.0), "-1: it reports the force exerted by the tool"] = 1.0

    @cached_property
    def matrix(self) -> np.ndarray:
        """Rotation matrix (3, 3) whose columns are the sensor's axes in the tool's frame."""
        from ...geometry.rotations import rotation_by

        return rotation_by(self.turn)

    def reading(
        self, force: np.ndarray, moment: np.ndarray, turn: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return force and moment (3,) about the sensor's origin, in its frame, for a wrench (3,), (3,) about the tool
        centre point in the world frame."""
        R = turn @ self.matrix
        g = R.T @ np.array(GRAVITY)
        f = R.T @ force
        weight = self.mass * g
        m = R.T @ moment + cross(self.point, f.tolist()) + cross(self.centre, weight.tolist())
        f = self.sign * (f + weight) + self.force_bias
        return f + self.force_noise * rng.standard_normal(3), (
            self.sign * m + self.moment_bias + self.moment_noise * rng.standard_normal(3)
        )

    def readings_at_rest(self, turns: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return forces and moments (poses, 3) without contact, for sensor axes (poses, 3, 3) in the world frame."""
        wrenches = [self.reading(np.zeros(3), np.zeros(3), R @ self.matrix.T, rng) for R in turns]
        return np.array([w[0] for w in wrenches]), np.array([w[1] for w in wrenches])


SLOW = 1e-4  # [m/s] below which friction is proportional to the speed
NONE = np.zeros(3)


class Contact(Protocol):
    """Interface of a contact."""

    def wrench(
        self, position: np.ndarray, turn: np.ndarray, velocity: np.ndarray, rate: np.ndarray, time: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return force (3,) [N] and moment (3,) [N m] on the tool about the tool centre point, in the world frame.

        turn (3, 3): columns are the tool's axes; position and velocity are those of the tool centre point.
        """
        ...

    def energy(self, position: np.ndarray, turn: np.ndarray, time: float) -> float:
        """Return the energy stored in the contact's springs [J]."""
        ...


@dataclass(frozen=True)
class SyntheticSurface(Options):
    """A compliant surface without adhesion that passes through the origin and pushes back a tool tip inside it.

    `tilt` rotates the normal at the origin from z about y; with a positive tilt the surface falls towards +x.
    `curvature` bends it to a parabola along the direction of steepest fall; a positive curvature is convex.

    >>> gt.control.lead_through.SyntheticSurface(tilt=0.07).normal.round(4)
    array([0.0699, 0.    , 0.9976])
    """

    stiffness: Annotated[float, Unit("N/m"), Within(above=0.0), "of the contact"] = 5000.0
    tilt: Annotated[float, Unit("rad", written="deg"), Within(above=-1.5, below=1.5), "of its normal about y"] = 0.0
    curvature: Annotated[float, Unit("1/m"), Within(), "of the surface; positive: convex"] = 0.0
    friction: Annotated[float, Within(least=0.0), "Coulomb coefficient"] = 0.0
    rise: Annotated[float, Unit("m/s"), Within(), "speed of the surface along its normal"] = 0.0

    @cached_property
    def normal(self) -> np.ndarray:
        """Normal (3,) at the origin, from the workpiece to the tool."""
        return np.array([math.sin(self.tilt), 0.0, math.cos(self.tilt)])

    def normal_at(self, position: np.ndarray) -> np.ndarray:
        """Return the normal (3,) at the tool tip, from the workpiece to the tool."""
        if self.curvature == 0.0:
            return self.normal
        fall = np.array([math.cos(self.tilt), 0.0, -math.sin(self.tilt)])
        bent = self.normal + self.curvature * float(fall @ position) * fall
        return bent / float(np.linalg.norm(bent))

    def force(self, position: np.ndarray, velocity: np.ndarray, time: float) -> np.ndarray:
        """Return the force (3,) [N] on a tool at position (3,) [m] with velocity (3,) [m/s]."""
        local = self.normal_at(position)
        pressed = self.stiffness * max(-self._gap(position, time), 0.0)
        if self.friction == 0.0:
            return pressed * local
        along = velocity - (local @ velocity) * local
        return pressed * (local - self.friction * along / max(float(np.linalg.norm(along)), SLOW))

    def wrench(
        self, position: np.ndarray, turn: np.ndarray, velocity: np.ndarray, rate: np.ndarray, time: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Contact`; there is no moment about the tip."""
        return self.force(position, velocity, time), NONE

    def energy(self, position: np.ndarray, turn: np.ndarray, time: float) -> float:
        """See `Contact`."""
        return self.stiffness * max(-self._gap(position, time), 0.0) ** 2 / 2

    def _gap(self, position: np.ndarray, time: float) -> float:
        """Distance from the surface along its normal; for a curved surface from the tangent plane."""
        gap = float(self.normal @ position) - self.rise * time
        if self.curvature == 0.0:
            return gap
        x = math.cos(self.tilt) * position[0] - math.sin(self.tilt) * position[2]
        return (gap + self.curvature * x**2 / 2) * float(self.normal @ self.normal_at(position))


@dataclass(frozen=True)
class SyntheticHole(Options):
    """A round hole with its mouth at the origin, in a face z = 0; its axis is rotated from z about y by `tilt`.

    The tip of a round peg touches the wall, and its shaft touches the rim. Each contact pushes back perpendicular to
    the hole's axis if the deviation exceeds the clearance. Outside `capture` the tip touches the face, inside it the
    bottom at `depth`. The tool centre point is the centre of the peg's tip, the peg's axis is the tool's z.

    >>> hole = gt.control.lead_through.SyntheticHole()
    >>> inside, turned = np.array([0.0, 0.0, -0.02]), np.array([[0.995, 0.0, 0.0998], [0, 1.0, 0], [-0.0998, 0, 0.995]])
    >>> force, moment = hole.wrench(inside, turned, np.zeros(3), np.zeros(3), 0.0)
    >>> bool(force[0] < 0 and moment[1] < 0)  # the rim pushes the tilted peg back
    True
    """

    tilt: Annotated[float, Unit("rad", written="deg"), Within(above=-0.5, below=0.5), "of its axis about y"] = 0.0
    clearance: Annotated[float, Unit("m", written="mm"), Within(least=0.0), "between peg and wall, radial"] = 0.0005
    depth: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "to the bottom"] = 0.03
    capture: Annotated[
        float, Unit("m", written="mm"), Within(above=0.0), "distance from the axis within which the tip enters"
    ] = 0.003
    stiffness: Annotated[float, Unit("N/m"), Within(above=0.0), "of each contact"] = 2000.0
    friction: Annotated[float, Within(least=0.0), "Coulomb coefficient"] = 0.0

    @cached_property
    def axis(self) -> np.ndarray:
        """Axis (3,), out of the hole."""
        return np.array([math.sin(self.tilt), 0.0, math.cos(self.tilt)])

    def wrench(
        self, position: np.ndarray, turn: np.ndarray, velocity: np.ndarray, rate: np.ndarray, time: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Contact`."""
        force, moment = np.zeros(3), np.zeros(3)
        for arm, pressed in self._pressed(position, turn):
            contact = self._with_friction(pressed, velocity + crossed(rate, arm))
            force, moment = force + contact, moment + crossed(arm, contact)
        return force, moment

    def energy(self, position: np.ndarray, turn: np.ndarray, time: float) -> float:
        """See `Contact`."""
        return sum(float(f @ f) for _, f in self._pressed(position, turn)) / (2 * self.stiffness)

    def _pressed(self, position: np.ndarray, turn: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Contact points (3,) relative to the tip, and their forces without friction."""
        h, peg = self.axis, turn[:, 2]
        inside = -float(h @ position)
        if inside <= 0.0:
            return []
        if float(np.linalg.norm(position + inside * h)) > self.capture and inside < self.capture:
            return [(NONE, self.stiffness * inside * h)]
        rim = inside / float(h @ peg) * peg  # from the tip to the point of the shaft at the rim
        bottom = self.stiffness * max(inside - self.depth, 0.0) * h
        return [(NONE, self._wall(position, h)), (rim, self._wall(position + rim, h)), (NONE, bottom)]

    def _wall(self, point: np.ndarray, h: np.ndarray) -> np.ndarray:
        """Force (3,) [N] on a point of the peg."""
        off = point - float(h @ point) * h
        size = float(np.linalg.norm(off))
        return NONE if size <= self.clearance else -self.stiffness * (size - self.clearance) / size * off

    def _with_friction(self, force: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        size = float(np.linalg.norm(force))
        if size == 0.0:
            return force
        across = force / size
        along = velocity - float(across @ velocity) * across
        direction = along / max(float(np.linalg.norm(along)), SLOW)
        return force - self.friction * size * direction
