"""A transcribed problem for repeated solves: other parameters, warm starts, continuation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..compiler.causal import flat_of
from ..compiler.flat import FlatModel, flatten
from ..lang.declarations import Parameter
from ..lang.optimization import Optimization
from ..lang.source import ModelError
from ..results.trajectory import Trajectory
from .formulation.dynamic import DynamicProblem
from .formulation.horizon import require_order
from .formulation.problem import build
from .guess import initial_guess
from .judgement.checks import check_equalities
from .mesh import Mesh, given_mesh
from .nlp import Nlp, make_nlp
from .solution import Solution
from .solve import NotSolved, SolverOptions, scaled_by, solve_nlp
from .watch import Multipliers, Progress

ATTRIBUTES = ("nominal", "min", "max", "start", "fixed")
HALVINGS = 4  # how often a continuation step is halved before giving up


@dataclass(frozen=True, eq=False)
class Continuation(Portable):
    """Result of `Transcription.continuation`: (parameters, solution) of each step in order, halved steps included.

    `message`: where and why the continuation stopped early; else empty.
    """

    steps: tuple[tuple[dict[str, Any], Solution], ...]
    message: str = ""

    @property
    def solution(self) -> Solution:
        """The last solution."""
        return self.steps[-1][1]

    @property
    def iterations(self) -> int:
        return sum(s.iterations for _, s in self.steps)

    def __str__(self) -> str:
        lines = ["step  iterations  objective       parameters"]
        for n, (values, s) in enumerate(self.steps, 1):
            assignments = ", ".join(f"{k} = {np.array2string(np.asarray(v), precision=6)}" for k, v in values.items())
            lines.append(f"{n:4d}  {s.iterations:10d}  {s.objective:<14.8g}  {assignments}")
        return "\n".join([*lines, *([self.message] if self.message else [])])


class Transcription(Portable):
    """A model transcribed on a mesh by `transcribe`, with its derivatives, for repeated solves.

    `solve` takes one set of parameters; `continuation` takes a sequence and starts each solve from the last solution.
    """

    def __init__(self, model: Optimization, nlp: Nlp, names: Mapping[str, list[str]], options: SolverOptions) -> None:
        self.model, self.nlp, self.options = model, nlp, options
        self._names = names

    @property
    def problem(self) -> DynamicProblem:
        return self.nlp.problem

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that solve() accepts."""
        return tuple(self._names)

    def solve(
        self,
        parameters: Mapping[str, Any] | None = None,
        *,
        guess: Trajectory | Solution | None = None,
        start: Solution | None = None,
        solver: SolverOptions | None = None,
        progress: Progress | None = None,
        throw: bool = True,
    ) -> Solution:
        """Solve with other values of parameters, without building anything again.

        Args:
            parameters: values in SI units by name; the others keep the model's values.
            guess: as for gt.solve.
            start: a solution for a warm start; its multipliers are used if it comes from this transcription.

        Raises ModelError for an unknown name, an invalid value, or a value that changes attributes such as bounds, and
        NotSolved unless throw is False.
        """
        nlp = self._with(parameters or {})
        if guess is not None and start is not None:
            raise ValueError("solve() takes a guess or a start, not both")
        warm = None
        if start is not None and start.nlp.functions is self.nlp.functions:
            x0, warm = start.x.copy(), Multipliers(start.multipliers, start.bound_multipliers)
            x0[nlp.free.stop :] = nlp.lbx[nlp.free.stop :]
        else:
            x0 = self.first_guess(nlp, guess if start is None else start)
        return solve_nlp(nlp, x0, solver or self.options, progress, throw, warm)

    def first_guess(self, nlp: Nlp, guess: Trajectory | Solution | None) -> np.ndarray:
        """Return scaled unknowns from a guess, with the parameters of the NLP."""
        x0 = initial_guess(nlp, guess)
        x0[nlp.free.stop :] = nlp.lbx[nlp.free.stop :]
        return x0

    def continuation(
        self,
        steps: Sequence[Mapping[str, Any]],
        *,
        guess: Trajectory | Solution | None = None,
        start: Solution | None = None,
        solver: SolverOptions | None = None,
        throw: bool = True,
    ) -> Continuation:
        """Solve for a sequence of parameter sets, each from the last solution.

        A failed step is halved, up to four times, between the last successful parameters and the requested ones. A
        solution that the mesh does not resolve (status check_failed) counts as a success. Raises NotSolved if halving
        does not help, unless throw is False, and ModelError as solve() does.
        """
        solved: list[tuple[dict[str, Any], Solution]] = []
        todo = [(dict(s), HALVINGS) for s in reversed(steps)]
        if not todo:
            raise ValueError("a continuation takes at least one set of parameters")
        while todo:
            values, halvings = todo.pop()
            values = {**(solved[-1][0] if solved else {}), **values}
            s = self.solve(values, guess=guess, start=start, solver=solver, throw=False)
            if s.status.converged:
                solved.append((values, s))
                guess, start = None, s
                continue
            if not solved or halvings == 0:
                assignments = ", ".join(f"{k} = {v}" for k, v in values.items())
                message = f"the continuation stopped before {assignments}: {s.message}"
                if throw:
                    raise NotSolved(replace(s, message=message))
                return Continuation((*solved, (values, s)), message)
            last = solved[-1][0]
            middle = {k: (np.asarray(last.get(k, self._default(k))) + np.asarray(v)) / 2 for k, v in values.items()}
            todo += [(values, halvings - 1), (middle, halvings - 1)]
        return Continuation(tuple(solved))

    def _default(self, name: str) -> np.ndarray:
        values = {q.name: q.value for q in self.problem.flat.parameters}
        default = np.array([values[n] for n in self._names[name]])
        return default if len(default) > 1 else default[0]

    def _with(self, parameters: Mapping[str, Any]) -> Nlp:
        """Return the NLP with other values of the tunable parameters."""
        nlp, problem = self.nlp, self.problem
        if not parameters:
            return nlp
        for name in parameters:
            if name not in self._names:
                raise ModelError(
                    f"{problem.flat.title} was transcribed with parameters {', '.join(self._names) or 'none'}; found "
                    f"'{name}'"
                )
        changed = flatten(self.model.with_(**parameters))
        changed.require_values()
        self._check_attributes(changed, ", ".join(parameters))
        values = {q.name: q.value for q in changed.parameters}
        symbols, numbers = problem.P[len(problem.free_names) :], ca.SX([values[n] for n in problem.tunable])
        require_order(problem.flat.title, *ca.substitute([problem.t0, problem.tf], [symbols], [numbers]))
        low, high = nlp.lbx.copy(), nlp.ubx.copy()
        low[nlp.free.stop :] = high[nlp.free.stop :] = [values[n] for n in problem.tunable] / nlp.p_scale[
            len(problem.free_names) :
        ]
        return replace(nlp, lbx=low, ubx=high)

    def _check_attributes(self, changed: FlatModel, names: str) -> None:
        for old, new in zip(self.problem.flat.variables, changed.variables, strict=True):
            for name in ATTRIBUTES:
                if name == "start" and new.start is None:
                    continue  # of a joint in a loop, whose start is that of the assembled position
                if getattr(old, name) != getattr(new, name):
                    raise ModelError(
                        f"{name} of '{old.name}' depends on {names}, but transcribe() fixes attributes; write it as a "
                        "constraint in constraints(), or transcribe the changed model",
                        old.where,
                    )


def transcribe(
    model: Optimization,
    mesh: Mesh | None = None,
    *,
    parameters: Sequence[str] | None = None,
    scaling: Trajectory | Solution | None = None,
    branches: Mapping[str, int] | None = None,
    solver: SolverOptions | None = None,
) -> Transcription:
    """Transcribe a model once, to solve it for many values of its parameters.

    Args:
        mesh: as for `solve`.
        parameters: names of parameters, declared in the model's own class, that may change between solves; default all.
            The values of all others are folded into the equations.
        scaling, branches, solver: as for `solve`.

    Returns a `Transcription`; its `solve({"name": value})` builds nothing again. Raises ModelError for a wrong model or
    an unknown name.

    >>> class Fastest(gt.Optimization):
    ...     limit = gt.parameter(1.0, positive=True)
    ...     final_time = gt.free(1.0, min=0.1, unit="s")
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     u = gt.input()
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.u
    ...     def objective(self):
    ...         return self.final_time
    ...     def constraints(self):
    ...         yield self.x.at(self.final_time) == 0
    ...         yield gt.between(-self.limit, self.u, self.limit)
    >>> problem = gt.transcribe(Fastest(), gt.Mesh(3))
    >>> [round(problem.solve({"limit": value}).final_time, 4) for value in (1.0, 2.0, 4.0)]
    [1.0, 0.5, 0.25]
    """
    flat, options = flat_of(model), solver or SolverOptions()
    known = [n for n, item in type(model)._declared.items() if isinstance(item, Parameter)]
    names: dict[str, list[str]] = {}
    for name in known if parameters is None else parameters:
        if name not in known:
            raise ModelError(f"{flat.title} declares no parameter '{name}'; it declares {', '.join(known) or 'none'}")
        elements = [q.name for q in flat.parameters if q.name == name or q.name.startswith(f"{name}[")]
        if elements:  # a parameter bound to others has no symbol of its own
            names[name] = elements
    tunable = tuple(e for n in names.values() for e in n)
    problem = build(model, options.formulation, options.prefer, branches, tunable, scaled_by(scaling))
    nlp = make_nlp(problem, given_mesh(mesh), options.compile)
    check_equalities(problem, nlp.element)
    return Transcription(model, nlp, names, options)
