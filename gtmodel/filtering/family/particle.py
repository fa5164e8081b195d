"""Particle filter with the linearised optimal proposal: each particle uses the reading before it moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from ...results.refusal import ArgumentError, naming
from ..belief import Belief, InitialState, Innovation
from ..error_state import Filter, joseph
from ..spread import UsedNumbers, moments, roots, spread_of
from ..system import System
from .interacting import log_sum

Proposal = Literal["optimal", "bootstrap"]
SINGULAR = 1e-7  # determinant of a factor of correlations: below, states are correlated to within round-off
LEAST_SHARE = 0.05  # of the particles: a bootstrap with a smaller effective size is refused


class Looked(NamedTuple):
    """Correction of the particles at a reading: process noise before it (n, n) or (m, N, n, n), gains (m, N, n, k),
    Jacobians (m, N, k, n), variances of the readings (m, N, k)."""

    Q: np.ndarray
    K: np.ndarray
    H: np.ndarray
    R: np.ndarray


class Cloud(NamedTuple):
    """Particles of m runs, each the mean of a Gaussian from which it is drawn when it moves on.

    x: (m, N, size). logs: logarithms of their weights (m, N). pending: covariance around each, (n, n) or (m, N, n, n):
    process noise since the previous reading, after correction by the last one; initially the whole uncertainty.
    looked: correction at the last reading. effective: 1 / sum of squared weights (m,). instants: number of readings.
    """

    time: float
    x: np.ndarray
    logs: np.ndarray
    pending: np.ndarray
    looked: Looked | None
    effective: np.ndarray
    instants: int


class ParticleFilter(Filter):
    """Particle filter with the proposal p(x_k | x_(k-1), z_k), linearised at each particle.

    The weight of a particle is the likelihood of the reading before the particle moves; its new state is drawn from the
    posterior given process and reading, which is exact for linear readings. The draw happens at the next step, so mean
    and covariance are those of the mixture of Gaussians, with less variance than those of the draws. The proposal
    "bootstrap" moves particles with the process alone. If the readings are much more accurate than the process, it
    leaves one particle with all the weight; it is then refused, with the expected effective size. Below half of the
    particles in effective size, particles are resampled systematically. `Filtered.effective` holds the effective size
    at each instant; a note summarises it.

    Marginalised (Rao-Blackwellised) states are not drawn: each particle keeps a Gaussian of them, conditional on its
    drawn states, as its own Kalman filter. Draw the states that enter process or readings nonlinearly, and marginalise
    the others: fewer drawn states need fewer particles. All readings weigh all particles, so each drawn state of one
    axis costs particles for the other axes too, even if the axes are independent.

    Args:
        system: process and sensors.
        particles: number of particles.
        seed: of all draws; the same seed gives the same numbers.
        proposal: "optimal" or "bootstrap".
        marginalised: names of the states that are not drawn.

    Source: Doucet, Godsill, Andrieu 2000, Statistics and Computing 10, 197-208; for marginalised states Schön,
    Gustafsson, Nordlund 2005, IEEE Transactions on Signal Processing 53, 2279-2289.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-2])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> log = {"tape": gt.filtering.Readings(0.1 * np.arange(20), np.linspace(0, 1, 20))}
    >>> filter = gt.filtering.ParticleFilter(system, particles=500, seed=1)
    >>> run = filter.run(log, gt.filtering.InitialState({}, {"x": 0.1}))
    >>> run["x"][-1].round(2), int(run.effective.min()) > 250
    (np.float64(1.0), True)
    """

    def __init__(
        self,
        system: System,
        *,
        particles: int = 1000,
        seed: int = 0,
        proposal: Proposal = "optimal",
        marginalised: Sequence[str] = (),
    ) -> None:
        super().__init__(system)
        if particles < 2:
            raise ArgumentError(f"expected at least 2; found {particles}", "particles")
        if proposal not in ("optimal", "bootstrap"):
            raise ArgumentError(f"expected 'optimal' or 'bootstrap'; found {proposal!r}", "proposal")
        undrawn = {i for name in marginalised for i in _along(system, name)}
        if undrawn and proposal == "bootstrap":
            raise ArgumentError("the bootstrap proposal draws every state; use proposal='optimal'", "marginalised")
        if len(undrawn) == system.space.dimension:
            raise ArgumentError("no state is left to draw; use 'kf' or 'ekf', or leave a state out", "marginalised")
        self.particles, self.seed, self.proposal = particles, seed, proposal
        self.drawn = [i for i in range(system.space.dimension) if i not in undrawn]

    def begin(self, start: InitialState, time: float, runs: int = 1) -> Cloud:
        """Return undrawn particles at the mean: until the first reading the cloud is the initial Gaussian."""
        belief, N = start.belief(self.system, time, runs), self.particles
        x = np.repeat(belief.x[:, None], N, axis=1)
        return Cloud(belief.time, x, np.full((runs, N), -np.log(N)), belief.P[0], None, np.full(runs, float(N)), 0)

    def advance(self, belief: Cloud, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Cloud, None]:
        """Draw each particle and move it to a later time, its process noise pending; no change at the same time."""
        if time == belief.time:
            return belief, None
        if belief.looked is not None:
            belief = self._drawn(belief, belief.looked)
        m, N, size = belief.x.shape
        step = self.system.transition(belief.time, time - belief.time, belief.x.reshape(m * N, size), u0, u1)
        F, Q = (a if a.ndim == 2 else a.reshape(m, N, *a.shape[1:]) for a in (step.F, step.Q))
        pending = F @ belief.pending @ F.mT + Q if belief.pending.any() else Q
        return belief._replace(time=time, x=step.x.reshape(m, N, size), pending=pending), None

    def _drawn(self, belief: Cloud, looked: Looked) -> Cloud:
        """Resample the particles if the effective size is small, then draw each from its Gaussian."""
        m, N, n = *belief.logs.shape, self.system.space.dimension
        rng = np.random.default_rng([self.seed, belief.instants])
        which, logs = np.tile(np.arange(N), (m, 1)), belief.logs
        for run in np.flatnonzero(belief.effective < N / 2):
            logs = logs.copy() if logs is belief.logs else logs
            which[run], logs[run] = _systematic(np.exp(logs[run]), rng.random()), -np.log(N)
        runs = np.arange(m)[:, None]
        if len(self.drawn) < n:
            d, pending = self._partly_drawn(belief.pending[runs, which], rng)
        else:
            Q, K, H, R = (a if a.ndim == 2 else a[runs, which] for a in looked)
            # a draw from the process, corrected by the reading with drawn measurement noise (Matheron's rule)
            noise = _draws(Q, rng, (m, N, n))[..., None]
            drawn_noise = (rng.standard_normal(R.shape) * np.sqrt(R))[..., None]
            d, pending = (noise - K @ (H @ noise + drawn_noise))[..., 0], np.zeros((n, n))
        return belief._replace(
            x=self.system.space.plus(belief.x[runs, which], d), logs=logs, pending=pending, looked=None
        )

    def _partly_drawn(self, P: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """For Gaussians with covariances P (m, N, n, n): errors (m, N, n), drawn for the drawn states and conditional
        means for the others, and the conditional covariances of these."""
        m, N, k = *P.shape[:2], len(self.drawn)
        # scaled to a diagonal of ones; a drawn state without noise has zeros and does not move
        scale = np.sqrt(P.diagonal(0, 2, 3)[..., self.drawn])
        unit = P[..., self.drawn] / np.where(scale > 0, scale, np.inf)[..., None, :]
        square = unit[..., self.drawn, :] / np.where(scale > 0, scale, np.inf)[..., None]
        L = roots(square.reshape(-1, k, k)).reshape(m, N, k, k)
        regular = np.abs(np.linalg.det(L)).min() > SINGULAR
        G = np.linalg.solve(L, unit.mT).mT if regular else unit @ np.linalg.pinv(L, rcond=SINGULAR).mT
        d = (G @ rng.standard_normal((m, N, k, 1)))[..., 0]
        remaining = P - G @ G.mT
        remaining[..., self.drawn, :] = 0.0
        remaining[..., self.drawn] = 0.0
        return d, remaining

    def correct(self, belief: Cloud, names: tuple[str, ...], z: np.ndarray, u: np.ndarray) -> tuple[Cloud, Innovation]:
        """Return the cloud after readings z (m, numbers) of these sensors, side by side, and the innovation."""
        system, space = self.system, self.system.space
        m, N, size = belief.x.shape
        n, reading, weights = space.dimension, system.reading(names), np.exp(belief.logs)
        x, zs, pending = belief.x.reshape(m * N, size), np.repeat(z, N, axis=0), belief.pending
        residual, H = reading(belief.time, x, u, zs)
        k = residual.shape[1]
        Q = np.broadcast_to(pending, (m, N, n, n)).reshape(m * N, n, n)
        innovation, choice = self._innovation(names, residual.reshape(m, N, k), H.reshape(m, N, k, n), Q, weights)
        if self.proposal == "bootstrap":
            self._refuse(belief, H.reshape(m, N, k, n), choice.used, weights, system.variances(names))
            rng = np.random.default_rng([self.seed, belief.instants, 1])
            x = space.plus(x, _draws(pending, rng, (m, N, n)).reshape(m * N, n))
            residual, H = reading(belief.time, x, u, zs)
            pending, Q = np.zeros((n, n)), np.zeros_like(Q)
        PH = Q @ H.mT
        larger = choice.larger if np.ndim(choice.larger) == 0 else np.repeat(choice.larger, N, axis=0)
        each = UsedNumbers(np.repeat(choice.used, N, axis=0), larger)
        spread = spread_of(system, names, residual, H @ PH, PH, each)
        solved = spread.solved()
        logs = belief.logs + spread.innovation(names, solved).log_likelihood.reshape(m, N)
        total = log_sum(logs)
        logs = logs - total[:, None]
        x = space.plus(x, (solved.K @ spread.residual[..., None])[..., 0])
        H = H if choice.used.all() else np.where(spread.used[..., None], H, 0.0)
        R = np.broadcast_to(spread.R, residual.shape)
        looked = Looked(pending, *(a.reshape(m, N, *a.shape[1:]) for a in (solved.K, H, R)))
        corrected = Cloud(
            belief.time, x.reshape(m, N, size), logs, joseph(Q, solved.K, H, R).reshape(m, N, n, n), looked,
            1 / np.sum(np.exp(2 * logs), axis=1), belief.instants + 1,
        )  # fmt: skip
        return corrected, innovation._replace(log_likelihood=total)

    def _innovation(
        self, names: tuple[str, ...], residual: np.ndarray, H: np.ndarray, Q: np.ndarray, weights: np.ndarray
    ) -> tuple[Innovation, UsedNumbers]:
        """Innovation of the whole cloud and the used readings: gates apply to the cloud, not to a particle."""
        m, N, k, n = H.shape
        mean = np.sum(weights[..., None] * residual, axis=1)
        difference = np.where(np.isfinite(residual), residual - mean[:, None], 0.0)
        S = np.einsum("mp,mpij->mij", weights, H @ Q.reshape(m, N, n, n) @ H.mT) + moments(difference, weights)
        spread = spread_of(self.system, names, mean, S, np.empty((m, 0, k)))
        return spread.innovation(names, spread.solved()), spread.choice

    def _refuse(self, belief: Cloud, H: np.ndarray, used: np.ndarray, weights: np.ndarray, R: np.ndarray) -> None:
        """Raise ArgumentError if the bootstrap would leave too few particles with weight."""
        P = self.summary(belief).P
        mean = np.einsum("mp,mpij->mij", weights, H) / np.sqrt(R)[:, None] * used[..., None]
        ratios = np.linalg.eigvalsh(mean @ P @ mean.mT)
        share = float(expected_share(ratios).min())
        if share < LEAST_SHARE:
            raise ArgumentError(
                f"the bootstrap proposal collapses at {belief.time:g} s: of {self.particles} particles about "
                f"{max(1.0, share * self.particles):.3g} would keep weight, since the readings are up to "
                f"{np.sqrt(ratios.max()):.3g} times more accurate than their prediction; use proposal='optimal'",
                "proposal",
            )

    def summary(self, belief: Cloud) -> Belief:
        """Return mean and covariance of the cloud."""
        space, weights = self.system.space, np.exp(belief.logs)
        likeliest = belief.x[np.arange(len(weights)), np.argmax(weights, axis=1)]
        x = space.mean(belief.x, weights, likeliest)
        P = moments(space.minus(belief.x, x[:, None]), weights)
        pending = belief.pending
        return Belief(
            belief.time, x, P + (pending if pending.ndim == 2 else np.einsum("mp,mpij->mij", weights, pending))
        )

    def details(self, belief: Cloud) -> Mapping[str, np.ndarray]:
        """Return the effective size."""
        return {"effective": belief.effective}


def _along(system: System, name: str) -> range:
    """Components of an error that belong to a state."""
    with naming("marginalised"):
        along = system.space.part(name)[2]
    return range(along.start, along.stop)


def expected_share(ratios: Any) -> np.ndarray:
    """Return the expected effective share of particles after weighting by a reading, a geometric mean over readings.

    ratios: eigenvalues (..., k) of R^-1 H P H', the predicted variance over the variance of the reading's noise.

    >>> from gtmodel.filtering.family.particle import expected_share
    >>> expected_share([[0.0], [1.0], [1e6]]).round(4).tolist()  # a ratio of deviations of 1, and of a thousand
    [1.0, 0.6205, 0.0009]
    """
    r = np.maximum(np.asarray(ratios, float), 0.0)
    return np.exp(np.sum(0.5 * np.log1p(2 * r) - np.log1p(r) - r / (1 + 2 * r), axis=-1))


def _draws(covariance: np.ndarray, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Draws (m, N, n) with zero mean."""
    free = rng.standard_normal(shape)
    if not covariance.any():
        return np.zeros(shape)
    n = shape[-1]
    L = roots(covariance.reshape(-1, n, n))
    return free @ L[0].T if len(L) == 1 else (L @ free.reshape(-1, n, 1)).reshape(shape)


def _systematic(weights: np.ndarray, offset: float) -> np.ndarray:
    """Indices of the resampled particles: evenly spaced on the cumulated weights."""
    ends = np.cumsum(weights)
    positions = (np.arange(len(weights)) + offset) / len(weights) * ends[-1]
    return np.minimum(np.searchsorted(ends, positions), len(weights) - 1)
