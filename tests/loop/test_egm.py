"""EGM: bytes written by hand from the wire format's definition, C and Python on the same datagrams, good and bad."""

from __future__ import annotations

import ctypes

import pytest
from hypothesis import given, settings, strategies as st

from gtmodel.loop import egm
from gtmodel.loop.egm import DATAGRAM_MAX, WireError
from tests.loop.c_codecs import EgmPathCorrection, decode_egm, encode_egm
from tests.loop.spoiling import spoilt

# header {1: 300, 2: 70000, 3: 2}; feedBack {1 {1: 1.5, 1: -2.0}, 3 {1: 1000.25}}; mciState {1: 3}
BY_HAND = bytes.fromhex(
    "0a09" "08ac02" "10f0a204" "1802"
    "121f" "0a12" "09000000000000f83f" "0900000000000000c0" "1a09" "09000000000042" "8f40"
    "2a02" "0803"
)  # fmt: skip
# EgmSensor: header {1: 300, 2: 70000, 3: 3}; planned {3 {1: 1000.25}}; speedRef {3 {1: 0.5}}
SENSOR_BY_HAND = bytes.fromhex(
    "0a09" "08ac02" "10f0a204" "1803"
    "120b" "1a09" "09000000000042" "8f40"
    "1a0b" "1a09" "09000000000000e03f"
)  # fmt: skip
NUMBERS = st.floats(-1e6, 1e6)
SIX = st.lists(NUMBERS, max_size=6)


def _python(data: bytes) -> egm.EgmRobot | None:
    try:
        return egm.decode_robot(data)
    except WireError:
        return None


def _example() -> egm.EgmRobot:
    pose = egm.EgmPose([1.0, -2.0, 3.0], [10.5, 20.25, -30.0], [1.0, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0], [5.0, 6.0, 7.0])
    pose.has_position = pose.has_quaternion = pose.has_euler = True
    return egm.EgmRobot(70000, 123456, 2, pose, egm.EgmPose([4.0, 5.0, 6.0], [1.0]), 1, 3, 2, True)


def test_bytes_by_hand_are_read(runtime: ctypes.CDLL) -> None:
    expected = egm.EgmRobot(300, 70000, 2, egm.EgmPose([1.5, -2.0], [1000.25]), mci_state=3)
    assert egm.decode_robot(BY_HAND) == expected
    assert decode_egm(runtime, BY_HAND) == expected


def test_the_answer_is_the_bytes_by_hand(runtime: ctypes.CDLL) -> None:
    sensor = egm.EgmSensor(300, 70000, external_mm=[1000.25], external_speeds_mm_s=[0.5])
    assert egm.encode_sensor(sensor) == SENSOR_BY_HAND
    assert encode_egm(runtime, sensor) == SENSOR_BY_HAND
    assert egm.decode_sensor(SENSOR_BY_HAND) == sensor


@pytest.mark.parametrize("packed", [False, True])
def test_packed_and_unpacked_are_the_same(runtime: ctypes.CDLL, packed: bool) -> None:
    robot = _example()
    data = egm.encode_robot(robot, packed=packed)
    assert egm.decode_robot(data) == robot
    assert decode_egm(runtime, data) == robot


def test_unknown_fields_of_every_wire_type_are_skipped(runtime: ctypes.CDLL) -> None:
    unknown = bytes.fromhex("f80101f9010102030405060708fa0103aabbccfd0101020304")
    data = unknown + BY_HAND + unknown
    assert egm.decode_robot(data) == egm.decode_robot(BY_HAND) == decode_egm(runtime, data)


@pytest.mark.parametrize(
    ("what", "data"),
    [
        ("nothing", b""),
        ("no header", BY_HAND[11:]),
        ("a number that is not finite", egm.encode_robot(egm.EgmRobot(1, 2, feedback=egm.EgmPose([float("nan")])))),
        ("a group", BY_HAND + bytes.fromhex("0b0c")),
        ("field number zero", BY_HAND + bytes.fromhex("0001")),
        ("a varint of eleven bytes", BY_HAND + b"\x30" + b"\xff" * 10 + b"\x01"),
        ("a length beyond the end", BY_HAND + bytes.fromhex("3affffffff0f")),
        ("packed doubles that are cut", BY_HAND + bytes.fromhex("12060a040a0200") + b"\x01"),
        ("more than a datagram", BY_HAND * 40),
    ],
)
def test_bad_datagrams_are_refused(runtime: ctypes.CDLL, what: str, data: bytes) -> None:
    assert what != "more than a datagram" or len(data) > DATAGRAM_MAX
    assert _python(data) is None
    assert decode_egm(runtime, data) is None


def test_c_and_python_agree_on_spoilt_datagrams(runtime: ctypes.CDLL) -> None:
    alphabet = b"\x00\x01\x08\x09\x0a\x12\x1a\x7f\x80\xff"
    accepted = 0
    for data in spoilt(egm.encode_robot(_example()), 4000, 1, alphabet):
        found = _python(data)
        assert decode_egm(runtime, data) == found
        accepted += found is not None
    assert 400 < accepted < 3600, "both verdicts occur"


@settings(max_examples=60, deadline=None)
@given(
    joints=SIX,
    external=SIX,
    sequence=st.integers(0, 2**32 - 1),
    path=st.none() | st.lists(NUMBERS, min_size=3, max_size=3),
)
def test_c_writes_what_python_writes(
    runtime: ctypes.CDLL, joints: list[float], external: list[float], sequence: int, path: list[float] | None
) -> None:
    sensor = egm.EgmSensor(sequence, sequence // 3, joints_deg=joints, joint_speeds_deg_s=joints[::-1])
    sensor.external_mm, sensor.external_speeds_mm_s = external, external[::-1]
    if path is not None:
        sensor = egm.EgmSensor(sequence, 5, egm.TYPE_PATH_CORRECTION, path_mm=path, age_ms=sequence % 1000)
    data = egm.encode_sensor(sensor)
    assert encode_egm(runtime, sensor) == data
    assert egm.decode_sensor(data) == sensor


def test_a_buffer_that_is_too_small_gives_no_answer(runtime: ctypes.CDLL) -> None:
    correction = EgmPathCorrection(1, 2, (ctypes.c_double * 3)(1.0, 2.0, 3.0), 4)
    out = ctypes.create_string_buffer(64)
    lengths = [runtime.gt_egm_write_path_correction(ctypes.byref(correction), out, n) for n in range(64)]
    whole = len(egm.encode_sensor(egm.EgmSensor(1, 2, path_mm=[1.0, 2.0, 3.0], age_ms=4)))
    assert lengths == [0] * whole + [whole] * (64 - whole)
