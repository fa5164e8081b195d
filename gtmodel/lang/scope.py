"""Symbols of one flattened model: every scalar variable is a chain x, x', x'', ..., extended on demand."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca

from .._pickling import Portable
from .source import ModelError, here

if TYPE_CHECKING:
    from .condition import Condition


@dataclass(frozen=True, eq=False)
class Instant:
    """A symbol for the value of an expression at an instant; if time is None, for its integral over the horizon."""

    symbol: ca.SX
    expression: ca.SX
    time: ca.SX | None


@dataclass(frozen=True, eq=False)
class Misfit:
    """Residuals of measurements in symbols of instants; known: scaled with a known standard deviation."""

    residual: ca.SX
    known: bool


class Scope(Portable):
    """Registry of the derivative chains and parameters of one flattened model.

    Symbols belong to the scope: two flattenings of the same model share no symbols.
    """

    def __init__(self) -> None:
        self.source: Any = None
        self._most: tuple[int, int, int, int] | None = None
        self.chains: list[list[ca.SX]] = []
        self.names: list[str] = []
        self._owner: dict[int, tuple[int, int]] = {}
        # cache of symbols_in by element hash; it keeps the expression, because a hash is valid only while that exists
        self._symbols: dict[int, tuple[ca.SX, tuple[tuple[int, int], ...]]] = {}
        self.parameters: list[ca.SX] = []
        self.parameter_names: list[str] = []
        self.time = ca.SX.sym("time")
        self._time_key = self.time.element_hash()
        self.instants: list[Instant] = []
        self.misfits: list[Misfit] = []
        # 1 if the condition is true, else 0; constant between two events
        self.modes: list[tuple[ca.SX, Condition]] = []
        # symbols for values just before an event, with their expressions
        self.earlier: list[tuple[ca.SX, ca.SX]] = []
        # external functions that stay calls in the equations
        self.calls: list[ca.Function] = []

    def _reduced(self, pickler: Any) -> tuple[Any, ...]:
        if not self.is_owned or self is pickler.inside:
            return Portable._reduced(self, pickler)
        return pickler.link(self)

    @property
    def is_owned(self) -> bool:
        """Whether a flat model or a Builder declares these symbols; not of a copy with further symbols."""
        return self.source is not None and self.source.tree.scope is self

    def __copy__(self) -> Scope:
        other = object.__new__(Scope)
        other.__dict__.update(self.__dict__)
        return other

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_owner", "_symbols", "_time_key")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._time_key, self._symbols = self.time.element_hash(), {}
        self._owner = {s.element_hash(): (i, k) for i, chain in enumerate(self.chains) for k, s in enumerate(chain)}

    def belong(self, source: Any, growing: bool = False) -> None:
        """Declare the Builder or the flat model that the symbols of now belong to."""
        self.source = source
        if not growing:
            self._most = len(self.chains), len(self.parameters), len(self.modes), len(self.earlier)

    def places(self) -> dict[int, Hashable]:
        """Return the place of each symbol of the source by its element hash."""
        chains, parameters, modes, earlier = self._most or (None,) * 4
        placed: list[tuple[ca.SX, tuple[Any, ...]]] = [(self.time, ("time",))]
        placed += [(s, ("chain", i, k)) for i, chain in enumerate(self.chains[:chains]) for k, s in enumerate(chain)]
        placed += [(s, ("parameter", n)) for n, s in enumerate(self.parameters[:parameters])]
        placed += [(s, ("mode", n)) for n, (s, _) in enumerate(self.modes[:modes])]
        placed += [(s, ("earlier", n)) for n, (s, _) in enumerate(self.earlier[:earlier])]
        return {symbol.element_hash(): place for symbol, place in placed}

    def at_place(self, place: Any) -> ca.SX:
        """Return the symbol at a place."""
        kind, *numbers = place
        if kind == "chain":
            return self.symbol(*numbers)
        if kind == "time":
            return self.time
        n = numbers[0]
        return self.parameters[n] if kind == "parameter" else (self.modes if kind == "mode" else self.earlier)[n][0]

    def new_chain(self, name: str) -> ca.SX:
        """Add a scalar variable; return its symbol of order 0."""
        self.chains.append([])
        self.names.append(name)
        return self.symbol(len(self.chains) - 1, 0)

    def symbol(self, index: int, order: int) -> ca.SX:
        """Return the symbol of derivative `order` of variable `index`."""
        chain = self.chains[index]
        while len(chain) <= order:
            k = len(chain)
            s = ca.SX.sym(derivative_name(self.names[index], k))
            self._owner[s.element_hash()] = (index, k)
            chain.append(s)
        return chain[order]

    def new_parameter(self, name: str) -> ca.SX:
        """Add a scalar parameter; return its symbol, whose time derivative is zero."""
        s = ca.SX.sym(name)
        self.parameters.append(s)
        self.parameter_names.append(name)
        return s

    def mode(self, condition: Condition) -> ca.SX:
        """Return a symbol that is 1 while a condition is true, else 0; its time derivative is zero."""
        symbol = ca.SX.sym(f"mode{len(self.modes)}")
        self.modes.append((symbol, condition))
        return symbol

    def before(self, expression: ca.SX) -> ca.SX:
        """Return symbols for the entries of an expression just before an event."""
        entries = [ca.SX.sym(f"pre({x})") for x in ca.vertsplit(ca.vec(ca.densify(expression)))]
        self.earlier += zip(entries, ca.vertsplit(ca.vec(ca.densify(expression))), strict=True)
        return ca.reshape(ca.vertcat(*entries), *expression.shape)

    def owner(self, symbol: ca.SX) -> tuple[int, int] | None:
        """Return (variable index, derivative order) of a chain symbol; None for parameters and time."""
        return self._owner.get(symbol.element_hash())

    def symbols_in(self, expression: ca.SX) -> tuple[tuple[int, int], ...]:
        """Return the chain symbols in an expression as sorted (variable index, order) pairs."""
        if not isinstance(expression, ca.SX):  # vertcat() without arguments is not an SX
            expression = ca.SX(expression)
        if not expression.is_scalar(True):
            return self._search(expression)
        key = expression.element_hash()
        if key not in self._symbols:
            self._symbols[key] = (expression, self._search(expression))
        return self._symbols[key][1]

    def symbols_in_each(self, expressions: Sequence[ca.SX]) -> list[tuple[tuple[int, int], ...]]:
        """Return `symbols_in` of many scalars; searching them together takes little longer than searching one."""
        new = {e.element_hash(): e for e in expressions if e.is_scalar(True)}
        new = {key: e for key, e in new.items() if key not in self._symbols}
        if len(new) > 1:
            column = ca.vertcat(*new.values())
            symbols = ca.symvar(column)
            owners = [self._owner.get(s.element_hash()) for s in symbols]
            inside: list[list[tuple[int, int]]] = [[] for _ in new]
            if symbols:
                sparsity = ca.Function("symbols", [ca.vertcat(*symbols)], [column]).jac_sparsity(0, 0)
                for row, number in zip(*sparsity.get_triplet(), strict=True):
                    if (pair := owners[number]) is not None:
                        inside[row].append(pair)
            for (key, e), pairs in zip(new.items(), inside, strict=True):
                self._symbols[key] = e, tuple(sorted(pairs))
        return [self.symbols_in(e) for e in expressions]

    def _search(self, expression: ca.SX) -> tuple[tuple[int, int], ...]:
        owners = (self._owner.get(s.element_hash()) for s in ca.symvar(expression))
        return tuple(sorted(pair for pair in owners if pair is not None))

    def derivative(self, expression: ca.SX) -> ca.SX:
        """Return the total time derivative of an expression, by the chain rule over the variables in it."""
        if expression.is_symbolic() and expression.size2() == 1:
            owners = [self.owner(s) for s in ([expression] if expression.numel() == 1 else ca.vertsplit(expression))]
            derivatives = [self.symbol(pair[0], pair[1] + 1) for pair in owners if pair is not None]
            if len(derivatives) == len(owners):
                return derivatives[0] if len(derivatives) == 1 else ca.vertcat(*derivatives)
        symbols: list[ca.SX] = []
        rates: list[ca.SX] = []
        for s in ca.symvar(expression):
            key = s.element_hash()
            pair = self._owner.get(key)
            if pair is not None:
                symbols.append(s)
                rates.append(self.symbol(pair[0], pair[1] + 1))
            elif key == self._time_key:
                symbols.append(s)
                rates.append(ca.SX(1))
        if not symbols:
            return ca.SX.zeros(*expression.shape)
        return ca.jtimes(expression, ca.vertcat(*symbols), ca.vertcat(*rates))

    def value_at(self, expression: ca.SX, time: ca.SX) -> ca.SX:
        """Return a symbol for the value of an expression at a constant time.

        Raises ModelError for a time that is not constant, and for an expression that holds the value at an instant.
        """
        constant = {p.element_hash() for p in self.parameters}
        if varying := [s.name() for s in ca.symvar(time) if s.element_hash() not in constant]:
            raise ModelError(
                f".at() takes a constant time: a number [s], self.start_time, self.final_time or an expression of "
                f"parameters; found one that depends on {', '.join(varying)}",
                here(),
            )
        allowed = {self.time.element_hash(), *constant}
        if any(self.owner(s) is None and s.element_hash() not in allowed for s in ca.symvar(expression)):
            raise ModelError(
                ".at() takes an expression along the path; found one that already holds a value at an instant or an "
                "integral; apply .at() to the variables inside",
                here(),
            )
        symbol = ca.SX.sym(f"at{len(self.instants)}", *expression.shape)
        self.instants.append(Instant(symbol, expression, time))
        return symbol


def derivative_name(name: str, order: int) -> str:
    """Return the name of a derivative: `x`, `der(x)`, `der(x,2)`."""
    if order == 0:
        return name
    return f"der({name})" if order == 1 else f"der({name},{order})"
