"""A causal function along a motion: Newton's unknowns begin where they were an instant before."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..compiler.causal import CausalFunction
from ..compiler.newton import NewtonKernel
from ..results import Status

STEPS = 8  # of Newton from the instant before; more say that it is not near
SAME = 1e-6  # relative and absolute: of values that Newton found from two sides
CONVERGED = 1e-12  # relative: corrections this small are round-off


class FollowedBranch:
    """The first target of a function at instants that follow one another closely, as an integrator asks for them.

    From the home pose on the function itself finds its unknowns, which takes several times as long: it is asked only at
    the first instant, and where Newton does not converge from the last one. What it says of margins, and whether it is
    on the same branch, is asked of all instants that were kept at once.

    >>> class Cubic(gt.Model):
    ...     x, u = gt.variable(), gt.input()
    ...     def equations(self):
    ...         yield self.x**3 + self.x == self.u
    >>> f = gt.motion.followed_branch.FollowedBranch(Cubic().causal(known="u", targets="x"))
    >>> [round(float(f.kept(u)[0]), 4) for u in (2.0, 2.1)], f.statuses()
    ([1.0, 1.0248], array([0, 0]))
    """

    def __init__(self, f: CausalFunction) -> None:
        self.f = f
        self.near: list[np.ndarray] = []
        self._kept: list[tuple[tuple[np.ndarray, ...], np.ndarray]] = []

    def __call__(self, *arguments: Any) -> np.ndarray:
        """The target (n,); NaN where the function fails."""
        columns = [np.asarray(a, float).reshape(-1) for a in arguments]
        given, unknowns = np.concatenate(columns), []
        for kernel, z in zip(self.f.kernels, self.near, strict=bool(self.near)):
            corrected = _corrected(kernel, z, given)
            if corrected is None:
                break
            unknowns.append(corrected)
            given = np.concatenate([given, corrected])
        if len(unknowns) < len(self.f.kernels):
            unknowns = [z.reshape(-1) for z in self.f.unknowns(*arguments)[0]]
        self.near = unknowns if all(np.all(np.isfinite(z)) for z in unknowns) else []
        return np.asarray(self.f.closed.call([ca.DM(a) for a in (*columns, *unknowns)])[0]).reshape(-1)

    def kept(self, *arguments: Any) -> np.ndarray:
        """The target at an instant that `statuses` will look at."""
        value = self(*arguments)
        self._kept.append((tuple(np.asarray(a, float) for a in arguments), value))
        return value

    def statuses(self) -> np.ndarray:
        """The function's own status at all instants that were kept, WRONG_BRANCH where it finds another value."""
        value, *_, status = self.f(*(np.array(column) for column in zip(*(a for a, _ in self._kept), strict=True)))
        own = np.array([v for _, v in self._kept])
        same = np.isclose(own, np.reshape(value, own.shape), rtol=SAME, atol=SAME).all(axis=1)
        return np.where((status == Status.OK) & ~same, Status.WRONG_BRANCH, status)


def _corrected(kernel: NewtonKernel, z: np.ndarray, given: np.ndarray) -> np.ndarray | None:
    """A solution from z by Newton; None where it is not reached in a few steps."""
    a, last = ca.DM(given), np.inf
    for _ in range(STEPS):
        r, jacobian = (v.full() for v in kernel.residual(z, a))
        try:
            step = np.linalg.solve(jacobian, r).reshape(-1)
        except np.linalg.LinAlgError:
            return None
        z, size = z - step, float(np.max(np.abs(step) / kernel.scale))
        if size <= CONVERGED:
            return z
        if not size < last:  # round-off, or not near
            return z if size <= 1e3 * CONVERGED else None
        last = size
    return None
