"""parameters.toml of a calibration: a robot file that gtmodel reads, with standard deviations in its comments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...lang import Model, ModelError
from ...robots.links import family_of
from ..unknowns import merged
from .findings import CalibrationFindings

# key in the file -> parameter of the model, and the factor from SI
GEOMETRY = {
    "three_link": {"A_m": ("A", 1.0), "v": ("v", 1.0), "L_m": ("L", 1.0), "home_m": ("home", 1.0)},
    "six_link": {"A_m": ("A", 1.0), "v": ("v", 1.0), "L_m": ("L", 1.0), "B_m": ("B", 1.0), "home_m": ("home", 1.0)},
    "f1": {
        "A0_mm": ("A0", 1e3), "v": ("v", 1.0), "L_mm": ("L", 1e3), "A_bj_mm": ("A", 1e3), "B0_mm": ("B", 1e3),
        "u1_2": ("u1_2", 1.0), "u1_3": ("u1_3", 1.0), "u2_3": ("u2_3", 1.0), "r3_mm": ("r3", 1e3),
        "home_mm": ("home", 1e3),
    },
}  # fmt: skip
MASSES = {
    "m_p_kg": "m_p", "m_c_kg": "m_c", "coulomb_N": "coulomb", "viscous_kg_s": "viscous", "m_a_kg": "m_a",
    "c_p_m": "c_p", "I_p_kg_m2": "I_p", "J_kg_m2": "J",
}  # fmt: skip


@dataclass(frozen=True)
class Origin:
    """Where a robot comes from, for its calibrated file.

    name: its name in text. reference: "file.py:Class" of a model in Python. given: its parameters by name.
    """

    name: str
    reference: str = ""
    given: Mapping[str, Any] = field(default_factory=dict)


def text(findings: CalibrationFindings, model: Model, title: str, origin: Origin) -> str:
    """A robot file: for a family, masses and friction unchanged; for a model in Python, its reference and parameters
    with the calibrated values."""
    import tomli_w

    calibrated = findings.calibration.parameters()
    values = {name: calibrated.get(name, getattr(model, name, None)) for name in _names(model)}
    pieces = [name for name in findings.calibration.values if ".guideway." in name]  # no robot file holds these
    family = "" if pieces else family_of(model)
    table: dict[str, Any] = {"title": title, "source": f"calibration of {origin.name}", "note": _note(findings)}
    if family:
        table["family"] = family
        for key, (name, factor) in GEOMETRY[family].items():
            table[key] = (factor * np.array(values[name], float)).tolist()
        for key, name in MASSES.items():
            if getattr(model, name, None) is not None and not (
                family == "three_link" and key in ("c_p_m", "I_p_kg_m2")
            ):
                table[key] = np.array(getattr(model, name), float).tolist()
        beside = {k: v for k, v in findings.calibration.values.items() if k.partition("[")[0] not in values}
        body = tomli_w.dumps(table)
    elif _has_dh_numbers(model):
        from ...robots import robot_table  # here: most calibrations are not of arms

        names = {q.name for q in findings.problem.closure.flat.parameters}
        beside = {k: v for k, v in findings.calibration.values.items() if k not in names}
        body = tomli_w.dumps(robot_table(model.with_(**calibrated), "") | table)
    else:
        names = {q.name for q in findings.problem.closure.flat.parameters}
        beside = {k: v for k, v in findings.calibration.values.items() if k not in names}
        if origin.reference:
            table["robot"] = origin.reference
        body = tomli_w.dumps({**table, "parameters": _plain(merged(origin.given, calibrated))})
    comments = [f"# {line}" for line in _confidence(findings)]
    comments += [
        f"# measurement: {name} = {value:.9g}"
        for name, value in beside.items()
        if ".guideway.at[" not in name and ".guideway.points[" not in name
    ]
    use = "gtmodel reads this file as a robot"
    if not family and origin.reference and not _has_dh_numbers(model):
        place = origin.reference.rpartition(":")[0] or origin.reference
        use += f", with '{place}' next to it, to the problem or in the current folder"
    if pieces:
        use = "not a robot file, since guideways are measured: A and v are the nominal values"
    return "\n".join([f"# Calibrated parameters; {use}.", *comments, "", body])


def urdf(findings: CalibrationFindings, model: Model, title: str) -> dict[str, str]:
    """calibrated.urdf of an arm with Denavit-Hartenberg parameters, by name; none for other robots, or for bodies that
    URDF cannot describe."""
    if not _has_dh_numbers(model):
        return {}
    from ...robots import to_urdf  # here: most calibrations are not of arms

    try:
        return {
            "calibrated.urdf": to_urdf(model.with_(**findings.calibration.parameters()), f"{title}; {_note(findings)}")
        }
    except ModelError:
        return {}


def _has_dh_numbers(model: Model) -> bool:
    """Whether the model is a serial arm that a robot file describes completely."""
    return getattr(getattr(model, "structure", None), "style", "rpy") != "rpy"


def _plain(value: Any) -> Any:
    """Convert arrays to lists."""
    if isinstance(value, Mapping):
        return {n: _plain(v) for n, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _names(model: Model) -> list[str]:
    family = family_of(model)
    return [name for name, _ in GEOMETRY[family].values()] if family else []


def _note(findings: CalibrationFindings) -> str:
    errors, _, held = findings.headline
    what = "held-out" if held else "fitted"
    accuracy = (
        f"; mean {what} error {1e3 * errors[findings.position].mean:.3g} mm" if findings.position in errors else ""
    )
    synthetic = f"; synthetic data: {findings.data.synthetic}" if findings.data.synthetic else ""
    return f"frame of the measurements{accuracy}{synthetic}"


def _confidence(findings: CalibrationFindings) -> list[str]:
    e = findings.confidence.estimate
    if e is None:
        return ["not solved: these are the values at the end of the iteration"]
    lines = [*findings.confidence.reasons[-1:], *findings.confidence.notes]
    for name, std in zip(e.names, e.std, strict=True):
        lines.append(f"std of {name}: {std:.3g}" if np.isfinite(std) else f"{name} is not determined by these poses")
    return lines
