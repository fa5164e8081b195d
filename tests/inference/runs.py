"""Tasks that worker processes import."""

import os
import time

import numpy as np

from gtmodel.inference import linear_fit


def mean_of_ten(rng: np.random.Generator, k: int):
    """Synthetic: ten values of mean 3 and noise 0.2, fitted with the noise unknown."""
    return linear_fit(np.ones((10, 1)), 3 + 0.2 * rng.standard_normal(10), ["m"])


def own_seed(rng: np.random.Generator, k: int) -> tuple[int, int, str | None]:
    time.sleep(0.1)  # so that a signal meets the others at work
    return k, int(rng.integers(1 << 30)), os.environ.get("OPENBLAS_NUM_THREADS")


def third_fails(rng: np.random.Generator, k: int) -> int:
    if k == 2:
        raise ValueError("no such pose")
    return k


def slow(rng: np.random.Generator, k: int) -> int:
    time.sleep(60 if k else 0)
    return k


def tells_its_number(rng: np.random.Generator, k: int) -> int:
    print(os.getpid(), flush=True)
    time.sleep(60)
    return k
