"""Number types of generated C, double or float; conversion of C in double to C in float; text that is safe inside C."""

from __future__ import annotations

import math
import re
import textwrap
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..compiler.analysis.sizes import DOUBLE as DOUBLE_PRECISION, Precision
from ..compiler.causal import PIVOT_TOLERANCE
from ..compiler.toolchain import LIBM
from ..results.refusal import ArgumentError

WIDTH = 110


class GenerationError(ArgumentError):
    """Raised if code cannot be generated, written or compared; the message is one plain sentence."""


def comment_safe(text: str) -> str:
    """Return the text as one line of ASCII that cannot end a comment or continue a line."""
    line = " ".join(text.split()).replace("*/", "* /").replace("/*", "/ *").replace("??/", "?? /")
    return line.encode("ascii", "backslashreplace").decode("ascii").rstrip("\\")


def comment(lines: list[str], indent: str = "") -> str:
    """Return a block comment of wrapped paragraphs; an empty paragraph is an empty line."""
    width = WIDTH - len(indent) - 3
    wrapped: list[str] = []
    for line in lines:
        safe = comment_safe(line)
        hang = "  " if line.startswith("- ") else ""
        wrapped += textwrap.wrap(safe, width, subsequent_indent=hang, break_long_words=False) or [""]
    if len(wrapped) == 1:
        return f"{indent}/* {wrapped[0]} */\n"
    first, *rest = wrapped
    body = "".join(f"{indent} * {line}".rstrip() + "\n" for line in rest)
    return f"{indent}/* {first}\n{body}{indent} */\n"


def hexadecimal(value: float) -> str:
    """Return a double as a C constant with all its bits; NAN and INFINITY by their names in math.h."""
    if value != value:
        return "NAN"
    if value in (float("inf"), float("-inf")):
        return "INFINITY" if value > 0 else "-INFINITY"
    return value.hex()


def decimal(value: float) -> str:
    """Return a double as the shortest decimal constant that reads back as the same double."""
    return repr(float(value))


@dataclass(frozen=True)
class Real:
    """A number type. name: in C. dtype, bits: in NumPy. pivot: least pivot, as a fraction of its typical size.
    residual: largest residual of a Newton solution, as a fraction of what one nominal of each unknown gives.
    round_off: Newton steps below it, in nominals, need not shrink. held: value of outputs before a test.
    awkward: inputs that are singular, denormal or overflow when squared. precision: sets the limits of the inputs."""

    name: str
    dtype: Any
    bits: Any
    pivot: float
    residual: float
    round_off: float
    held: float
    awkward: tuple[float, ...]
    precision: Precision

    def array(self, values: Any) -> np.ndarray:
        """Return the values rounded to this type; infinite beyond its range."""
        with np.errstate(over="ignore"):
            return np.asarray(values, dtype=self.dtype)


# residual: far above round-off of equations on squared lengths (1e-15), far below the errors of robot measurements
DOUBLE = Real(
    "double", np.float64, np.int64, PIVOT_TOLERANCE, 1e-11, 1e-10, -1.25e300, (0.0, 5e-324, -1e-310, 1e160, -1e300),
    DOUBLE_PRECISION,
)  # fmt: skip
# float has a round-off of 6e-8: divided by a pivot of 1e-2 it is 6e-6, a residual of 1e-6 is some tens of round-offs,
# and 1e-3 of a metre is a millimetre
FLOAT = Real(
    "float", np.float32, np.int32, 1e-2, 1e-6, 1e-5, -1.25e30, (0.0, 1e-45, -1e-40, 1e25, -1e38),
    Precision(2.0**-24, 1e-3, 2.0**40),
)  # fmt: skip

# largest difference of float from double for the same function, as a fraction of the range of the signal
FLOAT_TOLERANCE = 1e-5


def real_of(name: str) -> Real:
    """Return DOUBLE or FLOAT by its name in C. Raises GenerationError for another name."""
    for real in (DOUBLE, FLOAT):
        if real.name == name:
            return real
    raise GenerationError(f"'{name}' is no kind of number for generated code; give 'double' or 'float'")


# shared names that involve numbers get the suffix f, as in libm, so that a project may hold both types
_NAMES = """
    gt_all_equal gt_all_finite gt_copy gt_filter gt_filter_advance gt_filter_along gt_filter_begin
    gt_filter_belief gt_filter_correct gt_filter_cycle gt_filter_fill gt_filter_gated gt_filter_instant
    gt_filter_judge gt_filter_judged gt_filter_kernel gt_filter_matrix gt_filter_memory gt_filter_motion
    gt_filter_move gt_filter_multiply gt_filter_noise gt_filter_outcome gt_filter_plus gt_filter_product
    gt_filter_rows gt_filter_sensor gt_filter_spread gt_filter_sum gt_filter_turn gt_filter_use gt_filter_used
    gt_filter_work gt_newton gt_newton_kernel gt_newton_lu gt_newton_marks gt_stage_qp gt_stage_qp_advanced
    gt_stage_qp_aimed gt_stage_qp_at gt_stage_qp_begun gt_stage_qp_call gt_stage_qp_centred gt_stage_qp_changed
    gt_stage_qp_column gt_stage_qp_copy gt_stage_qp_eliminated gt_stage_qp_excess gt_stage_qp_factored
    gt_stage_qp_fed gt_stage_qp_finite gt_stage_qp_followed gt_stage_qp_graded gt_stage_qp_judged
    gt_stage_qp_kept gt_stage_qp_kernel gt_stage_qp_larger gt_stage_qp_limit gt_stage_qp_measured
    gt_stage_qp_moved gt_stage_qp_offset gt_stage_qp_one_row gt_stage_qp_outcome gt_stage_qp_place
    gt_stage_qp_pulled gt_stage_qp_pushed gt_stage_qp_sloped gt_stage_qp_smaller gt_stage_qp_solve
    gt_stage_qp_stage gt_stage_qp_status gt_stage_qp_stepped gt_stage_qp_thickened gt_stage_qp_three_rows
    gt_stage_qp_tried gt_stage_qp_weighed gt_stage_qp_work gt_traj gt_traj_at gt_traj_end_ms
"""
FILTER = (
    "gt_filter.h", "gt_filter_correct.h", "gt_filter_matrix.h", "gt_filter_motion.h", "gt_filter_number.h",
    "gt_filter_types.h",
)  # fmt: skip
STAGE_QP = (
    "gt_stage_qp.h", "gt_stage_qp_factor.h", "gt_stage_qp_limits.h", "gt_stage_qp_riccati.h", "gt_stage_qp_sides.h",
    "gt_stage_qp_types.h",
)  # fmt: skip
HEADERS = ("gt_guard.h", "gt_compare.h", "gt_newton.h", "gt_traj.h", *FILTER, *STAGE_QP)
_WORDS = {
    "double": "float",
    "DBL_MAX": "FLT_MAX",
    "HUGE_VAL": "HUGE_VALF",
    **{name: f"{name}f" for name in _NAMES.split()},
    **{name: f"{name}f" for name in LIBM},
    **{f"{h[:-2].upper()}_H": f"{h[:-2].upper()}F_H" for h in HEADERS},
}
_INCLUDE = re.compile(r'#include "(\w+)\.h"')
_TOKEN = re.compile(
    r"""
    (?P<skip>/\*.*?\*/ | "(?:\\.|[^"\\\n])*" | \#\s*error[^\n]* | \#\s*include[^\n]*)
  | (?P<hexadecimal>\b0[xX][0-9a-fA-F]+(?:\.[0-9a-fA-F]*)?[pP][+-]?\d+)
  | (?P<decimal>(?<![\w.])(?:\d+\.\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?|\d+[eE][+-]?\d+))
  | (?P<word>[A-Za-z_]\w*)
    """,
    re.X | re.S,
)


def file_name(name: str) -> str:
    """Return the name of a shared header in float; other names are unchanged."""
    return f"{name[:-2]}f.h" if name in HEADERS else name


def single(text: str) -> str:
    """Return the text of a C file in float. Comments, strings and messages are unchanged.

    Raises GenerationError for a constant that float cannot hold.
    """
    text = _INCLUDE.sub(lambda m: f'#include "{file_name(m[1] + ".h")}"', text)
    text = re.sub(r"(#define GT_NEWTON_ROUND_OFF) \S+", rf"\1 {FLOAT.round_off}", text)
    return _TOKEN.sub(_in_float, text)


def _in_float(token: re.Match[str]) -> str:
    if token["word"]:
        return _WORDS.get(token["word"], token["word"])
    if token["skip"]:
        return token["skip"]
    exact = float.fromhex(token[0]) if token["hexadecimal"] else float(token[0])
    value = float(FLOAT.array(exact))
    if math.isinf(value) or (value == 0.0) != (exact == 0.0):
        raise GenerationError(f"the constant {token[0]} is beyond the range of float; generate double")
    # written as the rounded float: a compiler may round seventeen decimals differently
    return (value.hex() if token["hexadecimal"] else str(np.float32(value))) + "f"
