"""Quantities of parts of gt.mechanics in expressions of the text."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Values, array, scalar
from ..scalars import Operation, Scalar, operation
from ..syntax import FunctionCall, Literal, ModelicaError, Place
from .library import part_name

PART = "part"  # the operation: name of the part, path inside it, indices


def quantity(part: str, path: str, indices: tuple[int, ...], at: Place | None) -> Scalar:
    """One scalar of a part, such as ("joint.part", "a.r", (0,))."""
    return Operation(PART, (part, path, ",".join(map(str, indices))), at)


def called(node: FunctionCall, scope: Any) -> Values:
    """__mechanics("part.shaft.phi"), with its length where it is a vector: for the texts of MultiBody alone."""
    instance = scope.instance
    if instance is None or not part_name(scope.space.text):
        raise ModelicaError(f"there is no function '{node.reference}'", node.at)
    path, *length = [a.value for a in node.arguments if isinstance(a, Literal)]
    part, _, inside = str(path).partition(".")
    name = instance.full(part)
    if not length:
        return scalar(quantity(name, inside, (), node.at))
    return array([quantity(name, inside, (i,), node.at) for i in range(int(length[0]))], (int(length[0]),))


def vector(part: str, path: str, at: Place | None) -> Values:
    """A vector of a part, in coordinates of the world."""
    return array([quantity(part, path, (i,), at) for i in range(3)], (3,))


def turned(part: str, port: str, path: str, at: Place | None) -> Values:
    """A vector of a part's frame in coordinates of the frame: R' v."""
    result = np.empty(3, object)
    for j in range(3):
        terms = [
            operation("*", (quantity(part, f"{port}.R", (i, j), at), quantity(part, path, (i,), at)), at)
            for i in range(3)
        ]
        result[j] = operation("+", (operation("+", (terms[0], terms[1]), at), terms[2]), at)
    return result
