"""Files with bytes changed, lost and put in anywhere: read, or refused in one sentence; never a traceback."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy
from scipy.io import savemat

from gtmodel.measurements import Column, LogError, inspect, read_log
from gtmodel.measurements.streams.matlab import refuse_damaged
from gtmodel.results import ArgumentError

T = 0.004 * np.arange(40)
X = np.random.default_rng(9).standard_normal(40)  # synthetic: seed 9
SIGNS = [b",", b";", b"\n", b"\r", b'"', b"\0", b"nan", b"1e400", b"\xff", b"#", b" ", b"\n\n", b"[", b"\t", b"%", b"_"]
LONGEST = 300


def rows(sign: str, point: str = ".") -> bytes:
    lines = [f"{t!r}{sign}{x!r}".replace(".", point) for t, x in zip(T.tolist(), X.tolist(), strict=True)]
    return "\n".join([f"t{sign}x", *lines, ""]).encode()


def mat(folder: Path) -> bytes:
    savemat(folder / "good.mat", {"t": T, "x": X, "rec": {"q": np.ones((3, 40))}, "name": "arm"})
    return (folder / "good.mat").read_bytes()


def mat_7_3(folder: Path) -> bytes:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "good.h5", "w", userblock_size=512) as file:
        file["t"], file["x"] = T, X
    return (folder / "good.h5").read_bytes()


def parquet(folder: Path) -> bytes:
    arrow, tables = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    tables.write_table(arrow.table({"t": T, "x": X, "word": ["a"] * 40}), folder / "good.parquet")
    return (folder / "good.parquet").read_bytes()


def bag(folder: Path) -> bytes:
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with rosbag1.Writer(folder / "good.bag") as writer:
        topic = writer.add_connection("/x", "std_msgs/msg/Float64", typestore=store)
        for t, x in zip((1e9 * T).astype(int).tolist(), X.tolist(), strict=True):
            message = store.types["std_msgs/msg/Float64"](x)
            writer.write(topic, 10**18 + t, store.serialize_ros1(message, "std_msgs/msg/Float64"))
    return (folder / "good.bag").read_bytes()


KINDS: dict[str, tuple[str, Callable[[Path], bytes]]] = {
    "commas": ("log.csv", lambda _: rows(",")),
    "semicolons": ("log.csv", lambda _: rows(";", ",")),
    "blanks": ("log.txt", lambda _: rows(" ")),
    "UTF-16": ("log.csv", lambda _: rows(",").decode().encode("utf-16")),
    "MATLAB": ("log.mat", mat),
    "MATLAB 7.3": ("log.mat", mat_7_3),
    "Parquet": ("log.parquet", parquet),
    "ROS 1": ("log.bag", bag),
}


def damaged(good: bytes, rng: random.Random) -> bytes:
    data = bytearray(good)
    for _ in range(rng.choice([1, 1, 2, 5])):
        at = rng.randrange(len(data) + 1)
        what = rng.randrange(5)
        if what == 0:
            data[at : at + 1] = bytes([rng.randrange(256)])
        elif what == 1:
            del data[at : at + rng.choice([1, 2, 10, 100])]
        elif what == 2:
            data[at:at] = rng.choice(SIGNS)
        elif what == 3:
            del data[at:]
        else:
            begin = rng.randrange(len(data) + 1)
            data[at:at] = data[begin : begin + 20]
    return bytes(data)


def assert_damage_is_read_or_refused(kind: str, folder: Path, count: int, seed: int) -> None:
    name, write = KINDS[kind]
    good, rng = write(folder), random.Random(seed)
    path, refused = folder / name, 0
    for _ in range(count):
        path.write_bytes(damaged(good, rng))
        for use in (lambda: read_log(path, {"x": Column("x", "m")}, time=Column("t", "s")), lambda: str(inspect(path))):
            try:
                use()
            except ArgumentError as error:
                refused += 1
                assert len(str(error)) <= LONGEST and "\n" not in str(error), str(error)
    assert refused > 0


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_damaged(tmp_path: Path, kind: str) -> None:
    assert_damage_is_read_or_refused(kind, tmp_path, 40, 1)


@pytest.mark.proof
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_much_damaged(tmp_path: Path, kind: str) -> None:
    assert_damage_is_read_or_refused(kind, tmp_path, 3000, 2)


def changed(good: bytes, old: bytes, new: bytes) -> bytes:
    assert len(old) == len(new) and old in good
    return good.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ((9, 320), (99, 320), "type 99"),  # SciPy would look up a type behind its table of types
        ((9, 320), (14, 320), "type 14"),  # numbers that would be a matrix
        ((9, 320), (9, 3200), "3200 bytes exceeds"),
        ((6, 8, 6, 0), (6, 8, 60, 0), "unknown class 60"),
        ((6, 8, 6, 0), (6, 8, 0x806, 0), "lacks some of its elements"),  # imaginary parts that are not there
        ((5, 8, 1, 40), (5, 7, 1, 40), "takes 7 bytes"),
        ((5, 8, 1, 2), (5, 8, 1, 2**30), "rows or columns"),  # members of a cell
    ],
)
def test_an_element_that_would_end_the_process_is_refused(tmp_path: Path, old, new, part: str) -> None:
    content = {"t": T, "x": X, "c": np.array([1.0, "a"], dtype=object)}
    savemat(tmp_path / "good.mat", content)
    good = (tmp_path / "good.mat").read_bytes()
    wrong = changed(good, *(struct.pack(f"<{len(words)}I", *words) for words in (old, new)))
    (tmp_path / "log.mat").write_bytes(wrong)
    with pytest.raises(LogError) as caught:
        read_log(tmp_path / "log.mat", {"x": Column("x", "m")}, time=Column("t", "s"))
    assert part in str(caught.value) and len(str(caught.value)) <= LONGEST


@pytest.mark.parametrize("compressed", [False, True])
def test_what_matlab_files_may_hold_is_looked_through(tmp_path: Path, compressed: bool) -> None:
    rec = {"q": np.ones((3, 40)), "none": np.zeros((0, 0)), "words": np.array(["a", "bc"], dtype=object)}
    content = {"t": T, "x": X, "z": 1j * T, "rec": rec, "list": [rec, rec], "s": scipy.sparse.eye(4), "on": T > 0.1}
    savemat(tmp_path / "log.mat", content, do_compression=compressed)
    refuse_damaged(tmp_path / "log.mat")
    (session,) = read_log(tmp_path / "log.mat", {"x": Column("x", "m")}, time=Column("t", "s"))
    assert np.array_equal(session.trajectory["x"], X)
