"""The pinhole camera with Brown's distortion, with OpenCV's order of coefficients and pixel convention.

Source: Brown 1971, "Close-range camera calibration"; OpenCV, "Camera Calibration and 3D Reconstruction".
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ..results.refusal import ArgumentError
from ..results.status import Status

LENS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
PIXELS = 4  # the first of them are in pixels
ROUNDS, ARRIVED = 30, 1e-13  # Newton steps of undistort() at most, and size of the last step
TINY = 1e-300  # avoids a division by zero


def distorted(x: Any, y: Any, k: Any) -> tuple[Any, Any]:
    """Return distorted image coordinates of x, y on the plane at distance 1, with k = (k1, k2, p1, p2, k3).

    Works for numbers, arrays, CasADi symbols and expressions of the language.
    """
    r2 = x * x + y * y
    radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    return (
        x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
        y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y,
    )


def straightness(r2: Any, k: Any, minimum: Callable[[Any, Any], Any], maximum: Callable[[Any, Any], Any],
                 sqrt: Callable[[Any], Any]) -> Any:  # fmt: skip
    """Return the least derivative of the distorted radius r (1 + k1 r^2 + k2 r^4 + k3 r^6) from the centre to r^2 = r2.

    If it is not positive, the image folds over within this radius, and another point has the same pixel. It is 1
    without distortion.
    """
    a, b, c = 21 * k[4], 10 * k[1], 3 * k[0]  # derivative in r^2 of 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6
    root = sqrt(maximum(b * b - 4 * a * c, 0.0))

    def slope(t: Any) -> Any:
        return 1 + t * (3 * k[0] + t * (5 * k[1] + t * 7 * k[4]))

    # the interior minimum from two formulas, of which at least one does not divide by zero
    within = [maximum(minimum(t, r2), 0.0) for t in (-2 * c / (b + root + TINY), (root - b) / (2 * a + TINY))]
    return minimum(slope(r2), minimum(slope(within[0]), slope(within[1])))


def project(p: np.ndarray, lens: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pixels (n, 2) and status codes (n,) of points p (n, 3) [m] in camera frame: z forward, x right, y down.

    lens (9,): fx, fy, cx, cy [pixel], k1, k2, p1, p2, k3. The centre of the first pixel is (0, 0). A point behind the
    camera, or beyond the radius at which the image folds over, has Status.OUT_OF_RANGE and NaN, not the pixel of
    another point. A point that is not finite has Status.NOT_FINITE.

    >>> lens = np.array([500.0, 500.0, 320.0, 240.0, -0.2, 0.0, 0.0, 0.0, 0.0])
    >>> uv, status = gt.vision.project(np.array([[0.1, 0.0, 1.0], [0.1, 0.0, -1.0], [9.0, 0.0, 1.0]]), lens)
    >>> uv[0], status
    (array([369.9, 240. ]), array([0, 1, 1]))
    """
    p, lens = np.asarray(p, float).reshape(-1, 3), _lens(lens)
    with np.errstate(all="ignore"):
        x, y = p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]
        good = (p[:, 2] > 0) & (straightness(x * x + y * y, lens[4:], np.minimum, np.maximum, np.sqrt) > 0)
        xd, yd = distorted(x, y, lens[4:])
    uv = np.column_stack([lens[0] * xd + lens[2], lens[1] * yd + lens[3]])
    status = np.where(good, int(Status.OK), int(Status.OUT_OF_RANGE))
    status = np.where(np.isfinite(p).all(axis=1), status, int(Status.NOT_FINITE))
    uv[status != Status.OK] = np.nan
    return uv, status


def undistort(uv: np.ndarray, lens: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (n, 2), x and y on the plane at distance 1, of pixels uv (n, 2), and status codes (n,).

    Newton's method starts from the undistorted lens. Status is NOT_CONVERGED, with NaN, if there is no direction for a
    pixel or the iteration fails; directions beyond the fold do not count.

    >>> lens = np.array([500.0, 500.0, 320.0, 240.0, -0.2, 0.0, 0.0, 0.0, 0.0])
    >>> xy, status = gt.vision.undistort(np.array([[369.9, 240.0], [5000.0, 240.0]]), lens)
    >>> xy[0].round(9), status
    (array([0.1, 0. ]), array([0, 2]))
    """
    uv, lens = np.asarray(uv, float).reshape(-1, 2), _lens(lens)
    target = (uv - lens[2:4]) / lens[:2]
    xy = target.copy()
    step = np.full_like(xy, np.inf)
    f = _distorted_with_jacobian()
    with np.errstate(all="ignore"):
        for _ in range(ROUNDS):
            value, J = _columns(f, xy, lens[4:])
            step = np.linalg.solve(np.where(np.isfinite(J), J, np.eye(2)), (value - target)[:, :, None])[:, :, 0]
            length = np.linalg.norm(step, axis=1, keepdims=True)
            step = step * np.minimum(1.0, 0.5 / np.maximum(length, TINY))  # do not step over a fold
            xy = xy - step
            if np.nanmax(np.abs(step), initial=0.0) <= ARRIVED:
                break
        residual = np.abs(_columns(f, xy, lens[4:])[0] - target).max(axis=1)
        r2 = np.sum(xy**2, axis=1)
        good = (residual <= 1e-10 * (1 + np.abs(target).max(axis=1))) & np.isfinite(xy).all(axis=1)
        good &= straightness(r2, lens[4:], np.minimum, np.maximum, np.sqrt) > 0
    status = np.where(good, int(Status.OK), int(Status.NOT_CONVERGED))
    status = np.where(np.isfinite(uv).all(axis=1), status, int(Status.NOT_FINITE))
    xy[status != Status.OK] = np.nan
    return xy, status


def direction_covariance(uv: np.ndarray, lens: np.ndarray, sigma: float) -> np.ndarray:
    """Return the covariance (n, 2, 2) of undistort() for noise with standard deviation `sigma` [pixel] in u and v."""
    lens = _lens(lens)
    xy, _ = undistort(uv, lens)
    J = lens[:2, None] * _columns(_distorted_with_jacobian(), xy, lens[4:])[1]
    inverse = np.linalg.inv(np.where(np.isfinite(J), J, np.eye(2)))
    return sigma**2 * inverse @ inverse.transpose(0, 2, 1)


def pixel(P: ca.SX, lens: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the pixel (2,) of a point P (3,) in camera coordinates, and margins (2,) that must be positive: the depth
    in front of the camera, and the straightness of the lens up to the point."""
    x, y = P[0] / P[2], P[1] / P[2]
    k = [lens[PIXELS + n] for n in range(5)]
    xd, yd = distorted(x, y, k)
    straight = straightness(x * x + y * y, k, ca.fmin, ca.fmax, ca.sqrt)
    return ca.vertcat(lens[0] * xd + lens[2], lens[1] * yd + lens[3]), ca.vertcat(P[2], straight)


def pixel_jacobian(p: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Return the derivatives (n, 2, 3) [pixel/m] of project() with respect to points p (n, 3)."""
    P, k = ca.SX.sym("P", 3), ca.SX.sym("lens", len(LENS))
    J = ca.Function("slopes", [P, k], [ca.densify(ca.jacobian(pixel(P, k)[0], P))])
    p, n = np.asarray(p, float).reshape(-1, 3), len(np.asarray(p, float).reshape(-1, 3))
    if not n:
        return np.zeros((0, 2, 3))
    rows = J.map(n)(p.T, np.repeat(_lens(lens)[:, None], n, axis=1)).full()
    return rows.T.reshape(n, 3, 2).transpose(0, 2, 1)


def _distorted_with_jacobian() -> ca.Function:
    xy, k = ca.SX.sym("xy", 2), ca.SX.sym("k", 5)
    d = ca.vertcat(*distorted(xy[0], xy[1], [k[n] for n in range(5)]))
    return ca.Function("distorted", [xy, k], [d, ca.densify(ca.jacobian(d, xy))])


def _columns(f: ca.Function, xy: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n = len(xy)
    if not n:
        return np.zeros((0, 2)), np.zeros((0, 2, 2))
    value, J = f.map(n)(xy.T, np.repeat(k[:, None], n, axis=1))
    return value.full().T, J.full().T.reshape(n, 2, 2).transpose(0, 2, 1)


def _lens(lens: Any) -> np.ndarray:
    values = np.asarray(lens, float).reshape(-1)
    if values.shape != (len(LENS),) or not np.all(np.isfinite(values)) or np.any(values[:2] == 0):
        raise ArgumentError(f"expected {', '.join(LENS)}, finite, with nonzero focal lengths; found {values}", "lens")
    return values
