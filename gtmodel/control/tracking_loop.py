"""A plant that follows a reference under a control law in continuous time, as a model to simulate."""

from __future__ import annotations

from typing import Any

import casadi as ca

from gtmodel import lang as gt
from gtmodel.compiler.causal import flat_of
from gtmodel.lang.expression import Expr, operand

from .feedforward import Law


def tracking_loop(plant: gt.Model, law: Law, known: str = "q", targets: str = "tau") -> gt.Model:
    """The plant under a law, as a model to simulate: part `plant`, and an input `reference` in place of its forces.

    Args:
        plant: a model whose `known` and `targets` are vectors of equal length.
        law: `Feedforward`, `ComputedTorque`, `Feedback`, or a `Law` of your own.
        known, targets: the actuators' positions and forces, by name.

    The law acts in continuous time; the reference must be twice differentiable, "cubic" where it is a table. Raises
    ModelError where the plant has no such vectors of equal length.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> loop = gt.control.tracking_loop(robot, gt.control.Feedback(4e4, 2e3))
    >>> rate = loop.causal(known="reference", targets="der(plant.T,2)", prefer="plant.T")
    >>> [signal.name for signal in rate.inputs][:2]
    ['plant.T', 'der(plant.T)']
    """
    shape, unit, _ = actuators(plant, known, targets)

    class TrackingLoop(gt.Model):
        plant: Any
        reference: Any

        def equations(self) -> Any:
            position, reference = getattr(self.plant, known), self.reference

            def symbols(e: Any) -> ca.SX:
                return ca.SX(operand(e, reference.scope)[0])

            wanted = [symbols(gt.der(reference, order)) for order in range(3)]
            forces = law.forces(wanted, symbols(position), symbols(gt.der(position)))
            # the law's numbers carry no units
            yield getattr(self.plant, targets) == Expr(forces, shape, None, reference.scope)

    members = {"plant": gt.part(plant), "reference": gt.input(shape[0], unit=unit)}
    return type("TrackingLoop", (TrackingLoop,), members)()


def actuators(plant: gt.Model, known: str, targets: str) -> tuple[tuple[int], str | None, str | None]:
    """Shape of the positions and of the forces, and their units. Raises ModelError where they are no such vectors."""
    flat = flat_of(plant)
    shape = flat.groups.get(known, ((), []))[0]
    if len(shape) != 1 or flat.groups.get(targets, ((), []))[0] != shape:
        raise gt.ModelError(
            f"the plant must declare '{known}' and '{targets}' as vectors of one length; it has {flat.top()}"
        )
    units = [flat.variables[flat.groups[name][1][0]].unit for name in (known, targets)]
    return (shape[0],), units[0], units[1]
