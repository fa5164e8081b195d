"""What a filter says of a log: estimates with deviations, innovations, and how likely the log was."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from ..results.study import to_inherit
from ..results.trajectory import Trajectory
from .belief import Belief, InitialState, Innovation
from .system import System

MOST_WEIGHED = 1 / 3  # of the readings of a sensor: 18 % of right ones lie beyond Huber's k, and all outliers
MOST_GATED = 0.02  # of the readings of a sensor: a gate that leaves out more hides a wrong model


@dataclass(frozen=True, eq=False)
class Kept:
    """Of one instant, for smoothing: how the error came there, and the belief before and after its readings."""

    step: Any
    before: Belief
    after: Belief


@dataclass(frozen=True, eq=False)
class Replay:
    """What a run was made of, so that it can be made again with other noise: log, start and known inputs."""

    log: Mapping[str, Any]
    start: InitialState
    inputs: Trajectory | None


@to_inherit
@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimated states at K instants of m runs: what a filter and a smoother have in common.

    time: of the instants [s]. x: means (K, m, size). deviations: standard deviations of their errors (K, m, n).
    errors: (K, m, n), where the truth was given.
    """

    system: System
    time: np.ndarray
    x: np.ndarray
    deviations: np.ndarray
    errors: np.ndarray | None

    @property
    def runs(self) -> int:
        """How many runs there are."""
        return self.x.shape[1]

    @property
    def dimension(self) -> int:
        """Degrees of freedom of the state."""
        return self.system.space.dimension

    def _shown(self, a: np.ndarray) -> np.ndarray:
        return a[:, 0] if self.runs == 1 else np.swapaxes(a, 0, 1)

    def __getitem__(self, name: str) -> np.ndarray:
        """Mean of a state or of an estimated constant. Raises ArgumentError for a name that is not there."""
        self.system.space.part(name)
        return self.system.space.values(self._shown(self.x))[name]

    @property
    def deviation(self) -> dict[str, np.ndarray]:
        """Standard deviations of the errors by state."""
        return self.system.space.errors(self._shown(self.deviations))

    @property
    def error(self) -> dict[str, np.ndarray]:
        """Errors by state. Raises ArgumentError where the truth was not given."""
        if self.errors is None:
            raise ArgumentError("the truth was not given to the run, so there are no errors", "truth")
        return self.system.space.errors(self._shown(self.errors))

    def trajectory(self) -> Trajectory:
        """Means and deviations of a single run, the latter as "p.deviation"; of rows with one stamp the last, after all
        readings. Raises ArgumentError for several runs."""
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
    """A filtered log: K instants of m runs; of a single run the arrays have no axis of runs.

    time: of the instants [s]. status, message: SOLVED, or why it ended early; what was reached is kept.
    innovations: sensor -> (K, m, size) over their deviations: of a filter that is right white noise of variance 1; NaN
        where nothing was read or used. nis, count: normalised innovation squared of each instant and how many numbers
        it is made of, (K, m). log_likelihood: of the log (m,); a reading beyond its gate counts as one at its edge, one
        that counts less by Huber's loss, of interacting models and particles by the larger noise.
    gated: sensor -> readings that its gate left out (m,). weighed: sensor that weighs outliers -> readings that counted
        less (m,); their innovations are cut at Huber's k, which `consistency` knows.
    nees: normalised estimation error squared (K, m), where the truth was given; chi-squared with `dimension` degrees of
        freedom over independent runs, not over instants of one run.
    notes: sentences on what limits the numbers, such as a gate that left out more than one reading in fifty.
    replay: what a Kalman filter ran over, for `consistency`; None of other filters.
    mode_probabilities: of interacting models (K, m, modes). effective: size of the cloud of a particle filter after
        each instant's readings, before it was drawn anew (K, m). None of other filters.

    run["p"] is the mean of a state, run.deviation["p"] the standard deviation of its error, run.error["p"] the error
    itself where the truth was given; (K, size), or (m, K, size) of several runs.
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

    @property
    def covariances(self) -> np.ndarray:
        """Covariances of the errors (K, n, n) of a single run, (m, K, n, n) of several. Raises ArgumentError where they
        were not kept."""
        if self.kept is None:
            raise ArgumentError("the covariances were not kept; run with keep=True", "keep")
        return self._shown(np.array([k.after.P for k in self.kept]))


def _plain(unit: str) -> str:
    return "1" if unit == "?" else unit


class RunRecord:
    """Gathers what a run gives."""

    def __init__(self, system: System, instants: int, runs: int, keep: bool, truth: Mapping[str, Any] | None) -> None:
        n = system.space.dimension
        self.system, self.runs, self.n = system, runs, 0
        self.time = np.empty(instants)
        self.x = np.empty((instants, runs, system.space.size))
        self.variances = np.empty((instants, runs, n))
        group = system.group([*system.sensors])
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
        before: Belief,
        after: Belief,
        innovation: Innovation,
        details: Mapping[str, np.ndarray],
    ) -> None:
        """One instant."""
        k = self.n
        self.time[k], self.x[k] = time, after.x
        self.variances[k] = after.P.diagonal(0, 1, 2)
        rows = self.system.rows_of(innovation.names)
        whole = innovation.used.all()
        residual = innovation.residual if whole else np.where(innovation.used, innovation.residual, np.nan)
        for name, at in zip(innovation.names, rows, strict=True):
            self.residuals[k, :, self.columns[name]] = residual[:, at]
            self.expected[k, :, self.columns[name]] = innovation.variance[:, at]
        if not whole:
            for n, name in enumerate(innovation.names):
                self.gated[name] += innovation.gated[:, n]
        if innovation.weighed is not None:
            for n, name in enumerate(innovation.names):
                if name in self.weighed:
                    self.weighed[name] += innovation.weighed[:, n]
        self.nis[k], self.count[k] = innovation.nis, innovation.numbers
        self.log_likelihood += innovation.log_likelihood
        if self.kept is not None:
            self.kept.append(Kept(step, before, after))
        if self.truth is not None and self.errors is not None and self.nees is not None:
            self.errors[k] = self.system.space.minus(self.truth[k], after.x)
            self.nees[k] = normalised_square(self.errors[k], after.P)
        for name, value in details.items():
            self.details.setdefault(name, []).append(value)
        self.n = k + 1

    def ended(self, why: str = "", sensor: str | None = None) -> Filtered:
        """What was gathered. sensor: of which there is no value where the run ended."""
        n = self.n
        status = {"": SolveStatus.SOLVED, "stopped": SolveStatus.INTERRUPTED}.get(why, SolveStatus.NOT_FINITE)
        message = status.message
        if why == "not finite":
            at = f"after {self.time[n - 1]:g} s" if n else "at the start"
            message = f"the estimate is not finite {at}: the model has no answer there, or a covariance grew too large"
            if sensor is not None:
                at = f"at the reading after {self.time[n - 1]:g} s" if n else "at the first reading"
                message = f"the model has no finite value of what '{sensor}' measures {at}: the estimate lies beyond it"
        white = self.residuals[:n] / np.sqrt(self.expected[:n])
        cut = {name: white[:, :, at] for name, at in self.columns.items()}
        kept = None if self.kept is None else tuple(self.kept)
        nees, errors = (None, None) if self.errors is None or self.nees is None else (self.nees[:n], self.errors[:n])
        return Filtered(
            self.system, self.time[:n], self.x[:n], np.sqrt(self.variances[:n]), errors, status, message, cut,
            self.nis[:n], self.count[:n], self.log_likelihood, self.gated, nees, kept, self._notes(),
            weighed=self.weighed, replay=self.replay,
            **{name: np.array(values) for name, values in self.details.items()},
        )  # fmt: skip

    def _notes(self) -> tuple[str, ...]:
        """Of each sensor whose gate leaves out, or whose weights lessen, more than outliers: its model is wrong."""
        notes = []
        for name, sensor in self.system.sensors.items():
            out = int(self.gated[name].sum())
            given = out + int(np.isfinite(self.residuals[: self.n, :, self.columns[name]]).any(axis=2).sum())
            if out > MOST_GATED * given:
                notes.append(
                    f"the gate of '{name}' at {sensor.gate} left out {out} of {given} readings, "
                    f"{100 * out / given:.3g} %, more than the {100 * MOST_GATED:g} % that outliers explain: the model "
                    "or its noise is wrong there; run without the gate and look at the innovations"
                )
        for name, few in self.weighed.items():
            less, of = int(few.sum()), int(np.isfinite(self.residuals[: self.n, :, self.columns[name]]).any(2).sum())
            if less > MOST_WEIGHED * of:
                notes.append(
                    f"{less} of {of} readings of '{name}' counted less as outliers, {100 * less / of:.3g} %, where of "
                    f"right ones 18 % do: its noise is set too small, or the model is wrong there; see `consistency`"
                )
        if "effective" in self.details:
            sizes = np.array(self.details["effective"])
            notes.append(
                f"effective size of the cloud: {np.median(sizes):.0f} particles in the median of all instants, "
                f"{sizes.min():.0f} at the least"
            )
        return tuple(notes)


def normalised_square(d: np.ndarray, P: np.ndarray) -> np.ndarray:
    """d' P^-1 d (m,) of rows d (m, n), P scaled to a diagonal of ones first: its entries differ by 1e18."""
    scale = 1.0 / np.sqrt(np.einsum("mii->mi", P))
    e = d * scale
    return np.sum(e * np.linalg.solve(P * scale[:, :, None] * scale[:, None, :], e[..., None])[..., 0], axis=1)


def true_points(system: System, truth: Mapping[str, Any], instants: int, runs: int) -> np.ndarray:
    """True states (K, m, size) by name; constants that are not named have their own value, others none."""
    space = system.space
    points = np.empty((instants, runs, space.size))
    values = {**system.start_constants(), **truth}
    for part in space.parts:
        _, at, _ = space.part(part.name)
        if part.name not in values:
            raise ArgumentError(f"the truth of '{part.name}' is missing; give it for every state", "truth")
        v = np.asarray(values[part.name], float)
        if part.size == 1 and v.shape[-1:] != (1,):
            v = v[..., None]
        v = np.swapaxes(v, 0, 1) if v.ndim == 3 else v[:, None] if v.ndim == 2 else v
        try:
            points[:, :, at] = v
        except ValueError:
            shapes = f"({instants}, {part.size}) or ({runs}, {instants}, {part.size})"
            given = np.shape(values[part.name])
            raise ArgumentError(f"expected {shapes}; found {given}", f"truth.{part.name}") from None
    return points
