"""A bundle by SciPy's sparse least squares, compiled blocks and an exact Jacobian, and by COLMAP where installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import scipy

from gtmodel.compiler.rows import map_columns
from gtmodel.inference.bundle import UnknownGroup
from tests.inference.synthetic_bundle import LABELS, Scene, projection


class ByScipy:
    """Residuals and exact sparse Jacobian in increments from the start: the same compiled functions on columns that
    gtmodel evaluates, one entry of the Jacobian a row of a CSR matrix whose pattern is made once."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        group = UnknownGroup("camera", scene.cameras, LABELS, turn=0)
        c, d, p, uv = ca.SX.sym("c", 10), ca.SX.sym("d", 9), ca.SX.sym("p", 3), ca.SX.sym("uv", 2)
        moved: Any = group.moved_sx(c, d)
        moved[:4] = moved[:4] / ca.norm_2(moved[:4])
        error = projection().call([moved, p, uv])[0]
        J = ca.jacobian(error, ca.vertcat(d, p))
        self.residual = ca.Function("residual", [c, d, p, uv], [ca.densify(error)], {"cse": True})
        self.slope = ca.Function("slope", [c, d, p, uv], [ca.densify(J.T)], {"cse": True})
        n, cameras = len(scene.uv), len(scene.cameras)
        of_points = 9 * cameras + 3 * scene.point[:, None] + np.arange(3)
        columns = np.hstack([9 * scene.camera[:, None] + np.arange(9), of_points])
        self.indices = np.repeat(columns, 2, axis=0).reshape(-1)
        self.pointer = 12 * np.arange(2 * n + 1)
        self.shape = (2 * n, 9 * cameras + 3 * len(scene.points))
        self.start = np.concatenate([np.zeros(9 * cameras), scene.points.reshape(-1)])

    def _columns(self, x: np.ndarray) -> list[np.ndarray]:
        s, cameras = self.scene, len(self.scene.cameras)
        d, p = x[: 9 * cameras].reshape(-1, 9), x[9 * cameras :].reshape(-1, 3)
        return [s.cameras[s.camera].T, d[s.camera].T, p[s.point].T, s.uv.T]

    def errors(self, x: np.ndarray) -> np.ndarray:
        """(2 n,)."""
        return map_columns(self.residual, self._columns(x))[0].T.reshape(-1)

    def jacobian(self, x: np.ndarray) -> Any:
        """(2 n, unknowns), sparse."""
        values = map_columns(self.slope, self._columns(x))[0].T.reshape(-1)
        return scipy.sparse.csr_matrix((values, self.indices, self.pointer), shape=self.shape)

    def solve(self, tolerance: float) -> tuple[float, int]:
        """Cost and evaluations."""
        end = scipy.optimize.least_squares(
            self.errors, self.start, jac=self.jacobian, method="trf", tr_solver="lsmr", x_scale="jac",
            ftol=tolerance, xtol=tolerance, gtol=tolerance,
        )  # fmt: skip
        return float(end.cost), int(end.nfev)


def by_colmap(scene: Scene) -> Callable[[], float] | None:
    """COLMAP's bundle adjustment (Ceres) of the same bundle in its own form; None where it is not installed."""
    try:
        import pycolmap  # type: ignore[import-not-found]
    except ImportError:
        return None
    from scipy.spatial.transform import Rotation

    turned = np.diag([1.0, -1.0, -1.0])  # it looks along +z
    C, uv = scene.cameras, scene.uv * [1.0, -1.0]
    rotation = turned @ Rotation.from_quat(C[:, [1, 2, 3, 0]]).as_matrix()

    def made() -> Any:
        whole = pycolmap.Reconstruction()
        places = []
        for k, c in enumerate(C):
            lens = [c[7], 0.0, 0.0, c[8], c[9]]
            camera = pycolmap.Camera(model="RADIAL", width=4000, height=4000, params=lens, camera_id=k + 1)
            whole.add_camera_with_trivial_rig(camera)
            own = np.flatnonzero(scene.camera == k)
            image = pycolmap.Image(name=f"{k}", keypoints=uv[own], camera_id=k + 1, image_id=k + 1)
            pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation[k]), turned @ c[4:7])
            whole.add_image_with_trivial_frame(image, pose)
            places.append({int(o): n for n, o in enumerate(own)})
        by_point: list[list[int]] = [[] for _ in scene.points]
        for o, p in enumerate(scene.point):
            by_point[p].append(o)
        for p, seen in enumerate(by_point):
            track = pycolmap.Track()
            for o in seen:
                k = int(scene.camera[o])
                track.add_element(k + 1, places[k][o])
            whole.add_point3D(scene.points[p], track)
        return whole

    return lambda: _colmap(pycolmap, made())


def _colmap(pycolmap: Any, whole: Any) -> float:
    """Mean distance of a corner from its prediction [pixel] at the end."""
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = False
    options.print_summary = False
    config = pycolmap.BundleAdjustmentConfig()
    for k in whole.reg_image_ids():
        config.add_image(k)
    pycolmap.create_default_bundle_adjuster(options, config, whole).solve()
    whole.update_point_3d_errors()
    return float(whole.compute_mean_reprojection_error())
