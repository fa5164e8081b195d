"""Model and Connector: classes whose body declares and whose equations() yields the physics."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Iterator
from typing import Any, ClassVar

import numpy as np

from .declare import ATTRIBUTES, Declaration, Each, Free, Outer, Parameter, Part, Port, Variable
from .expression import Expr
from .slips import near
from .source import ModelError, SourceLocation, here
from .values import check_parameter


class Model:
    """Base class of all components.

    `Rod(L=2.0)` is an immutable configuration: a class and its modifiers. While the compiler flattens it,
    `self.name` inside `equations()` is the expression, part or port of that name.
    """

    _declared: ClassVar[dict[str, Declaration]] = {}
    _path: str
    _values: dict[str, Any]
    # bound by the package: see compiler.causal.compile_causal and simulate.simulate
    causal: ClassVar[Callable[..., Any]]
    simulate: ClassVar[Callable[..., Any]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        declared: dict[str, Declaration] = {}
        for base in reversed(cls.__mro__):
            for name, item in vars(base).items():
                if isinstance(item, Declaration):
                    declared[name] = item
                elif isinstance(declared.get(name), Free):
                    del declared[name]
                elif name in declared:
                    raise ModelError(f"'{name}' in {cls.__name__} hides a declaration of the same name")
        for name, item in vars(cls).items():
            if isinstance(item, Model) and "where" in item.__dict__:
                made = type(item).__name__
                raise ModelError(
                    f"'{name}' is no part yet; write {name} = gt.part({made}, ...)", item.__dict__["where"]
                )
        for name, item in declared.items():
            if name.startswith("_"):
                raise ModelError(f"declared names may not start with an underscore; found '{name}'", item.where)
            if name in _RESERVED:
                raise ModelError(f"'{name}' is a method of every model; choose another name", item.where)
        cls._declared = declared

    def __init__(self, **modifiers: Any) -> None:
        self.__dict__["where"] = here()
        self.__dict__["_modifiers"] = {name: _frozen(value) for name, value in modifiers.items()}
        check_modifiers(type(self), modifiers, here())

    def __setattr__(self, name: str, value: Any) -> None:
        raise ModelError(f"models are immutable: '{name}' cannot be assigned; use model.with_({name}=...)", here())

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # Python's own questions, such as for __array__
            raise AttributeError(f"'{type(self).__name__}' has no attribute '{name}'")
        raise AttributeError(f"{type(self).__name__} has no declaration '{name}'{near(name, type(self)._declared)}")

    def __delattr__(self, name: str) -> None:
        raise ModelError(f"models are immutable: '{name}' cannot be deleted", here())

    def _member(self, item: Declaration) -> Any:
        values = self.__dict__.get("_values")
        if values is not None:
            if item.name not in values:
                raise ModelError(f"'{item.name}' is used before it is declared", item.where)
            return values[item.name]
        if isinstance(item, Parameter):
            return self.__dict__["_modifiers"].get(item.name, item.default)
        return self.__dict__["_modifiers"].get(item.name, item)

    @property
    def time(self) -> Any:
        """Time as an expression, inside equations()."""
        return self.__dict__["_time"]

    def with_(self, **modifiers: Any) -> Any:
        """A new model with some modifiers replaced; the old one stays as it is.

        A dictionary, of a part or of a variable's attributes, replaces the entries it names and keeps the others.
        """
        return type(self)(**_merged(self.__dict__["_modifiers"], modifiers))

    def equations(self) -> Iterable[Any]:
        """Yield equations (`a == b`), connections and branches."""
        return ()

    def initial_equations(self) -> Iterable[Any]:
        """Yield equations that hold at the start time only."""
        return ()

    def __repr__(self) -> str:
        shown = ", ".join(f"{k}={v!r}" for k, v in self.__dict__.get("_modifiers", {}).items())
        return f"{type(self).__name__}({shown})"


class Connector(Model):
    """A set of potentials and flows at which components are joined.

    `overdetermined` is the reason, told in errors, why such connectors may not be joined in a loop: a potential with
    more numbers than freedoms, such as a rotation matrix. Components tell with gt.tree_edge and gt.tree_root which
    port follows from which. Empty: loops are fine.
    """

    overdetermined: ClassVar[str] = ""

    @classmethod
    def _signature(cls) -> tuple[tuple[str, str, tuple[int, ...]], ...]:
        own = [(name, item.role, item.shape) for name, item in cls._declared.items() if isinstance(item, Variable)]
        inner = [(name, item.cls.__name__, ()) for name, item in cls._declared.items() if isinstance(item, Port)]
        return (*own, *inner)


def walk_declarations(cls: type[Model]) -> Iterator[tuple[str, Declaration]]:
    """Declarations in the order in which they can be bound: parameters, free constants, variables and
    ports, then outer references and parts."""
    order = (Parameter, Free, Variable, Port, Outer, Part)
    yield from sorted(cls._declared.items(), key=lambda kv: [isinstance(kv[1], kind) for kind in order].index(True))


def _merged(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    both = {k: _merged(old[k], v) for k, v in new.items() if isinstance(v, dict) and isinstance(old.get(k), dict)}
    return {**old, **new, **both}


def _frozen(value: Any) -> Any:
    """A copy of a modifier that nobody else can change: arrays inside, also in lists and dictionaries."""
    if isinstance(value, np.ndarray):
        value = value.copy()
        value.flags.writeable = False
    elif isinstance(value, dict):
        value = {k: _frozen(v) for k, v in value.items()}
    elif type(value) in (list, tuple):
        value = type(value)(_frozen(v) for v in value)
    return value


def check_modifiers(
    cls: type[Model],
    modifiers: dict[str, Any],
    where: SourceLocation,
    part: str = "",
    places: dict[str, SourceLocation] | None = None,
) -> None:
    """Raises ModelError for modifiers that a model of this class does not take.

    part: its full name, "" for the whole model. places: where single modifiers were written, `where` for the others.
    """
    what, given_at = f" (part '{part}')" if part else "", where
    for name, value in modifiers.items():
        where = (places or {}).get(name, given_at)
        if name not in cls._declared:
            close = difflib.get_close_matches(name, cls._declared, n=2)
            known = ", ".join(sorted(cls._declared)) or "none"
            hint = f"did you mean '{close[0]}'?" if close else f"it has {known}"
            raise ModelError(f"{cls.__name__}{what} has no declaration '{name}'; {hint}", where)
        item = cls._declared[name]
        if isinstance(item, (Port, Outer)):
            kind = "a port" if isinstance(item, Port) else "an outer reference"
            raise ModelError(f"'{name}' of {cls.__name__}{what} is {kind} and takes no modifier", where)
        if isinstance(item, Free):
            raise ModelError(
                f"'{name}' of {cls.__name__}{what} is free, for the optimisation to choose, and takes no modifier; "
                "declare a parameter, or another guess in a subclass",
                where,
            )
        if isinstance(item, Parameter) and not _symbolic(value):
            check_parameter(item, value, f"{part}.{name}" if part else name, where)
        elif isinstance(item, Variable) and (not isinstance(value, dict) or set(value) - set(ATTRIBUTES)):
            raise ModelError(
                f"'{name}' is a variable: a modifier is a dictionary with keys of {', '.join(ATTRIBUTES)}; "
                f"found {value!r}",
                where,
            )


def _symbolic(value: Any) -> bool:
    """True for what becomes a value only when the model is bound, and for None: no value."""
    if isinstance(value, (list, tuple)):
        return any(map(_symbolic, value))
    return value is None or isinstance(value, (Declaration, Each, Expr)) or callable(value)


_RESERVED = frozenset(
    ["equations", "initial_equations", "with_", "time", "causal", "simulate", "objective", "where", "constraints"]
)
