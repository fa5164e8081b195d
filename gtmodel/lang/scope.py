"""Symbols of one flattening: every scalar variable is a chain x, x', x'', ... made on demand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca

from .source import ModelError, here

if TYPE_CHECKING:
    from .condition import Condition


@dataclass(frozen=True, eq=False)
class Instant:
    """A symbol that stands for an expression at one instant; time None means its integral over the horizon."""

    symbol: ca.SX
    expression: ca.SX
    time: ca.SX | None


@dataclass(frozen=True, eq=False)
class Misfit:
    """Measured residuals in symbols of instants, and whether they are in units of a known standard deviation."""

    residual: ca.SX
    known: bool


class Scope:
    """Registry of the derivative chains and parameters of one flattened model.

    Symbols belong to the scope, never to the module: two flattenings of one model share nothing.
    """

    def __init__(self) -> None:
        self.chains: list[list[ca.SX]] = []
        self.names: list[str] = []
        self._owner: dict[int, tuple[int, int]] = {}
        # answers of symbols_in by element hash, beside the expression: a hash is only good while its expression lives
        self._symbols: dict[int, tuple[ca.SX, tuple[tuple[int, int], ...]]] = {}
        self.parameters: list[ca.SX] = []
        self.parameter_names: list[str] = []
        self.time = ca.SX.sym("time")
        self._time_key = self.time.element_hash()
        self.instants: list[Instant] = []
        self.misfits: list[Misfit] = []
        # 1 where the condition holds, 0 where it does not; constant between two events
        self.modes: list[tuple[ca.SX, Condition]] = []
        # symbols for values just before an event, with what they are values of
        self.earlier: list[tuple[ca.SX, ca.SX]] = []

    def new_chain(self, name: str) -> ca.SX:
        """A new scalar variable; returns its symbol of order 0."""
        self.chains.append([])
        self.names.append(name)
        return self.symbol(len(self.chains) - 1, 0)

    def symbol(self, index: int, order: int) -> ca.SX:
        """The symbol of variable `index` differentiated `order` times."""
        chain = self.chains[index]
        while len(chain) <= order:
            k = len(chain)
            s = ca.SX.sym(derivative_name(self.names[index], k))
            self._owner[s.element_hash()] = (index, k)
            chain.append(s)
        return chain[order]

    def new_parameter(self, name: str) -> ca.SX:
        """A new scalar parameter symbol: its time derivative is zero."""
        s = ca.SX.sym(name)
        self.parameters.append(s)
        self.parameter_names.append(name)
        return s

    def mode(self, condition: Condition) -> ca.SX:
        """A symbol that is 1 while a condition holds, else 0: its time derivative is zero."""
        symbol = ca.SX.sym(f"mode{len(self.modes)}")
        self.modes.append((symbol, condition))
        return symbol

    def before(self, expression: ca.SX) -> ca.SX:
        """Symbols for the entries of an expression just before an event."""
        entries = [ca.SX.sym(f"pre({x})") for x in ca.vertsplit(ca.vec(ca.densify(expression)))]
        self.earlier += zip(entries, ca.vertsplit(ca.vec(ca.densify(expression))), strict=True)
        return ca.reshape(ca.vertcat(*entries), *expression.shape)

    def owner(self, symbol: ca.SX) -> tuple[int, int] | None:
        """(variable index, derivative order) of a chain symbol; None for parameters and time."""
        return self._owner.get(symbol.element_hash())

    def symbols_in(self, expression: ca.SX) -> tuple[tuple[int, int], ...]:
        """Chain symbols that occur in an expression as sorted (variable index, order) pairs."""
        if not isinstance(expression, ca.SX):  # vertcat() of nothing is no SX
            expression = ca.SX(expression)
        if not expression.is_scalar(True):
            return self._search(expression)
        key = expression.element_hash()
        if key not in self._symbols:
            self._symbols[key] = (expression, self._search(expression))
        return self._symbols[key][1]

    def symbols_in_each(self, expressions: Sequence[ca.SX]) -> list[tuple[tuple[int, int], ...]]:
        """`symbols_in` of many scalars: the new ones are searched at once, in little more time than one."""
        new = {e.element_hash(): e for e in expressions if e.is_scalar(True)}
        new = {key: e for key, e in new.items() if key not in self._symbols}
        if len(new) > 1:
            column = ca.vertcat(*new.values())
            symbols = ca.symvar(column)
            owners = [self._owner.get(s.element_hash()) for s in symbols]
            inside: list[list[tuple[int, int]]] = [[] for _ in new]
            if symbols:
                of_rows = ca.Function("symbols", [ca.vertcat(*symbols)], [column]).jac_sparsity(0, 0)
                for row, place in zip(*of_rows.get_triplet(), strict=True):
                    if (pair := owners[place]) is not None:
                        inside[row].append(pair)
            for (key, e), pairs in zip(new.items(), inside, strict=True):
                self._symbols[key] = e, tuple(sorted(pairs))
        return [self.symbols_in(e) for e in expressions]

    def _search(self, expression: ca.SX) -> tuple[tuple[int, int], ...]:
        owners = (self._owner.get(s.element_hash()) for s in ca.symvar(expression))
        return tuple(sorted(pair for pair in owners if pair is not None))

    def derivative(self, expression: ca.SX) -> ca.SX:
        """Total time derivative of an expression, by the chain rule over all chain symbols in it."""
        if expression.is_symbolic() and expression.size2() == 1:
            own = [self.owner(s) for s in ([expression] if expression.numel() == 1 else ca.vertsplit(expression))]
            following = [self.symbol(pair[0], pair[1] + 1) for pair in own if pair is not None]
            if len(following) == len(own):
                return following[0] if len(following) == 1 else ca.vertcat(*following)
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
        """A symbol for the value of an expression at a constant time.

        Raises ModelError for a time that is none, and for a value that stands for one instant already.
        """
        constant = {p.element_hash() for p in self.parameters}
        if moving := [s.name() for s in ca.symvar(time) if s.element_hash() not in constant]:
            raise ModelError(
                f".at() takes a constant time: a number [s], self.start_time, self.final_time or an expression of "
                f"parameters; found one that depends on {', '.join(moving)}",
                here(),
            )
        along = {self.time.element_hash(), *constant}
        if any(self.owner(s) is None and s.element_hash() not in along for s in ca.symvar(expression)):
            raise ModelError(
                ".at() takes an expression along the path; found one that holds a value at an instant or an integral "
                "already; take .at() of what stands inside",
                here(),
            )
        symbol = ca.SX.sym(f"at{len(self.instants)}", *expression.shape)
        self.instants.append(Instant(symbol, expression, time))
        return symbol


def derivative_name(name: str, order: int) -> str:
    """`x`, `der(x)`, `der(x,2)`: the name under which a derivative is asked for."""
    if order == 0:
        return name
    return f"der({name})" if order == 1 else f"der({name},{order})"
