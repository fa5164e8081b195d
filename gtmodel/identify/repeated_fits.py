"""Repeated identifications: each recording alone, cross-validation, and Monte Carlo runs that show whether the
intervals hold."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from gtmodel.inference import Coverage, MonteCarlo, coverage, monte_carlo

from ..inference import BetweenRecordings, between_recordings
from ..lang import ModelError
from ..measurements import Session
from ..results.estimate import Estimate
from ..workers.mapped import mapped
from .inertia import Confidence, Identification, identify
from .options import Processing
from .regressor import Regressor
from .rows import Rows, rows_of
from .simulated_log import LogSimulator, Sensors

MOST = 12  # recordings that are fitted one by one


@dataclass(frozen=True, eq=False)
class BySession:
    """Estimates of each recording by name; `apart` compares them if they differ beyond their noise."""

    estimates: dict[str, Estimate]
    names: tuple[str, ...]
    apart: BetweenRecordings | None

    @property
    def intervals(self) -> dict[str, dict[str, list[float]]]:
        """95 % limits by parameter and recording, as far as the recording determines the parameter."""
        return {
            name: {session: list(e.interval(name)) for session, e in self.estimates.items() if name in e.names}
            for name in self.names
        }


def between_sessions(
    identification: Identification,
    sessions: Sequence[Session],
    others: Sequence[tuple[Session, Rows]] = (),
    *,
    nonnegative: bool | Sequence[str] = True,
    confidence: Confidence = "auto",
) -> BySession | None:
    """Estimate the same parameters from each recording alone; None if fewer than two determine any.

    sessions: the recordings of the fit, whose rows begin at `rows.starts`. others: further recordings with their rows.
    """  # fmt: skip
    rows = identification.rows
    parts = [(s.name, rows.part(k)) for k, s in enumerate(sessions)] + [(s.name, r) for s, r in others]
    if not 2 <= len(parts) <= MOST:
        return None
    free = (*identification.estimate.names, *identification.estimate.held)
    estimates: dict[str, Estimate] = {}
    for n, (name, part) in enumerate(parts, 1):
        if not len(part):
            continue
        # the offset parameter of another recording has no row here
        names = [p for p in free if p in part.names and np.any(part.Y[:, :, part.names.index(p)])]
        limited = nonnegative if isinstance(nonnegative, bool) else [p for p in nonnegative if p in names]
        try:
            e = identify(part, names, nonnegative=limited, confidence=confidence, test=[]).estimate
        except ModelError:
            continue
        if e.degrees_of_freedom > 0:
            estimates[name if name not in estimates else f"{name} ({n})"] = e
    if len(estimates) < 2:
        return None
    names = tuple(p for p in free if p not in rows.signed)
    return BySession(estimates, names, between_recordings(estimates, names))


Array = np.ndarray


@dataclass(frozen=True, eq=False)
class LeftOutInTurn:
    """Cross-validation errors (n, m) of all rows, measured minus modelled; `count` is the number of blocks."""

    errors: Array
    count: int

    @property
    def rms(self) -> Array:
        """rms error by target (m,), in the unit of the efforts."""
        return np.sqrt(np.mean(self.errors**2, axis=0))


def leave_out_in_turn(
    identification: Identification,
    folds: int,
    *,
    nonnegative: bool | Sequence[str] = True,
    confidence: Confidence = "auto",
) -> LeftOutInTurn:
    """Cross-validate a fit: predict each of `folds` blocks of rows, equally long in time, by a fit without it.

    With as many folds as rows, each block is one row. Neighbouring rows of a coloured residual are correlated, so
    prefer long blocks. Raises ModelError if there are fewer rows than folds, and if the remaining rows do not determine
    the parameters.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> log = gt.identify.LogSimulator(Axis(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> s = gt.identify.study(Axis(), log, ["m", "d", "c"])
    >>> left = gt.identify.leave_out_in_turn(s.fit, 5)
    >>> bool(s.noise[0] < left.rms[0] < 1.5 * s.noise[0])
    True
    """
    rows, n = identification.rows, len(identification.rows)
    if not 2 <= folds <= n:
        raise ModelError(f"{folds} folds of {n} rows; expected at least two, and no more than rows")
    free = (*identification.estimate.names, *identification.estimate.held)
    ends = np.round(np.linspace(0, n, folds + 1)).astype(int)
    errors = np.empty_like(rows.effort)

    def without(block: tuple[int, int]) -> Array:
        begin, end = block
        training = np.r_[0:begin, end:n]
        remaining = rows.chosen(training)
        # the offset of a recording that is omitted entirely has no rows
        names = [p for p in free if np.any(remaining.Y[:, :, remaining.names.index(p)])]
        limited = nonnegative if isinstance(nonnegative, bool) else [p for p in nonnegative if p in names]
        fit = identify(remaining, names, nonnegative=limited, confidence=confidence, test=[])
        part = slice(begin, end)
        return rows.effort[part] - rows.Y[part] @ fit.parameters - rows.y0[part]

    blocks = list(itertools.pairwise(ends.tolist()))
    for (begin, end), error in zip(blocks, mapped(without, blocks), strict=True):
        errors[begin:end] = error
    return LeftOutInTurn(errors, folds)


@dataclass(frozen=True)
class Repeated:
    """Estimates of the finished runs, and how often their intervals contain the truth."""

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
        simulator, sensors: the motion of the plant, and the noise of each log.
        regressor: of the fitted parameters.
        truth: name -> true value [SI] of the parameters whose intervals are checked.
        level: confidence level of the intervals.
        free, processing, confidence, processes, progress, interrupted: as for `identify`, `rows_of` and `monte_carlo`.

    The fits have no bounds: an interval at a bound has no coverage.

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
