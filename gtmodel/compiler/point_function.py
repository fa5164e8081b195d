"""A CasADi function at one point: NumPy memory that stays, so that a call costs hardly more than its arithmetic."""

from __future__ import annotations

from threading import Lock
from typing import Any

import casadi as ca
import numpy as np


def densified(f: ca.Function) -> ca.Function:
    """The same function with results that are dense."""
    if all(f.sparsity_out(k).is_dense() for k in range(f.n_out())):
        return f
    symbols = f.sx_in()
    return ca.Function(f.name(), symbols, [ca.densify(r) for r in f.call(symbols)])


class PointFunction:
    """A function of columns, called with arrays or numbers; gives each result as an array of its shape.

    The results are new at each call; calls from several threads wait for one another.
    """

    def __init__(self, f: ca.Function) -> None:
        f = densified(f)
        self._arguments = [np.zeros(f.numel_in(k)) for k in range(f.n_in())]
        self._results = [np.zeros((f.size2_out(k), f.size1_out(k))) for k in range(f.n_out())]
        self._buffer, self._run = f.buffer()
        set_arg: Any = self._buffer.set_arg
        set_res: Any = self._buffer.set_res
        places: list[tuple[Any, list[Any]]] = [(set_arg, self._arguments), (set_res, self._results)]
        for setter, arrays in places:
            for k, a in enumerate(arrays):
                if a.size:
                    setter(k, memoryview(a))
        self._lock = Lock()

    def __call__(self, *values: Any) -> list[np.ndarray]:
        with self._lock:
            for argument, value in zip(self._arguments, values, strict=True):
                argument[:] = value
            self._run()
            return [r.T.copy() for r in self._results]
