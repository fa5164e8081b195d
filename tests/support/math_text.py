"""Numbers beside axes, as pictures of all tests have them, are set once: matplotlib would parse each "$1.0$" anew in
each picture, for a quarter of the time of drawing."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

KEPT = 20_000


def keep_parsed() -> None:
    """Parsed formulas are kept beyond their picture; nothing where another version of matplotlib does it otherwise."""
    from matplotlib.mathtext import MathTextParser

    parse = getattr(MathTextParser, "_parse_cached", None)
    if not hasattr(parse, "__wrapped__"):
        return
    parsers: dict[str, Any] = {}

    @lru_cache(KEPT)
    def parsed(kind: str, *key: Any) -> Any:
        return parse.__wrapped__(parsers[kind], *key)

    def cached(self: Any, *key: Any) -> Any:
        parsers.setdefault(self._output_type, self)
        return parsed(self._output_type, *key)

    MathTextParser._parse_cached = cached
