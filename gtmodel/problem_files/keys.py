"""Keys that several kinds share: the robot, and logs with their measured signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import date, datetime
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, PositiveFloat

from gtmodel.lang.units import UnitError
from gtmodel.measurements import AlignBy, Column, Conversion, EvenGrid, LogForm, Session, Signal, read_recording
from gtmodel.measurements.log import JITTER, left_out
from gtmodel.measurements.sampling import EmptyRows, LateRows
from gtmodel.measurements.signals import read_signals
from gtmodel.results import ArgumentError, Trajectory, TrajectoryError
from gtmodel.results.quantity import unit_of

from .base import Context, FileSection, InputError, Problem, Source
from .from_options import Made, key_of, made_from, options_of

if TYPE_CHECKING:
    from gtmodel.lang import Model


class FrictionSection(FileSection):
    """Friction, smoothed around zero velocity."""

    smoothing: Literal["tanh", "piecewise_linear"] | None = Field(
        default=None, description="smoothing of the sign of the velocity; tanh for robots of the catalogue"
    )
    velocity_scale_m_s: PositiveFloat | None = Field(
        default=None,
        description="velocity over which the sign changes, in m/s, and in rad/s at revolute joints; "
        "0.1 for robots of the catalogue",
    )


class RobotProblem(Problem):
    """A problem about one robot."""

    robot: str = Field(
        description="catalogue name, TOML robot file, URDF, SDF or MJCF file (arm.urdf, arm.urdf:tip, arm.sdf, "
        "arm.xml; tree.urdf:* for all branches), or a model in Python: package.module:Class, file.py:Class"
    )
    inertia: str | None = Field(
        default=None, description="identified masses and friction of a catalogue robot; model_2 if left out"
    )
    payload_kg: float | None = Field(default=None, ge=0, description="mass added to the plate")
    parameters: dict[str, Any] = Field(default={}, description="values of the model's parameters by name, in SI")
    friction: FrictionSection = FrictionSection.left_out()

    def model(self, context: Context) -> Model:
        """Return the configured robot. Raises InputError."""
        from . import robots  # here: the keys alone need no robot

        return robots.resolve(
            self.robot,
            context,
            parameters=self.parameters,
            inertia=self.inertia,
            smoothing=self.friction.smoothing,
            velocity_scale=self.friction.velocity_scale_m_s,
            payload=self.payload_kg,
        )


Free = Literal["estimate"]
FILES = Field(default=[], description="CSV, MATLAB, Parquet or bag files; paths start at the problem's folder")


class TimeColumn(FileSection):
    """The column of time."""

    column: str | list[str] = Field(
        default="time",
        description='name of the time column in the log, or names of columns whose sum is the time; "" if there is '
        "none: then rows are log.sample_time_s apart",
    )
    unit: str | list[str] = Field(
        default="s", description='unit of the time column, such as "ms" or "100 ns", or one for each column'
    )
    since: datetime | date | str = Field(
        default="",
        description="date at which the time is zero, if clocks of different origins are joined; or words in a line "
        "above the table that has the date",
    )
    zone: str = Field(default="", description="zone of dates without one, such as +01:00; UTC if left out")
    per_channel: bool = Field(
        default=False,
        description="whether each channel has a time column of this name, or pattern such as t_*, on its left",
    )

    def declared(self) -> Column | None:
        """Return the column for `gtmodel.measurements`, None if there is no time column."""
        if not self.column:
            return None
        since = self.since if isinstance(self.since, str) else self.since.isoformat()
        column, unit = fixed(self.column), fixed(self.unit)
        return Column(column, unit, since=since, zone=self.zone, per_channel=self.per_channel)


class ColumnSection(FileSection):
    """Columns of a log that show one quantity."""

    column: str | list[str] = Field(description='name in the log; "q" also means the columns "q[0]", "q[1]", ...')
    unit: str | list[str] = Field(description="unit in the log, or one for each column")
    gear_ratio: float | list[float] | None = Field(
        default=None,
        description="turns of the motor per turn of the joint: motor positions are divided by it, motor torques and "
        "currents multiplied; one, or one for each column",
    )
    motor_constant_Nm_A: float | list[float] | None = Field(
        default=None, description="torque per current of the motor, for columns of currents; one, or one for each"
    )
    coupling: list[list[float]] | None = Field(
        default=None,
        description="square matrix from the columns, after scale and gear ratio, to the quantity, such as for a wrist "
        "whose joint 6 moves with joint 5; efforts have the inverse transpose of the positions' matrix",
    )
    quantity_unit: str | list[str] = Field(
        default="",
        description="SI unit of the quantity, or of each component, if the scale changes the dimension and no model "
        "states it",
    )
    time: TimeColumn | None = Field(
        default=None, description="time column of this signal; the log's time column if left out"
    )
    stream: str = Field(default="", description="stream of this signal, such as the topic of a bag")
    file: str = Field(
        default="",
        description="file of this signal, or a pattern for several recordings, *_currents.csv; if left out, the log "
        "file that has the column",
    )

    def clock(self) -> dict[str, Any]:
        """Return the signal's own time column, stream and file as `gtmodel.measurements` expects them."""
        return {"time": None if self.time is None else self.time.declared(), "stream": self.stream, "file": self.file}

    def shown(self) -> tuple[str | tuple[str, ...], str | tuple[str, ...]]:
        """Return names and units as `gtmodel.measurements` expects them."""
        column, unit = (x if isinstance(x, str) else tuple(x) for x in (self.column, self.unit))
        return column, unit

    def drives(self) -> dict[str, Any]:
        """Return gear ratio, motor constant and coupling as `gtmodel.measurements.Conversion` expects them."""
        coupling = None if self.coupling is None else tuple(map(tuple, self.coupling))
        return {"gear_ratio": fixed(self.gear_ratio), "motor_constant": fixed(self.motor_constant_Nm_A),
                "coupling": coupling}  # fmt: skip


def fixed(value: Any) -> Any:
    """Return a list as a tuple, anything else as it is."""
    return tuple(value) if isinstance(value, list) else value


class MeasuredSignalSection(ColumnSection):
    """A measured signal: quantity(t) = scale column(t + delay) - offset, each a number, one for each column, or
    "estimate"."""

    scale: float | list[float] | Free = Field(
        default=1.0, description="quantity per column, in SI unit of the key per column's unit; -1 reverses a sign"
    )
    offset: float | list[float] | Free = Field(
        default=0.0, description="reading when the quantity is zero, in the SI unit"
    )
    delay_s: float | list[float] | Free = Field(default=0.0, description="delay of the column behind the quantity")
    per_session: list[Literal["delay", "scale", "offset"]] = Field(
        default=["offset"], description="estimated numbers that differ from session to session"
    )

    def signal(self, key: str, unit: str | None = None) -> Signal:
        """Return the signal for `gtmodel.measurements`. The SI unit of the quantity comes from `unit` or from the key,
        such as force_N; a unit with "?" in front means that components have their own units, of which quantity_unit
        tells the declared ones. Raises InputError."""
        unit = unit_of(key.rpartition(".")[2]) if unit is None else unit.removeprefix("?")
        if unit and self.quantity_unit:
            raise InputError(f"is known already, {unit}; leave it out", f"{key}.quantity_unit")
        free = tuple(dict.fromkeys(self.per_session))
        try:
            scale, offset, delay = (fixed(x) for x in (self.scale, self.offset, self.delay_s))
            return Signal(
                *self.shown(), scale, offset, delay, unit or fixed(self.quantity_unit), free, **self.drives(),
                **self.clock(),
            )  # fmt: skip
        except (TrajectoryError, UnitError) as error:
            raise InputError(str(error), key) from error


class RecordedSignalSection(ColumnSection):
    """A column of a recording whose signals may have different clocks: quantity = scale column - offset."""

    scale: float | list[float] = Field(
        default=1.0, description="quantity per column, one, or one for each column; -1 reverses a sign"
    )
    offset: float | list[float] = Field(
        default=0.0, description="reading when the quantity is zero, in the quantity's SI unit"
    )

    def recorded(self) -> Column:
        """Return the column for `gtmodel.measurements`. Raises LogError."""
        conversion = Conversion(
            fixed(self.scale), fixed(self.offset), quantity_unit=fixed(self.quantity_unit), **self.drives()
        )
        return Column(*self.shown(), conversion=conversion, **self.clock())


@made_from(LogForm, "by_file")
class FileForm(Made):
    """Format of a file, as far as it cannot be detected."""


class FormSection(FileForm):
    """Format of files, as far as it cannot be detected."""

    formats: dict[str, FileForm] = Field(
        default={},
        description='keys of the format that differ in the files with this name or pattern, [log.formats."*.log"]',
    )

    def form(self) -> LogForm:
        """Return only these keys as options. Raises ArgumentError."""
        common = {field: getattr(self, key) for key, field in FileForm.attributes.items()}
        own = {
            name: LogForm(**common | {FileForm.attributes[key]: getattr(form, key) for key in form.model_fields_set})
            for name, form in self.formats.items()
        }
        return LogForm(**common, by_file=own)


@made_from(EvenGrid, "start", "end")
class ResampleSection(Made):
    """Resampling of uneven rows on an even grid, before any other step."""


class LogReading(FormSection):
    """Format of logs with even or uneven rows."""

    source: Source = ""
    time: TimeColumn = TimeColumn()
    sample_time_s: PositiveFloat | None = Field(
        default=None, description="expected sampling period; the log's median if left out; needed without a time column"
    )
    late_rows: LateRows = Field(
        default="refuse",
        description="rows whose time is not after all earlier times: refuse the log, drop the rows, or sort them",
    )
    empty_rows: EmptyRows = Field(
        default="refuse", description="rows with a missing number or nan: refuse the log, or drop the rows"
    )


class LogSampling(LogReading):
    """Format and sampling of logs; a kind adds its files and signals."""

    session: str | None = Field(default=None, description="column whose number distinguishes the recordings in a file")
    jitter: float = Field(
        default=JITTER, gt=0, lt=1, description="largest deviation of a time step, relative to the sampling period"
    )
    resample: ResampleSection | None = Field(
        default=None, description="for logs with uneven rows or gaps; if left out, the rows must be even"
    )

    align: list[Made[AlignBy]] = Field(
        default=[], description="clocks to align, if signals have files or times with different origins"
    )
    curves: dict[str, RecordedSignalSection] = Field(
        default={}, description="further signals, by name, that only align clocks"
    )

    def read(
        self, names: list[str], signals: Mapping[str, Signal], context: Context, key: str,
        called: Mapping[str, str] | None = None, table: str = "",
    ) -> tuple[Session, ...]:  # fmt: skip
        """Return the columns of the signals from these files, unchanged; `key` is the key of the file names.

        called: key of a signal -> its name in `signals`, for `align`. table: this section, if not that of `key`.
        Raises InputError with the key of the file that is missing or wrong.
        """
        if not names:
            raise InputError("is empty; name a log file", key)
        section = key.rpartition(".")[0]
        table, called = table or section, called or {}
        if not self.time.column and self.sample_time_s is None:
            raise InputError("is missing; a log without a time column needs it", f"{section}.sample_time_s")
        try:
            sessions = read_signals(
                [context.file(name, f"{key}[{n}]", source=self.source) for n, name in enumerate(names)],
                signals,
                time=self.time.declared(),
                session=self.session,
                sample_time=self.sample_time_s,
                jitter=self.jitter,
                grid=None if self.resample is None else self.resample.options(),
                align_by=[
                    replace(a, reference=called.get(a.reference, a.reference), other=called.get(a.other, a.other))
                    for a in options_of(self, "align")["align"]
                ],
                curves={name: curve.recorded() for name, curve in self.curves.items()},
                late_rows=self.late_rows,
                empty_rows=self.empty_rows,
                form=self.form(),
                progress=context.progress,
            )
        except (ArgumentError, UnitError) as error:
            argument = error.argument if isinstance(error, ArgumentError) else ""
            name = argument.replace("align_by", "align").removeprefix("grid.")
            name = f"resample.{name}" if name in ("sample_time", "longest_gap") else name
            if isinstance(error, ArgumentError) and name.startswith(("align[", "resample.")):
                raise InputError(error.message, f"{table}.{key_of(type(self), name, {})}") from error
            if isinstance(error, ArgumentError) and argument == "recording.time":
                raise InputError(f"{error.message}: declare a pair in [[{table}.align]]", table) from error
            # the sentence names the file; a wrong column may be the fault of the section or of the file
            raise InputError(str(error), section) from error
        if dropped := left_out(s.trajectory for s in sessions):
            counts = ", ".join(f"{count} {why.removeprefix('rows ')}" for why, count in dropped.items())
            context.note(f"rows of the log that are not used: {counts}")
        for sentence in dict.fromkeys(line for s in sessions for line in s.trajectory.provenance.get("joined", [])):
            context.note(sentence)
        widths = {tuple(s.trajectory[name].shape[1:] for name in signals) for s in sessions}
        if len(widths) > 1:
            raise InputError("the files have signals of different widths; name logs of one robot", key)
        return sessions


def files_of(files: list[str], signals: Mapping[str, Any]) -> list[str]:
    """Return the files of a log; if there are none, those that its signals name."""
    return files or list(dict.fromkeys(s.file for s in signals.values() if s.file))


class RecordingFiles(LogReading):
    """Files recorded together, whose signals may have different clocks; a kind adds its signals."""

    files: list[str] = FILES

    def recording(
        self, signals: Mapping[str, RecordedSignalSection], context: Context, key: str = "log"
    ) -> dict[str, Trajectory]:
        """Return the signals by clock, in SI units, with uneven rows; see `read_recording`. Raises InputError."""
        if not (files := files_of(self.files, signals)):
            raise InputError("is empty; name a log file", f"{key}.files")
        paths = [context.file(f, f"{key}.files[{n}]", source=self.source) for n, f in enumerate(files)]
        try:
            columns = {name: signal.recorded() for name, signal in signals.items()}
            return read_recording(
                paths, columns, time=self.time.declared(), sample_time=self.sample_time_s, late_rows=self.late_rows,
                empty_rows=self.empty_rows, form=self.form(), progress=context.progress,
            )  # fmt: skip
        except (TrajectoryError, UnitError) as error:
            raise InputError(str(error), key) from error


class LogFiles(LogSampling):
    """Files and sampling of logs; a kind adds its signals."""

    files: list[str] = FILES

    def sessions(
        self, signals: Mapping[str, Signal], context: Context, *, files: list[str] | None = None,
        key: str = "log.files", called: Mapping[str, str] | None = None,
    ) -> tuple[Session, ...]:  # fmt: skip
        """Read `files`, or the files of the section, with `read`."""
        return self.read(files_of(self.files, signals) if files is None else files, signals, context, key, called)
