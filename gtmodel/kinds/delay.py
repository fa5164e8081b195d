"""Kind "delay": delay of one signal behind another that shows the same motion."""

from __future__ import annotations

from pydantic import Field

from gtmodel.measurements import delay_study, sampling_of
from gtmodel.measurements.alignment import options
from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Problem
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.keys import RecordedSignalSection, RecordingFiles
from gtmodel.results import Trajectory

RESULT = "gtmodel.measurements.DelayStudy"


class PairSection(FileSection):
    """Two signals that show one motion."""

    name: str = Field(default="", description="name of the late signal, for tables; its column if left out")
    reference: RecordedSignalSection = Field(description="the signal without delay")
    late: RecordedSignalSection = Field(description="the delayed signal; its delay is negative if it is earlier")


class Schema(Problem):
    """Delays between signals that show the same motion. The signals come from [log] or from [synthetic]."""

    log: RecordingFiles | None = Field(default=None, description="a measured recording")
    pair: list[PairSection] = Field(default=[], description="pairs of signals in [log], one table for each")
    synthetic: Made[options.SyntheticDelay] | None = Field(default=None, description="a synthetic recording")
    search: Made[options.Search] = Made[options.Search].left_out()


def arguments(problem: Schema) -> dict[str, str]:
    """Return keys of arguments: recordings by name are the entries of [[pair]], or [synthetic]."""
    if problem.synthetic is not None:
        return {"recordings": "synthetic", "recordings.synthetic": "synthetic"}
    pairs = {f"recordings.{_name(pair)}": f"pair[{n}]" for n, pair in enumerate(problem.pair)}
    return {"recordings": "pair", **pairs}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study, on the pairs of the log or on a synthetic pair."""
    if (problem.log is None) == (problem.synthetic is None):
        present = "both" if problem.log else "neither"
        raise InputError(f"expected one of [log] and [synthetic]; found {present}", "log")
    if problem.synthetic is not None:
        if problem.pair:
            raise InputError("belongs to [log]; a synthetic recording has one pair", "pair[0]")
        return Call(delay_study, problem.synthetic.options(), problem.search.options(), title=problem.title)
    return Call(delay_study, _pairs(problem, context), problem.search.options(), title=problem.title)


def explain(problem: Schema, context: Context) -> str:
    """Describe the sampling of the signals and the range of the delay."""
    search = problem.search.options()
    lines = [f"{problem.heading}: delays up to {1e3 * search.longest:g} ms in both directions"]
    if problem.log is not None:
        for name, (first, late) in _pairs(problem, context).items():
            rates = [f"{len(t)} rows at {sampling_of(t.time).rate:.6g} Hz" for t in (first, late)]
            lines.append(f"{name}: reference {rates[0]}, late {rates[1]}")
    lines.append("late(t) = scale reference(t - delay) + shift, by one cubic spline through both")
    return "\n".join(lines)


def _pairs(problem: Schema, context: Context) -> dict[str, tuple[Trajectory, Trajectory]]:
    assert problem.log is not None
    if not problem.pair:
        raise InputError("is missing; name the signals, [pair.reference] and [pair.late]", "pair")
    columns = dict[str, RecordedSignalSection]()
    for n, pair in enumerate(problem.pair):
        columns[f"reference_{n}"], columns[f"late_{n}"] = pair.reference, pair.late
    recording = problem.log.recording(columns, context)
    by_name = {name: _called(t, name, columns[name]) for t in recording.values() for name in t.names}
    pairs = {}
    for n, pair in enumerate(problem.pair):
        name = _name(pair)
        if name in pairs:
            raise InputError(f"two pairs are called '{name}'; give them different names", f"pair[{n}].name")
        pairs[name] = by_name[f"reference_{n}"], by_name[f"late_{n}"]
    return pairs


def _name(pair: PairSection) -> str:
    column = pair.late.column
    return pair.name or (column if isinstance(column, str) else ", ".join(column))


def _called(trajectory: Trajectory, name: str, section: RecordedSignalSection) -> Trajectory:
    """A signal with the name of its column, for messages."""
    label = section.column if isinstance(section.column, str) else ", ".join(section.column)
    return Trajectory(
        trajectory.time, {label: trajectory[name]}, {label: trajectory.unit(name)}, synthetic=trajectory.synthetic
    )
