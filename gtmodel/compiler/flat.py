"""Flattening: turns a model into named scalar variables, parameters and equations with their origin."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from .._near import meant
from .._pickling import Interned, Portable
from ..lang.bind import ParameterRecord, Tree, bind, element_names
from ..lang.builder import Builder
from ..lang.connect import Branch, Connection, Energy, JointConstraint, Loops, TreeEdge, flatten_items
from ..lang.declarations import Declaration
from ..lang.events import When
from ..lang.expression import Relation
from ..lang.model import Model
from ..lang.scope import Scope, derivative_name
from ..lang.slips import each_of, line_of, persons_code
from ..lang.source import ModelError, SourceLocation, of_frame
from ..lang.units import rate_unit
from .analysis.events import FlatEvents, collect_events
from .connections import connection_equations
from .matrices import stacked
from .trees import LoopCut, cuts_of

_DER = re.compile(r"^der\((?P<inner>.+?)(?:,\s*(?P<order>\d+))?\)$")


@dataclass(frozen=True)
class FlatVariable:
    """One scalar variable with its attributes. Values in SI units."""

    name: str
    index: int
    role: str
    unit: str | None
    component: str
    where: SourceLocation
    description: str
    nominal: float = 1.0
    min: float = -np.inf
    max: float = np.inf
    start: float | None = None
    fixed: bool = False
    prefer: int = 0


@dataclass(frozen=True)
class FlatParameter:
    """One scalar parameter; its value is NaN if it is not set."""

    name: str
    symbol: ca.SX
    value: float
    unit: str | None
    nonzero: bool
    where: SourceLocation
    free: bool = False
    min: float = -np.inf
    max: float = np.inf


@dataclass(frozen=True)
class FlatEquation:
    """One scalar equation residual == 0, with its component, file and line."""

    residual: ca.SX
    label: str
    component: str
    where: SourceLocation


@dataclass(frozen=True)
class FlatBranch:
    """A named geometric branch: the sign of an expression distinguishes two solutions."""

    name: str
    expression: ca.SX
    where: SourceLocation


@dataclass(frozen=True)
class FlatEnergy:
    """A term of the energy balance: stored [J], supplied [W] or dissipated [W]."""

    kind: str
    component: str
    expression: ca.SX


@dataclass(frozen=True, eq=False)
class FlatConstraint:
    """A constraint of a joint that closes a loop: the number of its equation, its reaction, and what it fixes."""

    equation: int
    reaction: ca.SX
    item: JointConstraint


@dataclass(frozen=True, eq=False)
class FlatClosing:
    """A component that closes a loop by constraints; `cut` is the loop, None for a component that always does so."""

    component: Model
    constraints: list[FlatConstraint]
    cut: LoopCut | None


@dataclass(frozen=True, eq=False)
class FlatLoops:
    """The closings of a model, the user's words on them, all edges of components, and the constraints that were dropped
    as redundant.

    `floating` are components of links whose orientation no joint and no body determines, `loose` those whose reactions
    depend on the choice of constraints; `notes` say both. `mobility` counts the degrees of freedom of the assembled
    mechanism; it is None before the loops are settled.
    """

    closings: list[FlatClosing]
    words: list[Loops]
    edges: list[TreeEdge] = field(default_factory=list)
    floating: list[Model] = field(default_factory=list)
    dropped: list[FlatEquation] = field(default_factory=list)
    mobility: int | None = None
    loose: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()

    @property
    def drop(self) -> bool:
        """Whether the user has redundant constraints dropped."""
        return any(w.drop for w in self.words)


@dataclass
class FlatModel(Interned):
    """The flat system. `groups` maps every declared name to its shape and scalar variable indices; `rotations` are the
    names of those declared as rotation matrices. `source`: the model before its known rotations were rewritten."""

    scope: Scope
    title: str
    variables: list[FlatVariable]
    parameters: list[FlatParameter]
    equations: list[FlatEquation]
    branches: list[FlatBranch]
    groups: dict[str, tuple[tuple[int, ...], list[int]]]
    bindings: dict[str, ca.SX]
    tree: Tree = field(repr=False)
    initial: list[FlatEquation] = field(default_factory=list)
    positive: frozenset[str] = frozenset()
    energies: list[FlatEnergy] = field(default_factory=list)
    events: FlatEvents | None = None
    loops: FlatLoops = field(default_factory=lambda: FlatLoops([], []))
    rotations: frozenset[str] = frozenset()
    source: FlatModel | None = None
    cache: dict[Any, Any] = field(default_factory=dict, repr=False)
    # the function and the arguments that made this model, for pickling; None if only its content describes it
    made: tuple[Any, tuple[Any, ...]] | None = field(default=None, init=False, repr=False, compare=False)

    def _recipe(self, pickler: Any) -> tuple[Any, ...]:
        if self.made is not None:
            return self.made
        pickler.inside = self.scope
        return Portable._reduced(self, pickler)

    def _reduced(self, pickler: Any) -> tuple[Any, ...]:
        if pickler.root is not self and self.scope.is_owned:
            pickler.link(self.scope)
        return (Interned if self._is_interned() else Portable)._reduced(self, pickler)

    def __reduce_ex__(self, protocol: Any) -> tuple[Any, ...]:
        return (Interned if self._is_interned() else Portable).__reduce_ex__(self, protocol)

    def _symbols_from(self) -> Any:
        return self.scope.source

    def _is_interned(self) -> bool:
        return self.made is not None or self.scope.source is self

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "cache": {}}

    def unit_of(self, index: int, order: int) -> str:
        """Return the unit of a variable's derivative, "?" if the variable has no unit."""
        unit = self.variables[index].unit
        if unit is None or order == 0:
            return unit or "?"
        return rate_unit(unit, order)

    def level(self, index: int) -> int:
        """Return the level of the component that declares a variable; 0 for the model itself and for Modelica text."""
        component = self.variables[index].component
        return component.count(".") + 1 if component else 0

    @property
    def root(self) -> Model:
        """The bound model."""
        return self.tree.root

    @cached_property
    def p(self) -> ca.SX:
        """All parameter symbols as one column."""
        return stacked([q.symbol for q in self.parameters])

    @property
    def p0(self) -> np.ndarray:
        """Parameter values (k,), NaN where missing."""
        return np.array([q.value for q in self.parameters])

    def require_values(self) -> np.ndarray:
        """Return the parameter values. Raises ModelError that names the first parameter without a value."""
        values = self.p0
        for n in np.flatnonzero(~np.isfinite(values)).tolist():
            q = self.parameters[n]
            # for a parameter that gtmodel declares, such as a sampled block's period, the caller's line matters
            where = None if q.where is None or q.where.file.startswith("<") else q.where
            raise ModelError(f"parameter '{q.name}' of {self.title} has no value; set it", where)
        return values

    def lookup(self, name: str) -> tuple[tuple[int, ...], list[int], int]:
        """Return shape, scalar indices and derivative order of a name such as `T`, `T[0]`, `der(q)`, `der(q,2)`."""
        order = 0
        inner = name.strip()
        while (m := _DER.match(inner)) is not None:
            order += int(m["order"] or 1)
            inner = m["inner"].strip()
        if inner in self.groups:
            shape, indices = self.groups[inner]
            return shape, indices, order
        for v in self.variables:
            if v.name == inner:
                return (), [v.index], order
        names = list(dict.fromkeys([*self.groups, *(v.name for v in self.variables)]))
        hint = meant(inner, names, f"top-level names are {self.top()}", most=3)
        if inner in self.bindings:
            hint = "it is a parameter, whose value is set when the model is created"
        raise ModelError(f"{self.title} has no variable '{inner}'; {hint}")

    def top(self) -> str:
        """Return the names declared at the top level, for messages."""
        return ", ".join(n for n in self.groups if "." not in n) or "none"

    def symbol_name(self, index: int, order: int) -> str:
        return derivative_name(self.variables[index].name, order)


def flatten(model: Model | Builder) -> FlatModel:
    """Flatten a configured model or a Builder.

    Raises ModelError, with file and line, for items that are not equations, trivial equations, wrong shapes or units,
    and wrong connections.
    """
    tree = model.tree if isinstance(model, Builder) else bind(model)
    equations: list[FlatEquation] = []
    initial: list[FlatEquation] = []
    branches: list[FlatBranch] = []
    energies: list[FlatEnergy] = []
    connections: list[tuple[Connection, Model]] = []
    whens: list[tuple[When, Model]] = []
    items_of = {id(c): list(_items(c, "equations")) for c in tree.components}
    every = [(item, c) for c in tree.components for item, _ in items_of[id(c)]]
    words = [item for item, _ in every if isinstance(item, Loops)]
    edges = [(item, c) for item, c in every if isinstance(item, TreeEdge)]
    loop_cuts, backwards, floating = cuts_of([item for item, _ in every if isinstance(item, Connection)], edges, words)
    cuts = {id(cut.component): cut for cut in loop_cuts}
    closings: list[FlatClosing] = []
    for component in tree.components:
        path = component._path
        count = at_start = 0
        cut = cuts.get(id(component))
        constraints: list[FlatConstraint] = []
        for item, where in items_of[id(component)] if cut is None else _closing_items(cut):
            if isinstance(item, (Relation, JointConstraint)):
                relation = item.relation if isinstance(item, JointConstraint) else item
                if isinstance(item, JointConstraint):
                    constraints.append(FlatConstraint(len(equations), item.reaction.sx, item))
                for residual in _scalars(relation, path, tree.scope):
                    count += 1
                    equations.append(FlatEquation(residual, _label(path, count, component), path, relation.where))
            elif isinstance(item, Connection):
                connections.append((item, component))
            elif isinstance(item, Branch):
                name = f"{path}.{item.name}" if path else item.name
                branches.append(FlatBranch(name, item.expression.sx, item.where))
            elif isinstance(item, When):
                whens.append((item, component))
            elif isinstance(item, Energy):
                energies.append(FlatEnergy(item.kind, path, item.expression.sx))
            elif isinstance(item, TreeEdge):
                relation = None if item.either is None else item.either[id(item) in backwards]
                for residual in () if relation is None else _scalars(relation, path, tree.scope):
                    count += 1
                    equations.append(FlatEquation(residual, _label(path, count, component), path, item.where))
            elif not isinstance(item, Loops):
                raise _no_equation(item, component, "equations", where)
        if constraints:
            closings.append(FlatClosing(component, constraints, cut))
        for item, where in _items(component, "initial_equations"):
            if not isinstance(item, Relation) or item.op != "==":
                raise _no_equation(item, component, "initial_equations", where)
            for residual in _scalars(item, path, tree.scope):
                at_start += 1
                label = f"{_label(path, at_start, component)} (initial)"
                initial.append(FlatEquation(residual, label, path, item.where))
    for residual, label, path, where in connection_equations(tree, connections):
        equations.append(FlatEquation(residual, label, path, where))
    parameters = _parameters(tree)
    positive = _flagged(tree, "positive")
    flat = FlatModel(
        scope=tree.scope,
        title=model.title if isinstance(model, Builder) else type(model).__name__,
        variables=variables_of(tree),
        parameters=parameters,
        equations=equations,
        branches=branches,
        groups={r.name: (r.item.shape, r.indices) for r in tree.variables},
        bindings={r.name: r.expression for r in tree.parameters},
        tree=tree,
        initial=initial,
        energies=energies,
        events=collect_events(tree, whens, equations),
        rotations=frozenset(r.name for r in tree.variables if r.item.kind == "rotation"),
        positive=frozenset(q.name for q in parameters if q.symbol.element_hash() in positive),
        loops=FlatLoops(closings, words, [e for e, _ in edges], floating),
    )
    flat.made = flatten, (model,)
    if isinstance(model, Model):
        tree.scope.belong(flat)
    return flat


def _label(path: str, count: int, component: Model) -> str:
    return f"{path or type(component).__name__} equation {count}"


def _items(component: Model, method: str) -> Iterable[tuple[Any, SourceLocation | None]]:
    """Yield the items of a component's generator with the line of its current yield."""
    title = f"{method}() of {type(component).__name__}"
    function = getattr(type(component), method)
    with persons_code(title, function):
        source = getattr(component, method)()
    if source is None or isinstance(source, (Relation, Connection, Branch, When)):
        result = "nothing" if source is None else f"one {type(source).__name__.lower()}"
        raise ModelError(f"{title} returned {result}; write 'yield' in front of each equation", line_of(function))
    for item in each_of(source, title):
        frame = getattr(source, "gi_frame", None)
        where = of_frame(frame.f_code.co_filename, frame.f_lineno) if frame is not None else None
        for single in flatten_items(item):
            yield single, where


def _closing_items(cut: LoopCut) -> Iterable[tuple[Any, SourceLocation | None]]:
    """Yield the items with which a joint closes a loop."""
    assert cut.edge.closing is not None
    for item in cut.edge.closing():
        for single in flatten_items(item):
            yield single, cut.edge.where


def _no_equation(item: Any, component: Model, method: str, where: SourceLocation | None) -> ModelError:
    text = item if isinstance(item, (bool, int, float, str)) else type(item).__name__
    return ModelError(
        f"{type(component).__name__}.{method}() yielded {text}, which is not an equation; expected 'a == b' with "
        "expressions of the model, gt.connect, gt.branch or gt.when",
        where,
    )


def _scalars(item: Relation, path: str, scope: Scope) -> Iterable[ca.SX]:
    """Yield the scalar residuals of a relation, row by row. Raises ModelError for a trivial one."""
    if item.op != "==":
        raise ModelError(
            f"a relation with '{item.op}' is not an equation; put inequalities into constraints()", item.where
        )
    residual = item.residual
    if scope.instants and ca.depends_on(residual, ca.vertcat(*[ca.vec(i.symbol) for i in scope.instants])):
        raise ModelError(
            ".at() can be used only in objective() and constraints() of an Optimization: an equation holds at every "
            "time; for a start value use initial_equations() or start=...",
            item.where,
        )
    for k in range(residual.numel()):
        r = residual[k]
        if not scope.symbols_in(r):
            fault = "is always true" if r.is_zero() else f"has no variable ({r} == 0)"
            raise ModelError(f"an equation of '{path or 'the model'}' {fault}; remove or correct it", item.where)
        yield r


def _numbers(sx: ca.SX | None, n: int, default: float, symbols: ca.SX, values: np.ndarray) -> np.ndarray:
    """Return numeric attribute values for given parameter values."""
    if sx is None:
        return np.full(n, default)
    if sx.is_constant():
        return np.asarray(ca.evalf(sx)).reshape(-1)
    f = ca.Function("attribute", [symbols], [sx])
    return np.asarray(f(values)).reshape(-1)


def variables_of(tree: Tree) -> list[FlatVariable]:
    """Return all scalar variables of a tree with the values of their attributes."""
    result: list[FlatVariable] = []
    values = np.full(len(tree.scope.parameters), np.nan)
    for r in tree.parameters:
        if r.values is not None:
            values[r.indices] = r.values
    parameters = stacked(tree.scope.parameters), values
    for r in tree.variables:
        a = r.attributes
        n = len(r.indices)
        nominal = _numbers(a["nominal"], n, 1.0, *parameters)
        low = _numbers(a["min"], n, -np.inf, *parameters)
        high = _numbers(a["max"], n, np.inf, *parameters)
        # a fixed variable without a start value starts at 0, as in Modelica
        start = None if a["start"] is None and not a["fixed"] else _numbers(a["start"], n, 0.0, *parameters)
        for k, (index, name) in enumerate(zip(r.indices, element_names(r.name, r.item.shape), strict=True)):
            if low[k] > high[k]:
                raise ModelError(
                    f"'{name}' has min {low[k]:g} above max {high[k]:g}; correct one of them", r.item.where
                )
            result.append(
                FlatVariable(
                    name, index, r.item.role, r.item.unit, r.component, r.item.where, r.item.description,
                    float(nominal[k]), float(low[k]), float(high[k]),
                    None if start is None else float(start[k]), bool(a["fixed"]), int(a["prefer"]),
                )
            )  # fmt: skip
    return sorted(result, key=lambda v: v.index)


def _parameters(tree: Tree) -> list[FlatParameter]:
    nonzero = _flagged(tree, "nonzero")
    result = []
    for r in tree.parameters:
        for k, index in enumerate(r.indices):
            symbol = tree.scope.parameters[index]
            result.append(
                FlatParameter(
                    tree.scope.parameter_names[index],
                    symbol,
                    float(r.values[k]) if r.values is not None else np.nan,
                    r.item.unit,
                    symbol.element_hash() in nonzero,
                    r.item.where,
                    not hasattr(r.item, "nonzero"),
                    *_limits(r, k),
                )
            )
    return result


def _flagged(tree: Tree, flag: str) -> set[int]:
    """Return the parameter symbols declared positive or nonzero, also by a part's parameter bound to them."""
    symbols = set()
    for r in tree.parameters:
        if getattr(r.item, flag, False):
            symbols |= {s.element_hash() for s in ca.vertsplit(r.expression) if s.is_symbolic()}
    return symbols


def _limits(r: ParameterRecord, k: int) -> tuple[float, float]:
    def limit(value: Any, default: float) -> float:
        if value is None or isinstance(value, Declaration):  # a bound by another parameter is not a number
            return default
        return float(np.broadcast_to(np.asarray(value, float), r.shape).reshape(-1)[k])

    return limit(r.item.low, -np.inf), limit(r.item.high, np.inf)
