"""Predictive control of the L1 in C beside its goals, and its programs beside HPIPM, PIQP, DAQP and CasADi.

OMP_NUM_THREADS=1 python -m tests.bench.bench_predictive [--problems 100] [--draws 100000]

- Instructions of a program by callgrind, as a + b * iterations; iterations of drawn cold cycles, counted natively.
- The same programs to the same tolerance, cold, and warm from the cycle before: HPIPM (with BLASFEO, of CasADi's
  wheel), in turn in one C program; DAQP's C on the condensed program; PIQP, and the C that CasADi generates for
  `qrqp`, called from Python.
- The nonlinear problem of one cycle, cold: programs repeated in C, beside the C that CasADi generates for `sqpmethod`.
Cold cycles: position and goal anywhere in a box of 0.9 x 0.4 x 0.5 m, speeds up to 1.5 m/s, no rest at the end needed.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import gtmodel as gt
from gtmodel.cgen.real import DOUBLE
from gtmodel.cgen.steps.function import record as record_of
from gtmodel.predictive import ControlHorizon, Controller, StageQP, controller
from gtmodel.predictive.converged import _Problem
from gtmodel.predictive.cycle import CycleTwin
from gtmodel.results.status import Status
from tests.bench.callgrind import _edges, _run, missing
from tests.bench.rivals.horizon_rivals import TOLERANCE, ByQrqp, by_daqp, by_piqp, flat, text_of_hpipm
from tests.bench.rivals.horizon_sqp import BySqpmethod, Repeated
from tests.predictive.compiled import FLAGS, write

RIVAL = Path(__file__).parent / "rivals" / "horizon_qp.c"
LOW, HIGH = np.array([0.1, -1.1, 0.1]), np.array([1.0, -0.7, 0.6])
SPEEDS = (0.0, 0.5, 1.0, 1.5)  # m/s
MOST = 6e6  # instructions of the longest cycle
MOST_TEXT, MOST_STACK = 20, 200  # kB
MODES = ("SPEED_ABS", "SPEED", "BALANCE", "ROBUST")
STARTS = (0.0, 1e2, 1e4)  # mu0 of HPIPM; 0: its own
CAP = 20  # iterations, of problems/l1_predictive.toml
CHUNK = 1000  # problems in one file
RIVALS = 20  # problems for rivals called from Python
REPEATS = 5  # of a program: the least time counts
WARM = (0, 1, 2)  # warm_start of HPIPM: none, unknowns, unknowns and multipliers
MOVED = 125  # cycles from one goal to the next
WHOLE, SAME = 10, 1e-4  # nonlinear problems; equal costs, relative
# their stages, and largest distance and speed [m, m/s]: from further away the rival finds hardly any optimum
CASES = ((10, 0.05), (40, 0.01))


def law(stages: int = 40) -> Controller:
    """The controller of problems/l1_predictive.toml without its observer: the programs are the same."""
    return controller(
        gt.robots.gantry_tau("l1_tape"), ControlHorizon(period=0.004, stages=stages, length=0.01, max_iterations=CAP),
        tolerances={"T": 1e-3, "der(T)": 0.5, "der(T,2)": 20.0}, targets={"T": [0.5, -0.9, 0.3]}, references=["T"],
        limits={"tau": (-700.0, 700.0), "der(q)": (-1.5, 1.5)},
    )  # fmt: skip


def drawn(c: Controller, count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """First state, data and last data of cold cycles, which plan from a state that stays."""
    rng, program, n = np.random.default_rng(seed), c.program, c.program.qp.stage.states
    problems = []
    for _ in range(count):
        T, goal = rng.uniform(LOW, HIGH), rng.uniform(LOW, HIGH)
        x = np.ravel(np.column_stack([T, rng.uniform(-1, 1, 3) * rng.choice(SPEEDS)]))
        data = np.asarray(program.prepare(x, c.first, np.zeros(0), goal, x).full())[:, 0]
        last = np.asarray(program.finish(x, np.zeros(0), goal).full())[:, 0]
        problems.append((np.zeros(n), np.tile(data, (program.qp.count, 1)), last, np.zeros(c.sides)))
    return problems


def cycles(c: Controller, count: int, seed: int) -> list[tuple[np.ndarray, ...]]:
    """The same of warm cycles, with the sides of the solution before, moved on: the model as plant, a goal that moves
    every half second."""
    rng, run, problems, program = np.random.default_rng(seed), CycleTwin(c), list[tuple[np.ndarray, ...]](), c.program
    state, inputs, outputs = (record_of(k, DOUBLE) for k in (c.state, c.inputs, c.outputs))
    solve = run.method.solve

    def noted(x: np.ndarray, p: np.ndarray, q: np.ndarray, start: Any) -> Any:
        if start is not None:
            problems.append((x, p.T, q[:, 0], np.concatenate([start[1].T.ravel(), start[2].ravel()])))
        return solve(x, p, q, start)

    run.method.solve = noted  # type: ignore[method-assign]
    x = np.ravel(np.column_stack([rng.uniform(LOW, HIGH), np.zeros(3)]))
    start = record_of(c.start, DOUBLE)
    start["x"] = x
    run.init(state, start)
    while len(problems) < count:
        if len(problems) % MOVED == 0:
            inputs[c.goals[0].identifier] = rng.uniform(LOW, HIGH)
        inputs["x"] = x
        if run.step(state, inputs, outputs) != Status.OK:
            raise RuntimeError("a cycle of the motion has no solution")
        v, goal = state["plan_v"][: program.qp.stage.inputs], inputs[c.goals[0].identifier]
        x = program.advance(x, v, np.zeros(0), goal).full()[:, 0]
    return problems


def matrices(qp: StageQP) -> tuple[ca.Function, ca.Function]:
    """What HPIPM takes of a stage and of the last one, soft rows first, and the constant of the cost."""
    made = []
    for s, names in ((qp.stage, "A B b Q S R q r"), (qp.last, "Q q")):
        order = sorted(range(len(s.rows)), key=lambda i, s=s: s.rows[i].price is None)
        low = {d.row: d.bound for d in s.sides if d.sign > 0}
        high = {d.row: -d.bound for d in s.sides if d.sign < 0}
        C, D = s.matrices["C"][order, :], s.matrices["D"][order, :]
        price = [p for i in order if (p := s.rows[i].price)]
        parts = [s.matrices[k] for k in names.split()] + [C, D]
        parts += [ca.vertcat(*[low[i] for i in order]), ca.vertcat(*[high[i] for i in order])]
        parts += [ca.DM([p[0] for p in price]), ca.DM([p[1] for p in price])]
        flat = ca.vertcat(*[ca.vec(ca.densify(ca.SX(M))) for M in parts])
        made.append(ca.Function("m", [s.data], [flat, s.matrices["constant"]]))
    return made[0], made[1]


def record(qp: StageQP, problems: list[Any], path: Path) -> None:
    """Write the problems as the C program reads them."""
    of, end = matrices(qp)
    with path.open("wb") as f:
        for x, data, last, start in problems:
            once, where = np.unique(data, axis=0, return_inverse=True)
            flat, constant = (v.full()[:, where.reshape(-1)] for v in of.map(len(once))(once.T))
            ending, more = end(last)
            np.concatenate([
                x, data.ravel(), last, [np.sum(constant) + float(more)], start, flat.ravel(order="F"),
                ending.full().ravel(),
            ]).astype(float).tofile(f)  # fmt: skip


def build(qp: StageQP, folder: Path) -> Path:
    """The C program with both solvers."""
    source = write(qp, folder, DOUBLE)
    wheel = Path(ca.__file__).parent
    stage, last = qp.stage, qp.last
    sizes = {
        "COUNT": qp.count, "STATES": stage.states, "INPUTS": stage.inputs, "ROWS": len(stage.rows),
        "SOFT": len(stage.soft) // 2, "LAST_ROWS": len(last.rows), "LAST_SOFT": len(last.soft) // 2,
        "NUMBERS": stage.numbers, "LAST_NUMBERS": last.numbers,
        "PRODUCTS": f"{(qp.count * stage.positives + last.positives) // 2}.0", "TOLERANCE": repr(qp.tolerance),
        "SIDES": qp.count * stage.positives + last.positives,
    }  # fmt: skip
    program = folder / "both"
    _run("gcc", *FLAGS, "-D_POSIX_C_SOURCE=200809L", f"-I{folder}", "-c", source, "-o", folder / "ours.o")
    _run(
        "gcc", "-std=gnu99", "-O2", f"-I{wheel}/include", *[f"-D{k}={v}" for k, v in sizes.items()], RIVAL,
        folder / "ours.o", f"-L{wheel}", f"-Wl,-rpath,{wheel}", "-Wl,-z,now", "-lhpipm", "-lblasfeo", "-lm", "-o",
        program,
    )  # fmt: skip
    return program


def of_size(folder: Path) -> None:
    """Print machine code and stack of the program beside their goals, and the code of HPIPM."""
    texts = []
    for level in ("-O2", "-Os"):
        file = folder / "size.o"
        _run("gcc", *FLAGS, level, "-fstack-usage", f"-I{folder}", "-c", folder / "gt_qp.c", "-o", file)
        rows = [line.split() for line in _run("nm", "-S", file).splitlines()]
        texts.append(sum(int(row[1], 16) for row in rows if len(row) == 4 and row[2] in "Tt") / 1e3)
    stack = sum(int(line.split("\t")[1]) for line in (folder / "size.su").read_text().splitlines()) / 1e3
    own, other = (size / 1e3 for size in text_of_hpipm())
    print(f"text {texts[0]:.1f} kB (goal {MOST_TEXT}), with -Os {texts[1]:.1f}; stack at most {stack:.0f} kB (goal "
          f"{MOST_STACK}); HPIPM may reach {own:.0f} kB, and {other:.0f} kB of BLASFEO")  # fmt: skip


def solved(program: Path, file: Path, repeats: int, mode: int, mu0: float, warm: int = 0) -> np.ndarray:
    """Iterations, status, cost, time of ours, then of HPIPM, a row for each problem."""
    text = _run(program, file, str(repeats), str(mode), str(mu0), str(warm))
    return np.array([[float(v) for v in line.split()] for line in text.splitlines()])


def instructions(program: Path, file: Path, mode: int, mu0: float, folder: Path, warm: int = 0) -> tuple[float, float]:
    """Mean instructions of a problem, of ours and of HPIPM."""
    log = folder / "callgrind.out"
    options = ("--compress-strings=no", "--compress-pos=no", "--dump-line=no", f"--callgrind-out-file={log}")
    _run("valgrind", "--tool=callgrind", *options, program, file, "1", str(mode), str(mu0), str(warm))
    edges = _edges(log.read_text())
    counts = []
    for callee in ("gt_qp_solve", "d_ocp_qp_ipm_solve"):
        calls, cost = edges["main", callee]
        counts.append(cost / calls)
    return counts[0], counts[1]


def by_number(qp: StageQP, problems: list[Any], folder: Path) -> tuple[float, float]:
    """a and b of instructions = a + b * iterations."""
    counts, iterations = [], []
    for k, problem in enumerate(problems):
        record(qp, [problem], folder / "one")
        program = folder / "both"
        counts.append(instructions(program, folder / "one", 1, 0.0, folder)[0])
        iterations.append(solved(program, folder / "one", 1, 1, 0.0)[0, 0])
        if k + 1 >= 6 and len(set(iterations)) > 2:
            break
    b, a = np.polyfit(iterations, counts, 1)
    return float(a), float(b)


def from_python(qp: StageQP, problems: list[Any], own: np.ndarray, folder: Path, *, warm: bool) -> None:
    """Print the times of ours over those of rivals that are called from Python; `own`: costs and times of ours."""
    inputs = qp.count * qp.stage.inputs
    free = inputs + qp.count * len(qp.stage.soft) + len(qp.last.soft)
    whole = [flat(qp, p[:3]) for p in problems]
    qrqp = ByQrqp(whole[0], folder / ("warm" if warm else "cold"), warm=warm)
    piqp = [by_piqp(f, TOLERANCE * (1 + abs(cost))) for f, cost in zip(whole, own[:, 0], strict=True)]
    rivals = {
        "PIQP, sparse": (piqp, "0.5"),
        "DAQP's C, condensed": (by_daqp(whole, own[:, 0], inputs, free, folder, warm=warm), "none"),
        "CasADi's C of qrqp": ([qrqp(f) for f in whole], "0.02"),
    }
    for name, (rows, goal) in rivals.items():
        found = np.array(rows)
        good = np.isfinite(found[:, 0])
        if not good.any():
            print(f"{name}: solved none of {len(whole)}, or is not installed")
            continue
        far = np.max(np.abs(own[good, 0] - found[good, 0]) / (1 + np.abs(found[good, 0])))
        ratio = np.median(own[good, 1] / found[good, 1])
        print(f"{name}: {good.sum()} of {len(whole)} solved, median {1e3 * np.median(found[good, 1]):.2f} ms; ours "
              f"over it {ratio:.4f} (goal {goal}); costs differ by at most {far:.1e}")  # fmt: skip


def of_drawn(c: Controller, program: Path, folder: Path, draws: int) -> None:
    """Print the iterations of many cold programs."""
    counted, failed = np.zeros(CAP + 1, int), 0
    for first in range(0, draws, CHUNK):
        record(c.program.qp, drawn(c, min(CHUNK, draws - first), 100 + first), folder / "draws")
        rows = solved(program, folder / "draws", 1, 1, 0.0)
        counted += np.bincount(rows[:, 0].astype(int), minlength=CAP + 1)
        failed += int(np.sum(rows[:, 1] != 0))
    numbers = ", ".join(f"{k}: {counted[k]}" for k in np.flatnonzero(counted))
    print(f"iterations of {draws} cold programs: {numbers}; without a solution: {failed}")


def beside_hpipm(program: Path, folder: Path, *, warm: bool) -> np.ndarray:
    """Print ours over HPIPM in its best mode and start. Returns the rows of the problems."""
    file, best = folder / "problems", tuple[float, int, float, int]()
    for mode in range(len(MODES)):
        for mu0 in STARTS:
            for kind in WARM if warm else (0,):
                rows = solved(program, file, 1, mode, mu0, kind)
                if np.all(rows[:, 5] == 0) and (not best or rows[:, 4].mean() < best[0]):
                    best = (float(rows[:, 4].mean()), mode, mu0, kind)
    if not best:
        print("HPIPM solved not all problems in any mode")
    mode, mu0, kind = best[1:] if best else (1, 0.0, int(warm))
    runs = [solved(program, file, 1, mode, mu0, kind) for _ in range(REPEATS)]
    rows = runs[0]
    for at in (3, 7):
        rows[:, at] = np.min([r[:, at] for r in runs], axis=0)
    own, other = instructions(program, file, mode, mu0, folder, kind)
    far = np.max(np.abs(rows[:, 2] - rows[:, 6]) / (1 + np.abs(rows[:, 6])))
    print(f"{'warm' if warm else 'cold'}: HPIPM {MODES[mode]}, mu0 {mu0 or 'own'}, warm_start {kind}: "
          f"{rows[:, 4].mean():.1f} iterations, ours {rows[:, 0].mean():.1f}; costs differ by at most "
          f"{far:.1e}")  # fmt: skip
    print(f"instructions {own / 1e6:.2f} / {other / 1e6:.2f} million = {own / other:.2f} (goal 1.0); time: median "
          f"{np.median(rows[:, 3] / rows[:, 7]):.2f}, worst {rows[:, 3].max() / rows[:, 7].max():.2f} (goal 1.5); ours "
          f"{1e3 * np.median(rows[:, 3]):.2f} ms, HPIPM {1e3 * np.median(rows[:, 7]):.2f} ms")  # fmt: skip
    return rows


def of_whole_problem(stages: int, near: float, folder: Path) -> None:
    """Print the time of the nonlinear problem beside the C that CasADi generates for `sqpmethod` with `qrqp`."""
    c, rng = law(stages), np.random.default_rng(1)
    folder.mkdir()
    ours, rival = Repeated(c, folder / "ours"), BySqpmethod(c, folder / "rival")
    judged, ratios, spent = _Problem(c, np.zeros((3, stages + 1)), np.zeros(0)), list[float](), list[float]()
    for _ in range(WHOLE):
        T = rng.uniform(LOW, HIGH)
        goal, x = T + near * rng.uniform(-1, 1, 3), np.ravel(np.column_stack([T, near * rng.uniform(-1, 1, 3)]))
        judged.p[:] = goal[:, None]
        own_x, own_v, programs, own = ours(x, goal)
        other_x, other_v, other = rival(x, goal)
        cost, found = (judged.value(a.T, b.T) for a, b in ((own_x, own_v), (other_x, other_v)))
        if programs and abs(found - cost) <= SAME * (1 + cost):
            ratios.append(other / own)
            spent.append(own)
        elif not programs or found < cost:
            print(f"ours did not find the optimum of the nonlinear problem: {cost:.8g}, rival {found:.8g}")
    middle = f"median {np.median(ratios):.0f}, least {min(ratios):.0f}" if ratios else "none"
    print(f"CasADi's C of sqpmethod with qrqp, {stages} stages, {near:g} m, cold: the same optimum in {len(ratios)} of "
          f"{WHOLE}; its time over ours: {middle} (goal 50); ours {1e3 * np.median(spent or [np.nan]):.2f} "
          "ms")  # fmt: skip


def main() -> int:
    """Print ratios and goals."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--problems", type=int, default=100)
    options.add_argument("--draws", type=int, default=2000)
    given = options.parse_args()
    if lacking := missing():
        print(f"Predictive control: {lacking}.")
        return 0
    for stages in (20, 80, 40):
        c = law(stages)
        qp = c.program.qp
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            program, problems = build(qp, folder), drawn(c, given.problems, 1)
            record(qp, problems, folder / "problems")
            a, b = by_number(qp, problems, folder)
            print(f"N = {stages}: {a / 1e6:.3f} + {b / 1e6:.4f} x iterations million instructions; with {CAP}: "
                  f"{(a + CAP * b) / 1e6:.2f}, goal for N = 40: {MOST / 1e6:.0f}")  # fmt: skip
            if stages == 40:
                of_size(folder)
                of_drawn(c, program, folder, given.draws)
                rows = beside_hpipm(program, folder, warm=False)
                from_python(qp, problems[:RIVALS], rows[:RIVALS, 2:4], folder, warm=False)
                problems = cycles(c, given.problems, 2)
                record(qp, problems, folder / "problems")
                rows = beside_hpipm(program, folder, warm=True)
                from_python(qp, problems[:RIVALS], rows[:RIVALS, 2:4], folder, warm=True)
                for whole, near in CASES:
                    of_whole_problem(whole, near, folder / f"whole_{whole}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
