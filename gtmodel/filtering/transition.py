"""Transition from one instant to the next: discretisation of a process, exact if it is linear."""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..linear.state_space import ramped
from ..results.refusal import ArgumentError
from .manifold import Manifold, RowsFunction
from .process import ProcessEquations

TAYLOR = 6  # terms of exp(A s) in the covariance of noise; 0.3^6 / 6! is 1e-6
# Gauss nodes and weights on [0, 1]: exact for integrals of s^5, so for three integrators behind white noise
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
GAUSS = tuple(zip((_NODES + 1) / 2, _WEIGHTS / 2, strict=True))
DECAYED = 4.0  # time constants per exponential of Van Loan; it loses a factor exp(2 * 4) = 3e3 of precision there
STIFF = 1.0  # largest product of the fastest rate and a Runge-Kutta step: the truncation error is then 1/120
ON_GRID = 1e-6  # of a period; stamps are rounded


class Advance(NamedTuple):
    """One step for rows of states: the states after it (m, size), Jacobian F and covariance Q of their errors, (n, n)
    for all rows or (m, n, n)."""

    x: np.ndarray
    F: np.ndarray
    Q: np.ndarray

    def then(self, next: Advance) -> Advance:
        """Return this step followed by the next one, as one step."""
        return Advance(next.x, next.F @ self.F, next.F @ self.Q @ np.swapaxes(next.F, -1, -2) + next.Q)


def carried(F: np.ndarray, P: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Covariances (m, n, n) after a step: F P F' + Q; F and Q are (n, n) or (m, n, n)."""
    if len(P) > 1:
        return F @ P @ F.mT + Q
    F, Q = (M if M.ndim == 2 else M[0] for M in (F, Q))  # plain matrices take half the time of stacks
    after = np.dot(np.dot(F, P[0]), F.T)
    after += Q
    return after[None]


class LinearTransition:
    """Transition of a linear process with constant coefficients: matrix exponentials, cached by step length.

    Noise covariance after Van Loan 1978, IEEE Trans. Autom. Control 23, 395-404; known inputs are linear in time
    between the two instants.
    """

    def __init__(self, A: np.ndarray, B: np.ndarray, c: np.ndarray, G: np.ndarray, intensity: np.ndarray) -> None:
        self.A, self.B, self.c, self.G, self.noise = A, B, c, G, G @ intensity @ G.T
        self.decay = max(0.0, float(-np.linalg.eigvals(A).real.min())) if len(A) else 0.0  # fastest decay rate [1/s]
        self._cache: dict[float, tuple[np.ndarray, ...]] = {}

    def with_intensity(self, intensity: np.ndarray) -> LinearTransition:
        """Return the same transition with other noise densities (nw, nw)."""
        return LinearTransition(self.A, self.B, self.c, self.G, intensity)

    def matrices(self, dt: float) -> tuple[np.ndarray, ...]:
        """Return F, the input matrices for the start and the end of the step, the constant part, and Q."""
        if dt not in self._cache:
            F, first, last = ramped(self.A, np.column_stack([self.B, self.c]), dt)
            Q = self._covariance(dt)
            if len(self._cache) > MOST_STEPS:
                self._cache.pop(next(iter(self._cache)))
            self._cache[dt] = F, first[:, :-1], last[:, :-1], first[:, -1] + last[:, -1], (Q + Q.T) / 2
        return self._cache[dt]

    def _covariance(self, dt: float) -> np.ndarray:
        """Covariance of the noise of a step (n, n). With exp(-A dt) a step of many time constants loses precision, so
        it is doubled from a short one; each doubling is a sum of covariances."""
        from scipy.linalg import expm

        n = len(self.A)
        doublings = max(0, int(np.ceil(np.log2(max(self.decay * abs(dt) / DECAYED, 1e-300)))))
        loan = expm(np.block([[-self.A, self.noise], [np.zeros((n, n)), self.A.T]]) * (dt / 2**doublings))
        F: np.ndarray = loan[n:, n:].T
        Q: np.ndarray = F @ loan[:n, n:]
        for _ in range(doublings):
            F, Q = F @ F, F @ Q @ F.T + Q
        return Q

    def __call__(self, t: float, dt: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        F, first, last, constant, Q = self.matrices(dt)
        after = np.dot(x, F.T)
        if self.B.size:
            after = after + np.dot(u0, first.T) + np.dot(u1, last.T)
        return Advance(after + constant, F, Q)


MOST_PARTS = 10_000  # of one step: a filter is not meant for a hundred thousand steps per second
MOST_STEPS = 1000  # step lengths whose exponentials are cached: uneven logs have many


class CurvedTransition:
    """Transition of any process: fourth-order Runge-Kutta, with the Jacobian of this step on the manifold.

    The covariance of the noise is the integral of exp(A s) G q G' exp(A's), linearised at the start of the step, by
    Gauss quadrature. longest: steps are divided into equal parts of at most this [s], and further if the error
    dynamics is faster.
    """

    def __init__(self, dynamics: ProcessEquations, space: Manifold, rates: Any, longest: float) -> None:
        self.longest, self.space = longest, space
        column = dynamics.columns()
        x, t = dynamics.symbol("x", space.size), column["t"]
        u0, u1, w, dt = column["u"], dynamics.symbol("v", column["u"].numel()), column["w"], dynamics.symbol("h")
        none = ca.DM.zeros(w.numel())
        after = runge_kutta(space, rates, t, dt, x, u0, u1, none)
        F = ca.mtimes([space.to_error(after), ca.jacobian(after, x), space.from_error(x)])
        rate = rates(t, x, u0, w)
        root = dynamics.symbol("root", w.numel())
        G = ca.mtimes([space.to_error(x), ca.jacobian(rate, w), ca.diag(root)])
        G = ca.substitute(G, w, none) if w.numel() else G
        moved = space.to_unit(x + dt * rates(t, x, u0, none))  # to first order in dt, for the rates of the errors
        euler = ca.mtimes([space.to_error(moved), ca.jacobian(moved, x), space.from_error(x)])
        n = space.dimension
        A = ca.reshape(ca.jacobian(ca.vec(euler), dt), n, n)
        A = ca.substitute(A, dt, 0)
        Q = ca.DM.zeros(n, n)
        for node, weight in GAUSS:
            term = total = G
            for k in range(1, TAYLOR + 1):
                term = ca.mtimes(A, term) * (node * dt / k)
                total = total + term
            Q = Q + weight * dt * ca.mtimes(total, total.T)
        # estimate of the fastest eigenvalue, low only if several cancel; traces do not depend on the units of states
        fastest = ca.fmax(ca.fabs(ca.trace(A)), ca.sqrt(ca.fabs(ca.trace(ca.mtimes(A, A)))))
        self.function = RowsFunction("transition", [t, dt, x, u0, u1, root], [after, F, Q, fastest], (1, 2))
        self.root = np.sqrt(np.diag(dynamics.intensity))

    def with_intensity(self, intensity: np.ndarray) -> CurvedTransition:
        """Return the same transition with other noise densities (nw, nw), without compiling again."""
        other = copy.copy(self)
        other.root = np.sqrt(np.diag(intensity))
        return other

    def __call__(self, t: float, dt: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        parts = max(1, int(np.ceil(abs(dt) / self.longest - 1e-9)))
        if parts == 1:
            return self._part(t, dt, x, u0, u1)
        h, u = dt / parts, [u0 + (u1 - u0) * (k / parts) for k in range(parts + 1)]
        step = self._part(t, h, x, u[0], u[1])
        for k in range(1, parts):
            step = step.then(self._part(t + k * h, h, step.x, u[k], u[k + 1]))
        return step

    def _part(self, t: float, h: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        """One step, halved as often as the fastest rate requires."""
        after, F, Q, fastest = self.function(t, h, x, u0, u1, self.root)
        rate = float(fastest.max())
        if abs(h) * rate <= STIFF or not rate < np.inf:  # a value that is not finite stays so in shorter steps
            return Advance(after, F, Q)
        if abs(h) * rate > STIFF * MOST_PARTS:
            raise ArgumentError(
                f"the process has a time constant of {1 / rate:.3g} s at {t:g} s, far shorter than a step of {h:g} s; "
                "replace this fast dynamics by its steady state in the model",
                "process",
            )
        middle = (u0 + u1) / 2
        first = self._part(t, h / 2, x, u0, middle)
        return first.then(self._part(t + h / 2, h / 2, first.x, middle, u1))


class GivenTransition:
    """Transition of a process in discrete time; a step takes time and known inputs at its start."""

    def __init__(self, dynamics: ProcessEquations, space: Manifold, rates: Any) -> None:
        self.period, self.Q = float(dynamics.period or 0.0), np.zeros((space.dimension, space.dimension))
        n = dynamics.space.dimension
        self.Q[:n, :n] = dynamics.intensity
        x, t, u = dynamics.symbol("x", space.size), dynamics.symbol("t"), dynamics.columns()["u"]
        after = space.to_unit(rates(t, x, u, ca.DM.zeros(0)))
        F = ca.mtimes([space.to_error(after), ca.jacobian(after, x), space.from_error(x)])
        self._own = n
        self.function = RowsFunction("transition", [t, x, u], [after, F], (1,))

    def with_intensity(self, intensity: np.ndarray) -> GivenTransition:
        """Return the same transition with another covariance per step."""
        other = copy.copy(self)
        other.Q = np.zeros_like(self.Q)
        other.Q[: self._own, : self._own] = intensity
        return other

    def __call__(self, t: float, dt: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        total = Advance(x, np.eye(len(self.Q)), np.zeros_like(self.Q))
        steps = round(dt / self.period)
        resolution = 4 * np.spacing(abs(t) + abs(dt))  # of stamps, such as those of a clock that counts from 1970
        if abs(dt - steps * self.period) > ON_GRID * self.period * max(1, steps) + resolution:
            raise ArgumentError(
                f"the next reading after {t:g} s comes {dt:g} s later, which is not a multiple of the process's period "
                f"of {self.period:g} s; resample readings and delays to its instants, or use a ProcessModel",
                "log",
            )
        for k in range(steps):
            share = k / steps
            after, F = self.function(t + share * dt, total.x, u0 + share * (u1 - u0))
            step = Advance(after, F, self.Q)
            total = step if k == 0 else total.then(step)
        return total


def runge_kutta(space: Manifold, rates: Any, t: Any, dt: Any, x: Any, u0: Any, u1: Any, w: Any) -> Any:
    """Return one classical fourth-order Runge-Kutta step on CasADi columns, with inputs linear from u0 to u1."""
    middle = (u0 + u1) / 2
    k1 = rates(t, x, u0, w)
    k2 = rates(t + dt / 2, x + dt / 2 * k1, middle, w)
    k3 = rates(t + dt / 2, x + dt / 2 * k2, middle, w)
    k4 = rates(t + dt, x + dt * k3, u1, w)
    return space.to_unit(x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
