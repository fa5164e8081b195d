"""What a file says beside its numbers is heeded: units, scales, fill values.

Sizes that it cannot hold, numbers that stand elsewhere, and what is no row or no array are refused in a sentence.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from gtmodel.measurements import Column, LogError, LogForm, open_log, read_log
from gtmodel.results.read_bounds import GROWTH, SMALL

T = 0.004 * np.arange(40)
STORED = np.arange(40, dtype=np.int16) - 20


def hdf5(path: Path, said: dict[str, Any]) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["t"] = T
        file["t"].attrs["units"] = "seconds since 2026-11-23 00:00:00"
        file["x"] = STORED
        for key, value in said.items():
            file["x"].attrs[key] = value


def parquet(path: Path, said: dict[str, Any]) -> None:
    arrow, files = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    note = {k: str(np.ravel(v)[0] if not isinstance(v, (str, bytes)) else v) for k, v in said.items()}
    fields = [arrow.field("t", arrow.float64()), arrow.field("x", arrow.int16(), metadata=note)]
    files.write_table(arrow.table([T, STORED], schema=arrow.schema(fields)), path)


@pytest.mark.parametrize("write", [hdf5, parquet])
def test_scale_offset_and_unit_of_a_column(tmp_path: Path, write: Any) -> None:
    path = tmp_path / ("log.h5" if write is hdf5 else "log.parquet")
    write(path, {"units": "mm", "scale_factor": [0.25], "add_offset": 3.0})
    (session,) = read_log(path, {"x": Column("x", "mm")}, time=Column("t", "s"))
    np.testing.assert_allclose(session.trajectory["x"], 1e-3 * (0.25 * STORED + 3.0), rtol=1e-15)
    with pytest.raises(LogError, match="'x' is in mm here and declared in m;"):
        read_log(path, {"x": Column("x", "m")}, time=Column("t", "s"))
    write(path, {"_FillValue": np.int16(-20), "units": "m s-1"})
    with pytest.raises(LogError, match=r"1, .* 'x'"):
        read_log(path, {"x": Column("x", "m/s")}, time=Column("t", "s"))
    (session,) = read_log(path, {"x": Column("x", "m/s")}, time=Column("t", "s"), empty_rows="drop")
    np.testing.assert_array_equal(session.trajectory["x"], STORED[1:])
    write(path, {"scale_factor": "much"})
    with pytest.raises(LogError, match=r"'x': its attribute scale_factor is .*much"):
        read_log(path, {"x": Column("x", "m")}, time=Column("t", "s"))


def test_an_object_of_matlab_is_no_array(tmp_path: Path) -> None:
    from scipy.io.matlab import MatlabObject

    dtype = [("Time_", object), ("Data_", object)]
    made = np.zeros((1, 1), dtype=dtype)
    made[0, 0] = (T, 2.0 * T)
    savemat(tmp_path / "log.mat", {"t": T, "x": T, "ts": MatlabObject(made, "timeseries")})
    names = open_log(tmp_path / "log.mat")[0].heads.names
    assert names == ["t", "x"]
    with pytest.raises(LogError, match=r"'ts' holds no numbers; .* timetable"):
        read_log(tmp_path / "log.mat", {"x": Column("ts", "m")}, time=Column("t", "s"))
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, own in (("t", b"double"), ("ts", b"timeseries"), ("on", b"logical")):
            file[name] = T[None] if name != "on" else (T > 0.1).astype(np.uint8)[None]
            file[name].attrs["MATLAB_class"] = np.bytes_(own)
    assert open_log(tmp_path / "log.h5")[0].heads.names == ["on", "t"]


def test_a_square_array_inside_an_array_of_structs_is_asked_about(tmp_path: Path) -> None:
    C = np.arange(1600.0).reshape(40, 40)
    records = np.array([(T, C), (T, 2 * C)], dtype=[("t", object), ("C", object)])
    savemat(tmp_path / "log.mat", {"rec": records})
    asked = {"x": Column("rec[1].C[3]", "m")}
    with pytest.raises(LogError, match="square matrix"):
        read_log(tmp_path / "log.mat", asked, time=Column("rec[1].t", "s"))
    (session,) = read_log(tmp_path / "log.mat", asked, time=Column("rec[1].t", "s"), form=LogForm(samples="rows"))
    np.testing.assert_array_equal(session.trajectory["x"], 2 * C[:, 3])


def test_time_stamps_that_64_bits_do_not_hold(tmp_path: Path) -> None:
    arrow, files = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    for first, last in ((1_700_000_000, 40_000_000_000), (-9_000_000_000, 9_000_000_000)):  # s; in the year 3237
        stamps = arrow.array([first, *range(1_700_000_001, 1_700_000_011), last], arrow.timestamp("s"))
        files.write_table(arrow.table({"stamp": stamps, "x": np.arange(12.0)}), tmp_path / "log.parquet")
        with pytest.raises(LogError, match="'stamp' holds a time stamp beyond the years 1678 to 2261"):
            read_log(tmp_path / "log.parquet", {"x": Column("x", "m")}, uneven=True)


def test_a_row_without_its_list_moves_no_other_row(tmp_path: Path) -> None:
    arrow, files = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    lists = [[float(k), 10.0 * k] for k in range(40)]
    column = arrow.array([*lists[:5], None, *lists[6:]], arrow.list_(arrow.float64(), 2))
    files.write_table(arrow.table({"t": T, "q": column}), tmp_path / "log.parquet")
    with pytest.raises(LogError, match=r"row 6, column 'q\[0\]'"):
        read_log(tmp_path / "log.parquet", {"q": Column("q", "m")}, time=Column("t", "s"))
    (session,) = read_log(
        tmp_path / "log.parquet", {"q": Column("q", "m")}, time=Column("t", "s"), uneven=True, empty_rows="drop"
    )
    np.testing.assert_array_equal(session.trajectory["q"], np.delete(np.array(lists), 5, axis=0))


# -- sizes that a file cannot hold ----


def test_a_file_that_declares_more_than_it_holds(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.create_dataset("t", shape=(10**11,), chunks=(1000,), dtype="f8")
        file.create_dataset("x", shape=(10**11,), chunks=(1000,), dtype="f8")
    with pytest.raises(LogError, match=r"would take 8e\+05 MB, .* most_growth = "):
        read_log(tmp_path / "log.h5", {"x": Column("x", "m")}, time=Column("t", "s"))


def test_a_compressed_bomb(tmp_path: Path) -> None:
    savemat(tmp_path / "log.mat", {"t": T}, do_compression=True)
    head = (tmp_path / "log.mat").read_bytes()[:128]
    length = SMALL + 8
    packed = zlib.compress(np.array([14, length], np.uint32).tobytes() + bytes(1000))
    (tmp_path / "log.mat").write_bytes(head + np.array([15, len(packed)], np.uint32).tobytes() + packed)
    with pytest.raises(LogError, match="times the size of the file; expected at most 200 times"):
        open_log(tmp_path / "log.mat")
    with pytest.raises(LogError, match="cannot be read as a MATLAB file"):  # allowed by the key, and then it is damaged
        open_log(tmp_path / "log.mat", LogForm(most_growth=1e9))


def test_a_parquet_file_of_one_number_again_and_again(tmp_path: Path) -> None:
    arrow, files = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    rows = int(SMALL / 16) + 100_000  # two columns of eight bytes
    zeros = arrow.array(np.zeros(rows, np.int8))
    files.write_table(arrow.table({"t": zeros, "x": zeros}), tmp_path / "log.parquet")
    assert 16 * rows > GROWTH * (tmp_path / "log.parquet").stat().st_size
    with pytest.raises(LogError, match="most_growth"):
        read_log(tmp_path / "log.parquet", {"x": Column("x", "m")}, time=Column("t", "s"))


def test_numbers_that_stand_in_another_file(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret.bin").write_bytes(T.tobytes())
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["t"] = T
        file.create_dataset("x", (40,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 320)])
        layout = h5py.VirtualLayout((40,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", (40,))
        file.create_virtual_dataset("y", layout)
    for name in "xy":
        with pytest.raises(LogError, match=f"'{name}' is stored in another file"):
            read_log(tmp_path / "log.h5", {"q": Column(name, "m")}, time=Column("t", "s"))


# -- text ----


def test_a_first_cell_of_a_spreadsheet_error_is_a_row(tmp_path: Path) -> None:
    rows = [f"{k},{0.004 * k:.3f},{k * k}" for k in range(10)]
    rows[4] = rows[4].replace("4", "#N/A", 1)
    (tmp_path / "log.csv").write_text("\n".join(["x,t,y", *rows, "# the end"]) + "\n")
    columns = {"x": Column("x", "m"), "y": Column("y", "m")}
    with pytest.raises(LogError, match="line 6, column 'x': found '#N/A'"):
        read_log(tmp_path / "log.csv", columns, time=Column("t", "s"))
    (session,) = read_log(tmp_path / "log.csv", {"y": columns["y"]}, time=Column("t", "s"))
    np.testing.assert_array_equal(session.trajectory["y"], np.arange(10.0) ** 2)
    (tmp_path / "log.csv").write_text("\n".join(["#N/A,0.0,1", *rows[1:4]]) + "\n")
    (stream,) = open_log(tmp_path / "log.csv")
    assert stream.read({"y": ["3"]}).values["y"][:, 0].tolist() == [1.0, 1.0, 4.0, 9.0]


@pytest.mark.parametrize("word", ["run", "2026-11-23T12:00:0"])
def test_a_first_row_that_looks_like_the_others_is_no_header(tmp_path: Path, word: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text("".join(f"{word}{k},{0.5 * k},{k * k}\n" for k in range(9)))
    if word == "run":
        with pytest.raises(LogError, match=r"line 1: 1 words and 2 numbers .* header = 0; .* header = 1"):
            open_log(path)
    (stream,) = open_log(path, LogForm(header=0 if word == "run" else None))
    assert stream.read({"y": ["3"]}).values["y"][:, 0].tolist() == [k * k for k in range(9)]


def test_decimal_commas_between_blanks_are_asked_about(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    for head in ("t x\n", ""):
        path.write_text(head + "0,0  1,5\n0,1  1,7\n0,2  1,6\n")
        with pytest.raises(LogError, match=r"'0,0  1,5'; if so, set decimal = .comma."):
            open_log(path)
        (stream,) = open_log(path, LogForm(decimal="comma"))
        assert stream.read({"x": [stream.heads.names[1]]}).values["x"][:, 0].tolist() == [1.5, 1.7, 1.6]


def test_links_of_hdf5_are_named_with_where_they_lead(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "numbers.h5", "w") as file:
        file["t"], file["x"] = T, STORED
    for name, link, said in (
        ("elsewhere", h5py.ExternalLink("numbers.h5", "/x"), r"'x' is a link to '/x' of numbers.h5; read that file"),
        ("nowhere", h5py.SoftLink("/in/y"), r"'x' is a link to '/in/y', which this file does not contain"),
        ("round", h5py.SoftLink("/x"), r"'x' is a link to '/x', which this file does not contain"),
    ):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            file["x"] = link
        with pytest.raises(LogError, match=r"holds no array of numbers; " + said):
            open_log(tmp_path / f"{name}.h5")
        with h5py.File(tmp_path / f"{name}.h5", "a") as file:
            file["t"], file["raw/z"], file["z"] = T, STORED, h5py.SoftLink("/raw/z")
        read = {"z": Column("raw.z", "1")}
        assert len(read_log(tmp_path / f"{name}.h5", read, time=Column("t", "s"))) == 1
        for column, words in (("x", said), ("z", "'z' is a link to 'raw.z' of this file; use that name")):
            with pytest.raises(LogError, match=words):
                read_log(tmp_path / f"{name}.h5", {"q": Column(column, "1")}, time=Column("t", "s"))
