"""KUKA RSI in Python, robot and sensor side: decimal numbers as the C runtime reads and writes them, and a scanner that
accepts the same telegrams as the C scanner."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from functools import lru_cache

from ..results.read_bounds import walk_xml
from .egm import DATAGRAM_MAX

DIGITS_MOST = 18
POWER_MOST = 22
WRITE_LIMIT = 1e9
SCALE = 1_000_000
_NUMBER = re.compile(rb"[+-]?(?P<whole>[0-9]*)(?:\.(?P<part>[0-9]*))?(?:[eE](?P<exponent>[+-]?[0-9]{1,3}))?")
_DIGITS = re.compile(rb"[0-9]{1,19}")


@lru_cache(maxsize=4096)  # most numbers of a telegram do not change
def read_decimal(text: bytes) -> float | None:
    """Read [+-]digits[.digits][e[+-]digits]; None for anything else. gt_decimal.h says which digits are cut off."""
    match = _NUMBER.fullmatch(text)
    if match is None or not (match["whole"] or match["part"]):
        return None
    whole, part = match["whole"].lstrip(b"0"), match["part"] or b""
    if len(whole) > DIGITS_MOST:
        return None
    zeros = 0 if whole else len(part) - len(part.lstrip(b"0"))
    part = part[: DIGITS_MOST - len(whole) + zeros]
    mantissa, power = int(whole + part or b"0"), int(match["exponent"] or 0) - len(part)
    if abs(power) > POWER_MOST:
        return None
    scale = float(10 ** abs(power))
    value = float(mantissa) / scale if power < 0 else float(mantissa) * scale
    return -value if text[:1] == b"-" else value


def read_digits(text: bytes) -> int | None:
    """Read one to nineteen digits as an integer; None for anything else."""
    return int(text) if _DIGITS.fullmatch(text) else None


def write_decimal(value: float) -> bytes:
    """Write six digits after the point, magnitude rounded half up. Raises ValueError unless |value| < 1e9."""
    if not abs(value) < WRITE_LIMIT:
        raise ValueError(f"{value} cannot be sent: expected a number below 1e9")
    scaled = math.floor(abs(value) * SCALE + 0.5)
    sign = b"-" if value < 0 and scaled > 0 else b""
    return sign + b"%d.%06d" % divmod(scaled, SCALE)


_SPACES = re.compile(rb"[ \t\r\n]*")
_WORD = re.compile(rb"[A-Za-z0-9_]*")
COMMENT = re.compile(rb"--(?:[^-]|-(?!-))*-->")  # after "<!"; two hyphens end it
_CARTESIAN = (b"X", b"Y", b"Z", b"A", b"B", b"C")
_JOINTS = tuple(b"A%d" % n for n in range(1, 7))
_EXTERNAL = tuple(b"E%d" % n for n in range(1, 7))
_UINT32 = (1 << 32) - 1
ELEMENTS = {
    "RIst": _CARTESIAN,
    "RSol": _CARTESIAN,
    "AIPos": _JOINTS,
    "ASPos": _JOINTS,
    "EIPos": _EXTERNAL,
    "ESPos": _EXTERNAL,
}


class TelegramError(ValueError):
    """The bytes are not a telegram of a controller."""


@dataclass
class RsiRobot:
    """A controller's telegram: six numbers by element name, count of late answers, time stamp [ms] and its digits.

    `given`: by element, bit n is set if number n was sent; the other numbers are zero.
    """

    ipoc: int = 0
    stamp: bytes = b""
    delay: int = 0
    values: dict[str, list[float]] = field(default_factory=dict)
    given: dict[str, int] = field(default_factory=dict)


@dataclass
class RsiSensor:
    """The answer: corrections in mm and degrees, and the stamp of the telegram."""

    stamp: bytes = b""
    ak_deg: list[float] = field(default_factory=lambda: [0.0] * 6)
    ek_mm: list[float] = field(default_factory=lambda: [0.0] * 6)
    rkorr: list[float] = field(default_factory=lambda: [0.0] * 6)


def encode_robot(robot: RsiRobot) -> bytes:
    """Return a telegram as a controller sends it."""
    out = b'<Rob TYPE="KUKA">'
    for name, values in robot.values.items():
        out += _element(name.encode(), ELEMENTS[name], values)
    stamp = robot.stamp or b"%d" % robot.ipoc
    return out + b'<Delay D="%d"/><IPOC>%s</IPOC></Rob>' % (robot.delay, stamp)


def encode_sensor(sensor: RsiSensor) -> bytes:
    """Return the answer, byte for byte like the C writer. Raises ValueError if a number cannot be sent."""
    out = b'<Sen Type="ImFree">' + _element(b"AK", _JOINTS, sensor.ak_deg) + _element(b"EK", _EXTERNAL, sensor.ek_mm)
    out += _element(b"RKorr", _CARTESIAN, sensor.rkorr)
    return out + b"<IPOC>" + sensor.stamp + b"</IPOC></Sen>"


def decode_sensor(data: bytes) -> RsiSensor:
    """Decode the answer as a controller does, with the standard library's parser. Raises TelegramError."""
    from xml.etree import ElementTree

    try:
        walk_xml(data)
        root = ElementTree.fromstring(data)
        places = (("AK", _JOINTS), ("EK", _EXTERNAL), ("RKorr", _CARTESIAN))
        corrections = {name: _six(root.find(name), names) for name, names in places}
        stamp = (root.findtext("IPOC") or "").encode()
    except (ElementTree.ParseError, ValueError) as error:
        raise TelegramError(f"the answer cannot be read: {error}") from error
    if root.tag != "Sen" or not stamp:
        raise TelegramError("the answer has no IPOC")
    return RsiSensor(stamp, corrections["AK"], corrections["EK"], corrections["RKorr"])


def decode_robot(data: bytes) -> RsiRobot:
    """Decode a controller's telegram as gt_rsi.c does. Raises TelegramError."""
    if len(data) > DATAGRAM_MAX:
        raise TelegramError("the telegram is too long")
    return _Scanner(data).robot()


class _Scanner:
    def __init__(self, data: bytes) -> None:
        self.data = data
        self.offset = 0
        self.read: set[str] = set()

    def robot(self) -> RsiRobot:
        robot, depth = RsiRobot(), 0  # open elements, <Rob> is the first
        while self.offset < len(self.data):
            self._spaces() if depth == 0 else self._to(b"<")
            self._need(b"<")
            if self._skip(b"/"):
                name = self._end()
                depth -= 1
                if depth < 0 or (name == b"Rob") != (depth == 0):
                    raise TelegramError("an end tag has no matching start tag")
                if depth == 0:
                    self._blank()
                    if self.offset < len(self.data):
                        raise TelegramError("the telegram continues after </Rob>")
                    if not robot.stamp:
                        break
                    return robot
            elif self._skip(b"?"):
                self._to(b">")
                self._need(b">")
            elif self._skip(b"!"):
                self._comment()
            else:
                depth += self._open(robot, depth)
        raise TelegramError("the telegram is not complete")

    def _open(self, robot: RsiRobot, depth: int) -> int:
        """Read one element inside `depth` others; return 1 if it stays open, otherwise 0."""
        name = self._word()
        if not name or (name == b"Rob") != (depth == 0):
            raise TelegramError("an element has no name, or <Rob> is not the first and only one of its name")
        element = name.decode()
        if element in (*ELEMENTS, "Delay", "IPOC"):
            if depth != 1 or element in self.read:
                raise TelegramError(f"{element} appears twice or inside another element")
            self.read.add(element)
        empty = self._attributes(element, robot)
        if element != "IPOC":
            return 0 if empty else 1
        if empty:
            raise TelegramError("IPOC is not a number")
        self._ipoc(robot)
        return 0

    def _attributes(self, element: str, robot: RsiRobot) -> bool:
        """Read the attributes; return whether the element is empty, closed by "/>"."""
        names = ELEMENTS.get(element)
        values = robot.values.setdefault(element, [0.0] * 6) if names else []
        if names:
            robot.given.setdefault(element, 0)
        while True:
            self._spaces()
            empty = self._skip(b"/")
            if self._skip(b">"):
                return empty
            name = self._word()
            if empty or not name:
                raise TelegramError("an attribute has no name")
            text = self._quoted()
            if element == "Delay" and name == b"D":
                delay = read_digits(text)
                if delay is None:
                    raise TelegramError("the delay is not a number")
                robot.delay = min(delay, _UINT32)
            elif names and name in names:
                value, bit = read_decimal(text), 1 << names.index(name)
                if value is None or robot.given[element] & bit:
                    raise TelegramError(f"{element} contains a value that is not a number, or one number twice")
                values[names.index(name)] = value
                robot.given[element] |= bit

    def _quoted(self) -> bytes:
        """Read ="value" or ='value', with optional spaces around the sign."""
        self._spaces()
        self._need(b"=")
        self._spaces()
        quote = b'"' if self._skip(b'"') else b"'"
        if quote == b"'":
            self._need(quote)
        begin = self.offset
        self._to(quote)
        self._need(quote)
        return self.data[begin : self.offset - 1]

    def _ipoc(self, robot: RsiRobot) -> None:
        self._blank()
        digits = self._word()
        self._blank()
        self._need(b"<")
        self._need(b"/")
        ipoc = read_digits(digits)
        if self._end() != b"IPOC" or ipoc is None:
            raise TelegramError("IPOC is not a number")
        robot.ipoc, robot.stamp = ipoc, digits

    def _end(self) -> bytes:
        """Read the rest of an end tag; return its name."""
        name = self._word()
        self._spaces()
        self._need(b">")
        return name

    def _blank(self) -> None:
        """Skip spaces and comments."""
        self._spaces()
        while self.data.startswith(b"<!", self.offset):
            self.offset += 2
            self._comment()
            self._spaces()

    def _comment(self) -> None:
        if not self._past(COMMENT):
            raise TelegramError("a comment is not closed")

    def _spaces(self) -> None:
        self._past(_SPACES)

    def _skip(self, byte: bytes) -> bool:
        matches = self.data[self.offset : self.offset + 1] == byte
        self.offset += matches
        return matches

    def _need(self, byte: bytes) -> None:
        if not self._skip(byte):
            raise TelegramError(f"'{byte.decode()}' is missing")

    def _to(self, byte: bytes) -> None:
        end = self.data.find(byte, self.offset)
        self.offset = len(self.data) if end < 0 else end

    def _word(self) -> bytes:
        return self._past(_WORD)

    def _past(self, pattern: re.Pattern[bytes]) -> bytes:
        """Return the part of the pattern that matches here, possibly empty."""
        match = pattern.match(self.data, self.offset)
        self.offset = self.offset if match is None else match.end()
        return b"" if match is None else match[0]


def _element(name: bytes, attributes: tuple[bytes, ...], values: list[float]) -> bytes:
    pairs = zip(attributes, values, strict=True)
    return b"<%s %s/>" % (name, b" ".join(b'%s="%s"' % (a, write_decimal(v)) for a, v in pairs))


def _six(element: object, names: tuple[bytes, ...]) -> list[float]:
    get = getattr(element, "get", lambda name, default: default)
    return [float(get(name.decode(), "0")) for name in names]
