"""Whether the confidence intervals of a calibration hold: residuals must be noise, and as large as was stated."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ...inference import OverNoise, chi_squared_over_noise, correlation_time, noise_size, whiteness
from ...inference.residuals import SMALL_P
from ...results import Estimate
from ..calibration import Calibration
from ..smooth_errors import SmoothErrors, with_smooth_errors

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
    docs/calibration.md, "Intervals": with guideway errors these held; sandwich covariances did not, neither there nor
    for drift over poses in the order of a grid.
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
