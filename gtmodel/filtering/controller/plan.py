"""Plan of a filter cycle as kernels and tables; the C code and its Python twin both follow it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from ...cgen.real import GenerationError
from ..manifold import Manifold, StatePart
from ..system import System
from ..transition import GAUSS, TAYLOR, CurvedTransition, LinearTransition
from .sparse import (
    EntryMatrix,
    EntryProduct,
    ExpressionMaker,
    KernelExpressions,
    Place,
    closed,
    constant,
    pattern,
    picked,
    product,
    sparse_of,
    without_ones,
)


@dataclass(frozen=True, eq=False)
class Kernel:
    """A generated function: columns in, columns out."""

    name: str
    symbols: list[Any]
    results: list[Any]

    def called(self, name: str) -> ca.Function:
        """Return the function under a name; its instructions do not depend on the name."""
        return ca.Function(name, self.symbols, self.results)


@dataclass(frozen=True, eq=False)
class TransitionPlan:
    """One Runge-Kutta step with its derivative, and the covariance of its noise; see gt_filter.h.

    A path is the derivative of x by the error at the start of the step: `moving` rows that change, then fixed rows, in
    the columns with entries; `fixed_path` holds the fixed rows at each stage and at the end. A response is the
    derivative of the error by the noise: entries that change, then constant ones, `fixed_response` for each power of A
    and `fixed_total` at each node.
    """

    rates: Kernel
    frame: Kernel | None
    noise: Kernel | None
    jacobian: EntryMatrix
    frames: EntryMatrix
    arrival: EntryMatrix
    drift: EntryMatrix
    drive: EntryMatrix
    moving: int
    width: int
    frame_places: list[int]
    picked: list[int]
    fixed_path: np.ndarray
    responses: list[Place]
    fixed_response: np.ndarray
    fixed_total: np.ndarray
    response: EntryProduct
    spread: EntryProduct
    weights: np.ndarray
    powers: np.ndarray


@dataclass(frozen=True, eq=False)
class SensorPlan:
    """One sensor: its measurement function, and the limits of its readings."""

    name: str
    size: int
    first: int
    delay: int
    quaternion: bool
    stale: int
    closed: int
    gate: float
    kernel: Kernel
    jacobian: EntryMatrix
    variance: np.ndarray
    deviation: float


@dataclass(frozen=True, eq=False)
class FilterPlan:
    """All constant data of a filter. The transition is F', so column after column of F; `same` is 1 for each row whose
    diagonal entry of F is a constant 1, which is left out of the transition."""

    size: int
    errors: int
    inputs: int
    parts: int
    step: float
    given: Kernel | None
    motion: TransitionPlan | None
    turn: Kernel | None
    unit: Kernel | None
    turned: list[tuple[int, int]]
    error_of: list[int]
    same: list[float]
    transition: EntryMatrix
    noise: EntryMatrix
    sensors: tuple[SensorPlan, ...]
    depth: int = field(default=0)

    @property
    def stride(self) -> int:
        """Length of a column of the covariance factor, padded to an even number."""
        return self.errors + self.errors % 2

    @property
    def reached(self) -> list[int]:
        """For each row of F, the number of columns from its first entry to the last column."""
        first = [k if same else self.errors for k, same in enumerate(self.same)]
        for column, row in self.transition.places:
            first[row] = min(first[row], column)
        return [self.errors - k for k in first]

    @property
    def numbers(self) -> int:
        """Total size of the readings of all sensors."""
        return sum(s.size for s in self.sensors)

    @property
    def kernels(self) -> list[Kernel]:
        """All generated functions. `turn` is not among them: gt_filter_correct.h contains it by hand."""
        m = self.motion
        moving = [self.given] if m is None else [m.rates, m.frame, m.noise, self.unit]
        return [k for k in [*moving, *[s.kernel for s in self.sensors]] if k is not None]


def plan_of(
    system: System,
    period: float,
    stale: Mapping[str, int],
    closed_gates: Mapping[str, int],
) -> FilterPlan:
    """Make the plan of a system with cycles of `period` [s]. Raises GenerationError for unsupported models."""
    space, maker = system.space, ExpressionMaker(system)
    if system.curved_errors:
        raise GenerationError("generated code does not support directions as states; use a unit quaternion")
    sensors, first = [], 0
    for name, sensor in system.sensors.items():
        delay = _cycles(sensor.lag, period, f"the delay of '{name}'")
        if delay < 0:
            raise GenerationError(f"the delay of '{name}' is below zero; a loop has no readings of the future")
        size = system.readings[name].size
        residual = maker.kernel(
            f"sensor_{name}", {"t": 1, "x": space.size, "u": maker.inputs, "z": size},
            lambda t, x, u, z, name=name: system.residual((name,), t, x, u, z), upright=(1,),
        )  # fmt: skip
        H = maker.shared(residual, sparse_of(residual[1]).given)
        kernel = _kernel_of(f"sensor_{name}", residual, [residual[0], H.expressions])
        gate = float(system.gate_limits(name)[-1]) if sensor.gate else 0.0
        deviations = system.deviations[name]
        sensor_plan = SensorPlan(
            name, size, first, delay, sensor.kind != "vector", stale.get(name, 0), closed_gates.get(name, 0), gate,
            kernel, H, deviations**2, float(deviations.min()),
        )  # fmt: skip
        sensors.append(sensor_plan)
        first += size
    depth = max(s.delay for s in sensors)
    turned = [(at.start, along.start) for part, at, along in space.places() if part.kind == "quaternion"]
    error_of = [-1] * space.size
    for part, at, along in space.places():
        if part.kind == "vector":
            error_of[at] = _range(along)
    common = {"turned": turned, "error_of": error_of, "sensors": tuple(sensors), "depth": depth}
    common |= _of_quaternions(maker) if turned else {"turn": None, "unit": None}
    moved: dict[str, Any] = _moved(system, maker, period)
    moved["transition"], moved["same"] = without_ones(moved["transition"])
    # pyrefly: ignore[bad-argument-type]
    return FilterPlan(size=space.size, errors=space.dimension, inputs=maker.inputs, **moved, **common)


def _moved(system: System, maker: ExpressionMaker, period: float) -> dict[str, Any]:
    """Part of the plan for the transition of the state."""
    space, transition = system.space, system.transition
    n = space.dimension
    if isinstance(transition, CurvedTransition):
        parts = max(1, int(np.ceil(period / transition.longest - 1e-9)))
        step = period / parts
        motion, F, Q = _motion(system, maker, step)
        return {"parts": parts, "step": step, "given": None, "motion": motion, "transition": F.transposed, "noise": Q}
    sizes = {"t": 1, "x": space.size, "u": maker.inputs, "v": maker.inputs}
    if isinstance(transition, LinearTransition):
        F, first, last, rest, Q = transition.matrices(period)
        parts, step = 1, period
        given = maker.kernel("given", sizes, lambda t, x, u, v: [F @ x + first @ u + last @ v + rest, ca.DM(F)])
    else:
        parts, step, Q = _cycles(period, transition.period, "the period"), transition.period, transition.Q

        def after(t: Any, x: Any, u: Any, v: Any) -> list[Any]:
            moved = space.to_unit(system.rates(t, x, u, ca.DM.zeros(0)))
            return [moved, ca.mtimes([space.to_error(moved), ca.jacobian(moved, x), space.from_error(x)])]

        given = maker.kernel("given", sizes, after)
    matrix = sparse_of(given[1])
    if matrix.shape != (n, n):
        raise GenerationError("the process has a transition of another size; this is an error in gtmodel")
    return {
        "parts": parts, "step": step, "given": _kernel_of("given", given, [given[0], matrix.expressions]),
        "motion": None, "transition": matrix.transposed, "noise": constant(np.tril(Q)),
    }  # fmt: skip


def _of_quaternions(maker: ExpressionMaker) -> dict[str, Kernel]:
    """Kernels of quaternions: plus, and scaling to unit length with the derivative of its error."""
    space = Manifold([StatePart("q", "quaternion", 4)])
    turn = maker.kernel("turn", {"x": 4, "d": 3}, lambda x, d: [space.plus_symbols(x, d)])

    def units(x: Any) -> list[Any]:
        scaled = space.to_unit(x)
        return [scaled, space.to_error(scaled) / ca.sqrt(ca.dot(x, x))]

    unit = maker.kernel("unit", {"x": 4}, units)
    rows = [unit[1][i, j] for i in range(3) for j in range(4)]
    return {"turn": _kernel_of("turn", turn, [turn[0]]), "unit": _kernel_of("unit", unit, [unit[0], ca.vertcat(*rows)])}


def _motion(system: System, maker: ExpressionMaker, step: float) -> tuple[TransitionPlan, EntryMatrix, EntryMatrix]:
    """The plan of one step, F and Q."""
    space, d = system.space, system.dynamics
    n, none = space.dimension, ca.DM.zeros(sum(d.noise.values()))
    sizes = {"t": 1, "x": space.size, "u": maker.inputs}

    def rates(t: Any, x: Any, u: Any) -> list[Any]:
        rate = system.rates(t, x, u, none)
        return [rate, ca.jacobian(rate, x)]

    def drifts(t: Any, x: Any, u: Any) -> list[Any]:
        """Error dynamics A and noise input G, as in `CurvedTransition`."""
        w, dt = d.symbol("w", none.numel()), d.symbol("h")
        rate = system.rates(t, x, u, w)
        G = ca.substitute(ca.jacobian(rate, w), w, none) if none.numel() else ca.jacobian(rate, w)
        moved = space.to_unit(x + dt * system.rates(t, x, u, none))
        euler = ca.mtimes([space.to_error(moved), ca.jacobian(moved, x), space.from_error(x)])
        A = ca.substitute(ca.reshape(ca.jacobian(ca.vec(euler), dt), n, n), dt, 0)
        return [A, ca.mtimes([space.to_error(x), G, np.sqrt(d.intensity)])]

    rate, drift = maker.kernel("rates", sizes, rates), maker.kernel("noise", sizes, drifts, upright=(0, 1))
    frame = maker.kernel("frame", {"x": space.size}, lambda x: [space.from_error(x)])
    J, S, A, G = (sparse_of(m) for m in (rate[1], frame[0], drift[0], drift[1]))
    E = _arrival(space)
    path, stages, F_values = _path(J, S, E, step)
    weights = np.array([weight * step for _, weight in GAUSS])
    powers = np.array([[_power(node * step, k) for k in range(1, TAYLOR + 1)] for node, _ in GAUSS])
    responses, fixed_response, fixed_total, Q_values = _responses(A, G, weights, powers)
    F, Q = _changing((n, n), F_values), _changing((n, n), Q_values)
    turning = len(responses) - fixed_response.shape[1]
    A, G = picked(A, {i for i, _ in responses[:turning]}), picked(G, {i for i, _ in responses[:turning]})
    # rows of a path that change, fixed rows that these and F need too, and the columns of both
    changing = [F.places[k] for k in F.changing]
    rows = sorted({i for (i, _), order in zip(path, stages.T, strict=True) if np.isnan(order).any()})
    J, S, E = picked(J, set(rows)), picked(S, set(rows)), picked(E, {i for i, _ in changing})
    fixed_rows = sorted({j for _, j in (*J.places, *E.places)} - set(rows))
    columns = sorted({j for i, j in path if i in rows} | {j for _, j in changing})
    width = len(columns) + len(columns) % 2
    row_of = {i: n for n, i in enumerate([*rows, *fixed_rows])}
    column_of = {j: n for n, j in enumerate(columns)}
    fixed_path = np.zeros((len(stages), len(fixed_rows), width))
    for (i, j), order in zip(path, stages.T, strict=True):
        if i in fixed_rows and j in column_of:
            fixed_path[:, row_of[i] - len(rows), column_of[j]] = order
    frame_places = [row_of[i] * width + column_of[j] for i, j in S.places]
    of_F = sorted({i for i, _ in changing})
    taken = [of_F.index(i) * width + column_of[j] for i, j in changing]
    J, E = J.placed(rows, row_of).given, E.placed(of_F, row_of)
    S, A, G = S.given, A.given, G.given
    turned = [(j, i) for i, j in responses]
    order = sorted(range(len(turned)), key=turned.__getitem__)
    spread = product(responses, [turned[k] for k in order], [Q.places[k] for k in Q.changing])
    plan = TransitionPlan(
        _kernel_of("rates", rate, [rate[0], J.expressions]),
        _kernel_of("frame", frame, [S.expressions]) if S.places else None,
        _kernel_of("noise", drift, [A.expressions, G.expressions]) if A.places or G.places else None,
        J, S, E, A, G, len(rows), width, frame_places, taken, fixed_path, responses, fixed_response, fixed_total,
        product(A.places, responses, responses[:turning]),
        # the transpose has the same numbers as the responses, in another order
        EntryProduct(spread.start, spread.left, np.array(order, int)[spread.right]),
        weights, powers,
    )  # fmt: skip
    return plan, F, Q


def _arrival(space: Manifold) -> EntryMatrix:
    """Derivative of the error at the end by x: one for vectors, twelve changing entries for each quaternion."""
    entries = []
    for part, at, along in space.places():
        if part.kind == "vector":
            entries += [((i, j), 1.0) for i, j in zip(_range(along), _range(at), strict=True)]
        else:
            entries += [((i, j), np.nan) for i in _range(along) for j in _range(at)]
    return _changing((space.dimension, space.size), dict(entries))


def _range(along: slice) -> range:
    return range(along.start, along.stop)


def _changing(shape: tuple[int, int], values: Mapping[Place, float]) -> EntryMatrix:
    """A matrix whose NaN entries change."""
    places = tuple(sorted(values))
    value = np.array([values[place] for place in places])
    changing = np.flatnonzero(np.isnan(value))
    return EntryMatrix(shape, places, np.where(np.isnan(value), 0.0, value), changing, None)


def _unknown(matrix: EntryMatrix) -> np.ndarray:
    """Its values, NaN for changing entries, so that results of them are NaN too."""
    value = matrix.value.copy()
    value[matrix.changing] = np.nan
    return value


def _path(
    J: EntryMatrix, S: EntryMatrix, E: EntryMatrix, step: float
) -> tuple[list[Place], np.ndarray, dict[Place, float]]:
    """Entries of a path, their values at four stages and at the end, and those of F; NaN for changing values."""
    path = closed(J.places, S.places)
    along = product(J.places, path, path)
    begin = np.zeros(len(path))
    begin[[path.index(place) for place in S.places]] = _unknown(S)
    change, total, stages = np.zeros(len(path)), np.zeros(len(path)), []
    for share, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
        stages.append(begin + share * step * change)
        change = along.applied(_unknown(J), stages[-1])
        total = total + weight * change
    stages.append(begin + step / 6 * total)
    places = pattern(E.places, path)
    F = product(E.places, path, places).applied(_unknown(E), stages[-1])
    return path, np.array(stages), dict(zip(places, F.tolist(), strict=True))


def _responses(
    A: EntryMatrix, G: EntryMatrix, weights: np.ndarray, powers: np.ndarray
) -> tuple[list[Place], np.ndarray, np.ndarray, dict[Place, float]]:
    """Entries of a response, changing ones first; the others for each power of A and at each node; entries of Q."""
    places = closed(A.places, G.places)
    again = product(A.places, places, places)
    terms = [np.zeros(len(places))]
    terms[0][[places.index(place) for place in G.places]] = _unknown(G)
    for _ in range(TAYLOR):
        terms.append(again.applied(_unknown(A), terms[-1]))
    totals = [terms[0] + sum(p * term for p, term in zip(row, terms[1:], strict=True)) for row in powers]
    turned = [(j, i) for i, j in places]
    order_of_turned = sorted(range(len(turned)), key=turned.__getitem__)
    of_noise = [(i, j) for i, j in pattern(places, turned) if j <= i]
    spread = product(places, [turned[k] for k in order_of_turned], of_noise)
    Q = sum(w * spread.applied(total, total[order_of_turned]) for w, total in zip(weights, totals, strict=True))
    order, fixed = _sorted(np.array([*terms, *totals]))
    return (
        [places[k] for k in order], fixed[: len(terms)], fixed[len(terms) :],
        dict(zip(of_noise, np.asarray(Q).tolist(), strict=True)),
    )  # fmt: skip


def _sorted(rows: np.ndarray) -> tuple[list[int], np.ndarray]:
    """Order of the columns, those with a NaN first, and the other columns."""
    moving = np.isnan(rows).any(axis=0)
    fixed = np.flatnonzero(~moving)
    return [*np.flatnonzero(moving).tolist(), *fixed.tolist()], rows[:, fixed]


def _power(s: float, k: int) -> float:
    """s^k / k!"""
    term = 1.0
    for n in range(1, k + 1):
        term *= s / n
    return term


def _cycles(time: float, period: float, what: str) -> int:
    """Number of periods in a time. Raises GenerationError if it is not a whole number."""
    count = round(time / period)
    if abs(count * period - time) > 1e-6 * period:
        raise GenerationError(f"{what}, {time:g} s, is not a multiple of {period:g} s; give one that is", "period")
    return count


def _kernel_of(name: str, expressions: KernelExpressions, results: Sequence[Any]) -> Kernel:
    dense: Any = ca.cse([ca.densify(ca.vec(r)) for r in results])
    return Kernel(name, expressions.symbols, dense)
