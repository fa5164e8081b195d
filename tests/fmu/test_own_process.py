"""A unit of another maker that crashes, ends its process, hangs, prints or lies: a sentence, and nothing else is lost.

All numbers are synthetic.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel.fmu.process import UnitProcess
from gtmodel.results import ArgumentError
from tests.support.wild_units import COMMANDS, POSITIONS, How, described, packed, starts, wild

pytest.importorskip("fmpy")
STEP, SOON_S = 0.004, 1.5  # s; loading a unit on a busy machine takes tenths
ENDS = {
    How.ABORTS: ("ended by SIGABRT in fmi{}{}", "abort()", "last message: no licence"),
    How.EXITS: ("ended its process in fmi{}{}", "exit code", "last message: no licence"),
    How.CRASHES: ("ended by SIGSEGV in fmi{}{}", "a fault of its own code"),
    How.HANGS: ("did not return from fmi{}{} within 1.5 s", "timeout"),
    How.SCRIBBLES: (
        "wrote to or closed files",
        "in one of its calls",
    ),
}


@pytest.fixture(scope="module", params=[2, 3])
def version(request):
    return request.param


@pytest.fixture
def path(version, tmp_path):
    (place := tmp_path / "wild.fmu").write_bytes(wild(version))
    return place


def running_children() -> set[int]:
    """Processes of units that this one started."""
    found = set()
    for status in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            if status.read_text().rsplit(")")[-1].split()[1] == str(os.getpid()):
                command = status.with_name("cmdline").read_bytes()
                found |= {int(status.parent.name)} if b"caller.py" in command else set()
    return found


@pytest.mark.parametrize(("how", "code"), [(how, 0) for how in ENDS] + [(How.EXITS, 3)])
def test_a_unit_that_ends_is_a_sentence(how, code, path, version):
    """In a step, and before the first one; its process is gone, later calls say the same."""
    before = running_children()
    timeout = SOON_S if how is How.HANGS else 60.0  # a busy machine takes its time to end a process
    unit = gt.fmu.RunningUnit(path, starts(how, code=code), timeout=timeout)
    assert len(running_children() - before) == 1
    unit.step(STEP)
    with pytest.raises(gt.fmu.UnitStopped, match=r"'wild' stopped (between 0.004 and 0.008|at 0.004) s: ") as stopped:
        unit.step(STEP)
    assert all(words.format(version, "DoStep") in str(stopped.value) for words in ENDS[how])
    assert stopped.value.time == STEP and "\n" not in str(stopped.value)
    assert how is not How.EXITS or f"with exit code {code}" in str(stopped.value)
    assert running_children() == before
    with pytest.raises(gt.fmu.UnitStopped) as again:
        unit.get(POSITIONS)
    assert str(again.value).split(" s: ")[1] == str(stopped.value).split(" s: ")[1]
    with pytest.raises(ArgumentError) as refusal:
        gt.fmu.RunningUnit(path, starts(how, code=code, when=0.0), timeout=timeout)
    assert refusal.value.argument == "start" and running_children() == before
    assert all(words.format(version, "ExitInitializationMode") in refusal.value.message for words in ENDS[how])


WRONG = [
    (How.ASKS_TO_END, 0.0, (2, 3), "stopped between 0.004 and 0.008 s.*: .* end"),
    (How.WANTS_EVENT, 0.0, (3,), "event"),
    (How.ELSEWHERE, 0.006, (3,), "until 0.006 s: .* end time"),
    (How.ELSEWHERE, 4.0, (3,), "end time"),
    (How.NO_NUMBER, 0.0, (2, 3), r"has position\[1\] = nan at 0.008 s"),
    (How.DISCARDS, 0.0, (2, 3), r"0.008 s: \[31m far off \ufffd"),  # without control characters
]


@pytest.mark.parametrize(("how", "code", "versions", "words"), WRONG)
def test_what_goes_wrong_ends_the_run(how, code, versions, words, path, version):
    unit = gt.fmu.RunningUnit(path, starts(how, code=code))
    if version not in versions:
        return
    unit.step(STEP)
    with pytest.raises(gt.fmu.UnitStopped, match=words):
        unit.advance([(COMMANDS, [0.0, 0.0, 0.0])], STEP, POSITIONS)


def test_one_message_is_the_same_as_three(path):
    """And both are what the unit computes, to the last bit; a new start begins anew."""
    one, three = (gt.fmu.RunningUnit(path, starts(How.PRINTS, when=9.0, carts=[0.1, 0.2, 0.3])) for _ in range(2))
    x = [0.1, 0.2, 0.3]
    for _ in range(2):
        for k in range(5):
            u = [0.1 * k, 1 / 3, -0.7]
            got = one.advance([(COMMANDS[:1], u[:1]), (COMMANDS[1:], u[1:])], STEP, POSITIONS)
            three.set(COMMANDS, u)
            three.step(STEP)
            x = [a + 0.5 * (b - a) for a, b in zip(x, u, strict=True)]
            assert got.tolist() == three.get(POSITIONS).tolist() == x
        one.restart()
        three.restart()
        x = [0.1, 0.2, 0.3]
    assert one.time == 0.0


def test_what_a_unit_prints_is_no_output_of_ours(path, capfd):
    unit = gt.fmu.RunningUnit(path, starts(How.PRINTS))
    for _ in range(3):
        unit.step(STEP)
    del unit  # ends its process; what waits in its buffer comes then
    printed = capfd.readouterr()
    assert printed.out == "" and all(words in printed.err for words in ("no JSON", "nor I", "late"))


def test_a_unit_ends_with_whoever_runs_it(path, tmp_path):
    """Also where that is killed while the unit hangs; a stop that is asked for reaches the parent alone."""
    program = (
        "import sys, gtmodel as gt\n"
        f"unit = gt.fmu.RunningUnit({str(path)!r}, {starts(How.HANGS)!r})\n"
        "unit.step(0.004)\nprint(unit._process._process.pid, flush=True)\nunit.step(0.004)\n"
    )
    own = os.environ | {"TMPDIR": str(tmp_path)}  # a process that is killed leaves its files
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, env=own) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        os.kill(child, signal.SIGTERM)
        os.kill(child, signal.SIGINT)
        time.sleep(0.1)
        assert Path(f"/proc/{child}").exists()
        parent.kill()
    deadline = time.monotonic() + 10.0
    while alive(child) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not alive(child)


def alive(number: int) -> bool:
    """Whether the process runs; one that waits for its new parent to ask is no more."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rsplit(")")[-1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("timeout", [0.0, -1.0, float("nan"), float("inf"), 1e9])
def test_a_time_limit_that_is_none_is_refused(timeout, path):
    with pytest.raises(ArgumentError) as refusal:
        gt.fmu.RunningUnit(path, timeout=timeout)
    assert refusal.value.argument == "timeout"
    with pytest.raises(ArgumentError) as refusal:
        gt.fmu.PlantUnit(path, POSITIONS, command=COMMANDS, timeout=timeout)
    assert refusal.value.argument == "timeout"


ENTITY = b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>'
HOSTILE = {
    "bomb": (
        lambda d: {"modelDescription.xml": d, "resources/zeros": bytes(300_000_000)},
        "times the size of the file",
    ),
    "large description": (lambda d: {"modelDescription.xml": d + bytes(70_000_000)}, "a description of 70"),
    "entities": (lambda d: {"modelDescription.xml": d.replace(b"?>", b"?>" + ENTITY, 1)}, "declares an entity"),
    "deep": (lambda d: {"modelDescription.xml": b"<a>" * 100_000}, "deep"),
    "none": (lambda d: {"other": d}, "no modelDescription.xml"),
    "no XML": (lambda d: {"modelDescription.xml": b"<"}, "is not XML"),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_an_archive_is_unpacked_within_bounds(kind, tmp_path):
    make, words = HOSTILE[kind]
    (place := tmp_path / "hostile.fmu").write_bytes(packed(make(described(2))))
    with pytest.raises(ArgumentError, match=words) as refusal:
        gt.fmu.RunningUnit(place)
    assert refusal.value.argument == "path" and "\n" not in refusal.value.message


def test_a_damaged_archive_is_a_sentence(path):
    data = bytearray(path.read_bytes())
    data[60:600] = bytes(540)
    path.write_bytes(data)
    with pytest.raises(ArgumentError, match="cannot be unpacked"):
        gt.fmu.RunningUnit(path)


def test_a_system_without_poll_gets_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("select.poll")  # as on Windows
    with pytest.raises(OSError, match="not on Windows"):
        UnitProcess(tmp_path, 1.0)
