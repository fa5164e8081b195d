"""A unit of ours called by ctypes, for comparison with Python: co-simulation, both versions, no other package."""

from __future__ import annotations

import ctypes as c
import io
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .export import Fmu

_NO = c.c_bool(False)


class _Callbacks(c.Structure):
    _fields_ = [(name, c.c_void_p) for name in ("logger", "allocate", "free", "finished", "environment")]


class UnitCaller:
    """One instance for co-simulation of the library in the archive, unpacked into `place`.

    Statuses are those of the standard: 0 OK, 2 Discard, 3 Error.
    """

    def __init__(self, unit: Fmu, place: Path) -> None:
        with zipfile.ZipFile(io.BytesIO(unit.data)) as archive:
            archive.extractall(place)
        self._three = unit.version == 3
        self._prefix = f"fmi{unit.version}"
        self._library = c.CDLL(str(next((place / "binaries").rglob("*.so"))))
        token = unit.token.encode()
        if self._three:
            make = self._function("InstantiateCoSimulation", c.c_void_p)
            instance = make(b"gt", token, b"", _NO, _NO, _NO, _NO, None, c.c_size_t(0), None, None, None)
        else:
            self._callbacks = _Callbacks()
            instance = self._function("Instantiate", c.c_void_p)(b"gt", 1, token, b"", c.byref(self._callbacks), 0, 0)
        self._instance = c.c_void_p(instance)

    def _function(self, name: str, result: Any = c.c_int) -> Any:
        function = self._library[f"{self._prefix}{name}"]
        function.restype = result
        return function

    def _do(self, name: str, *arguments: Any) -> int:
        return int(self._function(name)(self._instance, *arguments))

    def begin(self, references: Sequence[int], values: Sequence[float], time: float = 0.0) -> int:
        """Anew from these start values and this time. The worst status on the way."""
        status = self._do("Reset")
        if len(references):
            status = max(status, self.set(references, values))
        start, none = c.c_double(time), c.c_double()
        if self._three:
            status = max(status, self._do("EnterInitializationMode", _NO, none, start, _NO, none))
        else:
            status = max(status, self._do("SetupExperiment", 0, none, start, 0, none))
            status = max(status, self._do("EnterInitializationMode"))
        return max(status, self._do("ExitInitializationMode"))

    def set(self, references: Sequence[int], values: Sequence[float]) -> int:
        """Sets numbers."""
        return self._values("SetFloat64" if self._three else "SetReal", references, np.array(values, float))

    def set_integers(self, references: Sequence[int], values: Sequence[int]) -> int:
        """Sets integers."""
        return self._values("SetInt32" if self._three else "SetInteger", references, np.array(values, np.int32))

    def get(self, references: Sequence[int]) -> tuple[int, np.ndarray]:
        """Status, and numbers; NaN where none were written."""
        values = np.full(len(references), np.nan)
        return self._values("GetFloat64" if self._three else "GetReal", references, values), values

    def get_integers(self, references: Sequence[int]) -> tuple[int, np.ndarray]:
        """Status, and integers."""
        values = np.full(len(references), -1, np.int32)
        return self._values("GetInt32" if self._three else "GetInteger", references, values), values

    def _values(self, name: str, references: Sequence[int], values: np.ndarray) -> int:
        where = np.array(references, np.uint32)
        size = c.c_size_t(len(where))
        more = [c.c_size_t(len(values))] if self._three else []
        return self._do(name, c.c_void_p(where.ctypes.data), size, c.c_void_p(values.ctypes.data), *more)

    def step(self, time: float, length: float) -> int:
        """Goes on from `time` by `length` [s]."""
        if self._three:
            flags, last = [c.c_bool() for _ in range(3)], c.c_double()
            given = [c.c_double(time), c.c_double(length), c.c_bool(True), *map(c.byref, flags), c.byref(last)]
            return self._do("DoStep", *given)
        return self._do("DoStep", c.c_double(time), c.c_double(length), 1)

    def close(self) -> None:
        """Frees the instance."""
        self._function("FreeInstance", None)(self._instance)
