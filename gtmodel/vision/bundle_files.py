"""Read and write BAL files: cameras, points and observations as text.

Source: Agarwal, Snavely, Seitz and Szeliski 2010, "Bundle adjustment in the large", ECCV. A camera has nine numbers:
rotation vector, translation, f, k1, k2; it looks along -z, p = -P / P_z, and (u, v) = f (1 + k1 p^2 + k2 p^4) p from
the middle of the picture, v upwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from ..geometry.expressions import applied
from ..geometry.quaternions import exponential, logarithm
from ..inference.bundle import ResidualBlock, UnknownGroup
from ..results.disk import path_of, write_whole
from ..results.refusal import ArgumentError

LABELS = ("qw", "qx", "qy", "qz", "x", "y", "z", "f", "k1", "k2")


@dataclass(frozen=True, eq=False)
class BundleFile:
    """Cameras, points and observations of a bundle adjustment.

    cameras (c, 10): quaternion, scalar first, translation, f [pixel], k1, k2; points (p, 3); for each observation the
    indices camera (n,) and point (n,), and uv (n, 2) [pixel].
    """

    cameras: np.ndarray
    points: np.ndarray
    camera: np.ndarray
    point: np.ndarray
    uv: np.ndarray

    def groups(self) -> list[UnknownGroup]:
        """Return the unknowns "camera" and "point" (local) for gt.inference.bundle.bundle_fit()."""
        return [
            UnknownGroup("camera", self.cameras, LABELS, turn=0),
            UnknownGroup("point", self.points, ["x", "y", "z"], local=True),
        ]

    def blocks(self, sigma: float | None = None, loss: str = "linear", width: float = 2.0) -> list[ResidualBlock]:
        """Return the observations as residuals, predicted minus measured [pixel]."""
        sees = [("camera", self.camera), ("point", self.point)]
        return [ResidualBlock("pixels", bal_view(), sees, self.uv, sigma=sigma, loss=loss, width=width)]


def bal_view() -> ca.Function:
    """Return the function (camera (10,), point (3,), data (2,): u, v) -> (error (2,) [pixel], depth).

    >>> gt.vision.bal_view()([1.0, 0, 0, 0, 0, 0, 0, 100.0, 0, 0], [0.1, 0.2, -1.0], [9.0, 19.0])[0].full().ravel()
    array([1., 1.])
    """
    camera, point, data = (ca.SX.sym("x", k) for k in (10, 3, 2))
    P = applied(camera, point)
    x, y = -P[0] / P[2], -P[1] / P[2]
    r2 = x * x + y * y
    scale = camera[7] * (1 + r2 * (camera[8] + r2 * camera[9]))
    return ca.Function("bal_view", [camera, point, data], [ca.vertcat(scale * x, scale * y) - data, -P[2]])


def read_bal(path: str | Path) -> BundleFile:
    """Read a BAL file. Raises ArgumentError if it is not a valid BAL file.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> text = "1 1 1\\n0 0 8.5 17.0\\n0 0 0 0 0 -5 400 0.01 0\\n0.1 0.2 0.3"
    >>> with TemporaryDirectory() as folder:
    ...     _ = (Path(folder) / "one.txt").write_text(text)
    ...     one = gt.vision.read_bal(Path(folder) / "one.txt")
    >>> one.points, one.cameras[0, 7]
    (array([[0.1, 0.2, 0.3]]), np.float64(400.0))
    """
    path = path_of(path)
    try:
        words = path.read_text(encoding="utf-8").split()
        cameras, points, n = (int(w) for w in words[:3])
        if len(words) != 3 + 4 * n + 9 * cameras + 3 * points:
            raise ValueError(f"{len(words)} numbers for {cameras} cameras, {points} points and {n} observations")
        numbers = np.array(words[3:], float)
    except (OSError, ValueError) as error:
        raise ArgumentError(f"{path.name} is not a BAL file: {error}", "path") from None
    observations = numbers[: 4 * n].reshape(n, 4)
    lens = numbers[4 * n : 4 * n + 9 * cameras].reshape(cameras, 9)
    P = numbers[4 * n + 9 * cameras :].reshape(points, 3)
    camera, point = observations[:, 0].astype(int), observations[:, 1].astype(int)
    if n and not (0 <= camera.min() <= camera.max() < cameras and 0 <= point.min() <= point.max() < points):
        raise ArgumentError(f"{path.name} has observations of cameras or points that it does not contain", "path")
    return BundleFile(np.hstack([exponential(lens[:, :3]), lens[:, 3:]]), P, camera, point, observations[:, 2:].copy())


def write_bal(path: str | Path, bundle: BundleFile, *, overwrite: bool = False) -> None:
    """Write a BAL file with all digits, so that reading it gives the same numbers.

    Raises FileExistsError if the file exists, unless `overwrite`.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> one = gt.vision.BundleFile(np.array([[1.0, 0, 0, 0, 0, 0, -5, 400, 0.01, 0]]), np.array([[0.1, 0.2, 0.3]]),
    ...     np.array([0]), np.array([0]), np.array([[8.5, 17.0]]))
    >>> with TemporaryDirectory() as folder:
    ...     gt.vision.write_bal(Path(folder) / "one.txt", one)
    ...     again = gt.vision.read_bal(Path(folder) / "one.txt")
    >>> again.cameras[0, 6:], again.uv
    (array([-5.e+00,  4.e+02,  1.e-02,  0.e+00]), array([[ 8.5, 17. ]]))
    """
    lines = [f"{len(bundle.cameras)} {len(bundle.points)} {len(bundle.uv)}"]
    for c, p, (u, v) in zip(bundle.camera, bundle.point, bundle.uv, strict=True):
        lines.append(f"{c} {p} {u!r} {v!r}".replace("np.float64(", "").replace(")", ""))
    vectors = logarithm(bundle.cameras[:, :4])
    numbers = np.concatenate([np.hstack([vectors, bundle.cameras[:, 4:]]).reshape(-1), bundle.points.reshape(-1)])
    lines += [repr(float(x)) for x in numbers]
    write_whole(path, ("\n".join(lines) + "\n").encode(), overwrite=overwrite)
