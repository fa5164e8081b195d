"""From one instant to the next: a process in discrete time, exactly where it is linear."""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from .manifold import Manifold
from .process import ProcessEquations
from .rowwise import RowsFunction

TAYLOR = 6  # terms of exp(A s) in the covariance of noise; (0.3)^6 / 6! is 1e-6 of it
# nodes and weights of Gauss on [0, 1]: exact for the integrals of s^5, so for three integrators behind white noise
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
GAUSS = tuple(zip((_NODES + 1) / 2, _WEIGHTS / 2, strict=True))


class Advance(NamedTuple):
    """One step for rows of states: the states after it (m, size), Jacobian F and covariance Q of their errors, (n, n)
    for all rows or (m, n, n)."""

    x: np.ndarray
    F: np.ndarray
    Q: np.ndarray

    def then(self, next: Advance) -> Advance:
        """This step and the next one, as one."""
        return Advance(next.x, next.F @ self.F, next.F @ self.Q @ np.swapaxes(next.F, -1, -2) + next.Q)


class LinearTransition:
    """Of a linear process with constant coefficients: matrix exponentials, kept for each length of step.

    Noise by Van Loan 1978, IEEE Trans. Autom. Control 23, 395-404; known inputs run straight between the two instants.
    """

    def __init__(self, A: np.ndarray, B: np.ndarray, c: np.ndarray, G: np.ndarray, intensity: np.ndarray) -> None:
        self.A, self.B, self.c, self.G, self.noise = A, B, c, G, G @ intensity @ G.T
        self._made: dict[float, tuple[np.ndarray, ...]] = {}

    def with_intensity(self, intensity: np.ndarray) -> LinearTransition:
        """The same with other densities of noise (nw, nw)."""
        return LinearTransition(self.A, self.B, self.c, self.G, intensity)

    def matrices(self, dt: float) -> tuple[np.ndarray, ...]:
        """F, those of the inputs at the begin and at the end, the constant part, and Q."""
        if dt not in self._made:
            from scipy.linalg import expm

            n, m = self.B.shape
            driven = np.zeros((n + 2 * m + 1, n + 2 * m + 1))
            driven[:n, :n], driven[:n, n : n + m], driven[:n, -1] = self.A, self.B, self.c
            driven[n : n + m, n + m : n + 2 * m] = np.eye(m) / dt if dt else 0.0  # no time passes: nothing moves
            E = expm(driven * dt)
            held, ramp = E[:n, n : n + m], E[:n, n + m : n + 2 * m]
            loan = expm(np.block([[-self.A, self.noise], [np.zeros((n, n)), self.A.T]]) * dt)
            F = E[:n, :n]
            Q = loan[n:, n:].T @ loan[:n, n:]
            if len(self._made) > MOST_STEPS:
                self._made.pop(next(iter(self._made)))
            self._made[dt] = F, held - ramp, ramp, E[:n, -1], (Q + Q.T) / 2
        return self._made[dt]

    def __call__(self, t: float, dt: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        F, first, last, constant, Q = self.matrices(dt)
        return Advance(x @ F.T + u0 @ first.T + u1 @ last.T + constant, F, Q)


MOST_STEPS = 1000  # lengths of step whose exponentials are kept: uneven logs have many


class CurvedTransition:
    """Of any process: Runge and Kutta's fourth order, with the Jacobian of that very step on the manifold.

    The covariance of the noise is the integral of exp(A s) G q G' exp(A's) at the begin of the step, by Gauss.
    longest: steps are cut into equal parts of at most this [s].
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
        there = space.to_unit(x + dt * rates(t, x, u0, none))  # to first order in dt, for the errors' own rates
        euler = ca.mtimes([space.to_error(there), ca.jacobian(there, x), space.from_error(x)])
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
        self.function = RowsFunction("transition", [t, dt, x, u0, u1, root], [after, F, Q], (1, 2))
        self.root = np.sqrt(np.diag(dynamics.intensity))

    def with_intensity(self, intensity: np.ndarray) -> CurvedTransition:
        """The same with other densities of noise (nw, nw); nothing is compiled anew."""
        other = copy.copy(self)
        other.root = np.sqrt(np.diag(intensity))
        return other

    def __call__(self, t: float, dt: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        parts = max(1, int(np.ceil(abs(dt) / self.longest - 1e-9)))
        if parts == 1:
            return Advance(*self.function(t, dt, x, u0, u1, self.root))
        h, u = dt / parts, [u0 + (u1 - u0) * (k / parts) for k in range(parts + 1)]
        made = Advance(*self.function(t, h, x, u[0], u[1], self.root))
        for k in range(1, parts):
            made = made.then(Advance(*self.function(t + k * h, h, made.x, u[k], u[k + 1], self.root)))
        return made


class GivenTransition:
    """Of a process that is written as its step."""

    def __init__(self, dynamics: ProcessEquations, space: Manifold, rates: Any) -> None:
        self.period, self.Q = float(dynamics.period or 0.0), np.zeros((space.dimension, space.dimension))
        own = dynamics.space.dimension
        self.Q[:own, :own] = dynamics.intensity
        x, t = dynamics.symbol("x", space.size), dynamics.symbol("t")
        after = space.to_unit(rates(t, x, ca.DM.zeros(0), ca.DM.zeros(0)))
        F = ca.mtimes([space.to_error(after), ca.jacobian(after, x), space.from_error(x)])
        self._own = own
        self.function = RowsFunction("transition", [x], [ca.substitute(after, t, 0), ca.substitute(F, t, 0)], (1,))

    def with_intensity(self, intensity: np.ndarray) -> GivenTransition:
        """The same with another covariance of each step."""
        other = copy.copy(self)
        other.Q = np.zeros_like(self.Q)
        other.Q[: self._own, : self._own] = intensity
        return other

    def __call__(self, t: float, dt: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        made = Advance(x, np.eye(len(self.Q)), np.zeros_like(self.Q))
        for k in range(round(dt / self.period)):
            after, F = self.function(made.x)
            one = Advance(after, F, self.Q)
            made = one if k == 0 else made.then(one)
        return made


def runge_kutta(space: Manifold, rates: Any, t: Any, dt: Any, x: Any, u0: Any, u1: Any, w: Any) -> Any:
    """One classical step of fourth order on CasADi columns, the inputs straight between u0 and u1."""
    middle = (u0 + u1) / 2
    k1 = rates(t, x, u0, w)
    k2 = rates(t + dt / 2, x + dt / 2 * k1, middle, w)
    k3 = rates(t + dt / 2, x + dt / 2 * k2, middle, w)
    k4 = rates(t + dt, x + dt * k3, u1, w)
    return space.to_unit(x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
