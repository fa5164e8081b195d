"""Run one instance of an FMU in co-simulation, in a separate process; FMPy reads its description."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..loop.plant import PlantStopped
from ..results.agreement import Within, agree, numbers_of
from ..results.disk import path_of, scratch
from ..results.refusal import ArgumentError
from .caller import LONGEST_S, TIMEOUT_S
from .content import ArchiveFault, unpack
from .export import Fmu
from .process import UnitEnded, UnitProcess, one_line
from .signals import UnitSignals

NEEDS_FMPY = "running an FMU needs FMPy; install it with pip install 'gtmodel[fmi]'"
WHOLE = 1e-9  # tolerance of whole ratios of steps, for decimals in the description
_SAME_TIME = 1e-9  # tolerance of a time that a unit reports, relative to max(1 s, time)
_DISCARD = 2  # statuses: OK, warning, discard, error, fatal, pending
_STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
ABOVE_ZERO = (Within(above=0.0),)
_SHORT = 0.01  # share of a step: a unit that misses its end by more, and by more than its inner step, has failed

Values = Sequence[float] | np.ndarray


class UnitStopped(PlantStopped):
    """An FMU failed on the way. The sentence has the time and the FMU's own message; `time` [s]: last good time."""


class RunningUnit:
    """One instance of an FMU in co-simulation, in a separate process; variables have their names in the description.

    path: of the archive, FMI 2.0 or 3.0, or the result of `export`. start: start values by name, in the FMU's own
    units. timeout: of a call of the FMU [s]; its process is ended if a call takes longer.

    Threads may share the instance: calls wait for each other. Forked processes may not: create one in each process.

    Raises ArgumentError without FMPy; for an archive that cannot be read, or lacks co-simulation or a library for this
    machine; for unknown real variables, with similar names; unless there is one number for each name; for a step length
    that is not positive; for a start value that the variable cannot have or that the FMU rejects. Raises UnitStopped if
    a
    step fails, or if the FMU crashes, ends its process or does not return.
    """

    def __init__(
        self, path: str | Path | Fmu, start: Mapping[str, float] | None = None, *, timeout: float = TIMEOUT_S
    ) -> None:
        if find_spec("fmpy") is None:
            raise ArgumentError(NEEDS_FMPY, "path")
        agree(timeout, float, "timeout", (Within(above=0.0, most=LONGEST_S),))
        agree(start, Mapping[str, Any] | None, "start")
        self._start = dict(start or {})
        for name, value in self._start.items():
            agree(value, float, f"start.{name}")
        unit = path if isinstance(path, Fmu) else path_of(path)
        with ExitStack() as files:
            folder = files.enter_context(scratch("gtmodel-fmu-"))
            self._open(unit, folder, timeout, files)
            self._free = weakref.finalize(self, files.pop_all().close)

    def _open(self, unit: Path | Fmu, folder: Path, timeout: float, files: ExitStack) -> None:
        """Start the process and the FMU, up to the first step. files: takes callbacks that free both."""
        if isinstance(unit, Fmu):
            (path := folder / f"{unit.table.name}.fmu").write_bytes(unit.data)
        else:
            path = unit
        description = _read(path, folder / "unit")
        stepping = description.coSimulation
        if stepping is None:
            raise ArgumentError(
                f"'{path}' offers only model exchange, which needs a solver; export it with co-simulation",
                "path",
            )
        self.name = str(description.modelName)
        self.version = str(description.fmiVersion)
        self.signals = UnitSignals(self.name, description)
        text = stepping.fixedInternalStepSize  # FMI 3.0 only
        inner = 0.0 if text is None else float(text)
        self.inner_step = inner if 0.0 < inner < np.inf else None  # the schema allows NaN and INF
        self._three = self.version.startswith("3")
        self._references = {name: s.reference for name, s in self.signals.all.items()}
        self.signals.settable(list(self._start), "start")
        try:
            self._process = UnitProcess(folder, timeout)
        except OSError as error:
            raise ArgumentError(f"no process can be started for '{self.name}': {error.strerror}", "path") from error
        files.callback(self._process.close)
        self._log, self._failure = self._process.log, ""
        self._prepare([_instantiation(folder / "unit", description, self._three)], "cannot be run here", "path")
        self._begin()

    def _prepare(self, calls: Sequence[tuple[Any, ...]], what: str, argument: str) -> None:
        """Make calls before the first step. Raises ArgumentError if one fails."""
        self._log.clear()
        try:
            fault = _sentence(self._process.ask(calls)[1])
        except UnitEnded as ended:
            raise ArgumentError(f"'{self.name}' {what}: {ended}", argument) from ended
        if fault:
            raise ArgumentError(f"'{self.name}' {what}: {self._message(fault)}", argument)

    def _begin(self) -> None:
        """Initialise the FMU for the first step."""
        names, argument = list(self._start), "start" if self._start else "path"
        values = numbers_of(names, list(self._start.values()), "start").tobytes()
        self._prepare([("begin", self._places(names), values)], "does not start", argument)
        self.time = 0.0

    def restart(self) -> None:
        """Return to the start, with the same start values. If the FMU returns an error, it cannot be used any more."""
        with self._process.held():
            try:
                self._prepare([("reset",)], "cannot be reset", "path")
                self._begin()
            except ArgumentError as error:
                self._failure = error.message
                raise
            self._failure = ""

    def _places(self, names: Sequence[str]) -> bytes:
        return np.array([self._references[name] for name in names], np.uintc).tobytes()

    def set(self, names: Sequence[str], values: Values) -> None:
        """Set variables by name. Raises UnitStopped if the FMU returns an error."""
        self._run([(names, values)], None, None)

    def get(self, names: Sequence[str]) -> np.ndarray:
        """Return variables by name. Raises UnitStopped if the FMU returns an error, or if a value is not finite."""
        return self._run([], None, names)

    def step(self, length: float) -> None:
        """Step by `length` [s]. Raises UnitStopped if the step fails or the FMU requests to end."""
        agree(length, float, "length", ABOVE_ZERO)
        self._run([], length, None)

    def advance(
        self, given: Sequence[tuple[Sequence[str], Values]], length: float, outputs: Sequence[str]
    ) -> np.ndarray:
        """Set each (names, values), step by `length` [s] and return outputs, in one message to the FMU's process.

        Equivalent to `set`, `step` and `get`. Raises UnitStopped as they do.
        """
        agree(length, float, "length", ABOVE_ZERO)
        return self._run(given, length, outputs)

    def _run(
        self, inputs: Sequence[tuple[Sequence[str], Values]], length: float | None, outputs: Sequence[str] | None
    ) -> np.ndarray:
        """Set inputs, step unless the length is None, and return outputs unless None."""
        sets: list[tuple[Any, ...]] = []
        for names, values in inputs:
            self.signals.of(names, "inputs")
            sets.append(("set", self._places(names), numbers_of(names, values, "values").tobytes()))
        if outputs is not None:
            self.signals.of(outputs, "outputs")
        with self._process.held():
            return self._exchange(inputs, sets, length, outputs)

    def _exchange(
        self,
        inputs: Sequence[tuple[Sequence[str], Values]],
        sets: Sequence[tuple[Any, ...]],
        length: float | None,
        outputs: Sequence[str] | None,
    ) -> np.ndarray:
        calls = [*sets]
        if length is not None:
            calls.append(("step", self.time, float(length)))
        if outputs is not None:
            calls.append(("get", self._places(outputs)))
        if self._failure:
            raise UnitStopped(self._failure, self.time)
        self._log.clear()
        try:
            results, fault = self._process.ask(calls)
        except UnitEnded as ended:
            stepping = length is not None and ended.function.endswith("DoStep")
            when = (
                f"between {self.time:.6g} and {self.time + (length or 0.0):.6g}" if stepping else f"at {self.time:.6g}"
            )
            raise UnitStopped(f"'{self.name}' stopped {when} s: {ended}", self.time) from ended
        message, failed = _sentence(fault), len(results) - 1 if fault else len(calls)
        if failed < len(inputs):
            raise self._stopped(f"refuses {', '.join(inputs[failed][0])} at {self.time:.6g} s", message)
        if length is not None:
            self._check_step(length, results[len(inputs)], message if failed == len(inputs) else "")
        return self._numbers(outputs, results[-1], message) if outputs is not None else np.zeros(0)

    def _numbers(self, names: Sequence[str], values: bytes, fault: str) -> np.ndarray:
        if fault:
            raise self._stopped(f"has no {', '.join(names)} at {self.time:.6g} s", fault)
        numbers = np.frombuffer(values).copy()
        if not np.all(np.isfinite(numbers)):
            bad = [f"{n} = {x:g}" for n, x in zip(names, numbers, strict=True) if not np.isfinite(x)]
            raise self._stopped(f"has {', '.join(bad)} at {self.time:.6g} s", "expected a finite number")
        return numbers

    def _check_step(self, length: float, result: tuple[bool, bool, bool, float], fault: str) -> None:
        """Advance the time if the step succeeded, otherwise raise. fault: status of the call in words, if it failed."""
        event, ends, early, reached = result
        end = self.time + length
        if ends and (not fault or not self._three):
            fault = "it requested to end"
        if not fault and early:
            fault = "it returned early, which was not allowed"
        if not fault and event:
            fault = "it requested event handling, which is not supported"
        if not fault and self._three and abs(reached - end) > max(self.inner_step or 0.0, _SHORT * length):
            fault = "it reported another end time"
        if fault:
            inside = self.time + _SAME_TIME * max(1.0, end) < reached <= end
            good = f", good until {reached:.6g} s" if inside else ""
            interval = f"stopped between {self.time:.6g} and {end:.6g} s{good}"
            raise self._stopped(interval, fault, reached if inside else None)
        self.time = end

    def _stopped(self, what: str, fault: str, time: float | None = None) -> UnitStopped:
        """Return the exception of a fault; time: last good time."""
        return UnitStopped(f"'{self.name}' {what}: {self._message(fault)}", self.time if time is None else time)

    def _message(self, otherwise: str) -> str:
        """Return the FMU's own last error message, if it logged one."""
        errors = [line for status, text in self._log if status >= _DISCARD and (line := one_line(text))]
        return errors[-1] if errors else otherwise


def _read(path: Path, folder: Path) -> Any:
    """Unpack an archive into the folder; return its description."""
    fmpy: Any = import_module("fmpy")
    try:
        unpack(path, folder)
    except ArchiveFault as fault:
        raise ArgumentError(f"'{path}' {fault}", "path") from fault
    try:
        return fmpy.read_model_description(str(folder))
    except Exception as error:
        lines = [line.strip(" -") for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
        raise ArgumentError(f"FMPy cannot read '{path}': {' '.join(lines[:2])}", "path") from error


def _instantiation(folder: Path, description: Any, three: bool) -> tuple[Any, ...]:
    """Return the call that creates the instance: library, version, name, token, resources, FMPy's library for logs."""
    fmpy: Any = import_module("fmpy")
    name = description.coSimulation.modelIdentifier
    place = folder / "binaries" / (fmpy.platform_tuple if three else fmpy.platform)
    resources = f"{folder / 'resources'}/" if three else (folder / "resources").as_uri()
    try:
        proxy = "" if three else str(import_module("fmpy.logging").logging._name)
    except (OSError, AttributeError):  # FMPy has this library for some machines only
        proxy = ""
    library = str(place / f"{name}{fmpy.sharedLibraryExtension}")
    return ("make", library, 3 if three else 2, name, str(description.guid), resources, proxy)


def _sentence(fault: Any) -> str:
    """Return a sentence about a failed call; empty if no call failed."""
    if fault is None or len(fault) == 1:
        return one_line(fault[0]) or "without a message" if fault else ""
    function, status = fault
    word = _STATUS[status] if 0 <= status < len(_STATUS) else f"the unknown status {status}"
    return f"{function} returned {word}, without a message"
