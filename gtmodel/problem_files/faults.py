"""Any exception of a run as a status and one plain sentence: bad input, a fault in a person's code, or ours."""

from __future__ import annotations

import os
import sysconfig
import traceback
from pathlib import Path

from gtmodel.lang import ModelError, UnitError
from gtmodel.results import SolveStatus, TrajectoryError, UnknownNameError

from .base import InputError
from .python_models import fault, sentence_of

LONGEST = 300
_PACKAGE = str(Path(__file__).resolve().parents[1]) + os.sep
_NOBODYS = (_PACKAGE + "lang" + os.sep, _PACKAGE + "__init__.py", sysconfig.get_path("stdlib") + os.sep, "<")


def describe(error: BaseException, path: str = "") -> tuple[SolveStatus, str]:
    """Status and sentence of at most `LONGEST` characters; `path` is the problem file."""
    status, sentence = _described(error, shortened(path, LONGEST // 2))
    return status, shortened(sentence, LONGEST)


def shortened(text: str, most: int) -> str:
    """A text of at most `most` characters: what it begins with, and its end, which says what to do; cut at blanks."""
    if len(text) <= most:
        return text
    end = most // 3
    head, tail = text[: most - end - 5], text[-end:]
    return f"{head.rpartition(' ')[0] or head} ... {tail.partition(' ')[2] or tail}"


def _described(error: BaseException, path: str) -> tuple[SolveStatus, str]:
    if isinstance(error, InputError):
        about_an_option = error.message.startswith("--") and not error.key
        return SolveStatus.BAD_INPUT, str(error if about_an_option else error.within(path))
    prefix = f"{path}: " if path else ""
    if isinstance(error, ModelError):
        # "arm.py:FiveBar: " and "FiveBar: 1 equation ..." name the model once
        return SolveStatus.BAD_INPUT, prefix + sentence_of(error).removeprefix(f"{path.rpartition(':')[2]}: ")
    if isinstance(error, (UnitError, TrajectoryError, UnknownNameError)):
        return SolveStatus.BAD_INPUT, f"{prefix}{error}"
    if isinstance(error, OSError) and error.filename is not None:
        return SolveStatus.BAD_INPUT, f"{prefix}{error.filename}: {error.strerror}"
    if isinstance(error, KeyboardInterrupt):
        return SolveStatus.INTERRUPTED, f"{prefix}stopped before there was a result"
    if _in_persons_code(error):
        return SolveStatus.BAD_INPUT, prefix + fault(error, "the model")
    text = shortened(" ".join(str(error).split()), LONGEST // 2)
    return SolveStatus.FAILED, (
        f"{prefix}internal error: {type(error).__name__}: {text}; please report it, with the traceback "
        "that gtmodel --debug shows"
    )


def _in_persons_code(error: BaseException) -> bool:
    """True when the last code before the fault, the language and libraries apart, is not gtmodel's."""
    owner = ""
    for frame in traceback.extract_tb(error.__traceback__):
        name = frame.filename
        if not name.startswith(_NOBODYS) and "site-packages" not in name:
            owner = name
    return bool(owner) and not owner.startswith(_PACKAGE)
