"""A unit belongs to one process and serves one call at a time; what would harm it is refused before it sees it.

All numbers are synthetic.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import tempfile
import threading

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.loop import RobotSide, egm
from gtmodel.results import ArgumentError
from gtmodel.results.disk import scratch
from tests.support.wild_units import COMMANDS, POSITIONS, How, starts, wild

pytest.importorskip("fmpy")
STEP = 0.004


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    (place := tmp_path_factory.mktemp("units") / "wild.fmu").write_bytes(wild(3))
    return place


@pytest.fixture(scope="module")
def unit(path):
    return gt.fmu.RunningUnit(path)


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The folder of temporary ones."""
    (place := tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    return place


def stopped(unit, steps=9) -> str:
    """Why a unit ends within some steps."""
    for _ in range(steps):
        try:
            unit.step(STEP)
        except gt.fmu.UnitStopped as error:
            return str(error)
    return ""


def in_a_child(task) -> str:
    """What a forked process says."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        try:
            os.write(writing, task().encode())
        finally:
            os._exit(0)
    os.close(writing)
    with open(reading, encoding="utf-8") as said:
        text = said.read()
    os.waitpid(child, 0)
    return text


FAR = {
    "fewer": ([1.0], "3 numbers, for command[1], command[2], command[3]; found 1: [1.0]"),
    "one": (1.0, "found 1.0"),
    "more": ([1.0] * 5, "found 5: "),
    "column": (np.ones((3, 1)), "found an array of shape (3, 1)"),
    "texts": (["1", "2", "3"], "found ['1', '2', '3']"),
    "uneven": ([1.0, [2.0], 3.0], "[1.0, [2.0], 3.0]"),
}


@pytest.mark.parametrize("kind", FAR)
def test_a_unit_takes_one_number_for_each_name(kind, unit):
    """Before, memory that is not the numbers' went to the unit."""
    values, words = FAR[kind]
    for call in (lambda: unit.set(COMMANDS, values), lambda: unit.advance([(COMMANDS, values)], STEP, POSITIONS)):
        with pytest.raises(ArgumentError, match=re.escape(words)) as refusal:
            call()
        assert refusal.value.argument == "values"


def test_a_plant_takes_one_number_for_each_cart(path):
    plant = gt.fmu.FmuPlant(path, POSITIONS, command=COMMANDS)
    for n in (1, 4):
        for argument, given in {"position_m": ([0.1] * n, [0.0] * 3), "speed_m_s": ([0.1] * 3, [0.0] * n)}.items():
            with pytest.raises(ArgumentError, match=f"3 numbers.* found {n}: ") as refusal:
                plant.step(*given)
            assert refusal.value.argument == argument
    assert plant.unit.time == 0.0


def test_a_loop_that_sends_no_speeds_moves_a_plant(path):
    plant = gt.fmu.FmuPlant(path, POSITIONS, command=COMMANDS)
    side = RobotSide("egm", plant)
    sensor = egm.EgmSensor(side.number, 0, external_mm=[100.0, 200.0, 300.0])
    side.step([egm.encode_sensor(sensor)])
    assert side.late == 0 and plant.position_m == pytest.approx([0.05, 0.1, 0.15], rel=1e-12)  # half of the way


@pytest.mark.parametrize("length", [0.0, -1.0, float("nan"), float("inf"), "a", None])
def test_a_step_has_a_length(length, unit):
    before = unit.time
    with pytest.raises(ArgumentError) as refusal:
        unit.step(length)
    with pytest.raises(ArgumentError, match=r"(expected|must be) (a number|finite|more)"):
        unit.advance([], length, POSITIONS)
    assert refusal.value.argument == "length" and unit.time == before


POORLY = {
    "start.position[2]": {"start": {POSITIONS[0]: 1.0, POSITIONS[1]: [3.0, 4.0]}},
    "start.code": {"start": {"code": "a"}},
    "start": {"start": "text"},
    "timeout": {"timeout": "a"},
    "cycle_s": {"cycle_s": "a"},
    "steps": {"steps": 2.5},
}


@pytest.mark.parametrize("argument", POORLY)
def test_what_is_no_number_is_refused(argument, path):
    with pytest.raises(ArgumentError, match=r"expected .* found") as refusal:
        gt.fmu.FmuPlant(path, POSITIONS, command=COMMANDS, **POORLY[argument])
    assert refusal.value.argument == argument


@pytest.mark.parametrize("given", [None, 5, sys.stdin])
def test_what_is_no_path_is_refused(given):
    with pytest.raises(ArgumentError, match=r"expected text or os\.PathLike") as refusal:
        gt.fmu.RunningUnit(given)
    assert refusal.value.argument == "path"


@pytest.mark.parametrize(("name", "why"), [("x.fmu", "No such file or directory"), ("", "Is a directory")])
def test_a_file_that_is_not_there_is_named_once(name, why, tmp_path):
    with pytest.raises(ArgumentError) as refusal:
        gt.fmu.RunningUnit(tmp_path / name)
    assert refusal.value.message == f"'{tmp_path / name}' cannot be read: {why}"


def test_a_temporary_folder_that_is_not_there_is_a_sentence(path, temporary):
    temporary.rmdir()
    with pytest.raises(ArgumentError, match=f"temporary folder {temporary} .*set TMPDIR"):
        gt.fmu.RunningUnit(path)


def test_a_process_that_is_forked_leaves_the_unit_alone(path, temporary):
    """Also its end; before, finalizers in it ended the unit and deleted its folder."""
    unit = gt.fmu.RunningUnit(path)
    unit.step(STEP)

    def calls() -> str:
        said = []
        for call in (lambda: unit.step(STEP), unit.restart, lambda: unit.get(POSITIONS)):
            try:
                call()
            except ArgumentError as error:
                said.append(error.message)
        unit._free()  # as the interpreter does when it ends
        return "\n".join(said)

    said = in_a_child(calls).splitlines()
    assert len(said) == 3 and all(f"process {os.getpid()}, not" in line for line in said)
    assert len(list(temporary.iterdir())) == 1
    unit.step(STEP)
    assert unit.time == 2 * STEP


def test_a_temporary_folder_goes_with_the_process_that_made_it(temporary):
    held = scratch()
    place = held.__enter__()
    in_a_child(lambda: str(held.__exit__(None, None, None)))
    assert place.is_dir()
    held.__exit__(None, None, None)
    assert not place.exists()


@pytest.mark.parametrize("how", [How.CRASHES, How.EXITS])
def test_a_unit_that_ended_and_is_dropped_leaves_nothing(how, path, temporary):
    unit = gt.fmu.RunningUnit(path, starts(how))
    assert "ended" in stopped(unit) and "ended" in stopped(unit)
    assert len(list(temporary.iterdir())) == 1
    del unit
    assert not list(temporary.iterdir())


def test_threads_share_a_unit(path):
    unit, faults = gt.fmu.RunningUnit(path), []

    def work() -> None:
        try:
            for _ in range(100):
                unit.advance([(COMMANDS, [1.0, 1.0, 1.0])], STEP, POSITIONS)
        except BaseException as error:
            faults.append(repr(error))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not faults and unit.time == pytest.approx(400 * STEP, rel=1e-9)  # of sums of 400 numbers


def test_after_a_reset_that_failed_a_unit_goes_on_no_more(path):
    unit = gt.fmu.RunningUnit(path, starts(How.STAYS, when=9.0))
    unit.step(STEP)
    with pytest.raises(ArgumentError, match="fmi3Reset returned Error"):
        unit.restart()
    for call in (lambda: unit.step(STEP), lambda: unit.get(POSITIONS)):
        with pytest.raises(gt.fmu.UnitStopped, match="fmi3Reset") as why:
            call()
        assert why.value.time == STEP


def test_an_exit_code_that_nobody_keeps_is_unknown(path):
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        said = stopped(gt.fmu.RunningUnit(path, starts(How.EXITS, code=7)))
    finally:
        signal.signal(signal.SIGCHLD, before)
    assert "exit code unknown" in said and "code 0" not in said


@pytest.mark.parametrize(
    ("number", "words"), [(signal.SIGKILL, "memory is short; free memory"), (signal.SIGXCPU, "limit of computing time")]
)
def test_what_the_system_ends_is_no_fault_of_the_maker(number, words, path):
    unit = gt.fmu.RunningUnit(path)
    os.kill(unit._process._process.pid, number)
    said = stopped(unit)
    assert words in said and "maker" not in said
