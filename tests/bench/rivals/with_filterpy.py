"""Two filters as a user of filterpy would write them: a linear one of 9 states and 6 readings, and a rigid body with
tracker and inertial unit, an error state of 18 and 12 readings.

The body's nominal state stands beside filterpy's filter, whose x is the error; Jacobians by hand, in NumPy, with
preallocated matrices; the covariance of the noise is made once, since the step is constant.
"""

from __future__ import annotations

from typing import Any

import numpy as np

G = np.array([0.0, 0.0, -9.81])


def skew(v: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    return np.array(
        [
            p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
            p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
            p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
            p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
        ]
    )


def exponential(d: np.ndarray) -> np.ndarray:
    half = 0.5 * np.sqrt(d @ d)
    factor = 0.5 * (np.sin(half) / half if half > 1e-9 else 1.0)
    return np.array([np.cos(half), factor * d[0], factor * d[1], factor * d[2]])


def logarithm(q: np.ndarray) -> np.ndarray:
    q = -q if q[0] < 0 else q
    sine = np.sqrt(q[1:] @ q[1:])
    return (2 * np.arctan2(sine, q[0]) / sine if sine > 1e-12 else 2.0) * q[1:]


def matrix(q: np.ndarray) -> np.ndarray:
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_blocks(w: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """exp(-[w]h), and what a turn gains from an error of w and of alpha, to the order of the step."""
    W = skew(w)
    turned = np.eye(3) - W * h + W @ W * (0.5 * h * h)
    return turned, np.eye(3) * h - W * (0.5 * h * h), np.eye(3) * (0.5 * h * h)


def run(
    log: dict[str, np.ndarray], h: float, densities: tuple[float, float], deviations: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Nominal states (K, 19) and deviations (K, 18); log has position, orientation, force and rate (K, .); start the
    nominal state and the deviations of its error, 19 + 18 numbers."""
    from filterpy.kalman import ExtendedKalmanFilter

    filter: Any = ExtendedKalmanFilter(dim_x=18, dim_z=12)
    filter.x, filter.P, filter.R = np.zeros(18), np.diag(start[19:] ** 2), np.diag(deviations**2)
    third = np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])
    filter.Q = np.zeros((18, 18))
    filter.Q[:9, :9], filter.Q[9:, 9:] = [np.kron(third, d * np.eye(3)) for d in densities]
    filter.F[0:3, 3:6] = filter.F[3:6, 6:9] = filter.F[12:15, 15:18] = np.eye(3) * h
    filter.F[0:3, 6:9] = np.eye(3) * (0.5 * h * h)
    H, expected = np.zeros((12, 18)), np.zeros(12)
    H[0:3, 0:3] = H[3:6, 9:12] = H[9:12, 12:15] = np.eye(3)
    x = start[:19].copy()
    count = len(log["position"])
    states, spreads = np.empty((count, 19)), np.empty((count, 18))
    for k in range(count):
        if k:
            p, v, a, q, w, alpha = x[0:3], x[3:6], x[6:9], x[9:13], x[13:16], x[16:19]
            filter.F[9:12, 9:12], filter.F[9:12, 12:15], filter.F[9:12, 15:18] = rotation_blocks(w, h)
            x[0:3] = p + h * v + (0.5 * h * h) * a
            x[3:6] = v + h * a
            x[9:13] = product(q, exponential(h * w + (0.5 * h * h) * alpha))
            x[13:16] = w + h * alpha
            filter.predict()
        q = x[9:13]
        R = matrix(q)
        felt = R.T @ (x[6:9] - G)
        H[6:9, 6:9], H[6:9, 9:12] = R.T, skew(felt)
        expected[6:9] = felt
        measured, turned = log["orientation"][k], q * [1.0, -1.0, -1.0, -1.0]
        z = np.concatenate(
            [log["position"][k] - x[0:3], logarithm(product(turned, measured)), log["force"][k] - felt,
             log["rate"][k] - x[13:16]]
        )  # fmt: skip
        filter.update(z, lambda _: H, lambda _: 0.0)
        d = filter.x
        x[0:9] += d[0:9]
        x[9:13] = product(q, exponential(d[9:12]))
        x[13:19] += d[12:18]
        filter.x = np.zeros(18)
        states[k], spreads[k] = x, np.sqrt(np.diag(filter.P))
    return states, spreads


def run_linear(
    z: np.ndarray, F: np.ndarray, Q: np.ndarray, H: np.ndarray, R: np.ndarray, P: np.ndarray, *, whole: bool
) -> dict[str, np.ndarray]:
    """States and deviations of a Kalman filter that starts at zero with covariance P.

    whole: also innovations with their deviations and normalised squares, log-likelihoods, and the covariances before
    and after each reading. They are computed from what filterpy has; its own `log_likelihood` takes four times as long
    as the filter.
    """
    from filterpy.kalman import KalmanFilter

    count, k, n = *z.shape, len(F)
    filter: Any = KalmanFilter(dim_x=n, dim_z=k)
    filter.F, filter.Q, filter.H, filter.R, filter.P, filter.x = F, Q, H, R, P, np.zeros((n, 1))
    kept = {"x": np.empty((count, n)), "deviations": np.empty((count, n))}
    more = {"y": (k,), "S": (k,), "nis": (), "likelihood": (), "prior": (n, n), "P": (n, n), "x_prior": (n,)}
    kept |= {name: np.empty((count, *shape)) for name, shape in more.items()} if whole else {}
    constant = k * np.log(2 * np.pi)
    for i in range(count):
        if i:
            filter.predict()
        if whole:
            kept["prior"][i], kept["x_prior"][i] = filter.P, filter.x[:, 0]
        filter.update(z[i])
        kept["x"][i], kept["deviations"][i] = filter.x[:, 0], np.sqrt(np.diag(filter.P))
        if whole:
            y = filter.y[:, 0]
            nis = y @ filter.SI @ y
            kept["P"][i], kept["y"][i], kept["S"][i], kept["nis"][i] = filter.P, y, np.diag(filter.S), nis
            kept["likelihood"][i] = -0.5 * (nis + np.linalg.slogdet(filter.S)[1] + constant)
    return kept
