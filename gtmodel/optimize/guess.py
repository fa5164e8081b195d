"""Initial guesses: from a trajectory by name, from an earlier solution, or from start attributes."""

from __future__ import annotations

import numpy as np

from ..lang.source import ModelError
from ..results.trajectory import Trajectory
from .attributes import names_of, start_of
from .nlp import Nlp
from .solution import Solution


def initial_guess(nlp: Nlp, guess: Trajectory | Solution | None) -> np.ndarray:
    """Scaled unknowns. A trajectory's time span is the guess of a free horizon; it is stretched over the horizon.

    States and controls are found under any of their names. Raises ModelError if a trajectory holds none of
    the states.
    """
    problem, mesh, layout = nlp.problem, nlp.mesh, nlp.element.layout
    free = problem.P_guess.copy()
    if isinstance(guess, Solution):
        for n, name in enumerate(problem.free_names):
            free[n] = guess.free.get(name, free[n])
        guess = guess.trajectory
    elif guess is not None and guess.duration > 0:
        for name, time in (("start_time", guess.time[0]), ("final_time", guess.time[-1])):
            if name in problem.free_names:
                free[problem.free_names.index(name)] = time
    free = np.clip(free, problem.P_bounds.low, problem.P_bounds.high)
    flat, alias = problem.flat, problem.base.alias
    states = [_series(guess, names_of(flat, alias, p), start_of(flat, alias, p)) for p in problem.state_pairs]
    if guess is not None and states and not any(found for _, found in states):
        raise ModelError(f"the guess holds none of the states {', '.join(problem.state_names)}")
    states += [_series(None, [], 0.0)] * (layout.nx - len(states))
    pairs = [(i, 0) for i in problem.control_indices]
    controls = [_series(guess, names_of(flat, alias, p), start_of(flat, alias, p)) for p in pairs]
    x_low, x_high, u_low, u_high = (
        b for bounds in (problem.x_bounds, problem.u_bounds) for b in (bounds.low, bounds.high)
    )
    values = np.zeros(nlp.size)
    n, N = layout.size, mesh.elements
    for k in range(N):
        s = mesh.edges[k] + mesh.h[k] * mesh.table.nodes
        block = np.zeros(n)
        for j, (f, _) in enumerate(states):
            at = np.clip(f(s), x_low[j], x_high[j])
            block[layout.left[j]] = at[0]
            block[layout.x[:, j]] = at[1:]
        for j, (f, _) in enumerate(controls):
            at = f(s[1:]) if mesh.control == "polynomial" else np.full(mesh.points, f(s).mean())
            block[layout.u[:, j]] = np.clip(at, u_low[j], u_high[j])
        values[k * n : (k + 1) * n] = block / layout.scale
    end = np.array([f(np.array([1.0]))[0] for f, _ in states])
    values[N * n : N * n + layout.nx] = np.clip(end, x_low, x_high) / problem.x_scale
    values[N * n + layout.nx :] = free / nlp.p_scale
    return values


def _series(guess: Trajectory | None, names: list[tuple[str, int]], default: float):
    """s in [0, 1] -> values, and whether the guess holds one of the names."""
    for name, sign in names:
        values = None if guess is None else _column(guess, name)
        if guess is not None and values is not None:
            t = (guess.time - guess.time[0]) / (guess.duration or 1.0)
            return (lambda s: sign * np.interp(s, t, values)), True  # noqa: B023
    return (lambda s: np.full(len(s), default)), False


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
