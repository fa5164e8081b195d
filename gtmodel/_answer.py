"""End of a command: a table or one JSON object on stdout, an error sentence on stderr, and the exit code."""

from __future__ import annotations

import sys
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer.exceptions import TyperException

from gtmodel import _terminal as terminal

if TYPE_CHECKING:
    from gtmodel.problem_files.run import Finished

_EXIT = {"solved": 0, "bad_input": 2}


class Answer:
    """Result of a command: problem, kind, and a finished run or other data to print. `brief` counts passed checks."""

    def __init__(self, problem: str) -> None:
        self.problem = problem
        self.kind: str | None = None
        self.title = ""
        self.brief = False
        self.finished: Finished | None = None
        self.data: dict[str, Any] | None = None

    def load(self, problem: str, settings: Sequence[str] | None) -> Any:
        """Load the problem that is asked for, and take over its kind and title."""
        from gtmodel.problem_files.load import load, refuse_twice

        refuse_twice(settings or ())
        loaded = load(problem, settings or ())
        self.problem, self.kind = loaded.name, loaded.problem.kind
        self.title = loaded.problem.title or loaded.path.stem
        if loaded.shipped:
            print(f"there is no {problem} here; using the one shipped with gtmodel: {loaded.path}", file=sys.stderr)
        return loaded


@contextmanager
def answering(context: typer.Context, as_json: bool, subject: str) -> Iterator[Answer]:
    """Turn the result or the exception of the block into a table or JSON object, an error sentence and an exit code."""
    began = time.monotonic()
    answer = Answer(Path(subject).name)
    try:
        with terminal.nothing_on_stdout() if as_json else nullcontext(), warnings.catch_warnings():
            if not context.obj:  # NumPy's warnings that matter show in the status of the result
                warnings.simplefilter("ignore", RuntimeWarning)
                warnings.showwarning = lambda message, *_, **__: print(f"{subject}: {message}", file=sys.stderr)
            yield answer
    except (typer.Exit, BrokenPipeError):
        raise
    except BaseException as error:
        if context.obj:
            traceback.print_exc()
        from gtmodel.problem_files import python_models

        status, sentence = python_models.describe(error, subject)
        print(sentence, file=sys.stderr)
        if as_json:
            from gtmodel.results import Study
            from gtmodel.results.as_json import summary

            failed = Study(status=status, message=sentence)
            print_json(summary(answer.problem, answer.kind, failed, time.monotonic() - began))
        raise typer.Exit(_EXIT.get(status, 1)) from None
    if answer.finished is None:
        if as_json and answer.data is not None:
            print_json(answer.data)
        return
    outcome, wall_s = answer.finished.outcome, answer.finished.wall_s
    if as_json:
        from gtmodel.results.as_json import summary

        print_json(summary(answer.problem, answer.kind, outcome, wall_s))
    else:
        terminal.outcome_table(answer.title, outcome, answer.brief)
        for path in answer.finished.files:
            print(f"wrote {path}")
    if not outcome.status.ok:
        print(f"{subject}: {outcome.message}", file=sys.stderr)
    code = _EXIT.get(outcome.status, 1)
    if answer.finished.unwritten:
        print(answer.finished.unwritten, file=sys.stderr)
        code = code or 1
    raise typer.Exit(code)


def print_json(data: dict[str, Any]) -> None:
    from gtmodel.results.as_json import line

    text = line(data)
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:  # JSON can escape every character
        text = line(data, ascii_only=True)
    print(text)


def refused(error: TyperException, words: list[str], commands: set[str]) -> int:
    """Answer a wrong option, or no command at all, by one sentence; return the exit code."""
    from gtmodel._near import plain

    sentence = plain(error.format_message().rstrip("."), words, commands)
    if not words:
        print(sentence)
        return error.exit_code
    called = " ".join(["gtmodel", *words[:1]])
    command = called if words[0] in commands else "gtmodel"
    print(f"{called}: {sentence}; '{command} --help' shows the options.", file=sys.stderr)
    if "--json" in words:
        from gtmodel.results import SolveStatus, Study
        from gtmodel.results.as_json import summary

        print_json(summary("", None, Study(status=SolveStatus.BAD_INPUT, message=sentence), 0.0))
    return 2
