"""The colours and styles of curves and links."""

from __future__ import annotations

from typing import Any

# readable with colour-blind eyes (Okabe and Ito), dark ones first
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#f0e442")
STYLES = ("-", "--", ":", "-.")


def colour(k: int) -> str:
    """The colour of curve k, from 0; more curves than colours begin again."""
    return COLOURS[k % len(COLOURS)]


def curve(k: int) -> dict[str, Any]:
    """Colour and style of curve k, from 0, of many: 32 that are all different."""
    return dict(color=colour(k), linestyle=STYLES[k // len(COLOURS) % len(STYLES)])
