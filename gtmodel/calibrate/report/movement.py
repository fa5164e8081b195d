"""Parameters that moved farther than expected for a known robot, and fits of few poses that drift along weakly
determined directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...inference import Identifiability, Prior
from ...lang import ModelError
from ..calibration import Calibration
from ..measurements import Measurements
from ..problem import CalibrationProblem

WIDTH = 3.0  # standard deviation of the priors, in expected sizes


def near_start(
    c: Calibration, kept: Measurements | None, fit: Callable[[CalibrationProblem], Calibration]
) -> tuple[Calibration, tuple[str, ...]]:
    """Refit with priors at the start values if poses do not close; returns the names of the unknowns that got one.

    Along a combination that the poses determine no better than prior knowledge, noise moves a fit by far more than a
    drawing is off, even to where two links coincide and the pose no longer follows from the actuators. A robot that
    took these poses is not there. All unknowns without a prior then get one, `WIDTH` times their expected size, which
    hardly moves what the poses determine. The refit is kept if more poses close, fitted or held out; their errors play
    no role.
    """
    p, u = c.problem, c.problem.unknowns
    known = all(n in p.measurements.noise for n in p.reading.places)
    if not c.status.ok or not len(c.x) or not known or p.implicit:
        return c, ()
    before = _lost(c, kept)
    if not before:
        return c, ()
    with_prior = {q.name for q in u.priors}
    free = [k for k, n in enumerate(u.names) if n not in with_prior]
    priors = tuple(Prior(u.names[k], float(u.start[k]), WIDTH * float(u.sizes[k])) for k in free)
    try:
        refit = fit(replace(p, unknowns=replace(u, priors=(*u.priors, *priors))))
    except (ModelError, ValueError):
        return c, ()
    if not refit.status.ok or _lost(refit, kept) >= before:
        return c, ()
    return refit, tuple(q.name for q in priors)


def _lost(c: Calibration, kept: Measurements | None) -> int:
    """Number of poses that do not close with the calibrated parameters."""
    lost = 0
    for m in (None, kept) if kept is not None else (None,):
        try:
            errors = c.positioning_errors(m)
        except (ModelError, ValueError, np.linalg.LinAlgError):
            continue
        lost += int(np.count_nonzero(np.any([np.isnan(e).any(axis=1) for e in errors.values()], axis=0)))
    return lost


OPEN = 1e-6  # undetermined share of a parameter's direction; less is round-off
FAR = 0.1  # of the largest length: far beyond the error of a tape measure
DOUBTFUL = 5.0  # standard deviations: a smaller movement is not significant
DRIFT = 15.0  # expected sizes along an undetermined combination: more than a plausible start error
ALONG = 0.7  # share of a movement along the combination, below which it is no drift
MOST_NAMED = 4
SMALL = 5e-3  # of the largest length: typical residuals of correctly read poses


def moved_too_far(c: Calibration) -> list[str]:
    """Sentences on implausible, significant movements of a known robot's parameters.

    The length that moved farthest, and norms of rows without a unit, such as a cart's travel per actuator's."""
    if c.estimate is None:
        return []
    u, x = c.problem.unknowns, c.x
    geometric = [k for k, n in enumerate(u.names) if n.partition("[")[0] in c.problem.closure.flat.bindings]
    lengths = [k for k in geometric if u.units[k] == "m" and u.names[k] in c.values]
    sentences, advice = [], "check the columns, the axes and the robot model"
    if lengths:
        size = max(abs(float(u.start[j])) for j in lengths)
        doubt = _doubt(c, size)
        k = max(lengths, key=lambda k: max(abs(x[k] - u.start[k]) - doubt[k], 0.0))
        change = float(x[k] - u.start[k])
        if abs(change) > max(FAR * size, doubt[k]):
            sentences.append(f"{u.names[k]} moved by {change:.3g} m from its start value: {advice}")
    before, after, unsure = c.problem.values(u.start), c.values, _doubt(c, max(map(abs, u.start), default=0.0))
    for row in dict.fromkeys(
        u.names[k].rpartition(",")[0] or u.names[k].partition("[")[0] for k in geometric if u.units[k] in ("", "1")
    ):
        members = [n for n in after if n == row or n.startswith((f"{row},", f"{row}["))]
        norms = [float(np.linalg.norm([values[n] for n in members])) for values in (before, after)]
        free = [unsure[k] for k in geometric if u.names[k] in members]
        if members and norms[0] > 0 and abs(norms[1] - norms[0]) > max(FAR * norms[0], *free):
            name = f"{row}]" if "[" in row and row not in after else row
            sentences.append(
                f"the length of {name} changed by a factor of {norms[1] / norms[0]:.3g}: check the units; {advice}"
            )
    return sentences


def drifted(c: Calibration, identifiability: Identifiability) -> list[str]:
    """Sentences on parameters that moved far together along a weakly determined or undetermined combination."""
    u = c.problem.unknowns
    changes = dict(zip(u.names, (c.x - u.start).tolist(), strict=True))
    scale = dict(zip(identifiability.names, identifiability.scale, strict=True))
    sentences = []
    for direction in (*identifiability.null, *identifiability.near):
        names = list(direction.weights)
        along = np.array([direction.weights[n] / scale[n] for n in names])
        movement = np.array([changes[n] / scale[n] for n in names])
        along /= np.linalg.norm(along)
        if abs(along @ movement) <= DRIFT or abs(along @ movement) < ALONG * np.linalg.norm(movement):
            continue
        sizes = [f"{n} by {changes[n]:.3g} {u.units[u.names.index(n)]}".rstrip() for n in names[:MOST_NAMED]]
        more = f" and {len(names) - MOST_NAMED} others" if len(names) > MOST_NAMED else ""
        determined = "do not determine" if np.isinf(direction.std) else "determine no better than prior knowledge"
        sentences.append(
            f"{', '.join(sizes)}{more} moved along a combination that the poses {determined}: many values fit "
            f"equally well; {'fix it' if len(names) == 1 else 'fix one of them'} or give a prior"
        )
    return list(dict.fromkeys(sentences))


def _doubt(c: Calibration, size: float) -> np.ndarray:
    """How far each unknown (n,) may have moved by noise; small if the residuals are too large for a robot of this size
    [m] to be noise."""
    assert c.estimate is not None
    rms = float(np.sqrt(np.mean(c.residuals**2))) if c.residuals.size else 0.0
    return DOUBTFUL * c.estimate.std * min(1.0, SMALL * size / rms if rms > 0 else 1.0)


def undetermined(c: Calibration, identifiability: Identifiability) -> str:
    """Sentence on undetermined parameters and the one that moved farthest relative to its expected size."""
    u = c.problem.unknowns
    names = [
        n for n, share in zip(identifiability.names, identifiability.determined_by, strict=True) if share < 1 - OPEN
    ]
    size = dict(zip(identifiability.names, identifiability.scale, strict=True))
    changes = {n: float(x - x0) for n, x, x0 in zip(u.names, c.x, u.start, strict=True) if n in names}
    sentence = "undetermined parameters have one of many values that fit equally well"
    if not changes:
        return sentence
    name = max(changes, key=lambda n: (abs(changes[n]) / size[n], n))
    unit = u.units[u.names.index(name)]
    return (
        f"{sentence}: among {len(names)} such parameters, {name} moved farthest, by {changes[name]:.3g} {unit}".rstrip()
    )
