"""Numbers of an F1 worked out of its table: plate orientation at home, 5-DOF parameters, parallel clusters."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..geometry.quaternions import quaternion_matrix, quaternion_of
from ..geometry.rotations import shortest_rotation
from . import clusters

Array = np.ndarray
Table = dict[str, Any]
QUATERNIONS = ("u1_2", "u1_3", "u2_3")


def of_table(table: Table) -> Table:
    """A0, v, L, A, B, u1_2, u1_3, u2_3 (raw) and r3 in metres from a table in millimetres."""
    v = np.array(table["v"], dtype=float)
    lengths = {n: np.array(table[key], dtype=float) / 1e3 for n, key in
               (("A0", "A0_mm"), ("L", "L_mm"), ("A", "A_bj_mm"), ("B", "B0_mm"), ("r3", "r3_mm"))}  # fmt: skip
    raw = {name: np.array(table[name], dtype=float) for name in QUATERNIONS}
    return {**lengths, **raw, "v": np.tile(v, (3, 1)) if v.ndim == 1 else v}


def home_rotation(f1: Table) -> tuple[Array, float]:
    """R (3, 3) of the plate with q4 = q5 = q6 = 0 at which clusters are nearest to parallel, and the misfit [m]."""
    R12, R13, R23 = _rotations(f1, raw=True)
    turned = np.vstack([f1["A"][:1], f1["A"][1:3] @ R12.T, f1["A"][3:] @ (R13 @ R23).T])
    return clusters.orientation(turned, f1["B"])


def home(f1: Table) -> Array:
    """A T [m] that is reachable on most machines: 0.7 of the links' length below the virtual cart joints at q = 0."""
    R12, R13, R23 = _rotations(f1, raw=True)
    R, _ = home_rotation(f1)
    joints = [f1["A"][0], R12 @ f1["A"][1:3].mean(axis=0), R13 @ (f1["r3"] + R23 @ f1["A"][3:].mean(axis=0))]
    plate = [f1["B"][rows].mean(axis=0) for rows in clusters.ROWS]
    base = np.array([a + x - R @ b for a, x, b in zip(f1["A0"], joints, plate, strict=True)])
    v = f1["v"].mean(axis=0)
    return base.mean(axis=0) - 0.7 * f1["L"].mean() * v / np.linalg.norm(v)


def five_dof(f1: Table) -> Table:
    """Parameters of F1FiveDof without `home`: means over the clusters, and e_c from the fit at home."""
    _, R13, R23 = _rotations(f1)
    e_c = quaternion_of((R13 @ R23).T @ home_rotation(f1)[0], positive="largest")
    means = {k: np.array([f1[k][rows].mean(axis=0) for rows in clusters.ROWS]) for k in ("A", "B", "L")}
    return {**{k: f1[k] for k in ("A0", "v", "r3", *QUATERNIONS)}, **means, "e_c": e_c}


def parallel(f1: Table) -> Table:
    """A set of ours near `f1` whose clusters are exact parallelograms wherever q4 = -q5.

    Links of a cluster are made equally long, the axis of q4 antiparallel to that of q5, the links of arm 2 spread along
    the axis of q6, and the plate joints of a cluster copy its cart joints. Means over clusters stay.
    """
    R12, R13, R23 = _rotations(f1)
    C = (R13 @ R23).T @ home_rotation(f1)[0]
    s12, s13, s23 = (float(f1[name] @ f1[name]) for name in QUATERNIONS)
    R12 = shortest_rotation(R12[:, 1], -R13[:, 1]) @ R12
    spread = np.linalg.norm(f1["A"][2] - f1["A"][1]) * np.array([[-0.5], [0.5]])
    A, B, L = (f1[k].copy() for k in "ABL")
    A[1:3] = A[1:3].mean(axis=0) + spread * (R12.T @ R13 @ R23[:, 0])
    B[1:3] = B[1:3].mean(axis=0) + s12 * spread * C[0]
    B[3:] = B[3:].mean(axis=0) + s13 * s23 * clusters.centred(A[3:]) @ C
    for rows in clusters.ROWS:
        L[rows] = L[rows].mean()
    return {**f1, "A": A, "B": B, "L": L, "u1_2": np.sqrt(s12) * quaternion_of(R12, positive="largest")}


def _rotations(f1: Table, raw: bool = False) -> list[Array]:
    us = [f1[name] for name in QUATERNIONS]
    return [np.array(quaternion_matrix(u), dtype=float) / (1.0 if raw else u @ u) for u in us]
