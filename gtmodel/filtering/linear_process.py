"""A linear process by its matrices, in continuous time or in steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..results.refusal import ArgumentError
from .correlated import covariance_matrix
from .manifold import Manifold, StatePart
from .process import ProcessEquations, only_named


class LinearProcess:
    """A linear process by its matrices, as papers and `control.StateSpace` have it, measured as "y".

    x' = A x + B u + w and y = C x + D u in continuous time, or of the next x where there is a period. The covariance of
    the readings stands at the sensor: `Sensor("y", covariance=R)`.

    Args:
        A: (n, n). C: (p, n).
        Q: covariance of w (n, n), per step, or per second in continuous time; (n,) for a diagonal. As a noise that
            `tune` may change it is "w".
        B, D: of the known inputs "u", (n, m) and (p, m); none if left out.
        period: of the steps [s]; continuous time if left out.

    The states are "x", n numbers. Raises ArgumentError for matrices whose shapes do not fit.

    >>> A, C = [[1.0, 0.1], [0.0, 1.0]], [[1.0, 0.0]]
    >>> process = gt.filtering.LinearProcess(A, C, [0.0, 1e-4], period=0.1)
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("y", covariance=[[0.01]])])
    >>> system.linear, system.space.labels
    (True, ('x[0]', 'x[1]'))
    """

    def __init__(self, A: Any, C: Any, Q: Any, *, B: Any = None, D: Any = None, period: float | None = None) -> None:
        self.A, self.C = (_matrix(value, name) for value, name in ((A, "A"), (C, "C")))
        n, p = len(self.A), len(self.C)
        self.B = np.zeros((n, 0)) if B is None else _matrix(B, "B")
        m = self.B.shape[1]
        self.D = np.zeros((p, m)) if D is None else _matrix(D, "D")
        for name, value, shape in (("A", self.A, (n, n)), ("C", self.C, (p, n)), ("B", self.B, (n, m)),
                                   ("D", self.D, (p, m))):  # fmt: skip
            if value.shape != shape:
                raise ArgumentError(f"expected the shape {shape}; found {value.shape}", name)
        if period is not None and not period > 0:
            raise ArgumentError(f"expected more than 0 s; found {period}", "period")
        self.period = period
        self.noise: dict[str, Any] = {"w": self._covariance(Q)}

    @classmethod
    def of(cls, plant: Any, Q: Any) -> LinearProcess:
        """The process of a `control.StateSpace`, or of anything that has A, B, C, D and dt; all inputs are known.

        Raises ArgumentError for a plant without them, and for a discrete one whose period is not stated.
        """
        missing = [name for name in "ABCD" if not hasattr(plant, name)]
        if missing:
            sentence = f"expected a state space with A, B, C and D; {type(plant).__name__} has no {missing[0]}"
            raise ArgumentError(sentence, "plant")
        dt = getattr(plant, "dt", None)
        if dt is True:
            raise ArgumentError("the plant is discrete, of a period that it does not state; give it a dt in s", "plant")
        own = [np.asarray(getattr(plant, name), float) for name in "ABCD"]
        return cls(own[0], own[2], Q, B=own[1] if own[1].size else None, D=own[3] if own[1].size else None,
                   period=float(dt) if dt else None)  # fmt: skip

    def _covariance(self, Q: Any) -> np.ndarray:
        return covariance_matrix(np.diag(Q) if np.ndim(Q) == 1 else Q, len(self.A), "Q", singular=True)

    def with_noise(self, **noise: Any) -> LinearProcess:
        """The same process with another covariance `w`. Raises ArgumentError for a noise of another name."""
        only_named(noise, self.noise, "noise")
        return LinearProcess(self.A, self.C, noise.get("w", self.noise["w"]), B=self.B, D=self.D, period=self.period)

    def intensity(self, sizes: Mapping[str, int]) -> np.ndarray:
        """Covariance of the noise (n, n), per second or per step."""
        return self.noise["w"]

    def unit_of(self, name: str) -> str:
        """Not stated by matrices: "?"."""
        return "?"

    def dynamics(self, signals: Sequence[str]) -> ProcessEquations:
        """Its equations as functions of columns."""
        wrong = [name for name in signals if name not in ("x", "y")]
        if wrong:
            raise ArgumentError(f"there is no '{wrong[0]}' to measure; there are 'y' and 'x'", "sensors")
        A, B, C, D = (ca.sparsify(ca.DM(M)) for M in (self.A, self.B, self.C, self.D))
        n, m = self.B.shape
        continuous = self.period is None

        def rates(t: Any, x: Any, u: Any, w: Any, p: Any) -> Any:
            after = ca.mtimes(A, x) + (ca.mtimes(B, u) if m else 0)
            return after + w if continuous else after

        def output(t: Any, x: Any, u: Any, p: Any) -> Any:
            return ca.mtimes(C, x) + (ca.mtimes(D, u) if m else 0)

        outputs = {"y": output, "x": lambda t, x, u, p: x}
        space = Manifold([StatePart("x", size=n, unit="?")])
        return ProcessEquations(
            space, {"u": m} if m else {}, {"w": n} if continuous else {}, rates,
            {name: outputs[name] for name in signals}, self.noise["w"], {}, period=self.period,
        )  # fmt: skip


def _matrix(value: Any, name: str) -> np.ndarray:
    try:
        M = np.atleast_2d(np.asarray(value, float))
    except (TypeError, ValueError):
        raise ArgumentError(f"expected a matrix of numbers; found {value!r}", name) from None
    if M.ndim != 2 or not np.isfinite(M).all():
        raise ArgumentError(f"expected a matrix of finite numbers; found {value!r}", name)
    return M
