"""C in double as C in float: types, constants, functions of libm, and names of the shared headers."""

from __future__ import annotations

import math
import re

import numpy as np

from ..compiler.toolchain import LIBM
from .real import FLOAT
from .text import GenerationError

# shared names that speak of numbers get the f that libm gives to its functions in float: a project may hold both
_NAMES = """
    gt_all_equal gt_all_finite gt_copy gt_filter gt_filter_advance gt_filter_along gt_filter_begin gt_filter_belief
    gt_filter_correct gt_filter_cycle gt_filter_fill gt_filter_gated gt_filter_instant gt_filter_judge
    gt_filter_judged gt_filter_kernel gt_filter_matrix gt_filter_memory gt_filter_motion gt_filter_move
    gt_filter_multiply gt_filter_noise gt_filter_outcome gt_filter_plus gt_filter_product gt_filter_rows
    gt_filter_sensor gt_filter_spread gt_filter_sum gt_filter_turn gt_filter_use gt_filter_used gt_filter_work
    gt_newton gt_newton_kernel gt_newton_lu gt_newton_marks gt_traj gt_traj_at gt_traj_end_ms
"""
FILTER = (
    "gt_filter.h", "gt_filter_correct.h", "gt_filter_matrix.h", "gt_filter_motion.h", "gt_filter_number.h",
    "gt_filter_types.h",
)  # fmt: skip
HEADERS = ("gt_guard.h", "gt_compare.h", "gt_newton.h", "gt_traj.h", *FILTER)
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
    """Name of a shared header in float; other names stay."""
    return f"{name[:-2]}f.h" if name in HEADERS else name


def single(text: str) -> str:
    """The text of a C file in float. Comments, strings and messages stay.

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
    # written as the float that it is: a compiler may round seventeen decimals the other way
    return (value.hex() if token["hexadecimal"] else str(np.float32(value))) + "f"
