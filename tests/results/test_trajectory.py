"""Trajectory: access, interpolation, derived trajectories, files, and the sentences of its errors."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gtmodel.results import Trajectory, TrajectoryError, UnknownNameError

TIME = [0.0, 0.1, 0.3, 0.6]
ROUNDING = 1e-12  # relative; interpolation weights round a few times


def example(**changes: Any) -> Trajectory:
    """A vector and two scalar signals over four rows."""
    arguments: dict[str, Any] = {
        "time": TIME,
        "values": {
            "T": [[0.0, 1.0, -2.0], [0.5, 1.0, -2.5], [1.0, 1.0, -3.0], [1.5, 1.0, -7.25]],
            "arm[0].rod.tension": [1.0, -20.0, 3.0, 4.0],
            "count": [0, 1, 2, 3],
        },
        "units": {"T": "m", "arm[0].rod.tension": "N/m"},
        "title": "Point to point",
        "provenance": {"robot": "l1_tape", "limits": {"force_N": 500.0}, "seeds": [1, 2]},
        "synthetic": "seed 3, 10 um noise",
    }
    arguments.update(changes)
    return Trajectory(arguments.pop("time"), arguments.pop("values"), arguments.pop("units"), **arguments)


finite = st.floats(allow_nan=False, allow_infinity=False)
moderate = st.floats(min_value=-1e6, max_value=1e6)
eighths = st.integers(-1000, 1000).map(lambda i: i / 8)
AWKWARD = [
    "x",
    "x[0]",
    "x[1]",
    "x[0][2]",
    "x[01]",
    "time[0]",
    "der(x)",
    "arm[0].x",
    "Δω'",
    "title:",
    "x#",
    "[0]",
]
AWKWARD_NOTES = ["", "{}", "a: b, c", "# title: x", "ñ–²", '"quoted"']
ORIGINS: list[dict[str, Any]] = [{}, {"b": [1, 0.1, None], "a": {"ü": "line\nbreak"}}]
quick = settings(
    max_examples=30,
    deadline=None,  # scipy is imported on first use
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # files of one test share a folder
)


@st.composite
def trajectories(draw: st.DrawFn, number: st.SearchStrategy[float] = finite) -> Trajectory:
    """Any trajectory of up to four rows: awkward names and notes, scalar and vector signals."""
    time = sorted(draw(st.lists(number, min_size=1, max_size=4, unique=True)))
    values: dict[str, Any] = {}
    taken: set[str] = set()
    for name in draw(st.lists(st.sampled_from(AWKWARD), min_size=1, max_size=4, unique=True)):
        k = draw(st.integers(0, 3))
        own = {name, *(f"{name}[{i}]" for i in range(k))}
        if not own & taken:
            taken |= own
            count = len(time) * max(k, 1)
            data = np.array(draw(st.lists(number, min_size=count, max_size=count)))
            values[name] = data.reshape(len(time), k) if k else data
    return Trajectory(
        time,
        values,
        {name: draw(st.sampled_from(["m", "N.m", "rad/s", "1", "N m", ""])) for name in values},
        title=draw(st.sampled_from(AWKWARD_NOTES)),
        provenance=draw(st.sampled_from(ORIGINS)),
        synthetic=draw(st.sampled_from([None, *AWKWARD_NOTES[1:]])),
    )


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


# -- files --------------------------------------------------------------------


@quick
@given(traj=trajectories())
def test_csv_round_trip_is_exact(tmp_path: Path, traj: Trajectory) -> None:
    first, second = tmp_path / "first.csv", tmp_path / "second.csv"
    traj.to_csv(first, overwrite=True)
    again = Trajectory.from_csv(first)
    assert again == traj
    for name in traj.names:
        assert again[name].tobytes() == traj[name].tobytes()  # -0.0 too
    again.to_csv(second, overwrite=True)
    assert first.read_bytes() == second.read_bytes()


@quick
@given(traj=trajectories())
def test_npz_round_trip_is_exact(tmp_path: Path, traj: Trajectory) -> None:
    first, second = tmp_path / "first.npz", tmp_path / "second.npz"
    traj.to_npz(first, overwrite=True)
    again = Trajectory.from_npz(first)
    assert again == traj
    assert all(again[name].tobytes() == traj[name].tobytes() for name in traj.names)
    again.to_npz(second, overwrite=True)
    assert first.read_bytes() == second.read_bytes()


def test_text_of_a_csv_file(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    traj = Trajectory(
        [0.0, 0.1],
        {"T": [[1.0, -0.0], [1e-5, 1 / 3]], "x[0]": [2, 3]},
        {"T": "m", "x[0]": "rad/s"},
        title="Line",
        provenance={"b": 1, "a": [2.5]},
        synthetic="seed 1",
    )
    traj.to_csv(path)
    assert path.read_bytes() == (
        b"# title: Line\n"
        b"# synthetic: seed 1\n"
        b'# provenance: {"a": [2.5], "b": 1}\n'
        b"# scalar: x[0]\n"
        b"time [s],T[0] [m],T[1] [m],x[0] [rad/s]\n"
        b"0.0,1.0,-0.0,2.0\n"
        b"0.1,1e-05,0.3333333333333333,3.0\n"
    )
    assert Trajectory.from_csv(path) == traj
    plain = tmp_path / "plain.csv"
    Trajectory([0.0], {"x": [1.0]}).to_csv(plain)
    assert plain.read_bytes() == b"time [s],x [1]\n0.0,1.0\n"


def test_a_measurement_is_read_and_converted_to_si(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_bytes(
        b"\xef\xbb\xbf# laser tracker\r\n# Title: Run 7\r\ntime [ms], q[0] [mm] ,q[1] [mm],speed [rpm]\r\n"
        b"0,1, 2,60\r\n9,1.5,2e1,-60\r\n# synthetic: seed 5\r\n\r\n"
    )
    traj = Trajectory.from_csv(path)
    assert traj.time.tolist() == [0.0, 0.009]
    assert traj["q"].tolist() == [[0.001, 0.002], [0.0015, 0.02]]
    assert (traj.unit("q"), traj.unit("speed"), traj.title, traj.synthetic) == (
        "m",
        "rad/s",
        "Run 7",
        "seed 5",
    )
    np.testing.assert_allclose(traj["speed"], [2 * np.pi, -2 * np.pi], rtol=ROUNDING)


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("q[0] [m],q[1] [m]", ("q",)),
        ("q[0] [m],q[1] [rad]", ("q[0]", "q[1]")),
        ("q[1] [m],q[0] [m]", ("q[1]", "q[0]")),
        ("q[1] [m],q[2] [m]", ("q[1]", "q[2]")),
        ("q[0] [m],q[2] [m]", ("q[0]", "q[2]")),
        ("q[0] [m],x [m],q[1] [m]", ("q[0]", "x", "q[1]")),
        ("q [m],q[0] [m],q[1] [m]", ("q", "q[0]", "q[1]")),
        ("q[0] [m],q[1] [mm]", ("q",)),
        ("q[00] [m],q[01] [m]", ("q[00]", "q[01]")),
        ("q[0][0] [m],q[0][1] [m],q[1][0] [m]", ("q[0]", "q[1]")),
        ("arm[0].x [m],arm[1].x [m]", ("arm[0].x", "arm[1].x")),
        ("time[0] [m]", ("time[0]",)),
    ],
)
def test_which_columns_become_a_vector(tmp_path: Path, header: str, expected: tuple[str, ...]) -> None:
    path = tmp_path / "h.csv"
    path.write_text(f"time [s],{header}\n0{',1' * (header.count(',') + 1)}\n")
    assert Trajectory.from_csv(path).names == expected


def test_files_are_not_overwritten_unasked(tmp_path: Path) -> None:
    traj = example()
    for write, path in ((traj.to_csv, tmp_path / "a.csv"), (traj.to_npz, tmp_path / "a.npz")):
        path.write_text("precious")
        with pytest.raises(FileExistsError) as caught:
            write(path)
        assert str(caught.value) == (
            f"{path} is already there and was left alone; choose another path or pass overwrite=True"
        )
        assert path.read_text() == "precious"
        write(path, overwrite=True)
        assert path.read_bytes() != b"precious"


def test_npz_of_another_program(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    np.savez(path, a=np.zeros(3))
    with pytest.raises(TrajectoryError, match=r"other.npz is not a trajectory written by to_npz\(\)"):
        Trajectory.from_npz(path)
    path.write_text("hello")
    with pytest.raises(TrajectoryError, match="is not a trajectory"):
        Trajectory.from_npz(path)
    for read in (Trajectory.from_npz, Trajectory.from_csv):
        with pytest.raises(FileNotFoundError):
            read(tmp_path / "missing")


# -- sentences ----------------------------------------------------------------

NAN, INF = float("nan"), float("inf")
SIX = np.zeros((4, 3))
SIX[2, 1] = NAN


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"time": [0.0, 0.2, 0.2, 0.3]},
            "time[2] = 0.2 s does not come after time[1] = 0.2 s; time must increase strictly, so sort the "
            "rows or remove the repeated one",
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
        ({"values": {"x": ["a", "b", "c", "d"]}}, "signal 'x' holds <U1 data; expected real numbers"),
        ({"values": {"x": [1j, 0, 0, 0]}}, "signal 'x' holds complex128 data; expected real numbers"),
        ({"values": {}}, "a trajectory needs at least one signal; values is empty"),
        ({"values": {3: TIME}}, "a signal is named 3 of type int; expected a text"),
        (
            {"values": {"a b": TIME}},
            "signal name 'a b' cannot be written to a file; expected printable characters without "
            "blank or quote and no leading '#'",
        ),
        (
            {"values": {"time": TIME}},
            "a signal is named 'time', which is the name of the time grid; choose another name",
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
    with pytest.raises(TrajectoryError, match=r"signal 'x' is no array .*; expected rows of equal length"):
        Trajectory([0.0, 1.0], {"x": [[1.0], [1.0, 2.0]]})


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (
            "arm[0].rod.tensoin",
            "there is no signal 'arm[0].rod.tensoin'; close matches are 'arm[0].rod.tension'",
        ),
        ("T[3]", "there is no component 'T[3]': signal 'T' has 3, from 'T[0]' to 'T[2]'"),
        ("t[0]", "there is no signal 't[0]'; close matches are 'T[0]'"),
        ("zzz", "there is no signal 'zzz'; the trajectory holds 'T', 'arm[0].rod.tension', 'count'"),
        ("count[0]", "there is no signal 'count[0]'; close matches are 'count'"),
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
    assert str(caught.value) == "units names the signal 'coumt'; close matches are 'count'"
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
            "signal 'T' is in both trajectories; use select() or with_values() to say which one is meant",
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


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "FILE has no header; expected a line such as 'time [s],q[0] [m]'"),
        ("# title: x\n", "FILE has no header; expected a line such as 'time [s],q[0] [m]'"),
        ("time [s],x [m]\n\n", "FILE has a header but no rows; expected a row of numbers for each time"),
        (
            "time [s],T[0]\n0,1\n",
            "FILE line 1, column 2: 'T[0]' has no unit; expected 'name [unit]', such as 'q[0] [m]'",
        ),
        (
            "time,x [m]\n0,1\n",
            "FILE line 1, column 1: 'time' has no unit; expected 'name [unit]', such as 'q[0] [m]'",
        ),
        (
            "time [s],x []\n0,1\n",
            "FILE line 1, column 2: 'x []' has no unit; expected 'name [unit]', such as 'q[0] [m]'",
        ),
        (
            "# note\ntime [s],x [kgg]\n0,1\n",
            "FILE line 2, column 2: unit 'kgg' holds the unknown symbol 'kgg'; close matches are 'kg', 'g', 'kg.g'",
        ),
        (
            "t [s],x [m]\n0,1\n",
            "FILE line 1, column 1: found 't [s]'; expected the time, as 'time [s]' or 'time [ms]'",
        ),
        (
            "time [m],x [m]\n0,1\n",
            "FILE line 1, column 1: found 'time [m]'; expected the time, as 'time [s]' or 'time [ms]'",
        ),
        (
            "time [s],x [m],x [m]\n0,1,2\n",
            "FILE line 1, column 3: the name 'x' occurs twice; give every column its own name",
        ),
        (
            "time [s],time [s]\n0,1\n",
            "FILE line 1, column 2: a signal is named 'time', which is the name of the time grid; choose another name",
        ),
        (
            "time [s]\n0\n",
            "FILE line 1: there is no column besides the time; expected at least one signal",
        ),
        (
            "time [s];x [m]\n0;1\n",
            "FILE line 1: the columns are not separated by ','; save the file with commas and decimal points",
        ),
        (
            "# a\ntime [s],x [m]\n0,1\n1,abc\n",
            "FILE line 4, column 'x': found 'abc'; expected a finite number such as 1.5e-3",
        ),
        (
            "time [s],T[0] [m],T[1] [m]\n0,1,nan\n",
            "FILE line 2, column 'T[1]': found 'nan'; expected a finite number such as 1.5e-3",
        ),
        (
            "time [s],x [m]\n0,\n",
            "FILE line 2, column 'x': found ''; expected a finite number such as 1.5e-3",
        ),
        (
            "time [s],x [m]\n0,1e999\n",
            "FILE line 2, column 'x': found '1e999'; expected a finite number such as 1.5e-3",
        ),
        (
            "time [s],x [m]\n0,1_0\n",
            "FILE line 2, column 'x': found '1_0'; expected a finite number such as 1.5e-3",
        ),
        (
            "time [s],x [m]\n0,1\n1,2,3\n",
            "FILE line 3: found 3 cells; expected 2, one for each column of the header",
        ),
        (
            "time [s],x [m]\n0,1\n\n1,2\n",
            "FILE line 3: found 1 cells; expected 2, one for each column of the header",
        ),
        (
            "time [ms],x [m]\n0,1\n# pause\n4,1\n4,2\n",
            "FILE line 5, column 'time': 4.0 ms does not come after 4.0 ms in line 4; time must increase "
            "strictly, so sort the rows or remove the repeated one",
        ),
        (
            "# synthetic:\ntime [s],x [m]\n0,1\n",
            "FILE: synthetic is empty; give seed and noise in one line, or None for real data",
        ),
        (
            "# provenance: [1]\ntime [s],x [m]\n0,1\n",
            "FILE: the note '# provenance:' must hold one JSON dictionary in one line",
        ),
        (
            "# provenance: {\ntime [s],x [m]\n0,1\n",
            "FILE: the note '# provenance:' is no JSON (Expecting property name enclosed in double quotes: "
            "line 1 column 2 (char 1)); correct or remove it",
        ),
    ],
)
def test_what_from_csv_refuses(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(TrajectoryError) as caught:
        Trajectory.from_csv(path)
    assert str(caught.value) == sentence.replace("FILE", str(path))


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_bytes(b"time [s],x [m]\n0,\xff\n")
    with pytest.raises(TrajectoryError, match=r"is not a UTF-8 text file .*; save it as UTF-8"):
        Trajectory.from_csv(path)
