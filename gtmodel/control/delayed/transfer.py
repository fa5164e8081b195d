"""A transfer function from state matrices, quick at one z and at many: its matrix is made triangular once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

ON_A_POLE = 4 * np.finfo(float).eps  # of z: an eigenvalue is known no closer, so that a pole is met or not by chance


class Transfer:
    """leaves (z - A)^-1 entries: A (n, n), entries (n, k), leaves (n,), by the Schur form of the balanced A.

    One z is a Python number and many are an array: the same lines serve both, and a single z costs no call of NumPy.

    >>> from gtmodel.control.delayed.transfer import Transfer
    >>> lag = Transfer(np.array([[0.5]]), np.array([[2.0]]), np.array([1.0]))
    >>> lag.at(1.0 + 0j, [1.0]), lag.at(np.array([1.0 + 0j, -0.5 + 0j]), [1.0])
    ((4+0j), array([ 4.+0.j, -2.+0.j]))
    """

    def __init__(self, A: np.ndarray, entries: np.ndarray, leaves: np.ndarray) -> None:
        # balanced by powers of two, which round nothing: else a fast state takes the digits of a slow one
        balanced, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
        triangle, turn = scipy.linalg.schur(balanced, output="complex")
        self._rows: list[list[complex]] = triangle.tolist()
        self._entries: list[list[complex]] = (turn.conj().T @ (entries / scale[:, None])).tolist()
        self._leaves: list[complex] = ((leaves * scale) @ turn).tolist()

    def at(self, z: Any, inputs: Sequence[Any]) -> Any:
        """The output for `inputs`, one for each column of entries; one z or an array of them. At a pole, as close as
        rounding tells, a single z raises ZeroDivisionError, and one of an array is divided by zero."""
        x, out = [z] * len(self._rows), 0 * z
        for i in range(len(x) - 1, -1, -1):
            row = self._rows[i]
            right = 0 * z
            for entry, size in zip(self._entries[i], inputs, strict=True):
                right = right + entry * size
            for j in range(i + 1, len(x)):
                right = right + row[j] * x[j]
            apart = z - row[i]
            x[i] = right / (apart * (abs(apart) > ON_A_POLE * abs(z)))
            out = out + self._leaves[i] * x[i]
        return out
