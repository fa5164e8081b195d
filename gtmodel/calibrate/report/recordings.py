"""Whether the sessions of a calibration agree: the same fit of each."""

from __future__ import annotations

import numpy as np

from ...inference import BetweenRecordings, between_recordings
from ...lang import ModelError
from ...results import Estimate
from ..calibration import Calibration, calibrate

MOST = 12  # sessions that are fitted one by one


def between_sessions(c: Calibration) -> BetweenRecordings | None:
    """Parameters of the robot of which the sessions' own fits give disjoint intervals; None where they agree, and where
    fewer than two sessions determine any by themselves."""
    m = c.problem.measurements
    if m.sessions is None or not 2 <= len(m.session_names) <= MOST or c.estimate is None or c.problem.beside:
        return None
    own = [n for n in c.problem.unknowns.names if n.partition("[")[0] in c.problem.closure.flat.bindings]
    estimates: dict[str, Estimate] = {}
    for name in m.session_names:
        rows = np.array([s == name for s in m.sessions])
        try:
            e = calibrate(c.problem.on(m.part(rows)), cost=c.cost, start=c.problem.unknowns.named(c.x)).estimate
        except (ModelError, ValueError, np.linalg.LinAlgError):
            continue
        if e is not None and e.degrees_of_freedom > 0:
            estimates[name] = e
    return between_recordings(estimates, own) if len(estimates) > 1 and own else None
