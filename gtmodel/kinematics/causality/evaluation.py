"""Any causality of a robot at many points, and the orientation of its plate over a grid, with tables and pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Unpack

import numpy as np

from ...compiler.causal import CausalFunction, CausalSignal, compile_causal, flat_of
from ...geometry.rotations import matrices
from ...lang import Model, ModelError
from ...results import ArgumentError, SolveStatus, Status, Work
from ...results.agreement import AnyNumber
from ...results.refusal import naming
from ...results.work import WorkOptions, study_function
from ...workers.mapped import mapped
from ..orientation import OrientationMap, grid
from . import point_table
from .options import INCONSISTENT, NOT_COMPUTED, CausalityStudy, Orientation, PointGrid, words_of
from .point_table import Conditions

Array = np.ndarray


def csv_of(pairs: Sequence[tuple[CausalSignal, Array]], study: CausalityStudy, orientation: Orientation | None) -> str:
    """Return the CSV table of all points."""
    columns = [(point_table.columns(s), s.unit, values) for s, values in pairs]
    if orientation is not None:
        columns.append(([f"zyz[{k}]" for k in range(3)], "deg", np.degrees(study.orientation.zyz).reshape(-1, 3)))
        if orientation.rotation_vector:
            vector = np.degrees(study.orientation.rotation_vector).reshape(-1, 3)
            columns.append(([f"rotation_vector[{k}]" for k in range(3)], "deg", vector))
    return point_table.text(columns, study.words)


def figures_of(
    pairs: Sequence[tuple[CausalSignal, Array]], study: CausalityStudy, box: PointGrid | None, title: str
) -> dict[str, Any]:
    """Return the pictures by name."""
    targets = [(s.name, s.unit, values) for s, values in pairs]
    figures: dict[str, Any] = {"targets": partial(_targets_figure, targets, study.ok, title)}
    if study.orientation is not None and np.any(study.orientation.ok):
        figures["orientation_points"] = partial(_sequence_figure, study.orientation, title)
        if box is not None and min(box.counts[1:]) > 1:
            figures["orientation_layers"] = partial(_layers_figure, study.orientation, box, title)
    return figures


def _targets_figure(targets: list[tuple[str, str, Array]], ok: Array, title: str) -> Any:
    from ...plot.workspace import points_figure

    return points_figure(targets, ok, title)


def _sequence_figure(orientation: OrientationMap, title: str) -> Any:
    from ...plot.workspace import sequence_figure

    return sequence_figure(orientation.zyz, title)


def _layers_figure(orientation: OrientationMap, box: PointGrid, title: str) -> Any:
    from ...plot.workspace import layers_figure

    return layers_figure(orientation.zyz, box.half_width, box.directions, title)


Points = Mapping[str, Any] | PointGrid | Path | str | Array
CHUNK = 2000  # rows between two checks of the time limit
MOST_POINTS = 1_000_000


@study_function
def causality_study(
    model: Model,
    known: str | Sequence[str],
    targets: str | Sequence[str],
    points: Annotated[Points, AnyNumber()],
    *,
    branches: Mapping[str, int] | None = None,
    orientation: Orientation | None = None,
    **work_options: Unpack[WorkOptions],
) -> CausalityStudy:
    """Evaluate a causality at many points. A point without a solution has a status and does not affect the others.

    Args:
        model: any model; quantities have the names in the model, such as T, q, e or "arm[0].rod.tension".
        known, targets: known quantities, and quantities to compute.
        points: values (n, *shape) by name, in SI units; an array if only one quantity is known; a `PointGrid`; or the
            path of a CSV file with a column for each component, such as T[0] [m].
        branches: sign by declared branch name.
        orientation: adds angles of the plate to the table.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    After an interruption, rows that were not computed have the code -1. Raises ArgumentError.

    >>> import gtmodel as gt
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> s = gt.kinematics.causality_study(robot, "T", "q", [[1.4, -0.9, 0.3], [9.0, 9.0, 9.0]])
    >>> s.words
    ['ok', 'out_of_range']
    >>> s.targets["q"].shape
    (2, 3)
    """
    work = Work(**work_options)
    known, targets = ([x] if isinstance(x, str) else list(x) for x in (known, targets))
    function = causality_of(model, known, targets, branches, orientation)
    inputs = _inputs(points, model, known, function, branches)
    conditions = Conditions(function)
    inputs, normalised = conditions.normalised(inputs)
    outputs, codes = _evaluate(function, inputs, conditions, work)
    shape = (1, len(codes)) if not isinstance(points, PointGrid) else tuple(points.counts)
    rotations = None
    if orientation is not None:
        k = next(k for k, s in enumerate(function.outputs) if s.name == orientation.of)
        R, T = matrices(outputs[k]), np.hstack([a.reshape(len(codes), -1) for a in inputs])
        rotations = OrientationMap(T.reshape(*shape, -1), R.reshape(*shape, 3, 3), codes.reshape(shape))
    box = points if isinstance(points, PointGrid) else None
    study = _study_of(function, inputs, targets, outputs, codes, rotations, box is not None)
    pairs = [(s, values) for s, values in zip(function.outputs, outputs, strict=True) if s.name in targets]
    known_pairs = list(zip(function.inputs, inputs, strict=True))
    return study.with_(
        title=work.title,
        normalised=normalised,
        files={"points.csv": csv_of([*known_pairs, *pairs], study, orientation)},
        figures=figures_of(pairs, study, box, work.title),
    )


def causality_of(
    model: Model,
    known: Sequence[str],
    targets: Sequence[str],
    branches: Mapping[str, int] | None = None,
    orientation: Orientation | None = None,
) -> CausalFunction:
    """Return the causality, with the orientation among its targets. Raises ArgumentError.

    >>> from gtmodel.kinematics.causality import Orientation, causality_of
    >>> f = causality_of(gt.robots.f1_gantry_tau(), ["q"], ["T"], orientation=Orientation())
    >>> [signal.name for signal in f.outputs]
    ['T', 'e']
    """
    flat = flat_of(model)
    if not targets:
        raise ArgumentError("no targets; name at least one variable to compute", "targets")
    for argument, entries in (("known", known), ("targets", targets)):
        for n, name in enumerate(entries):
            try:
                flat.lookup(name)
            except ModelError as error:
                raise ArgumentError(str(error), f"{argument}[{n}]") from error
    names = list(targets)
    if orientation is not None:
        try:
            shape = flat.lookup(orientation.of)[0]
        except ModelError as error:
            raise ArgumentError(str(error), "orientation.of") from error
        if shape not in ((4,), (3, 3)):
            raise ArgumentError(
                f"'{orientation.of}' has shape {shape}; expected a quaternion (4,) or a rotation matrix (3, 3)",
                "orientation.of",
            )
        names += [] if orientation.of in names else [orientation.of]
    try:
        function = compile_causal(model, list(known), names, branches=branches or {})
    except ModelError as error:
        raise ArgumentError(str(error), "branches" if "branch" in str(error) else "known") from error
    if function.plan.uses_time:
        raise ArgumentError('the targets depend on time; use kind = "simulation"', "targets")
    return function


def _inputs(
    points: Points, model: Model, known: list[str], function: CausalFunction, branches: Mapping[str, int] | None
) -> list[Array]:
    """Return one array (rows, *shape) for each input of the function."""
    if isinstance(points, PointGrid):
        return [_box(points, model, known, function, branches)]
    if isinstance(points, (str, Path)):
        with naming("points"):
            return point_table.read(Path(points), function.inputs)
    if not isinstance(points, Mapping):
        if len(function.inputs) > 1:
            names = ", ".join(s.name for s in function.inputs)
            raise ArgumentError(f"expected values by name; the causality needs {names}", "points")
        points = {function.inputs[0].name: points}
    arrays = [_rows_of(points, signal) for signal in function.inputs]
    counts = {s.name: len(a) for s, a in zip(function.inputs, arrays, strict=True)}
    if len(set(counts.values())) > 1:
        numbers = ", ".join(f"{n} of {name}" for name, n in counts.items())
        raise ArgumentError(f"all quantities need the same number of rows; found {numbers}", "points")
    return arrays


def _rows_of(points: Mapping[str, Any], signal: CausalSignal) -> Array:
    if signal.name not in points:
        raise ArgumentError(f"'{signal.name}' is missing; found {', '.join(points) or 'none'}", "points")
    values = np.asarray(points[signal.name], dtype=float)
    if values.ndim != 1 + len(signal.shape) or values.shape[1:] != signal.shape or not len(values):
        expected = ", ".join(["n", *map(str, signal.shape)])
        raise ArgumentError(f"'{signal.name}' must have shape ({expected}); found {values.shape}", "points")
    return values


def _box(
    box: PointGrid, model: Model, known: list[str], function: CausalFunction, branches: Mapping[str, int] | None
) -> Array:
    shape = flat_of(model).lookup(known[0])[0]
    if len(known) != 1 or shape != (3,):
        raise ArgumentError("a grid needs one known vector of 3; give the points as a CSV file", "points.center")
    missing = [s.name for s in function.inputs if s.name != known[0]]
    if missing:
        raise ArgumentError(
            f"the targets also need {', '.join(missing)}, not in the grid; give the points as a CSV file", "targets"
        )
    if math.prod(box.counts) > MOST_POINTS:
        raise ArgumentError(f"{math.prod(box.counts)} points; at most {MOST_POINTS} are allowed", "points.counts")
    try:
        points = grid(_center(box, model, known, branches), box.half_width, box.counts, box.directions)
    except ArgumentError:
        raise
    except ValueError as error:
        raise ArgumentError(str(error), "points.directions") from error
    return points.reshape(-1, 3)


def _center(box: PointGrid, model: Model, known: list[str], branches: Mapping[str, int] | None) -> Array:
    if (box.center is None) == (box.center_where is None):
        keys = "neither" if box.center is None else "both"
        raise ArgumentError(f"give either center or center_where; found {keys}", "points.center")
    if box.center is not None:
        return np.array(box.center)
    values, argument = box.center_where or {}, "points.center_where"
    try:
        f = compile_causal(model, list(values), known, branches=branches or {})
    except ModelError as error:
        raise ArgumentError(str(error), argument) from error
    center, status = f(*[_sized(values, s, argument) for s in f.inputs])
    if status != Status.OK:
        raise ArgumentError(f"{known[0]} cannot be computed from these values: {status.message}", argument)
    return np.asarray(center)


def _sized(values: Mapping[str, Sequence[float]], signal: CausalSignal, argument: str) -> Array:
    value = np.asarray(values.get(signal.name, []), dtype=float)
    if value.shape != signal.shape:
        raise ArgumentError(f"'{signal.name}' needs {signal.size} numbers; found {value.size}", argument)
    return value


def _evaluate(
    function: CausalFunction, inputs: list[Array], conditions: Conditions, work: Work
) -> tuple[list[Array], Array]:
    """Return the function's outputs, and the code of each row."""
    rows = len(inputs[0])
    targets = [np.full((rows, *s.shape), np.nan) for s in function.outputs]
    codes = np.full(rows, -1)
    parts = [slice(first, min(first + CHUNK, rows)) for first in range(0, rows, CHUNK)]
    rows_of_parts = mapped(partial(_rows, function), ([a[part] for a in inputs] for part in parts))
    for part in parts:
        if work.interrupted():
            break
        work.progress("points", part.start / rows, {"row": float(part.start)})
        *outputs, status = next(rows_of_parts)
        for target, values in zip(targets, outputs, strict=True):
            target[part] = values
        broken = conditions.broken([a[part] for a in inputs]) & (status != Status.OK) & (status != Status.NOT_FINITE)
        codes[part] = np.where(broken, -2, status)
    return targets, codes


def _rows(function: CausalFunction, inputs: list[Array]) -> tuple[Array, ...]:
    return function(*inputs)


def _study_of(
    function: CausalFunction,
    inputs: list[Array],
    names: list[str],
    outputs: list[Array],
    codes: Array,
    rotations: OrientationMap | None,
    layered: bool,
) -> CausalityStudy:
    statuses = words_of(codes)
    words = [s.name.lower() for s in Status] + [INCONSISTENT, NOT_COMPUTED]
    counts = {word: n for word in words if (n := statuses.count(word)) or word == "ok"}
    status, message = SolveStatus.SOLVED, f"{counts['ok']} of {len(codes)} points have a solution"
    failures = ", ".join(f"{n} {word.replace('_', ' ')}" for word, n in counts.items() if word != "ok")
    if failures:
        reason = _inconsistent(function, inputs, codes)
        message += f"; {failures}" + (f" ({reason})" if reason else "")
    if NOT_COMPUTED in counts:
        status = SolveStatus.INTERRUPTED
    elif counts["ok"] == 0:
        status = SolveStatus.INFEASIBLE
    targets = {s.name: a for s, a in zip(function.outputs, outputs, strict=True) if s.name in names}
    solved = {name: values[codes == Status.OK] for name, values in targets.items()}
    layers = rotations if layered else None
    return CausalityStudy(
        status=status,
        message=message,
        known={s.name: a for s, a in zip(function.inputs, inputs, strict=True)},
        targets=targets,
        codes=codes,
        orientation=rotations,
        units={s.name: s.unit for s in (*function.inputs, *function.outputs)},
        count=len(codes),
        statuses=counts,
        ranges={
            name: {end: f(a, axis=0) if len(a) else None for end, f in (("min", np.min), ("max", np.max))}
            for name, a in solved.items()
        },
        zyz_range=None if rotations is None else rotations.range(),
        zyz_layer_range=None if layers is None else layers.layer_range(),
        layer_difference=None if layers is None else layers.layer_difference(),
        zyz_singular_rows=None if rotations is None else int(np.sum(rotations.singular)),
    )


def _inconsistent(function: CausalFunction, inputs: list[Array], codes: Array) -> str:
    """Return the reason for the first row with inconsistent known values; "" without such rows."""
    rows = np.flatnonzero(codes == -2)
    if not rows.size:
        return ""
    sentence = function.diagnose(*(a[rows[0]] for a in inputs))
    return f"row {rows[0]}: {sentence.partition(': ')[2] or sentence}"
