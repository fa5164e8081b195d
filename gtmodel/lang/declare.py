"""What stands in a class body: variable, input, parameter, part, parts, port, outer, potential, flow, free."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from .slips import floats, named, shortened
from .source import ModelError, SourceLocation, here
from .units import UnitError, si_unit

if TYPE_CHECKING:
    from .model import Model

Shape = tuple[int, ...]
Kind = Literal["rotation", "unit", "direction", "semidefinite"]


class Declaration:
    """One named line of a class body; remembers where it was written."""

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
            f"models are immutable: '{self.name}' cannot be assigned; give it when the model is made, "
            f"or use model.with_({self.name}=...)",
            here(),
        )


class _Quantity(Declaration):
    def __init__(self, shape: int | Shape | None, unit: str | None, description: str) -> None:
        super().__init__(description)
        try:
            self.shape = as_shape(shape)
        except (TypeError, ValueError):
            meant = f"; write unit={shape!r}" if isinstance(shape, str) else ""
            raise ModelError(f"a shape is a whole number or several; found {shape!r}{meant}", self.where) from None
        self.unit = unit
        try:
            self.dimension = None if unit is None else si_unit(unit).dimension
        except UnitError as error:
            raise ModelError(str(error), self.where) from None


class Variable(_Quantity):
    """Record of a variable: unit, nominal, min, max, start, fixed, state preference, role."""

    def __init__(self, shape: Any, unit: str | None, description: str, role: str, attributes: dict[str, Any]) -> None:
        super().__init__(shape, unit, description)
        if -1 in self.shape:
            raise ModelError(f"a variable takes a shape of whole numbers; found {shape}", self.where)
        self.role = role
        self.attributes = attributes


class Parameter(_Quantity):
    """Record of a parameter: default value, unit, sign assumptions, bounds that its values are checked against."""

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
    """A constant that an optimisation chooses, e.g. a free final time."""

    def __init__(self, guess: Any, low: Any, high: Any, unit: str | None, description: str) -> None:
        try:
            size = floats(guess).shape
        except (TypeError, ValueError):
            raise ModelError(f"a guess takes numbers; found {guess!r}", here()) from None
        super().__init__(size, unit, description)
        self.guess = guess
        self.low = low
        self.high = high


class Part(Declaration):
    """A component, or an array of `count` of them, with modifiers for each."""

    def __init__(self, cls: type[Model], count: int | None, modifiers: dict[str, Any]) -> None:
        super().__init__()
        if not isinstance(cls, type):
            order = "; parts() takes the count first: gt.parts(3, Arm)" if isinstance(count, type) else ""
            raise ModelError(f"a part takes a Model class; found {cls!r}{order}", self.where)
        if not hasattr(cls, "_declared"):
            raise ModelError(f"a part takes a Model class; found the class {cls.__name__}", self.where)
        _check_count(count, self.where)
        self.cls = cls
        self.count = count
        self.modifiers = modifiers


class Port(Declaration):
    """A connector instance at the border of a component."""

    def __init__(self, cls: type[Model], count: int | None) -> None:
        super().__init__()
        if not hasattr(cls, "_signature") or not isinstance(cls, type):
            raise ModelError(f"a port takes a class of gt.Connector; found {shortened(cls)}", self.where)
        _check_count(count, self.where)
        self.cls = cls
        self.count = count


class Outer(Declaration):
    """A reference to the nearest enclosing component of a class, e.g. World (gravity)."""

    def __init__(self, cls: type[Model]) -> None:
        super().__init__()
        self.cls = cls


class Each:
    """Marks a modifier of an array part that goes to every element unchanged."""

    def __init__(self, value: Any) -> None:
        self.value = value


def as_shape(shape: int | Shape | None) -> Shape:
    if shape is None:
        return ()
    if isinstance(shape, (int, np.integer)):
        return (int(shape),)
    return tuple(-1 if n is None else int(n) for n in shape)


@named
def variable(
    shape: int | Shape | None = None,
    *,
    unit: str | None = None,
    nominal: Any = None,
    min: Any = None,
    max: Any = None,
    start: Any = None,
    fixed: bool = False,
    prefer: int = 0,
    description: str = "",
) -> Any:
    """An unknown of the model.

    Args:
        shape: None for a scalar, n for a vector, (n, m) for a matrix.
        unit: SI unit, e.g. "N/m"; None switches the dimension check off for this variable.
        nominal: expected magnitude (> 0), used for scaling.
        min, max: bounds, used by optimisation.
        start: start or home value; with fixed=True an initial condition, which is 0 where none is given.
        prefer: preference as a state; higher is kept longer, negative is avoided.
    """
    return Variable(shape, unit, description, "variable", _attributes(nominal, min, max, start, fixed, prefer))


@named
def input(
    shape: int | Shape | None = None,
    *,
    unit: str | None = None,
    nominal: Any = None,
    min: Any = None,
    max: Any = None,
    start: Any = None,
    prefer: int = 0,
    description: str = "",
) -> Any:
    """A variable that the surroundings prescribe: known in simulation, free in optimisation.

    Any causality may still ask for it as a target. Arguments as for `variable`.
    """
    return Variable(shape, unit, description, "input", _attributes(nominal, min, max, start, False, prefer))


@named
def potential(
    shape: int | Shape | None = None, *, unit: str | None = None, prefer: int = 0, description: str = ""
) -> Any:
    """A connector variable that is equal at all connected ports (position, voltage); `prefer` as for `variable`."""
    return Variable(shape, unit, description, "potential", _attributes(None, None, None, None, False, prefer))


@named
def flow(shape: int | Shape | None = None, *, unit: str | None = None, description: str = "") -> Any:
    """A connector variable that sums to zero over connected ports, positive into the component."""
    return Variable(shape, unit, description, "flow", _attributes(None, None, None, None, False, 0))


@named
def parameter(
    default: Any = None,
    *,
    unit: str | None = None,
    shape: int | tuple[int | None, ...] | None = None,
    positive: bool = False,
    nonzero: bool = False,
    increasing: bool = False,
    min: Any = None,
    max: Any = None,
    kind: Kind | None = None,
    description: str = "",
) -> Any:
    """A constant of the model; values are checked.

    Args:
        default: value if none is given.
        shape: None for the default's; a None inside leaves that length to the value, e.g. (None, 3) for points.
        positive, nonzero: let the compiler divide by it.
        increasing: each entry of a vector is greater than the one before it.
        min, max: the values it may take, as a number, in its shape, or another parameter of the class.
        kind: what it describes. "rotation" (3, 3); "unit", each row of length 1 (axes, quaternions); "direction", each
            row of any length but zero; "semidefinite" (n, n), symmetric and positive semidefinite.
    """
    return Parameter(default, shape, unit, description, positive, nonzero, min, max, increasing, kind)


@named
def free(guess: Any, *, min: Any = None, max: Any = None, unit: str | None = None, description: str = "") -> Any:
    """A constant for the optimisation to choose: `final_time = gt.free(guess=1.0, min=0.2)`."""
    return Free(guess, min, max, unit, description)


def part(model: type[Model] | Model, **modifiers: Any) -> Any:
    """A component: a Model class, or a configured model such as `gt.robots.gantry_tau("l1_tape")`.

    Modifiers are values, parameters of the enclosing class (by name as declared there), dictionaries for nested
    parts, a Model class (redeclaration), or functions of the enclosing model.
    """
    if isinstance(model, type):
        return Part(model, None, modifiers)
    configured = getattr(model, "__dict__", {}).get("_modifiers")
    if configured is None:
        raise ModelError(f"a part takes a Model class or a configured model; found {model!r}", here())
    return Part(type(model), None, {**configured, **modifiers})


def parts(count: int, cls: type[Model], **modifiers: Any) -> Any:
    """An array of components; element i gets row i of each modifier, `gt.each(x)` gives x to all."""
    return Part(cls, count, modifiers)


@named
def port(cls: type[Model]) -> Any:
    """A connector at the border of a component."""
    return Port(cls, None)


@named
def ports(count: int, cls: type[Model]) -> Any:
    """An array of connectors."""
    return Port(cls, count)


@named
def outer(cls: type[Model]) -> Any:
    """The nearest enclosing part of this class; a default one is made at the root if there is none."""
    return Outer(cls)


def each(value: Any) -> Each:
    """Give the same modifier to every element of an array of parts."""
    return Each(value)


ATTRIBUTES = ("nominal", "min", "max", "start", "fixed", "prefer")


def _attributes(nominal: Any, low: Any, high: Any, start: Any, fixed: bool, prefer: int) -> dict[str, Any]:
    for name, value in zip(ATTRIBUTES, (nominal, low, high, start), strict=False):
        if isinstance(value, str):
            raise ModelError(f"{name} takes numbers; found {value!r}", here())
    if nominal is not None and np.any(np.asarray(nominal, float) <= 0):
        raise ModelError(f"a nominal is a magnitude and must be positive; found {nominal}", here())
    return dict(zip(ATTRIBUTES, (nominal, low, high, start, fixed, prefer), strict=True))


def _check_count(count: Any, where: SourceLocation) -> None:
    if count is not None and (not isinstance(count, (int, np.integer)) or isinstance(count, bool) or count < 0):
        raise ModelError(f"the count of parts or ports is a whole number and not negative; found {count!r}", where)


def _check_kind(kind: Kind, shape: Shape, where: SourceLocation) -> None:
    if kind not in get_args(Kind):
        raise ModelError(f"kinds of parameters are {', '.join(get_args(Kind))}; found '{kind}'", where)
    square = len(shape) == 2 and shape[0] == shape[1] != -1
    fits = {"unit": bool(shape), "direction": bool(shape), "semidefinite": square}.get(kind, shape == (3, 3))
    if not fits:
        expected = {"unit": "rows", "direction": "rows", "semidefinite": "(n, n)"}.get(kind, "(3, 3)")
        raise ModelError(f"a parameter of kind '{kind}' has shape {expected}; found {shape}", where)
