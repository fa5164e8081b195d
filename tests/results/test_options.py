"""Options: each field is what its annotation says, or it is refused under its name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.kinematics.workspace import WorkspaceLimits
from gtmodel.results import ArgumentError, Long, Options, Unit, Within


@dataclass(frozen=True)
class Inner(Options):
    """Options in options."""

    word: Annotated[Literal["linear", "cubic"], "between rows"] = "linear"


@dataclass(frozen=True)
class Everything(Options):
    """A field of every kind."""

    number: Annotated[float, Unit("m"), Within(above=0.0, most=10.0)] = 1.0
    whole: int = 1
    flag: bool = False
    text: str = ""
    path: str | Path | None = None
    some: Annotated[float | list[float], Long(2)] = 0.0
    rows: Annotated[list[list[float]], Long(3)] = field(default_factory=list)
    array: Annotated[np.ndarray, Long(3)] = field(default_factory=lambda: np.zeros((1, 3)))
    pair: tuple[float, str] = (1.0, "m")
    named: Annotated[dict[str, float], Within(above=0.0)] = field(default_factory=dict)
    inner: Inner = field(default_factory=Inner)
    inners: list[Inner] = field(default_factory=list)
    by_name: dict[str, Inner] = field(default_factory=dict)
    made_by: Callable[[], int] | None = None
    anything: Any = None


@pytest.mark.parametrize(
    "given",
    [
        {"number": 2}, {"number": np.float32(2.0)}, {"number": np.int64(2)}, {"whole": np.int64(3)},
        {"path": Path("a")}, {"path": None}, {"some": [1, 2]}, {"some": (1.0, 2.0)}, {"some": np.array([1.0, 2.0])},
        {"rows": np.zeros((4, 3))}, {"rows": [np.zeros(3), (1, 2, 3)]}, {"rows": []}, {"array": [[1, 2, 3]]},
        {"pair": (2, "s")}, {"named": {"a": 1}}, {"by_name": {"a": Inner()}}, {"made_by": lambda: 1},
        {"anything": object()},
    ],
)  # fmt: skip
def test_what_agrees_is_taken(given: dict[str, Any]) -> None:
    assert Everything(**given)


@pytest.mark.parametrize(
    ("argument", "bad", "told"),
    [
        ("number", "2", "expected a number; found '2'"),
        ("number", True, "found True"),
        ("number", None, "found None"),
        ("number", -1.0, "must be more than 0 and at most 10; found -1"),
        ("number", 11, "found 11"),
        ("number", float("nan"), "finite"),
        ("whole", 1.5, "whole number"),
        ("whole", np.bool_(True), "whole number"),
        ("flag", 1, "True or False"),
        ("text", 7, "expected text; found 7"),
        ("path", 7, "expected text or a path or None"),
        ("some", [1.0, 2.0, 3.0], "expected 2 numbers; found 3"),
        ("some", ["1", "2"], "expected a number; found '1'"),
        ("some", "12", "expected a number or a list of numbers"),
        ("some", {1.0: 2.0}, "found {1.0: 2.0}"),
        ("rows", [1.0, 2.0, 3.0], "expected a list of numbers; found 1.0"),
        ("rows", [[1.0, 2.0]], "expected 3 numbers; found 2"),
        ("rows", np.zeros(3), "expected a list of numbers"),
        ("rows", np.zeros((2, 2, 3)), "a list of numbers; found an array of shape (2, 3)"),
        ("array", [[1, 2, 3], [4, 5]], "rows of equal length"),
        ("array", np.zeros((3, 2)), "expected 3 numbers; found 2"),
        ("array", [["a", "b", "c"]], "an array of numbers"),
        ("pair", (1.0,), "expected 2"),
        ("pair", (1.0, 2.0), "expected text"),
        ("named", {"a": 0.0}, "more than 0"),
        ("named", {1: 1.0}, "text"),
        ("inner", Everything(), "Inner"),
        ("inner", {"word": "linear"}, "Inner"),
        ("inner", Inner, "the class"),
        ("inners[1]", [Inner(), 7], "Inner"),
        ("by_name.b", {"a": Inner(), "b": 7}, "Inner"),
        ("made_by", int, "a function"),
    ],
)
def test_what_does_not_agree_is_refused_with_found_and_expected(argument: str, bad: Any, told: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        Everything(**{argument.split("[")[0].split(".")[0]: bad})
    assert caught.value.argument == argument and told in caught.value.message


def test_a_word_is_told_with_the_one_that_was_meant() -> None:
    with pytest.raises(ArgumentError, match="one of linear, cubic; found 'cubik'; did you mean cubic"):
        Inner("cubik")  # type: ignore[arg-type]


def test_a_class_is_told_as_it_is_imported() -> None:
    with pytest.raises(
        ArgumentError, match=r"gtmodel\.motion\.Limits; found gtmodel\.kinematics\.workspace\.WorkspaceLimits"
    ):
        gt.motion.study(gt.robots.gantry_tau("l1_tape"), [0, 0, 0], [1, 0, 0], limits=WorkspaceLimits())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "argument"),
    [
        (lambda: gt.calibrate.Fit(variant="zzz"), "variant"),
        (lambda: gt.compliance.RodSprings(stiffness="2e7"), "stiffness"),
        (lambda: gt.motion.Spline(np.zeros((3, 2))), "points"),
        (lambda: gt.motion.Polyline(via=[[1.0, 2.0]]), "via"),
        (lambda: WorkspaceLimits(actuators=[[0.0, 1.0, 2.0]] * 3), "actuators"),
        (lambda: gt.milling.Cut("slott", 0.02, 0.005, 5e-4), "mode"),
        (lambda: gt.milling.Cut("slot", "0.02", 0.005, 5e-4), "radial_depth"),
        (lambda: gt.milling.Cutter(-0.0254, 2, gt.milling.CuttingCoefficients(1, 1, 1, 1, 1, 1)), "diameter"),
        (lambda: gt.vibration.Record([[1.0], [2.0]], [["a"], ["b"]], 0.01), "y"),
        (lambda: gt.vibration.Record([[1.0], [2.0]], [[1.0]], 0.01), "y"),
        (lambda: gt.vibration.Record([[1.0], [2.0]], [[1.0], [2.0]], 0.0), "sample_time"),
        (lambda: gt.vibration.Matrices([[1.0, 0.0], [0.0]], [[1.0]], [[1.0]]), "M"),
    ],
)
def test_what_was_found_raw(make: Callable[[], object], argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        make()
    assert caught.value.argument == argument
