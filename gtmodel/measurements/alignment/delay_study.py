"""The delay study: estimates the delay between two signals of the same motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from ...results import ArgumentError, Check, Quantity, Row, SolveStatus, Study, Work, at_least, at_most
from ...results.disk import MadeFiles
from ...results.estimate import Estimate
from ...results.refusal import naming
from ...results.study import to_inherit
from ...results.trajectory import Trajectory
from ...results.work import WorkOptions, study_function
from .align import Alignment, align
from .options import Search, SyntheticDelay, made_pair

RELATED = 0.99  # least explained share of the variance; below it the signals hardly show the same motion
TRUTH = 3.3  # standard deviations; by chance one synthetic recording in a thousand exceeds them


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DelayStudy(Study):
    """Delay of each pair of signals, positive if the second signal is late; empty if the study was stopped early."""

    pairs: Annotated[Sequence[str], "names of the pairs, in the order of the other lists"] = ()
    delay: Annotated[Sequence[float], Quantity("s", "delay of the second signal of each pair")] = ()
    delay_interval: Annotated[Sequence[Sequence[float]], Quantity("s", "95 % intervals")] = ()
    drift: Annotated[
        Sequence[float] | None, Quantity("1", "relative rate by which the second clock runs slow, if estimated")
    ] = None
    drift_interval: Annotated[Sequence[Sequence[float]] | None, Quantity("1", "95 % intervals")] = None
    scale: Annotated[Sequence[float], "ratio of the second signal to the first"] = ()
    explained: Annotated[
        Sequence[float], "share of the variance that the common curve explains; the smaller one of the two signals"
    ] = ()
    coloured: Annotated[Sequence[bool], "whether the residuals are coloured; the intervals then allow for it"] = ()
    synthetic: Annotated[str | None, "seed and noise of a synthetic recording; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = []
        for k, name in enumerate(self.pairs):
            low, high = (1e3 * x for x in self.delay_interval[k])
            rows.append(Row(f"delay of {name}", f"{1e3 * self.delay[k]:.4g}  ({low:.4g} .. {high:.4g}, 95 %)", "ms"))
            if self.drift is not None and self.drift_interval is not None:
                low, high = (1e6 * x for x in self.drift_interval[k])
                rows.append(
                    Row(f"drift of {name}", f"{1e6 * self.drift[k]:.3g}  ({low:.3g} .. {high:.3g}, 95 %)", "ppm")
                )
            rows.append(Row(f"explained of {name}", f"{100 * self.explained[k]:.5g}", "%"))
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])


@study_function
def delay_study(
    recordings: Mapping[str, tuple[Trajectory, Trajectory]] | SyntheticDelay,
    search: Search | None = None,
    **work_options: Unpack[WorkOptions],
) -> DelayStudy:
    """Estimate the delay between two signals of the same motion, with intervals and a test of the residuals.

    Args:
        recordings: name -> reference and late recording, each with one signal in the same unit; rows may be uneven. Or
            the options of a synthetic pair.
        search: search range, and which other parameters are estimated; default: +-50 ms, with scale and shift.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    The delay is defined by late(t) = scale reference(t - delay) + shift. See `align` for the method. Raises
    ArgumentError if units differ, if a signal does not vary, and if the signals agree at no delay or at several.

    >>> options = gt.measurements.SyntheticDelay(delay=0.003, duration=4.0)
    >>> s = gt.measurements.delay_study(options)
    >>> low, high = s.interval("synthetic")
    >>> low < 0.003 < high, round(1e3 * s.delay[0], 1)  # ms
    (True, 3.0)
    """
    work = Work(**work_options)
    search = search or Search()
    truth = recordings if isinstance(recordings, SyntheticDelay) else None
    pairs = {"synthetic": made_pair(recordings)} if isinstance(recordings, SyntheticDelay) else dict(recordings)
    if not pairs:
        raise ArgumentError("there is no pair of signals; expected at least one", "recordings")
    fits = dict[str, Alignment]()
    for n, (name, (first, late)) in enumerate(pairs.items()):
        work.step(f"delay of {name}", n / len(pairs))
        if len(first.names) != 1 or len(late.names) != 1:
            raise ArgumentError(f"a recording of '{name}' does not have exactly one signal", f"recordings.{name}")
        with naming(f"recordings.{name}", before=f"{name}: "):
            fits[name] = align(
                first, late, {first.names[0]: late.names[0]}, drift=search.drift, scale=search.scale,
                shift=search.shift, within=(-search.longest, search.longest),
            )  # fmt: skip
    note = next((t.synthetic for pair in pairs.values() for t in pair if t.synthetic), None)
    return _study(fits, search, truth, work.title, note)


def _study(
    fits: Mapping[str, Alignment], search: Search, truth: SyntheticDelay | None, title: str, note: str | None
) -> DelayStudy:
    delay = [-f.offset for f in fits.values()]
    std = np.array([f.estimate.std[0] for f in fits.values()])
    degrees_of_freedom = min(f.estimate.degrees_of_freedom for f in fits.values())
    estimate = Estimate(
        tuple(fits), np.array(delay), np.diag(std**2), degrees_of_freedom, 1.0, False,
        np.concatenate([f.estimate.residuals for f in fits.values()]), (), units=("s",) * len(fits),
    )  # fmt: skip
    intervals = [list(estimate.interval(name)) for name in fits]
    checks = {"explained": at_least(
        min(f.explained for f in fits.values()), RELATED,
        "look at the residuals in the picture: the second signal is more than a delayed copy of the first",
    ), "delay_s": at_most(
        float(np.max(np.abs(delay))), search.longest, "raise search.longest_delay_s: the delay is beyond the range",
    )}  # fmt: skip
    if truth is not None:
        checks["true_delay"] = Check(abs(delay[0] - truth.delay) / float(std[0]), TRUTH, "the interval is too narrow")
    message = ", ".join(f"{name} {1e3 * d:.3g} ms late" for name, d in zip(fits, delay, strict=True))
    drifts: dict[str, Any] = {}
    if search.drift:
        drifts["drift"] = [f.drift for f in fits.values()]
        drifts["drift_interval"] = [list(f.interval("drift")) for f in fits.values()]
    return DelayStudy(
        status=SolveStatus.SOLVED, message=message, title=title or "delay", checks=checks,
        notes=tuple(dict.fromkeys(f"{name}: {text}" for name, f in fits.items() for text in f.notes)),
        estimate=estimate, pairs=tuple(fits), delay=delay, delay_interval=intervals,
        scale=[float(f.warp.scale[0]) for f in fits.values()], explained=[f.explained for f in fits.values()],
        coloured=[f.coloured for f in fits.values()], synthetic=note,
        figures={"residuals": partial(_figure, fits, title or "delay", note)},
        files=MadeFiles({"delays.csv": partial(_table, fits, intervals, note)}), **drifts,
    )  # fmt: skip


def _table(fits: Mapping[str, Alignment], intervals: Sequence[Sequence[float]], note: str | None) -> str:
    lines = [f"# synthetic: {note}"] if note else []
    lines.append("pair,delay [s],low [s],high [s],scale,explained")
    for (name, f), (low, high) in zip(fits.items(), intervals, strict=True):
        lines.append(f'"{name}",{-f.offset:.9g},{low:.9g},{high:.9g},{f.warp.scale[0]:.9g},{f.explained:.9g}')
    return "\n".join(lines) + "\n"


def _figure(fits: Mapping[str, Alignment], title: str, note: str | None) -> Any:
    from ...plot.log import delay_figure

    return delay_figure(
        [(name, *next(iter(f.residuals.values())), f.unit, -f.offset) for name, f in fits.items()],
        title=f"{title} (synthetic)" if note and "synthetic" not in title.lower() else title,
    )
