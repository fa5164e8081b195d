"""Wrong logs: each is refused in one sentence of at most 300 characters that names the file and where in it."""

from __future__ import annotations

import gzip
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from gtmodel.measurements import Column, LogForm, read_log
from gtmodel.measurements.streams.text_lines import BLOCK
from gtmodel.results import ArgumentError, TrajectoryError

LONGEST = 300
LONGEST_LINE = 1 << 20  # letters: of a file that is soon read
GOOD = "t [s],x [mm],y\n" + "".join(f"{k / 10},{k},{k * k}\n" for k in range(8))
COLUMNS = {"x": Column("x", "mm"), "y": Column("y", "N")}


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new, 1)


# name: content, what its sentence names, options of read_log
TEXTS: dict[str, tuple[str | bytes, list[str], dict[str, Any]]] = {
    "empty": ("", ["log.csv"], {}),
    "comments alone": ("# nothing\n\n# at all\n", ["log.csv"], {}),
    "a header alone": ("t,x,y\n", ["log.csv line 1"], {}),
    "a column missing": (GOOD.replace("x [mm]", "pos"), ["log.csv line 1", "'x'"], {}),
    "a column nearly named": (GOOD.replace("x [mm]", "xx"), ["log.csv line 1", "'x'", "'xx'"], {}),
    "a column in other letters": (GOOD.replace("y", "Y"), ["log.csv line 1", "'y'"], {}),
    "no column of time": (GOOD.replace("t [s]", "zeit"), ["log.csv line 1", "'t'"], {}),
    "a column twice": (GOOD.replace("x [mm]", "y"), ["log.csv line 1", "'y'", "columns 2 and 3"], {"columns": ["y"]}),
    "another unit": (GOOD.replace("[mm]", "[m]"), ["log.csv line 1", "'x'", "in m here"], {}),
    "a unit that is none": (GOOD.replace("[mm]", "[furlong]"), ["log.csv line 1", "'x'", "furlong"], {}),
    "a word for a number": (changed("0.3,3", "0.3,off"), ["log.csv line 5", "'x'", "'off'"], {}),
    "an empty cell": (changed("0.3,3", "0.3,"), ["log.csv line 5", "'x'", "empty", 'empty_rows = "drop"'], {}),
    "nan": (changed("0.3,3", "0.3,nan"), ["log.csv line 5", "'x'", "'nan'", 'empty_rows = "drop"'], {}),
    "infinity": (changed("0.3,3", "0.3,-inf"), ["log.csv line 5", "'x'", "'-inf'"], {}),
    "an overflow": (changed("0.3,3", "0.3,1e999"), ["log.csv line 5", "'x'", "'1e999'"], {}),
    "thousands with an underscore": (changed("0.3,3", "0.3,1_000"), ["log.csv line 5", "'x'", "'1_000'"], {}),
    "a hexadecimal number": (changed("0.3,3", "0.3,0x1f"), ["log.csv line 5", "'x'", "'0x1f'"], {}),
    "a Fortran exponent": (changed("0.3,3", "0.3,1.0D-3"), ["log.csv line 5", "'x'", "'1.0D-3'"], {}),
    "a unit behind a number": (changed("0.3,3", "0.3,3 mm"), ["log.csv line 5", "'x'", "'3 mm'"], {}),
    "a date for a time": (changed("0.3,3", "2026-11-23T00:00:01,3"), ["log.csv line 5", "'t'", "date"], {}),
    "a clock for a time": (changed("0.3,3", "00:01.5,3"), ["log.csv line 5", "'t'", "date"], {}),
    "a day of another order": (changed("0.3,3", "11/23/2026 08:14:27,3"), ["log.csv line 5", "'t'", "2026-11-12T"], {}),
    "a date among decimal commas": (
        GOOD.replace(",", ";").replace(".", ",").replace("0,3", "23.11.2026"), ["line 5", "'t'", "it is a date"],
        {"form": LogForm(decimal="comma")},
    ),
    "a decimal comma": (
        GOOD.replace(",", ";").replace("0.3", "0,3"), ["log.csv line 5", "'t'", "'0,3'", 'decimal = "comma"'], {}
    ),
    "a point among decimal commas": (
        GOOD.replace(",", ";"), ["log.csv line 2", "'t'", "'0.0'", 'decimal = "comma"'],
        {"form": LogForm(decimal="comma")},
    ),
    "commas for both": (GOOD, ["log.csv"], {"form": LogForm(decimal="comma", delimiter="comma")}),
    "another delimiter than said": (GOOD, ["log.csv line 1", "'t'"], {"form": LogForm(delimiter="semicolon")}),
    "an encoding that is none": (GOOD, ["'klingon'"], {"form": LogForm(encoding="klingon")}),
    "a cell too few": (changed("0.3,3,9", "0.3,3"), ["log.csv line 5", "2 cells", "expected 3"], {}),
    "one cell": (changed("0.3,3,9", "end"), ["log.csv line 5", "one cell;", "expected 3"], {}),
    "a cell too many": (changed("0.3,3,9", "0.3,3,9,7"), ["log.csv line 5", "4 cells", "expected 3"], {}),
    "cut off in a row": (GOOD.rstrip()[: -len(",49")], ["log.csv line 9", "ends within", 'empty_rows = "drop"'], {}),
    "a quote that is not closed": (changed("0.3,3", '0.3,"3'), ["log.csv line 5", "quote"], {}),
    "a second header": (changed("0.4,", "t [s],x [mm],y\n0.4,"), ["log.csv line 6", "'t'", "'t [s]'"], {}),
    "a program's lines above": (
        "Rate\nAxis;3\nmade;today\n" + GOOD.replace("t [s],x", "t [s],x"), ["log.csv line 1", "header = 4"], {}
    ),
    "lines above names and units": (
        "Rate\nAxis;3\n" + "t;x;y\ns;mm;mm\n" + "0;1;2\n" * 9, ["log.csv line 1", "header = 3"], {}
    ),
    "lines above words and numbers": (
        "Rate\nmade today\n" + "t;x;y;state\n" + "".join(f"{k},5;1;2,5;runs\n" for k in range(9)),
        ["log.csv line 1", "header = 3"], {},
    ),
    "prose": ("Prose, in lines.\nOf words\nand, of, commas\nthat\nend.\n", ["log.csv", "text without a table"], {}),
    "a header that is not there": (GOOD, ["log.csv", "'t'"], {"form": LogForm(header=0)}),
    "a header below the end": (GOOD, ["log.csv"], {"form": LogForm(header=99)}),
    "no UTF-8": (
        changed("0.3", "\udcff").encode("utf-8", "surrogateescape"),
        ["log.csv line 5", "UTF-8", 'encoding = "cp1252"'], {},
    ),
    "half of a UTF-16 sign": (GOOD.encode("utf-16")[:-1], ["log.csv line", "UTF-16"], {}),
    "a zero byte": (changed("0.3", "0.\0"), ["log.csv line 5", "zero byte"], {}),
    "a carriage return within": (changed("0.3,3", "0.3\r,3"), ["log.csv line 5", "carriage return"], {}),
    "a spreadsheet": (b"PK\x03\x04" + b"\0" * 40, ["log.csv", "save the table as CSV"], {}),
    "an old spreadsheet": (b"\xd0\xcf\x11\xe0" + b"\0" * 40, ["log.csv", "Excel"], {}),
    "compressed": (gzip.compress(GOOD.encode()), ["log.csv", "gzip", "unpack"], {}),
    "a pointer of Git LFS": (
        "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n", ["log.csv", "git lfs pull"], {}
    ),
    "lines that do not end": (GOOD + "1," * (LONGEST_LINE // 2 + BLOCK), ["log.csv line 10", "not a table"], {}),
    "the time goes back": (changed("0.3,", "0.1,"), ["log.csv line 5", "'t'", "line 4"], {}),
    "a time twice": (changed("0.3,", "0.2,"), ["log.csv line 5", "'t'", "line 4"], {}),
    "a sample missing": (changed("0.3,3,9\n", ""), ["log.csv line 5", "1 sample is missing"], {}),
    "jitter": (changed("0.3,", "0.33,"), ["log.csv line 5", "jitters"], {}),
    "two rows": ("t,x,y\n0,1,2\n1,2,3\n", ["log.csv line 2", "2 rows"], {}),
    "another sample time": (GOOD, ["log.csv", "100 ms", "10 ms"], {"sample_time": 0.01}),
    "a session that comes again": (
        "t,x,y,run\n" + "".join(f"{t},1,2,{r}\n" for r in (1, 2, 1) for t in range(3)),
        ["log.csv line 8", "run 1"], {"session": "run"},
    ),
    "a stream of another name": (GOOD, ["log.csv", "'/imu'"], {"form": LogForm(stream="/imu")}),
    "a long cell": (changed("0.3,3", "0.3," + "9x" * 4000), ["log.csv line 5", "'x'"], {}),
    "long names": (GOOD.replace("y\n", "y" * 3000 + "\n", 1), ["log.csv line 1", "'y'"], {}),
    "two hundred columns": (
        ",".join(f"column_{k}" for k in range(200)) + "\n" + ",".join("1" for _ in range(200)) + "\n",
        ["log.csv line 1", "'t'"], {},
    ),
    "no finite row": (
        "t,x,y\n0,nan,1\n1,nan,1\n2,nan,1\n", ["log.csv", "lacks a number"], {"empty_rows": "drop"},
    ),
    "no time and no sample time": (GOOD, ["log.csv", "sample time"], {"time": None}),
    "a time in mm": (GOOD, ["time", "mm"], {"time": Column("t", "mm")}),
}  # fmt: skip


def refused(path: Path, options: dict[str, Any]) -> str:
    chosen = {name: COLUMNS[name] for name in options.get("columns", COLUMNS)}
    more = {name: value for name, value in options.items() if name != "columns"}
    with pytest.raises(ArgumentError) as caught:
        read_log(path, chosen, **{"time": Column("t", "s"), **more})
    assert isinstance(caught.value, TrajectoryError)
    return str(caught.value)


def assert_one_sentence(said: str, names: list[str]) -> None:
    assert len(said) <= LONGEST and "\n" not in said and "Traceback" not in said, said
    for name in names:
        assert name in said, said


@pytest.mark.parametrize("case", TEXTS)
def test_a_wrong_text_file_is_refused_in_one_sentence(
    tmp_path: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gtmodel.measurements.streams.text_lines.LONGEST_LINE", LONGEST_LINE)
    content, names, options = TEXTS[case]
    path = tmp_path / "log.csv"
    path.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
    assert_one_sentence(refused(path, options), names)


def test_a_pipe_is_refused_before_it_is_opened(tmp_path: Path) -> None:
    """Opening it waited for ever, and reading some bytes of it takes them away."""
    os.mkfifo(tmp_path / "log.csv")
    assert_one_sentence(refused(tmp_path / "log.csv", {}), ["log.csv", "pipe"])


def test_there_are_forty() -> None:
    assert len(TEXTS) + len(FILES) >= 40


ROWS = np.arange(8.0)


def mat(**variables: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        savemat(folder / "log.mat", variables)
        return folder / "log.mat"

    return write


def raw(name: str, content: bytes) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_bytes(content)
        return folder / name

    return write


def a_folder(folder: Path) -> Path:
    (folder / "log").mkdir()
    return folder / "log"


def a_bag_without_files(folder: Path) -> Path:
    (a_folder(folder) / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 5}\n")
    return folder / "log"


FILES: dict[str, tuple[Callable[[Path], Path], list[str], dict[str, Any]]] = {
    "a variable missing": (mat(t=ROWS, x=ROWS), ["log.mat", "'y'"], {}),
    "no time in it": (mat(x=ROWS, y=ROWS), ["log.mat", "'t'"], {}),
    "a variable of another length": (mat(t=ROWS, x=ROWS, y=ROWS[:5]), ["log.mat", "'y'", "8 samples"], {}),
    "a word for an array": (mat(t=ROWS, x=ROWS, y="Newton"), ["log.mat", "'y'", "no numbers"], {}),
    "a time of two columns": (mat(t=np.column_stack([ROWS, ROWS]), x=ROWS, y=ROWS), ["log.mat", "'t'", "8 x 2"], {}),
    "nan in a variable": (mat(t=ROWS, x=ROWS, y=np.where(ROWS == 4, np.nan, ROWS)), ["log.mat sample 5", "'y'"], {}),
    "a member that is not there": (mat(t=ROWS, rec={"x": ROWS, "y": ROWS}), ["log.mat", "'x'"], {}),
    "a time that goes back": (mat(t=ROWS[::-1], x=ROWS, y=ROWS), ["log.mat sample 2", "'t'"], {}),
    "no MATLAB file": (raw("log.mat", b"something else" * 50), ["log.mat", "MATLAB"], {}),
    "half of a MATLAB 7.3 file": (
        raw("log.mat", b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + b"\0" * 40),
        ["log.mat", "MATLAB"],
        {},
    ),
    "half of a Parquet file": (raw("log.parquet", b"PAR1" + b"\0" * 40), ["log.parquet", "Parquet"], {}),
    "no Parquet file": (raw("log.parquet", b"t,x,y\n0,1,2\n"), ["log.parquet", "does not begin"], {}),
    "half of a bag": (raw("log.bag", b"#ROSBAG V2.0\n" + b"\0" * 40), ["log.bag", "ROS bag"], {}),
    "half of an MCAP file": (raw("log.mcap", b"\x89MCAP0\r\n" + b"\0" * 40), ["log.mcap", "ROS bag"], {}),
    "half of a data base": (raw("log.db3", b"SQLite format 3\0" + b"\0" * 40), ["log.db3", "ROS bag"], {}),
    "a folder that is no bag": (a_folder, ["log", "metadata.yaml"], {}),
    "a bag without its files": (a_bag_without_files, ["log", "ROS bag"], {}),
}


@pytest.mark.parametrize("case", FILES)
def test_a_wrong_file_of_another_kind_is_refused_in_one_sentence(tmp_path: Path, case: str) -> None:
    write, names, options = FILES[case]
    for module in {"bag": ["rosbags"], "Parquet": ["pyarrow"], "7.3": ["h5py"]}.get(case.split()[-2], []):
        pytest.importorskip(module)
    assert_one_sentence(refused(write(tmp_path), options), names)


def test_a_library_that_is_not_there_is_named_with_the_way_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr("gtmodel.measurements.streams.form.import_module", missing)
    for name, content in (
        ("log.parquet", b"PAR1"), ("log.bag", b"#ROSBAG V2.0\n"), ("log.mat", b"MATLAB 7.3".ljust(512) + b"\x89HDF"),
    ):  # fmt: skip
        (tmp_path / name).write_bytes(content + b"\0" * 40)
        assert_one_sentence(refused(tmp_path / name, {}), [name, "pip install 'gtmodel[logs]'"])
