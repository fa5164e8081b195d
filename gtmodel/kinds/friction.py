"""Kind "friction": friction of the actuators and the mass they hold, from runs at constant velocity."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import tomli_w

from gtmodel.identify import (
    FrictionError,
    FrictionFit,
    Runs,
    constant_velocity_log,
    identify_friction,
    joined,
    mass_by_norm,
    steady_runs,
)
from gtmodel.identify.steady import CUTOFF_HZ, SHORTEST, STEADY
from gtmodel.inference import FALSE_ALARM
from gtmodel.lang import ModelError
from gtmodel.measurements import Corrections, Session
from gtmodel.problem_files.base import Check, Context, InputError, Outcome, Row, at_least, at_most
from gtmodel.results import SolveStatus, Status, TrajectoryError

from .friction_keys import Coefficients, Pose, Schema, Synthetic

NAME = "friction"

VALUES = {
    "mass_kg": "plate and half the links, as the carts' forces hold them",
    "mass_interval_kg": "95 % interval; of the choice where the runs leave the mass open",
    "mass_by_norm_kg": "mass of least asymmetry by norm: two, one (interval), maximum",
    "coulomb_plus_N": "Coulomb friction forwards, by cart",
    "coulomb_minus_N": "Coulomb friction backwards, by cart",
    "viscous_plus_kg_s": "viscous friction forwards, by cart",
    "viscous_minus_kg_s": "viscous friction backwards, by cart",
    "intervals": "95 % intervals by name: m, coulomb_plus[0], ...",
    "middle_N": "level between the two directions, by pose and cart: gravity and asymmetric friction together",
    "pattern_N_kg": "force of each cart that holds one kilogram, by pose",
    "residual_N": "rms of the fitted lines, by cart",
    "runs": "number of runs at constant velocity",
    "undetermined": "what the runs cannot tell, in words",
    "synthetic": "seed and noise of made-up logs; null for measured ones",
}

SLOPE_ERROR = 0.01  # of synthetic logs, or what their noise explains
DRIVES = "friction drives in one direction"
TELL = 'record more poses and let them tell the mass (gravity = "poses")'
COLUMNS = (
    "check the poses and their forces that hold a kilogram, the order of the columns and the offsets of the forces"
)
Weighed = Callable[[list[float]], np.ndarray]
WARNING = "the runs do not tell the mass"


def solve(problem: Schema, context: Context) -> Outcome:
    """Find the runs, fit the lines, share the levels between gravity and friction."""
    pattern = _pattern(problem, context)
    context.progress("reading", 0.2)
    if problem.printed is not None:
        return _of_printed(problem, problem.printed, pattern)
    sessions = _sessions(problem, context, pattern)
    if context.interrupted():
        return Outcome(status=SolveStatus.INTERRUPTED, message="stopped before the fit")
    runs = _runs(problem, sessions)
    try:
        fit = identify_friction(runs, pattern, symmetric=problem.directions == "symmetric", gravity=problem.gravity)
    except FrictionError as error:
        raise InputError(str(error), "pose") from error
    note = next((s.trajectory.synthetic for _, s in sessions if s.trajectory.synthetic), None)
    return _outcome(problem, fit, runs, note)


def explain(problem: Schema, context: Context) -> str:
    """The gravity pattern by pose, and what can be told from it."""
    pattern = _pattern(problem, context)
    lines = [f"{problem.title or 'friction'}: {pattern.shape[1]} carts in {len(pattern)} poses"]
    for pose, row in zip(problem.pose, pattern, strict=True):
        lines.append(f"{pose.name or 'pose'}: forces that hold one kilogram {_list(row)} N/kg")
    lines.append("tau = m pattern + fc+ + fv+ v forwards, m pattern - fc- + fv- v backwards (eqs. (6.8), (6.9))")
    return "\n".join(lines)


def _pattern(problem: Schema, context: Context) -> np.ndarray:
    """(poses, carts) force that holds one kilogram [N/kg]."""
    given = [k for k in ("log", "synthetic", "printed") if getattr(problem, k) is not None]
    if len(given) != 1:
        raise InputError(
            f"found {', '.join(f'[{k}]' for k in given) or 'none of them'}; "
            "expected one of [log], [synthetic], [printed]",
            given[-1] if given else "log",
        )
    weigh = cache(lambda: _by_geometry(problem, context))
    rows = [_holding(pose, f"pose[{n}]", weigh) for n, pose in enumerate(problem.pose)]
    if len({len(row) for row in rows}) > 1:
        raise InputError(f"the poses have {', '.join(str(len(r)) for r in rows)} carts; expected one number", "pose")
    return np.array(rows)


def _holding(pose: Pose, key: str, weigh: Callable[[], Weighed]) -> np.ndarray:
    if (pose.tcp_m is None) == (pose.holding_N is None):
        raise InputError("expected either tcp_m or holding_N with holding_mass_kg", key)
    if pose.holding_N is not None:
        if pose.holding_mass_kg is None:
            raise InputError("is missing; expected the mass that holding_N holds, in kg", f"{key}.holding_mass_kg")
        return np.array(pose.holding_N) / pose.holding_mass_kg
    try:
        return weigh()(pose.tcp_m or [])
    except InputError:
        raise
    except ValueError as error:
        raise InputError(str(error), f"{key}.tcp_m") from error


def _by_geometry(problem: Schema, context: Context) -> Weighed:
    """Tool centre point [m] -> forces that hold one kilogram more [N]; friction is in both cases and falls out."""
    payloads = [(problem.payload_kg or 0.0) + extra for extra in (0.0, 1.0)]
    models = [problem.model_copy(update={"payload_kg": p}).model(context) for p in payloads]
    try:
        inverse = [model.causal(known="T", targets="tau") for model in models]
    except ModelError as error:
        said = f"a tool centre point alone does not place it, as it does with three links ({error})"
        raise InputError(said, "robot") from error

    def weighed(tcp: list[float]) -> np.ndarray:
        width = inverse[0].inputs[0].size
        if len(tcp) != width:
            raise ValueError(f"expected a list of {width} numbers in m")
        at_rest = [np.zeros(width)] * (len(inverse[0].inputs) - 1)
        forces = []
        for function in inverse:
            tau, status = function(tcp, *at_rest)
            if status is not Status.OK:
                raise ValueError(f"{tcp} m cannot be reached: {status.sentence}")
            forces.append(np.asarray(tau))
        return forces[1] - forces[0]

    return weighed


def _sessions(problem: Schema, context: Context, pattern: np.ndarray) -> list[tuple[int, Session]]:
    """Recordings with the pose that each belongs to."""
    if problem.synthetic is not None:
        return [(p, _made(problem, problem.synthetic, row, p)) for p, row in enumerate(pattern)]
    log = problem.log
    assert log is not None
    keys = {"position_m": log.position_m, "force_N": log.force_N}
    for name, signal in keys.items():
        for what in ("scale", "offset", "delay_s"):
            if getattr(signal, what) == "estimate":
                raise InputError(
                    "constant-velocity runs do not tell it apart from gravity and friction; give a number",
                    f"log.{name}.{what}",
                )
    signals = {"q": log.position_m.signal("log.position_m"), "force": log.force_N.signal("log.force_N")}
    found = []
    for n, pose in enumerate(problem.pose):
        raw = log.read(pose.files, signals, context, f"pose[{n}].files")
        try:
            found += [(n, session) for session in Corrections(signals, raw).apply()]
        except TrajectoryError as error:
            raise InputError(str(error), "log") from error
        width = found[-1][1].trajectory["force"].reshape(len(found[-1][1].trajectory), -1).shape[1]
        if width != pattern.shape[1]:
            raise InputError(f"has {width} columns; the robot has {pattern.shape[1]} carts", "log.force_N.column")
    return found


def _made(problem: Schema, s: Synthetic, row: np.ndarray, pose: int) -> Session:
    tables = {k: np.array(getattr(s, k)) for k in _COEFFICIENTS}
    _check_widths(tables, row.size, "synthetic")
    plus, minus = tables["coulomb_plus_N"], tables["coulomb_minus_N"]

    def law(v: np.ndarray) -> np.ndarray:
        forwards, backwards = plus + tables["viscous_plus_kg_s"] * v, -minus + tables["viscous_minus_kg_s"] * v
        return s.mass_kg * row + np.where(v > 0, forwards, np.where(v < 0, backwards, 0.0))

    return constant_velocity_log(
        s.velocities_m_s,
        law,
        np.full(row.size, s.moved_mass_kg),
        # a seed of its own for every pose
        seed=s.seed + pose,
        noise=s.noise_N,
        quantisation=s.quantisation_m,
        title=problem.pose[pose].name,
    )


def _runs(problem: Schema, sessions: list[tuple[int, Session]]) -> Runs:
    log = problem.log
    found = []
    for pose, session in sessions:
        try:
            found.append(
                steady_runs(
                    session,
                    pose=pose,
                    cutoff_Hz=log.cutoff_Hz if log else CUTOFF_HZ,
                    steady=log.steady_acceleration_m_s2 if log else STEADY,
                    slow=log.slowest_m_s if log else 0.0,
                    shortest=log.shortest_run_s if log else SHORTEST,
                )
            )
        except TrajectoryError as error:
            raise InputError(str(error), f"pose[{pose}]") from error
    return joined(found)


_COEFFICIENTS = ("coulomb_plus_N", "coulomb_minus_N", "viscous_plus_kg_s", "viscous_minus_kg_s")


def _check_widths(tables: dict[str, np.ndarray], carts: int, key: str) -> None:
    for name, table in tables.items():
        if table.size != carts:
            raise InputError(f"has {table.size} numbers; the robot has {carts} carts", f"{key}.{name}")


def _of_printed(problem: Schema, printed: Coefficients, pattern: np.ndarray) -> Outcome:
    """Published lines: their levels, and the mass anew."""
    tables = {k: np.array(getattr(printed, k)) for k in _COEFFICIENTS}
    _check_widths(tables, pattern.shape[1], "printed")
    if len(pattern) > 1:
        raise InputError("published lines belong to one pose; leave the others out", "pose")
    g = pattern[0]
    skew = (tables["coulomb_plus_N"] - tables["coulomb_minus_N"]) / 2
    middle = printed.mass_kg * g + skew
    norms = mass_by_norm(middle, g)
    change = (norms.two - printed.mass_kg) * g
    values: dict[str, Any] = dict.fromkeys(VALUES)
    values |= {
        "mass_kg": norms.two,
        "mass_by_norm_kg": _norms(norms),
        **{k: tables[k] for k in _COEFFICIENTS},
        "coulomb_plus_N": tables["coulomb_plus_N"] - change,
        "coulomb_minus_N": tables["coulomb_minus_N"] + change,
        "middle_N": middle[None],
        "pattern_N_kg": pattern,
        "intervals": {},
        "undetermined": [WARNING + " while friction may differ by direction; every mass gives the same forces"],
    }
    size = [float(np.linalg.norm(middle - m * g)) for m in (printed.mass_kg, norms.two)]
    rows = [
        Row("published mass", printed.mass_kg, "kg"),
        Row("mass of most symmetric friction (2-norm)", norms.two, "kg"),
        Row("1-norm: least anywhere from", f"{norms.one[0]:.4g} to {norms.one[1]:.4g}", "kg"),
        Row("maximum norm", norms.maximum, "kg"),
        Row("asymmetry, 2-norm: published", size[0], "N"),
        Row("asymmetry, 2-norm: least", size[1], "N"),
        Row("why they differ", f"the minimum is flat: {size[0] - size[1]:.2g} N are not seen by eye"),
        *_coefficient_rows(values),
    ]
    figures = {} if problem.printed is None else {"friction": lambda: _printed_figure(problem, printed, g, norms.two)}
    return Outcome(
        status=SolveStatus.SOLVED,
        message=f"most symmetric at {norms.two:.4g} kg, published {printed.mass_kg:g} kg",
        objective=size[1],
        values=values,
        rows=rows,
        figures=figures,
    )


def _outcome(problem: Schema, fit: FrictionFit, runs: Runs, note: str | None) -> Outcome:
    e = fit.estimate
    values = {
        "mass_kg": fit.mass,
        "mass_interval_kg": list(e.interval("m")),
        "mass_by_norm_kg": _norms(fit.by_norm),
        "coulomb_plus_N": fit.coulomb_plus,
        "coulomb_minus_N": fit.coulomb_minus,
        "viscous_plus_kg_s": fit.viscous_plus,
        "viscous_minus_kg_s": fit.viscous_minus,
        "intervals": {name: list(e.interval(name)) for name in e.names},
        "middle_N": fit.middle,
        "pattern_N_kg": fit.pattern,
        "residual_N": fit.residual_rms,
        "runs": len(runs.pose),
        "undetermined": list(fit.undetermined),
        "synthetic": note,
    }
    low, high = e.interval("m")
    rows = [
        Row("mass held", fit.mass, "kg"),
        Row("95 % interval", f"{low:.4g} .. {high:.4g}", "kg"),
        Row("1-norm: least anywhere from", f"{fit.by_norm.one[0]:.4g} to {fit.by_norm.one[1]:.4g}", "kg"),
        Row("maximum norm", fit.by_norm.maximum, "kg"),
        *_coefficient_rows(values),
        Row("residual of the lines", _list(fit.residual_rms), "N"),
        Row("runs at constant velocity", len(runs.pose)),
        *(Row("not told" if k else "told", text) for k, text in enumerate(fit.undetermined, len(fit.undetermined) > 1)),
    ]
    if note:
        rows.append(Row("SYNTHETIC", note))
    friction = {k: np.asarray(values[k]).tolist() for k in _COEFFICIENTS}
    comment = f"# synthetic: {note}\n" if note else ""
    return Outcome(
        status=SolveStatus.SOLVED,
        message=f"{len(runs.pose)} runs, {len(fit.pattern)} poses",
        checks=_checks(problem, fit, runs),
        values=values,
        rows=rows,
        figures={"friction": lambda: _figure(problem, fit, runs, note)},
        files={"parameters.toml": comment + tomli_w.dumps({"mass_kg": fit.mass, **friction})},
        machine_files=("parameters.toml",),
    )


def _checks(problem: Schema, fit: FrictionFit, runs: Runs) -> dict[str, Check]:
    """Friction brakes; and against the truth of synthetic logs, which measured ones have not."""
    level = 1 - 2 * FALSE_ALARM / (4 * fit.pattern.shape[1])
    least, high = fit.against_motion(runs, level)
    told = problem.gravity == "poses" or problem.directions == "symmetric"
    advice = f"{DRIVES}; {COLUMNS if told else TELL}"
    checks = {"least_friction_N": at_least(least, min(least - high, 0.0), advice)}
    if problem.synthetic is None:
        return checks
    # a plant without viscous friction has no relative error
    true = {
        f"viscous_{way}[{i}]": x
        for way in ("plus", "minus")
        for i, x in enumerate(getattr(problem.synthetic, f"viscous_{way}_kg_s"))
        if x > 0
    }
    if not true:
        return checks
    from scipy import stats  # here: it alone takes as long to import as all of gtmodel

    e, std = fit.estimate, dict(zip(fit.estimate.names, fit.estimate.std, strict=True))
    errors = {n: abs(e.value(n) / x - 1) for n, x in true.items()}
    chance = float(stats.t.isf(FALSE_ALARM / 2 / len(true), e.freedom))
    bounds = {n: max(SLOPE_ERROR, chance * std[n] / x) for n, x in true.items()}
    # each against its own bound: the largest error may be the noise of the flattest line
    worst = max(errors, key=lambda n: errors[n] / bounds[n])
    return checks | {"slope_error": at_most(errors[worst], bounds[worst])}


def _coefficient_rows(values: dict[str, Any]) -> list[Row]:
    labels = ("Coulomb friction forwards", "Coulomb friction backwards", "viscous forwards", "viscous backwards")
    units = ("N", "N", "kg/s", "kg/s")
    return [Row(label, _list(values[k]), u) for label, k, u in zip(labels, _COEFFICIENTS, units, strict=True)]


def _norms(norms: Any) -> dict[str, Any]:
    return {"two": norms.two, "one": list(norms.one), "maximum": norms.maximum}


def _list(numbers: Any) -> str:
    return ", ".join(f"{x:.4g}" for x in np.ravel(numbers))


def _figure(problem: Schema, fit: FrictionFit, runs: Runs, note: str | None) -> Any:
    from gtmodel.plot.friction import friction_figure

    title = problem.title or "friction"
    names = [pose.name or f"pose {n}" for n, pose in enumerate(problem.pose, 1)]
    gravity = fit.mass * fit.pattern
    shifted = runs.force - gravity[runs.pose] + gravity[0]
    lines = [lambda v, i=i: fit.force(v, i) for i in range(fit.pattern.shape[1])]
    points = [(name, runs.velocity[runs.pose == p], shifted[runs.pose == p]) for p, name in enumerate(names)]
    return friction_figure(points, lines, gravity[0], title=f"{title} (synthetic: {note})" if note else title)


def _printed_figure(problem: Schema, printed: Coefficients, g: np.ndarray, mass: float) -> Any:
    from gtmodel.plot.friction import friction_figure

    def line(i: int) -> Any:
        held = printed.mass_kg * g[i]
        plus, minus = printed.coulomb_plus_N[i], printed.coulomb_minus_N[i]
        forth, back = printed.viscous_plus_kg_s[i], printed.viscous_minus_kg_s[i]
        return lambda v: held + np.where(v > 0, plus + forth * v, -minus + back * v)

    lines = [line(i) for i in range(g.size)]
    return friction_figure([], lines, mass * g, title=problem.title or "published friction")


__all__ = ["NAME", "VALUES", "Schema", "explain", "solve"]
