"""Builder: write a model without a class, for scripts and notebooks."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from .._pickling import Portable, kept, packed
from . import declare
from .bind import Tree, bind_discrete, bind_parameter, bind_part, bind_variable, empty_tree
from .connect import flatten_items
from .expression import Expr
from .model import EngineMethod, Model
from .source import ModelError, here


class _Root(Model):
    def equations(self) -> Iterable[Any]:
        return tuple(self.__dict__["_items"])


class Builder(Portable):
    """A model written line by line, without a class, for scripts and notebooks.

    Each name is declared once and can be used immediately. A part is a configured model; its ports and variables are
    attributes of the object that `part` returns. `causal` and `simulate` work as for a Model.

    >>> m = gt.Builder("oscillator")
    >>> k, mass = m.parameter("k", 100.0, unit="N/m"), m.parameter("mass", 1.0, unit="kg")
    >>> x = m.variable("x", unit="m", start=1.0)
    >>> m.add(mass * gt.der(x, 2) == -k * x)
    >>> acceleration = m.causal(targets="der(x,2)", prefer="x")
    >>> acceleration(0.5)
    (-50.0, <Status.OK: 0>)
    """

    causal = EngineMethod("gtmodel.compiler.causal", "compile_causal")
    simulate = EngineMethod("gtmodel.simulation.run", "simulate")
    mobility = EngineMethod("gtmodel.kinematics.mobility", "mobility")

    def __init__(self, title: str = "Builder") -> None:
        self.title = title
        self.items: list[Any] = []
        self.where = here()
        self._flat: Any = None  # cache, cleared when something is added
        self.tree: Tree = empty_tree(type(title, (_Root,), {})())
        self.tree.root._keep(_items=self.items)
        self.tree.scope.belong(self, growing=True)

    def _reduced(self, pickler: Any) -> tuple[Any, ...]:
        if pickler.root is not self:  # part of something else, which does not change it
            return kept, (packed(self),)
        pickler.inside = self.tree.scope
        return super()._reduced(pickler)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_flat": None}

    def variable(self, name: str, shape: Any = None, **attributes: Any) -> Expr:
        """Declare a variable; same attributes as gt.variable."""
        return self._declare(name, declare.variable(shape, **attributes), bind_variable)

    def input(self, name: str, shape: Any = None, **attributes: Any) -> Expr:
        """Declare an input; same attributes as gt.input."""
        return self._declare(name, declare.input(shape, **attributes), bind_variable)

    def discrete(self, name: str, start: Any = 0.0, **attributes: Any) -> Expr:
        """Declare a discrete variable with its start value; same attributes as gt.discrete."""
        return self._declare(name, declare.discrete(start, **attributes), bind_discrete)

    def parameter(self, name: str, value: Any, **attributes: Any) -> Expr:
        """Declare a parameter with its value; same attributes as gt.parameter."""
        return self._declare(name, declare.parameter(value, **attributes), bind_parameter)

    def part(self, name: str, model: Model) -> Any:
        """Add a configured model as a component and return it."""
        if not isinstance(model, Model):
            raise ModelError(f"part '{name}' takes a model such as Rod(L=2.0); found {model!r}", here())
        return self._declare(name, declare.part(type(model)), lambda item, tree: bind_part(item, model, tree))

    def add(self, *items: Any) -> None:
        """Add equations (a == b), connections, branches or energies."""
        self.items.extend(flatten_items(list(items)))
        self._change()

    def _declare(self, name: str, item: Any, bind: Callable[[Any, Tree], Any]) -> Any:
        values = self.tree.root.__dict__["_values"]
        if not name.isidentifier() or name.startswith("_"):
            raise ModelError(
                f"'{name}' is not a valid name; use letters, digits and underscores, with a letter first", here()
            )
        if name in values:
            raise ModelError(f"'{name}' is declared twice in {self.title}", here())
        item.name = name
        values[name] = bind(item, self.tree)
        self._change()
        return values[name]

    def _change(self) -> None:
        if self._flat is not None:
            self._flat.made = None  # what was compiled until now is of an earlier model
        self._flat = None

    @property
    def time(self) -> Expr:
        """The time [s] as an expression."""
        return self.tree.root.time

    def names(self) -> Iterable[str]:
        """Return the declared names."""
        return tuple(self.tree.root.__dict__["_values"])
