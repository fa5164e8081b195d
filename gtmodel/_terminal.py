"""Terminal of the command line: tables on stdout, progress on stderr, Ctrl-C and SIGTERM as requests to stop."""

from __future__ import annotations

import codecs
import ctypes
import io
import os
import shutil
import signal
import sys
import textwrap
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gtmodel.problem_files import Context
    from gtmodel.results import Study

_SPELLING = {"─": "-", "│": "|", "µ": "u", "μ": "u", "°": "deg", "·": "*", "×": "x", "√": "sqrt", "≤": "<=", "≥": ">="}
_STOPS = ("SIGINT", "SIGTERM", "SIGHUP")
# a study that does not check for a stop is ended about two seconds after its time
GRACE_S, EVERY_S = 1.4, 0.2
SECOND, AGAIN = 2, 20  # the alarm that ends it, and the number of alarms until the next attempt


def opened() -> None:
    """Connect closed standard streams (`>&-`) to the null device. If a stream stayed closed, the next opened file would
    get its number, and a solver would print into a result file."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            free = os.open(os.devnull, os.O_RDWR)
            if free != number:
                os.dup2(free, number)
                os.close(free)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


def printable() -> None:
    """Replace characters that the terminal cannot encode with a spelling that it can, so that no result is lost."""
    codecs.register_error("spelled", _spelled)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="spelled")


def _spelled(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    signs = error.object[error.start : error.end]
    return "".join(_SPELLING.get(sign) or _plain_letters(sign) for sign in signs), error.end


def _plain_letters(sign: str) -> str:
    return unicodedata.normalize("NFKD", sign).encode("ascii", "ignore").decode() or "?"


def interruptible() -> None:
    """Turn Ctrl-C into an exception again; `gtmodel/__init__.py` lets it end the process during the imports."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        with suppress(ValueError):  # not the main thread
            signal.signal(signal.SIGINT, signal.default_int_handler)


def hush() -> None:
    """Discard further output if stdout is closed or full, also the flush at the end of Python."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def table(head: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> None:
    """Print one table. Texts are printed literally: brackets are not markup."""
    if not sys.stdout.isatty():
        from gtmodel.results.plain_table import plain

        print(plain(head, [list(row) for row in rows], title))
        return
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    grid = Table(box=SIMPLE_HEAD, title=Text(title) if title else None, title_justify="left", pad_edge=False)
    for name in head:
        grid.add_column(name, overflow="fold")
    for row in rows:
        grid.add_row(*(Text(cell) for cell in row))
    console = Console()
    with console.capture() as captured:
        console.print(grid)
    # rich pads every line to the width of the table
    print("\n".join(line.rstrip() for line in captured.get().splitlines()).strip("\n"))


def entries(rows: Iterable[tuple[str, str]], title: str = "") -> None:
    """Print heads with indented texts, wrapped to the terminal, or to 80 columns if stdout is not a terminal."""
    width = max(shutil.get_terminal_size((80, 24)).columns, 40)
    wrap = partial(textwrap.fill, width=width, break_long_words=False, break_on_hyphens=False)
    lines = [wrap(title), ""] if title else []
    for head, text in rows:
        lines += [wrap(head, initial_indent=" ", subsequent_indent="     ")]
        lines += [wrap(text, initial_indent="     ", subsequent_indent="     ")] if text else []
    print("\n".join(lines))


def outcome_table(title: str, outcome: Study, brief: bool = False) -> None:
    """Print the status, rows and checks of a study, and below them its message. Error messages go to stderr.

    brief: count the checks that passed and list only those that failed.
    """
    from gtmodel.results.table import HEAD, cells

    table(HEAD, cells(outcome, brief), title)
    if outcome.status.ok and outcome.message not in (outcome.status.message, outcome.status.value):
        print(f"\n{outcome.message}")


@contextmanager
def nothing_on_stdout() -> Iterator[None]:
    """Send the output of models, solvers and compilers to stderr: stdout gets nothing but one JSON object."""
    sys.stdout.flush()
    try:
        saved = os.dup(1)
        os.dup2(2, 1)
    except OSError:
        saved = None
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _flush_c()
        if saved is not None:
            os.dup2(saved, 1)
            os.close(saved)


def _flush_c() -> None:
    """Flush the stdout buffer of the C library."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).fflush(None)


def _late(context: Context) -> Callable[[int, Any], None]:
    """Alarm handler that ends a study which is overdue and does not check for a stop.

    The first alarm does nothing, since a solver's callback may be about to check. After an alarm that ends the study,
    the next attempt comes only after the study had time to compute its last result.
    """
    from gtmodel.results.work import Interrupted  # here: `--help` does without numpy

    alarms = 0

    def late(_number: int, _frame: Any) -> None:
        nonlocal alarms
        alarms = alarms + 1 if context.overdue() else 0
        if alarms % AGAIN == SECOND:
            raise Interrupted("stopped within a step, before there was a result")

    return late


@contextmanager
def watching(
    context: Context, stopping: str = "stopping at the best iterate", *, quiet: bool = False
) -> Iterator[None]:
    """Show progress on stderr, unless `quiet`, and turn signals into requests to stop.

    The first Ctrl-C requests a stop and prints `stopping`; the second one aborts. SIGTERM, from a batch system or from
    `timeout`, and closing the terminal request a stop too.
    """

    def interrupt(number: int, _frame: Any) -> None:
        if context.stop_requested:
            raise KeyboardInterrupt
        context.request_stop()
        alarm(GRACE_S)
        with suppress(OSError):  # the terminal may be gone
            again = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
            sentence = f"{stopping}; {again} again aborts"
            try:
                print(sentence, file=sys.stderr)
            except RuntimeError:  # the signal came during a write to this stream
                os.write(2, f"{sentence}\n".encode())

    def notice(sentence: str) -> None:
        print(sentence, file=sys.stderr)

    def alarm(seconds: float) -> None:
        if getattr(signal, "SIGALRM", None) in before:  # none on Windows
            signal.setitimer(signal.ITIMER_REAL, seconds, EVERY_S)

    context.notice = notice
    before: dict[int, Any] = {}
    with suppress(ValueError):  # not the main thread: it gets no signals
        for name in _STOPS:
            number = getattr(signal, name, None)
            if number is None or (name == "SIGHUP" and signal.getsignal(number) is signal.SIG_IGN):  # nohup
                continue
            before[number] = signal.signal(number, interrupt)
        if hasattr(signal, "setitimer"):
            before[signal.SIGALRM] = signal.signal(signal.SIGALRM, _late(context))
            if context.max_seconds is not None:
                alarm(context.max_seconds + GRACE_S)
    try:
        with nullcontext() if quiet else _progress_of(context):
            yield
    finally:
        alarm(0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _progress_of(context: Context) -> Iterator[None]:
    from gtmodel import _progress

    if not sys.stderr.isatty():
        context.progress = lines = _progress.PlainLines(partial(print, file=sys.stderr, flush=True), _progress.EVERY_S)
        with lines.ticking():
            yield
        return
    from rich.console import Console

    with Console(stderr=True).status("working") as status:
        context.progress = _progress.LiveLine(status)
        yield
