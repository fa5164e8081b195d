"""poses.csv of a calibration: every pose with its errors."""

from __future__ import annotations

import numpy as np

from ...results.table import csv_text
from .findings import CalibrationFindings


def text(findings: CalibrationFindings) -> str:
    """Line of the file, fitted or held out, the measured position [m], errors of position [mm] and lengths [mm];
    empty where a pose cannot be closed."""
    name = findings.position
    T = findings.data.T
    held = findings.data.held_out
    labels = findings.problem.labels
    errors, lengths = np.full(T.shape, np.nan), np.full((len(T), len(labels)), np.nan)
    for part, prediction in ((~held, findings.fitted), (held, findings.held_out)):
        if name in prediction:
            errors[part] = prediction[name].errors
    lengths[~held] = findings.calibration.residuals
    if findings.data.kept is not None:
        lengths[held] = findings.calibration.on(findings.data.kept)
    places = {f"{name}[{k}] [m]": x for k, x in enumerate(T.T)}
    heads = [*(f"error {axis} [mm]" for axis in "xyz"[: T.shape[1]]), "error [mm]", *(f"{x} [mm]" for x in labels)]
    numbers = np.column_stack([1e3 * errors, 1e3 * np.linalg.norm(errors, axis=1), 1e3 * lengths])
    return csv_text(
        {"line": findings.data.lines, "part": np.where(held, "held out", "fitted"), **places}
        | dict(zip(heads, numbers.T, strict=True)),
        dict.fromkeys(places, ".7f") | dict.fromkeys(heads, ".5f"),
        [f"synthetic: {findings.data.synthetic}"] if findings.data.synthetic else (),
    )
