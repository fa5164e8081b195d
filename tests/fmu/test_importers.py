"""Schema, validator and importers on every sort of unit in both versions; and descriptions that were tampered with."""

from __future__ import annotations

import io
import re
import zipfile

import numpy as np
import pytest

import gtmodel as gt
from tests.fmu.makers import MAKERS, function, unit as unit_of
from tests.fmu.raw import OK, Raw, unpacked

# beside the same without parameters, or with them
LARGE, SLOW = ("filtered_p", "f1_ik_p", "ik_p", "spiral"), pytest.mark.proof


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", [pytest.param(n, marks=SLOW) if n in LARGE else n for n in sorted(MAKERS)])
def test_the_validator_finds_nothing(made, name, version):
    validation = pytest.importorskip("fmpy.validation")
    assert validation.validate_fmu(str(made(name, version)[2])) == []


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", [pytest.param(n, marks=SLOW) if n in LARGE else n for n in sorted(MAKERS)])
def test_check_finds_every_unit_right(made, name, version):
    unit, *_ = made(name, version)
    report = gt.fmu.check(unit, points=60)
    assert {n: c for n, c in report.checks.items() if not c.passed} == {}
    assert any(n.endswith("_import_difference") for n in report.checks) == (name not in ("block", "filter", "held"))


def test_check_says_what_is_missing(made, monkeypatch):
    import gtmodel.fmu.checking as checking

    monkeypatch.setattr(checking, "find_spec", lambda _: None)
    report = gt.fmu.check(made("fk", 3)[0], points=5)
    assert any("FMPy" in note and "gtmodel[fmi]" in note for note in report.notes)
    assert not any("validator" in n for n in report.checks)


def test_check_sees_other_numbers(made):
    """A unit of another robot under the function of this one."""
    from dataclasses import replace

    other = gt.fmu.export(gt.robots.gantry_tau("l1_tracker"), None, known="q", targets="T", name="u_fk")
    unit = replace(other, function=function("fk"))
    assert not gt.fmu.check(unit, points=20).checks["u_fk_fmi3_values_different"].passed


@pytest.mark.parametrize("name", ["forward", "filtered", "d1_fk", "f1_ik", "block"])
def test_another_importer_runs_those_of_fmi_2(made, name):
    cosim = pytest.importorskip("libcosimpy.CosimExecution", reason="libcosimpy is not installed")
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    unit, library, path = made(name, 2)
    execution = cosim.CosimExecution.from_step_size(step_size=int(4e6))
    slave = CosimLocalSlave(fmu_path=str(path), instance_name="unit")
    index = execution.add_local_slave(slave)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    manipulator = CosimManipulator.create_override()
    execution.add_manipulator(manipulator)
    inputs = [v for v in unit.table.of("input") if not v.integer]
    for v in inputs:
        manipulator.slave_real_values(index, [v.reference], [v.start])
    assert execution.simulate_until(int(100e6))
    outputs = [v.reference for v in unit.table.of("output") if not v.integer]
    got = observer.last_real_values(index, outputs)
    raw = Raw(unit, library)
    assert raw.begin() == OK
    for k in range(25):
        assert raw.step(k * 4e-3, 4e-3)[0] == OK
    assert np.array(got) == pytest.approx(raw.get(outputs)[1], rel=0, abs=1e-9)


def tampered(unit, change) -> bytes:
    """The archive with another description."""
    made = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(unit.data)) as old, zipfile.ZipFile(made, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            new.writestr(name, change(data.decode()).encode() if name == "modelDescription.xml" else data)
    return made.getvalue()


def replaced(pattern: str, by: str):
    def change(text: str) -> str:
        new, n = re.subn(pattern, by, text, count=1)
        assert n == 1, pattern
        return new

    return change


MUTATIONS = {
    "a unit is not defined": replaced(r'    <Unit name="N">\n(.*\n)*?    </Unit>\n', ""),
    "a dependency is of nobody": replaced(r'(<Output valueReference="\d+" dependencies=")', r"\g<1>999 "),
    "an output is missing in the structure": replaced(r"    <Output .*/>\n", ""),
    "an initial unknown is missing": replaced(r"    <InitialUnknown .*/>\n", ""),
    "a derivative is of nobody": replaced(r'derivative="\d+"', 'derivative="999"'),
    "two variables have one name": replaced(r'name="tau\[2\]"', 'name="tau[1]"'),
    "two variables have one reference": replaced(r'(name="tau\[2\]" valueReference=)"\d+"', r'\g<1>"1"'),
    "an input has no start": replaced(r'(name="tau\[1\]".*?) start="[^"]*"', r"\g<1>"),
    "a causality does not exist": replaced('causality="output"', 'causality="outcome"'),
    "an output says how it begins": replaced('initial="calculated"', 'initial="calculated" start="1.0"'),
}


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_description_that_was_changed_is_noticed(made, name, tmp_path):
    validation = pytest.importorskip("fmpy.validation")
    path = tmp_path / "changed.fmu"
    path.write_bytes(tampered(made("forward", 3)[0], MUTATIONS[name]))
    try:
        problems = validation.validate_fmu(str(path))
    except Exception as error:  # it may refuse to read it at all
        problems = [str(error)]
    assert problems


@pytest.mark.parametrize("version", [3, 2])
def test_a_changed_token_is_refused_at_instantiation(made, version):
    unit, library, _ = made("forward", version)
    digit = "0" if unit.token[3] != "0" else "1"
    assert Raw(unit, library, token=unit.token[:3] + digit + unit.token[4:]).i is None


def test_other_parameters_and_starts_have_other_tokens():
    units = [
        unit_of("fk", 3), unit_of("fk", 2), unit_of("fk", 3, start={"q": [-0.7, -0.8, -0.6]}),
        gt.fmu.export(gt.robots.gantry_tau("l1_tracker"), None, known="q", targets="T", name="u_fk", stop=0.2),
    ]  # fmt: skip
    assert len({u.token for u in units}) == len(units)


REFUSED = {
    "version": {"version": 1},
    "known": {"known": "q"},
    "name": {"name": "not a name"},
    "start": {"start": {"q": [1.0]}},
    "tunable": {"tunable": ["T"]},
}


@pytest.mark.parametrize("argument", REFUSED)
def test_what_cannot_be_exported_is_refused_by_its_argument(argument):
    with pytest.raises(gt.results.ArgumentError) as refusal:
        gt.fmu.export(function("fk"), None, **{"name": "u", **REFUSED[argument]})
    assert refusal.value.argument == argument


def test_states_cannot_be_held_and_events_not_exported():
    with pytest.raises(gt.results.ArgumentError, match="on_fault"):
        unit_of("forward", 3, on_fault="hold")
    from tests.fmu.makers import Loop

    with pytest.raises((gt.results.ArgumentError, ValueError)):
        gt.fmu.export(Loop(), None, known=[], targets="x", name="u")


def test_a_written_unit_is_the_one_in_memory(tmp_path):
    unit = gt.fmu.export(function("fk"), tmp_path / "deep" / "u_fk.fmu", stop=0.2)
    assert unit.path.read_bytes() == unit.data == unit_of("fk", 3).data
    assert unpacked(unit, tmp_path / "x").name == "u_fk.so"
