"""Parameters that a calibration moved farther than a robot known before allows, and fits of few poses that slide along
what they hardly determine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...inference import Identifiability, Prior
from ...lang import ModelError
from ..calibration import Calibration
from ..measurements import Measurements
from ..problem import CalibrationProblem

WIDTH = 3.0  # expected sizes of each unknown: what a start value may be off without being held back


def near_start(
    c: Calibration, kept: Measurements | None, fit: Callable[[CalibrationProblem], Calibration]
) -> tuple[Calibration, tuple[str, ...]]:
    """The calibration, and the names of unknowns that got a prior at their start; none where all poses close as it is.

    Along a combination that the poses determine no better than it was known, noise moves a fit by many times of what a
    drawing is off, as far as to where two links come to coincide and the pose no longer follows from the actuators. A
    robot that took these poses is not there. Then all unknowns without a prior get one, `WIDTH` times their expected
    size: what the poses determine is hardly moved by it. It stays where fewer poses are lost so. Only whether poses
    close is looked at, held-out ones too, not their errors.
    """
    p, u = c.problem, c.problem.unknowns
    known = all(n in p.measurements.noise for n in p.reading.places)
    if not c.status.ok or not len(c.x) or not known or p.implicit:
        return c, ()
    before = _lost(c, kept)
    if not before:
        return c, ()
    had = {q.name for q in u.priors}
    free = [k for k, n in enumerate(u.names) if n not in had]
    own = tuple(Prior(u.names[k], float(u.start[k]), WIDTH * float(u.sizes[k])) for k in free)
    try:
        held = fit(replace(p, unknowns=replace(u, priors=(*u.priors, *own))))
    except (ModelError, ValueError):
        return c, ()
    if not held.status.ok or _lost(held, kept) >= before:
        return c, ()
    return held, tuple(q.name for q in own)


def _lost(c: Calibration, kept: Measurements | None) -> int:
    """How many poses do not close at the calibrated parameters."""
    lost = 0
    for m in (None, kept) if kept is not None else (None,):
        try:
            errors = c.positioning_errors(m)
        except (ModelError, ValueError, np.linalg.LinAlgError):
            continue
        lost += int(np.count_nonzero(np.any([np.isnan(e).any(axis=1) for e in errors.values()], axis=0)))
    return lost


OPEN = 1e-6  # share of a parameter's direction in what is undetermined; below is round-off
FAR = 0.1  # of the largest length: a tape measure does not err by that
DOUBTFUL = 5.0  # standard deviations: a parameter that moved by less may be where it was
DRIFT = 15.0  # expected sizes along an undetermined combination: farther than a start value is off
ALONG = 0.7  # of a movement: what goes elsewhere is no drift along the combination
MOST_NAMED = 4
SMALL = 5e-3  # of the largest length: residuals of poses that were read right, whose noise standard deviations rest on


def moved_too_far(c: Calibration) -> list[str]:
    """What moved where no correction of a robot known before would go, and farther than by its standard deviation: the
    length that moved farthest, and lengths of rows without a unit, such as a cart's travel per actuator's; a sentence
    each."""
    if c.estimate is None:
        return []
    u, x = c.problem.unknowns, c.x
    own = [k for k, n in enumerate(u.names) if n.partition("[")[0] in c.problem.closure.flat.bindings]
    lengths = [k for k in own if u.units[k] == "m" and u.names[k] in c.values]
    said, asked = [], "are the columns, axes and the robot those of the measurement?"
    if lengths:
        size = max(abs(float(u.start[j])) for j in lengths)
        doubt = _doubt(c, size)
        k = max(lengths, key=lambda k: max(abs(x[k] - u.start[k]) - doubt[k], 0.0))
        moved = float(x[k] - u.start[k])
        if abs(moved) > max(FAR * size, doubt[k]):
            said.append(f"{u.names[k]} moved by {moved:.3g} m from where it was: {asked}")
    before, after, unsure = c.problem.values(u.start), c.values, _doubt(c, max(map(abs, u.start), default=0.0))
    for row in dict.fromkeys(
        u.names[k].rpartition(",")[0] or u.names[k].partition("[")[0] for k in own if u.units[k] in ("", "1")
    ):
        members = [n for n in after if n == row or n.startswith((f"{row},", f"{row}["))]
        norms = [float(np.linalg.norm([values[n] for n in members])) for values in (before, after)]
        free = [unsure[k] for k in own if u.names[k] in members]
        if members and norms[0] > 0 and abs(norms[1] - norms[0]) > max(FAR * norms[0], *free):
            name = f"{row}]" if "[" in row and row not in after else row
            said.append(
                f"{name} became {norms[1] / norms[0]:.3g} times as long as it was; are the units right? {asked}"
            )
    return said


def drifted(c: Calibration, identifiability: Identifiability) -> list[str]:
    """Parameters that moved far together along a combination that the poses do not determine, or no better than it was
    known: a sentence for each such combination, with how far."""
    u = c.problem.unknowns
    moved = dict(zip(u.names, (c.x - u.start).tolist(), strict=True))
    scale = dict(zip(identifiability.names, identifiability.scale, strict=True))
    said = []
    for direction in (*identifiability.null, *identifiability.near):
        names = list(direction.weights)
        along = np.array([direction.weights[n] / scale[n] for n in names])
        own = np.array([moved[n] / scale[n] for n in names])
        along /= np.linalg.norm(along)
        if abs(along @ own) <= DRIFT or abs(along @ own) < ALONG * np.linalg.norm(own):
            continue
        sizes = [f"{n} by {moved[n]:.3g} {u.units[u.names.index(n)]}".rstrip() for n in names[:MOST_NAMED]]
        more = f" and {len(names) - MOST_NAMED} others" if len(names) > MOST_NAMED else ""
        determined = "do not determine" if np.isinf(direction.std) else "determine no better than it was known"
        said.append(
            f"{', '.join(sizes)}{more} moved along a combination that the poses {determined}: one of many values that "
            f"fit alike; {'fix it' if len(names) == 1 else 'fix one of them'} or give a prior"
        )
    return list(dict.fromkeys(said))


def _doubt(c: Calibration, size: float) -> np.ndarray:
    """How far each unknown (n,) may have moved by noise: what is determined badly moves far and predicts as well. Small
    where residuals are so large for a robot of this size [m] that they are no noise."""
    assert c.estimate is not None
    rms = float(np.sqrt(np.mean(c.residuals**2))) if c.residuals.size else 0.0
    return DOUBTFUL * c.estimate.std * min(1.0, SMALL * size / rms if rms > 0 else 1.0)


def undetermined(c: Calibration, identifiability: Identifiability) -> str:
    """What the poses leave open, and the parameter among it that moved farthest beside its expected size."""
    u = c.problem.unknowns
    names = [
        n for n, share in zip(identifiability.names, identifiability.determined_by, strict=True) if share < 1 - OPEN
    ]
    size = dict(zip(identifiability.names, identifiability.scale, strict=True))
    moved = {n: float(x - x0) for n, x, x0 in zip(u.names, c.x, u.start, strict=True) if n in names}
    sentence = "what is undetermined has a value that is one of many that fit alike"
    if not moved:
        return sentence
    name = max(moved, key=lambda n: (abs(moved[n]) / size[n], n))
    unit = u.units[u.names.index(name)]
    return (
        f"{sentence}: of {len(names)} parameters concerned, {name} moved farthest, by {moved[name]:.3g} {unit}".rstrip()
    )
