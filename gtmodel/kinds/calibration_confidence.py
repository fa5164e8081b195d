"""Whether the confidence intervals of a calibration hold: residuals must be noise, and as large as was stated."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from gtmodel.calibrate import Calibration
from gtmodel.inference import noise_size, whiteness
from gtmodel.inference.residuals import SMALL_P

LEAST_POSES = 30  # for a test of whiteness


class Confidence:
    """Reasons in words why no interval can be told; none where residuals look like the noise they are taken for.

    Residuals of each link are tested for whiteness in the order of the poses (drift) and of each actuator's position:
    a guideway's wandering is the same wherever the cart comes by again, and shows in no other order. It is no noise but
    an effect that the model lacks: no sandwich covariance makes intervals true that it moves off their middle.
    """

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration

    @cached_property
    def reasons(self) -> tuple[str, ...]:
        c = self.calibration
        if c.estimate is None:
            return ()
        found = self._coloured()
        if c.estimate.known_noise and c.estimate.freedom > 0:
            size = noise_size(c.estimate)
            if not size.passed and c.estimate.noise > 1:
                found.append(size.sentence)
        if found:
            found.append(
                "no 95 % intervals are told: such residuals are no independent noise of the size that they would rest "
                "on, parameters may be several standard deviations off; judge by the held-out poses"
            )
        return tuple(found)

    @property
    def holds(self) -> bool:
        return not self.reasons

    def _coloured(self) -> list[str]:
        residuals, labels = self.calibration.residuals, self.calibration.problem.labels
        if len(residuals) < LEAST_POSES or not residuals.shape[1]:
            return []
        problem = self.calibration.problem
        q = np.asarray(problem.measurements.values[problem.actuators])
        orders = {"as measured": np.arange(len(residuals))}
        orders |= {f"by {problem.actuators}[{k}]": np.argsort(q[:, k], kind="stable") for k in range(q.shape[1])}
        found = []
        for label, r in zip(labels, residuals.T, strict=True):
            tests = {name: whiteness(r[order]) for name, order in orders.items()}
            name = min(tests, key=lambda n: tests[n].p)
            if tests[name].p < SMALL_P / (len(orders) * len(labels)):  # Bonferroni: a false alarm in 1 % of all fits
                found.append(f"{label}, poses in the order {name}: {tests[name].sentence}")
        return found
