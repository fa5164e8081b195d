"""Initial guesses: from a trajectory by name, from an earlier solution, or from start attributes."""

from __future__ import annotations

import numpy as np

from ..lang.source import ModelError
from ..results.trajectory import Trajectory
from .nlp import Nlp
from .solution import Solution


def initial_guess(nlp: Nlp, guess: Trajectory | Solution | None) -> np.ndarray:
    """Scaled unknowns. A trajectory is stretched over the horizon of the free constants' guesses.

    Raises ModelError if a trajectory holds none of the states.
    """
    problem, mesh, layout = nlp.problem, nlp.mesh, nlp.element.layout
    free = problem.P_guess.copy()
    if isinstance(guess, Solution):
        for n, name in enumerate(problem.free_names):
            free[n] = guess.free.get(name, free[n])
        guess = guess.trajectory
    flat = problem.flat
    own = len(problem.state_pairs)
    x_default = np.array([_start(flat, i, k) for i, k in problem.state_pairs] + [0.0] * (layout.nx - own))
    u_default = np.array([_start(flat, i, 0) for i in problem.control_indices])
    x_default = np.clip(x_default, problem.x_bounds.low, problem.x_bounds.high)
    u_default = np.clip(u_default, problem.u_bounds.low, problem.u_bounds.high)
    values = np.zeros(nlp.size)
    n, N = layout.size, mesh.elements
    columns = list(zip(problem.state_names, x_default, strict=True)), list(
        zip(problem.control_names, u_default, strict=True)
    )
    series = [[_series(guess, name, default) for name, default in group] for group in columns]
    if guess is not None and not any(found for _, found in series[0]):
        raise ModelError(f"the guess holds none of the states {', '.join(problem.state_names)}")
    for k in range(N):
        s = mesh.edges[k] + mesh.h[k] * mesh.table.nodes
        block = np.zeros(n)
        for j, (f, _) in enumerate(series[0]):
            at = f(s)
            block[layout.left[j]] = at[0]
            block[layout.x[:, j]] = at[1:]
        for j, (f, _) in enumerate(series[1]):
            block[layout.u[:, j]] = f(s[1:]) if mesh.control == "polynomial" else f(s).mean()
        values[k * n : (k + 1) * n] = block / layout.scale
    values[N * n : N * n + layout.nx] = [f(np.array([1.0]))[0] for f, _ in series[0]] / problem.x_scale
    values[N * n + layout.nx :] = free / nlp.p_scale
    return values


def _start(flat: object, index: int, order: int) -> float:
    v = flat.variables[index]  # type: ignore[attr-defined]
    return float(v.start) if order == 0 and v.start is not None else 0.0


def _series(guess: Trajectory | None, name: str, default: float):
    """s in [0, 1] -> values, and whether the guess holds the name."""
    values = None if guess is None else _column(guess, name)
    if guess is None or values is None:
        return (lambda s: np.full(len(s), default)), False
    t = (guess.time - guess.time[0]) / guess.duration
    return (lambda s: np.interp(s, t, values)), True


def _column(guess: Trajectory, name: str) -> np.ndarray | None:
    """A scalar by its name: `der(robot.T[0])` is also found as column 0 of `der(robot.T)`."""
    if name in guess and np.ndim(guess[name]) == 1:
        return guess[name]
    head, bracket, tail = name.rpartition("[")
    if not bracket:
        return None
    index, _, closing = tail.partition("]")
    vector = head + closing
    if index.isdigit() and vector in guess and np.ndim(guess[vector]) == 2:
        return guess[vector][:, int(index)]
    return None
