"""Quaternions as CasADi columns (4), scalar first: products, small turns, turned vectors."""

from __future__ import annotations

import casadi as ca


def product(a: ca.SX, b: ca.SX) -> ca.SX:
    """Hamilton's product a b: first the turn b, then a, both in outer coordinates."""
    return ca.vertcat(a[0] * b[0] - ca.dot(a[1:], b[1:]), a[0] * b[1:] + b[0] * a[1:] + ca.cross(a[1:], b[1:]))


def turned(u: ca.SX, turn: ca.SX) -> ca.SX:
    """u (1, turn / 2) / its length: u turned by |turn| [rad], where that is small, about an axis (3) of its own frame;
    smooth up to half a turn."""
    half = turn / 2
    return product(u, ca.vertcat(1, half)) / ca.sqrt(1 + ca.dot(half, half))


def rotated(u: ca.SX, p: ca.SX) -> ca.SX:
    """R(u) p of a unit quaternion, from its own frame to the outer one."""
    twice = 2 * ca.cross(u[1:], p)
    return p + u[0] * twice + ca.cross(u[1:], twice)
