"""From an Optimization to a pointwise dynamic problem: which formulation, which states."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca

from ...compiler.analysis.switching import refuse_events
from ...compiler.causal import flat_of
from ...compiler.flat import FlatModel
from ...compiler.plan import CausalPlan, make_plan
from ...lang.expression import Expr
from ...lang.optimization import Optimization
from ...lang.slips import line_of, persons_code
from ...lang.source import ModelError
from .assembled import assembled
from .attributes import Pair
from .builder import ProblemBuilder
from .delays import delays_of
from .dynamic import DynamicProblem, Quadrature
from .horizon import end_of, initial_rows
from .quadratures import refuse_adrift, set_apart
from .relations import ConstraintRow, relations

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
