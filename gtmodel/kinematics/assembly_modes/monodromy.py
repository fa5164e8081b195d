"""All 40 solutions of a random complex platform, found by monodromy from one that is known.

Going round a closed loop of platforms permutes the solutions: a known one comes back as another. Loops are
repeated until 40 are known, which is the number for a general platform (Lazard; Wampler; Husty 1996).
"""

from __future__ import annotations

import numpy as np

from .homotopy import Parameters, straight_line
from .study import MODES, Array, basis, leg_rows
from .tracker import newton_step, track

BASE_SIZE = 0.7  # of the random cart joints, as for a platform scaled by its leg length
PLATFORM_SIZE = 0.4  # of the random platform joints
LOOP_SIZE = 0.9  # distance of a loop's corners
MOST_LOOPS = 200
SAME = 1e-6  # projective distance below which two points with |z| = 1 are one


def random_start_system(seed: int) -> tuple[Parameters, Array]:
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
    start = Parameters(A, B, c)
    known = refined(start.system(), known)
    for _ in range(MOST_LOOPS):
        corners = [Parameters(A + LOOP_SIZE * draw(6, 3), B + LOOP_SIZE * draw(6, 3), c + LOOP_SIZE * draw(6))
                   for _ in range(2)]  # fmt: skip
        z = known
        for a, b in zip([start, *corners], [*corners, start], strict=True):
            to = Parameters(b.A[None], b.B[None], b.c[None])
            ends = track(straight_line(a, to), np.zeros(len(z), dtype=np.intp), z)
            z = ends.z[ends.arrived]
        for candidate in refined(start.system(), z):
            if np.all(projective_distance(known, candidate) > SAME):
                known = np.vstack([known, candidate])
        if len(known) == MODES:
            return start, known
    raise RuntimeError(f"{MOST_LOOPS} monodromy loops found {len(known)} of {MODES} solutions (seed {seed})")


def refined(C: Array, z: Array, iterations: int = 6) -> Array:
    """Points z (m, 8) after Newton steps on the system C (7, 18) or (m, 7, 18), scaled to |z| = 1."""
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    C = np.broadcast_to(C, (len(z), *C.shape[-2:]))
    for _ in range(iterations):
        z = z + newton_step(C, z, np.conj(z))
        z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return z


def projective_distance(z: Array, w: Array) -> Array:
    """Distance of points (..., 8) from the complex line through w (..., 8); both with unit norm."""
    return np.linalg.norm(z - w * np.sum(np.conj(w) * z, axis=-1, keepdims=True), axis=-1)
