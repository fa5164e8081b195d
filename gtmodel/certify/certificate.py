"""The result of a certificate."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from ..results import Options, Quantity, Row, Study, Unit, Within, listed

PROVED, REFUTED, UNDECIDED = 1, -1, 0
WORDS = {PROVED: "proved", REFUTED: "refuted", UNDECIDED: "undecided"}
_SHOWN = 12  # rows of the table for single outputs


@dataclass(frozen=True)
class InputSpeed(Options):
    """Inputs that move between two calls of code with Newton's method, which starts at the last answer.

    >>> gt.certify.InputSpeed(speed={"T": 1.0}, period=0.004)
    InputSpeed(speed={'T': 1.0}, period=0.004)
    """

    speed: Annotated[dict[str, float], "largest speed of every number of an input, by name [its unit/s]"]
    period: Annotated[float, Unit("s"), Within(above=0.0), "time between two calls"] = 0.004


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BoxCertificate(Study):
    """What holds at every point of a box. All bounds hold in the proved boxes; that is everywhere if `proved` is 1."""

    proved: Annotated[float, Quantity("", "share of the volume in which all claims are proved")]
    refuted: Annotated[float, Quantity("", "share of the volume in which a claim is wrong at every point")]
    undecided: Annotated[float, Quantity("", "share of the volume that stays undecided")]
    boxes: Annotated[int, Quantity("", "examined boxes")]
    claims: Annotated[Mapping[str, str], "verdict of each claim: proved, refuted or undecided, and where"]
    counter_examples: Annotated[Sequence[Mapping[str, Any]], "points that violate a claim, found by evaluation"]
    errors: Annotated[Mapping[str, float | None], "round-off of each output in double, at most [SI]; null if unbounded"]
    float_errors: Annotated[Mapping[str, float | None], "the same for code in float"]
    ranges: Annotated[Mapping[str, Sequence[float] | None], "interval that contains each output [SI]"]
    least_singular_value: Annotated[
        float | None, "lower bound of the smallest singular value of the Jacobian [SI]; null if not asked for"
    ]
    steps: Annotated[
        int | None, "steps of Newton's method until round-off, at most; null for closed forms and without a motion"
    ]
    scale: Annotated[float | None, "size of the proved box relative to the given one; null if it was not to shrink"]
    box: Annotated[Mapping[str, Sequence[float]], "least and greatest value of each input [SI]"]
    cuts: Annotated[str, "how the box was halved, from which a stopped proof continues"]
    real: Annotated[str, "number type of the code whose status is proved"]
    assumptions: Annotated[Sequence[str], "what the proof assumes, in sentences"]

    @property
    def rows(self) -> list[Row]:
        """The printed table."""
        rows = [
            Row("proved", math.floor(1e6 * self.proved) / 1e4, "%"),  # 100 only if all is proved
            Row("refuted", 100 * self.refuted, "%"),
            Row("undecided", 100 * self.undecided, "%"),
            Row("boxes examined", self.boxes),
            *([] if self.scale is None else [Row("size relative to the given box", self.scale)]),
            *([] if self.scale is None else [Row(f"  {n}, from and to", listed(x), "SI") for n, x in self.box.items()]),
            *[Row(name, word) for name, word in self.claims.items()],
        ]
        if self.least_singular_value is not None:
            rows.append(Row("smallest singular value of the Jacobian, at least", self.least_singular_value, "SI"))
        if self.steps is not None:
            rows.append(Row("steps of Newton's method, at most", self.steps))
        for name in list(self.errors)[:_SHOWN]:
            error, single, range_ = self.errors[name], self.float_errors[name], self.ranges[name]
            if range_ is not None:
                rows.append(Row(f"{name}, from and to", listed(range_), "SI"))
            if error is not None:
                word = "" if single is None else f"; in float {_above(single)}"
                rows.append(Row(f"round-off of {name}, at most", f"{_above(error)}{word}", "SI"))
        return rows + [Row("assumed", sentence) for sentence in self.assumptions]


def _above(bound: float) -> str:
    """Return three digits of a bound, not rounded below it."""
    return f"{1.0051 * bound:.3g}"
