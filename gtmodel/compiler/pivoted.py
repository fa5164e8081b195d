"""QR with column pivoting under a type that checkers understand."""

from __future__ import annotations

from typing import cast

import numpy as np
import scipy


def pivoted_qr(a: np.ndarray, mode: str = "full") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Q, R and the column order, largest remaining column first; mode "full" or "economic"."""
    return cast("tuple[np.ndarray, np.ndarray, np.ndarray]", scipy.linalg.qr(a, mode=mode, pivoting=True))
