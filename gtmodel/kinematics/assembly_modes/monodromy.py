"""All 40 solutions of a random complex platform, found by monodromy from one that is known.

Going round a closed loop of platforms permutes the solutions: a known one comes back as another. Loops are
repeated until 40 are known, which is the number for a general platform (Lazard; Wampler; Husty 1996).
"""

from __future__ import annotations

import numpy as np

from .homotopy import HomotopyParameters, straight_line
from .newton import refined
from .projective import SAME, projective_distance
from .study import MODES, Array, basis, leg_rows
from .tracker import track

BASE_SIZE = 0.7  # of the random cart joints, as for a platform scaled by its leg length
PLATFORM_SIZE = 0.4  # of the random platform joints
LOOP_SIZE = 0.9  # distance of a loop's corners
MOST_LOOPS = 200


def random_start_system(seed: int) -> tuple[HomotopyParameters, Array]:
    """A random complex platform and its 40 solutions (40, 8), |z| = 1; the same for the same seed.

    Raises RuntimeError when the loops do not find all 40.
    """
    random = np.random.default_rng(seed)

    def draw(*shape: int) -> Array:
        return (random.normal(size=shape) + 1j * random.normal(size=shape)) / np.sqrt(2)

    A, B = BASE_SIZE * draw(6, 3), PLATFORM_SIZE * draw(6, 3)
    x, y = draw(4), draw(4)
    y = y - (x @ y) / (x @ x) * x
    known = np.concatenate([x, y])[None]
    without_c = leg_rows(A, B, np.zeros(6, dtype=complex))
    c = -(without_c @ basis(known[0])) / (x @ x)
    start = HomotopyParameters(A, B, c)
    known = refined(start.system(), known)
    for _ in range(MOST_LOOPS):
        corners = [HomotopyParameters(A + LOOP_SIZE * draw(6, 3), B + LOOP_SIZE * draw(6, 3), c + LOOP_SIZE * draw(6))
                   for _ in range(2)]  # fmt: skip
        z = known
        for a, b in zip([start, *corners], [*corners, start], strict=True):
            to = HomotopyParameters(b.A[None], b.B[None], b.c[None])
            ends = track(straight_line(a, to), np.zeros(len(z), dtype=np.intp), z)
            z = ends.z[ends.arrived]
        for candidate in refined(start.system(), z):
            if np.all(projective_distance(known, candidate) > SAME):
                known = np.vstack([known, candidate])
        if len(known) == MODES:
            return start, known
    raise RuntimeError(f"{MOST_LOOPS} monodromy loops found {len(known)} of {MODES} solutions (seed {seed})")
