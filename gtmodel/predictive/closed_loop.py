"""The closed loop of a predictive controller near its targets, as a linear map from cycle to cycle.

With no limit active the program is the linear-quadratic regulator of its horizon, so that state, filter, delay, and
the servo that makes the forces are one matrix. Its spectral radius tells whether the loop settles.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from ..linear.state_space import held
from .discretised import Discretised

SLOWEST, FASTEST = 10.0, 3000.0  # rad/s: servos that are tried
STEPS = 12  # of the bisection between them: 0.2 %
DAMPING = (0.5, 1.0)  # of these servos


def servo_command(
    force: Any, q: Any, dq: Any, ddq: Any, before: Any, kp: Any, kd: Any, period: float, sends_speed: bool
) -> Any:
    """Return the position by which a servo makes a force, on average over a cycle of constant acceleration.

    q, dq: at the end of the cycle. before: the last position sent. kp, kd: of the servo F = kp (u - q) + kd (du - dq).
    sends_speed: the way from the command before over the period is the speed du; else du = 0.
    """
    speed = dq - ddq * (period / 2.0)
    position = (q - dq * (period / 2.0)) + ddq * ((period * period) / 6.0)
    if not sends_speed:
        return position + (force + kd * speed) / kp
    rate = kd / period
    wanted = (force + kp * position) + kd * speed
    return (wanted + (kp / 2.0 + rate) * before) / (1.5 * kp + rate)


class LinearCycle:
    """Slopes of a controller at rest at its targets."""

    def __init__(self, program: Discretised) -> None:
        s, rest = program.statement, program.standstill
        self.program, self.n, self.m = program, s.x.numel(), s.v.numel()
        d = ca.SX.zeros(program.d.numel())
        after = program.advance(s.x, s.v, d, s.p)
        shown = program.command(s.x, s.v, d, s.p)[2]
        rates, forces = (ca.substitute(e, s.w, s.v) for e in (s.rates, s.forces))
        columns = [after, shown, rates, forces]
        slopes = [ca.jacobian(e, ca.vertcat(s.x, s.v)) for e in columns]
        f = ca.Function("slopes", [s.x, s.v, s.p], slopes)
        values = [np.asarray(ca.DM(v).full()) for v in f(rest.x, rest.w, s.targets)]
        self.after, self.shown, self.rates, self.forces = ((v[:, : self.n], v[:, self.n :]) for v in values)
        self.gain = self._gain()

    def _gain(self) -> np.ndarray:
        """Gain of the horizon without limits, w = -gain x."""
        program, n = self.program, self.n
        A, B, H = program.matrices
        P: np.ndarray = program.terminal
        K = np.zeros((self.m, n))
        for _ in range(program.qp.count):
            inner = H[n:, n:] + B.T @ P @ B
            K = np.linalg.lstsq(inner, H[n:, :n] + B.T @ P @ A, rcond=None)[0]
            P = H[:n, :n] + A.T @ P @ A - (H[:n, n:] + A.T @ P @ B) @ K
        return K

    def radius(self, kp: Any = None, kd: Any = None, sends_speed: bool = True) -> float:
        """Return the spectral radius of a cycle; below 1 the loop settles.

        Without `kp`, `kd` the plant takes the inputs of the controller. With them a servo of each measured axis makes
        the forces, as in the law "predictive" of the loop; the controller must have `joint_places`.
        """
        n, m, program = self.n, self.m, self.program
        o, delay = program.observer, program.horizon.delay
        nd, k = program.d.numel(), 0 if kp is None else m
        sizes = [n, n if o is not None else 0, nd, delay * m, delay * 2 * k, k]
        ends = np.cumsum([0, *sizes])
        unit = np.eye(ends[-1])
        state, hat, d, past, pipe, before = (unit[a:b] for a, b in pairwise(ends.tolist()))
        A, B = self.after
        if o is None:
            hat = state
        else:
            missed = o.slope @ (state - hat)
            hat, d = hat + o.x @ missed, (d + o.d @ missed) if nd else d
        shift = d if nd else np.zeros((m, len(unit)))
        ahead: np.ndarray = hat
        queue = [past[j * m : (j + 1) * m] for j in range(delay)]
        for v in queue:
            ahead = A @ ahead + B @ (v + shift)
        v = -self.gain @ ahead - shift
        now = queue[0] if delay else v
        rows = [*([A @ hat + B @ (now + shift)] if o is not None else []), *([d] if nd else []), *queue[1:]]
        if delay:
            rows.append(v)
        if kp is None:
            return _radius([A @ state + B @ now, *rows])
        kp, kd = (np.broadcast_to(np.asarray(g, float), (m,))[:, None] for g in (kp, kd))
        T = program.horizon.period
        places = joint_places(program)
        assert places is not None and o is not None
        q, dq, ddq = ((self.shown[0][p] @ ahead + self.shown[1][p] @ (v + shift)) for p in places)
        force = self.forces[0] @ ahead + self.forces[1] @ v
        u = servo_command(force, q, dq, ddq, before, kp, kd, T, sends_speed)
        du = (u - before) / T if sends_speed else np.zeros_like(u)
        sent = [pipe[j * k : (j + 1) * k] for j in range(2 * delay)] + [u, du]
        state_after = self._under_servo(state, sent[0], sent[1], kp, kd)
        return _radius([state_after, *rows, *sent[2:], u])

    def _under_servo(self, x: Any, u: Any, du: Any, kp: Any, kd: Any) -> Any:
        """State after a cycle under a servo, whose command moves by du."""
        assert self.program.observer is not None
        slope, (Fx, Fw), (Ax, Bw) = self.program.observer.slope, self.forces, self.rates
        n, m = self.n, self.m
        per_force = Bw @ np.linalg.inv(Fw)
        speed = slope @ Ax
        A, B = np.zeros((n + m, n + m)), np.vstack([per_force * kd.T, np.eye(m)])
        A[:n, :n], A[:n, n:] = Ax - per_force @ (kp * slope + kd * speed + Fx), per_force * kp.T
        F, G = held(A, B, self.program.horizon.period)
        return (F @ np.vstack([x, u]) + G @ du)[:n]

    def fastest_servo(self) -> float | None:
        """Return the natural frequency [rad/s] up to which servos of the axes leave the loop stable, over EGM and RSI.

        Their damping is 0.5 or 1; each frequency is that of one axis with the others held. 0 if none is stable; None
        if the controller does not measure its axes alone, or does not return what the law of the loop needs.
        """
        if joint_places(self.program) is None:
            return None
        assert self.program.observer is not None
        slope = self.program.observer.slope
        inertia = np.diag(self.forces[1] @ np.linalg.inv(slope @ self.rates[0] @ self.rates[1]))

        def settles(rate: float) -> bool:
            return all(
                self.radius(rate**2 * inertia, 2 * damping * rate * inertia, sends_speed) < 1
                for damping in DAMPING
                for sends_speed in (True, False)
            )

        low, high = SLOWEST, FASTEST
        if not settles(low) or settles(high):
            return 0.0 if not settles(low) else high
        for _ in range(STEPS):
            middle = (low * high) ** 0.5
            low, high = (middle, high) if settles(middle) else (low, middle)
        return low


def _radius(rows: list[Any]) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(np.vstack(rows)))))


def joint_places(program: Discretised) -> list[slice] | None:
    """Places of q, der(q), der(q,2) of the axes among the outputs; None if the law of the loop lacks any."""
    s = program.statement
    if len(s.sensors) != 1 or program.observer is None or len(s.inputs) != 1 or s.sensors[0].size != s.v.numel():
        return None
    q = s.sensors[0].name
    ends = np.cumsum([0, *[k.size for k in s.shown]]).tolist()
    at = {k.name: slice(a, a + k.size) for k, a in zip(s.shown, ends, strict=False)}
    wanted = [q, f"der({q})", f"der({q},2)"]
    return [at[w] for w in wanted] if all(w in at for w in wanted) and s.inputs[0].name == f"{q[:-1]}tau" else None
