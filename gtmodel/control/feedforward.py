"""Feedforward and computed torque: control laws on the inverse dynamics of any model.

With a reference r and the measured positions q of the actuators, e = r - q:

    Feedback        tau = K e + D e'
    Feedforward     tau = f(r, r', r'') + K e + D e'
    ComputedTorque  tau = f(q, q', r'' + K e + D e')

f is the model's `causal(known=..., targets=...)`, such as Dressler 2012, eqs. (6.7) and (6.8). Gains are positive: K
[force per position] and D [force per velocity] of the first two, K [1/s2] and D [1/s] of computed torque.
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
    """What a loop needs of its law: forces as an expression of the reference and the state.

    Any object with such a `forces` is one; `Feedforward`, `ComputedTorque` and `Feedback` are three of them.
    """

    def forces(self, reference: list[ca.SX], position: ca.SX, velocity: ca.SX) -> ca.SX:
        """(n,) from the reference with its first two derivatives, the position and the velocity, (n,) each."""
        ...


@dataclass(frozen=True)
class Feedback:
    """Proportional and derivative feedback alone: stiffness (r - q) + damping (r' - q') on the reference r.

    stiffness [N/m], damping [N.s/m]: one number for all actuators, or one for each. Raises ValueError for a gain that
    is negative or no number.

    >>> gt.control.Feedback(4e4, -2e3)
    Traceback (most recent call last):
        ...
    ValueError: damping must not be negative; found -2000.0
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
    """The inverse dynamics of `model` and gains. Raises ModelError where the motion does not determine the targets."""

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
                f"'{self.targets}' needs {', '.join(others)} beside '{self.known}'; a law knows the motion of "
                f"'{self.known}' alone"
            )
        object.__setattr__(self, "inverse", inverse)

    def needed(self, *motion: Any) -> tuple[Array, Any]:
        """Forces (n, m) for rows of position, velocity and acceleration (n, k) each, and the status of each row."""
        return self.inverse.along(*motion)

    def modelled(self, motion: Trajectory) -> Trajectory:
        """The model's forces along a motion: a signal of the targets' name on the same rows.

        motion holds the known variable; of derivatives that it does not hold, "der(q)" and "der(q,2)", the smooth curve
        through the positions is asked, so these should be a reference or filtered. A synthetic motion's note is kept.
        Raises TrajectoryError for another unit, and for a row that the model cannot follow, with the time.
        """
        position = motion[self.known]
        for s in self.inverse.inputs:
            given = motion.unit(s.name) if s.name in motion else "1"  # also of what was given without a unit
            if given != "1" and si_unit(given).dimension != si_unit(s.unit).dimension:
                raise TrajectoryError(f"the model has '{s.name}' in {s.unit}; the motion gives it in {given}")
        rows = [position, *smooth_motion(motion.time, position)[1:]]
        for order, name in ((1, f"der({self.known})"), (2, f"der({self.known},2)")):
            if name in motion:
                rows[order] = motion[name]
        forces, status = self.needed(*rows)
        bad = np.flatnonzero(status != Status.OK)
        if bad.size:
            raise TrajectoryError(
                f"at {motion.time[bad[0]]:g} s the model cannot follow: {Status(int(status[bad[0]])).message}; keep "
                "the motion within its reach"
            )
        unit = self.inverse.outputs[0].unit
        return Trajectory(motion.time, {self.targets: forces}, {self.targets: unit}, title=motion.title,
                          synthetic=motion.synthetic)  # fmt: skip

    def _expression(self, motion: list[ca.SX]) -> ca.SX:
        if self.inverse.plan.newton:
            raise ModelError(
                f"{self.inverse.name} of {self.inverse.flat.title} is solved by Newton's method and makes no "
                "expression of a model; give its forces for the reference as an input instead, see modelled()"
            )
        return ca.SX(self.inverse.casadi.call(self.inverse.arguments_along(*motion))[0])


class Feedforward(_InverseDynamics):
    """Forces of the model for the reference (inverse dynamics), and feedback.

    Args:
        model: with the parameters that were identified, or their nominal values.
        stiffness, damping: gains of the feedback [N/m, N.s/m], alike for all actuators or one number for each; none if
            left out.
        known, targets: the actuators' positions and forces, by name.

    Raises ValueError for a gain that is negative or no number, and ModelError where the motion does not determine the
    targets.

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
    """Forces of the model at the measured state, for the acceleration that brings it back to the reference.

    Where the plant has the model's own parameters the error obeys e'' + D e' + K e = 0, whatever the motion. Args and
    errors as of `Feedforward`; the gains K are in 1/s2 and D in 1/s.

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
            raise ModelError(f"{name} has the shape {np.shape(gain)}; expected one number, or {count} of them")
    K, D = (ca.DM(np.broadcast_to(np.asarray(g, float), (count,))) for g in (law.stiffness, law.damping))
    return K * (reference[0] - position) + D * (reference[1] - velocity)


def _check_gains(*gains: Gain) -> None:
    for name, gain in zip(("stiffness", "damping"), gains, strict=True):
        if not np.all(np.isfinite(gain)) or np.any(np.asarray(gain) < 0):
            raise ValueError(f"{name} must not be negative; found {gain}")
