"""Issue 15: Newton's answer lies on the branches of the home pose, or the status says that it does not.

Foreign states and jumps lead to the mirror image of the robot, where links point backwards along the guideways.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.cgen.interface import Interface, interfaces
from gtmodel.cgen.points import HELD, draw, evaluate
from gtmodel.cgen.verification.comparison import call
from gtmodel.compiler.causal import CausalFunction
from tests.bench.callgrind import Call, count
from tests.cgen.calls import shared_library
from tests.cgen.hostile import ACROSS_M
from tests.cgen.test_hostile import WRONG_M, WRONG_RATE, carts_of, judge_of, links_of, parts

ROWS = 60
JUMPS = 200  # from each of these
NEAR = 0.02  # typical sizes from the home pose
AGREED = 1e-9
COST = 1.1  # issue 15: instructions of the whole function over those without margins for branches
CAUSALITIES = {
    "fk": dict(known="q", targets=["T", "e"]),
    "ik": dict(known="T", targets=["q", "e"]),
    "velocity": dict(known="T", targets=["q", "der(q)"]),
    "inverse_dynamics": dict(known="T", targets="tau"),
    "forward_dynamics": dict(known="tau", targets="der(T,2)", prefer="T"),
}
# a link on a cart of its own, and all links
SIDES = {"": {}, "_behind": {f"link[{k}].ahead": -1 for k in range(6)}, "_second": {"link[1].ahead": -1}}
LONG = ("inverse_dynamics", "forward_dynamics")  # of 7 and 14 s each: by -m proof only
EACH = [pytest.param(k, marks=[pytest.mark.proof] * (k in LONG)) for k in CAUSALITIES]


def faces_of(pairs: Iterable[tuple[str, str]]) -> dict[str, Interface]:
    robot = gt.robots.make("d1_six_link")
    functions = {key + end: robot.causal(**CAUSALITIES[key], branches=SIDES[end]) for key, end in pairs}  # type: ignore[arg-type]
    return {face.key: face for face in interfaces(functions, "a")}


class Made(NamedTuple):
    faces: dict[str, Interface]
    folder: Path
    library: ctypes.CDLL


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Made]:
    """The functions and their library by the key of one: those that take long are derived for their own tests only."""

    @cache
    def of(long: bool) -> Made:
        faces = faces_of((key, end) for key in CAUSALITIES for end in SIDES if (key in LONG) == long)
        folder = folder_of(faces, tmp_path_factory.mktemp("assembly"))
        return Made(faces, folder, shared_library(folder, tmp_path_factory.mktemp("assembly_library")))

    return lambda key: of(key in LONG)


@pytest.fixture
def faces(key: str, made: Callable[[str], Made]) -> dict[str, Interface]:
    return made(key).faces


@pytest.fixture
def library(key: str, made: Callable[[str], Made]) -> ctypes.CDLL:
    return made(key).library


def folder_of(faces: dict[str, Interface], place: Path) -> Path:
    return cgen.generate({key: face.function for key, face in faces.items()}, place / "a", name="a").folder


def answered(face: Interface, library: ctypes.CDLL) -> tuple[np.ndarray, np.ndarray]:
    """Inputs with states about the home pose that are ok, and outputs with the new states."""
    rows = draw(face, ROWS, seed=3, farthest=NEAR)
    outputs, status = call(library, face, rows)
    ok = status == Status.OK
    assert ok.sum() > ROWS / 4
    return rows[ok], outputs[ok]


@pytest.mark.parametrize("side", ["_behind", "_second"])
@pytest.mark.parametrize("key", EACH)
def test_a_foreign_state_is_told_and_nothing_moves(
    key: str, side: str, faces: dict[str, Interface], library: ctypes.CDLL
) -> None:
    here, there = faces[key], faces[key + side]
    assert [m.signal for m in here.state] == [m.signal for m in there.state]
    n = here.output_size
    for mine, other in ((here, there), (there, here)):
        rows, _ = answered(other, library)
        good, expected = answered(mine, library)
        outputs, status = call(library, mine, rows)
        assert np.all(status == Status.WRONG_BRANCH) and np.all(outputs == HELD)
        again, status = call(library, mine, good)
        assert not status.any() and np.array_equal(again[:, :n], expected[:, :n])
        in_python, status = evaluate(mine, rows)
        assert np.all(status == Status.WRONG_BRANCH) and np.isnan(in_python).all()


@pytest.mark.parametrize("key", EACH)
def test_what_is_ok_after_a_jump_is_right_and_of_this_assembly(
    key: str, faces: dict[str, Interface], library: ctypes.CDLL
) -> None:
    """The tool centre point jumps along the guideways past the carts, or they past it, and the state stays behind."""
    face, robot = faces[key], gt.robots.make("d1_six_link")
    links, along = links_of(robot), np.array(robot.v)[0]
    rows = np.repeat(answered(face, library)[0], JUMPS, axis=0)
    n, first = face.input_size, 0
    far = np.random.default_rng(6).uniform(-ACROSS_M, ACROSS_M, len(rows))[:, None]
    for m in face.inputs:
        if m.signal in ("T", "q"):
            rows[:, first : first + 3] += far * (along if m.signal == "T" else 1.0)
        first += m.size
    outputs, status = call(library, face, rows)
    ok = status == Status.OK
    assert ok.any() and (status == Status.WRONG_BRANCH).any()
    members = [*face.state, *face.inputs, *face.outputs]
    held = np.column_stack([outputs[:, face.output_size :], rows[:, :n], outputs[:, : face.output_size]])[ok]
    x = dict(zip([m.signal for m in members], parts(tuple(members), held), strict=True))
    assert np.all(links.all_ahead(carts_of(links, x), x["T"], x["e"]))
    wrong = judge_of(robot, 4 * float(np.finfo(float).eps))
    assert not wrong("inverse_dynamics" if "tau" in x else key, x, WRONG_M["double"], WRONG_RATE["double"]).any()


@pytest.mark.parametrize("key", EACH)
def test_the_call_in_python_refuses_a_foreign_guess_and_takes_branches(key: str, faces: dict[str, Interface]) -> None:
    here, there = faces[key].function, faces[key + "_behind"].function
    names = [m.signal for m in faces[key].state]
    rows = [np.array([there.plan.samples[0][there.plan.pairs.index(p)] for p in s.pairs]) for s in there.inputs]
    arguments = [r.reshape(s.shape) for r, s in zip(rows, there.inputs, strict=True)]
    home = iter([x for stage in faces[key + "_behind"].newton for x in stage.home])
    guess = {m.signal: np.reshape([next(home) for _ in range(m.size)], m.shape) for m in faces[key + "_behind"].state}
    assert list(guess) == names
    *values, status = here(*arguments, guess=guess)
    assert status is Status.WRONG_BRANCH and all(np.isnan(v).all() for v in values)
    *values, status = there(*arguments, guess=guess)
    assert status is Status.OK
    *straight, status = there(*arguments)
    assert status is Status.OK and np.allclose(np.concatenate(values), np.concatenate(straight), atol=AGREED)
    *_, said, margins = there.casadi.call(arguments)
    assert int(said) == Status.OK and np.all(np.asarray(margins)[-len(there.plan.sides) :] > 0)


def test_header_and_readme_name_the_branches(made: Callable[[str], Made]) -> None:
    folder = made("fk").folder
    header = " ".join((folder / "gt_a.h").read_text().split()).replace(" * ", " ")
    assert "- GT_WRONG_BRANCH if " in header and "off these branches: link[1].ahead = +1" in header
    assert "link[1].ahead = -1" in header
    assert "continue from a state" in (folder / "README.md").read_text()


@pytest.mark.parametrize("key", ["fk", "ik", *(pytest.param(k, marks=pytest.mark.proof) for k in ("velocity", *LONG))])
@pytest.mark.usefixtures("callgrind")
def test_what_the_branches_cost(key: str, faces: dict[str, Interface], library: ctypes.CDLL, tmp_path: Path) -> None:
    f = faces[key].function
    plain = CausalFunction(replace(f.plan, sides=[]), f.inputs, f.outputs, f.name, f.groups, f.preferred)
    rows, _ = answered(faces[key], library)
    spent = []
    for name, function in (("with", f), ("without", plain)):
        place = cgen.generate({key: function}, tmp_path / name, name="c").folder
        (face,) = interfaces({key: function}, "c")
        cells = iter(range(face.input_size, rows.shape[1]))
        fill = "".join(
            f"(&state.{m.identifier}{'[0]' if m.is_array else ''})[{k}] = in[{next(cells)}]; "
            for m in face.state
            for k in range(m.size)
        )
        known = f"(const {face.symbol}_in *)(const void *)in, ({face.symbol}_out *)(void *)out"
        begin = f"{face.symbol}_state state; {face.symbol}_start(&state);"
        statement = f"{{ {begin} {fill} (void){face.symbol}(&state, {known}); }}"
        case = Call(face.symbol, statement, rows[:10], face.output_size, "gt_c.h")
        spent.append(count({key: case}, [place / "gt_c.c", place / "gt_c_body.c"])[key].instructions)
    assert spent[0] <= COST * spent[1]
