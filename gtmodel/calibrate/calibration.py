"""Calibration of any model: measured poses in, parameters with confidence out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..compiler.flat import FlatModel
from ..inference import Identifiability
from ..inference.nonlinear import descend
from ..inference.weighting import loss_named, prior_rows
from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.source import ModelError
from ..results.estimate import Estimate
from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from .block_rows import BlockRows, JointRows, parts
from .blocks import Block
from .confidence import Fitted, estimated
from .implicit import require_noise_enough
from .measurements import Measurements
from .options import COSTS, Choice, Cost
from .problem import CalibrationProblem, noise_covariance, prepare
from .unknowns import modifiers


@dataclass(frozen=True, eq=False)
class Calibration:
    """The result of calibrate().

    `estimate` of the unknowns, None unless solved and asked for; `values` of all parameters in the closure equations;
    `start`: the `residuals` before. `blocks`: names of unknowns that were solved together.
    """

    problem: CalibrationProblem
    cost: Cost
    status: SolveStatus
    message: str
    x: np.ndarray
    estimate: Estimate | None
    identifiability: Identifiability | None
    values: dict[str, float]
    start: np.ndarray
    iterations: int
    blocks: tuple[tuple[str, ...], ...]

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of an unknown [SI] if the residuals are independent noise, which a study tests and this
        does not. Raises ArgumentError where there is no estimate, and for another name."""
        if self.estimate is None:
            raise ArgumentError("there is no estimate: not solved, or asked for without confidence", "name")
        return self.estimate.interval(name, level)

    @cached_property
    def residuals(self) -> np.ndarray:
        """Errors (N, m) [m] of `problem.error_labels`, at first use: of the lengths, and with latent variables of what
        was measured, model less measured, NaN where a pose does not close."""
        return self._errors_of(self.problem) if self.problem.implicit else self.problem.residuals(self.x)

    @property
    def alone(self) -> Calibration:
        """The same with the first of the measurements alone."""
        return replace(self, problem=replace(self.problem, beside=())) if self.problem.beside else self

    @property
    def parts(self) -> tuple[Calibration, ...]:
        """The same with each of the measurements, these first."""
        return (self, *(replace(self, problem=p) for p in self.problem.beside))

    @property
    def link_errors(self) -> dict[str, float]:
        """Mean |length error| [m] per link (Dressler 2012, eq. (5.13)), or of what was measured in part."""
        mean = np.nanmean(np.abs(self.residuals), axis=0) if len(self.residuals) else np.zeros(0)
        return dict(zip(self.problem.error_labels, mean.tolist(), strict=False))

    @property
    def pose_errors(self) -> np.ndarray:
        """Root mean square of the length errors [m] of each pose (N,)."""
        return np.sqrt(np.mean(self.residuals**2, axis=1))

    @property
    def flat(self) -> FlatModel:
        """The flat model with calibrated parameters: for causal functions, as gt.compiler.causal.compile_causal()."""
        flat = self.problem.closure.flat
        own = [replace(q, value=self.values.get(q.name, q.value)) for q in flat.parameters]
        return replace(flat, parameters=own, cache={})

    def parameters(self) -> dict[str, Any]:
        """Whole parameters as arrays and numbers, those of parts in dictionaries: for type(model)(**parameters), and
        model.with_(**parameters) where its parts had no modifiers."""
        return modifiers(self.problem.closure.flat, self.values, self.problem.closure.touched)

    def on(self, measurements: Measurements) -> np.ndarray:
        """Errors as `residuals` on other poses, such as those held out."""
        p = self.problem.on(measurements)
        return self._errors_of(p) if p.implicit else p.residuals(self.x)

    def _errors_of(self, p: CalibrationProblem) -> np.ndarray:
        errors = replace(self, problem=p).positioning_errors()
        return np.hstack([errors[n] for n in p.judged])

    def positioning_errors(self, measurements: Measurements | None = None) -> dict[str, np.ndarray]:
        """Errors of the forward kinematics of the measured actuators, model less measured, by signal of the pose.

        (N, 3) [m] for positions, and for quaternions a rotation vector (N, 3) [rad]. NaN where a pose cannot be closed.
        """
        p = self.problem if measurements is None else self.problem.on(measurements)
        errors = np.zeros((len(p.measurements), p.reading.noise.numel()))
        lost = np.zeros(len(p.measurements), bool)
        S = noise_covariance(p, "forward", unit=True)
        for b in p.blocks_of("forward"):
            y = p.adjustment(b, S).closing(self.x[b.columns])
            errors += np.where(np.isnan(y), 0.0, y)
            lost |= np.isnan(y).any(axis=1)
        errors[lost] = np.nan
        return {n: errors[:, p.reading.places[n]] for n in p.judged}


def calibrate(
    model: Model | Builder | FlatModel | CalibrationProblem,
    measurements: Measurements | Sequence[Measurements] | None = None,
    choice: Choice | None = None,
    *,
    cost: Cost = "length",
    loss: str = "linear",
    width: float = 1.0,
    start: Mapping[str, float] | None = None,
    actuators: str = "q",
    latent: Sequence[str] = (),
    hold_undetermined: bool = True,
    confidence: bool = True,
    limit: int = 100,
    stop: Callable[[], bool] | None = None,
) -> Calibration:
    """Parameters that bring the model nearest to measured poses, by Gauss-Newton on exact Jacobians.

    Arms that share no unknown are solved one by one. `cost`: see CalibrationProblem. `loss` and its `width` as in
    gtmodel.inference.nonlinear_fit(), in units of the noise where it is known and of the residual otherwise. `start`:
    other start values by unknown. With noise for all measured signals the confidence is propagated from it; otherwise
    it is estimated from the residuals, with poses taken as independent. What the poses do not determine stays at its
    start, and the estimate says so, unless `hold_undetermined` is False: ModelError then. With latent variables, and
    with several measurements, each of which has its own poses and signals, the cost is one of errors of what was
    measured; those of several weigh by their noise. Where no residual is left beyond the unknowns, and no noise is
    stated, there is no estimate; `identifiability` says how many are determined. `stop` is asked once per
    iteration: True ends with the best x so far and the status INTERRUPTED. Without `confidence` neither estimate nor
    identifiability are computed.

    Raises ModelError for what does not fit the model; an iteration that fails is a status.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> true = robot.with_(L=np.array(robot.L) + [1e-3, -2e-3, 0.0])
    >>> q, _ = true.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T})
    >>> c = gt.calibrate.calibrate(robot, poses, gt.calibrate.Choice(free=["L"]))
    >>> (1e3 * (c.parameters()["L"] - np.array(robot.L))).round(3) + 0.0  # mm
    array([ 1., -2., 0.])
    """
    if isinstance(model, CalibrationProblem):
        problem = model
    else:
        if measurements is None:
            raise ModelError("calibrate() needs measurements, or a problem made by prepare()")
        problem = prepare(model, measurements, choice, actuators=actuators, latent=latent)
    if cost not in COSTS:
        raise ModelError(f"there is no cost '{cost}'; these are: {', '.join(COSTS)}")
    u = problem.unknowns
    x = u.start.copy()
    for name, value in (start or {}).items():
        if name not in u.names:
            raise ModelError(f"start names '{name}', which is not free; these are: {', '.join(u.names)}")
        x[u.names.index(name)] = value
    _require_errors(problem, cost)
    begin = np.zeros((len(problem.measurements), 0)) if problem.implicit else problem.residuals(x)
    if not np.all(np.isfinite(begin)):
        raise ModelError("the closure equations are not finite at the start values; check units and frames")
    fits, x = _descended(problem, cost, x, loss, width, limit, stop)
    bad = next((f for f in fits if not f.descent.status.ok), None)
    status, message = (bad.descent.status, _failed(problem, bad)) if bad else (SolveStatus.SOLVED, _arrived(fits))
    estimate = identified = None
    if bad is None and confidence and fits:
        try:
            estimate, identified = estimated(problem, fits, loss_named(loss), width, hold_undetermined)
        except ValueError as error:
            raise ModelError(str(error)) from None
        if estimate is None:
            message += f"; {identified.counts}, and no residual is left to judge them by"
    return Calibration(
        problem, cost, status, message, x, estimate, identified, problem.values(x), begin,
        max((f.descent.iterations for f in fits), default=0),
        tuple(tuple(u.names[k] for k in f.rows.columns) for f in fits),
    )  # fmt: skip


def _require_errors(problem: CalibrationProblem, cost: Cost) -> None:
    """Raises ModelError where a cost does not go with latent values or with several measurements."""
    if cost not in ("length", "squared"):
        lacking = [
            f"{n} of {p.measurements.name or k}"
            for k, p in enumerate(problem.parts, 1) for n in p.noisy(cost) if n not in p.measurements.noise
        ]  # fmt: skip
        if problem.beside and lacking:
            raise ModelError(f"several measurements are weighed by their noise: give that of {', '.join(lacking)}")
        return
    latent = [n for p in problem.parts for n in p.latent]
    if latent:
        raise ModelError(
            f"the cost '{cost}' needs all lengths, and {', '.join(dict.fromkeys(latent))} is latent; take 'forward', "
            "'inverse' or 'orthogonal'"
        )
    if problem.beside:
        raise ModelError(
            f"several measurements are weighed by their noise, which the cost '{cost}' does not look at; take "
            "'forward', 'inverse' or 'orthogonal'"
        )


def _descended(
    problem: CalibrationProblem,
    cost: Cost,
    x: np.ndarray,
    loss: str,
    width: float,
    limit: int,
    stop: Callable[[], bool] | None = None,
) -> tuple[list[Fitted], np.ndarray]:
    u = problem.unknowns
    x = x.copy()
    implicit = cost in ("inverse", "forward", "orthogonal")
    if implicit and not problem.implicit and not problem.beside:  # from near the optimum each pose closes
        first, x = _descended(problem, "length", x, loss, width, limit, stop)
        if any(f.descent.status is SolveStatus.INTERRUPTED for f in first):
            return first, x
    fits = []
    for rows in _together(problem, cost, x):
        columns = rows.columns
        names = tuple(u.names[k] for k in columns)
        P, p = prior_rows(tuple(q for q in u.priors if q.name in names), names)
        d = descend(
            rows, x[columns], u.sizes[columns], P=P, p=p, loss=loss_named(loss), width=width, limit=limit, stop=stop
        )
        x[columns] = d.x
        fits.append(Fitted(rows, d, P))
    return fits, x


def _together(problem: CalibrationProblem, cost: Cost, x: np.ndarray) -> list[JointRows]:
    """Rows of the blocks of all measurements, those that share an unknown in one."""
    implicit = cost in ("inverse", "forward", "orthogonal")
    groups: list[tuple[set[int], list[BlockRows], list[int]]] = []
    for k, part in enumerate(problem.parts):
        read = part.reading
        for b in part.blocks_of(cost):
            if not len(b.columns):  # an arm of which nothing is free
                continue
            covariance, begin = None, (None, None)
            if implicit:
                covariance = noise_covariance(part, cost)
                labels = tuple(part.labels[j] for j in b.rows)
                begin = part.begin(b, covariance)
                require_noise_enough(b, read.data, covariance, begin, x[b.columns], labels)
            own = {part.unknowns.names[j] for j in b.columns}
            prior = any(p.name in own for p in part.unknowns.priors)
            sigma = 1.0 if implicit or not prior else residual_level(part, b, x)
            rows = BlockRows(b, read.data, sigma, covariance, begin)
            columns = set(b.columns.tolist())
            apart = [g for g in groups if not g[0] & columns]
            joined = [g for g in groups if g[0] & columns]
            merged = (
                columns.union(*(g[0] for g in joined)), [r for g in joined for r in g[1]] + [rows],
                [j for g in joined for j in g[2]] + [k],
            )  # fmt: skip
            groups = [*apart, merged]
    return [JointRows(members, parts) for _, members, parts in groups]


def _failed(problem: CalibrationProblem, bad: Fitted) -> str:
    """Why the iteration ended, with the poses that cannot be closed."""
    d = bad.descent
    if d.status is not SolveStatus.NOT_FINITE:
        return d.message
    for member, part in zip(bad.rows.members, bad.rows.parts, strict=True):
        lost = member.unclosed
        if len(lost):
            return problem.parts[part].measurements.unclosed(lost)
    return d.message


def residual_level(problem: CalibrationProblem, block: Block, x: np.ndarray) -> float:
    """Typical size of a residual from the stated noise, against which priors are weighed."""
    m = problem.measurements
    if any(n not in m.noise for n in problem.reading.places):
        lacking = [n for n in problem.reading.places if n not in m.noise]
        raise ModelError(f"priors are weighed against the noise: give that of {', '.join(lacking)} too")
    S, mean = noise_covariance(problem, "orthogonal"), 0.0
    for part in parts(len(m)):
        _, _, By, _ = block.evaluate_all(problem.reading.data[:, part], x[block.columns])
        own = np.broadcast_to(S, (len(m), *S.shape[1:]))[part]
        mean += float(np.sum(np.einsum("kmi,kij,kmj->km", By, own, By)))
    return float(np.sqrt(mean / (len(m) * len(block.rows))))


def _arrived(fits: Sequence[Fitted]) -> str:
    if not fits:
        return "nothing is free: judged as it is"
    counts = [f.descent.iterations for f in fits]
    return f"solved in {max(counts)} iterations" + (f", {len(fits)} blocks" if len(fits) > 1 else "")
