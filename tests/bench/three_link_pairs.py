"""Compared pairs: a generated function of the three-link Gantry-Tau, and its counterpart in hand-written C.

Both get the same regular poses. The peer takes parameters as inputs; the generated code has them folded in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import gtmodel as gt
from gtmodel.compiler.causal import CausalFunction
from tests.bench.callgrind import Call
from tests.oracle.hand_written import ThreeLink
from tests.support.strategies import columns, random_states

PEER = Path(__file__).parents[1] / "oracle" / "three_link.c"
POINTS = 64
SEED = 1
LINK_MASSES = {"massless links": (0.0, 0.0, 0.0), "heavy links": (2.1, 3.4, 5.2)}  # kg
FORCE = 300.0  # N, half width of the range that motor forces are drawn from

# Issue 3, point 6: the peer is decent if it costs at most this at -O2, and generated code at most 1.5 times the peer.
LIMITS = {"fk": 265, "ik": 175, "velocity": 220, "inverse_dynamics_linear": 880}
RATIO = 1.5

SMOOTHINGS = {"tanh": ("tanh", "THREE_LINK_TANH"), "linear": ("piecewise_linear", "THREE_LINK_PIECEWISE_LINEAR")}
_MEMBERS = ("A", "L", "m_p", "m_c", "m_a", "coulomb", "viscous", "velocity_scale")


@dataclass(frozen=True)
class Pair:
    """A generated function and its peer's call at the same points; `expected` (n, 3) by eqs. (6.3)-(6.8) in NumPy."""

    key: str
    title: str
    function: CausalFunction
    peer: Call
    expected: np.ndarray


class Clipped(ThreeLink):
    """The equations in NumPy with the sign smoothed by a straight line."""

    def friction(self, qd: np.ndarray) -> np.ndarray:
        return self.coulomb * np.clip(qd / self.velocity_scale, -1.0, 1.0) + self.viscous * qd


@dataclass(frozen=True)
class Pairs:
    """All pairs of one robot, and the C text with its parameters."""

    all: list[Pair]
    parameters: str


def three_link_pairs(links: str = "massless links") -> Pairs:
    """FK, IK, velocity map, inverse and forward dynamics of the L1 prototype with links of LINK_MASSES."""
    robots = {
        law: gt.robots.gantry_tau("l1_tape", smoothing=smoothing, m_a=list(LINK_MASSES[links]))
        for law, (smoothing, _) in SMOOTHINGS.items()
    }
    robot = robots["tanh"]
    assert np.array_equal(robot.v, [[1.0, 0.0, 0.0]] * 3), "the peer's guideways are along x"
    numbers = [np.array(getattr(robot, k), dtype=float) for k in _MEMBERS]
    oracles = {"tanh": ThreeLink(*numbers), "linear": Clipped(*numbers)}
    oracle = oracles["tanh"]
    states = random_states(robot, POINTS, SEED)
    T, Td, Tdd, q = columns(states)
    qd = np.array([oracle.inverse_jacobian(s.T, s.q) @ s.Td for s in states])
    tau = FORCE * np.random.default_rng(SEED).uniform(-1, 1, T.shape)
    pairs: list[Pair] = []

    def add(key: str, title: str, f: CausalFunction, points: list[np.ndarray], law: str, expected: np.ndarray) -> None:
        arguments = ", ".join(["in", "in + 3", "in + 6"][: len(points)])
        name = key.removesuffix(f"_{law}")
        statement = f"three_link_{name}(&robot, {f'{SMOOTHINGS[law][1]}, ' if law else ''}{arguments}, out);"
        peer = Call(f"three_link_{name}", statement, np.hstack(points), 3, "three_link.h")
        pairs.append(Pair(key, title, f, peer, expected))

    def at_states(value: Callable[..., np.ndarray]) -> np.ndarray:
        return np.array([value(s, f) for s, f in zip(states, tau, strict=True)])

    add("fk", "forward kinematics", robot.causal("q", "T"), [q], "", T)
    add("ik", "inverse kinematics", robot.causal("T", "q"), [T], "", q)
    add("velocity", "velocity map, (T, T') to q'", robot.causal("T", "der(q)"), [T, Td], "", qd)
    for law, (word, _) in SMOOTHINGS.items():
        r, o, word = robots[law], oracles[law], word.replace("_", " ")
        forces = at_states(lambda s, _, o=o: o.inverse_dynamics(s.T, s.q, s.Td, s.Tdd))
        in_T = at_states(lambda s, f, o=o: o.forward_dynamics(s.T, s.q, s.Td, f)[0])
        in_q = at_states(lambda s, f, o=o: o.forward_dynamics(s.T, s.q, s.Td, f)[1])
        add(f"inverse_dynamics_{law}", f"inverse dynamics, {word}", r.causal("T", "tau"), [T, Td, Tdd], law, forces)
        f = r.causal("tau", "der(T,2)", prefer="T")
        add(f"forward_dynamics_T_{law}", f"forward dynamics, states T, {word}", f, [T, Td, tau], law, in_T)
        f = r.causal("tau", "der(q,2)", prefer="q")
        add(f"forward_dynamics_q_{law}", f"forward dynamics, states q, {word}", f, [q, qd, tau], law, in_q)
    members = ", ".join(_c_text(getattr(oracle, k)) for k in (*_MEMBERS, "g"))
    return Pairs(pairs, f"static const three_link robot = {{{members}}};\n")


def _c_text(value: np.ndarray | float) -> str:
    a = np.asarray(value, dtype=float)
    return float(a).hex() if a.ndim == 0 else "{" + ", ".join(_c_text(x) for x in a) + "}"
