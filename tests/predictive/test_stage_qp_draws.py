"""Drawn quadratic programs of a horizon in compiled C, double and float: PIQP's cost, and conditions of optimality that
NumPy judges from the drawn matrices. What has no solution, or no sense, is never OK."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from gtmodel import Status
from gtmodel.cgen.real import DOUBLE, FLOAT
from gtmodel.predictive import HorizonStage, LimitedRow, StageQP
from tests.predictive.compiled import CompiledQP, Found
from tests.predictive.test_stage_qp import best

SX = ca.SX
COST = {"double": 1e-7, "float": 1e-3}  # relative to 1 + |cost|
KKT = {"double": 1e-6, "float": 2e-2}  # of the conditions of optimality, each relative to its typical size
# share of the problems with a solution that end with a status instead: in float a row of several inputs with a weight
# of 1e7 hides the cost of the others
UNSOLVED = {"double": 0.0, "float": 5e-3}
FEASIBLE = {"double": 1e-6, "float": 1e-3}  # of the inputs, relative to 1 + the size of the limit
MAX_ITERATIONS = 40
SOFT = (30.0, 2.0)
MANY = 10_000
SHAPES = [(2, 1, 6), (4, 2, 8), (3, 3, 5), (6, 3, 10), (1, 1, 20)]  # states, inputs, stages


@dataclass(frozen=True)
class Draw:
    """Numbers of one problem; H: Hessian of state and input, C: rows, the first `hard` of them exact."""

    A: np.ndarray
    B: np.ndarray
    b: np.ndarray
    H: np.ndarray
    g: np.ndarray
    C: np.ndarray
    low: np.ndarray
    high: np.ndarray
    x: np.ndarray

    @property
    def data(self) -> np.ndarray:
        return np.concatenate(
            [v.ravel() for v in (self.A, self.B, self.b, self.H, self.g, self.C, self.low, self.high)]
        )


def program(n: int, m: int, count: int) -> StageQP:
    """All numbers are data: limits of each input, one exact row of state and input, one soft row."""
    x, u = SX.sym("x", n), SX.sym("u", m)
    A, B, b, H, g, C, low, high = (
        SX.sym(name, *shape)
        for name, shape in (
            ("A", (n, n)), ("B", (n, m)), ("b", (n,)), ("H", (n + m, n + m)), ("g", (n + m,)), ("C", (2, n + m)),
            ("low", (m + 2,)), ("high", (m + 2,)),
        )
    )  # fmt: skip
    # NumPy lists a matrix by rows
    data = ca.vertcat(*[ca.vec(M.T) for M in (A, B, b, H, g, C, low, high)])
    z = ca.vertcat(x, u)
    rows = [LimitedRow(u[i], low[i], high[i]) for i in range(m)]
    rows += [LimitedRow(ca.mtimes(C[0, :], z), low[m], high[m])]
    rows += [LimitedRow(ca.mtimes(C[1, :], z), low[m + 1], high[m + 1], SOFT)]
    cost = ca.dot(z, ca.mtimes(H, z)) / 2 + ca.dot(g, z)
    stage = HorizonStage(x, u, data, ca.mtimes(A, x) + ca.mtimes(B, u) + b, cost, rows)
    last = HorizonStage(x, None, SX(0, 1), None, ca.sumsqr(x) / 2)
    return StageQP(stage, count, last, max_iterations=MAX_ITERATIONS)


def drawn(rng: np.random.Generator, n: int, m: int) -> Draw:
    """A strictly convex problem; the width of the limits decides how many inputs are at one."""
    A, B = 0.9 * np.eye(n) + 0.3 * rng.normal(size=(n, n)) / np.sqrt(n), rng.normal(size=(n, m))
    half = rng.normal(size=(n + m, n + m))
    wide = 10 ** rng.uniform(-2.5, 0.7)
    centre = 0.3 * wide * rng.normal(size=m)
    beyond = rng.uniform(1.0, 4.0)
    return Draw(
        A, B, 0.1 * rng.normal(size=n), half.T @ half / (n + m) + 0.01 * np.eye(n + m), rng.normal(size=n + m),
        np.vstack([np.append(0.05 * rng.normal(size=n), rng.normal(size=m)), rng.normal(size=n + m)]),
        np.append(centre - wide, [-beyond * wide, -1.0]), np.append(centre + wide, [beyond * wide, 1.0]),
        rng.normal(size=n) * 10 ** rng.uniform(-1, 0.5),
    )  # fmt: skip


def flat(d: Draw, count: int) -> tuple[np.ndarray, ...]:
    """H, c, A, b, G, h, 0 of: least z'Hz/2 + c'z with A z = b, G z <= h; z: states, inputs, excesses."""
    n, m = d.B.shape
    at_u, at_e = n * (count + 1), n * (count + 1) + m * count
    size = at_e + 2 * count
    H, c = np.zeros((size, size)), np.zeros(size)
    A, b = np.zeros((at_u, size)), np.zeros(at_u)
    A[:at_u, :at_u], b[:n] = np.eye(at_u), d.x
    G, h = list[np.ndarray](), list[float]()
    for k in range(count):
        own = np.r_[n * k : n * (k + 1), at_u + m * k : at_u + m * (k + 1)]
        H[np.ix_(own, own)] += d.H
        c[own] += d.g
        A[n * (k + 1) : n * (k + 2), own] = -np.hstack([d.A, d.B])
        b[n * (k + 1) : n * (k + 2)] = d.b
        for i, row in enumerate(np.vstack([np.eye(m, n + m, n), d.C])):
            for j, (sign, bound) in enumerate(((-1, -d.low[i]), (1, d.high[i]))):
                limit = np.zeros(size)
                limit[own] = sign * row
                if i == m + 1:
                    e = at_e + 2 * k + j
                    limit[e], c[e], H[e, e] = -1.0, *SOFT
                    G.append(-np.eye(1, size, e)[0])
                    h.append(0.0)
                G.append(limit)
                h.append(bound)
    H[n * count : at_u, n * count : at_u] += np.eye(n)
    return H, c, A, b, np.array(G), np.array(h), np.array(0.0)


def judge(d: Draw, count: int, o: Found, most: float) -> None:
    """Conditions of Karush, Kuhn and Tucker from the drawn matrices and the multipliers of the solution."""
    n, m = d.B.shape
    rows = np.vstack([np.eye(m, n + m, n), d.C])
    sides = o.sides[: count * (4 * (m + 2) + 4)].reshape(count, -1).astype(float)
    limits = 2 * (m + 2)
    l, e, v = sides[:, limits : 2 * limits], sides[:, 2 * limits : 2 * limits + 2], sides[:, 2 * limits + 2 :]
    size = 1 + np.abs(l).max() + abs(o.cost)
    after, x, u = o.x[count].astype(float), o.x.astype(float), o.u.astype(float)
    for k in reversed(range(count)):  # the multipliers of the dynamics follow from the states' conditions
        z, own = np.append(x[k], u[k]), rows @ np.append(x[k], u[k])
        slope = d.H @ z + d.g + np.hstack([d.A, d.B]).T @ after + rows.T @ (l[k, 1::2] - l[k, ::2])
        assert np.abs(slope[n:]).max() <= most * size
        after = slope[:n]
        assert np.abs(x[k + 1] - (d.A @ x[k] + d.B @ u[k] + d.b)).max() <= most * (1 + np.abs(x[k + 1]).max())
        assert np.abs(SOFT[0] + SOFT[1] * e[k] - l[k, -2:] - v[k]).max() <= most * size
        lacks = np.column_stack([d.low - own, own - d.high]).ravel()
        lacks[-2:] -= e[k]
        assert lacks.max() <= most
        assert np.all(l[k] >= 0) and np.all(e[k] >= 0) and np.all(v[k] >= 0)
        assert np.abs(lacks * l[k]).max() <= most * size and (e[k] * v[k]).max() <= most * size
    assert np.array_equal(o.x[0], d.x.astype(o.x.dtype))


def share(d: Draw, o: Found) -> float:
    """Share of the inputs' freedoms at a limit."""
    wide = (d.high - d.low)[: len(o.u[0])]
    near = np.minimum(o.u - d.low[: len(wide)], d.high[: len(wide)] - o.u)
    return float(np.mean(near < 1e-4 * wide))


def compared(shape: tuple[int, int, int], draws: int, seed: int, folder: Path) -> list[float]:
    """Draw and compare. Returns the shares at a limit of the problems with a solution."""
    n, m, count = shape
    qp = program(n, m, count)
    solvers = {real.name: CompiledQP(qp, folder / real.name, real) for real in (DOUBLE, FLOAT)}
    shares, unsolved, rng = list[float](), dict.fromkeys(solvers, 0), np.random.default_rng([seed, *shape])
    for _ in range(draws):
        d = drawn(rng, n, m)
        expected, data = best(flat(d, count)), np.tile(d.data, count)
        found = {name: s.solve(d.x, data, ()) for name, s in solvers.items()}
        if expected is None:
            assert all(o.status != Status.OK for o in found.values())
            continue
        for name, o in found.items():
            if o.status != Status.OK:
                unsolved[name] += 1
                continue
            assert abs(o.cost - expected) <= COST[name] * (1 + abs(expected)), (name, o.cost, expected)
            judge(d, count, o, KKT[name])
        shares.append(share(d, found["double"]))
    assert all(unsolved[name] <= most * draws for name, most in UNSOLVED.items()), unsolved
    return shares


needs_gcc = pytest.mark.skipif(CompiledQP.missing() is not None, reason=str(CompiledQP.missing()))


@needs_gcc
def test_drawn_problems_in_c_have_the_cost_of_piqp_and_meet_the_conditions_of_optimality(tmp_path: Path) -> None:
    shares = compared((2, 1, 6), 40, 3, tmp_path)
    assert min(shares) == 0.0 and max(shares) > 0.6


@needs_gcc
@pytest.mark.proof
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_many_drawn_problems_in_c(shape: tuple[int, int, int], tmp_path: Path) -> None:
    shares = np.array(compared(shape, MANY // len(SHAPES), 4, tmp_path))
    assert len(shares) > 0.5 * MANY / len(SHAPES)
    assert shares.min() == 0.0 and shares.max() >= 0.9


STRICT = ("-std=c99", "-ffp-contract=off")


@needs_gcc
@pytest.mark.parametrize(
    ("real", "draws"),
    [(DOUBLE, 60), *[pytest.param(real, 5000, marks=pytest.mark.proof) for real in (DOUBLE, FLOAT)]],
)
@pytest.mark.parametrize("compiler", ["gcc -O3", "clang -O2"])
def test_compilers_agree_bit_for_bit(compiler: str, real: Any, draws: int, tmp_path: Path) -> None:
    name, level = compiler.split()
    if shutil.which(name) is None:
        pytest.skip(f"there is no {name} on this machine: install the package {name}")
    n, m, count = 2, 1, 6
    qp, rng = program(n, m, count), np.random.default_rng(6)
    ours = CompiledQP(qp, tmp_path / "a", real)
    other = CompiledQP(qp, tmp_path / "b", real, name, (*STRICT, level))
    start = None
    for _ in range(draws):
        d = drawn(rng, n, m)
        a, b = (s.solve(d.x, np.tile(d.data, count), (), start) for s in (ours, other))
        assert (a.status, a.iterations) == (b.status, b.iterations)
        assert all(np.array_equal(v, w, equal_nan=True) for v, w in ((a.x, b.x), (a.u, b.u)))
        start = None
        if a.status == Status.OK:  # else there are no sides
            assert np.array_equal(a.sides, b.sides)
            start = a.sides if rng.random() < 0.5 else None


def absurd(rng: np.random.Generator, d: Draw) -> dict[str, Any]:
    """The problem, spoilt in one place."""
    values = {name: np.array(getattr(d, name)) for name in Draw.__dataclass_fields__}
    number = rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e160, 1e30, 5e-324])
    spoilt = values[rng.choice(list(values))]
    spoilt.flat[rng.integers(spoilt.size)] = number
    values["H"] = (values["H"] + values["H"].T) / 2
    return values


@needs_gcc
@pytest.mark.parametrize(
    ("real", "draws"),
    [(DOUBLE, 150), *[pytest.param(real, 20_000, marks=pytest.mark.proof) for real in (DOUBLE, FLOAT)]],
)
def test_what_has_no_sense_or_no_solution_is_never_ok(real: Any, draws: int, tmp_path: Path) -> None:
    n, m, count = 2, 1, 6
    solver, rng, refused = CompiledQP(program(n, m, count), tmp_path, real), np.random.default_rng(5), 0
    beyond = FEASIBLE[real.name]
    for k in range(draws):
        d = drawn(rng, n, m)
        if k % 3 == 0:
            d = Draw(**absurd(rng, d))
        elif k % 3 == 1:  # limits that exclude each other
            d.low[: m + 1] = d.high[: m + 1] + 10 ** rng.uniform(-3, 2)
        else:  # an input without weight, or with a negative one
            d.H[n:, :], d.H[:, n:], d.B[:] = 0.0, 0.0, 0.0
            d.H[n, n] = -rng.choice([0.0, 10 ** rng.uniform(-6, 6)])
            d.low[:], d.high[:] = -1e6, 1e6
        o = solver.solve(d.x, np.tile(d.data, count), ())
        if o.status == Status.OK and k % 3 == 0:  # a number that is finite and harmless
            assert np.all(np.isfinite(d.data)) and np.all(np.isfinite(o.x))
            assert np.all(o.u >= d.low[:m] - beyond * (1 + np.abs(d.low[:m])))
            assert np.all(o.u <= d.high[:m] + beyond * (1 + np.abs(d.high[:m])))
        else:
            assert o.status != Status.OK or (k % 3 == 2 and d.H[n, n] == 0.0), (k, o)
            refused += o.status != Status.OK
    assert refused > 0.6 * draws
