"""Effect of a small change of each parameter on poses and cost (Dressler 2012, eq. (5.8)), also as a table; and poses
of a robot whose parameters differ from pose to pose."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..compiler.flat import FlatModel
from ..compiler.rows import map_columns
from ..geometry.quaternions import turned
from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.source import ModelError
from ..results.table import csv_text
from .measurements import Measurements
from .options import Choice
from .positioning import pose_jacobians
from .problem import CalibrationProblem, prepare


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Sums over all poses of the changes when `step` is added to and subtracted from each unknown.

    `pose`: signal -> (n,), of positions [m], of quaternions the angle of rotation [rad]; `cost` (n,): of the squared
    closures of (5.1) [m^4].
    """

    names: tuple[str, ...]
    step: float
    pose: dict[str, np.ndarray]
    cost: np.ndarray


def sensitivity(problem: CalibrationProblem, x: np.ndarray, step: float = 5e-5) -> Sensitivity:
    """Sensitivity at the unknowns x, on the measured poses; poses to first order in the step, the cost exactly.

    The thesis uses ZYZ angles, whose sum depends on the frame; here it is the angle of rotation. Raises ModelError if
    the closure equations do not determine the pose, or if it is singular.
    """
    position = next((n for n in problem.reading.places if n != problem.actuators), "T")
    moves = pose_jacobians(problem, position, x)
    sums = {n: 2 * np.sum(np.linalg.norm(step * jacobian, axis=1), axis=0) for n, jacobian in moves.items()}
    return Sensitivity(problem.unknowns.names, step, sums, _cost_changes(problem, x, step))


def _cost_changes(problem: CalibrationProblem, x: np.ndarray, step: float) -> np.ndarray:
    data = problem.reading.data
    changes = np.zeros(len(x))
    for b in problem.squared:
        before = np.sum(b.evaluate(data, x[b.columns])[0] ** 2, axis=1)
        for k in b.columns:
            for sign in (1.0, -1.0):
                shifted = x.copy()
                shifted[k] += sign * step
                after = np.sum(b.evaluate(data, shifted[b.columns])[0] ** 2, axis=1)
                changes[k] += float(np.sum(np.abs(after - before)))
    return changes


ROUNDS = 50
ARRIVED = 1e-12  # m and rad: size of the last Newton step, for lengths of metres


def true_poses(
    model: Model | Builder | FlatModel,
    actuators: ArrayLike,
    near: Mapping[str, ArrayLike],
    deviations: Mapping[str, ArrayLike],
    *,
    known: str = "q",
) -> dict[str, np.ndarray]:
    """Poses of the robot at `actuators` (N, k) if scalar parameters are off by `deviations` (N,) pose by pose.

    `near`: the pose variables with start values, such as T (N, 3) and e (N, 4), a unit quaternion; they select the
    assembly mode. Without deviations this is the forward kinematics. A pose that does not close is NaN.

    Raises ModelError if the numbers of closure equations and pose coordinates differ.
    """
    q = np.asarray(actuators, float)
    names = list(deviations)
    m = Measurements({known: q, **near})
    p = prepare(model, m, Choice(free=names), actuators=known)
    (b,) = p.blocks_of("forward")
    places = {n: s for n, s in p.reading.places.items() if n != known}
    free = [k for s in places.values() for k in range(s.start, s.stop)]
    if len(free) != len(p.labels):
        raise ModelError(
            f"{len(p.labels)} closure equations for the {len(free)} degrees of freedom of {', '.join(places)}"
        )
    x = np.repeat(p.unknowns.start[:, None], len(q), axis=1)
    for name, off in deviations.items():
        x[p.unknowns.names.index(name)] += np.asarray(off, float)
    y = np.zeros((len(q), p.reading.noise.numel()))
    step = np.full((len(q), len(free)), np.inf)
    latent = np.zeros((0, len(q)))
    with np.errstate(all="ignore"):
        for _ in range(ROUNDS):
            r, _, By, _ = map_columns(b.function, [p.reading.data, y.T, latent, x[b.columns]])
            jacobian = By.reshape(len(p.labels), len(q), -1).transpose(1, 0, 2)[:, :, free]
            step = _solved(jacobian, r.T)
            y[:, free] -= step
            if np.nanmax(np.abs(step), initial=0.0) <= ARRIVED:
                break
    y[~(np.max(np.abs(step), axis=1) <= ARRIVED)] = np.nan
    return {n: moved(np.asarray(m.values[n]), y[:, s]) for n, s in places.items()}


def moved(value: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Rows moved: vectors by vectors, quaternions (N, 4) by rotations (N, 3) [rad] about their own axes."""
    if steps.shape[1] == value.shape[1]:
        return value + steps
    u, turn = ca.SX.sym("u", 4), ca.SX.sym("turn", 3)
    f = ca.Function("turned", [u, turn], [turned(u, turn)])
    return map_columns(f, [(value / np.linalg.norm(value, axis=1, keepdims=True)).T, steps.T])[0].T


def rows_of(array: np.ndarray, name: str, rows: Sequence[int]) -> dict[str, np.ndarray]:
    """Deviations (N, 3) of some points (rows of a parameter) by scalar names: "A[0,1]"."""
    return {f"{name}[{i},{k}]": array[:, k] for i in rows for k in range(array.shape[1])}


def _solved(jacobian: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Newton steps pose by pose; NaN if singular."""
    good = np.all(np.isfinite(jacobian), axis=(1, 2)) & np.all(np.isfinite(r), axis=1)
    good[good] = np.abs(np.linalg.det(jacobian[good])) > 0
    step = np.full(r.shape, np.nan)
    step[good] = np.linalg.solve(jacobian[good], r[good][..., None])[..., 0]
    return step


_OF_A_LINK = re.compile(r"(?P<name>\w+)\[(?P<link>\d+)(,(?P<axis>[012]))?\]")
_TITLES = {
    "position_mm": "position change, mm",
    "orientation_deg": "orientation change, deg",
    "cost_m4": "change of (5.1), m^4",
}


def table(sums: Mapping[str, Mapping[str, float]], of: str) -> tuple[list[str], np.ndarray]:
    """Rows such as "L", "A_x" and their sums (rows, links), NaN if a link has none; `of`: the key of the sums."""
    sums_by_row: dict[str, dict[int, float]] = {}
    for name, entry in sums.items():
        m = _OF_A_LINK.fullmatch(name)
        if m is not None and of in entry:
            row = m["name"] + (f"_{'xyz'[int(m['axis'])]}" if m["axis"] else "")
            sums_by_row.setdefault(row, {})[int(m["link"])] = entry[of]
    links = 1 + max((k for row in sums_by_row.values() for k in row), default=-1)
    order = sorted(sums_by_row, key=lambda row: (row[0] != "L", row))
    rows = [[sums_by_row[row].get(k, np.nan) for k in range(links)] for row in order]
    return order, np.array(rows, float).reshape(len(order), links)


def text(sums: Mapping[str, Mapping[str, float]]) -> str:
    """All three tables one below the other, a line per parameter and a column per link."""
    parts = []
    for of, title in _TITLES.items():
        order, values = table(sums, of)
        if order:
            links = {f"link {k}": [f"{x:.4g}" for x in column] for k, column in enumerate(values.T)}
            parts.append(csv_text({title: order} | links))
    return "".join(parts) or "\n"
