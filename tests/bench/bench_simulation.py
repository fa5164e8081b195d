"""Time of a simulation against CVODES by hand with the same output rows: first run, repeated runs, sweeps.

Prints Markdown. Processor times of one process, medians of interleaved turns; the error of every method is measured
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
from tests.bench.rivals.motions_by_hand import (
    ByHand,
    Cvodes,
    by_scipy,
    pendulum,
    pendulum_of_any_mass,
    three_link,
    three_link_of_any_payload,
)
from tests.simulation.models import SwingingPendulum
from tests.simulation.robot import T0, l1, oracle

ROWS, TOLERANCE, FINEST = 501, 1e-9, 1e-13
AT_MOST = {"first run": 10.0, "repeated": 5.0, "other start and inputs": 5.0, "sweep": 5.0}
# runs of a sweep over a parameter that are also made by `with_`, each of which compiles
MADE = 30
SEED = 18


@dataclass(frozen=True, eq=False)
class Case:
    """A motion in gtmodel and by hand. `arguments` of a number of cases, the first for 0; `fresh` makes a model that
    shares nothing with another one; `states` are the columns that both methods have."""

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
    methods: list[Callable[[int], Any]] = [lambda n: ours(kept, n), lambda n: theirs(rival, n), scipys]
    sweeping = [cpu(lambda run=run: [run(n) for n in range(sweep)]) / sweep for run in methods]
    rows = {name: [statistics.median(t) for t in zip(*times, strict=True)] for name, times in table.items()}
    rows["sweep"] = sweeping
    for name, (mine, hand, *more) in rows.items():
        most = AT_MOST.get(name)
        verdict = "" if most is None else "pass" if mine <= most * hand else "FAIL"
        third = f"{more[0]:.1f}" if more else ""
        times = f"{mine:.1f} | {hand:.1f} | {third} | {mine / hand:.1f}"
        shown = f"sweep of {sweep:,}" if name == "sweep" else name
        print(f"| {case.name}, {shown} | {times} | {most or ''} | {verdict} |", flush=True)
    print(f"| {case.name}, error | {errors[0]:.1e} | {errors[1]:.1e} | {errors[2]:.1e} | | | |", flush=True)


@dataclass(frozen=True, eq=False)
class ParameterSweep:
    """Runs that differ in one parameter of the model: the n-th of its values, starts and inputs as by hand."""

    name: str
    model: gt.Model
    parameter: str
    value: Callable[[int], float]
    motion: ByHand
    end: float
    given: dict[str, Any]
    by_hand: tuple[np.ndarray, np.ndarray]
    compared: Callable[[Mapping[str, np.ndarray]], np.ndarray]
    columns: list[int]


def parameter_sweeps(case: dict[str, Case], masses: int) -> list[ParameterSweep]:
    swinging, dropping = case["pendulum, 10 s"], case["L1 drop, 1 s"]
    heaviest = float(l1().m_p)
    return [
        ParameterSweep(
            name, c.fresh(), parameter, value, motion, c.end, c.arguments(0)[0], c.arguments(0)[1:], c.compared,
            c.columns,
        )
        for name, c, parameter, value, motion in (
            ("pendulum, mass", swinging, "m", lambda n: 0.5 + n / masses, pendulum_of_any_mass()),
            (
                "L1 drop, payload", dropping, "m_p", lambda n: heaviest * (1 + n / masses),
                three_link_of_any_payload(oracle(l1())),
            ),
        )
    ]  # fmt: skip


def bench_parameters(sweep: ParameterSweep, runs: int) -> None:
    """Each run side by side: of one model that is given the value, by hand, and, MADE of them, of a model made with
    the value."""
    step, p, (start, u) = sweep.end / (ROWS - 1), sweep.parameter, sweep.by_hand
    rival = Cvodes(sweep.motion, sweep.end, ROWS, TOLERANCE)
    times, made, apart = np.zeros((runs, 2)), list[float](), 0.0
    compared = set(np.linspace(0, runs - 1, min(runs, MADE)).round().astype(int).tolist())
    for n in range(runs):
        value, rows = sweep.value(n), dict[str, Any]()

        def run(name: str, model: gt.Model, rows: dict[str, Any] = rows, **more: Any) -> None:
            rows[name] = gt.simulate(model, sweep.end, step=step, tolerance=TOLERANCE, **sweep.given, **more)

        def by_hand(rows: dict[str, Any] = rows, value: float = value) -> None:
            rows["hand"] = rival(start, np.append(u, value))[1][:, sweep.columns]

        times[n] = cpu(lambda value=value, run=run: run("given", sweep.model, parameters={p: value})), cpu(by_hand)
        if n in compared:
            made.append(cpu(lambda value=value, run=run: run("made", sweep.model.with_(**{p: value}))))
            a, b = (sweep.compared(rows[k].trajectory) for k in ("given", "made"))
            apart = max(apart, float(np.max(np.abs(a - b))))
    given, hand = times.mean(axis=0)
    first, later, anew = times[0, 0], times[1:, 0].mean(), statistics.mean(made)
    verdict = "pass" if given <= AT_MOST["sweep"] * hand else "FAIL"
    print(
        f"| {sweep.name} | {anew:.1f} | {first:.0f} | {later:.1f} | {given:.1f} | {hand:.1f} | {given / hand:.1f} | "
        f"{AT_MOST['sweep']} | {verdict} | {apart:.0e} |",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=9)
    parser.add_argument("--sweep", type=int, default=1000)
    parser.add_argument("--masses", type=int, default=1000)
    given = parser.parse_args()
    print("| run | gtmodel [ms] | CVODES by hand [ms] | DOP853 [ms] | ratio | at most | |")
    print("|---|---:|---:|---:|---:|---:|---|")
    known = cases()
    for case in known:
        bench(case, given.turns, given.sweep)
    columns = ("`with_` [ms]", "`parameters=`, first run [ms]", "later runs [ms]", "mean [ms]", "by hand [ms]")
    print(f"\n| {' | '.join(('sweep over', *columns, 'mean / hand', 'at most', '', 'difference'))} |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---|---:|")
    for sweep in parameter_sweeps({c.name: c for c in known}, given.masses):
        bench_parameters(sweep, given.masses)


if __name__ == "__main__":
    main()
