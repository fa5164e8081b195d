"""Mass, damping and stiffness of the most compliant modes from a receptance (Cvitanic 2021, eq. (8)), with intervals.

A receptance is a sum of second-order ones: their values, their Jacobian in log parameters, and a linear start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...inference import Verdict, noise_size, nonlinear_fit, whiteness
from ...inference.chance import f_chance
from ...inference.nonlinear import Residuals
from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from .experiments import FrequencyResponse

POLE_ROUNDS = 6  # of the reweighted linear fit; it settles in three or does not settle
LEAST = 1e-3  # of the largest: the smallest compliance and damping that a start may have
# shares of log m, log c, log k in the logarithms of what follows from them, and what is added there
SHARES = {
    "m": (1.0, 0.0, 0.0), "c": (0.0, 1.0, 0.0), "k": (0.0, 0.0, 1.0),
    "fn": (-0.5, 0.0, 0.5), "zeta": (-0.5, 1.0, -0.5),
}  # fmt: skip
ADDED = {"fn": -np.log(2 * np.pi), "zeta": -np.log(2.0)}


def receptance(s: np.ndarray, m: np.ndarray, c: np.ndarray, k: np.ndarray) -> np.ndarray:
    """H (n,) [m/N] at s (n,) [1/s] of modes with m (modes,) [kg], c [N.s/m], k [N/m] in parallel.

    Each mode is m x'' + c x' + k x = F, Cvitanic 2021, eq. (8); displacements add.

    >>> m, c, k = np.array([200.0]), np.array([4000.0]), np.array([3e6])  # kg, N.s/m, N/m
    >>> H = gt.vibration.receptance(2j * np.pi * np.array([0.0, 19.5]), m, c, k)  # static, near resonance
    >>> (1e6 * np.abs(H)).round(2)  # um/N
    array([0.33, 2.04])
    """
    return parts(s, m, c, k).sum(axis=1)


def parts(s: np.ndarray, m: np.ndarray, c: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Receptance of each mode (n, modes)."""
    s = s[:, None]
    return 1 / (s * (m * s + c) + k)


def log_derivatives(s: np.ndarray, m: np.ndarray, c: np.ndarray, k: np.ndarray) -> np.ndarray:
    """dH / d(log m, log c, log k) of every mode (n, 3 modes), mode by mode."""
    H2 = parts(s, m, c, k) ** 2
    s = s[:, None]
    return -np.stack([H2 * m * s**2, H2 * c * s, H2 * k], axis=2).reshape(len(s), -1)


def linear_start(s: np.ndarray, H: np.ndarray, modes: int, weights: np.ndarray) -> np.ndarray:
    """log (m, c, k) (3 modes,) from a linear fit of N(s) = H(s) D(s), rows weighted by |H|^2 and by 1 / |N| before.

    One mode: N is constant and D = m s^2 + c s + k, so that 1/H is linear in the parameters and the rows are weighted
    by |H|^2. Several: poles of D give frequency and damping, a nonnegative fit of H their compliances.
    Source: Sanathanan and Koerner 1963, IEEE Transactions on Automatic Control 8.

    Raises ValueError where the lines hold fewer oscillations than asked for.
    """
    from scipy.optimize import nnls

    scale, size = float(np.mean(np.abs(s))), float(np.abs(H).max())
    z, h = s / scale, H / size
    numerator = z[:, None] ** np.arange(2 * modes - 1)
    denominator = z[:, None] ** np.arange(2 * modes)
    D, ascending = np.ones(len(z)), np.ones(1)
    for _ in range(POLE_ROUNDS):
        row = weights / np.abs(D)
        # the highest power of D has the coefficient one
        A = np.hstack([numerator, -h[:, None] * denominator]) * row[:, None]
        b = h * z ** (2 * modes) * row
        coefficients = np.linalg.lstsq(np.vstack([A.real, A.imag]), np.concatenate([b.real, b.imag]), rcond=None)[0]
        ascending = np.append(coefficients[2 * modes - 1 :], 1.0)
        D = np.abs(np.polyval(ascending[::-1], z))
        D = np.maximum(D, 1e-9 * D.max())
    poles = np.roots(ascending[::-1])
    poles = poles[poles.imag > 0]
    if len(poles) < modes:
        raise ValueError(f"the lines hold {len(poles)} oscillations; {modes} were asked for")
    omega, damping = np.abs(poles), np.maximum(np.abs(poles.real) / np.abs(poles), LEAST)
    shapes = 1 / (z[:, None] * (z[:, None] + 2 * damping * omega) + omega**2)
    rows = weights[:, None] * shapes
    share, _ = nnls(np.vstack([rows.real, rows.imag]), np.concatenate([(weights * h).real, (weights * h).imag]))
    share = np.maximum(share, LEAST * share.max())  # H = size * sum share / (...), z = s / scale
    m = 1 / (share * size * scale**2)
    theta = np.stack([m, 2 * damping * omega * scale * m, (omega * scale) ** 2 * m], axis=1)
    if not np.all(np.isfinite(theta)) or theta.min() <= 0:
        raise ValueError(f"no start with {modes} modes was found among the lines")
    return np.log(theta).ravel()


@dataclass(frozen=True, eq=False)
class ModalFit:
    """Modes in parallel, the most compliant at its resonance first.

    m, c, k (modes,) in kg, N.s/m, N/m; `estimate` of their logarithms ("log m[0]", ...), whose covariance is that of
    the noise alone, not of repeated experiments. `response`: the lines that were fitted. `bic`: smaller is better.
    `whiteness` of the residuals along the frequency; `adequacy`: chi-squared of them against a known noise.
    """

    m: np.ndarray
    c: np.ndarray
    k: np.ndarray
    estimate: Estimate
    response: FrequencyResponse
    bic: float
    whiteness: Verdict
    adequacy: Verdict | None
    notes: tuple[str, ...] = ()

    @property
    def fn(self) -> np.ndarray:
        """Undamped natural frequencies sqrt(k/m) / 2 pi (modes,) [Hz]."""
        return np.sqrt(self.k / self.m) / (2 * np.pi)

    @property
    def zeta(self) -> np.ndarray:
        """Damping ratios c / (2 sqrt(k m)) (modes,)."""
        return self.c / (2 * np.sqrt(self.k * self.m))

    @property
    def next_mode(self) -> float | None:
        """Distance from the first mode to the nearest other one [Hz]; None where there is one mode only."""
        return float(np.abs(self.fn[1:] - self.fn[0]).min()) if len(self.m) > 1 else None

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of "m[0]", "c[0]", "k[0]", "fn[0]" [Hz] or "zeta[0]" of the mode with this index, always
        positive. Raises ArgumentError."""
        stem, _, place = str(name).partition("[")
        if not (place.endswith("]") and place[:-1].isdecimal()):
            raise ArgumentError(
                f"there is no '{name}'; expected {', '.join(SHARES)} with an index, as in fn[0]", "name"
            )
        _, low, high = self.estimate.combination(self._weights(stem, int(place[:-1])), level)
        shift = ADDED.get(stem, 0.0)
        return float(np.exp(low + shift)), float(np.exp(high + shift))

    def log_std(self, name: str, mode: int = 0) -> float:
        """Standard deviation of the logarithm of "m", "c", "k", "fn" or "zeta": the relative one."""
        weights = self._weights(name, mode)
        w = np.array([weights.get(n, 0.0) for n in self.estimate.names])
        return float(np.sqrt(w @ self.estimate.covariance @ w))

    def at(self, s: np.ndarray) -> np.ndarray:
        """Receptance (n,) of all modes [m/N] at s (n,) [1/s]."""
        return receptance(s, self.m, self.c, self.k)

    def _weights(self, name: str, mode: int) -> dict[str, float]:
        if name not in SHARES or not 0 <= mode < len(self.m):
            raise ArgumentError(
                f"there is no '{name}' of mode {mode}; expected {', '.join(SHARES)} of 0 to {len(self.m) - 1}", "name"
            )
        return dict(zip((f"log {p}[{mode}]" for p in "mck"), SHARES[name], strict=True))


BAND = (0.7, 1.3)  # of the peak's frequency: where one mode is fitted
SEARCH = (3.0, 200.0)  # Hz, where the most compliant mode of an arm is looked for
CLOSE = 1.0  # Hz: a second mode within biases a fit of one by tens of per cent
MOST = 3
LIMIT = 60  # iterations; fits that end take ten
SMALL_P = 0.01
SEEN = 5.0  # times its standard deviation: a smaller receptance is no peak
ROUNDS = 3  # of weights by the model's own size, for noise in proportion to the receptance
BETTER = 10.0  # of BIC: a further mode must earn it, "very strong" after Kass and Raftery 1995


def peak(response: FrequencyResponse, search: tuple[float, float] = SEARCH) -> float:
    """Frequency [Hz] of the largest receptance, of three lines each, within `search` [Hz]; noise left out."""
    lines = response.between(*search)
    size = np.abs(lines.receptance)
    if lines.variance is not None:
        # an accelerometer's noise, twice integrated, is largest at the lowest frequency
        size = np.where(size > SEEN * np.sqrt(lines.variance), size, 0.0)
    size = np.convolve(size, np.ones(3) / 3, mode="valid")
    k = int(np.argmax(size))
    if k in (0, len(size) - 1):
        raise ValueError(
            f"the receptance is largest at the edge of {search[0]:g} to {search[1]:g} Hz, so that no mode lies within; "
            "give other search limits"
        )
    return float(lines.frequency[1 + k])


def fit_modes(
    response: FrequencyResponse,
    modes: int | None = None,
    *,
    band: tuple[float, float] | None = None,
    search: tuple[float, float] = SEARCH,
    noise: float | None = None,
    most: int = MOST,
) -> ModalFit:
    """Masses, damping and stiffness of modes by least squares on the receptance in log parameters, from a linear start.

    `modes`: how many; None takes as many as the Bayesian information criterion asks for, `most` at most. `band` [Hz]:
    the lines fitted, by default 0.7 to 1.3 times the frequency of the largest receptance within `search`. `noise`:
    relative standard deviation of H, E|error|^2 = (noise |H|)^2; without it the variance of the response counts, and
    where there is none either, noise is level and estimated from the residuals. Source: Cvitanic 2021, eq. (8).

    Raises ValueError where no mode is found, or for what the lines do not determine.

    >>> m, c, k = np.array([200.0]), np.array([4000.0]), np.array([3e6])  # kg, N.s/m, N/m
    >>> force, acceleration = gt.vibration.synthetic_hits(
    ...     m, c, k, sample_rate=1000.0, duration=4.0, hits=4, noise=0.01, seed=1
    ... )
    >>> fit = gt.vibration.fit_modes(gt.vibration.frequency_response(force, acceleration, 1000.0), modes=1)
    >>> (fit.fn.round(2), fit.m.round(), (fit.k / 1e6).round(2))  # Hz, kg, N/um
    (array([19.49]), array([200.]), array([3.]))
    """
    if modes is not None and modes < 1:
        raise ValueError(f"found {modes} modes; expected one or more, or None to let the data tell")
    if noise is not None and not noise > 0:
        raise ValueError(f"found a relative noise of {noise:g}; expected a number above zero")
    if band is None:
        f0 = peak(response, search)
        band = (BAND[0] * f0, BAND[1] * f0)
    lines = response.between(*band)
    if modes is not None:
        return _judged(_fit(lines, modes, noise), None)
    one = best = None
    failed: ValueError | None = None
    for n in range(1, most + 1):
        try:
            more = _fit(lines, n, noise)
        except ValueError as error:  # one mode through two may have no optimum
            failed = failed or error
            more = None
        one = more if n == 1 else one
        if best is None or (more is not None and more.bic < best.bic - BETTER and _separate(more, band)):
            best = more
        else:
            break
    if best is None:
        raise failed or ValueError(f"found most = {most}; expected one mode or more")
    return _judged(best, one)


def _separate(fit: ModalFit, band: tuple[float, float]) -> bool:
    """Whether the data determine every mode: by its covariance, and not far outside of the lines."""
    determined = all(fit.log_std("k", j) < 1 and fit.log_std("fn", j) < 0.2 for j in range(len(fit.m)))
    return determined and bool(np.all((fit.fn > 0.5 * band[0]) & (fit.fn < 2 * band[1])))


def _judged(fit: ModalFit, one: ModalFit | None) -> ModalFit:
    """With its warnings: a mode close by, and residuals that the model does not explain.

    Raises ValueError for a mode that lies beside the lines, as noise on a flank without a peak makes it.
    """
    f = fit.response.frequency
    if not f[0] <= fit.fn[0] <= f[-1]:
        raise ValueError(
            f"the mode found at {fit.fn[0]:.4g} Hz lies outside of the lines fitted, {f[0]:.4g} to {f[-1]:.4g} Hz; "
            "give another band or other search limits"
        )
    notes = []
    if (apart := fit.next_mode) is not None and apart < CLOSE:
        bias = (
            ""
            if one is None
            else f"; a fit of one mode has m {one.m[0] / fit.m[0] - 1:+.0%}, k {one.k[0] / fit.k[0] - 1:+.0%}"
        )
        notes.append(f"a second mode lies {apart:.2g} Hz from the first, closer than {CLOSE:g} Hz{bias}")  # fmt: skip
    if fit.adequacy is not None and not fit.adequacy.passed and fit.estimate.noise > 1:
        notes.append(f"{fit.adequacy.message}: intervals are too narrow")
    elif fit.adequacy is None and not fit.whiteness.passed and fit.response.wider == 1.0:
        notes.append(f"along the frequency {fit.whiteness.message}; another mode may lie in the band")
    return replace(fit, notes=tuple(notes))


def _fit(lines: FrequencyResponse, modes: int, noise: float | None) -> ModalFit:
    s, H = lines.s, lines.receptance
    names = [f"log {p}[{j}]" for j in range(modes) for p in "mck"]
    if 2 * len(s) <= len(names):
        raise ValueError(f"{len(s)} lines for {len(names)} parameters; take a wider band")
    theta = linear_start(s, H, modes, _start_weights(lines, noise))
    fitted = None
    for _ in range(ROUNDS if noise is not None else 1):
        sigma = _sigma(lines, noise, receptance(s, *_split(theta)))
        # level noise: the residuals give its size, in units of the largest receptance
        residuals = _residuals(lines, 1.0 if sigma is not None else float(np.abs(H).max()))
        with np.errstate(all="ignore"):  # a step too far is not finite and is taken back
            fitted = nonlinear_fit(residuals, theta, names, sigma=sigma, limit=LIMIT)
        if fitted.estimate is None:
            raise ValueError(f"the fit of {modes} modes came to no end: {fitted.message}")
        theta = fitted.x
    assert fitted is not None and fitted.estimate is not None
    return _ordered(fitted.estimate, fitted.x, lines, noise is not None)


def _residuals(lines: FrequencyResponse, unit: float) -> Residuals:
    s, H = lines.s, lines.receptance

    def at(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        p = _split(theta)
        error, jacobian = (receptance(s, *p) - H) / unit, log_derivatives(s, *p) / unit
        return np.concatenate([error.real, error.imag]), np.vstack([jacobian.real, jacobian.imag])

    return at


def _start_weights(lines: FrequencyResponse, noise: float | None) -> np.ndarray:
    if noise is not None:
        weights = 1 / np.maximum(np.abs(lines.receptance), 1e-3 * np.abs(lines.receptance).max())
    elif lines.variance is not None:
        weights = 1 / np.sqrt(lines.variance)
    else:
        return np.ones(len(lines.frequency))
    return weights / weights.max()


def _sigma(lines: FrequencyResponse, noise: float | None, H: np.ndarray) -> np.ndarray | None:
    """Standard deviations of real and imaginary parts (2 n,)."""
    if noise is not None:
        # of the model, not of the measurement: a line that noise made small must not count more
        each = noise * np.abs(H) / np.sqrt(2)
    elif lines.variance is not None:
        each = np.sqrt(lines.variance / 2)
    else:
        return None
    return np.tile(each, 2)


def _split(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    m, c, k = np.exp(theta.reshape(-1, 3).T)
    return m, c, k


def _ordered(e: Estimate, theta: np.ndarray, lines: FrequencyResponse, stated: bool) -> ModalFit:
    """Most compliant at its own resonance first, covariance wider where lines are correlated."""
    m, c, k = _split(theta)
    order = np.argsort(c * np.sqrt(k / m), kind="stable")
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    r = e.residuals
    n = len(r) // 2
    misfit = float(r @ r) if e.known_noise else 2 * n * float(np.log(r @ r / (2 * n)))
    estimate = replace(e, values=theta[rows], covariance=lines.wider**2 * e.covariance[rows][:, rows])
    # real and imaginary parts of a line are independent: one row after the other
    white = whiteness(np.concatenate([r[:n], r[n:]]))
    return ModalFit(
        m[order], c[order], k[order], estimate, lines, misfit + len(theta) * float(np.log(2 * n)), white,
        _adequacy(e, lines, stated) if e.known_noise else None,
    )  # fmt: skip


def _adequacy(e: Estimate, lines: FrequencyResponse, stated: bool) -> Verdict:
    """Residuals against the noise, which repeated hits estimate with few degrees of freedom themselves."""
    if stated or not np.isfinite(lines.degrees_of_freedom):
        return noise_size(e)
    # correlated lines are fewer than they look
    ratio, own = float(e.residuals @ e.residuals) / e.degrees_of_freedom, e.degrees_of_freedom / lines.wider**2
    p = float(f_chance(ratio, own, lines.degrees_of_freedom))
    said = (
        "are as large as the hits' own noise"
        if p >= SMALL_P
        else (f"are {np.sqrt(ratio):.2f} times the hits' own noise: the model lacks an effect, such as another mode")
    )
    return Verdict(ratio, p, p >= SMALL_P, f"residuals {said} (F = {ratio:.3g}, p = {p:.2g})")
