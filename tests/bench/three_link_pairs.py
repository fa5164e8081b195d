"""The pairs that are compared: a generated function of the three-link Gantry-Tau, and its peer in C by hand.

Both get the same regular poses. The peer takes parameters as inputs; the generated code has them folded in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import gtmodel as gt
from gtmodel.compiler.causal import CausalFunction
from tests.bench.callgrind import Call, generated_call
from tests.oracle.hand_written import ThreeLink
from tests.support.strategies import State, random_states

PEER = Path(__file__).parents[1] / "oracle" / "three_link.c"
POINTS = 64
SEED = 1
LINK_MASSES = (2.1, 3.4, 5.2)
# issue 3, point 6: what the peer may cost at -O2, so that it is a decent one
LIMITS = {"fk": 265, "ik": 175, "velocity": 220, "inverse_dynamics_linear": 880}
RATIO = 1.5

LAWS = {"tanh": "THREE_LINK_TANH", "linear": "THREE_LINK_PIECEWISE_LINEAR"}
_MEMBERS = ("A", "L", "m_p", "m_c", "m_a", "coulomb", "viscous", "velocity_scale")


@dataclass(frozen=True)
class Pair:
    """One generated function and the peer's call at the same points; `expected` (n, 3) from eqs. (6.3)-(6.8)."""

    key: str
    title: str
    function: CausalFunction
    generated: Call
    peer: Call
    expected: np.ndarray


def three_link_pairs(m_a: tuple[float, ...] = (0.0, 0.0, 0.0)) -> tuple[list[Pair], str]:
    """The pairs, and the C text of the peer's parameters. m_a: masses of the link clusters [kg]."""
    robots = {
        law: gt.robots.gantry_tau("l1_tape", smoothing=smoothing, m_a=list(m_a))
        for law, smoothing in (("tanh", "tanh"), ("linear", "piecewise_linear"))
    }
    robot = robots["tanh"]
    oracle = ThreeLink(*(np.array(getattr(robot, k), dtype=float) for k in _MEMBERS))
    states = random_states(robot, POINTS, SEED)
    T, Td, Tdd = (np.array([getattr(s, k) for s in states]) for k in ("T", "Td", "Tdd"))
    q = np.array([s.q for s in states])
    qd = np.array([oracle.inverse_jacobian(s.T, s.q) @ s.Td for s in states])
    tau = 300.0 * np.random.default_rng(SEED).uniform(-1, 1, T.shape)

    pairs: list[Pair] = []

    def add(key: str, title: str, f: CausalFunction, c: str, points: np.ndarray, expected: np.ndarray) -> None:
        peer = Call(c.split("(")[0], f"{c};", points, 3, "three_link.h")
        pairs.append(Pair(key, title, f, generated_call(key, f, points), peer, expected))

    def by_state(law: str, value: Callable[[ThreeLink, State, np.ndarray], np.ndarray]) -> np.ndarray:
        peer = oracle if law == "tanh" else Clipped(**vars(oracle))
        return np.array([value(peer, s, t) for s, t in zip(states, tau, strict=True)])

    add("fk", "forward kinematics", robot.causal("q", "T"), "three_link_fk(&robot, in, out)", q, T)
    add("ik", "inverse kinematics", robot.causal("T", "q"), "three_link_ik(&robot, in, out)", T, q)
    add("velocity", "velocity map (T, T') to q'", robot.causal("T", "der(q)"),
        "three_link_velocity(&robot, in, in + 3, out)", np.hstack([T, Td]), qd)  # fmt: skip
    for law, name in LAWS.items():
        word = "tanh" if law == "tanh" else "piecewise linear"
        r = robots[law]
        add(f"inverse_dynamics_{law}", f"inverse dynamics, {word} friction", r.causal("T", "tau"),
            f"three_link_inverse_dynamics(&robot, {name}, in, in + 3, in + 6, out)", np.hstack([T, Td, Tdd]),
            by_state(law, lambda o, s, _: o.inverse_dynamics(s.T, s.q, s.Td, s.Tdd)))  # fmt: skip
    for law, name in LAWS.items():
        word = "tanh" if law == "tanh" else "piecewise linear"
        r = robots[law]
        add(f"forward_dynamics_T_{law}", f"forward dynamics, states T, {word} friction",
            r.causal("tau", "der(T,2)", prefer="T"),
            f"three_link_forward_dynamics_T(&robot, {name}, in, in + 3, in + 6, out)", np.hstack([T, Td, tau]),
            by_state(law, lambda o, s, t: o.forward_dynamics(s.T, s.q, s.Td, t)[0]))  # fmt: skip
        add(f"forward_dynamics_q_{law}", f"forward dynamics, states q, {word} friction",
            r.causal("tau", "der(q,2)", prefer="q"),
            f"three_link_forward_dynamics_q(&robot, {name}, in, in + 3, in + 6, out)", np.hstack([q, qd, tau]),
            by_state(law, lambda o, s, t: o.forward_dynamics(s.T, s.q, s.Td, t)[1]))  # fmt: skip
    return pairs, parameters(oracle)


class Clipped(ThreeLink):
    """The oracle with the sign smoothed by a straight line."""

    def friction(self, qd: np.ndarray) -> np.ndarray:
        return self.coulomb * np.clip(qd / self.velocity_scale, -1.0, 1.0) + self.viscous * qd


def parameters(oracle: ThreeLink) -> str:
    """C text of the peer's parameters."""

    def c(value: np.ndarray | float) -> str:
        a = np.asarray(value, dtype=float)
        return float(a).hex() if a.ndim == 0 else "{" + ", ".join(c(x) for x in a) + "}"

    return f"static const three_link robot = {{{', '.join(c(getattr(oracle, k)) for k in (*_MEMBERS, 'g'))}}};\n"
