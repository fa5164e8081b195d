"""Instructions at many points at once: an interpreter in C, compiled once per machine.

CasADi's virtual machine evaluates one point after the other; for a function with 200,000 operations it reads every
operation from memory for each point. Here an operation is read once for several points, whose values are contiguous.
The operations are those of `columns.source` with the same rounding, so the results equal the virtual machine's.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache

import casadi as ca
import numpy as np

from ..columns.machine import FLAGS, TEXT
from ..columns.program import EXACT, LIBM, on_columns
from ..toolchain import CompilerMissing, kept_library
from .operations import Tape

AT_ONCE = 32  # points
LEAF = -1  # in place of the operation: an input or a constant
KNOWN = frozenset([*EXACT, *LIBM, ca.OP_INPUT, ca.OP_CONST, ca.OP_OUTPUT])

_SOURCE = """#include <math.h>
#include <stddef.h>
#include <string.h>
#define AT_ONCE %(at_once)d
#define EACH(value) for (i = 0; i < AT_ONCE; ++i) z[i] = value; memcpy(work[c[3]], z, sizeof z); break;
typedef double Column[AT_ONCE];
/* four numbers in a vector where the processor can: the same operations, rounded alike */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

/* The operations that the results need, depth first, as [operation, place, place, place of what it gives]; a place is
   taken again when nobody reads it any more. first: of a leaf its place. room: 4 n. Returns how many operations;
   *places: how many places. result: numbers, then their places. */
long gt_tape_plan(long n, const int *op, const int *first, const int *second, long results, int *result, int *code,
                  int *room, long *places) {
  int *place = room, *last = room + n, *stack = room + 2 * n, *order = room + 3 * n;
  long steps = 0, free = 0, r, s, top;
  for (s = 0; s < n; ++s) place[s] = op[s] < 0 ? first[s] : -1;
  for (r = 0; r < results; ++r) {
    top = 0;
    stack[top++] = result[r];
    while (top > 0) {
      const int k = stack[top - 1];
      if (place[k] != -1) --top;
      else if (place[first[k]] == -1) stack[top++] = first[k];
      else if (second[k] >= 0 && place[second[k]] == -1) stack[top++] = second[k];
      else {
        place[k] = 0;
        order[steps++] = k;
        --top;
      }
    }
  }
  for (s = 0; s < n; ++s) last[s] = -1;
  for (s = 0; s < steps; ++s) {
    const int k = order[s];
    last[first[k]] = (int)s;
    if (second[k] >= 0) last[second[k]] = (int)s;
  }
  for (r = 0; r < results; ++r) last[result[r]] = (int)steps;
  for (s = 0; s < steps; ++s) {
    const int k = order[s], x = first[k], y = second[k] >= 0 ? second[k] : first[k];
    int *c = code + 4 * s;
    c[0] = op[k];
    c[1] = place[x];
    c[2] = place[y];
    if (op[x] >= 0 && last[x] == s) stack[free++] = place[x];
    if (x != y && op[y] >= 0 && last[y] == s) stack[free++] = place[y];
    c[3] = place[k] = free > 0 ? stack[--free] : (int)(*places)++;
  }
  for (r = 0; r < results; ++r) result[r] = place[result[r]];
  return steps;
}

WIDE static void run(long steps, const int *code, Column *work) {
  const int *c = code, *end = code + 4 * steps;
  int i;
  for (; c < end; c += 4) {
    const double *x = work[c[1]], *y = work[c[2]];
    Column z;
    switch (c[0]) {
%(cases)s
    }
  }
}

/* in[a]: sizes[a] numbers for each of the points, one point behind the other, NULL for zeros; out[a] alike, NULL where
   it is not wanted. Inputs have the first places, then the constants. */
void gt_tape_run(long steps, const int *code, long inputs, const long *sizes, const double *const *in, long outputs,
                 const long *widths, const int *result, double *const *out, long numbers, const double *constants,
                 Column *work, long points) {
  long p, a, e, k, i, m;
  for (k = 0, a = 0; a < inputs; ++a) k += sizes[a];
  for (e = 0; e < numbers; ++e)
    for (i = 0; i < AT_ONCE; ++i) work[k + e][i] = constants[e];
  for (p = 0; p < points; p += AT_ONCE) {
    m = points - p < AT_ONCE ? points - p : AT_ONCE;
    for (k = 0, a = 0; a < inputs; ++a)
      for (e = 0; e < sizes[a]; ++e, ++k)
        for (i = 0; i < AT_ONCE; ++i)
          work[k][i] = in[a] == NULL ? 0.0 : in[a][(p + (i < m ? i : m - 1)) * sizes[a] + e];
    run(steps, code, work);
    for (k = 0, a = 0; a < outputs; ++a)
      for (e = 0; e < widths[a]; ++e, ++k)
        if (out[a] != NULL)
          for (i = 0; i < m; ++i) out[a][(p + i) * widths[a] + e] = work[result[k]][i];
  }
}
"""


def source() -> str:
    def value(op: int) -> str:
        return TEXT[op].format("x[i]", "y[i]") if op in TEXT else f"{LIBM[op]}({_arguments(op)})"

    cases = "\n".join(f"    case {op}: EACH(({value(op)}))" for op in sorted({*EXACT, *LIBM}))
    return _SOURCE % {"at_once": AT_ONCE, "cases": cases}


def _arguments(op: int) -> str:
    return "x[i], y[i]" if op in (ca.OP_ATAN2, ca.OP_POW, ca.OP_CONSTPOW) else "x[i]"


@cache
def interpreter(build: bool) -> ctypes.CDLL | None:
    """Return the library, built if it does not exist and `build` is set; None if it is not available."""
    try:
        library = kept_library(source(), FLAGS[1:], build)
        return None if library is None else ctypes.CDLL(str(library))
    except (CompilerMissing, OSError):
        return None


class Interpreted:
    """Instructions evaluated at many points with the library of `interpreter`.

    code: (steps, 4): operation, places of its operands and of its result. Places 0, 1, ... hold the entries of all
    inputs, then the constants; result: the places of the entries of all outputs.
    """

    def __init__(
        self, library: ctypes.CDLL, code: np.ndarray, places: int, constants: Sequence[float], result: np.ndarray,
        inputs: Sequence[int], outputs: Sequence[int],
    ) -> None:  # fmt: skip
        """inputs, outputs: number of entries of each."""
        self._run = library.gt_tape_run
        self._code, self._places, self._result = code, places, result
        self._constants = np.array(constants, float)
        self.inputs, self.outputs = list(inputs), list(outputs)
        self._sizes, self._widths = np.array(self.inputs, np.int_), np.array(self.outputs, np.int_)

    @classmethod
    def of_tape(
        cls, library: ctypes.CDLL, tape: Tape, inputs: Sequence[int], outputs: Sequence[Sequence[int]]
    ) -> Interpreted:
        """Create it from columns of entries of a tape; inputs: number of the tape's inputs in each argument."""
        n, own = len(tape.op), sum(inputs)
        op, first, second = (np.array(a, np.int32) for a in (tape.op, tape.first, tape.second))
        constants = list(tape.constants)
        first[constants] = own + np.arange(len(constants))
        op[(op == ca.OP_INPUT) | (op == ca.OP_CONST)] = LEAF
        result = np.array([k for numbers in outputs for k in numbers], np.int32)
        code, room = np.empty((n, 4), np.int32), np.empty((4, n), np.int32)
        places = ctypes.c_long(own + len(constants))
        plan = library.gt_tape_plan
        plan.restype = ctypes.c_long
        steps = plan(
            ctypes.c_long(n), _at(op), _at(first), _at(second), ctypes.c_long(len(result)), _at(result),
            _at(code), _at(room), ctypes.byref(places),
        )  # fmt: skip
        widths = [len(numbers) for numbers in outputs]
        return cls(library, code[:steps].copy(), places.value, [*tape.constants.values()], result, inputs, widths)

    @classmethod
    def of_function(cls, library: ctypes.CDLL, f: ca.Function) -> Interpreted | None:
        """Create it from the instructions of a function with dense columns as inputs and dense outputs; None for other
        functions, and if the interpreter lacks an operation."""
        if not on_columns(f):
            return None
        op = [f.instruction_id(k) for k in range(f.n_instructions())]
        if not set(op) <= KNOWN:
            return None
        inputs, outputs = [f.size1_in(k) for k in range(f.n_in())], [f.numel_out(k) for k in range(f.n_out())]
        begin = np.cumsum([0, *inputs]).tolist()
        work = begin[-1] + op.count(ca.OP_CONST)
        ends = np.cumsum([work + f.sz_w(), *outputs]).tolist()
        constants: list[float] = []
        code: list[tuple[int, int, int, int]] = []
        for k, each in enumerate(op):
            put, given = f.instruction_output(k), f.instruction_input(k)
            if each == ca.OP_INPUT:
                x = begin[given[0]] + given[1]
                code.append((ca.OP_ASSIGN, x, x, work + put[0]))
            elif each == ca.OP_CONST:
                x = begin[-1] + len(constants)
                constants.append(f.instruction_constant(k))
                code.append((ca.OP_ASSIGN, x, x, work + put[0]))
            elif each == ca.OP_OUTPUT:
                x = work + given[0]
                code.append((ca.OP_ASSIGN, x, x, ends[put[0]] + put[1]))
            else:
                code.append((each, work + given[0], work + given[-1], work + put[0]))
        result = np.arange(ends[0], ends[-1], dtype=np.int32)
        return cls(library, np.array(code, np.int32).reshape(-1, 4), ends[-1], constants, result, inputs, outputs)

    @property
    def steps(self) -> int:
        return len(self._code)

    def __call__(self, inputs: Sequence[np.ndarray | None], outputs: Sequence[np.ndarray | None], points: int) -> None:
        """Evaluate; inputs and outputs are float64 with one point after another."""
        given = (ctypes.c_void_p * max(len(inputs), 1))(*[None if a is None else a.ctypes.data for a in inputs])
        wanted = (ctypes.c_void_p * max(len(outputs), 1))(*[None if a is None else a.ctypes.data for a in outputs])
        work = np.empty((self._places, AT_ONCE))
        long = ctypes.c_long
        self._run(
            long(self.steps), _at(self._code), long(len(inputs)), _at(self._sizes), given, long(len(outputs)),
            _at(self._widths), _at(self._result), wanted, long(len(self._constants)), _at(self._constants), _at(work),
            long(points),
        )  # fmt: skip


def known(tape: Tape) -> bool:
    """Return whether the interpreter has all operations of a tape."""
    return set(tape.op) <= KNOWN


def _at(a: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(a.ctypes.data)
