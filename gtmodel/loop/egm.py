"""ABB EGM in Python, robot and sensor side: Protobuf wire format and the protocol's field numbers, without any vendor
file."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

DATAGRAM_MAX = 1400
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
_VARINT_BYTES = 10
_UINT64 = (1 << 64) - 1
_UINT32 = (1 << 32) - 1
_ONE_BYTE = [bytes([n]) for n in range(0x80)]


class WireError(ValueError):
    """The bytes are not a message of this protocol."""


def varint(value: int) -> bytes:
    """Encode an integer, seven bits per byte, lowest first."""
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
    """Encode EgmJoints as a field: a repeated double in field 1. Empty without values."""
    numbers = list(values)
    if not numbers:
        return b""
    if packed:
        return message_field(number, message_field(1, struct.pack(f"<{len(numbers)}d", *numbers)))
    return message_field(number, b"".join(double_field(1, x) for x in numbers))


def uint32(value: int) -> int:
    """Return the low 32 bits, as protobuf does."""
    return value & _UINT32


def fields(data: bytes) -> Iterator[tuple[int, int, int | float | bytes]]:
    """Yield (number, wire type, value) of each field: an int for a varint, a float for eight bytes, otherwise bytes.

    Raises WireError if the message is truncated or malformed, or contains groups.
    """
    offset = 0
    while offset < len(data):
        key, offset = _varint(data, offset)
        number, kind = key >> 3, key & 7
        if key > _UINT32 or number == 0:
            raise WireError("a field has no valid number")
        if kind == VARINT:
            value, offset = _varint(data, offset)
            yield number, kind, value
            continue
        if kind not in (FIXED64, FIXED32, BYTES):
            raise WireError("a field has an unknown wire type")
        size = {FIXED64: 8, FIXED32: 4}.get(kind)
        if size is None:
            size, offset = _varint(data, offset)
        if size > len(data) - offset:
            raise WireError("a field is longer than the message")
        content = data[offset : offset + size]
        offset += size
        yield number, kind, struct.unpack("<d", content)[0] if kind == FIXED64 else content


def _varint(data: bytes, offset: int) -> tuple[int, int]:
    """Return the varint at `offset` and the offset behind it."""
    if offset < len(data) and data[offset] < 0x80:
        return data[offset], offset + 1
    value = 0
    for n in range(_VARINT_BYTES):
        if offset >= len(data):
            break
        byte = data[offset]
        offset += 1
        value |= (byte & 0x7F) << 7 * n
        if not byte & 0x80:
            return value & _UINT64, offset
    raise WireError("a varint does not end")


JOINTS = 6
TYPE_UNDEFINED, TYPE_DATA, TYPE_CORRECTION, TYPE_PATH_CORRECTION = 0, 2, 3, 4
MCI_RUNNING = 3
MOTORS_OFF = 2


@dataclass
class EgmPose:
    """Numbers of EgmFeedBack or EgmPlanned; a list is empty if the robot did not send it."""

    joints_deg: list[float] = field(default_factory=list)
    external_mm: list[float] = field(default_factory=list)
    position_mm: list[float] = field(default_factory=lambda: [0.0] * 3)
    quaternion: list[float] = field(default_factory=lambda: [0.0] * 4)
    euler_deg: list[float] = field(default_factory=lambda: [0.0] * 3)
    has_position: bool = False
    has_quaternion: bool = False
    has_euler: bool = False


@dataclass
class EgmRobot:
    """The message EgmRobot."""

    sequence: int = 0
    time_ms: int = 0
    type: int = 0
    feedback: EgmPose = field(default_factory=EgmPose)
    planned: EgmPose = field(default_factory=EgmPose)
    motor_state: int = 0
    mci_state: int = 0
    rapid_state: int = 0
    convergence_met: bool = False


@dataclass
class EgmSensor:
    """The message EgmSensor, or EgmSensorPathCorr if `path_mm` is not None."""

    sequence: int = 0
    time_ms: int = 0
    type: int = TYPE_CORRECTION
    joints_deg: list[float] = field(default_factory=list)
    joint_speeds_deg_s: list[float] = field(default_factory=list)
    external_mm: list[float] = field(default_factory=list)
    external_speeds_mm_s: list[float] = field(default_factory=list)
    path_mm: list[float] | None = None
    age_ms: int = 0


def decode_robot(data: bytes) -> EgmRobot:
    """Decode EgmRobot. Raises WireError if the datagram is truncated, malformed, incomplete or not finite."""
    if len(data) > DATAGRAM_MAX:
        raise WireError("the datagram is too long")
    robot = EgmRobot()
    varints: dict[int, dict[int, int]] = {1: {}, 4: {}, 5: {}, 8: {}}
    for number, kind, value in fields(data):
        if kind == VARINT and number == 6:
            robot.convergence_met = value != 0
        elif kind == BYTES and isinstance(value, bytes):
            if number in (2, 3):
                _pose(value, robot.feedback if number == 2 else robot.planned)
            elif number in varints:
                varints[number] |= _varints(value)
    robot.sequence, robot.time_ms, robot.type = _header(varints[1])
    robot.motor_state, robot.mci_state, robot.rapid_state = (varints[n].get(1, 0) for n in (4, 5, 8))
    for pose in (robot.feedback, robot.planned):
        if not all(map(math.isfinite, _numbers_of(pose))):
            raise WireError("a number is not finite")
    return robot


def encode_robot(robot: EgmRobot, *, packed: bool = False) -> bytes:
    """Encode EgmRobot as a robot sends it: doubles unpacked, as in proto2, unless `packed`."""
    out = message_field(1, _header_bytes(robot.sequence, robot.time_ms, robot.type or TYPE_DATA))
    for number, pose in ((2, robot.feedback), (3, robot.planned)):
        parts = (
            (pose.has_position, pose.position_mm), (pose.has_quaternion, pose.quaternion),
            (pose.has_euler, pose.euler_deg),
        )  # fmt: skip
        cartesian = b"".join(message_field(n, _numbered(x)) for n, (present, x) in enumerate(parts, 1) if present)
        content = doubles_field(1, pose.joints_deg, packed=packed)
        content += message_field(2, cartesian) if cartesian else b""
        content += doubles_field(3, pose.external_mm, packed=packed)
        out += message_field(number, content)
    out += message_field(4, varint_field(1, robot.motor_state))
    out += message_field(5, varint_field(1, robot.mci_state))
    out += varint_field(6, int(robot.convergence_met))
    return out + message_field(8, varint_field(1, robot.rapid_state))


def encode_sensor(sensor: EgmSensor) -> bytes:
    """Encode EgmSensor or EgmSensorPathCorr, byte for byte like the C codec."""
    if sensor.path_mm is not None:
        head = message_field(1, _header_bytes(sensor.sequence, sensor.time_ms, TYPE_PATH_CORRECTION))
        content = message_field(1, _numbered(sensor.path_mm)) + varint_field(2, sensor.age_ms)
        return head + message_field(2, content)
    head = message_field(1, _header_bytes(sensor.sequence, sensor.time_ms, TYPE_CORRECTION))
    planned = doubles_field(1, sensor.joints_deg) + doubles_field(3, sensor.external_mm)
    speeds = doubles_field(1, sensor.joint_speeds_deg_s) + doubles_field(3, sensor.external_speeds_mm_s)
    return head + message_field(2, planned) + message_field(3, speeds)


def decode_sensor(data: bytes) -> EgmSensor:
    """Decode the loop's answer as a robot reads it. Raises WireError."""
    parts = dict(_messages(data))
    sensor = EgmSensor(*_header(_varints(parts.get(1, b""))))
    if sensor.type == TYPE_PATH_CORRECTION:
        sensor.path_mm = [0.0] * 3
        for number, position in _messages(parts.get(2, b"")):
            if number == 1:
                _numbered_into(position, sensor.path_mm)
        sensor.age_ms = _varints(parts.get(2, b"")).get(2, 0)
        return sensor
    planned, speed = EgmPose(), EgmPose()
    _pose(parts.get(2, b""), planned)
    _pose(parts.get(3, b""), speed)
    sensor.joints_deg, sensor.external_mm = planned.joints_deg, planned.external_mm
    sensor.joint_speeds_deg_s, sensor.external_speeds_mm_s = speed.joints_deg, speed.external_mm
    return sensor


def _header_bytes(sequence: int, time_ms: int, kind: int) -> bytes:
    return varint_field(1, sequence) + varint_field(2, time_ms) + varint_field(3, kind)


def _header(fields: Mapping[int, int]) -> tuple[int, int, int]:
    """Return sequence number, time and type."""
    if not {1, 2} <= fields.keys():
        raise WireError("the header lacks the sequence number or the time")
    return fields[1], fields[2], fields.get(3, 0)


def _messages(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the embedded messages with their field numbers."""
    return ((number, value) for number, kind, value in fields(data) if kind == BYTES and isinstance(value, bytes))


def _varints(data: bytes) -> dict[int, int]:
    """Return the last varint of each field number."""
    return {n: uint32(value) for n, kind, value in fields(data) if kind == VARINT and isinstance(value, int)}


def _pose(data: bytes, pose: EgmPose) -> None:
    for number, value in _messages(data):
        if number == 1:
            _joints(value, pose.joints_deg)
        elif number == 2:
            _cartesian(value, pose)
        elif number == 3:
            _joints(value, pose.external_mm)


def _cartesian(data: bytes, pose: EgmPose) -> None:
    present = set()
    parts = {1: pose.position_mm, 2: pose.quaternion, 3: pose.euler_deg}
    for number, value in _messages(data):
        if number in parts:
            present.add(number)
            _numbered_into(value, parts[number])
    pose.has_position |= 1 in present
    pose.has_quaternion |= 2 in present
    pose.has_euler |= 3 in present


def _joints(data: bytes, values: list[float]) -> None:
    """Append the doubles of field 1, packed or not, to `values`, up to six."""
    for number, kind, value in fields(data):
        joints: list[float] = []
        if number == 1 and kind == FIXED64 and isinstance(value, float):
            joints = [value]
        elif number == 1 and kind == BYTES and isinstance(value, bytes):
            if len(value) % 8:
                raise WireError("packed doubles are truncated")
            joints = list(struct.unpack(f"<{len(value) // 8}d", value))
        values += joints[: max(0, JOINTS - len(values))]


def _numbered(values: list[float]) -> bytes:
    return b"".join(double_field(n, x) for n, x in enumerate(values, 1))


def _numbered_into(data: bytes, values: list[float]) -> None:
    for number, kind, value in fields(data):
        if kind == FIXED64 and number <= len(values) and isinstance(value, float):
            values[number - 1] = value


def _numbers_of(pose: EgmPose) -> list[float]:
    return [*pose.joints_deg, *pose.external_mm, *pose.position_mm, *pose.quaternion, *pose.euler_deg]
