"""Constraints as rows low <= expression <= high, and rows that are bounds of one variable."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...compiler.flat import FlatModel
from ...lang.connect import flatten_items
from ...lang.expression import Relation
from ...lang.slips import each_of, line_of
from ...lang.source import ModelError, SourceLocation


@dataclass(eq=False)
class ConstraintRow:
    """One scalar constraint with its name and the line that wrote it; the solver sees it divided by `scale`.

    ends: whether it holds at the start and at the end of the horizon too, of one that holds along the path.
    """

    expression: ca.SX
    low: float
    high: float
    label: str
    where: SourceLocation | None
    scale: float = 1.0
    ends: tuple[bool, bool] = (True, True)


def relations(source: Iterable[Any] | None, flat: FlatModel) -> list[ConstraintRow]:
    """Rows of everything that constraints() yields. Raises ModelError for what is no relation."""
    written = line_of(getattr(type(flat.root), "constraints", None))
    if source is None:
        raise ModelError(
            f"constraints() of {flat.title} returned nothing; expected 'yield' in front of each relation", written
        )
    if not isinstance(source, Iterable):
        raise ModelError(
            f"constraints() of {flat.title} returned one {type(source).__name__}; expected 'yield' in front of each "
            "relation",
            written,
        )
    return relation_rows(source, f"{flat.title}.constraints()", written=written)


def relation_rows(
    source: Iterable[Any], title: str, word: str = "constraint", *, written: SourceLocation | None = None
) -> list[ConstraintRow]:
    """Rows of relations. Raises ModelError for what is no relation."""
    rows: list[ConstraintRow] = []
    for count, item in enumerate(flatten_items(list(each_of(source, title))), 1):
        if not isinstance(item, Relation):
            raise ModelError(
                f"{title} yielded {type(item).__name__}, which is no relation; expected '==', '<=', '>=' or gt.between",
                written,
            )
        low, high = {"==": (0.0, 0.0), "<=": (-np.inf, 0.0), ">=": (0.0, np.inf)}[item.op]
        residual = item.residual
        for k in range(residual.numel()):
            if not ca.symvar(residual[k]):
                raise ModelError(f"a {word} holds no variable: {residual[k]} {item.op} 0", item.where)
            suffix = f"[{k}]" if residual.numel() > 1 else ""
            rows.append(ConstraintRow(residual[k], low, high, f"{word} {count}{suffix} ({item.where})", item.where))
    return rows


def as_bound(
    e: ca.SX, row: ConstraintRow, flat: FlatModel, parameters: ca.SX
) -> tuple[tuple[int, int], float, float] | None:
    """(chain symbol, low, high) of a row a*s + b with numeric a and b, else None."""
    if flat.parameters:
        e = ca.substitute([e], [flat.p], [parameters])[0]
    symbols = ca.symvar(e)
    if len(symbols) != 1:
        return None
    pair = flat.scope.owner(symbols[0])
    slope = ca.gradient(e, symbols[0])
    if pair is None or not slope.is_constant() or float(slope) == 0.0:
        return None
    a = float(slope)
    b = float(ca.substitute([e], [symbols[0]], [ca.SX(0)])[0])
    ends = sorted([(row.low - b) / a, (row.high - b) / a])
    return pair, ends[0], ends[1]
