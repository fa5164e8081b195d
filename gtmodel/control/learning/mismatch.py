"""What a wrong model costs: the error of the Kalman filter of (7.21) against how far its model is off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from ...results import ArgumentError, Quantity, Row, SolveStatus, Study
from ...results.door import study_function
from .axis import tool_model
from .estimators import ToolEstimate, complementary_estimate, kalman_estimate, kinematic
from .kalman import most_likely_filter
from .law import RAMP
from .lifted import Array
from .measured_runs import check_judged
from .plants import SAMPLE_TIME
from .words import micrometres

OFF = (-0.2, -0.1, -0.06, -0.03, -0.01, 0.0, 0.01, 0.03, 0.06, 0.1, 0.2)  # of the tool's frequency
SLOW_CUTOFF = 2.63  # Hz, Dressler 2012, (7.18)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MismatchStudy(Study):
    """Errors of estimates of the tool, root mean squares over the fully corrected samples of one run."""

    off: Annotated[Sequence[float], "share by which the model's frequency differs from the tool's"] = ()
    kalman: Annotated[Sequence[float], Quantity("m", "error of the Kalman filter at each of these", written="um")] = ()
    normalised: Annotated[Sequence[float], "mean square of its innovations over what it expects, 1 where right"] = ()
    kinematics: Annotated[float, Quantity("m", "error of the motors alone", written="um")] = 0.0
    complementary: Annotated[float, Quantity("m", "error of the complementary filter", written="um")] = 0.0

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("motors alone", f"{1e6 * self.kinematics:.4g}", "um")]
        rows.append(Row("complementary filter", f"{1e6 * self.complementary:.4g}", "um"))
        return rows + [
            Row(f"Kalman filter, model {100 * d:+.0f} %", f"{1e6 * e:.4g}", "um")
            for d, e in zip(self.off, self.kalman, strict=True)
        ]


@study_function
def mismatch(
    run: Mapping[str, Any], frequency: float, damping: float, *, off: Sequence[float] = OFF, noise: float = 0.07,
    cutoff: float = SLOW_CUTOFF, ramp: int = RAMP, sample_time: float = SAMPLE_TIME, title: str = "",
) -> MismatchStudy:  # fmt: skip
    """How much an estimate of the tool errs, against how far the frequency of its model is off.

    Args:
        run: "motor" [m], "acceleration" [m/s2] and the true "tool" [m], each (N,), from rest; such as a synthetic one.
        frequency, damping: of the tool [Hz] and [1]. off: shares of the frequency. noise: of the accelerometer [m/s2].
        cutoff: of the complementary filter [Hz]. ramp: samples at either end that do not count.

    At each the filter's process noise is what makes its innovations most likely, without a look at the tool. Raises
    ArgumentError where signals are missing or of other lengths, and for numbers out of range.

    >>> learning = gt.control.learning
    >>> r = learning.SquarePath().samples(0.004)[:, 1]
    >>> run = {name: T(r) for name, T in learning.flexible_axis(11.5, 0.05).maps(825).items()}
    >>> run["acceleration"] = run["acceleration"] + 0.07 * np.random.default_rng(1).normal(size=825)
    >>> s = learning.mismatch(run, 11.5, 0.05, off=(0.0, 0.1))
    >>> s.kalman[0] < s.kalman[1] < s.complementary < s.kinematics
    True
    """
    missing = [name for name in ("motor", "acceleration", "tool") if name not in run]
    if missing:
        raise ArgumentError(f"has no {', '.join(missing)}; the errors are those of all three", "run")
    signals = {name: np.asarray(run[name], float) for name in ("motor", "acceleration", "tool")}
    size = len(signals["motor"])
    if any(x.shape != (size,) or not np.all(np.isfinite(x)) for x in signals.values()):
        raise ArgumentError("expected signals of one length, all of them finite", "run")
    check_judged(size, ramp, "run")
    if any(not d > -1 for d in off) or not len(off):
        raise ArgumentError("expected one share or more above -1", "off")
    corrected = slice(ramp, size - ramp)

    def error(estimate: ToolEstimate) -> float:
        return float(np.sqrt(np.mean((estimate(signals) - signals["tool"])[corrected] ** 2)))

    kalman, normalised = [], []
    for share in off:
        model = tool_model(frequency * (1 + share), damping, sample_time)
        filter = most_likely_filter(model, signals["motor"], signals["acceleration"], noise)
        kalman.append(error(kalman_estimate(size, filter)))
        normalised.append(float(np.mean(filter.innovations(signals["motor"], signals["acceleration"]) ** 2)))
    alone = error(kinematic(size))
    both = error(complementary_estimate(size, cutoff, sample_time))
    best = int(np.argmin(kalman))
    shown = title or "error of the estimate against mismatch of the model"
    return MismatchStudy(
        status=SolveStatus.SOLVED, title=shown,
        message=f"the Kalman filter errs by {micrometres(kalman[best])} where its model is off by "
        f"{100 * off[best]:+.0f} %, and by {micrometres(max(kalman))} at worst; the motors "
        f"alone by {micrometres(alone)}",
        figures={"mismatch": partial(_mismatch, np.array(off), np.array(kalman), alone, both, shown)},
        off=list(off), kalman=kalman, normalised=normalised, kinematics=alone, complementary=both,
    )  # fmt: skip


def _mismatch(off: Array, kalman: Array, alone: float, both: float, title: str) -> Any:
    from ...plot.learning import mismatch_figure

    return mismatch_figure(off, kalman, alone, both, title=title)
