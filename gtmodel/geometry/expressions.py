"""Rotation of vectors by quaternions, and rates of quaternions, for expressions of the language or CasADi columns."""

from __future__ import annotations

from typing import Any

from ..lang.functions import cross, der, dot


def rotated(q: Any, v: Any) -> Any:
    """Return R v for the rotation R of a unit quaternion."""
    twice = 2 * cross(q[1:4], v)
    return v + q[0] * twice + cross(q[1:4], twice)


def rotated_back(q: Any, v: Any) -> Any:
    """Return R' v for the rotation R of a unit quaternion."""
    u = q[1:4]
    return v - 2 * q[0] * cross(u, v) + 2 * cross(u, cross(u, v))


def applied(pose: Any, p: Any) -> Any:
    """Return R(q) p + t for a pose (7,): a unit quaternion q, then t."""
    return rotated(pose[:4], p) + pose[4:7]


def quaternion_velocity(e: Any) -> Any:
    """Return the angular velocity (3,) [rad/s] in outer coordinates, 2 vec(e' e*); times |e|^2 if |e| is not 1."""
    rate = der(e)
    return 2 * (e[0] * rate[1:] - rate[0] * e[1:] + cross(e[1:], rate[1:]))


def quaternion_kinematics(q: Any, w: Any) -> tuple[Any, Any]:
    """Return the rates of scalar and vector (3,) of a unit quaternion for the angular velocity w (3,) in body frame."""
    u = q[1:4]
    return -0.5 * dot(u, w), 0.5 * (q[0] * w + cross(u, w))
