"""The equations among positions alone, in independent coordinates: what a mechanism's rank is judged by."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from ..lang.units import parse_unit
from .alias import eliminate
from .flat import FlatModel, FlatVariable
from .matrices import called

RANK_TOLERANCE = 1e-5  # of singular values, relative to the largest: an assembled shaky point is good to 1e-6
CLOSED = 1e-11  # largest residual of an assembled point, in m and rad
STEPS = 80  # of the damped Gauss-Newton iteration
LEAST_DAMPING = 1e-10  # relative to squared singular values of order one: keeps redundant rows solvable
TRIES = 24  # random starts of an assembly
SPREADS = (0.0, 0.1, 0.3, 1.0, 2.0)  # of the starts, rad or nominals


@dataclass(frozen=True, eq=False)
class Positions:
    """Constraints g(x) == 0 among independent coordinates x.

    Attributes:
        flat: the model. coordinates: indices of the variables x. rows: the equation of each constraint, by number.
        constraints: g as a column. symbols: x as a column. variables, values: indices of all position variables, and
            their values as functions of x.
        starts: declared start values of x, NaN where there are none. levels: of the components that declare them.
        guesses: differences of other variables that the model itself declares from their start values.
    """

    flat: FlatModel
    coordinates: list[int]
    rows: list[int]
    symbols: ca.SX
    constraints: ca.SX
    variables: list[int]
    values: ca.SX
    starts: np.ndarray
    levels: np.ndarray
    guesses: ca.SX

    @cached_property
    def _system(self) -> ca.Function:
        jacobian = ca.densify(ca.jacobian(self.constraints, self.symbols))
        return ca.Function("positions", [self.symbols], [ca.densify(self.constraints), jacobian])

    @cached_property
    def _softly(self) -> ca.Function:
        column = ca.vertcat(self.constraints, self.guesses)
        return ca.Function(
            "softly", [self.symbols], [ca.densify(column), ca.densify(ca.jacobian(column, self.symbols))]
        )

    @cached_property
    def _second(self) -> ca.Function:
        v = ca.SX.sym("v", self.symbols.numel())
        once = ca.jtimes(self.constraints, self.symbols, v)
        return ca.Function("second", [self.symbols, v], [ca.densify(ca.jtimes(once, self.symbols, v))])

    @cached_property
    def _values(self) -> ca.Function:
        return ca.Function("values", [self.symbols], [ca.densify(self.values)])

    @cached_property
    def _moves(self) -> ca.Function:
        return ca.Function("moves", [self.symbols], [ca.densify(ca.jacobian(self.values, self.symbols))])

    @cached_property
    def nominal(self) -> np.ndarray:
        """Nominal values of the coordinates (n,)."""
        return np.array([self.flat.variables[i].nominal for i in self.coordinates])

    def residual(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the constraints (m,) and their derivatives by the coordinates in nominals (m, n)."""
        g, jacobian = called(self._system, x)
        return g, self._matrix(jacobian, len(g))

    def second(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the second derivatives of the constraints along v (n,), in nominals: (m,)."""
        return called(self._second, x, v * self.nominal)[0]

    def positions(self, x: np.ndarray) -> dict[int, float]:
        """Return the values of all position variables by index."""
        return dict(zip(self.variables, called(self._values, x)[0].tolist(), strict=True))

    def moves(self, x: np.ndarray) -> np.ndarray:
        """Return the derivatives of all position variables by the coordinates in nominals (k, n)."""
        return self._matrix(called(self._moves, x)[0], len(self.variables))

    def _matrix(self, columns: np.ndarray, height: int) -> np.ndarray:
        return columns.reshape(len(self.nominal), height).T * self.nominal

    def assembled(self, x: np.ndarray, free: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        """Return the assembled point near x and the largest residual left there, in m and rad; only the coordinates
        `free` (n, True or False) move, by default all.

        Levenberg-Marquardt with a damping of the size of the residual, which converges quadratically also if
        constraints are redundant (Yamashita and Fukushima, Computing Suppl. 15, 2001).
        """
        x, mask = x.copy(), 1.0 if free is None else free.astype(float)
        g: np.ndarray
        jacobian: np.ndarray
        g, jacobian = self.residual(x)
        if not g.size:
            return x, 0.0
        best, at = np.inf, x
        for _ in range(STEPS):
            size = float(np.max(np.abs(g)))
            if not np.isfinite(size) or not np.all(np.isfinite(jacobian)):
                break
            if size < best:
                best, at = size, x
            if size <= CLOSED / 10:
                break
            damping = max(LEAST_DAMPING, min(1e-2, float(g @ g)))
            jacobian = jacobian * mask
            gram = jacobian @ jacobian.T + damping * np.eye(len(g))
            step = -jacobian.T @ np.linalg.solve(gram, g)
            longest = float(np.max(np.abs(step), initial=0.0))
            if longest > 0.5:
                step *= 0.5 / longest
            x = x + step * self.nominal
            if longest < 1e-15:
                break
            g, jacobian = self.residual(x)
        return at, best

    def _near_guesses(self, x: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Return a point nearer to the guesses; only the coordinates `free` move."""
        if not self.guesses.numel() or not free.any():
            return x
        for _ in range(STEPS // 2):
            column, jacobian = called(self._softly, x)
            jacobian = self._matrix(jacobian, len(column)) * free
            gram = jacobian.T @ jacobian + 1e-3 * np.eye(len(x))
            step = -np.linalg.solve(gram, jacobian.T @ column)
            longest = float(np.max(np.abs(step)))
            if not np.isfinite(longest) or longest < 1e-6:
                break
            x = x + min(1.0, 0.5 / longest) * step * self.nominal
        return x

    def home(self, tries: int = TRIES) -> tuple[np.ndarray, float]:
        """Return an assembled point near the start values and its residual; the nearest miss if there is none."""
        known = ~np.isnan(self.starts)
        start = np.where(known, self.starts, 0.0)
        best: tuple[float, np.ndarray] | None = None
        start = self._near_guesses(start, ~known)
        # start values stay if the others can follow; else one of them moves; else all but those of the model itself
        one_moves = [known & (np.arange(len(known)) != n) for n in np.flatnonzero(known)]
        for group in ([known], one_moves, [known & (self.levels == 0)]):
            tried = [self.assembled(start, ~held) for held in group if held.any() and not held.all()]
            if closed := [(x, gap) for x, gap in tried if gap <= CLOSED]:
                return min(closed, key=lambda values: float(np.linalg.norm((values[0] - start)[known])))
        for seed in range(tries):
            rng = np.random.default_rng(seed)
            spread = SPREADS[seed % len(SPREADS)] if seed else 0.0
            noise = spread * rng.standard_normal(len(start)) * self.nominal
            x, gap = self.assembled(start + np.where(known, 0.1 * noise if seed < tries // 2 else noise, noise))
            if best is None or gap < best[0]:
                best = gap, x
            if gap <= CLOSED:
                break
        assert best is not None
        return best[1], best[0]


def is_position(v: FlatVariable) -> bool:
    """Return whether a variable is a length, an angle or a plain number, and no flow."""
    kg, _, seconds, *others = parse_unit(v.unit or "1").dimension.exponents
    return v.role != "flow" and not any((kg, seconds, *others))


def positions_of(flat: FlatModel, starts: dict[int, float] | None = None) -> Positions:
    """Return the position constraints of a model in independent coordinates.

    Equations that contain only positions define a variable each, from the roots on, where they are linear in the last
    one left; joint coordinates are independent where nothing defines them. All other equations are constraints.
    `starts`: values that replace the declared start values, by index.
    """
    scope = flat.scope
    inside = scope.symbols_in_each([e.residual for e in flat.equations])
    kinds = [is_position(v) for v in flat.variables]
    rows = [n for n, pairs in enumerate(inside) if pairs and all(k == 0 and kinds[i] for i, k in pairs)]
    numbers = ca.SX(ca.DM(flat.require_values()))
    # the start time stands for the time: a prescribed motion is held
    residuals = ca.substitute([flat.equations[n].residual for n in rows], [flat.p, scope.time], [numbers, ca.SX(0)])
    incident = [sorted({i for i, _ in inside[n]}) for n in rows]
    held = {c.equation for closing in flat.loops.closings for c in closing.constraints}
    definitions, coordinates, constraints = _ordered(flat, rows, residuals, incident, held)
    defined = [scope.symbol(i, 0) for i, _ in definitions]
    x = ca.vertcat(*[scope.symbol(i, 0) for i in coordinates]) if coordinates else ca.SX(0, 1)
    column = [ca.SX(ca.vertcat(*[residuals[n] for n in constraints])) if constraints else ca.SX(0, 1)]
    variables = [*coordinates, *(i for i, _ in definitions)]
    every = ca.vertcat(*[scope.symbol(i, 0) for i in variables]) if variables else ca.SX(0, 1)
    g, values = column[0], every
    if definitions:
        _, (g, values) = ca.substitute_inplace(defined, [e for _, e in definitions], [g, every])
    given = _starts(flat) if starts is None else {i: (value, 0) for i, value in starts.items()}
    started = [
        n for n, i in enumerate(variables) if starts is None and n >= len(coordinates) and given.get(i, (0, 1))[1] == 0
    ]
    guesses = [ca.SX(values)[n] - given[variables[n]][0] for n in started]
    return Positions(
        flat, coordinates, [rows[n] for n in constraints], x, ca.SX(g), variables, ca.SX(values),
        np.array([given.get(i, (np.nan, 0))[0] for i in coordinates]),
        np.array([given.get(i, (np.nan, 0))[1] for i in coordinates]),
        ca.SX(ca.vertcat(*guesses)) if guesses else ca.SX(0, 1),
    )  # fmt: skip


def _starts(flat: FlatModel) -> dict[int, tuple[float, int]]:
    """Return the start value of each variable that has one, and the level of the component that declares it; also one
    declared for another name of the same quantity."""
    held = {c.equation for closing in flat.loops.closings for c in closing.constraints}
    # a redundant constraint may be trivial, which the elimination of aliases reports as an error
    firm = [e for n, e in enumerate(flat.equations) if n not in held]
    try:
        alias = eliminate(replace(flat, equations=firm, cache={}), frozenset())
    except ModelError:
        return {v.index: (v.start, flat.level(v.index)) for v in flat.variables if v.start is not None}
    kept: dict[int, tuple[float, int]] = {}
    for v in sorted(flat.variables, key=lambda v: flat.level(v.index)):
        sign, index, order = alias.resolve(v.index, 0)
        if v.start is not None and not order:
            kept.setdefault(index, (sign * v.start, flat.level(v.index)))
    values = {}
    for v in flat.variables:
        sign, index, order = alias.resolve(v.index, 0)
        if index in kept and not order:
            values[v.index] = sign * kept[index][0], kept[index][1]
    return values


def _ordered(
    flat: FlatModel, rows: Sequence[int], residuals: list[ca.SX], incident: list[list[int]], held: set[int]
) -> tuple[list[tuple[int, ca.SX]], list[int], list[int]]:
    """Return definitions (variable, expression) in order, the independent variables, and the equations left over."""
    equations_of: dict[int, list[int]] = {}
    for n, variables in enumerate(incident):
        for i in variables:
            equations_of.setdefault(i, []).append(n)
    missing = [len(v) for v in incident]
    known: set[int] = set()
    used: set[int] = set()
    definitions: list[tuple[int, ca.SX]] = []
    coordinates: list[int] = []
    ready = deque(n for n, count in enumerate(missing) if count == 1)

    def learn(i: int) -> None:
        known.add(i)
        for n in equations_of[i]:
            missing[n] -= 1
            if missing[n] == 1:
                ready.append(n)

    shared = {i for i, at in equations_of.items() if len(at) > 1}
    candidates = deque(
        sorted(equations_of, key=lambda i: (-flat.variables[i].prefer, i not in shared, -flat.level(i), i))
    )
    while True:
        while ready:
            n = ready.popleft()
            left = [i for i in incident[n] if i not in known]
            if len(left) != 1 or rows[n] in held:
                continue
            symbol = flat.scope.symbol(left[0], 0)
            slope = ca.jacobian(residuals[n], symbol)
            if not slope.is_constant() or abs(float(slope)) < 1e-3:
                continue
            rest = ca.substitute(residuals[n], symbol, 0)
            definitions.append((left[0], -rest / float(slope)))
            used.add(n)
            learn(left[0])
        while candidates and candidates[0] in known:
            candidates.popleft()
        if not candidates:
            break
        coordinates.append(candidates[0])
        learn(candidates.popleft())
    return definitions, coordinates, [n for n in range(len(rows)) if n not in used]
