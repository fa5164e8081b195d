"""Random platforms by a seed, with lengths that a random pose has: synthetic data for the assembly modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .six_links import LINKS, Hands, bare


def draw(count: int, seed: int) -> Hands:
    """Base joints uniform in a cube of side 2 m, plate joints in one of side 1 m, measured in random poses.

    T is normal with standard deviation 1 m, attitudes are uniform over all. The drawn pose is the commanded one.
    The first platforms of a larger count are those of a smaller one.

    >>> from gtmodel.kinematics.assembly_modes import draw
    >>> hands = draw(3, seed=1)
    >>> len(hands), hands.L.shape, hands.synthetic
    (3, (3, 6), 'synthetic platforms, seed 1')
    """
    random = np.random.default_rng(seed)
    A, B, T, e = (np.zeros((count, *shape)) for shape in ((LINKS, 3), (LINKS, 3), (3,), (4,)))
    for i in range(count):
        A[i], B[i] = random.uniform(-1.0, 1.0, (LINKS, 3)), random.uniform(-0.5, 0.5, (LINKS, 3))
        T[i], e[i] = random.normal(size=3), random.normal(size=4)
    hands = bare(A, B, np.ones((count, LINKS)), T, e)
    return replace(
        hands,
        synthetic=f"synthetic platforms, seed {seed}",
        L=np.linalg.norm(T[:, None] + B @ np.swapaxes(hands.R, 1, 2) - A, axis=2),
    )
