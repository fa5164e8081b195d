"""Linearisation of a model at a point as a control.StateSpace with names, and its modes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from .._lazy import hint
from ..compiler.causal import flat_of
from ..compiler.consistency.initial import initial_point, start_values
from ..compiler.flat import FlatModel
from ..lang.model import Model
from ..lang.source import ModelError
from ..linear.state_space import frequency_and_damping
from .advance import refuse_discontinuities
from .inputs import SimulationInputs
from .options import by_name, names, numbers
from .systems import Systems

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")


@dataclass(frozen=True)
class Mode:
    """A mode of a linear model: eigenvalue [1/s], natural frequency [Hz], damping ratio, and its dominant states."""

    eigenvalue: complex
    frequency_Hz: float
    damping: float
    states: tuple[str, ...]


def linearize(
    model: Model,
    inputs: Sequence[str] | str,
    outputs: Sequence[str] | str,
    *,
    start: Mapping[str, Any] | None = None,
    input_values: Mapping[str, Any] | None = None,
    prefer: Sequence[str] | str = (),
) -> StateSpace:
    """Return the linear model x' = A x + B u, y = C x + D u of the deviations from a consistent point.

    Args:
        inputs: names of known variables; the model must not need their derivatives.
        outputs: names such as "T", "der(q)".
        start: prescribed values at the point by name; the others follow (see `simulate`).
        input_values: values of the inputs at the point, by default 0.
        prefer: names to keep as states if they are well conditioned at the point.

    Returns a `control.StateSpace` of python-control, in SI units. State, input and output names are the model's scalar
    names, with ":" instead of ".", which python-control reserves ("capacitor:v"). The point need not be an equilibrium;
    its rates and outputs are in `.params["rates"]` and `.params["outputs"]`, by the model's names.

    Raises ModelError for a wrong name, an input whose derivative is needed, sign() of a variable, or a singular point.

    >>> class Oscillator(gt.Model):
    ...     m = gt.parameter(2.0, unit="kg")
    ...     k = gt.parameter(50.0, unit="N/m")
    ...     x = gt.variable(unit="m")
    ...     v = gt.variable(unit="m/s")
    ...     force = gt.input(unit="N")
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield self.m * gt.der(self.v) == self.force - self.k * self.x
    >>> linear = gt.linearize(Oscillator(), "force", "x", start={"x": 0.0, "v": 0.0})
    >>> linear.state_labels, linear.A.tolist(), linear.B.tolist()
    (['x', 'v'], [[0.0, 1.0], [-25.0, 0.0]], [[0.0], [0.5]])
    """
    linear = Linearization(model, inputs, outputs, prefer).at(start, input_values)
    from .._control import control  # slow to import, and only needed here

    made = control.ss(
        *linear.matrices,
        name=linear.title, states=labels(linear.states), inputs=labels(linear.inputs), outputs=labels(linear.outputs),
        params={
            "rates": dict(zip(linear.states, linear.rates.tolist(), strict=True)),
            "outputs": dict(zip(linear.outputs, linear.values.tolist(), strict=True)),
        },
    )  # fmt: skip
    assert isinstance(made, control.StateSpace)
    return made


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Matrices A, B, C, D of the deviations from a point, with the names of states, inputs and outputs; `rates` of the
    states and `values` of the outputs at the point."""

    title: str
    matrices: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    states: list[str]
    inputs: list[str]
    outputs: list[str]
    rates: np.ndarray
    values: np.ndarray


class Linearization:
    """A model with inputs and outputs, derived once and linearised at several points; arguments as in `linearize`."""

    def __init__(
        self, model: Model, inputs: Sequence[str] | str, outputs: Sequence[str] | str, prefer: Sequence[str] | str = ()
    ) -> None:
        self._flat = flat = flat_of(model)
        refuse_discontinuities(flat)
        prefer = names("prefer", prefer)
        self._known = known = _inputs(flat, names("inputs", inputs))
        wanted = [(i, order) for _, indices, order in map(flat.lookup, names("outputs", outputs)) for i in indices]
        repeated = [flat.symbol_name(*pair) for n, pair in enumerate(wanted) if pair in wanted[:n]]
        if repeated:
            raise ModelError(f"output '{repeated[0]}' is named twice; name it once")
        self._targets = wanted
        self._u = {i: ca.SX.sym(flat.variables[i].name) for i in known}
        functions = SimulationInputs(flat, ca.SX.sym("t"), dict(self._u), {})
        preferred = [i for name in prefer for i in flat.lookup(name)[1]]
        self._systems = Systems(flat, functions, [flat.scope.symbol(*p) for p in wanted], preferred)

    def at(self, start: Mapping[str, Any] | None, input_values: Mapping[str, Any] | None) -> LinearModel:
        """Return the linear model at a consistent point. Raises ModelError as `linearize`."""
        flat, known, u, count = self._flat, self._known, self._u, len(self._targets)
        start, input_values = by_name("start", start), by_name("input_values", input_values)
        values = _values(flat, known, input_values)
        plan = self._systems.plan
        held, guess = start_values(plan, start, known)
        held |= {(i, k): values[i] if k == 0 else 0.0 for i, k in plan.pairs if i in values}
        w = initial_point(plan, held, guess).w
        system = self._systems.at(w, 0.0)
        if system is None:
            raise ModelError(f"{flat.title}: the model is singular at this point; linearise at another one")
        for i, order in system.plan.inputs:
            if i in u and order > 0:
                raise ModelError(f"the model needs the derivative of input '{flat.variables[i].name}'; filter it first")
        r = system.reduced
        column = ca.vertcat(*u.values()) if u else ca.SX(0, 1)
        y = r.outputs[:count]
        blocks = [ca.densify(ca.jacobian(e, v)) for e in (r.rates, r.residuals, y) for v in (r.x, r.z, column)]
        f = ca.Function("linear", [r.x, r.z, column, r.t, r.p], [*blocks, r.rates, ca.densify(y)])
        point = [*r.from_point(w), [values[i] for i in known], 0.0, np.zeros(r.p.numel())]
        fx, fz, fu, rx, rz, ru, gx, gz, gu, rates, y0 = (np.asarray(m.full()) for m in f.call(point))
        if rz.size:  # Newton unknowns follow the states: dz = -rz^-1 (rx dx + ru du)
            zx, zu = -np.linalg.solve(rz, rx), -np.linalg.solve(rz, ru)
            fx, fu, gx, gu = fx + fz @ zx, fu + fz @ zu, gx + gz @ zx, gu + gz @ zu
        if count == 1 and not known:
            raise ModelError(
                "control.StateSpace does not support a single output without an input; name a second output"
            )
        if not all(np.all(np.isfinite(m)) for m in (fx, fu, gx, gu)):
            raise ModelError(f"{flat.title}: the model is singular at this point; linearise at another one")
        inputs = [flat.variables[i].name for i in known]
        outputs = [flat.symbol_name(*p) for p in self._targets]
        shown = rates.reshape(-1), y0.reshape(-1)
        return LinearModel(flat.title, (fx, fu, gx, gu), list(system.states), inputs, outputs, *shown)


def labels(names: Iterable[str]) -> list[str]:
    """Return names for python-control, which reserves the dot."""
    return [name.replace(".", ":") for name in names]


def _inputs(flat: FlatModel, names: list[str]) -> list[int]:
    """Return the indices of the inputs. Raises ModelError for a derivative, and for a repeated name."""
    known: list[int] = []
    for name in names:
        _, indices, order = flat.lookup(name)
        if order:
            raise ModelError(f"input '{name}' is a derivative; name the variable itself, or filter it in the model")
        repeated = [flat.variables[i].name for i in indices if i in known]
        if repeated:
            raise ModelError(f"input '{repeated[0]}' is named twice; name it once")
        known += indices
    return known


def _values(flat: FlatModel, known: list[int], input_values: Mapping[str, Any]) -> dict[int, float]:
    """Return the value of each input at the point, by index. Raises ModelError for a wrong name or shape."""
    values = dict.fromkeys(known, 0.0)
    for name, value in input_values.items():
        _, indices, order = flat.lookup(name)
        if order or not set(indices) <= set(known):
            raise ModelError(f"input_values: '{name}' is not an input")
        array = numbers(f"input_values: '{name}'", value)
        if array.size not in (1, len(indices)) or not np.all(np.isfinite(array)):
            raise ModelError(f"input_values: '{name}' takes {len(indices)} finite numbers; found {value}")
        values.update(zip(indices, np.broadcast_to(array, len(indices)).tolist(), strict=True))
    return values


def natural_modes(system: StateSpace) -> list[Mode]:
    """Return the modes of a linear model by rising frequency, one for each conjugate pair.

    system: the result of `linearize`. Each `Mode` has its eigenvalue [1/s], with positive imaginary part if complex,
    natural frequency [Hz], damping ratio (1 for a decaying real eigenvalue) and dominant states.

    >>> class Oscillator(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     v = gt.variable(unit="m/s")
    ...     stiffness = gt.parameter(25.0, unit="1/s2")
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield gt.der(self.v) == -self.stiffness * self.x
    >>> (mode,) = gt.natural_modes(gt.linearize(Oscillator(), [], ["x", "v"], start={"x": 0.0, "v": 0.0}))
    >>> round(mode.frequency_Hz, 4)  # 5 rad/s
    0.7958
    """
    values, vectors = np.linalg.eig(np.asarray(system.A))
    result = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag < 0:
            continue
        share = np.abs(vector) / max(1e-300, float(np.max(np.abs(vector))))
        moving = tuple(str(n) for n, s in zip(system.state_labels, share, strict=True) if s > 0.5)
        frequency, damping = frequency_and_damping(value)
        result.append(Mode(complex(value), float(frequency), float(damping), moving))
    return sorted(result, key=lambda m: (m.frequency_Hz, m.eigenvalue.real))
