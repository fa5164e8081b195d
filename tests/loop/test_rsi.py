"""RSI: a telegram as in the field, C and Python on good and bad ones, numbers in text, the configuration."""

from __future__ import annotations

import ctypes
from decimal import ROUND_HALF_UP, Decimal
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings, strategies as st

from gtmodel.loop import rsi, rsi_configuration
from gtmodel.loop.rsi import read_decimal as read_decimal_python, write_decimal
from tests.loop.c_codecs import decode_rsi, encode_rsi, read_decimal
from tests.loop.spoiling import spoilt

TELEGRAM = b"""<?xml version="1.0"?>
<Rob TYPE="KUKA">
<RIst X="1620.0008" Y="-0.5" Z="1e-3" A="-180.0000" B="0.0" C="+180.0"/>
<RSol X="1620.0" Y="0" Z="0" A="0" B="0" C="0" />
<AIPos A1="0.0" A2="-90.0" A3="90.0" A4="0.0" A5="90.0" A6="0.0"/>
<EIPos E1="-1303.68" E2="12.5" E3="0.0" E4="0" E5="0" E6="0"/>
<GearTorque A1="x"/><ProgStatus R="1"></ProgStatus><Delay D="3" />
<IPOC>00004208163634</IPOC>
</Rob>"""
NUMBERS = st.floats(-1e8, 1e8)
SIX = st.lists(NUMBERS, min_size=6, max_size=6)


def _python(data: bytes) -> rsi.RsiRobot | None:
    try:
        return rsi.decode_robot(data)
    except rsi.TelegramError:
        return None


def test_a_telegram_is_read(runtime: ctypes.CDLL) -> None:
    found = rsi.decode_robot(TELEGRAM)
    assert decode_rsi(runtime, TELEGRAM) == found
    assert (found.ipoc, found.stamp, found.delay) == (4208163634, b"00004208163634", 3)
    assert found.values["RIst"] == [1620.0008, -0.5, 1e-3, -180.0, 0.0, 180.0]
    assert found.values["EIPos"][:2] == [-1303.68, 12.5]
    assert "ASPos" not in found.values


def test_the_stamp_comes_back_to_the_letter(runtime: ctypes.CDLL) -> None:
    sensor = rsi.RsiSensor(rsi.decode_robot(TELEGRAM).stamp, ek_mm=[1.0, -2.5, 1e-7, 5e-7, -5e-7, 1234567.1234567])
    data = rsi.encode_sensor(sensor)
    assert encode_rsi(runtime, sensor) == data
    root = ElementTree.fromstring(data)
    assert root.findtext("IPOC") == "00004208163634"
    external = root.find("EK")
    assert external is not None
    assert external.attrib == {
        "E1": "1.000000", "E2": "-2.500000", "E3": "0.000000", "E4": "0.000001", "E5": "-0.000001",
        "E6": "1234567.123457",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("what", "old", "new"),
    [
        ("no IPOC", b"<IPOC>00004208163634</IPOC>", b""),
        ("a letter in IPOC", b"4208163634", b"42O8163634"),
        ("an IPOC of twenty digits", b"00004208163634", b"1" * 20),
        ("a number with a comma", b'E2="12.5"', b'E2="12,5"'),
        ("no number", b'E2="12.5"', b'E2=""'),
        ("not a number", b'E2="12.5"', b'E2="nan"'),
        ("two points", b'E2="12.5"', b'E2="1.2.5"'),
        ("a quote that is missing", b'E2="12.5"', b"E2=12.5"),
        ("an end that is missing", b"</Rob>", b""),
        ("another root", b"<Rob ", b"<Bob "),
        ("a delay that is no number", b'D="3"', b'D="-3"'),
        ("a number beyond all bounds", b'E2="12.5"', b'E2="1e400"'),
    ],
)
def test_bad_telegrams_are_refused(runtime: ctypes.CDLL, what: str, old: bytes, new: bytes) -> None:
    data = TELEGRAM.replace(old, new)
    assert data != TELEGRAM, what
    assert _python(data) is None
    assert decode_rsi(runtime, data) is None


IPOC = b"<IPOC>00004208163634</IPOC>"


@pytest.mark.parametrize(
    ("what", "old", "new"),
    [
        ("IPOC within another element", IPOC, b"<Tech>" + IPOC + b"</Tech>"),
        ("IPOC within an element of numbers", IPOC, b'<Tech><Deep A="1">' + IPOC + b"</Deep></Tech>"),
        ("a second IPOC", IPOC, IPOC + b"<IPOC>17</IPOC>"),
        ("a second IPOC within another element", IPOC, IPOC + b"<Tech><IPOC>17</IPOC></Tech>"),
        ("an element within IPOC", IPOC, b"<IPOC>00004208163634<A/></IPOC>"),
        ("an IPOC that ends at once", IPOC, b"<IPOC/>00004208163634<A/>"),
        ("an IPOC that another element ends", IPOC, b"<IPOC>00004208163634</IPO>"),
        ("axes within another element", b"<EIPos", b'<Tech><EIPos E1="9"/></Tech><EIPos'),
        ("axes twice", b"<EIPos", b'<EIPos E3="9"/><EIPos'),
        ("a number twice", b'E3="0.0"', b'E3="0.0" E3="9"'),
        ("text behind the end", b"</Rob>", b"</Rob>and more"),
        ("a second telegram behind the end", b"</Rob>", b"</Rob><Rob>" + IPOC + b"</Rob>"),
        ("an end behind the end", b"</Rob>", b"</Rob></Rob>"),
        ("a zero byte behind the end", b"</Rob>", b"</Rob>\x00"),
        ("text before the beginning", b"<Rob ", b"x<Rob "),
        ("Rob within Rob", b"<Delay", b"<Rob></Rob><Delay"),
        ("an element that is not closed", b"</ProgStatus>", b""),
        ("an end too many", b"</ProgStatus>", b"</ProgStatus></ProgStatus>"),
        ("a stroke before an attribute", b"<Delay D", b"<Delay /D"),
        ("a comment that does not end", b"<Delay", b"<!-- <Delay"),
        ("a comment with two hyphens", b"<Delay", b"<!-- a -- b --><Delay"),
        ("a comment that three hyphens end", b"<Delay", b"<!-- a ---><Delay"),
        ("a comment of one hyphen", b"<Delay", b"<!- a --><Delay"),
        ("a comment within the digits", b"4208163634", b"42<!-- -->08163634"),
        ("a comment behind the end that does not end", b"</Rob>", b"</Rob><!-- "),
        ("a declaration", b"<Delay", b"<!DOCTYPE Rob><Delay"),
        ("what only a comment holds", IPOC, b"<!--" + IPOC + b"-->"),
    ],
)
def test_telegrams_of_another_shape_are_refused(runtime: ctypes.CDLL, what: str, old: bytes, new: bytes) -> None:
    data = TELEGRAM.replace(old, new)
    assert data != TELEGRAM, what
    assert decode_rsi(runtime, data) is None
    assert _python(data) is None


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"</Rob>", b"</Rob>\r\n \t"),
        (b"</Rob>", b"</Rob >"),
        (IPOC, b"<IPOC> 00004208163634 </IPOC >"),
        (IPOC, b'<Tech C11="1"><A><B/></A>text</Tech>' + IPOC),
        (b"<?xml", b" <?xml"),
        (b"<Rob ", b"<!-- of the cell, <Rob> - not yet --><Rob "),
        (b"<EIPos", b'<!--<EIPos E1="9"/> </Rob> " > --><!-- --><EIPos'),
        (IPOC, b"<IPOC><!--was 3--> 00004208163634 <!----></IPOC>"),
        (b"</Rob>", b"<!-- - --></Rob> <!-- end -->\n<!---->"),
    ],
)
def test_telegrams_of_the_same_meaning_are_read(runtime: ctypes.CDLL, old: bytes, new: bytes) -> None:
    data = TELEGRAM.replace(old, new)
    assert data != TELEGRAM
    assert decode_rsi(runtime, data) == _python(data) == rsi.decode_robot(TELEGRAM)


def test_c_and_python_agree_on_spoilt_telegrams(runtime: ctypes.CDLL) -> None:
    accepted = 0
    for data in spoilt(TELEGRAM, 4000, 2, b"<>/=\"'?!. -+0123456789eERobIPOCAEX"):
        found = _python(data)
        assert decode_rsi(runtime, data) == found
        accepted += found is not None
    commented = TELEGRAM.replace(b"<EIPos", b"<!-- a - b --><EIPos").replace(b"</Rob>", b"</Rob><!---->")
    for data in spoilt(commented, 2000, 3, b"<>/=\"'?!. -+0123456789eERobIPOCAEX"):
        assert decode_rsi(runtime, data) == _python(data)
    assert 200 < accepted < 3800, "both verdicts occur"


@settings(max_examples=60, deadline=None)
@given(ak=SIX, ek=SIX, rkorr=SIX, stamp=st.from_regex(rb"[0-9]{1,19}", fullmatch=True))
def test_c_writes_what_python_writes(
    runtime: ctypes.CDLL, ak: list[float], ek: list[float], rkorr: list[float], stamp: bytes
) -> None:
    sensor = rsi.RsiSensor(stamp, ak, ek, rkorr)
    data = rsi.encode_sensor(sensor)
    assert encode_rsi(runtime, sensor) == data
    read = rsi.decode_sensor(data)
    # half of what is rounded away, and the reading of a number of fifteen digits
    assert read.stamp == stamp and all(abs(a - b) <= 0.6e-6 for a, b in zip(read.ek_mm, ek, strict=True))


def test_numbers_that_cannot_be_sent_give_no_answer(runtime: ctypes.CDLL) -> None:
    for bad in (float("nan"), float("inf"), 1e9, -1e9):
        assert encode_rsi(runtime, rsi.RsiSensor(b"1", ek_mm=[bad] + [0.0] * 5)) == b""
        with pytest.raises(ValueError, match="cannot be sent"):
            write_decimal(bad)


@given(text=st.from_regex(rb"[+-]?[0-9]{0,20}\.?[0-9]{0,20}([eE][+-]?[0-9]{0,4})?", fullmatch=True))
@settings(max_examples=150, deadline=None)
def test_decimals_are_read_alike(runtime: ctypes.CDLL, text: bytes) -> None:
    found = read_decimal_python(text)
    assert read_decimal(runtime, text) == found
    if found is not None:
        # cut after eighteen digits and rounded twice: two units in the last place of 53 bits
        assert found == pytest.approx(float(text), rel=4.5e-16, abs=0.0)


@given(value=st.decimals(-99999, 99999, places=6))
def test_decimals_of_a_controller_are_exact(value: Decimal) -> None:
    assert read_decimal_python(str(value).encode()) == float(value)


@given(value=st.floats(-1e8, 1e8))
def test_decimals_are_written_to_a_millionth(value: float) -> None:
    # v * 1e6 is rounded once before it is cut: beyond 2^53 millionths nothing is lost, below at most one in the last
    exact = Decimal(value).quantize(Decimal("0.000001"), ROUND_HALF_UP)
    assert abs(Decimal(write_decimal(value).decode()) - exact) <= Decimal("0.000001")


def test_the_configuration_holds_on_everywhere() -> None:
    root = ElementTree.fromstring(rsi_configuration("192.168.1.20", 49152))
    taken = root.findall("RECEIVE/ELEMENTS/ELEMENT")
    assert [e.get("INDX") for e in taken] == [str(n) for n in range(1, 19)]
    assert {e.get("HOLDON") for e in taken} == {"1"}
    assert {e.get("TAG") for e in taken} >= {"AK.A1", "EK.E1", "EK.E6", "RKorr.X"}
    config = {e.tag: e.text for e in root.findall("CONFIG/*")}
    assert config == {"IP_NUMBER": "192.168.1.20", "PORT": "49152", "SENTYPE": "ImFree", "ONLYSEND": "FALSE"}
    for address, port in (("robot", 1), ("1.2.3.4", 0), ("1.2.3.4", 65536)):
        with pytest.raises(ValueError, match="expected an IPv4 address"):
            rsi_configuration(address, port)
