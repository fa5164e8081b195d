"""poses.csv of a calibration: every pose with its errors."""

from __future__ import annotations

import numpy as np

from ...results.table import csv_text
from .findings import Found


def text(found: Found) -> str:
    """Line of the file, fitted or held out, the measured position [m], errors of position [mm] and lengths [mm];
    empty where a pose cannot be closed."""
    name = found.position
    T = found.data.T
    held = found.data.held_out
    labels = found.problem.labels
    errors, lengths = np.full((len(T), 3), np.nan), np.full((len(T), len(labels)), np.nan)
    for part, prediction in ((~held, found.fitted), (held, found.held_out)):
        if name in prediction:
            errors[part] = prediction[name].errors
    lengths[~held] = found.calibration.residuals
    if found.data.kept is not None:
        lengths[held] = found.calibration.on(found.data.kept)
    places = {f"{name}[{k}] [m]": x for k, x in enumerate(T.T)}
    heads = [*(f"error {axis} [mm]" for axis in "xyz"), "error [mm]", *(f"{x} [mm]" for x in labels)]
    numbers = np.column_stack([1e3 * errors, 1e3 * np.linalg.norm(errors, axis=1), 1e3 * lengths])
    return csv_text(
        {"line": found.data.lines, "part": np.where(held, "held out", "fitted"), **places}
        | dict(zip(heads, numbers.T, strict=True)),
        dict.fromkeys(places, ".7f") | dict.fromkeys(heads, ".5f"),
        [f"synthetic: {found.data.synthetic}"] if found.data.synthetic else (),
    )
