"""Decimal numbers in text as the C runtime reads and writes them, rounding included."""

from __future__ import annotations

import math
import re
from functools import lru_cache

DIGITS_MOST = 18
POWER_MOST = 22
WRITE_LIMIT = 1e9
SCALE = 1_000_000
_NUMBER = re.compile(rb"[+-]?(?P<whole>[0-9]*)(?:\.(?P<part>[0-9]*))?(?:[eE](?P<exponent>[+-]?[0-9]{1,3}))?")
_DIGITS = re.compile(rb"[0-9]{1,19}")


@lru_cache(maxsize=4096)  # most numbers of a telegram stand still
def read_decimal(text: bytes) -> float | None:
    """[+-]digits[.digits][e[+-]digits] as a number, None for anything else; see gt_decimal.h for what is cut."""
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
    """One to nineteen digits as a number, None for anything else."""
    return int(text) if _DIGITS.fullmatch(text) else None


def write_decimal(value: float) -> bytes:
    """Six digits after the point, rounded half up in magnitude. Raises ValueError unless |value| < 1e9."""
    if not abs(value) < WRITE_LIMIT:
        raise ValueError(f"{value} cannot be sent: expected a number below 1e9")
    scaled = math.floor(abs(value) * SCALE + 0.5)
    sign = b"-" if value < 0 and scaled > 0 else b""
    return sign + b"%d.%06d" % divmod(scaled, SCALE)
