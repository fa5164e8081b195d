"""An oscillator field as a TOML file, to be loaded where forces act on the arm, such as in milling."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ...results.disk import path_of
from ...results.read_bounds import toml_of
from .gaussian_process import GaussianProcess
from .gaussian_process_kernel import KernelInputs
from .oscillator_field import DIRECTIONS, QUANTITIES, OscillatorField

FORMAT = "gtmodel oscillator field 1"
_UNITS = {"m": "kg", "c": "N.s/m", "k": "N/m"}


def oscillator_text(field: OscillatorField) -> str:
    """The field as TOML, every number to its last bit: training poses, logarithms and hyperparameters.

    >>> rng = np.random.default_rng(1)
    >>> poses = rng.uniform([-0.3, -3.1, 0.2, 0.0], [0.9, -2.1, 0.4, 2.0], (12, 4))  # x, y, z [m], A [rad]
    >>> m, c, k = (size * np.exp(0.1 * rng.standard_normal((12, 3))) for size in (200.0, 4000.0, 3e6))
    >>> field, _ = gt.vibration.fit_oscillator_field(poses, m, c, k, starts=1, calibrate=False)
    >>> gt.vibration.oscillator_text(field).splitlines()[1]
    'format = "gtmodel oscillator field 1"'
    """
    first = field.processes[DIRECTIONS[0], QUANTITIES[0]]
    content: dict[str, Any] = {
        "format": FORMAT,
        "synthetic": field.synthetic or "",
        "pose": "x [m], y [m], z [m], A [rad]",
        "covariance": {
            "shape": first.shape,
            "scale": list(first.inputs.scale),
            "periodic": list(first.inputs.periodic),
        },
    }
    for d in DIRECTIONS:
        own = [field.processes[d, q] for q in QUANTITIES]
        content[d] = {"poses": own[0].X.tolist()}
        for q, g in zip(QUANTITIES, own, strict=True):
            content[d][q] = {
                "unit": _UNITS[q],
                "lengths": g.lengths.tolist(),
                **{name: float(getattr(g, name)) for name in ("amplitude", "noise", "mean", "level", "inflation")},
                "logarithms": g.y.tolist(),
            }
    head = f"# SYNTHETIC: {field.synthetic}\n" if field.synthetic else ""
    return head + "# m x'' + c x' + k x = F by direction, over poses; see gtmodel.vibration.OscillatorField\n" + (
        tomli_w.dumps(content)
    )  # fmt: skip


def load_oscillator_field(path: str | Path) -> OscillatorField:
    """The field that oscillator_text() wrote: the same answers, bit for bit. Raises ValueError for another file.

    >>> rng = np.random.default_rng(1)
    >>> poses = rng.uniform([-0.3, -3.1, 0.2, 0.0], [0.9, -2.1, 0.4, 2.0], (12, 4))  # x, y, z [m], A [rad]
    >>> m, c, k = (size * np.exp(0.1 * rng.standard_normal((12, 3))) for size in (200.0, 4000.0, 3e6))
    >>> field, _ = gt.vibration.fit_oscillator_field(poses, m, c, k, starts=1, calibrate=False)
    >>> from pathlib import Path
    >>> _ = Path("field.toml").write_text(gt.vibration.oscillator_text(field))
    >>> again = gt.vibration.load_oscillator_field("field.toml")
    >>> np.array_equal(again.at(poses[0]), field.at(poses[0]))
    True
    """
    name = path_of(path).name
    try:
        content = toml_of(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{name} cannot be read as an oscillator field: {error}") from error
    if content.get("format") != FORMAT:
        raise ValueError(
            f"{name} has the format {content.get('format')!r}; expected '{FORMAT}', as kind dynamic_stiffness writes it"
        )
    try:
        covariance = content["covariance"]
        inputs = KernelInputs(tuple(covariance["scale"]), tuple(covariance["periodic"]))
        processes = {
            (d, q): _process(np.array(content[d]["poses"], float), content[d][q], inputs, covariance["shape"])
            for d in DIRECTIONS
            for q in QUANTITIES
        }
    except KeyError as error:
        raise ValueError(f"{name} lacks the key {error}; let kind dynamic_stiffness write it anew") from error
    return OscillatorField(processes, content.get("synthetic") or None)


def _process(X: np.ndarray, table: dict[str, Any], inputs: KernelInputs, shape: Any) -> GaussianProcess:
    numbers = [float(table[name]) for name in ("amplitude", "noise", "mean", "level", "inflation")]
    return GaussianProcess(X, np.array(table["logarithms"], float), inputs, shape, np.array(table["lengths"]), *numbers)
