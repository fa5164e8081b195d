"""Simulation of guiding a tool in six degrees of freedom against a synthetic contact, with delay, lag and a mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ...geometry.rotations import rotation_by
from ..delayed import DelayedLoop
from .gains import GuidePhase, Hand, rows_of_phases
from .law import LeadThroughLaw
from .options import ServoChain
from .scenes import Contact, SyntheticSensor
from .sensor import SignTest
from .wrench import Turn, Vector, WrenchStatus, crossed, turns_of, vector_of


@lru_cache(maxsize=16)  # thousands of hands are tried with one servo
def force_loop(servo: ServoChain, cycle: float = 0.004) -> DelayedLoop:
    """Return the force loop along the normal in contact; its gain is force_gain times contact stiffness [1/s].

    `gt.control.delayed.gain_limit` returns the gain and the frequency at which it oscillates. cycle [s].

    >>> limit = gt.control.delayed.gain_limit(gt.control.lead_through.force_loop(gt.control.lead_through.ServoChain()))
    >>> round(limit.gain, 1), round(limit.frequency, 1)  # [1/s], [Hz]
    (112.1, 12.8)
    """
    return DelayedLoop(servo.plant(), cycle, servo.delay)


class ServoRun:
    """Axes that follow their commands with the same servo chain; `position` (n,) [m], `velocity` (n,) [m/s] and
    `acceleration` (n,) [m/s2] are those at the sample, before a new command acts."""

    def __init__(self, servo: ServoChain, cycle: float, start: np.ndarray) -> None:
        loop = force_loop(servo, cycle)
        (self._whole, rest), (self._a, self._early, self._late) = loop.split, loop.transition
        self._parts, self._plant, self._acting = rest > 0, loop.plant, np.zeros_like(start)
        self._x = np.zeros((len(self._a), len(start)))
        self._x[0] = start
        self._pending = [np.zeros(len(start))] * (self._whole + self._parts + 1)  # commands, newest first

    @property
    def position(self) -> np.ndarray:
        """At the sample."""
        return self._x[0]

    @property
    def velocity(self) -> np.ndarray:
        """At the sample."""
        return self._x[1]

    @property
    def acceleration(self) -> np.ndarray:
        """At the sample, under the previous command."""
        return self._plant.A[1] @ self._x + self._plant.B[1] * self._acting

    def advance(self, command: np.ndarray) -> None:
        """Advance by one cycle, with a new command (n,) at its beginning."""
        self._pending = [command, *self._pending[:-1]]
        self._acting = self._pending[self._whole]
        self._x = self._a @ self._x + self._late[:, None] * self._acting
        if self._parts:
            self._x += self._early[:, None] * self._pending[self._whole + 1]


@dataclass(frozen=True, eq=False)
class ToolRun:
    """A synthetic run, a row per cycle: time (n,) [s]; position (n, 3) [m], turn (n, 3, 3), velocity and rate (n, 3)
    of the tool; command (n, 6) [m/s, rad/s]; force (n, 3) [N] and moment (n, 3) [N m] of the contact on the tool,
    without noise; hand_force and hand_moment (n, 3) on the tool, about the tool centre point; read (n, 3), the tool's
    force as the law computes it from the reading; spring (n,) [J] in the contact; normal (n, 3), contact (n,), share
    (n,) of the gain and about (n,) [rad] from the law.

    status: of the last cycle, or of a failed sign test, after which the tool does not move. allowed: whether no sensor
    was rejected, from the sign tests to the end. stopped: [s] when one was rejected during the run, else None.
    """

    time: np.ndarray
    position: np.ndarray
    turn: np.ndarray
    velocity: np.ndarray
    rate: np.ndarray
    command: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    hand_force: np.ndarray
    hand_moment: np.ndarray
    read: np.ndarray
    normal: np.ndarray
    contact: np.ndarray
    share: np.ndarray
    about: np.ndarray
    spring: np.ndarray
    status: WrenchStatus
    allowed: bool
    stopped: float | None = None


def guide_tool(
    law: LeadThroughLaw,
    phases: Sequence[GuidePhase],
    contact: Contact,
    servo: ServoChain | None = None,
    *,
    handle: SyntheticSensor,
    tool: SyntheticSensor,
    tests: tuple[SignTest, SignTest],
    hand: Hand | None = None,
    grip: ArrayLike = (0.0, 0.0, 0.0),
    start: ArrayLike = (0.0, 0.0, 0.0),
    turn: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    seed: int = 0,
) -> ToolRun:
    """Simulate guiding a tool by hand through phases, with readings of both true sensors.

    Args:
        law: with the calibrated sensors. tests: sign tests of the tool's and the handle's sensor.
        contact: `SyntheticSurface`, `SyntheticHole` or your own `Contact`.
        handle, tool: the true sensors. hand: its impedance; without it the hand applies the forces of the phases.
        grip: (3,) [m], position of the hand from the tool centre point, in the tool's frame.
        start, turn: position (3,) [m] of the tool at rest, and matrix (3, 3) whose columns are the tool's axes.
        seed: of the noise.

    The rotation follows the servo as angles about the world axes, integrated cycle by cycle. Raises ArgumentError if
    shapes do not fit, if numbers are not finite, or without phases.

    >>> L = gt.control.lead_through
    >>> ok, sensor = L.SignTest(None, L.WrenchStatus.OK), L.SyntheticSensor(mass=0.0)
    >>> run = L.guide_tool(
    ...     L.LeadThroughLaw(), [L.GuidePhase(4.0, force=(5.0, 0.0, -5.0))], L.SyntheticSurface(),
    ...     handle=sensor, tool=sensor, tests=(ok, ok), seed=1)
    >>> bool(abs(run.force[500:, 2].mean() - 2.0) < 0.02), run.status.name
    (True, 'OK')
    """
    servo = servo or ServoChain()
    rows, cycle = rows_of_phases(list(phases), law.cycle), law.cycle
    begin, R = vector_of(start, "start"), turns_of(np.asarray(turn, float)[None], "turn")[0]
    r, count = vector_of(grip, "grip"), len(rows)
    rng = np.random.default_rng(seed)
    moves, turns = ServoRun(servo, cycle, begin), ServoRun(servo, cycle, np.zeros(3))
    state = law.start(*tests)
    stopped: float | None = None
    vectors = ("position", "velocity", "rate", "force", "moment", "hand_force", "hand_moment", "read", "normal")
    columns = {name: np.zeros((count, 3)) for name in vectors}
    columns |= {name: np.zeros(count) for name in ("share", "about", "spring")}
    orientation, command, touching = np.zeros((count, 3, 3)), np.zeros((count, 6)), np.zeros(count, bool)
    target = begin + R @ r
    for k in range(count):
        x, v, w = moves.position, moves.velocity, turns.velocity
        force, moment = contact.wrench(x, R, v, w, k * cycle)
        arm = R @ r
        f_h, m_h = rows[k, 0], rows[k, 1]
        if hand is not None:
            off, relative = target - x - arm, rows[k, 2] - v - crossed(w, arm)
            f_h = f_h + hand.force(off, relative, moves.acceleration + crossed(turns.acceleration, arm))
        m_h = m_h + crossed(arm, f_h)
        target = target + cycle * rows[k, 2]
        readings = _wrench(handle.reading(f_h, m_h, R, rng)), _wrench(tool.reading(force, moment, R, rng))
        allowed, state = state.allowed, law.step(state, *readings, _turn(R))
        if allowed and not state.allowed:
            stopped = k * cycle
        read = law.tool.wrench(readings[1], _turn(R), law.gravity)[0]
        for name, value in (
            ("position", x), ("velocity", v), ("rate", w), ("force", force), ("moment", moment), ("hand_force", f_h),
            ("hand_moment", m_h), ("read", read), ("normal", state.translation.normal),
            ("share", state.translation.watched[2]), ("about", state.rotation.about),
            ("spring", contact.energy(x, R, k * cycle)),
        ):  # fmt: skip
            columns[name][k] = value
        orientation[k], touching[k] = R, state.contact
        command[k] = *state.velocity, *state.rate
        before = turns.position.copy()
        moves.advance(np.array(state.velocity))
        turns.advance(np.array(state.rate))
        step = turns.position - before
        if step.any():
            R = rotation_by(step) @ R
    return ToolRun(
        cycle * np.arange(count),
        turn=orientation,
        command=command,
        contact=touching,
        status=state.status,
        allowed=state.allowed,
        stopped=stopped,
        **columns,
    )


def _wrench(pair: tuple[np.ndarray, np.ndarray]) -> tuple[Vector, Vector]:
    return _vector(pair[0]), _vector(pair[1])


def _turn(R: np.ndarray) -> Turn:
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    return (a, b, c), (d, e, f), (g, h, i)


def _vector(row: np.ndarray) -> Vector:
    x, y, z = row.tolist()
    return x, y, z
