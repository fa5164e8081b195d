"""Multi-start optimisation: distinct optima from perturbed guesses, reproducible by seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any, cast

import numpy as np

from .._pickling import Portable
from ..results.agreement import Within, agree
from ..results.trajectory import Trajectory
from ..workers.mapped import mapped
from .nlp import Nlp
from .solution import Solution
from .solve import NotSolved, SolverOptions, solve_nlp
from .transcription import Transcription

# relative difference below which two costs belong to the same optimum
SAME_COST = 1e-5


def local_optimum(here: int, starts: int) -> str:
    """Return the sentence on how many starts ended in an optimum.

    >>> local_optimum(3, 4)
    'local optimum; 3 of 4 starts ended here'
    """
    return f"local optimum; {here} of {starts} starts ended here"


@dataclass
class ReachedOptima(Portable):
    """Costs of the optima that successive starts ended in; None for a start that failed.

    repeated: number of the most recent starts without a new optimum.

    >>> reached = ReachedOptima()
    >>> for cost in (2.0, None, 1.0, 2.0, 2.0):
    ...     reached.add(cost)
    >>> reached.different, reached.repeated, reached.message(2.0)
    ([1.0, 2.0], 2, 'local optimum; 3 of 5 starts ended here')
    """

    costs: list[float | None] = field(default_factory=list)
    repeated: int = 0

    def add(self, cost: float | None) -> None:
        new = cost is not None and not self.ended_at(cost)
        self.repeated = 0 if new else self.repeated + 1
        self.costs.append(cost)

    def ended_at(self, cost: float) -> int:
        """Return the number of starts that ended at this cost."""
        return sum(c is not None and abs(c - cost) <= SAME_COST * max(abs(c), abs(cost)) for c in self.costs)

    @property
    def different(self) -> list[float]:
        """Costs of the different optima, best first."""
        optima: list[float] = []
        for cost in sorted(c for c in self.costs if c is not None):
            if not optima or cost - optima[-1] > SAME_COST * max(abs(cost), abs(optima[-1])):
                optima.append(cost)
        return optima

    def message(self, cost: float) -> str:
        """Return the message for the optimum with this cost; empty after a single start."""
        return local_optimum(self.ended_at(cost), len(self.costs)) if len(self.costs) > 1 else ""


WAVES = 3  # a perturbation is a sum of this many half waves over the horizon, so it is smooth
# two optima are the same if their costs, states, constants and controls agree within these tolerances; the cost
# determines controls less sharply than states
SAME_PATH, SAME_CONTROL = 1e-3, 1e-2
NOTHING = 1e-3  # constants smaller than this share of their range are compared on that scale


@dataclass(frozen=True, eq=False)
class Optimum:
    """One of the optima that `multi_start` found.

    count: number of starts that ended here. distance: from the best optimum; the largest of the RMS differences of
    states and of controls over the horizon, in nominals, and of the relative differences of free constants.
    """

    solution: Solution
    count: int
    distance: float

    @property
    def objective(self) -> float:
        return self.solution.objective


@dataclass(frozen=True, eq=False)
class MultiStart(Portable):
    """Result of `multi_start`: distinct optima, best first; each message says how many starts ended there.

    `failures`: messages of the starts that failed. Printing the object shows a table.
    """

    optima: tuple[Optimum, ...]
    failures: tuple[str, ...]
    seed: int

    @property
    def best(self) -> Solution:
        return self.optima[0].solution

    @property
    def starts(self) -> int:
        return sum(o.count for o in self.optima) + len(self.failures)

    def __str__(self) -> str:
        lines = ["optimum  cost            starts  distance"]
        lines += [
            f"{n:7d}  {o.objective:<14.8g}  {o.count:6d}  {o.distance:8.3g}" for n, o in enumerate(self.optima, 1)
        ]
        return "\n".join([*lines, f"{len(self.failures)} of {self.starts} starts failed; seed {self.seed}"])


def multi_start(
    problem: Transcription,
    count: int,
    *,
    seed: int = 0,
    spread: float = 0.3,
    parameters: Mapping[str, Any] | None = None,
    guess: Trajectory | Solution | None = None,
    solver: SolverOptions | None = None,
) -> MultiStart:
    """Solve from the guess and from count - 1 random perturbations of it to look for other optima.

    Args:
        problem: the result of `transcribe`.
        count: number of starts.
        seed: seed of the perturbations.
        spread: size of the smooth random perturbation of states and controls, relative to the range between their
            bounds (to the nominal if unbounded). Free constants change by about this share of their value; of the range
            between their bounds if these have opposite signs; of 1 if the guess is 0.
        parameters: values by name, as for `Transcription.solve`. guess, solver: as for `solve`.

    Raises NotSolved if every start fails, and ArgumentError for a count below one or a spread that is not positive.

    >>> class Wells(gt.Optimization):  # two places to rest, x = -1 and x = 1; the right one costs less
    ...     x = gt.free(-0.2, min=-2.0, max=2.0)
    ...     y = gt.variable(start=0.0, fixed=True)
    ...     def equations(self):
    ...         yield gt.der(self.y) == (self.x**2 - 1.0) ** 2 - 0.1 * self.x
    ...     def objective(self):
    ...         return self.y.at(self.final_time)
    >>> found = gt.multi_start(gt.transcribe(Wells(), gt.Mesh(1, 1)), 6)
    >>> [round(optimum.solution.free["x"], 2) for optimum in found.optima]
    [1.01, -0.99]
    """
    agree(count, Annotated[int, Within(least=1)], "count")
    agree(seed, Annotated[int, Within(least=0)], "seed")
    agree(spread, Annotated[float, Within(above=0.0)], "spread")
    nlp = problem._with(parameters or {})
    first = problem.first_guess(nlp, guess)
    options = solver or problem.options
    # absolute scale for comparing costs, needed if the optimal cost is 0
    floor = abs(float(nlp.nlp(first, [])[0]))
    floor = floor if np.isfinite(floor) else 0.0
    distinct: list[tuple[Solution, int]] = []
    failures: list[Solution] = []
    for solution in mapped(partial(_from_start, nlp, first, spread, seed, options), range(count)):
        s = replace(solution, nlp=nlp)
        if not s.status.converged:
            failures.append(s)
            continue
        for n, (known, times) in enumerate(distinct):
            close = abs(s.objective - known.objective) <= SAME_COST * max(abs(s.objective), abs(known.objective), floor)
            states, controls, constants = _distances(s, known)
            if close and max(states, constants) <= SAME_PATH and controls <= SAME_CONTROL:
                distinct[n] = (min(s, known, key=lambda v: v.objective), times + 1)
                break
        else:
            distinct.append((s, 1))
    if not distinct:
        raise NotSolved(failures[0])
    distinct.sort(key=lambda pair: pair[0].objective)
    best = distinct[0][0]
    optima = tuple(Optimum(_with_count(s, times, count), times, distance(s, best)) for s, times in distinct)
    return MultiStart(optima, tuple(s.message for s in failures), seed)


def _from_start(
    nlp: Nlp, first: np.ndarray, spread: float, seed: int, options: SolverOptions, k: int
) -> Solution:  # fmt: skip
    """Solve from start k; the solution comes without its NLP, which all starts share."""
    x0 = first if k == 0 else _perturbed(nlp, first, spread, np.random.default_rng([seed, k]))
    return replace(solve_nlp(nlp, x0, options, throw=False), nlp=cast(Nlp, None))


def _with_count(solution: Solution, count: int, starts: int) -> Solution:
    """Append to the message how many of the starts ended there."""
    message = f"{solution.message}; {local_optimum(count, starts)}"
    return replace(solution, message=message) if starts > 1 else solution


def distance(a: Solution, b: Solution) -> float:
    """Return the distance of two solutions on one mesh: the largest of the RMS differences over the horizon of states
    and of controls, in nominals, and of the relative difference of a free constant."""
    return max(_distances(a, b))


def _distances(a: Solution, b: Solution) -> tuple[float, float, float]:
    """Return the distances of states, of controls and of free constants."""
    nlp, layout = a.nlp, a.nlp.element.layout
    ya, yb = (s.x[: nlp.end].reshape(-1, layout.size) for s in (a, b))
    each = []
    for columns in (layout.x.ravel(), layout.u.ravel()):
        each.append(float(np.sqrt(np.mean((ya - yb)[:, columns] ** 2))) if columns.size else 0.0)
    free = nlp.free
    pa, pb, room = a.x[free], b.x[free], _room(nlp, free, np.maximum(np.abs(a.x[free]), np.abs(b.x[free])))
    size = np.maximum(np.maximum(np.abs(pa), np.abs(pb)), NOTHING * room)
    return each[0], each[1], float(np.max(np.abs(pa - pb) / size, initial=0.0))


def _room(nlp: Nlp, free: slice, size: np.ndarray) -> np.ndarray:
    """Return the range between the bounds of free constants, else their size, else 1."""
    room = nlp.ubx[free] - nlp.lbx[free]
    return np.where(np.isfinite(room) & (room > 0), room, np.where(size > 0, size, 1.0))


def _perturbed(nlp: Nlp, x0: np.ndarray, spread: float, rng: np.random.Generator) -> np.ndarray:
    """Return the start plus smooth random waves, clipped to the bounds."""
    mesh, layout = nlp.mesh, nlp.element.layout
    x = x0.copy()
    blocks = x[: nlp.end].reshape(mesh.elements, layout.size)
    left, points = mesh.edges[:-1], mesh.edges[:-1, None] + mesh.h[:, None] * mesh.table.points
    places = mesh.edges[:-1, None] + mesh.h[:, None] * np.linspace(0.0, 1.0, len(layout.u))

    def wave(low: float, high: float) -> Any:
        size = spread * (high - low if np.isfinite(high - low) else 1.0)
        a, phase = rng.standard_normal(WAVES), rng.uniform(0.0, 2 * np.pi, WAVES)
        return lambda s: size * sum(a[j] * np.sin(np.pi * (j + 1) * s + phase[j]) for j in range(WAVES))

    for j in range(layout.nx):
        column = int(layout.x[0, j])
        f = wave(nlp.lbx[column], nlp.ubx[column])
        blocks[:, layout.left[j]] += f(left)
        blocks[:, layout.x[:, j]] += f(points)
        x[nlp.end + j] += f(1.0)
    for j in range(layout.nu):
        column = int(layout.u[-1, j])
        f = wave(nlp.lbx[column], nlp.ubx[column])
        blocks[:, layout.u[:, j]] += f(places)
    free = nlp.free
    low, high, p, change = nlp.lbx[free], nlp.ubx[free], x[free], spread * rng.standard_normal(len(x[free]))
    # a factor can change neither a sign nor a zero
    added = (p == 0.0) | ((low < 0) & (high > 0) & np.isfinite(high - low))
    x[free] = np.where(added, p + change * _room(nlp, free, np.abs(p)), p * np.exp(change))
    return np.clip(x, nlp.lbx, nlp.ubx)
