"""What a simulation will do, in text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..compiler.causal import compile_causal
from ..lang.model import Model
from .prepare import prepare


def explain_simulation(
    model: Model,
    *,
    inputs: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    start_time: float = 0.0,
    prefer: Sequence[str] | str = (),
    tolerance: float = 1e-9,
    method: str = "bdf",
) -> str:
    """How `simulate` runs a model: its states, their start values and what chose them, how their rates are computed.

    Arguments as for `simulate`. Returns a text for people. Raises ModelError as `simulate` does.

    >>> class Ball(gt.Model):
    ...     height = gt.variable(unit="m", start=2.0, fixed=True)
    ...     speed = gt.variable(unit="m/s", start=0.0, fixed=True)
    ...     g = gt.parameter(9.81, unit="m/s2")
    ...     def equations(self):
    ...         yield gt.der(self.height) == self.speed
    ...         yield gt.der(self.speed) == -self.g
    >>> text = gt.simulation.explain_simulation(Ball())
    >>> "height" in text
    True
    """
    ready = prepare(model, inputs, start, start_time, (), prefer, tolerance, method, parameters=parameters)
    plan, flat, system = ready.systems.plan, ready.systems.flat, ready.system
    x, z = system.reduced.from_point(ready.initial.w)
    known = [flat.variables[i].name for i in ready.inputs.known]
    integrator = f"IDAS, with {z.size} Newton unknowns" if z.size else f"CVODES ({method})"
    lines = [
        f"{flat.title}: simulation by {integrator}, tolerance {tolerance:g}",
        f"  prescribed: {', '.join(known) or 'nothing'}",
        f"  index {plan.structure.index}; {plan.structure.degrees_of_freedom} degrees of freedom",
        "  start:" if x.size else "  no states: everything follows from what is prescribed",
    ]
    for name, value in zip(system.states, x.tolist(), strict=True):
        why = "chosen by the initialisation" if name in ready.chosen else "prescribed, or follows"
        lines.append(f"    {name} = {ready.chosen.get(name, value):.6g}  {why}")
    terms: dict[str, list[str]] = {}
    for e in flat.energies:
        terms.setdefault(e.kind, []).append(e.component or flat.title)
    lines += [f"  energy {kind}: {', '.join(dict.fromkeys(names))}" for kind, names in terms.items()]
    text = "\n".join(lines)
    if not x.size:
        return text
    rates = [flat.symbol_name(i, k + 1) for i, k in system.plan.states]
    kept = list(dict.fromkeys(flat.variables[i].name for i, _ in system.plan.states))
    return text + "\n" + compile_causal(flat, known, rates, kept).explain()
