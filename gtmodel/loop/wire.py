"""Protobuf's wire format: keys, varints, doubles and embedded messages, with nothing behind it but bytes."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator

DATAGRAM_MAX = 1400
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
_VARINT_BYTES = 10
_UINT64 = (1 << 64) - 1
_UINT32 = (1 << 32) - 1
_ONE_BYTE = [bytes([n]) for n in range(0x80)]


class WireError(ValueError):
    """Bytes that are no message of this protocol."""


def varint(value: int) -> bytes:
    """Seven bits per byte, lowest first."""
    if value < 0x80:
        return _ONE_BYTE[value]
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def varint_field(number: int, value: int) -> bytes:
    return varint(number << 3 | VARINT) + varint(value)


def double_field(number: int, value: float) -> bytes:
    return varint(number << 3 | FIXED64) + struct.pack("<d", value)


def message_field(number: int, content: bytes) -> bytes:
    return varint(number << 3 | BYTES) + varint(len(content)) + content


def doubles_field(number: int, values: Iterable[float], *, packed: bool = False) -> bytes:
    """EgmJoints as a field: a repeated double in its field 1; nothing for no values."""
    given = list(values)
    if not given:
        return b""
    if packed:
        return message_field(number, message_field(1, struct.pack(f"<{len(given)}d", *given)))
    return message_field(number, b"".join(double_field(1, x) for x in given))


def uint32(value: int) -> int:
    """The low 32 bits, as protobuf takes them."""
    return value & _UINT32


def fields(data: bytes) -> Iterator[tuple[int, int, int | float | bytes]]:
    """(number, wire type, value) of each field: an int for a varint, a float for eight bytes, bytes for the others.

    Raises WireError for a message that is cut or malformed; groups are refused.
    """
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        number, kind = key >> 3, key & 7
        if key > _UINT32 or number == 0:
            raise WireError("a field has no number")
        if kind == VARINT:
            value, at = _varint(data, at)
            yield number, kind, value
            continue
        if kind not in (FIXED64, FIXED32, BYTES):
            raise WireError("a field is of an unknown wire type")
        size = {FIXED64: 8, FIXED32: 4}.get(kind)
        if size is None:
            size, at = _varint(data, at)
        if size > len(data) - at:
            raise WireError("a field is longer than the message")
        piece = data[at : at + size]
        at += size
        yield number, kind, struct.unpack("<d", piece)[0] if kind == FIXED64 else piece


def _varint(data: bytes, at: int) -> tuple[int, int]:
    if at < len(data) and data[at] < 0x80:
        return data[at], at + 1
    value = 0
    for n in range(_VARINT_BYTES):
        if at >= len(data):
            break
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << 7 * n
        if not byte & 0x80:
            return value & _UINT64, at
    raise WireError("a varint does not end")
