"""Whether the confidence intervals of a calibration are valid: residuals must be noise, or smooth errors of the links'
ends that repeat with the actuator position and are added to the covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from ...inference import OverNoise, chi_squared_over_noise, correlation_time, noise_size, whiteness
from ...inference.residuals import SMALL_P
from ...results.estimate import Estimate
from ..blocks import Block
from ..calibration import Calibration

WAVES = 24  # per axis: enough for the shortest length below
BEYOND = 1.5  # half-width of the waves' range over that of the actuator, so that the process is free at the ends
LENGTHS = np.geomspace(0.13, 2.0, 10)  # tried correlation lengths, in half ranges of the actuator
RATIOS = np.exp(np.linspace(-6.0, 16.0, 89))  # variances of the error over that of the noise
ALONG = 2.0 ** np.arange(-3, 4)  # sizes along the guideway over those across
FINE = 101  # points of the range for removing the straight line
ABSORBED = 1e-6  # remaining part of a shift up to which the unknowns count as absorbing it


@dataclass(frozen=True, eq=False)
class SmoothErrors:
    """Sizes of the error [m], `along` the guideway and per axis `across` it; correlation `length` in units of q;
    `noise` [m]; `covariance` (n, n) of the unknowns due to both; `left` (N,): residuals less the error."""

    along: float
    across: float
    length: float
    noise: float
    covariance: np.ndarray
    left: np.ndarray


def with_smooth_errors(c: Calibration, position: str = "T") -> tuple[Estimate, dict[str, SmoothErrors]] | None:
    """Return the estimate with a covariance that includes smooth errors of the links' ends, by link; Student intervals.

    None if the method is not valid: a cost other than "length", priors, latent variables, several links that share an
    unknown, a link moved by several actuators, or if smooth_errors() returns None. `position`: the measured
    end-effector; its errors shift the links' ends as theirs do.
    """
    p = c.problem
    if c.estimate is None or c.cost != "length" or p.unknowns.priors or p.reading.latent.numel():
        return None
    N, n, links = len(p.measurements), len(c.x), {}
    covariance = np.zeros((n, n))
    degrees_of_freedom = N - max((len(b.columns) for b in p.lengths), default=0)
    for b in p.lengths:
        errors = _of_link(c, b, position)
        if errors is None or degrees_of_freedom < 1:
            return None
        links[p.labels[b.rows[0]]] = errors
        covariance[np.ix_(b.columns, b.columns)] = errors.covariance
    # few poses may underestimate the error or the noise: never less than the covariance for white noise
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
    """Estimate smooth errors of a link's end from residuals at the least-squares solution.

    J (N, n): Jacobian of the residuals (N,) [m] in the unknowns; normals (N, 3): in the position of the link's end;
    q (N,): the actuator; v (3,): its guideway.

    The end is off by e(q), along and across the guideway: a Gaussian process with squared exponential covariance and
    its straight line over the range of q removed, because a straight guideway (A and v) absorbs the line. Sizes, length
    and noise are restricted maximum likelihood estimates on a grid. None unless the unknowns absorb shifts of the end
    that are constant or linear in q, as on a straight guideway with free A and v; otherwise the line would be
    undetermined.
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
    axes = np.linalg.svd(v[None])[2].T  # direction of the guideway, and two across
    Z = ((normals @ axes)[:, :, None] * waves[:, None, :]).reshape(N, -1)
    free, r = Z - Q @ (Q.T @ Z), residuals - Q @ (Q.T @ residuals)
    G, g, total = free.T @ free, free.T @ r, float(r @ r)
    best, optimum = np.inf, (0.0, 0.0, 0.0, 0.0)
    for length, along in product(LENGTHS, ALONG):
        d = np.outer([along, 1.0, 1.0], _spectrum(frequency, length)).reshape(-1)
        w, U = np.linalg.eigh(G * np.outer(d, d))
        w, u = np.maximum(w, 0.0), (U.T @ (d * g)) ** 2
        # r'(I + ratio Z Z')^-1 r and the logarithm of the determinant, for all ratios
        explained = np.sum(u * RATIOS[:, None] / (1 + RATIOS[:, None] * w), axis=1)
        noise2 = np.maximum(total - explained, 0.0) / (N - n)
        with np.errstate(divide="ignore"):
            cost = (N - n) * np.log(noise2) + np.sum(np.log1p(RATIOS[:, None] * w), axis=1)
        k = int(np.argmin(cost))
        if cost[k] < best:
            best, optimum = float(cost[k]), (float(length), float(along), float(RATIOS[k]), float(noise2[k]))
    length, along, ratio, noise2 = optimum
    d = np.outer([along, 1.0, 1.0], _spectrum(frequency, length)).reshape(-1) * np.sqrt(ratio)
    inverse = np.linalg.pinv(J)
    moves = inverse @ (Z * d)
    remainder = r - (free * d) @ np.linalg.solve(np.eye(len(d)) + G * np.outer(d, d), d * g)
    return SmoothErrors(
        along * float(np.sqrt(ratio * noise2)), float(np.sqrt(ratio * noise2)), 0.5 * length * float(np.ptp(q)),
        float(np.sqrt(noise2)), noise2 * (moves @ moves.T + inverse @ inverse.T), remainder,
    )  # fmt: skip


def _spectrum(frequency: np.ndarray, length: float) -> np.ndarray:
    """Standard deviations of the waves of a process of unit size."""
    return np.sqrt(np.sqrt(2 * np.pi) * length * np.exp(-0.5 * (length * frequency) ** 2))


def _without_line(x: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    fine = np.linspace(-1.0, 1.0, FINE)
    values, everywhere = (np.sin((y[:, None] + BEYOND) * frequency) / np.sqrt(BEYOND) for y in (x, fine))
    line, *_ = np.linalg.lstsq(np.column_stack([np.ones(FINE), fine]), everywhere, rcond=None)
    return values - np.column_stack([np.ones(len(x)), x]) @ line


LEAST_POSES = 30  # for a test of whiteness
MEASURED = "as measured"
# largest standard deviation in expected errors: beyond, linearisation at the solution is invalid. Synthetic D1 with
# free plate joints, 500 seeds: intervals of arm 1, at 10, are valid; arms 2 and 3, at 50, have 57 to 477 hits.
WEAK = 15.0


def weighed_over_noise(c: Calibration) -> OverNoise | None:
    """Test of the residuals of several measurements against their noise if that of the actuators is not stated.

    None for a single one, whose residuals give the noise."""
    e = c.estimate
    if e is None or e.known_noise or not c.problem.beside or not e.degrees_of_freedom > 0:
        return None
    return chi_squared_over_noise(float(e.residuals @ e.residuals), e.degrees_of_freedom)


class Confidence:
    """The estimate behind the intervals, or the reasons why there are no valid ones.

    Residuals of each link are tested for whiteness in the order of the poses (drift) and in that of each actuator's
    position: a guideway error repeats with the cart position and shows only in the latter. If links run on straight
    guideways, the covariance includes such an effect as a smooth error of each link's end (see with_smooth_errors()),
    provided that it leaves white residuals. docs/kinds/calibration.md, "When intervals are given", has coverages of
    95 % intervals on synthetic L1 robots for seeds fixed beforehand: these intervals were valid with guideway errors;
    sandwich covariances were not, neither there nor for drift over poses in grid order.
    """

    def __init__(
        self, calibration: Calibration, position: str = "T", loss: str = "linear", moved_far: bool = False
    ) -> None:
        self.calibration = calibration
        self.position = position
        self.loss = loss
        self.moved_far = moved_far

    @property
    def holds(self) -> bool:
        """Whether intervals are valid."""
        return not self.reasons

    @property
    def estimate(self) -> Estimate | None:
        """With the covariance of valid intervals; that for white residuals if there are none."""
        return self.calibration.estimate if self._smooth is None else self._smooth[0]

    @cached_property
    def reasons(self) -> tuple[str, ...]:
        """Sentences on why intervals are not valid; empty if they are."""
        doubts = [] if self._smooth is not None else self._wrong
        if not doubts and self._weak:
            return (self._weak,)
        if not doubts:
            return ("95 % intervals are not valid: parameters moved farther than expected for a known robot; "
                    "the fit may have found another optimum",) if self.moved_far else ()  # fmt: skip
        return (
            *doubts,
            *self._why_not_smooth,
            "95 % intervals are not valid: the residuals are not independent noise of the assumed size, and "
            "parameters may be several standard deviations off; judge by the held-out poses",
        )

    @property
    def withheld(self) -> str:
        """Why intervals are not valid, in one sentence; empty if they are."""
        if self.calibration.estimate is None:
            why = "" if self.calibration.status.ok else "not solved, "
            return f"no valid intervals: {why}{self.calibration.message}"
        return "" if self.holds else self.reasons[-1]

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Sentences on the assumptions of valid intervals, other than plain noise."""
        if self.calibration.estimate is None or not self.holds:
            return ()
        sentences = []
        if self._few:
            sentences.append(
                f"{len(self.calibration.residuals)} fitted poses are too few to test whether residuals are coloured "
                f"({LEAST_POSES} are needed): "
                + ("intervals include smooth errors of the carts" if self._smooth is not None else
                   "intervals assume independent noise and are too narrow if guideways are not straight or "
                   "the device drifts")
            )  # fmt: skip
        elif self._smooth is not None:
            sizes = ", ".join(
                f"{name} {1e6 * e.along:.2g} um along and {1e6 * e.across:.2g} um across its guideway with a length of "
                f"{e.length:.2g} m, and {1e6 * e.noise:.2g} um of noise"
                for name, e in self._smooth[1].items()
            )
            sentences.append(
                "residuals depend on the cart positions: 95 % intervals include smooth errors of the links' ends "
                f"({sizes}), and are those of the straight guideways through them"
            )
        return tuple(sentences)

    @property
    def tested(self) -> bool:
        """Whether there are enough residuals to test for whiteness."""
        return not self._few

    @property
    def coloured(self) -> bool:
        """Whether residuals were tested and are not independent noise."""
        return bool(self._coloured)

    @property
    def scope(self) -> str:
        """Scope of the intervals, for the verdict."""
        if not self.holds:
            return "parameters: no valid 95 % intervals, see the notes"
        covered = f"parameters: the 95 % intervals cover the noise of {self._recorded}"
        if self._few:
            return f"{covered}; {len(self.calibration.residuals)} poses are too few to test for coloured residuals"
        if self._smooth is not None:
            return f"{covered} and smooth errors of the carts, but not drift, load or scale"
        return f"{covered}; they assume that the errors of successive poses are independent, and the test agrees"

    @property
    def _recorded(self) -> str:
        """The recordings that the intervals describe; another recording may have additional errors."""
        problem = self.calibration.problem
        several = bool(problem.beside) or len(problem.measurements.session_names) > 1
        return "these recordings" if several else "this recording"

    @cached_property
    def correlated(self) -> int:
        """Number of consecutive poses with about the same error: 1 unless residuals are coloured."""
        if not self._coloured:
            return 1
        residuals, labels = self.calibration.residuals, self.calibration.problem.error_labels
        orders = self._orders(self.calibration)
        return max(correlation_time(residuals[orders[name], labels.index(link)]) for link, name, _ in self._coloured)

    @cached_property
    def _weak(self) -> str:
        e, sizes = self.calibration.estimate, self.calibration.problem.unknowns.sizes
        if e is None:
            return ""
        times = np.where(np.isfinite(e.std), e.std / sizes, 0.0)
        k = int(np.argmax(times))
        if times[k] <= WEAK:
            return ""
        unit = f" {e.units[k]}" if e.units[k] not in ("", "1") else ""
        expected = f"if its expected error is not {sizes[k]:.2g}{unit}, change sizes"
        return (
            f"95 % intervals are not valid: the std of {e.names[k]} is {e.std[k]:.2g}{unit}, "
            f"{times[k]:.3g} times its expected error, too much for linearised least squares; fix "
            f"it, give a prior, or measure poses farther apart with larger rotations; {expected}"
        )

    @property
    def _few(self) -> bool:
        return all(len(c.residuals) < LEAST_POSES for c in self.calibration.parts)

    @cached_property
    def _wrong(self) -> list[str]:
        c = self.calibration
        if c.estimate is None:
            return []
        sentences = [f"{label}, poses ordered {name}: {message}" for label, name, message in self._coloured]
        if c.estimate.known_noise and c.estimate.degrees_of_freedom > 0:
            size = noise_size(c.estimate)
            if not size.passed and c.estimate.noise > 1:
                sentences.append(f"residuals of the fitted poses are {c.estimate.noise:.3g} times the stated noise")
        elif (weighed := weighed_over_noise(c)) is not None and not weighed.passed:
            sentences.append(f"residuals of the fitted poses are {weighed.ratio:.3g} times the stated noise")
        return sentences

    @cached_property
    def _coloured(self) -> list[tuple[str, str, str]]:
        parts = [c for c in self.calibration.parts if len(c.residuals) >= LEAST_POSES]
        return [result for c in parts for result in self._tested(c, c.residuals, c.problem.error_labels)]

    @cached_property
    def _smooth(self) -> tuple[Estimate, dict[str, SmoothErrors]] | None:
        """Smooth errors; None if not needed, not possible, or if coloured residuals remain."""
        if self.loss != "linear" or not (self._few or any(name != MEASURED for _, name, _ in self._coloured)):
            return None
        if self._few and self._wrong:
            return None
        smooth = with_smooth_errors(self.calibration, self.position)
        if smooth is None or self._few:
            return smooth
        remainder = np.column_stack([e.left for e in smooth[1].values()])
        return None if self._tested(self.calibration, remainder, list(smooth[1])) else smooth

    @property
    def _why_not_smooth(self) -> list[str]:
        orders = {name for _, name, _ in self._coloured}
        if orders == {MEASURED}:
            return [
                "the residuals drift over the recording; measure poses in random order to keep drift out of the "
                "parameters (in grid order even Newey-West covariances are too small)"
            ]
        if orders:
            c = self.calibration
            hindered = {
                "has a robust loss": self.loss != "linear",
                "does not have the cost linear": c.cost != "length",
                "has priors": bool(c.problem.unknowns.priors),
                "has latent variables": c.problem.implicit,
            }
            why = next((what for what, so in hindered.items() if so), "")
            if why:
                return [f"smooth errors of the links' ends were not tried as an explanation, because the fit {why}"]
            return [
                "smooth errors of the links' ends do not explain this, or were not tried because several links share "
                "an unknown or several actuators move a link"
            ]
        return []

    def _tested(
        self, c: Calibration, residuals: np.ndarray, labels: tuple[str, ...] | list[str]
    ) -> list[tuple[str, str, str]]:
        """Link, order and sentence for each link with coloured residuals."""
        if not residuals.shape[1] or not np.all(np.isfinite(residuals)):
            return []
        orders, coloured = self._orders(c), []
        for label, r in zip(labels, residuals.T, strict=True):
            tests = {name: whiteness(r[order]) for name, order in orders.items()}
            name = min(tests, key=lambda n: tests[n].p)
            if tests[name].p < SMALL_P / (len(orders) * len(labels)):  # Bonferroni: a false alarm in 1 % of all fits
                coloured.append((label, name, tests[name].message))
        return coloured

    def _orders(self, c: Calibration) -> dict[str, np.ndarray]:
        """Orders of the poses for the whiteness tests: as measured and by each actuator."""
        problem, poses = c.problem, len(c.problem.measurements)
        q = np.asarray(problem.measurements.values[problem.actuators])
        by_actuator = {f"by {problem.actuators}[{k}]": np.argsort(q[:, k], kind="stable") for k in range(q.shape[1])}
        return {MEASURED: np.arange(poses), **by_actuator}
