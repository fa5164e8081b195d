"""Plants of a simulated controller: the drives of eq. (6.11), or the rigid-body robot under a servo; either may carry
its arm on springs."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np
import scipy

from .._pickling import PortableError
from ..compiler.causal import CausalFunction
from ..results.agreement import numbers_of


class PlantStopped(PortableError, RuntimeError):
    """The plant failed on the way; holds one sentence and the time until which the plant worked [s]."""

    def __init__(self, sentence: str, time: float) -> None:
        super().__init__(sentence)
        self.time = time


class Plant(Protocol):
    """A plant with carts. `position_m`: carts as the motors measure them [m]; `arm_m`: the arm's side of the carts,
    which the motors do not measure [m]. `step` advances one cycle under commanded positions [m] and speeds [m/s], one
    per cart."""

    @property
    def position_m(self) -> np.ndarray: ...

    @property
    def arm_m(self) -> np.ndarray: ...

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None: ...


class PlantSource(Protocol):
    """Factory that returns a new plant at its start for every run, from a cycle [s]; for example `gt.fmu.PlantUnit`.

    The plant raises PlantStopped if it fails. It may have attributes `title`, its name, and `servo`, whose stiffness
    the law dynamics needs.
    """

    def __call__(self, cycle_s: float) -> Plant: ...


class DrivePlant:
    """Drives under closed-loop position control, b q^-d / (1 - a q^-1) about the start (Dressler 2012, eq. (6.11)).

    The commanded speed is not used.
    """

    def __init__(self, start_m: Sequence[float], a: Sequence[float], b: Sequence[float], delay: int) -> None:
        self.start_m = np.array(start_m, dtype=float)
        self.position_m = self.start_m.copy()
        self.a, self.b = np.array(a, dtype=float), np.array(b, dtype=float)
        # a command is measured `delay` cycles later; the step itself is one of them
        self._pipe: deque[np.ndarray] = deque([np.zeros_like(self.start_m)] * (delay - 1))

    @property
    def arm_m(self) -> np.ndarray:
        """Position of the carts [m]: these drives are rigid."""
        return self.position_m

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None:
        self._pipe.append(_per_cart(position_m, len(self.start_m), "position_m") - self.start_m)
        moved = self.a * (self.position_m - self.start_m) + self.b * self._pipe.popleft()
        self.position_m = self.start_m + moved


@dataclass(frozen=True)
class Servo:
    """Position servo of every cart or joint: F = kp (u - q) + kd (du - dq) in every substep of a cycle.

    u, du: commanded position and speed; q, dq: position and speed of the cart or joint; gains in N/m and N s/m, or in
    N.m/rad and N.m.s/rad, one number or one for each.
    """

    kp_N_m: float | tuple[float, ...] = 40_000.0
    kd_N_s_m: float | tuple[float, ...] = 1_500.0
    substeps: int = 8


class RigidBodyPlant:
    """The robot as rigid bodies with motors under a servo; within a cycle the command moves at the commanded speed.

    Args:
        forward_dynamics: CausalFunction of (T, der(T), tau) -> der(T,2), or of (q, der(q), tau) -> der(q,2), inputs in
            any order.
        velocity: CausalFunction of (T, der(T)) -> q, der(q); None if the state is q.
        start: T or q at the start, at rest [m, rad]; the robot sags until its servo makes the holding force.
        servo: gains and substeps.
        cycle_s: cycle [s].

    limit_N: largest force of each motor [N, N m], at which it saturates. force_N: what the servo asked for at each
    substep of the last cycle, (substeps, n).
    """

    def __init__(
        self,
        forward_dynamics: CausalFunction,
        velocity: CausalFunction | None,
        start: Sequence[float],
        servo: Servo | None = None,
        cycle_s: float = 0.004,
    ) -> None:
        self.servo = servo or Servo()
        self._step, self._carts = _cycle(forward_dynamics, velocity, self.servo, cycle_s)
        self.limit_N, self.force_N = math.inf, np.zeros((0, len(start)))
        self._state = np.concatenate([start, np.zeros(len(start))])
        self.position_m = np.array(self._carts(self._state)).ravel()

    @property
    def arm_m(self) -> np.ndarray:
        """Position of the carts [m]: this robot is rigid."""
        return self.position_m

    @property
    def tcp_m(self) -> np.ndarray:
        """Tool centre point [m]; q [rad] if that is the state."""
        return self._state[: len(self._state) // 2]

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None:
        n = len(self.position_m)
        u, du = _per_cart(position_m, n, "position_m"), _per_cart(speed_m_s, n, "speed_m_s")
        state, force = (np.array(v) for v in self._step(self._state, u, du, self.limit_N))
        self._state, self.force_N = state.ravel(), force.T
        self.position_m = np.array(self._carts(self._state)).ravel()


class ElasticPlant:
    """The arm's side of each cart on a spring and a damper, e'' + 2 zeta w e' + w^2 e = -m'' with w = 2 pi f.

    m is the motor's side, `plant`; the arm does not act back on it (stiff control or a high gear ratio). The deflection
    e is exact if m is linear within each cycle.

    Args:
        frequency_Hz: f, natural frequency of the arm's side with the motor fixed, above zero.
        damping: zeta, not negative.
    """

    def __init__(self, plant: Plant, frequency_Hz: float, damping: float = 0.05, cycle_s: float = 0.004) -> None:
        if not (0 < frequency_Hz < math.inf and 0 <= damping < math.inf):
            raise ValueError(f"expected frequency > 0 and damping >= 0; found {frequency_Hz} Hz, {damping}")
        w = 2 * np.pi * frequency_Hz
        self.plant, self.cycle_s = plant, cycle_s
        self._transition = scipy.linalg.expm(cycle_s * np.array([[0.0, 1.0], [-(w**2), -2 * damping * w]]))
        self._deflection = np.zeros((2, len(plant.position_m)))  # e and e'
        self._slope = np.zeros(len(plant.position_m))

    @property
    def position_m(self) -> np.ndarray:
        """Motor side, measured by the controller [m]."""
        return self.plant.position_m

    @property
    def arm_m(self) -> np.ndarray:
        """Arm side, which moves the tool [m]."""
        return self.plant.arm_m + self._deflection[0]

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None:
        before = self.plant.arm_m.copy()
        self.plant.step(position_m, speed_m_s)
        slope = (self.plant.arm_m - before) / self.cycle_s
        self._deflection[1] -= slope - self._slope  # m'' of a piecewise linear m is a step of its rate
        self._deflection = self._transition @ self._deflection
        self._slope = slope


def _per_cart(values: Sequence[float], carts: int, argument: str) -> np.ndarray:
    """Return commands as an array. Raises ArgumentError unless there is one number for each cart."""
    return numbers_of([f"cart {k + 1}" for k in range(carts)], values, argument)


def _cycle(
    forward: CausalFunction, velocity: CausalFunction | None, servo: Servo, cycle_s: float
) -> tuple[ca.Function, ca.Function]:
    """Return (state, u, du, limit) -> state after a cycle, with fourth-order Runge-Kutta, and the forces that the servo
    asks for; and state -> carts."""
    size = forward.outputs[0].shape[0]
    x, u, du, t = ca.SX.sym("x", 2 * size), ca.SX.sym("u", size), ca.SX.sym("du", size), ca.SX.sym("t")
    state = {0: x[:size], 1: x[size:]}
    q, dq = (x[:size], x[size:]) if velocity is None else _call(velocity, state)
    wanted = ca.DM(servo.kp_N_m) * (u + t * du - q) + ca.DM(servo.kd_N_s_m) * (du - dq)
    limit = ca.SX.sym("limit")
    (acceleration,) = _call(forward, state, ca.fmin(ca.fmax(wanted, -limit), limit))
    motion = ca.Function("rate", [x, u, du, t, limit], [ca.vertcat(x[size:], acceleration), wanted])
    h, state, forces = cycle_s / servo.substeps, x, []

    def rate(x: ca.SX, u: ca.SX, du: ca.SX, t: float) -> ca.SX:
        return motion(x, u, du, t, limit)[0]

    for n in range(servo.substeps):
        time = n * h
        forces.append(motion(state, u, du, time, limit)[1])
        k1 = rate(state, u, du, time)
        k2 = rate(state + h / 2 * k1, u, du, time + h / 2)
        k3 = rate(state + h / 2 * k2, u, du, time + h / 2)
        k4 = rate(state + h * k3, u, du, time + h)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    cycle = ca.Function("cycle", [x, u, du, limit], [state, ca.horzcat(*forces)])
    return cycle, ca.Function("carts", [x], [q])


def _call(function: CausalFunction, state: dict[int, ca.SX], tau: ca.SX | None = None) -> list[ca.SX]:
    arguments = [tau if tau is not None and "tau" in s.name else state[s.pairs[0][1]] for s in function.inputs]
    results = function.casadi.call(arguments)
    return list(results[: len(function.outputs)])
