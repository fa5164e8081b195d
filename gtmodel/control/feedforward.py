"""Feedforward and computed torque: control laws on the inverse dynamics of any model.

With the reference r, the measured actuator positions q, and e = r - q:

    Feedback        tau = K e + D e'
    Feedforward     tau = f(r, r', r'') + K e + D e'
    ComputedTorque  tau = f(q, q', r'' + K e + D e')

f is the model's `causal(known=..., targets=...)`, for example Dressler 2012, eqs. (6.7) and (6.8). Gains are not
negative. Units: K [force per position] and D [force per velocity] in the first two laws, K [1/s2] and D [1/s] in
computed torque.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import casadi as ca
import numpy as np

from gtmodel.compiler.causal import CausalFunction, compile_causal
from gtmodel.lang import Model, ModelError
from gtmodel.lang.units import si_unit
from gtmodel.measurements import smooth_motion
from gtmodel.results import Status, Trajectory, TrajectoryError

Array = np.ndarray
Gain = float | tuple[float, ...]


class Law(Protocol):
    """Interface of a control law: forces as an expression of the reference and the state.

    Any object with this `forces` method is a law, for example `Feedforward`, `ComputedTorque` and `Feedback`.
    """

    def forces(self, reference: list[ca.SX], position: ca.SX, velocity: ca.SX) -> ca.SX:
        """Return the forces (n,) from the reference, its first two derivatives, position and velocity, (n,) each."""
        ...


@dataclass(frozen=True)
class Feedback:
    """Proportional-derivative feedback alone: stiffness (r - q) + damping (r' - q') for the reference r.

    stiffness [N/m], damping [N.s/m]: one number for all actuators, or one for each. Raises ValueError if a gain is
    negative or not finite.

    >>> gt.control.Feedback(4e4, -2e3)
    Traceback (most recent call last):
        ...
    ValueError: damping must be finite and not negative; found -2000.0
    """

    stiffness: Gain
    damping: Gain

    def __post_init__(self) -> None:
        _check_gains(self.stiffness, self.damping)

    def forces(self, reference: list[ca.SX], position: ca.SX, velocity: ca.SX) -> ca.SX:
        """See `Law`."""
        return _feedback(self, reference, position, velocity)


@dataclass(frozen=True, eq=False)
class _InverseDynamics:
    """Inverse dynamics of `model` with gains. Raises ModelError if the motion does not determine the targets."""

    model: Model
    stiffness: Gain = 0.0
    damping: Gain = 0.0
    known: str = "q"
    targets: str = "tau"
    inverse: CausalFunction = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _check_gains(self.stiffness, self.damping)
        inverse = compile_causal(self.model, self.known, self.targets)
        others = [s.name for s in inverse.inputs if s.name.removeprefix("der(").split(",")[0].rstrip(")") != self.known]
        if others:
            raise ModelError(
                f"'{self.targets}' depends on {', '.join(others)} as well as '{self.known}'; a law knows only the "
                f"motion of '{self.known}'"
            )
        object.__setattr__(self, "inverse", inverse)

    def needed(self, *motion: Any) -> tuple[Array, Any]:
        """Return the forces (n, m) for rows of position, velocity and acceleration (n, k), and a status per row."""
        return self.inverse.along(*motion)

    def modelled(self, motion: Trajectory) -> Trajectory:
        """Return the model's forces along a motion, at the same times, as a signal named after the targets.

        The motion must hold the known variable. Derivatives that it lacks, "der(q)" or "der(q,2)", come from a smooth
        curve through the positions, so the positions should be a reference or filtered. The note of a synthetic motion
        is copied. Raises TrajectoryError if a unit differs, or, with the time, if the model cannot follow a row.
        """
        position = motion[self.known]
        for s in self.inverse.inputs:
            unit = motion.unit(s.name) if s.name in motion else "1"  # "1" also for signals without a unit
            if unit != "1" and si_unit(unit).dimension != si_unit(s.unit).dimension:
                raise TrajectoryError(f"the model has '{s.name}' in {s.unit}; the motion has it in {unit}")
        rows = [position, *smooth_motion(motion.time, position)[1:]]
        for order, name in ((1, f"der({self.known})"), (2, f"der({self.known},2)")):
            if name in motion:
                rows[order] = motion[name]
        forces, status = self.needed(*rows)
        bad = np.flatnonzero(status != Status.OK)
        if bad.size:
            raise TrajectoryError(
                f"the model cannot follow the motion at {motion.time[bad[0]]:g} s: "
                f"{Status(int(status[bad[0]])).message}; keep the motion within its reach"
            )
        unit = self.inverse.outputs[0].unit
        return Trajectory(motion.time, {self.targets: forces}, {self.targets: unit}, title=motion.title,
                          synthetic=motion.synthetic)  # fmt: skip

    def _expression(self, motion: list[ca.SX]) -> ca.SX:
        if self.inverse.plan.newton:
            raise ModelError(
                f"{self.inverse.name} of {self.inverse.flat.title} is solved by Newton's method and cannot be an "
                "expression in a model; pass its forces along the reference as an input instead, see modelled()"
            )
        return ca.SX(self.inverse.casadi.call(self.inverse.arguments_along(*motion))[0])


class Feedforward(_InverseDynamics):
    """Inverse dynamics along the reference, plus PD feedback.

    Args:
        model: the model with identified or nominal parameters.
        stiffness, damping: feedback gains [N/m, N.s/m], one number for all actuators or one for each; 0 by default.
        known, targets: names of the actuators' positions and forces.

    Raises ValueError if a gain is negative or not finite, and ModelError if the motion does not determine the targets.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> law = gt.control.Feedforward(robot, stiffness=4e4, damping=2e3)
    >>> q = np.array([-0.7, -0.8, -0.6])
    >>> rest = np.zeros(3)
    >>> forces, status = law.needed(q, rest, rest)
    >>> forces.shape, status
    ((3,), <Status.OK: 0>)
    """

    def forces(self, reference: list[ca.SX], position: ca.SX, velocity: ca.SX) -> ca.SX:
        """See `Law`."""
        return self._expression(reference) + _feedback(self, reference, position, velocity)


class ComputedTorque(_InverseDynamics):
    """Inverse dynamics at the measured state, for an acceleration that drives the error to zero.

    If the plant equals the model, the error obeys e'' + D e' + K e = 0 for any motion. Arguments and errors as in
    `Feedforward`, but the gains are K [1/s2] and D [1/s].

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> law = gt.control.ComputedTorque(robot, stiffness=400.0, damping=40.0)  # critically damped, 20 rad/s
    >>> law.stiffness
    400.0
    """

    def forces(self, reference: list[ca.SX], position: ca.SX, velocity: ca.SX) -> ca.SX:
        """See `Law`."""
        acceleration = reference[2] + _feedback(self, reference, position, velocity)
        return self._expression([position, velocity, acceleration])


def _feedback(law: Any, reference: list[ca.SX], position: ca.SX, velocity: ca.SX) -> ca.SX:
    count = position.numel()
    for name, gain in (("stiffness", law.stiffness), ("damping", law.damping)):
        if np.shape(gain) not in ((), (count,)):
            raise ModelError(f"{name} has the shape {np.shape(gain)}; expected one number, or {count} numbers")
    K, D = (ca.DM(np.broadcast_to(np.asarray(g, float), (count,))) for g in (law.stiffness, law.damping))
    return K * (reference[0] - position) + D * (reference[1] - velocity)


def _check_gains(*gains: Gain) -> None:
    for name, gain in zip(("stiffness", "damping"), gains, strict=True):
        if not np.all(np.isfinite(gain)) or np.any(np.asarray(gain) < 0):
            raise ValueError(f"{name} must be finite and not negative; found {gain}")
