"""Report of a calibration: values by name, checks, the table of its poses and its pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import view
from ...compiler.causal import flat_of
from ...inference import Identifiability
from ...inference.covariance import listed
from ...inference.residuals import draw_residuals
from ...lang import Model
from ...results import Check, at_most
from ...results.table import csv_text
from ..prediction import Prediction
from ..variants import SERIAL
from .far_poses import MANY, columns_of, largest, named
from .findings import CalibrationFindings, verdict, written
from .movement import OPEN, drifted

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def text(findings: CalibrationFindings) -> str:
    """poses.csv: line of the file, fitted or held out, measured position [m], errors of position [mm] and lengths [mm];
    empty if a pose cannot be closed."""
    if not findings.data.whole:
        return _partial(findings)
    name = findings.position
    T = findings.data.T
    held = findings.data.held_out
    labels = findings.problem.labels
    errors, lengths = np.full(T.shape, np.nan), np.full((len(T), len(labels)), np.nan)
    for part, prediction in _parts(findings):
        if name in prediction:
            errors[part] = prediction[name].errors
    lengths[~held] = findings.calibration.residuals
    if findings.held_out_residuals is not None:
        lengths[held] = findings.held_out_residuals
    places = {f"{name}[{k}] [m]": x for k, x in enumerate(T.T)}
    heads = [*(f"error {axis} [mm]" for axis in "xyz"[: T.shape[1]]), "error [mm]", *(f"{x} [mm]" for x in labels)]
    numbers = np.column_stack([1e3 * errors, 1e3 * np.linalg.norm(errors, axis=1), 1e3 * lengths])
    return csv_text(
        {"line": findings.data.lines, "part": _words(findings), **places} | dict(zip(heads, numbers.T, strict=True)),
        dict.fromkeys(places, ".7f") | dict.fromkeys(heads, ".5f"),
        [f"synthetic: {findings.data.synthetic}"] if findings.data.synthetic else (),
    )


def _parts(findings: CalibrationFindings) -> list[tuple[np.ndarray, dict[str, Prediction]]]:
    """Rows and their predictions; with cross-validation only those of the refits."""
    fitted = [] if findings.left_out is not None else [(~findings.data.held_out, findings.fitted)]
    return [*fitted, (findings.unseen, findings.held_out)]


def _words(findings: CalibrationFindings) -> np.ndarray:
    if findings.left_out is not None:
        return np.full(len(findings.data.lines), "left out in turn")
    return np.where(findings.data.held_out, "held out", "fitted")


def _partial(findings: CalibrationFindings) -> str:
    """poses.csv of partial measurements: line, fitted or held out, and for each signal the reading and its error."""
    data = findings.data
    values, formats = {}, {}
    for name in findings.problem.judged:
        rows = np.asarray(data.all.values[name])
        heads = [name] if rows.shape[1] == 1 else [f"{name}[{k}]" for k in range(rows.shape[1])]
        values |= dict(zip(heads, rows.T, strict=True))
        formats |= dict.fromkeys(heads, ".7f")
        errors: np.ndarray | None = None
        for part, prediction in _parts(findings):
            if name in prediction:
                part_errors = prediction[name].errors
                errors = np.full((len(data.lines), part_errors.shape[1]), np.nan) if errors is None else errors
                errors[part] = part_errors
        if errors is not None:
            heads = [f"error of {n}" for n in ([name] if errors.shape[1] == 1 else heads[: errors.shape[1]])]
            values |= dict(zip(heads, errors.T, strict=True))
            formats |= dict.fromkeys(heads, ".8f")
    return csv_text(
        {"line": data.lines, "part": _words(findings), **values}, formats,
        ["SI units", *([f"synthetic: {data.synthetic}"] if data.synthetic else [])],
    )  # fmt: skip


def pictures(findings: CalibrationFindings, title: str) -> Mapping[str, Callable[[], Figure]]:
    """File name -> drawing, for which there are results."""
    c, headline, held = findings.calibration, findings.headline[0], findings.headline[2]
    name = findings.position
    what = "held-out poses" if held else "fitted poses"
    figures: dict[str, Callable[[], Figure]] = {}
    parts = findings.beside or not findings.data.whole
    if parts:
        of_parts = {title: sizes for part in findings.parts for title, sizes in _of_part(part).items()}
        if of_parts:
            figures["pose_errors"] = lambda: _plot().pose_errors_figure(
                of_parts, f"{title}: errors by pose", None, "error [mm]"
            )
    elif name in headline:
        data = findings.data
        sizes, before = np.full(len(data.lines), np.nan), np.full(len(data.lines), np.nan)
        for part, prediction in _parts(findings):
            sizes[part] = prediction[name].sizes if name in prediction else np.nan
        held_out = data.held_out if findings.left_out is None and data.held_out.any() else None
        errors = {"calibrated": sizes}
        if name in findings.a_priori:
            before[findings.unseen if data.held_out.any() else ~data.held_out] = findings.a_priori[name].sizes
            errors["before calibration"] = before
        lines = data.lines if data.all.places is not None and len(set(data.lines)) == len(data.lines) else None
        worst = int(np.nanargmax(sizes))
        whose = "fitted and held-out poses" if held_out is not None else what
        figures["pose_errors"] = lambda: _plot().pose_errors_figure(
            errors, f"{title}: errors of {whose}", worst, lines=lines, held_out=held_out
        )
        if data.T.shape[1] > 1:
            figures["workspace_errors"] = lambda: _plot().workspace_errors_figure(
                data.T, sizes, f"{title}: errors by place, {whose}", held_out=held_out
            )
    if not parts:
        figures["residuals"] = lambda: _residuals(c.residuals, findings.problem.labels, title)
    estimate, after = findings.confidence.estimate, findings.after
    if estimate is not None and after is not None:
        units = [u or "1" for u in estimate.units]
        figures["deviations"] = lambda: _plot().deviations_figure(
            estimate.names, estimate.std, units, f"{title}: standard deviations"
        )
        figures["correlation"] = lambda: _plot().correlation_figure(
            after.names, after.correlation, f"{title}: correlation"
        )
    return figures


def scenes(findings: CalibrationFindings, robot: Model, title: str) -> Mapping[str, Callable[[], view.RobotScene]]:
    """The errors of the poses in space; none of planar robots, and of measurements that are judged by parts."""
    name, data = findings.position, findings.data
    if findings.beside or not data.whole or name not in findings.headline[0] or data.T.shape[1] != 3:
        return {}
    errors = np.full((len(data.lines), 3), np.nan)
    for part, prediction in _parts(findings):
        if name in prediction and prediction[name].errors.shape[1] == 3:
            errors[part] = prediction[name].errors
    return {"errors": partial(_errors_in_space, robot, data.T, errors, list(_words(findings)), title)}


def _errors_in_space(robot: Model, T: np.ndarray, errors: np.ndarray, words: Sequence[str], title: str) -> Any:
    drawn, note = view.error_lines(T, errors)
    bodies = [*view.groups(T, [f"pose {word}" for word in words]), *drawn]
    return view.around(robot, bodies, title=title, note=f"{note} The robot is drawn before calibration.".strip())


def _residuals(residuals: np.ndarray, labels: Sequence[str], title: str) -> Figure:
    """Residuals (N, m) [m] of the fitted poses."""
    units, what = ["mm"] * len(labels), f"{title}: errors of the fitted poses"
    return draw_residuals([*(1e3 * residuals.T)], labels, units, what, place="pose")


def _of_part(part: CalibrationFindings) -> dict[str, np.ndarray]:
    """Sizes [m] of the errors of one of the measurements, before and after, by label."""
    errors, _, held = part.headline
    what = "held-out poses" if held else "fitted poses"
    sizes = {}
    for name in part.problem.judged:
        if name in errors and name.partition("@")[0] != part.data.pose.orientation:
            sizes[f"{part.data.name}, {name}, {what}"] = errors[name].sizes
            if name in part.a_priori:
                sizes[f"{part.data.name}, {name}, before calibration"] = part.a_priori[name].sizes
    return sizes


def _plot() -> Any:
    from ...plot import calibration

    return calibration


LOOK = "see the verdict in the table"
SHOWN_PAIRS = 20
SHOWN_NAMES = 4
FEW_NOTES = 3  # most sentences on undetermined parameters that are shown one by one
APART, KEPT = "the data do not determine ", " stays fixed: "  # in notes on parameters
DH = {"theta", "d", "a", "alpha"}  # parameters of a serial arm


def values_of(findings: CalibrationFindings, accuracy: float | None) -> dict[str, Any]:
    """The quantities of a `CalibrationStudy`, its estimate and its notes; accuracy [m]: the required one."""
    c, data = findings.calibration, findings.data
    sound, proven, sentences = verdict(findings, accuracy)
    errors, lines, held = findings.headline
    names = {q.name for q in findings.problem.closure.flat.parameters}
    intervals_hold = c.estimate is not None and findings.confidence.holds
    whole = data.whole
    head = errors.get(findings.position) if whole else None
    return {
        "parameters": {n: v for n, v in c.values.items() if n in names},
        "unknowns": _unknowns(findings),
        "estimate": findings.confidence.estimate if intervals_hold else None,
        "withheld": "" if intervals_hold else findings.confidence.withheld,
        "intervals_hold": intervals_hold,
        "colour_tested": c.estimate is not None and findings.confidence.tested,
        "measurement": {n: v for n, v in c.values.items() if n not in names} | _refitted(findings),
        "poses": {
            "fitted": len(findings.lines), "held_out": len(findings.lines_held_out), "repeated": len(data.repeated),
        } | ({} if data.refitting is None else {"refitting": len(data.refitting)})
        | ({"left_out": len(data.source.left_out)} if data.source.left_out else {}),
        "link_errors": dict(c.link_errors),
        "held_out_link_rms": _link_rms(findings),
        "held_out": _sizes(findings.held_out.get(findings.position)) if whole else None,
        "fitted": _sizes(findings.fitted.get(findings.position)) if whole else None,
        "a_priori": _sizes(findings.a_priori.get(findings.position)) if whole else None,
        "orientation": _sizes(errors.get(data.pose.orientation or "")),
        "worst": None if head is None else _worst(findings, head, lines, held),
        "largest": _largest(findings) if whole else None,
        "principal": None if head is None else _principal(head),
        "identifiability_before": None if findings.before is None else _identifiability(findings.before),
        "identifiability_after": None if findings.after is None else _identifiability(findings.after),
        "correlated": [] if findings.after is None else [list(p) for p in findings.after.correlated[:SHOWN_PAIRS]],
        "outliers": _outliers(findings),
        "repeatability": findings.repeatability,
        "recordings": _recordings(findings),
        "sensitivity": _sensitivity(findings),
        "numerics_sound": sound,
        "prediction_proven": proven,
        "verdict": sentences,
        "notes": _notes(findings),
        "truth": _truth(findings),
        "synthetic": data.synthetic,
        "degrees": _in_degrees(findings),
    }  # fmt: skip


def checks_of(accuracy: float | None, findings: CalibrationFindings) -> dict[str, Check]:
    """Checks of the prediction and, if required, the accuracy."""
    checks = {}
    name = findings.position
    for part in findings.parts:
        suffix = f" of {part.data.name}" if findings.beside else ""
        judged = part.judged if len(part.calibration.x) else None
        if judged is not None:
            checks[f"held_out_over_fitted{suffix}"] = judged.check(LOOK)
        if part.lost:
            checks[f"held_out_poses_lost{suffix}"] = at_most(float(part.lost), 0.0, LOOK)
    checks |= findings.left[0]
    if findings.far:
        checks["moved_too_far"] = at_most(float(len(findings.far)), 0.0, LOOK)
    over = findings.over_noise
    if over is not None:
        checks["residuals_over_noise"] = over.check(LOOK)
    if accuracy is not None and name in findings.headline[0]:
        mean = findings.headline[0][name].mean
        # errors of fitted poses prove nothing
        proven = 1e3 * mean if findings.held_out or not len(findings.calibration.x) else np.nan
        checks["mean_error_mm"] = at_most(
            proven, 1e3 * accuracy, LOOK if findings.held_out else "hold out poses to prove it"
        )
    return checks


def _unknowns(findings: CalibrationFindings) -> list[dict[str, Any]]:
    c, u, estimate = findings.calibration, findings.problem.unknowns, findings.confidence.estimate
    entries = []
    for k, name in enumerate(u.names):
        entry: dict[str, Any] = {"name": name, "unit": u.units[k] or "1", "start": float(u.start[k])}
        entry |= {"value": float(c.x[k]), "std": None, "interval_95": None}
        if estimate is not None and np.isfinite(estimate.std[k]):
            entry["std"] = float(estimate.std[k])
            if findings.confidence.holds:
                entry["interval_95"] = list(estimate.interval(name))
        entries.append(entry)
    return entries


def _notes(findings: CalibrationFindings) -> list[str]:
    c = findings.calibration
    if not c.status.ok:
        return [*findings.inspection.notes]
    absent = [_absent(part) for part in findings.parts if part.problem.implicit]
    absent += [_refit_note(part) for part in findings.parts if part.refitted is not None]
    if c.estimate is None:
        return [*findings.inspection.notes, *absent]
    intervals = [*findings.confidence.reasons, *findings.confidence.notes]
    drift = [] if findings.after is None else drifted(c, findings.after)
    drift += [] if findings.apart is None else [findings.apart.message]
    suspect = (
        [f"residuals are coloured: {findings.suspect}"] if findings.suspect and findings.confidence.coloured else []
    )
    notes = [*findings.priors, *_gathered(findings), *drift, *suspect, *intervals, *_crowded(findings), *findings.far]
    notes += [*findings.left[1], *findings.inspection.notes, *absent]
    notes += [s for part in findings.parts for s in _left_out(part)]
    return list(dict.fromkeys(notes))  # two null directions may move the same names: one sentence


def _gathered(findings: CalibrationFindings) -> list[str]:
    """Notes of the estimate; many sentences on undetermined parameters, and those on kept ones, become one each."""
    c = findings.calibration
    assert c.estimate is not None
    notes = list(dict.fromkeys(c.estimate.notes))
    apart, kept = ([s for s in notes if word in s] for word in (APART, KEPT))
    gathered = [s for s in notes if s not in apart and s not in kept]
    if len(apart) > FEW_NOTES:
        assert findings.after is not None
        of = [
            n for n, share in zip(findings.after.names, findings.after.determined_by, strict=True) if share < 1 - OPEN
        ]
        serial = findings.variant != SERIAL and set(findings.problem.closure.flat.bindings) >= DH
        advice = (
            f'set variant = "{SERIAL}", which frees only parameters that such poses determine'
            if serial
            else "fix some of them, or give priors; result.json lists the combinations (identifiability_after)"
        )
        names = (
            f"{', '.join(of[:SHOWN_NAMES])} and {len(of) - SHOWN_NAMES} others" if len(of) > SHOWN_NAMES else listed(of)
        )
        gathered.insert(0, f"the poses do not determine {len(of)} parameters apart from each other ({names}): {advice}")
    else:
        gathered = apart + gathered
    if kept:
        names = ", ".join(s.partition(KEPT)[0] for s in kept)
        one = len(kept) == 1
        gathered.append(
            f"{len(kept)} parameter{'' if one else 's'} cannot be seen with this set-up and {'was' if one else 'were'} "
            f"kept: {names} (gtmodel explain says why)"
        )
    return gathered


def _left_out(part: CalibrationFindings) -> list[str]:
    lines = part.data.source.left_out
    if not lines:
        return []
    of = f" of {part.data.name}" if part.calibration.problem.reading.ending else ""
    many, numbers = ("" if len(lines) == 1 else "s"), ", ".join(map(str, lines))
    return [f"leave_out: {len(lines)} pose{many}{of} not read (line{many} {numbers})"]


def _in_degrees(findings: CalibrationFindings) -> bool:
    """Whether the file has angles in degrees."""
    return any("deg" in c.units for part in findings.parts for c in part.data.columns.values())


def _outliers(findings: CalibrationFindings) -> list[dict[str, Any]]:
    """The outlying poses, one entry each; of partial measurements the outliers of each signal."""
    if not findings.data.whole:
        return [
            {"line": int(findings.lines[o.pose]), "link": findings.problem.error_labels[o.link],
             "residual_mm": 1e3 * o.residual, "times": o.times}
            for o in findings.outliers
        ]  # fmt: skip
    entries = []
    held = findings.data.held_out
    for p in findings.far_poses:
        residuals = findings.held_out_residuals if p.held_out else findings.calibration.residuals
        assert residuals is not None
        lengths = residuals[int(np.count_nonzero(held[: p.row] == held[p.row]))]
        link = int(np.nanargmax(np.abs(lengths)))
        entries.append(
            {"line": int(findings.data.lines[p.row]), "link": findings.problem.labels[link],
             "residual_mm": 1e3 * float(lengths[link]), "times": p.times, "held_out": p.held_out,
             "pose": named(findings, [p.row]), "column": columns_of(findings)[p.worst],
             "off_mm": 1e3 * float(p.error[p.worst]), "error_mm": 1e3 * p.size, "others_mm": 1e3 * p.others}
        )  # fmt: skip
    return entries


def _largest(findings: CalibrationFindings) -> list[dict[str, Any]]:
    entries = []
    for part, row, error in largest(findings):
        worst = int(np.argmax(np.abs(error)))
        entries.append(
            {"part": part, "line": int(findings.data.lines[row]), "position_m": findings.data.T[row].tolist(),
             "error_mm": 1e3 * float(np.linalg.norm(error)), "column": columns_of(findings)[worst],
             "off_mm": 1e3 * float(error[worst])}
        )  # fmt: skip
    return entries


def _refitted(findings: CalibrationFindings) -> dict[str, float]:
    """Refitted parameters of the held-out recordings, by name."""
    values: dict[str, float] = {}
    for part in findings.parts:
        refit = part.refitted
        if refit is not None:
            names = refit.problem.reading.parameters.names
            values |= {f"{n} of the held-out recording{_of(part)}": v for n, v in refit.values.items() if n in names}
    return values


def _of(findings: CalibrationFindings) -> str:
    """Ending with the name of the measurements if there are several."""
    return f" of {findings.data.name}" if findings.calibration.problem.reading.ending else ""


def _refit_note(findings: CalibrationFindings) -> str:
    calibration = findings.refitted
    assert calibration is not None
    names, poses = calibration.problem.unknowns.names, len(calibration.problem.measurements)
    return (
        f"{len(names)} parameters of the held-out recording{_of(findings)} ({names[0]} to {names[-1]}) were refitted "
        f"on {poses} of its poses; the other poses judge"
    )


def _absent(part: CalibrationFindings) -> str:
    """Sentence on partial measurements."""
    latent = part.problem.latent
    return (
        f"{part.data.name}: {', '.join(latent)} {'was' if len(latent) == 1 else 'were'} not fully measured and "
        f"estimated pose by pose; the errors are those of {', '.join(part.problem.judged)}"
    )


def _crowded(findings: CalibrationFindings) -> list[str]:
    """A sentence if so many poses have outliers that the cause is probably systematic."""
    N, bad = len(findings.lines), len({o.pose for o in findings.outliers})
    if bad <= MANY * N:
        return []
    return [
        f"{bad} of {N} poses ({bad / N:.0%}) have outliers, too many for chance: look for what they share, "
        "such as a place, a session or a lost target; a robust loss helps only with start values near the robot"
    ]


def _link_rms(findings: CalibrationFindings) -> dict[str, float] | None:
    residuals = findings.held_out_residuals
    if residuals is None:
        return None
    rms = np.sqrt(np.nanmean(residuals**2, axis=0))
    return dict(zip(findings.problem.error_labels, rms.tolist(), strict=True))


def _recordings(findings: CalibrationFindings) -> list[dict[str, Any]] | None:
    """Each of several or partial measurements with the errors of its signals."""
    if not findings.beside and findings.data.whole:
        return None
    entries = []
    for part in findings.parts:
        errors = {}
        for name in part.problem.judged:
            factor, unit = written(part, name)
            sizes = {}
            for key, predictions in (("a_priori", part.a_priori), ("fitted", part.fitted), ("held_out", part.held_out)):
                p = predictions.get(name)
                sizes[key] = None if p is None else {
                    "mean": factor * p.mean, "max": factor * p.greatest, "rms": factor * p.rms, "lost": p.lost,
                }  # fmt: skip
            errors[name] = {"unit": unit, **sizes}
        entries.append(
            {
                "name": part.data.name, "fitted": len(part.lines), "held_out": len(part.lines_held_out),
                "errors": errors, "link_errors_mm": {n: 1e3 * v for n, v in part.calibration.link_errors.items()},
            }
        )  # fmt: skip
    return entries


def _sizes(p: Prediction | None) -> dict[str, float] | None:
    return None if p is None else {"mean": p.mean, "max": p.greatest, "rms": p.rms}


def _worst(findings: CalibrationFindings, head: Prediction, lines: np.ndarray, held: bool) -> dict[str, Any]:
    part = findings.unseen if held else ~findings.data.held_out
    T = findings.data.T[part]
    k = head.worst
    return {"line": int(lines[k]), "position_m": T[k].tolist(), "error_mm": 1e3 * head.greatest, "held_out": held}


def _principal(head: Prediction) -> dict[str, Any]:
    sizes, directions = head.principal()
    return {"rms_mm": (1e3 * sizes).tolist(), "directions": directions.tolist()}


def _identifiability(i: Identifiability) -> dict[str, Any]:
    return {
        "rank": i.rank,
        "redundant": i.redundant,
        "ranks": {f"{t:.0e}": r for t, r in i.ranks.items()},
        "condition": i.condition,
        "observability": {f"O{k}": getattr(i.indices, f"o{k}") for k in range(1, 6)},
        "scaling": i.indices.scaling,
        "notes": i.notes,
    }


def _sensitivity(findings: CalibrationFindings) -> dict[str, dict[str, float]] | None:
    s = findings.sensitivity
    if s is None:
        return None
    table = {}
    for k, name in enumerate(s.names):
        entry = {"position_mm": 1e3 * float(s.pose[findings.position][k])}
        e = findings.data.pose.orientation
        if e is not None and e in s.pose:
            entry["orientation_deg"] = float(np.degrees(s.pose[e][k]))
        table[name] = entry | {"cost_m4": float(s.cost[k])}
    return table


def _truth(findings: CalibrationFindings) -> dict[str, float] | None:
    robot = findings.data.source.truth
    if robot is None:
        return None
    values = {q.name: q.value for q in flat_of(robot).parameters}
    return {n: values[n] for n in findings.calibration.values if n in values}
