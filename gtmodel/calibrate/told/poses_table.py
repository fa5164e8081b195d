"""poses.csv of a calibration: every pose with its errors."""

from __future__ import annotations

import numpy as np

from .findings import Found


def text(found: Found) -> str:
    """Line of the file, fitted or held out, the measured position [m], errors of position [mm] and lengths [mm];
    empty where a pose cannot be closed."""
    name = found.position
    T = found.data.T
    labels = found.problem.labels
    heads = ["line", "part", *(f"{name}[{k}] [m]" for k in range(T.shape[1])),
             *(f"error {axis} [mm]" for axis in "xyz"), "error [mm]", *(f"{x} [mm]" for x in labels)]  # fmt: skip
    held = found.data.held_out
    errors, lengths = np.full((len(T), 3), np.nan), np.full((len(T), len(labels)), np.nan)
    for part, prediction in ((~held, found.fitted), (held, found.held_out)):
        if name in prediction:
            errors[part] = prediction[name].errors
    lengths[~held] = found.calibration.residuals
    if found.data.kept is not None:
        lengths[held] = found.calibration.on(found.data.kept)
    numbers = np.column_stack([1e3 * errors, 1e3 * np.linalg.norm(errors, axis=1), 1e3 * lengths])
    lines = [f"# synthetic: {found.data.synthetic}"] if found.data.synthetic else []
    lines.append(",".join(heads))
    for k in range(len(T)):
        part = "held out" if held[k] else "fitted"
        cells = [
            str(found.data.lines[k]),
            part,
            *(f"{x:.7f}" for x in T[k]),
            *("" if np.isnan(x) else f"{x:.5f}" for x in numbers[k]),
        ]
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"
