"""What a declaration in a class body leaves there: objects that the class keeps until a model is made of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from .._lazy import hint
from .slips import floats, shortened
from .source import ModelError, SourceLocation, here
from .units import UnitError, si_unit

if TYPE_CHECKING:
    from .model import Model
else:
    Model = hint("gtmodel.lang.model", "Model")

Shape = tuple[int, ...]
Kind = Literal["rotation", "unit", "direction", "semidefinite"]


class Declaration:
    """One declaration in a class body, with its file and line."""

    name: str = "?"

    def __init__(self, description: str = "") -> None:
        self.where = here()
        self.description = description

    def __repr__(self) -> str:
        return f"{type(self).__name__.lower()} '{self.name}'"

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        return self if instance is None else instance._member(self)

    def __set__(self, instance: Any, value: Any) -> None:
        raise ModelError(
            f"models are immutable: '{self.name}' cannot be assigned; pass it when you create the model, "
            f"or use model.with_({self.name}=...)",
            here(),
        )


class _Quantity(Declaration):
    def __init__(self, shape: int | Shape | None, unit: str | None, description: str) -> None:
        super().__init__(description)
        try:
            self.shape = as_shape(shape)
        except (TypeError, ValueError):
            advice = f"; write unit={shape!r}" if isinstance(shape, str) else ""
            raise ModelError(
                f"a shape must be an integer or a tuple of integers; found {shape!r}{advice}", self.where
            ) from None
        self.unit = unit
        try:
            self.dimension = None if unit is None else si_unit(unit).dimension
        except UnitError as error:
            raise ModelError(str(error), self.where) from None


class Variable(_Quantity):
    """Declaration of a variable: unit, role, attributes (nominal, min, max, start, fixed, prefer) and kind."""

    def __init__(
        self, shape: Any, unit: str | None, description: str, role: str, attributes: dict[str, Any],
        kind: Literal["rotation"] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(shape, unit, description)
        if -1 in self.shape:
            raise ModelError(f"the shape of a variable must consist of integers; found {shape}", self.where)
        if kind not in (None, "rotation"):
            raise ModelError(f"the kind of a variable must be 'rotation'; found {kind!r}", self.where)
        if kind is not None:
            _check_kind(kind, self.shape, self.where)
        self.role = role
        self.attributes = attributes
        self.kind = kind


class Parameter(_Quantity):
    """Declaration of a parameter: default value, unit, and the sign, bounds and kind that its values must satisfy."""

    def __init__(
        self,
        default: Any,
        shape: Any,
        unit: str | None,
        description: str,
        positive: bool,
        nonzero: bool,
        low: Any = None,
        high: Any = None,
        increasing: bool = False,
        kind: Kind | None = None,
    ) -> None:
        if shape is None and default is not None:
            shape = np.shape(default)
        super().__init__(shape, unit, description)
        self.default = default
        self.positive = positive
        self.nonzero = nonzero or positive
        self.low = low
        self.high = high
        self.increasing = increasing
        self.kind: Kind | None = kind
        if kind is not None:
            _check_kind(kind, self.shape, self.where)


class Free(_Quantity):
    """Declaration of a constant that an optimisation chooses, e.g. a free final time."""

    def __init__(self, guess: Any, low: Any, high: Any, unit: str | None, description: str) -> None:
        try:
            size = floats(guess).shape
        except (TypeError, ValueError):
            raise ModelError(f"a guess must be a number or an array of numbers; found {guess!r}", here()) from None
        super().__init__(size, unit, description)
        self.guess = guess
        self.low = low
        self.high = high


class Discrete(_Quantity):
    """Declaration of a discrete variable: start value, unit, and whether it is an output of a sampled block."""

    low = high = None
    positive = nonzero = False

    def __init__(self, start: Any, shape: Any, unit: str | None, description: str, output: bool = False) -> None:
        try:
            self.start = floats(start)
        except (TypeError, ValueError):
            raise ModelError(
                f"the start of a discrete variable must be a number or an array of numbers; found {start!r}", here()
            ) from None
        if not np.all(np.isfinite(self.start)):
            raise ModelError(f"the start of a discrete variable must be finite; found {start!r}", here())
        super().__init__(self.start.shape if shape is None else shape, unit, description)
        if self.start.shape not in ((), self.shape):
            raise ModelError(
                f"the start of a discrete variable must have its shape {self.shape}; found {self.start.shape}",
                self.where,
            )
        self.output = output
        self.helper = False  # auxiliary variable of a translator, recorded only if requested as an output


class Part(Declaration):
    """Declaration of a component, or of an array of `count` components, with their modifiers."""

    def __init__(self, cls: type[Model], count: int | None, modifiers: dict[str, Any]) -> None:
        super().__init__()
        if not isinstance(cls, type):
            advice = "; parts() takes the count first: gt.parts(3, Arm)" if isinstance(count, type) else ""
            raise ModelError(f"a part needs a Model class; found {cls!r}{advice}", self.where)
        if not hasattr(cls, "_declared"):
            raise ModelError(f"a part needs a Model class; found the class {cls.__name__}", self.where)
        _check_count(count, self.where)
        self.cls = cls
        self.count = count
        self.modifiers = modifiers


class Port(Declaration):
    """Declaration of a connector, or of an array of `count` connectors, of a component."""

    def __init__(self, cls: type[Model], count: int | None) -> None:
        super().__init__()
        if not hasattr(cls, "_signature") or not isinstance(cls, type):
            raise ModelError(f"a port needs a subclass of gt.Connector; found {shortened(cls)}", self.where)
        _check_count(count, self.where)
        self.cls = cls
        self.count = count


class Outer(Declaration):
    """Declaration of a reference to the nearest enclosing component of a class, e.g. World (gravity)."""

    def __init__(self, cls: type[Model]) -> None:
        super().__init__()
        self.cls = cls


class Each:
    """Marks a modifier of an array of parts that every element gets unchanged."""

    def __init__(self, value: Any) -> None:
        self.value = value


def as_shape(shape: int | Shape | None) -> Shape:
    if shape is None:
        return ()
    if isinstance(shape, (int, np.integer)):
        return (int(shape),)
    return tuple(-1 if n is None else int(n) for n in shape)


def _check_count(count: Any, where: SourceLocation) -> None:
    if count is not None and (not isinstance(count, (int, np.integer)) or isinstance(count, bool) or count < 0):
        raise ModelError(f"the count of parts or ports must be a non-negative integer; found {count!r}", where)


def _check_kind(kind: Kind, shape: Shape, where: SourceLocation) -> None:
    if kind not in get_args(Kind):
        raise ModelError(f"kind must be one of {', '.join(get_args(Kind))}; found '{kind}'", where)
    square = len(shape) == 2 and shape[0] == shape[1] != -1
    fits = {"unit": bool(shape), "direction": bool(shape), "semidefinite": square}.get(kind, shape == (3, 3))
    if not fits:
        expected = {"unit": "rows", "direction": "rows", "semidefinite": "(n, n)"}.get(kind, "(3, 3)")
        raise ModelError(f"a declaration of kind '{kind}' must have shape {expected}; found {shape}", where)
