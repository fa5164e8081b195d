"""What the command line shows to people: tables on stdout, progress on stderr; Ctrl-C and SIGTERM ask to stop."""

from __future__ import annotations

import codecs
import ctypes
import io
import os
import signal
import sys
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
# a study that does not ask is ended some two seconds after it was to end
GRACE_S, EVERY_S = 1.4, 0.2
SECOND, AGAIN = 2, 20  # which of the alarms ends it


def opened() -> None:
    """A standard stream that is closed (`>&-`) leads nowhere from here on: else the next file that is opened would take
    its number, and what a solver prints would stand in a result."""
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
    """From here on what the terminal's encoding lacks is spelled with what it has: a result is never lost to a sign."""
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
    """Ctrl-C is an exception again; `gtmodel/__init__.py` let it end the process while the imports ran."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        with suppress(ValueError):  # not the main thread
            signal.signal(signal.SIGINT, signal.default_int_handler)


def hush() -> None:
    """Let nothing more be said on a stdout that is closed or full, not even when Python ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def table(head: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> None:
    """Print one table. Texts are shown as they are: a bracket is no markup."""
    if not sys.stdout.isatty():
        from gtmodel.results.plain_table import plain

        print(plain(head, [list(row) for row in rows], title))
        return
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    shown = Table(box=SIMPLE_HEAD, title=Text(title) if title else None, title_justify="left", pad_edge=False)
    for name in head:
        shown.add_column(name, overflow="fold")
    for row in rows:
        shown.add_row(*(Text(cell) for cell in row))
    console = Console()
    with console.capture() as captured:
        console.print(shown)
    # rich pads every line to the width of the table
    print("\n".join(line.rstrip() for line in captured.get().splitlines()).strip("\n"))


def outcome_table(title: str, outcome: Study) -> None:
    """Print one study: its status, its rows, its checks; the message below. A failure's goes to stderr."""
    from gtmodel.results.table import HEAD, cells

    table(HEAD, cells(outcome), title)
    if outcome.status.ok and outcome.message not in (outcome.status.message, outcome.status.value):
        print(f"\n{outcome.message}")


@contextmanager
def nothing_on_stdout() -> Iterator[None]:
    """What a model, a solver or a compiler prints meanwhile goes to stderr: stdout holds one JSON object only."""
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
    """Push out what C code still holds in its own buffer for stdout."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).fflush(None)


def _late(context: Context) -> Callable[[int, Any], None]:
    """What an alarm does: it ends a study that was to end and does not ask. Not at the first one, which may come right
    before a solver's callback asks, and not again before what was kept could be made."""
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
    """Progress on stderr, unless `quiet`; the first Ctrl-C asks for a stop, which shows as `stopping`, the second one
    breaks off. SIGTERM, of a batch system or of `timeout`, and a terminal that is closed ask likewise."""

    def interrupt(number: int, _frame: Any) -> None:
        if context.stop_requested:
            raise KeyboardInterrupt
        context.request_stop()
        alarm(GRACE_S)
        with suppress(OSError):  # the terminal may be gone
            again = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
            sentence = f"{stopping}; {again} again breaks off"
            try:
                print(sentence, file=sys.stderr)
            except RuntimeError:  # the signal came while the stream itself was being written to
                os.write(2, f"{sentence}\n".encode())

    def notice(sentence: str) -> None:
        print(sentence, file=sys.stderr)

    def alarm(seconds: float) -> None:
        if getattr(signal, "SIGALRM", None) in before:  # none on Windows
            signal.setitimer(signal.ITIMER_REAL, seconds, EVERY_S)

    context.notice = notice
    before: dict[int, Any] = {}
    with suppress(ValueError):  # not the main thread: nobody asks it to stop
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
