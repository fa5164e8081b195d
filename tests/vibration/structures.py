"""Systems that tests identify, and how two models are compared."""

from __future__ import annotations

import numpy as np

from gtmodel.vibration import Hit, Matrices, Physical, Sampling, Steps, SyntheticStructure

M = np.diag([30.0, 12.0])
D = np.array([[210.0, -60.0], [-60.0, 60.0]])
K = np.array([[150e3, -90e3], [-90e3, 90e3]])
TS = 0.004


def relative(found, true) -> float:
    """Relative Frobenius error."""
    return float(np.linalg.norm(np.asarray(found) - true) / np.linalg.norm(true))


def response(system, f_Hz: np.ndarray) -> np.ndarray:
    """C (zI - A)^-1 B + D at frequencies (n,), (n, p, m)."""
    A, B, C, D = (np.asarray(X) for X in (system.A, system.B, system.C, system.D))
    z = np.exp(2j * np.pi * f_Hz * system.dt)
    return C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, B.astype(complex)) + D


def random_system(seed: int, n: int, m: int, p: int):
    """A stable discrete A, B, C, D with poles from 0.3 to 0.95, well inside what a short record tells."""
    random = np.random.default_rng(seed)
    A = np.zeros((n, n))
    for k in range(0, n - 1, 2):
        r, w = random.uniform(0.5, 0.95), (0.25 + k + random.uniform(0, 1)) / n * np.pi * 0.9
        A[k : k + 2, k : k + 2] = r * np.array([[np.cos(w), -np.sin(w)], [np.sin(w), np.cos(w)]])
    if n % 2:
        A[-1, -1] = random.uniform(0.3, 0.9)
    T = np.linalg.qr(random.standard_normal((n, n)))[0]
    return (
        T @ A @ T.T,
        T @ random.standard_normal((n, m)),
        random.standard_normal((p, n)) @ T.T,
        random.standard_normal((p, m)),
    )


def matched(found: np.ndarray, true: np.ndarray) -> float:
    """Largest distance of a true pole from the nearest found one, each used once."""
    from scipy.optimize import linear_sum_assignment

    cost = np.abs(np.subtract.outer(true, found))
    return float(cost[linear_sum_assignment(cost)].max())


# of the shipped problems; FEW of 30000 samples, for speed
FEW = Sampling(seed=63, noise=1e-5, samples=3000, sample_time=TS)
TWO = SyntheticStructure(M.tolist(), D.tolist(), K.tolist(), force=50.0, hold_samples=8)
FORCED = Physical(force_coordinates=[1])
STEPS = Steps(a=0.9647, b=0.03527, delay_samples=5, amplitudes=[1e-3, 1.5e-3, 2e-3])
HIT = Hit(frequency=[7.4, 11.45], damping=[0.03, 0.025], amplitude=[[5e-4, 1e-4], [1e-4, 4e-4]])
OF_STEPS = Sampling(seed=611, noise=5e-6, samples=400)
OF_HIT = Sampling(seed=64, noise=1e-5, samples=1000)
PRINTED = Matrices(  # Dressler 2012, section 6.3, signs included
    M=[[0.0278, -0.0331], [-0.1759, 0.3086]],
    D=[[3.7432, -4.7826], [-9.7408, -3.4976]],
    K=[[-3732.6, -1567.1], [6920.9, 556.0]],
    published=[14.0, 103.0],
)
