"""What a smooth error of a link's end, the same wherever its actuator comes by again, does to a fit that lacks it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..results.estimate import Estimate
from .blocks import Block
from .calibration import Calibration

WAVES = 24  # per axis: enough for the least length below
BEYOND = 1.5  # half-width of the waves' range over that of the actuator, so that its ends are free
LENGTHS = np.geomspace(0.13, 2.0, 10)  # correlation lengths that are tried, of half the actuator's range
RATIOS = np.exp(np.linspace(-6.0, 16.0, 89))  # variances of the error over that of the noise
ALONG = 2.0 ** np.arange(-3, 4)  # sizes along the guideway over those across
FINE = 101  # points of the range over which no straight line is left
ABSORBED = 1e-6  # of a shift's size: what the unknowns leave of it where they can take it up


@dataclass(frozen=True, eq=False)
class SmoothErrors:
    """Sizes of the error [m], `along` the guideway and per axis `across` it, with the correlation `length` in units of
    q; `noise` [m] beside it; `covariance` (n, n) of the unknowns by both; `left` (N,) residuals without the error."""

    along: float
    across: float
    length: float
    noise: float
    covariance: np.ndarray
    left: np.ndarray


def with_smooth_errors(c: Calibration, position: str = "T") -> tuple[Estimate, dict[str, SmoothErrors]] | None:
    """The estimate with a covariance that counts smooth errors of the links' ends, by link; intervals are Student's.

    None where it is not known to be true: another cost than "length", priors, latent variables, several links that
    share an unknown, a link that several actuators move, or what smooth_errors() does not take. `position`: the
    measured end-effector, whose errors shift the ends as theirs do.
    """
    p = c.problem
    if c.estimate is None or c.cost != "length" or p.unknowns.priors or p.reading.latent.numel():
        return None
    N, n, links = len(p.measurements), len(c.x), {}
    covariance = np.zeros((n, n))
    degrees_of_freedom = N - max((len(b.columns) for b in p.lengths), default=0)
    for b in p.lengths:
        one = _of_link(c, b, position)
        if one is None or degrees_of_freedom < 1:
            return None
        links[p.labels[b.rows[0]]] = one
        covariance[np.ix_(b.columns, b.columns)] = one.covariance
    # few poses may see no error where there is one, or less noise than there is: never less than white noise leaves
    wider = np.maximum(1.0, np.sqrt(np.diag(c.estimate.covariance) / np.diag(covariance)))
    covariance *= np.outer(wider, wider)
    return replace(
        c.estimate, covariance=covariance, known_noise=False, degrees_of_freedom=float(degrees_of_freedom)
    ), links


def _of_link(c: Calibration, b: Block, position: str) -> SmoothErrors | None:
    p = c.problem
    places = p.reading.places
    if len(b.rows) != 1 or position not in places:
        return None
    r, J, By, _ = b.evaluate_all(p.reading.data, c.x[b.columns])
    moving = np.flatnonzero(np.any(By[:, 0, places[p.actuators]] != 0, axis=0))
    if len(moving) != 1:
        return None
    q = np.asarray(p.measurements.values[p.actuators])[:, moving[0]]
    normals, by_q = By[:, 0, places[position]], By[:, 0, places[p.actuators]][:, moving[0]]
    return smooth_errors(J[:, 0], r[:, 0], normals, q, -np.linalg.lstsq(normals, by_q, rcond=None)[0])


def smooth_errors(
    J: np.ndarray, residuals: np.ndarray, normals: np.ndarray, q: np.ndarray, v: np.ndarray
) -> SmoothErrors | None:
    """Smooth errors of a link's end, from residuals at the least-squares solution.

    J (N, n): Jacobian of the residuals (N,) [m] in the unknowns; normals (N, 3): that in the place of the link's end;
    q (N,): the actuator; v (3,): its guideway.

    The end is off by e(q), along and across the guideway a Gaussian process with a squared exponential covariance of
    which no straight line over the range of q is left: a straight guideway, A and v, is the line through its errors.
    Sizes, length and noise by restricted maximum likelihood on a grid. None where the unknowns do not take up shifts of
    the end that are constant or linear in q, as a link on a straight guideway does with A and v free: the line would
    be undetermined.
    Source: Patterson and Thompson 1971, Biometrika 58 (REML); Solin and Sarkka 2020, Statistics and Computing 30 (waves
    for the process).
    """
    N, n = J.shape
    x = 2 * (q - q.min()) / max(float(np.ptp(q)), 1e-300) - 1
    norms = np.linalg.norm(J, axis=0)
    if not np.all(norms > 0):
        return None
    Q, R = np.linalg.qr(J / norms)
    if N <= n or np.abs(np.diag(R)).min() < 1e-9:
        return None
    shifts = np.hstack([normals, x[:, None] * normals])
    if np.linalg.norm(shifts - Q @ (Q.T @ shifts)) > ABSORBED * np.linalg.norm(shifts):
        return None
    frequency = np.pi * np.arange(1, WAVES + 1) / (2 * BEYOND)
    waves = _without_line(x, frequency)
    axes = np.linalg.svd(v[None])[2].T  # the guideway's direction, and two across
    Z = ((normals @ axes)[:, :, None] * waves[:, None, :]).reshape(N, -1)
    free, r = Z - Q @ (Q.T @ Z), residuals - Q @ (Q.T @ residuals)
    G, g, total = free.T @ free, free.T @ r, float(r @ r)
    best, optimum = np.inf, (0.0, 0.0, 0.0, 0.0)
    for length, along in product(LENGTHS, ALONG):
        d = np.outer([along, 1.0, 1.0], _spectrum(frequency, length)).reshape(-1)
        w, U = np.linalg.eigh(G * np.outer(d, d))
        w, u = np.maximum(w, 0.0), (U.T @ (d * g)) ** 2
        # r'(I + ratio Z Z')^-1 r and the logarithm of the determinant, for all ratios
        taken = np.sum(u * RATIOS[:, None] / (1 + RATIOS[:, None] * w), axis=1)
        noise2 = np.maximum(total - taken, 0.0) / (N - n)
        with np.errstate(divide="ignore"):
            cost = (N - n) * np.log(noise2) + np.sum(np.log1p(RATIOS[:, None] * w), axis=1)
        k = int(np.argmin(cost))
        if cost[k] < best:
            best, optimum = float(cost[k]), (float(length), float(along), float(RATIOS[k]), float(noise2[k]))
    length, along, ratio, noise2 = optimum
    d = np.outer([along, 1.0, 1.0], _spectrum(frequency, length)).reshape(-1) * np.sqrt(ratio)
    back = np.linalg.pinv(J)
    moved = back @ (Z * d)
    left = r - (free * d) @ np.linalg.solve(np.eye(len(d)) + G * np.outer(d, d), d * g)
    return SmoothErrors(
        along * float(np.sqrt(ratio * noise2)), float(np.sqrt(ratio * noise2)), 0.5 * length * float(np.ptp(q)),
        float(np.sqrt(noise2)), noise2 * (moved @ moved.T + back @ back.T), left,
    )  # fmt: skip


def _spectrum(frequency: np.ndarray, length: float) -> np.ndarray:
    """Standard deviations of the waves of a process of size 1."""
    return np.sqrt(np.sqrt(2 * np.pi) * length * np.exp(-0.5 * (length * frequency) ** 2))


def _without_line(x: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    fine = np.linspace(-1.0, 1.0, FINE)
    at, everywhere = (np.sin((y[:, None] + BEYOND) * frequency) / np.sqrt(BEYOND) for y in (x, fine))
    line, *_ = np.linalg.lstsq(np.column_stack([np.ones(FINE), fine]), everywhere, rcond=None)
    return at - np.column_stack([np.ones(len(x)), x]) @ line
