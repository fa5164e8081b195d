"""Where a person wrote a declaration: file and line, quoted in every model error."""

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
    """File name (last two path parts) and line of a declaration or an equation; ours: the file is gtmodel's own."""

    file: str
    line: int
    ours: bool = field(default=False, compare=False)

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@cache
def _short(filename: str) -> str:
    """The last two parts of a path: enough to find the file, the same on every machine."""
    if filename.startswith("<"):
        return filename
    if "ipykernel" in filename and (cell := _notebook_cell(filename)) is not None:
        return cell
    plain = os.path.normpath(filename)  # `python ../model.py` is the same file
    return "/".join(plain.replace("\\", "/").rsplit("/", 2)[-2:])


def _notebook_cell(filename: str) -> str | None:
    """ "Cell In[3]" for a notebook's temporary file, whose name changes with every kernel."""
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
    """Location of the innermost calling frame outside the language package itself."""
    frame = _callers()
    return of_frame(frame.f_code.co_filename, frame.f_lineno)


def dropped() -> str | None:
    """What the statement that compares or calls, in the innermost calling frame outside the language package, loses: ""
    for `a == b` alone on its line, for which Python compares and then pops, "e" for `e = a == b` in a function that
    never reads its own name e. None where something may still take it."""
    frame = _callers()
    code, at = frame.f_code.co_code, frame.f_lasti
    after = at + 2
    while opname[code[at]] == "CACHE":  # of a call some versions of Python stand at the last one
        at -= 2
    if opname[code[at]] not in ("COMPARE_OP", "CALL", "CALL_KW"):
        return None
    while opname[code[after]] == "CACHE":
        after += 2
    if opname[code[after]] == "POP_TOP":
        return ""
    # names of modules and of closures others may read; a call may have compared for purposes of its own
    if opname[code[at]] != "COMPARE_OP" or not opname[code[after]].startswith("STORE_FAST"):
        return None
    name = next(_names(i)[0] for i in get_instructions(frame.f_code) if i.offset == after)
    return name if name != "_" and name not in _read(frame.f_code) else None


@cache
def _read(code: CodeType) -> frozenset[str]:
    """Names of its own that a function reads somewhere; all of them where it may do so by name."""
    if {"locals", "vars", "eval", "exec"} & set(code.co_names):
        return frozenset(code.co_varnames)
    read: set[str] = set()
    for i in get_instructions(code):
        if i.opname.startswith("LOAD_FAST"):
            read.update(_names(i))
        elif i.opname.startswith("STORE_FAST_LOAD_FAST"):  # one instruction of newer Pythons
            read.add(_names(i)[1])
    return frozenset(read)


def _names(i: Instruction) -> tuple[str, ...]:
    """Of the local variables of an instruction: one, or two in newer Pythons."""
    return i.argval if isinstance(i.argval, tuple) else (i.argval,)


def of_frame(filename: str, line: int) -> SourceLocation:
    """Location from a code object's file name and a line number."""
    return SourceLocation(_short(filename), line, filename.startswith(_OURS))


class ModelError(ValueError):
    """A model is wrong: the sentence says what was found, what was expected and where it was written.

    It is a ValueError; `where` is the `SourceLocation` of the line concerned, or None; `argument` the value given to a
    call that it is about, such as "start.x", or nothing.

    >>> class Wrong(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     t = gt.variable(unit="s")
    ...     def equations(self):
    ...         yield self.x == self.t
    >>> try:
    ...     Wrong().causal(known="t", targets="x")
    ... except gt.ModelError as error:
    ...     print(error, "| line", error.where.line)
    units do not fit in '==': left is m, right is s; ... | line 5
    """

    def __init__(self, sentence: str, where: SourceLocation | None = None) -> None:
        said = where is None or f"({where})" in sentence  # a place is named once
        super().__init__(sentence if said else f"{sentence} ({where})")
        self.where = where
        self.argument = ""

    def placed(self, where: SourceLocation | None) -> None:
        """Say a place where the sentence names none."""
        if self.where is None and where is not None and not re.search(r"\.(?:py|mop?):\d+|\]:\d+", str(self)):
            self.args, self.where = (f"{self} ({where})",), where


@contextmanager
def about(argument: str) -> Iterator[None]:
    """A ModelError that is raised inside says that it is about this value of a call, such as "start.x"."""
    try:
        yield
    except ModelError as error:
        error.argument = error.argument or argument
        raise
