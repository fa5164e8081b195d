"""Reduced systems for each choice of states and branch signs, cached, and continuation of Newton unknowns."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from threading import get_ident
from typing import TypeVar

import casadi as ca
import numpy as np

from ..compiler.analysis.bounds import Pace, pace_of
from ..compiler.flat import FlatModel
from ..compiler.newton import solve_rows
from ..compiler.plan import CausalPlan, make_plan, starts_with
from ..lang.source import ModelError
from .choice import Choice, StateSelection, choice_of
from .inputs import SimulationInputs
from .record import Recorded
from .reduced import OriginalEquations, Reduced, Roots, Stepper

CORRECTIONS = 12
# each correction must shrink to a quarter of the last, as in compiler.newton, so that Newton stays on its solution
CONTRACTION = 0.25
# largest step of an unknown, relative to its nominal or its value if larger, so that no narrow bend is missed
REACH = 0.1
# corrections below this are round-off, even for badly scaled equations
ROUND_OFF = 1e-8
CONVERGED = 1e-13
SHORTEST = 1.0 / 4096
MOST_STEPS = 2000


class NewtonContinuation:
    """Follows the solution of r(z, a) == 0 along a, which consists of states, time and input pieces (x, t, p)."""

    def __init__(self, reduced: Reduced, scale: np.ndarray) -> None:
        self._scale = scale
        r, z = reduced.residuals, reduced.z
        a = ca.vertcat(reduced.x, reduced.t, reduced.p)
        along = ca.SX.sym("along", a.numel())
        jacobian = ca.densify(ca.jacobian(r, z))
        self._newton = ca.Function("newton", [z, a], [r, jacobian])
        self._tangent = ca.Function("tangent", [z, a, along], [ca.densify(ca.jtimes(r, a, along)), jacobian])

    def place(self, x: np.ndarray, time: float, p: np.ndarray) -> np.ndarray:
        return np.concatenate([x, [time], p])

    def apart(self, z: np.ndarray, other: np.ndarray) -> float:
        """Return the largest difference of two solutions, relative to the nominal or the value if larger."""
        return float(np.max(np.abs(z - other) / self._size(z), initial=0.0))

    def tangent(self, z: np.ndarray, a: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Return the change of z, to first order, for a change `along` of a; NaN if the equations are singular."""
        rate, jacobian = (np.asarray(v.full()) for v in self._tangent(z, a, along))
        return -solve_rows(jacobian[None], rate.T)[0]

    def correct(self, z: np.ndarray, a: np.ndarray) -> np.ndarray | None:
        """Return the solution close to z, to round-off; None if Newton's method does not contract."""
        last = REACH
        for n in range(CORRECTIONS):
            r, jacobian = (np.asarray(v.full()) for v in self._newton(z, a))
            step = solve_rows(jacobian[None], -r.T)[0]
            size = self.apart(z, z + step)
            if not size <= max(last * (CONTRACTION if n else 1.0), ROUND_OFF):
                return None
            z = z + step
            if size <= CONVERGED or (size <= ROUND_OFF and size > 0.5 * last):
                return z
            last = size
        return z if last <= ROUND_OFF else None

    def step(self, z: np.ndarray, a: np.ndarray) -> np.ndarray | None:
        """Return a Newton step from z, limited in length; None if the equations are singular."""
        r, jacobian = (np.asarray(v.full()) for v in self._newton(z, a))
        step = solve_rows(jacobian[None], -r.T)[0]
        if not np.all(np.isfinite(step)):
            return None
        return step * min(1.0, float(np.min(self._size(z) / np.maximum(np.abs(step), 1e-300))))

    def follow(self, z: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray | None:
        """Return the solution at `end` that continues z, the solution at `begin`; None if it cannot be followed."""
        done, step = 0.0, 1.0
        for _ in range(MOST_STEPS):
            part = min(1.0, done + step)
            here, there = (begin + s * (end - begin) for s in (done, part))
            ahead = self.tangent(z, here, there - here)
            near = bool(np.all(np.abs(ahead) <= REACH * self._size(z)))
            corrected = self.correct(z + ahead, there if part < 1.0 else end) if near else None
            if corrected is None:
                step /= 2
                if step < SHORTEST:
                    return None
                continue
            z, done, step = corrected, part, 2 * step
            if done >= 1.0:
                return z
        return None

    def _size(self, z: np.ndarray) -> np.ndarray:
        return np.maximum(self._scale, np.abs(z))


Pair = tuple[int, int]
Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")
# cache size for each kind of object, for the next simulations of a model
KEPT = 16


@dataclass(frozen=True, eq=False)
class BranchPlan:
    """A plan for one choice of states and the signs of its roots; `jacobian` (point, time, varied parameters) returns
    the derivatives whose signs select the roots at any point."""

    plan: CausalPlan
    jacobian: ca.Function
    signs: tuple[int, ...]


@dataclass(frozen=True)
class IntegratorSettings:
    """Integrator settings; `bounded`: no internal step is longer than an interval."""

    tolerance: float = 1e-9
    method: str = "bdf"
    bounded: bool = False


@dataclass(frozen=True, eq=False)
class SimulatedSystem:
    """A branch plan with the inputs and outputs of a simulation, ready for integration."""

    choice: Choice
    plan: CausalPlan
    reduced: Reduced
    stepper: Stepper
    tolerance: float

    @cached_property
    def continuation(self) -> NewtonContinuation | None:
        """Continuation of the Newton unknowns; None without any."""
        return NewtonContinuation(self.reduced, self.stepper.z_scale) if self.reduced.z.numel() else None

    @cached_property
    def roots(self) -> Roots:
        return Roots(self.reduced, self.tolerance)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        return tuple(self.name_of(s) for s in self.plan.states)

    def name_of(self, pair: Pair) -> str:
        """Return the declared name of a state, or its name as a derivative, "der(q)"."""
        return self._declared.get(pair) or self.plan.flat.symbol_name(*pair)

    @cached_property
    def _declared(self) -> dict[Pair, str]:
        return self.plan.alias.declared_names(self.plan.flat)


DEFAULT = IntegratorSettings()


class Systems:
    """Builds and caches the systems of simulations of a model that differ only in start values, input values and varied
    parameters.

    `plan` has their common structure and sample points; `selection` chooses the states; `inputs` has the symbols of
    their functions, and the numbers of the first simulation. Parameters are numbers, except the varied ones, which stay
    symbols; `flat` is the model with the values of one run.
    """

    def __init__(
        self, flat: FlatModel, inputs: SimulationInputs, outputs: list[ca.SX], prefer: Sequence[int] = ()
    ) -> None:
        self.flat, self.inputs, self._outputs = flat, inputs, outputs
        places = sorted(inputs.parameters)
        self._fold = ca.SX(ca.DM(flat.require_values()))
        for n in places:
            self._fold[n] = flat.parameters[n].symbol
        self._varied = ca.SX(ca.vertcat(*[flat.parameters[n].symbol for n in places]))
        self._numbers = flat.p0[places]
        expressions = [*outputs, *(e.expression for e in flat.energies), *(e.residual for e in flat.equations)]
        targets = {(v.index, 0) for v in flat.variables} | set(flat.scope.symbols_in(ca.vertcat(*expressions)))
        # plans depend neither on inputs nor on tolerances, so the model caches them for the next simulation
        key = ("simulation", get_ident(), tuple(inputs.known), tuple(places), tuple(sorted(targets)))
        if key not in flat.cache:
            flat.cache[key] = self._first_plan(sorted(targets)), {}
        self.plan: CausalPlan
        self._branches: dict[Choice, list[BranchPlan]]
        self.plan, self._branches = flat.cache[key]
        preferred = frozenset(self.plan.alias.resolve(i, 0)[1] for i in prefer)
        self.selection = StateSelection(self.plan, preferred, self._varied, self._numbers)
        self._reduced: dict[BranchPlan, Reduced] = {}
        self._systems: dict[tuple[BranchPlan, IntegratorSettings], SimulatedSystem] = {}
        self._paces: dict[Hashable, Pace] = {}
        self.samples = self.plan.samples  # consistent points for the numbers of one run

    @staticmethod
    def kept(
        flat: FlatModel, inputs: SimulationInputs, outputs: Recorded, prefer: Sequence[int], now: FlatModel
    ) -> Systems:
        """Return the cached systems of this model for inputs of this structure, else new ones. `now`: the model with
        the values of this run.

        Each thread has its own cache, because concurrent calls of a CasADi integrator corrupt each other's memory."""
        cache: dict[Hashable, Systems] = flat.cache.setdefault(("simulated", get_ident()), {})

        def cached(difference: Hashable) -> Systems:
            key = inputs.structure, outputs.key, tuple(prefer), difference
            systems = cache.pop(key, None) or Systems(now if difference else flat, inputs, outputs.expressions, prefer)
            return put_last(cache, key, systems)

        difference = _difference(flat, now, sorted(inputs.parameters))
        systems = cached(difference)
        if not inputs.parameters:
            return systems
        signs, samples = systems._starts(now)
        if signs != systems._signs:
            systems = cached((difference, signs))
        return systems.with_numbers(now, samples)

    def with_numbers(self, now: FlatModel, samples: np.ndarray | None) -> Systems:
        """Return a copy with the parameter values of a run; it shares all caches."""
        _ = self.original_equations, self._reads_time  # evaluated before the copy, so that all copies share them
        run = copy(self)
        run.flat, run._numbers = now, now.p0[sorted(self.inputs.parameters)]
        run.selection = self.selection.with_numbers(run._numbers)
        run.samples = self.plan.samples if samples is None else samples
        return run

    @property
    def _signs(self) -> tuple[int, ...]:
        """Signs of the plan's roots."""
        return tuple(r.value for b in self.plan.blocks for r in b.roots)

    def _starts(self, now: FlatModel) -> tuple[Hashable, np.ndarray | None]:
        """Return the signs of the roots with the values of a run, and consistent points, None for those of the plan.
        Without consistent points the values themselves replace the signs."""
        same = np.array_equal(now.p0, self.flat.p0)
        if same or not (self._start_depends or [v.start for v in now.variables] != self._own_starts):
            return self._signs, None
        try:
            return starts_with(self.plan, now)
        except ModelError:
            return now.p0.tobytes(), None

    @cached_property
    def _own_starts(self) -> list[float | None]:
        return [v.start for v in self.flat.variables]

    @cached_property
    def _start_depends(self) -> bool:
        """Whether varied parameters affect the choice among several consistent starts: they occur in the sampler stages
        up to the last one with symbols of roots or Newton blocks."""
        plan, scope = self.plan, self.flat.scope
        sides = [r.slope for b in plan.blocks for r in b.roots]
        chosen = scope.symbols_in(ca.vertcat(*sides, *(s for b in plan.newton for s in b.unknowns)))
        if not chosen:
            return False
        inside = [set(scope.symbols_in(stage)) for stage in plan.sampler.stages]
        last = max(next((n for n, symbols in enumerate(inside) if pair in symbols), 0) for pair in chosen)
        return bool(ca.depends_on(ca.vertcat(*plan.sampler.stages[: last + 1], *sides), self._varied))

    @cached_property
    def original_equations(self) -> OriginalEquations:
        return OriginalEquations(self.plan, self._fold, sorted(self.inputs.parameters))

    @property
    def parameters(self) -> np.ndarray:
        """Values of all parameters in this run."""
        return self.flat.require_values()

    def at(self, w: np.ndarray, time: float, settings: IntegratorSettings = DEFAULT) -> SimulatedSystem | None:
        """Return the system for the states and branches of a consistent point; None if no choice of states is valid."""
        choice = self.selection.choose(w, time)
        if choice is None:
            return None
        branches = self._branches.setdefault(choice, [])
        branch = next((b for b in branches if _signs(b.jacobian, w, time, self._numbers) == b.signs), None)
        if branch is None:
            branch = self._branch(self.selection.states(choice), w, time)
            branches.append(branch)
        system = self._systems.pop((branch, settings), None) or self._system(branch, settings)
        return put_last(self._systems, (branch, settings), system)

    def _system(self, branch: BranchPlan, settings: IntegratorSettings) -> SimulatedSystem:
        reduced = self._reduced.pop(branch, None) or Reduced(branch.plan, self.inputs, self._outputs)
        put_last(self._reduced, branch, reduced)
        stepper = Stepper(reduced, settings.tolerance, settings.method, settings.bounded)
        return SimulatedSystem(choice_of(branch.plan.stages), branch.plan, reduced, stepper, settings.tolerance)

    def pace(
        self,
        inputs: SimulationInputs,
        start: float,
        end: float,
        watched: ca.SX | None = None,
        varies: Sequence[int] = (),
    ) -> Pace:
        """Return how fast functions of time change between two times, with the values of `inputs`.

        watched: further expressions that the simulation monitors. varies: places of parameters that change during the
        run, so that expressions with them are not functions of time alone.
        """
        uses_time = bool(self.inputs.functions) or self._reads_time
        uses_time = uses_time or (watched is not None and bool(ca.depends_on(watched, self.flat.scope.time)))
        numbers = (*sorted(inputs.constants.items()), *sorted(inputs.parameters.items()))
        key = numbers if uses_time else (), start, end, watched is None
        pace = self._paces.pop(key, None)
        if pace is None:
            written = self._written if watched is None else ca.vertcat(self._written, watched)
            driven = self._driven(inputs, written, varies) if uses_time else ca.SX(0, 1)
            pace = pace_of(driven, self.inputs.t, start, end)
        return put_last(self._paces, key, pace)

    @cached_property
    def _written(self) -> ca.SX:
        """The model's equations and energies as written."""
        flat = self.flat
        return ca.vertcat(*[e.residual for e in flat.equations], *[e.expression for e in flat.energies])

    @cached_property
    def _reads_time(self) -> bool:
        """Whether equations or energies contain the time."""
        return bool(ca.depends_on(self._written, self.flat.scope.time))

    def _driven(self, inputs: SimulationInputs, written: ca.SX, varies: Sequence[int]) -> ca.SX:
        """Return the input functions and the written expressions with known inputs substituted."""
        flat, symbols = self.flat, self.inputs
        pairs = flat.scope.symbols_in(written)
        functions = [pair for pair in pairs if pair[0] in symbols.functions]
        constant = [pair for pair in pairs if pair[0] in symbols.constants]
        parameters = ca.SX(ca.DM(self.parameters))
        for place in varies:
            parameters[place] = flat.parameters[place].symbol
        old = [flat.scope.time, flat.p, *(flat.scope.symbol(*pair) for pair in [*functions, *constant])]
        new = [symbols.t, parameters, *(symbols.expression(*pair) for pair in functions)]
        new += [ca.SX(inputs.constants[i] if order == 0 else 0.0) for i, order in constant]
        written = ca.substitute(written, ca.vertcat(*old), ca.vertcat(*new))
        return ca.vertcat(*symbols.functions.values(), written)

    def _branch(self, states: list[int], w: np.ndarray, time: float) -> BranchPlan:
        plan = self._plan(self.plan.pairs, states, rates=True, at=(w, time))
        assert plan.pairs == self.plan.pairs
        roots = [r for b in plan.blocks for r in b.roots]
        column = ca.vertcat(*[r.slope for r in roots]) if roots else ca.SX(0, 1)
        folded = ca.substitute(column, self.flat.p, self._fold) if self.flat.parameters else column
        jacobian = ca.Function("derivatives", [plan.sampler.w, self.flat.scope.time, self._varied], [folded])
        return BranchPlan(plan, jacobian, tuple(root.value for root in roots))

    def _first_plan(self, targets: list[Pair]) -> CausalPlan:
        known = set(self.inputs.known)
        missing = [v.name for v in self.flat.variables if v.role == "input" and v.index not in known]
        try:
            return self._plan(targets)
        except ModelError as error:
            if missing and " unknown" in str(error) and "equation" in str(error):
                raise ModelError(f"{error}; inputs without a value: {', '.join(missing)}") from None
            # a root of undetermined sign is accepted, because the start decides; other errors recur without targets
            plan = self._plan([])
            if not {plan.alias.resolve(*t)[1:] for t in targets} <= set(plan.pairs):
                raise
            return plan

    def _plan(
        self,
        targets: list[Pair],
        prefer: Sequence[int] = (),
        rates: bool = False,
        at: tuple[np.ndarray, float] | None = None,
    ) -> CausalPlan:
        return make_plan(self.flat, self.inputs.known, targets, prefer, rates=rates, fold=self._fold, at=at)


def _signs(jacobian: ca.Function, w: np.ndarray, time: float, numbers: np.ndarray) -> tuple[int, ...]:
    return tuple(1 if s >= 0 else -1 for s in np.asarray(jacobian(w, time, numbers).full()).reshape(-1))


def _difference(flat: FlatModel, now: FlatModel, places: list[int]) -> Hashable:
    """Return the differences between the model with the values of a run and the declared model that need other systems:
    signs of parameters, which affect the side of a root at the start, and nominals, which scale the integrator."""
    signs = np.sign(now.p0[places])
    nominals = tuple(v.nominal for v in now.variables)
    if np.array_equal(signs, np.sign(flat.p0[places])) and nominals == tuple(v.nominal for v in flat.variables):
        return ()
    return tuple(signs.tolist()), nominals


def put_last(cache: dict[Key, Value], key: Key, value: Value) -> Value:
    """Put a value last in a cache, drop the oldest entry if it is full, and return the value."""
    cache[key] = value
    if len(cache) > KEPT:
        cache.pop(next(iter(cache)))
    return value
