"""From one instant to the next: a process in discrete time, exactly where it is linear."""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..linear.state_space import ramped
from ..results.refusal import ArgumentError
from .manifold import Manifold, RowsFunction
from .process import ProcessEquations

TAYLOR = 6  # terms of exp(A s) in the covariance of noise; (0.3)^6 / 6! is 1e-6 of it
# nodes and weights of Gauss on [0, 1]: exact for the integrals of s^5, so for three integrators behind white noise
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
GAUSS = tuple(zip((_NODES + 1) / 2, _WEIGHTS / 2, strict=True))
DECAYED = 4.0  # time constants in one of Van Loan's exponentials, which loses exp(2 * 4) = 3e3 round-offs there
STIFF = 1.0  # the fastest rate of the errors times a step of Runge and Kutta, which is off by 1/120 of it then
ON_GRID = 1e-6  # of a period; stamps are rounded


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
        self.decay = max(0.0, float(-np.linalg.eigvals(A).real.min())) if len(A) else 0.0  # the fastest [1/s]
        self._made: dict[float, tuple[np.ndarray, ...]] = {}

    def with_intensity(self, intensity: np.ndarray) -> LinearTransition:
        """The same with other densities of noise (nw, nw)."""
        return LinearTransition(self.A, self.B, self.c, self.G, intensity)

    def matrices(self, dt: float) -> tuple[np.ndarray, ...]:
        """F, those of the inputs at the begin and at the end, the constant part, and Q."""
        if dt not in self._made:
            F, first, last = ramped(self.A, np.column_stack([self.B, self.c]), dt)
            Q = self._covariance(dt)
            if len(self._made) > MOST_STEPS:
                self._made.pop(next(iter(self._made)))
            self._made[dt] = F, first[:, :-1], last[:, :-1], first[:, -1] + last[:, -1], (Q + Q.T) / 2
        return self._made[dt]

    def _covariance(self, dt: float) -> np.ndarray:
        """Of the noise of a step (n, n). What decays within it grows in exp(-A dt), so a step of many time constants is
        doubled from a short one: a sum of covariances, which stays one."""
        from scipy.linalg import expm

        n = len(self.A)
        doublings = max(0, int(np.ceil(np.log2(max(self.decay * abs(dt) / DECAYED, 1e-300)))))
        loan = expm(np.block([[-self.A, self.noise], [np.zeros((n, n)), self.A.T]]) * (dt / 2**doublings))
        F = loan[n:, n:].T
        Q = F @ loan[:n, n:]
        for _ in range(doublings):
            F, Q = F @ F, F @ Q @ F.T + Q
        return Q

    def __call__(self, t: float, dt: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        F, first, last, constant, Q = self.matrices(dt)
        return Advance(x @ F.T + u0 @ first.T + u1 @ last.T + constant, F, Q)


MOST_PARTS = 10_000  # of one step: a hundred thousand steps a second are more than a filter is for
MOST_STEPS = 1000  # lengths of step whose exponentials are kept: uneven logs have many


class CurvedTransition:
    """Of any process: Runge and Kutta's fourth order, with the Jacobian of that very step on the manifold.

    The covariance of the noise is the integral of exp(A s) G q G' exp(A's) at the begin of the step, by Gauss.
    longest: steps are cut into equal parts of at most this [s], and into shorter ones where the errors have rates that
    are too fast for it.
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
        # no slower than the fastest eigenvalue but where several cancel: of any units, since traces have none
        fastest = ca.fmax(ca.fabs(ca.trace(A)), ca.sqrt(ca.fabs(ca.trace(ca.mtimes(A, A)))))
        self.function = RowsFunction("transition", [t, dt, x, u0, u1, root], [after, F, Q, fastest], (1, 2))
        self.root = np.sqrt(np.diag(dynamics.intensity))

    def with_intensity(self, intensity: np.ndarray) -> CurvedTransition:
        """The same with other densities of noise (nw, nw); nothing is compiled anew."""
        other = copy.copy(self)
        other.root = np.sqrt(np.diag(intensity))
        return other

    def __call__(self, t: float, dt: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        parts = max(1, int(np.ceil(abs(dt) / self.longest - 1e-9)))
        if parts == 1:
            return self._part(t, dt, x, u0, u1)
        h, u = dt / parts, [u0 + (u1 - u0) * (k / parts) for k in range(parts + 1)]
        made = self._part(t, h, x, u[0], u[1])
        for k in range(1, parts):
            made = made.then(self._part(t + k * h, h, made.x, u[k], u[k + 1]))
        return made

    def _part(self, t: float, h: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        """One step, halved as often as the fastest rate there asks for."""
        after, F, Q, fastest = self.function(t, h, x, u0, u1, self.root)
        rate = float(fastest.max())
        if abs(h) * rate <= STIFF or not rate < np.inf:  # what is not finite stays so in shorter steps
            return Advance(after, F, Q)
        if abs(h) * rate > STIFF * MOST_PARTS:
            raise ArgumentError(
                f"the process has a time constant of {1 / rate:.3g} s at {t:g} s, far shorter than a step of {h:g} s; "
                "take what settles so fast as settled, in the model",
                "process",
            )
        middle = (u0 + u1) / 2
        first = self._part(t, h / 2, x, u0, middle)
        return first.then(self._part(t + h / 2, h / 2, first.x, middle, u1))


class GivenTransition:
    """Of a process that is written as its step, with time and known inputs at the begin of each."""

    def __init__(self, dynamics: ProcessEquations, space: Manifold, rates: Any) -> None:
        self.period, self.Q = float(dynamics.period or 0.0), np.zeros((space.dimension, space.dimension))
        own = dynamics.space.dimension
        self.Q[:own, :own] = dynamics.intensity
        x, t, u = dynamics.symbol("x", space.size), dynamics.symbol("t"), dynamics.columns()["u"]
        after = space.to_unit(rates(t, x, u, ca.DM.zeros(0)))
        F = ca.mtimes([space.to_error(after), ca.jacobian(after, x), space.from_error(x)])
        self._own = own
        self.function = RowsFunction("transition", [t, x, u], [after, F], (1,))

    def with_intensity(self, intensity: np.ndarray) -> GivenTransition:
        """The same with another covariance of each step."""
        other = copy.copy(self)
        other.Q = np.zeros_like(self.Q)
        other.Q[: self._own, : self._own] = intensity
        return other

    def __call__(self, t: float, dt: float, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> Advance:
        made = Advance(x, np.eye(len(self.Q)), np.zeros_like(self.Q))
        steps = round(dt / self.period)
        resolution = 4 * np.spacing(abs(t) + abs(dt))  # of stamps, such as those of a clock that counts from 1970
        if abs(dt - steps * self.period) > ON_GRID * self.period * max(1, steps) + resolution:
            raise ArgumentError(
                f"from {t:g} s to the next reading it is {dt:g} s, no multiple of the process's period of "
                f"{self.period:g} s; bring readings and delays to its instants, or take a ProcessModel",
                "log",
            )
        for k in range(steps):
            share = k / steps
            after, F = self.function(t + share * dt, made.x, u0 + share * (u1 - u0))
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
