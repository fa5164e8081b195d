"""Compile time: the causalities of the Gantry-Tau, a request answered from the cache, and chains of pendulums.

Prints Markdown. Times are processor time, the best of some repetitions where that is cheap: other load on the machine
disturbs them little, but they are no instruction counts, and no test rests on them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import gtmodel as gt
from gtmodel.compiler.causal import CausalFunction, flat_of
from gtmodel.compiler.flat_cache import shared
from tests.bench.chains import angle_chain, cartesian_chain

LENGTHS = (1, 2, 5, 10, 20, 50)
REPEAT_BELOW = 1.0  # s: what takes longer is measured once
REPETITIONS = 3

CAUSALITIES = {  # name: (known, targets, preferred states)
    "forward kinematics": ("q", "T", ()),
    "inverse kinematics": ("T", "q", ()),
    "velocity map": ("T", "der(q)", ()),
    "inverse dynamics": ("T", "tau", ()),
    "forward dynamics, states T": ("tau", "der(T,2)", "T"),
    "forward dynamics, states q": ("tau", "der(q,2)", "q"),
}
LIMITS = {"three-link": 1.0, "six-link": 5.0}  # s, issue 3, point 6

Compile = Callable[[gt.Model], CausalFunction]


def causal(known: Any, targets: Any, prefer: Any = ()) -> Compile:
    return lambda model: model.causal(known, targets, prefer=prefer)


CHAINS: dict[str, tuple[Callable[[int], type[gt.Model]], Compile]] = {
    "angles, inverse dynamics": (angle_chain, causal("phi", "torque")),
    "angles, forward dynamics": (angle_chain, causal("torque", "der(phi,2)", "phi")),
    "Cartesian, forward dynamics": (cartesian_chain, causal((), "der(r,2)")),
}


@dataclass(frozen=True)
class Measured:
    """Processor times [s]: flattening, and all from a fresh model to a function that can be called."""

    flattening: float
    total: float
    model: gt.Model
    function: CausalFunction


def measure(make: Callable[[], gt.Model], compile: Compile) -> Measured:
    """The best of some repetitions, or the only one where it takes long."""
    best: Measured | None = None
    for _ in range(REPETITIONS):
        shared.cache_clear()
        model = make()
        start = time.process_time()
        flat_of(model)
        flattened = time.process_time()
        f = compile(model)
        f.casadi  # noqa: B018, built on first use
        total = time.process_time() - start
        if best is None or total < best.total:
            best = Measured(flattened - start, total, model, f)
        if total > REPEAT_BELOW:
            break
    assert best is not None
    return best


def robots() -> None:
    print("| robot | function | operations | compiling [s] | limit [s] | | from cache [us] |")
    print("|---|---|---:|---:|---:|---|---:|")
    makers: dict[str, Callable[[], gt.Model]] = {"three-link": lambda: gt.robots.gantry_tau("l1_tape")}
    six = six_link()
    if six is not None:
        makers["six-link"] = six
    for robot, make in makers.items():
        for title, (known, targets, prefer) in CAUSALITIES.items():
            compile = causal(known, targets, prefer)
            try:
                m = measure(make, compile)
            except gt.ModelError as error:
                print(f"| {robot} | {title} | | not compiled: {error} | | | |")
                continue
            start = time.process_time()
            again = compile(m.model)
            cached = (time.process_time() - start) * 1e6
            assert again is m.function, "a second request must come from the cache"
            verdict = "pass" if m.total < LIMITS[robot] else "FAIL"
            print(
                f"| {robot} | {title} | {_size(m.function)} | {m.total:.2f} | {LIMITS[robot]:g} | {verdict} | "
                f"{cached:.0f} |",
                flush=True,
            )
        model = make()
        start = time.process_time()
        for known, targets, prefer in CAUSALITIES.values():
            causal(known, targets, prefer)(model).casadi  # noqa: B018
        print(f"| {robot} | all of these, from one model | | {time.process_time() - start:.2f} | | | |", flush=True)
    if six is None:
        print("\nThis gtmodel has no six-link robot: it was not measured.")


def six_link() -> Callable[[], gt.Model] | None:
    """A nominal six-link L1: the three-link set with our own plate joints."""
    try:
        from gtmodel.robots.six_link import ARM, SixLink
    except ImportError:
        return None
    three = gt.robots.gantry_tau("l1_tape")
    A, v, L = (np.array(getattr(three, k), dtype=float)[list(ARM)] for k in ("A", "v", "L"))
    B = np.array(
        [[0, -0.05, 0.1], [0, 0.12, -0.08], [0, -0.02, 0.14], [0.05, -0.09, 0.04], [-0.05, 0, -0.14], [0, 0.12, 0.08]]
    )
    same = {k: np.array(getattr(three, k), dtype=float) for k in ("m_p", "m_c", "coulomb", "viscous", "home")}
    return lambda: SixLink(A=A + B, v=v, L=L, B=B, I_p=np.diag([0.1, 0.1, 0.1]), **same)


def chains() -> None:
    print(
        "| compiling a chain of n pendulums [s] | "
        + " | ".join(f"n = {n}" for n in LENGTHS)
        + " | exponent | operations at 50 |"
    )
    print("|---|" + "---:|" * (len(LENGTHS) + 2))
    for title, (make, compile) in CHAINS.items():
        found = [measure(partial(_configured, make, n), compile) for n in LENGTHS]
        for row, times in ((title, [m.total for m in found]), ("- flattening", [m.flattening for m in found])):
            size = _size(found[-1].function) if row == title else ""
            shown = " | ".join(f"{t:.2f}" for t in times)
            print(f"| {row} | {shown} | {growth(times):.1f} | {size} |", flush=True)


def _configured(make: Callable[[int], type[gt.Model]], n: int) -> gt.Model:
    return make(n)()


def _size(f: CausalFunction) -> str:
    """Operations of a closed form, the common ones counted once."""
    return "Newton" if f.plan.newton else str(f.closed.n_instructions())


def growth(times: Sequence[float], lengths: Sequence[int] = LENGTHS) -> float:
    """Exponent p of time ~ n^p over the three longest chains, by least squares."""
    return float(np.polyfit(np.log(lengths[-3:]), np.log(times[-3:]), 1)[0])


def main() -> None:
    print("Processor time on this machine, from a fresh model to a function that can be called; limits: issue 3.")
    print("A second request for the same function is answered from the cache.\n")
    robots()
    print("\nChains: exponent p of time ~ n^p from n = 10 to 50.\n")
    chains()


if __name__ == "__main__":
    main()
