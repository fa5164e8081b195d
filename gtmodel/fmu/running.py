"""One instance of a unit in co-simulation, run by FMPy."""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import tempfile
import weakref
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..loop.plant import PlantStopped
from ..results.refusal import ArgumentError
from .export import Fmu
from .signals import UnitSignals

NEEDS_FMPY = "running a unit needs FMPy; install it by pip install 'gtmodel[fmi]'"
WHOLE = 1e-9  # how near a ratio of steps is to a whole number: decimals of the description
_KEPT = 64  # last sentences of its log
_SAME_TIME = 1e-9  # of a time that a unit says it reached, over it or one second
_DISCARD = 2  # statuses: OK, warning, discard, error, fatal, pending
_STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
_SHORT = 0.01  # of a step: a unit that ends farther from its end, and than its own step, did not make it
_LAST_TIME, _TERMINATED = 2, 3  # kinds of status of FMI 2.0


class UnitStopped(PlantStopped):
    """A unit that has no answer on the way: one sentence with the time and what the unit says; `time` [s] is where it
    was last well."""


class RunningUnit:
    """One instance of a unit in co-simulation, by FMPy; variables by their names in the description.

    path: of the archive, FMI 2.0 or 3.0, or what `export` gave. start: values by name in the unit's own units, set
    before it begins.

    Raises ArgumentError without FMPy, for an archive that it cannot read, that has no co-simulation or nothing for this
    machine, for names that are no real variables of it, near names said, for a start of what has none and one that the
    unit refuses; UnitStopped where a step ends without an answer.
    """

    def __init__(self, path: str | Path | Fmu, start: Mapping[str, float] | None = None) -> None:
        if find_spec("fmpy") is None:
            raise ArgumentError(NEEDS_FMPY, "path")
        fmpy: Any = import_module("fmpy")
        folder = tempfile.mkdtemp(prefix="gtmodel-fmu-")
        self._free = weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        if isinstance(path, Fmu):
            (own := Path(folder) / f"{path.table.name}.fmu").write_bytes(path.data)
            path = own
        try:
            description = fmpy.read_model_description(str(path))
            fmpy.extract(str(path), folder)
        except Exception as error:
            raise ArgumentError(f"FMPy cannot read '{path}': {_first(error)}", "path") from error
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
        self._said: deque[tuple[int, str]] = deque(maxlen=_KEPT)
        self._start = dict(start or {})
        self._references = {name: s.reference for name, s in self.signals.all.items()}
        self.signals.settable(list(self._start), "start")
        with _at_home():
            self._unit: Any = self._made(folder, description)
        self._free.detach()
        self._free = weakref.finalize(self, _freed, self._unit, folder)
        self.time = 0.0
        self._begin()

    def _made(self, folder: str, description: Any) -> Any:
        simulation: Any = import_module("fmpy.simulation")
        said = self._said  # not self: the callback lives as long as the instance

        def two(component: Any, name: bytes, status: int, category: bytes, message: bytes) -> None:
            said.append((status, _text(message)))

        def three(environment: Any, status: int, category: bytes, message: bytes) -> None:
            said.append((status, _text(message)))

        # FMPy prints what it cannot do; stdout belongs to whoever called
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                return simulation.instantiate_fmu(
                    folder, description, "CoSimulation", debug_logging=True, logger=three if self._three else two
                )
        except Exception as error:
            raise ArgumentError(f"'{self.name}' cannot be run here: {self._sentence(_first(error))}", "path") from error

    def _begin(self) -> None:
        """From instantiated to the first step."""
        self._said.clear()
        try:
            if self._start:
                self._set(list(self._start), list(self._start.values()))
            if self._three:
                self._unit.enterInitializationMode(startTime=0.0)
            else:
                self._unit.setupExperiment(startTime=0.0)
                self._unit.enterInitializationMode()
            self._unit.exitInitializationMode()
        except Exception as error:
            argument = "start" if self._start else "path"
            raise ArgumentError(f"'{self.name}' does not begin: {self._sentence(_first(error))}", argument) from error
        self.time = 0.0

    def restart(self) -> None:
        """Back to the start, with the same start values."""
        self._unit.reset()
        self._begin()

    def places(self, names: Sequence[str], argument: str) -> list[int]:
        """Value references of variables. Raises ArgumentError for a name that is none."""
        return [s.reference for s in self.signals.of(names, argument)]

    def set(self, names: Sequence[str], values: Sequence[float] | np.ndarray) -> None:
        """Sets variables by name. Raises UnitStopped where the unit refuses them."""
        self.signals.of(names, "inputs")
        self._said.clear()
        try:
            self._set(names, values)
        except Exception as error:
            raise self._stopped(f"takes no {', '.join(names)} at {self.time:.6g} s", _first(error)) from error

    def _set(self, names: Sequence[str], values: Sequence[float] | np.ndarray) -> None:
        references = [self._references[name] for name in names]
        (self._unit.setFloat64 if self._three else self._unit.setReal)(references, list(map(float, values)))

    def get(self, names: Sequence[str]) -> np.ndarray:
        """Values of variables by name. Raises UnitStopped where there are none, or no finite ones."""
        references = self.places(names, "outputs")
        self._said.clear()
        try:
            values = np.array((self._unit.getFloat64 if self._three else self._unit.getReal)(references))
        except Exception as error:
            raise self._stopped(f"has no {', '.join(names)} at {self.time:.6g} s", _first(error)) from error
        if not np.all(np.isfinite(values)):
            bad = [f"{n} = {x:g}" for n, x in zip(names, values, strict=True) if not np.isfinite(x)]
            raise self._stopped(f"has {', '.join(bad)} at {self.time:.6g} s", "that is no number")
        return values

    def step(self, length: float) -> None:
        """Goes on by `length` [s]. Raises UnitStopped where it cannot, or asks to end."""
        self._said.clear()
        end = self.time + length
        fault, reached = (self._step_three if self._three else self._step_two)(length)
        if fault:
            inside = self.time + _SAME_TIME * max(1.0, end) < reached <= end
            well = f", well until {reached:.6g} s" if inside else ""
            where = f"stopped between {self.time:.6g} and {end:.6g} s{well}"
            raise self._stopped(where, fault, reached if inside else None)
        self.time = end

    def _step_three(self, length: float) -> tuple[str, float]:
        """What is wrong, empty if nothing is, and the time that was reached."""
        fmi3: Any = import_module("fmpy.fmi3")
        ctypes: Any = import_module("ctypes")
        event, ends, early = (fmi3.fmi3Boolean() for _ in range(3))
        last = fmi3.fmi3Float64(np.nan)
        fault = ""
        try:
            self._unit.fmi3DoStep(
                self._unit.component, self.time, length, fmi3.fmi3Boolean(True),
                *map(ctypes.byref, (event, ends, early, last)),
            )  # fmt: skip
        except Exception as error:
            fault = _first(error)
        if not fault and ends.value:
            fault = "it asked to end"
        if not fault and early.value:
            fault = "it returned early, which was not allowed"
        if not fault and event.value:
            fault = "it wants an event to be handled, which co-simulation without events does not"
        end, reached = self.time + length, float(last.value)
        if not fault and abs(reached - end) > max(self.inner_step or 0.0, _SHORT * length):
            fault = "it says it ended elsewhere"
        return fault, reached

    def _step_two(self, length: float) -> tuple[str, float]:
        try:
            self._unit.doStep(currentCommunicationPoint=self.time, communicationStepSize=length)
        except Exception as error:
            fault, reached = _first(error), self.time
            with contextlib.suppress(Exception):  # a unit may lack the call
                if self._unit.getBooleanStatus(_TERMINATED):
                    fault = "it asked to end"
            with contextlib.suppress(Exception):
                reached = float(self._unit.getRealStatus(_LAST_TIME))
            return fault, reached
        return "", self.time

    def _stopped(self, what: str, fault: str, time: float | None = None) -> UnitStopped:
        """The exception of a fault; time: until which it was well."""
        at = self.time if time is None else time
        return UnitStopped(f"'{self.name}' {what}: {self._sentence(fault)}", at)

    def _sentence(self, otherwise: str) -> str:
        """What the unit itself said last of what went wrong."""
        bad = [text for status, text in self._said if status >= _DISCARD and text]
        return bad[-1] if bad else otherwise


def _first(error: Exception) -> str:
    """One line of an exception, statuses by their words."""
    status = getattr(error, "status", None)
    if isinstance(status, int) and 0 <= status < len(_STATUS):
        return f"{getattr(error, 'function', 'a call')} gave {_STATUS[status]}, and it said nothing"
    return next(iter(str(error).splitlines()), type(error).__name__)


def _text(message: bytes | None) -> str:
    """As one line without what moves a terminal."""
    text = (message or b"").decode("utf-8", "replace")
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def _freed(unit: Any, folder: str) -> None:
    """The end of an instance and of its files."""
    with contextlib.suppress(Exception):
        unit.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def _at_home() -> Iterator[None]:
    """FMPy loads a library from its folder, and stays there where that fails."""
    here = os.getcwd()
    try:
        yield
    finally:
        os.chdir(here)
