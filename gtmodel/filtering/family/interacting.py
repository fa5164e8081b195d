"""Interacting multiple models: several systems that differ in noise or parameters, with their probabilities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...results.refusal import ArgumentError
from ..belief import Belief, InitialState, Innovation
from ..error_state import ErrorState, Filter
from ..spread import moments, spread_of
from ..system import System, agree_in_shape
from ..transition import Advance

NEVER = -1e300  # logarithm of zero probability; stays finite in sums


class Mixture(NamedTuple):
    """One belief per mode, and the log-probabilities of the modes (m, modes)."""

    modes: tuple[Belief, ...]
    logs: np.ndarray

    @property
    def time(self) -> float:
        """Time [s]."""
        return self.modes[0].time

    @property
    def probabilities(self) -> np.ndarray:
        """Probabilities of the modes (m, modes)."""
        return np.exp(self.logs)


class Interacting(Filter):
    """Interacting multiple models: an error-state filter for each system, mixed before each step.

    The true system may change from one instant to the next, as a Markov chain. Means are mixed as intrinsic means, with
    minus and plus. Log-likelihood, residuals and their covariance are those of the mixture. Gates and outlier weights
    also apply to the mixture, so that all modes use the same readings.

    Args:
        systems: two or more with the same states and sensors, such as `system.with_(noise={"jerk": 1e6})`.
        stay: probability of staying in a mode from one instant to the next, the others being equally likely; or the
            whole transition matrix, from row to column.
        probabilities: of the modes at the start; equal if left out.
        iterations: of each correction, as in `ErrorState`.

    Source: Blom, Bar-Shalom 1988, IEEE Trans. Autom. Control 33, 780-783.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> tape = gt.filtering.Sensor("tape", "x", deviation=0.01)
    >>> def walk(variance):
    ...     process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [variance])
    ...     return gt.filtering.System(process, [tape])
    >>> t = 0.1 * np.arange(40)
    >>> log = {"tape": gt.filtering.Readings(t, np.where(t < 2, 0.0, t - 2))}
    >>> filter = gt.filtering.Interacting([walk(1e-6), walk(1e-2)], stay=0.95)
    >>> run = filter.run(log, gt.filtering.InitialState({}, {"x": 0.1}))
    >>> run.mode_probabilities[[15, 30], 0, 1].round(1).tolist()
    [0.0, 1.0]
    """

    def __init__(
        self, systems: Sequence[System], *, stay: Any = 0.99, probabilities: Any = None, iterations: int = 1
    ) -> None:
        systems = [*systems]
        if len(systems) < 2:
            raise ArgumentError(f"expected two or more systems; found {len(systems)}", "systems")
        first = systems[0]
        super().__init__(first)
        agree_in_shape(systems)
        self.filters = [ErrorState(system, iterations=iterations) for system in systems]
        self.chances = _chances(stay, len(systems))
        p = np.full(len(systems), 1 / len(systems)) if probabilities is None else np.asarray(probabilities, float)
        if p.shape != (len(systems),) or not np.all(p >= 0) or abs(p.sum() - 1) > 1e-9:
            raise ArgumentError(
                f"expected {len(systems)} probabilities that sum to 1; found {probabilities!r}", "probabilities"
            )
        self.first = _logs(p)

    def begin(self, start: InitialState, time: float, runs: int = 1) -> Mixture:
        """Return the same initial belief for all modes."""
        beliefs = tuple(start.belief(filter.system, time, runs) for filter in self.filters)
        return Mixture(beliefs, np.tile(self.first, (runs, 1)))

    def advance(
        self, belief: Mixture, time: float, u0: np.ndarray, u1: np.ndarray
    ) -> tuple[Mixture, tuple[Advance, ...]]:
        """Mix the modes and advance each one; return them and their steps. At the same time nothing is mixed."""
        return self.advanced(belief, time, u0, u1, ())

    def advanced(
        self, belief: Mixture, time: float, u0: np.ndarray, u1: np.ndarray, bends: Sequence[tuple[float, np.ndarray]]
    ) -> tuple[Mixture, tuple[Advance, ...]]:
        """As `advance`, with known inputs whose slope changes in between; the modes are mixed once."""
        if time > belief.time:
            belief = self._mixed(belief)
        pairs = zip(self.filters, belief.modes, strict=True)
        advanced = [filter.advanced(mode, time, u0, u1, bends) for filter, mode in pairs]
        return Mixture(tuple(mode for mode, _ in advanced), belief.logs), tuple(step for _, step in advanced)

    def _mixed(self, belief: Mixture) -> Mixture:
        """Mix the beliefs: each mode starts from all modes, weighted with the probability that it follows them."""
        joint = belief.probabilities[:, :, None] * self.chances
        after = joint.sum(axis=1)
        # a mode with probability zero keeps its own belief
        weights = np.where(after[:, None] > 0, joint, np.eye(len(self.filters)))
        x, P = _combined(self.system, belief.modes, (weights / weights.sum(axis=1, keepdims=True)).mT)
        modes = tuple(Belief(belief.time, x[:, n], P[:, n]) for n in range(len(belief.modes)))
        return Mixture(modes, _logs(after))

    def correct(
        self, belief: Mixture, names: tuple[str, ...], z: np.ndarray, u: np.ndarray
    ) -> tuple[Mixture, Innovation]:
        """Return all modes after the readings with their new probabilities, and the innovation of the mixture."""
        pairs = [*zip(self.filters, belief.modes, strict=True)]
        measured = [filter.seen(mode, names, z, u) for filter, mode in pairs]
        chances = belief.probabilities
        residuals = np.stack([residual for residual, _, _, _ in measured], axis=1)
        residual = np.sum(chances[..., None] * residuals, axis=1)
        difference = np.where(np.isfinite(residuals), residuals - residual[:, None], 0.0)
        S = moments(difference, chances)
        variances = self.system.variances(names)
        for n, (filter, (_, _, S_mode, _)) in enumerate(zip(self.filters, measured, strict=True)):
            S += chances[:, n, None, None] * (S_mode + np.diag(filter.system.variances(names) - variances))
        mixed = spread_of(self.system, names, residual, S, np.empty((len(S), 0, S.shape[-1])))
        beliefs, logs = [], belief.logs.copy()
        for n, ((filter, mode), (residual, H, S, PH)) in enumerate(zip(pairs, measured, strict=True)):
            spread = spread_of(filter.system, names, residual, S, PH, mixed.choice)
            solved = spread.solved()
            logs[:, n] += spread.innovation(names, solved).log_likelihood
            beliefs.append(filter.corrected(mode, names, z, u, spread, solved.K, H))
        total = log_sum(logs)
        innovation = mixed.innovation(names, mixed.solved())._replace(log_likelihood=total + mixed.edge)
        return Mixture(tuple(beliefs), np.maximum(logs - total[:, None], NEVER)), innovation

    def details(self, belief: Mixture) -> Mapping[str, np.ndarray]:
        """Return the probabilities of the modes."""
        return {"mode_probabilities": belief.probabilities}

    def summary(self, belief: Mixture) -> Belief:
        """Return mean and covariance of the mixture."""
        x, P = _combined(self.system, belief.modes, belief.probabilities[:, None])
        return Belief(belief.time, x[:, 0], P[:, 0])


def _combined(system: System, modes: Sequence[Belief], weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (m, mixtures, size) and covariances of mixtures of beliefs with weights (m, mixtures, modes)."""
    space, (m, count, k) = system.space, weights.shape
    x, P = (np.repeat(np.stack(v, axis=1), count, axis=0) for v in zip(*((b.x, b.P) for b in modes), strict=True))
    w = weights.reshape(m * count, k)
    mean = space.mean(x, w, x[np.arange(m * count), np.argmax(w, axis=1)])
    d = space.minus(x, mean[:, None])
    if system.curved_errors:
        J = space.carried(x.reshape(m * count * k, -1), -d.reshape(m * count * k, -1)).reshape(P.shape)
        P = J @ P @ J.mT
    P = np.einsum("mk,mkij->mij", w, P) + moments(d, w)
    return mean.reshape(m, count, -1), P.reshape(m, count, *P.shape[1:])


def log_sum(logs: np.ndarray) -> np.ndarray:
    """Logarithm of the sum over the last axis, from logarithms."""
    most = logs.max(axis=-1)
    return most + np.log(np.sum(np.exp(logs - most[..., None]), axis=-1))


def _logs(p: np.ndarray) -> np.ndarray:
    return np.log(p, out=np.full_like(p, NEVER), where=p > 0)


def _chances(stay: Any, modes: int) -> np.ndarray:
    """Transition probabilities from mode to mode."""
    try:
        p = np.asarray(stay, float)
    except (TypeError, ValueError):
        p = np.full(3, np.nan)
    if p.ndim == 0 and 0 < p <= 1:
        return np.where(np.eye(modes, dtype=bool), p, (1 - p) / (modes - 1))
    if p.shape != (modes, modes) or not np.all(p >= 0) or np.any(np.abs(p.sum(axis=1) - 1) > 1e-9):
        raise ArgumentError(
            f"expected a probability, or ({modes}, {modes}) of them with rows that sum to 1; found {stay!r}",
            "stay",
        )
    return p
