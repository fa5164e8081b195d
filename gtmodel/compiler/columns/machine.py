"""Column programs as C code with loops that a compiler can vectorise, compiled when that pays, and their calls."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from functools import partial

import casadi as ca
import numpy as np

from ..toolchain import CompilerMissing, kept_library
from .program import LIBM, ColumnProgram, Step

# rows of the inner loops, whose columns are on the stack
AT_ONCE = 32
NAME = "gt_columns"
TEXT = {
    ca.OP_ASSIGN: "{0}", ca.OP_ADD: "{0} + {1}", ca.OP_SUB: "{0} - {1}", ca.OP_MUL: "{0} * {1}", ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}", ca.OP_SQ: "{0} * {0}", ca.OP_TWICE: "{0} + {0}", ca.OP_INV: "1.0 / {0}", ca.OP_SQRT: "sqrt({0})",
    ca.OP_FABS: "fabs({0})", ca.OP_FLOOR: "floor({0})", ca.OP_CEIL: "ceil({0})", ca.OP_LT: "{0} < {1}",
    ca.OP_LE: "{0} <= {1}", ca.OP_EQ: "{0} == {1}", ca.OP_NE: "{0} != {1}", ca.OP_NOT: "{0} == 0.0",
    ca.OP_AND: "{0} != 0.0 && {1} != 0.0", ca.OP_OR: "{0} != 0.0 || {1} != 0.0",
    # for zeros of different sign CasADi returns the first, libm's fmin the negative one
    ca.OP_FMIN: "{0} <= {1} || {1} != {1} ? {0} : {1}", ca.OP_FMAX: "{0} >= {1} || {1} != {1} ? {0} : {1}",
    ca.OP_IF_ELSE_ZERO: "{0} != 0.0 ? {1} : 0.0", ca.OP_SIGN: "{0} < 0.0 ? -1.0 : ({0} > 0.0 ? 1.0 : {0})",
}  # fmt: skip
# sqrt need not set errno; calls of libm must not be replaced by builtins
FLAGS = (
    "-O3",
    "-fno-math-errno",
    *[f"-fno-builtin-{name}" for name in sorted({*LIBM.values()} - {"sign", "fmin", "fmax"})],
)


# {inputs}, {outputs}: entries of all of them; {last}: of the last output
_FRAME = """#include <math.h>
#include <stddef.h>
#define AT_ONCE {at_once}
#define LAST {last}
typedef double Column[AT_ONCE];
/* four numbers in a vector where the processor can: the same operations, rounded alike */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

WIDE static void some(double (*restrict x)[AT_ONCE], double (*restrict y)[AT_ONCE]) {{
{body}
}}

static void load(Column *x, const double *p, long size, const long *step, long m) {{
  const long row = step[0], entry = step[1];
  long e, i;
  for (e = 0; e < size; ++e) {{
    const double *q = p + e * entry;
    if (m == AT_ONCE) {{
      for (i = 0; i < AT_ONCE; ++i) x[e][i] = q[i * row];
    }} else {{
      for (i = 0; i < AT_ONCE; ++i) x[e][i] = q[(i < m ? i : m - 1) * row];
    }}
  }}
}}

/* adds something to `doubt` where a row may be a bad one */
WIDE static void judge(double (*restrict x)[AT_ONCE], double (*restrict y)[AT_ONCE], const double *low,
                       const double *high, const double *weight, double most, double *restrict doubt) {{
  Column size;
  int i, k;
  for (i = 0; i < AT_ONCE; ++i) size[i] = 0.0;
  for (k = 0; k < {inputs}; ++k)
    for (i = 0; i < AT_ONCE; ++i) size[i] += weight[k] * (x[k][i] * x[k][i]);
  for (i = 0; i < AT_ONCE; ++i) doubt[i] += size[i] <= most ? 0.0 : 1.0;
  for (k = 0; k < {outputs} - LAST; ++k)
    for (i = 0; i < AT_ONCE; ++i) doubt[i] += 0.0 * y[k][i];
  for (k = 0; k < LAST; ++k)
    for (i = 0; i < AT_ONCE; ++i) {{
      const double margin = y[{outputs} - LAST + k][i];
      doubt[i] += (margin > low[k]) | (margin < high[k]) ? 0.0 : 1.0;
    }}
}}

/* rows begin to end from in[a], whose rows and entries lie step[2 a] and step[2 a + 1] apart, to out[a], row behind
   row, if there is one; with low, whether one of the rows may be a bad one */
long {name}(const double *const *in, const long *step, double *const *out, const double *low, const double *high,
            const double *weight, double most, long begin, long end) {{
  double x[{room_in}][AT_ONCE], y[{room_out}][AT_ONCE];
  Column doubt;
  long j, e, i, bad = 0;
  for (i = 0; i < AT_ONCE; ++i) doubt[i] = 0.0;
  for (j = begin; j < end; j += AT_ONCE) {{
    const long m = end - j < AT_ONCE ? end - j : AT_ONCE;
{loads}
    some(x, y);
{stores}
    if (low != NULL) judge(x, y, low, high, weight, most, doubt);
  }}
  for (i = 0; i < AT_ONCE; ++i) bad |= !(doubt[i] == 0.0);
  return bad;
}}
"""


def source(program: ColumnProgram) -> str:
    """Return the C source of the function that `MachineCode` calls.

    Steps are grouped into loops by the number of libm calls before them: loops without calls need no memory for
    intermediate values.
    """
    steps, values = _numbered(program)
    level: list[int] = []
    for _, operands, _ in steps:
        own = [x - values for x in operands if isinstance(x, int) and x >= values]
        level.append(max([level[k] + (steps[k].op in LIBM) for k in own], default=0))
    part = [(level[k], step.op in LIBM) for k, step in enumerate(steps)]
    stored = {
        x - values
        for k, step in enumerate(steps)
        for x in step.operands
        if isinstance(x, int) and x >= values and part[x - values] != part[k]
    }
    lines = ["  int i;", *[f"  Column t{k};" for k in sorted(stored)]]
    lines += [_constant_output(place - values, value) for place, value in program.constants]
    for each in sorted(set(part)):
        lines.append("  for (i = 0; i < AT_ONCE; ++i) {")
        lines += [f"    {_line(steps, k, part, stored, values)}" for k in range(len(steps)) if part[k] == each]
        lines.append("  }")
    sizes = [[s.stop - s.start for s in slices] for slices in (program.inputs, program.outputs)]
    loads = [
        f"    load(x + {s.start}, in[{a}] + j * step[{2 * a}], {s.stop - s.start}, step + {2 * a}, m);"
        for a, s in enumerate(program.inputs)
    ]
    stores = [
        f"    if (out[{a}] != NULL)\n"
        f"    for (e = 0; e < {size}; ++e)\n"
        f"      for (i = 0; i < m; ++i) out[{a}][(j + i) * {size} + e] = y[{s.start - values} + e][i];"
        for a, (s, size) in enumerate(zip(program.outputs, sizes[1], strict=True))
    ]
    return _FRAME.format(
        at_once=AT_ONCE, last=sizes[1][-1], name=NAME, inputs=sum(sizes[0]), outputs=sum(sizes[1]),
        room_in=max(sum(sizes[0]), 1), room_out=max(sum(sizes[1]), 1), body="\n".join(lines), loads="\n".join(loads),
        stores="\n".join(stores),
    )  # fmt: skip


def _constant_output(entry: int, value: float) -> str:
    return f"  for (i = 0; i < AT_ONCE; ++i) y[{entry}][i] = {_constant(value)};"


def _numbered(program: ColumnProgram) -> tuple[list[Step], int]:
    """Return the steps with unique numbers for their results, from `values` on in the operands; `target`: the place of
    an output, or -1."""
    values = program.inputs[-1].stop
    first = program.outputs[-1].stop if program.outputs else values
    now: dict[int, int] = {k: k for k in range(values)}
    steps: list[Step] = []
    for op, operands, target in program.steps:
        given = tuple(now[x] if isinstance(x, int) else x for x in operands)
        now[target] = values + len(steps)
        steps.append(Step(op, given, target if target < first else -1))
    return steps, values


def _line(steps: Sequence[Step], k: int, part: Sequence[tuple[int, bool]], stored: set[int], values: int) -> str:
    op, operands, target = steps[k]

    def text(x: int | float) -> str:
        if isinstance(x, float):
            return _constant(x)
        if x < values:
            return f"x[{x}][i]"
        return f"v{x - values}" if part[x - values] == part[k] else f"t{x - values}[i]"

    given = [text(x) for x in operands]
    right = TEXT[op].format(*given) if op in TEXT else f"{LIBM[op]}({', '.join(given)})"
    line = f"const double v{k} = {right};"
    if k in stored:
        line += f" t{k}[i] = v{k};"
    return line if target < 0 else f"{line} y[{target - values}][i] = v{k};"


def _constant(x: float) -> str:
    if math.isnan(x):
        return "NAN"
    if math.isinf(x):
        return "INFINITY" if x > 0 else "(-INFINITY)"
    return f"({x.hex()})"


# seconds per row of a step in NumPy, and of a libm call in CasADi's virtual machine
STEP, CALL = 0.6e-9, 20e-9
# seconds of gcc: constant, and per step
COMPILE, COMPILE_STEP = 0.2, 1e-3
# seconds spent on rows from which it pays to look for a cached library
LOOK = 0.02
# limits for gcc and for the stack
MOST_STEPS, MOST_ENTRIES = 4000, 500


class MachineCode:
    """The loaded function of `source`."""

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
        """Return a function (begin, end) that writes the results of these rows and returns whether one may be bad,
        according to the limits of a `kernel.Judge`.

        Inputs (size, n) with any strides, results (n, entries), None for results to skip; all float64.
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
    """Machine code of a program, compiled when the rows so far have taken as much time as compiling would; a cached
    library is used earlier."""

    def __init__(self, program: ColumnProgram) -> None:
        self._program = program
        self._row = len(program.steps) * STEP + program.calls * CALL
        self._spent = 0.0
        entries = max([s.stop for s in (*program.inputs, *program.outputs)], default=0)
        self._possible = len(program.steps) <= MOST_STEPS and entries <= MOST_ENTRIES
        self._looked = False
        self._made: MachineCode | None = None

    def of(self, rows: int) -> MachineCode | None:
        """Return the machine code for a call on this number of rows; None if NumPy should evaluate them."""
        if self._made is None and self._possible:
            self._spent += rows * self._row
            if self._spent >= COMPILE + COMPILE_STEP * len(self._program.steps):
                self.make(True)
            elif self._spent >= LOOK and not self._looked:
                self.make(False)
        return self._made

    def make(self, build: bool) -> bool:
        """Load the library, or build it if `build`; return whether it is available. Without a compiler or a cache
        folder NumPy is used."""
        if self._made is not None or not self._possible:
            return self._made is not None
        self._looked = True
        try:
            library = kept_library(source(self._program), FLAGS, build)
            self._made = None if library is None else MachineCode(str(library))
        except (CompilerMissing, OSError, AttributeError):
            self._possible = False  # not tried again
        return self._made is not None
