"""Rivals of the program of one cycle: PIQP, DAQP in its own C on the inputs alone, CasADi's C of `qrqp`.

Each takes what `flat` returns and gives cost, and CPU time [s]; the cost is NaN where it found no solution.
"""

from __future__ import annotations

import importlib
import os
import re
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse

from gtmodel.predictive import StageQP
from tests.bench.callgrind import _run

TOLERANCE = 1e-6  # of ControlHorizon
SCALE = 1e-3  # of the cost for `qrqp`, whose tolerances are absolute
SOURCE = Path(__file__).parent / "condensed_qp.c"
BEYOND = 1e-5  # of a row of an accepted solution, relative to its limit
Found = tuple[float, float]


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


def text_of_hpipm(root: str = "d_ocp_qp_ipm_solve") -> tuple[int, int]:
    """Machine code of HPIPM and of BLASFEO that a call of `root` may reach, function by function."""
    wheel, sizes, calls = Path(ca.__file__).parent, dict[str, int](), dict[str, set[str]]()
    for library in ("libhpipm.so", "libblasfeo.so"):
        for line in _run("nm", "-S", "--defined-only", wheel / library).splitlines():
            match line.split():
                case [_, size, "T" | "t" | "W" | "w", name]:
                    sizes[name] = int(size, 16)
        now = ""
        for line in _run("objdump", "-d", "--no-show-raw-insn", wheel / library).splitlines():
            if head := re.match(r"[0-9a-f]+ <([^>]+)>:", line):
                now = head[1]
            elif to := re.search(r"\b(?:call|j\w+|lea)\s.*<([^>+@]+)", line):
                calls.setdefault(now, set()).add(to[1])
    seen, ahead = set[str](), [root]
    while ahead:
        name = ahead.pop()
        if name in sizes and name not in seen:
            seen.add(name)
            ahead += calls.get(name, ())
    own = sum(sizes[name] for name in seen if name.startswith("d_"))
    return own, sum(sizes[name] for name in seen) - own


def by_piqp(f: dict[str, Any], allowed: float) -> Found:
    """Interior point in C++, sparse, without its set-up; it has no warm start."""
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


def compiled(f: ca.Function, folder: Path) -> ca.Function:
    """The function in the C that CasADi generates for it, in a new folder."""
    folder.mkdir()
    here = Path.cwd()
    try:
        os.chdir(folder)
        f.generate("rival.c")
    finally:
        os.chdir(here)
    _run("gcc", "-O2", "-shared", "-fPIC", folder / "rival.c", "-o", folder / "rival.so", "-lm")
    return ca.external(f.name(), str(folder / "rival.so"))


class ByQrqp:
    """The C that CasADi generates for `qrqp`; `warm`: from the solution and the multipliers of the problem before."""

    def __init__(self, f: dict[str, Any], folder: Path, *, warm: bool) -> None:
        H, A = self._matrices(f)
        options = {
            "error_on_fail": False, "print_iter": False, "print_header": False, "max_iter": 5000,
            "dual_inf_tol": TOLERANCE,
        }  # fmt: skip
        solver = ca.conic("rival", "qrqp", {"h": H.sparsity(), "a": A.sparsity()}, options)
        symbols = [ca.MX.sym(name, solver.sparsity_in(name)) for name in solver.name_in()]
        whole = ca.Function("whole", symbols, list(solver.call(symbols)), solver.name_in(), solver.name_out())
        self.solver = compiled(whole, folder)
        self.warm, self.start = warm, dict[str, Any]()
        self.H, self.A = H.sparsity(), A.sparsity()

    def _matrices(self, f: dict[str, Any]) -> tuple[Any, Any]:
        A = scipy.sparse.vstack([scipy.sparse.csc_matrix(f[k]) for k in ("A", "G")]).tocsc()
        return SCALE * ca.DM(scipy.sparse.csc_matrix(f["P"])), ca.DM(A)

    def __call__(self, f: dict[str, Any]) -> Found:
        H, A = (ca.project(M, of) for M, of in zip(self._matrices(f), (self.H, self.A), strict=True))
        low, high = np.append(f["b"], np.full(len(f["h"]), -np.inf)), np.append(f["b"], f["h"])
        begun = time.process_time()
        try:
            o = self.solver(
                h=H, g=SCALE * f["c"], a=A, lba=low, uba=high, lbx=-np.inf, ubx=np.inf, **self.start
            )  # fmt: skip
        except RuntimeError:  # generated code that found no solution
            self.start = {}
            return np.nan, np.nan
        spent = time.process_time() - begun
        if self.warm:
            self.start = {"x0": 0.0 * o["x"], "lam_x0": o["lam_x"], "lam_a0": o["lam_a"]}
        good = float(np.max(f["G"] @ o["x"].full()[:, 0] - f["h"])) < BEYOND
        return (float(o["cost"]) / SCALE + f["constant"] if good else np.nan), spent


def by_daqp(
    given: list[dict[str, Any]], costs: np.ndarray, inputs: int, free: int, folder: Path, *, warm: bool
) -> list[Found]:
    """DAQP's C from CasADi's wheel (libdaqp, its headers), factorisation and solution; condensing is not counted.

    First with all limits exact, in the inputs alone; where these exclude each other or cost more than `costs`, with an
    excess for each soft limit. `warm`: from the active set of the problem before. The solutions must keep the limits.
    """
    wheel, program = Path(ca.__file__).parent, folder / "daqp"
    _run("gcc", "-D_POSIX_C_SOURCE=200809L", "-std=gnu99", "-O2", f"-I{wheel}/include", SOURCE, f"-L{wheel}",
         f"-Wl,-rpath,{wheel}", "-ldaqp", "-lm", "-o", program)  # fmt: skip
    found = [(np.nan, np.nan)] * len(given)
    for exact in (True, False):
        chosen = [k for k, one in enumerate(found) if not np.isfinite(one[0])]
        small = [condensed(given[k], free) for k in chosen]
        with (folder / "small").open("wb") as file:
            for c in small:
                _written(c, inputs, free, exact).tofile(file)
        lines = _run(program, folder / "small", str(int(warm))).splitlines() if chosen else []
        for k, c, line in zip(chosen, small, lines, strict=True):
            status, _, _, spent, _, *z = (float(v) for v in line.split())
            z = [*z, *np.zeros(free - inputs)] if exact else [*z[free - inputs :], *z[: free - inputs]]
            cost = float(np.dot(z, c["P"] @ z) / 2 + np.dot(c["c"], z) + c["constant"])
            dear = exact and cost - costs[k] > TOLERANCE * (1 + abs(costs[k]))
            if status == 1 and np.max(c["G"] @ z - c["h"]) < BEYOND and not dear:
                found[k] = (cost, spent)
    return found


def _written(c: dict[str, Any], inputs: int, free: int, exact: bool) -> np.ndarray:
    """As condensed_qp.c reads it: excesses first, whose limits are bounds; rows of both signs are one row."""
    order = np.arange(inputs) if exact else np.r_[inputs:free, :inputs]
    simple = 0 if exact else free - inputs
    of_excess = ~np.any(c["G"][:, :inputs], axis=1)
    G, h = c["G"][~of_excess][:, order], c["h"][~of_excess]
    low, kept = np.full(len(h), -1e30), np.ones(len(h), bool)
    for i in range(1, len(h)):
        if np.array_equal(G[i], -G[i - 1]) and kept[i - 1]:
            low[i], kept[i - 1] = -h[i - 1], False
    parts = [c["P"][np.ix_(order, order)], c["c"][order], G[kept], np.full(simple, 1e30), h[kept],
             np.zeros(simple), low[kept]]  # fmt: skip
    return np.concatenate([[len(order), simple + kept.sum(), simple], *[p.ravel() for p in parts]])
