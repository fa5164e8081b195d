"""Build a pointwise dynamic problem from an Optimization: formulation, states, limits, dynamics and cost."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ...compiler.analysis.switching import refuse_events
from ...compiler.causal import flat_of
from ...compiler.flat import FlatModel
from ...compiler.plan import CausalPlan, make_plan
from ...lang.expression import Expr
from ...lang.optimization import Optimization
from ...lang.slips import line_of, persons_code
from ...lang.source import ModelError
from .builder import ProblemBuilder, cost_of
from .delays import delays_of
from .dynamic import Bounds, DynamicProblem, Quadrature
from .horizon import (
    ConstraintRow,
    Pair,
    PointValue,
    end_of,
    horizon,
    initial_rows,
    point_values,
    relations,
    shortest_length,
)
from .limits import TrajectoryBounds, bounded_end, check_bounds, limits_of, rows_at_start
from .quadratures import refuse_adrift, set_apart
from .scaling import Jacobians, of_constants, scale_of, within


def assembled(
    b: ProblemBuilder,
    objective: Expr,
    constraints: list[ConstraintRow],
    quadratures: Sequence[Quadrature],
    branches: dict[str, int],
) -> DynamicProblem:
    """Assemble the problem of an objective and constraints in the builder's form. Raises ModelError."""
    ends = horizon(b.flat, b.P, b.parameters)
    instants = point_values(b.flat, ends, b.flat.scope.instants, b.parameters)
    limits = limits_of(b, constraints, instants, {q.index for q in quadratures})
    original_path = limits.path
    path = _expressed(b, limits, instants)
    names, bounds_P, guess = _constants(b)
    shortest = shortest_length(b.flat, ends, constraints, guess, b.P[b.n_free :])
    if shortest and not bounded_end(b, ends, shortest, bounds_P):
        limits.points.append(ConstraintRow(ends.length, shortest, np.inf, "the horizon's shortest length", None))
    check_bounds(b, limits.x, limits.u, bounds_P, limits.start, limits.end)
    rates, algebraic, labels = b.dynamics()
    integrands = b.express([q.integrand for q in quadratures]) if quadratures else []
    sizes = zip(names, of_constants(guess, bounds_P.low, bounds_P.high), strict=True)
    scale_P = np.array([b.sizes.get(n, s) for n, s in sizes])
    x_scale = within(b.nominals(b.states), limits.x.low, limits.x.high)
    u_scale = within(b.nominals(b.input_pairs), limits.u.low, limits.u.high)
    jacobian = b.jacobian(x_scale, u_scale, guess)
    _size(path, jacobian)
    at_start = rows_at_start(b, original_path, path, limits.x, limits.u, limits.start, ends.t0)
    scale = jacobian.at_one(algebraic)
    if b.kind == "inverse":
        scale[: len(b.controls)] = u_scale[: len(b.controls)]
    cost = cost_of(
        b, objective, [*limits.points, *(row for _, row in at_start)], [*instants, *(value for value, _ in at_start)],
        jacobian, ends, guess, scale_P,
    )  # fmt: skip
    cost_states = cost.states
    for bounds, limit in ((limits.x, np.inf), (limits.start, 0.0), (limits.end, np.inf)):
        bounds.low = np.append(bounds.low, [-limit] * len(cost_states))
        bounds.high = np.append(bounds.high, [limit] * len(cost_states))
    return DynamicProblem(
        flat=b.flat, plan=b.plan, formulation=b.kind, state_pairs=b.states, control_indices=b.controls,
        x=ca.vertcat(b.x, *[q for q, _, _ in cost_states]),
        xd=ca.vertcat(b.xd, *[ca.SX.sym("rate_integral") for _ in cost_states]),
        u=b.u, P=b.P, t=b.flat.scope.time, t0=ends.t0, tf=ends.tf, rates=[*rates, *(e for _, e, _ in cost_states)],
        algebraic=algebraic, algebraic_labels=labels, algebraic_scale=scale, path=path, x_bounds=limits.x,
        u_bounds=limits.u, P_bounds=bounds_P, P_guess=guess, start_bounds=limits.start,
        end_bounds=limits.end, integrals=cost.integrals, instants=cost.instants, mayer=cost.mayer, points=cost.points,
        builder=b, base=b.base, x_scale=np.append(x_scale, [size for _, _, size in cost_states]), u_scale=u_scale,
        P_scale=scale_P, delayed=list(b.delayed.values()), delayed_indices=list(b.delayed), z_pairs=b.z_pairs,
        tunable=b.tunable, branches=branches, misfits=cost.misfits, shortest=shortest,
        quadratures=[Quadrature(q.index, e, q.start) for q, e in zip(quadratures, integrands, strict=True)],
    )  # fmt: skip


def _expressed(b: ProblemBuilder, limits: TrajectoryBounds, instants: list[PointValue]) -> list[ConstraintRow]:
    """Express the path rows and the values at instants in states, inputs and constants."""
    expressions = [i.expression for i in instants]
    values = b.express(expressions + [r.expression for r in limits.path])
    for i, e, between in zip(instants, values, b.off_points(expressions, values[: len(instants)]), strict=False):
        i.expression, i.off = e, between
    return [replace(r, expression=e) for r, e in zip(limits.path, values[len(instants) :], strict=True)]


def _constants(b: ProblemBuilder) -> tuple[list[str], Bounds, np.ndarray]:
    """Return names, bounds and guess of the free constants followed by the tunable parameters."""
    value = {q.name: q.value for q in b.flat.parameters}
    tunable_values = [value[n] for n in b.tunable]
    free = [q for q in b.flat.parameters if q.free]
    bounds = Bounds(np.array([q.min for q in free] + tunable_values), np.array([q.max for q in free] + tunable_values))
    return [*(q.name for q in free), *b.tunable], bounds, np.array([q.value for q in free] + tunable_values)


def _size(path: list[ConstraintRow], jacobian: Jacobians) -> None:
    """Set the scale of each row, from its bounds if these are small, else from its derivatives."""
    for row, size in zip(path, jacobian.typical([r.expression for r in path]), strict=True):
        nominal = float(within(np.array(row.scale), np.array(row.low), np.array(row.high)))
        row.scale = scale_of(nominal if nominal != 1.0 else float(size))


FORMULATIONS = ("auto", "inverse", "explicit", "torn", "dae")


def build(
    model: Optimization,
    formulation: str = "auto",
    prefer: Sequence[str] = (),
    branches: Mapping[str, int] | None = None,
    tunable: Sequence[str] = (),
    sizes: tuple[tuple[str, float], ...] = (),
    linked: bool = False,
    sides: tuple[ConstraintRow, ...] = (),
) -> DynamicProblem:
    """Flatten, choose states, and express cost and constraints in them; cached per configuration object.

    formulation:
        "explicit": rates as functions of states and controls; needs a closed form.
        "inverse": controls as functions of states and their rates, for fully actuated models.
        "torn": explicit, but unknowns of equations without a closed form are free at each point, and those
            equations are constraints.
        "dae": only aliases are eliminated: all unknowns are free at each point, and all equations and their
            differentiated consequences are constraints.
        "auto": inverse if it exists, if it does not introduce the only divisions by expressions that may vanish, as in
            u = (x' - f) / cos x, and if no rate is needed at the start or within the horizon; else explicit; else torn.
    branches: sign +1 or -1 by name of a declared branch; +1 by default.
    tunable: names of parameters that stay symbols and may change between solves.
    sizes: sizes of variables and free constants by name that replace their nominals, see scaling.of_trajectory.
    linked: the problem is one of several phases; its states continue, so none is replaced by an integral.
    sides: further path constraints.

    Raises ModelError with file and line.
    """
    if formulation not in FORMULATIONS:
        raise ValueError(f"formulation must be one of {', '.join(FORMULATIONS)}; found '{formulation}'")
    flat, signs = flat_of(model), tuple(sorted(dict(branches or {}).items()))
    refuse_events(flat)
    options = _Options(formulation, tuple(prefer), signs, tuple(tunable), sizes, linked, sides)
    if options not in flat.cache:
        flat.cache[options] = _build(flat, options)
    return flat.cache[options]


@dataclass(frozen=True)
class _Options:
    """Options of `build`, the key of its cache."""

    formulation: str
    prefer: tuple[str, ...]
    branches: tuple[tuple[str, int], ...]
    tunable: tuple[str, ...]
    sizes: tuple[tuple[str, float], ...]
    linked: bool
    sides: tuple[ConstraintRow, ...]


def _build(flat: FlatModel, options: _Options) -> DynamicProblem:
    objective, constraints = _stated(flat)
    constraints = [*constraints, *(replace(row) for row in options.sides)]
    inputs = [v.index for v in flat.variables if v.role == "input"]
    delays, branches = delays_of(flat), dict(options.branches)
    controls = [i for i in inputs if i not in delays]
    preferred = [i for name in options.prefer for i in flat.lookup(name)[1]]
    fold = _fold(flat, options.tunable)
    quadratures: list[Quadrature] = []
    if not options.linked:
        refuse_adrift(flat, objective.sx, constraints, end_of(flat, "final_time"))
        cost, quadratures = set_apart(flat, objective.sx, constraints, preferred, end_of(flat, "final_time"))
        objective = Expr(cost, (), objective.dimension, objective.scope)
    apart = {q.index for q in quadratures}
    pairs = _all_pairs(flat, constraints, apart)
    base = make_plan(flat, inputs, pairs, preferred, branches, rates=True, fold=fold, apart=apart)
    _refuse_others(base, options.prefer)
    if options.formulation == "dae" and (idle := _idle(flat, base)):
        # all equations are rows here, even those of unused variables
        base = make_plan(flat, inputs, sorted({*pairs, *idle}), preferred, branches, rates=True, fold=fold)
    derivatives = [flat.symbol_name(i, k) for i, k in base.inputs if i in inputs and k > 0]
    if derivatives:
        raise ModelError(
            f"{flat.title} needs {', '.join(derivatives)}, but a control may jump; declare the control as a state and "
            "its derivative as the control"
        )
    # if the states' equations have no closed form, their inverse has none either
    hopeless = bool(delays) or (options.formulation == "auto" and bool(base.newton))
    inverse = None
    if options.formulation in ("auto", "inverse") and not hopeless:
        inverse = _inverse_plan(flat, controls, base.states, pairs, branches, fold, apart)
    plan, kind = _formulated(flat, options.formulation, controls, base, inverse)
    delayed = {i: (controls.index(source), item) for i, (source, item) in delays.items()}

    def assemble(plan: CausalPlan, kind: str) -> DynamicProblem:
        sizes = dict(options.sizes)
        b = ProblemBuilder(flat, plan, kind, base.states, controls, base, fold, options.tunable, delayed, sizes)
        return assembled(b, objective, constraints, quadratures, branches)

    problem = assemble(plan, kind)
    if (
        options.formulation == "auto"
        and kind == "inverse"
        and any(i.off is not None and i.s < 1.0 for i in problem.instants)
    ):
        # a rate off the points constrains the controls, not the motion: only the explicit form converges reliably
        return assemble(base, "explicit")
    return problem


def _refuse_others(plan: CausalPlan, prefer: Sequence[str]) -> None:
    """Raise ModelError for a preferred name that cannot be a state."""
    flat, states = plan.flat, {i for i, _ in plan.states}
    for name in prefer:
        if not any(plan.alias.resolve(i, 0)[1] in states for i in flat.lookup(name)[1]):
            names = ", ".join(flat.symbol_name(*p) for p in plan.states) or "none"
            raise ModelError(
                f"{flat.title}: '{name}' in prefer cannot be a state; states are {names}. Remove it from prefer, or "
                "prefer one of these"
            )


def _stated(flat: FlatModel) -> tuple[Expr, list[ConstraintRow]]:
    """Return the objective and the constraints, including the initial equations. Raises ModelError."""
    root = flat.root
    if not isinstance(root, Optimization):
        raise ModelError(f"{flat.title} is not a gt.Optimization")
    flat.scope.instants.clear()  # those of another formulation of the same model
    flat.scope.misfits.clear()
    with persons_code(f"objective() of {flat.title}", type(root).objective):
        objective = root.objective()
    if not isinstance(objective, Expr) or objective.shape != ():
        raise ModelError(
            f"{flat.title}.objective() must return a scalar expression; found {objective!r}",
            line_of(type(root).objective),
        )
    attributes = vars(type(root))
    if "constraint" in attributes and type(root).constraints is Optimization.constraints:
        raise ModelError(
            f"{flat.title}.constraint() is never called; rename it to constraints()",
            line_of(attributes["constraint"]),
        )
    if not flat.variables:
        raise ModelError(f"{flat.title} has no variable, so there is no trajectory to optimise; declare a variable")
    return objective, relations(root.constraints(), flat) + initial_rows(flat)


def _formulated(
    flat: FlatModel, formulation: str, controls: list[int], base: CausalPlan, inverse: CausalPlan | None
) -> tuple[CausalPlan, str]:
    """Return the plan and the kind of a formulation. Raises ModelError if the model does not allow it."""
    if formulation == "dae":
        return base, "dae"
    if formulation == "explicit":
        _refuse_newton(flat, base)
    divides = inverse is not None and _pivots(inverse) and not _pivots(base)
    if inverse is not None and (formulation == "inverse" or not divides):
        return inverse, "inverse"
    if formulation == "inverse":
        raise ModelError(
            f"{flat.title}: the motion of the states does not determine the controls "
            f"({len(controls)} controls for {len({i for i, _ in base.states})} coordinates); use formulation 'explicit'"
        )
    return base, "torn" if base.newton else "explicit"


def _idle(flat: FlatModel, plan: CausalPlan) -> list[Pair]:
    """Return variables and derivatives in the equations that the plan does not compute."""
    known = {s.element_hash() for b in plan.blocks for s, _ in b.assignments}
    known |= {s.element_hash() for b in plan.newton for s in b.unknowns}
    known_pairs = {*plan.inputs, *plan.states}
    return [p for p in plan.pairs if p not in known_pairs and flat.scope.symbol(*p).element_hash() not in known]


def _pivots(plan: CausalPlan) -> bool:
    """Return whether the plan divides by an expression that depends on the state."""
    return any(m.kind == "pivot" for b in plan.blocks for m in b.margins)


def _fold(flat: FlatModel, tunable: Sequence[str]) -> ca.SX:
    """Return numbers for the parameters, but symbols for free constants and tunable ones. Raises ModelError."""
    values = flat.require_values()
    names = {q.name for q in flat.parameters if not q.free}
    for name in tunable:
        if name not in names:
            raise ModelError(f"{flat.title} has no parameter '{name}'; it has {', '.join(sorted(names)) or 'none'}")
    return ca.vertcat(
        *[q.symbol if q.free or q.name in tunable else ca.SX(values[n]) for n, q in enumerate(flat.parameters)]
    )


def _all_pairs(flat: FlatModel, constraints: list[ConstraintRow], apart: Collection[int]) -> list[Pair]:
    """Return all variables and derivatives used by the model, cost or constraints, except the variables `apart`."""
    expressions = [i.expression for i in flat.scope.instants] + [r.expression for r in constraints]
    named = [p for pairs in flat.scope.symbols_in_each(expressions) for p in pairs]
    return sorted({(v.index, 0) for v in flat.variables if v.index not in apart} | set(named))


def _inverse_plan(
    flat: FlatModel,
    controls: list[int],
    states: list[Pair],
    needed: list[Pair],
    branches: Mapping[str, int],
    fold: ca.SX,
    apart: Collection[int],
) -> CausalPlan | None:
    coordinates = sorted({i for i, _ in states})
    if len(coordinates) != len(controls) or not controls:
        return None
    if any((i, k) not in states for i, top in states for k in range(top)):
        return None
    try:
        plan = make_plan(flat, coordinates, needed, branches=branches, fold=fold, apart=apart)
    except ModelError:
        return None  # not every motion of these coordinates is possible; use the explicit form
    top = {i: max(k for j, k in states if j == i) + 1 for i in coordinates}
    usable = not plan.newton and not plan.states
    return plan if usable and all(k <= top[i] for i, k in plan.inputs) else None


def _refuse_newton(flat: FlatModel, plan: CausalPlan) -> None:
    """Raise ModelError for equations without a closed form."""
    if plan.newton:
        names = "; ".join(", ".join(b.labels) for b in plan.newton)
        raise ModelError(
            f"{flat.title}: the equations for {names} have no closed form, which formulation 'explicit' needs; use "
            "'torn' or 'dae', which keep these unknowns"
        )
