"""Initial guesses from a trajectory, an earlier solution, or start attributes."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from ..compiler.evaluate import build as functions_of
from ..lang.source import ModelError
from ..lang.units import parse_unit
from ..results.trajectory import Trajectory
from .formulation.dynamic import DynamicProblem
from .formulation.horizon import names_of, start_of
from .mesh import control_basis
from .nlp import Nlp
from .solution import Solution

Series = Callable[[np.ndarray], np.ndarray]


def initial_guess(nlp: Nlp, guess: Trajectory | Solution | None) -> np.ndarray:
    """Return scaled unknowns from a guess.

    A trajectory is stretched over the horizon; its start and end times are the guess of free ones. States and controls
    are looked up under all their aliases. Algebraic variables missing from the guess are solved from its states and
    inputs if possible. Raises ModelError if a trajectory contains none of the states, or a signal whose unit has
    another dimension than the model's; a signal with unit "1" is not checked.
    """
    problem, mesh, layout = nlp.problem, nlp.mesh, nlp.element.layout
    if guess is not None and not isinstance(guess, (Trajectory, Solution)):
        raise ModelError(f"the guess must be a gt.Trajectory or an earlier solution; found {guess!r}")
    free = problem.P_guess.copy()
    first_fraction = 0.0
    if isinstance(guess, Solution):
        time = guess.trajectory.time
        first_fraction = (time[1] - time[0]) / (time[-1] - time[0]) if len(time) > 1 else 0.0
        for n, name in enumerate(problem.free_names):
            free[n] = guess.free.get(name, free[n])
        guess = guess.trajectory
    elif guess is not None and guess.duration > 0:
        for end, time in ((problem.t0, guess.time[0]), (problem.tf, guess.time[-1])):
            if end.is_symbolic() and end.name() in problem.free_names:
                free[problem.free_names.index(end.name())] = time
    free = np.clip(free, problem.P_bounds.low, problem.P_bounds.high)
    flat, alias = problem.flat, problem.base.alias
    if guess is not None:
        for pair in (*problem.state_pairs, *problem.input_pairs):
            _same_unit(guess, names_of(flat, alias, pair), flat.unit_of(*pair))
    states = [_series(guess, names_of(flat, alias, p), start_of(flat, alias, p)) for p in problem.state_pairs]
    if guess is not None and states and not any(in_guess for _, in_guess in states):
        raise ModelError(f"the guess contains none of the states {', '.join(problem.state_names)}")
    states += [_series(None, [], 0.0)] * (layout.nx - len(states))
    inputs = [_series(guess, names_of(flat, alias, p), start_of(flat, alias, p)) for p in problem.input_pairs]
    x, u = problem.x_bounds, problem.u_bounds
    N, table = mesh.elements, mesh.table
    s = mesh.edges[:-1, None] + mesh.h[:, None] * table.nodes  # (N, K + 1)
    xs = np.stack([np.clip(f(s.ravel()), x.low[j], x.high[j]) for j, (f, _) in enumerate(states)], -1) if states else (
        np.zeros((s.size, 0)))  # fmt: skip
    xs = xs.reshape(*s.shape, layout.nx)
    s_at = s[:, 1:].ravel()
    us = np.stack([f(s_at) for f, _ in inputs], -1) if inputs else np.zeros((s_at.size, 0))
    if first_fraction:  # point variables have no value at the start: hold the first one
        for n in range(layout.nu, us.shape[1]):
            us[:, n] = inputs[n][0](np.maximum(s_at, first_fraction))
    missing = [n for n, (_, in_guess) in enumerate(inputs) if n >= layout.nu and not in_guess]
    known = layout.nu + len(problem.delayed)
    if any(n >= known for n in missing):
        x_rows = xs[:, 1:].reshape(s_at.size, layout.nx)[:, : len(problem.state_pairs)]
        solved = solve_point_variables(
            problem, x_rows, np.clip(us[:, :known], u.low[:known], u.high[:known]), free, s_at
        )
        for n in missing:
            if n >= known:
                us[:, n] = np.where(np.isfinite(solved[:, n - known]), solved[:, n - known], us[:, n])
    us = np.clip(us, u.low, u.high).reshape(N, mesh.points, -1)
    values = np.zeros(nlp.size)
    rows = values[: nlp.end].reshape(N, layout.size)
    rows[:, layout.left[: layout.nx]] = xs[:, 0]
    rows[:, layout.x.ravel()] = xs[:, 1:].reshape(N, -1)
    rows[:, layout.z.ravel()] = us[:, :, layout.nu :].reshape(N, -1)
    if mesh.control == "polynomial":  # the coefficients are the values at the points
        rows[:, layout.u] = us[:, :, : layout.nu]
    else:
        for k in range(N):
            c = _coefficients(nlp, us[k, :, : layout.nu], [f for f, _ in inputs[: layout.nu]], k)
            rows[k, layout.u] = np.clip(c, u.low[: layout.nu], u.high[: layout.nu])
    for j, block in layout.blocks.items():
        edges = mesh.edges[np.concatenate([[0], np.cumsum(block.sizes)])]
        means = [
            inputs[j][0](np.linspace(a, b, 2 * size + 1)).mean()
            for a, b, size in zip(edges[:-1], edges[1:], block.sizes, strict=True)
        ]
        rows[:, layout.u[0, j]] = np.clip(np.repeat(means, block.sizes), u.low[j], u.high[j])
    end = np.zeros(layout.nl)
    ends = np.array([f(np.array([1.0]))[0] for f, _ in states])
    end[: layout.nx] = np.clip(ends, x.low, x.high)
    end_scale = layout.scale[layout.left]
    if layout.carried.size:
        end[layout.carried] = rows[-1, layout.u[-1, layout.carries]]
    if layout.h >= 0:
        rows[:, layout.edge], rows[:, layout.h], end[-1] = mesh.edges[:-1], mesh.h, 1.0
    rows /= layout.scale
    values[nlp.end : nlp.constants] = end / end_scale
    values[nlp.constants :] = free / nlp.p_scale
    return values


def _coefficients(nlp: Nlp, at_points: np.ndarray, series: list[Series], k: int) -> np.ndarray:
    """Return control coefficients (m, nu) of element k from values at its points or ends."""
    mesh = nlp.mesh
    if mesh.control == "constant":
        return at_points.mean(axis=0, keepdims=True)
    if mesh.control == "linear":
        ends = mesh.edges[k : k + 2]
        return np.array([f(ends) for f in series]).reshape(len(series), 2).T
    return np.linalg.solve(control_basis(mesh.control, mesh.table, mesh.table.points), at_points)


def solve_point_variables(
    problem: DynamicProblem, x: np.ndarray, u: np.ndarray, free: np.ndarray, s: np.ndarray
) -> np.ndarray:
    """Solve the algebraic variables (n, nz) for rows of states and inputs; NaN where the solution fails."""
    flat, plan = problem.flat, problem.base
    inputs = [("x", problem.state_pairs), ("u", problem.input_pairs[: u.shape[1]])]
    built = functions_of(plan, inputs, [("z", problem.z_pairs)], "point_variables", parametric=True)
    p = flat.p0.copy()
    names = [q.name for q in flat.parameters]
    for name, value in zip((*problem.free_names, *problem.tunable), free, strict=True):
        p[names.index(name)] = value
    t0, tf = (float(v) for v in ca.Function("ends", [problem.P], [problem.t0, problem.tf])(free))
    n = len(s)
    arguments = (
        [x.T, u.T] + ([(t0 + s * (tf - t0))[None, :]] if plan.uses_time else []) + [np.repeat(p[:, None], n, axis=1)]
    )
    unknowns: list[np.ndarray] = []
    with np.errstate(all="ignore"):
        for kernel in built.kernels:
            unknowns.append(kernel.solve(np.vstack([*arguments, *unknowns]))[0])
        value = built.closed.map(n).call([ca.DM(a) for a in (*arguments, *unknowns)])[0]
    return np.asarray(value.full()).reshape(len(problem.z_pairs), n).T


def _series(guess: Trajectory | None, names: list[tuple[str, int]], default: float) -> tuple[Series, bool]:
    """Return a function s in [0, 1] -> values, and whether the guess contains one of the names."""
    for name, sign in names:
        values = None if guess is None else _column(guess, name)
        if guess is not None and values is not None:
            t = (guess.time - guess.time[0]) / (guess.duration or 1.0)
            return (lambda s: sign * np.interp(s, t, values)), True  # noqa: B023
    return (lambda s: np.full(len(s), default)), False


def _same_unit(guess: Trajectory, names: list[tuple[str, int]], unit: str) -> None:
    """Raise ModelError if the unit of the signal that `_series` takes has another dimension."""
    name = next((name for name, _ in names if _column(guess, name) is not None), None)
    if name is None or unit == "?":
        return
    head, _, tail = name.rpartition("[")
    guess_unit = guess.unit(name if name in guess else head + tail.partition("]")[2])
    if guess_unit != "1" and parse_unit(guess_unit).dimension != parse_unit(unit).dimension:
        raise ModelError(f"the guess has {name} in {guess_unit}, but the model has it in {unit}; convert the guess")


def _column(guess: Trajectory, name: str) -> np.ndarray | None:
    """Look up a scalar by name; `der(robot.T[0])` is also column 0 of `der(robot.T)`."""
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
