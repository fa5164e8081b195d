"""Predictive control of the L1 in C beside its goals, and its programs beside HPIPM, PIQP, DAQP and CasADi's `qrqp`.

OMP_NUM_THREADS=1 python -m tests.bench.bench_predictive [--problems 100] [--draws 100000]

- Instructions of a program by callgrind, as a + b * iterations; iterations of drawn cold cycles, counted natively.
- The same programs, cold, to the same tolerance, in turn in one C program: HPIPM from CasADi's wheel (BLASFEO of the
  wheel). PIQP, DAQP and the C that CasADi generates for `qrqp` are called from
  Python.
Cold cycles: position and goal anywhere in a box of 0.9 x 0.4 x 0.5 m, speeds up to 1.5 m/s, no rest at the end needed.
"""

from __future__ import annotations

import argparse
import importlib
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse

import gtmodel as gt
from gtmodel.cgen.real import DOUBLE
from gtmodel.predictive import ControlHorizon, Controller, StageQP, controller
from tests.bench.callgrind import _edges, _run, missing
from tests.predictive.compiled import FLAGS, write

RIVAL = Path(__file__).parent / "rivals" / "horizon_qp.c"
LOW, HIGH = np.array([0.1, -1.1, 0.1]), np.array([1.0, -0.7, 0.6])
SPEEDS = (0.0, 0.5, 1.0, 1.5)  # m/s
MOST = 6e6  # instructions of the longest cycle
MODES = ("SPEED_ABS", "SPEED", "BALANCE", "ROBUST")
STARTS = (0.0, 1e2, 1e4)  # mu0 of HPIPM; 0: its own
CAP = 20  # iterations, of problems/l1_predictive.toml
TOLERANCE = 1e-6  # of ControlHorizon
CHUNK = 1000  # problems in one file
RIVALS = 10  # problems for rivals called from Python


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
        problems.append((np.zeros(n), np.tile(data, (program.qp.count, 1)), last))
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
        for x, data, last in problems:
            once, where = np.unique(data, axis=0, return_inverse=True)
            flat, constant = (v.full()[:, where.reshape(-1)] for v in of.map(len(once))(once.T))
            ending, more = end(last)
            np.concatenate([
                x, data.ravel(), last, [np.sum(constant) + float(more)], flat.ravel(order="F"),
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
    }  # fmt: skip
    program = folder / "both"
    _run("gcc", *FLAGS, "-D_POSIX_C_SOURCE=200809L", f"-I{folder}", "-c", source, "-o", folder / "ours.o")
    _run(
        "gcc", "-std=gnu99", "-O2", f"-I{wheel}/include", *[f"-D{k}={v}" for k, v in sizes.items()], RIVAL,
        folder / "ours.o", f"-L{wheel}", f"-Wl,-rpath,{wheel}", "-Wl,-z,now", "-lhpipm", "-lblasfeo", "-lm", "-o",
        program,
    )  # fmt: skip
    return program


def solved(program: Path, file: Path, repeats: int, mode: int, mu0: float) -> np.ndarray:
    """Iterations, status, cost, time of ours, then of HPIPM, a row for each problem."""
    text = _run(program, file, str(repeats), str(mode), str(mu0))
    return np.array([[float(v) for v in line.split()] for line in text.splitlines()])


def instructions(program: Path, file: Path, mode: int, mu0: float, folder: Path) -> tuple[float, float]:
    """Mean instructions of a problem, of ours and of HPIPM."""
    log = folder / "callgrind.out"
    options = ("--compress-strings=no", "--compress-pos=no", "--dump-line=no", f"--callgrind-out-file={log}")
    _run("valgrind", "--tool=callgrind", *options, program, file, "1", str(mode), str(mu0))
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


def flat(qp: StageQP, problem: Any) -> dict[str, Any]:
    """P, c, A, b, G, h, constant of: least z'Pz/2 + c'z + constant, A z = b, G z <= h; z: inputs, excesses, states."""
    x, data, last = problem
    n, m, count = qp.stage.states, qp.stage.inputs, qp.count
    names = ("A", "B", "b", "Q", "S", "R", "q", "r", "C", "D", "constant")
    stages = [qp.stage] * count + [qp.last]
    own = [ca.Function("m", [s.data], [ca.densify(ca.SX(v)) for v in (*[s.matrices[k] for k in names],
           ca.vertcat(*[d.bound for d in s.sides]))]) for s in (qp.stage, qp.last)]  # fmt: skip
    soft = np.cumsum([0, *[len(s.soft) for s in stages]])
    at_x = m * count + soft[-1]
    size = at_x + n * (count + 1)
    P, c, constant = scipy.sparse.lil_matrix((size, size)), np.zeros(size), 0.0
    A, b = scipy.sparse.lil_matrix((n * (count + 1), size)), np.zeros(n * (count + 1))
    G, h = scipy.sparse.lil_matrix((sum(len(s.sides) + len(s.soft) for s in stages), size)), list[float]()
    A[:n, at_x : at_x + n], b[:n] = np.eye(n), x
    for k, s in enumerate(stages):
        values = own[k == count](data[k] if k < count else last)
        M = {name: v.full() for name, v in zip((*names, "bound"), values, strict=True)}
        at_u, at, after = m * k, at_x + n * k, at_x + n * (k + 1)
        P[at:after, at:after], c[at:after] = M["Q"], M["q"][:, 0]
        constant += float(M["constant"].item())
        if k < count:
            P[at_u : at_u + m, at_u : at_u + m], P[at_u : at_u + m, at:after] = M["R"], M["S"]
            P[at:after, at_u : at_u + m], c[at_u : at_u + m] = M["S"].T, M["r"].reshape(-1)
            rows = slice(n * (k + 1), n * (k + 2))
            A[rows, at:after], A[rows, at_u : at_u + m], b[rows] = -M["A"], -M["B"], M["b"][:, 0]
            A[rows, after : after + n] = np.eye(n)
        e = m * count + soft[k]
        for d, bound in zip(s.sides, M["bound"][:, 0], strict=True):
            i = len(h)
            G[i, at:after] = -d.sign * M["C"][d.row]
            if k < count:
                G[i, at_u : at_u + m] = -d.sign * M["D"][d.row]
            h.append(-bound)
            if d.price is not None:
                G[i, e] = G[i + 1, e] = -1.0
                h.append(0.0)
                c[e], P[e, e] = d.price
                e += 1
    return {"P": P.tocsc(), "c": c, "A": A.tocsc(), "b": b, "G": G.tocsc(), "h": np.array(h), "constant": constant}


def condensed(f: dict[str, Any], free: int) -> dict[str, Any]:
    """The same in the first `free` unknowns: the states follow from the inputs."""
    A = f["A"].toarray()
    Z = np.vstack([np.eye(free), -np.linalg.solve(A[:, free:], A[:, :free])])
    z = np.append(np.zeros(free), np.linalg.solve(A[:, free:], f["b"]))
    P, G = f["P"].toarray(), f["G"].toarray()
    constant = f["constant"] + f["c"] @ z + z @ P @ z / 2
    return {"P": Z.T @ P @ Z, "c": Z.T @ (f["c"] + P @ z), "G": G @ Z, "h": f["h"] - G @ z, "constant": constant}


def by_piqp(f: dict[str, Any], allowed: float) -> tuple[float, float]:
    """Cost, and time of the call."""
    try:
        piqp: Any = importlib.import_module("piqp")
    except ImportError:
        return np.nan, np.nan
    solver = piqp.SparseSolver()
    solver.settings.eps_abs, solver.settings.eps_rel, solver.settings.check_duality_gap = TOLERANCE, 0.0, True
    solver.settings.eps_duality_gap_abs, solver.settings.eps_duality_gap_rel = allowed, 0.0
    solver.setup(f["P"], f["c"], f["A"], f["b"], f["G"], None, f["h"])
    begun = time.process_time()
    status = solver.solve()
    spent = time.process_time() - begun
    return (solver.result.info.primal_obj + f["constant"] if status == piqp.PIQP_SOLVED else np.nan), spent


def by_casadi(f: dict[str, Any], plugin: str, folder: Path | None) -> tuple[float, float]:
    """Cost, and time of the call of a plugin of CasADi; with a folder, of its generated C."""
    rows = [scipy.sparse.csc_matrix(f[k]) for k in ("A", "G") if k in f]
    H, A = ca.DM(scipy.sparse.csc_matrix(f["P"])), ca.DM(scipy.sparse.vstack(rows).tocsc())
    high = np.concatenate([f[k] for k in ("b", "h") if k in f])
    low = np.concatenate([f.get("b", np.zeros(0)), np.full(len(f["h"]), -np.inf)])
    options = {"error_on_fail": False} | (
        {"print_iter": False, "print_header": False, "max_iter": 5000} if plugin == "qrqp" else {}
    )
    solver = ca.conic("rival", plugin, {"h": H.sparsity(), "a": A.sparsity()}, options)
    if folder is not None:
        symbols = [ca.MX.sym(name, solver.sparsity_in(name)) for name in solver.name_in()]
        whole = ca.Function("whole", symbols, list(solver.call(symbols)), solver.name_in(), solver.name_out())
        here = Path.cwd()
        try:
            os.chdir(folder)
            whole.generate("rival.c")
        finally:
            os.chdir(here)
        _run("gcc", "-O2", "-shared", "-fPIC", folder / "rival.c", "-o", folder / "rival.so", "-lm")
        solver = ca.external("whole", str(folder / "rival.so"))
    begun = time.process_time()
    try:
        o = solver(h=H, g=f["c"], a=A, lba=low, uba=high, lbx=-np.inf, ubx=np.inf)
    except RuntimeError:  # generated code that found no solution
        return np.nan, np.nan
    spent = time.process_time() - begun
    good = float(np.max(f["G"] @ o["x"].full()[:, 0] - f["h"])) < 1e-5
    return (float(o["cost"]) + f["constant"] if good else np.nan), spent


def from_python(qp: StageQP, problems: list[Any], rows: np.ndarray, folder: Path) -> None:
    """Rivals that are called from Python."""
    free = qp.count * qp.stage.inputs + qp.count * len(qp.stage.soft) + len(qp.last.soft)
    whole = [flat(qp, p) for p in problems]
    small = [condensed(f, free) for f in whole]
    rivals: dict[str, tuple[list[Any], Any, str]] = {
        "PIQP": (whole, lambda f, cost: by_piqp(f, TOLERANCE * (1 + abs(cost))), "0.5"),
        "CasADi's C of qrqp": (whole, lambda f, cost: by_casadi(f, "qrqp", folder), "0.02"),
        "DAQP, condensed, through CasADi": (small, lambda f, cost: by_casadi(f, "daqp", None), "none"),
    }
    for name, (given, solve, goal) in rivals.items():
        found = np.array([solve(f, cost) for f, cost in zip(given, rows[:, 2], strict=True)])
        good = np.isfinite(found[:, 0])
        if not good.any():
            print(f"{name}: solved none of {len(given)}, or is not installed")
            continue
        far = np.max(np.abs(rows[good, 2] - found[good, 0]) / (1 + np.abs(found[good, 0])))
        ratio = np.median(rows[good, 3] / found[good, 1])
        print(f"{name}: {good.sum()} of {len(given)} solved, median {1e3 * np.median(found[good, 1]):.2f} ms; ours "
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


def beside_hpipm(program: Path, folder: Path) -> np.ndarray:
    """Print ours over HPIPM in its best mode and start. Returns the rows of the problems."""
    best: tuple[float, int, float] | None = None
    for mode in range(len(MODES)):
        for mu0 in STARTS:
            rows = solved(program, folder / "problems", 1, mode, mu0)
            if np.all(rows[:, 5] == 0) and (best is None or rows[:, 4].mean() < best[0]):
                best = (float(rows[:, 4].mean()), mode, mu0)
    if best is None:
        print("HPIPM solved not all problems in any mode")
    mode, mu0 = best[1:] if best else (1, 0.0)
    rows = solved(program, folder / "problems", 5, mode, mu0)
    own, other = instructions(program, folder / "problems", mode, mu0, folder)
    far = np.max(np.abs(rows[:, 2] - rows[:, 6]) / (1 + np.abs(rows[:, 6])))
    print(f"HPIPM {MODES[mode]}, mu0 {mu0 or 'own'}: {rows[:, 4].mean():.1f} iterations, ours {rows[:, 0].mean():.1f}; "
          f"costs differ by at most {far:.1e}")  # fmt: skip
    print(f"instructions {own / 1e6:.2f} / {other / 1e6:.2f} million = {own / other:.2f} (goal 1.0); time: median "
          f"{np.median(rows[:, 3] / rows[:, 7]):.2f}, worst {rows[:, 3].max() / rows[:, 7].max():.2f} (goal 1.5); ours "
          f"{1e3 * np.median(rows[:, 3]):.2f} ms, HPIPM {1e3 * np.median(rows[:, 7]):.2f} ms")  # fmt: skip
    return rows


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
                of_drawn(c, program, folder, given.draws)
                rows = beside_hpipm(program, folder)
                from_python(qp, problems[:RIVALS], rows[:RIVALS], folder)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
