"""Lead-through against a synthetic surface, cycle by cycle: servo with lag, delay and mode, contact with friction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError
from ...results.options import Options, Unit, Within
from ..delayed import CorrectedPlant, DelayedLoop
from .calibration import GRAVITY, calibrate_wrench
from .law import SurfaceLaw
from .sign import sign_test
from .status import WrenchStatus
from .vectors import Vector
from .wrench import rows_of, vector_of

AT_REST = 50  # readings before the start
SLOW = 1e-4  # [m/s] below it friction falls with the speed: it has no direction at rest
QUARTERS = np.array([np.eye(3), [[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]], float)


@dataclass(frozen=True)
class ServoChain(Options):
    """How the robot follows a velocity command along each axis: delay, first-order lag, and a mode in series.

    >>> len(gt.control.lead_through.ServoChain(mode_frequency=67.0).plant())  # lag, position, and two of the mode
    4
    """

    lag: Annotated[float, Unit("s"), Within(above=0.0), "time constant of the velocity loop"] = 0.012
    delay: Annotated[float, Unit("s"), Within(least=0.0), "from a command's cycle to its effect"] = 0.008
    mode_frequency: Annotated[float, Unit("Hz"), Within(least=0.0), "natural, of the mode; 0: none"] = 0.0
    mode_damping: Annotated[float, Unit("1"), Within(above=0.0), "damping ratio of the mode"] = 0.02

    def plant(self) -> CorrectedPlant:
        """Position [m] from the velocity command [m/s]: 1 / (s (lag s + 1)), times the mode's transfer function."""
        if self.mode_frequency == 0:
            return CorrectedPlant(
                np.array([[0.0, 1.0], [0.0, -1 / self.lag]]), np.array([0.0, 1 / self.lag]), np.array([1.0, 0.0])
            )
        w = 2 * np.pi * self.mode_frequency
        a = np.zeros((4, 4))
        a[0, 1] = a[1, 2] = 1.0
        a[2, 1:] = -(w**2), -2 * self.mode_damping * w, w**2
        a[3, 3] = -1 / self.lag
        return CorrectedPlant(a, np.array([0.0, 0.0, 0.0, 1 / self.lag]), np.array([1.0, 0.0, 0.0, 0.0]))


def force_loop(servo: ServoChain, cycle: float = 0.004) -> DelayedLoop:
    """The force loop along the normal, in contact, whose gain is force_gain times contact stiffness [1/s].

    `gt.control.delayed.gain_limit` gives the gain and the frequency at which it oscillates. cycle [s].

    >>> limit = gt.control.delayed.gain_limit(gt.control.lead_through.force_loop(gt.control.lead_through.ServoChain()))
    >>> round(limit.gain, 1), round(limit.frequency, 1)  # [1/s], [Hz]
    (112.1, 12.8)
    """
    return DelayedLoop(servo.plant(), cycle, servo.delay)


@dataclass(frozen=True)
class SyntheticSurface(Options):
    """A plane that pushes back where the tool tip is inside it, without adhesion; it stands at the origin.

    `tilt` turns its normal from z about y: with a positive one it falls towards +x.

    >>> gt.control.lead_through.SyntheticSurface(tilt=0.07).normal.round(4)
    array([0.0699, 0.    , 0.9976])
    """

    stiffness: Annotated[float, Unit("N/m"), Within(above=0.0), "of the contact"] = 5000.0
    tilt: Annotated[float, Unit("rad", written="deg"), Within(above=-1.5, below=1.5), "of its normal about y"] = 0.0
    friction: Annotated[float, Unit("1"), Within(least=0.0), "Coulomb coefficient"] = 0.0
    rise: Annotated[float, Unit("m/s"), Within(), "speed of the surface along its normal"] = 0.0

    @property
    def normal(self) -> np.ndarray:
        """(3,), from the workpiece to the tool."""
        return np.array([math.sin(self.tilt), 0.0, math.cos(self.tilt)])

    def force(self, position: np.ndarray, velocity: np.ndarray, time: float) -> np.ndarray:
        """(3,) [N] on a tool at position (3,) [m] that moves with velocity (3,) [m/s]."""
        n = self.normal
        pressed = self.stiffness * max(self.rise * time - float(n @ position), 0.0)
        along = velocity - (n @ velocity) * n
        return pressed * (n - self.friction * along / max(float(np.linalg.norm(along)), SLOW))


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

    loop = force_loop(servo, cycle)
    (whole, rest), (a, early, late) = loop.split, loop.transition
    x, ahead = np.zeros((len(a), 3)), np.zeros((whole + (rest > 0) + 1, 3))  # commands on their way, youngest first
    x[0] = at
    rows = {name: np.zeros((count, 3)) for name in ("position", "command", "force", "guided", "normal")}
    contact = np.zeros(count, bool)
    drawn = noise * rng.standard_normal((count, 3))
    for k in range(count):
        force = surface.force(x[0], x[1], k * cycle)
        read = sensor_sign * (force + weight) + drawn[k] - weight
        state = law.step(state, _vector(hand[k]), _vector(read))
        for name, value in (("position", x[0]), ("command", state.velocity), ("force", force),
                            ("guided", state.guided), ("normal", state.normal)):  # fmt: skip
            rows[name][k] = value
        contact[k] = state.contact
        ahead = np.vstack([[state.velocity], ahead[:-1]])
        x = a @ x + np.outer(late, ahead[whole])
        if rest:
            x += np.outer(early, ahead[whole + 1])
    return GuidedRun(cycle * np.arange(count), **rows, contact=contact, status=state.status)


def _vector(row: np.ndarray) -> Vector:
    return float(row[0]), float(row[1]), float(row[2])
