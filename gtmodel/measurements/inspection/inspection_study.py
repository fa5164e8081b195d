"""The inspection of a log before it is used."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Unpack

import numpy as np

from ...lang.units import convert
from ...results.quantity import Quantity, Row
from ...results.status import SolveStatus
from ...results.study import Study, to_inherit
from ...results.trajectory_checks import Array
from ...results.trajectory_files import PathLike
from ...results.work import Work, WorkOptions, study_function
from ..sampling import SamplingReport
from ..streams.form import FormError, LogError, LogForm, shown
from ..streams.matlab import MatFile
from ..streams.opening import content_of
from ..streams.stream import MOST_SHOWN, Stream
from ..streams.text import TextStream, date_in
from .columns import (
    Clock,
    ClockPair,
    ColumnFacts,
    ColumnScan,
    Envelope,
    TimeParts,
    UnitGuess,
    clock_of,
    counts_rows,
    is_clock,
    pairs,
    runs_forward,
    time_parts,
    unit_guess,
    unit_of_name,
)

if TYPE_CHECKING:
    from ..streams.bags import Bag

SHORTEST = 16  # samples of a stream of a MATLAB file; shorter ones beside others are parameters
MOST_CLOCKS = 4
MOST_GAPS = 20  # gaps listed
STARTED = 60.0  # s; a time that begins later does not count from the start of the recording
MOST_NAMES = 12
MOST_WORDS = 4  # columns with words among their numbers listed
_COMPONENT = re.compile(r"(?P<base>.+?)(?:\[\d+\]|[_. ](?:[xyzw]|\d+)|(?<=[^\d\W])\d+)")


@dataclass(frozen=True, eq=False)
class InspectedStream:
    """One table of a log: its columns, their probable units, its clocks, and the `envelope` for the picture."""

    name: str
    rows: int
    columns: list[ColumnFacts]
    guesses: list[UnitGuess]
    clocks: list[Clock]
    pairs: list[ClockPair]
    envelope: Envelope
    groups: list[list[int]]
    declarations: list[str] = field(default_factory=list)  # notes on the keys that the time needs

    @property
    def clock(self) -> Clock | None:
        """The first clock with a known unit, else the first clock."""
        return next((c for c in self.clocks if c.unit), next(iter(self.clocks), None))


@to_inherit
@dataclass(frozen=True, kw_only=True)
class InspectionStudy(Study):
    """Contents of a log: `streams` by name as plain data, `inspected` as objects; the notes list peculiarities."""

    done: ClassVar[str] = "read"
    streams: Annotated[
        dict[str, Any],
        Quantity(description="per stream: rows, clocks, and columns with range, unit and the reason for the unit"),
    ] = field(default_factory=dict)
    inspected: Sequence[InspectedStream] = ()

    @property
    def rows(self) -> list[Row]:
        """The rows of each stream: first its clocks, then one row for each vector or column."""
        return [row for stream in self.inspected for row in _rows(stream, len(self.inspected) > 1)]


@study_function
def inspect(
    path: PathLike,
    form: LogForm = LogForm(),  # noqa: B008
    **work_options: Unpack[WorkOptions],
) -> InspectionStudy:
    r"""Inspect a log before it is used: streams, columns, guessed units with reasons, rates, jitter, gaps, clocks.

    Args:
        path: a file that `open_log` reads. It is read once, in blocks, so it may be larger than the memory.
        form: format of the file, as far as the file does not state it.
        title: title of the table and the picture.
        progress, max_seconds, stop: see `Work`. A stopped study describes the rows read so far.

    Units that the header does not state are marked as guesses. A header below other lines and decimal commas are
    recognised; a note states the keys that other readers need. Raises LogError for a file that cannot be read.

    >>> from pathlib import Path
    >>> lines = [f"{4 * k},{0.5 * k % 2},{300 + k}" for k in range(40) if k != 20]
    >>> written = Path("run.csv").write_text("t_ms,force_N,tcp_x\n" + "\n".join(lines))
    >>> study = gt.measurements.inspect("run.csv")
    >>> (stream,) = study.inspected
    >>> [guess.unit for guess in stream.guesses]
    ['ms', 'N', 'mm']
    >>> stream.guesses[2].why
    'named like a position, up to 339: too large for m'
    >>> round(stream.clock.sampling.rate, 6), stream.clock.sampling.gaps[0].missing
    (250.0, 1)
    """
    work = Work(**work_options)
    content, form, notes = _opened(path, form)
    all_streams = [content] if isinstance(content, Stream) else list(content.streams())
    streams = [s for s in all_streams if not form.stream or s.name == form.stream]
    if not streams:
        names = _listed([s.name for s in all_streams if s.name])
        if not all_streams:
            raise LogError(f"{shown(path)} holds no table of numbers")
        advice = f"it has {names}" if names else "it is a single table, so name no stream"
        raise LogError(f"{shown(path)}: there is no stream '{form.stream[:40]}'; {advice}")
    tables, ended = list[InspectedStream](), False
    title = work.title or shown(Path(path).name)
    work.keep(partial(_answer, title, tables, notes, True))
    for stream in streams:
        notes += [_on(stream, remark) for remark in stream.remarks]
        opened = len(stream.remarks)
        inspected, ended = _inspected(stream, work, others=len(streams) > 1 and isinstance(content, MatFile))
        notes += [_on(stream, remark) for remark in stream.remarks[opened:]]
        tables += [] if inspected is None else [inspected]
        notes += [_on(stream, sentence) for sentence in _left_out(stream)]
        if ended:
            notes.append(f"stopped after row {tables[-1].rows if tables else 0}; later rows are not included")
            break
    if not tables and not ended:
        raise LogError(f"{streams[0].heads.where} has a header but no rows; expected at least one row of numbers")
    empty = not any(c.rows for stream in tables for c in stream.columns)
    if empty and not ended and isinstance(content, TextStream) and not content.layout.commas:
        raise LogError(f"{shown(path)} is a text without a table: none of its {tables[0].rows} lines holds a number")
    notes += [sentence for stream in tables for sentence in _remarkable(stream, len(tables) > 1)]
    if isinstance(content, MatFile):
        notes += _parameters(content)
    return _answer(title, tables, notes, ended)


def _opened(path: PathLike, form: LogForm) -> tuple[Stream | MatFile | Bag, LogForm, list[str]]:
    """Open a log, with the line of the header and the decimal commas recognised; return them in the form and as notes.

    Other readers need them declared: a number read wrongly would spoil a result.
    """
    notes = list[str]()
    while True:
        try:
            content = content_of(path, form)
            commas = isinstance(content, TextStream) and content.layout.sign != "," and content.layout.commas
            if not commas:
                return content, form, notes
            detected: dict[str, Any] = {"decimal": "comma"}
        except FormError as error:
            detected = error.form
        form = replace(form, **detected)  # pyrefly: ignore[bad-argument-type]
        notes += [f"the table begins at line {line}: header = {line}" for line in [detected.get("header")] if line]
        notes += ['the numbers have decimal commas: decimal = "comma"'] if "decimal" in detected else []


def _answer(title: str, tables: list[InspectedStream], notes: list[str], ended: bool) -> InspectionStudy:
    figures = {"log": partial(_picture, title, tables)} if tables else {}
    return InspectionStudy(
        status=SolveStatus.INTERRUPTED if ended else SolveStatus.SOLVED,
        message="" if ended else f"{len(tables)} stream{'s' if len(tables) != 1 else ''}; units with ? are guesses",
        title=title,
        notes=notes,
        figures=figures,
        streams={stream.name or "table": _data(stream) for stream in tables},
        inspected=tables,
    )


def _inspected(stream: Stream, work: Work, others: bool) -> tuple[InspectedStream | None, bool]:
    """Return the inspected stream, None if it is too short beside others; and whether the study was stopped."""
    names = [name for name in stream.heads.names if name and _once(stream, name)]
    labels = [label for group in stream.heads.channel_times().values() for label in group]
    names = sorted([*names, *labels], key=stream.heads.place)
    units = {name: stream.heads.units[stream.heads.place(name)] for name in names}
    scan, time_names, ended, parts = None, list[str](), False, None
    blocks = stream.blocks(names, gaps=True) if names else iter(())
    for block in blocks:
        if scan is None:
            parts = None if stream.clock else time_parts(names, block.values)
            time_names = [] if parts else _clock_names(stream, names, labels, block.values)
            scan = ColumnScan(names, [*time_names, *(parts[:2] if parts else ())])
        scan.add(block.values)
        work.progress(f"reading {stream.source}", block.fraction)
        if work.interrupted() and block.fraction < 1.0:
            ended = True
            break
    if scan is None or (others and scan.lines < SHORTEST):
        return None, ended
    facts, groups = scan.facts(), _groups(names)
    guesses: list[UnitGuess] = [UnitGuess("", "")] * len(names)
    for group in groups:
        rows = scan.head[:, group] if len(group) > 1 else None
        for j in group:
            guesses[j] = unit_guess(facts[j], units[names[j]], scan.head[:, j], rows, names[j] in labels)
        _as_one(group, guesses, facts)
    clocks = [clock_of(name, guesses[names.index(name)].unit, scan.numbers(name)) for name in time_names]
    if parts:
        rest = convert(scan.numbers(parts.rest), parts.unit, "s")
        clocks = [clock_of(parts.label, "s", scan.numbers(parts.whole) + rest)]
    scan.forget()
    clocks.sort(key=lambda clock: clock.name != stream.clock)
    inspected = InspectedStream(
        stream.name, scan.lines, facts, guesses, clocks, [] if labels else pairs(clocks), scan.envelope, groups,
        _declarations(stream, clocks, parts, guesses, names, labels),
    )  # fmt: skip
    return inspected, ended


def _declarations(
    stream: Stream, clocks: list[Clock], parts: TimeParts | None, guesses: list[UnitGuess], names: list[str],
    labels: list[str],
) -> list[str]:  # fmt: skip
    """Return notes on the keys that declare a time in several columns, one for each channel, or of known origin."""
    notes, time = list[str](), clocks[0].name if clocks else ""
    if parts is not None:
        notes.append(
            f'the time is in two columns: time = {{ column = ["{parts.whole}", "{parts.rest}"], '
            f'unit = ["s", "{parts.unit}"] }}'
        )
    if time in labels:
        name, unit = stream.heads.names[stream.heads.place(time)], guesses[names.index(time)].unit
        notes.append(
            "each channel has its own time column on its left: "
            f'time = {{ column = "{name}", unit = "{unit or "?"}", per_channel = true }}'
        )
    dated = [(line, date) for line in stream.above() if (date := date_in(line))]
    if dated and clocks and not stream.stamps and abs(float(np.nanmin(clocks[0].time))) < STARTED:
        line, _ = dated[0]
        words = re.split(r"[\d:\t;,]", line, maxsplit=1)[0].strip('#% "')
        if words:
            notes.append(
                f"'{words}' above the table has a date; if '{time}' counts from it, time.since = \"{words}\" joins it "
                'with other clocks, with time.zone = "+01:00" if the date has that zone'
            )
    return notes


def _once(stream: Stream, name: str) -> bool:
    return stream.heads.names.count(name) == 1


def _left_out(stream: Stream) -> list[str]:
    """Return notes on ignored columns, and on words among numbers, which count as empty."""
    names = stream.heads.names
    read = stream.heads.channel_times()
    notes = [f"{stream.cell}s {_places(names, n)} are all called '{n}' and are ignored; give each a different name"
             for n in dict.fromkeys(names) if n and not _once(stream, n) and n not in read]  # fmt: skip
    if "" in names:
        notes.append(f"{stream.cell} {_places(names, '')} has no name and is ignored")
    for name, (line, word, advice) in list(stream.words.items())[:MOST_WORDS]:
        notes.append(f"{stream.row} {line}, {stream.cell} '{name}': '{word[:MOST_SHOWN]}' is not a number and counts "
                     f"as empty{advice}")  # fmt: skip
    return notes


def _places(names: Sequence[str], name: str) -> str:
    return _listed([str(k + 1) for k, n in enumerate(names) if n == name])


def _clock_names(stream: Stream, names: list[str], labels: list[str], values: Array) -> list[str]:
    """Return the time columns by name; if there are none, the columns that increase with every row."""
    columns = list(zip(names, values.T, strict=True))
    named = [name for name, column in columns if name == stream.clock or is_clock(name, column)]
    if not named and len(values) > 2:
        named = [name for name, column in columns
                 if (np.all(np.diff(column) > 0) or runs_forward(name, column) or name in labels)
                 and not counts_rows(column)]  # fmt: skip
    return named[:MOST_CLOCKS]


def _groups(names: list[str]) -> list[list[int]]:
    """Group adjacent columns whose names are components of one vector: q[0], q[1]; x_1, x_2; p.x, p.y, p.z."""
    groups: list[list[int]] = []
    before = ""
    for j, name in enumerate(names):
        match = _COMPONENT.fullmatch(name)
        base = match["base"] if match else ""
        if base and base == before:
            groups[-1].append(j)
        else:
            groups.append([j])
        before = base
    return groups


def _as_one(group: list[int], guesses: list[UnitGuess], facts: list[ColumnFacts]) -> None:
    """Give all components of a vector the unit guessed for the component with the widest range."""
    units = [guesses[j].unit for j in group if not facts[j].constant]
    if len(group) < 2 or any(guesses[j].stated for j in group) or len(set(units)) < 2:
        return
    widest = max(group, key=lambda j: facts[j].most - facts[j].least)
    for j in group:
        guesses[j] = guesses[widest]


def _on(stream: Stream, sentence: str) -> str:
    return f"{stream.name}: {sentence}" if stream.name else sentence


def _remarkable(stream: InspectedStream, several: bool) -> list[str]:
    """Return notes on peculiarities to check before the log is used."""
    lead = f"{stream.name}: " if several else ""
    notes = [lead + sentence for sentence in stream.declarations]
    guessed = dict[tuple[str, str], list[tuple[str, float, str]]]()  # unit, reason without numbers -> columns
    for group in stream.groups:
        guess, name = stream.guesses[group[0]], _group_name([stream.columns[j] for j in group])
        if guess.stated and (suffix := unit_of_name(name)) not in ("", guess.unit):
            notes.append(
                f"{lead}the header says {guess.unit} of '{name}', whose name ends in {suffix}; {guess.unit} counts"
            )
        for guess, facts in ((stream.guesses[j], stream.columns[j]) for j in group):
            if guess.why and not guess.stated and not guess.why.startswith("the name"):
                alike = (guess.unit, re.sub(r"\d[\d.e+-]*", "", guess.why))
                guessed.setdefault(alike, []).append((name, max(abs(facts.least), abs(facts.most)), guess.why))
    for (unit, _), columns in list(guessed.items())[:MOST_NAMES]:
        _, _, why = max(columns, key=lambda column: column[1])
        notes.append(
            f"{lead}{_listed([*dict.fromkeys(name for name, _, _ in columns)])}: {f'{unit}? ' if unit else ''}{why}"
        )
    for clock in stream.clocks:
        s, unit = clock.sampling, "s" if clock.unit else "of its unit"
        if clock.resets:
            times = "once" if clock.resets == 1 else f"{clock.resets} times"
            notes.append(f"{lead}the time '{clock.name}' goes back {times}: a reset, or late rows")
        if s.repeated:
            notes.append(f"{lead}the time '{clock.name}' repeats itself in {s.repeated} rows")
        if s.gaps:
            first = s.gaps[0]
            notes.append(
                f"{lead}'{clock.name}' has {_gaps(s)}, {100 * s.missing:.2g} % of the samples; the first lasts "
                f"{first.duration:.4g} {unit} from {first.time:.6g} {unit}"
            )
        if not clock.unit:
            notes.append(f"{lead}the unit of the time '{clock.name}' is unknown")
    if not stream.clocks:
        notes.append(
            f"{lead}{stream.rows} rows and no time column: a table of poses? reading a recording needs the sample time"
        )
    for pair in stream.pairs:
        notes.append(
            f"{lead}'{pair.other}' is {1e3 * pair.offset:.4g} ms ahead of '{pair.first}' at the first row and gains "
            f"{1e6 * pair.drift:.3g} ppm, roughly; scatter {1e3 * pair.residual:.3g} ms"
        )
    # components of a quaternion are bounded by 1
    turned = {c.name for c, guess in zip(stream.columns, stream.guesses, strict=True) if "quaternion" in guess.why}
    for applies, sentence in (
        (lambda c: c.rows == 0, "no numbers in {}"),
        (lambda c: c.rows and c.constant, "constant: {}"),
        (lambda c: c.rows and c.empty, "rows without a number in {}"),
        (lambda c: c.clipped and c.name not in turned, "looks clipped, with many rows at an extreme: {}"),
    ):
        columns = [c for c in stream.columns if applies(c)]
        if columns:
            notes.append(lead + sentence.format(_listed([_counted(c) for c in columns])))
    return notes


def _gaps(sampling: SamplingReport) -> str:
    count = len(sampling.gaps)
    return "one gap" if count == 1 else f"{count} gaps"


def _counted(c: ColumnFacts) -> str:
    if c.rows == 0 or c.constant:
        return c.name
    return f"{c.name} ({c.empty if not c.clipped else c.clipped})"


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more


def _parameters(file: MatFile) -> list[str]:
    """Return notes on the single numbers and short vectors of a MATLAB file."""
    single = [n for n, v in file.variables.items() if int(np.prod(v.shape)) == 1]
    short = [n for n, v in file.variables.items() if 1 < int(np.prod(v.shape)) < SHORTEST]
    notes = []
    if single:
        values = {n: float(file.variables[n].load().ravel()[0]) for n in single[: MOST_NAMES + 1]}
        notes.append("single numbers: " + _listed([f"{n} = {values.get(n, 0.0):g}" for n in single]))
    if short:
        notes.append("short vectors: " + _listed(short))
    if file.skipped:
        notes.append("no numbers in " + _listed(list(file.skipped)))
    return notes


def _rows(stream: InspectedStream, several: bool) -> list[Row]:
    rows = [Row(f"stream {stream.name}" if several else "rows", stream.rows)]
    for clock in stream.clocks:
        s = clock.sampling
        if clock.unit and s.rate:
            low, high = float(np.nanmin(clock.time)), float(np.nanmax(clock.time))
            span = f"from {low:.6g} to {high:.6g}"
            if high - low < 1e-4 * abs(high):  # seconds since 1970
                span = f"{high - low:.6g} after {low:.10g}"
            text = f"{s.rate:.6g} Hz, jitter {100 * s.jitter:.2g} %, {_gaps(s)}, {span}"
            rows.append(Row(f"time {clock.name}", text, "s"))
    times = {clock.name for clock in stream.clocks if clock.unit}
    for group in stream.groups:
        facts = [stream.columns[j] for j in group]
        if all(c.name in times for c in facts):
            continue
        rows.append(Row(_group_name(facts), _range(facts), _unit_shown(stream.guesses[group[0]])))
    return rows


def _group_name(facts: list[ColumnFacts]) -> str:
    return facts[0].name if len(facts) == 1 else f"{facts[0].name} to {facts[-1].name}"


def _range(facts: list[ColumnFacts]) -> str:
    filled = [c for c in facts if c.rows]
    if not filled:
        return "no numbers"
    least, most = min(c.least for c in filled), max(c.most for c in filled)
    parts = [f"{least:.6g}" if least == most else f"{least:.6g} to {most:.6g}"]
    steps = {f"{c.step:.3g}" for c in filled if c.step}
    if len(steps) == 1:
        parts.append(f"in steps of {steps.pop()}")
    if empty := sum(c.empty for c in facts):
        parts.append(f"{empty} empty")
    return ", ".join(parts)


def _unit_shown(guess: UnitGuess) -> str:
    return guess.unit if guess.stated or not guess.unit else f"{guess.unit} ?"


def _data(stream: InspectedStream) -> dict[str, Any]:
    """Return a stream as plain data for result.json."""
    return {
        "rows": stream.rows,
        "columns": [
            {
                "name": c.name, "unit": g.unit, "unit_from": "header" if g.stated else "guess" if g.unit else "",
                "why": g.why, "least": c.least, "most": c.most, "mean": c.mean, "numbers": c.rows, "empty": c.empty,
                "constant": c.constant, "step": c.step, "clipped_rows": c.clipped, "longest_repeat": c.longest,
            }
            for c, g in zip(stream.columns, stream.guesses, strict=True)
        ],
        "clocks": [_clock_data(clock) for clock in stream.clocks],
        "clock_pairs": [
            {"first": p.first, "other": p.other, "offset_s": p.offset, "drift_ppm": 1e6 * p.drift,
             "residual_s": p.residual} for p in stream.pairs
        ],
    }  # fmt: skip


def _clock_data(clock: Clock) -> dict[str, Any]:
    s = clock.sampling
    time = clock.time[np.isfinite(clock.time)]
    return {
        "name": clock.name, "unit": clock.unit, "monotonic": not (s.late or s.repeated), "resets": clock.resets,
        "repeated": s.repeated, "start": float(time[0]) if len(time) else None,
        "end": float(time[-1]) if len(time) else None, "rate_Hz": s.rate, "step_s": s.step, "jitter": s.jitter,
        "largest_jitter": s.most, "gaps": len(s.gaps), "missing": s.missing,
        "first_gaps": [asdict(gap) for gap in s.gaps[:MOST_GAPS]],
    }  # fmt: skip


def _picture(title: str, streams: Sequence[InspectedStream]) -> Any:
    from ...plot.log import log_figure

    return log_figure(title, [_drawn(stream) for stream in streams])


def _drawn(stream: InspectedStream) -> dict[str, Any]:
    """Return the data of the picture: times of the envelope, and each group of columns."""
    clock, rows = stream.clock, stream.envelope.rows
    if clock is not None and len(clock.time):
        time, label = clock.time[np.round(rows).astype(int)], f"{clock.name} [{'s' if clock.unit else '?'}]"
    else:
        time, label = rows, "row"
    return {
        "name": stream.name, "time": time, "label": label, "low": stream.envelope.low, "high": stream.envelope.high,
        "groups": [
            (_group_name([stream.columns[j] for j in group]), _unit_shown(stream.guesses[group[0]]), group)
            for group in stream.groups
            if not any(stream.columns[j].name == c.name for c in stream.clocks for j in group)
            and any(stream.columns[j].rows and not stream.columns[j].constant for j in group)
        ],
        "clock": None if clock is None else clock.time,
    }  # fmt: skip
