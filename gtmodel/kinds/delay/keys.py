"""The keys of kind "delay"."""

from __future__ import annotations

from pydantic import Field

from gtmodel.measurements.alignment import options
from gtmodel.problem_files.base import FileSection, Problem
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.log_keys import RecordedSignalSection, RecordingFiles

RESULT = "gtmodel.measurements.DelayStudy"


class PairSection(FileSection):
    """Two signals that show one motion."""

    name: str = Field(default="", description="of the second one, for tables; its column if left out")
    reference: RecordedSignalSection = Field(description="the signal that counts as on time")
    late: RecordedSignalSection = Field(description="the one whose delay is sought; negative where it comes earlier")


class Schema(Problem):
    """How late signals come behind others that show the same motion. One of [log] and [synthetic] gives them."""

    log: RecordingFiles | None = Field(default=None, description="a measured recording")
    pair: list[PairSection] = Field(default=[], description="one table for each, with [log]")
    synthetic: Made[options.SyntheticDelay] | None = Field(default=None, description="a synthetic recording")
    search: Made[options.Search] = Made[options.Search].left_out()
