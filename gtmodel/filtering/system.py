"""A process with its sensors, compiled: steps from instant to instant, and readings with their Jacobians."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..inference.chance import chi_squared_bound, chi_squared_chance, chi_squared_share
from ..results.refusal import ArgumentError
from .manifold import Manifold, RowsFunction, StatePart
from .process import AnyProcess, same_mixing
from .sensors import ESTIMATE, Sensor
from .transition import CurvedTransition, GivenTransition, LinearTransition, runge_kutta

SAME_INSTANT = 1e-9  # s; times closer than that are one instant: round-off of clocks, far below any motion
LONGEST_STEP = 0.01  # s; steps of a process that is not linear are cut into parts of at most this


class SensorGroup(NamedTuple):
    """Sensors that are read at one instant. space: of what they read, side by side; rows: where the residual of each
    stands; variances: of all numbers; gates, robust: place and name of those that have a gate, or weigh outliers."""

    space: Manifold
    rows: tuple[slice, ...]
    variances: np.ndarray
    gates: tuple[tuple[int, str], ...]
    robust: tuple[tuple[int, str], ...]


class System:
    """A process and its sensors as numeric functions on rows of states.

    Args:
        process: what moves.
        sensors: what is measured.
        estimate: names of parameters of the model that become constant states, beside the `"estimate"`s of sensors.
        longest_step: of a process that is not linear [s].

    space: of all states, constants last. transition: from instant to instant. `linear` says whether process and sensors
    are linear with constant coefficients. Raises ArgumentError for wrong names.
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
            raise ArgumentError(f"expected sensors with a name of their own each; found {names}", "sensors")
        self.sensors = {sensor.name: sensor for sensor in sensors}
        d = self.dynamics = process.dynamics([*dict.fromkeys(sensor.quantity for sensor in sensors)])
        for name in estimate:
            if name not in d.parameters:
                there = ", ".join(f"'{n}'" for n in d.parameters) or "none; name them as parameters of the process"
                raise ArgumentError(f"'{name}' is no parameter that may change; there are {there}", "estimate")
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
        made = {name: sensor.mixing(self.readings[name].dimension) for name, sensor in self.sensors.items()}
        self.mixing = {name: W for name, W in made.items() if W is not None}
        self.transition, straight = self._transition(longest_step)
        self.linear = straight and self._straight_readings()
        self._made: dict[tuple[str, ...], Any] = {}
        self._groups: dict[tuple[str, ...], SensorGroup] = {}
        self._limits: dict[str, np.ndarray] = {}

    def with_(self, noise: Mapping[str, Any] | None = None, deviations: Mapping[str, Any] | None = None) -> System:
        """The same system with other densities of noise and other deviations of sensors; nothing is compiled anew.

        Raises ArgumentError for a name that is not there, and for noise that is correlated in another way.
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
                there = ", ".join(f"'{n}'" for n in self.sensors)
                raise ArgumentError(f"there is no sensor '{name}'; there are {there}", "deviations")
            size = self.readings[name].dimension
            sensor = self.sensors[name].with_deviation(value, size)
            other.sensors = {**other.sensors, name: sensor}
            other.deviations[name] = sensor.deviations(size)
        return other

    @property
    def curved_errors(self) -> bool:
        """Whether the axes of an error turn with the point it belongs to, as of directions."""
        return any(part.kind == "direction" for part in self.space.parts)

    def gate_limits(self, name: str) -> np.ndarray:
        """Normalised innovations squared beyond which the gate of a sensor is closed, by how many numbers are used."""
        if name not in self._limits:
            sizes = np.arange(1, self.readings[name].dimension + 1)
            beyond = 1 - (self.sensors[name].gate or 1.0)
            self._limits[name] = np.append(np.inf, chi_squared_bound(beyond, sizes))
        return self._limits[name]

    def huber_limits(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """How far off, in its own deviations, a reading of a sensor begins to count less, by how many numbers are used;
        and the mean of that distance times Huber's influence there over those numbers, 1 without a limit."""
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
        """Where the constants begin, by name."""
        given = dict(self.dynamics.parameters)
        return {
            name: given.get(name, np.ones(part.size) if name.endswith(".scale") else np.zeros(part.size))
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
        """Rates of all states as a CasADi column, or the next states of a process in discrete time; constants stay."""
        own = self.dynamics.rates(t, x[: self.own.size], u, w, self._parameters(x))
        if not self.constants:  # none of a single number would be a row in CasADi
            return own
        kept = x[self.own.size :]
        return ca.vertcat(own, kept if self.dynamics.step else 0 * kept)

    def _part(self, sensor: Sensor) -> StatePart:
        """The manifold of one reading."""
        c = self._columns
        value = self.dynamics.outputs[sensor.quantity](c["t"], c["x"], c["u"], c["p"])
        self._corrections(sensor, value.numel())
        own = next((part.kind for part in self.dynamics.space.parts if part.name == sensor.quantity), sensor.kind)
        if own != sensor.kind and own != "vector":
            raise ArgumentError(
                f"'{sensor.name}' measures the {own} '{sensor.quantity}' as a {sensor.kind}; say kind='{own}'",
                f"{sensor.name}.kind",
            )
        return StatePart(sensor.name, sensor.kind, value.numel(), self.process.unit_of(sensor.quantity))

    def _corrections(self, sensor: Sensor, size: int) -> None:
        """Raises ArgumentError where scale or offset of a sensor are of another size than its quantity."""
        for what in ("scale", "offset"):
            given = getattr(sensor, what)
            if given != ESTIMATE if isinstance(given, str) else np.shape(given) not in ((), (1,), (size,)):
                raise ArgumentError(f"expected a number, or {size}; found {given!r}", f"{sensor.name}.{what}")

    def expected(self, sensor: Sensor, t: Any, x: Any, u: Any) -> Any:
        """What a sensor reads at states x, as a CasADi column."""
        if sensor.delay == ESTIMATE:
            if self.dynamics.step:
                raise ArgumentError("the delay of a process in discrete time cannot be estimated; give it", "delay")
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
        """The steps, and whether they are linear with constant coefficients."""
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
        """What these sensors read, z side by side, over what they should read, and the Jacobian H of the latter in the
        error of x, on CasADi columns: for a filter that is written out, such as in C.

        Raises ArgumentError for a sensor that weighs outliers: a residual by itself says nothing of its weight.
        """
        for name in names:
            if self.sensors[name].outliers:
                raise ArgumentError(
                    f"'{name}' weighs outliers, which a filter that is written out, such as in C, does not; give it a "
                    "gate in its place",
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
                own = ca.sparsify(ca.DM(np.tril(np.linalg.inv(self.mixing[name]))))
                residual, row = ca.mtimes(own, residual), ca.mtimes(own, row)
            residuals.append(residual)
            rows.append(row)
            first += space.size
        return ca.vertcat(*residuals), ca.mtimes(ca.vertcat(*rows), self.space.from_error(x))

    def independent(self, names: tuple[str, ...], e: np.ndarray) -> np.ndarray:
        """Errors (..., numbers) of what these sensors read as combinations whose noise is independent, which is
        what `reading` gives; the same where no sensor has a full covariance."""
        if not self.mixing:
            return e
        e = e.copy()
        for name, at in zip(names, self.rows_of(names), strict=True):
            if name in self.mixing:
                e[..., at] = e[..., at] @ np.tril(np.linalg.inv(self.mixing[name])).T
        return e

    def reading(self, names: tuple[str, ...]) -> Any:
        """The function (t, x, u, z) -> residuals (m, k) of what these sensors read, side by side, and their Jacobian H
        (m, k, n); made when it is first needed."""
        if names not in self._made:
            t, x, u = self._symbols()
            z = self.dynamics.symbol("z", sum(self.readings[name].size for name in names))
            residual, H = self._residual(names, t, x, u, z)
            self._made[names] = RowsFunction("reading", [t, x, u, z], [residual, H], (1,))
        return self._made[names]

    def read(self, names: tuple[str, ...], t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """What these sensors read at rows of states without noise, (m, numbers)."""
        key = ("values", *names)
        if key not in self._made:
            t_, x_, u_ = self._symbols()
            values = [self.expected(self.sensors[name], t_, x_, u_) for name in names]
            self._made[key] = RowsFunction("expected", [t_, x_, u_], [ca.vertcat(*values)])
        return self._made[key](t, x, u)[0]

    def group(self, names: Sequence[str]) -> SensorGroup:
        """What does not change of the readings of these sensors, side by side."""
        key = tuple(names)
        if key not in self._groups:
            space = Manifold([self.readings[name] for name in key])
            rows = tuple(along for _, _, along in space.places())
            variances = np.concatenate([self.deviations[name] ** 2 for name in key])
            gates = tuple((n, name) for n, name in enumerate(key) if self.sensors[name].gate)
            robust = tuple((n, name) for n, name in enumerate(key) if self.sensors[name].outliers)
            self._groups[key] = SensorGroup(space, rows, variances, gates, robust)
        return self._groups[key]

    def rows_of(self, names: Sequence[str]) -> tuple[slice, ...]:
        """Where the residual of each of these sensors stands among them."""
        return self.group(names).rows

    def variances(self, names: Sequence[str]) -> np.ndarray:
        """Variances of the noise of these sensors, one for each number of the residual."""
        return self.group(names).variances

    def bends(self, inputs: Any, first: float, last: float) -> list[tuple[float, np.ndarray]]:
        """Instants between two times at which known inputs may bend, rows of a trajectory, and their values there."""
        times = getattr(inputs, "time", None) if self.dynamics.inputs else None
        if times is None:
            return []
        if (period := self.dynamics.period) is not None:  # a step takes the inputs at its begin
            steps = round((last - first) / period)
            return [(t, self.inputs_at(inputs, t)) for t in (float(first + k * period) for k in range(1, steps))]
        rows = slice(*np.searchsorted(times, [first + SAME_INSTANT, last - SAME_INSTANT]))
        return [(float(t), self.inputs_at(inputs, float(t))) for t in times[rows]]

    def inputs_at(self, inputs: Any, t: float) -> np.ndarray:
        """The known inputs (nu,) at an instant from a trajectory of them."""
        names: Mapping[str, int] = self.dynamics.inputs
        if not names:
            return _NONE
        return np.concatenate([np.atleast_1d(inputs(t, name)) for name in names])


_NONE = np.zeros(0)
HUBER = 1.345  # deviations of a single number: 95 % efficient where the noise is normal


def _log_gamma(x: np.ndarray) -> np.ndarray:
    from scipy.special import gammaln

    return gammaln(x)


def _varies(blocks: Sequence[Any], arguments: Any) -> bool:
    """Whether an entry of some matrices depends on an argument."""
    return any(any(ca.which_depends(ca.vec(b), arguments, 1, True)) for b in blocks if b.numel())


def agree_in_shape(systems: Sequence[System]) -> None:
    """Raises ArgumentError unless all systems have the same states and sensors."""
    first = systems[0]
    for n, other in enumerate(systems):
        if other.space.parts != first.space.parts or other.readings != first.readings:
            raise ArgumentError(f"system {n} has other states or sensors than system 0; give all the same", "systems")
        for name, sensor in other.sensors.items():
            if not same_mixing(other.mixing.get(name), first.mixing.get(name)):
                raise ArgumentError(f"system {n} has noise of '{name}' that is correlated in another way", "systems")
            for what in ("lag", "gate"):
                if getattr(sensor, what) != getattr(first.sensors[name], what):
                    raise ArgumentError(
                        f"system {n} has another {'delay' if what == 'lag' else what} of '{name}' than system 0; all "
                        "are to use the same readings at the same instants",
                        "systems",
                    )
