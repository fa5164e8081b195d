"""Calibrated numbers as a model's modifiers, those of its parts inside."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..compiler.flat import FlatModel

_STEP = re.compile(r"(\w+)(?:\[(\d+)\])?")


def modifiers(flat: FlatModel, values: Mapping[str, float], touched: Sequence[int]) -> dict[str, Any]:
    """Whole parameters for type(model)(**modifiers): arrays and numbers by name, of parts dictionaries of these, and
    for parts with an index a list of dictionaries, one each.

    `values` by scalar name; `touched`: indices in flat.parameters of those to give.
    """
    p = ca.vertcat(*[q.symbol for q in flat.parameters])
    at = np.array([values.get(q.name, q.value) for q in flat.parameters])
    nested: dict[str, Any] = {}
    for name in dict.fromkeys(_whole(flat.parameters[k].name) for k in touched):
        if name not in flat.bindings:
            continue
        array = np.asarray(ca.Function("p", [p], [flat.bindings[name]])(at))
        shape = _shape(name, [q.name for q in flat.parameters])
        *path, last = name.split(".")
        inside = nested
        for step, index in (_STEP.fullmatch(s).groups() for s in path):  # type: ignore[union-attr]
            if index is None:
                inside = inside.setdefault(step, {})
            else:
                listed = inside.setdefault(step, [])
                listed += [{} for _ in range(int(index) + 1 - len(listed))]
                inside = listed[int(index)]
        inside[last] = array.reshape(-1).reshape(shape) if shape else float(array.reshape(-1)[0])
    return nested


def merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Modifiers `old` with those of `new` in their place; one dictionary for all of several parts goes to each."""
    both = dict(old)
    for name, value in new.items():
        before = old.get(name)
        if isinstance(value, Mapping) and isinstance(before, Mapping):
            both[name] = merged(before, value)
        elif isinstance(value, list) and value and isinstance(value[0], Mapping) and isinstance(before, Mapping | list):
            each = before if isinstance(before, list) else [before] * len(value)
            pairs = zip(each, value, strict=False)
            both[name] = [merged(a, b) for a, b in pairs] if len(each) == len(value) else value
        elif isinstance(value, Mapping) and isinstance(before, list):
            both[name] = [merged(a, value) for a in before]
        else:
            both[name] = value
    return both


def _whole(name: str) -> str:
    """leg[0].c[1,2] is of leg[0].c."""
    head, dot, last = name.rpartition(".")
    return head + dot + last.partition("[")[0]


def _shape(name: str, names: Sequence[str]) -> tuple[int, ...]:
    indices = [n[len(name) + 1 : -1].split(",") for n in names if n.startswith(f"{name}[") and n.endswith("]")]
    return tuple(int(k) + 1 for k in np.max(np.array(indices, int), axis=0)) if indices else ()
