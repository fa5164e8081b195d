"""Files of all kinds give the numbers that were written, to the last bit, under the names that their kind has."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from gtmodel.measurements import Column, LogError, LogForm, inspect, open_log, read_log, read_recording, sampling_of
from gtmodel.measurements.signal_table import read as read_table
from gtmodel.measurements.streams.stream import Lines

T = np.arange(40) * 0.004
Q = np.random.default_rng(1).standard_normal((40, 3)) * np.array([1.0, 1e-7, 1e9])  # synthetic: seed 1


def csv(sign: str = ",", head: str = "t [s],x [m],y,z", end: str = "\n", point: str = ".") -> str:
    rows = [sign.join(map(repr, row)).replace(".", point) for row in np.column_stack([T, Q]).tolist()]
    return end.join([head.replace(",", sign), *rows, ""])


def columns_of(path: Path, form: LogForm = LogForm(), names: tuple[str, ...] = ("t", "x", "y", "z")) -> np.ndarray:  # noqa: B008
    (stream,) = open_log(path, form)
    return stream.read({"all": list(names)}).values["all"]


XYZ = ("t", "x", "y", "z")
WRITTEN = np.column_stack([T, Q])
QUOTED = '"t","x","y","z"\n' + "\n".join(",".join(f'"{x!r}"' for x in row) for row in WRITTEN.tolist())
TEXTS: dict[str, tuple[bytes, LogForm, tuple[str, ...]]] = {
    "commas": (csv().encode(), LogForm(), XYZ),
    "semicolons": (csv(";").encode(), LogForm(), XYZ),
    "tabs": (csv("\t").encode(), LogForm(), XYZ),
    "bars": (csv("|").encode(), LogForm(), XYZ),
    "blanks": (csv(" ", "t,x,y,z").encode(), LogForm(), XYZ),
    "blanks, units in the header": (csv(" ").encode(), LogForm(), XYZ),
    "blanks on the left": (csv(" ", "t,x,y,z").replace("\n", "\n   ").encode(), LogForm(), XYZ),
    "decimal commas": (csv(";", point=",").encode(), LogForm(decimal="comma"), XYZ),
    "decimal commas and tabs": (csv("\t", point=",").encode(), LogForm(decimal="comma"), XYZ),
    "UTF-8 with its mark": (csv().encode("utf-8-sig"), LogForm(), XYZ),
    "UTF-16": (csv().encode("utf-16"), LogForm(), XYZ),
    "UTF-16, big end first": (b"\xfe\xff" + csv().encode("utf-16-be"), LogForm(), XYZ),
    "cp1252": (csv(head="t,Ä,y,z").encode("cp1252"), LogForm(encoding="cp1252"), ("t", "Ä", "y", "z")),
    "Windows": (csv(end="\r\n").encode(), LogForm(), XYZ),
    "an old Mac": (csv(end="\r").encode(), LogForm(), XYZ),
    "no line end at the end": (csv().rstrip().encode(), LogForm(), XYZ),
    "no header": (csv().partition("\n")[2].encode(), LogForm(), ("1", "2", "3", "4")),
    "no header, said so": (csv().partition("\n")[2].encode(), LogForm(header=0), ("1", "2", "3", "4")),
    "names in a comment": (("# made by numpy\n# " + csv()).encode(), LogForm(), XYZ),
    "a row of units": (csv(head="t,x,y,z\ns,m,m,deg").encode(), LogForm(), XYZ),
    "units in parentheses": (csv(head="t (s),x (m),y (mm),z").encode(), LogForm(), XYZ),
    "the cell with its unit": (csv(head="t (s),x (m),y (mm),z").encode(), LogForm(), ("t (s)", "x", "y (mm)", "z")),
    "names of two words": (csv(head='t,"motor, left",y,z').encode(), LogForm(), ("t", "motor, left", "y", "z")),
    "lines of a program above": (("Rate 250\n\nLog of 3 axes\n" + csv()).encode(), LogForm(header=4), XYZ),
    "comments and blank lines between": (csv().replace("\n", "\n# x\n\n", 3).encode(), LogForm(), XYZ),
    "a delimiter behind each row": (csv(end=",\n").encode(), LogForm(), XYZ),
    "a delimiter behind the rows alone": (csv(end=",\n").replace(",\n", "\n", 1).encode(), LogForm(), XYZ),
    "quoted cells": (QUOTED.encode(), LogForm(), XYZ),
}  # fmt: skip


@pytest.mark.parametrize("kind", TEXTS)
def test_a_text_file_of_any_form_gives_its_numbers_to_the_last_bit(tmp_path: Path, kind: str) -> None:
    content, form, names = TEXTS[kind]
    path = tmp_path / "log.txt"
    path.write_bytes(content)
    np.testing.assert_array_equal(columns_of(path, form, names), WRITTEN)


def test_blocks_of_any_size_read_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.csv"
    for name, end in (("\\n", "\n"), ("\\r\\n", "\r\n"), ("\\r", "\r")):
        path.write_bytes(csv(end=end).encode())
        for size in (1, 7, 64, 1000):
            monkeypatch.setattr("gtmodel.measurements.streams.text.chunks", _chunks_of(size))
            (stream,) = open_log(path)
            rows = stream.read({"all": ["t", "x", "y", "z"]})
            np.testing.assert_array_equal(rows.values["all"], WRITTEN, err_msg=f"{name} by {size}")
            assert rows.lines.array().tolist() == list(range(2, 42))


def _chunks_of(size: int) -> Any:
    from gtmodel.measurements.streams import text_lines

    return lambda path, encoding: text_lines.chunks(path, encoding, size)


def test_a_decimal_comma_is_not_guessed(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(csv(";", point=","))
    with pytest.raises(LogError, match=r'line 2, column .*decimal = "comma"'):
        columns_of(path)


def test_numbers_of_lines_survive_what_is_left_out() -> None:
    lines = Lines()
    for part in ([2, 3, 4], [7, 8], [20], [21, 30]):
        lines.extend(np.array(part))
    assert lines.array().tolist() == [2, 3, 4, 7, 8, 20, 21, 30]
    assert [lines[k] for k in range(len(lines))] == lines.array().tolist()


def test_units_of_a_header_are_those_of_the_field(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t [sec],M (Nm),w [°/s],x[mm],der(T),a [m/s²]\n0,1,2,3,4,5\n1,1,2,3,4,5\n")
    heads = open_log(path)[0].heads
    assert heads.names == ["t", "M", "w", "x", "der(T)", "a"] and heads.units == ["s", "N.m", "deg/s", "mm", "", "m/s2"]


# -- MATLAB ----


def mat(path: Path, **variables: object) -> Path:
    savemat(path, variables)
    return path


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("inside", ["", "rec."])
def test_matrices_of_a_matlab_file_either_way_round(tmp_path: Path, inside: str, turned: bool) -> None:
    data = {"t": T[None] if turned else T[:, None], "q": Q.T if turned else Q, "gain": 3.0, "name": "robot"}
    path = mat(tmp_path / "log.mat", **({"rec": data, "other": 1.0} if inside else data))
    (session,) = read_log(path, {"q": Column(f"{inside}q", "m")}, time=Column(f"{inside}t", "s"))
    np.testing.assert_array_equal(session.trajectory["q"], Q)


def test_transformations_are_numbered_row_by_row(tmp_path: Path) -> None:
    poses = np.arange(4 * 4 * 40.0).reshape(4, 4, 40)
    path = mat(tmp_path / "log.mat", T=poses, t=T)
    (session,) = read_log(path, {"T": Column("T", "m")}, time=Column("t", "s"))
    np.testing.assert_array_equal(session.trajectory["T"][7].reshape(4, 4), poses[:, :, 7])


def test_without_a_time_samples_are_what_there_is_more_of(tmp_path: Path) -> None:
    path = mat(
        tmp_path / "log.mat", gain=np.arange(6.0), q=np.zeros((6, 500)), few=np.zeros((7, 9)), run=np.arange(7.0)
    )
    streams = {stream.name: set(stream.heads.names) for stream in open_log(path)}
    assert streams["500 samples"] == {f"q[{k}]" for k in range(6)}
    assert streams["7 samples"] == {*(f"few[{k}]" for k in range(9)), "run"}


def test_a_square_matrix_needs_a_word(tmp_path: Path) -> None:
    square = Q[:3]
    path = mat(tmp_path / "log.mat", t=T[:3], q=square)
    with pytest.raises(LogError, match="square matrix"):
        read_log(path, {"q": Column("q", "m")}, time=Column("t", "s"))
    for samples, expected in (("rows", square), ("columns", square.T)):
        form = LogForm(samples=samples)  # type: ignore[arg-type]
        (session,) = read_log(path, {"q": Column("q", "m")}, time=Column("t", "s"), form=form)
        np.testing.assert_array_equal(session.trajectory["q"], expected)


def test_arrays_of_structs_and_integers(tmp_path: Path) -> None:
    runs = np.array([(T, Q[:, 0]), (T, Q[:, 1])], dtype=[("t", "O"), ("x", "O")])
    path = mat(tmp_path / "log.mat", run=runs, k=np.arange(40, dtype=np.int16))
    (session,) = read_log(path, {"x": Column("run[1].x", "m"), "k": Column("k", "1")}, time=Column("run[1].t", "s"))
    np.testing.assert_array_equal(session.trajectory["x"], Q[:, 1])
    np.testing.assert_array_equal(session.trajectory["k"], np.arange(40.0))


def test_a_matlab_file_of_version_7_3(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        rec = file.create_group("rec")
        for name, value in (("t", T[:, None]), ("q", Q)):  # MATLAB stores the transpose
            rec.create_dataset(name, data=value.T).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("name", data=np.array([[82], [79]], dtype=np.uint16)).attrs["MATLAB_class"] = np.bytes_(
            "char"
        )
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)
    (session,) = read_log(path, {"q": Column("rec.q", "m")}, time=Column("rec.t", "s"))
    np.testing.assert_array_equal(session.trajectory["q"], Q)


# -- Parquet and bags ----


def test_a_parquet_file(tmp_path: Path) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    nanoseconds = (T * 1e9).round().astype(np.int64)
    x, y, z = Q.T
    table = arrow.table(
        {
            "stamp": arrow.array(1_700_000_000_000_000_000 + nanoseconds, arrow.timestamp("ns")),
            "x": x,
            "p": arrow.StructArray.from_arrays([arrow.array(y), arrow.array(z)], ["y", "z"]),
            "q": arrow.FixedSizeListArray.from_arrays(arrow.array(Q.ravel()), 3),
            "gap": arrow.array([None, *x[1:].tolist()]),
            "word": ["a"] * 40,
        }
    )
    parquet.write_table(table, tmp_path / "log.parquet", row_group_size=7)
    columns = {"x": Column("x", "m"), "z": Column("p.z", "m"), "q": Column("q", "m")}
    (session,) = read_log(tmp_path / "log.parquet", columns)  # its own time stamps are the time
    np.testing.assert_array_equal(session.trajectory["x"], x)
    np.testing.assert_array_equal(session.trajectory["z"], z)
    np.testing.assert_array_equal(session.trajectory["q"], Q)
    np.testing.assert_allclose(session.trajectory.time, T, atol=1e-12)
    with pytest.raises(LogError, match="row 1, column 'gap'"):
        read_log(tmp_path / "log.parquet", {"x": Column("gap", "m")})
    with pytest.raises(LogError, match="'word' holds string"):
        read_log(tmp_path / "log.parquet", {"x": Column("word", "m")})


START = 1_700_000_000_000_000_000  # ns
LATE = 2_500_000  # ns, from the stamp of a header to its arrival


@dataclass
class Bags:
    """Three bags of one recording: /imu with stamps, at 250 Hz, and /force without, at half of that."""

    folder: Path

    def write(self, kind: str) -> Path:
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
        from rosbags.typesys import Stores, get_typestore

        first = kind == "ros1"
        store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
        types = store.types
        path = self.folder / ("log.bag" if first else f"log_{kind}")
        plugin = {} if first else {"version": 9, "storage_plugin": StoragePlugin[kind]}
        with Writer1(path) if first else Writer2(path, **plugin) as bag:
            imu = bag.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
            force = bag.add_connection("/force", "std_msgs/msg/Float64", typestore=store)
            for k, t in enumerate((T * 1e9).round().astype(np.int64).tolist()):
                stamp = types["builtin_interfaces/msg/Time"](*divmod(START + t, 10**9))
                header = types["std_msgs/msg/Header"](**({"seq": k} if first else {}), stamp=stamp, frame_id="imu")
                vector, turn = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
                message = types["sensor_msgs/msg/Imu"](
                    header, turn(0.0, 0.0, 0.0, 1.0), np.zeros(9), vector(*Q[k].tolist()), np.zeros(9),
                    vector(0.0, 0.0, 9.81), np.zeros(9),
                )  # fmt: skip
                write = store.serialize_ros1 if first else store.serialize_cdr
                bag.write(imu, START + t + LATE, write(message, "sensor_msgs/msg/Imu"))
                if k % 2 == 0:
                    one = types["std_msgs/msg/Float64"](float(Q[k, 0]))
                    bag.write(force, START + t + LATE, write(one, "std_msgs/msg/Float64"))
        return path


KINDS = ["ros1", "SQLITE3", "MCAP"]


@pytest.mark.parametrize("kind", KINDS)
def test_bags(tmp_path: Path, kind: str) -> None:
    pytest.importorskip("rosbags")
    path = Bags(tmp_path).write(kind)
    streams = {stream.name: stream for stream in open_log(path)}
    assert set(streams) == {"/imu", "/force"}
    assert streams["/imu"].clock == "header.stamp" and "stamp of the header" in streams["/imu"].remarks[0]
    assert streams["/force"].clock == "receive_time" and "time of reception" in streams["/force"].remarks[0]
    names = tuple(f"angular_velocity.{x}" for x in "xyz")
    columns = {"w": Column(names, "rad/s", stream="/imu"), "f": Column("data", "N", stream="/force")}
    recording = read_recording(path, columns)
    np.testing.assert_array_equal(recording["/imu"]["w"], Q)
    np.testing.assert_array_equal(recording["/force"]["f"], Q[::2, 0])
    # both count from the first message of the bag: nanoseconds of today have more digits than a double
    np.testing.assert_allclose(recording["/imu"].time, T - LATE * 1e-9, atol=1e-12)
    np.testing.assert_allclose(recording["/force"].time, T[::2], atol=1e-12)
    if kind != "ros1":
        inside = path / "metadata.yaml"
        assert {stream.name for stream in open_log(inside)} == set(streams)
    if kind == "MCAP":
        (file,) = path.glob("*.mcap")
        assert {stream.name for stream in open_log(file)} == set(streams)
    (session,) = read_log(path, {"w": columns["w"]}, form=LogForm(stream="/imu"))
    assert session.sample_time == pytest.approx(0.004, rel=1e-9)


def joint_states(folder: Path, kind: str, messages: list[tuple[str, list[str], list[float]]]) -> Path:
    """A bag of JointStates, each (node, names, positions), 10 ms apart; velocities are ten times the positions."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    first = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    types, name = store.types, "sensor_msgs/msg/JointState"
    path = folder / ("joints.bag" if first else f"joints_{kind}")
    with Writer1(path) if first else Writer2(path, version=9, storage_plugin=StoragePlugin[kind]) as bag:
        made = {}
        for k, (node, names, position) in enumerate(messages):
            more: dict[str, Any] = {"callerid": node} if first else {}
            if node not in made and (first or not made):
                made[node] = bag.add_connection("/joints", name, typestore=store, **more)
            stamp = types["builtin_interfaces/msg/Time"](*divmod(START + k * 10**7, 10**9))
            header = types["std_msgs/msg/Header"](**({"seq": k} if first else {}), stamp=stamp, frame_id="")
            message = types[name](header, names, np.array(position), 10 * np.array(position), np.zeros(0))
            write = store.serialize_ros1 if first else store.serialize_cdr
            bag.write(made.get(node, next(iter(made.values()))), START + k * 10**7, write(message, name))
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_joints_are_columns_by_name_whatever_the_order(tmp_path: Path, kind: str) -> None:
    pytest.importorskip("rosbags")
    orders = [["elbow", "wrist"], ["wrist", "elbow"]]
    truth = {"elbow": 1.0, "wrist": -2.0}
    messages = [("/arm", names, [truth[n] + k for n in names]) for k, names in enumerate(orders * 5)]
    (stream,) = open_log(joint_states(tmp_path, kind, messages))
    assert stream.name == "/joints"
    read = stream.read({"all": ["position[elbow]", "position[wrist]", "velocity[wrist]"]}).values["all"]
    k = np.arange(10.0)
    np.testing.assert_array_equal(read, np.column_stack([1 + k, k - 2, 10 * (k - 2)]))


@pytest.mark.parametrize("kind", KINDS)
def test_publishers_of_one_topic_are_streams_of_their_own(tmp_path: Path, kind: str) -> None:
    pytest.importorskip("rosbags")
    arm, hand = ["elbow", "wrist"], ["finger"]
    messages = [("/arm", arm, [1.0 * k, -1.0 * k]) if k % 2 else ("/hand", hand, [100.0 + k]) for k in range(20)]
    path = joint_states(tmp_path, kind, messages)
    of_arm, of_hand = (" from /arm", " from /hand") if kind == "ros1" else ("", "")  # a ROS 2 bag names no node
    names = [f"/joints{of_arm} [elbow, wrist]", f"/joints{of_hand} [finger]"]
    streams = {stream.name: stream for stream in open_log(path)}
    assert set(streams) == {*names}
    wrist = streams[names[0]].read({"q": ["position[wrist]"]}).values["q"][:, 0]
    np.testing.assert_array_equal(wrist, -np.arange(1.0, 20, 2))
    finger = streams[names[1]].read({"q": ["position[finger]"]}).values["q"][:, 0]
    np.testing.assert_array_equal(finger, 100 + np.arange(0.0, 20, 2))
    with pytest.raises(LogError, match="several streams"):
        read_log(path, {"q": Column("position[elbow]", "rad")})


def test_two_nodes_with_the_same_joints_are_not_mixed(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    messages = [("/real" if k % 2 else "/model", ["elbow"], [1.0 * k]) for k in range(20)]
    streams = open_log(joint_states(tmp_path, "ros1", messages))
    assert [stream.name for stream in streams] == ["/joints from /model [elbow]", "/joints from /real [elbow]"]


def test_a_joint_that_is_named_twice_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    messages = [("/arm", ["elbow", "elbow"], [0.0, 1.0])] * 5
    with pytest.raises(LogError, match="'elbow' twice"):
        open_log(joint_states(tmp_path, "SQLITE3", messages))


def test_stamps_of_two_files_are_of_one_clock(tmp_path: Path) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    for name, begin in (("a", START), ("b", START + 1_500_000_001)):
        stamps = arrow.array(begin + 4_000_000 * np.arange(40), arrow.timestamp("ns"))
        later = arrow.array([None, *(begin + 4_000_000 * np.arange(1, 40) + 7).tolist()], arrow.timestamp("ns"))
        table = arrow.table({"stamp": stamps, "arrived": later, name: Q[:, 0]})
        parquet.write_table(table, tmp_path / f"{name}.parquet")
    paths = [tmp_path / "b.parquet", tmp_path / "a.parquet"]
    recording = read_recording(paths, {"a": Column("a", "m"), "b": Column("b", "m")})
    np.testing.assert_allclose(recording["a.parquet"].time, T, atol=1e-12)
    np.testing.assert_allclose(recording["b.parquet"].time, T + 1.500000001, atol=1e-12)
    own = Column("arrived", "s")
    late = read_recording(paths[1], {"a": Column("a", "m", own)}, empty_rows="drop")["arrived"]
    np.testing.assert_allclose(late.time, T[1:] + 7e-9, atol=1e-12)


@pytest.mark.parametrize(("between", "end"), [("T", ""), (" ", ""), ("T", "Z")])
def test_dates_are_seconds_after_the_first(tmp_path: Path, between: str, end: str) -> None:
    path = tmp_path / "log.csv"
    nanoseconds = (T * 1e9).round().astype(np.int64) + 123
    stamps = np.datetime64("2026-11-23T23:59:59.95", "ns") + nanoseconds
    lines = [f"{s}{end},{x!r},word".replace("T", between) for s, x in zip(stamps, Q[:, 0].tolist(), strict=True)]
    path.write_text("\n".join(["stamp,x,state", *lines]) + "\n")
    (stream,) = open_log(path)
    assert stream.clock == "stamp" and "dates in 'stamp'" in stream.remarks[0]
    for time in (Column("time", "s"), Column("stamp", "s")):  # a file's own clock needs no word
        (session,) = read_log(path, {"x": Column("x", "m")}, time=time)
        np.testing.assert_allclose(session.trajectory.time, T, atol=1e-12)
        np.testing.assert_array_equal(session.trajectory["x"], Q[:, 0])
    lines[20] = lines[20].replace("2026", "soon")
    path.write_text("\n".join(["stamp,x,state", *lines]) + "\n")
    with pytest.raises(LogError, match="line 22, column 'stamp': found 'soon"):
        read_log(path, {"x": Column("x", "m")})
    (session,) = read_log(path, {"x": Column("x", "m")}, empty_rows="drop", uneven=True)
    assert len(session.trajectory) == 39


@pytest.mark.parametrize("end", ["7", "7,", "7,0.5", "7,0.5,"])
def test_an_unfinished_last_row_may_be_dropped(tmp_path: Path, end: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,x,y,z\n" + "".join(f"{k},0.5,2,3\n" for k in range(7)) + end)
    (session,) = read_log(path, {"x": Column("x", "m")}, time=Column("t", "s"), empty_rows="drop")
    assert len(session.trajectory) == 7 and session.trajectory.provenance["rows without a number"] == 1
    assert any("line 9" in note and "ends within" in note for note in inspect(path).notes)
    with pytest.raises(LogError, match=r'line 9: the file ends within.*empty_rows = "drop"'):
        read_log(path, {"x": Column("x", "m")}, time=Column("t", "s"))


@pytest.mark.parametrize("point", [".", ","])
def test_dates_with_the_day_first_are_seconds_too(tmp_path: Path, point: str) -> None:
    days = [f"{day} {clock}{point}{k}" for day, clock in (("31.12.2026", "23:59:59"), ("1.1.2027", "00:00:00"))
            for k in range(10)]  # fmt: skip
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["Zeitstempel;x", *(f"{day};{k},5" for k, day in enumerate(days))]) + "\n")
    time, form = Column("Zeitstempel", "s"), LogForm(decimal="comma")
    (session,) = read_log(path, {"x": Column("x", "m")}, time=time, form=form)
    np.testing.assert_allclose(session.trajectory.time, 0.1 * np.arange(20), atol=1e-9)
    assert session.trajectory["x"][-1] == 19.5


# -- time ----


def test_a_file_without_time_has_the_one_that_is_given(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("x\n1\n2\n4\n")
    (session,) = read_log(path, {"x": Column("x", "m")}, time=None, sample_time=0.002)
    assert session.trajectory.time.tolist() == [0.0, 0.002, 0.004] and session.sample_time == 0.002
    with pytest.raises(LogError, match="sample time is needed"):
        read_log(path, {"x": Column("x", "m")}, time=None)


def test_late_and_repeated_rows(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    times, values = [0, 1, 2, 2, 4, 3, 5, 6], [0, 1, 2, 9, 4, 3, 5, 6]
    path.write_text("t,x\n" + "".join(f"{t},{x}\n" for t, x in zip(times, values, strict=True)))
    columns, time = {"x": Column("x", "m")}, Column("t", "s")
    with pytest.raises(LogError, match=r"line 5, column 't': 2\.0 s does not come after 2\.0 s in line 4"):
        read_log(path, columns, time=time)
    (ordered,) = read_log(path, columns, time=time, late_rows="sort")
    assert ordered.trajectory["x"].tolist() == [0, 1, 2, 3, 4, 5, 6] and ordered.sample_time == 1.0
    assert ordered.trajectory.provenance == {"rows that came late or twice": 2}
    (dropped,) = read_log(path, columns, time=time, late_rows="drop", uneven=True)
    assert dropped.trajectory["x"].tolist() == [0, 1, 2, 4, 5, 6]
    with pytest.raises(LogError, match="line 6: 2000 ms after the row before"):
        read_log(path, columns, time=time, late_rows="drop")


def test_rows_without_a_number(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,x,y\n0,1,7\n1,,7\n2,nan,7\n3,4,\n4,5,7\n5,6,-\n")
    with pytest.raises(LogError, match="line 3, column 'x': the cell is empty"):
        read_log(path, {"x": Column("x", "m")}, time=Column("t", "s"))
    (session,) = read_log(path, {"x": Column("x", "m")}, time=Column("t", "s"), uneven=True, empty_rows="drop")
    assert session.trajectory["x"].tolist() == [1, 4, 5, 6] and session.trajectory.time.tolist() == [0, 3, 4, 5]
    assert session.trajectory.provenance == {"rows without a number": 2}
    (both,) = read_log(
        path, {"x": Column("x", "m"), "y": Column("y", "m")}, time=Column("t", "s"), uneven=True, empty_rows="drop"
    )
    assert both.trajectory.time.tolist() == [0, 4]


def test_how_rows_are_sampled() -> None:
    rng = np.random.default_rng(2)  # synthetic: seed 2, steps of 10 ms with a deviation of 10 %
    time = np.cumsum(0.01 * (1 + 0.1 * rng.standard_normal(4000)))
    keep = np.ones(4000, dtype=bool)
    keep[[500, 1500, 1501, 1502, 3000]] = False
    sampling = sampling_of(time[keep])
    assert sampling.rate == pytest.approx(100.0, rel=5e-3) and sampling.jitter == pytest.approx(0.1, rel=0.1)
    assert [(gap.row, gap.missing) for gap in sampling.gaps] == [(499, 1), (1498, 3), (2995, 1)]
    assert sampling.late == sampling.repeated == 0 and not sampling.even(0.1)
    assert sampling_of(np.arange(10) * 0.1).even(1e-6)
    assert sampling_of([0.0]).rate == 0.0


def test_clocks_of_several_files(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time,x,u\n0,1,5\n1,2,5\n2,3,5\n")
    (tmp_path / "b.csv").write_text("time,y,u\n0.5,1,6\n1.7,2,6\n2,3,6\n2.1,9,6\n")
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    recording = read_recording(
        paths, {"x": Column("x", "m"), "y": Column("y", "m"), "u": Column("u", "V", file="b.csv")}
    )
    assert list(recording) == ["a.csv", "b.csv"] and recording["b.csv"]["u"].tolist() == [6.0] * 4
    with pytest.raises(LogError, match=r"column 'u' of 'u' is in a.csv and b.csv; name its file"):
        read_recording(paths, {"u": Column("u", "V")})
    with pytest.raises(LogError, match="in no file"):
        read_recording(paths, {"u": Column("w", "V")})
    with pytest.raises(LogError, match="is not in the recording"):
        read_recording(paths, {"u": Column("u", "V", file="c.csv")})


def test_poses_are_read_by_the_same_reader(tmp_path: Path) -> None:
    savemat(tmp_path / "poses.mat", {"q": Q.T, "T": Q, "run": np.repeat([1.0, 2.0], 20)})
    table = read_table(tmp_path / "poses.mat", {"q": ("q", "mm"), "T": ("T", "m")}, "run")
    np.testing.assert_array_equal(table.values["T"], Q)
    np.testing.assert_allclose(table.values["q"], Q / 1000, rtol=1e-15)
    assert table.sessions == ("1",) * 20 + ("2",) * 20
    (tmp_path / "poses.csv").write_text("q;T\n1,5;2\n;3\n")
    gaps = read_table(
        tmp_path / "poses.csv", {"q": ("q", "mm"), "T": ("T", "m")}, form=LogForm(decimal="comma"), gaps=True
    )
    assert gaps.values["q"][0, 0] == 0.0015 and np.isnan(gaps.values["q"][1, 0])


QUOTED = [
    ('t,x\n"0,0","1,25"\n"0,1","-2,50"\n"0,2","3,75"\n', [1.25, -2.5, 3.75]),
    ('t,x\n"0,0",1\n"0,1","2,5"\n"0,2",3\n', [1.0, 2.5, 3.0]),  # whole numbers are not quoted
    ('"t","x"\n"0,000","1,250"\n"0,100","2,500"\n"0,200","3,750"\n', [1.25, 2.5, 3.75]),  # 0,100 is no thousands
]


@pytest.mark.parametrize(("text", "x"), QUOTED)
def test_quoted_decimal_commas_between_commas(tmp_path: Path, text: str, x: list[float]) -> None:
    (tmp_path / "log.csv").write_text(text)
    columns = {"x": Column("x", "m")}
    for form in (LogForm(), LogForm(decimal="comma"), LogForm(decimal="comma", delimiter="comma")):
        (session,) = read_log(tmp_path / "log.csv", columns, time=Column("t", "s"), form=form)
        assert session.trajectory["x"].tolist() == x
        assert session.trajectory.time.tolist() == [0.0, 0.1, 0.2]
    (stream,) = open_log(tmp_path / "log.csv")
    assert any("decimal commas" in remark for remark in stream.remarks)


@pytest.mark.parametrize("rows", ['0.1,"1,250"\n0.2,"2,500"\n0.3,"3,750"\n', '1,"1,250"\n2,"2,500"\n3,"3,750"\n'])
def test_quoted_thousands_are_no_decimal_commas(tmp_path: Path, rows: str) -> None:
    (tmp_path / "log.csv").write_text(f"t,x\n{rows}")
    with pytest.raises(LogError, match="line 2, column 'x'"):
        read_log(tmp_path / "log.csv", {"x": Column("x", "m")}, time=Column("t", "s"))
