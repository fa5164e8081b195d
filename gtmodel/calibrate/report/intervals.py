"""Whether the confidence intervals of a calibration hold: residuals must be noise, and a smooth error of a link's end,
the same wherever its actuator comes by again, is none."""

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


LEAST_POSES = 30  # for a test of whiteness
MEASURED = "as measured"
# of its expected error: an unknown that is determined no better is too far off for a Jacobian at the solution, and
# noise in it is no small part of what determines it. Synthetic D1 with plate joints free, 500 seeds: arm 1, at 10,
# holds; arms 2 and 3, at 50, have 57 to 477 hits.
WEAK = 15.0


def weighed_over_noise(c: Calibration) -> OverNoise | None:
    """Residuals of several measurements in units of the noise by which they are weighed, where that of the actuators is
    not stated, so that these count as exact; None for a single one, whose residuals say themselves how large they are.
    """
    e = c.estimate
    if e is None or e.known_noise or not c.problem.beside or not e.degrees_of_freedom > 0:
        return None
    return chi_squared_over_noise(float(e.residuals @ e.residuals), e.degrees_of_freedom)


class Confidence:
    """The estimate that intervals rest on, and reasons in words where none can be given.

    Residuals of each link are tested for whiteness in the order of the poses (drift) and of each actuator's position: a
    guideway error is the same wherever the cart comes by again, and shows in no other order. Where links run on
    straight guideways such an effect is counted as a smooth error of each link's end (see with_smooth_errors()), if
    what it leaves is white. Coverages of 95 % intervals on synthetic L1 robots, by seeds fixed beforehand, are in
    docs/kinds/calibration.md, "When intervals are given": with guideway errors these held; sandwich covariances did
    not, neither there nor for drift over poses in the order of a grid.
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
        """Whether intervals can be given."""
        return not self.reasons

    @property
    def estimate(self) -> Estimate | None:
        """With the covariance that intervals rest on; that of white residuals where none hold."""
        return self.calibration.estimate if self._smooth is None else self._smooth[0]

    @cached_property
    def reasons(self) -> tuple[str, ...]:
        """Why no interval is given, in sentences; none where they are."""
        wrong = [] if self._smooth is not None else self._wrong
        if not wrong and self._weak:
            return (self._weak,)
        if not wrong:
            return ("no 95 % intervals hold: parameters moved farther than a robot known before would go, this may "
                    "be another optimum",) if self.moved_far else ()  # fmt: skip
        return (
            *wrong,
            *self._why_not_smooth,
            "no 95 % intervals hold: such residuals are no independent noise of the size that they would rest "
            "on, parameters may be several standard deviations off; judge by the held-out poses",
        )

    @property
    def withheld(self) -> str:
        """Why no interval can be given, in one sentence; empty where they can."""
        if self.calibration.estimate is None:
            why = "" if self.calibration.status.ok else "not solved, "
            return f"no intervals hold: {why}{self.calibration.message}"
        return "" if self.holds else self.reasons[-1]

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What intervals that are given rest on, where it is not plain noise, in sentences."""
        if self.calibration.estimate is None or not self.holds:
            return ()
        said = []
        if self._few:
            said.append(
                f"{len(self.calibration.residuals)} fitted poses are too few to test whether residuals are coloured "
                f"({LEAST_POSES} are needed): "
                + ("intervals allow for smooth errors of the carts" if self._smooth is not None else
                   "intervals take them for independent noise and are too narrow if guideways are not straight or "
                   "the device drifts")
            )  # fmt: skip
        elif self._smooth is not None:
            sizes = ", ".join(
                f"{name} {1e6 * e.along:.2g} um along and {1e6 * e.across:.2g} um across its guideway over "
                f"{e.length:.2g} m, beside {1e6 * e.noise:.2g} um of noise"
                for name, e in self._smooth[1].items()
            )
            said.append(
                "residuals follow the carts' positions: 95 % intervals count smooth errors of the links' ends "
                f"({sizes}), and are of the straight guideways through these"
            )
        return tuple(said)

    @property
    def tested(self) -> bool:
        """Whether residuals are enough to be tested for whiteness."""
        return not self._few

    @property
    def coloured(self) -> bool:
        """Whether residuals were tested and are no independent noise."""
        return bool(self._coloured)

    @property
    def scope(self) -> str:
        """What the intervals cover, for the verdict."""
        if not self.holds:
            return "parameters: no 95 % intervals hold, see the notes"
        covered = f"parameters: 95 % intervals cover noise of {self._recorded}"
        if self._few:
            return f"{covered}; colour not tested, {len(self.calibration.residuals)} poses"
        if self._smooth is not None:
            return f"{covered} and smooth errors of the carts, not drift, load or scale"
        return f"{covered}; colour was tested and not found"

    @property
    def _recorded(self) -> str:
        """What the intervals describe: another recording of the robot may have its own errors beside noise."""
        problem = self.calibration.problem
        several = bool(problem.beside) or len(problem.measurements.session_names) > 1
        return "these recordings" if several else "this recording"

    @cached_property
    def correlated(self) -> int:
        """How many poses in a row have about one error: 1 unless residuals are coloured."""
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
        expected = f"if {sizes[k]:.2g} {e.units[k] or '1'} is not what to expect of it, say so in sizes"
        return (
            f"no 95 % intervals hold: {e.names[k]} is determined to {e.std[k]:.2g} {e.units[k] or '1'} only, "
            f"{times[k]:.3g} times its expected error, where intervals of linearised least squares do not hold; fix "
            f"it, give a prior, or measure poses farther apart and turned farther; {expected}"
        )

    @property
    def _few(self) -> bool:
        return all(len(c.residuals) < LEAST_POSES for c in self.calibration.parts)

    @cached_property
    def _wrong(self) -> list[str]:
        c = self.calibration
        if c.estimate is None:
            return []
        sentences = [f"{label}, poses in the order {name}: {said}" for label, name, said in self._coloured]
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
        return [one for c in parts for one in self._tested(c, c.residuals, c.problem.error_labels)]

    @cached_property
    def _smooth(self) -> tuple[Estimate, dict[str, SmoothErrors]] | None:
        """None where not needed, not possible, or where it leaves colour."""
        if self.loss != "linear" or not (self._few or any(name != MEASURED for _, name, _ in self._coloured)):
            return None
        if self._few and self._wrong:
            return None
        smooth = with_smooth_errors(self.calibration, self.position)
        if smooth is None or self._few:
            return smooth
        left = np.column_stack([e.left for e in smooth[1].values()])
        return None if self._tested(self.calibration, left, list(smooth[1])) else smooth

    @property
    def _why_not_smooth(self) -> list[str]:
        orders = {name for _, name, _ in self._coloured}
        if orders == {MEASURED}:
            return [
                "they drift over the recording; measured in random order, poses keep drift out of the parameters, in "
                "the order of a grid even a covariance for coloured residuals (Newey-West) covers too little"
            ]
        if orders:
            c = self.calibration
            hindered = {
                "has a robust loss": self.loss != "linear",
                "has another cost than linear": c.cost != "length",
                "has priors": bool(c.problem.unknowns.priors),
                "has latent variables": c.problem.implicit,
            }
            why = next((what for what, so in hindered.items() if so), "")
            if why:
                return [f"whether smooth errors of the links' ends explain them was not tried, as the fit {why}"]
            return [
                "smooth errors of the links' ends do not explain them, or several links share an unknown, or one of "
                "them moves by several actuators, where this is not tried"
            ]
        return []

    def _tested(
        self, c: Calibration, residuals: np.ndarray, labels: tuple[str, ...] | list[str]
    ) -> list[tuple[str, str, str]]:
        """Link, order and sentence of each link whose residuals are coloured."""
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
        """Orders of the poses in which residuals are tested: as measured and by each actuator."""
        problem, poses = c.problem, len(c.problem.measurements)
        q = np.asarray(problem.measurements.values[problem.actuators])
        by = {f"by {problem.actuators}[{k}]": np.argsort(q[:, k], kind="stable") for k in range(q.shape[1])}
        return {MEASURED: np.arange(poses), **by}
