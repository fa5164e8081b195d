"""Orientation of the plate of a robot over a grid of tool centre points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..compiler.causal import compile_causal
from ..geometry.rotations import matrices, rotation_vector, zyz
from ..results import Status


def grid(center: Any, half_width: Any, counts: Sequence[int], directions: Any = None) -> np.ndarray:
    """Return the points (*counts, 3) of a box: center + sum_k s_k d_k, s_k evenly spaced within +-half_width.

    Args:
        center: (3,) [m].
        half_width: (3,) [m]; ignored for a count of 1.
        counts: points along each direction; the first direction counts the layers.
        directions: (3, 3), one row each, normalised here; default: the axes. They need not be orthogonal.

    Raises ValueError for other shapes, a count below 1, or directions in one plane.

    >>> points = gt.kinematics.grid(center=[0.0, -0.9, 0.2], half_width=[0.1, 0.0, 0.05], counts=[3, 1, 2])
    >>> points.shape
    (3, 1, 2, 3)
    >>> points[0, 0]
    array([[-0.1 , -0.9 ,  0.15],
           [-0.1 , -0.9 ,  0.25]])
    """
    center, half = np.asarray(center, dtype=float), np.asarray(half_width, dtype=float)
    d = np.eye(3) if directions is None else np.asarray(directions, dtype=float)
    if center.shape != (3,) or half.shape != (3,) or len(counts) != 3 or d.shape != (3, 3):
        raise ValueError("a grid needs a centre (3,), half widths (3,), three counts and directions (3, 3)")
    if min(counts) < 1:
        raise ValueError(f"counts of a grid are 1 or more; found {list(counts)}")
    length = np.linalg.norm(d, axis=1)
    if not np.all(np.isfinite(d)) or np.any(length == 0) or abs(np.linalg.det(d / length[:, None])) < 1e-9:
        raise ValueError(f"directions of a grid must span space; found {d.tolist()}")
    steps = [np.linspace(-h, h, n) if n > 1 else np.zeros(1) for h, n in zip(half, counts, strict=True)]
    offsets = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1)
    return center + offsets @ (d / length[:, None])


@dataclass(frozen=True, eq=False)
class OrientationMap:
    """Orientation of the plate at tool centre points T (..., 3) [m]; the first axis counts layers.

    R (..., 3, 3) maps plate to world coordinates; NaN if status (...) is not ok. Angles in rad.
    """

    T: np.ndarray
    R: np.ndarray
    status: np.ndarray

    @property
    def ok(self) -> np.ndarray:
        """Whether each point has an orientation (...)."""
        return self.status == Status.OK

    @cached_property
    def reference(self) -> np.ndarray:
        """Orientation (3, 3) at the ok point nearest to the mean of the ok points; NaN if there is none."""
        if not np.any(self.ok):
            return np.full((3, 3), np.nan)
        points, ok = self.T.reshape(-1, self.T.shape[-1]), self.ok.ravel()
        distance = np.linalg.norm(points - np.mean(points[ok], axis=0), axis=1)
        return self.R.reshape(-1, 3, 3)[np.argmin(np.where(ok, distance, np.inf))]

    @cached_property
    def _zyz(self) -> tuple[np.ndarray, np.ndarray]:
        return zyz(self.R, about=zyz(self.reference)[0])

    @property
    def zyz(self) -> np.ndarray:
        """ZYZ angles (..., 3), alpha and gamma within pi of those at the reference (Dressler 2012, Fig. 4.7)."""
        return self._zyz[0]

    @property
    def singular(self) -> np.ndarray:
        """Whether ZYZ is singular (...), beta = 0 or pi; use `rotation_vector` near such points."""
        return self._zyz[1] & self.ok

    @cached_property
    def rotation_vector(self) -> np.ndarray:
        """Rotation vectors (..., 3) [rad] from the reference, world coordinates."""
        return rotation_vector(self.R, self.reference)

    def range(self) -> np.ndarray:
        """Return the ranges of the ZYZ angles (3,) [rad] over the ok points; NaN if there is none."""
        return _range(self.zyz[self.ok])

    def layer_range(self) -> np.ndarray:
        """Return the ranges of the ZYZ angles in each layer (layers, 3) [rad]."""
        return np.array([_range(a[ok]) for a, ok in zip(self.zyz, self.ok, strict=True)])

    def layer_difference(self) -> np.ndarray:
        """Return the difference between the layers (3,), as a fraction of `range`.

        From each angle the mean of its layer is subtracted; the difference is the largest deviation from the mean over
        the layers. It is small if the links cause the orientation errors, because a motion along the guideways rotates
        no link (Dressler 2012, section 4.2). Only places that are ok in all layers count; NaN if there is none.
        """
        everywhere = np.all(self.ok, axis=0)
        if not np.any(everywhere):
            return np.full(3, np.nan)
        pattern = self.zyz[:, everywhere]
        pattern = pattern - np.mean(pattern, axis=1, keepdims=True)
        return np.max(np.abs(pattern - np.mean(pattern, axis=0)), axis=(0, 1)) / self.range()


def orientation_map(
    model: Any,
    T: Any,
    *,
    known: str = "T",
    orientation: str = "e",
    joints: str | Sequence[str] = "q",
    branches: Mapping[str, int] | None = None,
) -> OrientationMap:
    """Compute the orientation of the plate at each tool centre point; the model has three degrees of freedom.

    Args:
        model: a model with the position `known` and the unit quaternion or rotation matrix `orientation`.
        T: (..., 3) [m], for example from `grid`; two or more axes.
        joints: variables that must also have a solution: an arm may limit the reach without affecting the orientation.
        branches: as for `causal`.

    A point out of reach has a status, and NaN for R. Raises ModelError for an unknown name or a causality that needs
    more than positions, ValueError for T of another shape.

    >>> robot = gt.robots.make("d1_six_link")
    >>> box = gt.kinematics.grid(center=[-1.6, -4.4, -0.1], half_width=[0.2, 0.2, 0.0], counts=[2, 2, 1])
    >>> orientation = gt.kinematics.orientation_map(robot, box)
    >>> orientation.ok.all(), np.degrees(orientation.range()).round(1)  # ranges of the ZYZ angles [deg]
    (np.True_, array([0. , 0.1, 0. ]))
    """
    T = np.asarray(T, dtype=float)
    if T.ndim < 2 or T.shape[-1] != 3:
        raise ValueError(f"expected points of shape (..., 3); found {T.shape}")
    required = [joints] if isinstance(joints, str) else list(joints)
    f = compile_causal(model, known, [orientation, *required], branches=branches)
    rotations, *_, status = f(T.reshape(-1, 3))
    return OrientationMap(T, matrices(rotations).reshape(*T.shape[:-1], 3, 3), np.asarray(status).reshape(T.shape[:-1]))


def _range(angles: np.ndarray) -> np.ndarray:
    return np.ptp(angles, axis=0) if len(angles) else np.full(3, np.nan)
