"""Constant-velocity runs: detection in a log, and synthetic logs of them."""

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

    `velocity` (runs, carts) [m/s], mean `force` (runs, carts) [N], `pose` (runs,) index from 0, `seconds` (runs,) the
    duration, `position` (runs, carts) at the middle of the run [m].
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
    """Find the runs of a log: intervals in which all carts move and none accelerates.

    `position` [m] and `force` [N] are names of the signals, (n,) or (n, carts); `pose` is the index of the pose of the
    log. Rows count while every acceleration, low-passed at `cutoff_Hz`, is below `acceleration` [m/s2] in size and
    every velocity above `slow` [m/s]. The settling time of the filter is cut off both ends; the rest must last
    `shortest` [s] or more. The velocity of a run is the slope of a straight line through its positions, its force the
    mean, both from unfiltered rows.

    Raises TrajectoryError if there is no run.

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
    steady = np.asarray((np.abs(a) < acceleration).all(axis=1) & (np.abs(v) > slow).all(axis=1))
    # a sign change ends a run, however slow it is
    border = np.concatenate([[True], (np.sign(v[1:]) != np.sign(v[:-1])).any(axis=1) | (steady[1:] != steady[:-1])])
    starts = np.flatnonzero(border)
    settle = round(1 / (cutoff_Hz * step))
    runs = []
    for start, stop in zip(starts, [*starts[1:], n], strict=True):
        rows = slice(start + settle + cut, stop - settle + cut)
        if steady[start] and (rows.stop - rows.start) * step >= shortest:
            runs.append(rows)
    if not runs:
        raise TrajectoryError(
            f"'{session.name}' has no run of {shortest:g} s at constant velocity with accelerations below "
            f"{acceleration:g} m/s2; record such runs, or raise the limit"
        )
    raw = session.trajectory
    q, tau = (raw[name].reshape(len(raw), -1) for name in (position, force))
    fits = [np.polyfit(raw.time[r] - raw.time[r].mean(), q[r], 1) for r in runs]
    return Runs(
        np.array([fit[0] for fit in fits]),
        np.array([tau[r].mean(axis=0) for r in runs]),
        np.full(len(runs), pose),
        np.array([(r.stop - r.start) * step for r in runs]),
        np.array([fit[1] for fit in fits]),
    )


def concatenate(runs: Sequence[Runs]) -> Runs:
    """Concatenate the runs of several recordings. Raises ArgumentError for none.

    >>> one = gt.identify.Runs(np.array([[0.2]]), np.array([[190.0]]), np.array([0]), np.ones(1), np.zeros((1, 1)))
    >>> gt.identify.concatenate([one, one._replace(pose=np.array([1]))]).pose
    array([0, 1])
    """
    if not runs:
        raise ArgumentError("there are no runs; expected those of at least one recording", "runs")
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
    """Return a SYNTHETIC log: all carts run back and forth at each velocity [m/s], with ramps between runs.

    Args:
        law: velocity (rows, 1) [m/s] -> force (rows, carts) [N] at constant velocity, gravity included.
        mass: (carts,) inertia in the ramps [kg].
        noise: standard deviation of the white noise of the forces [N], drawn from `seed`.
        quantisation: of the positions [m].
        sample_time: of the log [s].
        acceleration: of the ramps [m/s2].
        travel, longest: length of a run in metres, and upper limit of its duration in seconds.

    The trajectory has q [m] and force [N]; its `synthetic` note has seed and noise. Raises ArgumentError for no
    velocities, and for numbers that are not positive.

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
        listing = ", ".join(f"{v:g}" for v in velocities) or "none"
        raise ArgumentError(f"expected one or more, above 0; found {listing}", "velocities")
    if not noise >= 0:
        raise ArgumentError(f"expected 0 or more; found {noise:g}", "noise")
    pieces = []
    for speed in velocities:
        ramp = np.arange(0, speed, acceleration * sample_time)
        hold = np.full(round(min(longest, travel / speed) / sample_time), speed)
        forwards = np.concatenate([ramp, hold, ramp[::-1]])
        pieces += [forwards, -forwards]
    v = np.concatenate([*pieces, np.zeros(2)])
    a = np.gradient(v, sample_time)
    q = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * sample_time)])
    n, carts = len(v), len(mass)
    rng = np.random.default_rng(seed)
    force = law(v[:, None]) + a[:, None] * mass + rng.normal(0.0, noise, (n, carts))
    quantised = np.round(q / quantisation) * quantisation if quantisation else q
    trajectory = Trajectory(
        sample_time * np.arange(n),
        {"q": np.repeat(quantised[:, None], carts, axis=1), "force": force},
        {"q": "m", "force": "N"},
        title=title,
        synthetic=f"seed {seed}, white force noise {noise:g} N, positions in steps of {quantisation:g} m",
    )
    return Session(title or f"synthetic log, seed {seed}", trajectory, sample_time)
