"""Mass, damping and stiffness of the most compliant modes from a receptance (Cvitanic 2021, eq. (8)), with intervals.

A receptance is a sum of second-order terms: their values, Jacobian in log parameters, and linear start values.
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

POLE_ROUNDS = 6  # of the reweighted linear fit, which converges in three or not at all
LEAST = 1e-3  # relative to the largest: smallest compliance and damping of a start
# weights of log m, log c, log k in the logarithms of derived quantities, and constants added there
SHARES = {
    "m": (1.0, 0.0, 0.0), "c": (0.0, 1.0, 0.0), "k": (0.0, 0.0, 1.0),
    "fn": (-0.5, 0.0, 0.5), "zeta": (-0.5, 1.0, -0.5),
}  # fmt: skip
ADDED = {"fn": -np.log(2 * np.pi), "zeta": -np.log(2.0)}


def receptance(s: np.ndarray, m: np.ndarray, c: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Return H (n,) [m/N] at s (n,) [1/s] of parallel modes with m (modes,) [kg], c [N.s/m], k [N/m].

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
    """log (m, c, k) (3 modes,) from a linear fit of N(s) = H(s) D(s), rows weighted by the previous 1 / |D|.

    Poles of D give frequency and damping, a nonnegative fit of H the compliances. Source: Sanathanan and Koerner 1963,
    IEEE Transactions on Automatic Control 8.

    Raises ValueError if the lines contain fewer oscillators than requested.
    """
    from scipy.optimize import nnls

    scale, size = float(np.mean(np.abs(s))), float(np.abs(H).max())
    z, h = s / scale, H / size
    numerator = z[:, None] ** np.arange(2 * modes - 1)
    denominator = z[:, None] ** np.arange(2 * modes)
    D, ascending = np.ones(len(z)), np.ones(1)
    for _ in range(POLE_ROUNDS):
        row = weights / np.abs(D)
        # the leading coefficient of D is one
        A = np.hstack([numerator, -h[:, None] * denominator]) * row[:, None]
        b = h * z ** (2 * modes) * row
        coefficients = np.linalg.lstsq(np.vstack([A.real, A.imag]), np.concatenate([b.real, b.imag]), rcond=None)[0]
        ascending = np.append(coefficients[2 * modes - 1 :], 1.0)
        D = np.abs(np.polyval(ascending[::-1], z))
        D = np.maximum(D, 1e-9 * D.max())
    poles = np.roots(ascending[::-1])
    poles = poles[poles.imag > 0]
    if len(poles) < modes:
        raise ValueError(f"the lines contain {len(poles)} oscillations; {modes} requested")
    omega, damping = np.abs(poles), np.maximum(np.abs(poles.real) / np.abs(poles), LEAST)
    shapes = 1 / (z[:, None] * (z[:, None] + 2 * damping * omega) + omega**2)
    rows = weights[:, None] * shapes
    compliance, _ = nnls(np.vstack([rows.real, rows.imag]), np.concatenate([(weights * h).real, (weights * h).imag]))
    compliance = np.maximum(compliance, LEAST * compliance.max())  # H = size * sum compliance / (...), z = s / scale
    m = 1 / (compliance * size * scale**2)
    theta = np.stack([m, 2 * damping * omega * scale * m, (omega * scale) ** 2 * m], axis=1)
    if not np.all(np.isfinite(theta)) or theta.min() <= 0:
        raise ValueError(f"no start with {modes} modes was found in the lines")
    return np.log(theta).ravel()


@dataclass(frozen=True, eq=False)
class ModalFit:
    """Parallel modes, the most compliant at its resonance first.

    m, c, k (modes,) in kg, N.s/m, N/m; `estimate` of their logarithms ("log m[0]", ...) with the covariance from noise
    alone, not from repeated experiments. `response`: the fitted lines. `bic`: smaller is better. `whiteness` of the
    residuals along the frequency; `adequacy`: chi-squared test of the residuals against a known noise.
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
        """Distance from the first mode to the nearest other one [Hz]; None if there is only one mode."""
        return float(np.abs(self.fn[1:] - self.fn[0]).min()) if len(self.m) > 1 else None

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of "m[0]", "c[0]", "k[0]", "fn[0]" [Hz] or "zeta[0]" for the mode with this index, always
        positive. Raises ArgumentError."""
        stem, _, place = str(name).partition("[")
        if not (place.endswith("]") and place[:-1].isdecimal()):
            raise ArgumentError(
                f"unknown name '{name}'; expected {', '.join(SHARES)} with an index, as in fn[0]", "name"
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
                f"unknown name '{name}' of mode {mode}; expected {', '.join(SHARES)} of 0 to {len(self.m) - 1}", "name"
            )
        return dict(zip((f"log {p}[{mode}]" for p in "mck"), SHARES[name], strict=True))


BAND = (0.7, 1.3)  # of the peak's frequency: range of the fit of one mode
SEARCH = (3.0, 200.0)  # Hz, range of the search for the most compliant mode of an arm
CLOSE = 1.0  # Hz: a nearer second mode biases a fit of one mode by tens of per cent
MOST = 3
LIMIT = 60  # iterations; fits that converge need ten
SMALL_P = 0.01
SEEN = 5.0  # standard deviations: a smaller receptance is not a peak
ROUNDS = 3  # of weighting by the model, for noise in proportion to the receptance
BETTER = 10.0  # of BIC: improvement required of a further mode, "very strong" after Kass and Raftery 1995


def peak(response: FrequencyResponse, search: tuple[float, float] = SEARCH) -> float:
    """Frequency [Hz] of the largest receptance within `search` [Hz], averaged over three lines, ignoring noise."""
    lines = response.between(*search)
    size = np.abs(lines.receptance)
    if lines.variance is not None:
        # accelerometer noise, integrated twice, is largest at the lowest frequency
        size = np.where(size > SEEN * np.sqrt(lines.variance), size, 0.0)
    size = np.convolve(size, np.ones(3) / 3, mode="valid")
    k = int(np.argmax(size))
    if k in (0, len(size) - 1):
        raise ValueError(
            f"the receptance is largest at the edge of {search[0]:g} to {search[1]:g} Hz, so that there is no mode "
            "inside; set other search limits"
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
    """Fit masses, damping and stiffness of modes to a receptance by least squares in log parameters.

    `modes`: number of modes; None selects it by the Bayesian information criterion, up to `most`. `band` [Hz]: range of
    the fit, by default 0.7 to 1.3 times the frequency of the largest receptance within `search`. `noise`: relative
    standard deviation of H, E|error|^2 = (noise |H|)^2. Without it the variance of the response is used; if there is
    none, the noise is constant and estimated from the residuals. Source: Cvitanic 2021, eq. (8).

    Raises ValueError if no mode is found or the lines do not determine it.

    >>> m, c, k = np.array([200.0]), np.array([4000.0]), np.array([3e6])  # kg, N.s/m, N/m
    >>> force, acceleration = gt.vibration.synthetic_hits(
    ...     m, c, k, sample_rate=1000.0, duration=4.0, hits=4, noise=0.01, seed=1
    ... )
    >>> fit = gt.vibration.fit_modes(gt.vibration.frequency_response(force, acceleration, 1000.0), modes=1)
    >>> (fit.fn.round(2), fit.m.round(), (fit.k / 1e6).round(2))  # Hz, kg, N/um
    (array([19.49]), array([200.]), array([3.]))
    """
    if modes is not None and modes < 1:
        raise ValueError(f"found {modes} modes; expected one or more, or None for automatic selection")
    if noise is not None and not noise > 0:
        raise ValueError(f"found a relative noise of {noise:g}; expected a number above zero")
    if band is None:
        f0 = peak(response, search)
        band = (BAND[0] * f0, BAND[1] * f0)
    lines = response.between(*band)
    if modes is not None:
        return _with_warnings(_fit(lines, modes, noise), None)
    single = best = None
    failed: ValueError | None = None
    for n in range(1, most + 1):
        try:
            fit = _fit(lines, n, noise)
        except ValueError as error:  # a fit of one mode to two may have no optimum
            failed = failed or error
            fit = None
        single = fit if n == 1 else single
        if best is None or (fit is not None and fit.bic < best.bic - BETTER and _separate(fit, band)):
            best = fit
        else:
            break
    if best is None:
        raise failed or ValueError(f"found most = {most}; expected at least one mode")
    return _with_warnings(best, single)


def _separate(fit: ModalFit, band: tuple[float, float]) -> bool:
    """Whether the data determine every mode: its covariance is small, and it is not far outside the lines."""
    determined = all(fit.log_std("k", j) < 1 and fit.log_std("fn", j) < 0.2 for j in range(len(fit.m)))
    return determined and bool(np.all((fit.fn > 0.5 * band[0]) & (fit.fn < 2 * band[1])))


def _with_warnings(fit: ModalFit, single: ModalFit | None) -> ModalFit:
    """The fit with warnings of a close mode and of unexplained residuals.

    Raises ValueError if the mode is outside the lines, as from noise on a flank without a peak.
    """
    f = fit.response.frequency
    if not f[0] <= fit.fn[0] <= f[-1]:
        raise ValueError(
            f"the mode found at {fit.fn[0]:.4g} Hz is outside the fitted lines, {f[0]:.4g} to {f[-1]:.4g} Hz; set "
            "another band or other search limits"
        )
    notes = []
    if (distance := fit.next_mode) is not None and distance < CLOSE:
        bias = (
            ""
            if single is None
            else f"; a fit of one mode has m {single.m[0] / fit.m[0] - 1:+.0%}, k {single.k[0] / fit.k[0] - 1:+.0%}"
        )
        notes.append(f"a second mode is {distance:.2g} Hz from the first, closer than {CLOSE:g} Hz{bias}")  # fmt: skip
    if fit.adequacy is not None and not fit.adequacy.passed and fit.estimate.noise > 1:
        notes.append(f"{fit.adequacy.message}: intervals are too narrow")
    elif fit.adequacy is None and not fit.whiteness.passed and fit.response.wider == 1.0:
        notes.append(f"along the frequency {fit.whiteness.message}; the band may contain another mode")
    return replace(fit, notes=tuple(notes))


def _fit(lines: FrequencyResponse, modes: int, noise: float | None) -> ModalFit:
    s, H = lines.s, lines.receptance
    names = [f"log {p}[{j}]" for j in range(modes) for p in "mck"]
    if 2 * len(s) <= len(names):
        raise ValueError(f"{len(s)} lines for {len(names)} parameters; use a wider band")
    theta = linear_start(s, H, modes, _start_weights(lines, noise))
    fitted = None
    for _ in range(ROUNDS if noise is not None else 1):
        sigma = _sigma(lines, noise, receptance(s, *_split(theta)))
        # constant noise: the residuals give its size, relative to the largest receptance
        residuals = _residuals(lines, 1.0 if sigma is not None else float(np.abs(H).max()))
        with np.errstate(all="ignore"):  # a step that is too large is not finite and is rejected
            fitted = nonlinear_fit(residuals, theta, names, sigma=sigma, limit=LIMIT)
        if fitted.estimate is None:
            raise ValueError(f"the fit of {modes} modes did not converge: {fitted.message}")
        theta = fitted.x
    assert fitted is not None and fitted.estimate is not None
    return _ordered(fitted.estimate, fitted.x, lines, noise is not None)


def _residuals(lines: FrequencyResponse, unit: float) -> Residuals:
    s, H = lines.s, lines.receptance

    def residual(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        p = _split(theta)
        error, jacobian = (receptance(s, *p) - H) / unit, log_derivatives(s, *p) / unit
        return np.concatenate([error.real, error.imag]), np.vstack([jacobian.real, jacobian.imag])

    return residual


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
        # relative to the model, not to the measurement: a line that noise made small must not get more weight
        sigma = noise * np.abs(H) / np.sqrt(2)
    elif lines.variance is not None:
        sigma = np.sqrt(lines.variance / 2)
    else:
        return None
    return np.tile(sigma, 2)


def _split(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    m, c, k = np.exp(theta.reshape(-1, 3).T)
    return m, c, k


def _ordered(e: Estimate, theta: np.ndarray, lines: FrequencyResponse, stated: bool) -> ModalFit:
    """The fit with the most compliant mode first, and a larger covariance if lines are correlated."""
    m, c, k = _split(theta)
    order = np.argsort(c * np.sqrt(k / m), kind="stable")
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    r = e.residuals
    n = len(r) // 2
    misfit = float(r @ r) if e.known_noise else 2 * n * float(np.log(r @ r / (2 * n)))
    estimate = replace(e, values=theta[rows], covariance=lines.wider**2 * e.covariance[rows][:, rows])
    # real and imaginary parts of a line are independent: append one to the other
    white = whiteness(np.concatenate([r[:n], r[n:]]))
    return ModalFit(
        m[order], c[order], k[order], estimate, lines, misfit + len(theta) * float(np.log(2 * n)), white,
        _adequacy(e, lines, stated) if e.known_noise else None,
    )  # fmt: skip


def _adequacy(e: Estimate, lines: FrequencyResponse, stated: bool) -> Verdict:
    """Test of the residuals against the noise, which has few degrees of freedom if estimated from repeated hits."""
    if stated or not np.isfinite(lines.degrees_of_freedom):
        return noise_size(e)
    # correlated lines have fewer degrees of freedom
    ratio, independent = float(e.residuals @ e.residuals) / e.degrees_of_freedom, e.degrees_of_freedom / lines.wider**2
    p = float(f_chance(ratio, independent, lines.degrees_of_freedom))
    finding = (
        "are as large as the noise of the hits"
        if p >= SMALL_P
        else (f"are {np.sqrt(ratio):.2f} times the noise of the hits: the model lacks an effect, such as another mode")
    )
    return Verdict(ratio, p, p >= SMALL_P, f"residuals {finding} (F = {ratio:.3g}, p = {p:.2g})")
