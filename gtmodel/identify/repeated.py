"""The same identification on many synthetic logs: are the parameters unbiased, do the intervals hold?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from gtmodel.inference import Coverage, MonteCarlo, coverage, monte_carlo
from gtmodel.measurements import Session
from gtmodel.results.estimate import Estimate

from .inertia import Confidence, identify
from .options import Processing
from .regressor import Regressor
from .rows import rows_of
from .simulated_log import LogSimulator, Sensors


@dataclass(frozen=True)
class Repeated:
    """Estimates of the runs that ended, and how often their intervals hold the truth."""

    runs: MonteCarlo
    coverage: Coverage

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        return self.runs.results


def repeat_identification(
    simulator: LogSimulator,
    regressor: Regressor,
    truth: dict[str, float],
    sensors: Sensors,
    runs: int,
    seed: int,
    *,
    free: Sequence[str] | None = None,
    processing: Processing | None = None,
    confidence: Confidence = "auto",
    level: float = 0.95,
    processes: int | None = None,
    progress: Callable[[int, int], object] | None = None,
    interrupted: Callable[[], bool] | None = None,
) -> Repeated:
    """Draw, prepare and fit `runs` synthetic logs with generators spawned from `seed`, in parallel processes.

    Args:
        simulator, sensors: the motion of the plant, and the noise that each log has of its own.
        regressor: of the parameters that are fitted.
        truth: name -> true value [SI] of the parameters whose intervals are judged.
        level: of the intervals.
        free, processing, confidence, processes, progress, interrupted: as of `identify`, `rows_of` and `monte_carlo`.

    Fits are without bounds: an interval at a bound has no coverage.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> simulator = gt.identify.LogSimulator(Axis(), q)
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d", "c"])
    >>> truth = {"m": 2.0, "d": 5.0, "c": 3.0}
    >>> noisy = gt.identify.Sensors(effort_noise=0.5)
    >>> seen = gt.identify.repeat_identification(simulator, regressor, truth, noisy, 20, seed=1, processes=0)
    >>> seen.coverage.band, seen.coverage.outside  # hits of 20 that chance allows; names with others
    ((15, 20), ())
    """
    task = partial(_run, simulator, regressor, sensors, processing or Processing(), free, confidence)
    repetitions = monte_carlo(task, runs, seed, processes=processes, progress=progress, interrupted=interrupted)
    return Repeated(repetitions, coverage(repetitions.results, truth, level=level))


def _run(
    simulator: LogSimulator,
    regressor: Regressor,
    sensors: Sensors,
    processing: Processing,
    free: Sequence[str] | None,
    confidence: Confidence,
    rng: np.random.Generator,
    k: int,
) -> Estimate:
    session = Session(f"synthetic {k}", simulator.draw(rng, sensors), simulator.sample_time)
    rows = rows_of(session, regressor, processing, simulator.known, simulator.targets)
    return identify(rows, free, nonnegative=False, confidence=confidence, test=[]).estimate
