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
from .regressor import Regressor
from .rows import Processing, rows_of
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
    """Draw, prepare and fit `runs` logs with generators spawned from `seed`, in parallel processes.

    truth: name -> true value, of the parameters whose intervals are judged. Fits are without bounds: an interval at a
    bound has no coverage. Arguments beyond: as of `identify`, `rows_of` and `monte_carlo`.
    """
    task = partial(_run, simulator, regressor, sensors, processing or Processing(), free, confidence)
    found = monte_carlo(task, runs, seed, processes=processes, progress=progress, interrupted=interrupted)
    return Repeated(found, coverage(found.results, truth, level=level))


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
