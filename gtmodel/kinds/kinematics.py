"""Kind "kinematics": any causality of a robot on many points, and the orientation of its plate over a grid."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from gtmodel.compiler.causal import CausalFunction, Signal, compile_causal, flat_of
from gtmodel.kinematics.orientation import OrientationMap, grid
from gtmodel.kinematics.rotations import matrices
from gtmodel.lang import Model, ModelError
from gtmodel.problem_files import point_table
from gtmodel.problem_files.base import Context, InputError, Outcome, Row, Section
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.problem_files.robots import file_of
from gtmodel.results import SolveStatus, Status

from .known_values import Conditions

NAME = "kinematics"

VALUES = {
    "rows": "number of points",
    "statuses": "number of rows by status: ok, out_of_range, not_converged (no solution where Newton looks for one, as "
    "beyond a six-link robot's reach), wrong_branch (Newton's solution lies on another than a declared branch), "
    "singular, not_finite, inconsistent_known_values (such as a quaternion that is not of length 1), not_computed",
    "ranges": "least and greatest value of each target over the rows that are ok, in SI units",
    "zyz_range_deg": "largest minus smallest ZYZ angle over the rows that are ok; null without [orientation]",
    "zyz_layer_range_deg": "the same for each layer of a grid; null without one",
    "layer_difference": "how far the layers are from one pattern, as a fraction of zyz_range_deg; null without a grid",
    "zyz_singular_rows": "number of rows where ZYZ is singular, beta = 0 or pi; null without [orientation]",
}

CHUNK = 2000  # rows between two looks at the clock
MOST_POINTS = 1_000_000
NOT_COMPUTED = "not_computed"
INCONSISTENT = "inconsistent_known_values"
_OWN = {-1: NOT_COMPUTED, -2: INCONSISTENT}  # codes beside those of Status

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Count = Annotated[int, Field(ge=1)]


class Grid(Section):
    """A box of points for the one known vector of three, in SI units."""

    center: Three | None = Field(default=None, description="middle of the box")
    center_where: dict[str, list[float]] | None = Field(
        default=None, description="the middle is where these have their values, such as {q = [0.0, 0.0, 0.0]}"
    )
    half_width: Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=3, max_length=3)] = Field(
        description="from the middle to the last point along each direction"
    )
    counts: Annotated[list[Count], Field(min_length=3, max_length=3)] = Field(
        description="points along each direction; the first one counts layers"
    )
    directions: Annotated[list[Three], Field(min_length=3, max_length=3)] = Field(
        default=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        description="one row each, made unit vectors; the first one goes from layer to layer",
    )


class Orientation(Section):
    """Adds the orientation to the table: ZYZ angles in degrees, and on request the turn from the middle point.

    Keep the joints among the targets: an arm that has no say in the orientation still limits what can be reached.
    """

    of: str = Field(default="e", description="the model's quaternion, scalar first, or rotation matrix")
    rotation_vector: bool = Field(
        default=False, description="add the rotation vector from the middle point, in degrees; nowhere singular"
    )


class Schema(RobotProblem):
    """A causality on many points. Quantities go by the model's own names, such as T, q, e or "arm[0].rod.tension"."""

    known: Annotated[list[str], Field(min_length=1)] = Field(description="what is given at each point")
    targets: Annotated[list[str], Field(min_length=1)] = Field(description="what is computed there")
    branches: dict[str, Literal[-1, 1]] = Field(default={}, description="sign by declared branch name")
    points: str = Field(
        default="", description="CSV file with a column for each component, such as T[0] [m]; from the problem's folder"
    )
    grid: Grid | None = Field(default=None, description="points of a box, instead of a file")
    orientation: Orientation | None = Field(default=None, description="orientation of the plate in degrees")


@dataclass(frozen=True, eq=False)
class _Table:
    """All rows: inputs and targets as the function orders them, and the status word of each row."""

    function: CausalFunction
    inputs: list[np.ndarray]
    targets: list[np.ndarray]
    codes: np.ndarray  # of Status, or of _OWN
    normalised: int = 0  # rows with a quaternion brought to length 1

    @property
    def ok(self) -> np.ndarray:
        return self.codes == Status.OK

    @property
    def words(self) -> list[str]:
        return [_OWN[c] if c in _OWN else Status(c).name.lower() for c in self.codes.tolist()]

    @property
    def inconsistent(self) -> str:
        """Why the first row with inconsistent known values has no solution; "" where there is none."""
        rows = np.flatnonzero(self.codes == -2)
        if not rows.size:
            return ""
        sentence = self.function.diagnose(*(a[rows[0]] for a in self.inputs))
        return f"row {rows[0]}: {sentence.partition(': ')[2] or sentence}"


def solve(problem: Schema, context: Context) -> Outcome:
    """Evaluate all points; those without a solution have a status and harm no other."""
    if context.start is not None:
        raise InputError("--start: kinematics is computed point by point and starts from no earlier result")
    model = problem.model(context)
    function = _function(problem, model)
    inputs = _points(problem, context, model, function)
    conditions = Conditions(function)
    inputs, normalised = conditions.normalised(inputs)
    table = _evaluate(function, inputs, conditions, context, normalised)
    orientation = _orientation(problem, table)
    return _outcome(problem, table, orientation)


def explain(problem: Schema, context: Context) -> str:
    """The certificate of the causality."""
    model = problem.model(context)
    function = _function(problem, model)
    return f"{problem.title or 'kinematics'}\n{function.explain()}"


def _function(problem: Schema, model: Model) -> CausalFunction:
    if bool(problem.points) == (problem.grid is not None):
        found = "both" if problem.points else "neither"
        raise InputError(f"give either points = a CSV file or a [grid]; found {found}", "points")
    flat = flat_of(model)
    targets = list(problem.targets)
    names = {"known": problem.known, "targets": targets}
    if problem.orientation is not None:
        names["orientation.of"] = [problem.orientation.of]
    for key, entries in names.items():
        for n, name in enumerate(entries):
            try:
                shape = flat.lookup(name)[0]
            except ModelError as error:
                raise InputError(str(error), key if key == "orientation.of" else f"{key}[{n}]") from error
            if key == "orientation.of" and shape not in ((4,), (3, 3)):
                raise InputError(
                    f"'{name}' has shape {shape}; expected a quaternion (4,) or a rotation matrix (3, 3)", key
                )
    if problem.orientation is not None and problem.orientation.of not in targets:
        targets.append(problem.orientation.of)
    try:
        function = compile_causal(model, problem.known, targets, branches=problem.branches)
    except ModelError as error:
        raise InputError(str(error), "branches" if "branch" in str(error) else "known") from error
    if function.plan.uses_time:
        raise InputError('the targets depend on time; use kind = "simulation"', "targets")
    return function


def _points(problem: Schema, context: Context, model: Model, function: CausalFunction) -> list[np.ndarray]:
    """One array per input of the function, (rows, *shape)."""
    if problem.grid is None:
        path = file_of(problem.points, context)
        if path is None:
            raise InputError(f"there is no file '{problem.points}' in {context.folder} or here", "points")
        context.take("points", path)
        try:
            return point_table.read(path, function.inputs)
        except InputError as error:
            raise error.within("", "points") from error
    box = problem.grid
    shape = flat_of(model).lookup(problem.known[0])[0]
    if len(problem.known) != 1 or shape != (3,):
        raise InputError("a grid is for one known vector of three; give the points as a CSV file", "grid")
    more = [s.name for s in function.inputs if s.name != problem.known[0]]
    if more:
        raise InputError(
            f"the targets need {', '.join(more)} too, which a grid does not give; give the points as a CSV file",
            "targets",
        )
    if math.prod(box.counts) > MOST_POINTS:
        raise InputError(f"{math.prod(box.counts)} points are more than {MOST_POINTS}; take fewer", "grid.counts")
    center = _center(problem, box, model)
    try:
        points = grid(center, box.half_width, box.counts, box.directions)
    except ValueError as error:
        raise InputError(str(error), "grid") from error
    return [points.reshape(-1, 3)]


def _center(problem: Schema, box: Grid, model: Model) -> np.ndarray:
    if (box.center is None) == (box.center_where is None):
        found = "neither" if box.center is None else "both"
        raise InputError(f"give either center or center_where; found {found}", "grid.center")
    if box.center is not None:
        return np.array(box.center)
    given: Mapping[str, list[float]] = box.center_where or {}
    key = "grid.center_where"
    try:
        f = compile_causal(model, list(given), problem.known, branches=problem.branches)
        center, status = f(*[_sized(given, s, key) for s in f.inputs])
    except ModelError as error:
        raise InputError(str(error), key) from error
    if status != Status.OK:
        raise InputError(f"{problem.known[0]} cannot be computed there: {status.sentence}", key)
    return np.asarray(center)


def _sized(given: Mapping[str, list[float]], signal: Signal, key: str) -> np.ndarray:
    value = np.asarray(given.get(signal.name, []), dtype=float)
    if value.shape != signal.shape:
        raise InputError(f"'{signal.name}' takes {signal.size} numbers; found {value.size}", key)
    return value


def _evaluate(
    function: CausalFunction, inputs: list[np.ndarray], conditions: Conditions, context: Context, normalised: int
) -> _Table:
    rows = len(inputs[0])
    targets = [np.full((rows, *s.shape), np.nan) for s in function.outputs]
    codes = np.full(rows, -1)
    for first in range(0, rows, CHUNK):
        if context.interrupted():
            break
        context.progress("points", first / rows, {"row": float(first)})
        part = slice(first, min(first + CHUNK, rows))
        *found, status = function(*[a[part] for a in inputs])
        for target, values in zip(targets, found, strict=True):
            target[part] = values
        broken = conditions.broken([a[part] for a in inputs]) & (status != Status.OK) & (status != Status.NOT_FINITE)
        codes[part] = np.where(broken, -2, status)
    return _Table(function, inputs, targets, codes, normalised)


def _orientation(problem: Schema, table: _Table) -> OrientationMap | None:
    if problem.orientation is None:
        return None
    place = next(k for k, s in enumerate(table.function.outputs) if s.name == problem.orientation.of)
    shape = (1, len(table.codes)) if problem.grid is None else tuple(problem.grid.counts)
    points = np.hstack([a.reshape(len(table.codes), -1) for a in table.inputs])
    R = matrices(table.targets[place])
    return OrientationMap(points.reshape(*shape, -1), R.reshape(*shape, 3, 3), table.codes.reshape(shape))


def _outcome(problem: Schema, table: _Table, orientation: OrientationMap | None) -> Outcome:
    title = problem.title or f"kinematics of {problem.robot}"
    rows, ok = len(table.codes), int(np.sum(table.ok))
    words = [s.name.lower() for s in Status] + [INCONSISTENT, NOT_COMPUTED]
    counts = {word: n for word in words if (n := table.words.count(word)) or word == "ok"}
    status, message = SolveStatus.SOLVED, f"{ok} of {rows} points have a solution"
    failed = ", ".join(f"{n} {word.replace('_', ' ')}" for word, n in counts.items() if word != "ok")
    if failed:
        message += f"; {failed}" + (f" ({table.inconsistent})" if table.inconsistent else "")
    if NOT_COMPUTED in counts:
        status = SolveStatus.INTERRUPTED
    elif ok == 0:
        status = SolveStatus.INFEASIBLE
    values = _values(problem, table, orientation, counts)
    return Outcome(
        status=status,
        message=message,
        values=values,
        rows=_rows(table, values, orientation),
        files={"points.csv": _csv(problem, table, orientation)},
        figures=_figures(problem, table, orientation, title),
    )


def _values(
    problem: Schema, table: _Table, orientation: OrientationMap | None, counts: dict[str, int]
) -> dict[str, Any]:
    ranges = {}
    for signal, values in zip(table.function.outputs, table.targets, strict=True):
        if signal.name in problem.targets:
            found = values[table.ok]
            least, greatest = (f(found, axis=0) if len(found) else None for f in (np.min, np.max))
            ranges[signal.name] = {"min": least, "max": greatest}
    layered = orientation is not None and problem.grid is not None
    return {
        "rows": len(table.codes),
        "statuses": counts,
        "ranges": ranges,
        "zyz_range_deg": None if orientation is None else np.degrees(orientation.range()),
        "zyz_layer_range_deg": np.degrees(orientation.layer_range()) if layered and orientation else None,
        "layer_difference": orientation.layer_difference() if layered and orientation else None,
        "zyz_singular_rows": None if orientation is None else int(np.sum(orientation.singular)),
    }


def _rows(table: _Table, values: dict[str, Any], orientation: OrientationMap | None) -> list[Row]:
    rows = [Row("points", values["rows"])]
    rows += [Row(word.replace("_", " "), n) for word, n in values["statuses"].items()]
    if table.normalised:
        rows.append(Row("quaternions brought to length 1", table.normalised))
    units = {s.name: s.unit for s in table.function.outputs}
    for name, ends in values["ranges"].items():
        if ends["min"] is not None and np.ndim(ends["min"]) < 2:
            rows += [Row(f"least {name}", ends["min"], units[name]), Row(f"greatest {name}", ends["max"], units[name])]
    if orientation is not None:
        # no number, no row: no point is ok, or no place is ok in all layers
        if np.all(np.isfinite(values["zyz_range_deg"])):
            rows.append(Row("range of ZYZ angles", values["zyz_range_deg"], "deg"))
        if values["layer_difference"] is not None and np.all(np.isfinite(values["layer_difference"])):
            rows.append(Row("layers differ by", 100 * values["layer_difference"], "%"))
        if values["zyz_singular_rows"]:
            rows.append(Row("rows where ZYZ is singular", values["zyz_singular_rows"]))
    return rows


def _csv(problem: Schema, table: _Table, orientation: OrientationMap | None) -> str:
    pairs = [*zip(table.function.inputs, table.inputs, strict=True)]
    pairs += [(s, v) for s, v in zip(table.function.outputs, table.targets, strict=True) if s.name in problem.targets]
    columns = [(point_table.columns(s), s.unit, values) for s, values in pairs]
    if orientation is not None and problem.orientation is not None:
        columns.append(([f"zyz[{k}]" for k in range(3)], "deg", np.degrees(orientation.zyz).reshape(-1, 3)))
        if problem.orientation.rotation_vector:
            vector = np.degrees(orientation.rotation_vector).reshape(-1, 3)
            columns.append(([f"rotation_vector[{k}]" for k in range(3)], "deg", vector))
    return point_table.text(columns, table.words)


def _figures(problem: Schema, table: _Table, orientation: OrientationMap | None, title: str) -> dict[str, Any]:
    from gtmodel.plot import orientation as pictures
    from gtmodel.plot.points import points_figure

    shown = [
        (s.name, s.unit, values)
        for s, values in zip(table.function.outputs, table.targets, strict=True)
        if s.name in problem.targets
    ]
    figures: dict[str, Any] = {"targets": partial(points_figure, shown, table.ok, title)}
    if orientation is not None and np.any(orientation.ok):
        figures["orientation_points"] = partial(pictures.sequence_figure, orientation, title)
        if problem.grid is not None and min(problem.grid.counts[1:]) > 1:
            figures["orientation_layers"] = partial(
                pictures.layers_figure, orientation, problem.grid.half_width, problem.grid.directions, title
            )
    return figures
