"""Times in several columns, of known origin, or one for each channel; formats by file; lines that are no rows."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from gtmodel.measurements import (
    Column,
    Conversion,
    EvenGrid,
    LogError,
    LogForm,
    Signal,
    inspect,
    open_log,
    read_log,
    read_recording,
    read_signals,
    session_of,
)
from gtmodel.measurements.log import ORIGIN, SHORT, left_out, recordings_of
from gtmodel.measurements.signals import Corrections
from gtmodel.results import Trajectory

BEGIN = datetime(2026, 11, 28, 8, 15, 0, 250_000, tzinfo=UTC)
T = 0.01 * np.arange(50)
MICRO = 1e-6  # s; resolution of the written times


def written(folder: Path, name: str, lines: list[str]) -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def split_time(folder: Path) -> Path:
    """Seconds and microseconds since 1970, crossing a full second."""
    micro = [round((BEGIN.timestamp() + 0.5 + t) * 1e6) for t in T]
    lines = [f"{m // 10**6},{m % 10**6},{np.sin(t):.9f}" for m, t in zip(micro, T, strict=True)]
    return written(folder, "egm.csv", ["sec,usec,q", *lines])


def local_time(folder: Path, zone: str) -> Path:
    """Seconds since a local date above the table, which begins 0.5 s before the other file."""
    local = BEGIN.astimezone(timezone(timedelta(hours=1))).replace(tzinfo=None)
    lines = [f"{t:.6f}\t{np.cos(t - 0.5):.9f}" for t in 0.01 * np.arange(120)]
    return written(folder, "torque.log", [f"Log started:\t{local.isoformat(' ')}{zone}", "", "Time\ttau", *lines])


FORM = LogForm(by_file={"*.log": LogForm(header=3)})
PARTS = Column(("sec", "usec"), ("s", "us"))


def test_a_time_is_the_sum_of_its_columns(tmp_path: Path) -> None:
    path = split_time(tmp_path)
    (session,) = read_log(path, {"q": Column("q", "rad")}, time=PARTS)
    # seconds since 1970 as a double: 0.24 us
    np.testing.assert_allclose(session.trajectory.time - session.trajectory.time[0], T, atol=MICRO)
    (session,) = read_log(path, {"q": Column("q", "rad")}, time=PARTS._replace(since="1970-01-01"))
    np.testing.assert_allclose(session.trajectory.time, T, atol=1e-12)
    assert session.trajectory.provenance[ORIGIN] == round(BEGIN.timestamp() * 1e6 + 5e5) * 1000


@pytest.mark.parametrize(
    ("since", "zone", "written_zone"),
    [
        ("Log started", "+01:00", ""),
        ("Log started", "", "+01:00"),
        ("2026-11-28T09:15:00.250", "+01:00", ""),
        ("2026-11-28T09:15:00.25+01:00", "", ""),
    ],
)
def test_clocks_of_known_origin_are_joined(tmp_path: Path, since: str, zone: str, written_zone: str) -> None:
    paths = [split_time(tmp_path), local_time(tmp_path, written_zone)]
    columns = {
        "q": Column("q", "rad", time=PARTS._replace(since="1970-01-01")),
        "tau": Column("tau", "N.m", time=Column("Time", "s", since=since, zone=zone)),
    }
    recording = read_recording(paths, columns, form=FORM)
    np.testing.assert_allclose(recording["torque.log"].time[:2], [0.0, 0.01], atol=MICRO)
    np.testing.assert_allclose(recording["egm.csv"].time, T + 0.5, atol=MICRO)
    files = {"q": "egm*", "tau": "*.log"}
    signals = {n: Signal(c.name, c.unit, time=c.time, file=files[n]) for n, c in columns.items()}
    (session,) = read_signals(paths, signals, form=FORM)
    np.testing.assert_allclose(session.trajectory["tau"], np.cos(T), atol=1e-6)
    assert "by the known origins" in session.trajectory.provenance["joined"][0]


@pytest.mark.parametrize(
    ("time", "said"),
    [
        (Column("Time", "s", since="Begun"), "not in a line above"),
        (Column("Time", "s", since="Log"), ""),
        (Column("Time", "s", since="Log started", zone="CET"), "zone = 'CET'"),
        (Column(("Time", "tau"), ("s", "N.m")), "N.m"),
        (Column("t*", "s", per_channel=True), "on the left of 'tau'"),
    ],
)
def test_a_time_that_cannot_be(tmp_path: Path, time: Column, said: str) -> None:
    path = local_time(tmp_path, "")
    columns = {"tau": Column("tau", "N.m")}
    if not said:
        read_log(path, columns, time=time, form=FORM)
        return
    with pytest.raises(LogError, match=said):
        read_log(path, columns, time=time, form=FORM)


def test_a_declared_origin_needs_the_others(tmp_path: Path) -> None:
    columns = {"q": Column("q", "rad", time=PARTS), "tau": Column("tau", "N.m", time=Column("Time", "s", since="Log"))}
    with pytest.raises(LogError, match=r"egm\.csv.*declare `since`"):
        read_recording(
            [split_time(tmp_path), local_time(tmp_path, "")],
            columns,
            form=LogForm(by_file={"*.log": LogForm(header=3)}),
        )


def test_dates_have_a_zone(tmp_path: Path) -> None:
    lines = [f"{(BEGIN + timedelta(seconds=t)).replace(tzinfo=None).isoformat()},{t}" for t in T]
    path = written(tmp_path, "log.csv", ["date,x", *lines])
    for zone, hours in (("", 0), ("+01:00", 1)):
        (session,) = read_log(path, {"x": Column("x", "m")}, time=Column("date", "s", zone=zone))
        assert session.trajectory.provenance[ORIGIN] == round(BEGIN.timestamp() * 1e6 - 3600e6 * hours) * 1000
    with pytest.raises(LogError, match="leave `since` out"):
        read_log(path, {"x": Column("x", "m")}, time=Column("date", "s", since="1970-01-01"))


def channels(folder: Path, names: tuple[str, str] = ("t", "t")) -> Path:
    """Two channels with 10 ms and 20 ms, the second 3 ms later; times in 100 us; blank cells and a last word."""
    rows = []
    for k, t in enumerate(T):
        first = f"{1e4 * t:.0f};{np.sin(t):.9f}"
        rows.append(f"{first};{200 * k + 30};{np.cos(0.02 * k + 0.003):.9f}" if k < 20 else f"{first};;")
    return written(folder, "scope.csv", [f"{names[0]};x;{names[1]};y", "Offset;0;Offset;0", *rows, "EOF"])


@pytest.mark.parametrize(("names", "time"), [(("t", "t"), "t"), (("t_1", "t_2"), "t_*")])
def test_each_channel_has_its_time(tmp_path: Path, names: tuple[str, str], time: str) -> None:
    path = channels(tmp_path, names)
    clock = Column(time, "100 us", per_channel=True)
    conversion = Conversion(scale=(2.0, -1.0))
    columns = {"z": Column(("x", "y"), "m", conversion=conversion)}
    recording = read_recording(path, columns, time=clock, empty_rows="drop")
    x, y = recording[f"{names[0]} of x"], recording[f"{names[1]} of y"]
    np.testing.assert_allclose(x.time, T, atol=1e-12)
    np.testing.assert_allclose(y.time, 0.02 * np.arange(20) + 0.003, atol=1e-12)
    np.testing.assert_allclose(x["z[0]"], 2 * np.sin(T), atol=1e-8)
    np.testing.assert_allclose(y["z[1]"], -np.cos(y.time), atol=1e-8)
    assert left_out([y]) == {"rows without a number": 1}  # blank cells below are no rows
    (session,) = read_signals([path], {"z": Signal(("x", "y"), "m")}, time=clock, empty_rows="drop")
    grid = session.trajectory.time
    assert grid[0] == 0.01 and grid[-1] == 0.38  # on the rows of x, within those of y
    np.testing.assert_allclose(session.trajectory["z"], np.column_stack([np.sin(grid), np.cos(grid)]), atol=1e-6)
    (one,) = read_log(path, {"y": Column("y", "m")}, time=clock, empty_rows="drop")
    np.testing.assert_array_equal(one.trajectory.time, y.time)
    with pytest.raises(LogError, match="time columns of their own"):
        read_log(path, {"z": Column(("x", "y"), "m")}, time=clock, empty_rows="drop")


def test_a_coupling_needs_one_clock(tmp_path: Path) -> None:
    columns = {"z": Column(("x", "y"), "m", conversion=Conversion(coupling=((1.0, 0.5), (0.0, 1.0))))}
    with pytest.raises(LogError, match="a time column each"):
        read_recording(channels(tmp_path), columns, time=Column("t", "100 us", per_channel=True), empty_rows="drop")


def test_channels_are_inspected(tmp_path: Path) -> None:
    study = inspect(channels(tmp_path))
    assert any('column = "t", unit = ' in note and "per_channel = true" in note for note in study.notes)
    assert any("EOF" in note and "empty_rows" in note for note in study.notes)
    assert [clock.name for clock in study.inspected[0].clocks] == ["t of x", "t of y"]


def test_lines_without_a_number_are_left_out(tmp_path: Path) -> None:
    rows = [f"{k},{k},2" for k in range(8)]
    path = written(tmp_path, "log.csv", ["t,x,y", *rows[:4], "restarted", *rows[4:], "end,of file"])
    (session,) = read_log(path, {"x": Column("x", "m")}, time=Column("t", "s"), empty_rows="drop")
    assert len(session.trajectory) == 8 and left_out([session.trajectory]) == {"rows without a number": 2}
    with pytest.raises(LogError, match=r'line 6: found one cell.*empty_rows = "drop"'):
        read_log(path, {"x": Column("x", "m")}, time=Column("t", "s"))
    path = written(tmp_path, "log.csv", ["t,x,y", *rows[:4], "4,1", *rows[5:]])  # a row of numbers is a fault
    with pytest.raises(LogError, match="line 6: found 2 cells"):
        read_log(path, {"x": Column("x", "m")}, time=Column("t", "s"), empty_rows="drop")


@pytest.mark.parametrize("units", [";[Umdr];[mm]", ";[Umdr];[Foo]", "[s];[U/min];[mm]"])
def test_a_row_of_units_in_german(tmp_path: Path, units: str) -> None:
    path = written(tmp_path, "log.csv", ["t;a;b", units, *(f"{k};{k};{k}" for k in range(5))])
    (stream,) = open_log(path)
    assert stream.heads.units[1] == ("rpm" if "min" in units else "rev") and stream.layout.first_row == 3


def test_stretches_of_a_recording_share_an_offset(tmp_path: Path) -> None:
    """Two long gaps leave three stretches, the middle one too short."""
    paths = []
    for n in (1, 2):
        rows = [f"{0.01 * k:.2f},{np.sin(0.1 * k) + n}" for k in range(200) if not (50 <= k < 80 or 85 <= k < 120)]
        paths.append(written(tmp_path, f"{n}.csv", ["time,x", *rows]))
    signals = {"x": Signal("x", "m", offset="estimate")}
    sessions = read_signals(paths, signals, grid=EvenGrid(sample_time=0.01))
    assert [s.stretch for s in sessions] == [0, 1, 0, 1] and recordings_of(sessions) == [0, 0, 1, 1]
    assert left_out(s.trajectory for s in sessions) == {SHORT: 10}
    corrections = Corrections(signals, sessions)
    assert [free.name for free in corrections.free] == ["x.offset of session 1", "x.offset of session 2"]
    moved = corrections.apply([1.0, 2.0])
    for session in moved:
        np.testing.assert_allclose(session.trajectory["x"], np.sin(10 * session.trajectory.time), atol=1e-6)
    assert recordings_of(moved) == [0, 0, 1, 1]


def test_components_have_units_of_their_own() -> None:
    conversion = Conversion(scale=(2.0, 3.0), gear_ratio=(10.0, 10.0), quantity_unit=("N.m", "N"))
    np.testing.assert_allclose(conversion.apply([[1.0, 1.0]], ["1"]), [[20.0, 30.0]])  # efforts are multiplied
    assert conversion.si_unit(["1"]) == "1" and conversion.is_effort(["1"])
    assert Conversion(quantity_unit=("N.m", "N.m")).si_unit(["N.m", "N.m"]) == "N.m"
    with pytest.raises(LogError, match="3 units for 2 columns"):
        Conversion(scale=2.0, quantity_unit=("N", "N", "N")).apply([[1.0, 1.0]], ["1", "1"])
    signal = Signal(("a", "b"), ("V", "V"), scale=(2.0, 3.0), quantity_unit=("N.m", "N"))
    log = Trajectory(T, {"f": np.ones((50, 2))}, {"f": "V"})
    (session,) = Corrections({"f": signal}, [session_of(log)]).apply()
    np.testing.assert_allclose(session.trajectory["f"][0], [2.0, 3.0])
