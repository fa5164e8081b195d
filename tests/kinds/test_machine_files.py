"""What a machine or another program takes over: every file is decided on, and a failed check is told truly."""

import ast
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, strategies as st
from matplotlib.figure import Figure
from matplotlib.text import Text

import gtmodel
from gtmodel.cli import main
from gtmodel.problem_files import run
from gtmodel.problem_files.base import TRAJECTORY, Check, Context, InputError, at_least, at_most
from gtmodel.problem_files.load import apply, load, refuse_twice
from gtmodel.results import SolveStatus, Study, Trajectory, written
from gtmodel.results.check import verdict

SOURCES = sorted(Path(gtmodel.__file__).parent.rglob("*.py"))
# what people read, and data that were made up to be read again
FOR_PEOPLE = {
    "trajectory.csv", "sensitivity.csv", "modes.csv", "map.csv", "errors.csv", "boundary.csv", "points.csv", "run.toml",
    "measurements.csv", "residuals.csv", "carts.csv", "load_tests.csv", "delays.csv", "loop_off.csv", "loop_on.csv",
    "corners.csv", "events.csv", "innovations.csv", "samples.csv", "limits.csv", "table.csv", "postures.csv",
    "boxes.csv", "motion.csv", "robot.toml", "problem.toml", "force.csv",  # examples in sentences
    "gantry_tau.toml", "gantry_tau_dynamics.toml", "pyproject.toml",  # read, never written
    "element.c", "entry.c", "gt_loop_model.c", "gt_model_main.c",  # compiled where they were written
    "gt_fmu.c", "gt_fmu_model.c", "gt_fmu_step.c", "_main.c", "_selftest.c",  # in the sources of an archive
}  # fmt: skip
NUMBER = st.floats(1e-9, 1e9)


def _outcome(status: SolveStatus, machine: tuple[str, ...], passed: bool = True) -> Study:
    return Study(
        status=status,
        checks={"error_mm": at_most(1.0 if passed else 3.0, 2.0)},
        trajectory=Trajectory([0.0, 0.1], {"x": [1.0, 2.0]}, {"x": "m"}),
        files={"motion.mod": "MODULE A\n"},
        machine_files=machine,
    )


def _written(folder: Path, outcome: Study, write_failed: bool = False) -> dict[str, str]:
    loaded = replace(load("table_3_1.toml"), kind=SimpleNamespace(call=lambda problem, context: lambda **_: outcome))
    run.solve(loaded, Context(), out=folder, write_failed=write_failed)
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.mark.parametrize("status", [s for s in SolveStatus if s is not SolveStatus.CHECK_FAILED])
@pytest.mark.parametrize("followed", [True, False])
def test_a_trajectory_that_must_not_be_relied_on_is_marked_or_not_written(
    status: SolveStatus, followed: bool, tmp_path: Path
) -> None:
    machine = ("motion.mod", TRAJECTORY) if followed else ("motion.mod",)
    outcome = _outcome(status, machine, passed=False)
    files = _written(tmp_path / "a", outcome)
    assert not outcome.status.ok and "motion.mod" not in files and (TRAJECTORY in files) is not followed
    asked = _written(tmp_path / "b", outcome, write_failed=True)
    for name in {"motion.mod", TRAJECTORY} & {*files, *asked}:
        assert "NOT TO BE USED" in asked[name].splitlines()[0]
        assert name not in files or "NOT TO BE USED" in files[name].splitlines()[0]
    assert Trajectory.from_csv(tmp_path / "b" / TRAJECTORY)["x"].tolist() == [1.0, 2.0]


def test_what_may_be_used_carries_no_mark(tmp_path: Path) -> None:
    files = _written(tmp_path / "a", _outcome(SolveStatus.SOLVED, ("motion.mod", TRAJECTORY)))
    assert {"motion.mod", TRAJECTORY} <= set(files) and not any("NOT TO BE USED" in text for text in files.values())


def test_every_file_that_a_kind_names_is_decided_on() -> None:
    named: dict[str, str] = {}
    machine: set[str] = set()
    for path in SOURCES:
        text = re.sub(r"^ *(>>>|\.\.\.) .*$", "", path.read_text(), flags=re.M)  # examples write files of the reader's
        for name in re.findall(r'"([a-z_]+\.(?:csv|toml|mod|c))"', text):
            named[name] = path.name
        for listed in re.findall(r"machine_files=[(\[]([^)\]]*)[)\]]", text):
            machine |= set(re.findall(r'"([^"]+)"', listed))
    machine |= {"compensation.csv", "identified.toml"}  # by their constants
    assert {n: at for n, at in named.items() if n not in machine | FOR_PEOPLE} == {}


def test_no_kind_states_a_verdict_that_its_bound_does_not() -> None:
    """A Check by hand takes its verdict from where value and bound come from, never from a comparison of its own."""
    for path in SOURCES:
        if path.parent.name == "results":
            continue
        text = path.read_text()
        for node in ast.walk(ast.parse(text)) if "judged" in text else ():
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Check":
                for judged in (k.value for k in node.keywords if k.arg == "judged"):
                    assert isinstance(judged, ast.Attribute), f"{path.name}:{node.lineno}: use at_most or at_least"


@given(NUMBER, st.one_of(NUMBER, st.floats(-1e-6, 1e-6)), st.booleans())
def test_the_sentence_tells_a_value_from_the_bound_that_it_misses(bound: float, off: float, least: bool) -> None:
    value = bound * (1 + off)
    check: Check = (at_least if least else at_most)(value, bound)
    if check.passed:
        return
    found, told = re.fullmatch(
        r"1 of 1 checks failed: error_mm \((\S+) mm, at (?:least|most) (\S+) mm\)", verdict({"error_mm": check}, 1)
    ).groups()  # type: ignore[union-attr]
    assert float(found) < float(told) if least else float(found) > float(told)


@pytest.mark.parametrize(
    "settings",
    [["draw.seed=1", "draw.seed=2"], ["a.0.b=1", "a.00.b=1"], ["draw.seed=1", "draw={}"], ["x=1", " x =1"]],
)
def test_a_setting_does_not_take_back_another(settings: list[str]) -> None:
    with pytest.raises(InputError, match="leave one of them out"):
        refuse_twice(settings)
    words = [word for setting in settings for word in ("--set", setting)]
    assert main(["solve", "table_3_1.toml", *words]) == main(["explain", "table_3_1.toml", *words]) == 2


def test_settings_beside_each_other_are_no_contradiction() -> None:
    settings = ["a={b=1}", "a.c=2", "ab=3"]
    refuse_twice(settings)
    assert apply({}, settings) == {"a": {"b": 1, "c": 2}, "ab": 3}
    with pytest.raises(InputError):
        apply({"a": [1, 2]}, ["a.²=1"])


@pytest.mark.parametrize("title", ["cost $5 and $x_", r"$\frac b$", "one $"])
def test_a_dollar_in_a_title_is_a_dollar(title: str) -> None:
    """Two of them would be read as a formula, or not at all."""

    def figure() -> Figure:
        made = Figure(figsize=(3, 2))
        made.suptitle(title)
        axes = made.subplots()
        axes.semilogy([1, 100], [1e-3, 1e3], label=title)
        axes.set_title(title)
        axes.legend()
        return made

    made = figure()
    assert written.png(lambda: made).startswith(b"\x89PNG")
    assert not any(text.get_parse_math() for text in made.findobj(Text) if text.get_text() == title)
    assert any("mathdefault" in text.get_text() and text.get_parse_math() for text in made.findobj(Text))
