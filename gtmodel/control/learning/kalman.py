"""The Kalman filter of Dressler 2012, (7.21) and (7.22): a model of the tool, corrected by an accelerometer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from ..._lazy import hint
from ..._pickling import Portable
from ...linear.state_space import settled_covariance
from ...results import ArgumentError
from .plants import SampledSystem, frequency_response, pulse_response

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")

DECADES = (-20.0, 0.0)  # range of log10 of the process noise in the search


@dataclass(frozen=True, eq=False)
class ExtendedKalman(Portable):
    """Kalman filter for a model x(t + T) = A x + B u, z = C x, extended by the tool's velocity and acceleration.

    model: discrete, from z_c [m], or from z_c at this and the following samples, to the tool z [m]; `tool_model`, or
    the system of `gtmodel.vibration.identify_subspace`. process: r of R1 = r I. noise: standard deviation of the
    accelerometer [m/s2].

    x_a is the *backward* second difference of z, delayed by one sample, so it is compared with the previous reading.
    Only the acceleration corrects the state, because z is not measured (the text of (7.22) prints all outputs). Raises
    ArgumentError for a model with feedthrough, several outputs or in continuous time, if process or noise is not
    positive, and on computing the gain if the acceleration does not observe an undamped part of the model.

    >>> learning = gt.control.learning
    >>> filter = learning.ExtendedKalman(learning.tool_model(11.5, 0.05), process=1e-12, noise=0.07)
    >>> filter.gain.shape  # two states, velocity, acceleration
    (4,)
    """

    model: SampledSystem | StateSpace
    process: float
    noise: float

    def __post_init__(self) -> None:
        if not (self.process > 0 and self.noise > 0):
            raise ArgumentError("process and noise must be above 0", "process")
        if self.model.noutputs != 1 or not self.model.isdtime(strict=True) or not self.model.nstates:
            raise ArgumentError("expected a discrete-time model with states and one output, the tool", "model")
        if np.any(np.asarray(self.model.D)):
            raise ArgumentError("the model has feedthrough, unlike (7.19); identify it without", "model")

    @property
    def sample_time(self) -> float:
        """Sampling period [s]."""
        return float(self.model.dt)

    @cached_property
    def extended(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Abar, Bbar and the row of the acceleration, (7.21)."""
        A, B, C = (np.asarray(m, float) for m in (self.model.A, self.model.B, self.model.C))
        n, T = len(A), self.sample_time
        big = np.zeros((n + 2, n + 2))
        big[:n, :n] = A
        big[n, :n] = C @ (A - np.eye(n)) / T
        big[n + 1, :n] = C @ (A - np.eye(n)) / T**2
        big[n + 1, n] = -1 / T
        return big, np.vstack([B, C @ B / T, C @ B / T**2]), np.eye(n + 2)[n + 1 :]

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of the predicted state, from the Riccati equation."""
        A, _, H = self.extended
        try:
            return settled_covariance(A, H, self.process * np.eye(len(A)), np.array([self.noise**2]))
        except np.linalg.LinAlgError:
            poles = np.abs(np.linalg.eigvals(np.asarray(self.model.A, float)))
            raise ArgumentError(
                "the acceleration does not observe an undamped part of the model, so no filter exists; the largest "
                f"modulus of its poles is {poles.max():.6g}: use a model without this part, for example another order",
                "model",
            ) from None

    @cached_property
    def innovation_variance(self) -> float:
        """Variance of the acceleration minus its prediction [m2/s4]."""
        H = self.extended[2]
        return float((H @ self.covariance @ H.T)[0, 0] + self.noise**2)

    @cached_property
    def gain(self) -> np.ndarray:
        """K = A P H' / (H P H' + R), for the predictor form of (7.22)."""
        A, _, H = self.extended
        return (A @ self.covariance @ H.T)[:, 0] / self.innovation_variance

    @cached_property
    def system(self) -> SampledSystem:
        """The filter from z_c (this and following samples) and acceleration to zhat and the predicted acceleration."""
        A, B, H = self.extended
        n = len(A)
        # one more state: the previous reading
        big = np.zeros((n + 1, n + 1))
        big[:n, :n], big[:n, n] = A - np.outer(self.gain, H[0]), self.gain
        inputs = np.zeros((n + 1, B.shape[1] + 1))
        inputs[:n, :-1], inputs[n, -1] = B, 1.0
        C = np.zeros((2, n + 1))
        C[0, : n - 2] = np.asarray(self.model.C, float)[0]
        C[1, :n] = H[0]
        return SampledSystem(big, inputs, C, np.zeros((2, B.shape[1] + 1)), self.sample_time)

    def pulses(self, size: int) -> list[np.ndarray]:
        """Return pulse responses (size,) of zhat to each input; the last input is the acceleration."""
        return [pulse_response(self._from(k, 0), size) for k in range(self.system.ninputs)]

    def response(self, frequency: np.ndarray, column: int) -> np.ndarray:
        """Return the response (k,) of zhat to an input at frequencies (k,) in Hz."""
        return frequency_response(self._from(column, 0), frequency)

    def innovations(self, motor: Any, acceleration: Any) -> np.ndarray:
        """Return the innovations (N,): previous acceleration minus its prediction over its standard deviation, white
        with variance 1 if the filter is right.

        motor, acceleration: (N,) of a run that starts at rest. Raises ArgumentError if they are not finite (N,).
        """
        zc, a = np.asarray(motor, float), np.asarray(acceleration, float)
        for name, values in (("motor", zc), ("acceleration", a)):
            if values.shape != (len(a),) or not np.all(np.isfinite(values)):
                raise ArgumentError(f"expected {len(a)} finite numbers; found {values.shape}, or not finite", name)
        ahead = [np.append(zc[k:], np.full(k, zc[-1])) for k in range(self.system.ninputs - 1)]
        predicted = np.zeros(len(a))
        for k, u in enumerate([*ahead, a]):
            predicted += scipy.signal.fftconvolve(pulse_response(self._from(k, 1), len(a)), u)[: len(a)]
        return (np.append(0.0, a[:-1]) - predicted) / np.sqrt(self.innovation_variance)

    def log_likelihood(self, motor: Any, acceleration: Any) -> float:
        """Return the log-likelihood of the innovations of a run (N,), without the constant."""
        v = self.innovations(motor, acceleration)
        return float(-0.5 * (v @ v + len(v) * np.log(self.innovation_variance)))

    def _from(self, column: int, row: int) -> SampledSystem:
        s = self.system
        return SampledSystem(
            s.A, np.asarray(s.B)[:, column : column + 1], np.asarray(s.C)[row : row + 1], [[0.0]], self.sample_time
        )


def most_likely_filter(
    model: SampledSystem | StateSpace, motor: Any, acceleration: Any, noise: float
) -> ExtendedKalman:  # fmt: skip
    """Return the filter with the process noise that maximises the likelihood of the innovations of a run (N,).

    Arguments as in `ExtendedKalman`; motor [m], acceleration [m/s2]: (N,), from rest. The tool is not used.

    >>> learning = gt.control.learning
    >>> rng = np.random.default_rng(1)
    >>> filter = learning.most_likely_filter(
    ...     learning.tool_model(11.5, 0.05), np.zeros(300), 0.07 * rng.normal(size=300), 0.07
    ... )
    >>> bool(filter.process < 1e-8)  # the model explains the run
    True
    """

    def cost(decade: float) -> float:
        return -ExtendedKalman(model, 10.0**decade, noise).log_likelihood(motor, acceleration)

    grid = np.arange(DECADES[0], DECADES[1] + 1, 2.0)
    values = [cost(d) for d in grid]
    best = float(grid[int(np.argmin(values))])
    within = (max(best - 2, DECADES[0]), min(best + 2, DECADES[1]))
    refined = scipy.optimize.minimize_scalar(cost, bounds=within, method="bounded", options={"xatol": 0.05})
    return ExtendedKalman(model, 10.0 ** float(refined.x), noise)
