"""Lead-through against a synthetic surface, cycle by cycle: servo with lag, delay and mode, contact with friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError
from .calibration import calibrate_wrench
from .law import SurfaceLaw
from .options import ServoChain
from .scenes import SyntheticSurface
from .servo import ServoRun
from .sign import sign_test
from .status import WrenchStatus
from .synthetic_sensor import GRAVITY
from .vectors import Vector
from .wrench import rows_of, vector_of

AT_REST = 50  # readings before the start
QUARTERS = np.array([np.eye(3), [[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]], float)


@dataclass(frozen=True, eq=False)
class GuidedRun:
    """A synthetic run, a row per cycle (n,): time [s]; position, command (n, 3) [m], [m/s]; force (n, 3) [N] on the
    tool, without noise; guided (n, 3) [m/s] as of `SurfaceState`; normal (n, 3); contact (n,).

    status: of the last cycle, or of the sign test where it failed: then nothing moved.
    """

    time: np.ndarray
    position: np.ndarray
    command: np.ndarray
    force: np.ndarray
    guided: np.ndarray
    normal: np.ndarray
    contact: np.ndarray
    status: WrenchStatus


def guide(
    law: SurfaceLaw,
    handle: ArrayLike,
    surface: SyntheticSurface | None = None,
    servo: ServoChain | None = None,
    *,
    start: ArrayLike = (0.0, 0.0, 0.0),
    noise: float = 0.0,
    seed: int = 0,
    tool_mass: float = 0.8,
    sensor_sign: int = 1,
) -> GuidedRun:
    """Guide a tool by the handle forces (n, 3) [N], one row per cycle, against a synthetic surface.

    Args:
        start: (3,) [m] of the tool tip at rest; the surface passes the origin.
        noise: standard deviation of a component of the tool force [N], white; seed: of its draw.
        tool_mass: [kg] of the tool that the sensor carries: by its weight the sign is tested before the first cycle.
        sensor_sign: -1 for a sensor that reports the force by the tool.

    The transition of the servo is exact for held commands. Raises ArgumentError for other shapes, what is not finite, a
    negative noise, a tool without mass and another sign.

    >>> L = gt.control.lead_through
    >>> run = L.guide(L.SurfaceLaw(), np.tile([5.0, 0.0, -5.0], (1000, 1)))
    >>> run.force[-1].round(2), run.status.name  # 2 N held
    (array([0., 0., 2.]), 'OK')
    """
    surface, servo = surface or SyntheticSurface(), servo or ServoChain()
    hand, at = rows_of(handle, "handle"), vector_of(start, "start")
    if not (np.isfinite(noise) and noise >= 0):
        raise ArgumentError(f"must be a number, at least 0; found {noise!r}", "noise")
    if not (np.isfinite(tool_mass) and tool_mass > 0):
        raise ArgumentError(f"must be a number above 0; found {tool_mass!r}", "tool_mass")
    if sensor_sign not in (1, -1):
        raise ArgumentError(f"is 1 or -1; found {sensor_sign!r}", "sensor_sign")
    rng, count, cycle = np.random.default_rng(seed), len(hand), law.gains.cycle
    weight = tool_mass * np.array(GRAVITY)
    pulls = tool_mass * QUARTERS.transpose(0, 2, 1) @ np.array(GRAVITY)
    least = max(noise, 1e-3)
    known = calibrate_wrench(QUARTERS, pulls, 0 * pulls, sigma_force=least, sigma_moment=least)
    at_rest = sensor_sign * weight + noise * rng.standard_normal((AT_REST, 3))
    state = law.start(sign_test(known, np.eye(3), at_rest, sigma=least))

    chain = ServoRun(servo, cycle, at)
    rows = {name: np.zeros((count, 3)) for name in ("position", "command", "force", "guided", "normal")}
    contact = np.zeros(count, bool)
    drawn = noise * rng.standard_normal((count, 3))
    for k in range(count):
        force = surface.force(chain.position, chain.velocity, k * cycle)
        read = sensor_sign * (force + weight) + drawn[k] - weight
        state = law.step(state, _vector(hand[k]), _vector(read))
        for name, value in (("position", chain.position), ("command", state.velocity), ("force", force),
                            ("guided", state.guided), ("normal", state.normal)):  # fmt: skip
            rows[name][k] = value
        contact[k] = state.contact
        chain.advance(np.array(state.velocity))
    return GuidedRun(cycle * np.arange(count), **rows, contact=contact, status=state.status)


def _vector(row: np.ndarray) -> Vector:
    return float(row[0]), float(row[1]), float(row[2])
