"""Compressed files that hold far more than their size: refused before they are unpacked, read where that is said."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.measurements import LogForm, open_log
from gtmodel.measurements.streams.form import LogError
from gtmodel.results import read_bounds

SMALL = 1 << 18  # bytes that always may, in place of 268 MB: a bomb of two megabytes is made and read in no time
MESSAGES, NUMBERS = 4, 1 << 16
BAGS = [
    ("ros1", "BZ2"), ("ros1", "LZ4"), ("MCAP", "STORAGE"), ("MCAP", "MESSAGE"), ("MCAP", "FILE"),
    ("SQLITE3", "MESSAGE"), ("SQLITE3", "FILE"),
]  # fmt: skip


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read_bounds, "SMALL", SMALL)


def bag(folder: Path, kind: str, compression: str) -> Path:
    """Zeros, a few messages of many: compressed to far less than a two hundredth."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    first, path = kind == "ros1", folder / ("log.bag" if kind == "ros1" else "log")
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    writer: Any = Writer1(path) if first else Writer2(path, version=9, storage_plugin=StoragePlugin[kind])
    if first:
        writer.set_compression(Writer1.CompressionFormat[compression])
    else:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        name = "std_msgs/msg/Float64MultiArray"
        topic = writer.add_connection("/x", name, typestore=store)
        message = store.types[name](store.types["std_msgs/msg/MultiArrayLayout"]([], 0), np.zeros(NUMBERS))
        raw = (store.serialize_ros1 if first else store.serialize_cdr)(message, name)
        for k in range(MESSAGES):
            writer.write(topic, 10**18 + k * 10**7, raw)
    return path


@pytest.mark.parametrize(("kind", "compression"), BAGS)
def test_a_bag_that_swells_is_refused_unless_that_is_said(tmp_path: Path, kind: str, compression: str) -> None:
    path = bag(tmp_path, kind, compression)
    form = LogForm(most_growth=20.0)
    with pytest.raises(LogError, match=r"its compressed content would take .* most_growth") as caught:
        open_log(path, form)
    assert "\n" not in str(caught.value)
    (stream,) = open_log(path, LogForm(most_growth=1e5))
    assert stream.heads.names == ["receive_time", "layout.data_offset"]  # such long arrays are no columns


def test_a_trajectory_that_swells_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.npz"
    n = 200_000
    np.savez_compressed(path, header=np.array("{}"), time=np.zeros(n))
    assert sum(entry.file_size for entry in zipfile.ZipFile(path).infolist()) > 8 * n
    with pytest.raises(gt.results.TrajectoryError, match="times the size of the file"):
        gt.Trajectory.from_npz(path)
