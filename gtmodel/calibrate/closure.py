"""Closure equations of any model: the kinematics left when measured variables are known; start values of latents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..compiler.alias import AliasResult, eliminate
from ..compiler.causal import flat_of
from ..compiler.flat import FlatEquation, FlatModel
from ..compiler.matrices import substituted_in_order
from ..compiler.rows import map_columns
from ..compiler.structure import overdetermined_and_underdetermined
from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.source import ModelError

LEAST_FACTOR = 1e-3  # of an unknown, at the values of the parameters


@dataclass(frozen=True, eq=False)
class Closure(Portable):
    """Residuals (m,) that vanish on a perfect robot, in `symbols` of the known and latent variables and in flat.p.

    `labels` per row: the component that declares the equation, such as "arm[0].rod", "tool x" or, numbered, "leg 2".
    `touched`: indices in flat.parameters of the parameters in the rows. `unit`: known or latent quaternions whose unit
    length is an equation of the model. `lengths` (m,): residuals a == b^2 written as sqrt(a) - b if b is a parameter
    or a variable that a branch declares positive. For rods and struts this is the distance of their joints less their
    length [m].
    """

    flat: FlatModel
    known: tuple[str, ...]
    latent: tuple[str, ...]
    symbols: dict[str, ca.SX]
    residuals: ca.SX
    lengths: ca.SX
    labels: tuple[str, ...]
    touched: tuple[int, ...]
    unit: tuple[str, ...] = ()


def closure_equations(model: Model | Builder | FlatModel, known: Sequence[str], latent: Sequence[str] = ()) -> Closure:
    """Return the equations in parameters, `known` and `latent` variables, with all other variables eliminated.

    A variable that occurs alone in an equation, with a factor of numbers or parameters, is eliminated, step by step:
    for example variables of frames, joints and plate points. Left out are equations with derivatives (forces),
    conditions on known values alone, and the unit length of a latent quaternion. `latent` variables were not measured
    and have one value per pose.

    Raises ModelError for an unknown name, for a derivative, or if nothing closes; the message says what to measure.

    >>> closure = gt.calibrate.closure_equations(gt.robots.gantry_tau("l1_tape"), known=["q", "T"])
    >>> closure.labels, closure.lengths.shape
    (('arm[0].rod', 'arm[1].rod', 'arm[2].rod'), (3, 1))
    """
    flat = model if isinstance(model, FlatModel) else flat_of(model)
    names = (*known, *latent)
    groups = {name: _indices(flat, name) for name in names}
    variables = [i for name in names for i in groups[name]]
    if len(set(variables)) != len(variables):
        raise ModelError(f"{flat.title}: a variable is named twice in {', '.join(names)}")
    alias = eliminate(flat, frozenset(variables))
    level = [e for e in alias.equations if _position(flat, e)]
    order, rest = _propagated(flat, level, set(variables))
    closing = [e for e, unknown in rest if not unknown]
    parameters = {q.symbol.element_hash(): k for k, q in enumerate(flat.parameters)}
    positive = set(parameters) | _declared_positive(flat, alias)
    results = [e.residual for e in closing] + [_rooted(e.residual, positive) for e in closing]
    if order:
        symbols, values = [s for s, _ in order], [v for _, v in order]
        results = substituted_in_order(symbols, values, results, bool(flat.scope.calls))
    hidden = {flat.scope.symbol(i, 0).element_hash() for n in latent for i in groups[n]}
    rows: list[tuple[FlatEquation, ca.SX, ca.SX]] = []
    touched: set[int] = set()
    four = {frozenset(flat.scope.symbol(i, 0).element_hash() for i in g): n for n, g in groups.items() if len(g) == 4}
    unit: list[str] = []
    for e, r, length in zip(closing, results, results[len(closing) :], strict=False):
        inside = {s.element_hash() for s in ca.symvar(r)}
        present = {parameters[h] for h in inside if h in parameters}
        if not present and frozenset(inside) in four:
            unit.append(four[frozenset(inside)])
        elif present or inside & hidden:
            rows.append((e, r, length))
            touched |= present
    if not touched or _overdetermined(rest):
        raise ModelError(_nothing_closes(flat, known, alias, rest))
    return Closure(
        flat, tuple(known), tuple(latent),
        {n: ca.vertcat(*[flat.scope.symbol(i, 0) for i in indices]) for n, indices in groups.items()},
        ca.vertcat(*[r for _, r, _ in rows]), ca.vertcat(*[length for *_, length in rows]),
        _labels(flat, [e for e, *_ in rows], positive), tuple(sorted(touched)), tuple(unit),
    )  # fmt: skip


def _indices(flat: FlatModel, name: str) -> list[int]:
    _, indices, order = flat.lookup(name)
    if order:
        raise ModelError(f"'{name}' is a derivative; closure equations need positions, such as {flat.top()}")
    return indices


def _position(flat: FlatModel, equation: FlatEquation) -> bool:
    inside = flat.scope.symbols_in(equation.residual)
    return all(k == 0 for _, k in inside)


def _propagated(
    flat: FlatModel, equations: list[FlatEquation], known: set[int]
) -> tuple[list[tuple[ca.SX, ca.SX]], list[tuple[FlatEquation, set[int]]]]:
    """Assignments in order, and the other equations with their remaining unknowns."""
    done = set(known)
    waiting = [(e, {i for i, _ in flat.scope.symbols_in(e.residual)} - done) for e in equations]
    order: list[tuple[ca.SX, ca.SX]] = []
    progress, by_parameters = True, False
    while progress or not by_parameters:
        # a factor of parameters only where no number is left: it might be zero for other values
        progress, by_parameters = False, not progress
        remaining: list[tuple[FlatEquation, set[int]]] = []
        for e, unknown in waiting:
            unknown -= done
            one = len(unknown) == 1 and not (by_parameters and progress)
            solved = _solved(flat, e, next(iter(unknown)), by_parameters) if one else None
            if solved is None:
                remaining.append((e, unknown))
                continue
            order.append((flat.scope.symbol(next(iter(unknown)), 0), solved))
            done |= unknown
            progress = True
        waiting = remaining
    return order, waiting


def _solved(flat: FlatModel, equation: FlatEquation, index: int, by_parameters: bool) -> ca.SX | None:
    """The unknown in terms of the other variables if its factor is constant, or one of parameters that is not zero at
    their values; None otherwise."""
    s = flat.scope.symbol(index, 0)
    factor = ca.SX(ca.jacobian(equation.residual, s))
    given = {q.element_hash() for q in ca.vertsplit(flat.p)} if by_parameters and flat.parameters else set[int]()
    if not {q.element_hash() for q in ca.symvar(factor)} <= given:
        return None
    if abs(float(ca.DM(ca.substitute(factor, flat.p, ca.DM(flat.p0))))) <= (LEAST_FACTOR if by_parameters else 0.0):
        return None
    at_zero = ca.substitute(equation.residual, s, ca.SX(0))
    return -at_zero / float(factor)


def _labels(flat: FlatModel, equations: list[FlatEquation], positive: set[int]) -> tuple[str, ...]:
    """The component of each equation: with x, y, z for the three of a vector, numbered for several others."""
    paths = [e.component or flat.title for e in equations]
    groups = {p: [e for e, q in zip(equations, paths, strict=True) if q == p] for p in paths}
    ends: dict[str, Sequence[str | int]] = {p: range(1, len(group) + 1) for p, group in groups.items()}
    for p, group in groups.items():
        vector = len(group) == 3 and len({e.where for e in group}) == 1
        if vector and all(_rooted(e.residual, positive) is e.residual for e in group):
            ends[p] = "xyz"
    counts = [paths[:k].count(p) for k, p in enumerate(paths)]
    return tuple(p if len(groups[p]) == 1 else f"{p} {ends[p][k]}" for p, k in zip(paths, counts, strict=True))


def _nothing_closes(
    flat: FlatModel, known: Sequence[str], alias: AliasResult, rest: list[tuple[FlatEquation, set[int]]]
) -> str:
    names = _missing(flat, known, alias, rest)
    hint = f"measure {' or '.join(names)} too, or declare it latent" if names else f"known can be some of {flat.top()}"
    return f"{flat.title}: with {', '.join(known)} known, not all equations with parameters close; {hint}"


def left_open(model: Model | Builder | FlatModel, known: Sequence[str]) -> list[str]:
    """Return the model's top-level variables that must also be known, or latent, for all equations to close."""
    flat = model if isinstance(model, FlatModel) else flat_of(model)
    variables = {i for name in known for i in _indices(flat, name)}
    alias = eliminate(flat, frozenset(variables))
    _, rest = _propagated(flat, [e for e in alias.equations if _position(flat, e)], set(variables))
    return _missing(flat, known, alias, rest)


def _missing(
    flat: FlatModel, known: Sequence[str], alias: AliasResult, rest: list[tuple[FlatEquation, set[int]]]
) -> list[str]:
    inside = _overdetermined(rest)
    return [n for n, (_, indices) in flat.groups.items() if "." not in n and n not in known
            and {alias.resolve(i, 0)[1] for i in indices} & inside]  # fmt: skip


def _overdetermined(rest: list[tuple[FlatEquation, set[int]]]) -> set[int]:
    """Unknowns in more remaining equations than they need: the measured values are redundant here."""
    remaining = [u for _, u in rest if u]
    unknown = sorted({i for u in remaining for i in u})
    column = {j: k for k, j in enumerate(unknown)}
    entries = {(row, column[j]): 0 for row, u in enumerate(remaining) for j in u}
    over, _ = overdetermined_and_underdetermined(len(remaining), len(unknown), entries)
    return {j for row in over for j in remaining[row]}


def _declared_positive(flat: FlatModel, alias: AliasResult) -> set[int]:
    """Variables that are branches themselves, such as the length of a strut."""
    index = {flat.scope.symbol(i, 0).element_hash(): i for _, group in flat.groups.values() for i in group}
    leaves = [index.get(b.expression.element_hash()) for b in flat.branches if b.expression.is_symbolic()]
    resolved = [alias.resolve(i, 0) for i in leaves if i is not None]
    return {flat.scope.symbol(i, 0).element_hash() for sign, i, order in resolved if sign > 0 and not order}


def _rooted(r: ca.SX, positive: set[int]) -> ca.SX:
    """sqrt(a) - b for a residual a - b^2 with b positive, in either order; the residual itself otherwise."""
    if r.is_leaf() or r.op() != ca.OP_SUB:
        return r
    first, second = r.dep(0), r.dep(1)
    if _square(second, positive):
        return ca.sqrt(first) - second.dep(0)
    if _square(first, positive):
        return ca.sqrt(second) - first.dep(0)
    return r


def _square(e: ca.SX, positive: set[int]) -> bool:
    return not e.is_leaf() and e.op() == ca.OP_SQ and e.dep(0).element_hash() in positive


ROUNDS = 60
LEFT = 1e-8  # residual in units of the equations' derivatives at which a pose counts as closed
NEIGHBOURS = 3
LEAST, MOST = 1e-12, 1e12


def closed_start(equations: ca.SX, d: ca.SX, latent: ca.SX, data: np.ndarray) -> np.ndarray:
    """Latent values (N, nz) that close `equations` of d and latent alone, for data (nd, N).

    Levenberg steps from zero, each row separately; rows that do not close restart from their nearest closed rows."""
    f = ca.Function("stances", [d, latent], ca.cse([ca.densify(equations), ca.densify(ca.jacobian(equations, latent))]))
    N, nz = data.shape[1], latent.numel()
    z, residual = _levenberg(f, data, np.zeros((N, nz)))
    good = residual <= LEFT
    spread = np.ptp(data, axis=1)
    places = (data / np.where(spread > 0, spread, 1.0)[:, None]).T
    for rank in range(NEIGHBOURS):
        unclosed, closed = np.flatnonzero(~good), np.flatnonzero(good)
        if not len(unclosed) or len(closed) <= rank:
            break
        distances = np.linalg.norm(places[unclosed, None] - places[None, closed], axis=2)
        near = closed[np.argsort(distances, axis=1, kind="stable")[:, rank]]
        restarted, rest = _levenberg(f, data[:, unclosed], z[near])
        better = rest < residual[unclosed]
        z[unclosed[better]], residual[unclosed[better]] = restarted[better], rest[better]
        good = residual <= LEFT
    return z


def _levenberg(f: ca.Function, data: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """z and the remaining residual in units of the equations' derivatives (N,)."""
    N, nz = z.shape
    damping: np.ndarray = np.full(N, 1e-3)

    def evaluate(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, J = map_columns(f, [data, z.T])
        return r.T, J.reshape(J.shape[0], N, nz).transpose(1, 0, 2)

    with np.errstate(all="ignore"):
        r, J = evaluate(z)
        J: np.ndarray = np.nan_to_num(J, posinf=0.0, neginf=0.0)
        cost: np.ndarray = np.where(np.isfinite(r).all(axis=1), np.sum(r**2, axis=1), np.inf)
        for _ in range(ROUNDS):
            A = J.transpose(0, 2, 1) @ J
            scale = np.trace(A, axis1=1, axis2=2) / nz
            A += (damping * np.where(scale > 0, scale, 1.0))[:, None, None] * np.eye(nz)
            step = -np.linalg.solve(A, J.transpose(0, 2, 1) @ np.nan_to_num(r)[..., None])[..., 0]
            candidate, slopes = evaluate(z + step)
            finite = np.isfinite(candidate).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2))
            new = np.where(finite, np.sum(candidate**2, axis=1), np.inf)
            better = new < cost
            damping = np.clip(np.where(better, damping / 10, damping * 10), LEAST, MOST)
            z, r = np.where(better[:, None], z + step, z), np.where(better[:, None], candidate, r)
            J, cost = np.where(better[:, None, None], slopes, J), np.where(better, new, cost)
            if not better.any() and damping.min() >= 1.0:
                break
        size = np.linalg.norm(J, axis=(1, 2))
    return z, np.where(size > 0, np.sqrt(cost) / np.where(size > 0, size, 1.0), np.inf)
