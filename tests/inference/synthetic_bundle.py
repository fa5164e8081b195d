"""Synthetic bundles: cameras above a field of points, in the form of BAL files (p = -P / P_z, f, k1, k2)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from gtmodel.inference.bundle import ResidualBlock, UnknownGroup

LABELS = ["qw", "qx", "qy", "qz", "x", "y", "z", "f", "k1", "k2"]


def projection() -> ca.Function:
    """(camera, point, measured) -> (error [pixel], distance in front of the camera)."""
    c, p, uv = ca.SX.sym("c", 10), ca.SX.sym("p", 3), ca.SX.sym("uv", 2)
    twice = 2 * ca.cross(c[1:4], p)
    P = p + c[0] * twice + ca.cross(c[1:4], twice) + c[4:7]
    x, y = -P[0] / P[2], -P[1] / P[2]
    r2 = x**2 + y**2
    d = c[7] * (1 + c[8] * r2 + c[9] * r2**2)
    return ca.Function("projection", [c, p, uv], [ca.vertcat(d * x, d * y) - uv, -P[2]])


@dataclass
class Scene:
    """What is measured, and starting values; the truth beside."""

    cameras: np.ndarray
    points: np.ndarray
    camera: np.ndarray
    point: np.ndarray
    uv: np.ndarray
    true_cameras: np.ndarray
    true_points: np.ndarray

    def groups(self, fixed=None, cameras=None, points=None):
        return [
            UnknownGroup("camera", self.cameras if cameras is None else cameras, LABELS, turn=0, fixed=fixed),
            UnknownGroup("point", self.points if points is None else points, ["x", "y", "z"], local=True),
        ]

    def blocks(self, sigma=None, **more):
        return [ResidualBlock("pixels", projection(), [("camera", self.camera), ("point", self.point)], self.uv,
                              sigma=sigma, **more)]  # fmt: skip

    def anchored(self):
        """A mask that fixes the first camera's place and attitude, and one coordinate of the one opposite."""
        fixed = np.zeros((len(self.cameras), 9), bool)
        fixed[0, :6] = True
        fixed[len(fixed) // 2, 3] = True
        return fixed


def scene(cameras=6, points=40, views=4, noise=0.5, seed=0, rough=1.0) -> Scene:
    """So many cameras on a circle above so many points, each seen by `views` of them chosen at random."""
    rng = np.random.default_rng(seed)
    P = rng.uniform([-5, -5, -1], [5, 5, 1], (points, 3))
    angle = np.linspace(0, 2 * np.pi, cameras, endpoint=False)
    place = np.column_stack([4 * np.cos(angle), 4 * np.sin(angle), 12 + rng.normal(0, 0.5, cameras)])
    turn = Rotation.from_rotvec(rng.normal(0, 0.15, (cameras, 3)))
    lens = np.column_stack(
        [1000 + rng.normal(0, 20, cameras), rng.normal(-0.02, 0.01, cameras), rng.normal(0.002, 0.002, cameras)]
    )
    C = np.hstack([turn.as_quat()[:, [3, 0, 1, 2]], -turn.apply(place), lens])
    camera = np.sort(np.argsort(rng.random((points, cameras)), axis=1)[:, :views]).reshape(-1)
    point = np.repeat(np.arange(points), views)
    uv = projection().map(len(camera))(C[camera].T, P[point].T, np.zeros((2, len(camera))))[0].full().T
    uv = uv + rng.normal(0, noise, uv.shape)
    step = np.hstack([rng.normal(0, 0.02, (cameras, 3)), rng.normal(0, 0.1, (cameras, 3)),
                      rng.normal(0, 30, (cameras, 1)), np.zeros((cameras, 2))])  # fmt: skip
    start = UnknownGroup("camera", C, LABELS, turn=0).moved(C, rough * step)
    start[:, 8:] = 0.0
    return Scene(start, P + rough * rng.normal(0, 0.1, P.shape), camera, point, uv, C, P)
