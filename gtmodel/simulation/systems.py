"""Reduced systems by choice of states and branch signs: a choice that was made before costs nothing."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import casadi as ca
import numpy as np

from ..compiler.analysis.pace import Pace, pace_of
from ..compiler.flat import FlatModel
from ..compiler.plan import CausalPlan, make_plan
from ..lang.source import ModelError
from .audit import OriginalEquations
from .choice import Choice, StateSelection, choice_of
from .continuation import NewtonContinuation
from .inputs import SimulationInputs
from .record import Recorded
from .reduced import Reduced
from .roots import Roots
from .step import Stepper

Pair = tuple[int, int]
Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")
# of each kind, for the next simulation of a model
KEPT = 16


@dataclass(frozen=True, eq=False)
class BranchPlan:
    """A plan for one choice of states, with the signs of its roots; `derivatives` have these signs at any point."""

    plan: CausalPlan
    jacobian: ca.Function
    signs: tuple[int, ...]


@dataclass(frozen=True)
class IntegratorSettings:
    """How a system is integrated; `bounded`: no internal step is longer than an interval."""

    tolerance: float = 1e-9
    method: str = "bdf"
    bounded: bool = False


@dataclass(frozen=True, eq=False)
class SimulatedSystem:
    """A branch with the inputs and outputs of a simulation, ready to be integrated."""

    choice: Choice
    plan: CausalPlan
    reduced: Reduced
    stepper: Stepper
    tolerance: float

    @cached_property
    def continuation(self) -> NewtonContinuation | None:
        """Of the Newton unknowns; None where there are none."""
        return NewtonContinuation(self.reduced, self.stepper.z_scale) if self.reduced.z.numel() else None

    @cached_property
    def roots(self) -> Roots:
        return Roots(self.reduced, self.tolerance)

    @property
    def states(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(self.name_of(s) for s in self.plan.states)

    def name_of(self, pair: Pair) -> str:
        """Of a state: the one that the model declares, or as a derivative, "der(q)"."""
        return self._declared.get(pair) or self.plan.flat.symbol_name(*pair)

    @cached_property
    def _declared(self) -> dict[Pair, str]:
        return self.plan.alias.declared_names(self.plan.flat)


DEFAULT = IntegratorSettings()


class Systems:
    """Makes and keeps the systems of simulations of a model that differ in starts and numbers of their inputs only.

    `plan` has the structure that all of them share, and samples to start from; `selection` chooses the states;
    `inputs` has the symbols that their functions read, and the numbers of the simulation they were made for.
    """

    def __init__(
        self, flat: FlatModel, inputs: SimulationInputs, outputs: list[ca.SX], prefer: Sequence[int] = ()
    ) -> None:
        self._flat, self.inputs, self._outputs = flat, inputs, outputs
        self._fold = ca.SX(ca.DM(flat.require_values()))
        expressions = [*outputs, *(e.expression for e in flat.energies), *(e.residual for e in flat.equations)]
        targets = {(v.index, 0) for v in flat.variables} | set(flat.scope.symbols_in(ca.vertcat(*expressions)))
        # plans know neither inputs nor tolerances: the model keeps them for the next simulation
        key = ("simulation", tuple(inputs.known), tuple(sorted(targets)))
        if key not in flat.cache:
            flat.cache[key] = self._first_plan(sorted(targets)), {}
        self.plan: CausalPlan
        self._branches: dict[Choice, list[BranchPlan]]
        self.plan, self._branches = flat.cache[key]
        self.selection = StateSelection(self.plan, frozenset(self.plan.alias.resolve(i, 0)[1] for i in prefer))
        self._reduced: dict[BranchPlan, Reduced] = {}
        self._made: dict[tuple[BranchPlan, IntegratorSettings], SimulatedSystem] = {}
        self._paces: dict[Hashable, Pace] = {}

    @staticmethod
    def kept(flat: FlatModel, inputs: SimulationInputs, outputs: Recorded, prefer: Sequence[int]) -> Systems:
        """Those of the last simulations of this model with inputs of this structure, else new ones."""
        known: dict[Hashable, Systems] = flat.cache.setdefault("simulated", {})
        key = inputs.structure, outputs.names, tuple(prefer)
        systems = known.pop(key, None) or Systems(flat, inputs, outputs.expressions, prefer)
        return put_last(known, key, systems)

    @cached_property
    def original_equations(self) -> OriginalEquations:
        return OriginalEquations(self.plan)

    def at(self, w: np.ndarray, time: float, settings: IntegratorSettings = DEFAULT) -> SimulatedSystem | None:
        """The system whose states and branches suit a consistent point; None where no choice of states would do."""
        choice = self.selection.choose(w, time)
        if choice is None:
            return None
        known = self._branches.setdefault(choice, [])
        branch = next((b for b in known if _signs(b.jacobian, w, time) == b.signs), None)
        if branch is None:
            branch = self._branch(self.selection.states(choice), w, time)
            known.append(branch)
        made = self._made.pop((branch, settings), None) or self._system(branch, settings)
        return put_last(self._made, (branch, settings), made)

    def _system(self, branch: BranchPlan, settings: IntegratorSettings) -> SimulatedSystem:
        reduced = self._reduced.pop(branch, None) or Reduced(branch.plan, self.inputs, self._outputs)
        put_last(self._reduced, branch, reduced)
        stepper = Stepper(reduced, settings.tolerance, settings.method, settings.bounded)
        return SimulatedSystem(choice_of(branch.plan.stages), branch.plan, reduced, stepper, settings.tolerance)

    def pace(self, inputs: SimulationInputs, start: float, end: float) -> Pace:
        """How fast functions of time change between two times: inputs that have the numbers of a simulation."""
        key = tuple(sorted(inputs.constants.items())) if self._uses_time else (), start, end
        pace = self._paces.pop(key, None) or pace_of(self._driven(inputs), self.inputs.t, start, end)
        return put_last(self._paces, key, pace)

    @cached_property
    def _written(self) -> ca.SX:
        """The model's equations and energies as a person wrote them."""
        flat = self._flat
        return ca.vertcat(*[e.residual for e in flat.equations], *[e.expression for e in flat.energies])

    @cached_property
    def _uses_time(self) -> bool:
        return bool(self.inputs.functions) or bool(ca.depends_on(self._written, self._flat.scope.time))

    def _driven(self, inputs: SimulationInputs) -> ca.SX:
        """What functions of time act on: the inputs themselves, and the model's equations."""
        flat, symbols = self._flat, self.inputs
        if not self._uses_time:
            return ca.SX(0, 1)
        pairs = flat.scope.symbols_in(self._written)
        given = [pair for pair in pairs if pair[0] in symbols.functions]
        constant = [pair for pair in pairs if pair[0] in symbols.constants]
        old = [flat.scope.time, flat.p, *(flat.scope.symbol(*pair) for pair in [*given, *constant])]
        new = [symbols.t, self._fold, *(symbols.expression(*pair) for pair in given)]
        new += [ca.SX(inputs.constants[i] if order == 0 else 0.0) for i, order in constant]
        written = ca.substitute(self._written, ca.vertcat(*old), ca.vertcat(*new))
        return ca.vertcat(*symbols.functions.values(), written)

    def _branch(self, states: list[int], w: np.ndarray, time: float) -> BranchPlan:
        plan = self._plan(self.plan.pairs, states, rates=True, at=(w, time))
        assert plan.pairs == self.plan.pairs
        roots = [r for b in plan.blocks for r in b.roots]
        column = ca.vertcat(*[r.slope for r in roots]) if roots else ca.SX(0, 1)
        folded = ca.substitute(column, self._flat.p, self._fold) if self._flat.parameters else column
        jacobian = ca.Function("derivatives", [plan.sampler.w, self._flat.scope.time], [folded])
        return BranchPlan(plan, jacobian, tuple(root.value for root in roots))

    def _first_plan(self, targets: list[Pair]) -> CausalPlan:
        given = set(self.inputs.known)
        left = [v.name for v in self._flat.variables if v.role == "input" and v.index not in given]
        try:
            return self._plan(targets)
        except ModelError as error:
            if left and " unknown" in str(error) and "equation" in str(error):
                raise ModelError(f"{error}; inputs without a value: {', '.join(left)}") from None
            # a root that nothing settles is no obstacle here: the start will. All else is wrong without targets too
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
        return make_plan(self._flat, self.inputs.known, targets, prefer, rates=rates, fold=self._fold, at=at)


def _signs(jacobian: ca.Function, w: np.ndarray, time: float) -> tuple[int, ...]:
    return tuple(1 if s >= 0 else -1 for s in np.asarray(jacobian(w, time).full()).reshape(-1))


def put_last(kept: dict[Key, Value], key: Key, value: Value) -> Value:
    """The value, now the last of those that are kept; the oldest goes."""
    kept[key] = value
    if len(kept) > KEPT:
        kept.pop(next(iter(kept)))
    return value
