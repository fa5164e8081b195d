"""Priors that the measured poses contradict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...inference import noise_size
from ...lang import ModelError
from ..calibration import Calibration, calibrate
from .intervals import WEAK

FAR = 5.0  # standard deviations of prior and fit together
MOST = 3  # are named
STEPS = 40  # of the fit without priors, from the one with them: what needs more is not determined without


def contradicted_priors(c: Calibration) -> list[str]:
    """Sentences on priors far from what the poses say without any, the farthest first; none where residuals are as
    large as the noise, or the poses alone do not determine them, or so weakly that no interval would be given."""
    u = c.problem.unknowns
    if not u.priors or (c.estimate is not None and (c.estimate.noise <= 1 or noise_size(c.estimate).passed)):
        return []
    try:
        without = replace(c.problem, unknowns=replace(u, priors=()))
        alone = calibrate(without, cost=c.cost, start=u.named(c.x), limit=STEPS).estimate
    except (ModelError, ValueError, np.linalg.LinAlgError):
        return []
    if alone is None:
        return []
    contradictions: list[tuple[float, str]] = []
    for prior in u.priors:
        k = u.names.index(prior.name)
        std = float(alone.std[k])
        off = abs(float(alone.values[k]) - prior.value) / float(np.hypot(prior.std, std))
        if std <= WEAK * u.sizes[k] and off > FAR:
            unit = u.units[k] or "1"
            poses = f"which give {alone.values[k]:.6g} +- {std:.2g} without priors; correct or widen it"
            known = f"the prior {prior.name} = {prior.value:g} {unit} +- {prior.std:g}"
            contradictions.append((off, f"{known} contradicts the poses, {poses}"))
    return [sentence for _, sentence in sorted(contradictions, key=lambda pair: -pair[0])[:MOST]]
