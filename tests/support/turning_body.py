"""A rigid body that is tracked, with an inertial unit on it: model, sensors, and readings of a smooth motion."""

from __future__ import annotations

from typing import Any

import numpy as np

import gtmodel as gt
from gtmodel.filtering import InitialState, ProcessModel, Readings, Sensor, System

G = np.array([0.0, 0.0, -9.81])
STATES = ["p", "v", "a", "Q", "w", "alpha"]


class TrackedBody(gt.Model):
    """p, v, a in the world, Q body to world, w and alpha in the axes of the body; the unit feels force and rate."""

    gravity = gt.parameter([0.0, 0.0, -9.81], unit="m/s2")
    p = gt.variable(3, unit="m")
    v = gt.variable(3, unit="m/s")
    a = gt.variable(3, unit="m/s2")
    Q = gt.variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0])
    w = gt.variable(3, unit="rad/s")
    alpha = gt.variable(3, unit="rad/s2")
    jerk = gt.input(3, unit="m/s3")
    angular_jerk = gt.input(3, unit="rad/s3")
    force = gt.variable(3, unit="m/s2")

    def equations(self) -> Any:
        s, u, f = self.Q[0], self.Q[1:4], self.a - self.gravity
        yield gt.der(self.p) == self.v
        yield gt.der(self.v) == self.a
        yield gt.der(self.a) == self.jerk
        yield gt.der(s) == -0.5 * gt.dot(u, self.w)
        yield gt.der(u) == 0.5 * (s * self.w + gt.cross(u, self.w))
        yield gt.der(self.w) == self.alpha
        yield gt.der(self.alpha) == self.angular_jerk
        yield self.force == f - 2 * s * gt.cross(u, f) + 2 * gt.cross(u, gt.cross(u, f))


DEVIATIONS = {"position": 6.4e-6, "orientation": 2e-4, "force": 0.0124, "rate": 8.8e-4}
DENSITIES = {"jerk": 1e2, "angular_jerk": 1e4}


def tracked(densities: dict[str, float] = DENSITIES, gravity: Any = G) -> System:
    """18 degrees of freedom and 12 numbers an instant."""
    process = ProcessModel(TrackedBody(gravity=gravity), densities, states=STATES, quaternions=["Q"])
    d = DEVIATIONS
    return System(
        process,
        [
            Sensor("position", "p", deviation=d["position"], period=0.001),
            Sensor("orientation", "Q", deviation=d["orientation"], kind="quaternion", period=0.001),
            Sensor("force", deviation=d["force"], period=0.001),
            Sensor("rate", "w", deviation=d["rate"], period=0.001),
        ],
    )


def motion(t: np.ndarray) -> dict[str, np.ndarray]:
    """A body on an ellipse that turns about a fixed axis to and fro: states by name, (K, .)."""
    s, c, z = np.sin(2 * t), np.cos(2 * t), np.zeros_like(t)
    axis = np.array([0.6, 0.0, 0.8])
    angle, rate, faster = 0.7 * np.sin(3 * t), 2.1 * np.cos(3 * t), -6.3 * np.sin(3 * t)
    return {
        "p": np.column_stack([0.3 * c, 0.2 * s, 0.1 * s]),
        "v": np.column_stack([-0.6 * s, 0.4 * c, 0.2 * c]),
        "a": np.column_stack([-1.2 * c, -0.8 * s, -0.4 * s]) + z[:, None],
        "Q": np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis]),
        "w": rate[:, None] * axis,
        "alpha": faster[:, None] * axis,
    }


def turned_back(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """R' v by rows."""
    s, u = q[:, :1], q[:, 1:]
    return v - 2 * s * np.cross(u, v) + 2 * np.cross(u, np.cross(u, v))


def exact(states: dict[str, np.ndarray], gravity: Any = G) -> dict[str, np.ndarray]:
    """What the sensors read without noise."""
    return {
        "position": states["p"],
        "orientation": states["Q"],
        "force": turned_back(states["Q"], states["a"] - gravity),
        "rate": states["w"],
    }


def noisy(t: np.ndarray, seed: int) -> dict[str, Readings]:
    """Readings of `motion` with the noise of the sensors (synthetic)."""
    rng = np.random.default_rng(seed)
    made = {}
    for name, values in exact(motion(t)).items():
        if name == "orientation":
            d = rng.normal(size=(len(t), 3)) * DEVIATIONS[name]
            space = gt.filtering.Manifold([gt.filtering.StatePart("Q", "quaternion", 4)])
            made[name] = Readings(t, space.plus(values, d))
        else:
            made[name] = Readings(t, values + rng.normal(size=values.shape) * DEVIATIONS[name])
    return made


SPREAD = {"p": 1e-5, "v": 0.01, "a": 0.1, "Q": 1e-3, "w": 0.01, "alpha": 1.0}


def beginning(t0: float = 0.0) -> InitialState:
    """The true state at t0, with deviations."""
    return InitialState({name: v[0] for name, v in motion(np.array([t0])).items()}, SPREAD)
