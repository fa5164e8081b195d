"""ROS bags by rosbags: each topic is a stream, the fields of its messages are columns; compressed parts are unpacked
piece by piece before."""

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


RECEIVED, STAMP = "receive_time", "header.stamp"
MOST_COMPONENTS = 64  # of an array in a message: longer ones are pictures, clouds and maps
PER_BLOCK = 4096  # messages
_NS = 10**9
_NAMES = ("name", "joint_names")  # fields that name the components of the arrays beside them


class Bag:
    """A ROS 1 bag, or a ROS 2 bag: its folder, the metadata.yaml in it, or a file of it (.mcap, .db3)."""

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
        """The bag, open for reading. Raises LogError where it is none."""
        return _Opened(self)

    def streams(self) -> list[Stream]:
        """A stream for each topic whose messages hold numbers."""
        made = (
            TopicStream(self, topic, of, several) for topic in sorted(self.topics) for of, several in self._of(topic)
        )
        return [stream for stream in made if len(stream.heads.names) > 1]

    def messages(self, topic: str) -> Iterator[tuple[int, MessageSource, Any]]:
        """Of each message of a topic: when it was received [ns], of what it is, and its content."""
        with self.opened() as reader:
            of_topic = [c for c in reader.connections if c.topic == topic]
            callers = {c.id: str(getattr(c.ext, "callerid", None) or "") for c in of_topic}
            for connection, received, raw in reader.messages(connections=of_topic):
                message = reader.deserialize(raw, connection.msgtype)
                names = _names(message, f"{self.source} topic {topic}")
                yield int(received), MessageSource(callers[connection.id], tuple(sorted(names))), message

    def _of(self, topic: str) -> Iterator[tuple[MessageSource, bool]]:
        """What the messages of a topic are of, and whether that is several: publishers, or sets of joints."""
        with self.opened() as reader:
            several = len({getattr(c.ext, "callerid", None) for c in reader.connections if c.topic == topic}) > 1
        sources = dict[MessageSource, None]()
        for _, source, _ in self.messages(topic):
            sources[source] = None
            if not (several or source.names):
                break  # one publisher, and no names that could change
        yield from ((source, len(sources) > 1) for source in sources)


class MessageSource(NamedTuple):
    """What a message is of: the node that sent it, where the bag says so (ROS 1), and the names in it, sorted."""

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
        except Exception as error:  # of rosbags, of its database and of its compression
            raise self._refused(error) from error

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        self._open.__exit__(kind, error, trace)
        if isinstance(error, Exception) and not isinstance(error, LogError):
            raise self._refused(error) from error

    def _refused(self, error: Exception) -> LogError:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        return LogError(f"{self._bag.source} cannot be read as a ROS bag ({reason})")


class TopicStream(Stream):
    """The messages of a topic. Columns are dotted fields, `linear_acceleration.x`, and two times [s] after the bag's
    first message: when it was received, and the stamp of its header, which is the clock where it is set.

    Arrays beside a list of names, as those of a JointState, are columns by name, `position[elbow]`, whatever order a
    message has them in. Where several nodes publish on a topic, or messages with other names stand between, each is a
    stream of its own: "/joint_states [elbow, wrist]", "/joint_states from /arm".
    """

    row: ClassVar[str] = "message"
    cell: ClassVar[str] = "field"

    def __init__(self, bag: Bag, topic: str, of: MessageSource, several: bool) -> None:
        self._bag, self._topic, self._source = bag, topic, of
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
            label += f" from {of.publisher}" if of.publisher else ""
            label += f" [{', '.join(of.names)}]" if of.names else ""
        source, stamps = f"{bag.source} topic {label}", {STAMP: bag.start, RECEIVED: bag.start}
        super().__init__(source, label, Heads(names, source, units), clock, stamps=stamps)
        from_ = "the stamp of the header" if clock == STAMP else "when the message was received"
        self.remarks.append(f"{bag.types[topic]}; its time is {from_}, counted from the first message of the bag")

    def blocks(self, columns: Sequence[str], *, gaps: bool = False) -> Iterator[RowBlock]:
        """See `Stream.blocks`."""
        asked = [self.heads.names[self.heads.place(name)] for name in columns]
        total, begin, rows = self._bag.topics[self._topic].msgcount, 0, list[list[float]]()
        for received, message in self._messages():
            numbers = dict(_numbers(message))
            numbers[RECEIVED] = (received - self._bag.start) / _NS
            if STAMP in asked:
                stamp = _stamp(message)
                numbers[STAMP] = (stamp - self._bag.start) / _NS if stamp else np.nan
            row = [numbers.get(name, np.nan) for name in asked]
            if not gaps and not np.all(np.isfinite(row)):
                j = int(np.argmin(np.isfinite(row)))
                raise self.no_number(begin + len(rows) + 1, columns[j], numbers.get(asked[j], "nothing"))
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
    """The stamp of a message's header [ns], 0 where there is none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * _NS + int(stamp.nanosec)


def _names(message: Any, where: str) -> list[str]:
    """The names that a message gives to the numbers of its arrays. Raises LogError where one is there twice."""
    names = next((list(v) for f in _NAMES if isinstance(v := getattr(message, f, None), (list, np.ndarray))), [])
    if not all(isinstance(name, str) for name in names):
        return []
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise LogError(f"{where}: a message names '{twice[0]}' twice; which of the two is meant is not clear")
    return names


def _numbers(message: Any, prefix: str = "") -> Iterator[tuple[str, float]]:
    """The numbers of a message by their dotted names."""
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
            of: Sequence[object] = names if len(names) == len(value) else range(len(value))
            if is_dataclass(value[0]):
                for k, part in zip(of, value, strict=True):
                    yield from _numbers(part, f"{name}[{k}].")
            elif not isinstance(value[0], str):
                yield from ((f"{name}[{k}]", float(part)) for k, part in zip(of, value, strict=True))
