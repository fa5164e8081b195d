"""Trajectory: access, interpolation and derived trajectories."""

from __future__ import annotations

import copy
import pickle
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from gtmodel.results import Trajectory, UnknownNameError
from tests.results.trajectories import ROUNDING, TIME, eighths, example, moderate, quick, trajectories

# -- reading ------------------------------------------------------------------


def test_signals_components_and_units() -> None:
    traj = example()
    assert traj.names == ("T", "arm[0].rod.tension", "count")
    assert traj["T"].shape == (4, 3) and traj["T"].dtype == np.float64
    np.testing.assert_array_equal(traj["T[2]"], [-2.0, -2.5, -3.0, -7.25])
    np.testing.assert_array_equal(traj["count"], [0.0, 1.0, 2.0, 3.0])
    assert (traj.unit("T"), traj.unit("T[1]"), traj.unit("count")) == ("m", "m", "1")
    assert traj.unit("arm[0].rod.tension") == "N/m"
    assert "T" in traj and "T[2]" in traj and "arm[0].rod.tension" in traj
    assert "T[3]" not in traj and "arm" not in traj and "count[0]" not in traj and 3 not in traj
    assert len(traj) == 4 and traj.duration == 0.6
    assert traj.scale("T") == 7.25 and traj.scale("T[0]") == 1.5 and traj.scale("arm[0].rod.tension") == 20.0


def test_one_row_is_a_trajectory() -> None:
    traj = Trajectory([2.0], {"x": [5.0]})
    assert len(traj) == 1 and traj.duration == 0.0
    for kind in ("linear", "pchip", "previous"):
        assert traj(2.0, "x", kind) == 5.0


def test_nothing_can_be_changed() -> None:
    source = np.array([1.0, 2.0, 3.0, 4.0])
    traj = example(values={"x": source}, units={"x": "m"})
    source[0] = 99.0
    assert traj["x"][0] == 1.0
    for array in (traj["x"], traj.time, example()["T"], example()["T[0]"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    with pytest.raises(AttributeError) as caught:
        traj.title = "other"  # type: ignore[misc]
    assert str(caught.value) == (
        "a trajectory is immutable, so 'title' cannot be set; use with_values() to get a new one"
    )
    with pytest.raises(AttributeError, match="cannot be deleted; use select"):
        del traj._values
    traj.provenance["limits"]["force_N"] = 0.0
    traj.units["x"] = "kg"
    assert traj.provenance == example().provenance and traj.unit("x") == "m"


def test_equality_sees_every_part() -> None:
    assert example() == example()
    x = {"x": [1.0, 2.0, 3.0, 4.0]}
    base = Trajectory(TIME, x)
    assert base != Trajectory([0.0, 0.1, 0.3, 0.7], x)
    assert base != Trajectory(TIME, {"x": [1.0, 2.0, 3.0, 5.0]})
    assert base != Trajectory(TIME, {"x": [[1.0], [2.0], [3.0], [4.0]]})
    assert base != Trajectory(TIME, {"y": x["x"]})
    assert base != Trajectory(TIME, x, {"x": "m"})
    assert base != Trajectory(TIME, x, title="t")
    assert base != Trajectory(TIME, x, provenance={"a": 1})
    assert base != Trajectory(TIME, x, synthetic="seed 1")
    assert base != 3
    with pytest.raises(TypeError):
        hash(base)
    with pytest.raises(TypeError):
        iter(base)


def test_repr_is_short() -> None:
    assert repr(example()) == (
        "Trajectory('Point to point', synthetic, 4 rows from 0 to 0.6 s: T (3) [m], arm[0].rod.tension "
        "[N/m], count [1])"
    )
    many = Trajectory([0.0], {f"x{i}": [0.0] for i in range(100)})
    assert repr(many) == (
        "Trajectory(1 rows from 0 to 0 s: x0 [1], x1 [1], x2 [1], x3 [1], x4 [1], x5 [1], and 94 more)"
    )


@quick
@given(trajectories())
def test_copies_are_equal(traj: Trajectory) -> None:
    assert pickle.loads(pickle.dumps(traj)) == traj
    assert copy.deepcopy(traj) == traj


# -- interpolation ------------------------------------------------------------


@pytest.mark.parametrize("kind", ["linear", "pchip", "previous"])
@quick
@given(traj=trajectories(number=eighths))
def test_rows_are_hit_exactly(kind: Any, traj: Trajectory) -> None:
    for name in traj.names:
        np.testing.assert_array_equal(traj(traj.time, name, kind), traj[name])


@quick
@given(
    st.lists(st.integers(-1000, 1000), min_size=2, max_size=8, unique=True),
    moderate,
    moderate,
    st.lists(st.floats(0, 1), max_size=5),
)
def test_linear_interpolation_reproduces_a_line(grid: list[int], a: float, b: float, at: list[float]) -> None:
    time = np.sort(np.array(grid, dtype=float))
    traj = Trajectory(time, {"x": a + b * time, "v": np.column_stack([b * time, np.full(time.size, a)])})
    t = time[0] + np.array(at) * (time[-1] - time[0])
    size = abs(a) + 1000 * abs(b)
    np.testing.assert_allclose(traj(t, "x"), a + b * t, rtol=0, atol=ROUNDING * size)
    np.testing.assert_allclose(traj(t, "v[0]"), b * t, rtol=0, atol=ROUNDING * size)
    np.testing.assert_array_equal(traj(t, "v[1]"), np.full(t.size, a))


@quick
@given(trajectories(number=moderate), st.floats(0, 1))
def test_linear_agrees_with_numpy(traj: Trajectory, at: float) -> None:
    t = min(traj.time[0] + at * traj.duration, traj.time[-1])
    for name in traj.names:
        columns = traj[name].reshape(len(traj), -1).T
        expected = [np.interp(t, traj.time, column) for column in columns]
        np.testing.assert_allclose(
            np.atleast_1d(traj(t, name)), expected, rtol=0, atol=ROUNDING * (1 + traj.scale(name))
        )


def test_shapes_of_interpolation() -> None:
    traj = example()
    assert isinstance(traj(0.2, "count"), float) and traj(0.2, "count") == pytest.approx(1.5)
    assert traj(0.2, "T").shape == (3,)
    assert traj([0.2, 0.25], "T").shape == (2, 3)
    assert traj([0.2, 0.25], "T[0]").shape == (2,)
    assert traj([], "T").shape == (0, 3)


def test_previous_holds_and_pchip_does_not_overshoot() -> None:
    traj = Trajectory([0.0, 1.0, 2.0, 3.0], {"x": [0.0, 0.0, 1.0, 1.0]})
    np.testing.assert_array_equal(traj([0.0, 0.999, 1.0, 1.999, 3.0], "x", "previous"), [0.0, 0.0, 0.0, 0.0, 1.0])
    fine = traj(np.linspace(0, 3, 301), "x", "pchip")
    assert fine.min() == 0.0 and fine.max() == 1.0 and np.all(np.diff(fine) >= 0)
    assert traj(1.25, "x", "pchip") == pytest.approx(0.15625)  # 3 s^2 - 2 s^3 at s = 1/4
    assert traj(1.25, "x") == 0.25


def test_time_outside_by_rounding_is_the_end() -> None:
    traj = Trajectory([0.0, 0.3], {"x": [1.0, 2.0]})
    assert 3 * 0.1 > 0.3 and traj(3 * 0.1, "x") == 2.0
    assert traj.resample([0.0, 3 * 0.1]) == traj


# -- new trajectories ---------------------------------------------------------


def test_resample_by_step_keeps_the_end_where_it_fits() -> None:
    traj = Trajectory([0.0, 0.5, 1.2], {"x": [0.0, 5.0, 12.0]}, {"x": "m"}, title="ramp", synthetic="seed 1")
    fine = traj.resample(dt=0.004)
    assert len(fine) == 301 and fine.time[-1] == 1.2
    np.testing.assert_allclose(fine["x"], 10 * fine.time, rtol=ROUNDING, atol=ROUNDING)
    assert (fine.unit("x"), fine.title, fine.synthetic) == ("m", "ramp", "seed 1")
    assert traj.resample(dt=0.5).time.tolist() == [0.0, 0.5, 1.0]
    assert traj.resample(dt=5.0).time.tolist() == [0.0]
    assert traj.resample([0.1, 0.2], kind="previous")["x"].tolist() == [0.0, 0.0]


@quick
@given(st.integers(1, 400), st.integers(1, 400), st.floats(-100, 100))
def test_resample_counts_rows(steps: int, step_ms: int, start: float) -> None:
    end = start + steps * step_ms / 1000
    fine = Trajectory([start, end], {"x": [0.0, 1.0]}).resample(dt=step_ms / 1000)
    assert len(fine) == steps + 1 and fine.time[-1] == end


@quick
@given(trajectories(number=moderate))
def test_resample_on_the_same_grid_changes_nothing(traj: Trajectory) -> None:
    assert traj.resample(traj.time) == traj


def test_select_with_values_and_merge() -> None:
    traj = example()
    chosen = traj.select(["count", "T[2]"])
    assert chosen.names == ("count", "T[2]") and chosen["T[2]"].shape == (4,) and chosen.unit("T[2]") == "m"
    assert traj.select("T").names == ("T",)
    assert chosen.synthetic == traj.synthetic and chosen.provenance == traj.provenance
    changed = traj.with_values({"T": np.zeros((4, 2))}, units={"F": "N"}, F=[1, 2, 3, 4])
    assert changed.names == ("T", "arm[0].rod.tension", "count", "F")
    assert changed["T"].shape == (4, 2) and (changed.unit("T"), changed.unit("F")) == ("m", "N")
    assert traj["T"].shape == (4, 3)
    assert traj.select("T").merge(traj.select(["arm[0].rod.tension", "count"])) == traj
    assert traj.with_values() == traj


def test_merge_keeps_both_notes() -> None:
    a = Trajectory([0.0], {"x": [1.0]}, title="a", provenance={"n": 1}, synthetic="seed 1")
    b = Trajectory([0.0], {"y": [1.0]}, {"y": "m"}, title="b", provenance={"n": 2}, synthetic="seed 2")
    both = a.merge(b)
    assert (both.title, both.synthetic, both.unit("y")) == ("a", "seed 1; seed 2", "m")
    assert both.provenance == {"merged": [{"n": 1}, {"n": 2}]}
    plain = Trajectory([0.0], {"z": [1.0]})
    assert plain.merge(b).provenance == {"n": 2} and plain.merge(b).synthetic == "seed 2"
    assert plain.merge(b).title == "b"


def test_a_trajectory_draws_what_is_named() -> None:
    t = np.linspace(0.0, 1.0, 5)
    run = Trajectory(t, {"q": np.stack([t, t**2], axis=1), "F": np.sin(t)}, {"q": "m", "F": "N"})
    assert len(run.plot().axes) == 2
    (axes,) = run.plot("q[1]", marks=[0.5]).axes
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), t**2)
    with pytest.raises(UnknownNameError):
        run.plot("p")


def test_a_trajectory_becomes_a_pandas_table(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a stand-in that records what pandas gets: pandas is no dependency, not of the tests either."""
    run = Trajectory([0.0, 1.0], {"q": np.eye(2), "F": [3.0, 4.0]}, {"q": "m", "F": "N"})
    monkeypatch.setitem(
        sys.modules,
        "pandas",
        SimpleNamespace(DataFrame=lambda data, index: (data, index), Index=lambda v, name: (v, name)),
    )
    data, (index, label) = run.to_pandas()
    assert list(data) == ["q[0] [m]", "q[1] [m]", "F [N]"] and label == "time [s]"
    np.testing.assert_array_equal(data["q[1] [m]"], [0.0, 1.0])
    np.testing.assert_array_equal(index, [0.0, 1.0])
