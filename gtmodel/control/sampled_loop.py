"""Models of a plant that follows a reference under a control law, in continuous time or sampled."""

from __future__ import annotations

from typing import Any, Literal

import casadi as ca
import numpy as np

from gtmodel import lang as gt
from gtmodel.compiler.causal import CausalFunction, compile_causal, flat_of
from gtmodel.compiler.rows import PointFunction
from gtmodel.compiler.toolchain import find
from gtmodel.lang.expression import Expr, operand
from gtmodel.lang.units import rate_unit

from .feedforward import Law


def tracking_loop(plant: gt.Model, law: Law, known: str = "q", targets: str = "tau") -> gt.Model:
    """Return the plant under a continuous-time law as a model: part `plant`, input `reference` instead of the forces.

    Args:
        plant: a model whose `known` and `targets` are vectors of equal length.
        law: `Feedforward`, `ComputedTorque`, `Feedback`, or your own `Law`.
        known, targets: names of the actuators' positions and forces.

    The reference must be twice differentiable; pass a table as "cubic". Raises ModelError if the plant has no such
    vectors.

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

            references = [symbols(gt.der(reference, order)) for order in range(3)]
            forces = law.forces(references, symbols(position), symbols(gt.der(position)))
            # the law's numbers carry no units
            yield getattr(self.plant, targets) == Expr(forces, shape, None, reference.scope)

    members = {"plant": gt.part(plant), "reference": gt.input(shape[0], unit=unit)}
    return type("TrackingLoop", (TrackingLoop,), members)()


def actuators(plant: gt.Model, known: str, targets: str) -> tuple[tuple[int], str | None, str | None]:
    """Return the shape and units of positions and forces. Raises ModelError unless both are vectors of equal length."""
    flat = flat_of(plant)
    shape = flat.groups.get(known, ((), []))[0]
    if len(shape) != 1 or flat.groups.get(targets, ((), []))[0] != shape:
        raise gt.ModelError(
            f"the plant must declare '{known}' and '{targets}' as vectors of equal length; it has {flat.top()}"
        )
    units = [flat.variables[flat.groups[name][1][0]].unit for name in (known, targets)]
    return (shape[0],), units[0], units[1]


# velocity input of the law: the plant's velocity, or the difference of two measured positions over the period
Velocity = Literal["measured", "difference"]
INPUTS = ("reference", "reference_rate", "reference_acceleration", "position", "velocity")


def sampled_loop(
    plant: gt.Model,
    law: Law,
    period: float = 0.004,
    delay: float = 0.008,
    *,
    known: str = "q",
    targets: str = "tau",
    first: Any = 0.0,
    resolution: float = 0.0,
    velocity: Velocity = "measured",
    compiled: bool = False,
) -> gt.Model:
    """Return the plant under a sampled law as a model: parts `plant` and `law`, input `reference`.

    Args:
        plant: a model whose `known` and `targets` are vectors of equal length.
        law: `Feedforward`, `ComputedTorque`, `Feedback`, or your own `Law`.
        period: sampling period [s].
        delay: from a sample until its forces act [s]; need not be a whole number of periods.
        known, targets: names of the actuators' positions and forces.
        first: forces until the first forces of the law act, one number or one for each actuator.
        resolution: of the encoders, in the unit of the positions; the law reads the nearest multiple. 0: exact.
        velocity: "measured": the plant's velocity; "difference": the difference of the measured positions at this and
            the previous sample over the period (0 at the first sample).
        compiled: evaluate the law by its generated C code, compiled on this machine, instead of CasADi's virtual
            machine. The numbers are identical bit for bit.

    At each sample the law reads the position, the velocity and the reference with two derivatives. Its forces start to
    act after `delay` and are held until the next forces act. `gt.simulate(loop, ...).samples["law"]` holds inputs and
    forces. The reference must be twice differentiable; pass a table as "cubic". For a law in continuous time see
    `tracking_loop`. Raises ModelError if the plant has no such vectors, if a number is out of range, or if `compiled`
    is set and there is no C compiler.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> law = gt.control.ComputedTorque(robot, stiffness=400.0, damping=40.0)
    >>> loop = gt.control.sampled_loop(robot, law, period=0.004, delay=0.008)
    >>> at = {"plant.T": [0.5, -0.9, 0.3], "der(plant.T)": 0.0}
    >>> q, status = robot.causal(known="T", targets="q")(at["plant.T"])
    >>> run = gt.simulate(loop, 0.02, inputs={"reference": q + 0.001}, start=at)
    >>> samples = run.samples["law"]
    >>> len(samples), bool(np.all(samples["reference"] - samples["position"] > 0))
    (6, True)
    """
    shape, unit, force = actuators(plant, known, targets)
    block = sampled_law(law, shape[0], unit, force, first, resolution, velocity, compiled)

    class SampledLoop(gt.Model):
        plant: Any
        law: Any
        reference: Any

        def equations(self) -> Any:
            position, reference = getattr(self.plant, known), self.reference
            yield self.law.position == position
            yield self.law.velocity == gt.der(position)
            yield self.law.reference == reference
            yield self.law.reference_rate == gt.der(reference)
            yield self.law.reference_acceleration == gt.der(reference, 2)
            yield getattr(self.plant, targets) == self.law.forces

    members = {
        "plant": gt.part(plant),
        "law": gt.part(block, period=period, delay=delay),
        "reference": gt.input(shape[0], unit=unit),
    }
    return type("SampledLoop", (SampledLoop,), members)()


def sampled_law(
    law: Law,
    count: int,
    unit: str | None = None,
    force: str | None = None,
    first: Any = 0.0,
    resolution: float = 0.0,
    velocity: Velocity = "measured",
    compiled: bool = False,
) -> type[gt.SampledBlock]:
    """Return a law as a sampled block for `count` actuators, to build your own loops: `gt.part(block, period=0.004)`.

    Args:
        unit, force: SI units of the positions and of the forces.
        first, resolution, velocity, compiled: as in `sampled_loop`.

    Inputs: `position`, `velocity`, `reference`, `reference_rate`, `reference_acceleration`. Output: `forces`. With
    velocity "difference" the block also stores the `measured` position. Raises ModelError as `sampled_loop`.

    >>> block = gt.control.sampled_law(gt.control.Feedback(4e4, 2e3), 3, unit="m", force="N")
    >>> block(period=0.004).delay
    0.0
    """
    if not (np.isfinite(resolution) and resolution >= 0):
        raise gt.ModelError(f"the encoder resolution must be finite and not negative; found {resolution!r}")
    if velocity not in ("measured", "difference"):
        raise gt.ModelError(f"velocity must be 'measured' or 'difference'; found {velocity!r}")
    held = np.asarray(first, float)
    if held.shape not in ((), (count,)) or not np.all(np.isfinite(held)):
        raise gt.ModelError(f"the first forces must be one finite number, or {count} numbers; found {first!r}")
    evaluate = PointFunction(_machine_code(law_function(law, count)) if compiled else law_function(law, count))

    class SampledLaw(gt.SampledBlock):
        def step(self, inputs: Any, state: Any) -> dict[str, Any]:
            position, rate, memory = inputs.position, inputs.velocity, {}
            if resolution:
                position = resolution * np.round(position / resolution)
            if velocity == "difference":
                rate = (position - state.measured) / self.period if state.begun else np.zeros(count)
                memory = {"measured": position, "begun": 1.0}
            references = inputs.reference, inputs.reference_rate, inputs.reference_acceleration
            (forces,) = evaluate(*references, position, rate)
            return {"forces": forces[:, 0], **memory}

    rate, acceleration = (None if unit is None else rate_unit(unit, order) for order in (1, 2))
    members = {
        "position": gt.input(count, unit=unit, description="of the actuators"),
        "velocity": gt.input(count, unit=rate, description="of the actuators"),
        "reference": gt.input(count, unit=unit, description="reference of the actuators"),
        "reference_rate": gt.input(count, unit=rate, description="its derivative"),
        "reference_acceleration": gt.input(count, unit=acceleration, description="its second derivative"),
        "forces": gt.output(np.broadcast_to(held, (count,)).copy(), unit=force, description="held"),
    }
    if velocity == "difference":
        members["measured"] = gt.discrete(np.zeros(count), unit=unit, description="position at the previous sample")
        members["begun"] = gt.discrete(0.0, description="1 from the first sample on")
    return type("SampledLaw", (SampledLaw,), members)


def law_function(law: Law, count: int) -> ca.Function:
    """Return a law as a CasADi function: reference, two derivatives, position, velocity -> forces, (count,) each.

    Raises ModelError if the law returns another number of forces.

    >>> f = gt.control.law_function(gt.control.Feedback(100.0, 10.0), 1)
    >>> float(f(0.02, 0.0, 0.0, 0.01, 0.05))
    0.5
    """
    symbols = [ca.SX.sym(name, count) for name in INPUTS]
    forces = ca.densify(law.forces(symbols[:3], *symbols[3:]))
    if forces.numel() != count:
        raise gt.ModelError(f"the law returns {forces.numel()} forces; expected {count}")
    return ca.Function("law", symbols, [forces], list(INPUTS), ["forces"])


def law_causal(law: Law, count: int, unit: str = "m", force: str = "N") -> CausalFunction:
    """Return a law as a causal function, from which `gt.cgen` generates C code for a real controller.

    Args:
        law: as in `sampled_loop`, for `count` actuators.
        unit, force: SI units of the positions and of the forces.

    Inputs and output are named as in `sampled_law`; inputs that the law does not use are left out. Raises ModelError as
    `law_function`.

    >>> function = gt.control.law_causal(gt.control.Feedback(100.0, 10.0), 1)
    >>> [s.name for s in function.inputs]
    ['reference', 'reference_rate', 'position', 'velocity']
    >>> forces, status = function([0.02], [0.0], [0.01], [0.05])
    >>> forces.tolist()
    [0.5]
    """
    f = law_function(law, count)
    used: list[str] = [name for n, name in enumerate(INPUTS) if f.jac_sparsity(0, n).nnz()]

    class SampledForces(gt.Model):
        def equations(self) -> Any:
            scope = self.forces.scope
            arguments = [operand(getattr(self, n), scope)[0] if n in used else ca.SX(count, 1) for n in INPUTS]
            # the law's numbers carry no units
            yield self.forces == Expr(ca.SX(f.call(arguments)[0]), (count,), None, scope)

    rate, acceleration = rate_unit(unit), rate_unit(unit, 2)
    units: dict[str, str] = dict(zip(INPUTS, (unit, rate, acceleration, unit, rate), strict=True))
    members: dict[str, Any] = {name: gt.input(count, unit=units[name]) for name in used}
    model = type("SampledForces", (SampledForces,), members | {"forces": gt.variable(count, unit=force)})()
    return compile_causal(model, used, "forces")


def _machine_code(function: ca.Function) -> ca.Function:
    """Compile the function's C code. Raises ModelError without a compiler."""
    from gtmodel.compiler.toolchain import CompilerMissing
    from gtmodel.optimize.point_kernels import compiled

    chain = find()
    if isinstance(chain, str):
        raise gt.ModelError(f"compiled=True needs a C compiler, but {chain}; compiled=False gives the same forces")
    try:
        return compiled([function])[0][0]
    except CompilerMissing as error:
        raise gt.ModelError(f"compiled=True: {error}") from None
