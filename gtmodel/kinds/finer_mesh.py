"""When a motion fails a check that a finer mesh can mend: how fine, and how it is told."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

# forces that jump leave errors that fall as the square of the elements' length, smooth ones faster
ORDER = 2
SPARE = 1.2  # beyond what that order asks for
LEAST, MOST = 1.5, 4.0  # times as many elements at once
PASSES = 4


def elements_after(elements: int, most: int, checks: Mapping[str, Any], mended: Iterable[str]) -> int | None:
    """So many elements instead, at most `most`, where one of the checks named in `mended` failed; else None."""
    failed = [checks[name] for name in mended if name in checks and not checks[name].passed]
    if not failed or elements >= most:
        return None
    missed = max(MOST**ORDER if c.value is None or not c.bound else c.value / c.bound for c in failed)
    factor = min(max(SPARE * max(missed, 1.0) ** (1 / ORDER), LEAST), MOST)
    return min(int(elements * factor) + 1, most)


def told(given: int, used: int, failed: Iterable[str]) -> str:
    """What the message adds where the mesh was refined: which checks failed on the given one."""
    if used == given:
        return ""
    return f" on {used} elements: on the given {given} {' and '.join(failed)} failed"
