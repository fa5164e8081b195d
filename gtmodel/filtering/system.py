"""A process with its sensors, compiled: transitions between instants, and measurements with their Jacobians."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..inference.chance import chi_squared_bound, chi_squared_chance, chi_squared_share
from ..results.refusal import ArgumentError
from .manifold import Manifold, RowsFunction, StatePart
from .process import AnyProcess, same_mixing
from .sensors import ESTIMATE, Sensor
from .transition import CurvedTransition, GivenTransition, LinearTransition, runge_kutta

SAME_INSTANT = 1e-9  # s; closer times are the same instant: round-off of clocks, far below any motion
LONGEST_STEP = 0.01  # s; steps of a nonlinear process are divided into parts of at most this


class SensorGroup(NamedTuple):
    """Sensors that are read at the same instant. space: of their readings, side by side; rows: slice of each residual;
    variances: of all numbers (k,); noise: the same as a diagonal matrix (1, k, k); gates, robust: index and name of the
    sensors with a gate, or with outlier weights."""

    space: Manifold
    rows: tuple[slice, ...]
    variances: np.ndarray
    noise: np.ndarray
    gates: tuple[tuple[int, str], ...]
    robust: tuple[tuple[int, str], ...]


class System(Portable):
    """A process and its sensors as numeric functions on rows of states.

    Args:
        process: model of the motion, with its noise.
        sensors: measured quantities.
        estimate: names of model parameters that become constant states, besides the `"estimate"`s of sensors.
        longest_step: longest step of a nonlinear process [s].

    space: of all states, constants last. transition: from instant to instant. linear: whether process and sensors are
    linear with constant coefficients. Raises ArgumentError for wrong names.
    """

    def __init__(
        self,
        process: AnyProcess,
        sensors: Sequence[Sensor],
        *,
        estimate: Sequence[str] = (),
        longest_step: float = LONGEST_STEP,
    ) -> None:
        self.process = process
        if not longest_step > 0:
            raise ArgumentError(f"expected more than 0 s; found {longest_step}", "longest_step")
        names = [sensor.name for sensor in sensors]
        if not names or len(set(names)) != len(names):
            raise ArgumentError(f"expected sensors with different names; found {names}", "sensors")
        self.sensors = {sensor.name: sensor for sensor in sensors}
        d = self.dynamics = process.dynamics([*dict.fromkeys(sensor.quantity for sensor in sensors)])
        for name in estimate:
            if name not in d.parameters:
                free = ", ".join(f"'{n}'" for n in d.parameters) or "none; name it in parameters= of the process"
                raise ArgumentError(f"'{name}' is not a free parameter of the process; these are {free}", "estimate")
        self._columns = d.columns()
        self.readings = {name: self._part(sensor) for name, sensor in self.sensors.items()}
        constants = [StatePart(name, size=d.parameters[name].size, unit="?") for name in estimate]
        for name, sensor in self.sensors.items():
            for what, unit in (("delay", "s"), ("scale", "1"), ("offset", self.readings[name].unit)):
                if getattr(sensor, what) == ESTIMATE:
                    size = 1 if what == "delay" else self.readings[name].size
                    constants.append(StatePart(f"{name}.{what}", size=size, unit=unit))
        self.own = d.space
        self.constants = tuple(part.name for part in constants)
        self.space = Manifold([*d.space.parts, *constants])
        self.deviations = {
            name: sensor.deviations(self.readings[name].dimension) for name, sensor in self.sensors.items()
        }
        mixing = {name: sensor.mixing(self.readings[name].dimension) for name, sensor in self.sensors.items()}
        self.mixing = {name: W for name, W in mixing.items() if W is not None}
        self.transition, straight = self._transition(longest_step)
        self.linear = straight and self._straight_readings()
        self._compiled: dict[tuple[str, ...], Any] = {}
        self._groups: dict[tuple[str, ...], SensorGroup] = {}
        self._limits: dict[str, np.ndarray] = {}

    def with_(self, noise: Mapping[str, Any] | None = None, deviations: Mapping[str, Any] | None = None) -> System:
        """Return the same system with other noise densities and sensor deviations, without compiling again.

        Raises ArgumentError for an unknown name, and for noise with other correlations.
        """
        other = copy.copy(self)
        other._groups = {}
        if noise:
            other.process = self.process.with_noise(**noise)
            intensity = other.process.intensity(self.dynamics.noise)
            other.dynamics = replace(self.dynamics, intensity=intensity)
            other.transition = self.transition.with_intensity(intensity)
        other.deviations = dict(self.deviations)
        for name, value in (deviations or {}).items():
            if name not in self.sensors:
                names = ", ".join(f"'{n}'" for n in self.sensors)
                raise ArgumentError(f"there is no sensor '{name}'; the sensors are {names}", "deviations")
            size = self.readings[name].dimension
            sensor = self.sensors[name].with_deviation(value, size)
            other.sensors = {**other.sensors, name: sensor}
            other.deviations[name] = sensor.deviations(size)
        return other

    @cached_property
    def curved_errors(self) -> bool:
        """Whether the axes of an error rotate with its point, as for directions."""
        return any(part.kind == "direction" for part in self.space.parts)

    def gate_limits(self, name: str) -> np.ndarray:
        """Return the largest normalised innovation squared that the gate of a sensor accepts, by count of numbers."""
        if name not in self._limits:
            sizes = np.arange(1, self.readings[name].dimension + 1)
            beyond = 1 - (self.sensors[name].gate or 1.0)
            self._limits[name] = np.append(np.inf, chi_squared_bound(beyond, sizes))
        return self._limits[name]

    def huber_limits(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the normalised distance beyond which a reading of a sensor counts less, by count of used numbers, and
        the mean of distance times Huber's influence divided by this count; 1 without a limit."""
        key = f"{name} huber"
        if key not in self._limits:
            sizes = np.arange(1, self.readings[name].dimension + 1)
            square = chi_squared_bound(chi_squared_chance(HUBER**2, 1), sizes)
            # E[min(d^2, k d)] of d^2 chi-squared: the part below k, and k times the mean of d beyond it
            mean = np.sqrt(2) * np.exp(_log_gamma((sizes + 1) / 2) - _log_gamma(sizes / 2))
            beyond = chi_squared_chance(square, sizes + 1)
            part = sizes * chi_squared_share(square, sizes + 2) + np.sqrt(square) * mean * beyond
            self._limits[key] = np.array([[np.inf, *np.sqrt(square)], [1.0, *(part / sizes)]])
        limits, factors = self._limits[key]
        return limits, factors

    def start_constants(self) -> dict[str, Any]:
        """Return the start values of the constants by name."""
        declared = dict(self.dynamics.parameters)
        return {
            name: declared.get(name, np.ones(part.size) if name.endswith(".scale") else np.zeros(part.size))
            for name in self.constants
            for part in [self.space.part(name)[0]]
        }

    # -- expressions -----------------------------------------------------------------------------------

    def _constant(self, x: Any, name: str) -> Any:
        return x[self.space.part(name)[1]]

    def _parameters(self, x: Any) -> Any:
        values = [self._constant(x, n) if n in self.constants else v for n, v in self.dynamics.parameters.items()]
        return ca.vertcat(*values) if values else ca.DM.zeros(0)

    def rates(self, t: Any, x: Any, u: Any, w: Any) -> Any:
        """Return the rates of all states as a CasADi column, or in discrete time the next states; constants stay."""
        rates = self.dynamics.rates(t, x[: self.own.size], u, w, self._parameters(x))
        if not self.constants:  # CasADi would make a row of zero constants and a single state
            return rates
        constants = x[self.own.size :]
        return ca.vertcat(rates, constants if self.dynamics.step else 0 * constants)

    def _part(self, sensor: Sensor) -> StatePart:
        """The manifold of one reading."""
        c = self._columns
        value = self.dynamics.outputs[sensor.quantity](c["t"], c["x"], c["u"], c["p"])
        self._corrections(sensor, value.numel())
        kind = next((part.kind for part in self.dynamics.space.parts if part.name == sensor.quantity), sensor.kind)
        if kind != sensor.kind and kind != "vector":
            raise ArgumentError(
                f"'{sensor.name}' measures the {kind} '{sensor.quantity}' as a {sensor.kind}; set kind='{kind}'",
                f"{sensor.name}.kind",
            )
        return StatePart(sensor.name, sensor.kind, value.numel(), self.process.unit_of(sensor.quantity))

    def _corrections(self, sensor: Sensor, size: int) -> None:
        """Raise ArgumentError if the size of scale or offset of a sensor does not fit its quantity."""
        for what in ("scale", "offset"):
            value = getattr(sensor, what)
            if value != ESTIMATE if isinstance(value, str) else np.shape(value) not in ((), (1,), (size,)):
                raise ArgumentError(f"expected a number, or {size}; found {value!r}", f"{sensor.name}.{what}")

    def expected(self, sensor: Sensor, t: Any, x: Any, u: Any) -> Any:
        """Return the ideal reading of a sensor at states x, as a CasADi column."""
        if sensor.delay == ESTIMATE:
            if self.dynamics.step:
                raise ArgumentError("with a process in discrete time a delay cannot be estimated; give it", "delay")
            lag = self._constant(x, f"{sensor.name}.delay")
            none = ca.DM.zeros(sum(self.dynamics.noise.values()))
            x = runge_kutta(self.space, self.rates, t, -lag, x, u, u, none)
        value = self.dynamics.outputs[sensor.quantity](t, x[: self.own.size], u, self._parameters(x))
        if sensor.kind != "vector":
            return value
        scale = self._constant(x, f"{sensor.name}.scale") if sensor.scale == ESTIMATE else np.asarray(sensor.scale)
        offset = self._constant(x, f"{sensor.name}.offset") if sensor.offset == ESTIMATE else np.asarray(sensor.offset)
        return (value + offset) / scale

    def _symbols(self) -> tuple[Any, Any, Any]:
        symbol = self.dynamics.symbol
        return symbol("t"), symbol("x", self.space.size), symbol("u", sum(self.dynamics.inputs.values()))

    # -- compiled --------------------------------------------------------------------------------------

    def _transition(self, longest: float) -> tuple[Any, bool]:
        """The transition, and whether it is linear with constant coefficients."""
        d, (t, x, u), w = self.dynamics, self._symbols(), self._columns["w"]
        rate = self.rates(t, x, u, w)
        blocks = [ca.jacobian(rate, v) for v in (x, u, w)]
        every = ca.vertcat(t, x, u, w)
        straight = self.space.flat and not (_varies(blocks, every) or ca.jacobian(rate, t).nnz())
        if d.step:
            return GivenTransition(d, self.space, self.rates), straight
        if not straight:
            return CurvedTransition(d, self.space, self.rates, longest), False
        rest = ca.substitute(rate, every, ca.DM.zeros(every.numel()))
        A, B, G, c = (np.asarray(m.full()) for m in ca.Function("linear", [], [*blocks, rest])().values())
        return LinearTransition(A, B, c[:, 0], G, d.intensity), True

    def _straight_readings(self) -> bool:
        t, x, u = self._symbols()
        values = [self.expected(sensor, t, x, u) for sensor in self.sensors.values()]
        vectors = all(sensor.kind == "vector" for sensor in self.sensors.values())
        return vectors and not _varies([ca.jacobian(ca.vertcat(*values), x)], ca.vertcat(t, x, u))

    def residual(self, names: Sequence[str], t: Any, x: Any, u: Any, z: Any) -> tuple[Any, Any]:
        """Return the residual of readings z of these sensors, side by side, and the Jacobian H of the ideal readings
        with respect to the error of x, on CasADi columns, for generated filters such as C code.

        Raises ArgumentError for a sensor that weighs outliers: the weight does not follow from one residual.
        """
        for name in names:
            if self.sensors[name].outliers:
                raise ArgumentError(
                    f"'{name}' weighs outliers, which generated code does not support; give it a gate instead",
                    "outliers",
                )
        return self._residual(names, t, x, u, z)

    def _residual(self, names: Sequence[str], t: Any, x: Any, u: Any, z: Any) -> tuple[Any, Any]:
        residuals, rows, first = [], [], 0
        for name in names:
            space = Manifold([self.readings[name]])
            value = self.expected(self.sensors[name], t, x, u)
            residual = space.minus_symbols(z[first : first + space.size], value)
            row = ca.mtimes(space.to_error(value), ca.jacobian(value, x))
            if name in self.mixing:  # independent combinations
                unmix = ca.sparsify(ca.DM(np.tril(np.linalg.inv(self.mixing[name]))))
                residual, row = ca.mtimes(unmix, residual), ca.mtimes(unmix, row)
            residuals.append(residual)
            rows.append(row)
            first += space.size
        return ca.vertcat(*residuals), ca.mtimes(ca.vertcat(*rows), self.space.from_error(x))

    def independent(self, names: tuple[str, ...], e: np.ndarray) -> np.ndarray:
        """Return reading errors e (..., numbers) of these sensors as combinations with independent noise, as `reading`
        returns them; unchanged if no sensor has a full covariance."""
        if not self.mixing:
            return e
        e = e.copy()
        for name, at in zip(names, self.rows_of(names), strict=True):
            if name in self.mixing:
                e[..., at] = e[..., at] @ np.tril(np.linalg.inv(self.mixing[name])).T
        return e

    def reading(self, names: tuple[str, ...]) -> Any:
        """Return the function (t, x, u, z) -> residuals (m, k) of these sensors, side by side, and their Jacobian H
        (m, k, n); it is compiled at the first call."""
        if names not in self._compiled:
            t, x, u = self._symbols()
            z = self.dynamics.symbol("z", sum(self.readings[name].size for name in names))
            residual, H = self._residual(names, t, x, u, z)
            self._compiled[names] = RowsFunction("reading", [t, x, u, z], [residual, H], (1,))
        return self._compiled[names]

    def read(self, names: tuple[str, ...], t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the readings of these sensors at rows of states without noise, (m, numbers)."""
        key = ("values", *names)
        if key not in self._compiled:
            t_, x_, u_ = self._symbols()
            values = [self.expected(self.sensors[name], t_, x_, u_) for name in names]
            self._compiled[key] = RowsFunction("expected", [t_, x_, u_], [ca.vertcat(*values)])
        return self._compiled[key](t, x, u)[0]

    def group(self, names: Sequence[str]) -> SensorGroup:
        """Return the constant properties of the readings of these sensors, side by side."""
        key = tuple(names)
        if key not in self._groups:
            space = Manifold([self.readings[name] for name in key])
            rows = tuple(along for _, _, along in space.places())
            variances = np.concatenate([self.deviations[name] ** 2 for name in key])
            gates = tuple((n, name) for n, name in enumerate(key) if self.sensors[name].gate)
            robust = tuple((n, name) for n, name in enumerate(key) if self.sensors[name].outliers)
            self._groups[key] = SensorGroup(space, rows, variances, np.diag(variances)[None], gates, robust)
        return self._groups[key]

    def rows_of(self, names: Sequence[str]) -> tuple[slice, ...]:
        """Return the slice of the residual of each of these sensors."""
        return self.group(names).rows

    def variances(self, names: Sequence[str]) -> np.ndarray:
        """Return the noise variances of these sensors, one for each number of the residual."""
        return self.group(names).variances

    def bends(self, inputs: Any, first: float, last: float) -> list[tuple[float, np.ndarray]]:
        """Return the trajectory rows between two times, where known inputs may change slope: times and values."""
        times = getattr(inputs, "time", None) if self.dynamics.inputs else None
        if times is None:
            return []
        if (period := self.dynamics.period) is not None:  # a step takes the inputs at its start
            steps = round((last - first) / period)
            return [(t, self.inputs_at(inputs, t)) for t in (float(first + k * period) for k in range(1, steps))]
        rows = slice(*np.searchsorted(times, [first + SAME_INSTANT, last - SAME_INSTANT]))
        return [(float(t), self.inputs_at(inputs, float(t))) for t in times[rows]]

    def inputs_at(self, inputs: Any, t: float) -> np.ndarray:
        """Return the known inputs (nu,) of a trajectory at an instant."""
        names: Mapping[str, int] = self.dynamics.inputs
        if not names:
            return _NONE
        return np.concatenate([np.atleast_1d(inputs(t, name)) for name in names])


_NONE = np.zeros(0)
HUBER = 1.345  # standard deviations of a single number: 95 % efficient for normal noise


def _log_gamma(x: np.ndarray) -> np.ndarray:
    from scipy.special import gammaln

    return gammaln(x)


def _varies(blocks: Sequence[Any], arguments: Any) -> bool:
    """Whether any entry of these matrices depends on the arguments."""
    return any(any(ca.which_depends(ca.vec(b), arguments, 1, True)) for b in blocks if b.numel())


def agree_in_shape(systems: Sequence[System]) -> None:
    """Raise ArgumentError unless all systems have the same states and sensors."""
    first = systems[0]
    for n, other in enumerate(systems):
        if other.space.parts != first.space.parts or other.readings != first.readings:
            raise ArgumentError(f"system {n} has other states or sensors than system 0; make them equal", "systems")
        for name, sensor in other.sensors.items():
            if not same_mixing(other.mixing.get(name), first.mixing.get(name)):
                raise ArgumentError(f"system {n} has other correlations of the noise of '{name}'", "systems")
            for what in ("lag", "gate"):
                if getattr(sensor, what) != getattr(first.sensors[name], what):
                    raise ArgumentError(
                        f"system {n} has another {'delay' if what == 'lag' else what} of '{name}' than system 0; all "
                        "systems must use the same readings at the same instants",
                        "systems",
                    )
