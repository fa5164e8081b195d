"""The calibration problem: equations of the model, data, unknowns and functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from .._pickling import Portable
from ..compiler.causal import flat_of
from ..compiler.flat import FlatModel
from ..compiler.rows import map_columns
from ..inference import Identifiability, identifiability
from ..inference.weighting import prior_rows
from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.source import ModelError
from .blocks import Block, blocks
from .closure import Closure, closed_start, closure_equations
from .implicit import Adjustment, Begin
from .measurements import CONDITIONS, Measurements, SignalName
from .options import Choice
from .reading import Reading, reading, variables_of
from .unknowns import SIZE, Parameters, Unknowns, unknowns

LOOSE = 1e3  # times the smallest noise: signals with more noise hardly determine the pose


# units with a usual expected error: 1 mm, its angle at a distance of 1 m, and that of a compliance
SIZED = ("m", "rad", "m/N")
FACTOR = 10.0
LOOKED_AT = 40  # number of poses


@dataclass(frozen=True, eq=False)
class CalibrationProblem(Portable):
    """A prepared calibration: closure equations of the model with data, unknowns and functions; nothing is solved.

    `beside`: other measurements of the same robot, with the same unknowns. `closure`: of the first pose of a row.
    Costs: "squared" closure residuals (Dressler 2012, eq. (5.1)); "length" errors |d| - L; or the errors of measured
    signals that close every pose: of `actuators` alone ("inverse"), of all others ("forward"), or of all that have
    noise ("orthogonal").
    """

    closure: Closure
    measurements: Measurements
    reading: Reading
    unknowns: Unknowns
    actuators: str
    beside: tuple[CalibrationProblem, ...] = ()
    made: dict[str, tuple[Block, ...]] = field(default_factory=dict, repr=False)
    starts: dict[tuple[int, ...], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict, repr=False)

    def blocks_of(self, cost: str) -> tuple[Block, ...]:
        """Blocks of a cost, built once for all poses; rows that share a noise in this cost are in one block."""
        if cost not in self.made:
            places, counted = self.reading.places, () if cost in ("squared", "length") else self.noisy(cost)
            joined = [k for n in counted for k in range(places[n].start, places[n].stop)]
            read, u = self.reading, self.unknowns
            (inside,) = u.substituted([read.equations(squared=cost == "squared")])
            self.made[cost] = blocks(inside, read.d, read.noise, read.latent, u.x, joined)
        return self.made[cost]

    @property
    def latent(self) -> tuple[str, ...]:
        """Latent (unmeasured) variables."""
        return tuple(dict.fromkeys(n for s in self.reading.stances for n in s.closure.latent))

    @property
    def parts(self) -> tuple[CalibrationProblem, ...]:
        """One problem per measurements, this one first."""
        return (self, *self.beside)

    @property
    def implicit(self) -> bool:
        """Whether lengths are unknown because of latent variables, so that only errors of measured signals exist."""
        return self.reading.latent.numel() > 0

    @property
    def squared(self) -> tuple[Block, ...]:
        """Blocks of the squared closures."""
        return self.blocks_of("squared")

    @property
    def lengths(self) -> tuple[Block, ...]:
        """Blocks of the length errors."""
        return self.blocks_of("length")

    @property
    def orthogonal(self) -> tuple[Block, ...]:
        """Blocks for the noise of all signals."""
        return self.blocks_of("orthogonal")

    def noisy(self, cost: str) -> list[str]:
        """Signals whose errors enter a cost."""
        every = list(self.reading.places)
        return every if cost == "orthogonal" else [n for n in every if self.of_actuators(n) == (cost == "inverse")]

    def of_actuators(self, signal: str) -> bool:
        """Whether a signal belongs to the actuators, at any pose of a row."""
        return signal.partition("@")[0] == self.actuators

    @property
    def judged(self) -> list[str]:
        """Measured signals other than the actuators; their errors are those of the robot."""
        return self.noisy("forward")

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the closure residuals: links in the model's order, then components, points and distances."""
        read = self.reading
        links = [SignalName("", pose=k).at(n) for k, s in enumerate(read.stances, 1) for n in s.closure.labels]
        return (*links, *read.derived_labels)

    @property
    def error_labels(self) -> tuple[str, ...]:
        """Names of the columns of a calibration's residuals: links, or measured signals if there are latent values."""
        if not self.implicit:
            return self.labels
        sizes = {n: s.stop - s.start for n, s in self.reading.places.items()}
        return tuple(
            name for n in self.judged for name in ([n] if sizes[n] == 1 else [f"{n}[{k}]" for k in range(sizes[n])])
        )

    def residuals(self, x: ArrayLike | None = None) -> np.ndarray:
        """Return length errors (N, m) [m] in the order of `labels`, at x (default: the start values).

        Raises ModelError if latent variables leave the lengths unknown.
        """
        if self.implicit:
            raise ModelError(
                f"{', '.join(self.latent)} is latent, so that the lengths are unknown; use the errors of the measured "
                "signals, positioning_errors()"
            )
        x = self.unknowns.start if x is None else np.asarray(x, float)
        r = np.empty((len(self.measurements), len(self.labels)))
        for b in self.lengths:
            r[:, b.rows] = b.residuals(self.reading.data, x[b.columns])
        return r

    def jacobian(self, x: ArrayLike | None = None) -> np.ndarray:
        """Return the Jacobian of the residuals in x (N, m, n).

        With nz latent values it is (N, m - nz, n), for combinations of the lengths that do not depend on them.
        """
        x = self.unknowns.start if x is None else np.asarray(x, float)
        J, _, Bz = self.all_jacobians("length", x)
        nz = Bz.shape[2]
        return np.linalg.qr(Bz, mode="complete")[0][:, :, nz:].transpose(0, 2, 1) @ J if nz else J

    def all_jacobians(self, cost: str, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return Jacobians of the closures in unknowns (N, m, n), noise (N, m, ny) and latent values (N, m, nz)."""
        N, m, read = len(self.measurements), len(self.labels), self.reading
        J, By, Bz = (np.zeros((N, m, k)) for k in (len(x), read.noise.numel(), read.latent.numel()))
        for b in self.blocks_of(cost):
            every = np.arange(N)
            _, J[np.ix_(every, b.rows, b.columns)], By[:, b.rows], Bz[np.ix_(every, b.rows, b.hidden)] = b.evaluate_all(
                read.data, x[b.columns], *self.begin(b)
            )
        return J, By, Bz

    def identifiability(self, x: ArrayLike | None = None, sigma: float = 1.0, **more: Any) -> Identifiability:
        """Return how well these poses determine each unknown, before or after measuring.

        sigma [m]: error of a length. Priors count as rows. Further arguments as in gtmodel.inference.identifiability().
        """
        P, _ = prior_rows(self.unknowns.priors, self.unknowns.names)
        if self.implicit or self.beside:
            measured = [p.measured_rows(x) for p in self.parts]
            poses = sum(len(p.measurements) for p in self.parts)
            rows = np.vstack([*measured, P])
            return identifiability(rows, self.unknowns.names, scale=self.unknowns.sizes, poses=poses, **more)
        J = self.jacobian(x)
        rows = np.vstack([J.reshape(-1, J.shape[2]) / sigma, P])
        return identifiability(rows, self.unknowns.names, scale=self.unknowns.sizes, poses=len(J), **more)

    def measured_rows(self, x: ArrayLike | None = None, cost: str = "") -> np.ndarray:
        """Return the Jacobian (rows, n) of the errors of measured signals, in units of their noise, at x.

        Poses that do not close have no rows."""
        x = self.unknowns.start if x is None else np.asarray(x, float)
        S = noise_covariance(self, cost or self.usual_cost, unit=not self.weighed)
        rows = [np.zeros((0, len(x)))]
        for b in self.blocks_of(cost or self.usual_cost):
            a = self.adjustment(b, S)
            _, J = a.per_pose(x[b.columns])
            full = np.zeros((int(a.closed.sum()) * J.shape[1], len(x)))
            full[:, b.columns] = J[a.closed].reshape(-1, J.shape[2])
            rows.append(full)
        return np.vstack(rows)

    def adjustment(self, block: Block, covariance: np.ndarray) -> Adjustment:
        """The errors of measured signals in one block, for a noise covariance."""
        return Adjustment(block, self.reading.data, covariance, self.begin(block, covariance))

    def begin(self, block: Block, covariance: np.ndarray | None = None) -> Begin:
        """Start values of a block: changes of the data (N, ny) and latent values (N, nz) of the nominal robot.

        Only signals whose noise is very large compared with the others' are changed."""
        wide: tuple[int, ...] = ()
        if covariance is not None:
            sizes = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2).max(axis=0))
            wide = tuple(np.flatnonzero(sizes > LOOSE * np.min(sizes, initial=np.inf, where=sizes > 0)).tolist())
        if not wide and not len(block.hidden):
            return None, None
        y, z = self._closed(wide)
        return y if wide else None, z[:, block.hidden]

    def _closed(self, wide: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Changes (N, ny) of the `wide` signals and all latent values (N, nz) at the start values of the unknowns."""
        if wide not in self.starts:
            read, u = self.reading, self.unknowns
            (inside,) = u.substituted([read.equations(squared=True)[: len(self.labels) - len(read.derived_labels)]])
            exact = [k for k in range(read.noise.numel()) if k not in wide]
            quiet = [ca.DM.zeros(len(exact), 1), ca.DM(u.start)]
            (equations,) = ca.substitute([inside], [read.noise[exact], u.x], quiet)
            free = ca.vertcat(read.noise[list(wide)], read.latent)
            closed = closed_start(equations, read.d, free, read.data)
            y = np.zeros((len(closed), read.noise.numel()))
            y[:, list(wide)] = closed[:, : len(wide)]
            self.starts[wide] = y, closed[:, len(wide) :]
        return self.starts[wide]

    @property
    def equations(self) -> int:
        """Number of equations per pose that remain for the unknowns."""
        return len(self.labels) - self.reading.latent.numel()

    @property
    def usual_cost(self) -> Literal["forward", "orthogonal"]:
        """Errors of all signals if all noise is stated; otherwise those of the pose, with exact actuators."""
        return "orthogonal" if all(n in self.measurements.noise for n in self.reading.places) else "forward"

    @property
    def weighed(self) -> bool:
        """Whether the noise of all judged signals is stated."""
        return all(n in self.measurements.noise for n in self.judged)

    def on(self, measurements: Measurements) -> CalibrationProblem:
        """Return the problem with other poses, of the same signals, corrections and sessions.

        Raises ModelError if these differ.
        """
        sessions = self.measurements.session_names
        closures = [s.closure for s in self.reading.stances]
        starts = [latent_starts(c) for c in closures]
        read = reading(closures, measurements, starts, sessions, self.reading.ending)
        if read.parameters.names != self.reading.parameters.names or len(read.data) != len(self.reading.data):
            raise ModelError(
                f"the other poses have signals {', '.join(measurements.values)}; signals, corrections and "
                f"sessions must be those of the problem: {', '.join(self.measurements.values)}"
            )
        updated = replace(self.reading, data=read.data)
        return replace(self, measurements=measurements, reading=updated, beside=(), starts={})

    def values(self, x: ArrayLike) -> dict[str, float]:
        """Return all parameters in the equations, of model and measurement, at x."""
        u = self.unknowns
        (numbers,) = map_columns(u.numbers, [np.reshape(np.asarray(x, float), (-1, 1))])
        return dict(zip(u.parameters, numbers[:, 0].tolist(), strict=True))


def prepare(
    model: Model | Builder | FlatModel,
    measurements: Measurements | Sequence[Measurements],
    choice: Choice | None = None,
    *,
    actuators: str = "q",
    latent: Sequence[str] = (),
    values: Mapping[str, float] | None = None,
) -> CalibrationProblem:
    """Prepare the calibration of a model on measured poses: closure equations, unknowns, Jacobians. Nothing is solved.

    All measured values except rates and loads count as known. `actuators`: the variable that the drives measure.
    `latent`: see closure_equations(). Several measurements of one robot share its parameters; their frames, scales,
    offsets and points are separate, with " of NAME" in their names. `values`: parameters by name, instead of the
    model's and of the measurement's start values. Raises ModelError if an argument does not fit the model.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T}, noise={"T": 2e-5})
    >>> problem = gt.calibrate.prepare(robot, poses)
    >>> problem.labels
    ('arm[0].rod', 'arm[1].rod', 'arm[2].rod')
    >>> len(problem.unknowns.names), float(np.abs(problem.residuals()).max()) < 1e-9  # m
    (21, True)
    >>> heights = gt.calibrate.Measurements({"q": q, "T[2]": T[:, 2]}, noise={"q": 1e-5, "T[2]": 2e-5})
    >>> gt.calibrate.prepare(robot, heights).latent
    ('T',)
    """
    flat = model if isinstance(model, FlatModel) else flat_of(model)
    several = [measurements] if isinstance(measurements, Measurements) else list(measurements)
    if not several:
        raise ModelError("there are no measurements; give at least one")
    ready: list[tuple[list[Closure], Reading, Measurements]] = []
    for k, m in enumerate(several, 1):
        poses = variables_of(flat, m, latent)
        signals = [n for n in m.values if not n.startswith(CONDITIONS)]
        if actuators not in poses[0][0]:
            raise ModelError(f"the actuators '{actuators}' are not among the measured {', '.join(signals)}")
        closures = [closure_equations(flat, known, hidden) for known, hidden in poses]
        ending = f" of {m.name or k}" if len(several) > 1 else ""
        ready.append((closures, reading(closures, m, [latent_starts(c) for c in closures], (), ending), m))
    touched = sorted({t for closures, _, _ in ready for c in closures for t in c.touched})
    everything = Parameters.of(flat, touched)
    for _, read, _ in ready:
        everything.extend(read.parameters)
    for name, value in (values or {}).items():
        if name in everything.names:
            everything.values[everything.names.index(name)] = float(value)
    choice = choice or Choice()
    of_measurement = [n for _, read, _ in ready for n in read.parameters.names]
    free = None if choice.free is None else [*choice.free, *of_measurement]
    unit = [n for _, read, _ in ready for n in read.unit]
    u = unknowns(everything, replace(choice, free=free, unit=[*choice.unit, *unit]))
    first, *others = [CalibrationProblem(c[0], m, read, u, actuators) for c, read, m in ready]
    sized = _with_sizes(first)
    parts = [replace(p, unknowns=sized) for p in (first, *others)]
    return replace(parts[0], beside=tuple(parts[1:]))


def _with_sizes(problem: CalibrationProblem) -> Unknowns:
    """Sizes from the data for unknowns whose unit has no usual size, such as offsets in motor revolutions.

    The size moves the lengths of a pose by a millimetre; it is used if it differs from the usual one by more than a
    factor of ten. Parameters of the model without a unit are excluded: they are directions."""
    u, m = problem.unknowns, problem.measurements
    geometric = {problem.closure.flat.parameters[t].name for t in problem.closure.touched}
    known = [s in SIZED or (s in ("", "1") and n in geometric) for n, s in zip(u.names, u.units, strict=True)]
    guessed = [k for k, n in enumerate(u.names) if not known[k] and n not in u.stated]
    if not guessed or problem.implicit:
        return u
    rows = np.unique(np.linspace(0, len(m) - 1, min(LOOKED_AT, len(m))).round().astype(int))
    try:
        J = problem.on(m.part(rows)).jacobian()
    except ModelError:
        return u
    effects = np.sqrt(np.sum(J[:, :, guessed] ** 2, axis=(0, 1)) / len(rows))
    sizes = u.sizes.copy()
    for k, by_unit in zip(guessed, effects, strict=True):
        if np.isfinite(by_unit) and by_unit > 0 and not 1 / FACTOR <= by_unit <= FACTOR:
            sizes[k] = SIZE / by_unit
    return replace(u, sizes=sizes)


def latent_starts(closure: Closure) -> dict[str, np.ndarray]:
    """Return start values of latent variables from the model. Raises ModelError if there are none."""
    starts = {}
    for name in closure.latent:
        _, indices, _ = closure.flat.lookup(name)
        values = [closure.flat.variables[i].start for i in indices]
        if any(v is None for v in values):
            raise ModelError(f"'{name}' is latent and has no start value; set one in the model")
        starts[name] = np.array(values, float)
    return starts


def noise_covariance(problem: CalibrationProblem, cost: str, unit: bool = False) -> np.ndarray:
    """Covariance (N or 1, ny, ny) of the noise in a cost; unit variances if only ratios matter."""
    read, m = problem.reading, problem.measurements
    names = [n for n in problem.noisy(cost) if cost != "orthogonal" or n in m.noise]
    if cost == "orthogonal" and not names:
        raise ModelError("the cost 'orthogonal' weights errors by their noise: state the noise of measured signals")
    lacking = [n for n in names if n not in m.noise]
    if lacking and len(names) > 1 and not unit:
        raise ModelError(f"the cost '{cost}' weights {' and '.join(names)} against each other: state the noise of "
                         f"{' and '.join(lacking)} too")  # fmt: skip
    parts = {n: np.eye(s.stop - s.start)[None] if unit or n in lacking else m.covariance(n, s.stop - s.start)
             for n, s in read.places.items() if n in names}  # fmt: skip
    count = max([len(c) for c in parts.values()], default=1)
    S = np.zeros((count, read.noise.numel(), read.noise.numel()))
    for n, c in parts.items():
        S[:, read.places[n], read.places[n]] = c
    return S
