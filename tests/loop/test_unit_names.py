"""A unit as a plant: names, causalities, units of its variables and steps that do not fit, and what it may do wrong."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.toolchain import find
from gtmodel.fmu import running
from gtmodel.results import ArgumentError
from tests.loop import units

pytest.importorskip("fmpy")
if isinstance(find(), str):
    pytest.skip("no C compiler: no unit", allow_module_level=True)

POSITIONS, COMMANDS = units.POSITIONS, units.COMMANDS
METRE = '<BaseUnit m="1"/>'


def _amiss(make: Any, argument: str, *words: str) -> list[str]:
    """What is amiss in a refusal: another argument, words that its sentence lacks, lines after the first."""
    with pytest.raises(ArgumentError) as refusal:
        make()
    found, message = refusal.value.argument, refusal.value.message
    other = [] if found == argument else [found]
    return [*other, *(word for word in words if word not in message), *message.split("\n")[1:]]


@pytest.mark.parametrize(
    ("keys", "argument", "word"),
    [
        ({"position": ["positon[1]", *POSITIONS[1:]]}, "position", "position[1]"),  # the nearest name
        ({"position": COMMANDS}, "position", "causality input"),
        ({"command": POSITIONS}, "command", "causality output"),
        ({"position": [POSITIONS[0], *POSITIONS[:2]]}, "position", "twice"),
        ({"command": COMMANDS[:2]}, "command", "expected 3 names"),
        ({"command": ()}, "command", "either"),
        ({"arm": COMMANDS}, "arm", "causality input"),
        ({"start": {"postion[1]": 0.0}}, "start", "position[1]"),
        ({"units": {"positions": "mm"}}, "units", "positions"),
        ({"units": {"position": "mm"}}, "units", "not in mm"),
        ({"units": {"position": "furlong"}}, "units", "furlong"),
        ({"command_speed": COMMANDS}, "command_speed", "m/s"),
        ({"stiffness": 4e4}, "damping", "both"),
        ({"damping": 4e4}, "stiffness", "both"),
    ],
)
def test_variables_that_do_not_fit_are_named(keys: dict[str, Any], argument: str, word: str) -> None:
    given: dict[str, Any] = {"position": POSITIONS, "command": COMMANDS} | keys
    assert _amiss(lambda: gt.fmu.PlantUnit(units.drives(3), **given)(0.004), argument, word) == []


def test_forces_and_speeds_have_their_units() -> None:
    unit = units.rigid()
    carts, motors, speeds = units.CARTS, units.MOTORS, units.SPEEDS
    assert _amiss(lambda: gt.fmu.FmuPlant(unit, carts, force=motors, speed=carts), "speed", "m/s") == []
    assert _amiss(lambda: gt.fmu.FmuPlant(unit, speeds, force=motors, speed=speeds), "position", "such as m") == []
    assert _amiss(lambda: gt.fmu.FmuPlant(unit, carts, command=motors), "command", "such as m") == []
    assert _amiss(lambda: gt.fmu.FmuPlant(unit, carts, force=motors), "speed", "speeds") == []
    assert _amiss(lambda: units.rigid_plant(unit, start={"q[1]": 0.0})(0.004), "start", "start value", "T[1]") == []
    assert _amiss(lambda: units.rigid_plant(unit, start={"T[2]": 50.0})(0.004), "start") == []  # beyond reach


@pytest.mark.parametrize("version", [2, 3])
def test_a_unit_in_millimetres_is_read_in_metres(version: int, tmp_path: Path) -> None:
    """The same library, whose description says that its numbers are millimetres."""
    plain = units.drives_plant(units.drives(version))(0.004)
    in_mm = units.changed(units.drives(version), tmp_path, (METRE, METRE.replace("/>", ' factor="0.001"/>')))
    scaled = units.drives_plant(in_mm)(0.004)
    assert scaled.position_m == pytest.approx(1e-3 * plain.position_m, rel=1e-15)
    for k in range(8):
        u = plain.position_m + 0.01 * k
        plain.step(u.tolist(), [0.0] * 3)
        scaled.step((1e-3 * u).tolist(), [0.0] * 3)
    assert scaled.position_m == pytest.approx(1e-3 * plain.position_m, rel=1e-12)
    assert np.min(np.abs(plain.position_m - np.array(units.start()))) > 1e-3


def test_a_unit_without_units_is_not_guessed(tmp_path: Path) -> None:
    bare = units.changed(units.drives(3), tmp_path, (' unit="m"', ""))
    assert _amiss(lambda: units.drives_plant(bare)(0.004), "position", "no unit", "units") == []
    wide = units.drives_plant(bare, units={"position": "mm", "command": "mm"})(0.004)
    assert wide.position_m == pytest.approx(1e-3 * np.array(units.start()), rel=1e-15)
    assert units.drives_plant(bare, units={"position": "m", "command": "m"})(0.004).position_m.tolist() == units.start()


def test_a_unit_whose_steps_do_not_fit_is_refused(tmp_path: Path) -> None:
    other = units.changed(units.drives(3), tmp_path, ('fixedInternalStepSize="0.004"', 'fixedInternalStepSize="0.003"'))
    assert _amiss(lambda: units.drives_plant(other)(0.004), "steps", "3 ms", "4 ms") == []
    other = units.changed(units.drives(3), tmp_path, ('fixedInternalStepSize="0.004"', 'fixedInternalStepSize="0.001"'))
    assert _amiss(lambda: units.drives_plant(other, steps=7)(0.004), "steps", "choose 1") == []
    fine = units.drives_plant(other, steps=4)(0.004)  # samples of 4 ms hold over four steps of 1 ms
    plain = units.drives_plant(units.drives(3))(0.004)
    for _ in range(8):
        for p in (fine, plain):
            p.step((np.array(units.start()) + 0.01).tolist(), [0.0] * 3)
    assert fine.position_m.tolist() == plain.position_m.tolist()


@pytest.mark.parametrize("number", ["NaN", "INF", "-1.0"])
def test_a_step_inside_that_is_no_length_is_none(number: str, tmp_path: Path) -> None:
    new = f'fixedInternalStepSize="{number}"'
    other = units.changed(units.drives(3), tmp_path, ('fixedInternalStepSize="0.004"', new))
    assert units.drives_plant(other)(0.004).unit.inner_step is None


def test_a_unit_with_a_factor_of_zero_is_refused(tmp_path: Path) -> None:
    other = units.changed(units.drives(3), tmp_path, ('<BaseUnit m="1"/>', '<BaseUnit m="1" factor="0"/>'))
    assert _amiss(lambda: units.drives_plant(other)(0.004), "position", "factor") == []


def test_a_plant_of_another_cycle_is_refused() -> None:
    plant = units.drives_plant(units.drives(3))(0.008)
    assert _amiss(lambda: gt.loop.RobotSide("egm", plant), "plant", "8 ms", "4 ms") == []
    assert gt.loop.RobotSide("egm", plant, cycle_ms=8).start_m.tolist() == units.start()


def test_what_cannot_be_run_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = os.getcwd()
    only = units.changed(units.drives(2), tmp_path, ("<CoSimulation", "<CoSimulated"))
    assert _amiss(lambda: units.drives_plant(only)(0.004), "file") == []
    empty = units.changed(units.drives(3), tmp_path, without="binaries/")
    assert _amiss(lambda: units.drives_plant(empty)(0.004), "file", "cannot be run here") == []
    assert os.getcwd() == here
    monkeypatch.setattr(running, "find_spec", lambda name: None)
    assert _amiss(lambda: units.drives_plant(units.drives(3))(0.004), "file", "pip install 'gtmodel[fmi]'") == []


def test_a_unit_with_model_exchange_alone_says_so(tmp_path: Path) -> None:
    import re
    import zipfile
    from io import BytesIO

    unit = units.rigid()
    text = zipfile.ZipFile(BytesIO(unit.data)).read("modelDescription.xml").decode()
    (element,) = re.findall(r"<CoSimulation .*?/>", text)
    alone = units.changed(unit, tmp_path, (element, ""))
    assert _amiss(lambda: units.rigid_plant(alone)(0.004), "file", "model exchange") == []


@pytest.mark.parametrize("version", [2, 3])
def test_a_number_that_a_unit_refuses_ends_the_run(version: int) -> None:
    """A sentence with the time; what else a unit may do wrong stands in tests/fmu/test_own_process.py."""
    running_unit = gt.fmu.RunningUnit(units.drives(version))
    running_unit.step(0.004)
    with pytest.raises(gt.fmu.UnitStopped, match=r"command\[1\] at 0.004 s.*finite") as stopped:
        running_unit.set(["command[1]"], [float("nan")])
    assert stopped.value.time == 0.004
    assert running_unit.get(POSITIONS).tolist() == units.start()  # it goes on
