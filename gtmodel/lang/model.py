"""Model and Connector: classes whose body declares and whose equations() yields the physics."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Iterator
from typing import Any, ClassVar

import numpy as np

from .declare import ATTRIBUTES, Declaration, Free, Parameter, Part, Port, Variable
from .source import ModelError, here


class Model:
    """Base class of all components.

    `Rod(L=2.0)` is an immutable configuration: a class and its modifiers. While the compiler flattens it,
    `self.name` inside `equations()` is the expression, part or port of that name.
    """

    _declared: ClassVar[dict[str, Declaration]] = {}
    _path: str
    _values: dict[str, Any]
    causal: ClassVar[Callable[..., Any]]  # bound by the package: see compiler.causal.compile_causal

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
        for name, item in declared.items():
            if name in _RESERVED:
                raise ModelError(f"'{name}' is a method of every model; choose another name", item.where)
        cls._declared = declared

    def __init__(self, **modifiers: Any) -> None:
        self.__dict__["where"] = here()
        self.__dict__["_modifiers"] = dict(modifiers)
        for name, value in modifiers.items():
            self._check_modifier(name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        raise ModelError(f"models are immutable: '{name}' cannot be assigned; use model.with_({name}=...)", here())

    def _check_modifier(self, name: str, value: Any) -> None:
        declared = type(self)._declared
        if name not in declared:
            close = difflib.get_close_matches(name, declared, n=2)
            hint = f"; did you mean '{close[0]}'?" if close else f"; it has {', '.join(sorted(declared)) or 'none'}"
            raise ModelError(f"{type(self).__name__} has no declaration '{name}'{hint}", here())
        item = declared[name]
        if isinstance(item, Parameter) and _is_number(value):
            check_parameter(item, value, name)
        elif isinstance(item, Variable):
            if not isinstance(value, dict) or set(value) - set(ATTRIBUTES):
                raise ModelError(
                    f"'{name}' is a variable: a modifier is a dictionary with keys of {', '.join(ATTRIBUTES)}; "
                    f"found {value!r}",
                    here(),
                )

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
        """A new model with some modifiers replaced; the old one stays as it is."""
        return type(self)(**{**self.__dict__["_modifiers"], **modifiers})

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
    """A set of potentials and flows at which components are joined."""

    @classmethod
    def _signature(cls) -> tuple[tuple[str, str, tuple[int, ...]], ...]:
        return tuple(
            (name, item.role, item.shape) for name, item in cls._declared.items() if isinstance(item, Variable)
        )


def walk_declarations(cls: type[Model]) -> Iterator[tuple[str, Declaration]]:
    """Declarations in the order in which they can be bound: parameters, free constants, variables and
    ports, then outer references and parts."""
    rank = {Parameter: 0, Free: 1, Variable: 2, Port: 3}
    items = list(cls._declared.items())
    yield from sorted(items, key=lambda kv: next((r for t, r in rank.items() if isinstance(kv[1], t)), _late(kv[1])))


def _late(item: Declaration) -> int:
    return 5 if isinstance(item, Part) else 4


def _is_number(value: Any) -> bool:
    if isinstance(value, (str, bool)) or value is None:
        return False
    try:
        return np.asarray(value).dtype.kind in "iuf"
    except (TypeError, ValueError):
        return False


def check_parameter(item: Parameter, value: Any, name: str) -> np.ndarray:
    """The value as a float array of the declared shape; ModelError for shape, sign or a non-finite number."""
    array = np.asarray(value, dtype=float)
    if array.shape != item.shape:
        raise ModelError(
            f"parameter '{name}' has shape {item.shape}; found a value of shape {array.shape}", item.where
        )
    if not np.all(np.isfinite(array)):
        raise ModelError(f"parameter '{name}' must be finite; found {value}", item.where)
    if item.positive and np.any(array <= 0):
        raise ModelError(f"parameter '{name}' is declared positive; found {value}", item.where)
    if item.nonzero and np.any(array == 0):
        raise ModelError(f"parameter '{name}' is declared nonzero; found {value}", item.where)
    return array


_RESERVED = frozenset(
    ["equations", "initial_equations", "with_", "time", "causal", "simulate", "explain", "where", "constraints"]
)
