"""What a predictive controller is about: equations, squares of the cost, and limits, as expressions of one instant.

The equations come from a model and its causality, as those of an optimisation do (optimize/formulation). The input v of
a stage is that of the model (explicit form), or the highest derivatives of the states (inverse form), from which the
inputs of the model follow. A disturbance d adds to it: the model moves with w = v + d.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..compiler.causal import flat_of
from ..compiler.flat import FlatModel
from ..lang.expression import Expr
from ..lang.model import Model
from ..lang.optimization import Optimization, integral
from ..lang.source import ModelError
from ..optimize.formulation.dynamic import DynamicProblem
from ..optimize.formulation.horizon import declared_name, start_of
from ..optimize.formulation.problem import build
from ..results.agreement import described
from ..results.refusal import ArgumentError
from .options import Measurement, numbers

SX = ca.SX


@dataclass(frozen=True)
class NamedVariable:
    """A variable of the model, with its scalar entries side by side."""

    name: str
    size: int
    unit: str


@dataclass(frozen=True, eq=False)
class LimitedQuantity(Portable):
    """low <= value <= high, an expression of (x, v, w, p); `soft`: no input of the stage is in it."""

    name: str
    value: Any
    low: float
    high: float
    size: float
    soft: bool


@dataclass(frozen=True, eq=False)
class Statement(Portable):
    """Expressions in the state x, the input v, the disturbance d, and the references p.

    rates: of x, in (x, w, p). residuals: the cost is the integral of their squares, in (x, w, p, hold); `hold`: inputs
    of the model that hold the targets. end: residuals at the end, in (x, p). forces: inputs of the model, in (x, w).
    measured: in x. outputs: in (x, w). w stands for v + d.
    """

    causality: str
    x: Any
    v: Any
    w: Any
    p: Any
    hold: Any
    rates: Any
    residuals: Any
    end: Any
    forces: Any
    measured: Any
    outputs: Any
    rows: list[LimitedQuantity]
    force_low: np.ndarray
    force_high: np.ndarray
    states: list[NamedVariable]
    inputs: list[NamedVariable]
    references: list[NamedVariable]
    sensors: list[NamedVariable]
    shown: list[NamedVariable]
    targets: np.ndarray
    start: np.ndarray


@dataclass(frozen=True, eq=False)
class Wishes:
    """What a person says: see `controller`."""

    tolerances: Mapping[str, Any]
    targets: Mapping[str, Any]
    references: Sequence[str]
    measured: Mapping[str, Measurement]
    limits: Mapping[str, Any]
    outputs: Sequence[str]
    prefer: Sequence[str]
    branches: Mapping[str, int]


class Reader:
    """A model with what is asked of it, for several causalities."""

    def __init__(self, model: Model, wishes: Wishes) -> None:
        self.wishes, self.stated = wishes, isinstance(model, Optimization)
        cls: Any = type(model)
        bases = (cls,) if self.stated else (cls, Optimization)
        self.places: dict[str, tuple[int, int]] = {}  # variable -> first entry and size
        self.marks: list[Any] = []
        self._entries: list[Any] = []

        def objective(root: Any) -> Any:
            total = cls.objective(root) if self.stated else None
            # integrals without weight: the plan then computes their integrands
            self.marks = [integral(Expr(e, (), None, self.flat.scope)) for e in self._entries]
            return 0.0 * self.marks[0] if total is None else total

        self.model = type(cls.__name__, bases, {"objective": objective})(**model._modifiers)
        self.flat = flat_of(self.model)
        for argument in ("references", "outputs"):
            names = getattr(wishes, argument)
            if twice := [name for name in names if names.count(name) > 1]:
                raise ArgumentError(f"'{twice[0]}' stands there twice; name it once", argument)
        self.sensors = self._signals(wishes.measured, "measured")
        self.shown = self._signals(wishes.outputs, "outputs")
        self.tracked = self._signals(wishes.tolerances, "tolerances")
        self.limited = self._signals(wishes.limits, "limits")
        for argument in ("tolerances", "targets"):
            if self.stated and getattr(wishes, argument):
                raise ArgumentError("an Optimization states its own cost; leave it out", argument)
        if unknown := [name for name in wishes.targets if name not in wishes.tolerances]:
            raise ArgumentError(f"'{unknown[0]}' has no tolerance; give it one", "targets")
        if not self.stated and not self.tracked:
            raise ArgumentError("expected at least one name with a tolerance, or an Optimization", "tolerances")
        self.tunable = self._tunable()

    def _signals(self, names: Any, argument: str) -> list[NamedVariable]:
        """Variables by name, whose entries the plan must then compute."""
        entries = []
        for name in names:
            try:
                _, indices, order = self.flat.lookup(name)
            except ModelError as error:
                raise ArgumentError(str(error), argument) from None
            if name not in self.places:
                self.places[name] = len(self._entries), len(indices)
                self._entries += [self.flat.scope.symbol(i, order) for i in indices]
            entries.append(NamedVariable(name, len(indices), _unit(self.flat, indices[0], order)))
        return entries

    def _tunable(self) -> list[str]:
        """Parameters of an Optimization that are references."""
        if not self.stated:
            return []
        names = []
        for name in self.wishes.references:
            own = [q.name for q in self.flat.parameters if q.name == name or q.name.startswith(f"{name}[")]
            if not own:
                known = ", ".join(sorted({q.name.split("[")[0] for q in self.flat.parameters})) or "none"
                raise ArgumentError(f"there is no parameter '{name}'; the parameters are {known}", "references")
            names += own
        return names

    def read(self, causality: str) -> Statement:
        """Return the statement in one causality. Raises ModelError if the model has none."""
        problem = build(
            self.model, causality, tuple(self.wishes.prefer), self.wishes.branches, tuple(self.tunable), linked=True
        )
        _refuse(problem)
        return _Assembly(self, problem).statement()

    def values(self, name: str, at: Mapping[str, Any], argument: str, size: int) -> np.ndarray:
        """Numbers of a name, one for each entry."""
        array = numbers(at[name], f"{argument}.{name}")
        if array.size not in (1, size) or not np.all(np.isfinite(array)):
            raise ArgumentError(
                f"expected finite numbers, 1 or {size}; found {at[name]!r}"
                if size > 1
                else f"expected a finite number; found {at[name]!r}",
                f"{argument}.{name}",
            )
        return np.broadcast_to(array.ravel(), (size,)).copy()


_PER_SECONDS = re.compile(r"(?P<unit>.+)/s(?P<order>\d*)")


def _unit(flat: FlatModel, index: int, order: int) -> str:
    """Unit of a derivative of a variable; "?" if it has none."""
    unit = flat.variables[index].unit
    if not unit or not order:
        return unit or "?"
    if already := _PER_SECONDS.fullmatch(unit):
        unit, order = already["unit"], order + int(already["order"] or 1)
    return f"{unit}/s{order if order > 1 else ''}"


def _refuse(problem: DynamicProblem) -> None:
    title = problem.flat.title
    if not problem.state_pairs:
        raise ModelError(f"{title}: it has no state, so there is nothing to plan; use `causal`")
    if problem.z_pairs or problem.delayed_indices:
        raise ModelError(f"{title}: its equations have no closed form; a predictive controller needs one")
    if problem.free_names:
        raise ModelError(f"{title}: a free constant such as {problem.free_names[0]} is not part of a controller")
    along = {f"at the start: {r.label}" for r in problem.path}  # the first stage has these rows
    if points := [r for r in problem.points if r.label not in along]:
        raise ModelError(f"{title}: {points[0].label} holds at one instant; a horizon that moves has none")
    if np.any(np.isfinite([problem.end_bounds.low, problem.end_bounds.high])):
        raise ModelError(f"{title}: a state is prescribed at one instant, the end; a horizon that moves has none")
    if problem.misfits:
        raise ModelError(f"{title}: gt.misfit is not part of a controller")
    controls = len(problem.control_indices) if problem.formulation == "inverse" else 0
    if problem.algebraic.numel() > controls:
        raise ModelError(
            f"{title}: {problem.algebraic_labels[controls]} is a condition on the inputs; solve it for one"
        )
    expressions = [
        *[r for r in problem.rates if r is not None],
        problem.algebraic,
        *[r.expression for r in problem.path],
    ]
    if any(ca.depends_on(SX(e), problem.t) for e in [*expressions, *[e for _, e, _ in problem.integrals]]):
        raise ModelError(f"{title}: the equations or the cost depend on time; give what changes as a reference")


class _Assembly:
    def __init__(self, reader: Reader, problem: DynamicProblem) -> None:
        self.reader, self.problem = reader, problem
        m = len(problem.control_indices)
        tops = [k for k, r in enumerate(problem.rates) if r is None]
        self.inverse = problem.formulation == "inverse"
        size = len(tops) if self.inverse else m
        if size == 0:
            raise ModelError(f"{problem.flat.title}: there is no input to decide on; declare one with gt.input")
        self.x, self.w, self.v = problem.x, SX.sym("w", size), SX.sym("v", size)
        self.tops = problem.xd[tops] if self.inverse else SX(0, 1)
        # inputs of the model, by the motion
        self.computed = -ca.substitute(problem.algebraic, problem.u, SX.zeros(m)) if self.inverse else problem.u
        self.names = [problem.flat.variables[i].name for i in problem.control_indices]

    def moved(self, expressions: Sequence[Any], commanded: bool) -> list[Any]:
        """Replace the model's inputs and rates by the input of the stage; `commanded`: the model's inputs without the
        disturbance."""
        columns = [ca.vec(SX(e)) for e in expressions]
        if not columns:
            return []
        column = ca.vertcat(*columns)
        own = self.v if commanded else self.w
        if self.inverse:
            forces = ca.substitute(self.computed, self.tops, own)
            column = ca.substitute(column, ca.vertcat(self.problem.u, self.tops), ca.vertcat(forces, self.w))
        else:
            column = ca.substitute(column, self.problem.u, own)
        ends = np.cumsum([0, *[c.numel() for c in columns]]).tolist()
        return [column[a:b] for a, b in pairwise(ends)]

    def statement(self) -> Statement:
        reader, problem = self.reader, self.problem
        wishes, flat = reader.wishes, problem.flat
        by_mark = {s.element_hash(): e for s, e, _ in problem.integrals}
        entries = [by_mark[mark.sx.element_hash()] for mark in reader.marks]
        at = {name: entries[a : a + size] for name, (a, size) in reader.places.items()}
        rates = [self.tops[[k for k, r in enumerate(problem.rates) if r is None].index(k)] if r is None else r
                 for k, r in enumerate(problem.rates)]  # fmt: skip
        hold = SX.sym("hold", len(self.names))
        if reader.stated:
            p, references = problem.P, self._of_parameters()
            targets = problem.P_guess.copy()
            residuals = [r for s, e, weight in problem.integrals if weight for r in squares(weight * e, flat)]
            end = self._mayer()
        else:
            p, references, targets, residuals = self._of_tolerances(at, hold)
            end = []
        start = np.array([start_of(flat, problem.base.alias, pair) for pair in problem.state_pairs])
        low, high = problem.u_bounds.low[: len(self.names)].copy(), problem.u_bounds.high[: len(self.names)].copy()
        rows = self._declared_rows()
        for signal in reader.limited:
            pairs = numbers(wishes.limits[signal.name], f"limits.{signal.name}")
            if pairs.shape not in ((2,), (signal.size, 2)) or np.any(np.isnan(pairs)):
                several = f", or {signal.size} such pairs" if signal.size > 1 else ""
                raise ArgumentError(f"expected [low, high]{several}; found {described(wishes.limits[signal.name])}",
                                    f"limits.{signal.name}")  # fmt: skip
            for k, (a, b) in enumerate(np.broadcast_to(pairs, (signal.size, 2)).tolist()):
                name = signal.name if signal.size == 1 else f"{signal.name}[{k}]"
                if not a < b:
                    raise ArgumentError(f"expected a low limit below the high one; found {a:g} and {b:g}",
                                        f"limits.{signal.name}")  # fmt: skip
                if math.isinf(a) and math.isinf(b):
                    raise ArgumentError("expected a finite low or high limit", f"limits.{signal.name}")
                if name in self.names:
                    i = self.names.index(name)
                    if not max(low[i], a) < min(high[i], b):
                        raise ArgumentError(
                            f"expected limits that leave room within {low[i]:g} to {high[i]:g} of the model; found "
                            f"{a:g} and {b:g}", f"limits.{signal.name}",
                        )  # fmt: skip
                    low[i], high[i] = max(low[i], a), min(high[i], b)
                else:
                    rows.append((name, at[signal.name][k], a, b, size_of(a, b)))
        rows += [(self.names[i], problem.u[i], low[i], high[i], size_of(low[i], high[i]))
                 for i in range(len(self.names)) if np.isfinite(low[i]) or np.isfinite(high[i])]  # fmt: skip
        for name, _, a, b, _ in rows:
            if not a < b:
                raise ModelError(
                    f"{flat.title}: {name} has no room between its limits {a:g} and {b:g}; a predictive controller "
                    "needs a low limit below the high one"
                )
        commanded = self.moved([e for _, e, *_ in rows], True)
        limited = [
            LimitedQuantity(name, e, a, b, size, not ca.depends_on(e, ca.vertcat(self.v, self.w)))
            for (name, _, a, b, size), e in zip(rows, commanded, strict=True)
        ]
        measured = ca.vertcat(SX(0, 1), *self.moved([e for s in reader.sensors for e in at[s.name]], False))
        names = [declared_name(flat, problem.base.alias, pair)[0] for pair in problem.state_pairs]
        places = [flat.lookup(name) for name in names]
        states = [NamedVariable(name, 1, _unit(flat, own[0], order))
                  for name, (_, own, order) in zip(names, places, strict=True)]  # fmt: skip
        if ca.depends_on(measured, self.w):
            raise ArgumentError("expected variables that the inputs do not change at once", "measured")
        inputs = self._inputs()
        if own := [k.name for k in inputs if any(s.name.split("[")[0] == k.name for s in reader.shown)]:
            raise ArgumentError(f"'{own[0]}' is an input, which is returned anyway; leave it out", "outputs")
        return Statement(
            causality=problem.formulation, x=self.x, v=self.v, w=self.w, p=p, hold=hold,
            rates=ca.vertcat(*self.moved(rates, False)), residuals=ca.vertcat(SX(0, 1), *self.moved(residuals, False)),
            end=ca.vertcat(SX(0, 1), *self.moved(end, False)),
            forces=ca.substitute(self.computed, self.tops, self.w) if self.inverse else self.w,
            measured=measured,
            outputs=ca.vertcat(SX(0, 1), *self.moved([e for s in reader.shown for e in at[s.name]], False)),
            rows=limited, force_low=low, force_high=high,
            states=states, inputs=inputs, references=references,
            sensors=reader.sensors, shown=reader.shown, targets=targets, start=start,
        )  # fmt: skip

    def _inputs(self) -> list[NamedVariable]:
        """Inputs of the model as declared, vectors in one piece."""
        flat, entries = self.problem.flat, list[NamedVariable]()
        for name, (_, indices) in flat.groups.items():
            if indices and indices[0] in self.problem.control_indices:
                entries.append(NamedVariable(name, len(indices), flat.variables[indices[0]].unit or "?"))
        return entries

    def _of_parameters(self) -> list[NamedVariable]:
        reader, entries = self.reader, list[NamedVariable]()
        for name in reader.wishes.references:
            size = sum(1 for t in reader.tunable if t == name or t.startswith(f"{name}["))
            entries.append(NamedVariable(name, size, "?"))
        return entries

    def _of_tolerances(self, at: Mapping[str, list[Any]], hold: Any) -> tuple[Any, ...]:
        """References, their targets, and residuals (value - reference) / tolerance."""
        reader = self.reader
        wishes, flat = reader.wishes, self.problem.flat
        references, symbols, targets, residuals = list[NamedVariable](), list[Any](), list[float](), list[Any]()
        for name in wishes.references:
            if name not in wishes.tolerances:
                raise ArgumentError(f"'{name}' has no tolerance; give it one", "references")
        for signal in reader.tracked:
            tolerance = reader.values(signal.name, wishes.tolerances, "tolerances", signal.size)
            if not np.all(tolerance > 0):
                raise ArgumentError("expected more than 0", f"tolerances.{signal.name}")
            _, indices, order = flat.lookup(signal.name)
            if signal.name in wishes.targets:
                goal = reader.values(signal.name, wishes.targets, "targets", signal.size)
            elif order == 0 and not set(indices) <= set(self.problem.control_indices):
                raise ArgumentError(f"'{signal.name}' has a tolerance but no target", "targets")
            else:
                goal = np.zeros(signal.size)
            if signal.name in wishes.references:
                symbol = SX.sym(signal.name, signal.size)
                references.append(signal)
                symbols.append(symbol)
                targets += goal.tolist()
            elif order == 0 and set(indices) <= set(self.problem.control_indices) and signal.name not in wishes.targets:
                own = [self.problem.control_indices.index(i) for i in indices]
                symbol = hold[own]
            else:
                symbol = SX(goal)
            residuals += [(e - symbol[k]) / tolerance[k] for k, e in enumerate(at[signal.name])]
        return ca.vertcat(SX(0, 1), *symbols), references, np.array(targets), residuals

    def _declared_rows(self) -> list[tuple[str, Any, float, float, float]]:
        """Bounds of states and path constraints of the model."""
        problem, rows = self.problem, list[tuple[str, Any, float, float, float]]()
        for k, name in enumerate(problem.state_names):
            a, b = problem.x_bounds.low[k], problem.x_bounds.high[k]
            if np.isfinite(a) or np.isfinite(b):
                rows.append((name, problem.x[k], a, b, size_of(a, b)))
        return rows + [(r.label, r.expression, r.low, r.high, r.scale) for r in problem.path]

    def _mayer(self) -> list[Any]:
        """Squares of the end of an objective."""
        problem, cost = self.problem, self.problem.mayer
        for instant in problem.instants:
            if ca.depends_on(cost, instant.symbol):
                if instant.s != 1.0:
                    raise ModelError(f"{problem.flat.title}: a cost at an instant must stand at the end of the horizon")
                cost = ca.substitute(cost, instant.symbol, instant.expression)
        end = squares(cost, problem.flat)
        if ca.depends_on(ca.vertcat(SX(0, 1), *end), ca.vertcat(problem.u, problem.xd)):
            raise ModelError(f"{problem.flat.title}: the cost at the end must not contain an input")
        return end


def size_of(low: float, high: float) -> float:
    """Typical size of a quantity with these limits."""
    ends = [abs(x) for x in (low, high) if math.isfinite(x) and x != 0]
    return max(ends, default=1.0)


def squares(cost: Any, flat: FlatModel) -> list[Any]:
    """Return residuals whose squares add up to a cost, but for a constant. Raises ModelError for another cost.

    >>> import casadi as ca
    >>> from gtmodel.predictive.statement import squares
    >>> x = ca.SX.sym("x", 2)
    >>> squares(4 * x[0]**2 + (x[1] - 1)**2 / 9, None)
    [SX((2*x_0)), SX((0.333333*(x_1-1)))]
    """
    entries: list[Any] = []

    def add(e: Any, factor: float) -> None:
        if e.is_constant():
            return
        op = e.op()
        if op == ca.OP_ADD:
            add(e.dep(0), factor)
            add(e.dep(1), factor)
        elif op == ca.OP_TWICE:
            add(e.dep(0), 2 * factor)
        elif op == ca.OP_SQ and factor >= 0:
            entries.append(math.sqrt(factor) * e.dep(0))
        elif op == ca.OP_MUL and any(e.dep(k).is_constant() for k in (0, 1)):
            k = 0 if e.dep(0).is_constant() else 1
            add(e.dep(1 - k), factor * float(e.dep(k)))
        elif op == ca.OP_DIV and e.dep(1).is_constant():
            add(e.dep(0), factor / float(e.dep(1)))
        else:
            raise ModelError(
                f"{flat.title}: expected a cost that is a sum of squares, such as gt.integral(x**2 + 0.1 * u**2); "
                f"found the term {e}"
            )

    add(SX(cost), 1.0)
    return entries
