"""From a flat model, what is known and what is asked to an ordered list of solved blocks."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from .alias import AliasResult, eliminate
from .blocks import Margin, SolvedBlock
from .branch import check_branches, follow, settle, sides
from .flat import FlatEquation, FlatModel
from .graph import strong_components
from .home import Moved, home_of, moved, starts_of
from .kinks import has_kinks, kinked_in
from .linear import solve_linear
from .newton import NewtonBlock
from .pivots import SignAnalysis
from .points import Sampler
from .quadric import NoClosedForm, eliminate_explicit, solve_nonlinear
from .relevance import Condition, condition_block, conditions_on, needed, set_apart
from .states import Stage, choose
from .structure import Structure, analyse

SAMPLE_POINTS = 5  # rank decisions want three; two more tell whether a root's sign depends on the pose

Pair = tuple[int, int]


@dataclass(eq=False)
class Plan:
    """A causality worked out: `inputs` are the chain symbols it reads, `blocks` what it computes.

    `samples` are consistent points (rows) over the chain symbols `pairs`. `parameters` are the numbers or
    symbols that stand for the parameters in the blocks. `conditions` are equations among the elements of one known
    variable, which its values must satisfy, `on_known` these with those of their derivatives that concern what is
    read; `undetermined` variables have too few equations, but no target needs them. `moved` are start values that gave
    way to the equations. `sides` are branches that tell where Newton's answers lie.
    """

    flat: FlatModel
    alias: AliasResult
    structure: Structure
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
    on_known: list[Condition] = field(default_factory=list)
    undetermined: list[int] = field(default_factory=list)
    moved: list[Moved] = field(default_factory=list)
    sides: list[Margin] = field(default_factory=list)

    @property
    def newton(self) -> list[NewtonBlock]:
        """Blocks without a closed form, in order; their unknowns are inputs of what comes after them."""
        return [b.newton for b in self.blocks if b.newton is not None]

    @property
    def margins(self) -> list[Margin]:
        """What decides the status of an answer: the margins of the blocks in order, then the sides of Newton's."""
        return [m for b in self.blocks for m in b.margins] + self.sides

    def symbol(self, index: int, order: int) -> ca.SX:
        """Expression of an original variable's derivative in kept symbols."""
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
) -> Plan:
    """Work out one causality.

    Args:
        known: scalar variable indices prescribed from outside, with all their derivatives.
        targets: (index, order) pairs to compute.
        prefer: scalar variable indices to keep as states.
        branches: sign +1 or -1 by branch name; the default is +1.
        rates: compute the derivative of every state too.
        fold: numbers (or symbols) to put in place of the parameters before any algebra: zeros vanish and
            numbers become pivots. The structure and the inputs do not depend on it.
        at: one consistent point over the plan's `pairs`, and its time; states and branches are chosen there,
            whatever is declared. The simulation uses it to switch states on the way.
        apart: variable indices that are left out, with the equations that hold them.

    Raises ModelError for a system that is not square, redundant, singular or without a consistent point.
    """
    check_branches(flat, branches or {})
    inside = flat
    if apart:
        left = [e for e in flat.equations if not any(i in apart for i, _ in flat.scope.symbols_in(e.residual))]
        inside = replace(flat, equations=left)
    alias = eliminate(inside, frozenset([*known, *prefer]))
    known_set = set(known)
    given = known_set | set(apart)
    unknowns = [v.index for v in flat.variables if v.index not in alias.removed and v.index not in given]
    wanted = [alias.resolve(*t)[1:] for t in targets]
    equations, conditions = set_apart(flat, alias.equations, known_set)
    equations, unknowns, undetermined = needed(flat, equations, unknowns, {i for i, _ in wanted})
    structure = analyse(flat, equations, unknowns)
    column = {j: n for n, j in enumerate(unknowns)}
    deficit = max([order - int(structure.d[column[i]]) for i, order in wanted if i in column], default=0)
    structure = structure.raised(max(0, deficit))
    derivatives = _differentiate(flat, structure)
    pairs = _pairs(flat, derivatives, structure, conditions, wanted)
    stage_residuals = [
        ca.vertcat(*[derivatives[i][structure.c[i] + k] for i in range(len(structure.c)) if structure.c[i] + k >= 0])
        for k in range(-int(structure.d.max(initial=0)), 1)
    ]
    stage_residuals = _with_conditions(flat, stage_residuals, conditions, pairs)
    sampler = Sampler(flat, pairs, [r for r in stage_residuals if r.numel()], starts_of(flat, alias), frozenset(known))
    changed: list[Moved] = []
    if at is None:
        sampler, samples, changed = _points(sampler, alias)
    else:
        samples, sampler.time = at[0][None, :], at[1]
    parameters = flat.p if fold is None else fold
    folded = derivatives if fold is None else _folded(flat, derivatives, fold)
    system = _system(flat, structure, folded)
    stages = choose(
        flat,
        structure,
        _jacobians(flat, structure, derivatives, sampler, samples),
        _kept(alias, prefer),
        set(zip(*system.sparsity().get_triplet(), strict=True)),  # entries that are not identically zero
    )
    solver: dict[Pair, Pair] = {}
    states: list[Pair] = []
    for stage in stages:
        chosen = set(stage.matched.values())
        for i, j in stage.matched.items():
            solver[(unknowns[j], int(structure.d[j]) + stage.k)] = (i, int(structure.c[i]) + stage.k)
        states += [(unknowns[j], int(structure.d[j]) + stage.k) for j in stage.columns if j not in chosen]
    states = sorted(p for p in states if p not in solver)
    if rates:
        wanted += [(i, k + 1) for i, k in states]
    unknown_of = {node: pair for pair, node in solver.items()}
    roots = [solver[p] for p in wanted if p in solver]
    used = _users(flat, folded, unknown_of, solver)
    components = strong_components(roots, lambda node: [solver[p] for p in used[node] if p in solver])
    analysis = SignAnalysis(flat, sampler, samples)
    blocks = [_solve(flat, structure, folded, c, unknown_of, analysis) for c in components]
    for block, c in zip(blocks, components, strict=True):
        block.uses = tuple(tuple(flat.symbol_name(*p) for p in (*used[n], unknown_of[n])) for n in sorted(c))
    # what is read is told by the equations as written: a parameter that happens to be zero changes no signature
    written = used if fold is None else _users(flat, derivatives, unknown_of, solver)
    reached = strong_components(roots, lambda node: [solver[p] for p in written[node] if p in solver])
    read = {p for c in reached for node in c for p in written[node] if p not in solver}
    read |= {p for p in wanted if p not in solver}
    on_known = conditions_on(flat, conditions, read, sampler, samples)
    if on_known:
        read |= set().union(*[c.symbols for c in on_known])
        on_known = on_known if fold is None else [c.folded(flat.p, fold) for c in on_known]
        blocks.insert(0, condition_block(on_known))
    time_key = flat.scope.time.element_hash()
    computed = [folded[i][m] for c in components for i, m in c] + [c.residual for c in on_known]
    uses_time = any(s.element_hash() == time_key for e in computed for s in ca.symvar(e))
    plan = Plan(
        flat, alias, structure, stages, list(known), states, sorted(read), blocks, pairs, samples, uses_time,
        parameters, sampler, system, conditions, on_known, undetermined,
        changed,
    )  # fmt: skip
    if at is None:
        settle(plan, sampler, branches or {})
        plan.sides = sides(plan, sampler)
    else:
        follow(plan, sampler)
    _size_margins(plan, sampler)
    return plan


def differentiated(plan: Plan) -> list[tuple[str, ca.SX]]:
    """All equations that hold at a point, with the derivatives that they imply: (name with file and line, residual)."""
    return [
        (f"{e.label}{chr(39) * m} ({e.where})", residual)
        for e, chain in zip(plan.structure.equations, _differentiate(plan.flat, plan.structure), strict=True)
        for m, residual in enumerate(chain)
    ]


def _kept(alias: AliasResult, prefer: Sequence[int]) -> frozenset[int]:
    return frozenset(alias.resolve(i, 0)[1] for i in prefer)


def _differentiate(flat: FlatModel, structure: Structure) -> list[list[ca.SX]]:
    """derivatives[i][m] = m-th time derivative of equation i, m = 0..c_i, all equations of one order at once."""
    result = [[e.residual] for e in structure.equations]
    for m in range(int(structure.c.max(initial=0))):
        rows = [i for i in range(len(result)) if structure.c[i] > m]
        rates = flat.scope.derivative(ca.vertcat(*[result[i][m] for i in rows]))
        for n, i in enumerate(rows):
            half = _half(rates[n], {})
            result[i].append(rates[n] if half is None else half)
    return result


def _half(e: ca.SX, known: dict[int, ca.SX | None], depth: int = 50) -> ca.SX | None:
    """e/2 where every term has a factor two, as the derivatives of squares have; None otherwise.

    known: answers by element; depth: how far down it looks, against sums as long as Python's stack.
    """
    key = e.element_hash()
    if key not in known:
        known[key] = _halved(e, known, depth)
    return known[key]


def _halved(e: ca.SX, known: dict[int, ca.SX | None], depth: int) -> ca.SX | None:
    if e.is_zero():
        return e
    if depth == 0 or e.is_constant() or e.is_symbolic():
        return None
    op = e.op()
    if op == ca.OP_TWICE:
        return e.dep(0)
    if op == ca.OP_NEG:
        a = _half(e.dep(0), known, depth - 1)
        return None if a is None else -a
    if op in (ca.OP_ADD, ca.OP_SUB):
        a = _half(e.dep(0), known, depth - 1)
        b = None if a is None else _half(e.dep(1), known, depth - 1)
        return None if a is None or b is None else a + b if op == ca.OP_ADD else a - b
    if op == ca.OP_MUL:
        for one, other in ((e.dep(0), e.dep(1)), (e.dep(1), e.dep(0))):
            a = _half(one, known, depth - 1)
            if a is not None:
                return a * other
    return None


def _folded(flat: FlatModel, derivatives: list[list[ca.SX]], fold: ca.SX) -> list[list[ca.SX]]:
    if not flat.parameters:
        return derivatives
    everything = ca.substitute([e for chain in derivatives for e in chain], [flat.p], [fold])
    flatten = iter(everything)
    return [[next(flatten) for _ in chain] for chain in derivatives]


def condition_order(flat: FlatModel, conditions: Sequence[FlatEquation], pairs: Sequence[Pair]) -> int:
    """How often conditions on known values are differentiated, as often as these occur; -1 without any."""
    highest = dict(sorted(pairs))
    return max((highest.get(i, 0) for e in conditions for i, _ in flat.scope.symbols_in(e.residual)), default=-1)


def _with_conditions(
    flat: FlatModel, stages: list[ca.SX], conditions: list[FlatEquation], pairs: list[Pair]
) -> list[ca.SX]:
    """Stage residuals with the conditions on known values, differentiated as often as these occur."""
    if not conditions:
        return stages
    residual = ca.vertcat(*[e.residual for e in conditions])
    top = condition_order(flat, conditions, pairs)
    stages = [*stages, *[ca.SX(0, 1)] * max(0, top + 1 - len(stages))]
    for m in range(top + 1):
        stages[m] = ca.vertcat(stages[m], residual)
        residual = flat.scope.derivative(residual)
    return stages


def _users(
    flat: FlatModel, derivatives: list[list[ca.SX]], unknown_of: dict[Pair, Pair], solver: dict[Pair, Pair]
) -> dict[Pair, list[Pair]]:
    """Symbols that each node's equation uses, besides the one it is solved for."""
    return {
        node: [p for p in flat.scope.symbols_in(derivatives[node[0]][node[1]]) if solver.get(p) != node]
        for node in unknown_of
    }


def _system(flat: FlatModel, structure: Structure, derivatives: list[list[ca.SX]]) -> ca.SX:
    """d f_i^(c_i) / d x_j^(d_j)."""
    # SX also where nothing is left but aliases
    top = ca.SX(ca.vertcat(*[derivatives[i][structure.c[i]] for i in range(len(structure.c))]))
    columns = ca.SX(ca.vertcat(*[flat.scope.symbol(j, int(structure.d[n])) for n, j in enumerate(structure.unknowns)]))
    return ca.jacobian(top, columns)


def _pairs(
    flat: FlatModel,
    derivatives: list[list[ca.SX]],
    structure: Structure,
    conditions: list[FlatEquation],
    wanted: Sequence[Pair],
) -> list[Pair]:
    pairs = {p for chain in derivatives for e in chain for p in flat.scope.symbols_in(e)}
    pairs |= {(j, m) for n, j in enumerate(structure.unknowns) for m in range(int(structure.d[n]) + 1)}
    pairs |= {p for e in conditions for p in flat.scope.symbols_in(e.residual)}
    return sorted(pairs | set(wanted))


def _points(sampler: Sampler, alias: AliasResult) -> tuple[Sampler, np.ndarray, list[Moved]]:
    """Consistent points of a causality, and which start values gave way. If some do the points are about the home pose
    that all causalities of the model share."""
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


def _jacobians(
    flat: FlatModel, structure: Structure, derivatives: list[list[ca.SX]], sampler: Sampler, samples: np.ndarray
) -> list[np.ndarray]:
    f = ca.Function("system", [sampler.w, flat.p, flat.scope.time], [_system(flat, structure, derivatives)])
    return [np.asarray(f(w, flat.p0, sampler.time).full()) for w in samples]


def _solve(
    flat: FlatModel,
    structure: Structure,
    derivatives: list[list[ca.SX]],
    nodes: list[Pair],
    unknown_of: dict[Pair, Pair],
    signs: SignAnalysis,
) -> SolvedBlock:
    order = sorted(nodes, key=lambda n: unknown_of[n])  # canonical: by declaration of the unknowns
    rows = sorted(nodes)
    residuals = [derivatives[i][m] for i, m in rows]
    unknowns = [flat.scope.symbol(*unknown_of[n]) for n in order]
    names = [flat.symbol_name(*unknown_of[n]) for n in order]
    equations = [f"{structure.equations[i].label}{chr(39) * m} ({structure.equations[i].where})" for i, m in rows]
    label = names[0] if len(names) == 1 else f"{names[0]}..{names[-1]}"
    jacobian = ca.jacobian(ca.vertcat(*residuals), ca.vertcat(*unknowns))
    kinked = has_kinks(flat) and any(kinked_in(residuals, unknowns))
    keys = {s.element_hash() for s in unknowns}
    if not kinked and not any(s.element_hash() in keys for s in ca.symvar(jacobian)):
        assignments, margins, how = solve_linear(residuals, unknowns, signs, label)
        kind = "explicit" if len(nodes) == 1 and not margins else "linear"
        return SolvedBlock(kind, names, equations, assignments, margins, [], how)
    try:
        assignments, margins, roots, how = solve_nonlinear(residuals, unknowns, signs, kinked)
    except NoClosedForm:
        left, unknown, explicit = eliminate_explicit(residuals, unknowns, signs, True, kinked)
        scale = np.array([flat.variables[p[0]].nominal for p in map(flat.scope.owner, unknown) if p is not None])
        labels = [u.name() for u in unknown]
        how = f"Newton in {', '.join(labels)}" + (f", {len(explicit)} explicit" if explicit else "")
        newton = NewtonBlock(unknown, left, labels, scale)
        solved = SolvedBlock("Newton", names, equations, list(reversed(explicit)), [], [], how, newton)
    else:
        solved = SolvedBlock(how.split(" in ")[0], names, equations, assignments, margins, roots, how)
    solved.closures = tuple(residuals)
    return solved


def _size_margins(plan: Plan, sampler: Sampler) -> None:
    """Typical sizes of the margins, read off the consistent points; pivots that are negative there change their sign,
    which means nothing and costs an operation."""
    flat = plan.flat
    margins = [m for b in plan.blocks for m in b.margins]
    if margins:
        sizes = ca.Function(
            "sizes", [sampler.w, flat.p, flat.scope.time], [ca.vertcat(*[m.expression for m in margins])]
        )
        values = np.array([np.asarray(sizes(w, flat.p0, sampler.time)).reshape(-1) for w in plan.samples])
        scales = dict(zip(map(id, margins), np.median(np.abs(values), axis=0), strict=True))
        turned = {id(m) for m, row in zip(margins, values.T, strict=True) if m.kind == "pivot" and row[0] < 0}
        for b in plan.blocks:
            b.margins = [
                type(m)(
                    m.kind, -m.expression if id(m) in turned else m.expression, m.label, float(scales[id(m)]) or 1.0
                )
                for m in b.margins
            ]
