"""A sampled loop as a linear system in discrete time: the plant's exact transition, held forces, the law's Jacobian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from gtmodel import lang as gt
from gtmodel.simulation import linearize
from gtmodel.simulation.hybrid.clock import exact

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
    """The loop of `sampled_loop` as a linear system from sample to sample, for deviations from a point at rest.

    Args:
        plant, law, period, delay, known, targets, velocity: as of `sampled_loop`.
        start: the point, by the plant's own names, e.g. {"T": [...], "der(T)": 0}; the law holds the plant there with
            the reference at its position.

    Returns a `control.StateSpace` with `dt` = period. Its states are those of the plant, named as by `gt.linearize`,
    then forces of earlier samples, "forces(k-1)[0]" first, as many as the delay holds, and for the difference the
    position measured before. Inputs are the reference and its two derivatives, outputs the positions, both at the
    samples. The plant's transition is exact for held forces (matrix exponential, split where the delay is no whole
    number of periods), the law's Jacobian is exact too. A pole outside the unit circle is a loop that oscillates or
    runs away.

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
    import control  # slow to import, and only needed here

    (count,), _, _ = actuators(plant, known, targets)
    if not (np.isfinite(period) and period > 0 and np.isfinite(delay) and delay >= 0):
        raise gt.ModelError(f"a period is positive and a delay not negative; found {period!r} s and {delay!r} s")
    measured = [known, f"der({known})"]
    linear, by = at_rest(plant, law, measured, start, targets)

    a, b, c = (np.asarray(m) for m in (linear.A, linear.B, linear.C))
    whole, part = divmod(exact(delay), exact(period))
    transition, early, latest = held_late(a, b, float(part), float(exact(period) - part))
    late = int(whole) + (part > 0)  # forces of earlier samples that still have to act
    n, m = len(a), late * count
    difference = velocity == "difference"
    size = n + m + count * difference
    # forces of this sample, from the state and from the reference
    state, wanted = np.zeros((count, size)), np.hstack([by[name] for name in INPUTS[:3]])
    state[:, :n] = by["position"] @ c[:count]
    if difference:
        state[:, :n] += by["velocity"] @ c[:count] / period
        state[:, n + m :] = -by["velocity"] / period
    else:
        state[:, :n] += by["velocity"] @ c[count:]
    A, B = np.zeros((size, size)), np.zeros((size, wanted.shape[1]))
    A[:n, :n] = transition
    for j, effect in ((int(whole), latest), (int(whole) + 1, early)):
        if j == 0:
            A[:n] += effect @ state
            B[:n] += effect @ wanted
        elif j <= late:
            A[:n, n + (j - 1) * count : n + j * count] += effect
    if late:
        A[n : n + count], B[n : n + count] = state, wanted
        A[n + count : n + m, n : n + m - count] = np.eye(m - count)
    if difference:
        A[n + m :, :n] = c[:count]
    names = [f"forces(k-{j})[{i}]" for j in range(1, late + 1) for i in range(count)]
    names += [f"measured[{i}]" for i in range(count)] if difference else []
    loop = control.ss(
        A, B, np.hstack([c[:count], np.zeros((count, size - n))]), np.zeros((count, B.shape[1])), period,
        name=linear.name, states=[*linear.state_labels, *names],
        inputs=[f"{name}[{i}]" for name in INPUTS[:3] for i in range(count)],
        outputs=[f"position[{i}]" for i in range(count)],
    )  # fmt: skip
    assert isinstance(loop, control.StateSpace)
    return loop


def at_rest(
    plant: gt.Model, law: Law, outputs: Sequence[str], start: Mapping[str, Any], targets: str
) -> tuple[StateSpace, dict[str, np.ndarray]]:
    """The plant from its forces to `outputs`, the first two of which are positions and velocities, about a point where
    the law holds it at rest; and the law's derivatives there (count, count), by the names of its inputs.

    Raises ModelError for a point that is not at rest, and as `gt.linearize`.
    """
    linear = linearize(plant, targets, list(outputs), start=start)
    count = linear.ninputs
    at, f, rest = _measured(linear, count), law_function(law, count), np.zeros(count)
    point = [at[:count], rest, rest, *np.split(at, 2)]
    held = f(*point).full().reshape(-1)
    linear = linearize(plant, targets, list(outputs), start=start, input_values={targets: held})
    jacobian = ca.Function("jacobian", f.sx_in(), [ca.jacobian(f(*f.sx_in()), ca.vertcat(*f.sx_in()))])
    slopes = np.split(np.asarray(jacobian(*point).full()), len(INPUTS), axis=1)
    return linear, dict(zip(INPUTS, slopes, strict=True))


def _measured(linear: StateSpace, count: int) -> np.ndarray:
    """Position and velocity at the point, (2 count,); it has to be at rest."""
    values = np.array(list(linear.params["outputs"].values()))[: 2 * count]
    if np.any(values[count:] != 0.0):
        raise gt.ModelError("the point of linearize_sampled is at rest; give the derivatives in `start` the value 0")
    return values
