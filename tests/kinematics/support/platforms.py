"""Platforms to try the assembly modes on: A, B (n, 6, 3), L (n, 6), and the pose R, T each was measured in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Platforms:
    """n platforms with lengths that a pose R (n, 3, 3), T (n, 3) has."""

    A: np.ndarray
    B: np.ndarray
    L: np.ndarray
    R: np.ndarray
    T: np.ndarray

    @property
    def legs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.A, self.B, self.L


def random_poses(n: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Attitudes uniform over all, positions normal with standard deviation 1."""
    return Rotation.random(n, rng=random).as_matrix(), random.normal(size=(n, 3))


def in_poses(A: np.ndarray, B: np.ndarray, R: np.ndarray, T: np.ndarray) -> Platforms:
    """The platforms with the lengths they have in poses R, T."""
    return Platforms(A, B, np.linalg.norm(T[:, None] + B @ np.swapaxes(R, 1, 2) - A, axis=2), R, T)


def random_platforms(n: int, seed: int) -> Platforms:
    """Base joints uniform in a cube of side 2, platform joints in one of side 1, random poses."""
    random = np.random.default_rng(seed)
    A, B = random.uniform(-1, 1, (n, 6, 3)), random.uniform(-0.5, 0.5, (n, 6, 3))
    return in_poses(A, B, *random_poses(n, random))


def planar_platforms(n: int, seed: int) -> Platforms:
    """As random, with the joints of base and platform each in a plane."""
    p = random_platforms(n, seed)
    flat = np.array([1.0, 1.0, 0.0])
    return in_poses(p.A * flat, p.B * flat, p.R, p.T)


def six_three_platforms(n: int, seed: int) -> Platforms:
    """As random, with the platform joints coincident in pairs."""
    p = random_platforms(n, seed)
    return in_poses(p.A, p.B[:, [0, 0, 2, 2, 4, 4]], p.R, p.T)


def griffis_duffy_platforms(n: int, seed: int) -> Platforms:
    """Similar regular hexagons in base and platform: architecturally singular."""
    random = np.random.default_rng(seed)
    angle = np.arange(6) * np.pi / 3
    hexagon = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(6)])
    A, B = np.tile(hexagon, (n, 1, 1)), np.tile(0.5 * hexagon, (n, 1, 1))
    return in_poses(A, B, *random_poses(n, random))


def collinear_platforms(n: int, seed: int) -> Platforms:
    """All platform joints on one line, about which the platform is free to turn."""
    p = random_platforms(n, seed)
    return in_poses(p.A, p.B * [1.0, 0.0, 0.0], p.R, p.T)


def exact_tau_platforms(n: int, seed: int) -> Platforms:
    """Clusters of one, two and three links, each with parallel and equal links in the pose R, T."""
    random = np.random.default_rng(seed)
    R, T = random_poses(n, random)
    B = random.uniform(-0.25, 0.25, (n, 6, 3))
    links = random.normal(size=(n, 3, 3))
    links *= (1.5 + random.uniform(-0.2, 0.2, (n, 3, 1))) / np.linalg.norm(links, axis=2, keepdims=True)
    A = T[:, None] + B @ np.swapaxes(R, 1, 2) - links[:, [0, 1, 1, 2, 2, 2]]
    return in_poses(A, B, R, T)


# Dietmaier, "The Stewart-Gough platform of general geometry can have 40 real postures", Advances in Robot
# Kinematics 1998, pp. 1-10; six decimals as printed. LENGTHS, not squared lengths. Also in RobotLocomotion/drake,
# examples of mixed-integer inverse kinematics.
DIETMAIER_A = np.array([
    [0.0, 0.0, 0.0], [1.107915, 0.0, 0.0], [0.549094, 0.756063, 0.0],
    [0.735077, -0.223935, 0.525991], [0.514188, -0.526063, -0.368418], [0.590473, 0.094733, -0.205018],
])  # fmt: skip
DIETMAIER_B = np.array([
    [0.0, 0.0, 0.0], [0.542805, 0.0, 0.0], [0.956919, -0.528915, 0.0],
    [0.665885, -0.353482, 1.402538], [0.478359, 1.158742, 0.107672], [-0.137087, -0.235121, 0.353913],
])  # fmt: skip
DIETMAIER_L = np.array([1.0, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071])


def singular_platforms(n: int, seed: int) -> Platforms:
    """As random, with the sixth base joint moved until the legs are linearly dependent in the pose R, T."""
    random = np.random.default_rng(seed)
    found = []
    while len(found) < n:
        A, B = random.uniform(-1, 1, (6, 3)), random.uniform(-0.5, 0.5, (6, 3))
        R, T = (a[0] for a in random_poses(1, random))
        direction = random.normal(size=3)
        # the determinant is linear in the joint's position: two values give the root
        low, high = (_wrench_determinant(A + s * np.eye(6)[5][:, None] * direction, B, R, T) for s in (0.0, 1.0))
        s = low / (low - high)
        if abs(s) < 3:
            found.append((A + s * np.eye(6)[5][:, None] * direction, B, R, T))
    A, B, R, T = (np.array(a) for a in zip(*found, strict=True))
    return in_poses(A, B, R, T)


def _wrench_determinant(A: np.ndarray, B: np.ndarray, R: np.ndarray, T: np.ndarray) -> float:
    """Of the six lines of force of the legs, not normalised."""
    arm = B @ R.T
    d = T + arm - A
    return float(np.linalg.det(np.hstack([d, np.cross(arm, d)])))
