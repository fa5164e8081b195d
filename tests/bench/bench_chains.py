"""Chains and arms: compile time and operations as the number of bodies grows, and forward dynamics by hand.

python tests/bench/bench_chains.py

Prints Markdown with the goals of issue 46: 100 bodies from parts in 5 s, operations that grow as the bodies, and an arm
of seven joints within 1.1 times the fewer operations of articulated bodies and of composite bodies with Cholesky.
Operations are CasADi's after elimination of common subexpressions, without reading inputs and writing outputs.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial

import casadi as ca
import numpy as np

import gtmodel as gt
from tests.bench.bench_compile_time import CHAINS, causal, growth, measure
from tests.bench.rivals import arm_dynamics_by_hand as hand

LENGTHS, SECONDS, EXPONENT, RATIO = (20, 50, 100), 5.0, 1.2, 1.1
P = np.pi / 2
ARMS = {  # a, d, alpha: an arm like LBR iiwa, and the UR5e
    "seven joints": (np.zeros(7), np.array([0.34, 0, 0.4, 0, 0.4, 0, 0.126]), np.array([-P, P, P, -P, -P, P, 0])),
    "UR5e": (np.array([0, -0.425, -0.3922, 0, 0, 0]), np.array([0.1625, 0, 0, 0.1333, 0.0997, 0.0996]),
             np.array([P, 0, 0, P, -P, 0])),
}  # fmt: skip
SEED = 1


def arm(a: np.ndarray, d: np.ndarray, alpha: np.ndarray) -> gt.Model:
    """An arm with synthetic masses, centres of mass and full inertias."""
    n, rng = len(a), np.random.default_rng(SEED)
    roots = rng.normal(size=(n, 3, 3))
    inertia = 0.01 * (roots @ roots.transpose(0, 2, 1) + np.eye(3))
    return gt.robots.serial_arm(
        a=a, d=d, alpha=alpha, m=rng.uniform(1, 5, n), c=rng.normal(size=(n, 3)) * 0.1, I=inertia
    )


def chains() -> bool:
    print("| chain of n bodies | " + " | ".join(f"n = {n} [s]" for n in LENGTHS) + " | goal | | operations at "
          + ", ".join(map(str, LENGTHS)) + " | exponent | goal | |")  # fmt: skip
    print("|---|" + "---:|" * len(LENGTHS) + "---:|---|---:|---:|---:|---|")
    good = True
    for title, (make, compile) in CHAINS.items():
        found = [measure(partial(_made, make, n), compile) for n in LENGTHS]
        sizes = [m.function.closed.n_instructions() for m in found]
        exponent, seconds = growth(sizes, LENGTHS), [m.total for m in found]
        fast, few = seconds[-1] <= SECONDS, exponent <= EXPONENT
        good &= fast and few
        times = " | ".join(f"{s:.2f}" for s in seconds)
        counts = ", ".join(map(str, sizes))
        print(f"| {title} | {times} | {SECONDS:g} | {_verdict(fast)} | {counts} | {exponent:.2f} | {EXPONENT:g} "
              f"| {_verdict(few)} |", flush=True)  # fmt: skip
    return good


def _made(make: Callable[[int], type[gt.Model]], n: int) -> gt.Model:
    return make(n)()


def arms() -> bool:
    print("\n| forward dynamics | articulated bodies | composite bodies | gtmodel | ratio | goal | |")
    print("|---|---:|---:|---:|---:|---:|---|")
    good = True
    for name, (a, d, alpha) in ARMS.items():
        robot, n = arm(a, d, alpha), len(a)
        q, rate, torque = (ca.SX.sym(name, n) for name in ("q", "rate", "torque"))
        links = hand.links_of(robot, a, d, alpha, q)
        ways = (hand.by_articulated_bodies, hand.by_composite_bodies)
        rivals = [ca.Function("rival", [q, rate, torque], [hand.shortened(way(links, rate, torque))]) for way in ways]
        ours = causal("tau", "der(q,2)", "q")(robot)
        point = np.random.default_rng(SEED).uniform(-1, 1, (3, n))
        for rival in rivals:
            np.testing.assert_allclose(np.asarray(rival(*point)).ravel(), ours(*point)[0], rtol=1e-9)
        articulated, composite, own = (f.n_instructions() - 4 * n for f in (*rivals, ours.closed))
        ratio = own / min(articulated, composite)
        good &= ratio <= RATIO
        print(f"| {name} | {articulated} | {composite} | {own} | {ratio:.2f} | {RATIO} | {_verdict(ratio <= RATIO)} |")
    return good


def _verdict(good: bool) -> str:
    return "pass" if good else "MISSED"


if __name__ == "__main__":
    passed = [chains(), arms()]
    sys.exit(0 if all(passed) else 1)
