"""Wrenches of two force sensors, at handle and tool, in the robot's datagrams (gt_wrench in Python).

Neither protocol defines them: these EGM fields and RSI elements are extensions by gtmodel.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field

from .egm import BYTES, FIXED64, VARINT, WireError, double_field, fields, message_field, varint_field
from .rsi import COMMENT, read_decimal, read_digits, write_decimal

EGM_HANDLE, EGM_TOOL = 100, 101
RSI_HANDLE, RSI_TOOL = b"FtHandle", b"FtTool"
_NAMES = (b"FX", b"FY", b"FZ", b"MX", b"MY", b"MZ")
_UINT32 = (1 << 32) - 1
_END = re.compile(rb"[ \t\r\n]*(/?)>")
_WORD = re.compile(rb"[A-Za-z0-9_]*")
_ATTRIBUTE = re.compile(rb"[ \t\r\n]*([A-Za-z0-9_]+)[ \t\r\n]*=[ \t\r\n]*(?:\"([^\"]*)\"|'([^']*)')")


@dataclass
class Wrench:
    """Reading of a force sensor, about its origin and along its axes: external force [N] and moment [N m] on the load
    that it carries, age in cycles of the robot, and status of the sensor: 0 if the wrench is usable.
    """

    force_N: list[float] = field(default_factory=lambda: [0.0] * 3)
    moment_N_m: list[float] = field(default_factory=lambda: [0.0] * 3)
    age_cycles: int = 0
    status: int = 0


def to_egm(data: bytes, handle: Wrench, tool: Wrench) -> bytes:
    """Append two wrenches to an EgmRobot."""
    for number, w in ((EGM_HANDLE, handle), (EGM_TOOL, tool)):
        content = b"".join(double_field(n, x) for n, xs in ((1, w.force_N), (2, w.moment_N_m)) for x in xs)
        data += message_field(number, content + varint_field(3, w.age_cycles) + varint_field(4, w.status))
    return data


def to_rsi(data: bytes, handle: Wrench, tool: Wrench) -> bytes:
    """Insert two wrenches into a telegram. Raises ValueError if a number cannot be sent as a decimal."""
    out = b""
    for name, w in ((RSI_HANDLE, handle), (RSI_TOOL, tool)):
        pairs = zip(_NAMES, [*w.force_N, *w.moment_N_m], strict=True)
        numbers = b" ".join(b'%s="%s"' % (key, write_decimal(x)) for key, x in pairs)
        out += b'<%s %s Age="%d" State="%d"/>' % (name, numbers, w.age_cycles, w.status)
    head, end, rest = data.rpartition(b"<IPOC>")
    return head + out + end + rest


def read_egm(data: bytes) -> tuple[Wrench, Wrench] | None:
    """Return the wrenches of handle and tool, or None unless each appears once. `egm.decode_robot` accepts the data."""
    parts: dict[int, list[bytes]] = {EGM_HANDLE: [], EGM_TOOL: []}
    for number, kind, value in fields(data):
        if kind == BYTES and number in parts and isinstance(value, bytes):
            parts[number].append(value)
    if any(len(contents) != 1 for contents in parts.values()):
        return None
    try:
        handle, tool = (_from_egm(contents[0]) for contents in parts.values())
    except WireError:
        return None
    return None if handle is None or tool is None else (handle, tool)


def _from_egm(data: bytes) -> Wrench | None:
    numbers: dict[int, list[float]] = {1: [], 2: []}
    ages, wrench = 0, Wrench()
    for number, kind, value in fields(data):
        if number in numbers:
            if kind == FIXED64 and isinstance(value, float):
                numbers[number].append(value)
            elif kind == BYTES and isinstance(value, bytes) and len(value) % 8 == 0:
                numbers[number] += struct.unpack(f"<{len(value) // 8}d", value)
            else:
                return None
        elif kind == VARINT and number == 3 and isinstance(value, int):
            wrench.age_cycles = min(value, _UINT32)  # clipped, does not wrap
            ages += 1
        elif kind == VARINT and number == 4 and isinstance(value, int):
            wrench.status = min(value, _UINT32)
    wrench.force_N, wrench.moment_N_m = numbers[1], numbers[2]
    return wrench if len(numbers[1]) == len(numbers[2]) == 3 and ages == 1 else None


def read_rsi(data: bytes) -> tuple[Wrench, Wrench] | None:
    """Return the wrenches of handle and tool, or None unless each appears once. `rsi.decode_robot` accepts the data."""
    wrenches: dict[bytes, dict[bytes, bytes]] = {}
    depth, offset = 0, data.find(b"<")
    while offset >= 0:
        offset += 1
        if data[offset : offset + 1] == b"/":
            depth, offset = depth - 1, data.find(b">", offset)
        elif data[offset : offset + 1] == b"?":
            offset = data.find(b">", offset)
        elif comment := COMMENT.match(data, offset + 1):
            offset = comment.end()
        else:
            name, pairs, empty, offset = _element(data, offset)
            if depth == 1 and name in (RSI_HANDLE, RSI_TOOL):
                attributes = {key: value for key, value in pairs if key in (*_NAMES, b"Age", b"State")}
                if wrenches.get(name) or len(attributes) < sum(key in attributes for key, _ in pairs):
                    return None  # twice
                wrenches[name] = attributes
            depth += not empty
        offset = data.find(b"<", offset)
    handle, tool = (_from_rsi(wrenches.get(name, {})) for name in (RSI_HANDLE, RSI_TOOL))
    return None if handle is None or tool is None else (handle, tool)


def _element(data: bytes, offset: int) -> tuple[bytes, list[tuple[bytes, bytes]], bool, int]:
    """Return name and attributes of an element, whether it is empty, and the offset behind its tag."""
    word = _WORD.match(data, offset)
    assert word is not None
    offset, pairs = word.end(), []
    while match := _ATTRIBUTE.match(data, offset):
        pairs.append((match[1], match[2] if match[3] is None else match[3]))
        offset = match.end()
    end = _END.match(data, offset)
    assert end is not None, "the telegram was accepted"
    return word[0], pairs, end[1] == b"/", end.end()


def _from_rsi(attributes: dict[bytes, bytes]) -> Wrench | None:
    numbers = [read_decimal(attributes.get(key, b"")) for key in _NAMES]
    age, status = read_digits(attributes.get(b"Age", b"")), read_digits(attributes.get(b"State", b"0"))
    six = [x for x in numbers if x is not None]
    if len(six) < len(numbers) or age is None or status is None:
        return None
    return Wrench(six[:3], six[3:], min(age, _UINT32), min(status, _UINT32))
