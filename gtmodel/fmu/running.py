"""One instance of a unit in co-simulation, in a process of its own; FMPy reads its description."""

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

NEEDS_FMPY = "running a unit needs FMPy; install it by pip install 'gtmodel[fmi]'"
WHOLE = 1e-9  # how near a ratio of steps is to a whole number: decimals of the description
_SAME_TIME = 1e-9  # of a time that a unit says it reached, over it or one second
_DISCARD = 2  # statuses: OK, warning, discard, error, fatal, pending
_STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
ABOVE_ZERO = (Within(above=0.0),)
_SHORT = 0.01  # of a step: a unit that ends farther from its end, and than its own step, did not make it

Values = Sequence[float] | np.ndarray


class UnitStopped(PlantStopped):
    """A unit that has no answer on the way: one sentence with the time and what the unit says; `time` [s] is where it
    was last well."""


class RunningUnit:
    """One instance of a unit in co-simulation, in a process of its own; variables by their names in the description.

    path: of the archive, FMI 2.0 or 3.0, or what `export` gave. start: values by name in the unit's own units, set
    before it begins. timeout: of a call of the unit [s], beyond which its process is ended.

    Threads may share it: a call waits for that of another. A process that is forked may not: make one in each process.

    Raises ArgumentError without FMPy, for an archive that it cannot read, that has no co-simulation or nothing for this
    machine, for names that are no real variables of it, near names said, for values other than a number for each name,
    for a step of no length, for a start of what has none and one that the unit refuses; UnitStopped where a step ends
    without an answer, and where the unit crashes, ends its process or does not return.
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
        given = path if isinstance(path, Fmu) else path_of(path)
        with ExitStack() as files:
            folder = files.enter_context(scratch("gtmodel-fmu-"))
            self._made(given, folder, timeout, files)
            self._free = weakref.finalize(self, files.pop_all().close)

    def _made(self, given: Path | Fmu, folder: Path, timeout: float, files: ExitStack) -> None:
        """Up to the first step. files: takes what is to be freed."""
        if isinstance(given, Fmu):
            (path := folder / f"{given.table.name}.fmu").write_bytes(given.data)
        else:
            path = given
        description = _read(path, folder / "unit")
        stepping = description.coSimulation
        if stepping is None:
            raise ArgumentError(
                f"'{path}' offers no co-simulation, only model exchange, which needs a solver; export it with "
                "co-simulation",
                "path",
            )
        self.name = str(description.modelName)
        self.version = str(description.fmiVersion)
        self.signals = UnitSignals(self.name, description)
        inner = stepping.fixedInternalStepSize  # a text, of FMI 3.0 only
        own = 0.0 if inner is None else float(inner)
        self.inner_step = own if 0.0 < own < np.inf else None  # NaN and INF are numbers of its schema too
        self._three = self.version.startswith("3")
        self._references = {name: s.reference for name, s in self.signals.all.items()}
        self.signals.settable(list(self._start), "start")
        try:
            self._process = UnitProcess(folder, timeout)
        except OSError as error:
            raise ArgumentError(f"no process can be started for '{self.name}': {error.strerror}", "path") from error
        files.callback(self._process.close)
        self._said, self._astray = self._process.said, ""
        self._begun([_making(folder / "unit", description, self._three)], "cannot be run here", "path")
        self._begin()

    def _begun(self, calls: Sequence[tuple[Any, ...]], what: str, argument: str) -> None:
        """Raises ArgumentError where a call before the first step goes wrong."""
        self._said.clear()
        try:
            wrong = _sentence(self._process.ask(calls)[1])
        except UnitEnded as ended:
            raise ArgumentError(f"'{self.name}' {what}: {ended}", argument) from ended
        if wrong:
            raise ArgumentError(f"'{self.name}' {what}: {self._own(wrong)}", argument)

    def _begin(self) -> None:
        """From instantiated to the first step."""
        names, argument = list(self._start), "start" if self._start else "path"
        values = numbers_of(names, list(self._start.values()), "start").tobytes()
        self._begun([("begin", self._places(names), values)], "does not begin", argument)
        self.time = 0.0

    def restart(self) -> None:
        """Back to the start, with the same start values. Where the unit refuses, it is not run on."""
        with self._process.held():
            try:
                self._begun([("reset",)], "does not go back to its start", "path")
                self._begin()
            except ArgumentError as error:
                self._astray = error.message
                raise
            self._astray = ""

    def _places(self, names: Sequence[str]) -> bytes:
        return np.array([self._references[name] for name in names], np.uintc).tobytes()

    def set(self, names: Sequence[str], values: Values) -> None:
        """Sets variables by name. Raises UnitStopped where the unit refuses them."""
        self._run([(names, values)], None, None)

    def get(self, names: Sequence[str]) -> np.ndarray:
        """Values of variables by name. Raises UnitStopped where there are none, or no finite ones."""
        return self._run([], None, names)

    def step(self, length: float) -> None:
        """Goes on by `length` [s]. Raises UnitStopped where it cannot, or asks to end."""
        agree(length, float, "length", ABOVE_ZERO)
        self._run([], length, None)

    def advance(
        self, given: Sequence[tuple[Sequence[str], Values]], length: float, outputs: Sequence[str]
    ) -> np.ndarray:
        """Sets each (names, values), goes on by `length` [s] and gets outputs, in one message to the unit's process.

        The same as `set`, `step` and `get` one after another. Raises UnitStopped as they do.
        """
        agree(length, float, "length", ABOVE_ZERO)
        return self._run(given, length, outputs)

    def _run(
        self, given: Sequence[tuple[Sequence[str], Values]], length: float | None, outputs: Sequence[str] | None
    ) -> np.ndarray:
        """What is set, a step if there is a length, outputs if they are asked for."""
        sets: list[tuple[Any, ...]] = []
        for names, values in given:
            self.signals.of(names, "inputs")
            sets.append(("set", self._places(names), numbers_of(names, values, "values").tobytes()))
        if outputs is not None:
            self.signals.of(outputs, "outputs")
        with self._process.held():
            return self._answered(given, sets, length, outputs)

    def _answered(
        self,
        given: Sequence[tuple[Sequence[str], Values]],
        sets: Sequence[tuple[Any, ...]],
        length: float | None,
        outputs: Sequence[str] | None,
    ) -> np.ndarray:
        calls = [*sets]
        if length is not None:
            calls.append(("step", self.time, float(length)))
        if outputs is not None:
            calls.append(("get", self._places(outputs)))
        if self._astray:
            raise UnitStopped(self._astray, self.time)
        self._said.clear()
        try:
            results, fault = self._process.ask(calls)
        except UnitEnded as ended:
            stepping = length is not None and ended.function.endswith("DoStep")
            when = (
                f"between {self.time:.6g} and {self.time + (length or 0.0):.6g}" if stepping else f"at {self.time:.6g}"
            )
            raise UnitStopped(f"'{self.name}' stopped {when} s: {ended}", self.time) from ended
        wrong, at = _sentence(fault), len(results) - 1 if fault else len(calls)
        if at < len(given):
            raise self._stopped(f"takes no {', '.join(given[at][0])} at {self.time:.6g} s", wrong)
        if length is not None:
            self._stepped(length, results[len(given)], wrong if at == len(given) else "")
        return self._got(outputs, results[-1], wrong) if outputs is not None else np.zeros(0)

    def _got(self, names: Sequence[str], values: bytes, wrong: str) -> np.ndarray:
        if wrong:
            raise self._stopped(f"has no {', '.join(names)} at {self.time:.6g} s", wrong)
        numbers = np.frombuffer(values).copy()
        if not np.all(np.isfinite(numbers)):
            bad = [f"{n} = {x:g}" for n, x in zip(names, numbers, strict=True) if not np.isfinite(x)]
            raise self._stopped(f"has {', '.join(bad)} at {self.time:.6g} s", "that is no number")
        return numbers

    def _stepped(self, length: float, result: tuple[bool, bool, bool, float], wrong: str) -> None:
        """Goes on where the step went well. wrong: the status of the call in words, where it was none of success."""
        event, ends, early, reached = result
        end = self.time + length
        if ends and (not wrong or not self._three):
            wrong = "it asked to end"
        if not wrong and early:
            wrong = "it returned early, which was not allowed"
        if not wrong and event:
            wrong = "it wants an event to be handled, which co-simulation without events does not"
        if not wrong and self._three and abs(reached - end) > max(self.inner_step or 0.0, _SHORT * length):
            wrong = "it says it ended elsewhere"
        if wrong:
            inside = self.time + _SAME_TIME * max(1.0, end) < reached <= end
            well = f", well until {reached:.6g} s" if inside else ""
            where = f"stopped between {self.time:.6g} and {end:.6g} s{well}"
            raise self._stopped(where, wrong, reached if inside else None)
        self.time = end

    def _stopped(self, what: str, fault: str, time: float | None = None) -> UnitStopped:
        """The exception of a fault; time: until which it was well."""
        at = self.time if time is None else time
        return UnitStopped(f"'{self.name}' {what}: {self._own(fault)}", at)

    def _own(self, otherwise: str) -> str:
        """What the unit itself said last of what went wrong."""
        bad = [said for status, text in self._said if status >= _DISCARD and (said := one_line(text))]
        return bad[-1] if bad else otherwise


def _read(path: Path, folder: Path) -> Any:
    """The description of an archive, which is unpacked into the folder."""
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


def _making(folder: Path, description: Any, three: bool) -> tuple[Any, ...]:
    """The call that makes the instance: library, version, name, token, resources, FMPy's library for texts of logs."""
    fmpy: Any = import_module("fmpy")
    name = description.coSimulation.modelIdentifier
    place = folder / "binaries" / (fmpy.platform_tuple if three else fmpy.platform)
    resources = f"{folder / 'resources'}/" if three else (folder / "resources").as_uri()
    try:
        proxy = "" if three else str(import_module("fmpy.logging").logging._name)
    except (OSError, AttributeError):  # FMPy has it for some machines only
        proxy = ""
    library = str(place / f"{name}{fmpy.sharedLibraryExtension}")
    return ("make", library, 3 if three else 2, name, str(description.guid), resources, proxy)


def _sentence(fault: Any) -> str:
    """Of a call that went wrong: its function and status, or a sentence; empty for none."""
    if fault is None or len(fault) == 1:
        return one_line(fault[0]) or "it said nothing" if fault else ""
    function, status = fault
    word = _STATUS[status] if 0 <= status < len(_STATUS) else f"the status {status}, which there is not"
    return f"{function} gave {word}, and it said nothing"
