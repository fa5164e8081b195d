"""Compressed parts of a ROS bag, unpacked piece by piece before rosbags unpacks each as a whole: a few bytes may hold
gigabytes."""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

from .extra import needed
from .form import LogForm, refuse_swollen

PIECE = 1 << 20  # bytes that are unpacked at once
ROS1, MCAP, ZSTD = b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"\x28\xb5\x2f\xfd"
_CHUNK_1, _CHUNK_MCAP = b"\x05", 6  # what marks a chunk
_IN_CHUNK = 28  # bytes of an MCAP chunk before the name of its compression: two times, size, checksum


def refuse_bomb(path: Path, form: LogForm) -> None:
    """Raises LogError where what a bag has compressed, chunks or whole files, is far larger than the bag. What does not
    unpack is left to rosbags, which says so.

    path: a file of a bag, or its folder.
    """
    for file in sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]:
        _refuse_parts(_parts(file), file, form)


def refuse_message_bombs(readers: Iterable[Any], path: Path, form: LogForm) -> None:
    """As `refuse_bomb`, of bags whose messages are compressed one by one: the readers of rosbags, open."""
    packed = [r for r in readers if getattr(r, "compression_mode", None) == "message"]  # of ROS 2
    for storage in (s for reader in packed for s in getattr(reader, "storage", reader).storages):
        messages = storage.messages(storage.connections)
        _refuse_parts((("zstd", bytes(data)) for _, _, data in messages), path, form)


def _refuse_parts(parts: Iterator[tuple[str, bytes]], file: Path, form: LogForm) -> None:
    """Raises LogError for parts, each the name of its compression and its bytes, that hold together far more than their
    file, of a folder the largest one."""
    own, total = file if file.is_file() else max(file.iterdir(), key=lambda p: p.stat().st_size), 0
    for compression, data in parts:
        for size in _unpacked(compression, data, f"{own.name} is a ROS bag"):
            total += size
            refuse_swollen(own, total, form, "what is compressed in it")


def _parts(file: Path) -> Iterator[tuple[str, bytes]]:
    with open(file, "rb") as content:
        head = content.read(len(ROS1))
        left = file.stat().st_size
        if head == ROS1:
            yield from _of_ros1(content, left)
        elif head.startswith(MCAP):
            content.seek(len(MCAP))
            yield from _of_mcap(content, left)
        elif head.startswith(ZSTD):
            content.seek(0)
            yield "zstd", content.read()


def _of_ros1(file: BinaryIO, end: int) -> Iterator[tuple[str, bytes]]:
    """The chunks of a bag of ROS 1: records of a header and data, each behind its length."""
    while (head := _sized(file, "<I", end)) is not None:
        fields = {name: value for name, _, value in (field.partition(b"=") for field in _fields(head))}
        if fields.get(b"op") == _CHUNK_1:
            data = _sized(file, "<I", end)
            if data is None:
                return
            yield fields.get(b"compression", b"").decode(errors="replace"), data
        elif len(length := file.read(4)) == 4:
            file.seek(struct.unpack("<I", length)[0], 1)


def _fields(head: bytes) -> Iterator[bytes]:
    at = 0
    while at + 4 <= len(head):
        (length,) = struct.unpack_from("<I", head, at)
        yield head[at + 4 : at + 4 + length]
        at += 4 + length


def _of_mcap(file: BinaryIO, end: int) -> Iterator[tuple[str, bytes]]:
    """The chunks of an MCAP file: records of a kind and data behind its length."""
    while kind := file.read(1):
        if kind[0] != _CHUNK_MCAP:
            if len(length := file.read(8)) < 8:
                return
            file.seek(min(struct.unpack("<Q", length)[0], end), 1)
            continue
        data = _sized(file, "<Q", end)
        if data is None or len(data) < _IN_CHUNK + 4:
            return
        (length,) = struct.unpack_from("<I", data, _IN_CHUNK)
        name = data[_IN_CHUNK + 4 :][:length]
        yield name.decode(errors="replace"), data[_IN_CHUNK + 4 + length + 8 :]


def _sized(file: BinaryIO, form: str, end: int) -> bytes | None:
    """Bytes behind their length; None where the file does not hold them."""
    size = struct.calcsize(form)
    if len(length := file.read(size)) < size or (count := struct.unpack(form, length)[0]) > end - file.tell():
        return None
    return file.read(count)


def _unpacked(compression: str, data: bytes, what: str) -> Iterator[int]:
    """The sizes of the pieces that are unpacked from compressed data."""
    inflate: Any
    if compression == "bz2":
        inflate = bz2.BZ2Decompressor()
    elif compression == "lz4":
        inflate = needed("lz4.frame", what).LZ4FrameDecompressor()
    elif compression == "zstd":
        inflate = _zstd(what).ZstdDecompressor()
    else:
        return  # none, or one that rosbags does not take
    try:
        while not inflate.eof:
            piece = inflate.decompress(data, PIECE)
            if not piece and (inflate.needs_input or not data):
                return
            data = b""
            yield len(piece)
    except Exception:  # of the three; rosbags says what is damaged
        return


def _zstd(what: str) -> Any:
    """Python's own from 3.14 on; before it the package that rosbags needs."""
    try:
        return import_module("compression.zstd")
    except ImportError:
        return needed("backports.zstd", what)
