"""Filters by name: all have the same interface, so changing the name changes the filter."""

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
    """Make a filter by its name.

    "kf": Kalman filter of a linear system. "ekf": extended error-state filter. "iekf": the same with three
    linearisations per instant. "ukf": unscented. "imm": interacting models, for a list of systems. "particle": particle
    filter with the linearised optimal proposal. "steady": constant gain. "additive": quaternions as four numbers, for
    comparison.

    Args:
        name: one of these.
        system: process and sensors; for "imm" a list of them.
        options: of the filter's class, such as `particles=4000`.

    Raises ArgumentError for an unknown name or option, and if the filter does not support the system.

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
            "the complementary filter has no noise model and takes two signals, not a system: call "
            "gt.filtering.complementary(slow, acceleration, cutoff)",
            "name",
        )
    if name not in FILTERS:
        known = ", ".join(f"'{n}'" for n in FILTERS)
        raise ArgumentError(f"there is no filter '{name}'; expected one of {known}", "name")
    several = not isinstance(system, System)
    if several != (name == "imm"):
        sentence = f"'{name}' takes one system; use 'imm' for several" if several else "'imm' takes a list of systems"
        raise ArgumentError(sentence, "system")
    cls = FILTERS[name]
    named = [n for n in signature(ErrorState if cls is kalman else cls).parameters if n not in ("system", "systems")]
    for option in options:
        if option not in named:
            known = ", ".join(f"'{n}'" for n in named)
            raise ArgumentError(f"'{name}' has no option '{option}'; it has {known}", option)
    if name == "additive" and "quaternions" not in options:
        raise ArgumentError("name the states that are quaternions, such as quaternions=['Q']", "quaternions")
    return cls(system, **options)
