"""Constant-velocity runs: found in a log, or made as one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ...measurements import Session, ZeroPhase, motion
from ...results import ArgumentError
from ...results.trajectory import Trajectory
from ...results.trajectory_checks import Array, TrajectoryError
from .options import ACCELERATION, CUTOFF_HZ, SHORTEST


class Runs(NamedTuple):
    """Constant-velocity runs.

    `velocity` (runs, carts) [m/s], mean `force` (runs, carts) [N], `pose` (runs,) index from 0, `seconds` (runs,) that
    each lasted, `position` (runs, carts) at its middle [m].
    """

    velocity: Array
    force: Array
    pose: np.ndarray
    seconds: Array
    position: Array


def constant_velocity_runs(
    session: Session,
    position: str = "q",
    force: str = "force",
    *,
    pose: int = 0,
    cutoff_Hz: float = CUTOFF_HZ,
    acceleration: float = ACCELERATION,
    slow: float = 0.0,
    shortest: float = SHORTEST,
) -> Runs:
    """The runs of a log: stretches in which no cart accelerates and all move.

    `position` [m] and `force` [N] are names of the signals, (n,) or (n, carts); `pose` is the index of the pose in
    which the log was recorded. Rows count while every acceleration behind a low pass of `cutoff_Hz` is below
    `acceleration` [m/s2] and every velocity above `slow` [m/s] in size; a stretch lasts at least `shortest` [s] after
    the filter's settling time is cut off its ends. The velocity of a run is that of a straight line through its
    positions, its force the mean, both of unfiltered rows.

    Raises TrajectoryError where there is none.

    >>> log = gt.identify.constant_velocity_log(
    ...     [0.2, 0.4], lambda v: 150.0 * np.sign(v) + 190.0 * v, np.array([30.0]), seed=1, noise=5.0
    ... )
    >>> runs = gt.identify.constant_velocity_runs(log)
    >>> runs.velocity[:, 0].round(3), runs.force[:, 0].round(-1)
    (array([ 0.2, -0.2,  0.4, -0.4]), array([ 190., -190.,  230., -230.]))
    """
    low_pass = ZeroPhase(cutoff_Hz)
    smooth, step = motion(session, position, low_pass), session.sample_time
    cut = low_pass.end_rows(step)
    n = len(smooth)
    v, a = (smooth[name].reshape(n, -1) for name in (f"der({position})", f"der({position},2)"))
    still = np.asarray((np.abs(a) < acceleration).all(axis=1) & (np.abs(v) > slow).all(axis=1))
    # a change of sign is no constant velocity, however slow it happens
    border = np.concatenate([[True], (np.sign(v[1:]) != np.sign(v[:-1])).any(axis=1) | (still[1:] != still[:-1])])
    starts = np.flatnonzero(border)
    settle = round(1 / (cutoff_Hz * step))
    stretches = []
    for start, stop in zip(starts, [*starts[1:], n], strict=True):
        rows = slice(start + settle + cut, stop - settle + cut)
        if still[start] and (rows.stop - rows.start) * step >= shortest:
            stretches.append(rows)
    if not stretches:
        raise TrajectoryError(
            f"'{session.name}' holds no constant velocity of {shortest:g} s with accelerations below "
            f"{acceleration:g} m/s2; record runs at constant velocity, or raise the limit"
        )
    raw = session.trajectory
    q, tau = (raw[name].reshape(len(raw), -1) for name in (position, force))
    fits = [np.polyfit(raw.time[r] - raw.time[r].mean(), q[r], 1) for r in stretches]
    return Runs(
        np.array([fit[0] for fit in fits]),
        np.array([tau[r].mean(axis=0) for r in stretches]),
        np.full(len(stretches), pose),
        np.array([(r.stop - r.start) * step for r in stretches]),
        np.array([fit[1] for fit in fits]),
    )


def concatenate(runs: Sequence[Runs]) -> Runs:
    """Runs of several recordings as one, in their order. Raises ArgumentError for none.

    >>> one = gt.identify.Runs(np.array([[0.2]]), np.array([[190.0]]), np.array([0]), np.ones(1), np.zeros((1, 1)))
    >>> gt.identify.concatenate([one, one._replace(pose=np.array([1]))]).pose
    array([0, 1])
    """
    if not runs:
        raise ArgumentError("there are no runs; expected those of one recording or more", "runs")
    return Runs(*(np.concatenate(parts) for parts in zip(*runs, strict=True)))


def constant_velocity_log(
    velocities: Sequence[float],
    law: Callable[[Array], Array],
    mass: Array,
    *,
    seed: int,
    noise: float,
    quantisation: float = 1e-6,
    sample_time: float = 0.004,
    acceleration: float = 4.0,
    travel: float = 0.6,
    longest: float = 2.0,
    title: str = "",
) -> Session:
    """A SYNTHETIC log: all carts run forth and back at each velocity [m/s], between ramps.

    Args:
        law: velocity (rows, 1) [m/s] -> force (rows, carts) [N] at constant velocity, gravity included.
        mass: (carts,) felt while accelerating [kg].
        noise: standard deviation of the white noise of the forces [N], drawn from `seed`.
        quantisation: of the positions [m].
        sample_time: of the log [s].
        acceleration: of the ramps [m/s2].
        travel, longest: a run is so many metres long, but takes no longer than so many seconds.

    The trajectory has q [m] and force [N] and carries seed and noise in its `synthetic`. Raises ArgumentError for no
    velocities, and for numbers that are not above zero.

    >>> log = gt.identify.constant_velocity_log(
    ...     [0.2, 0.4], lambda v: 150.0 * np.sign(v) + 190.0 * v, np.array([30.0]), seed=1, noise=5.0
    ... )
    >>> log.trajectory.synthetic, log.trajectory["force"].shape
    ('seed 1, white force noise 5 N, positions in steps of 1e-06 m', (1904, 1))
    """
    above_zero = {"sample_time": sample_time, "acceleration": acceleration, "travel": travel, "longest": longest}
    for name, value in above_zero.items():
        if not (value > 0 and np.isfinite(value)):
            raise ArgumentError(f"expected a number above 0; found {value:g}", name)
    if not (len(velocities) and all(v > 0 and np.isfinite(v) for v in velocities)):
        each = ", ".join(f"{v:g}" for v in velocities) or "none"
        raise ArgumentError(f"expected one or more, above 0; found {each}", "velocities")
    if not noise >= 0:
        raise ArgumentError(f"expected 0 or more; found {noise:g}", "noise")
    pieces = []
    for speed in velocities:
        ramp = np.arange(0, speed, acceleration * sample_time)
        hold = np.full(round(min(longest, travel / speed) / sample_time), speed)
        there = np.concatenate([ramp, hold, ramp[::-1]])
        pieces += [there, -there]
    v = np.concatenate([*pieces, np.zeros(2)])
    a = np.gradient(v, sample_time)
    q = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * sample_time)])
    n, carts = len(v), len(mass)
    rng = np.random.default_rng(seed)
    force = law(v[:, None]) + a[:, None] * mass + rng.normal(0.0, noise, (n, carts))
    seen = np.round(q / quantisation) * quantisation if quantisation else q
    trajectory = Trajectory(
        sample_time * np.arange(n),
        {"q": np.repeat(seen[:, None], carts, axis=1), "force": force},
        {"q": "m", "force": "N"},
        title=title,
        synthetic=f"seed {seed}, white force noise {noise:g} N, positions in steps of {quantisation:g} m",
    )
    return Session(title or f"synthetic log, seed {seed}", trajectory, sample_time)
