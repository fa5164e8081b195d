"""Bodies with loops over equal parts: the same numbers as Python's, less text, no more instructions."""

from __future__ import annotations

import ctypes
import re
import subprocess
from itertools import accumulate, pairwise
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import cgen
from gtmodel.cgen.body import body
from gtmodel.cgen.interface import Interface, interfaces
from gtmodel.cgen.lanes import lanes_of, lines_of
from gtmodel.cgen.loops import SOLVER, loop_text
from gtmodel.cgen.open_body import open_body, part_numbers
from gtmodel.cgen.points import draw, evaluate
from gtmodel.cgen.real import FLOAT
from gtmodel.cgen.verification.comparison import call, compare
from gtmodel.compiler.causal import CausalFunction
from gtmodel.results.status import Status
from tests.bench.callgrind import FLAGS
from tests.cgen.calls import shared_library
from tests.cgen.conftest import copy, run, succeed
from tests.support.compare import relative_error

# bytes of machine code with guards, 20,500 and 38,600 when written out; the first keeps the kernel and Newton's method,
# which both share
TEXT = {"velocity": 10_500, "inverse_dynamics": 11_300}
BOTH = 21_700
SHARED = 2_100  # of the elimination, and of the tables of both
# of a call; 13,005 and 16,682 when written out, 12,140 and 16,559 when the last kernel computed a Jacobian too
INSTRUCTIONS = {"velocity": 12_000, "inverse_dynamics": 16_400}
NUMBERS = 4  # equal parts of the small model

Functions = dict[str, CausalFunction]


class Cell(gt.Model):
    p = gt.parameter(1.0)
    q = gt.parameter(2.0)
    r = gt.parameter(3.0)
    x = gt.variable(start=0.1)


class Net(gt.Model):
    """A dense linear system with a row for each cell, and a sum over the cells."""

    u = gt.variable(3, start=[0.7, 1.1, -0.4])
    total = gt.variable()
    cell = gt.parts(NUMBERS, Cell)

    def equations(self):
        u, x = self.u, [cell.x for cell in self.cell]
        powers = [u[0], u[1] * u[1], u[2] - u[0], u[0] * u[2]]
        for k, cell in enumerate(self.cell):
            row = sum(((cell.p + cell.q * w) ** (j + 1)) * x[j] for j, w in enumerate(powers))
            yield row == cell.r * u[1] + u[k % 3]
        yield self.total == sum(cell.q * cell.x * cell.x for cell in self.cell)


@pytest.fixture(scope="module")
def functions() -> Functions:
    robot = gt.robots.six_link_gantry_tau()
    return {"velocity": robot.causal("T", ["q", "der(q)"]), "inverse_dynamics": robot.causal("T", "tau")}


@pytest.fixture(scope="module")
def faces(functions: Functions) -> dict[str, Interface]:
    return {face.key: face for face in interfaces(functions, "d1")}


@pytest.fixture(scope="module")
def folder(functions: Functions, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cgen.generate(functions, tmp_path_factory.mktemp("loops") / "d1", name="d1").folder


@pytest.fixture(scope="module")
def library(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return shared_library(folder, tmp_path_factory.mktemp("library"))


@pytest.mark.parametrize("key", list(TEXT))
def test_loops_equal_python_bit_for_bit(key: str, faces: dict[str, Interface], library: ctypes.CDLL) -> None:
    face = faces[key]
    assert face.loops is not None
    checks, _, solved = compare(library, face, 1000, seed=11)
    assert [name for name, check in checks.items() if not check.passed] == []
    assert solved > 100


@pytest.mark.parametrize("key", list(TEXT))
def test_what_python_refuses_c_refuses_for_the_same_reason(
    key: str, faces: dict[str, Interface], library: ctypes.CDLL
) -> None:
    face = faces[key]
    rng, rows = np.random.default_rng(5), draw(faces[key], 300, seed=5)
    rows[::3, :3] *= 10.0 ** rng.uniform(-3, 300, (100, 1))
    rows[1::7, face.input_size - 1] = np.inf
    rows[2::11, -1] = np.nan
    expected, wanted = evaluate(face, rows)
    outputs, status = call(library, face, rows)
    assert np.array_equal(wanted, status)
    assert {Status.OK, Status.NOT_FINITE, Status.OUT_OF_RANGE, Status.NOT_CONVERGED} <= set(map(Status, wanted))
    assert np.array_equal(outputs[status == Status.OK], expected[wanted == Status.OK])


@pytest.mark.parametrize("key", list(TEXT))
def test_elimination_and_gram_schmidt_agree(key: str, faces: dict[str, Interface]) -> None:
    """The written out body, which Python calls elsewhere, solves its systems in another way."""
    face = faces[key]
    rows = draw(face, 200, seed=3)
    values, status = evaluate(face, rows)
    good = status == Status.OK
    given = [rows[:, m] for m in _slices([m.size for m in face.inputs])]
    start = rows[:, face.input_size :]
    names = {"q[1]": start[:, 0], "q[2]": start[:, 1], "e": start[:, 2:]}
    *targets, codes = face.function(*given, guess=names)
    both = good & (codes == Status.OK)
    assert both.sum() > 20
    assert relative_error(values[both, : face.output_size], np.hstack(targets)[both]) < 1e-9


def _slices(sizes: list[int]) -> list[slice]:
    return [slice(a, b) for a, b in pairwise([0, *accumulate(sizes)])]


def test_text_does_not_depend_on_the_run(functions: Functions, faces: dict[str, Interface]) -> None:
    again = interfaces(functions, "d1")
    assert body("d1", again) == body("d1", list(faces.values()))


def test_loops_are_small(folder: Path, functions: Functions) -> None:
    costs = cgen.costs(folder, functions)
    found = {key: costs.text_bytes[f"gt_d1_{key}"] for key in TEXT}
    assert {key: n for key, n in found.items() if n > TEXT[key]} == {} and sum(found.values()) <= BOTH
    counted = {key: costs.instructions.get(f"gt_d1_{key}", 0) for key in INSTRUCTIONS}  # 0 without valgrind
    assert {key: n for key, n in counted.items() if n > INSTRUCTIONS[key]} == {}


@pytest.mark.parametrize("key", list(TEXT))
def test_self_test_sees_a_changed_number_of_a_table(key: str, folder: Path, tmp_path: Path) -> None:
    place = copy(folder, tmp_path)
    source = place / "gt_d1_body.c"
    text = source.read_text()
    begin = text.index(f"{key}_body_numbers[6]")
    numbers = [m for m in re.finditer(r"-?\d+\.\d+", text[begin : text.index("};", begin)]) if float(m[0])]
    number = numbers[len(numbers) // 2]
    first, last = begin + number.start(), begin + number.end()
    source.write_text(f"{text[:first]}{float(number[0]) * (1 + 1e-9)!r}{text[last:]}")
    succeed("sh", "-c", "cc -O1 -ffp-contract=off *.c -lm", cwd=place)
    assert run("./a.out", cwd=place).returncode == 1
    source.write_text(text)
    succeed("sh", "-c", "cc -O1 -ffp-contract=off *.c -lm && ./a.out", cwd=place)


def test_elimination_and_tables_are_small(folder: Path, tmp_path: Path) -> None:
    target = tmp_path / "body.o"
    subprocess.run(["gcc", *FLAGS, "-c", folder / "gt_d1_body.c", "-o", target], check=True)
    listing = subprocess.run(["nm", "-S", target], check=True, capture_output=True, text=True).stdout
    sizes = {line.split()[3]: int(line.split()[1], 16) for line in listing.splitlines() if len(line.split()) == 4}
    shared = [n for name, n in sizes.items() if name.startswith(("factored", "solved")) or name.endswith("_numbers")]
    assert 0 < sum(shared) <= SHARED


def test_small_functions_are_written_out(l1: Functions, f1: Functions) -> None:
    for name, functions in (("l1", l1), ("f1", f1)):
        assert [face.loops for face in interfaces(functions, name)] == [None] * len(functions)


def test_floats_are_written_out(functions: Functions) -> None:
    assert [face.loops for face in interfaces(functions, "d1", real=FLOAT)] == [None, None]


def test_parts_are_those_of_the_most_numerous_array(functions: Functions) -> None:
    found = part_numbers(functions["velocity"].flat)
    assert sorted({name for name, _ in found.values()}) == sorted(
        ["L[]", *[f"{letter}[,{k}]" for letter in "ABv" for k in range(3)]]
    )
    assert {lane for _, lane in found.values()} == set(range(6))


def test_a_model_of_a_user_with_equal_parts(tmp_path: Path) -> None:
    """No robot: a dense system with a row for each cell, compiled by itself and compared with Python."""
    rng = np.random.default_rng(8)
    cells = [dict(p=a, q=b, r=c) for a, b, c in rng.uniform(0.5, 2.0, (NUMBERS, 3)).tolist()]
    f = Net(cell=cells).causal(known="u", targets=["total", "cell[0].x"])
    opened = open_body(f, "net")
    assert opened is not None and opened.sizes == (NUMBERS,)
    lanes = lanes_of(opened)
    assert {group.lanes for group in lanes.groups} == {tuple(range(NUMBERS))}
    assert 2 * lines_of(lanes) < f.closed.n_instructions()
    source, target = tmp_path / "net.c", tmp_path / "net.so"
    source.write_text(f"#include <float.h>\n#include <math.h>\n{SOLVER}{loop_text('net', lanes)}")
    subprocess.run(["cc", "-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC",
                    source, "-o", target, "-lm"], check=True)  # fmt: skip
    net = ctypes.CDLL(str(target)).net
    points = rng.uniform(-2.0, 2.0, (200, 3))
    points[7], points[8] = np.nan, 1e200  # no number, and one that overflows
    expected = opened.evaluate([points.T])
    pointers = ctypes.POINTER(ctypes.c_double)
    for k, point in enumerate(points):
        results = [np.zeros(size) for size in opened.outputs]
        given = (pointers * 1)(np.ascontiguousarray(point).ctypes.data_as(pointers))
        net(given, (pointers * len(results))(*[r.ctypes.data_as(pointers) for r in results]), None, None, 0)
        for result, want in zip(results, expected, strict=True):
            np.testing.assert_array_equal(result, want[:, k])
    *targets, status = f(points)
    good = status == Status.OK
    assert good.sum() > 150 and not good[7:9].any()
    assert relative_error(expected[0].T[good, 0], targets[0][good]) < 1e-6
