"""Errors that offsets explain: a robot that was homed anew, a device that was moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...measurements.inspection.residual_tests import explained_by
from ...results.suspicion import FIRST
from ..problem import CalibrationProblem

MOST = 0.5  # of the squared errors: offsets that explain less are not what the errors are
COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


@dataclass(frozen=True, eq=False)
class Shift:
    """Offsets of a signal, one row (k,) per session, and the `share` of the squared length errors that they explain."""

    signal: str
    sessions: tuple[str, ...]
    offsets: np.ndarray
    units: tuple[str, ...]
    share: float
    actuators: bool

    @property
    def message(self) -> str:
        number = self.offsets.size
        sizes = ", ".join(f"{x:.3g}" for x in self.offsets.reshape(-1)[:8]) + (", ..." if number > 8 else "")
        counted = COUNTS[number] if number < len(COUNTS) else str(number)
        of = f"offset{'s' if number > 1 else ''} of {self.signal}"
        per = f" in {len(self.sessions)} sessions" if len(self.sessions) > 1 else ""
        unit = f" {self.units[0]}" if len(set(self.units)) == 1 and self.units[0] not in ("", "1") else ""
        asked = "was the robot homed anew?" if self.actuators else "was the device moved?"
        return (
            f"{counted} {of}{per} ({sizes}{unit}) explain {100 * self.share:.0f} % of the squared error; {asked} Then "
            f"estimate them: {'offset' if self.actuators else 'frame'} of {self.signal} per session"
        )


def shift_of(problem: CalibrationProblem, x: np.ndarray, refitted: bool, position: str = "T") -> Shift | None:
    """The offsets of actuators or position, per session, that explain most of the length errors at x, if that is more
    than half and beyond chance.

    `refitted`: whether these poses were fitted, so that the unknowns, too, may move; to the first order.
    """
    if problem.implicit:
        return None
    r = problem.residuals(x).reshape(-1)
    J, By, _ = problem.all_jacobians("length", x)
    free = J.reshape(len(r), -1) if refitted else np.zeros((len(r), 0))
    m, best = problem.measurements, None
    names = m.session_names
    sessions = np.array(m.sessions if m.sessions is not None else [""] * len(m))
    for signal in (problem.actuators, position):
        if signal not in problem.reading.places:
            continue
        own = By[:, :, problem.reading.places[signal]]
        each = np.concatenate([own * (sessions == s)[:, None, None] for s in names], axis=2).reshape(len(r), -1)
        test = explained_by(free, r, each)
        share = 1 - test.rest / (test.F * test.more + test.rest)
        if not (share > MOST and test.p < FIRST):
            continue
        if best is None or share > best.share:
            offsets = np.linalg.lstsq(np.hstack([free, each]), -r, rcond=None)[0][free.shape[1] :]
            units = tuple(problem.closure.flat.variables[k].unit or "" for k in _indices(problem, signal))
            rows = -offsets.reshape(len(names), -1)  # of the reading, as Correction counts them
            best = Shift(signal, names, rows, units, float(share), signal == problem.actuators)
    return best


def _indices(problem: CalibrationProblem, signal: str) -> list[int]:
    _, indices, _ = problem.closure.flat.lookup(signal)
    return list(indices)
