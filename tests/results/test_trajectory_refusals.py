"""Trajectory: the sentences of its errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gtmodel.results import Trajectory, TrajectoryError, UnknownNameError
from tests.results.trajectories import TIME, example

NAN, INF = float("nan"), float("inf")
SIX = np.zeros((4, 3))
SIX[2, 1] = NAN


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"time": [0.0, 0.2, 0.2, 0.3]},
            "time[2] = 0.2 s does not come after time[1] = 0.2 s; time must increase strictly, so average "
            "the rows with equal time or keep the first",
        ),
        (
            {"time": [0.0, 0.3, 0.2, 0.4]},
            "time[2] = 0.2 s does not come after time[1] = 0.3 s; time must increase strictly, so sort the rows",
        ),
        (
            {"time": [0.0, 0.3, 0.2, 0.3]},
            "time[2] = 0.2 s does not come after time[1] = 0.3 s; time must increase strictly, so sort the rows, and "
            "average the rows with equal time or keep the first",
        ),
        ({"time": [0.0, INF, 2.0, 3.0]}, "time[1] is inf; expected finite seconds"),
        ({"time": []}, "time has shape (0,); expected (n,) with n at least 1"),
        ({"time": 3.0}, "time has shape (); expected (n,) with n at least 1"),
        (
            {"values": {"x": [1.0, 2.0]}},
            "signal 'x' has shape (2,); expected (4,) or (4, k), a row for each time",
        ),
        (
            {"values": {"x": np.zeros((4, 0))}},
            "signal 'x' has shape (4, 0); expected (4,) or (4, k), a row for each time",
        ),
        (
            {"values": {"x": [0, 1, NAN, NAN]}},
            "signal 'x' is nan in row 2; expected finite numbers, so remove the row or fill the gap before",
        ),
        (
            {"values": {"T": SIX}},
            "signal 'T[1]' is nan in row 2; expected finite numbers, so remove the row or fill the gap before",
        ),
        (
            {"values": {"x": [-INF, 1, 2, 3]}},
            "signal 'x' is -inf in row 0; expected finite numbers, so remove the row or fill the gap before",
        ),
        ({"values": {"x": ["a", "b", "c", "d"]}}, "signal 'x' has <U1 data; expected real numbers"),
        ({"values": {"x": [1j, 0, 0, 0]}}, "signal 'x' has complex128 data; expected real numbers"),
        ({"values": {}}, "a trajectory needs at least one signal; values is empty"),
        ({"values": {3: TIME}}, "a signal is named 3 of type int; expected a text"),
        (
            {"values": {"a b": TIME}},
            "signal name 'a b' cannot be written to a file; expected printable characters without "
            "blank or quote and no leading '#'",
        ),
        (
            {"values": {"time": TIME}},
            "a signal is named 'time', the name of the time grid; choose another name",
        ),
        (
            {"values": {"T": np.zeros((4, 3)), "T[2]": TIME}},
            "signal 'T[2]' has the name of a component of the vector signal 'T'; rename one of them",
        ),
        (
            {"units": {"T": "mm"}},
            "signal 'T': unit 'mm' has a scale of 0.001; declare lengths in 'm' and convert at the boundary",
        ),
        ({"title": "a\nb"}, "title is 'a\\nb'; expected one line of printable characters"),
        ({"synthetic": " "}, "synthetic is empty; give seed and noise in one line, or None for real data"),
        (
            {"provenance": {"x": NAN}},
            "provenance cannot be written as JSON (Out of range float values are not JSON compliant: nan); "
            "give texts, finite numbers, lists and dictionaries",
        ),
    ],
)
def test_what_the_constructor_refuses(changes: dict[str, Any], sentence: str) -> None:
    changes = {"units": None, **changes} if "values" in changes else changes
    with pytest.raises(TrajectoryError) as caught:
        example(**changes)
    # the interpreter's own words in parentheses may change between versions
    assert str(caught.value).replace(" compliant)", " compliant: nan)") == sentence


def test_ragged_data() -> None:
    with pytest.raises(TrajectoryError, match=r"signal 'x' is not an array .*; expected rows of equal length"):
        Trajectory([0.0, 1.0], {"x": [[1.0], [1.0, 2.0]]})


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (
            "arm[0].rod.tensoin",
            "there is no signal 'arm[0].rod.tensoin'; did you mean 'arm[0].rod.tension'?",
        ),
        ("T[3]", "there is no component 'T[3]': signal 'T' has 3, from 'T[0]' to 'T[2]'"),
        ("t[0]", "there is no signal 't[0]'; did you mean 'T[0]'?"),
        ("zzz", "there is no signal 'zzz'; the trajectory has 'T', 'arm[0].rod.tension', 'count'"),
        ("count[0]", "there is no signal 'count[0]'; did you mean 'count'?"),
    ],
)
def test_unknown_names(name: str, sentence: str) -> None:
    traj = example()
    for ask in (traj.__getitem__, traj.unit, traj.scale, traj.select, lambda n: traj(0.0, n)):
        with pytest.raises(UnknownNameError) as caught:
            ask(name)
        assert str(caught.value) == sentence
        assert isinstance(caught.value, KeyError)


def test_unit_of_an_unknown_signal() -> None:
    with pytest.raises(UnknownNameError) as caught:
        example(units={"T": "m", "coumt": "1"})
    assert str(caught.value) == "units names the signal 'coumt'; did you mean 'count'?"
    with pytest.raises(UnknownNameError):
        example().with_values(units={"G": "m"})


@pytest.mark.parametrize(
    ("act", "sentence"),
    [
        (lambda x: x(0.7, "T"), "t = 0.7 s is outside the trajectory, which runs from 0.0 to 0.6 s"),
        (lambda x: x(-1e-9, "T"), "t = -1e-09 s is outside the trajectory, which runs from 0.0 to 0.6 s"),
        (lambda x: x([0.1, NAN], "T"), "t = nan s is outside the trajectory, which runs from 0.0 to 0.6 s"),
        (lambda x: x(0.1, "T", "cubic"), "kind is 'cubic'; expected 'linear', 'pchip' or 'previous'"),
        (lambda x: x([[0.1]], "T"), "t has shape (1, 1); expected a scalar or a one-dimensional array"),
        (lambda x: x.resample(), "resample() takes either times t or a step dt; give exactly one of them"),
        (
            lambda x: x.resample(TIME, dt=0.1),
            "resample() takes either times t or a step dt; give exactly one of them",
        ),
        (lambda x: x.resample(0.004), "t has shape (); expected (m,) new times, or a step as dt=0.004"),
        (lambda x: x.resample(dt=0.0), "dt is 0.0; expected a positive finite step in seconds"),
        (
            lambda x: x.resample([0.0, 0.9]),
            "t = 0.9 s is outside the trajectory, which runs from 0.0 to 0.6 s",
        ),
        (lambda x: x.select([]), "a trajectory needs at least one signal; values is empty"),
        (
            lambda x: x.merge(x),
            "signal 'T' is in both trajectories; use select() or with_values() to choose one",
        ),
        (
            lambda x: x.merge(x.resample(dt=0.1)),
            "the time grids differ (4 rows from 0.0 to 0.6 s, and 7 rows from 0.0 to 0.6 s); resample one "
            "on the time of the other first",
        ),
    ],
)
def test_what_methods_refuse(act: Any, sentence: str) -> None:
    with pytest.raises(TrajectoryError) as caught:
        act(example())
    assert str(caught.value) == sentence


def test_misspelt_keywords_raise() -> None:
    for act in (
        lambda: Trajectory([0.0], {"x": [1.0]}, titel="a"),  # type: ignore[call-arg]
        lambda: example().resample(step=0.1),  # type: ignore[call-arg]
        lambda: example()(0.1, "T", knd="linear"),  # type: ignore[call-arg]
        lambda: example().to_csv("never.csv", overwite=True),  # type: ignore[call-arg]
    ):
        with pytest.raises(TypeError, match="unexpected keyword"):
            act()
