"""Robot poses in rows: coordinates, cart joints and plate joints of many tool centre points at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..compiler.causal import CausalFunction
from ..compiler.rows import RowFunction
from ..results import Status

Array = np.ndarray


@dataclass(frozen=True)
class Poses:
    """n poses of a robot with m actuators and l links.

    Attributes:
        T: (n, 3) tool centre points [m].
        q: (n, m) actuator coordinates [m or rad].
        a, b: (n, l, 3) the two ends of each link, at its cart and at the plate [m].
        status: (n,) codes of `Status`; other rows than OK are NaN.
    """

    T: Array
    q: Array
    a: Array
    b: Array
    status: Array

    def rows(self, chosen: Array) -> Poses:
        """Those rows alone."""
        return Poses(*(x[chosen] for x in (self.T, self.q, self.a, self.b, self.status)))

    @property
    def directions(self) -> Array:
        """(n, l, 3) unit vectors of the links, from cart to plate."""
        d = self.b - self.a
        return d / np.sqrt(np.einsum("nli,nli->nl", d, d))[..., None]


class InverseKinematics:
    """Tool centre points to `Poses`, from one function whose outputs are q and then both ends of every link.

    Args:
        function: called with T (n, 3); returns q (n, m), a_1 (n, 3), b_1 (n, 3), a_2, ..., and Status codes (n,).
            A CausalFunction will do; without Newton blocks it is cut loose from its model, so that it can be pickled.
        offsets: (l, 3) added to both ends of each link [m]: from the simplified joint A to the real one, R B_i of a
            plate that keeps its orientation (Dressler 2012, eq. (4.9)); zero if left out.
    """

    def __init__(self, function: Callable[..., Any], offsets: Array | None = None) -> None:
        self._causal = function if isinstance(function, CausalFunction) else None
        if isinstance(function, CausalFunction) and all(b.kind != "Newton" for b in function.plan.blocks):
            function = RowFunction(function)
        self._function = function
        self._offsets = None if offsets is None else np.asarray(offsets, dtype=float)

    def diagnose(self, T: Array) -> str:
        """One sentence on T (3,) [m]: ok, or why there is no pose; with the variable where it is known."""
        if self._causal is not None and np.isfinite(T).all():
            return self._causal.diagnose(T)
        return Status(int(self(np.asarray(T)[None]).status[0])).message

    def __getstate__(self) -> dict[str, Any]:
        # symbols stay at home; what is left computes the same numbers
        return {**self.__dict__, "_causal": None}

    def __call__(self, T: Array) -> Poses:
        """Poses of T (n, 3) [m]; a row without a solution is NaN and its status says why."""
        T = np.asarray(T, dtype=float)
        q, *ends, status = self._function(T)
        a, b = np.stack(ends[0::2], axis=1), np.stack(ends[1::2], axis=1)
        if self._offsets is not None:
            a, b = a + self._offsets, b + self._offsets
        status = np.asarray(status)
        finite = np.isfinite(T).all(axis=1)
        return Poses(T, q, a, b, np.where(finite, status, Status.NOT_FINITE))
