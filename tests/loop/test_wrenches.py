"""The two wrenches of a datagram: C and Python agree on any bytes; nothing else of a datagram changes."""

from __future__ import annotations

import ctypes
import math
from ctypes import Structure, c_double, c_uint32

import pytest

from gtmodel.loop import Exchange, Wrench, egm, rsi
from gtmodel.loop.egm import double_field, message_field, varint_field
from gtmodel.loop.wrenches import EGM_HANDLE, read_egm, read_rsi, to_egm, to_rsi
from tests.loop import c_codecs
from tests.loop.spoiling import spoilt
from tests.loop.test_rsi import TELEGRAM

HANDLE = Wrench([1.5, -2.25, 0.5], [0.125, 0.0, -0.0625], 3, 0)
TOOL = Wrench([-1e-3, 7.0, 1e8], [0.0, -1.0, 2.5], 0, 5)
ROBOT = egm.EgmRobot(sequence=7, time_ms=28, feedback=egm.EgmPose(external_mm=[1.0, 2.0, 3.0]), mci_state=3)
UINT32 = (1 << 32) - 1


class _Wrench(Structure):
    _fields_ = (("force", c_double * 3), ("moment", c_double * 3), ("age", c_uint32), ("status", c_uint32))


def _in_c(library: ctypes.CDLL, protocol: str, data: bytes) -> tuple[Wrench, Wrench] | None:
    both = _Wrench(), _Wrench()
    read = getattr(library, f"gt_{protocol}_read_wrenches")
    good = read(data, c_uint32(len(data)), ctypes.byref(both[0]), ctypes.byref(both[1]))
    handle, tool = (Wrench(list(w.force), list(w.moment), w.age, w.status) for w in both)
    assert good or (handle, tool) == (Wrench(), Wrench())
    return (handle, tool) if good else None


def _same(a: tuple[Wrench, Wrench] | None, b: tuple[Wrench, Wrench] | None) -> bool:
    return repr(a) == repr(b)  # NaN too


def _datagram(protocol: str) -> bytes:
    return to_egm(egm.encode_robot(ROBOT), HANDLE, TOOL) if protocol == "egm" else to_rsi(TELEGRAM, HANDLE, TOOL)


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_what_is_sent_is_read(runtime: ctypes.CDLL, protocol: str) -> None:
    data = _datagram(protocol)
    read = read_egm(data) if protocol == "egm" else read_rsi(data)
    assert read is not None and _same(read, _in_c(runtime, protocol, data))
    for sent, came in zip((HANDLE, TOOL), read, strict=True):
        assert came.force_N == pytest.approx(sent.force_N, abs=5e-7), "RSI rounds to 1e-6"
        assert came.moment_N_m == pytest.approx(sent.moment_N_m, abs=5e-7)
        assert (came.age_cycles, came.status) == (sent.age_cycles, sent.status)


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_the_rest_of_a_datagram_is_read_as_before(runtime: ctypes.CDLL, protocol: str) -> None:
    """A law that reads no wrenches is told of none, and everything else is what it would be without them."""
    bare = egm.encode_robot(ROBOT) if protocol == "egm" else TELEGRAM
    data, exchange = _datagram(protocol), Exchange("egm" if protocol == "egm" else "rsi", 3)
    assert exchange.read(data) == exchange.read(bare)
    if protocol == "egm":
        assert c_codecs.decode_egm(runtime, data) == c_codecs.decode_egm(runtime, bare) == egm.decode_robot(bare)
    else:
        assert c_codecs.decode_rsi(runtime, data) == c_codecs.decode_rsi(runtime, bare) == rsi.decode_robot(bare)
    exchange.reads_wrenches = True
    feedback, without = exchange.read(data), exchange.read(bare)
    assert feedback is not None and feedback.wrenches is not None
    assert without is not None and without.wrenches is None


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_c_and_python_agree_on_spoilt_datagrams(runtime: ctypes.CDLL, protocol: str) -> None:
    data, read = _datagram(protocol), {True: 0, False: 0}
    alphabet = (
        b"\x00\xff\x09\x11\x12\x18\xa2\x06\xaa" if protocol == "egm" else b"0123456789<>\"'/ =.FtHandleToolAgeXYZM?"
    )
    for variant in spoilt(data, 6000, 3, alphabet):
        try:
            (egm.decode_robot if protocol == "egm" else rsi.decode_robot)(variant)
        except ValueError:
            _in_c(runtime, protocol, variant)  # must only not fall
            continue
        both = read_egm(variant) if protocol == "egm" else read_rsi(variant)
        assert _same(both, _in_c(runtime, protocol, variant)), variant
        read[both is None] += 1
    assert min(read.values()) > 20


NUMBERS = b"".join(double_field(1, 1.0) for _ in range(3)), b"".join(double_field(2, 1.0) for _ in range(3))
AGE = varint_field(3, 1)


@pytest.mark.parametrize(
    ("content", "age"),
    [
        (NUMBERS[0] + NUMBERS[1] + AGE, 1),
        (NUMBERS[0] + NUMBERS[1] + varint_field(3, 1 << 32), UINT32),  # it must not wrap to a young one
        (NUMBERS[0] + NUMBERS[1] + varint_field(3, (1 << 64) - 1), UINT32),
        (NUMBERS[0] + NUMBERS[1], None),
        (NUMBERS[0] + NUMBERS[1] + AGE + AGE, None),
        (NUMBERS[0] + AGE, None),
        (NUMBERS[0] + double_field(1, 1.0) + NUMBERS[1] + AGE, None),
        (message_field(1, b"\x00" * 24) + message_field(2, b"\x00" * 24) + AGE, 1),
        (message_field(1, b"\x00" * 23) + NUMBERS[1] + AGE, None),
        (double_field(1, math.nan) + double_field(1, math.inf) + double_field(1, 5e-324) + NUMBERS[1] + AGE, 1),
    ],
)
def test_a_wrench_is_whole_or_is_not_there(runtime: ctypes.CDLL, content: bytes, age: int | None) -> None:
    good = to_egm(egm.encode_robot(ROBOT), HANDLE, TOOL)
    only_tool = good.replace(good[len(egm.encode_robot(ROBOT)) : -len(_message(TOOL))], b"")
    data = only_tool + message_field(EGM_HANDLE, content)
    both = read_egm(data)
    assert _same(both, _in_c(runtime, "egm", data))
    assert (both[0].age_cycles if both else None) == age
    assert read_egm(data + message_field(EGM_HANDLE, content)) is None, "twice"
    assert _in_c(runtime, "egm", data + message_field(EGM_HANDLE, content)) is None


def _message(wrench: Wrench) -> bytes:
    return to_egm(b"", wrench, wrench)[: len(to_egm(b"", wrench, wrench)) // 2]


@pytest.mark.parametrize(
    ("old", "new", "age"),
    [
        (b'Age="3"', b'Age="4294967296"', UINT32),
        (b'Age="3"', b'Age="99999999999999999999"', None),
        (b'Age="3"', b'Age="-1"', None),
        (b'Age="3" ', b"", None),
        (b'FX="1.500000"', b'FX="NaN"', None),
        (b'FX="1.500000"', b'FX="1" FX="1"', None),
        (b' State="0"', b"", 3),
        (b"<FtHandle", b"<In><FtHandle", None),
        (b"<FtHandle", b"<FtTool A='1'/><FtHandle", 3),
        (b"<FtHandle", b"<!-- <FtHandle FX='9' Age='1'/> <In> --><FtHandle", 3),
    ],
)
def test_a_wrench_of_a_telegram_stands_once_in_rob(
    runtime: ctypes.CDLL, old: bytes, new: bytes, age: int | None
) -> None:
    data = to_rsi(TELEGRAM, HANDLE, TOOL)
    assert old in data
    data = data.replace(old, new, 1)
    if new.startswith(b"<In>"):
        data = data.replace(b"<IPOC>", b"</In><IPOC>")
    rsi.decode_robot(data)  # the telegram itself is good
    both = read_rsi(data)
    assert _same(both, _in_c(runtime, "rsi", data))
    assert (both[0].age_cycles if both else None) == age
