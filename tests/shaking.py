"""Results of linear algebra shaken in the last place: what passes with one processor's round-off passes with another's.

`pytest --shake SEED` moves every number that numpy.linalg and scipy.linalg give by one unit in the last place up or
down, or leaves it, by a hash of seed and number: the same call gives the same result, as on one machine. Subprocesses
inherit the seed as GTMODEL_SHAKE, but shake only if they are pytest themselves or call `shake_as_inherited`.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy

VARIABLE = "GTMODEL_SHAKE"
# What BLAS and LAPACK compute, each in another order on another processor. No norms and determinants: their last bits
# follow from sums that NumPy makes itself.
SHAKEN = {
    np.linalg: ("cholesky", "eig", "eigh", "eigvals", "eigvalsh", "inv", "lstsq", "pinv", "qr", "solve", "svd"),
    scipy.linalg: (
        "cho_factor", "cho_solve", "cholesky", "eig", "eigh", "eigvals", "eigvalsh", "expm", "inv", "lstsq",
        "lu_factor", "lu_solve", "null_space", "orth", "pinv", "qr", "schur", "solve", "solve_triangular",
        "svd", "svdvals",
    ),
}  # fmt: skip
MIXERS = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9], dtype=np.uint64)


def shaken(value: Any, seed: int) -> Any:
    """The value with every float of it one unit in the last place up, down, or as it is; zeros and others stay."""
    if isinstance(value, tuple):
        parts = [shaken(v, seed) for v in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if isinstance(value, np.ndarray) and value.dtype == np.complex128:
        return shaken(value.real, seed) + 1j * shaken(value.imag, seed)
    if isinstance(value, np.float64):
        return shaken(np.array(value), seed)[()]
    if not (isinstance(value, np.ndarray) and value.dtype == np.float64):
        return value
    bits = np.array(value, order="C").view(np.uint64) if value.ndim else np.array([value]).view(np.uint64)
    with np.errstate(over="ignore"):
        mixed = (bits ^ np.uint64(seed)) * MIXERS[0]
        mixed = (mixed ^ (mixed >> np.uint64(29))) * MIXERS[1]
    way = (mixed >> np.uint64(40)) % np.uint64(3)
    moved = np.where(way == 0, np.nextafter(value.reshape(bits.shape), -np.inf), value.reshape(bits.shape))
    moved = np.where(way == 1, np.nextafter(value.reshape(bits.shape), np.inf), moved)
    return np.where(value == 0.0, value, moved.reshape(value.shape))


def shake(seed: int) -> None:
    """Shake from here on, in this process."""

    def shaking(f: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(f)
        def call(*arguments: Any, **options: Any) -> Any:
            return shaken(f(*arguments, **options), seed)

        return call

    for module, names in SHAKEN.items():
        for name in names:
            setattr(module, name, shaking(getattr(module, name)))


def shake_as_inherited() -> None:
    """In a subprocess whose numbers are compared with those of the tests: shake by the seed of these, if they shake."""
    if VARIABLE in os.environ:
        shake(int(os.environ[VARIABLE]))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--shake", type=int, metavar="SEED", help="shake results of linear algebra in the last place")


def pytest_configure(config: pytest.Config) -> None:
    seed = config.getoption("--shake")
    if seed is None and VARIABLE in os.environ:
        seed = int(os.environ[VARIABLE])
    if seed is not None:
        os.environ[VARIABLE] = str(seed)
        shake(seed)


def pytest_report_header() -> list[str]:
    """Which processor the numbers are those of."""
    names = (VARIABLE, "OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "GLIBC_TUNABLES")
    return [f"{name}={os.environ[name]}" for name in names if os.environ.get(name)]
