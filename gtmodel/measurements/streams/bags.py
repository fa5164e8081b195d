"""Read ROS bags with rosbags: a topic is a stream, the fields of its messages are columns. The size of compressed parts
is checked first."""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, NamedTuple

import numpy as np

from .form import LogError, LogForm, needed, refuse_swollen, shown
from .heads import Heads
from .stream import RowBlock, Stream

PIECE = 1 << 20  # bytes decompressed at once
ROS1, MCAP, ZSTD = b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"\x28\xb5\x2f\xfd"
_CHUNK_1, _CHUNK_MCAP = b"\x05", 6  # opcodes of a chunk
_IN_CHUNK = 28  # bytes of an MCAP chunk before the name of the compression: two times, size, checksum


def refuse_bomb(path: Path, form: LogForm) -> None:
    """Raise LogError if the compressed chunks or files of a bag decompress to far more than its size. Damaged data are
    left to rosbags, which reports them.

    path: a file of a bag, or its folder.
    """
    for file in sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]:
        _refuse_parts(_parts(file), file, form)


def refuse_message_bombs(readers: Iterable[Any], path: Path, form: LogForm) -> None:
    """Like `refuse_bomb`, for bags with individually compressed messages; `readers`: open readers of rosbags."""
    packed = [r for r in readers if getattr(r, "compression_mode", None) == "message"]  # of ROS 2
    for storage in (s for reader in packed for s in getattr(reader, "storage", reader).storages):
        messages = storage.messages(storage.connections)
        _refuse_parts((("zstd", bytes(data)) for _, _, data in messages), path, form)


def _refuse_parts(parts: Iterator[tuple[str, bytes]], file: Path, form: LogForm) -> None:
    """Raise LogError if parts (compression, bytes) decompress to far more than their file, or the largest file of a
    folder."""
    largest, total = file if file.is_file() else max(file.iterdir(), key=lambda p: p.stat().st_size), 0
    for compression, data in parts:
        for size in _unpacked(compression, data, f"{largest.name} is a ROS bag"):
            total += size
            refuse_swollen(largest, total, form, "its compressed content")


def _parts(file: Path) -> Iterator[tuple[str, bytes]]:
    with open(file, "rb") as content:
        head = content.read(len(ROS1))
        size = file.stat().st_size
        if head == ROS1:
            yield from _of_ros1(content, size)
        elif head.startswith(MCAP):
            content.seek(len(MCAP))
            yield from _of_mcap(content, size)
        elif head.startswith(ZSTD):
            content.seek(0)
            yield "zstd", content.read()


def _of_ros1(file: BinaryIO, end: int) -> Iterator[tuple[str, bytes]]:
    """Yield the chunks of a ROS 1 bag. A record is a header and data, each preceded by its length."""
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
    start = 0
    while start + 4 <= len(head):
        (length,) = struct.unpack_from("<I", head, start)
        yield head[start + 4 : start + 4 + length]
        start += 4 + length


def _of_mcap(file: BinaryIO, end: int) -> Iterator[tuple[str, bytes]]:
    """Yield the chunks of an MCAP file. A record is an opcode, a length, and data."""
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
    """Read bytes preceded by their length; None if the file ends before."""
    size = struct.calcsize(form)
    if len(length := file.read(size)) < size or (count := struct.unpack(form, length)[0]) > end - file.tell():
        return None
    return file.read(count)


def _unpacked(compression: str, data: bytes, what: str) -> Iterator[int]:
    """Yield the sizes of the decompressed pieces of the data."""
    inflate: Any
    if compression == "bz2":
        inflate = bz2.BZ2Decompressor()
    elif compression == "lz4":
        inflate = needed("lz4.frame", what).LZ4FrameDecompressor()
    elif compression == "zstd":
        inflate = _zstd(what).ZstdDecompressor()
    else:
        return  # not compressed, or a compression that rosbags does not support
    try:
        while not inflate.eof:
            piece = inflate.decompress(data, PIECE)
            if not piece and (inflate.needs_input or not data):
                return
            data = b""
            yield len(piece)
    except Exception:  # of any of the three libraries; rosbags reports the damage
        return


def _zstd(what: str) -> Any:
    """Return the module of Python, from 3.14 on, else the package that rosbags needs."""
    try:
        return import_module("compression.zstd")
    except ImportError:
        return needed("backports.zstd", what)


RECEIVED, STAMP = "receive_time", "header.stamp"
MOST_COMPONENTS = 64  # of an array in a message; longer ones are pictures, point clouds and maps
PER_BLOCK = 4096  # messages
_NS = 10**9
_NAMES = ("name", "joint_names")  # fields with names for the components of the arrays in a message


class Bag:
    """A ROS 1 bag, or a ROS 2 bag: its folder, its metadata.yaml, or one of its files (.mcap, .db3)."""

    def __init__(self, path: Path, form: LogForm) -> None:
        self.source = shown(path)
        what = f"{self.source} is a ROS bag"
        self._path = path.parent if path.name == "metadata.yaml" else path
        self._reader = needed("rosbags.highlevel", what).AnyReader
        typesys = needed("rosbags.typesys", what)
        self._types = typesys.get_typestore(typesys.Stores.LATEST)
        refuse_bomb(self._path, form)
        with self.opened() as reader:
            refuse_message_bombs(reader.readers, self._path, form)
            self.start = int(reader.start_time)
            self.topics = {name: info for name, info in reader.topics.items() if info.msgcount}
            self.types = {name: info.msgtype or "" for name, info in self.topics.items()}
            if not self.topics:
                raise LogError(f"{self.source} holds no messages")

    def opened(self) -> Any:
        """Open the bag for reading. Raises LogError if it is not a bag."""
        return _Opened(self)

    def streams(self) -> list[Stream]:
        """Return the streams of all topics whose messages contain numbers."""
        streams = (
            TopicStream(self, topic, source, several)
            for topic in sorted(self.topics)
            for source, several in self._sources(topic)
        )
        return [stream for stream in streams if len(stream.heads.names) > 1]

    def messages(self, topic: str) -> Iterator[tuple[int, MessageSource, Any]]:
        """Yield for each message of a topic the time of reception [ns], the source, and the content."""
        with self.opened() as reader:
            connections = [c for c in reader.connections if c.topic == topic]
            callers = {c.id: str(getattr(c.ext, "callerid", None) or "") for c in connections}
            for connection, received, raw in reader.messages(connections=connections):
                message = reader.deserialize(raw, connection.msgtype)
                names = _names(message, f"{self.source} topic {topic}")
                yield int(received), MessageSource(callers[connection.id], tuple(sorted(names))), message

    def _sources(self, topic: str) -> Iterator[tuple[MessageSource, bool]]:
        """Yield the sources of a topic (publishers, sets of names), each with whether there are several."""
        with self.opened() as reader:
            several = len({getattr(c.ext, "callerid", None) for c in reader.connections if c.topic == topic}) > 1
        sources = dict[MessageSource, None]()
        for _, source, _ in self.messages(topic):
            sources[source] = None
            if not (several or source.names):
                break  # one publisher, and no names that could change
        yield from ((source, len(sources) > 1) for source in sources)


class MessageSource(NamedTuple):
    """The source of a message: the node that sent it, if known (ROS 1), and the sorted names in the message."""

    publisher: str
    names: tuple[str, ...]


class _Opened:
    def __init__(self, bag: Bag) -> None:
        self._bag = bag
        self._open: Any = None

    def __enter__(self) -> Any:
        try:
            self._open = self._bag._reader([self._bag._path], default_typestore=self._bag._types)
            return self._open.__enter__()
        except FileNotFoundError:
            raise
        except Exception as error:  # of rosbags, its database or its decompression
            raise self._refused(error) from error

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        self._open.__exit__(kind, error, trace)
        if isinstance(error, Exception) and not isinstance(error, LogError):
            raise self._refused(error) from error

    def _refused(self, error: Exception) -> LogError:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        return LogError(f"{self._bag.source} cannot be read as a ROS bag ({reason})")


class TopicStream(Stream):
    """The messages of a topic. Columns are fields with dotted names, `linear_acceleration.x`, and two times [s] after
    the first message of the bag: the time of reception and the stamp of the header. The stamp is the clock if it is
    set.

    If a message has a list of names, as a JointState, the components of its arrays are columns by name,
    `position[elbow]`, in any order. If several nodes publish on a topic, or if the names differ between messages, each
    source is a separate stream: "/joint_states [elbow, wrist]", "/joint_states from /arm".
    """

    row: ClassVar[str] = "message"
    cell: ClassVar[str] = "field"

    def __init__(self, bag: Bag, topic: str, sender: MessageSource, several: bool) -> None:
        self._bag, self._topic, self._source = bag, topic, sender
        names: list[str] = [RECEIVED]
        clock = RECEIVED
        for _, message in self._messages():
            names += [name for name, _ in _numbers(message)]
            if _stamp(message):
                clock = STAMP
                names.insert(0, STAMP)
            break
        units = ["s" if name in (STAMP, RECEIVED) else "" for name in names]
        label = topic
        if several:
            label += f" from {sender.publisher}" if sender.publisher else ""
            label += f" [{', '.join(sender.names)}]" if sender.names else ""
        source, stamps = f"{bag.source} topic {label}", {STAMP: bag.start, RECEIVED: bag.start}
        super().__init__(source, label, Heads(names, source, units), clock, stamps=stamps)
        meaning = "the stamp of the header" if clock == STAMP else "the time of reception"
        self.remarks.append(f"{bag.types[topic]}; its time is {meaning}, counted from the first message of the bag")

    def blocks(self, columns: Sequence[str], *, gaps: bool = False) -> Iterator[RowBlock]:
        """See `Stream.blocks`."""
        names = [self.heads.names[self.heads.place(name)] for name in columns]
        total, begin, rows = self._bag.topics[self._topic].msgcount, 0, list[list[float]]()
        for received, message in self._messages():
            numbers = dict(_numbers(message))
            numbers[RECEIVED] = (received - self._bag.start) / _NS
            if STAMP in names:
                stamp = _stamp(message)
                numbers[STAMP] = (stamp - self._bag.start) / _NS if stamp else np.nan
            row = [numbers.get(name, np.nan) for name in names]
            if not gaps and not np.all(np.isfinite(row)):
                j = int(np.argmin(np.isfinite(row)))
                raise self.no_number(begin + len(rows) + 1, columns[j], numbers.get(names[j], "nothing"))
            rows.append(row)
            if len(rows) == PER_BLOCK:
                begin += len(rows)
                yield RowBlock(np.array(rows), np.arange(begin - len(rows) + 1, begin + 1), begin / total)
                rows = []
        if rows:
            yield RowBlock(np.array(rows), np.arange(begin + 1, begin + 1 + len(rows)), 1.0)

    def _messages(self) -> Iterator[tuple[int, Any]]:
        for received, source, message in self._bag.messages(self._topic):
            if source == self._source:
                yield received, message


def _stamp(message: Any) -> int:
    """Return the stamp of the header of a message [ns], 0 if there is none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * _NS + int(stamp.nanosec)


def _names(message: Any, where: str) -> list[str]:
    """Return the names of the components of the arrays in a message. Raises LogError if a name occurs twice."""
    names = next((list(v) for f in _NAMES if isinstance(v := getattr(message, f, None), (list, np.ndarray))), [])
    if not all(isinstance(name, str) for name in names):
        return []
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise LogError(f"{where}: a message names '{twice[0]}' twice, so its numbers are ambiguous")
    return names


def _numbers(message: Any, prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yield the dotted names and numbers of a message."""
    names = _names(message, prefix or "message")
    for field in fields(message):
        value, name = getattr(message, field.name), prefix + field.name
        if field.name.startswith("__") or name == "header":
            continue
        if is_dataclass(value):
            yield from _numbers(value, f"{name}.")
        elif isinstance(value, (bool, int, float, np.number, np.bool_)):
            yield name, float(value)
        elif isinstance(value, (list, np.ndarray)) and 0 < len(value) <= MOST_COMPONENTS:
            keys: Sequence[object] = names if len(names) == len(value) else range(len(value))
            if is_dataclass(value[0]):
                for k, part in zip(keys, value, strict=True):
                    yield from _numbers(part, f"{name}[{k}].")
            elif not isinstance(value[0], str):
                yield from ((f"{name}[{k}]", float(part)) for k, part in zip(keys, value, strict=True))
