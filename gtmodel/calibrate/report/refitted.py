"""What a held-out recording has of its own, found again on a part of its poses, before it is judged on the rest."""

from __future__ import annotations

from dataclasses import replace

from ...lang import ModelError
from ...results import ArgumentError
from ..calibration import Calibration, calibrate
from ..choice import Choice
from ..measured.options import Refit
from ..measurements import Correction, Measurements
from ..problem import prepare
from ..unknowns import TURN

PLACES = {"offset": ".offset", "scale": ".scale", "device": ".device.", "target": ".target."}  # in names of parameters


def of_its_own(m: Measurements, refit: Refit, actuators: str) -> Measurements:
    """The poses with corrections of the actuators that are refitted, also where the fit knows none."""
    wanted = {what: True for what in ("offset", "scale") if what in refit.what}
    if not wanted:
        return m
    there = next((c for c in m.corrections if c.signal == actuators), Correction(actuators))
    others = [c for c in m.corrections if c.signal != actuators]
    return replace(m, corrections=(*others, replace(there, **wanted)))


def refitted(c: Calibration, m: Measurements, refit: Refit) -> Calibration:
    """The calibrated robot with what other measurements have of their own, fitted on these poses; all else stays.

    Raises ArgumentError where they have nothing of that kind, and where these poses do not determine it."""
    own = of_its_own(m, refit, c.problem.actuators)
    ending = c.problem.reading.ending  # of the names of what these measurements have, among several
    values = c.values | {name.replace(ending, ""): v for name, v in c.values.items() if ending and ending in name}
    try:
        free = prepare(c.flat, own, Choice(free=[]), actuators=c.problem.actuators, values=values)
        kinds = {name: next((k for k, p in PLACES.items() if p in name), "") for name in free.reading.parameters.names}
        lacking = [k for k in refit.what if k not in kinds.values()]
        if lacking:
            raise ArgumentError(f"the measurements have no {lacking[0]} of their own to refit", "refit.what")
        still = [name.partition(TURN)[0] for name, kind in kinds.items() if kind not in refit.what]
        problem = prepare(
            c.flat, own, Choice(free=[], fixed=still), actuators=c.problem.actuators, values=values,
        )  # fmt: skip
        own_fit = calibrate(problem, cost=c.cost)
    except ModelError as error:
        raise ArgumentError(str(error), "refit") from error
    if own_fit.identifiability is not None and own_fit.identifiability.redundant:
        left = own_fit.identifiability
        raise ArgumentError(
            f"{len(m)} poses determine {left.rank} of {len(own_fit.x)} values that are refitted", "refit"
        )
    return own_fit
