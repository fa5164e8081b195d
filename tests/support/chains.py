"""Serial arms as chains of axes, from published tables; lengths in m."""

from __future__ import annotations

import numpy as np

from gtmodel import robots
from gtmodel.geometry.chains import Chain

P = np.pi / 2
Z = np.array([0.0, 0.0, 1.0])


def of_dh(a, d, alpha, *, modified: bool = False, end=None) -> Chain:
    """A revolute chain from a DH table, standard or modified (Craig), with joint angles as theta."""
    M, axes, points = np.eye(4), [], []
    for ai, di, twist in zip(a, d, alpha, strict=True):
        X, D = np.eye(4), np.eye(4)
        X[1:3, 1:3] = [[np.cos(twist), -np.sin(twist)], [np.sin(twist), np.cos(twist)]]
        X[0, 3], D[2, 3] = ai, di
        if modified:
            M = M @ X
        axes.append(M[:3, 2])
        points.append(M[:3, 3])
        M = M @ D if modified else M @ D @ X
    if end is not None:
        M = M @ end
    return Chain(axes, points, None, M[:3, 3], M[:3, :3])


def shift(z: float) -> np.ndarray:
    M = np.eye(4)
    M[2, 3] = z
    return M


def ur5e(twists=(0.0,) * 6) -> Chain:
    """Universal Robots, DH parameters for calculations, UR5e."""
    alpha = np.array([P, 0, 0, P, -P, 0]) + twists
    return of_dh([0, -0.425, -0.3922, 0, 0, 0], [0.1625, 0, 0, 0.1333, 0.0997, 0.0996], alpha)


def puma560() -> Chain:
    """Corke, Armstrong-Helouvry, ICRA 1994."""
    return of_dh([0, 0.4318, 0.0203, 0, 0, 0], [0, 0, 0.15005, 0.4318, 0, 0], [P, 0, -P, P, -P, 0])


def kr500(along: float = 0.0) -> Chain:
    """The KR 500-3; `along` moves the origin of axis 5 along axis 4, where URDFs have it."""
    robot = robots.kr500()
    points = np.cumsum(np.array(robot.origins), axis=0)
    axes = np.array(robot.axes)
    end = points[-1].copy()
    points[3] = points[3] + along * axes[3]
    points[5] = points[4]
    return Chain(axes, points, None, end, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]])


def panda() -> Chain:
    """Franka Emika Panda, modified DH parameters of its interface's documentation."""
    return of_dh(
        [0, 0, 0, 0.0825, -0.0825, 0, 0.088], [0.333, 0, 0.316, 0, 0.384, 0, 0], [0, -P, P, P, -P, P, P],
        modified=True, end=shift(0.107),
    )  # fmt: skip


def iiwa14() -> Chain:
    """KUKA LBR iiwa 14 R820: spherical shoulder and wrist."""
    heights = np.array([0.36, 0.36, 0.78, 0.78, 1.18, 1.18, 1.18])
    axes = np.array([Z, [0, 1, 0], Z, [0, -1, 0], Z, [0, 1, 0], Z], float)
    return Chain(axes, np.outer(heights, Z), None, [0, 0, 1.306])


def scara() -> Chain:
    """RRPR, links of 0.4 and 0.3, tool on the last axis."""
    x = np.array([0.0, 0.4, 0.7, 0.7])
    points = np.column_stack([x, 0 * x, np.full(4, 0.4)])
    R = np.diag([1.0, -1.0, -1.0])
    return Chain([Z, Z, -Z, -Z], points, [True, True, False, True], [0.7, 0, 0.2], R)


def planar(*lengths: float) -> Chain:
    """Parallel axes along z, links along x."""
    x = np.cumsum([0.0, *lengths])
    return Chain(np.tile(Z, (len(lengths), 1)), np.column_stack([x[:-1], 0 * x[:-1], 0 * x[:-1]]), T=[x[-1], 0, 0])


def anthropomorphic() -> Chain:
    """Three joints: a turntable and two parallel axes."""
    return Chain([Z, [0, -1, 0], [0, -1, 0]], [[0, 0, 0], [0, 0, 0.5], [0.6, 0, 0.5]], T=[1.1, 0, 0.5])


def manseur_doty() -> Chain:
    """Manseur, Doty, IJRR 8(5), 1989: sixteen real postures of one pose."""
    alpha = np.radians([90.0, 1.0, 90.0, 1.0, 90.0, 0.0])
    return of_dh([0.3, 1, 0, 1.5, 0, 0], [0, 0, 0.2, 0, 0, 0], alpha)


def random_arm(seed: int) -> Chain:
    """Six revolute axes without structure."""
    rng = np.random.default_rng(seed)
    return of_dh(rng.uniform(-0.5, 0.5, 6), rng.uniform(-0.5, 0.5, 6), rng.uniform(-np.pi, np.pi, 6))


def draw(chain: Chain, seed: int, count: int, limits=None) -> np.ndarray:
    """Joint positions, uniform in limits, +-pi, or +-0.3 m."""
    bound = np.where(chain.revolute, np.pi, 0.3)
    low, high = (-bound, bound) if limits is None else np.asarray(limits).T
    return np.random.default_rng(seed).uniform(low, high, (count, len(chain)))
