"""The C codecs through ctypes: structs as in gt_egm.h, gt_rsi.h, gt_sequence.h and gt_traj.h."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, Structure, c_double, c_int, c_uint8, c_uint32, c_uint64

from gtmodel.loop import egm, rsi
from gtmodel.loop.egm import DATAGRAM_MAX


class EgmPose(Structure):
    _fields_ = (
        ("joint_count", c_uint32),
        ("joints_deg", c_double * 6),
        ("external_count", c_uint32),
        ("external_mm", c_double * 6),
        ("has_position", c_int),
        ("position_mm", c_double * 3),
        ("has_quaternion", c_int),
        ("quaternion", c_double * 4),
        ("has_euler", c_int),
        ("euler_deg", c_double * 3),
    )

    def to_python(self) -> egm.EgmPose:
        return egm.EgmPose(
            joints_deg=list(self.joints_deg[: self.joint_count]),
            external_mm=list(self.external_mm[: self.external_count]),
            position_mm=list(self.position_mm),
            quaternion=list(self.quaternion),
            euler_deg=list(self.euler_deg),
            has_position=bool(self.has_position),
            has_quaternion=bool(self.has_quaternion),
            has_euler=bool(self.has_euler),
        )


class EgmRobot(Structure):
    _fields_ = (
        *[(name, c_uint32) for name in ("sequence", "time_ms", "type", "motor_state", "mci_state", "rapid_state")],
        ("convergence_met", c_int),
        ("feedback", EgmPose),
        ("planned", EgmPose),
    )


class EgmSensor(Structure):
    _fields_ = (
        ("sequence", c_uint32),
        ("time_ms", c_uint32),
        ("joint_count", c_uint32),
        ("joints_deg", c_double * 6),
        ("joint_speeds_deg_s", c_double * 6),
        ("external_count", c_uint32),
        ("external_mm", c_double * 6),
        ("external_speeds_mm_s", c_double * 6),
    )


class EgmPathCorrection(Structure):
    _fields_ = (("sequence", c_uint32), ("time_ms", c_uint32), ("position_mm", c_double * 3), ("age_ms", c_uint32))


SIX = ("rist", "rsol", "aipos_deg", "aspos_deg", "eipos_mm", "espos_mm")


class RsiRobot(Structure):
    _fields_ = (
        ("present", c_uint32),
        ("given", c_uint32 * 6),
        *[(name, c_double * 6) for name in SIX],
        ("delay", c_uint32),
        ("ipoc", c_uint64),
        ("ipoc_length", c_uint32),
        ("ipoc_text", c_uint8 * 20),
    )


class RsiSensor(Structure):
    _fields_ = (
        ("ak_deg", c_double * 6),
        ("ek_mm", c_double * 6),
        ("rkorr", c_double * 6),
        ("ipoc_length", c_uint32),
        ("ipoc_text", c_uint8 * 20),
    )


class Sequence(Structure):
    _fields_ = (
        ("started", c_int),
        *[(name, c_uint64) for name in ("first", "newest", "seen", "lost", "repeated", "reordered", "stale")],
    )


class Traj(Structure):
    _fields_ = (("rows", POINTER(c_double)), ("count", c_uint32), ("columns", c_uint32), ("step_ms", c_uint32))


class Log(Structure):
    _fields_ = (
        ("records", POINTER(c_double)),
        *[(name, c_uint32) for name in ("capacity", "columns", "put", "taken")],
        ("dropped", c_uint64),
    )


def decode_egm(library: ctypes.CDLL, data: bytes) -> egm.EgmRobot | None:
    """EgmRobot as C reads it; None where it refuses."""
    robot = EgmRobot()
    if not library.gt_egm_read_robot(data, c_uint32(len(data)), ctypes.byref(robot)):
        return None
    return egm.EgmRobot(
        robot.sequence, robot.time_ms, robot.type, robot.feedback.to_python(), robot.planned.to_python(),
        robot.motor_state, robot.mci_state, robot.rapid_state, bool(robot.convergence_met),
    )  # fmt: skip


def encode_egm(library: ctypes.CDLL, sensor: egm.EgmSensor) -> bytes:
    """EgmSensor or EgmSensorPathCorr as C writes it."""
    out = ctypes.create_string_buffer(DATAGRAM_MAX)
    if sensor.path_mm is not None:
        c = EgmPathCorrection(sensor.sequence, sensor.time_ms, (c_double * 3)(*sensor.path_mm), sensor.age_ms)
        n = library.gt_egm_write_path_correction(ctypes.byref(c), out, c_uint32(DATAGRAM_MAX))
    else:
        six = [(c_double * 6)(*x) for x in (sensor.joints_deg, sensor.joint_speeds_deg_s)]
        more = [(c_double * 6)(*x) for x in (sensor.external_mm, sensor.external_speeds_mm_s)]
        counts = len(sensor.joints_deg), len(sensor.external_mm)
        s = EgmSensor(sensor.sequence, sensor.time_ms, counts[0], *six, counts[1], *more)
        n = library.gt_egm_write_sensor(ctypes.byref(s), out, c_uint32(DATAGRAM_MAX))
    return out.raw[:n]


def decode_rsi(library: ctypes.CDLL, data: bytes) -> rsi.RsiRobot | None:
    """A controller's telegram as C reads it; None where it refuses."""
    robot = RsiRobot()
    if not library.gt_rsi_read_robot(data, c_uint32(len(data)), ctypes.byref(robot)):
        return None
    names = [name for n, name in enumerate(rsi.ELEMENTS) if robot.present >> n & 1]
    values = {name: list(getattr(robot, SIX[list(rsi.ELEMENTS).index(name)])) for name in names}
    given = {name: robot.given[list(rsi.ELEMENTS).index(name)] for name in names}
    return rsi.RsiRobot(robot.ipoc, bytes(robot.ipoc_text[: robot.ipoc_length]), robot.delay, values, given)


def encode_rsi(library: ctypes.CDLL, sensor: rsi.RsiSensor) -> bytes:
    """The answer as C writes it; empty where it refuses."""
    text = (c_uint8 * 20)(*sensor.stamp)
    six = [(c_double * 6)(*x) for x in (sensor.ak_deg, sensor.ek_mm, sensor.rkorr)]
    out = ctypes.create_string_buffer(DATAGRAM_MAX)
    n = library.gt_rsi_write_sensor(ctypes.byref(RsiSensor(*six, len(sensor.stamp), text)), out, c_uint32(DATAGRAM_MAX))
    return out.raw[:n]


def read_decimal(library: ctypes.CDLL, text: bytes) -> float | None:
    """A decimal number as C reads it; None where it refuses."""
    value = c_double()
    good = library.gt_read_decimal(text, c_uint32(0), c_uint32(len(text)), ctypes.byref(value))
    return value.value if good else None
