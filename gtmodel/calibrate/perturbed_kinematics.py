"""Where a robot stands whose parameters differ from pose to pose, by Newton's method on its closure equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..compiler.flat import FlatModel
from ..compiler.rows import map_columns
from ..geometry.quaternions import turned
from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.source import ModelError
from .choice import Choice
from .measurements import Measurements
from .problem import prepare

ROUNDS = 50
ARRIVED = 1e-12  # m and rad: the last Newton step, of lengths of metres


def true_poses(
    model: Model | Builder | FlatModel,
    actuators: ArrayLike,
    near: Mapping[str, ArrayLike],
    deviations: Mapping[str, ArrayLike],
    *,
    known: str = "q",
) -> dict[str, np.ndarray]:
    """Poses of the robot with `actuators` (N, k) where scalar parameters are off by `deviations` (N,) pose by pose.

    `near`: the variables of the pose and where to start, such as T (N, 3) and e (N, 4), a unit quaternion. The assembly
    mode is that of the start. With no deviation this is the forward kinematics. A pose that does not close is NaN.

    Raises ModelError where closure equations and pose differ in number.
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
            f"{len(p.labels)} equations close, but the pose {', '.join(places)} has {len(free)} degrees of freedom"
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


def moved(value: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Rows moved: vectors by vectors, quaternions (N, 4) by turns (N, 3) [rad] about their own axes."""
    if by.shape[1] == value.shape[1]:
        return value + by
    u, turn = ca.SX.sym("u", 4), ca.SX.sym("turn", 3)
    f = ca.Function("turned", [u, turn], [turned(u, turn)])
    return map_columns(f, [(value / np.linalg.norm(value, axis=1, keepdims=True)).T, by.T])[0].T


def rows_of(array: np.ndarray, name: str, rows: Sequence[int]) -> dict[str, np.ndarray]:
    """Deviations (N, 3) of some points, rows of a parameter, by scalar names: "A[0,1]"."""
    return {f"{name}[{i},{k}]": array[:, k] for i in rows for k in range(array.shape[1])}


def _solved(jacobian: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Newton steps pose by pose; NaN where singular."""
    good = np.all(np.isfinite(jacobian), axis=(1, 2)) & np.all(np.isfinite(r), axis=1)
    good[good] = np.abs(np.linalg.det(jacobian[good])) > 0
    step = np.full(r.shape, np.nan)
    step[good] = np.linalg.solve(jacobian[good], r[good][..., None])[..., 0]
    return step
