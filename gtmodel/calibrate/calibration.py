"""Calibration of any model: parameters with confidence from measured poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from .._pickling import Portable
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
class Calibration(Portable):
    """The result of calibrate().

    `estimate` of the unknowns: None if not solved or if not computed. `values` of all parameters in the closure
    equations. `start`: `residuals` at the start values. `blocks`: names of the unknowns that were solved together.
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
        """Return the confidence interval of an unknown [SI], valid if the residuals are independent noise.

        A study tests that; this method does not. Raises ArgumentError if there is no estimate or no such unknown."""
        if self.estimate is None:
            raise ArgumentError("there is no estimate: not solved, or `confidence` was False", "name")
        return self.estimate.interval(name, level)

    @cached_property
    def residuals(self) -> np.ndarray:
        """Errors (N, m) [m] of `problem.error_labels`: link lengths, or model less measured with latent variables.

        NaN if a pose does not close."""
        return self._errors_of(self.problem) if self.problem.implicit else self.problem.residuals(self.x)

    @property
    def alone(self) -> Calibration:
        """This calibration with the first measurements only."""
        return replace(self, problem=replace(self.problem, beside=())) if self.problem.beside else self

    @property
    def parts(self) -> tuple[Calibration, ...]:
        """One calibration per measurements, this one first."""
        return (self, *(replace(self, problem=p) for p in self.problem.beside))

    @property
    def link_errors(self) -> dict[str, float]:
        """Mean |length error| [m] per link (Dressler 2012, eq. (5.13)), or mean error of each partial measurement."""
        mean = np.nanmean(np.abs(self.residuals), axis=0) if len(self.residuals) else np.zeros(0)
        return dict(zip(self.problem.error_labels, mean.tolist(), strict=False))

    @property
    def pose_errors(self) -> np.ndarray:
        """Root mean square of the length errors [m] of each pose (N,)."""
        return np.sqrt(np.mean(self.residuals**2, axis=1))

    @property
    def flat(self) -> FlatModel:
        """The flat model with calibrated parameters, for gt.compiler.causal.compile_causal()."""
        flat = self.problem.closure.flat
        parameters = [replace(q, value=self.values.get(q.name, q.value)) for q in flat.parameters]
        return replace(flat, parameters=parameters, cache={})

    def parameters(self) -> dict[str, Any]:
        """Return whole parameters as arrays and numbers, those of parts in dictionaries.

        For type(model)(**parameters), and for model.with_(**parameters) if its parts had no modifiers."""
        return modifiers(self.problem.closure.flat, self.values, self.problem.closure.touched)

    def on(self, measurements: Measurements) -> np.ndarray:
        """Return errors as in `residuals` on other poses, such as held-out ones."""
        p = self.problem.on(measurements)
        return self._errors_of(p) if p.implicit else p.residuals(self.x)

    def _errors_of(self, p: CalibrationProblem) -> np.ndarray:
        errors = replace(self, problem=p).positioning_errors()
        return np.hstack([errors[n] for n in p.judged])

    def positioning_errors(self, measurements: Measurements | None = None) -> dict[str, np.ndarray]:
        """Return errors of the forward kinematics at the measured actuators, model less measured, by pose signal.

        (N, 3) [m] for positions and a rotation vector (N, 3) [rad] for quaternions. NaN if a pose cannot be closed.
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
    """Fit parameters to measured poses by Gauss-Newton with exact Jacobians.

    Blocks (arms) that share no unknown are solved one by one. `cost`: see CalibrationProblem. `loss` and its `width` as
    in gtmodel.inference.nonlinear_fit(), in units of the noise if it is known and of the residual otherwise. `start`:
    other start values by unknown. If the noise of all measured signals is stated, it is propagated to the covariance of
    the parameters. Otherwise the residuals give the covariance; poses are then assumed independent. Directions that
    the poses do not determine stay at their start values, and a note says so; with `hold_undetermined` False they
    raise ModelError. With latent variables or several measurements, the cost must be an error of measured signals.
    Several measurements, each with its own poses and signals, are weighted by their noise. Without degrees of freedom
    left and without stated noise there is no estimate; `identifiability` says how many parameters are determined.
    `stop` is called once per iteration: True ends with the best x so far and the status INTERRUPTED. With `confidence`
    False, neither estimate nor identifiability is computed.

    Raises ModelError if an argument does not fit the model. An iteration that fails gives a status, no exception.

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
            raise ModelError("calibrate() needs measurements, or a problem from prepare()")
        problem = prepare(model, measurements, choice, actuators=actuators, latent=latent)
    if cost not in COSTS:
        raise ModelError(f"there is no cost '{cost}'; choose one of: {', '.join(COSTS)}")
    u = problem.unknowns
    x = u.start.copy()
    for name, value in (start or {}).items():
        if name not in u.names:
            raise ModelError(f"start names '{name}', which is not free; free are: {', '.join(u.names)}")
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
            message += f"; {identified.counts}, but no degrees of freedom are left to estimate their errors"
    return Calibration(
        problem, cost, status, message, x, estimate, identified, problem.values(x), begin,
        max((f.descent.iterations for f in fits), default=0),
        tuple(tuple(u.names[k] for k in f.rows.columns) for f in fits),
    )  # fmt: skip


def _require_errors(problem: CalibrationProblem, cost: Cost) -> None:
    """Raise ModelError if a cost cannot be used with latent values or with several measurements."""
    if cost not in ("length", "squared"):
        lacking = [
            f"{n} of {p.measurements.name or k}"
            for k, p in enumerate(problem.parts, 1) for n in p.noisy(cost) if n not in p.measurements.noise
        ]  # fmt: skip
        if problem.beside and lacking:
            raise ModelError(f"several measurements are weighted by their noise: state that of {', '.join(lacking)}")
        return
    latent = [n for p in problem.parts for n in p.latent]
    if latent:
        raise ModelError(
            f"the cost '{cost}' needs all lengths, but {', '.join(dict.fromkeys(latent))} is latent; choose 'forward', "
            "'inverse' or 'orthogonal'"
        )
    if problem.beside:
        raise ModelError(
            f"several measurements are weighted by their noise, which the cost '{cost}' ignores; choose "
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
    if implicit and not problem.implicit and not problem.beside:  # near the optimum each pose closes
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
    """Rows of the blocks of all measurements; blocks that share an unknown are joined."""
    implicit = cost in ("inverse", "forward", "orthogonal")
    groups: list[tuple[set[int], list[BlockRows], list[int]]] = []
    for k, part in enumerate(problem.parts):
        read = part.reading
        for b in part.blocks_of(cost):
            if not len(b.columns):  # an arm without free parameters
                continue
            covariance, begin = None, (None, None)
            if implicit:
                covariance = noise_covariance(part, cost)
                labels = tuple(part.labels[j] for j in b.rows)
                begin = part.begin(b, covariance)
                require_noise_enough(b, read.data, covariance, begin, x[b.columns], labels)
            names = {part.unknowns.names[j] for j in b.columns}
            prior = any(p.name in names for p in part.unknowns.priors)
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
    """Why the iteration ended, with the poses that do not close."""
    d = bad.descent
    if d.status is not SolveStatus.NOT_FINITE:
        return d.message
    for member, part in zip(bad.rows.members, bad.rows.parts, strict=True):
        lost = member.unclosed
        if len(lost):
            return problem.parts[part].measurements.unclosed(lost)
    return d.message


def residual_level(problem: CalibrationProblem, block: Block, x: np.ndarray) -> float:
    """Typical size of a residual according to the stated noise; priors are weighted against it."""
    m = problem.measurements
    if any(n not in m.noise for n in problem.reading.places):
        lacking = [n for n in problem.reading.places if n not in m.noise]
        raise ModelError(f"priors are weighted against the noise: state that of {', '.join(lacking)} too")
    S, mean = noise_covariance(problem, "orthogonal"), 0.0
    for part in parts(len(m)):
        _, _, By, _ = block.evaluate_all(problem.reading.data[:, part], x[block.columns])
        covariance = np.broadcast_to(S, (len(m), *S.shape[1:]))[part]
        mean += float(np.sum(np.einsum("kmi,kij,kmj->km", By, covariance, By)))
    return float(np.sqrt(mean / (len(m) * len(block.rows))))


def _arrived(fits: Sequence[Fitted]) -> str:
    if not fits:
        return "nothing is free: the robot is evaluated as it is"
    most = max(f.descent.iterations for f in fits)
    return f"solved in {most} iteration{'s'[: most != 1]}" + (f", {len(fits)} blocks" if len(fits) > 1 else "")
