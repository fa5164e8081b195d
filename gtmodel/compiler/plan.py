"""Plan of a causality: turns a flat model, known variables and targets into an ordered list of solved blocks."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..lang.source import ModelError
from .alias import AliasResult, eliminate
from .analysis.angular_rates import by_angular_rates
from .analysis.body_axes import BodyAxes, in_body_axes
from .blocks import Margin, NewtonBlock, SignAnalysis, SolvedBlock, median
from .branch import RootSigns, check_branches, follow, open_loops, settle, sides
from .closed_form.known_chain import CLOSED, KnownChain, known_chain
from .consistency.home import Moved, home_of, moved, starts_of
from .consistency.points import Sampler
from .degrees_of_freedom import counting_freedom
from .flat import FlatEquation, FlatModel
from .graph import largest_matching, strong_components
from .known_poses import KnownPose, known_pose
from .relevance import KnownCondition, condition_block, conditions_on, needed, set_apart
from .solving import solve_block
from .states import Stage, choose
from .structure import (
    EquationStructure,
    analyse,
    differentiate,
    folded as folded_into,
    pairs_of,
    stage_residuals,
    system_of,
)

SAMPLE_POINTS = 5  # rank decisions need three; two more show whether a root's sign depends on the pose

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class CausalPlan(Portable):
    """The plan of a causality: `inputs` are the chain symbols that it reads, `blocks` compute the unknowns.

    `samples` are consistent points (rows) over the chain symbols `pairs`. `parameters` are the numbers or symbols of
    the parameters in the blocks. `conditions` are equations among the elements of one known variable; `on_known` are
    these and their derivatives up to the order of the inputs. `undetermined` variables have too few equations, but no
    target needs them. `moved` are start values that do not satisfy the equations. `sides` are margins that check the
    branch of Newton's solutions, and the constraints that were dropped. `chain`: the chain of joints whose pose is
    known; `singular`: the start values of its joints are singular for Newton's method. `numbers`: for a plan with
    symbolic parameters, the plan with numeric ones, which determines how large inputs may be.
    """

    flat: FlatModel
    alias: AliasResult
    structure: EquationStructure
    stages: list[Stage]
    known: list[int]
    states: list[Pair]
    inputs: list[Pair]
    blocks: list[SolvedBlock]
    pairs: list[Pair]
    samples: np.ndarray
    uses_time: bool
    parameters: ca.SX
    sampler: Sampler
    system: ca.SX
    conditions: list[FlatEquation] = field(default_factory=list)
    on_known: list[KnownCondition] = field(default_factory=list)
    undetermined: list[int] = field(default_factory=list)
    moved: list[Moved] = field(default_factory=list)
    sides: list[Margin] = field(default_factory=list)
    numbers: CausalPlan | None = None
    chain: KnownChain | None = None
    singular: bool = False

    @property
    def newton(self) -> list[NewtonBlock]:
        """Blocks without a closed form, in order; later blocks use their unknowns as inputs."""
        return [b.newton for b in self.blocks if b.newton is not None]

    @property
    def margins(self) -> list[Margin]:
        """The margins that decide the status: those of the blocks in order, then the sides of Newton's solutions."""
        return [m for b in self.blocks for m in b.margins] + self.sides

    @property
    def has_branches(self) -> bool:
        """Whether there are branches to select, of the model or of roots in closed form."""
        return bool(self.flat.branches) or any(r.name for b in self.blocks for r in b.roots)

    def symbol(self, index: int, order: int) -> ca.SX:
        """Return the derivative of an original variable as an expression of kept symbols."""
        sign, kept, k = self.alias.resolve(index, order)
        s = self.flat.scope.symbol(kept, k)
        return s if sign > 0 else -s


def make_plan(
    flat: FlatModel,
    known: Sequence[int],
    targets: Sequence[Pair],
    prefer: Sequence[int] = (),
    branches: Mapping[str, int] | None = None,
    rates: bool = False,
    fold: ca.SX | None = None,
    at: tuple[np.ndarray, float] | None = None,
    apart: Collection[int] = (),
    chains: bool = True,
) -> CausalPlan:
    """Make the plan of one causality.

    Args:
        known: indices of scalar variables that are known with all their derivatives.
        targets: (index, order) pairs to compute.
        prefer: indices of scalar variables preferred as states.
        branches: sign +1 or -1 by branch name; the default is +1.
        rates: compute the derivative of every state too.
        fold: numbers (or symbols) that replace the parameters before any algebra: zeros vanish and numbers become
            pivots. The structure and the inputs do not depend on it.
        at: one consistent point over the plan's `pairs`, and its time; states and branches are chosen there,
            regardless of declarations. The simulation uses it to switch states during a run.
        apart: indices of variables that are left out together with their equations.
        chains: solve chains of joints whose pose is known in closed form if that is possible.

    Raises ModelError for a system that is not square, redundant, singular or without a consistent point.
    """
    numbers = () if fold is None else tuple(ca.DM(fold).full().ravel().tolist()) if fold.is_constant() else None
    key = "unsettled", *map(tuple, (known, targets, prefer)), rates, numbers, tuple(sorted(apart)), chains
    plan = flat.cache.get(key) if at is None and numbers is not None else None
    if plan is None:
        plan = _unsettled(flat, known, targets, prefer, rates, fold, at, apart, chains)
        if at is None and numbers is not None and plan.has_branches:
            flat.cache[key] = plan  # other branches of the same causality begin with it
    check_branches(plan.flat, plan.blocks, branches or {})
    if at is None:
        plan = settle(plan, plan.sampler, branches or {})
        plan = replace(plan, sides=[*sides(plan, plan.sampler), *open_loops(plan)])
    else:
        plan = follow(plan, plan.sampler)
    return _with_sizes(plan, plan.sampler)


def _unsettled(
    flat: FlatModel, known: Sequence[int], targets: Sequence[Pair], prefer: Sequence[int], rates: bool,
    fold: ca.SX | None, at: tuple[np.ndarray, float] | None, apart: Collection[int], chains: bool,
) -> CausalPlan:  # fmt: skip
    """Make the plan but for what depends on the branches: signs of roots, home pose, samples, sides, sizes."""
    if flat.events is not None and flat.events.modes:
        raise ModelError(
            f"{flat.title} has equations that switch with gt.If, which only simulate() supports; here write one of the "
            "sides, or a smooth function",
            flat.events.modes[0].where,
        )
    with counting_freedom(flat, known):
        posed = _posed(flat, known, targets, prefer, apart)
    flat = posed.flat
    model = flat.source or flat
    sampler, samples, changed = _located(posed, at)
    folded = posed.derivatives if fold is None else folded_into(flat, posed.derivatives, fold)
    system = system_of(flat, posed.structure, folded)
    jacobians = _jacobians(posed, sampler, samples)
    with counting_freedom(flat, known):
        stages = choose(
            flat,
            posed.structure,
            jacobians,
            frozenset(posed.alias.resolve(i, 0)[1] for i in prefer),
            set(zip(*system.sparsity().get_triplet(), strict=True)),  # entries that are not identically zero
        )
    stages, turns = by_angular_rates(flat, posed.alias, posed.structure, stages, system, sampler, samples)
    if turns:
        posed = replace(posed, derivatives=_replaced(posed.derivatives, turns))
        folded = posed.derivatives if fold is None else _replaced(folded, turns)
    order = _ordered(posed, stages, folded, rates)
    pose = posed.pose is not None

    def solved(order: _Order, axes: BodyAxes | None = None) -> list[SolvedBlock]:
        turns = not order.states and at is None  # a simulated angle may make further turns
        of, states = order.unknown_of, set(order.states)
        residuals, points, own = (folded, samples, None) if axes is None else (
            _replaced(folded, axes.residuals), axes.samples, axes.own
        )  # fmt: skip
        signs = SignAnalysis(flat, sampler, points)
        return [
            solve_block(flat, posed.structure, residuals, c, of, signs, order.uses(flat, c), pose, turns, states, own)
            for c in order.components
        ]

    blocks = None
    if fold is not None and fold.is_constant() and at is None and not pose:
        needed = [n for c in order.components for n in c]
        axes = in_body_axes(
            flat, posed.alias, posed.structure, posed.derivatives, order.unknown_of, needed, turns, sampler, samples
        )
        if axes is not None:
            values = folded_into(flat, [list(axes.residuals.values())], fold)[0]
            axes = replace(axes, residuals=dict(zip(axes.residuals, values, strict=True)))
            inner = order.read(flat, _replaced(folded, axes.residuals), axes)
            turned = [] if inner is None else solved(inner, axes)
            if inner is not None and axes.suit(inner.components, turned):
                blocks = axes.in_world(turned, order.wanted)
    if blocks is None:
        blocks = solved(order)
    chain = None
    if chains and any(b.newton for b in blocks) and at is None:

        def forward(joints: Sequence[int], wanted: Sequence[Pair]) -> CausalPlan:
            return make_plan(model, joints, wanted, fold=fold, chains=False)

        chain = known_chain(model, posed.alias, known, forward, fold)
        block = None if chain is None else chain.solved
        shorter = None if chain is None or block is None else order.without(posed, chain, folded)
        if block is not None and shorter is not None:
            order = shorter
            blocks = [block, *solved(order)]
    closed = bool(blocks) and blocks[0].kind == CLOSED
    read, on_known = _read(posed, order, fold, sampler, samples, chain if closed else None)
    if on_known:
        blocks.insert(0, condition_block(on_known, posed.pose.reflections() if posed.pose else ()))
    if posed.pose is not None and not closed:
        blocks += posed.pose.condition_blocks(posed.alias, any(b.newton for b in blocks))
    newton = [b.newton for b in blocks if b.newton is not None]
    if chain is not None and not closed and not chain.is_solved_by(newton):
        chain = None
    regular: dict[Pair, float] = {}
    if chain is not None and not closed:
        blocks.append(chain.newton_margins())
        regular = chain.regular_starts(sampler, samples)
    if regular:
        sampler = replace(sampler, starts={**sampler.starts, **regular})
        samples = sampler.points(SAMPLE_POINTS)
    computed = [folded[i][m] for c in order.components for i, m in c] + [c.residual for c in on_known]
    return CausalPlan(
        flat=flat, alias=posed.alias, structure=posed.structure, stages=stages, known=list(known),
        states=order.states, inputs=sorted(read), blocks=blocks, pairs=posed.pairs, samples=samples,
        uses_time=_holds_time(flat, computed), parameters=flat.p if fold is None else fold, sampler=sampler,
        system=system, conditions=posed.conditions, on_known=on_known, undetermined=posed.undetermined, moved=changed,
        chain=chain, singular=bool(regular),
    )  # fmt: skip


def _replaced(derivatives: list[list[ca.SX]], by: Mapping[Pair, ca.SX]) -> list[list[ca.SX]]:
    return [[by.get((i, m), e) for m, e in enumerate(chain)] for i, chain in enumerate(derivatives)]


@dataclass(frozen=True, eq=False)
class _Posed:
    """The equations that a causality needs, with their derivatives and symbols."""

    flat: FlatModel
    alias: AliasResult
    known: frozenset[int]
    wanted: list[Pair]
    structure: EquationStructure
    unknowns: list[int]
    derivatives: list[list[ca.SX]]
    pairs: list[Pair]
    conditions: list[FlatEquation]
    undetermined: list[int]
    pose: KnownPose | None


def _posed(
    flat: FlatModel, known: Sequence[int], targets: Sequence[Pair], prefer: Sequence[int], apart: Collection[int]
) -> _Posed:
    pose = known_pose(flat, known)
    flat = flat if pose is None else pose.flat
    alias = eliminate(flat, frozenset([*known, *prefer]), frozenset(apart))
    excluded = {*known, *apart}
    unknowns = [v.index for v in flat.variables if v.index not in alias.removed and v.index not in excluded]
    wanted = [alias.resolve(*t)[1:] for t in [*targets, *(pose.read if pose else [])]]
    equations, conditions = set_apart(flat, alias.equations, set(known))
    equations, unknowns, undetermined = needed(flat, equations, unknowns, {i for i, _ in wanted})
    structure = analyse(flat, equations, unknowns, {i for i, _ in wanted})
    column = {j: n for n, j in enumerate(unknowns)}
    deficit = max([order - int(structure.d[column[i]]) for i, order in wanted if i in column], default=0)
    structure = structure.raised(max(0, deficit))
    derivatives = differentiate(flat, structure)
    pairs = pairs_of(flat, derivatives, structure, conditions, wanted)
    return _Posed(
        flat, alias, frozenset(known), wanted, structure, unknowns, derivatives, pairs, conditions, undetermined, pose
    )


def _located(posed: _Posed, at: tuple[np.ndarray, float] | None) -> tuple[Sampler, np.ndarray, list[Moved]]:
    """Return the sampler, consistent points (or the point `at`), and the start values that were moved."""
    flat = posed.flat
    given, pose = posed.known, posed.pose
    without = () if pose is None else pose.replaced
    residuals = stage_residuals(flat, posed.structure, posed.derivatives, posed.conditions, posed.pairs, without)
    if pose is not None:
        residuals = pose.at_points(posed.alias, residuals, posed.pairs)
        given -= pose.known  # it follows the joints
    sampler = Sampler(flat, posed.pairs, residuals, starts_of(flat, posed.alias), given)
    if at is None:
        return _points(sampler, posed.alias)
    sampler.time = at[1]
    return sampler, at[0][None, :], []


@dataclass(frozen=True, eq=False)
class _Order:
    """Which equation is solved for which unknown, and in which order. Nodes are (equation, derivative)."""

    states: list[Pair]
    wanted: list[Pair]
    solver: dict[Pair, Pair]
    unknown_of: dict[Pair, Pair]
    roots: list[Pair]
    used: dict[Pair, list[Pair]]
    components: list[list[Pair]]

    def uses(self, flat: FlatModel, nodes: list[Pair]) -> tuple[tuple[str, ...], ...]:
        """Return the names of all symbols in each equation."""
        return tuple(tuple(flat.symbol_name(*p) for p in (*self.used[n], self.unknown_of[n])) for n in sorted(nodes))

    def without(self, posed: _Posed, chain: KnownChain, folded: list[list[ca.SX]]) -> _Order | None:
        """Return the order in which the joints of a chain are known; None if the others do not follow from them.

        As many equations are left out as there are joints, and rather those with known values of the pose.
        """
        columns = [p for p in self.solver if p not in set(chain.symbols)]
        place, read = {p: k for k, p in enumerate(columns)}, set(chain.read)
        inside = {n: (*self.used[n], p) for n, p in self.unknown_of.items()}
        kept = [n for n, pairs in inside.items() if read.isdisjoint(pairs)]
        options = {n: [place[p] for p in pairs if p in place] for n, pairs in inside.items()}
        match = largest_matching([options[n] for n in kept], len(columns))
        for n in [n for n in inside if n not in set(kept)]:
            if -1 in match or len(match) == len(columns):
                break
            larger = largest_matching([options[m] for m in (*kept, n)], len(columns), [*match, -1])
            if -1 not in larger:
                kept, match = [*kept, n], larger
        if -1 in match or len(match) != len(columns):
            return None
        match = largest_matching([options[n] for n in kept], len(columns))  # whatever was tried before
        unknown_of = {n: columns[k] for n, k in zip(kept, match, strict=True)}
        solver = {p: n for n, p in unknown_of.items()}
        roots = [solver[p] for p in self.wanted if p in solver]
        used = _users(posed.flat, folded, unknown_of, solver)
        return _Order(self.states, self.wanted, solver, unknown_of, roots, used, _reached(roots, solver, used))

    def read(self, flat: FlatModel, residuals: list[list[ca.SX]], axes: BodyAxes) -> _Order | None:
        """Return the order for equations in the axes of bodies; None if that joins what is solved apart here.

        What one block solves here it solves there too: a core keeps the equations that make it symmetric.
        """
        nodes, columns = list(self.unknown_of), list(self.solver)
        place = {p: k for k, p in enumerate(columns)}
        inside = flat.scope.symbols_in_each([residuals[i][m] for i, m in nodes])
        options = [[place[p] for p in pairs if p in place] for pairs in inside]
        begin = [place[p] if place[p] in of else -1 for p, of in zip(self.unknown_of.values(), options, strict=True)]
        match = largest_matching(options, len(columns), begin)
        if -1 in match:
            return None
        unknown_of = {n: columns[k] for n, k in zip(nodes, match, strict=True)}
        solver = {p: n for n, p in unknown_of.items()}
        roots = [solver[p] for p in dict.fromkeys([*self.wanted, *axes.rotations(self.wanted)]) if p in solver]
        used = _users(flat, residuals, unknown_of, solver)
        needed = {n for c in _reached(roots, solver, used) for n in c}
        block_of = {self.unknown_of[n]: k for k, c in enumerate(self.components) for n in c}
        tied = {n: list(pairs) for n, pairs in used.items()}
        for c in self.components:
            ring = [n for n in (solver[self.unknown_of[n]] for n in c) if n in needed]
            for n, after in zip(ring, [*ring[1:], *ring[:1]], strict=True) if len(ring) > 1 else ():
                tied[n].append(unknown_of[after])
        components = _reached(roots, solver, tied)
        if any(len({block_of.get(unknown_of[n]) for n in c}) > 1 for c in components):
            return None
        given = {p for c in self.components for n in c for p in self.used[n] if p not in self.solver}
        if not given.issuperset(p for c in components for n in c for p in used[n] if p not in solver):
            return None
        return _Order(self.states, self.wanted, solver, unknown_of, roots, used, components)

    def reached(self, used: dict[Pair, list[Pair]]) -> list[list[Pair]]:
        """Return the blocks of nodes that the targets need, in order."""
        return _reached(self.roots, self.solver, used)


def _ordered(posed: _Posed, stages: list[Stage], folded: list[list[ca.SX]], rates: bool) -> _Order:
    structure, unknowns = posed.structure, posed.unknowns
    solver: dict[Pair, Pair] = {}
    states: list[Pair] = []
    for stage in stages:
        chosen = set(stage.matched.values())
        for i, j in stage.matched.items():
            solver[(unknowns[j], int(structure.d[j]) + stage.k)] = (i, int(structure.c[i]) + stage.k)
        states += [(unknowns[j], int(structure.d[j]) + stage.k) for j in stage.columns if j not in chosen]
    states = sorted(p for p in states if p not in solver)
    wanted = [*posed.wanted, *([(i, k + 1) for i, k in states] if rates else [])]
    unknown_of = {node: pair for pair, node in solver.items()}
    roots = [solver[p] for p in wanted if p in solver]
    used = _users(posed.flat, folded, unknown_of, solver)
    return _Order(states, wanted, solver, unknown_of, roots, used, _reached(roots, solver, used))


def _reached(roots: list[Pair], solver: dict[Pair, Pair], used: dict[Pair, list[Pair]]) -> list[list[Pair]]:
    return strong_components(roots, lambda node: [solver[p] for p in used[node] if p in solver])


def _read(
    posed: _Posed, order: _Order, fold: ca.SX | None, sampler: Sampler, samples: np.ndarray, closed: KnownChain | None
) -> tuple[set[Pair], list[KnownCondition]]:
    """Return the symbols that the unfolded equations read, and the conditions on them.

    Unfolded, so that a parameter that happens to be zero does not change the inputs.
    """
    flat, solver = posed.flat, order.solver
    used = order.used if fold is None else _users(flat, posed.derivatives, order.unknown_of, solver)
    read = {p for c in order.reached(used) for node in c for p in used[node] if p not in solver}
    read |= {p for p in order.wanted if p not in solver}
    if closed is not None:
        read = (read - set(closed.symbols)) | set(closed.read)
    on_known = conditions_on(flat, posed.conditions, read, sampler, samples)
    if on_known:
        read |= set().union(*[c.symbols for c in on_known])
        on_known = on_known if fold is None else [c.folded(flat.p, fold) for c in on_known]
    return read, on_known


def _holds_time(flat: FlatModel, expressions: list[ca.SX]) -> bool:
    clock = flat.scope.time.element_hash()
    return any(s.element_hash() == clock for s in ca.symvar(ca.vertcat(*expressions))) if expressions else False


def differentiated(plan: CausalPlan) -> list[tuple[str, ca.SX]]:
    """Return all equations of a point and their derivatives as (name with file and line, residual)."""
    return [
        (f"{e.label}{chr(39) * m} ({e.where})", residual)
        for e, chain in zip(plan.structure.equations, differentiate(plan.flat, plan.structure), strict=True)
        for m, residual in enumerate(chain)
    ]


def _points(sampler: Sampler, alias: AliasResult) -> tuple[Sampler, np.ndarray, list[Moved]]:
    """Return the sampler, consistent points of a causality, and the start values that were moved.

    If start values were moved, the points lie around the home pose that all causalities of the model share.
    """
    flat, declared = sampler.flat, dict(sampler.starts)
    try:
        samples = sampler.points(SAMPLE_POINTS)
        if not moved(flat, sampler, samples[0], declared):
            return sampler, samples, []
    except ModelError:
        if not home_of(flat):
            raise
    shared = replace(sampler, starts=starts_of(flat, alias, home_of(flat)))
    samples = shared.points(SAMPLE_POINTS)
    return shared, samples, moved(flat, shared, samples[0], declared)


def starts_with(plan: CausalPlan, now: FlatModel) -> tuple[tuple[int, ...], np.ndarray]:
    """Return the root signs and samples of a plan for other parameter values, those of the model `now`.

    The plan must hold the parameters that differ as symbols. Raises ModelError if `now` has no consistent point.
    """
    key = "root signs", plan
    if key not in plan.flat.cache:
        plan.flat.cache[key] = RootSigns(plan, plan.sampler)
    roots: RootSigns = plan.flat.cache[key]
    sampler = copy(plan.sampler)
    sampler.flat, sampler.starts, sampler.time = now, starts_of(now, plan.alias), 0.0
    sampler, samples, _ = _points(sampler, plan.alias)
    if not roots.count:
        return (), samples
    settled = roots.settled(sampler, samples, {})
    return tuple(r.value for r in settled), roots.samples(sampler, samples, settled)


def _users(
    flat: FlatModel, derivatives: list[list[ca.SX]], unknown_of: dict[Pair, Pair], solver: dict[Pair, Pair]
) -> dict[Pair, list[Pair]]:
    """Return the symbols that each node's equation uses, except the one it is solved for."""
    inside = flat.scope.symbols_in_each([derivatives[i][m] for i, m in unknown_of])
    return {node: [p for p in pairs if solver.get(p) != node] for node, pairs in zip(unknown_of, inside, strict=True)}


def _jacobians(posed: _Posed, sampler: Sampler, samples: np.ndarray) -> list[np.ndarray]:
    flat = posed.flat
    system = system_of(flat, posed.structure, posed.derivatives)
    f = ca.Function("system", [sampler.w, flat.p, flat.scope.time], [system])
    return [np.asarray(f(w, flat.p0, sampler.time).full()) for w in samples]


def _with_sizes(plan: CausalPlan, sampler: Sampler) -> CausalPlan:
    """Return the plan with typical sizes of the margins at the consistent points; pivots that are negative there change
    their sign, which saves an operation. Margins of the closed form of a chain are relative to its size already."""
    flat = plan.flat
    margins = [m for b in plan.blocks if b.kind != CLOSED for m in b.margins]
    if not margins:
        return plan
    sizes = ca.Function("sizes", [sampler.w, flat.p, flat.scope.time], [ca.vertcat(*[m.expression for m in margins])])
    values = np.array([np.asarray(sizes(w, flat.p0, sampler.time)).reshape(-1) for w in plan.samples])
    sized = {
        id(m): replace(
            m,
            expression=-m.expression if m.kind == "pivot" and row[0] < 0 else m.expression,
            scale=float(median(np.abs(row))) or 1.0,
        )
        for m, row in zip(margins, values.T, strict=True)
    }
    blocks = [replace(b, margins=[sized.get(id(m), m) for m in b.margins]) for b in plan.blocks]
    return replace(plan, blocks=blocks)
