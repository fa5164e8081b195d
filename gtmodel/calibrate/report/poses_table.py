"""poses.csv of a calibration: every pose with its errors."""

from __future__ import annotations

import numpy as np

from ...results.table import csv_text
from ..prediction import Prediction
from .findings import CalibrationFindings


def text(findings: CalibrationFindings) -> str:
    """Line of the file, fitted or held out, the measured position [m], errors of position [mm] and lengths [mm];
    empty where a pose cannot be closed."""
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
    """Rows and the predictions that are told of them: of poses left out in turn those without them."""
    seen = [] if findings.left_out is not None else [(~findings.data.held_out, findings.fitted)]
    return [*seen, (findings.unseen, findings.held_out)]


def _words(findings: CalibrationFindings) -> np.ndarray:
    if findings.left_out is not None:
        return np.full(len(findings.data.lines), "left out in turn")
    return np.where(findings.data.held_out, "held out", "fitted")


def _partial(findings: CalibrationFindings) -> str:
    """Line of the file, fitted or held out, and of each signal beside the actuators what was measured and its error."""
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
                own = prediction[name].errors
                errors = np.full((len(data.lines), own.shape[1]), np.nan) if errors is None else errors
                errors[part] = own
        if errors is not None:
            heads = [f"error of {n}" for n in ([name] if errors.shape[1] == 1 else heads[: errors.shape[1]])]
            values |= dict(zip(heads, errors.T, strict=True))
            formats |= dict.fromkeys(heads, ".8f")
    return csv_text(
        {"line": data.lines, "part": _words(findings), **values}, formats,
        ["SI units", *([f"synthetic: {data.synthetic}"] if data.synthetic else [])],
    )  # fmt: skip
