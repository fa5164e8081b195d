"""EGM against google.protobuf with an own schema: both codecs, C and Python, read and write what it does."""

from __future__ import annotations

import ctypes
import random
from typing import Any

import pytest

from gtmodel.loop import egm
from gtmodel.loop.egm import DATAGRAM_MAX, WireError
from tests.loop.c_codecs import decode_egm, encode_egm
from tests.loop.spoiling import spoilt

pytest.importorskip(
    "google.protobuf", reason="google.protobuf is the oracle of the EGM codec; pip install 'gtmodel[oracle]'"
)
from google.protobuf.message import DecodeError, Message

from tests.loop.egm_schema import NOT_READ, messages

MESSAGES = {packed: messages(packed=packed) for packed in (False, True)}
DRAWS = 300
# the extremes of a double beside what a robot sends; finite, for others are refused
DOUBLES = (0.0, -0.0, 5e-324, -1.7976931348623157e308, 2.2250738585072014e-308)


def _number(rng: random.Random) -> float:
    return rng.choice(DOUBLES) if rng.random() < 0.2 else rng.uniform(-3000.0, 3000.0)


def _uint32(rng: random.Random) -> int:
    return rng.choice((0, 1, 127, 128, 2**32 - 1, rng.randrange(2**32)))


def _fill_pose(pose: Any, rng: random.Random) -> None:
    """Any part may be missing; more than six joints are sent now and then."""
    for joints in (pose.joints, pose.externalJoints):
        if rng.random() < 0.8:
            joints.joints.extend(_number(rng) for _ in range(rng.randint(0, 8)))
    for part, count in ((pose.cartesian.pos, 3), (pose.cartesian.orient, 4), (pose.cartesian.euler, 3)):
        if rng.random() < 0.6:
            for n in range(1, count + 1):
                setattr(part, f"n{n}", _number(rng))
    if rng.random() < 0.5:
        pose.time.sec, pose.time.usec = _uint32(rng), _uint32(rng)


def _robot(rng: random.Random, *, packed: bool) -> Any:
    robot = MESSAGES[packed]["Robot"]()
    robot.header.seqno, robot.header.tm, robot.header.mtype = _uint32(rng), _uint32(rng), rng.randrange(6)
    _fill_pose(robot.feedBack, rng)
    _fill_pose(robot.planned, rng)
    for state in (robot.motorState, robot.mciState, robot.rapidExecState):
        if rng.random() < 0.8:
            state.state = _uint32(rng)
    if rng.random() < 0.8:
        robot.mciConvergenceMet = rng.random() < 0.5
    robot.testSignals.signals.extend(_number(rng) for _ in range(rng.randint(0, 5)))
    if rng.random() < 0.5:
        robot.measuredForce.signals.append(float("nan"))  # not used, so that it may be anything
        robot.utilizationRate = 12.5
    return robot


def _pose_of(pose: Any) -> egm.EgmPose:
    parts = pose.cartesian
    numbers = {
        "position_mm": [parts.pos.n1, parts.pos.n2, parts.pos.n3],
        "quaternion": [parts.orient.n1, parts.orient.n2, parts.orient.n3, parts.orient.n4],
        "euler_deg": [parts.euler.n1, parts.euler.n2, parts.euler.n3],
    }
    return egm.EgmPose(
        joints_deg=list(pose.joints.joints[:6]),
        external_mm=list(pose.externalJoints.joints[:6]),
        has_position=parts.HasField("pos"),
        has_quaternion=parts.HasField("orient"),
        has_euler=parts.HasField("euler"),
        **numbers,
    )


def _read_by_protobuf(robot: Any) -> egm.EgmRobot:
    return egm.EgmRobot(
        robot.header.seqno, robot.header.tm, robot.header.mtype, _pose_of(robot.feedBack), _pose_of(robot.planned),
        robot.motorState.state, robot.mciState.state, robot.rapidExecState.state, robot.mciConvergenceMet,
    )  # fmt: skip


@pytest.mark.parametrize("packed", [False, True])
def test_what_protobuf_writes_is_read(runtime: ctypes.CDLL, packed: bool) -> None:
    rng = random.Random(1)
    for _ in range(DRAWS):
        robot = _robot(rng, packed=packed)
        data = robot.SerializeToString()
        assert len(data) <= DATAGRAM_MAX
        expected = _read_by_protobuf(robot)
        assert egm.decode_robot(data) == expected
        assert decode_egm(runtime, data) == expected


def _with_unknown(message: Message, rng: random.Random) -> None:
    """Fields of numbers that EGM does not have, of every wire type, merged into a message and all inside it."""
    unknown = MESSAGES[False]["Unknown"](a=_uint32(rng), b=_number(rng), c="ä" * rng.randint(0, 3), d=7)
    unknown.e.pos.n1 = _number(rng)
    for field, value in message.ListFields():
        if field.message_type is not None:
            _with_unknown(value, rng)
    message.MergeFromString(unknown.SerializeToString())


@pytest.mark.parametrize("packed", [False, True])
def test_fields_that_are_not_known_are_skipped_everywhere(runtime: ctypes.CDLL, packed: bool) -> None:
    rng = random.Random(2)
    longer = 0
    for _ in range(DRAWS):
        robot = MESSAGES[packed]["Robot"]()
        robot.header.seqno, robot.header.tm = _uint32(rng), _uint32(rng)
        robot.feedBack.externalJoints.joints.extend(_number(rng) for _ in range(3))
        robot.feedBack.cartesian.pos.n2 = _number(rng)
        robot.mciState.state = 3
        expected, plain = _read_by_protobuf(robot), robot.SerializeToString()
        _with_unknown(robot, rng)
        data = robot.SerializeToString()
        longer += len(data) > len(plain) + 6 * 20
        assert egm.decode_robot(data) == expected
        assert decode_egm(runtime, data) == expected
    assert longer == DRAWS, "the fields did get into the inner messages"


def test_protobuf_reads_what_python_sends_as_a_robot() -> None:
    rng = random.Random(3)
    for draw in range(DRAWS):
        packed = draw % 2 == 1
        robot = _read_by_protobuf(_robot(rng, packed=packed))
        robot.type = robot.type or egm.TYPE_DATA
        data = egm.encode_robot(robot, packed=packed)
        for schema in (False, True):  # a parser takes both, whatever the schema says
            found = MESSAGES[schema]["Robot"].FromString(data)
            assert _read_by_protobuf(found) == robot


def _sensor(rng: random.Random) -> egm.EgmSensor:
    if rng.random() < 0.3:
        path = [_number(rng) for _ in range(3)]
        return egm.EgmSensor(_uint32(rng), _uint32(rng), egm.TYPE_PATH_CORRECTION, path_mm=path, age_ms=_uint32(rng))
    six = [[_number(rng) for _ in range(count)] for count in (rng.randint(0, 6), rng.randint(0, 6)) for _ in range(2)]
    return egm.EgmSensor(_uint32(rng), _uint32(rng), egm.TYPE_CORRECTION, *six)


def test_answers_are_the_bytes_of_protobuf(runtime: ctypes.CDLL) -> None:
    """Protobuf writes fields in the order of their numbers; so do both codecs, to the byte."""
    rng = random.Random(4)
    kinds = set()
    for _ in range(DRAWS):
        sensor = _sensor(rng)
        data = egm.encode_sensor(sensor)
        assert encode_egm(runtime, sensor) == data
        name = "Sensor" if sensor.path_mm is None else "SensorPathCorr"
        found = MESSAGES[False][name].FromString(data)
        assert (found.header.seqno, found.header.tm, found.header.mtype) == (
            sensor.sequence, sensor.time_ms, sensor.type,
        )  # fmt: skip
        if sensor.path_mm is not None:
            assert [getattr(found.pathCorr.pos, f"n{n}") for n in (1, 2, 3)] == sensor.path_mm
            assert found.pathCorr.age == sensor.age_ms
        else:
            assert list(found.planned.joints.joints) == sensor.joints_deg
            assert list(found.planned.externalJoints.joints) == sensor.external_mm
            assert list(found.speedRef.joints.joints) == sensor.joint_speeds_deg_s
            assert list(found.speedRef.externalJoints.joints) == sensor.external_speeds_mm_s
        assert found.SerializeToString() == data, "no field is unknown to protobuf or in another place"
        assert egm.decode_sensor(data) == sensor
        kinds.add(name)
    assert kinds == {"Sensor", "SensorPathCorr"}


def test_what_is_accepted_protobuf_accepts_with_the_same_numbers(runtime: ctypes.CDLL) -> None:
    """On spoilt datagrams. The other way round there are differences on purpose: both codecs refuse more."""
    rng, schema = random.Random(5), messages(without=NOT_READ)["Robot"]
    both = refused = 0
    for draw in range(20):
        whole = _robot(rng, packed=draw % 2 == 1)
        whole.header.mtype = 2
        for data in spoilt(whole.SerializeToString(), 200, draw, b"\x00\x01\x08\x09\x0a\x12\x1a\x7f\x80\xff"):
            try:
                mine = egm.decode_robot(data)
            except WireError:
                mine = None
            assert decode_egm(runtime, data) == mine
            try:
                found = schema.FromString(data)
            except DecodeError:
                assert mine is None, data.hex()
                refused += 1
                continue
            if mine is not None:
                assert _read_by_protobuf(found) == mine, data.hex()
                both += 1
    assert both > 500 and refused > 500, "both verdicts occur"
