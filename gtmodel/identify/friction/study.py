"""The friction study: friction of the actuators and the mass they hold, from runs at constant velocity or from
published lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Literal, Unpack

import numpy as np
import tomli_w

from ...inference import FALSE_ALARM
from ...lang import Model
from ...measurements import Session
from ...results import ArgumentError, Check, Row, SolveStatus, Work, at_least, at_most, naming
from ...results.estimate import half_width
from ...results.work import WorkOptions, study_function
from .constant_velocity import Runs, concatenate, constant_velocity_log, constant_velocity_runs
from .gravity import Gravity, MassByNorm, gravity_pattern, mass_by_norm
from .levels import FrictionFit, identify_friction
from .options import (
    LABELS,
    Array,
    ConstantVelocity,
    FrictionAlarm,
    FrictionCoefficients,
    FrictionStudy,
    HeldPose,
    SyntheticRuns,
)

SLOPE_ERROR = 0.01  # relative, for synthetic logs, unless their noise explains more
DRIVES = "friction drives in one direction"
TELL = 'record more poses, which then determine the mass (gravity = "poses")'
COLUMNS = (
    "check the poses and their forces that hold a kilogram, the order of the columns and the offsets of the forces"
)


@study_function
def friction_study(
    robot: Model,
    runs: Runs | Sequence[Sequence[Session]] | SyntheticRuns,
    poses: Sequence[HeldPose],
    *,
    constant_velocity: ConstantVelocity | None = None,
    directions: Literal["separate", "symmetric"] = "separate",
    gravity: Gravity = "most_symmetric",
    accept: Sequence[FrictionAlarm] = (),
    **work_options: Unpack[WorkOptions],
) -> FrictionStudy:
    """Identify friction of the actuators and the mass they hold from logs of runs at constant velocity.

    The study finds the runs, fits lines to them, and divides their levels into gravity and friction.

    Args:
        robot: a robot whose pose follows from its tool centre point `T`, with efforts `tau`; not used if all poses have
            printed holding forces.
        runs: recordings by pose, sessions with the signals q (n, carts) [m] and force (n, carts) [N]; or constant-
            velocity runs; or options for synthetic logs.
        poses: where the tool was held.
        constant_velocity: which parts of the recordings count.
        directions: "separate" for coefficients by direction of motion, or "symmetric".
        gravity: how the mass is found, see `identify_friction`.
        accept: alarms about the runs that become notes instead of errors.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError if the logs do not fit the poses or contain no runs, and as `identify_friction` does.

    >>> known = gt.identify.SyntheticRuns(
    ...     [150.0] * 3, [140.0] * 3, [190.0] * 3, [180.0] * 3, mass=22.0, velocities=[0.2, 0.5, 1.0]
    ... )
    >>> pose = gt.identify.HeldPose(tcp=[0.5, -0.9, 0.3])
    >>> s = gt.identify.friction_study(gt.robots.gantry_tau("l1_tape"), known, [pose])
    >>> s.runs, round(s.mass), s.viscous_plus.round(-1)
    (6, 22, array([190., 190., 190.]))
    """
    work = Work(**work_options)
    work.progress("computing gravity", 0.1)
    pattern = gravity_pattern(robot, poses)
    names = [pose.name or f"pose {n}" for n, pose in enumerate(poses, 1)]
    work.progress("reading", 0.2)
    note, truth = None, runs if isinstance(runs, SyntheticRuns) else None
    if isinstance(runs, Runs):
        selected = runs
    else:
        logs = _synthetic_logs(runs, pattern, names) if isinstance(runs, SyntheticRuns) else runs
        note = next((s.trajectory.synthetic for log in logs for s in log if s.trajectory.synthetic), None)
        if work.interrupted():
            return FrictionStudy(status=SolveStatus.INTERRUPTED, message="stopped before the fit", title=work.title)
        selected = _runs_of(logs, pattern, constant_velocity or ConstantVelocity())
    with naming({"pattern": "poses", "": "runs"}):
        fit = identify_friction(selected, pattern, symmetric=directions == "symmetric", gravity=gravity, accept=accept)
    e = fit.estimate
    coefficients: dict[str, Any] = {name: getattr(fit, name) for name in LABELS}
    return FrictionStudy(
        status=SolveStatus.SOLVED,
        message=f"{len(selected.pose)} runs, {len(fit.pattern)} pose{'s' if len(fit.pattern) > 1 else ''}",
        title=work.title,
        checks={
            name: check
            for name, check in _checks(fit, selected, truth, gravity == "poses" or directions == "symmetric").items()
            if check.passed or name != "least_friction_N" or "driving_friction" not in accept
        },
        mass=fit.mass,
        mass_interval=list(e.interval("m")),
        mass_by_norm=by_norm(fit.by_norm),
        **coefficients,
        intervals={name: list(e.interval(name)) for name in e.names},
        middle=fit.middle,
        pattern=fit.pattern,
        residual=fit.residual_rms,
        runs=len(selected.pose),
        notes=fit.notes,
        estimate=e,
        synthetic=note,
        figures={"friction": partial(_figure, fit, selected, names, work.title or "friction", note)},
        files={"parameters.toml": _parameters(fit.mass, coefficients, note)},
        machine_files=("parameters.toml",),
    )


def check_widths(coefficients: FrictionCoefficients, carts: int, argument: str) -> None:
    """Raise ArgumentError unless every friction coefficient has one number for each cart."""
    for name in LABELS:
        count = len(getattr(coefficients, name))
        if count != carts:
            raise ArgumentError(f"has {count} numbers; the robot has {carts} carts", f"{argument}.{name}")


def by_norm(norms: MassByNorm) -> dict[str, Any]:
    """As the result has it."""
    return {"two": norms.two, "one": list(norms.one), "maximum": norms.maximum}


def _synthetic_logs(s: SyntheticRuns, pattern: Array, names: Sequence[str]) -> list[list[Session]]:
    check_widths(s, pattern.shape[1], "runs")
    if len(s.velocities) < 2:
        raise ArgumentError(f"expected at least two velocities; found {len(s.velocities)}", "runs.velocities")
    plus, minus, forth, back = (np.array(getattr(s, name)) for name in LABELS)

    def law(row: Array, v: Array) -> Array:
        forwards, backwards = plus + forth * v, -minus + back * v
        return s.mass * row + np.where(v > 0, forwards, np.where(v < 0, backwards, 0.0))

    return [
        [
            constant_velocity_log(
                s.velocities,
                partial(law, row),
                np.full(row.size, s.moved_mass),
                seed=s.seed + pose,  # another seed for every pose
                noise=s.noise,
                quantisation=s.quantisation,
                title=names[pose],
            )
        ]
        for pose, row in enumerate(pattern)
    ]


def _runs_of(logs: Sequence[Sequence[Session]], pattern: Array, limits: ConstantVelocity) -> Runs:
    poses, carts = pattern.shape
    if len(logs) != poses:
        raise ArgumentError(f"has recordings of {len(logs)} poses; expected {poses}, one list per pose", "runs")
    parts = []
    for pose, log in enumerate(logs):
        for session in log:
            force = session.trajectory["force"]
            width = force.reshape(len(force), -1).shape[1]
            if width != carts:
                raise ArgumentError(f"has {width} columns; the robot has {carts} carts", "runs.force")
            with naming(f"runs[{pose}]"):
                parts.append(constant_velocity_runs(
                    session, pose=pose, cutoff_Hz=limits.cutoff, acceleration=limits.steady_acceleration,
                    slow=limits.slowest, shortest=limits.shortest_run,
                ))  # fmt: skip
    if not parts:
        raise ArgumentError("is empty; expected at least one recording", "runs")
    return concatenate(parts)


def _checks(fit: FrictionFit, runs: Runs, truth: SyntheticRuns | None, mass_determined: bool) -> dict[str, Check]:
    """Friction must brake; and for synthetic logs the slopes must match the truth."""
    level = 1 - 2 * FALSE_ALARM / (4 * fit.pattern.shape[1])
    least, high = fit.against_motion(runs, level)
    advice = f"{DRIVES}; {COLUMNS if mass_determined else TELL}"
    checks = {"least_friction_N": at_least(least, min(least - high, 0.0), advice)}
    if truth is None:
        return checks
    # a plant without viscous friction has no relative error
    true = {
        f"{name}[{i}]": x for name in LABELS if name.startswith("viscous")
        for i, x in enumerate(getattr(truth, name)) if x > 0
    }  # fmt: skip
    if not true:
        return checks
    e, std = fit.estimate, dict(zip(fit.estimate.names, fit.estimate.std, strict=True))
    errors = {n: abs(e.value(n) / x - 1) for n, x in true.items()}
    chance = half_width(1 - FALSE_ALARM / len(true), e.degrees_of_freedom)
    bounds = {n: max(SLOPE_ERROR, chance * std[n] / x) for n, x in true.items()}
    # each against its own bound: the largest error may be from the noise of the flattest line
    worst = max(errors, key=lambda n: errors[n] / bounds[n])
    return checks | {"slope_error": at_most(errors[worst], bounds[worst])}


def _parameters(mass: float, coefficients: Mapping[str, Array], note: str | None) -> str:
    """parameters.toml, with the keys of a problem file."""
    names = {f.name: FrictionStudy.quantities()[f.name].name(f.name) for f in fields(FrictionCoefficients)}
    table = {names["mass"]: mass, **{names[n]: np.asarray(x).tolist() for n, x in coefficients.items()}}
    return (f"# synthetic: {note}\n" if note else "") + tomli_w.dumps(table)


def _figure(fit: FrictionFit, runs: Runs, names: Sequence[str], title: str, note: str | None) -> Any:
    from ...plot.identification import levels_figure

    gravity = fit.mass * fit.pattern
    shifted = runs.force - gravity[runs.pose] + gravity[0]
    lines = [partial(fit.force, cart=i) for i in range(fit.pattern.shape[1])]
    points = [(name, runs.velocity[runs.pose == p], shifted[runs.pose == p]) for p, name in enumerate(names)]
    return levels_figure(points, lines, gravity[0], title=f"{title} (synthetic: {note})" if note else title)


WARNING = "if friction may differ by direction, the runs do not determine the mass: every mass gives the same forces"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PublishedFriction(FrictionStudy):
    """Friction of published lines with the mass that makes it most symmetric.

    `chosen` is the published mass [kg]; `asymmetry` is the 2-norm [N] of the asymmetry that it leaves between the
    directions; `objective` is the least possible 2-norm.
    """

    chosen: float
    asymmetry: float

    @property
    def rows(self) -> list[Row]:
        """Rows of the table."""
        norms, least = self.mass_by_norm or {}, self.objective or 0.0
        return [
            Row("published mass", self.chosen, "kg"),
            Row("mass of most symmetric friction (2-norm)", self.mass, "kg"),
            Row("1-norm: minimal from", f"{norms['one'][0]:.4g} to {norms['one'][1]:.4g}", "kg"),
            Row("maximum norm", norms["maximum"], "kg"),
            Row("asymmetry, 2-norm: published", self.asymmetry, "N"),
            Row("asymmetry, 2-norm: least", least, "N"),
            Row("why they differ", f"the minimum is flat: the eye cannot see {self.asymmetry - least:.2g} N"),
            *self._coefficients(),
        ]


@study_function
def published_friction_study(
    robot: Model,
    published: FrictionCoefficients,
    pose: HeldPose,
    **work_options: Unpack[WorkOptions],
) -> PublishedFriction:
    """Find the mass of most symmetric friction from printed lines, which apply to one pose.

    Args:
        robot: as for `friction_study`.
        published: friction by cart, with the mass that was chosen for it.
        pose: where the tool was held.
        progress, max_seconds, stop: see `gtmodel.results.Work`; the study takes no noticeable time.

    Raises ArgumentError if the number of coefficients does not match the carts, and as `gravity_pattern` does.

    >>> lines = gt.identify.FrictionCoefficients(
    ...     [189.0, 262.0, 239.0], [145.0, 119.0, 177.0], [205.0] * 3, [158.0] * 3, mass=22.4
    ... )
    >>> pose = gt.identify.HeldPose(holding=[-177.0, -15.0, 191.0], holding_mass=22.4)
    >>> s = gt.identify.published_friction_study(gt.robots.gantry_tau("l1_tape"), lines, pose)
    >>> round(s.mass, 1), s.asymmetry > s.objective
    (22.7, True)
    """
    work = Work(**work_options)
    work.progress("reading", 0.2)
    pattern = gravity_pattern(robot, [pose])
    g = pattern[0]
    check_widths(published, g.size, "published")
    lines: dict[str, Any] = {name: np.array(getattr(published, name)) for name in LABELS}
    middle = published.mass * g + (lines["coulomb_plus"] - lines["coulomb_minus"]) / 2
    norms = mass_by_norm(middle, g)
    change = (norms.two - published.mass) * g
    shifted = {"coulomb_plus": lines["coulomb_plus"] - change, "coulomb_minus": lines["coulomb_minus"] + change}
    size = [float(np.linalg.norm(middle - m * g)) for m in (published.mass, norms.two)]
    return PublishedFriction(
        status=SolveStatus.SOLVED,
        message=f"most symmetric at {norms.two:.4g} kg, published {published.mass:g} kg",
        title=work.title,
        objective=size[1],
        mass=norms.two,
        mass_by_norm=by_norm(norms),
        **(lines | shifted),
        middle=middle[None],
        pattern=pattern,
        intervals={},
        notes=[WARNING],
        chosen=published.mass,
        asymmetry=size[0],
        figures={
            "friction": partial(_levels_figure, lines, published.mass, g, norms.two, work.title or "published friction")
        },
    )


def _levels_figure(lines: dict[str, np.ndarray], chosen: float, g: np.ndarray, mass: float, title: str) -> Any:
    from ...plot.identification import levels_figure

    def line(i: int, v: np.ndarray) -> np.ndarray:
        plus, minus, forth, back = (lines[name][i] for name in LABELS)
        return chosen * g[i] + np.where(v > 0, plus + forth * v, -minus + back * v)

    return levels_figure([], [partial(line, i) for i in range(g.size)], mass * g, title=title)
