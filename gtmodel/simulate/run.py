"""simulate(): a consistent start, an error-controlled integrator, states that switch where they would fail."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import casadi as ca
import numpy as np

from ..compiler.causal import flat_of
from ..compiler.flat import FlatModel
from ..compiler.initial import initial_point, missing_starts, start_values
from ..compiler.plan import Plan, make_plan
from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.scope import derivative_name
from ..lang.source import ModelError
from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .inputs import Inputs, read_inputs
from .reduced import Reduced, stored_energy
from .step import CHUNK, Stepper

OUTPUT_STEPS = 500
# below this fraction of the best conditioning the states are chosen anew
SWITCH_BELOW = 0.3
MAX_SWITCHES = 10000

Progress = Callable[[float], bool]


@dataclass(frozen=True)
class Switch:
    """A change of states on the way."""

    time: float
    before: tuple[str, ...]
    after: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Simulation:
    """Result of simulate().

    trajectory: every quantity declared at the top or one level below, the states' derivatives, and with
    declared energies `energy.stored`, `energy.supplied`, `energy.dissipated` [J].
    energy_error: largest |stored - start - supplied + dissipated| [J]; None without declared energies.
    chosen: states whose start value nobody prescribed. switches: changes of states on the way.
    """

    status: SolveStatus
    message: str
    trajectory: Trajectory
    energy_error: float | None = None
    chosen: list[str] = field(default_factory=list)
    switches: list[Switch] = field(default_factory=list)


class NotSimulated(RuntimeError):
    """Raised by simulate() when the run ended early; `.simulation` holds what was reached."""

    def __init__(self, simulation: Simulation) -> None:
        super().__init__(simulation.message)
        self.simulation = simulation


def simulate(
    model: Model | Builder,
    final_time: float,
    *,
    start_time: float = 0.0,
    inputs: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
    step: float | None = None,
    outputs: Sequence[str] = (),
    prefer: Sequence[str] = (),
    tolerance: float = 1e-9,
    method: Literal["bdf", "adams"] = "bdf",
    progress: Progress | None = None,
    throw: bool = True,
) -> Simulation:
    """Simulate a model from start_time to final_time [s].

    Args:
        inputs: known variables by name: a number, an array, a function of time, (times, values) or a Trajectory.
        start: prescribed start values by name, e.g. {"T": [...], "der(T)": [...]}; fixed start attributes are
            prescribed too, other start attributes are guesses. What is left free moves as little as possible.
        step: output interval [s]; default a 500th of the horizon.
        outputs: further names to record, e.g. "arm[0].rod.tension".
        prefer: names to keep as states.
        tolerance: relative and absolute tolerance of the integrator.
        method: "bdf" for anything, "adams" for smooth motion at tight tolerances.
        progress: called with the time reached; returning True stops the run, keeping what there is.

    Raises ModelError for a wrong model, input or start, and NotSimulated unless throw is False.
    """
    if not np.isfinite(final_time) or not final_time > start_time:
        raise ModelError(f"the simulation must end after its start; found {start_time:g} s to {final_time:g} s")
    step = (final_time - start_time) / OUTPUT_STEPS if step is None else float(step)
    if not 0 < step <= final_time - start_time:
        raise ModelError(f"the output interval must be positive and within the horizon; found {step:g} s")
    flat = flat_of(model)
    _refuse_sign(flat)
    given = read_inputs(flat, inputs or {})
    run = _Run(flat, given, list(outputs), [i for name in prefer for i in flat.lookup(name)[1]], tolerance, method)
    run.begin(start or {}, start_time)
    simulation = run.go(start_time, final_time, step, progress)
    if throw and not simulation.status.ok:
        raise NotSimulated(simulation)
    return simulation


class _Run:
    def __init__(
        self, flat: FlatModel, inputs: Inputs, outputs: list[str], prefer: list[int], tolerance: float, method: str
    ) -> None:
        self.flat, self.inputs, self.prefer = flat, inputs, prefer
        self.tolerance, self.method = tolerance, method
        self.entries = _entries(flat, outputs)
        scope = flat.scope
        self.expressions = [scope.symbol(i, k) for _, _, pairs, _ in self.entries for i, k in pairs]
        self.has_energy = bool(flat.energies)
        self.switches: list[Switch] = []

    def plan(self, at: np.ndarray | None = None) -> Plan:
        flat = self.flat
        terms = [e.expression for e in flat.energies]
        targets = {(v.index, 0) for v in flat.variables}
        targets |= {p for e in [*self.expressions, *terms] for p in flat.scope.symbols_in(e)}
        given = set(self.inputs.known)
        left = [v.name for v in flat.variables if v.role == "input" and v.index not in given]
        try:
            return make_plan(
                flat, self.inputs.known, sorted(targets), self.prefer, rates=True,
                fold=ca.SX(ca.DM(flat.require_values())), at=at,
            )  # fmt: skip
        except ModelError as error:
            if left and "equations for" in str(error):
                raise ModelError(f"{error}; inputs without a value: {', '.join(left)}") from None
            raise

    def use(self, plan: Plan) -> None:
        self.reduced = Reduced(plan, self.inputs, [*self.expressions, stored_energy(plan)])
        self.stepper = Stepper(self.reduced, self.tolerance, self.method)

    def begin(self, start: Mapping[str, Any], time: float) -> None:
        plan = self.plan()
        held, guess = start_values(plan, start)
        self.use(plan)
        known = [p for p in plan.pairs if p[0] in set(self.inputs.known)]
        if known:
            p = self.reduced.table_parameters(time, self._next_knot(time))
            values = ca.Function(
                "known", [self.reduced.t, self.reduced.p], [ca.vertcat(*[self.reduced._known(*pair) for pair in known])]
            )(time, p)
            held |= dict(zip(known, np.asarray(values).reshape(-1).tolist(), strict=True))
        w = initial_point(plan, held, guess, time)
        at = self.plan(at=w)  # states and branches of this very start
        self.chosen = missing_starts(at, held)
        self.use(at)
        self.x, self.z = self._from_point(at, w)
        self.supplied = self.dissipated = 0.0

    def _from_point(self, plan: Plan, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        position = {pair: n for n, pair in enumerate(plan.pairs)}
        scope = plan.flat.scope
        x = np.array([w[position[s]] for s in plan.states])
        pairs = [scope.owner(u) for b in plan.newton for u in b.unknowns]
        return x, np.array([w[position[pair]] for pair in pairs if pair is not None])

    def _next_knot(self, time: float) -> float:
        knots = self.inputs.knots
        later = knots[knots > time + 1e-12]
        return float(later[0]) if later.size else time + 1.0

    def go(self, t0: float, t1: float, step: float, progress: Progress | None) -> Simulation:
        count = max(1, round((t1 - t0) / step))
        grid = np.linspace(t0, t1, count + 1) if abs(count * step - (t1 - t0)) < 1e-9 * (t1 - t0) else np.append(
            np.arange(t0, t1, step), t1)  # fmt: skip
        knots = self.inputs.knots
        stops = np.unique(np.concatenate([grid, knots[(knots > t0) & (knots < t1)]]))
        recorded = [self._record(t0, float(stops[1]))]
        times = [t0]
        wanted = set(grid.tolist())
        status, message = SolveStatus.SOLVED, "simulated"
        i = 0
        while i < len(stops) - 1:
            left = float(stops[i])
            done = self._chunk(stops, i, wanted, times, recorded)
            if done == 0:
                right = float(stops[i + 1])
                trouble = self._advance(left, right)
                if trouble:
                    status, message = SolveStatus.FAILED, trouble
                    break
                if right in wanted:
                    recorded.append(self._record(right, left))
                    times.append(right)
                done = 1
            i += done
            if progress is not None and progress(float(stops[i])):
                status, message = SolveStatus.INTERRUPTED, f"stopped by request at {stops[i]:.6g} s"
                break
        trajectory, error = self._trajectory(np.array(times), np.array(recorded))
        if self.switches and status.ok:
            message = f"simulated; states switched {len(self.switches)} times"
        return Simulation(status, message, trajectory, error, self.chosen, self.switches)

    def _chunk(
        self, stops: np.ndarray, i: int, wanted: set[float], times: list[float], recorded: list[np.ndarray]
    ) -> int:
        """Integrate up to CHUNK equal intervals in one call; returns how many of them are good."""
        piece = stops[i : i + CHUNK + 1]
        if len(piece) <= CHUNK or (self.inputs.tables and np.any(np.isin(piece[1:-1], self.inputs.knots))):
            return 0
        lengths = np.diff(piece)
        if np.ptp(lengths) > 1e-9 * lengths[0]:
            return 0
        p = self.reduced.table_parameters(float(piece[0]), float(piece[-1]))
        result = self.stepper(self.x, self.z, float(piece[0]), float(lengths.mean()), p, chunk=True)
        if result is None:
            return 0
        xs, zs, works = result
        base = self.supplied, self.dissipated
        good = 0
        for k, time in enumerate(map(float, piece[1:])):
            quality = self.reduced.quality(xs[k], zs[k], time, p)
            if quality < SWITCH_BELOW / 6:
                break
            self.x, self.z = xs[k], zs[k]
            self.supplied, self.dissipated = base[0] + works[k, 0], base[1] + works[k, 1]
            good += 1
            poor = quality < SWITCH_BELOW
            if poor and not self._switch(time, p):
                poor = False  # nothing better here: the next piece shows whether it goes on
            if time in wanted:
                recorded.append(self._record(time, float(piece[0])))
                times.append(time)
            if poor:
                break
        return good

    def _advance(self, left: float, right: float) -> str:
        """Integrate one piece; switch states where they get poor. Returns a sentence on failure."""
        time, length = left, right - left
        p = self.reduced.table_parameters(left, right)
        shortest = max(1e-12, 1e-9 * (right - left))
        while time < right - 1e-15 * max(1.0, abs(right)):
            length = min(length, right - time)
            result = self.stepper(self.x, self.z, time, length, p)
            quality = -1.0
            if result is not None:
                x, z, work = (r[0] for r in result)
                quality = self.reduced.quality(x, z, time + length, p)
            if result is None or quality < SWITCH_BELOW / 6:
                if length > shortest:
                    length *= 0.5
                    continue
                return self._lost(time, p)
            self.x, self.z = x, z
            self.supplied += work[0]
            self.dissipated += work[1]
            time = right if length == right - time else time + length
            if quality < SWITCH_BELOW and not self._switch(time, p):
                return f"the states became singular at {time:.6g} s and no better choice exists there"
            length = min(2 * length, right - time) if time < right else length
        return ""

    def _lost(self, time: float, p: np.ndarray) -> str:
        margins = np.asarray(self.reduced.margin(self.x, self.z, time, p)).reshape(-1)
        labels = [m for b in self.reduced.plan.blocks for m in b.margins]
        near = [m.label for m, v in zip(labels, margins, strict=True) if abs(v) < 1e-3 * m.scale or not np.isfinite(v)]
        hint = f"; near zero there: {', '.join(near[:4])}" if near else ""
        return f"the integrator stopped at {time:.6g} s: the motion leads out of the model's range{hint}"

    def _switch(self, time: float, p: np.ndarray) -> bool:
        """Choose states anew at the present point. False if nothing changes."""
        old = self.reduced.plan
        w = np.asarray(self.reduced.point(self.x, self.z, time, p)).reshape(-1)
        new = self.plan(at=w)
        if new.states == old.states or len(self.switches) >= MAX_SWITCHES:
            return False
        self.use(new)
        self.x, self.z = self._from_point(new, w)
        names = [tuple(self.flat.symbol_name(*s) for s in plan.states) for plan in (old, new)]
        self.switches.append(Switch(time, names[0], names[1]))
        return True

    def _record(self, time: float, other: float) -> np.ndarray:
        """Outputs at a time; `other` is a time on the same piece of the tables."""
        p = self.reduced.table_parameters(min(time, other), max(time, other))
        y = np.asarray(self.reduced.output(self.x, self.z, time, p)).reshape(-1)
        return np.concatenate([y, [self.supplied, self.dissipated]])

    def _trajectory(self, times: np.ndarray, rows: np.ndarray) -> tuple[Trajectory, float | None]:
        values: dict[str, np.ndarray] = {}
        units: dict[str, str] = {}
        column = 0
        for name, shape, pairs, unit in self.entries:
            block = rows[:, column : column + len(pairs)]
            column += len(pairs)
            if np.all(np.isfinite(block)):
                values[name] = block[:, 0] if shape == () else block
                if unit != "?":
                    units[name] = unit
        error = None
        if self.has_energy:
            stored, supplied, dissipated = rows[:, -3], rows[:, -2], rows[:, -1]
            for name, data in (("stored", stored), ("supplied", supplied), ("dissipated", dissipated)):
                values[f"energy.{name}"], units[f"energy.{name}"] = data, "J"
            error = float(np.max(np.abs(stored - stored[0] - supplied + dissipated)))
        return Trajectory(times, values, units), error


def _entries(
    flat: FlatModel, outputs: list[str]
) -> list[tuple[str, tuple[int, ...], list[tuple[int, int]], str]]:
    """(name, shape, chain symbols, unit) of what is recorded."""
    from ..compiler.causal import _unit

    entries: dict[str, tuple[str, tuple[int, ...], list[tuple[int, int]], str]] = {}
    moving = {i for e in flat.equations for i, k in flat.scope.symbols_in(e.residual) if k >= 1}
    for name, (shape, indices) in flat.groups.items():
        if name.count(".") > 1 or len(shape) > 1:
            continue
        entries[name] = (name, shape, [(i, 0) for i in indices], _unit(flat, indices[0], 0))
        if name.count(".") == 0 and (all(i in moving for i in indices) or flat.variables[indices[0]].prefer > 0):
            first = derivative_name(name, 1)
            entries[first] = (first, shape, [(i, 1) for i in indices], _unit(flat, indices[0], 1))
    for name in outputs:
        shape, indices, order = flat.lookup(name)
        entries[name] = (name, shape, [(i, order) for i in indices], _unit(flat, indices[0], order))
    return list(entries.values())


def _refuse_sign(flat: FlatModel) -> None:
    for e in flat.equations:
        f = ca.Function("e", [ca.vertcat(*ca.symvar(e.residual))], [e.residual])
        if any(f.instruction_id(k) == ca.OP_SIGN for k in range(f.n_instructions())):
            raise ModelError(
                f"'{e.label}' holds sign(), whose jump makes integrators fail or return wrong answers; use a "
                "smoothed friction (TanhFriction, PiecewiseLinearFriction)",
                e.where,
            )
