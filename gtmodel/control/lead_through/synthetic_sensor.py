"""Synthetic force sensors: what they read, with bias, load and noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from ...results.options import Options, Unit, Within
from .hand import ZEROS, Three
from .vectors import cross

GRAVITY = (0.0, 0.0, -9.81)  # [m/s2], in the world frame, z up


@dataclass(frozen=True)
class SyntheticSensor(Options):
    """A force sensor on the tool as it truly is; what it reads is the wrench on what it carries, at its origin.

    No inertial forces: what it carries is light, or moves slowly.

    >>> sensor = gt.control.lead_through.SyntheticSensor(mass=1.0, force_noise=0.0, moment_noise=0.0)
    >>> rng, upright = np.random.default_rng(0), np.eye(3)
    >>> sensor.reading(np.zeros(3), np.zeros(3), upright, rng)[0].round(2)
    array([ 0.  ,  0.  , -9.81])
    """

    turn: Annotated[Three, Unit("rad", written="deg"), Within(), "rotation vector, tool's frame to sensor's"] = ZEROS
    point: Annotated[Three, Unit("m", written="mm"), Within(), "sensor's origin to tool centre point, its frame"] = (
        ZEROS
    )
    force_bias: Annotated[Three, Unit("N"), Within(), "reading without force"] = ZEROS
    moment_bias: Annotated[Three, Unit("N.m"), Within(), "reading without moment"] = ZEROS
    mass: Annotated[float, Unit("kg"), Within(least=0.0), "that it carries"] = 0.8
    centre: Annotated[Three, Unit("m", written="mm"), Within(), "of the mass, from its origin, in its frame"] = ZEROS
    force_noise: Annotated[float, Unit("N"), Within(least=0.0), "standard deviation, white"] = 0.1
    moment_noise: Annotated[float, Unit("N.m"), Within(least=0.0), "standard deviation, white"] = 0.005
    sign: Annotated[float, Within(least=-1.0, most=1.0), "-1: it reports the force by the tool"] = 1.0

    @cached_property
    def matrix(self) -> np.ndarray:
        """(3, 3), columns are the sensor's axes in the tool's frame."""
        from ...geometry.rotations import rotation_by

        return rotation_by(self.turn)

    def reading(
        self, force: np.ndarray, moment: np.ndarray, turn: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Force and moment (3,) in the sensor's frame about its origin, of those about the tool centre point, world."""
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
        """Free of contact, with the sensor's axes (poses, 3, 3) in the world frame: forces and moments (poses, 3)."""
        both = [self.reading(np.zeros(3), np.zeros(3), R @ self.matrix.T, rng) for R in turns]
        return np.array([b[0] for b in both]), np.array([b[1] for b in both])
