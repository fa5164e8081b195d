"""Calibration of any model: measured poses in, parameters with confidence out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..compiler.flat import FlatModel
from ..inference import Identifiability
from ..inference.losses import loss_named
from ..inference.nonlinear import descend
from ..inference.weighting import prior_rows
from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.source import ModelError
from ..results.estimate import Estimate
from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from .block_rows import BlockRows, parts
from .blocks import Block
from .choice import Choice
from .confidence import Fitted, estimated
from .implicit import Adjustment, require_noise_enough
from .measurements import Measurements
from .modifiers import modifiers
from .options import COSTS, Cost
from .problem import CalibrationProblem, noise_covariance, prepare


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
        """Length errors (N, m) [m] of `problem.labels`, at first use; none with latent variables."""
        return np.zeros_like(self.start) if self.problem.reading.latent.numel() else self.problem.residuals(self.x)

    @property
    def link_errors(self) -> dict[str, float]:
        """Mean |length error| [m] per link (Dressler 2012, eq. (5.13))."""
        return dict(zip(self.problem.labels, np.abs(self.residuals).mean(axis=0).tolist(), strict=True))

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
        """Length errors (N, m) [m] on other poses, such as those held out."""
        return self.problem.on(measurements).residuals(self.x)

    def positioning_errors(self, measurements: Measurements | None = None) -> dict[str, np.ndarray]:
        """Errors of the forward kinematics of the measured actuators, model less measured, by signal of the pose.

        (N, 3) [m] for positions, and for quaternions a rotation vector (N, 3) [rad]. NaN where a pose cannot be closed.
        """
        p = self.problem if measurements is None else self.problem.on(measurements)
        errors = np.full((len(p.measurements), p.reading.noise.numel()), np.nan)
        S = noise_covariance(p, "forward", unit=True)
        for b in p.blocks_of("forward"):
            y = Adjustment(b, p.reading.data, S, p.reading.latent.numel()).closing(self.x[b.columns])
            touched = [k for k in range(errors.shape[1]) if np.any(np.nan_to_num(y[:, k]))]
            errors[:, touched] = y[:, touched]
        return {n: errors[:, s] for n, s in p.reading.places.items() if n != p.actuators}


def calibrate(
    model: Model | Builder | FlatModel | CalibrationProblem,
    measurements: Measurements | None = None,
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
    start, and the estimate says so, unless `hold_undetermined` is False: ModelError then. `stop` is asked once per
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
    begin = problem.residuals(x) if not problem.reading.latent.numel() else np.zeros((len(problem.measurements), 0))
    if not np.all(np.isfinite(begin)):
        raise ModelError("the closure equations are not finite at the start values; check units and frames")
    fits, x = _descended(problem, cost, x, loss, width, limit, stop)
    bad = next((f for f in fits if not f.descent.status.ok), None)
    status, message = (bad.descent.status, bad.descent.message) if bad else (SolveStatus.SOLVED, _arrived(fits))
    estimate = identified = None
    if bad is None and confidence:
        try:
            estimate, identified = estimated(problem, fits, loss_named(loss), width, hold_undetermined)
        except ValueError as error:
            raise ModelError(str(error)) from None
    return Calibration(
        problem, cost, status, message, x, estimate, identified, problem.values(x), begin,
        max(f.descent.iterations for f in fits), tuple(tuple(u.names[k] for k in f.rows.block.columns) for f in fits),
    )  # fmt: skip


def _descended(
    problem: CalibrationProblem,
    cost: Cost,
    x: np.ndarray,
    loss: str,
    width: float,
    limit: int,
    stop: Callable[[], bool] | None = None,
) -> tuple[list[Fitted], np.ndarray]:
    u, read = problem.unknowns, problem.reading
    x = x.copy()
    implicit = cost in ("inverse", "forward", "orthogonal")
    if implicit and not read.latent.numel():  # from near the optimum each pose closes
        first, x = _descended(problem, "length", x, loss, width, limit, stop)
        if any(f.descent.status is SolveStatus.INTERRUPTED for f in first):
            return first, x
    fits = []
    for b in problem.blocks_of(cost):
        if not len(b.columns):  # an arm of which nothing is free
            continue
        names = tuple(u.names[k] for k in b.columns)
        own = tuple(p for p in u.priors if p.name in names)
        P, p = prior_rows(own, names)
        covariance = None
        if implicit:
            covariance = noise_covariance(problem, cost)
            labels = tuple(problem.labels[k] for k in b.rows)
            require_noise_enough(b, read.data, covariance, read.latent.numel(), x[b.columns], labels)
        sigma = 1.0 if implicit or not own else _level(problem, b, x)
        rows = BlockRows(b, read.data, sigma, covariance, read.latent.numel())
        d = descend(
            rows, x[b.columns], u.sizes[b.columns], P=P, p=p, loss=loss_named(loss), width=width, limit=limit, stop=stop
        )
        x[b.columns] = d.x
        fits.append(Fitted(rows, d, P))
    return fits, x


def _level(problem: CalibrationProblem, block: Block, x: np.ndarray) -> float:
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
    counts = [f.descent.iterations for f in fits]
    return f"solved in {max(counts)} iterations" + (f", {len(fits)} blocks" if len(fits) > 1 else "")
