"""A plant that follows a reference under a control law, as a model, and its simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from gtmodel import lang as gt
from gtmodel.compiler.causal import flat_of
from gtmodel.lang.expression import Expr, operand
from gtmodel.results import Trajectory
from gtmodel.simulation import Simulation, simulate

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
    flat = flat_of(plant)
    shape, unit = flat.groups.get(known, ((), []))[0], ""
    if not shape or flat.groups.get(targets, ((), []))[0] != shape:
        raise gt.ModelError(
            f"the plant must declare '{known}' and '{targets}' as vectors of one length; it has {flat.top()}"
        )
    unit = flat.variables[flat.groups[known][1][0]].unit

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


@dataclass(frozen=True, eq=False)
class Tracked:
    """What `track` returns: a motion under a law.

    trajectory: "reference", "position" and "forces" on the reference's rows, in SI units. simulation: the run behind
    it. `error` (n, k) is reference less position, `rms` (k,) its root mean square.
    """

    trajectory: Trajectory
    simulation: Simulation

    @property
    def error(self) -> np.ndarray:
        """(n, k) reference less position."""
        return self.trajectory["reference"] - self.trajectory["position"]

    @property
    def rms(self) -> np.ndarray:
        """(k,) root mean square of the error."""
        return np.sqrt(np.mean(self.error**2, axis=0))


def track(
    plant: gt.Model,
    law: Law,
    reference: Trajectory,
    start: Mapping[str, Any],
    *,
    known: str = "q",
    targets: str = "tau",
    tolerance: float = 1e-7,
) -> Tracked:
    """Simulate the plant along a reference under a law; returns a `Tracked`, with the tracking error.

    Args:
        plant: a model whose `known` and `targets` are vectors of equal length.
        law: `Feedforward`, `ComputedTorque`, `Feedback`, or a `Law` of your own.
        reference: holds the known variable at equal steps; between its rows it is a cubic spline.
        start: start values of the plant by its own names, e.g. {"T": [...], "der(T)": [0, 0, 0]}.
        known, targets: the actuators' positions and forces, by name.
        tolerance: of the integrator, see `simulate`.

    Raises ModelError for a plant, law or start that does not fit, and NotSimulated.

    >>> class Cart(gt.Model):
    ...     m = gt.parameter(2.0, unit="kg", positive=True)
    ...     q = gt.variable(1, unit="m")
    ...     tau = gt.input(1, unit="N")
    ...     def equations(self):
    ...         yield self.m * gt.der(self.q, 2) == self.tau
    >>> t = np.linspace(0.0, 1.0, 101)
    >>> reference = gt.Trajectory(t, {"q": 3 * t[:, None] ** 2 - 2 * t[:, None] ** 3}, {"q": "m"})
    >>> for mass in (2.0, 1.0):  # as the law believes
    ...     law = gt.control.Feedforward(Cart(m=mass), stiffness=800.0, damping=80.0)
    ...     run = gt.control.track(Cart(), law, reference, {"q": [0.0], "der(q)": [0.0]})
    ...     print(bool(abs(run.error).max() > 1e-3))  # m
    False
    True
    """
    rows = reference[known]
    table = Trajectory(reference.time, {"reference": rows}, {"reference": reference.unit(known)})
    run = simulate(
        tracking_loop(plant, law, known, targets),
        float(reference.time[-1]),
        start_time=float(reference.time[0]),
        inputs={"reference": (table, "cubic")},
        start={_inside(name): value for name, value in start.items()},
        step=float(reference.time[1] - reference.time[0]),
        outputs=[f"plant.{known}", f"plant.{targets}"],
        tolerance=tolerance,
    )
    simulated = run.trajectory
    q, tau = (np.column_stack([simulated(reference.time, f"plant.{n}[{k}]") for k in range(rows.shape[1])])
              for n in (known, targets))  # fmt: skip
    names = {"reference": (rows, reference.unit(known)), "position": (q, reference.unit(known)),
             "forces": (tau, simulated.unit(f"plant.{targets}"))}  # fmt: skip
    note = "; ".join(n for n in (reference.synthetic, "simulated closed loop, no noise") if n)
    trajectory = Trajectory(
        reference.time, {n: v for n, (v, _) in names.items()}, {n: u for n, (_, u) in names.items()}, synthetic=note
    )
    return Tracked(trajectory, run)


def _inside(name: str) -> str:
    """A plant's own name, "T" or "der(T,2)", seen from the loop."""
    return f"der(plant.{name[4:]}" if name.startswith("der(") else f"plant.{name}"
