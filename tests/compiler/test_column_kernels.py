"""Functions on columns of many rows: the bits of CasADi's virtual machine, and the statuses of `status_codes`."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler import newton, rows, toolchain
from gtmodel.compiler.columns import kernel as kept, machine
from gtmodel.compiler.columns.kernel import BLOCK, PIECE, ColumnKernel
from gtmodel.compiler.columns.program import LIBM, program_of
from gtmodel.compiler.rows import map_columns
from gtmodel.results.status import Status

HOSTILE = np.array([
    0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, -5e-324, 1e-310, -2.2e-308, 1.7e308, -1.7e308, 1e22, -1e22,
    709.9, -745.3, 0.5, -0.5, 2.0, 3.0, np.pi, -np.pi / 2, 1e-8, 1 + 2**-52, 2.0**53, -(2.0**63), 123456.789,
])  # fmt: skip
UNARY = [
    ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.sinh, ca.cosh, ca.tanh, ca.exp, ca.log, ca.sqrt, ca.fabs,
    ca.floor, ca.ceil, ca.sign, ca.logic_not, lambda x: -x, lambda x: x * x, lambda x: x + x, lambda x: 1 / x,
    lambda x: x**2.5, lambda x: 2.5**x, lambda x: x**3, lambda x: 3.0 - x, lambda x: x / 7.0, lambda x: x,
]  # fmt: skip
BINARY = [
    lambda x, y: x + y, lambda x, y: x - y, lambda x, y: x * y, lambda x, y: x / y, ca.fmin, ca.fmax, ca.atan2,
    lambda x, y: x**y, lambda x, y: x < y, lambda x, y: x <= y, lambda x, y: x == y, lambda x, y: x != y,
    ca.logic_and, ca.logic_or, lambda x, y: ca.if_else(x, y, 0),
    lambda x, y: ca.if_else(x > y, x, y), lambda x, y: ca.if_else(y, x, y) + x,
]  # fmt: skip


def by_machine(f: ca.Function, columns: list[np.ndarray]) -> list[np.ndarray]:
    """By CasADi itself, all at once."""
    return [np.array(r.full()) for r in f.map(columns[0].shape[1]).call([ca.DM(c) for c in columns])]


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    """NaN for NaN, whatever its payload; zeros with their signs."""
    nan = np.isnan(a)
    return np.array_equal(nan, np.isnan(b)) and np.array_equal(
        np.ascontiguousarray(a)[~nan].view(np.int64), np.ascontiguousarray(b)[~nan].view(np.int64)
    )


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory):
    """A cache of their own; functions that another test has asked for are asked anew."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GTMODEL_CACHE", str(tmp_path_factory.mktemp("cache") / "kept"))
        kept._entries.clear()
        yield


@pytest.fixture(params=["numpy", "machine code"])
def way(request, monkeypatch) -> str:
    """NumPy as on a machine without a compiler, or C as soon as there is a kernel."""
    if request.param == "numpy":
        monkeypatch.setattr(machine.Prospect, "make", lambda self, build: False)
    else:
        assert not isinstance(lacking := toolchain.find(), str), lacking
        monkeypatch.setattr(machine, "COMPILE", 0.0)
        monkeypatch.setattr(machine, "COMPILE_STEP", 0.0)
    kept._entries.clear()
    yield request.param
    kept._entries.clear()


def kernel(f: ca.Function, way: str = "numpy") -> ColumnKernel:
    program = program_of(f)
    assert program is not None
    made = ColumnKernel(program)
    assert (made.machine.of(1) is not None) == (way == "machine code")
    return made


def hostile_pairs() -> np.ndarray:
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(HOSTILE, HOSTILE)
    spread = [rng.standard_normal((2, 2000)) * 10.0**s for s in (-3, 0, 1, 3)]
    return np.hstack([np.array([x.ravel(), y.ravel()]), *spread])


def test_every_operation_has_the_bits_of_the_virtual_machine(way):
    x = ca.SX.sym("x", 2)
    f = ca.Function("f", [x], [ca.vertcat(*[u(x[0]) for u in UNARY], *[b(x[0], x[1]) for b in BINARY])])
    values = hostile_pairs()
    expected = by_machine(f, [values])[0]
    got = kernel(f, way).run([values])[0][0].T
    wrong = [k for k, (a, b) in enumerate(zip(expected, got, strict=True)) if not same_bits(a, b)]
    assert wrong == []
    operations = {f.instruction_id(k) for k in range(f.n_instructions())}
    assert set(LIBM) - operations <= {ca.OP_POW, ca.OP_CONSTPOW}


def random_function(seed: int, operations: int) -> ca.Function:
    rng = np.random.default_rng(seed)
    a, b = ca.SX.sym("a", 3), ca.SX.sym("b", 2)
    values = [*ca.vertsplit(a), *ca.vertsplit(b), ca.SX(0.75)]
    for _ in range(operations):
        i, j = rng.integers(0, len(values), 2)
        k = rng.integers(0, 8)
        x, y = values[i], values[j]
        values.append([x + y, x - y, x * y, x / (y * y + 1), ca.sin(x), ca.sqrt(ca.fabs(x)), ca.tanh(x), -x][k])
    picked = [values[k] for k in rng.integers(0, len(values), 6)]
    first = ca.vertcat(picked[0], picked[0], a[1], 4.0, picked[1], picked[2])
    matrix = ca.horzcat(ca.vertcat(*picked[2:4]), ca.vertcat(*picked[4:6]), ca.vertcat(b[0], picked[1]))
    return ca.Function("f", [a, b], [first, matrix, ca.SX(0, 1)])


@pytest.mark.parametrize("n", [1, 2, PIECE - 1, PIECE, PIECE + 1, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK + 300])
def test_random_functions_have_the_bits_of_the_virtual_machine(n, way):
    for seed in range(3):
        f = random_function(seed, 60)
        rng = np.random.default_rng(n)
        columns = [rng.standard_normal((3, n)), rng.standard_normal((n, 2)).T]  # and one that is a view
        columns[0][1, n // 2] = np.nan
        run = kernel(f, way)
        for _ in range(2):  # again on the memory of the first
            first, matrix, nothing = run.run(columns)[0]
            expected = by_machine(f, columns)
            assert same_bits(first.T, expected[0])
            assert same_bits(matrix.reshape(3 * n, 2).T, expected[1])
            assert nothing.shape == (n, 0)


def test_inputs_may_be_constant_or_read_only_and_stay_as_they_are(way):
    f = random_function(3, 40)
    a = np.broadcast_to(np.array([[1.0], [2.0], [3.0]]), (3, 2000))
    b = np.random.default_rng(0).standard_normal((2, 2000))
    b.flags.writeable = False
    before = b.copy()
    for x, y in zip(map_columns(f, [a, b]), by_machine(f, [a, b]), strict=True):
        assert same_bits(x, y)
    assert np.array_equal(b, before)


def test_inputs_of_other_kinds_and_odd_strides_are_read_as_numbers(way):
    f = random_function(4, 40)
    record = np.zeros(3000, dtype=[("tag", "i1"), ("a", "f8", 3), ("b", ">f8", 2)])
    rng = np.random.default_rng(0)
    record["a"], record["b"] = rng.standard_normal((3000, 3)), rng.integers(-3, 3, (3000, 2))
    plain = [np.array(record[n], dtype=float).T for n in "ab"]
    for b in (record["b"], record["b"].astype(int), record["b"].astype(np.float32), record["b"][:, ::-1][:, ::-1]):
        for x, y in zip(kernel(f, way).run([record["a"].T, b.T])[0], kernel(f, way).run(plain)[0], strict=True):
            assert same_bits(x, y)


def test_few_rows_and_unknown_operations_stay_with_the_virtual_machine():
    x = ca.SX.sym("x")
    plain, special = ca.Function("f", [x], [x * x]), ca.Function("f", [x], [ca.erf(x)])
    sparse = ca.Function("f", [x], [ca.vertcat(x, ca.SX(1, 1))])
    assert kept.kernel_of(plain, kept.FEWEST - 1) is None
    assert kept.kernel_of(plain, kept.PAID) is kept.kernel_of(plain, kept.FEWEST) is not None
    assert kept.kernel_of(special, kept.PAID) is None and kept.kernel_of(sparse, kept.PAID) is None
    values = np.linspace(-2, 2, kept.PAID)[None]
    assert same_bits(map_columns(special, [values])[0], by_machine(special, [values])[0])


def test_kernels_that_are_kept_are_few():
    x = ca.SX.sym("x")
    functions = [ca.Function("f", [x], [x + k]) for k in range(kept.KEPT + 9)]
    for f in functions:
        assert kept.kernel_of(f, kept.PAID) is not None
    assert len(kept._entries) == kept.KEPT


def test_threads_may_share_a_kernel(way):
    f = random_function(5, 80)
    run = kernel(f, way)
    rng = np.random.default_rng(2)
    tasks = [[rng.standard_normal((3, n)), rng.standard_normal((2, n))] for n in (9000, 5000, 12000, 7000) * 4]
    expected = [run.run(t)[0] for t in tasks]
    with ThreadPoolExecutor(4) as pool:
        for got, wanted in zip(pool.map(lambda t: run.run(t)[0], tasks), expected, strict=True):
            assert all(same_bits(x, y) for x, y in zip(got, wanted, strict=True))


def hostile_rows(rng: np.random.Generator, middle: np.ndarray, n: int, spread: float) -> np.ndarray:
    values = middle + rng.uniform(-spread, spread, (n, len(middle)))
    at = rng.integers(0, n, 40)
    values[at, rng.integers(0, len(middle), 40)] = rng.choice(HOSTILE, 40)
    values[rng.integers(0, n, 3)] = 1e7  # too large for the lengths
    return values


@pytest.mark.parametrize("spread", [0.1, 1.5])
@pytest.mark.parametrize(("known", "target"), [("T", "q"), ("q", "T"), ("T", "tau")])
def test_statuses_and_values_are_those_of_all_rows_at_once(known, target, spread, way, monkeypatch):
    robot = gt.robots.gantry_tau("l1_tape")
    f = robot.causal(known=known, targets=target)
    rng = np.random.default_rng(7)
    middle = np.array(robot.home) if known == "T" else robot.causal("T", "q")(robot.home)[0]
    arguments = [hostile_rows(rng, middle, 2 * BLOCK + 77, spread)]
    arguments += [hostile_rows(rng, np.zeros(3), len(arguments[0]), 2.0) for _ in f.inputs[1:]]
    arguments[0][BLOCK : 2 * BLOCK] = middle  # a block without a bad row
    for a in arguments[1:]:
        a[BLOCK : 2 * BLOCK] = 0.5
    values, status = f(*arguments)
    columns, _ = f._columns(arguments)
    assert f._evaluate(columns)[0][0].shape == values.T.shape
    monkeypatch.setattr(rows, "kernel_of", lambda f, n: None)
    before, codes = f(*arguments)
    assert np.array_equal(status, codes) and status.dtype == codes.dtype
    assert len(set(codes.tolist())) >= 3
    assert same_bits(values, before) and np.all(np.isnan(values[codes != Status.OK]))
    assert values.flags.c_contiguous


def test_newton_blocks_in_chunks_give_the_bits_of_single_calls(way, monkeypatch):
    robot = gt.robots.f1_gantry_tau()
    f = robot.causal("q", ["T", "e"])
    rng = np.random.default_rng(4)
    q = f.kernels[0].a0 + rng.uniform(-0.4, 0.4, (kept.PAID + 300, 6))  # some are out of reach
    q[5], q[6, 2], q[7] = np.nan, np.inf, 1e9
    f(q[:2000])  # kernels are there
    T, e, status = f(q)
    assert {Status.OK, Status.NOT_CONVERGED, Status.NOT_FINITE, Status.OUT_OF_RANGE} <= set(status.tolist())
    for k in (0, 3, 5, 6, 7, 8, len(q) - 1):
        one, turned, code = f(q[k])
        assert code == status[k] and same_bits(one, T[k]) and same_bits(turned, e[k])
    assert all(same_bits(x, y) for x, y in zip(f(np.asfortranarray(q))[:2], (T, e), strict=True))
    monkeypatch.setattr(newton, "CHUNK", 500)
    assert all(same_bits(np.asarray(x, float), np.asarray(y, float)) for x, y in zip(f(q), (T, e, status), strict=True))


def test_singular_matrices_are_those_of_their_singular_values():
    rng = np.random.default_rng(5)
    u, _, v = np.linalg.svd(rng.standard_normal((400, 5, 5)))
    s = np.exp(rng.uniform(np.log(1e-10), 0.0, (400, 5)))
    s[:20, 4] = 0.0
    s[20] = 0.0
    matrices = (u * s[:, None, :]) @ v * 10.0 ** rng.integers(-20, 20, (400, 1, 1))
    values = np.linalg.svd(matrices, compute_uv=False)
    expected = ~(values[:, -1] > newton.SINGULAR * values[:, 0])
    assert np.array_equal(newton.is_singular(matrices), expected)
    assert 20 < np.count_nonzero(expected) < 380
    assert newton.is_singular(np.array([[[0.0]], [[2.0]], [[-1e-9]]])).tolist() == [True, False, False]


def test_machine_code_is_made_when_rows_have_paid_for_it_and_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("GTMODEL_CACHE", str(tmp_path / "kept"))
    built: list[bool] = []
    original = machine.Prospect.make
    monkeypatch.setattr(machine.Prospect, "make", lambda p, build: built.append(build) or original(p, build))
    program = program_of(random_function(11, 50))
    assert program is not None
    prospect, rows = machine.Prospect(program), 1000
    while prospect.of(rows) is None:
        rows *= 2
    assert built == [False, True]
    assert len(list((tmp_path / "kept").glob("*.so"))) == 1
    again = machine.Prospect(program)
    assert again.of(10) is None and again.of(rows) is not None and again.of(1) is not None


def test_without_a_compiler_numpy_stays(monkeypatch, tmp_path):
    monkeypatch.setenv("CC", str(tmp_path / "nothing"))
    f = gt.robots.gantry_tau("l1_tape").causal("T", "q", name="without_compiler")
    assert f.compile() is False
    T = np.tile(f([0.9, -0.9, 0.45])[0], (3, 1))
    assert f(T)[1].shape == (3,)


def test_compiled_by_hand_it_gives_the_same_bits():
    robot = gt.robots.gantry_tau("l1_tape")
    f = robot.causal("T", ["tau", "q"], name="compiled_by_hand")
    rng = np.random.default_rng(8)
    arguments = [np.array(robot.home) + rng.uniform(-0.2, 0.2, (3000, 3)), *rng.standard_normal((2, 3000, 3))]
    before = f(*arguments)
    assert f.compile() and f.compile()
    for x, y in zip(f(*arguments), before, strict=True):
        assert np.array_equal(x, y)


@pytest.mark.filterwarnings("error")
def test_inputs_whose_squares_overflow_are_out_of_range_without_a_warning():
    robot = gt.robots.gantry_tau("l1_tape")
    T = np.tile(robot.home, (4096, 1))
    tau, status = robot.causal(known="T", targets="tau")(T, 0 * T, 0 * T + 1e200)
    assert np.isnan(tau).all() and (status == Status.OUT_OF_RANGE).all()
