"""Result of a filter over a log: estimates with standard deviations, innovations, and the likelihood of the log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from ..results.study import to_inherit
from ..results.trajectory import Trajectory
from .belief import Belief, InitialState, Innovation
from .system import System

MOST_WEIGHED = 1 / 3  # of the readings of a sensor: 18 % of the good ones lie beyond Huber's k, and all outliers
MOST_GATED = 0.02  # of the readings of a sensor: a gate that leaves out more hides a wrong model


class Kept(NamedTuple):
    """One instant, kept for smoothing: the step that led to it, and the beliefs before and after its readings."""

    step: Any
    before: Belief
    after: Belief


@dataclass(frozen=True, eq=False)
class Replay:
    """Log, start and known inputs of a run, to repeat it with other noise."""

    log: Mapping[str, Any]
    start: InitialState
    inputs: Trajectory | None


@to_inherit
@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimated states at K instants of m runs: base of the results of filter and smoother.

    time: of the instants [s]. x: means (K, m, size). deviations: standard deviations of their errors (K, m, n).
    errors: (K, m, n), if the truth was given.
    """

    system: System
    time: np.ndarray
    x: np.ndarray
    deviations: np.ndarray
    errors: np.ndarray | None

    @property
    def runs(self) -> int:
        """Number of runs."""
        return self.x.shape[1]

    @property
    def dimension(self) -> int:
        """Degrees of freedom of the state."""
        return self.system.space.dimension

    def _shown(self, a: np.ndarray) -> np.ndarray:
        return a[:, 0] if self.runs == 1 else np.swapaxes(a, 0, 1)

    def __getitem__(self, name: str) -> np.ndarray:
        """Mean of a state or of an estimated constant. Raises ArgumentError for an unknown name."""
        self.system.space.part(name)
        return self.system.space.values(self._shown(self.x))[name]

    @property
    def deviation(self) -> dict[str, np.ndarray]:
        """Standard deviations of the errors by state."""
        return self.system.space.errors(self._shown(self.deviations))

    @property
    def error(self) -> dict[str, np.ndarray]:
        """Errors by state. Raises ArgumentError if the truth was not given."""
        if self.errors is None:
            raise ArgumentError("the run has no truth and so no errors; pass truth= to `run`", "truth")
        return self.system.space.errors(self._shown(self.errors))

    def trajectory(self) -> Trajectory:
        """Return means and standard deviations ("p.deviation") of a single run as a trajectory.

        Of rows with the same time it keeps the last one, after all readings. Raises ArgumentError for several runs.
        """
        if self.runs > 1:
            raise ArgumentError(f"there are {self.runs} runs; a trajectory holds one", "runs")
        values, units = {}, {}
        for part in self.system.space.parts:
            values[part.name], units[part.name] = self[part.name], _plain(part.unit)
        for part in self.system.space.parts:
            name = f"{part.name}.deviation"
            values[name], units[name] = self.deviation[part.name], _plain(part.error_unit)
        rows = np.concatenate([np.diff(self.time) > 0, [True]])
        title = type(self).__name__.lower()
        return Trajectory(self.time[rows], {n: v[rows] for n, v in values.items()}, units, title=title)


@dataclass(frozen=True, eq=False)
class Filtered(Estimates):
    """A filtered log: K instants of m runs.

    time: of the instants [s]. status, message: SOLVED, or why the run ended early; earlier instants are kept.
    innovations: sensor -> (K, m, size), normalised by their standard deviations: white noise of variance 1 for a
        consistent filter; NaN if nothing was read or used. innovation_deviations: these standard deviations.
    nis, count: normalised innovation squared of each instant and its number of components, (K, m). log_likelihood: of
        the log (m,). A reading beyond its gate counts as one at its edge; an outlier with less weight counts by Huber's
        loss, or with its larger noise for interacting models and particles.
    gated: sensor -> number of readings that its gate left out (m,). weighed: sensor that weighs outliers -> number of
        readings with less weight (m,); their innovations are cut at Huber's k, and `consistency` accounts for this.
    nees: normalised estimation error squared (K, m), if the truth was given; chi-squared with `dimension` degrees of
        freedom over independent runs, not over instants of one run.
    notes: sentences on the limits of the result, such as a gate that left out more than one reading in fifty.
    replay: log and start of a Kalman filter, for `consistency`; None for other filters.
    blocks: of a single run, the covariances within each state one after the other (K, sum of d^2); see `covariance`.
    mode_probabilities: of interacting models (K, m, modes). effective: effective sample size of a particle filter after
        the readings of each instant, before resampling (K, m). None for other filters.

    run["p"] is the mean of a state, run.deviation["p"] the standard deviation of its error, run.error["p"] the error
    itself if the truth was given; (K, size) for a single run, (m, K, size) for several.
    """

    status: SolveStatus
    message: str
    innovations: Mapping[str, np.ndarray]
    nis: np.ndarray
    count: np.ndarray
    log_likelihood: np.ndarray
    gated: Mapping[str, np.ndarray]
    nees: np.ndarray | None
    kept: tuple[Kept, ...] | None
    notes: tuple[str, ...] = ()
    mode_probabilities: np.ndarray | None = None
    effective: np.ndarray | None = None
    weighed: Mapping[str, np.ndarray] = field(default_factory=dict)
    replay: Replay | None = None
    innovation_deviations: Mapping[str, np.ndarray] = field(default_factory=dict)
    blocks: np.ndarray | None = None

    def covariance(self, name: str) -> np.ndarray:
        """Return the covariances of the errors of one state, (K, d, d), of a single run, kept or not.

        Raises ArgumentError for an unknown name and for several runs.
        """
        part, _, along = self.system.space.part(name)
        if self.blocks is None:
            raise ArgumentError(f"there are {self.runs} runs; covariances by state are kept for one", "runs")
        before = sum(p.dimension**2 for p, _, at in self.system.space.places() if at.start < along.start)
        d = part.dimension
        return self.blocks[:, before : before + d**2].reshape(-1, d, d)

    @property
    def covariances(self) -> np.ndarray:
        """Covariances of the errors, (K, n, n) of a single run, (m, K, n, n) of several.

        Raises ArgumentError if they were not kept.
        """
        if self.kept is None:
            raise ArgumentError("the covariances were not kept; run with keep=True", "keep")
        return self._shown(np.array([k.after.P for k in self.kept]))


def _plain(unit: str) -> str:
    return "1" if unit == "?" else unit


class RunRecord:
    """Collects the results of a run."""

    def __init__(self, system: System, instants: int, runs: int, keep: bool, truth: Mapping[str, Any] | None) -> None:
        n = system.space.dimension
        self.system, self.runs, self.n = system, runs, 0
        self.time = np.empty(instants)
        self.x = np.empty((instants, runs, system.space.size))
        self.variances = np.empty((instants, runs, n))
        inside = [np.indices((a.stop - a.start,) * 2).reshape(2, -1) + a.start for _, _, a in system.space.places()]
        self.inside = np.concatenate(inside, axis=1)
        self.blocks = np.empty((instants, self.inside.shape[1])) if runs == 1 else None
        self.names = tuple(system.sensors)
        group = system.group(self.names)
        self.columns = dict(zip(system.sensors, group.rows, strict=True))
        self.residuals = np.full((instants, runs, group.space.dimension), np.nan)
        self.expected = np.ones_like(self.residuals)
        self.nis, self.count = np.zeros((instants, runs)), np.zeros((instants, runs), int)
        self.log_likelihood = np.zeros(runs)
        self.gated = {name: np.zeros(runs, int) for name in system.sensors}
        self.weighed = {name: np.zeros(runs, int) for name, s in system.sensors.items() if s.outliers}
        self.details: dict[str, list[np.ndarray]] = {}
        self.replay: Replay | None = None
        self.kept: list[Kept] | None = [] if keep else None
        self.truth = None if truth is None else true_points(system, truth, instants, runs)
        self.nees = None if truth is None else np.empty((instants, runs))
        self.errors = None if truth is None else np.empty((instants, runs, n))

    def add(
        self,
        time: float,
        step: Any,
        before: Belief | None,
        after: Belief,
        innovation: Innovation,
        details: Mapping[str, np.ndarray],
    ) -> None:
        """Add one instant; before: the belief before its readings, if it is kept."""
        k = self.n
        self.time[k], self.x[k] = time, after.x
        self.variances[k] = after.P.diagonal(0, 1, 2)
        if self.blocks is not None:
            self.blocks[k] = after.P[0][*self.inside]
        whole = innovation.whole
        residual = innovation.residual if whole else np.where(innovation.used, innovation.residual, np.nan)
        if innovation.names == self.names:
            self.residuals[k], self.expected[k] = residual, innovation.variance
        else:
            rows = self.system.rows_of(innovation.names)
            for name, columns in zip(innovation.names, rows, strict=True):
                self.residuals[k, :, self.columns[name]] = residual[:, columns]
                self.expected[k, :, self.columns[name]] = innovation.variance[:, columns]
        if not whole:
            for n, name in enumerate(innovation.names):
                self.gated[name] += innovation.gated[:, n]
        if innovation.weighed is not None:
            for n, name in enumerate(innovation.names):
                if name in self.weighed:
                    self.weighed[name] += innovation.weighed[:, n]
        self.nis[k], self.count[k] = innovation.nis, innovation.numbers
        self.log_likelihood += innovation.log_likelihood
        if self.kept is not None and before is not None:
            self.kept.append(Kept(step, before, after))
        if self.truth is not None and self.errors is not None and self.nees is not None:
            self.errors[k] = self.system.space.minus(self.truth[k], after.x)
            self.nees[k] = normalised_square(self.errors[k], after.P)
        for name, value in details.items():
            self.details.setdefault(name, []).append(value)
        self.n = k + 1

    def ended(self, why: str = "", sensor: str | None = None) -> Filtered:
        """Return the result so far. sensor: the sensor without a finite model value, if one ended the run."""
        n = self.n
        status = {"": SolveStatus.SOLVED, "stopped": SolveStatus.INTERRUPTED}.get(why, SolveStatus.NOT_FINITE)
        message = status.message
        if why == "not finite":
            where = f"after {self.time[n - 1]:g} s" if n else "at the start"
            message = f"the estimate is not finite {where}: the model has no value, or a covariance grew too large"
            if sensor is not None:
                where = f"at the reading after {self.time[n - 1]:g} s" if n else "at the first reading"
                message = f"the model has no finite value for '{sensor}' {where}: the estimate is outside its range"
        white = self.residuals[:n] / np.sqrt(self.expected[:n])
        cut = {name: white[:, :, columns] for name, columns in self.columns.items()}
        spread = {name: np.sqrt(self.expected[:n, :, columns]) for name, columns in self.columns.items()}
        kept = None if self.kept is None else tuple(self.kept)
        nees, errors = (None, None) if self.errors is None or self.nees is None else (self.nees[:n], self.errors[:n])
        return Filtered(
            self.system, self.time[:n], self.x[:n], np.sqrt(self.variances[:n]), errors, status, message, cut,
            self.nis[:n], self.count[:n], self.log_likelihood, self.gated, nees, kept, self._notes(),
            weighed=self.weighed, replay=self.replay, innovation_deviations=spread,
            blocks=None if self.blocks is None else self.blocks[:n],
            **{name: np.array(values) for name, values in self.details.items()},
        )  # fmt: skip

    def _notes(self) -> tuple[str, ...]:
        """A note for each sensor whose gate or outlier weights affect more readings than outliers explain."""
        notes = []
        for name, sensor in self.system.sensors.items():
            out = int(self.gated[name].sum())
            total = out + int(np.isfinite(self.residuals[: self.n, :, self.columns[name]]).any(axis=2).sum())
            if out > MOST_GATED * total:
                notes.append(
                    f"the gate of '{name}' at {sensor.gate} left out {out} of {total} readings, "
                    f"{100 * out / total:.3g} %, more than the {100 * MOST_GATED:g} % that outliers explain: the model "
                    "or its noise is wrong; run without the gate and look at the innovations"
                )
        for name, few in self.weighed.items():
            less, total = int(few.sum()), int(np.isfinite(self.residuals[: self.n, :, self.columns[name]]).any(2).sum())
            if less > MOST_WEIGHED * total:
                notes.append(
                    f"{less} of {total} readings of '{name}', {100 * less / total:.3g} %, counted less as outliers; "
                    "18 % of good readings do: its noise is set too small, or the model is wrong; see `consistency`"
                )
        if "effective" in self.details:
            sizes = np.array(self.details["effective"])
            notes.append(
                f"effective sample size: {np.median(sizes):.0f} particles in the median over all instants, "
                f"{sizes.min():.0f} at least"
            )
        return tuple(notes)


def normalised_square(d: np.ndarray, P: np.ndarray) -> np.ndarray:
    """d' P^-1 d (m,) of rows d (m, n). P is scaled to a diagonal of ones first: its entries differ by 1e18."""
    scale = 1.0 / np.sqrt(np.einsum("mii->mi", P))
    e = d * scale
    return np.sum(e * np.linalg.solve(P * scale[:, :, None] * scale[:, None, :], e[..., None])[..., 0], axis=1)


def true_points(system: System, truth: Mapping[str, Any], instants: int, runs: int) -> np.ndarray:
    """True states (K, m, size) by name; constants that are not named take their declared value."""
    space = system.space
    points = np.empty((instants, runs, space.size))
    values = {**system.start_constants(), **truth}
    for part in space.parts:
        _, columns, _ = space.part(part.name)
        if part.name not in values:
            raise ArgumentError(f"the truth of '{part.name}' is missing; give it for every state", "truth")
        v = np.asarray(values[part.name], float)
        if part.size == 1 and v.shape[-1:] != (1,):
            v = v[..., None]
        v = np.swapaxes(v, 0, 1) if v.ndim == 3 else v[:, None] if v.ndim == 2 else v
        try:
            points[:, :, columns] = v
        except ValueError:
            shapes = f"({instants}, {part.size}) or ({runs}, {instants}, {part.size})"
            shape = np.shape(values[part.name])
            raise ArgumentError(f"expected {shapes}; found {shape}", f"truth.{part.name}") from None
    return points
