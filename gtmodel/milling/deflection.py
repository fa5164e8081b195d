"""How far the tool deflects while it cuts: the static index (18) and the dynamic one (19)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .cutter import Cut, Cutter, tooth_frequency
from .forces import mean_forces, peak_force, to_world
from .oscillators import Oscillators
from .response import responses

RATE = 20000.0  # samples per second at least
SECONDS = 2.0  # of cutting, from rest
SETTLE = 1.0  # the part of it that means leave out
PER_TOOTH = 40  # samples at least while one tooth follows another: fewer would alias the force
MOST = 3_000_000  # samples of a force: more is a speed or a duration in another unit


@dataclass(frozen=True, eq=False)
class Deflection:
    """Norm of the tool's displacement over time, by pose (n,) [m]: largest of all times, (19); mean and standard
    deviation once transients are gone; largest then."""

    peak: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    steady_peak: np.ndarray


def samples_per_turn(speed: float, teeth: int, seconds: float, rate: float = RATE) -> int:
    """Of the force at a spindle speed [1/s] over `seconds`: `rate` per second and 40 per tooth at least.

    Raises ValueError for a speed that is not positive, and for more than three million samples.
    """
    tooth_frequency(speed, teeth)
    turn = max(np.ceil(rate / speed - 1e-9), PER_TOOTH * teeth)
    if max(turn, turn * speed * seconds) > MOST:
        raise ValueError(
            f"{seconds:.4g} s of cutting at {60 * speed:g} rpm are {turn * speed * seconds:.2g} samples; expected "
            f"{MOST:.2g} at most: is the speed in turns per minute and the time in seconds?"
        )
    return int(turn)


def duration(speed: float, seconds: float = SECONDS, settle: float = SETTLE) -> float:
    """`seconds`, or longer where no whole turn at `speed` [1/s] follows after `settle` [s]."""
    return max(seconds, settle + 1 / speed)


def cutting_force(
    cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *, up: ArrayLike = (0.0, 0.0, 1.0),
    seconds: float = SECONDS, rate: float = RATE,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Force (t, 3) [N], world coordinates, and its step [s]: whole samples per turn, `rate` per second or more.

    Each sample is the mean over one step about it: no impulse is lost between samples, nor counted twice.
    speed [1/s]; feed (3), up (3): see `to_world`. Raises ValueError for impossible values.
    """
    if not (seconds > 0 and rate > 0):
        raise ValueError(f"found {seconds:g} s at {rate:g} samples per second; expected more than 0")
    turn = samples_per_turn(speed, cutter.teeth, seconds, rate)
    F = to_world(mean_forces(cutter, cut, 2 * np.pi * np.arange(turn) / turn, 2 * np.pi / turn), feed, up)
    step = 1 / (speed * turn)
    return F[np.arange(int(np.ceil(seconds / step)) + 1) % turn], step


def deflections(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), seconds: float = SECONDS, settle: float = SETTLE, rate: float = RATE,
    hold: str = "linear",
) -> Deflection:  # fmt: skip
    """Of every pose of the oscillators, from rest; the dynamic index (19) is `peak`.

    speed [1/s] of the spindle; settle [s] is left out of means, which are of whole turns. A spindle so slow that no
    turn follows is given the time of one turn more. Raises ValueError for impossible values.
    """
    if not 0 <= settle < seconds:
        raise ValueError(f"{settle:g} s of {seconds:g} s are left out; expected fewer")
    tooth_frequency(speed, cutter.teeth)
    seconds = duration(speed, seconds, settle)
    F, step = cutting_force(cutter, cut, speed, feed, up=up, seconds=seconds, rate=rate)
    turns = max(1, int((seconds - settle) * speed * (1 + 1e-9)))
    after = len(F) - turns * round(1 / (speed * step))
    found = np.empty((4, len(oscillators)))
    for pose, x in enumerate(responses(oscillators, F, step, hold=hold)):
        squared = np.einsum("ij,ij->i", x, x)
        late = np.sqrt(squared[after:])
        found[:, pose] = np.sqrt(squared.max()), late.mean(), late.std(), late.max()
    return Deflection(*found)


def static_index(
    compliance: ArrayLike, cutter: Cutter, cut: Cut, feed: ArrayLike, *, up: ArrayLike = (0.0, 0.0, 1.0)
) -> np.ndarray:
    """|K^-1 F_peak| (n,) [m], eq. (18), of translational compliances (n, 3, 3) [m/N] under the largest force.

    It knows no speed. Joint stiffness over-predicts measured deflections several times: for ranking poses.
    """
    F = to_world(peak_force(cutter, cut), feed, up)
    return np.linalg.norm(np.asarray(compliance, float) @ F, axis=-1)
