"""What an identification of a serial arm gives besides numbers: its base parameters, bodies that can exist, files."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..lang import ModelError
from ..results import ArgumentError, Check, at_most
from .asked import Asked
from .inertia import Identification

URDF, ROBOT = "identified.urdf", "identified.toml"


class IdentifiedBodies(NamedTuple):
    """Quantities of the study, its checks, sentences and files."""

    values: dict[str, Any]
    checks: dict[str, Check]
    notes: list[str]
    files: dict[str, str]


def bodies_of(asked: Asked, identification: Identification) -> IdentifiedBodies:
    """Of a fit of inertias; nothing of any other. Raises ArgumentError where no bodies can be made of it."""
    if not asked.regressor.base:
        return IdentifiedBodies({}, {}, [], {})
    from ..robots import SerialArm, robot_table, to_urdf
    from .base_parameters import BaseRegressor  # here: most identifications are not of arms
    from .consistent import MOVED, consistent_inertias

    base, robot = asked.regressor, asked.robot
    assert isinstance(base, BaseRegressor) and isinstance(robot, SerialArm)
    values: dict[str, Any] = {"base_parameters": base.combinations}
    if asked.how.inertias != "consistent":
        return IdentifiedBodies(values, {}, [], {})
    try:
        c = consistent_inertias(robot, base, identification.estimate)
    except ModelError as error:
        raise ArgumentError(str(error), "fitting.inertias") from error
    import tomli_w

    source = asked.title or "identification"
    if identification.rows.synthetic:
        source += f"; synthetic data: {identification.rows.synthetic}"
    return IdentifiedBodies(
        values | {"masses": c.m, "first_moments": c.mc, "inertias": c.J},
        {"consistent_bodies_move": at_most(float(np.max(np.abs(c.moved), initial=0.0)), MOVED, "see the notes")},
        [*c.notes, "masses and inertias by themselves are those of the model where the motion determines nothing; "
         "the base parameters alone are measured"],
        {URDF: to_urdf(c.arm, source), ROBOT: tomli_w.dumps({"source": source, **robot_table(c.arm, URDF)})},
    )  # fmt: skip
