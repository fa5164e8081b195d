"""Programs on columns as machine code: whether it pays to make it, and calls of it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ..library_cache import CompilerMissing, kept_library
from .program import ColumnProgram
from .source import FLAGS, NAME, source

# seconds that a step takes NumPy for a row, and a call of libm CasADi's virtual machine
STEP, CALL = 0.6e-9, 20e-9
# seconds of gcc: at all, and for each step
COMPILE, COMPILE_STEP = 0.2, 1e-3
# seconds on rows from which it pays to look whether a library is there
LOOK = 0.02
# more than this gcc does not take, nor the stack
MOST_STEPS, MOST_ENTRIES = 4000, 500


class MachineCode:
    """The function of `source`, loaded."""

    def __init__(self, library: str) -> None:
        self._function = getattr(ctypes.CDLL(library), NAME)
        p, whole = ctypes.c_void_p, ctypes.c_long
        self._function.argtypes = [p, p, p, p, p, p, ctypes.c_double, whole, whole]
        self._function.restype = whole

    def bound(
        self,
        columns: Sequence[np.ndarray],
        results: Sequence[np.ndarray | None],
        limits: tuple[np.ndarray, np.ndarray, np.ndarray, float] | None = None,
    ) -> Callable[[int, int], bool]:
        """(begin, end) -> whether one of these rows may be a bad one, by the limits of a `kernel.Judge`; their results
        are then written.

        Inputs (size, n) with any strides, results (n, entries), None for what is not wanted; all of float64.
        """
        strides = [s // 8 for c in columns for s in (c.strides[1], c.strides[0])]
        given = (ctypes.c_void_p * len(columns))(*[_address(c) for c in columns])
        put = (ctypes.c_void_p * len(results))(*[None if r is None else _address(r) for r in results])
        low, high, weight, most = limits or (None, None, None, 0.0)
        numbers = [None if a is None else _address(a) for a in (low, high, weight)]
        function = partial(self._function, given, (ctypes.c_long * len(strides))(*strides), put, *numbers, most)
        kept = (columns, results, limits)

        def run(begin: int, end: int) -> bool:
            _ = kept
            return bool(function(begin, end))

        return run


def _address(a: np.ndarray) -> int:
    return a.ctypes.data


class Prospect:
    """Machine code of a program, made when the time that rows have taken without it has come to what making takes; one
    that is kept from another day is used sooner."""

    def __init__(self, program: ColumnProgram) -> None:
        self._program = program
        self._row = len(program.steps) * STEP + program.calls * CALL
        self._spent = 0.0
        entries = max([s.stop for s in (*program.inputs, *program.outputs)], default=0)
        self._possible = len(program.steps) <= MOST_STEPS and entries <= MOST_ENTRIES
        self._looked = False
        self._made: MachineCode | None = None

    def of(self, rows: int) -> MachineCode | None:
        """For a call on so many rows; None where NumPy is to take them."""
        if self._made is None and self._possible:
            self._spent += rows * self._row
            if self._spent >= COMPILE + COMPILE_STEP * len(self._program.steps):
                self.make(True)
            elif self._spent >= LOOK and not self._looked:
                self.make(False)
        return self._made

    def make(self, build: bool) -> bool:
        """Load the library, or build it if wanted; whether it is there. A machine without a compiler, or where nothing
        can be kept, stays with NumPy."""
        if self._made is not None or not self._possible:
            return self._made is not None
        self._looked = True
        try:
            library = kept_library(source(self._program), FLAGS, build)
            self._made = None if library is None else MachineCode(str(library))
        except (CompilerMissing, OSError, AttributeError):
            self._possible = False  # not tried again
        return self._made is not None
