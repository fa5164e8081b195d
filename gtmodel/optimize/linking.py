"""The NLP of linked phases: theirs one after the other, and rows that link the end of one to the start of the next."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Protocol

import casadi as ca
import numpy as np

from ..compiler.analysis.switching import differentiated, names_of
from ..compiler.matrices import nonzeros, stacked
from ..lang.expression import Expr
from ..lang.scope import Scope
from ..lang.source import ModelError
from ..lang.units import parse_unit
from .collocation import value_at
from .formulation.horizon import ConstraintRow, relation_rows
from .formulation.scaling import scale_of
from .mesh import is_of
from .nlp import Nlp, functions_of, scatter
from .watch import Program


class PhaseLinks(Protocol):
    """The fields of phases.Phases that describe the links."""

    free: dict[str, tuple[str, ...]]
    links: dict[str, Link]
    shared: tuple[str, ...]


class PhaseEnd:
    """Values of one phase at the instant where two phases meet; attributes and items are expressions.

    The class has no public names, so that none hides a name of the model.
    """

    def __init__(self, take: Callable[[str], Expr], value: Callable[[ca.SX], ca.SX]) -> None:
        self._take, self._value = take, value

    def __getitem__(self, name: str) -> Expr:
        return self._take(name)

    def __getattr__(self, name: str) -> Expr:
        if name.startswith("_"):
            raise AttributeError(name)
        return self[name]


def value_at_end(end: PhaseEnd, expression: ca.SX) -> ca.SX:
    """Return the value, where phases meet, of a scalar of the phase's flat model (variables, parameters, time)."""
    return end._value(expression)


Link = Callable[[PhaseEnd, PhaseEnd], Iterable[Any]]


class Border:
    """The start (place 0.0) or the end (1.0) of a phase: its unknowns there and the expressions used in links."""

    def __init__(self, nlp: Nlp, scope: Scope, place: float) -> None:
        self._nlp, self._scope, self._place = nlp, scope, place
        self._taken: list[tuple[ca.SX, list[ca.SX]]] = []
        layout = nlp.element.layout
        self.y, self.last = ca.SX.sym("y", layout.size), ca.SX.sym("last", layout.nl)
        self.P = ca.SX.sym("P", len(nlp.p_scale))

    def take(self, name: str) -> Expr:
        """Return the value of a name at this end. Raises ModelError for a name unknown to the phase."""
        flat = self._nlp.problem.flat
        shape, indices, order = flat.lookup(name)
        column = self._symbols([flat.scope.symbol(i, order) for i in indices])
        unit = flat.unit_of(indices[0], order)
        dimension = None if unit == "?" else parse_unit(unit).dimension
        matrix = ca.reshape(column, shape[1], shape[0]).T if len(shape) > 1 else column
        return Expr(matrix, shape, dimension, self._scope)

    def value(self, expression: ca.SX) -> ca.SX:
        """Return the value at this end of a scalar in the phase's variables, parameters and time."""
        return self._symbols([expression])

    def _symbols(self, expressions: list[ca.SX]) -> ca.SX:
        column = ca.vertcat(*[ca.SX.sym(f"end{len(self._taken)}_{k}") for k in range(len(expressions))])
        self._taken.append((column, expressions))
        return column

    def values(self) -> tuple[ca.SX, ca.SX]:
        """Return (symbols, values): the symbols taken and their expressions in the unknowns at this end."""
        if not self._taken:
            return ca.SX(0, 1), ca.SX(0, 1)
        problem = self._nlp.problem
        symbols = ca.vertcat(*[c for c, _ in self._taken])
        requested = [e for _, expressions in self._taken for e in expressions]
        expressions = problem.builder.express(requested)
        if not self._nlp.mesh.is_point(self._place):
            between = problem.builder.off_points(requested, expressions)
            expressions = [e if o is None else o for e, o in zip(expressions, between, strict=True)]
        f = ca.Function("end", problem.arguments, [ca.vertcat(*expressions)])
        return symbols, f(*self._point())

    def _point(self) -> tuple[ca.SX, ...]:
        nlp, problem = self._nlp, self._nlp.problem
        mesh, layout, P = nlp.mesh, nlp.element.layout, self.P * ca.DM(nlp.p_scale)
        k = 0 if self._place == 0.0 else mesh.elements - 1
        x, xd, u, t = value_at(problem, mesh, layout, self.y, P, mesh.h[k], mesh.edges[k], self._place)
        if self._place == 1.0:
            x = self.last[: layout.nx] * ca.DM(problem.x_scale)
        return x, xd, u, P, t

    @property
    def unknowns(self) -> tuple[ca.SX, np.ndarray]:
        """Symbols of the unknowns at this end and their indices among the phase's unknowns."""
        nlp = self._nlp
        n, k = nlp.element.layout.size, 0 if self._place == 0.0 else nlp.mesh.elements - 1
        places = [k * n + np.arange(n), nlp.end + np.arange(nlp.element.layout.nl), np.arange(nlp.constants, nlp.size)]
        return ca.vertcat(self.y, self.last, self.P), np.concatenate(places).astype(int)

    def times(self) -> tuple[ca.SX, ca.SX]:
        """Return start and end of this phase's horizon."""
        p = self._nlp.problem
        t0, tf = ca.Function("times", [p.P], [p.t0, p.tf])(self.P * ca.DM(self._nlp.p_scale))
        return t0, tf


@dataclass(eq=False)
class Joined(Program):
    """The NLP of all phases: their unknowns and rows in order, then the linking rows."""

    nlps: dict[str, Nlp]
    links: list[ConstraintRow]
    at: np.ndarray
    rows: np.ndarray
    shared: tuple[str, ...]


def join(model: PhaseLinks, nlps: dict[str, Nlp]) -> Joined:
    sizes, counts = [n.size for n in nlps.values()], [len(n.lbg) for n in nlps.values()]
    offsets, rows = (np.concatenate([[0], np.cumsum(a)]).astype(int) for a in (sizes, counts))
    total = int(offsets[-1])
    symbols, places, links = _links(model, nlps, offsets)
    expression = ca.vertcat(*[r.expression for r in links]) if links else ca.SX(0, 1)
    # only the unknowns that occur, in order
    order = np.argsort(places, kind="stable")
    sorted_symbols = symbols[order.tolist()] if places.size else symbols
    columns = sorted(set(ca.jacobian_sparsity(expression, sorted_symbols).get_triplet()[1]))
    z, index = sorted_symbols[columns], places[order][columns]
    lam = ca.SX.sym("lam", len(links))
    jacobian = ca.jacobian(expression, z)
    hessian = ca.triu(ca.hessian(ca.dot(lam, expression), z)[0])
    value = ca.Function("links", [z], [expression, stacked(nonzeros(jacobian))])
    curvature = ca.Function("links_hessian", [z, lam], [stacked(nonzeros(hessian))])

    X, p = ca.MX.sym("X", total), ca.MX.sym("p", 0)
    parts = [X[int(a) : int(b)] for a, b in pairwise(offsets)]
    zx = X[index.tolist()] if index.size else ca.MX(0, 1)
    each = list(nlps.values())
    evaluated = [n.nlp(x, p) for n, x in zip(each, parts, strict=True)]
    linked, slope = value(zx)
    f, g = sum((v[0] for v in evaluated), ca.MX(0)), ca.vertcat(*[v[1] for v in evaluated], linked)
    jacobians = [n.functions["jac_g"](x, p)[1] for n, x in zip(each, parts, strict=True)]
    r, c = (np.array(a, int) for a in jacobian.sparsity().get_triplet())
    below = scatter(r, index[c] if c.size else c, slope, (len(links), total))
    jac = ca.vertcat(ca.diagcat(*jacobians), below)
    grad = ca.vertcat(*[n.functions["grad_f"](x, p)[1] for n, x in zip(each, parts, strict=True)])
    sigma, lams = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", int(rows[-1]) + len(links))
    split = [lams[int(a) : int(b)] for a, b in pairwise(rows)]
    hess = ca.diagcat(*[n.functions["hess_lag"](x, p, sigma, v) for n, x, v in zip(each, parts, split, strict=True)])
    if hessian.nnz():
        r, c = (np.array(a, int) for a in hessian.sparsity().get_triplet())
        values = curvature(zx, lams[int(rows[-1]) :])
        hess = hess + scatter(index[r], index[c], values, (total, total))
    functions = functions_of(X, p, sigma, lams, f, g, grad, jac, hess)
    nlp = ca.Function("nlp", [X, p], [f, g], ["x", "p"], ["f", "g"])
    low = np.concatenate([*[n.lbg for n in each], [r.low for r in links]])
    high = np.concatenate([*[n.ubg for n in each], [r.high for r in links]])
    lbx, ubx = np.concatenate([n.lbx for n in each]), np.concatenate([n.ubx for n in each])
    return Joined(functions, nlp, lbx, ubx, low, high, nlps, links, offsets, rows, model.shared)


def _links(
    model: PhaseLinks, nlps: dict[str, Nlp], offsets: np.ndarray
) -> tuple[ca.SX, np.ndarray, list[ConstraintRow]]:
    """Return symbols of the unknowns at all ends, their indices, and the linking rows."""
    symbols: list[ca.SX] = []
    places: list[np.ndarray] = []
    rows: list[ConstraintRow] = []
    names = list(nlps)
    ends: dict[str, list[Border]] = {n: [] for n in names}
    for k, (first, second) in enumerate(pairwise(names)):
        scope = Scope()
        before, after = Border(nlps[first], scope, 1.0), Border(nlps[second], scope, 0.0)
        ends[first].append(before)
        ends[second].append(after)
        ends_here = PhaseEnd(before.take, before.value), PhaseEnd(after.take, after.value)
        relations = _relations_of(model.links[second], second, *ends_here) if second in model.links else []
        link_rows = relation_rows(relations, f"the link to '{second}'", f"link to '{second}'")
        link_rows += _continuity(model, nlps[first], nlps[second], second, before, after)
        old, new = (ca.vertcat(*v) for v in zip(before.values(), after.values(), strict=True))
        for row in link_rows:
            e = ca.substitute([row.expression], [old], [new])[0] if old.numel() else row.expression
            rows.append(_sized(replace(row, expression=e)))
        (_, tf), (start, _) = before.times(), after.times()
        if not nlps[second].problem.t0.is_constant():
            rows.append(ConstraintRow(start - tf, 0.0, 0.0, f"'{second}' begins when '{first}' ends", None))
        for end, offset in ((before, offsets[k]), (after, offsets[k + 1])):
            s, p = end.unknowns
            symbols.append(s)
            places.append(p + offset)
    rows += _shared(model, nlps, ends)
    # one symbol for each unknown: a phase in the middle has two ends
    column, positions = ca.vertcat(*symbols), np.concatenate(places).astype(int)
    used, first_position, inverse = np.unique(positions, return_index=True, return_inverse=True)
    unique_symbols = column[first_position.tolist()]
    if len(used) < len(positions) and rows:
        expressions = ca.substitute([r.expression for r in rows], [column], [unique_symbols[inverse.tolist()]])
        rows = [replace(r, expression=e) for e, r in zip(expressions, rows, strict=True)]
    return unique_symbols, used, rows


def _relations_of(link: Link, name: str, before: PhaseEnd, after: PhaseEnd) -> list[Any]:
    """Return the relations of a link. Raises ModelError if it does not return an iterable."""
    links: Any = link(before, after)
    if not isinstance(links, Iterable):
        what = "nothing" if links is None else f"one {type(links).__name__}"
        raise ModelError(f"the link to '{name}' returned {what}; expected a list of relations")
    return list(links)


def _sized(row: ConstraintRow) -> ConstraintRow:
    """Scale a row whose derivatives by the scaled unknowns are small; continuity rows are already scaled."""
    unknowns = ca.vertcat(*ca.symvar(row.expression))
    if row.scale != 1.0 or not unknowns.numel():
        return row
    jacobian = np.abs(
        ca.Function("derivatives", [unknowns], [ca.densify(ca.gradient(row.expression, unknowns))])(1.0).full()
    )
    scale = scale_of(float(np.max(np.where(np.isfinite(jacobian), jacobian, 0.0))))
    return replace(row, expression=row.expression / scale, low=row.low / scale, high=row.high / scale, scale=scale)


def _continuity(
    model: PhaseLinks, first: Nlp, second: Nlp, name: str, before: Border, after: Border
) -> list[ConstraintRow]:
    """Return continuity rows for states of the later phase that exist under the same name in the earlier one."""
    flat, alias = second.problem.flat, second.problem.base.alias
    states = second.problem.state_pairs
    jump: set[tuple[int, int]] = set()
    for free in model.free.get(name, ()):
        _, indices, order = flat.lookup(free)
        pairs = {alias.resolve(i, order)[1:] for i in indices}
        if not pairs & set(states):
            names = ", ".join(flat.symbol_name(*p) for p in states)
            raise ModelError(f"'{free}' may jump into phase '{name}', but is not a state there; states are {names}")
        jump |= pairs
    aliases = continuing(first, second)
    rows = []
    for n, pair in enumerate(states):
        if pair in jump or pair not in aliases:
            continue
        name_there = flat.symbol_name(*aliases[pair])
        scale = float(second.problem.x_scale[n])
        difference = (after.take(name_there).sx - before.take(name_there).sx) / scale
        label = f"{name_there} continues into '{name}'"
        rows.append(ConstraintRow(difference, 0.0, 0.0, label, flat.variables[aliases[pair][0]].where, scale))
    return rows


def continuing(first: Nlp, second: Nlp) -> dict[tuple[int, int], tuple[int, int]]:
    """Return, for each state of the later phase that continues, the variable under whose name it does.

    An alias that is differentiated in the earlier phase is preferred, then one differentiated in the later phase, then
    the state's own name.
    """
    before, flat, alias = first.problem.flat, second.problem.flat, second.problem.base.alias
    index = {v.name: v.index for v in flat.variables}
    continuous = [(before.variables[i].name, k) for i, k in differentiated(before)]
    known = {v.name for v in before.variables}
    before_names = names_of([(index[name], k) for name, k in continuous if name in index], alias)
    after_names = names_of([pair for pair in differentiated(flat) if flat.variables[pair[0]].name in known], alias)
    aliases: dict[tuple[int, int], tuple[int, int]] = {}
    for pair in second.problem.state_pairs:
        names = [*before_names.get(pair, ()), *after_names.get(pair, ())]
        if names or flat.variables[pair[0]].name in known:
            aliases[pair] = [*names, pair][0]
    return aliases


def _shared(model: PhaseLinks, nlps: dict[str, Nlp], ends: dict[str, list[Border]]) -> list[ConstraintRow]:
    """Return rows that equate shared free constants of neighbouring phases."""
    rows = []
    for name in model.shared:
        owners = [(k, n) for k, n in nlps.items() if any(is_of(name, f) for f in n.problem.free_names)]
        if len(owners) < 2:
            raise ModelError(f"'{name}' is shared, but only {len(owners)} of the phases declare it as a free constant")
        for (a, first), (b, second) in pairwise(owners):
            for i, element in enumerate(first.problem.free_names):
                if is_of(name, element):
                    j = second.problem.free_names.index(element)
                    p = ca.SX(ends[a][0].P[i] * first.p_scale[i] - ends[b][0].P[j] * second.p_scale[j])
                    rows.append(ConstraintRow(p, 0.0, 0.0, f"{element} of '{a}' and '{b}'", None))
    return rows
