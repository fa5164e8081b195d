"""Checks: a number with its bound and verdict, and the message about failed checks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from .quantity import split

_DIGITS, _ALL = 6, 17  # digits of a number in a message; digits that distinguish any two numbers


@dataclass(frozen=True)
class Check:
    """A tested number with its verdict. If a check fails, the whole result must not be used.

    A number that is only reported is not a check but a value.

    Args:
        value: the number.
        bound: largest allowed value, or smallest if `least` is set; None without a bound.
        advice: what to do if the check fails, such as "use a smaller tolerance".
        least: True if the bound is a lower bound.
        judged: the verdict, if it is not the comparison with the bound.

    >>> gt.results.Check(0.2, bound=0.1, advice="refine the mesh").passed
    False
    """

    value: float
    bound: float | None = None
    advice: str = ""
    least: bool = False
    judged: bool | None = None

    @property
    def compares(self) -> bool:
        """True if the verdict is the comparison with the bound."""
        if self.bound is None or not math.isfinite(self.value):
            return self.bound is not None
        return self.passed == (self.value >= self.bound if self.least else self.value <= self.bound)

    @property
    def passed(self) -> bool:
        """The verdict; NaN fails."""
        if self.judged is not None:
            return self.judged
        if self.bound is None:
            return math.isfinite(self.value)
        return self.value >= self.bound if self.least else self.value <= self.bound


def at_most(value: float, bound: float, advice: str = "") -> Check:
    """Return the check value <= bound. NaN fails.

    >>> gt.results.at_most(2e-3, 1e-3, "refine the mesh").passed
    False
    """
    return Check(value, bound, advice)


def at_least(value: float, bound: float, advice: str = "") -> Check:
    """Return the check value >= bound. NaN fails.

    >>> gt.results.at_least(12, 10).passed
    True
    """
    return Check(value, bound, advice, least=True)


def failed_of(checks: Mapping[str, Check]) -> dict[str, Check]:
    """Return the failed checks, by name."""
    return {name: check for name, check in checks.items() if not check.passed}


def verdict(failed: Mapping[str, Check], count: int) -> str:
    """Return one sentence: the failed ones of `count` checks with value and bound, and what to do."""
    failures = ", ".join(f"{name} ({_numbers(name, check)})" for name, check in failed.items())
    text = f"{len(failed)} of {count} checks failed: {failures}"
    parts = (part for check in failed.values() if check.advice for part in check.advice.split("; "))
    advice = dict.fromkeys(parts)  # each once
    return "; ".join([text, *advice])


def _numbers(name: str, check: Check) -> str:
    _, unit = split(name)
    unit = f" {unit}" if unit else ""
    value = f"{check.value:.{_digits(check)}g}{unit}" if math.isfinite(check.value) else "no value"
    if not check.compares:
        return value
    return f"{value}, {bound_in_words(check)}{unit}"


def bound_in_words(check: Check) -> str:
    """Return "at most 0.005", with enough digits to distinguish the value from the bound."""
    word = "at least" if check.least else "at most"
    return f"{word} {check.bound:.{_digits(check)}g}"


def _digits(check: Check) -> int:
    """Six, or enough to distinguish a value from a bound that it just misses."""
    if check.bound is None or not math.isfinite(check.value) or check.value == check.bound:
        return _DIGITS
    alike = (n for n in range(_DIGITS, _ALL) if f"{check.value:.{n}g}" != f"{check.bound:.{n}g}")
    return next(alike, _ALL)
