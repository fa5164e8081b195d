"""A calibration made ready: equations of the model, data, unknowns and functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..compiler.causal import flat_of
from ..compiler.flat import FlatModel
from ..inference import Identifiability, identifiability
from ..inference.weighting import prior_rows
from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.source import ModelError
from .blocks import Block, blocks
from .choice import Choice
from .closure import Closure, closure_equations
from .measurements import Measurements
from .reading import Reading, reading
from .unknowns import Parameters, Unknowns, unknowns


@dataclass(frozen=True, eq=False)
class CalibrationProblem:
    """A calibration made ready: closure equations of the model with data, unknowns and functions; nothing is solved.

    `costs`: "squared" closure residuals (Dressler 2012, eq. (5.1)); "length", their roots |d| - L; the errors of the
    measured signals that close every pose: of `actuators` alone ("inverse"), of all others ("forward"), or of all that
    have noise ("orthogonal").
    """

    closure: Closure
    measurements: Measurements
    reading: Reading
    unknowns: Unknowns
    actuators: str
    made: dict[str, tuple[Block, ...]] = field(default_factory=dict, repr=False)

    def blocks_of(self, cost: str) -> tuple[Block, ...]:
        """What a cost is made of; what shares a noise that it counts is in one block. Made once, for all poses."""
        if cost not in self.made:
            places, counted = self.reading.places, () if cost in ("squared", "length") else self.noisy(cost)
            joined = [k for n in counted for k in range(places[n].start, places[n].stop)]
            read, u = self.reading, self.unknowns
            known = [ca.vertcat(*[s for s, _ in read.values])], [ca.vertcat(*[v for _, v in read.values])]
            rows = self.closure.residuals if cost == "squared" else self.closure.lengths
            (inside,) = u.substituted(ca.substitute([rows], *known))
            self.made[cost] = blocks(inside, read.d, read.noise, read.latent, u.x, joined)
        return self.made[cost]

    @property
    def squared(self) -> tuple[Block, ...]:
        """The blocks of the squared closures."""
        return self.blocks_of("squared")

    @property
    def lengths(self) -> tuple[Block, ...]:
        """The blocks of the length errors."""
        return self.blocks_of("length")

    @property
    def orthogonal(self) -> tuple[Block, ...]:
        """The blocks in which the noise of all signals counts."""
        return self.blocks_of("orthogonal")

    def noisy(self, cost: str) -> list[str]:
        """Signals whose errors a cost counts."""
        every = list(self.reading.places)
        return every if cost == "orthogonal" else [n for n in every if (n == self.actuators) == (cost == "inverse")]

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the closure residuals: links, in the model's order."""
        return self.closure.labels

    def residuals(self, x: ArrayLike | None = None) -> np.ndarray:
        """Lengths' errors (N, m) [m] in the order of `labels`, at x (default: the start).

        Raises ModelError where latent variables leave them open.
        """
        if self.closure.latent:
            raise ModelError(
                f"{', '.join(self.closure.latent)} is latent, so that no length is known by itself; take the errors of "
                "what was measured, positioning_errors()"
            )
        x = self.unknowns.start if x is None else np.asarray(x, float)
        r = np.empty((len(self.measurements), len(self.labels)))
        for b in self.lengths:
            r[:, b.rows] = b.residuals(self.reading.data, x[b.columns])
        return r

    def jacobian(self, x: ArrayLike | None = None) -> np.ndarray:
        """Jacobian of the residuals in x (N, m, n).

        With nz latent values it is (N, m - nz, n), of combinations of the lengths that do not depend on these.
        """
        x = self.unknowns.start if x is None else np.asarray(x, float)
        J, _, Bz = self.all_jacobians("length", x)
        nz = Bz.shape[2]
        return np.linalg.qr(Bz, mode="complete")[0][:, :, nz:].transpose(0, 2, 1) @ J if nz else J

    def all_jacobians(self, cost: str, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Jacobians of the closures in unknowns (N, m, n), noise (N, m, ny) and latent values (N, m, nz)."""
        N, m, read = len(self.measurements), len(self.labels), self.reading
        J, By, Bz = (np.zeros((N, m, k)) for k in (len(x), read.noise.numel(), read.latent.numel()))
        for b in self.blocks_of(cost):
            _, J[np.ix_(np.arange(N), b.rows, b.columns)], By[:, b.rows], Bz[:, b.rows] = b.evaluate_all(
                read.data, x[b.columns]
            )
        return J, By, Bz

    def identifiability(self, x: ArrayLike | None = None, sigma: float = 1.0, **more: Any) -> Identifiability:
        """How well these poses determine each unknown, before or after measuring; sigma [m] of a length's error.

        Priors count as rows. Further arguments as for gtmodel.inference.identifiability().
        """
        J = self.jacobian(x)
        P, _ = prior_rows(self.unknowns.priors, self.unknowns.names)
        rows = np.vstack([J.reshape(-1, J.shape[2]) / sigma, P])
        return identifiability(rows, self.unknowns.names, scale=self.unknowns.sizes, poses=len(J), **more)

    def on(self, measurements: Measurements) -> CalibrationProblem:
        """The same equations and unknowns with other poses, of the same signals, corrections and sessions.

        Raises ModelError where they differ.
        """
        sessions = self.measurements.session_names
        read = reading(self.closure, measurements, latent_starts(self.closure), sessions)
        if read.parameters.names != self.reading.parameters.names or len(read.data) != len(self.reading.data):
            raise ModelError(
                f"the other poses have the signals {', '.join(measurements.values)} and other corrections or sessions "
                f"than those prepared: {', '.join(self.measurements.values)}"
            )
        return replace(self, measurements=measurements, reading=replace(self.reading, data=read.data))

    def values(self, x: ArrayLike) -> dict[str, float]:
        """All parameters that the equations hold, of model and measurement, at x."""
        u = self.unknowns
        numbers = np.asarray(u.numbers(np.asarray(x, float))).reshape(-1)
        return dict(zip(u.parameters, numbers.tolist(), strict=True))


def prepare(
    model: Model | Builder | FlatModel,
    measurements: Measurements,
    choice: Choice | None = None,
    *,
    actuators: str = "q",
    latent: Sequence[str] = (),
) -> CalibrationProblem:
    """The calibration problem of a model and measured poses: closure equations, unknowns, Jacobians. Nothing is solved.

    All measured values but rates and loads count as known; `actuators`: the variable that the drives measure; `latent`:
    see closure_equations(). Raises ModelError for what does not fit the model.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T}, noise={"T": 2e-5})
    >>> problem = gt.calibrate.prepare(robot, poses)
    >>> problem.labels
    ('arm[0].rod', 'arm[1].rod', 'arm[2].rod')
    >>> len(problem.unknowns.names), float(np.abs(problem.residuals()).max()) < 1e-9  # m
    (21, True)
    """
    flat = model if isinstance(model, FlatModel) else flat_of(model)
    known = [n for n in measurements.values if not n.startswith(("der(", "load("))]
    if actuators not in known:
        raise ModelError(f"the actuators '{actuators}' are not among the measured {', '.join(known)}")
    closure = closure_equations(flat, known, latent)
    read = reading(closure, measurements, latent_starts(closure))
    everything = Parameters.of(flat, closure.touched)
    everything.extend(read.parameters)
    choice = choice or Choice()
    free = [*choice.free, *read.parameters.names] if choice.free else []
    u = unknowns(everything, replace(choice, free=free, unit=[*choice.unit, *read.unit]))
    return CalibrationProblem(closure, measurements, read, u, actuators)


def latent_starts(closure: Closure) -> dict[str, np.ndarray]:
    """Start values of latent variables, from the model. Raises ModelError where there are none."""
    starts = {}
    for name in closure.latent:
        _, indices, _ = closure.flat.lookup(name)
        values = [closure.flat.variables[i].start for i in indices]
        if any(v is None for v in values):
            raise ModelError(f"'{name}' is latent and has no start value; give it one in the model")
        starts[name] = np.array(values, float)
    return starts


def noise_covariance(problem: CalibrationProblem, cost: str, unit: bool = False) -> np.ndarray:
    """(N or 1, ny, ny) of the noise that a cost counts; unit variances where nothing but ratios is needed."""
    read, m = problem.reading, problem.measurements
    names = [n for n in problem.noisy(cost) if cost != "orthogonal" or n in m.noise]
    if cost == "orthogonal" and not names:
        raise ModelError("the cost 'orthogonal' weighs errors by their noise: give noise to the measured signals")
    lacking = [n for n in names if n not in m.noise]
    if lacking and len(names) > 1 and not unit:
        raise ModelError(f"the cost '{cost}' weighs {' and '.join(names)} against each other: give the noise of "
                         f"{' and '.join(lacking)} too")  # fmt: skip
    parts = {n: np.eye(s.stop - s.start)[None] if unit or n in lacking else m.covariance(n, s.stop - s.start)
             for n, s in read.places.items() if n in names}  # fmt: skip
    count = max([len(c) for c in parts.values()], default=1)
    S = np.zeros((count, read.noise.numel(), read.noise.numel()))
    for n, c in parts.items():
        S[:, read.places[n], read.places[n]] = c
    return S
