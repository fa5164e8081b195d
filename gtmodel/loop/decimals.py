"""Decimal numbers in text as the C runtime reads and writes them, rounding included."""

from __future__ import annotations

import math
from functools import lru_cache

DIGITS_MOST = 18
POWER_MOST = 22
WRITE_LIMIT = 1e9
SCALE = 1_000_000
_DIGITS = frozenset(b"0123456789")


@lru_cache(maxsize=4096)  # most numbers of a telegram stand still
def read_decimal(text: bytes) -> float | None:
    """[+-]digits[.digits][e[+-]digits] as a number, None for anything else; see gt_decimal.h for what is cut."""
    at, negative = (1, text[:1] == b"-") if text[:1] in (b"+", b"-") else (0, False)
    seen = kept = mantissa = power = 0
    point = False
    while at < len(text) and (text[at] in _DIGITS or (text[at] == ord(".") and not point)):
        if text[at] == ord("."):
            point = True
        else:
            seen += 1
            if kept < DIGITS_MOST:
                mantissa = 10 * mantissa + text[at] - ord("0")
                kept += mantissa > 0
                power -= point
            elif not point:
                return None
        at += 1
    if seen == 0:
        return None
    if at < len(text) and text[at] in b"eE":
        exponent = _exponent(text[at + 1 :])
        if exponent is None:
            return None
        power += exponent
        at = len(text)
    if at != len(text) or abs(power) > POWER_MOST:
        return None
    scale = float(10 ** abs(power))
    value = float(mantissa) / scale if power < 0 else float(mantissa) * scale
    return -value if negative else value


def _exponent(text: bytes) -> int | None:
    digits = text[1:] if text[:1] in (b"+", b"-") else text
    if not 1 <= len(digits) <= 3 or not _DIGITS.issuperset(digits):
        return None
    return -int(digits) if text[:1] == b"-" else int(digits)


def read_digits(text: bytes) -> int | None:
    """One to nineteen digits as a number, None for anything else."""
    return int(text) if 1 <= len(text) <= 19 and _DIGITS.issuperset(text) else None


def write_decimal(value: float) -> bytes:
    """Six digits after the point, rounded half up in magnitude. Raises ValueError unless |value| < 1e9."""
    if not abs(value) < WRITE_LIMIT:
        raise ValueError(f"{value} cannot be sent: expected a number below 1e9")
    scaled = math.floor(abs(value) * SCALE + 0.5)
    sign = b"-" if value < 0 and scaled > 0 else b""
    return sign + b"%d.%06d" % divmod(scaled, SCALE)
