"""Kind "resampling": signals of a recording on one even grid."""

from __future__ import annotations

from pydantic import Field

from gtmodel.measurements import resampling_study, sampling_of
from gtmodel.measurements.common_grid import options
from gtmodel.problem_files.base import Call, Context, Problem
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.problem_files.keys import RecordedSignalSection, RecordingFiles
from gtmodel.results import Trajectory

RESULT = "gtmodel.measurements.ResamplingStudy"


class SignalSection(RecordedSignalSection):
    """A signal to resample."""

    delay_s: float = Field(default=0.0, description="delay to remove from the signal; kind delay estimates it")


class Schema(Problem):
    """Signals of a recording on one even grid: uneven rows and gaps are resampled, clocks are aligned."""

    log: RecordingFiles = Field(description="files of one recording")
    signals: dict[str, SignalSection] = Field(description="signals, by their names on the grid", min_length=1)
    grid: Made[options.EvenGrid] = Made[options.EvenGrid].left_out()
    align: list[Made[options.AlignBy]] = Field(default=[], description="clocks to align, one table for each")


ARGUMENTS = {"recording": "log", "recording.time": "log", "align_by": "align", "delays": "signals"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the signals in the file."""
    delays = {name: signal.delay_s for name, signal in problem.signals.items() if signal.delay_s}
    return Call(
        resampling_study, _recording(problem, context), *options_of(problem, "grid", "align").values(), delays=delays,
        title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the clocks and their signals."""
    lines = [f"{problem.heading}: {len(problem.signals)} signals"]
    for clock, rows in _recording(problem, context).items():
        sampling = sampling_of(rows.time)
        jitter, gaps = f"jitter {100 * sampling.jitter:.2g} %", f"{len(sampling.gaps)} gaps"
        lines.append(
            f"clock {clock}: {sampling.rows} rows at {sampling.rate:.6g} Hz, {jitter}, {gaps}: {', '.join(rows.names)}"
        )
    lines += [
        f"the clock of '{pair.other}' is aligned with the clock of '{pair.reference}'"
        for pair in options_of(problem, "align")["align"]
    ]
    return "\n".join(lines)


def _recording(problem: Schema, context: Context) -> dict[str, Trajectory]:
    return problem.log.recording(problem.signals, context)
