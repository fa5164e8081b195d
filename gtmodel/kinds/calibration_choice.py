"""What a calibration problem frees, ties and fixes; the variants of the thesis by name."""

from __future__ import annotations

import numpy as np

from gtmodel.calibrate import Choice, Measurements, Problem, prepare
from gtmodel.compiler.causal import flat_of
from gtmodel.inference import Prior
from gtmodel.lang import Model, ModelError

from .base import InputError
from .calibration_keys import Schema

QUATERNIONS = ("u1_2", "u1_3", "u2_3")
FAMILIES = {"ideal": "three_link", "modified": "three_link", "six_link": "six_link", "f1_unit": "f1", "f1_raw": "f1"}
SAID = {"three_link": "three links", "six_link": "six links", "f1": "an F1"}
KEYS = ("fixed", "tied", "unit_quaternions", "priors", "sizes", "free")


def family_of(model: Model) -> str:
    """three_link, six_link or f1 by the parameters that a model declares; "" for another mechanism."""
    if hasattr(model, "A0") and hasattr(model, "u1_2"):
        return "f1"
    A = np.shape(getattr(model, "A", None))
    if A == (6, 3) and hasattr(model, "B"):
        return "six_link"
    return "three_link" if A == (3, 3) and np.shape(getattr(model, "v", None)) == (3, 3) else ""


def choice_of(problem: Schema, model: Model) -> Choice:
    """Raises InputError for a variant of another family and for priors of unknown parameters."""
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
    own = {q.name: q.value for q in flat_of(model).parameters}
    priors = []
    for name, prior in problem.priors.items():
        value = prior.value if prior.value is not None else own.get(name)
        if value is None:
            raise InputError(f"'{name}' has no value of its own; give the prior's", f"priors.{name}")
        priors.append(Prior(name, value, prior.std))
    return Choice(problem.free, problem.fixed, tied, unit, priors, problem.sizes)


def prepared(problem: Schema, model: Model, measurements: Measurements, actuators: str) -> Problem:
    """Raises InputError with the key whose name is not understood."""
    try:
        return prepare(model, measurements, choice_of(problem, model), actuators=actuators)
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


def _key(problem: Schema, sentence: str) -> str:
    for key in KEYS:
        if any(f"'{name}" in sentence for name in getattr(problem, key)):
            return key
    return "measurements"
