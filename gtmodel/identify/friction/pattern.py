"""The forces with which the actuators of a robot hold one kilogram at the tool."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from ...compiler.causal import flat_of
from ...lang import Model, ModelError
from ...results import ArgumentError, Status, naming
from .options import HeldPose

Weighed = Callable[[Sequence[float]], np.ndarray]
PLATE = "m_p"  # mass of the plate, payload included, in all robots of the library


def gravity_pattern(robot: Model, poses: Sequence[HeldPose]) -> np.ndarray:
    """Force of each cart that holds one kilogram at the tool (poses, carts) [N/kg], by geometry or as printed.

    A pose gives its tool centre point, for which the robot's model is asked, or printed forces with the mass they hold.
    Raises ArgumentError for a pose that says neither or both, or cannot be reached, and for a robot that its tool
    centre point does not place or whose plate has no mass.

    >>> pose = gt.identify.HeldPose(tcp=[0.5, -0.9, 0.3])
    >>> gt.identify.gravity_pattern(gt.robots.gantry_tau("l1_tape"), [pose]).round(2)
    array([[-9.54, -0.41,  9.95]])
    """
    if not poses:
        raise ArgumentError("is empty; expected one or more", "poses")
    weigh = cache(lambda: _by_geometry(robot))
    rows = [_holding(pose, f"poses[{n}]", weigh) for n, pose in enumerate(poses)]
    if len({len(row) for row in rows}) > 1:
        raise ArgumentError(
            f"the poses have {', '.join(str(len(r)) for r in rows)} carts; expected one number", "poses"
        )
    return np.array(rows)


def _holding(pose: HeldPose, argument: str, weigh: Callable[[], Weighed]) -> np.ndarray:
    if (pose.tcp is None) == (pose.holding is None):
        raise ArgumentError("expected either tcp or holding with holding_mass", argument)
    if pose.tcp is not None:
        weighed = weigh()
        with naming(f"{argument}.tcp", ValueError):
            return weighed(pose.tcp)
    if pose.holding_mass is None:
        raise ArgumentError("is missing; expected the mass that holding holds, in kg", f"{argument}.holding_mass")
    return np.array(pose.holding) / pose.holding_mass


def _by_geometry(robot: Model) -> Weighed:
    """Tool centre point [m] -> forces that hold one kilogram more [N]; friction is in both cases and falls out."""
    masses = {p.name: p.value for p in flat_of(robot).parameters}
    if masses.get(PLATE) is None:
        raise ArgumentError(
            f"has no mass '{PLATE}' of its plate, so its geometry does not tell what the carts hold; "
            "give the poses' holding",
            "robot",
        )
    try:
        inverse = [m.causal(known="T", targets="tau") for m in (robot, robot.with_(**{PLATE: masses[PLATE] + 1.0}))]
    except ModelError as error:
        said = f"a tool centre point alone does not place it, as it does with three links ({error})"
        raise ArgumentError(said, "robot") from error

    def weighed(tcp: Sequence[float]) -> np.ndarray:
        width = inverse[0].inputs[0].size
        if len(tcp) != width:
            raise ValueError(f"expected a list of {width} numbers in m")
        at_rest = [np.zeros(width)] * (len(inverse[0].inputs) - 1)
        forces = []
        for function in inverse:
            tau, status = function(tcp, *at_rest)
            if status is not Status.OK:
                raise ValueError(f"{tcp} m cannot be reached: {status.message}")
            forces.append(np.asarray(tau))
        return forces[1] - forces[0]

    return weighed
