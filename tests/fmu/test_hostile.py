"""What importers do that the standard allows, and what it forbids: each was answered wrongly once."""

from __future__ import annotations

import ctypes as c
import io
import re
import sys
import xml.etree.ElementTree as ElementTree
import zipfile

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.fmu.content import base_unit
from gtmodel.fmu.table import fmi_name, unused
from gtmodel.lang.source import of_frame
from tests.fmu.makers import function
from tests.fmu.raw import DISCARD, ERROR, OK, Raw, unpacked

VERSIONS = pytest.mark.parametrize("version", [2, 3])


def description(unit):
    with zipfile.ZipFile(io.BytesIO(unit.data)) as archive:
        return ElementTree.fromstring(archive.read("modelDescription.xml"))


@VERSIONS
def test_a_time_that_importers_add_up_takes_one_sample_a_step(made, version):
    unit, library, _ = made("block", version)
    u, y = [unit.table.of(role)[0].reference for role in ("input", "output")]
    h, runs, far = unit.table.period, [], 0.0
    for added in (False, True):
        raw, t, values = Raw(unit, library), 0.0, []
        assert raw.begin() == OK
        for k in range(8_200):
            assert raw.set([u], [float(k % 7)]) == OK
            assert raw.step(t, h)[0] == OK
            t = t + h if added else (k + 1) * h
            far = max(far, t - (k + 1) * h)
            values.append(raw.get([y])[1][0])
        raw.free()
        runs.append(values)
    assert far > 1e-9 * h  # at step 7,983
    assert runs[0] == runs[1]


def test_a_step_far_shorter_than_a_period_takes_the_sample_at_its_start(made):
    unit, library, _ = made("block", 3)
    u, y = [unit.table.of(role)[0].reference for role in ("input", "output")]
    raw, h, t = Raw(unit, library), unit.table.period / 5000, 0.0
    assert raw.begin() == OK
    seen = []
    for k in range(5001):
        assert raw.set([u], [float(k)]) == OK
        assert raw.step(t, h)[0] == OK
        t += h
        seen.append(raw.get([y])[1][0])
    raw.free()
    assert seen[0] == seen[4999] == 0.0  # of the input 0 at the start
    assert seen[5000] == (4.0 + 2.0 * unit.table.period) * 5000.0


@VERSIONS
def test_outputs_begin_at_the_start_that_was_set(made, version):
    unit, library, _ = made("filter", version)
    names = {v.name: v.reference for v in unit.table.variables}
    for when in ("instantiated", "initialization"):
        raw = Raw(unit, library)
        if when == "instantiated":
            assert raw.set([names["start.x"], names["start.v"]], [0.25, 0.5]) == OK
        assert raw.begin({} if when == "instantiated" else {"start.x": 0.25, "start.v": 0.5}) == OK
        assert raw.get([names["x"], names["v"], names["nis"]])[1].tolist() == [0.25, 0.5, 0.0], when
        assert raw.step(0.0, unit.table.period)[0] == OK
        after = raw.get([names["x"]])[1][0]
        assert raw.set([names["tape"]], [3.0]) == OK
        assert raw.get([names["x"]])[1][0] == after != 0.25  # the start has no say any more
        raw.free()
    initial = description(unit).findall(".//InitialUnknown") + description(unit).findall(".//InitialUnknowns/Unknown")
    shift = 0 if version == 3 else 1
    on = {int(u.get("valueReference") or u.get("index")): u.get("dependencies") for u in initial}
    assert on[names["x"] + shift] == str(names["start.x"] + shift)
    assert on[names["nis"] + shift] == ""


def experiment(raw: Raw, start: float, stop: float) -> int:
    yes, zero = c.c_bool(True), c.c_double(0)
    if raw.three:
        return raw.do("EnterInitializationMode", c.c_bool(False), zero, c.c_double(start), yes, c.c_double(stop))
    status = raw.do("SetupExperiment", 0, zero, c.c_double(start), 1, c.c_double(stop))
    return max(status, raw.do("EnterInitializationMode"))


@VERSIONS
def test_past_the_stop_time_nothing_is_computed(made, version):
    unit, library, _ = made("forward", version)
    raw = Raw(unit, library)
    assert experiment(raw, 0.0, 0.01) == OK
    assert raw.do("ExitInitializationMode") == OK
    t = 0.0
    for _ in range(10):
        assert raw.step(t, 0.001)[0] == OK
        t += 0.001  # a little above 0.01 in the end
    before = raw.get([v.reference for v in unit.table.of("output")])[1]
    assert raw.step(t, 0.001)[0] == ERROR
    assert np.array_equal(raw.get([v.reference for v in unit.table.of("output")])[1], before)
    assert raw.do("Reset") == OK
    assert experiment(raw, 1.0, 0.5) == ERROR
    assert raw.do("Reset") == OK
    assert raw.begin() == OK
    assert raw.step(0.0, 0.02)[0] == OK  # the stop time of the last run is forgotten
    raw.free()


@VERSIONS
@pytest.mark.parametrize("start", [0.0, 1e6, 1.7e9])
def test_a_step_that_was_left_out_is_refused_at_any_time(made, version, start):
    unit, library, _ = made("forward", version)
    raw, h = Raw(unit, library), 0.001
    assert raw.begin(time=start) == OK
    for k in range(20):
        assert raw.step(start + k * h, h)[0] == OK
    assert raw.step(start + 21 * h, h)[0] == ERROR
    assert raw.step(start + 19 * h, 2 * h)[0] == ERROR
    assert raw.step(start + 20 * h, h)[0] == OK
    raw.free()


def test_a_unit_that_cannot_go_on_asks_to_end(made):
    """FMPy repeats a discarded step of FMI 2.0 for ever unless it does."""
    unit, library, path = made("forward", 2)
    motors = [v.name for v in unit.table.of("input")]

    def asks(h):
        raw, answer = Raw(unit, library), c.c_int(-1)
        assert raw.begin({motors[0]: 20_000.0}) == OK
        t = 0.0
        while raw.step(t, h)[0] == OK:
            t += h
        reached = c.c_double()
        assert raw.do("GetRealStatus", 2, c.byref(reached)) == OK
        assert raw.do("GetBooleanStatus", 3, c.byref(answer)) == OK
        raw.free()
        return bool(answer.value), reached.value > t

    assert asks(unit.table.step) == (True, False)
    assert asks(0.5) == (False, True)
    fmpy = pytest.importorskip("fmpy")
    run = fmpy.simulate_fmu(
        str(path), fmi_type="CoSimulation", stop_time=1.0, output_interval=unit.table.step,
        start_values={motors[0]: 20_000.0},
    )  # fmt: skip
    assert 0.0 < run["time"][-1] < 1.0


class Inverse(gt.SampledBlock):
    u = gt.input(unit="m")
    y = gt.output(unit="1/m")

    def step(self, inputs, state):
        return {"y": 1.0 / inputs.u}


class Desk(gt.Model):
    u = gt.input(unit="m")
    block = gt.part(Inverse, period=0.01)

    def equations(self):
        yield self.block.u == self.u


@VERSIONS
def test_a_unit_that_has_no_answer_at_its_start_fails_its_check(version):
    pytest.importorskip("fmpy")
    unit = gt.fmu.export(gt.cgen.BlockFunction(Desk(), "block"), None, version=version, name="stuck")
    report = gt.fmu.check(unit, points=3)
    assert not report.checks[f"stuck_fmi{version}_runs_failed"].passed
    assert report.checks[f"stuck_fmi{version}_validator_findings"].passed


@VERSIONS
def test_errors_are_always_said_and_discards_by_category(made, version):
    unit, library, _ = made("ik", version)
    raw = Raw(unit, library)
    place = [v.reference for v in unit.table.of("input")][:3]

    def logging(on, *categories) -> int:
        texts = (c.c_char_p * max(1, len(categories)))(*categories)
        flag = c.c_bool(on) if raw.three else int(on)
        return raw.do("SetDebugLogging", flag, c.c_size_t(len(categories)), texts if categories else None)

    def after(what) -> list[str]:
        raw.said.clear()
        what()
        return [category for _, category, _ in raw.said]

    def far():
        assert raw.set(place, [9.0, 9.0, 9.0]) == OK
        assert raw.get([v.reference for v in unit.table.of("output")])[0] == DISCARD

    def wrong():
        assert raw.get([10_000])[0] == ERROR

    assert raw.begin() == OK
    assert logging(False) == OK
    assert after(far) == []
    assert after(wrong) == ["logStatusError"]
    assert logging(True, b"logStatusError") == OK
    assert after(far) == []
    assert logging(True, b"logStatusDiscard") == OK
    assert after(far) == ["logStatusDiscard"]
    assert logging(False, b"logStatusError") == OK
    assert after(far) == ["logStatusDiscard"]
    assert logging(False, b"logStatusDiscard") == OK
    assert after(far) == []
    assert logging(True, b"logEvents") == ERROR
    assert after(lambda: logging(True, b"logEvents")) == ["logStatusError"]
    raw.free()


def test_arrays_of_different_lengths_are_refused_with_a_sentence(made):
    unit, library, _ = made("ik", 3)
    raw = Raw(unit, library)
    assert raw.begin() == OK
    values, references = (c.c_double * 3)(), (c.c_uint32 * 3)(1, 2, 3)
    for name in ("GetFloat64", "SetFloat64", "GetInt32", "SetInt32"):
        raw.said.clear()
        assert raw.do(name, references, c.c_size_t(3), values, c.c_size_t(2)) == ERROR
        assert [status for status, _, _ in raw.said] == [ERROR], name
    raw.said.clear()
    assert raw.do("DoStep", c.c_double(0), c.c_double(1e-3), c.c_bool(True), None, None, None, None) == ERROR
    assert [status for status, _, _ in raw.said] == [ERROR]
    raw.free()


def test_a_refused_completed_step_writes_nothing(made):
    unit, library, _ = made("forward", 3)
    raw = Raw(unit, library, co=False)
    flags = [c.c_bool(True), c.c_bool(True)]
    assert raw.do("CompletedIntegratorStep", c.c_bool(True), *map(c.byref, flags)) == ERROR
    assert [f.value for f in flags] == [True, True]
    raw.free()


def test_newton_begins_at_its_guess_after_held_outputs(tmp_path):
    unit = gt.fmu.export(function("d1_fk"), None, name="u_held_newton", on_fault="hold")
    library = unpacked(unit, tmp_path)
    q = [v.reference for v in unit.table.of("input")]
    home = [v.start for v in unit.table.of("input")]
    y = [v.reference for v in unit.table.of("output") if not v.integer]
    (flag,) = [v.reference for v in unit.table.of("output") if v.integer]
    values = []
    for begin in (home, [50.0] * len(q)):
        raw = Raw(unit, library)
        assert raw.begin(dict(zip([v.name for v in unit.table.of("input")], begin, strict=True))) == OK
        assert (raw.get_integers([flag])[1][0] == 0) == (begin is home)
        assert raw.step(0.0, 1e-3)[0] == OK
        assert raw.set(q, home) == OK
        values.append(raw.get(y)[1])
        assert raw.get_integers([flag])[1][0] == 0
        raw.free()
    assert np.max(np.abs(values[0] - values[1])) < 1e-10


@VERSIONS
def test_what_says_that_outputs_are_held_depends_on_all_inputs(made, version):
    unit, _, _ = made("held", version)
    (status,) = [v.reference for v in unit.table.of("output") if v.integer]
    inputs = [v.reference for v in unit.table.of("input")]
    assert sorted(unit.table.dependencies[status]) == sorted(inputs)


@VERSIONS
def test_outputs_of_samples_are_computed_and_cannot_be_set(made, version):
    """What has a start of its own could be set by an importer before initialisation."""
    unit, library, _ = made("filter", version)
    kinds = ("Float64", "Int32") if version == 3 else ("ScalarVariable",)
    root = description(unit)
    rows = [v for kind in kinds for v in root.iter(kind) if v.get("causality") == "output"]
    assert rows
    for row in rows:
        assert row.get("initial") == "calculated"
        assert row.get("start") is None
        assert all(inside.get("start") is None for inside in row)
    unknown = len(root.findall(".//InitialUnknown")) + len(root.findall(".//InitialUnknowns/Unknown"))
    assert unknown == len(rows)
    raw = Raw(unit, library)
    assert raw.set([unit.table.of("output")[0].reference], [0.0]) == ERROR
    raw.free()


class Inside(gt.Model):
    b = gt.variable(unit="m")
    speed = gt.input(unit="m/s")

    def equations(self):
        yield gt.der(self.b) == self.speed


class Near(gt.Model):
    """Its names are those that outputs get which are states or rates too."""

    T = gt.variable(unit="m")
    T_out = gt.variable(unit="m")
    d_T_out = gt.variable(unit="m")
    status = gt.variable(unit="m")
    inner_b_out = gt.variable(unit="m")
    inner = gt.part(Inside)
    u = gt.input(unit="m/s")

    def equations(self):
        yield gt.der(self.T) == self.u
        yield self.T_out == 2 * self.T
        yield self.d_T_out == 3 * self.T
        yield self.status == 4 * self.T
        yield self.inner_b_out == 5 * self.T
        yield self.inner.speed == 6 * self.u


def test_names_stay_unique(monkeypatch):
    wanted = ["T", "T_out", "der(T)", "d_T_out", "inner.b", "inner_b_out"]
    unit = gt.fmu.export(Near(), None, known="u", targets=wanted, prefer=["T", "inner.b"], name="near",
                         start={"T": 0.3, "inner.b": 0.1}, stop=0.01)  # fmt: skip
    names = [v.name for v in unit.table.variables]
    assert len(set(names)) == len(names), names
    assert {"T_out", "d_T_out"} <= set(names)
    monkeypatch.setattr(sys.modules["gtmodel.fmu.export"], "library", lambda sources: b"")
    held = gt.fmu.export(Near(), None, known="T", targets="status", name="near_held", on_fault="hold")
    names = [v.name for v in held.table.variables]
    assert len(set(names)) == len(names), names
    report = gt.fmu.check(unit, points=3)
    assert all(check.passed for check in report.checks.values()), report.checks


@pytest.mark.parametrize("name", ["fmu", "fmu3", "fmu_model", "fmu_step"])
def test_names_of_our_own_files_are_refused(name):
    with pytest.raises(gt.results.ArgumentError, match="name"):
        gt.fmu.export(function("driven"), None, name=name)


@pytest.mark.parametrize(("name", "which"), [("main", "fk"), ("a_selftest", "block")])
def test_names_that_end_as_files_that_are_left_out(name, which):
    assert gt.fmu.export(function(which), None, name=name).data


# the grammar of the standard, section 2.4.7.5.1
QUOTED = r"'(?:[A-Za-z0-9_!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['\"?\\abfnrtv])+'"
WORD = rf"(?:[A-Za-z_][A-Za-z0-9_]*|{QUOTED})(?:\[\d+(?:,\d+)*\])?"
NAME = re.compile(rf"{WORD}(?:\.{WORD})*|der\({WORD}(?:\.{WORD})*(?:,\d+)?\)")


@pytest.mark.parametrize("name", ["\u03b8", "der(\u00fc.x[2],2)", "it's", 'a"b', "back\\slash", "3d[1,2]", "a b.c"])
def test_names_follow_the_grammar_of_the_standard(name):
    assert NAME.fullmatch(fmi_name(name)), fmi_name(name)
    assert NAME.fullmatch(unused(fmi_name(name), {fmi_name(name)}))


def test_exponents_of_angles_below_zero():
    assert base_unit("m.rad-1") == {"m": 1, "rad": -1}
    assert base_unit("rad-2") == {"rad": -2}


def test_a_script_is_the_same_from_every_folder():
    """What the C says of a line stands in the archive: `python ../model.py` must give the same bytes."""
    assert str(of_frame("/models/runs/../plant.py", 3)) == str(of_frame("/models/plant.py", 3))


@pytest.mark.parametrize(
    ("given", "argument"),
    [
        ({"stop": float("inf")}, "stop"),
        ({"step": float("inf")}, "step"),
        ({"tolerance": float("nan")}, "tolerance"),
        ({"on_fault": "ignore"}, "on_fault"),
        ({"box": {"nothing": [[0.0, 1.0]]}}, "box"),
        ({"start": {"u": "fast"}}, "start"),
        ({"start": {"u": 1j}}, "start"),
    ],
)
def test_what_export_refuses(given, argument):
    with pytest.raises(gt.results.ArgumentError) as refusal:
        gt.fmu.export(function("driven"), None, name="refused", **given)
    assert refusal.value.argument == argument


def test_what_is_no_function_is_refused():
    with pytest.raises(gt.results.ArgumentError, match="what"):
        gt.fmu.export(3.0, None)
    with pytest.raises(gt.results.ArgumentError, match="box"):
        gt.fmu.export(function("block"), None, box={"error": [[0.0, 1.0]]})
    with pytest.raises(gt.results.ArgumentError, match="options"):
        gt.fmu.study({"a": function("driven")}, "nowhere", name="x", options={"b": {}}, check=None)


def test_a_file_of_somebody_else_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["gtmodel.fmu.export"], "library", lambda sources: b"")
    for name, text in (("notes.fmu", b"mine"), ("empty.fmu", b"")):
        (tmp_path / name).write_bytes(text)
    with pytest.raises(gt.results.ArgumentError, match="not written by gtmodel"):
        gt.fmu.export(function("fk"), tmp_path / "notes.fmu")
    assert (tmp_path / "notes.fmu").read_bytes() == b"mine"
    for _ in range(2):  # an empty place, then our own archive
        assert gt.fmu.export(function("fk"), tmp_path / "empty.fmu").path == tmp_path / "empty.fmu"


def test_one_tunable_is_a_name(monkeypatch):
    monkeypatch.setattr(sys.modules["gtmodel.fmu.export"], "library", lambda sources: b"")
    unit = gt.fmu.export(function("fk"), None, name="one", tunable="q")
    assert [v.name for v in unit.table.of("tunable")] == ["q[1]", "q[2]", "q[3]"]
