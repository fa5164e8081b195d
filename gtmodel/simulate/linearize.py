"""Linearisation of a model at a point: control.StateSpace with names, and its modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import control
import numpy as np

from ..compiler.causal import flat_of
from ..compiler.initial import initial_point, start_values
from ..compiler.plan import make_plan
from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.source import ModelError
from .inputs import Inputs
from .reduced import Reduced



@dataclass(frozen=True)
class Mode:
    """An eigenvalue of a linear model: natural frequency [Hz] and damping ratio; `states` move most in it."""

    eigenvalue: complex
    frequency_Hz: float
    damping: float
    states: tuple[str, ...]


def linearize(
    model: Model | Builder,
    inputs: Sequence[str] | str,
    outputs: Sequence[str] | str,
    *,
    start: Mapping[str, Any] | None = None,
    input_values: Mapping[str, Any] | None = None,
    prefer: Sequence[str] = (),
) -> control.StateSpace:
    """Linear model x' = A x + B u, y = C x + D u of the deviations from a consistent point.

    Args:
        inputs: names of known variables; they must enter without their derivatives.
        outputs: names such as "T", "der(q)".
        start: prescribed values of the point by name; the rest follows (see `simulate`).
        input_values: values of the inputs at the point, 0 by default.
        prefer: names to keep as states.

    State, input and output names are the model's scalar names. The point need not be an equilibrium; its rates
    are in `.params["rates"]`. Raises ModelError for a wrong name, an input whose derivative is needed, or a
    model with Newton unknowns that cannot be solved at the point.
    """
    flat = flat_of(model)
    inputs = [inputs] if isinstance(inputs, str) else list(inputs)
    outputs = [outputs] if isinstance(outputs, str) else list(outputs)
    known = [i for name in inputs for i in flat.lookup(name)[1]]
    out_pairs = []
    for name in outputs:
        _, indices, order = flat.lookup(name)
        out_pairs += [(i, order) for i in indices]
    targets = sorted({*out_pairs, *((v.index, 0) for v in flat.variables)})
    preferred = [i for name in prefer for i in flat.lookup(name)[1]]
    fold = ca.SX(ca.DM(flat.require_values()))
    plan = make_plan(flat, known, targets, preferred, rates=True, fold=fold)
    held, guess = start_values(plan, start)
    values = dict.fromkeys(known, 0.0)
    for name, value in (input_values or {}).items():
        indices = flat.lookup(name)[1]
        values.update(zip(indices, np.broadcast_to(np.asarray(value, float), len(indices)).tolist(), strict=True))
    held |= {(i, 0): x for i, x in values.items()}
    held |= {p: 0.0 for p in plan.pairs if p[0] in values and p[1] > 0}
    w = initial_point(plan, held, guess)
    plan = make_plan(flat, known, targets, preferred, rates=True, fold=fold, at=w)
    u = {i: ca.SX.sym(flat.variables[i].name) for i in known}
    for i, order in plan.inputs:
        if i in u and order > 0:
            raise ModelError(f"the model needs the derivative of input '{flat.variables[i].name}'; filter it first")
    reduced = Reduced(plan, Inputs(ca.SX.sym("t"), dict(u), {}), [flat.scope.symbol(*p) for p in out_pairs])
    position = {p: n for n, p in enumerate(plan.pairs)}
    x0 = np.array([w[position[s]] for s in plan.states])
    z_pairs = [flat.scope.owner(s) for b in plan.newton for s in b.unknowns]
    z0 = np.array([w[position[p]] for p in z_pairs if p is not None])
    u_column = ca.vertcat(*u.values()) if u else ca.SX(0, 1)
    y = reduced.outputs_x
    blocks = [ca.densify(ca.jacobian(e, v)) for e in (reduced.rates, reduced.residuals, y) for v in (reduced.x, reduced.z, u_column)]  # fmt: skip
    f = ca.Function("linear", [reduced.x, reduced.z, u_column, reduced.t, reduced.p], [*blocks, reduced.rates])
    fx, fz, fu, rx, rz, ru, gx, gz, gu, rates = (
        np.asarray(m.full()) for m in f(x0, z0, list(values.values()), 0.0, np.zeros(reduced.p.numel()))
    )
    if z0.size:  # Newton unknowns follow the states: dz = -rz^-1 (rx dx + ru du)
        zx, zu = -np.linalg.solve(rz, rx), -np.linalg.solve(rz, ru)
        fx, fu, gx, gu = fx + fz @ zx, fu + fz @ zu, gx + gz @ zx, gu + gz @ zu
    if not all(np.all(np.isfinite(m)) for m in (fx, fu, gx, gu)):
        raise ModelError(f"{flat.title}: the model is singular at this point; linearise at another one")
    return control.ss(
        fx, fu, gx, gu,
        name=flat.title,
        states=[flat.symbol_name(*s) for s in plan.states],
        inputs=[flat.variables[i].name for i in known],
        outputs=[flat.symbol_name(*p) for p in out_pairs],
        params={"rates": dict(zip([flat.symbol_name(*s) for s in plan.states], rates.reshape(-1).tolist(), strict=True))},
    )  # fmt: skip


def modes(system: control.StateSpace) -> list[Mode]:
    """Modes by rising frequency; of a conjugate pair the one with positive imaginary part."""
    values, vectors = np.linalg.eig(np.asarray(system.A))
    result = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag < 0:
            continue
        size = abs(value)
        share = np.abs(vector) / max(1e-300, float(np.max(np.abs(vector))))
        moving = tuple(str(n) for n, s in zip(system.state_labels, share, strict=True) if s > 0.5)
        damping = float(-value.real / size) if size > 0 else 0.0
        result.append(Mode(complex(value), float(size / (2 * np.pi)), damping, moving))
    return sorted(result, key=lambda m: (m.frequency_Hz, m.eigenvalue.real))
