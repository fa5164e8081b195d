"""Progress in a pipe or file: a plain line every ten seconds, none of short work, none with --quiet."""

from __future__ import annotations

import io
import json
import signal
import sys
import time
from pathlib import Path

import pytest

from gtmodel import _progress, _terminal
from gtmodel._progress import EVERY_S, PlainLines
from gtmodel.problem_files import Context
from gtmodel.results.work import Interrupted
from tests.support.commands import Commands
from tests.support.own_models import FILES


class Clock:
    """A clock that stands still until it is set."""

    def __init__(self) -> None:
        self.now = 1234.5

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def written() -> list[str]:
    return []


@pytest.fixture
def lines(clock: Clock, written: list[str]) -> PlainLines:
    return PlainLines(written.append, EVERY_S, clock)


def test_work_of_less_than_ten_seconds_writes_nothing(lines: PlainLines, clock: Clock, written: list[str]) -> None:
    for _ in range(99):
        lines("fitting", 0.5)
        clock.now += 0.1
        lines.tick()
    assert written == []


def test_one_line_every_ten_seconds_with_time_stage_and_share(
    lines: PlainLines, clock: Clock, written: list[str]
) -> None:
    began = clock.now
    for second in range(1, 41):
        lines("fitting", second / 40)
        clock.now = began + second
        assert 0 < lines.tick() <= 10
    assert written == ["0:00:10 fitting 25%", "0:00:20 fitting 50%", "0:00:30 fitting 75%", "0:00:40 fitting 100%"]


def test_numbers_are_shown_and_a_silent_step_keeps_its_line(
    lines: PlainLines, clock: Clock, written: list[str]
) -> None:
    clock.now += 10
    lines.tick()
    lines("optimising", None, {"iteration": 12, "objective": 1.25})
    clock.now += 10
    lines.tick()
    lines(fraction=0.1)
    clock.now += 3600
    lines.tick()
    assert written == ["0:00:10 working", "0:00:20 optimising, iteration 12, objective 1.25", "1:00:20 optimising 10%"]


def test_lines_that_were_late_are_not_made_up_for(lines: PlainLines, clock: Clock, written: list[str]) -> None:
    clock.now += 47
    assert lines.tick() == pytest.approx(3) and lines.tick() == pytest.approx(3)
    assert written == ["0:00:47 working"]


@pytest.mark.parametrize("error", [BrokenPipeError(), ValueError("I/O operation on closed file")], ids=type)
def test_a_reader_that_has_gone_breaks_nothing(error: Exception, clock: Clock) -> None:
    refused: list[str] = []

    def closed(line: str) -> None:
        refused.append(line)
        raise error

    lines = PlainLines(closed, EVERY_S, clock)
    for _ in range(2):
        clock.now += 10
        assert lines.tick() == pytest.approx(10)
    assert refused == ["0:00:10 working", "0:00:20 working"]


def test_lines_come_while_a_step_reports_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    stderr = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stderr)
    monkeypatch.setattr(_progress, "EVERY_S", 0.001)
    context = Context()
    with _terminal.watching(context):
        context.progress("deriving", 0.5)
        limit = time.monotonic() + 60
        while stderr.getvalue().count("deriving 50%") < 2 and time.monotonic() < limit:
            time.sleep(0.001)
    after = stderr.getvalue()
    context.progress("later")
    assert after.count("deriving 50%") >= 2 and stderr.getvalue() == after  # and none after the work


def test_quiet_shows_no_progress(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(_progress, "EVERY_S", 1e-6)
    context = Context()
    before = context.progress
    with _terminal.watching(context, quiet=True):
        assert context.progress is before
    assert capsys.readouterr().err == ""


def test_the_command_writes_progress_to_stderr_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(_progress, "EVERY_S", 1e-3)
    gtmodel = Commands(capsys)
    loud = gtmodel("solve", "swing.toml", "--json")
    assert loud.code == 0 and "0:00:00 " in loud.err and json.loads(loud.out) == loud.json
    quiet = gtmodel("solve", "swing.toml", "--json", "--quiet")
    assert quiet.code == 0 and "0:00:0" not in quiet.err and quiet.json["values"] == loud.json["values"]


def test_a_signal_amid_a_line_of_progress_asks_for_a_stop_all_the_same(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    class Busy:
        """As Python's own stream, which is written to when the signal comes."""

        def write(self, text: str) -> None:
            raise RuntimeError("reentrant call inside <_io.BufferedWriter name='<stderr>'>")

        def flush(self) -> None: ...

    context = Context()
    with _terminal.watching(context, quiet=True):
        monkeypatch.setattr(sys, "stderr", Busy())
        signal.raise_signal(signal.SIGTERM)
    assert context.stop_requested
    assert "SIGTERM again aborts" in capfd.readouterr().err


def alarms(context: Context, count: int) -> int:
    """How many of the alarms after a wish to end a study runs through that asks nothing."""
    done = 0
    with _terminal.watching(context, quiet=True):
        for _ in range(count):
            signal.raise_signal(signal.SIGALRM)
            done += 1
    return done


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no alarms on Windows")
def test_a_step_that_does_not_ask_is_ended_by_the_second_alarm(capfd: pytest.CaptureFixture[str]) -> None:
    assert alarms(Context(), 5) == 5  # nobody wants it to end
    for context in (Context(), Context(max_seconds=1e-9)):
        with _terminal.watching(context, quiet=True):
            before = signal.getitimer(signal.ITIMER_REAL)[0] > 0
            context.request_stop()
            assert before == (context.max_seconds is not None)
        assert alarms(context, 3) == 3  # no study runs: what is written is not broken off
        with pytest.raises(Interrupted), context.under_way():
            alarms(context, 3)
        with context.under_way():
            context.interrupted()  # the study asked: it ends by itself
            assert alarms(context, 3) == 3
    with _terminal.watching(context := Context(), quiet=True):
        signal.raise_signal(signal.SIGTERM)
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 0
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0 and context.stop_requested
    capfd.readouterr()
