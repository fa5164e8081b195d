"""Several phases, each an Optimization with its own horizon and mesh, linked end to start."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .._pickling import Portable
from ..lang.model import Model
from ..lang.optimization import Optimization
from ..lang.source import ModelError, SourceLocation
from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .formulation.horizon import ConstraintRow
from .formulation.problem import build
from .formulation.scaling import objective_scale
from .guess import initial_guess
from .ipopt import SolverRun, run_ipopt
from .judgement.checks import Remark, astray, check_equalities, not_finite
from .judgement.diagnosis import failure, named_row, solved_word, violated, worst_of
from .judgement.discretisation import judged
from .linking import Joined, Link, join
from .mesh import Mesh, given_mesh
from .multistart import ReachedOptima
from .nlp import Nlp, make_nlp
from .solution import Solution, read_solution
from .solve import NotSolved, SolverOptions
from .watch import Multipliers, Progress


class Phases(Portable):
    """Several Optimizations in a row that are solved as one: the objective is the sum of theirs.

    Args:
        phases: configured Optimizations by name, in order.
        free: names of states that may jump at the start of a phase, by name of the phase. All other states that both
            neighbours have under one name are continuous.
        links: functions (before, after) -> relations at the start of a phase, by name of the phase:
            `lambda before, after: [after.v == -0.8 * before.v]`. `before.x` is a value at the end of the previous phase
            and `after.x` one at the start of this phase; names of parts are written before["robot.T"].
        shared: free constants with one value in all phases that declare them.

    A phase with a free start_time begins when the previous one ends; a phase with a numeric start_time has its own
    clock. Raises ModelError for fewer than two phases and for unknown names. Example: see `solve_phases`.
    """

    def __init__(
        self,
        phases: Mapping[str, Optimization],
        *,
        free: Mapping[str, Iterable[str]] | None = None,
        links: Mapping[str, Link] | None = None,
        shared: Iterable[str] = (),
    ) -> None:
        self.phases = dict(phases)
        for name, phase in self.phases.items():
            if not isinstance(phase, (Model, type)):
                raise ModelError(f"phase '{name}' must be a configured Optimization; found {phase!r}")
        for word, names in (*(("free", v) for v in (free or {}).values()), ("shared", shared)):
            if isinstance(names, str):
                raise ModelError(f"{word} takes a list of names; found '{names}'")
        self.free = {k: tuple(v) for k, v in (free or {}).items()}
        self.links = dict(links or {})
        self.shared = tuple(shared)
        # further path constraints of a phase
        self.sides: dict[str, tuple[ConstraintRow, ...]] = {}
        if len(self.phases) < 2:
            raise ModelError(f"Phases needs at least two phases; found {len(self.phases)}")
        later = list(self.phases)[1:]
        for what in (self.free, self.links):
            for name in what:
                if name not in later:
                    raise ModelError(f"'{name}' is not among the phases after the first, {', '.join(later)}")

    def guesses(self) -> Sequence[Mapping[str, Trajectory | Solution]]:
        """Return default guesses, each by name of the phase, for a solve without a guess."""
        return ()

    def doubts(self, joined: Joined, x: np.ndarray) -> list[str]:
        """Return reasons to reject a converged solution x; empty if there are none."""
        return []


@dataclass(frozen=True, eq=False)
class PhasesSolution(Portable):
    """Result of solving Phases: the whole, and a Solution for each phase by name.

    A phase's Solution has the status and message of the whole, and its own share of the cost and the multipliers.
    `link_multipliers`: by name of the linking row, in SI units and IPOPT's sign. `where`: see `Solution`.
    """

    status: SolveStatus
    message: str
    objective: float
    iterations: int
    phases: dict[str, Solution]
    link_multipliers: dict[str, float]
    seconds: dict[str, float]
    joined: Joined = field(repr=False)
    x: np.ndarray = field(repr=False)
    multipliers: np.ndarray = field(repr=False)
    bound_multipliers: np.ndarray = field(repr=False)
    where: SourceLocation | None = None

    def __getitem__(self, name: str) -> Solution:
        return self.phases[name]

    @property
    def trajectories(self) -> dict[str, Trajectory]:
        return {name: s.trajectory for name, s in self.phases.items()}


def solve_phases(
    model: Phases,
    mesh: Mesh | Mapping[str, Mesh] | None = None,
    *,
    guess: Mapping[str, Trajectory | Solution] | PhasesSolution | None = None,
    branches: Mapping[str, int] | None = None,
    solver: SolverOptions | None = None,
    progress: Progress | None = None,
    throw: bool = True,
) -> PhasesSolution:
    """Solve linked phases as one problem.

    Args:
        model: see `Phases`.
        mesh: one mesh for all phases, or one per phase by name; default 50 x 3 Radau.
        guess: a trajectory or solution per phase by name, or an earlier result.
        branches, solver, progress, throw: as for `solve`.

    Returns a `PhasesSolution` with a Solution for each phase. Raises ModelError for a wrong problem, and NotSolved if
    the solver fails, unless throw is False.

    >>> class Fall(gt.Optimization):  # from 2 m to the ground
    ...     g = gt.parameter(9.81, unit="m/s2")
    ...     q = gt.variable(unit="m", start=2.0, fixed=True)
    ...     v = gt.variable(unit="m/s", start=0.0, fixed=True)
    ...     final_time = gt.free(0.5, min=0.1, unit="s")
    ...     def equations(self):
    ...         yield gt.der(self.q) == self.v
    ...         yield gt.der(self.v) == -self.g
    ...     def objective(self):
    ...         return self.final_time - self.start_time
    ...     def constraints(self):
    ...         yield self.q.at(self.final_time) == 0
    >>> class Rise(Fall):  # and up again until it rests
    ...     q = gt.variable(unit="m")
    ...     v = gt.variable(unit="m/s")
    ...     start_time = gt.free(0.5, unit="s")
    ...     final_time = gt.free(1.0, unit="s")
    ...     def constraints(self):
    ...         yield self.final_time - self.start_time >= 0.1
    ...         yield self.v.at(self.final_time) == 0
    >>> bounce = gt.Phases(
    ...     {"fall": Fall(), "rise": Rise()},
    ...     free={"rise": ["v"]},
    ...     links={"rise": lambda before, after: [after.v == -0.8 * before.v]},
    ... )
    >>> found = gt.solve_phases(bounce, gt.Mesh(4))
    >>> rise = found.phases["rise"].trajectory
    >>> round(float(rise["q"][-1]), 4)  # 2 m * 0.8^2
    1.28
    """
    if not isinstance(model, Phases):
        raise ModelError(
            f"gt.solve_phases takes gt.Phases; found {type(model).__name__}. Use gt.solve for a single phase"
        )
    options = solver or SolverOptions()
    if options.solver != "ipopt":
        raise ModelError(f"linked phases need solver 'ipopt'; found '{options.solver}'")
    nlps: dict[str, Nlp] = {}
    for by_phase, what in ((mesh, "mesh"), (guess, "guess")):
        for name in by_phase if isinstance(by_phase, Mapping) else ():
            if name not in model.phases:
                raise ModelError(f"there is no phase '{name}' for a {what}; phases are {', '.join(model.phases)}")
    for name, phase in model.phases.items():
        phase_mesh = given_mesh(mesh.get(name) if isinstance(mesh, Mapping) else mesh)
        sides = model.sides.get(name, ())
        problem = build(phase, options.formulation, options.prefer, branches, linked=True, sides=sides)
        nlps[name] = make_nlp(problem, phase_mesh, options.compile)
        check_equalities(problem, nlps[name].element)
    joined = join(model, nlps)
    if guess is not None and not isinstance(guess, (PhasesSolution, Mapping)):
        raise ModelError(f"the guess must be trajectories by phase name, or an earlier solution; found {guess!r}")
    by_phase = guess.phases if isinstance(guess, PhasesSolution) else guess
    solution = _best_of(model, joined, [by_phase] if by_phase else model.guesses() or [{}], options, progress)
    if throw and not solution.status.converged:  # a failed check does not raise
        raise NotSolved(solution)
    return solution


def _best_of(
    model: Phases,
    joined: Joined,
    guesses: Sequence[Mapping[str, Trajectory | Solution]],
    options: SolverOptions,
    progress: Progress | None,
) -> PhasesSolution:
    """Solve from each guess and return the best solution.

    The starts are no map: each may use only the iterations and the time that those before it left.
    """
    stop_at = None if options.max_seconds is None else time.monotonic() + options.max_seconds
    solutions: list[PhasesSolution] = []
    reached = ReachedOptima()
    for guess in guesses:
        if solutions:
            seconds_left = None if stop_at is None else max(0.0, stop_at - time.monotonic())
            spent = options.max_iterations - solutions[-1].iterations
            options = replace(options, max_iterations=max(0, spent), max_seconds=seconds_left)
            if spent <= 0 or seconds_left == 0.0 or solutions[-1].status is SolveStatus.INTERRUPTED:
                break
        x0 = np.concatenate([initial_guess(nlp, guess.get(name)) for name, nlp in joined.nlps.items()])
        scale = objective_scale(joined, x0, [m for n in joined.nlps.values() for m in n.problem.misfits])
        solution = _read(model, joined, run_ipopt(joined, x0, options, progress, scale=scale), options, scale)
        solutions.append(solution)
        reached.add(solution.objective if solution.status.ok else None)
    best = max(solutions, key=lambda s: (s.status.ok, s.status.converged, -s.objective if s.status.ok else 0.0))
    iterations = sum(s.iterations for s in solutions)
    seconds = {name: sum(s.seconds[name] for s in solutions) for name in best.seconds}
    best = replace(best, iterations=iterations, seconds=seconds)
    if not best.status.ok or not (starts_message := reached.message(best.objective)):
        return best
    message = f"{best.message}; {starts_message}"
    return replace(best, message=message, phases={n: replace(s, message=message) for n, s in best.phases.items()})


def _read(model: Phases, joined: Joined, run: SolverRun, options: SolverOptions, scale: float) -> PhasesSolution:
    status = run.status
    remark = Remark(solved_word(run)) if status.ok else failure(run, [*_infinite(joined, run), _worst(joined, run)])
    if status.ok:
        for k, (name, nlp) in enumerate(joined.nlps.items()):
            if elsewhere := astray(nlp, run.x[joined.at[k] : joined.at[k + 1]]):
                status, remark = SolveStatus.FAILED, replace(elsewhere, text=f"phase '{name}': {elsewhere.text}")
                break
    message, where = str(remark), remark.where
    run = run.at_best()
    solutions = {}
    for k, (name, nlp) in enumerate(joined.nlps.items()):
        columns, rows = slice(joined.at[k], joined.at[k + 1]), slice(joined.rows[k], joined.rows[k + 1])
        x = run.x[columns]
        multipliers = Multipliers(run.multipliers.rows[rows], run.multipliers.bounds[columns])
        cost = float(nlp.nlp(x, [])[0])
        phase_run = replace(run, x=x, g=run.g[rows], objective=cost, multipliers=multipliers, status=status)
        solution = replace(read_solution(nlp, phase_run, status, message), linked=True, where=where)
        solutions[name] = judged(solution, options.error_bound, scale=scale)
    failed = [f"phase '{n}': {s.message}" for n, s in solutions.items() if s.status is not status]
    if failed:
        status, message = SolveStatus.CHECK_FAILED, "; ".join(failed)
        where = next(s.where for s in solutions.values() if s.status is status)
    if status.converged and (doubts := model.doubts(joined, run.x)):
        joint = ", but" if status.ok else ";"
        status, message = SolveStatus.CHECK_FAILED, f"{message}{joint} {'; '.join(doubts)}"
    if any(s.status is not status for s in solutions.values()):
        solutions = {n: replace(s, status=status, message=message, where=where) for n, s in solutions.items()}
    values = run.multipliers.rows[joined.rows[-1] :] / np.array([r.scale for r in joined.links])
    links = dict(zip((r.label for r in joined.links), values.tolist(), strict=True))
    return PhasesSolution(
        status, message, run.objective, run.iterations, solutions, links, run.seconds, joined, run.x,
        run.multipliers.rows, run.multipliers.bounds, where,
    )  # fmt: skip


def _infinite(joined: Joined, run: SolverRun) -> list[Remark]:
    parts = zip(joined.nlps.items(), joined.at[:-1], joined.at[1:], strict=True)
    texts = [(name, not_finite(nlp, run.x[a:b])) for (name, nlp), a, b in parts]
    return [replace(remark, text=f"phase '{name}': {remark.text}") for name, remark in texts if remark]


def _worst(joined: Joined, run: SolverRun) -> Remark:
    remarks: list[Remark] = []
    for row, amount in violated(joined.lbg, joined.ubg, run.g):
        k = int(np.searchsorted(joined.rows, row, side="right")) - 1
        if k >= len(joined.nlps):
            link = joined.links[row - joined.rows[-1]]
            remarks.append(Remark(f"{link.label} by {amount:.2g}", link.where))
            continue
        name, nlp = list(joined.nlps.items())[k]
        x = run.x[joined.at[k] : joined.at[k + 1]]
        remark = named_row(nlp, x, row - int(joined.rows[k]), amount)
        remarks.append(replace(remark, text=f"{name}: {remark.text}"))
    return worst_of(remarks)
