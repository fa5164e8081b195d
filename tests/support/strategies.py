"""Reachable states of robots: one draw and one hypothesis strategy, shared by all tests.

They work on arrays alone (A, v, L of a three-link robot), so that no bug of gtmodel can choose the poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st

Array = np.ndarray

SIDES = [(i, j, k) for i in (1, -1) for j in (1, -1) for k in (1, -1)]  # sign of link times guideway, per arm

# A pose counts as regular if every link makes at least this cosine with its guideway, and if the unit vectors of the
# links span at least this volume. Both enter errors as reciprocals: two digits may be lost, not more.
MIN_COSINE = 0.15
MIN_VOLUME = 0.08
BOX = 0.6  # half width [m] of the region round home; four poses in five of it are regular on the L1 sets
SPEED = 1.0  # m/s
ACCELERATION = 5.0  # m/s2


@dataclass(frozen=True)
class State:
    """TCP position, velocity and acceleration, and the carts that belong to the position."""

    T: Array
    Td: Array
    Tdd: Array
    q: Array


def carts(robot: Any, T: Array, sides: tuple[int, ...]) -> Array | None:
    """q (3,) by the quadratic formula, or None where the pose is not regular."""
    A, v, L = (np.asarray(x, dtype=float) for x in (robot.A, robot.v, robot.L))
    d = T - A
    dv, vv = np.sum(d * v, axis=1), np.sum(v * v, axis=1)
    root = dv**2 - vv * (np.sum(d * d, axis=1) - L**2)
    if np.any(root < (MIN_COSINE * L) ** 2 * vv):
        return None
    q = (dv - np.array(sides) * np.sqrt(root)) / vv
    unit = (d - q[:, None] * v) / L[:, None]
    return q if abs(np.linalg.det(unit)) >= MIN_VOLUME else None


def random_states(robot: Any, count: int, seed: int, sides: tuple[int, ...] = (1, 1, 1)) -> list[State]:
    """`count` regular states on the given sides, the same at every run."""
    rng = np.random.default_rng(seed)
    found: list[State] = []
    while len(found) < count:
        T = np.asarray(robot.home) + BOX * rng.uniform(-1, 1, 3)
        q = carts(robot, T, sides)
        Td, Tdd = SPEED * rng.uniform(-1, 1, 3), ACCELERATION * rng.uniform(-1, 1, 3)
        if q is not None:
            found.append(State(T, Td, Tdd, q))
    return found


def columns(states: list[State]) -> tuple[Array, Array, Array, Array]:
    """(T, Td, Tdd, q), each (n, 3)."""
    return tuple(np.array([getattr(s, k) for s in states]) for k in ("T", "Td", "Tdd", "q"))  # type: ignore[return-value]


def vectors(size: float) -> st.SearchStrategy[Array]:
    """Vectors of length 3 with entries in [-size, size], on a grid of 1e-6 so that shrunk examples read well."""
    steps = round(size * 1e6)
    return st.tuples(*[st.integers(-steps, steps)] * 3).map(lambda t: np.array(t) / 1e6)


def reachable_states(robot: Any, sides: tuple[int, ...] = (1, 1, 1)) -> st.SearchStrategy[State]:
    """Regular states of a three-link robot round its home."""

    def state(drawn: tuple[Array, Array, Array]) -> State | None:
        T = np.asarray(robot.home) + drawn[0]
        q = carts(robot, T, sides)
        return None if q is None else State(T, drawn[1], drawn[2], q)

    return (
        st.tuples(vectors(BOX), vectors(SPEED), vectors(ACCELERATION)).map(state).filter(lambda s: s is not None)  # type: ignore[return-value]
    )
