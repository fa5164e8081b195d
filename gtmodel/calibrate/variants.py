"""Free, tied and fixed parameters of a fit: variants of the thesis by name, and guideways through measured points of
the carts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..inference import Prior
from ..lang import Model, ModelError
from ..measurements import signal_table
from ..results import ArgumentError
from ..robots.links import family_of
from ..robots.three_link import on_measured_points
from .devices import seen_with_quaternion
from .measured.options import CartPoints
from .measured.poses import MeasuredPoses, SplitPoses
from .measurements import Measurements
from .options import COST_WORDS, Choice, Cost, Fit, Known
from .problem import CalibrationProblem, prepare
from .unknowns import Unknowns

QUATERNIONS = ("u1_2", "u1_3", "u2_3")
SERIAL = "serial"
FAMILIES = {"ideal": "three_link", "modified": "three_link", "six_link": "six_link", "f1_unit": "f1", "f1_raw": "f1"}
WORDS = {"three_link": "three links", "six_link": "six links", "f1": "an F1"}
NAMING = ("fixed", "tied", "unit_quaternions", "priors", "sizes", "free")  # options that contain parameter names


Poses = MeasuredPoses | Measurements


def choice_of(
    fit: Fit, model: Model, known: Sequence[str] = (), on_points: Sequence[str] = (), independent: Sequence[str] = ()
) -> Choice:
    """The choice without priors.

    `known`: parameters that no fit changes; `on_points`: names of guideways through measured points, of which the frame
    is free; `independent`: free parameters of an arm if `free` is not given. Raises ArgumentError for a variant of
    another robot family.
    """
    tied, unit = dict(fit.tied), list(fit.unit_quaternions)
    if fit.variant is not None and fit.variant != SERIAL:
        required, family = FAMILIES[fit.variant], family_of(model)
        if required != family:
            raise ArgumentError(
                f"'{fit.variant}' is for robots with {WORDS[required]}; this has {WORDS.get(family, 'other parts')}",
                "fit.variant",
            )
        if fit.variant == "ideal":
            tied = {"v[1]": "v[0]", "v[2]": "v[0]"} | tied
        if fit.variant == "f1_unit":
            unit += [n for n in QUATERNIONS if n not in unit]
    unit += [f"{g}.u" for g in on_points]
    fixed = [*fit.fixed, *known, *(f"{g}.{n}" for g in on_points for n in ("at", "points"))]
    return Choice(
        fit.free if fit.free is not None or not independent else independent, fixed, tied, unit, (), fit.sizes
    )


def by_dh_numbers(fit: Fit, model: Model) -> Model:
    """Convert an arm of a URDF to Denavit-Hartenberg parameters if the variant needs them; other robots unchanged."""
    if fit.variant != SERIAL or not hasattr(model, "structure"):
        return model
    from ..robots import SerialArm, as_dh  # here: most calibrations are not of arms

    return as_dh(model) if isinstance(model, SerialArm) else model


def with_measured_orientation(model: Model, poses: Poses | Sequence[Poses]) -> Model:
    """Add the measured quaternion e to a model whose orientation is a matrix R; other models unchanged."""
    declared = type(model)._declared
    several = [poses] if isinstance(poses, MeasuredPoses | Measurements) else poses
    sets = [entry if isinstance(entry, Measurements) else entry.measurements for entry in several]
    measured = any(pose.orientation == "e" for m in sets for pose in m.poses) or any("e" in m.values for m in sets)
    return seen_with_quaternion(model) if measured and "R" in declared and "e" not in declared else model


def arm_choice(fit: Fit, model: Model, data: Sequence[SplitPoses]) -> tuple[list[str], list[str]]:
    """Parameters of an arm that the measured positions or poses determine, and sentences on the others.

    Empty for other variants. Raises ArgumentError for other robots.
    """
    if fit.variant != SERIAL:
        return [], []
    from ..robots import SerialArm, independent_geometry  # here: most calibrations are not of arms

    if not isinstance(model, SerialArm):
        raise ArgumentError("'serial' is for serial arms with Denavit-Hartenberg parameters", "fit.variant")
    try:
        base = any(d.pose.device for d in data)
        turns = any(d.pose.orientation is not None and d.pose.orientation in d.all.values for d in data)
        tool = [name for name in ("tool_xyz", "tool_rpy") if name not in fit.fixed]
        return independent_geometry(
            model, base=base, tool="tool_xyz" in tool, turns=turns, tool_turn="tool_rpy" in tool
        )
    except ModelError as error:
        raise ArgumentError(str(error), "fit.variant") from error


def prepared(
    fit: Fit, model: Model, data: Sequence[SplitPoses], carts: CartPoints | None = None, on_points: Sequence[str] = ()
) -> CalibrationProblem:
    """The calibration problem of the fitted poses of all measurements.

    Raises ArgumentError with the option that has an invalid name."""
    m, actuators = [d.fitted for d in data], data[0].actuators
    try:
        several = len(data) > 1
        known = [f"{n} of {d.name}" if several else n for d in data for n in d.source.known]
        independent, reasons = arm_choice(fit, model, data)
        choice = choice_of(fit, model, known, on_points, independent)
        first = prepare(model, m, choice, actuators=actuators)
        if reasons and fit.free is None:
            first = replace(first, unknowns=replace(first.unknowns, notes=(*first.unknowns.notes, *reasons)))
        turn = None if carts is None else carts.turn_std
        turns = {f"{g}.u": Known(std=turn) for g in on_points} if turn is not None else {}
        if not fit.priors and not turns:
            return first
        priors = _priors({**turns, **fit.priors}, first.unknowns)
        return prepare(model, m, replace(choice, priors=priors), actuators=actuators)
    except (ModelError, ValueError) as error:
        if isinstance(error, ArgumentError) and error.argument:
            raise
        raise ArgumentError(str(error), _naming(fit, str(error))) from error


def too_few(p: CalibrationProblem) -> list[str]:
    """Sentences on parts of the robot with fewer equations than unknowns."""
    if p.implicit or p.beside:
        return []  # identifiability reports on all measurements together
    N, sentences = len(p.measurements), []
    for b in p.lengths:
        names = [p.unknowns.names[k] for k in b.columns]
        priors = sum(prior.name in names for prior in p.unknowns.priors)
        if N * len(b.rows) + priors < len(names):
            least = -(-(len(names) - priors) // len(b.rows))
            sentences.append(
                f"{N} poses give {N * len(b.rows)} equations of {', '.join(p.labels[k] for k in b.rows)} for "
                f"{len(names)} unknowns ({names[0]} to {names[-1]}); measure at least {least} poses, better several "
                "times as many, or fix parameters"
            )
    return sentences


def cost_of(fit: Fit, p: CalibrationProblem) -> Cost:
    """The cost of a fit. Errors of measured signals replace length errors if lengths are unknown, if there are several
    measurements, or if an arm's position and orientation both have a stated noise."""
    cost = COST_WORDS[fit.cost]
    orientation = any(n.startswith("orientation_at_1_m") for n in p.labels) and p.weighed
    if cost not in ("length", "squared") or not (orientation or p.beside or any(part.implicit for part in p.parts)):
        return cost
    return "orthogonal" if all(part.usual_cost == "orthogonal" for part in p.parts) else "forward"


def _priors(keys: Mapping[str, Known], u: Unknowns) -> list[Prior]:
    """Priors for the unknowns of each name, by default at their start values. Raises ArgumentError."""
    priors: dict[str, Prior] = {}
    for name, prior in keys.items():
        begins = (name[:-1] + ",", f"{name} turned") if name.endswith("]") else (f"{name}[", f"{name} turned")
        hits = [k for k, n in enumerate(u.names) if n == name or n.startswith(begins)]
        if not hits:
            raise ArgumentError(f"names '{name}', which is not free; free are {', '.join(u.names)}", "fit.priors")
        if prior.value is not None and len(hits) > 1:
            sentence = f"found one value for the {len(hits)} unknowns of '{name}'; leave it out, or name one unknown"
            raise ArgumentError(sentence, f"fit.priors.{name}")
        for k in hits:
            value = float(u.start[k]) if prior.value is None else prior.value
            priors[u.names[k]] = Prior(u.names[k], value, prior.std)
    return list(priors.values())


def _naming(fit: Fit, sentence: str) -> str:
    for option in NAMING:
        if any(f"'{name}" in sentence for name in getattr(fit, option) or ()):
            return f"fit.{option}"
    return "poses"


UNIT_LENGTH = 1e-3  # tolerance of the quaternion's length; printed digits stay below it


def on_cart_points(robot: Model, carts: CartPoints | None) -> tuple[Model, list[str]]:
    """Return the robot and the names of its guideways through measured points. Raises ArgumentError."""
    if carts is None:
        return robot, []
    u = np.array(carts.quaternion, float)
    length = float(np.linalg.norm(u))
    if abs(length - 1) > UNIT_LENGTH:
        raise ArgumentError(f"has the length {length:.4g}; a rotation needs length 1", "carts.quaternion")
    if family_of(robot) not in ("three_link", "six_link"):
        raise ArgumentError("applies to Gantry-Tau robots with three or six links", "carts")
    try:
        result = on_measured_points(robot, carts.at, {arm - 1: rows for arm, rows in carts.points.items()}, u / length)
    except ModelError as error:
        raise ArgumentError(str(error), "carts.points") from error
    return result.robot, result.guideways


def read_cart_points(path: Path, arms: Sequence[int], unit: str = "mm") -> tuple[np.ndarray, dict[int, np.ndarray]]:
    r"""Read cart points: increasing coordinates (n,) [m], and by arm (n, 3) [m], from CSV columns q, P1, P2, P3.

    Raises ArgumentError with the line of the error.

    >>> from pathlib import Path
    >>> _ = Path("carts.csv").write_text("q,P1[0],P1[1],P1[2]\n0,0.1,0,900\n500,500.1,0.05,900\n")
    >>> at, points = gt.calibrate.read_cart_points(Path("carts.csv"), arms=[1])  # a file in mm
    >>> at, points[1].shape
    (array([0. , 0.5]), (2, 3))
    """
    columns = {"q": ("q", unit)} | {f"P{arm}": (f"P{arm}", unit) for arm in sorted(set(arms))}
    table = signal_table.read(path, columns)
    order = np.argsort(table.values["q"][:, 0], kind="stable")
    q = table.values["q"][order, 0]
    same = np.flatnonzero(np.diff(q) <= 0)
    if len(q) < 2 or same.size:
        where = f"line {table.lines[order[same[0] + 1]]} repeats a coordinate" if same.size else f"found {len(q)}"
        raise ArgumentError(f"a guideway needs at least two points at different coordinates; {where}")
    return q, {arm: table.values[f"P{arm}"][order] for arm in sorted(set(arms))}
