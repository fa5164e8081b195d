"""What a calibration problem frees, ties and fixes; the variants of the thesis by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gtmodel.calibrate import Choice, Measurements, Problem, prepare
from gtmodel.calibrate.unknowns import Unknowns
from gtmodel.inference import Prior
from gtmodel.lang import Model, ModelError
from gtmodel.problem_files.base import InputError

from .calibration_keys import PriorKeys, Schema

QUATERNIONS = ("u1_2", "u1_3", "u2_3")
FAMILIES = {"ideal": "three_link", "modified": "three_link", "six_link": "six_link", "f1_unit": "f1", "f1_raw": "f1"}
SAID = {"three_link": "three links", "six_link": "six links", "f1": "an F1"}
KEYS = ("fixed", "tied", "unit_quaternions", "priors", "sizes", "free")


def family_of(model: Model) -> str:
    """three_link, six_link or f1 by the parameters that a model declares; "" for another mechanism."""
    if hasattr(model, "A0") and hasattr(model, "u1_2"):
        return "f1"
    A, v = (np.shape(getattr(model, n, ())) for n in "Av")
    if A == v == (6, 3) and hasattr(model, "B"):
        return "six_link"
    return "three_link" if A == v == (3, 3) else ""


def choice_of(problem: Schema, model: Model, on_points: Sequence[str] = ()) -> Choice:
    """Without priors; `on_points`: names of guideways through measured points, of which the frame moves.

    Raises InputError for a variant of another family.
    """
    tied, unit = dict(problem.tied), list(problem.unit_quaternions)
    if problem.variant is not None:
        wanted, found = FAMILIES[problem.variant], family_of(model)
        if wanted != found:
            raise InputError(
                f"'{problem.variant}' is for robots with {SAID[wanted]}; this one has {SAID.get(found, 'other parts')}",
                "variant",
            )
        if problem.variant == "ideal":
            tied = {"v[1]": "v[0]", "v[2]": "v[0]"} | tied
        if problem.variant == "f1_unit":
            unit += [n for n in QUATERNIONS if n not in unit]
    unit += [f"{g}.u" for g in on_points]
    sag = problem.measurements.sag if problem.measurements else None
    known = [f"{problem.measurements.position}.sag"] if (
        problem.measurements and sag is not None and sag.compliance_m_per_N != "estimate"
    ) else []  # fmt: skip
    fixed = [*problem.fixed, *known, *(f"{g}.{n}" for g in on_points for n in ("at", "points"))]
    return Choice(problem.free, fixed, tied, unit, (), problem.sizes)


def prepared(
    problem: Schema, model: Model, measurements: Measurements, actuators: str, on_points: Sequence[str] = ()
) -> Problem:
    """Raises InputError with the key whose name is not understood."""
    try:
        choice = choice_of(problem, model, on_points)
        first = prepare(model, measurements, choice, actuators=actuators)
        turn = problem.cart_points.turn_std_rad if problem.cart_points else None
        known = {f"{g}.u": PriorKeys(std=turn) for g in on_points} if turn is not None else {}
        if not problem.priors and not known:
            return first
        priors = _priors({**known, **problem.priors}, first.unknowns)
        return prepare(model, measurements, replace(choice, priors=priors), actuators=actuators)
    except (ModelError, ValueError) as error:
        raise InputError(str(error), _key(problem, str(error))) from error


def require_poses(p: Problem) -> None:
    """Raises InputError where a part of the robot has fewer equations than unknowns."""
    N = len(p.measurements)
    for b in p.lengths:
        names = [p.unknowns.names[k] for k in b.columns]
        priors = sum(prior.name in names for prior in p.unknowns.priors)
        if N * len(b.rows) + priors < len(names):
            least = -(-(len(names) - priors) // len(b.rows))
            raise InputError(
                f"{N} poses give {N * len(b.rows)} equations of {', '.join(p.labels[k] for k in b.rows)} for "
                f"{len(names)} unknowns ({names[0]} to {names[-1]}); measure at least {least} poses, better several "
                "times as many, or fix parameters",
                "measurements",
            )


def _priors(keys: Mapping[str, PriorKeys], u: Unknowns) -> list[Prior]:
    """One for each unknown of the named ones, at its start where no value is given. Raises InputError."""
    found: dict[str, Prior] = {}
    for name, prior in keys.items():
        begins = (name[:-1] + ",", f"{name} turned") if name.endswith("]") else (f"{name}[", f"{name} turned")
        hits = [k for k, n in enumerate(u.names) if n == name or n.startswith(begins)]
        if not hits:
            raise InputError(f"names '{name}', which is not free; these are {', '.join(u.names)}", "priors")
        if prior.value is not None and len(hits) > 1:
            raise InputError(f"one value for the {len(hits)} unknowns of '{name}'; leave it out, or name one of them",
                             f"priors.{name}")  # fmt: skip
        for k in hits:
            value = float(u.start[k]) if prior.value is None else prior.value
            found[u.names[k]] = Prior(u.names[k], value, prior.std)
    return list(found.values())


def _key(problem: Schema, sentence: str) -> str:
    for key in KEYS:
        if any(f"'{name}" in sentence for name in getattr(problem, key)):
            return key
    return "measurements"
