"""From a statement to the quadratic program of a horizon: stages linearised at a plan, whose changing entries are data.

A stage of length h holds its input; the state after it follows by Runge-Kutta steps of fourth order. The cost of a
stage is h times the squares of the residuals at its beginning, with the Hessian of Gauss and Newton. Entries that are
constant stand as numbers in the stage; all others are computed by `prepare` from the plan. The program is one in the
changes of the plan, whose numbers stay small near the targets: single precision can solve it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy

from .._pickling import Portable
from ..filtering.manifold import Manifold, StatePart
from ..filtering.transition import runge_kutta
from ..linear.state_space import settled_covariance
from ..results.refusal import ArgumentError
from .kernels import loops
from .options import FOREVER, AxisServo, ControlHorizon, Measurement, numbers
from .servo import ServoedAxes
from .stage import HorizonStage, LimitedRow
from .stage_qp import StageQP
from .statement import Statement

SX = ca.SX
STANDSTILL = 1e-7  # largest rate at the targets, relative to 1
OF_A_SIDE = 27  # operations in an iteration
# s: under a servo the force of a cycle errs by what the disturbance changes in this time. A servo acts on an error of
# the model (payload, gains, a further delay) within cycles, faster than a random walk of the disturbance tells
UNMODELLED = 0.1
SINGULAR = 1e-9  # share of the trace that keeps the step of `locate` finite


class _Entries:
    """Entries of matrices: numbers where they are constant, else symbols whose values are collected."""

    def __init__(self) -> None:
        self.symbols: list[Any] = []
        self.values: list[Any] = []
        self._known: dict[int, Any] = {}

    def of(self, value: Any) -> Any:
        value = SX(value)
        if value.is_constant():
            return value
        key = value.element_hash()
        if key not in self._known:
            self._known[key] = SX.sym(f"data_{len(self.symbols)}")
            self.symbols.append(self._known[key])
            self.values.append(value)
        return self._known[key]

    def of_matrix(self, M: Any) -> Any:
        result = SX(M.sparsity())
        rows, columns = M.sparsity().get_triplet()
        for i, j in zip(rows, columns, strict=True):
            result[i, j] = self.of(M[i, j])
        return result

    def affine(self, e: Any, z: Any, at: Any) -> Any:
        """The expression linearised at z, in the changes `at` of z."""
        return ca.mtimes(self.of_matrix(ca.jacobian(e, z)), at) + self.of_matrix(ca.densify(e))

    @property
    def column(self) -> Any:
        return ca.vertcat(SX(0, 1), *self.symbols)


@dataclass(frozen=True, eq=False)
class Standstill(Portable):
    """State and input at rest at the targets, and their derivatives by the references."""

    x: np.ndarray
    w: np.ndarray
    x_p: np.ndarray
    w_p: np.ndarray
    hold: Any  # inputs of the model, an expression of p


@dataclass(frozen=True, eq=False)
class Observer(Portable):
    """Gains of the steady-state Kalman filter for state and disturbance, the largest innovations, and the slope of the
    readings by the state at the targets."""

    x: np.ndarray
    d: np.ndarray
    jump: np.ndarray
    slope: np.ndarray


class Discretised(Portable):
    """The program of a statement and all functions of a cycle.

    advance   x v d p            -> x after one period; under a servo also by two positions sent, and speeds
    locate    x y                -> x closer to the reading, by a step of Gauss and Newton; innovations, and those
                                    that the gains take: at the slope of the targets
    correct   x d innovations    -> x d, largest innovation over its jump
    prepare   x v d p following  -> data of a stage; following: the planned state after it
    finish    x d p              -> data of the last stage
    command   x v d p            -> inputs of the model within their limits, what these cut off, outputs; for a servo
                                    also the position to send, by the one before, and speeds
    """

    def __init__(
        self, s: Statement, horizon: ControlHorizon, measured: Mapping[str, Measurement],
        disturbance: Mapping[str, float], prices: Mapping[str, Any], price: tuple[float, float],
        servo: AxisServo | None = None,
    ) -> None:  # fmt: skip
        self.statement, self.horizon = s, horizon
        if horizon.stages == 1 and not (horizon.terminal or s.end.numel()):
            raise ArgumentError(
                "one stage without a cost after it does not see what its input does: use at least 2, or terminal=True",
                "horizon.stages",
            )
        n, m = s.x.numel(), s.v.numel()
        limited = {name for r in s.rows for name in (r.name, r.name.split("[")[0])}
        _refuse_others(prices, limited, "prices", "has no limit")
        _refuse_others(disturbance, {i.name for i in s.inputs}, "disturbance", "is no input")
        self.d = SX.sym("d", m if disturbance else 0)
        shift = self.d if disturbance else SX.zeros(m)
        self.standstill = _standstill(s)
        residuals = ca.substitute(s.residuals, s.hold, self.standstill.hold)
        moved = lambda e: ca.substitute(e, s.w, s.v + shift)  # noqa: E731
        h = horizon.stage
        after = _after(s, h, horizon.steps)
        self.step = ca.Function("step", [s.x, s.w, s.p], [after])
        self.cost = ca.Function("cost", [s.x, s.w, s.p], [h * ca.sumsqr(residuals)])
        rows = ca.vertcat(SX(0, 1), *[r.value for r in s.rows])
        self.rows = ca.Function("rows", [s.x, s.v, s.w, s.p], [rows])
        x, v, entries = SX.sym("x", n), SX.sym("u", m), _Entries()
        z, at = ca.vertcat(s.x, s.v), ca.vertcat(x, v)
        following = SX.sym("following", n)
        after_qp = entries.affine(moved(after) - following, z, at)
        cost = _quadratic(entries, moved(residuals), z, at, h)
        limits = _limits(entries, s, moved(rows), z, at, range(len(s.rows)), prices, price)
        stage = HorizonStage(x, v, entries.column, after_qp, cost, limits)
        self.prepare = _function("prepare", [s.x, s.v, self.d, s.p, following], entries.values)
        end, x_end = _Entries(), SX.sym("x", n)
        soft = [k for k, r in enumerate(s.rows) if r.soft]
        self.matrices = self._matrices(residuals, after)
        self.terminal = self._terminal() if horizon.terminal else np.zeros((n, n))
        rest = self.standstill
        goal = SX(rest.x) + (ca.mtimes(SX(rest.x_p), s.p - SX(s.targets)) if s.p.numel() else 0)
        final = _quadratic(end, s.end, s.x, x_end, 1.0)
        away = s.x - goal
        final += ca.dot(x_end, ca.mtimes(SX(self.terminal), x_end)) / 2
        final += ca.dot(end.of_matrix(ca.densify(ca.mtimes(SX(self.terminal), away))), x_end)
        final += end.of(ca.dot(away, ca.mtimes(SX(self.terminal), away)) / 2)
        self.final_cost = ca.Function(
            "final", [s.x, s.p],
            [ca.sumsqr(s.end) + ca.dot(away, ca.mtimes(SX(self.terminal), away)) / 2],
        )  # fmt: skip
        limits = _limits(end, s, rows, s.x, x_end, soft, prices, price)
        last = HorizonStage(x_end, None, end.column, None, final, limits)
        self.finish = _function("finish", [s.x, self.d, s.p], end.values)
        self.qp = StageQP(
            stage, horizon.stages, last, tolerance=horizon.tolerance, max_iterations=horizon.max_iterations
        )
        period = _after(s, horizon.period, horizon.steps)
        self.servo = (
            None if servo is None else ServoedAxes(s, (self.standstill.x, self.standstill.w), servo, horizon.period)
        )
        commanded, before, speeds = list[Any](), SX.sym("before", m), SX.sym("speeds")
        predicted, forces = moved(period), ca.substitute(s.forces, s.w, s.v)
        at_end = lambda e: ca.substitute(moved(e), s.x, moved(period))  # noqa: E731
        later = ca.substitute(forces, s.x, moved(period))
        if self.servo:
            commanded = [SX.sym("sent", 2 * m), speeds]
            predicted += self.servo.response(moved, at_end, (forces, later), *commanded)
        self.advance = _function("advance", [s.x, s.v, self.d, s.p, *commanded], [predicted])
        self.observer = self._observer(predicted, commanded, measured, disturbance)
        self.locate, self.correct = self._location(), self._correction()
        bounded = ca.vertcat(*[
            _bounded(forces[k], low, high)
            for k, (low, high) in enumerate(zip(s.force_low.tolist(), s.force_high.tolist(), strict=True))
        ])  # fmt: skip
        clipped = SX(0)
        for k in range(forces.numel()):
            clipped = ca.fmax(clipped, ca.fabs(forces[k] - bounded[k]))
        arguments, results = [s.x, s.v, self.d, s.p], [bounded, clipped, at_end(s.outputs) if s.shown else SX(0, 1)]
        if self.servo:
            arguments += [before, speeds]
            results.append(self.servo.command(moved, at_end, (bounded, bounded + later - forces), before, speeds))
        self.command = _functions("command", arguments, results)

    @property
    def operations(self) -> int:
        """Operations of a cycle with ten iterations."""
        often = {"given": 0, "pull": 2, "move": 2, "offset": 2, "fed": 2}
        functions = self.qp.kernels[0] | loops(self.qp.stage)
        each = sum(often.get(k, 1) * f.n_instructions() for k, f in functions.items())
        each += OF_A_SIDE * self.qp.stage.positives
        return self.horizon.stages * (self.prepare.n_instructions() + 10 * each)

    def _matrices(self, residuals: Any, after: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A, B, and the Hessian of Gauss and Newton at the standstill."""
        s, rest = self.statement, self.standstill
        z = ca.vertcat(s.x, s.w)
        f = ca.Function("f", [z, s.p], [ca.jacobian(after, z), ca.jacobian(residuals, z)])
        G, J = (np.asarray(ca.DM(v).full()) for v in f(np.concatenate([rest.x, rest.w]), s.targets))
        n = s.x.numel()
        return G[:, :n], G[:, n:], 2 * self.horizon.stage * J.T @ J

    def _terminal(self) -> np.ndarray:
        A, B, H = self.matrices
        n = len(A)
        try:
            P = scipy.linalg.solve_discrete_are(A, B, H[:n, :n], H[n:, n:], s=H[:n, n:])
        except (np.linalg.LinAlgError, ValueError):
            P = np.full((n, n), np.nan)
        if not np.all(np.isfinite(P)):
            raise ArgumentError(
                "the Riccati equation at the targets has no solution: give a tolerance to every input or its rate, and "
                "to what must come to rest; or set terminal=False",
                "tolerances",
            )
        return (P + P.T) / 2

    def _observer(
        self, predicted: Any, commanded: list[Any], measured: Mapping[str, Measurement],
        disturbance: Mapping[str, float],
    ) -> Observer | None:  # fmt: skip
        s, rest, n, m = self.statement, self.standstill, self.statement.x.numel(), self.statement.v.numel()
        if not measured:
            if disturbance:
                raise ArgumentError("a disturbance is estimated from measurements; name them", "measured")
            return None
        if not disturbance:
            raise ArgumentError(
                "expected the disturbances between which and the noise the filter weighs", "disturbance"
            )
        parts = [(predicted, s.x), (predicted, self.d), (s.measured, s.x), (s.forces, s.w)]
        arguments = [s.x, s.w, s.v, self.d, s.p, *commanded]
        f = ca.Function("f", arguments, [ca.jacobian(e, by) for e, by in parts])
        holding = [np.tile(self.servo.holding, 2), 1.0] if self.servo else []
        values = f(rest.x, rest.w, rest.w, 0.0, s.targets, *holding)
        A, B, C, force = (np.asarray(ca.DM(v).full()) for v in values)
        spread = np.concatenate([np.full(i.size, _spread(disturbance, i.name)) for i in s.inputs])
        back = np.linalg.inv(force)
        S = back @ np.diag(spread**2) @ back.T * self.horizon.period
        F = np.block([[A, B], [np.zeros((m, n)), np.eye(m)]])
        fast = S if self.servo is None else S * (UNMODELLED / self.horizon.period)
        Q = np.block([[B @ fast @ B.T, np.zeros((n, m))], [np.zeros((m, n)), S]])
        names = [(k.name, k.size) for k in s.sensors]
        R = np.concatenate([np.full(size, measured[name].deviation ** 2) for name, size in names])
        H = np.hstack([C, np.zeros((len(R), m))])
        try:
            with np.errstate(all="ignore"):
                P = settled_covariance(F, H, Q, R)
        except (np.linalg.LinAlgError, ValueError):
            raise ArgumentError(
                "these measurements do not determine the state and the disturbances of all inputs: measure more; or "
                "their deviations are too small beside the disturbances: raise them",
                "measured",
            ) from None
        gain = np.linalg.solve(H @ P @ H.T + np.diag(R), H @ P).T
        jump = np.concatenate([np.full(size, measured[name].jump) for name, size in names])
        return Observer(gain[:n], gain[n:], jump, C)

    def _location(self) -> ca.Function:
        s, o = self.statement, self.observer
        if o is None:
            y = SX.sym("y", s.x.numel())
            return _functions("locate", [s.x, y], [y, SX(0, 1), SX(0, 1)])
        y = SX.sym("y", s.measured.numel())
        error, step, slope = y - s.measured, self._towards(y), ca.jacobian(s.measured, s.x)
        own = error
        if ca.depends_on(slope, s.x):  # the gains are those of the slope at the targets
            own = error + ca.mtimes(SX(o.slope) - slope, step)
        return _functions("locate", [s.x, y], [s.x + step, error, own])

    def _towards(self, y: Any) -> Any:
        """Change of the state towards a reading: a step of Gauss and Newton."""
        s = self.statement
        J = ca.jacobian(s.measured, s.x)
        e, (k, n) = y - s.measured, J.shape
        # least change of the state; readings of one quantity by several sensors share it
        inner = ca.mtimes(J, J.T) if k <= n else ca.mtimes(J.T, J)
        inner = ca.densify(inner + SINGULAR * ca.trace(inner) * SX.eye(min(k, n)))
        return ca.mtimes(J.T, ca.solve(inner, e)) if k <= n else ca.solve(inner, ca.mtimes(J.T, e))

    def _correction(self) -> ca.Function:
        s, o = self.statement, self.observer
        if o is None:
            return _functions("correct", [s.x, self.d, SX(0, 1), SX(0, 1)], [s.x, self.d, SX(0)])
        e, own = SX.sym("e", s.measured.numel()), SX.sym("own", s.measured.numel())
        far = SX(0)
        for k in np.flatnonzero(o.jump < FOREVER).tolist():  # which float cannot hold
            far = ca.fmax(far, ca.fabs(e[k]) / float(o.jump[k]))
        x, d = s.x + ca.mtimes(SX(o.x), own), self.d + ca.mtimes(SX(o.d), own)
        return _functions("correct", [s.x, self.d, e, own], [x, d, far])


def _bounded(e: Any, low: float, high: float) -> Any:
    e = ca.fmin(e, high) if np.isfinite(high) else e
    return ca.fmax(e, low) if np.isfinite(low) else e


def _refuse_others(given: Mapping[str, Any], known: set[str], argument: str, what: str) -> None:
    for name in given:
        if name not in known:
            raise ArgumentError(f"'{name}' {what}; expected {', '.join(sorted(known)) or 'none'}", argument)


def _spread(disturbance: Mapping[str, float], name: str) -> float:
    if name not in disturbance:
        raise ArgumentError(f"'{name}' has none; give one for every input", "disturbance")
    if not 0 < disturbance[name] < np.inf:
        raise ArgumentError("expected more than 0", f"disturbance.{name}")
    return disturbance[name]


def _function(name: str, arguments: list[Any], values: list[Any]) -> ca.Function:
    return _functions(name, arguments, [ca.vertcat(SX(0, 1), *values)])


def _functions(name: str, arguments: list[Any], results: list[Any]) -> ca.Function:
    return ca.Function(name, arguments, [ca.densify(SX(r)) for r in results], {"cse": True})


def _after(s: Statement, length: float, steps: int) -> Any:
    """State after `length` [s] with the input held."""
    space = Manifold([StatePart("x", size=s.x.numel(), unit="?")])
    f = ca.Function("rates", [s.x, s.w, s.p], [s.rates])

    def rates(t: Any, x: Any, u: Any, w: Any) -> Any:
        return f(x, s.w, s.p)

    x = s.x
    for _ in range(steps):
        x = runge_kutta(space, rates, 0.0, length / steps, x, s.w, s.w, None)
    return ca.cse(x)


def _quadratic(entries: _Entries, residuals: Any, z: Any, at: Any, h: float) -> Any:
    """h times the squares of residuals, by Gauss and Newton, in the changes `at` of z."""
    if not residuals.numel():
        return SX(0)
    J = ca.jacobian(residuals, z)
    H = ca.triu2symm(entries.of_matrix(ca.triu(2 * h * ca.mtimes(J.T, J))))
    g = entries.of_matrix(2 * h * ca.mtimes(J.T, residuals))
    return ca.dot(at, ca.mtimes(H, at)) / 2 + ca.dot(g, at) + entries.of(h * ca.sumsqr(residuals))


def _limits(
    entries: _Entries, s: Statement, rows: Any, z: Any, at: Any, chosen: Any, prices: Mapping[str, Any],
    price: tuple[float, float],
) -> list[LimitedRow]:  # fmt: skip
    limits = []
    for k in chosen:
        r = s.rows[k]
        value = entries.affine(rows[k] / r.size, z, at)
        low, high = (b / r.size if np.isfinite(b) else None for b in (r.low, r.high))
        name = r.name if r.name in prices else r.name.split("[")[0]
        given = price if r.soft else None
        if name in prices:
            own = numbers(prices[name], f"prices.{name}")
            if own.shape != (2,) or not (np.all((own >= 0) & np.isfinite(own)) and own.any()):
                raise ArgumentError(
                    f"expected a linear and a quadratic price of at least 0, not both 0; found {prices[name]!r}",
                    f"prices.{name}",
                )
            given = (float(own[0]), float(own[1]))
        limits.append(LimitedRow(value, low, high, given))
    return limits


def _standstill(s: Statement) -> Standstill:
    """Where the rates vanish and the squares of the residuals are least."""
    n, z = s.x.numel(), ca.vertcat(s.x, s.w)
    kept = [r for r in ca.vertsplit(s.residuals) if not ca.depends_on(r, s.hold)] if s.residuals.numel() else []
    r = ca.vertcat(SX(0, 1), *kept)
    nlp = {"x": z, "p": s.p, "f": ca.sumsqr(r) if kept else SX(0), "g": s.rates}
    options = {
        "ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-12, "show_eval_warnings": False,
    }  # fmt: skip
    solver = ca.nlpsol("standstill", "ipopt", nlp, options)
    guess = np.concatenate([s.start, np.zeros(s.w.numel())])
    rest = np.asarray(solver(x0=guess, p=s.targets, lbg=0, ubg=0)["x"].full())[:, 0]
    J, G = ca.jacobian(r, z), ca.jacobian(s.rates, z)
    parts = [J, G, ca.jacobian(r, s.p), ca.jacobian(s.rates, s.p), s.rates, s.forces]
    J, G, J_p, G_p, rates, forces = (
        np.asarray(ca.DM(v).full()) for v in ca.Function("f", [z, s.p], parts)(rest, s.targets)
    )
    forces = forces[:, 0]
    largest = np.abs(rates).max(initial=0.0)
    if not all(np.all(np.isfinite(v)) for v in (J, G, J_p, G_p, rates, forces)):
        raise ArgumentError(
            "the equations or their slopes are not finite at the targets, as out of a robot's reach: move the targets",
            "targets",
        )
    if largest > STANDSTILL:
        raise ArgumentError(
            f"no standstill was found at the targets, from the start values and inputs of 0, but a rate of "
            f"{largest:.3g}: give targets that inputs can hold, or start values nearer to them", "targets",
        )  # fmt: skip
    room = STANDSTILL * (1 + np.abs(forces))
    if beyond := np.flatnonzero((forces < s.force_low - room) | (forces > s.force_high + room)).tolist():
        k, names = beyond[0], [f"{i.name}[{j}]" if i.size > 1 else i.name for i in s.inputs for j in range(i.size)]
        raise ArgumentError(
            f"holding them takes {names[k]} = {forces[k]:.4g}, beyond its limits {s.force_low[k]:g} to "
            f"{s.force_high[k]:g}", "targets",
        )  # fmt: skip
    with np.errstate(over="ignore"):
        kkt, right = np.block([[J.T @ J, G.T], [G, np.zeros((n, n))]]), np.vstack([J.T @ J_p, G_p])
    if not (np.all(np.isfinite(kkt)) and np.all(np.isfinite(right))):
        raise ArgumentError("the squares of the cost overflow: a tolerance is too small", "tolerances")
    change = -np.linalg.lstsq(kkt, right, rcond=None)[0][: z.numel()]
    by_z = np.asarray(ca.DM(ca.Function("f", [z], [ca.jacobian(s.forces, z)])(rest)).full())
    hold = SX(forces) + (ca.mtimes(SX(by_z @ change), s.p - SX(s.targets)) if s.p.numel() else 0)
    return Standstill(rest[:n], rest[n:], change[:n], change[n:], hold)
