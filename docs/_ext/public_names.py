"""What gtmodel offers by name: one list for the reference of the site and for the tests of the docstrings."""

from __future__ import annotations

import inspect
from operator import attrgetter
from typing import Any

import gtmodel as gt

LIBRARIES = [
    "calibrate", "cgen", "compliance", "control", "control.delayed", "control.lead_through", "control.learning",
    "filtering", "fmu", "identify", "inference", "inference.bundle", "kinematics",
    "kinematics.accuracy", "kinematics.assembly_modes", "kinematics.causality", "kinematics.singularity",
    "kinematics.workspace", "loop", "measurements", "mechanics", "milling", "modelica", "motion",
    "motion.axes",
    "motion.elastic", "optimize", "predictive", "results", "robots", "simulation", "sweep", "vibration", "view",
    "vision",
    "vision.detection", "vision.rendering", "vision.stereo", "vision.robot_cameras", "workers",
]  # fmt: skip


def public(library: str) -> dict[str, Any]:
    """Functions and classes of gtmodel that a library, or gt itself where the name is "", offers by name."""
    holder = attrgetter(library)(gt) if library else gt
    above = attrgetter(library.rpartition(".")[0])(gt) if "." in library else None  # what it offers too is its own
    offered = {name: getattr(holder, name) for name in getattr(holder, "__all__", vars(holder)) if name[0] != "_"}
    return {
        name: item
        for name, item in offered.items()
        if getattr(above, name, None) is not item
        and (inspect.isclass(item) or callable(item))
        and getattr(item, "__module__", "").startswith("gtmodel")
    }
