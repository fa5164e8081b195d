"""The keys of kind "resampling"."""

from __future__ import annotations

from pydantic import Field

from gtmodel.measurements.common_grid import options
from gtmodel.problem_files.base import Problem
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.log_keys import RecordedSignalSection, RecordingFiles

RESULT = "gtmodel.measurements.ResamplingStudy"


class SignalSection(RecordedSignalSection):
    """A signal that is wanted on the grid."""

    delay_s: float = Field(default=0.0, description="how late it is, which is taken off; the kind delay estimates it")


class Schema(Problem):
    """Signals of a recording on one even grid: uneven rows and gaps resampled, clocks brought together."""

    log: RecordingFiles = Field(description="the files that were recorded at once")
    signals: dict[str, SignalSection] = Field(description="by the names that they get on the grid", min_length=1)
    grid: Made[options.EvenGrid] = Made[options.EvenGrid].left_out()
    align: list[Made[options.AlignBy]] = Field(default=[], description="one table for each clock that is moved")
