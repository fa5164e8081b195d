"""The search of a milling study over angles, places, feeds and speeds, and its recommendations in sentences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import takewhile
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..results import ArgumentError, Work
from ..results.work import never
from ..vibration import OscillatorField
from ..workers.mapped import mapped
from .deflection import Deflection
from .oscillators import Oscillators
from .task import MillingPlace, MillingTask, Refined, deflections_of, place_of, refined

HARMONICS = 5  # of the tooth frequency, compared with the modes
MATTERS = 1.2  # ratio of deflections above which the choice of model matters
NEAR_HZ = 5.0  # a mode nearer than this to a tooth harmonic decides the deflection


@dataclass(frozen=True)
class NearMode:
    """The natural mode nearest to a harmonic of the tooth frequency, in relative distance.

    axis: 0 to 2 for x to z. mode, tooth_frequency, distance [Hz]; the distance is positive for a harmonic above the
    mode.
    """

    axis: int
    mode: float
    harmonic: int
    tooth_frequency: float

    @property
    def distance(self) -> float:
        """Frequency of the harmonic minus frequency of the mode [Hz]."""
        return self.harmonic * self.tooth_frequency - self.mode

    @property
    def message(self) -> str:
        """Harmonic, distance and mode in words."""
        named = "the tooth frequency" if self.harmonic == 1 else f"{self.harmonic} times the tooth frequency"
        side = "above" if self.distance >= 0 else "below"
        return (f"{named}, {self.harmonic * self.tooth_frequency:.4g} Hz, is {abs(self.distance):.3g} Hz {side} the "
                f"mode along {'xyz'[self.axis]} at {self.mode:.3g} Hz")  # fmt: skip


def nearest_mode(oscillators: Oscillators, tooth_frequency: float, harmonics: int = HARMONICS) -> NearMode:
    """Return the natural mode of the first pose that is nearest to a harmonic, 1 to `harmonics`, of the tooth
    frequency [Hz].

    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> print(gt.milling.nearest_mode(robot, tooth_frequency=5.0).message)
    2 times the tooth frequency, 10 Hz, is 0.419 Hz below the mode along y at 10.4 Hz
    """
    f = oscillators.frequency[0]
    order = np.arange(1, harmonics + 1)
    gap = np.abs(order[:, None] * tooth_frequency - f) / f
    h, axis = np.unravel_index(np.argmin(gap), gap.shape)
    return NearMode(int(axis), float(f[axis]), int(order[h]), tooth_frequency)


def frequency_sensitivity(
    oscillators: Oscillators, index: Callable[[Oscillators], np.ndarray], hertz: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the relative change (n,) of an index of the poses with all natural frequencies `hertz` lower, and higher.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> def index(robot):
    ...     return gt.milling.deflections(robot, cutter, cut, speed=6.5, feed=[1.0, 0.0, 0.0]).peak
    >>> lower, higher = gt.milling.frequency_sensitivity(robot, index)
    >>> lower.round(1), higher.round(1)
    (array([-0.2]), array([0.6]))
    """
    now = index(oscillators)
    return index(oscillators.shifted(-hertz)) / now - 1, index(oscillators.shifted(hertz)) / now - 1


@dataclass(frozen=True, eq=False)
class Findings:
    """Results of a search at the declared speed.

    angles (n,) [rad]; static, dynamic (n,) [m]: indices at these angles, NaN if unknown. at_static, at_dynamic:
    oscillators of the static and the dynamic choice. speed [1/s], teeth: of the cut. change, change_static: relative
    change of the index of the dynamic and the static choice with all modes 1 Hz lower and higher. speeds [1/s]: all
    speeds tried, including the declared one; best_by_speed, static_by_speed [m]: the best index at each of them, and
    the index of the static choice. static_row: row chosen by another static model.
    """

    angles: np.ndarray
    static: np.ndarray
    dynamic: np.ndarray
    at_static: Oscillators
    at_dynamic: Oscillators
    speed: float
    teeth: int
    change: tuple[float, float]
    change_static: tuple[float, float]
    speeds: np.ndarray
    best_by_speed: np.ndarray
    static_by_speed: np.ndarray
    static_row: int | None = None

    @property
    def choices(self) -> tuple[int, int]:
        """Rows of the static choice (`static_row` unless None) and of the least dynamic index."""
        static, dynamic = choices(self.static, self.dynamic)
        return static if self.static_row is None else self.static_row, dynamic

    @property
    def ratio(self) -> float:
        """Dynamic index of the static choice over the dynamic index of the dynamic choice."""
        s, d = self.choices
        return float(self.dynamic[s] / self.dynamic[d])


def choices(static: ArrayLike, dynamic: ArrayLike) -> tuple[int, int]:
    """Return the rows of the least static and the least dynamic index, among rows where both are known.

    Raises ValueError if there is no such row.

    >>> gt.milling.choices(static=[3e-3, 1e-3, 2e-3, np.nan], dynamic=[2e-4, 3e-4, np.nan, 1e-4])
    (1, 0)
    """
    static, dynamic = np.asarray(static, float), np.asarray(dynamic, float)
    both = np.isfinite(static) & np.isfinite(dynamic)
    if not both.any():
        raise ValueError("no angle is both reachable and covered by the dynamic model")
    return int(np.argmin(np.where(both, static, np.inf))), int(np.argmin(np.where(both, dynamic, np.inf)))


def guideline(f: Findings) -> list[str]:
    """Return recommendations, a sentence each: which model to use, distance of the tooth harmonics from a mode at both
    choices, sensitivity of the deflection to the natural frequencies, gain from another speed.

    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> findings = gt.milling.Findings(
    ...     angles=np.radians([50.0, 110.0]), static=np.array([2e-3, 1e-3]), dynamic=np.array([1e-4, 3e-4]),
    ...     at_static=robot, at_dynamic=robot, speed=30.0, teeth=2, change=(0.1, -0.04), change_static=(0.3, 0.2),
    ...     speeds=np.array([30.0]), best_by_speed=np.array([1e-4]), static_by_speed=np.array([3e-4]),
    ... )
    >>> print(gt.milling.guideline(findings)[0])
    use the dynamic model: at 60 Hz its angle 50 deg deflects 0.1 mm, that of the static model, 110 deg, 0.3 mm, 3.00
    times as much
    """
    s, d = f.choices
    tooth = f.speed * f.teeth
    a_s, a_d = np.rad2deg(f.angles[[s, d]])
    x_s, x_d = 1e3 * f.dynamic[[s, d]]
    if f.ratio > MATTERS:
        model = (f"use the dynamic model: at {tooth:.4g} Hz its angle {a_d:.4g} deg deflects {x_d:.3g} mm, that of the "
                 f"static model, {a_s:.4g} deg, {x_s:.3g} mm, {f.ratio:.2f} times as much")  # fmt: skip
    else:
        model = (f"the static model will do: at {tooth:.4g} Hz its angle {a_s:.4g} deg deflects {x_s:.3g} mm, the best "
                 f"of the dynamic model, {a_d:.4g} deg, {x_d:.3g} mm")  # fmt: skip
    near_s, near_d = nearest_mode(f.at_static, tooth), nearest_mode(f.at_dynamic, tooth)
    sentences = [
        model,
        f"at the static choice {near_s.message}",
        f"at the dynamic choice {near_d.message}",
        f"modes 1 Hz lower or higher than modelled change the deflection by {_signed(f.change_static)} at the static "
        f"choice, by {_signed(f.change)} at the dynamic one",
    ]
    if min(_hertz_apart(f.at_static, tooth), _hertz_apart(f.at_dynamic, tooth)) < NEAR_HZ:
        sentences.append(
            f"a mode less than {NEAR_HZ:g} Hz from a tooth harmonic dominates: measure it in the chosen pose"
        )
    sentences.append(_speed(f, x_d))
    if len(f.speeds) > 1:
        best = int(np.argmin(f.static_by_speed))
        sentences.append(f"the static choice deflects least, {1e3 * f.static_by_speed[best]:.3g} mm, at "
                    f"{60 * f.speeds[best]:.4g} rpm")  # fmt: skip
    return sentences


def _hertz_apart(oscillators: Oscillators, tooth_frequency: float) -> float:
    """Return the least absolute distance [Hz] of a mode of the first pose from a harmonic."""
    order = np.arange(1, HARMONICS + 1)
    return float(np.abs(order[:, None] * tooth_frequency - oscillators.frequency[0]).min())


def _signed(change: tuple[float, float]) -> str:
    return " or ".join(f"{100 * x:+.0f} %" for x in change)


def _speed(f: Findings, now: float) -> str:
    """Return the sentence about the gain from another speed."""
    if len(f.speeds) < 2:
        return "no other speed was tried"
    best = int(np.argmin(f.best_by_speed))
    least = 1e3 * f.best_by_speed[best]
    if np.isclose(f.speeds[best], f.speed) or least >= now:
        return f"none of {len(f.speeds)} speeds deflects less than the declared {60 * f.speed:.4g} rpm"
    return (f"at {60 * f.speeds[best]:.4g} rpm ({f.teeth * f.speeds[best]:.4g} Hz) the best angle deflects "
            f"{least:.3g} mm instead of {now:.3g} mm: the speed gains {100 * (1 - least / now):.0f} %")  # fmt: skip


@dataclass
class AngleSearch:
    """Results of the search for the report."""

    task: MillingTask
    place: MillingPlace
    deflection: Deflection | None = None
    peak: np.ndarray = field(default_factory=lambda: np.zeros(0))
    angle: float = np.nan
    index: float = np.nan
    refined: list[Refined] = field(default_factory=list)
    freed: Refined | None = None
    combinations: list[dict[str, Any]] = field(default_factory=list)
    findings: Findings | None = None
    guideline: list[str] = field(default_factory=list)


def search(work: Work, f: AngleSearch) -> None:
    """Compute the dynamic index of all combinations, the refinement and the guideline."""
    task, place = f.task, f.place
    dynamics = place.dynamics
    assert dynamics is not None
    f.deflection = deflections_of(task, dynamics.oscillators)
    f.peak = place.spread(f.deflection.peak)
    s_row, d_row = choices(place.static, f.peak)
    angles = place.sweep.angles
    choice = task.search.static_choice
    if choice is not None:
        s_row = int(dynamics.rows[np.argmin(np.abs(angles[dynamics.rows] - choice))])
        if abs(angles[s_row] - choice) > angles[1] - angles[0]:
            message = f"is {np.rad2deg(choice):g}; expected a reachable angle with known dynamics"
            raise ArgumentError(message, "search.static_choice")
    work.progress("refining the angle", 0.4)
    try:
        f.refined = refined(task, place, f.peak)
        if task.search.speed_range is not None:
            low, high = task.search.speed_range
            if low >= high:
                message = f"is {60 * low:g} to {60 * high:g} rpm; expected the lower speed first"
                raise ArgumentError(message, "search.speed_range")
            candidates = refined(task, place, f.peak, (low, high))
            f.freed = min(candidates, key=lambda better: better.peak, default=None)
    except ArgumentError:
        raise
    except ValueError as error:
        raise ArgumentError(str(error), "search") from error
    f.angle, f.index = float(angles[d_row]), float(f.peak[d_row])
    for better in f.refined:
        if better.peak < f.index:
            f.angle, f.index = better.angle, better.peak
    work.progress("comparing speeds", 0.6)
    by_speed = _combinations(work, f, int(np.flatnonzero(dynamics.rows == s_row)[0]))
    at_static, at_dynamic = dynamics.at(float(angles[s_row])), dynamics.at(f.angle)
    both = Oscillators.concatenate([at_dynamic, at_static])
    lower, higher = frequency_sensitivity(both, lambda oscillators: deflections_of(task, oscillators).peak)
    speeds, best, static = np.array(by_speed).reshape(-1, 3).T
    f.findings = Findings(
        angles, place.static, f.peak, at_static, at_dynamic, task.speed, task.cutter.teeth,
        (float(lower[0]), float(higher[0])), (float(lower[1]), float(higher[1])), speeds, best, static,
        None if choice is None else s_row,
    )  # fmt: skip
    f.guideline = guideline(f.findings)


def _combinations(work: Work, f: AngleSearch, static: int) -> list[tuple[float, float, float]]:
    """Fill `combinations`; return speed, least index and index of row `static` at the declared place and feed."""
    task = f.task
    entries, by_speed = _at(task, f.place, task.place, static, f.deflection, work.interrupted)
    f.combinations += entries

    def here(where: Sequence[float]) -> list[dict[str, Any]]:
        return _elsewhere(task, where, work.interrupted)

    places = takewhile(lambda _: not work.interrupted(), task.search.places)
    for entries in mapped(partial(_elsewhere, task), places, here=here, waiting=work.interrupted):
        f.combinations += entries
    return by_speed


def _elsewhere(
    task: MillingTask, where: Sequence[float], stop: Callable[[], bool] = never
) -> list[dict[str, Any]]:  # fmt: skip
    try:
        return _at(task, place_of(task, where), where, 0, None, stop)[0]
    except ArgumentError as error:
        if error.argument != "place" and not (error.argument == "dynamics" and isinstance(task.given, OscillatorField)):
            raise
        return [{"place_m": where, "reason": error.message}]


def _at(
    task: MillingTask, place: MillingPlace, where: Sequence[float], static: int, first: Deflection | None,
    stop: Callable[[], bool],
) -> tuple[list[dict[str, Any]], list[tuple[float, float, float]]]:  # fmt: skip
    """Return the least index at one place by feed and speed, and the speeds of the first feed as `_combinations`.

    first: deflection of the first feed and speed, if it is known.
    """
    s, entries, by_speed = task.search, list[dict[str, Any]](), list[tuple[float, float, float]]()
    dynamics = place.dynamics
    assert dynamics is not None
    for n, feed in enumerate([task.feed.tolist(), *s.feed_directions]):
        for v, speed in enumerate([task.speed, *s.speeds]):
            if stop():
                return entries, by_speed
            known = n == v == 0 and first is not None
            result = first if known else deflections_of(task, dynamics.oscillators, speed=speed, feed=feed)
            assert result is not None
            best = int(np.argmin(result.peak))
            angle = float(np.rad2deg(place.sweep.angles[dynamics.rows[best]]))
            entries.append({"place_m": where, "feed_direction": feed, "speed_rpm": 60 * speed,
                            "index_mm": 1e3 * float(result.peak[best]), "angle_deg": angle})  # fmt: skip
            if n == 0:
                by_speed.append((speed, float(result.peak[best]), float(result.peak[static])))
    return entries, by_speed
