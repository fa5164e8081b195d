"""What a simulation costs beside CVODES by hand, with the same rows out: first run, repeated runs, a sweep.

Prints Markdown. Processor times of one process, medians of interleaved turns; the error of every road is measured
against CVODES by hand at a much finer tolerance, so that equal tolerances can be seen to buy equal errors.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import gtmodel as gt
from tests.bench.rivals.motions_by_hand import ByHand, Cvodes, by_scipy, pendulum, three_link
from tests.simulation.models import SwingingPendulum
from tests.simulation.robot import T0, l1, oracle

ROWS, TOLERANCE, FINEST = 501, 1e-9, 1e-13
AT_MOST = {"first run": 10.0, "repeated": 5.0, "other start and inputs": 5.0, "sweep": 5.0}
SEED = 18


@dataclass(frozen=True, eq=False)
class Case:
    """A motion in gtmodel and by hand. `arguments` of a number of cases, the first for 0; `fresh` makes a model that
    shares nothing with another one; `states` are those columns that both roads have."""

    name: str
    fresh: Callable[[], gt.Model]
    motion: ByHand
    end: float
    arguments: Callable[[int], tuple[dict[str, Any], np.ndarray, np.ndarray]]
    compared: Callable[[Mapping[str, np.ndarray]], np.ndarray]
    columns: list[int]


def cases() -> list[Case]:
    count = iter(range(10**6))

    def fresh_pendulum() -> gt.Model:
        return type(f"Pendulum{next(count)}", (SwingingPendulum,), {})()

    def fresh_robot() -> gt.Model:
        return type(f"Robot{next(count)}", (type(l1()),), {})(**l1().__dict__["_modifiers"])

    def swing(n: int) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
        x = 0.6 if n == 0 else 0.6 - 0.1 * np.random.default_rng([SEED, n]).uniform()
        return {"start": {"x": x, "der(x)": 0.0}}, np.array([np.arcsin(x), 0.0]), np.zeros(0)

    def drop(n: int) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
        rng = np.random.default_rng([SEED, n])
        T = T0 if n == 0 else T0 + 0.05 * rng.uniform(-1, 1, 3)
        tau = np.zeros(3) if n == 0 else 5.0 * rng.uniform(-1, 1, 3)
        given = {"inputs": {"tau": tau}, "start": {"T": T, "der(T)": np.zeros(3)}}
        return given, np.concatenate([T, np.zeros(5)]), tau

    return [
        Case("pendulum, 10 s", fresh_pendulum, pendulum(), 10.0, swing, lambda t: np.array([t["x"], t["y"]]).T, [0, 2]),
        Case(
            "L1 drop, 1 s", fresh_robot, three_link(oracle(l1())), 1.0, drop,
            lambda t: np.column_stack([t["q"], t["T"], t["der(T)"]]), list(range(9)),
        ),
    ]  # fmt: skip


def cpu(run: Callable[[], Any]) -> float:
    """Processor time [ms] of a call."""
    begin = time.process_time()
    run()
    return 1e3 * (time.process_time() - begin)


def bench(case: Case, turns: int, sweep: int) -> None:
    end, step = case.end, case.end / (ROWS - 1)

    def ours(model: gt.Model, n: int = 0) -> gt.Simulation:
        return gt.simulate(model, end, step=step, tolerance=TOLERANCE, **case.arguments(n)[0])

    def theirs(integrator: Cvodes, n: int = 0) -> np.ndarray:
        return integrator(*case.arguments(n)[1:])[1]

    def scipys(n: int = 0) -> np.ndarray:
        return by_scipy(case.motion, end, ROWS, TOLERANCE, *case.arguments(n)[1:])[1]

    kept, rival = case.fresh(), Cvodes(case.motion, end, ROWS, TOLERANCE)
    exact = theirs(Cvodes(case.motion, end, ROWS, FINEST))[:, case.columns]
    errors = [
        float(np.max(np.abs(rows - exact)))
        for rows in (case.compared(ours(kept).trajectory), theirs(rival)[:, case.columns], scipys()[:, case.columns])
    ]
    table: dict[str, list[list[float]]] = {}
    numbers = iter(range(1, 10**6))
    for _ in range(turns):
        fresh, n = case.fresh(), next(numbers)
        planned = case.fresh()
        gt.simulation.explain_simulation(planned, **case.arguments(0)[0])
        lines = {
            "fresh model": (
                cpu(lambda m=fresh: ours(m)), cpu(lambda: theirs(Cvodes(case.motion, end, ROWS, TOLERANCE)))
            ),
            "first run": (
                cpu(lambda m=planned: ours(m)), cpu(lambda: theirs(Cvodes(case.motion, end, ROWS, TOLERANCE)))
            ),
            "repeated": (cpu(lambda: ours(kept)), cpu(lambda: theirs(rival)), cpu(scipys)),
            "other start and inputs": (
                cpu(lambda n=n: ours(kept, n)), cpu(lambda n=n: theirs(rival, n)), cpu(lambda n=n: scipys(n))
            ),
        }  # fmt: skip
        for name, times in lines.items():
            table.setdefault(name, []).append(list(times))
    roads: list[Callable[[int], Any]] = [lambda n: ours(kept, n), lambda n: theirs(rival, n), scipys]
    sweeping = [cpu(lambda run=run: [run(n) for n in range(sweep)]) / sweep for run in roads]
    rows = {name: [statistics.median(t) for t in zip(*times, strict=True)] for name, times in table.items()}
    rows["sweep"] = sweeping
    for name, (mine, hand, *more) in rows.items():
        most = AT_MOST.get(name)
        verdict = "" if most is None else "pass" if mine <= most * hand else "FAIL"
        third = f"{more[0]:.1f}" if more else ""
        times = f"{mine:.1f} | {hand:.1f} | {third} | {mine / hand:.1f}"
        print(f"| {case.name}, {name} | {times} | {most or ''} | {verdict} |", flush=True)
    print(f"| {case.name}, error | {errors[0]:.1e} | {errors[1]:.1e} | {errors[2]:.1e} | | | |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=9)
    parser.add_argument("--sweep", type=int, default=100)
    given = parser.parse_args()
    print("| run | gtmodel [ms] | CVODES by hand [ms] | DOP853 [ms] | ratio | at most | |")
    print("|---|---:|---:|---:|---:|---:|---|")
    for case in cases():
        bench(case, given.turns, given.sweep)


if __name__ == "__main__":
    main()
