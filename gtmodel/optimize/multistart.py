"""Many starts and the distinct optima that they lead to; deterministic by seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..results.trajectory import Trajectory
from .nlp import Nlp
from .solution import Solution
from .solve import NotSolved, SolverOptions, solve_nlp
from .transcription import Transcription

WAVES = 3  # a perturbation is a sum of so many half waves over the horizon: smooth, as motions are
# optima are one where their costs and their states agree to this part
SAME_COST, SAME_PATH = 1e-5, 1e-3


@dataclass(frozen=True, eq=False)
class Optimum:
    """One of the optima found: how many starts led there, and how far its states are from the best one's (root mean
    square over the horizon, in nominals)."""

    solution: Solution
    count: int
    distance: float

    @property
    def objective(self) -> float:
        return self.solution.objective


@dataclass(frozen=True, eq=False)
class MultiStart:
    """Distinct optima, the best first; `failures` are the messages of the starts that led nowhere."""

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
    """Solve from the guess and from count - 1 perturbations of it.

    spread: size of the smooth random change of states and controls, as a part of the room between their bounds (of
    the nominal where there are none); free constants change by about this part. Raises NotSolved if no start arrives.
    """
    if count < 1 or not spread > 0:
        raise ValueError(f"multi_start takes at least one start and a positive spread; found {count} and {spread:g}")
    nlp = problem._with(parameters or {})
    first = problem.first_guess(nlp, guess)
    options = solver or problem.options
    found: list[tuple[Solution, int]] = []
    failures: list[Solution] = []
    for k in range(count):
        x0 = first if k == 0 else _perturbed(nlp, first, spread, np.random.default_rng([seed, k]))
        s = solve_nlp(nlp, x0, options, throw=False)
        if not s.status.ok:
            failures.append(s)
            continue
        for n, (other, times) in enumerate(found):
            close = abs(s.objective - other.objective) <= SAME_COST * max(abs(s.objective), abs(other.objective), 1e-12)
            if close and distance(s, other) <= SAME_PATH:
                found[n] = (min(s, other, key=lambda v: v.objective), times + 1)
                break
        else:
            found.append((s, 1))
    if not found:
        raise NotSolved(failures[0])
    found.sort(key=lambda pair: pair[0].objective)
    best = found[0][0]
    optima = tuple(Optimum(s, times, distance(s, best)) for s, times in found)
    return MultiStart(optima, tuple(s.message for s in failures), seed)


def distance(a: Solution, b: Solution) -> float:
    """Root mean square difference of the states over the horizon, in nominals; of two solutions on one mesh."""
    layout, end = a.nlp.element.layout, a.nlp.end
    columns = layout.x.ravel()
    xa, xb = (s.x[:end].reshape(-1, layout.size)[:, columns] for s in (a, b))
    return float(np.sqrt(np.mean((xa - xb) ** 2))) if columns.size else 0.0


def _perturbed(nlp: Nlp, x0: np.ndarray, spread: float, rng: np.random.Generator) -> np.ndarray:
    """A start some smooth waves away, within the bounds."""
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
    free = slice(nlp.constants, nlp.constants + len(nlp.problem.free_names))
    x[free] *= np.exp(spread * rng.standard_normal(len(nlp.problem.free_names)))
    return np.clip(x, nlp.lbx, nlp.ubx)
