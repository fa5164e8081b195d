"""From an Optimization to a pointwise dynamic problem: which formulation, which states, limits, dynamics and cost,
put together."""

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
    """The problem of an objective and constraints, in the form that the builder writes. Raises ModelError."""
    ends = horizon(b.flat, b.P, b.parameters)
    instants = point_values(b.flat, ends, b.flat.scope.instants, b.parameters)
    limits = limits_of(b, constraints, instants, {q.index for q in quadratures})
    written = limits.path
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
    at_start = rows_at_start(b, written, path, limits.x, limits.u, limits.start, ends.t0)
    scale = jacobian.at_one(algebraic)
    if b.kind == "inverse":
        scale[: len(b.controls)] = u_scale[: len(b.controls)]
    cost = cost_of(
        b, objective, [*limits.points, *(row for _, row in at_start)], [*instants, *(value for value, _ in at_start)],
        jacobian, ends, guess, scale_P,
    )  # fmt: skip
    more = cost.states
    for bounds, reach in ((limits.x, np.inf), (limits.start, 0.0), (limits.end, np.inf)):
        bounds.low = np.append(bounds.low, [-reach] * len(more))
        bounds.high = np.append(bounds.high, [reach] * len(more))
    return DynamicProblem(
        flat=b.flat, plan=b.plan, formulation=b.kind, state_pairs=b.states, control_indices=b.controls,
        x=ca.vertcat(b.x, *[q for q, _, _ in more]),
        xd=ca.vertcat(b.xd, *[ca.SX.sym("rate_integral") for _ in more]),
        u=b.u, P=b.P, t=b.flat.scope.time, t0=ends.t0, tf=ends.tf, rates=[*rates, *(e for _, e, _ in more)],
        algebraic=algebraic, algebraic_labels=labels, algebraic_scale=scale, path=path, x_bounds=limits.x,
        u_bounds=limits.u, P_bounds=bounds_P, P_guess=guess, start_bounds=limits.start,
        end_bounds=limits.end, integrals=cost.integrals, instants=cost.instants, mayer=cost.mayer, points=cost.points,
        builder=b, base=b.base, x_scale=np.append(x_scale, [size for _, _, size in more]), u_scale=u_scale,
        P_scale=scale_P, delayed=list(b.delayed.values()), delayed_indices=list(b.delayed), z_pairs=b.z_pairs,
        tunable=b.tunable, branches=branches, misfits=cost.misfits, shortest=shortest,
        quadratures=[Quadrature(q.index, e, q.start) for q, e in zip(quadratures, integrands, strict=True)],
    )  # fmt: skip


def _expressed(b: ProblemBuilder, limits: TrajectoryBounds, instants: list[PointValue]) -> list[ConstraintRow]:
    """The rows along the path, and the instants, in states, inputs and constants."""
    asked = [i.expression for i in instants]
    values = b.express(asked + [r.expression for r in limits.path])
    for i, e, off in zip(instants, values, b.off_points(asked, values[: len(instants)]), strict=False):
        i.expression, i.off = e, off
    return [replace(r, expression=e) for r, e in zip(limits.path, values[len(instants) :], strict=True)]


def _constants(b: ProblemBuilder) -> tuple[list[str], Bounds, np.ndarray]:
    """Free constants and, behind them, the parameters that may change: names, bounds, guess."""
    value = {q.name: q.value for q in b.flat.parameters}
    held = [value[n] for n in b.tunable]
    free = [q for q in b.flat.parameters if q.free]
    bounds = Bounds(np.array([q.min for q in free] + held), np.array([q.max for q in free] + held))
    return [*(q.name for q in free), *b.tunable], bounds, np.array([q.value for q in free] + held)


def _size(path: list[ConstraintRow], jacobian: Jacobians) -> None:
    """Give each row its size: its own bounds' where these tell one."""
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
    """Flatten, choose states, and express cost and constraints in them; made once per configuration object.

    formulation:
        "explicit": rates as functions of states and controls; needs a closed form.
        "inverse": controls as functions of states and their rates, for fully actuated models.
        "torn": explicit, but unknowns of equations without a closed form are free at each point, and those
            equations are constraints.
        "dae": nothing but equal names is eliminated: all unknowns are free at each point, and all equations and the
            derivatives that they imply are constraints.
        "auto": inverse where it exists and does not bring the only divisions by something that may vanish, as in
            u = (x' - f) / cos x, and no rate is asked for at the start or within the horizon; else explicit; else torn.
    branches: sign +1 or -1 by the name of a declared branch; +1 by default.
    tunable: names of parameters that stay symbols, to be changed between solves.
    sizes: of variables and free constants by name, in place of their nominals: see sizes.of_trajectory.
    linked: it is one of several phases, whose states continue: none of them is a mere integral.
    sides: constraints along the path beside the model's own.

    Raises ModelError with file and line.
    """
    if formulation not in FORMULATIONS:
        raise ValueError(f"formulation is one of {', '.join(FORMULATIONS)}; found '{formulation}'")
    flat, wanted = flat_of(model), tuple(sorted(dict(branches or {}).items()))
    refuse_events(flat)
    asked = _Asked(formulation, tuple(prefer), wanted, tuple(tunable), sizes, linked, sides)
    if asked not in flat.cache:
        flat.cache[asked] = _build(flat, asked)
    return flat.cache[asked]


@dataclass(frozen=True)
class _Asked:
    """What is asked of a model; see `build`."""

    formulation: str
    prefer: tuple[str, ...]
    branches: tuple[tuple[str, int], ...]
    tunable: tuple[str, ...]
    sizes: tuple[tuple[str, float], ...]
    linked: bool
    sides: tuple[ConstraintRow, ...]


def _build(flat: FlatModel, asked: _Asked) -> DynamicProblem:
    objective, constraints = _stated(flat)
    constraints = [*constraints, *(replace(row) for row in asked.sides)]
    inputs = [v.index for v in flat.variables if v.role == "input"]
    delays, branches = delays_of(flat), dict(asked.branches)
    controls = [i for i in inputs if i not in delays]
    preferred = [i for name in asked.prefer for i in flat.lookup(name)[1]]
    fold = _fold(flat, asked.tunable)
    quadratures: list[Quadrature] = []
    if not asked.linked:
        refuse_adrift(flat, objective.sx, constraints, end_of(flat, "final_time"))
        cost, quadratures = set_apart(flat, objective.sx, constraints, preferred, end_of(flat, "final_time"))
        objective = Expr(cost, (), objective.dimension, objective.scope)
    apart = {q.index for q in quadratures}
    pairs = _all_pairs(flat, constraints, apart)
    base = make_plan(flat, inputs, pairs, preferred, branches, rates=True, fold=fold, apart=apart)
    _refuse_others(base, asked.prefer)
    if asked.formulation == "dae" and (idle := _idle(flat, base)):
        # all equations are rows here, also those that nothing asked for
        base = make_plan(flat, inputs, sorted({*pairs, *idle}), preferred, branches, rates=True, fold=fold)
    steep = [flat.symbol_name(i, k) for i, k in base.inputs if i in inputs and k > 0]
    if steep:
        raise ModelError(
            f"{flat.title} needs {', '.join(steep)}, but a control may jump; make it a state and its derivative "
            "the control"
        )
    # without a closed form of the states' equations there is none of their inverse either
    hopeless = bool(delays) or (asked.formulation == "auto" and bool(base.newton))
    inverse = None
    if asked.formulation in ("auto", "inverse") and not hopeless:
        inverse = _inverse_plan(flat, controls, base.states, pairs, branches, fold, apart)
    plan, kind = _formulated(flat, asked.formulation, controls, base, inverse)
    delayed = {i: (controls.index(source), item) for i, (source, item) in delays.items()}

    def made(plan: CausalPlan, kind: str) -> DynamicProblem:
        sizes = dict(asked.sizes)
        b = ProblemBuilder(flat, plan, kind, base.states, controls, base, fold, asked.tunable, delayed, sizes)
        return assembled(b, objective, constraints, quadratures, branches)

    problem = made(plan, kind)
    if (
        asked.formulation == "auto"
        and kind == "inverse"
        and any(i.off is not None and i.s < 1.0 for i in problem.instants)
    ):
        # a rate off the points ties the controls, not the motion: the explicit form finds it from any guess
        return made(base, "explicit")
    return problem


def _refuse_others(plan: CausalPlan, prefer: Sequence[str]) -> None:
    """Raises ModelError for a name of which nothing is a state, although it is preferred as one."""
    flat, states = plan.flat, {i for i, _ in plan.states}
    for name in prefer:
        if not any(plan.alias.resolve(i, 0)[1] in states for i in flat.lookup(name)[1]):
            names = ", ".join(flat.symbol_name(*p) for p in plan.states) or "none"
            raise ModelError(
                f"{flat.title}: '{name}' is preferred as a state and cannot be one; the states are {names}: leave it "
                "out of prefer, or prefer one of these"
            )


def _stated(flat: FlatModel) -> tuple[Expr, list[ConstraintRow]]:
    """The objective and the constraints, with the initial equations. Raises ModelError."""
    root = flat.root
    if not isinstance(root, Optimization):
        raise ModelError(f"{flat.title} is no Optimization; give it an objective and a horizon")
    flat.scope.instants.clear()  # those of another formulation of the same model
    flat.scope.misfits.clear()
    with persons_code(f"objective() of {flat.title}", type(root).objective):
        objective = root.objective()
    if not isinstance(objective, Expr) or objective.shape != ():
        raise ModelError(
            f"{flat.title}.objective() must return a scalar expression; found {objective!r}",
            line_of(type(root).objective),
        )
    own = vars(type(root))
    if "constraint" in own and type(root).constraints is Optimization.constraints:
        raise ModelError(
            f"{flat.title}.constraint() is not asked for any: its name has to be constraints",
            line_of(own["constraint"]),
        )
    if not flat.variables:
        raise ModelError(f"{flat.title} has no variable, so there is no trajectory to optimise; declare one")
    return objective, relations(root.constraints(), flat) + initial_rows(flat)


def _formulated(
    flat: FlatModel, formulation: str, controls: list[int], base: CausalPlan, inverse: CausalPlan | None
) -> tuple[CausalPlan, str]:
    """The plan of a formulation, and its kind. Raises ModelError for one that the model does not have."""
    if formulation == "dae":
        return base, "dae"
    if formulation == "explicit":
        _refuse_newton(flat, base)
    divides = inverse is not None and _pivots(inverse) and not _pivots(base)
    if inverse is not None and (formulation == "inverse" or not divides):
        return inverse, "inverse"
    if formulation == "inverse":
        raise ModelError(
            f"{flat.title}: the controls are not determined by the motion of the states "
            f"({len(controls)} controls for {len({i for i, _ in base.states})} coordinates); use formulation 'explicit'"
        )
    return base, "torn" if base.newton else "explicit"


def _idle(flat: FlatModel, plan: CausalPlan) -> list[Pair]:
    """Chain symbols of the equations that the plan does not compute."""
    known = {s.element_hash() for b in plan.blocks for s, _ in b.assignments}
    known |= {s.element_hash() for b in plan.newton for s in b.unknowns}
    given = {*plan.inputs, *plan.states}
    return [p for p in plan.pairs if p not in given and flat.scope.symbol(*p).element_hash() not in known]


def _pivots(plan: CausalPlan) -> bool:
    """Does it divide by what depends on the state?"""
    return any(m.kind == "pivot" for b in plan.blocks for m in b.margins)


def _fold(flat: FlatModel, tunable: Sequence[str]) -> ca.SX:
    """Numbers for the parameters, symbols for the free constants and the tunable ones. Raises ModelError."""
    values = flat.require_values()
    names = {q.name for q in flat.parameters if not q.free}
    for name in tunable:
        if name not in names:
            raise ModelError(f"{flat.title} has no parameter '{name}'; it has {', '.join(sorted(names)) or 'none'}")
    return ca.vertcat(
        *[q.symbol if q.free or q.name in tunable else ca.SX(values[n]) for n, q in enumerate(flat.parameters)]
    )


def _all_pairs(flat: FlatModel, constraints: list[ConstraintRow], apart: Collection[int]) -> list[Pair]:
    """Every chain symbol that the model, its cost or its constraints mention, but for the variables `apart`."""
    expressions = [i.expression for i in flat.scope.instants] + [r.expression for r in constraints]
    named = [p for pairs in flat.scope.symbols_in_each(expressions) for p in pairs]
    return sorted({(v.index, 0) for v in flat.variables if v.index not in apart} | set(named))


def _inverse_plan(
    flat: FlatModel,
    controls: list[int],
    states: list[Pair],
    asked: list[Pair],
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
        plan = make_plan(flat, coordinates, asked, branches=branches, fold=fold, apart=apart)
    except ModelError:
        return None  # not every motion of these coordinates is possible: the explicit form always is
    top = {i: max(k for j, k in states if j == i) + 1 for i in coordinates}
    usable = not plan.newton and not plan.states
    return plan if usable and all(k <= top[i] for i, k in plan.inputs) else None


def _refuse_newton(flat: FlatModel, plan: CausalPlan) -> None:
    """Raises ModelError for equations without a closed form."""
    if plan.newton:
        names = "; ".join(", ".join(b.labels) for b in plan.newton)
        raise ModelError(
            f"{flat.title}: the equations for {names} have no closed form, and formulation 'explicit' needs one; use "
            "'torn' or 'dae', which keep them as unknowns"
        )
