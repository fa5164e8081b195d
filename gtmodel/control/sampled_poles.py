"""Sampled loops as discrete-time linear systems: exact transition of the plant, held forces, Jacobian of the law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from gtmodel import lang as gt
from gtmodel.simulation.hybrid.clock import exact
from gtmodel.simulation.linearize import Linearization, LinearModel, labels

from .._lazy import hint
from ..linear.state_space import held_late
from .feedforward import Law
from .sampled_loop import INPUTS, Velocity, actuators, law_function

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")


def linearize_sampled(
    plant: gt.Model,
    law: Law,
    period: float = 0.004,
    delay: float = 0.008,
    *,
    start: Mapping[str, Any],
    known: str = "q",
    targets: str = "tau",
    velocity: Velocity = "measured",
) -> StateSpace:
    """Linearise the loop of `sampled_loop` about a point at rest, as a discrete-time linear system.

    Args:
        plant, law, period, delay, known, targets, velocity: as in `sampled_loop`.
        start: the point by the plant's names, e.g. {"T": [...], "der(T)": 0}; the law holds the plant there with the
            reference at its position.

    Returns a `control.StateSpace` with `dt` = period. Its states are the plant's states, named as by `gt.linearize`;
    then the forces of earlier samples that have yet to act, "forces(k-1)[0]" first; and with velocity "difference" the
    previous measured position. Inputs are the reference and its two derivatives, outputs the positions, at the samples.
    The plant's transition is exact for held forces (matrix exponential, split if the delay is not a whole number of
    periods). The law's Jacobian is exact. The loop is unstable if a pole lies outside the unit circle.

    Raises ModelError as `gt.linearize` and `sampled_loop`.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> law = gt.control.ComputedTorque(robot, stiffness=900.0, damping=60.0)
    >>> at = {"T": [0.5, -0.9, 0.3], "der(T)": 0.0}
    >>> for delay in (0.008, 0.060):
    ...     loop = gt.control.linearize_sampled(robot, law, 0.004, delay, start=at)
    ...     print(len(loop.poles()), bool(max(abs(loop.poles())) < 1))
    12 True
    51 False
    """
    (count,), _, _ = actuators(plant, known, targets)
    if not (np.isfinite(period) and period > 0 and np.isfinite(delay) and delay >= 0):
        raise gt.ModelError(f"the period must be positive and the delay not negative; found {period!r}, {delay!r} s")
    measured = [known, f"der({known})"]
    linear, jacobians = at_rest(plant, law, measured, start, targets)

    a, b, c, _ = linear.matrices
    whole, part = divmod(exact(delay), exact(period))
    transition, early, latest = held_late(a, b, float(part), float(exact(period) - part))
    late = int(whole) + (part > 0)  # earlier samples whose forces have yet to act
    n, m = len(a), late * count
    difference = velocity == "difference"
    size = n + m + count * difference
    # forces of this sample, from the state and from the reference
    state, reference = np.zeros((count, size)), np.hstack([jacobians[name] for name in INPUTS[:3]])
    state[:, :n] = jacobians["position"] @ c[:count]
    if difference:
        state[:, :n] += jacobians["velocity"] @ c[:count] / period
        state[:, n + m :] = -jacobians["velocity"] / period
    else:
        state[:, :n] += jacobians["velocity"] @ c[count:]
    A, B = np.zeros((size, size)), np.zeros((size, reference.shape[1]))
    A[:n, :n] = transition
    for j, effect in ((int(whole), latest), (int(whole) + 1, early)):
        if j == 0:
            A[:n] += effect @ state
            B[:n] += effect @ reference
        elif j <= late:
            A[:n, n + (j - 1) * count : n + j * count] += effect
    if late:
        A[n : n + count], B[n : n + count] = state, reference
        A[n + count : n + m, n : n + m - count] = np.eye(m - count)
    if difference:
        A[n + m :, :n] = c[:count]
    names = [f"forces(k-{j})[{i}]" for j in range(1, late + 1) for i in range(count)]
    names += [f"measured[{i}]" for i in range(count)] if difference else []
    from .._control import control  # slow to import, and only needed here

    loop = control.ss(
        A, B, np.hstack([c[:count], np.zeros((count, size - n))]), np.zeros((count, B.shape[1])), period,
        name=linear.title, states=[*labels(linear.states), *names],
        inputs=[f"{name}[{i}]" for name in INPUTS[:3] for i in range(count)],
        outputs=[f"position[{i}]" for i in range(count)],
    )  # fmt: skip
    assert isinstance(loop, control.StateSpace)
    return loop


def at_rest(
    plant: gt.Model, law: Law, outputs: Sequence[str], start: Mapping[str, Any], targets: str
) -> tuple[LinearModel, dict[str, np.ndarray]]:
    """Linearise plant and law about a point where the law holds the plant at rest.

    Returns the plant from its forces to `outputs`, which begin with positions and velocities, and the derivatives of
    the law (count, count) by the names of its inputs. Raises ModelError if the point is not at rest, and as
    `gt.linearize`.
    """
    plant_at = Linearization(plant, targets, list(outputs)).at
    linear = plant_at(start, None)
    count = len(linear.inputs)
    state, f, zero = _measured(linear, count), law_function(law, count), np.zeros(count)
    point = [state[:count], zero, zero, *np.split(state, 2)]
    held = f(*point).full().reshape(-1)
    linear = plant_at(start, {targets: held})
    jacobian = ca.Function("jacobian", f.sx_in(), [ca.jacobian(f(*f.sx_in()), ca.vertcat(*f.sx_in()))])
    slopes = np.split(np.asarray(jacobian(*point).full()), len(INPUTS), axis=1)
    return linear, dict(zip(INPUTS, slopes, strict=True))


def _measured(linear: LinearModel, count: int) -> np.ndarray:
    """Position and velocity at the point, (2 count,). Raises ModelError if it is not at rest."""
    values = linear.values[: 2 * count]
    if np.any(values[count:] != 0.0):
        raise gt.ModelError("linearize_sampled needs a point at rest; set the derivatives in `start` to 0")
    return values
