"""Filters by name: one interface, so that one is exchanged for another by a word."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from inspect import signature
from typing import Any

from ...results.refusal import ArgumentError
from ..error_state import ErrorState, Filter, kalman
from ..system import System
from .interacting import Interacting
from .kalman import AdditiveQuaternion, SteadyState, Unscented
from .particle import ParticleFilter

FILTERS: dict[str, Callable[..., Filter]] = {
    "kf": kalman,
    "ekf": ErrorState,
    "iekf": partial(ErrorState, iterations=3),
    "ukf": Unscented,
    "imm": Interacting,
    "particle": ParticleFilter,
    "steady": SteadyState,
    "additive": AdditiveQuaternion,
}


def make(name: str, system: System | Sequence[System], **options: Any) -> Filter:
    """A filter by its name.

    "kf": Kalman's, of a linear system. "ekf": extended, of the error of the state. "iekf": the same, linearised anew
    three times at each instant. "ukf": unscented. "imm": interacting models, of a list of systems. "particle": with the
    linearised optimal proposal. "steady": constant gain. "additive": quaternions as four numbers, for comparison.

    Args:
        name: one of these.
        system: process and sensors; of "imm" a list of them.
        options: of the filter's class, such as `particles=4000`.

    Raises ArgumentError for a name or an option that is not there, and where the filter cannot be had of this system.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> log = {"tape": gt.filtering.Readings(0.1 * np.arange(30), np.ones(30))}
    >>> start = gt.filtering.InitialState({}, {"x": 1.0})
    >>> for name in ("kf", "ekf", "ukf"):
    ...     print(name, gt.filtering.make(name, system).run(log, start)["x"][-1].round(6))
    kf 1.0
    ekf 1.0
    ukf 1.0
    """
    if name == "complementary":
        raise ArgumentError(
            "the complementary filter has no model of noise and takes two signals, not a system: "
            "gt.filtering.complementary(slow, acceleration, cutoff)",
            "name",
        )
    if name not in FILTERS:
        there = ", ".join(f"'{n}'" for n in FILTERS)
        raise ArgumentError(f"there is no filter '{name}'; there are {there}", "name")
    several = not isinstance(system, System)
    if several != (name == "imm"):
        sentence = f"'{name}' takes one system; take 'imm' for several" if several else "'imm' takes a list of systems"
        raise ArgumentError(sentence, "system")
    made = FILTERS[name]
    named = [n for n in signature(ErrorState if made is kalman else made).parameters if n not in ("system", "systems")]
    for option in options:
        if option not in named:
            there = ", ".join(f"'{n}'" for n in named)
            raise ArgumentError(f"'{name}' has no option '{option}'; it has {there}", option)
    if name == "additive" and "quaternions" not in options:
        raise ArgumentError("name the states of four numbers: quaternions=['Q']", "quaternions")
    return made(system, **options)
