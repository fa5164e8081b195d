"""File and line of a user's declarations and equations, and the ModelError that quotes them."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from dis import Instruction, get_instructions, opname
from functools import cache
from pathlib import Path
from types import CodeType, FrameType

LANG = str(Path(__file__).resolve().parent)
_OURS = str(Path(LANG).parent) + os.sep


@dataclass(frozen=True, order=True)
class SourceLocation:
    """File name (last two parts of the path) and line of a declaration or an equation; ours: a file of gtmodel."""

    file: str
    line: int
    ours: bool = field(default=False, compare=False)

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@cache
def _short(filename: str) -> str:
    """Return the last two parts of a path: enough to find the file, and the same on every machine."""
    if filename.startswith("<"):
        return filename
    if "ipykernel" in filename and (cell := _notebook_cell(filename)) is not None:
        return cell
    plain = os.path.normpath(filename)  # `python ../model.py` is the same file
    return "/".join(plain.replace("\\", "/").rsplit("/", 2)[-2:])


def _notebook_cell(filename: str) -> str | None:
    """Return "Cell In[3]" for a notebook's temporary file, whose name changes with every kernel."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    code_name = getattr(getattr(shell, "compile", None), "format_code_name", lambda name: None)(filename)
    return None if code_name is None else " ".join(code_name)


def _callers() -> FrameType:
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(LANG):
        frame = frame.f_back
    return frame


def here() -> SourceLocation:
    """Return the location of the innermost calling frame outside the language package."""
    frame = _callers()
    return of_frame(frame.f_code.co_filename, frame.f_lineno)


def dropped() -> str | None:
    """Detect that the calling statement, outside the language package, discards the result of a comparison or call.

    Returns "" for `a == b` alone on a line, for which Python compares and then pops; "e" for `e = a == b` in a function
    that never reads its local variable e; None if the result may be used.
    """
    frame = _callers()
    code, current = frame.f_code.co_code, frame.f_lasti
    after = current + 2
    while opname[code[current]] == "CACHE":  # some versions of Python point at the last cache entry of a call
        current -= 2
    if opname[code[current]] not in ("COMPARE_OP", "CALL", "CALL_KW"):
        return None
    while opname[code[after]] == "CACHE":
        after += 2
    if opname[code[after]] == "POP_TOP":
        return ""
    # globals and closure variables may be read elsewhere, and a call may use its comparison internally
    if opname[code[current]] != "COMPARE_OP" or not opname[code[after]].startswith("STORE_FAST"):
        return None
    name = next(_names(i)[0] for i in get_instructions(frame.f_code) if i.offset == after)
    return name if name != "_" and name not in _read(frame.f_code) else None


@cache
def _read(code: CodeType) -> frozenset[str]:
    """Return the local variables that a function reads; all of them if it may read them by name, as with eval."""
    if {"locals", "vars", "eval", "exec"} & set(code.co_names):
        return frozenset(code.co_varnames)
    read: set[str] = set()
    for i in get_instructions(code):
        if i.opname.startswith("LOAD_FAST"):
            read.update(_names(i))
        elif i.opname.startswith("STORE_FAST_LOAD_FAST"):  # one instruction in newer versions of Python
            read.add(_names(i)[1])
    return frozenset(read)


def _names(i: Instruction) -> tuple[str, ...]:
    """Return the local variables of an instruction: one, or two in newer versions of Python."""
    return i.argval if isinstance(i.argval, tuple) else (i.argval,)


def of_frame(filename: str, line: int) -> SourceLocation:
    """Return the location for a code object's file name and a line number."""
    return SourceLocation(_short(filename), line, filename.startswith(_OURS))


class ModelError(ValueError):
    """An error in a model. The message states what was found, what was expected, and the file and line.

    It is a ValueError. `where` is the `SourceLocation` of the line, or None. `argument` names the argument of a call
    that the error concerns, such as "start.x"; it may be empty.

    >>> class Wrong(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     t = gt.variable(unit="s")
    ...     def equations(self):
    ...         yield self.x == self.t
    >>> try:
    ...     Wrong().causal(known="t", targets="x")
    ... except gt.ModelError as error:
    ...     print(error, "| line", error.where.line)
    units differ in '==': left is m, right is s; ... | line 5
    """

    def __init__(self, sentence: str, where: SourceLocation | None = None) -> None:
        complete = where is None or f"({where})" in sentence
        super().__init__(sentence if complete else f"{sentence} ({where})")
        self.where = where
        self.argument = ""

    def placed(self, where: SourceLocation | None) -> None:
        """Add a location to a message that has none."""
        if self.where is None and where is not None and not re.search(r"\.(?:py|mop?):\d+|\]:\d+", str(self)):
            self.args, self.where = (f"{self} ({where})",), where


@contextmanager
def about(argument: str) -> Iterator[None]:
    """Set `argument`, such as "start.x", of every ModelError raised inside."""
    try:
        yield
    except ModelError as error:
        error.argument = error.argument or argument
        raise
