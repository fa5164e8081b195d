"""Issue 15, must-hold 3: hostile calls of generated C. What is ok solves the equations, and what is reachable is ok.

The judge is tests/oracle/extended.py: closures, their rates and virtual work written from the thesis, in extended
precision, with numbers read off the problem's robot.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtmodel import Status
from gtmodel.cgen import generate
from gtmodel.cgen.interface import Interface, interfaces
from gtmodel.cgen.points import evaluate
from gtmodel.cgen.real import real_of
from gtmodel.cgen.verification.comparison import call
from gtmodel.kinds.codegen.kind import functions_of
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.load import load
from tests.cgen.calls import shared_library
from tests.cgen.hostile import Hostile, inside
from tests.oracle.extended import ARM, Masses, StraightGuideways, TurningCarts, extended, motor_forces

PROBLEMS = Path(__file__).parents[2] / "problems"
FUNCTIONS = {
    "l1_controller": ("fk", "ik", "velocity", "inverse_dynamics"),
    "l1_controller_float": ("fk", "ik", "velocity", "inverse_dynamics"),
    "d1_controller": ("fk", "ik", "velocity", "inverse_dynamics"),
    "f1_controller": ("fk", "ik", "velocity"),
}
CASES = [(problem, key) for problem, keys in FUNCTIONS.items() for key in keys]
FEW, MANY = 500, 100_000
# wrong: metres of a link's length, and rates or forces over the size of their terms
WRONG_M = {"double": 1e-6, "float": 1e-3}
WRONG_RATE = {"double": 1e-9, "float": 1e-3}
CONTRADICTED = 1e-5  # of a rate, ten times what a condition among known values allows
UNITS_IN_THE_LAST_PLACE = 4  # of T and L, by which an answer may be meant for a pose beside the one that was given


class Made:
    """A problem's functions, their library, and the judge of their answers."""

    def __init__(self, name: str, place: Path) -> None:
        problem: Any = load(PROBLEMS / f"{name}.toml").problem
        robot = problem.model(Context(name=name))
        functions = functions_of(problem, Context(name=name))
        options: dict[str, Any] = dict(name=problem.name, real=problem.real, box=problem.box)
        self.faces = {f.key: f for f in interfaces(functions, problem.name, (), real_of(problem.real), problem.box)}
        self.library = shared_library(generate(functions, place / "out", **options).folder, place)
        self.robot, self.links = robot, links_of(robot)
        self.judge = judge_of(robot, UNITS_IN_THE_LAST_PLACE * float(np.finfo(real_of(problem.real).dtype).eps))
        self.real = problem.real
        along = extended(robot.v)[0]
        self.along = (along / np.sqrt(along @ along)).astype(float)

    def wrong(self, face: Interface, inputs: np.ndarray, outputs: np.ndarray) -> np.ndarray:
        """Rows of answers that miss an equation."""
        return self.judge(face.key, self._known(face, inputs, outputs), WRONG_M[self.real], WRONG_RATE[self.real])

    def as_declared(self, face: Interface, inputs: np.ndarray, outputs: np.ndarray, most_m: float = 0.0) -> np.ndarray:
        """Rows of answers with every link on its declared branch, or by at most this beyond its border; the F1 declares
        one for arm 1 only."""
        known = self._known(face, inputs, outputs)
        if self.links is None:
            return f1_of(self.robot).first_below(known["q"], known["T"], known["e"])
        return self.links.all_ahead(carts_of(self.links, known), known["T"], known.get("e"), most_m)

    def _known(self, face: Interface, inputs: np.ndarray, outputs: np.ndarray) -> dict[str, np.ndarray]:
        """Numbers by signal: inputs, outputs, and of the state what is neither."""
        known = dict(zip([m.signal for m in face.inputs], parts(face.inputs, inputs), strict=True))
        known |= dict(zip([m.signal for m in face.outputs], parts(face.outputs, outputs), strict=True))
        state = parts(face.state, outputs[:, face.output_size :])
        return {m.signal: s for m, s in zip(face.state, state, strict=True)} | known


def parts(members: tuple[Any, ...], rows: np.ndarray) -> list[np.ndarray]:
    edges = np.cumsum([0, *[m.size for m in members]])
    return [extended(rows[:, a:b]) for a, b in pairwise(edges)]


Judge = Callable[[str, dict[str, np.ndarray], float, float], np.ndarray]


def numbers_of(robot: Any, *names: str) -> list[np.ndarray]:
    return [extended(np.array(getattr(robot, n), dtype=float)) for n in names]


def links_of(robot: Any) -> StraightGuideways | None:
    """Links of an L1 or a D1, None for an F1."""
    if hasattr(robot, "u1_2"):
        return None
    six = hasattr(robot, "B")
    A, v, L = numbers_of(robot, "A", "v", "L")
    return StraightGuideways(A, v, L, ARM if six else np.arange(3), *numbers_of(robot, "B") if six else ())


def judge_of(robot: Any, round_off: float) -> Judge:
    links = links_of(robot)
    if links is None:
        return judge_of_f1(robot)
    six = links.B is not None
    names = ("m_p", "m_c", "m_a", "coulomb", "viscous", "velocity_scale", *(["c_p", "I_p"] * six))
    masses = Masses(*numbers_of(robot, *names))

    def of_carts(key: str, x: dict[str, np.ndarray], most_m: float, most: float) -> np.ndarray:
        T, e = x["T"], x.get("e")
        q = carts_of(links, x)
        bad = ~(links.closure_m(q, T, e) <= most_m)
        if key == "velocity":
            bad |= ~(links.rate(q, T, x["der(q)"], x["der(T)"], e) <= most)
        if key == "inverse_dynamics":
            rates, tau = (x["der(T)"], x["der(T,2)"]), x["tau"]
            missed = motor_forces(links, masses, q, T, *rates, tau, e)
            # a link nearly at right angles to its guideway: what a few units in the last place of T change is not known
            unknown = np.zeros_like(missed)
            for way in np.concatenate([np.eye(3), -np.eye(3)]):
                near = T + round_off * np.maximum(np.max(np.abs(T), axis=1), links.L.max())[:, None] * way
                moved = motor_forces(links, masses, links.carts(near, e, q), near, *rates, tau, e)
                unknown = np.fmax(unknown, np.abs(moved - missed))
            bad |= ~(missed <= most + unknown)
        return bad

    return of_carts


def f1_of(robot: Any) -> TurningCarts:
    return TurningCarts(*numbers_of(robot, "A0", "v", "L", "A", "B", "u1_2", "u1_3", "u2_3", "r3"))


def judge_of_f1(robot: Any) -> Judge:
    f1 = f1_of(robot)

    def of_f1(key: str, x: dict[str, np.ndarray], most_m: float, most: float) -> np.ndarray:
        bad = ~(f1.closure_m(x["q"], x["T"], x["e"]) <= most_m)
        if key == "velocity":
            # a unit quaternion keeps its length: a rate along itself contradicts it
            size = np.sqrt(np.sum(x["der(e)"] ** 2, axis=1))
            bad |= ~(np.abs(np.sum(x["e"] * x["der(e)"], axis=1)) <= CONTRADICTED * (1 + size))
            bad |= ~(f1.rate(x["q"], x["T"], x["der(q)"], x["der(T)"], x["e"], x["der(e)"]) <= most)
        return bad

    return of_f1


def carts_of(links: StraightGuideways, x: dict[str, np.ndarray]) -> np.ndarray:
    """All carts of an answer (rows, 3). Those of a state are part of it; of the others the branch `ahead` tells the
    root."""
    q = x["q"] if "q" in x else links.carts(x["T"], x.get("e"))
    for i in range(3):
        if f"q[{i}]" in x:
            q[:, i] = x[f"q[{i}]"][:, 0]
    return q


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Made]:
    kept: dict[str, Made] = {}
    return lambda name: kept.get(name) or kept.setdefault(name, Made(name, tmp_path_factory.mktemp(name)))


@pytest.mark.parametrize("rows", [FEW, pytest.param(MANY, marks=pytest.mark.proof)])
@pytest.mark.parametrize(("problem", "key"), CASES)
def test_what_is_ok_solves_the_equations(problem: str, key: str, rows: int, made: Callable[[str], Made]) -> None:
    it = made(problem)
    face = it.faces[key]
    inputs = Hostile(face, it.library, it.along, seed=15).rows(rows)
    outputs, status = call(it.library, face, inputs)
    ok = status == Status.OK
    assert ok.sum() > rows / 20
    bad = np.flatnonzero(ok)[it.wrong(face, inputs[ok], outputs[ok])]
    assert bad.size == 0, f"{bad.size} wrong, first {inputs[bad[0]].tolist()} -> {outputs[bad[0]].tolist()}"
    if face.newton:  # a foreign state, or a jump to the mirror image of T, leads to links that point backwards
        # at the border, where two solutions meet, round-off of the one that was given may tell the other
        bad = np.flatnonzero(ok)[~it.as_declared(face, inputs[ok], outputs[ok], WRONG_M[it.real])]
        assert bad.size == 0, f"{bad.size} on another branch, first {inputs[bad[0]].tolist()}"


@pytest.mark.parametrize(("problem", "key"), CASES)
def test_what_lies_inside_the_box_is_ok(problem: str, key: str, made: Callable[[str], Made]) -> None:
    it = made(problem)
    face = it.faces[key]
    inputs = inside(face, 200)
    outputs, status = call(it.library, face, inputs)
    assert np.all(status == Status.OK) and not it.wrong(face, inputs, outputs).any()
    assert it.as_declared(face, inputs, outputs).all()


@pytest.mark.parametrize(("problem", "key"), CASES)
def test_python_says_the_same(problem: str, key: str, made: Callable[[str], Made]) -> None:
    it = made(problem)
    face = it.faces[key]
    inputs = Hostile(face, it.library, it.along, seed=16).rows(FEW)
    outputs, status = call(it.library, face, inputs)
    expected, wanted = evaluate(face, inputs)
    np.testing.assert_array_equal(status, wanted)
    np.testing.assert_array_equal(outputs[status == Status.OK], expected[status == Status.OK])
