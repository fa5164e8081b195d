"""Compared pairs: generated inverse kinematics of arms, and the same by hand in C (tests/oracle/arms.c)."""

from __future__ import annotations

from functools import cache
from itertools import product
from pathlib import Path

import numpy as np

import gtmodel as gt
from gtmodel.compiler.causal import CausalFunction
from tests.bench.callgrind import Call
from tests.bench.three_link_pairs import Pair

PEER = Path(__file__).parents[1] / "oracle" / "arms.c"
POINTS, SEED = 64, 4
P = np.pi / 2
UR5E = dict(a=[0.0, -0.425, -0.3922, 0.0, 0.0, 0.0], d=[0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996],
            alpha=[P, 0.0, 0.0, P, -P, 0.0])  # fmt: skip
SCARA = dict(a=[0.3, 0.25, 0.0, 0.0], alpha=[0.0, np.pi, 0.0, 0.0], joints="rrpr")
Signs = tuple[int, ...]


@cache
def inverse_of(key: str) -> tuple[gt.Model, CausalFunction]:
    """An arm that has a peer, without masses and limits, and its inverse kinematics on the first branch."""
    arm = gt.robots.serial_arm(**(UR5E if key == "ur5e" else SCARA))
    names = ("shoulder", "elbow", "wrist") if key == "ur5e" else ("elbow",)
    return arm, arm.causal(["T", "R"], "q", branches=dict.fromkeys(names, 1))


def arm_pairs() -> list[Pair]:
    """One branch of each arm, at poses that it reaches on this branch away from singular positions; `expected`: q."""
    pairs = []
    for key in ("ur5e", "scara"):
        arm, inverse = inverse_of(key)
        chain = gt.kinematics.chain_of(arm)
        form = gt.kinematics.closed_form(chain)
        assert form is not None
        q = np.random.default_rng(SEED).uniform(-2.8, 2.8, (40 * POINTS, len(chain)))
        q = q[(np.asarray(form.slope_function(q.T)) > 0.05).all(axis=0)][:POINTS]
        T, R = chain.pose(q)
        points = np.hstack([T, R.reshape(-1, 9)])
        sign = hand_signs(key, points, q)
        if key == "ur5e":
            signs = ", ".join(map(str, sign))
            statement = f"{{static const double sign[] = {{{signs}}}; ur5e_inverse(in, in + 3, sign, out);}}"
        else:
            statement = f"scara_inverse(in, in + 3, {sign[0]}, out);"
        peer = Call(f"{key}_inverse", statement, points, q.shape[1], "arms.h")
        pairs.append(Pair(key, f"inverse kinematics, {key}", inverse, peer, q))
    return pairs


def hand_signs(key: str, points: np.ndarray, q: np.ndarray) -> Signs:
    """Return the signs by hand of the branch that q is on."""
    from tests.bench.callgrind import run

    choices = list(product((1, -1), repeat=3 if key == "ur5e" else 1))
    calls = {}
    for sign in choices:
        numbers = ", ".join(map(str, sign))
        statement = f"{key}_inverse(in, in + 3, {'(double[])' if key == 'ur5e' else ''}{{{numbers}}}, out);"
        if key == "scara":
            statement = f"scara_inverse(in, in + 3, {numbers}, out);"
        calls[numbers] = Call(f"{key}_inverse", statement, points, q.shape[1], "arms.h")
    written = run(calls, [PEER])
    return next(s for s in choices if np.abs(np.sin((written[", ".join(map(str, s))] - q) / 2)).max() < 1e-6)
