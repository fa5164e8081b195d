"""What is written: the same bytes in every process, names with units, one status table, no dates."""

import json
import math
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel import cgen
from gtmodel._files import codegen_dir
from gtmodel.cgen.interface import interfaces, unit_suffix
from gtmodel.cgen.real import comment, decimal, hexadecimal
from gtmodel.results import c_enum, c_sentences
from tests.cgen.conftest import Functions, SliderCrank

GENERATE = """
import sys
from pathlib import Path
import gtmodel as gt
from gtmodel import cgen
robot = gt.robots.gantry_tau("l1_tape")
functions = {"fk": robot.causal(known="q", targets="T"), "forward": robot.causal(known="tau", targets="der(T,2)")}
cgen.generate(functions, Path(sys.argv[1]), name="l1", provenance={"robot": "l1_tape"})
"""


def test_two_processes_give_identical_bytes(tmp_path: Path) -> None:
    clone = Path(gt.__file__).parents[1]
    for seed in ("1", "4321"):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(clone)}
        command = [sys.executable, "-c", GENERATE, seed]
        subprocess.run(command, cwd=tmp_path, env=environment, check=True, timeout=120)
    first, second = ({p.name: p.read_bytes() for p in (tmp_path / s).iterdir()} for s in ("1", "4321"))
    assert first == second and len(first) == 13


def test_no_dates_and_no_paths_of_this_machine(l1_folder: Path) -> None:
    for path in l1_folder.iterdir():
        text = path.read_text()
        assert str(Path(gt.__file__).parents[1]) not in text and "/tmp" not in text, path.name
        assert not re.search(r"\b20\d\d-\d\d-\d\d\b|\b\d\d:\d\d\b", text), path.name


def test_header_speaks_of_units_and_sources(l1_folder: Path) -> None:
    header = (l1_folder / "gt_l1.h").read_text()
    for line in (
        "double q_m[3]; /* q [m]: cart coordinates along their guideways (robots/three_link.py:",
        "double d_T_m_s[3]; /* der(T) [m/s]: tool centre point (",
        "double d2_T_m_s2[3]; /* der(T,2) [m/s2]: tool centre point (",
        "double tau_N[3]; /* tau [N]: motor forces (",
        "gt_status gt_l1_inverse_dynamics(const gt_l1_inverse_dynamics_in *in, gt_l1_inverse_dynamics_out *out);",
    ):
        assert line in header


@pytest.mark.parametrize(
    ("unit", "suffix"),
    [("m", "m"), ("m/s2", "m_s2"), ("N.m", "Nm"), ("N/m", "N_m"), ("kg.m2/s2", "kgm2_s2"), ("1/s", "per_s"),
     ("rad", "rad"), ("1", ""), ("?", ""), ("", ""), ("m/(s.K)", "m_sK")],
)  # fmt: skip
def test_units_become_words(unit: str, suffix: str) -> None:
    assert unit_suffix(unit) == suffix


def test_members_avoid_keywords_and_each_other(tmp_path: Path) -> None:
    class Odd(gt.Model):
        int = gt.variable(unit="1", description="ends a comment */ and a line \\")
        new = gt.variable(unit="1")
        v = gt.variable(unit="m/s")
        v_m = gt.variable(unit="s")
        φ = gt.variable(unit="rad")
        scale = gt.parameter(1.0, unit="s")
        speed = gt.parameter(1.0, unit="m/s")

        def equations(self):
            yield self.new == 2 * self.int
            yield self.v == gt.sin(self.int) * self.speed
            yield self.φ == 3 * self.int
            yield self.v_m == self.scale * gt.cos(self.int)

    function = Odd().causal(known="int", targets=["new", "v", "v_m", "φ"], name="f")
    (face,) = interfaces({"f": function}, "odd")
    assert [m.identifier for m in face.inputs] == ["int_2"]
    assert [m.identifier for m in face.outputs] == ["new_2", "v_m_s", "v_m_s_2", "u03c6_rad"]
    folder = cgen.generate({"f": function}, tmp_path / "odd", name="odd").folder
    assert cgen.check(folder, {"f": function}, points=20).passed


@pytest.mark.parametrize("name", ["", "2fast", "a-b", "a__b", "a_", "_a", "ä", "a b", "a/b", "../x"])
def test_names_must_be_identifiers(name: str, small: Functions, tmp_path: Path) -> None:
    with pytest.raises(cgen.GenerationError, match="use letters, digits and single underscores"):
        cgen.generate(small, tmp_path / "x", name=name)
    with pytest.raises(cgen.GenerationError, match="use letters, digits and single underscores"):
        cgen.generate({name: small["slider"]}, tmp_path / "x", name="x")
    assert not (tmp_path / "x").exists()


def test_names_must_not_meet(small: Functions, tmp_path: Path) -> None:
    f = small["slider"]
    for key in ("fk_in", "fk_out", "fk_body", "FK"):
        with pytest.raises(cgen.GenerationError, match=f"the function '{key}' needs the C name"):
            cgen.generate({"fk": f, key: f}, tmp_path / "x", name="x")
    with pytest.raises(cgen.GenerationError, match="which the self-test has"):
        cgen.generate({"selftest": f}, tmp_path / "x", name="x")
    with pytest.raises(cgen.GenerationError, match=r"gt_status\.h belongs to the runtime"):
        cgen.generate(small, tmp_path / "x", name="status")
    with pytest.raises(cgen.GenerationError, match="no function to generate"):
        cgen.generate({}, tmp_path / "x", name="x")


def test_a_parameter_without_a_value_is_named(tmp_path: Path) -> None:
    class Scale(gt.Model):
        k = gt.parameter(unit="1")
        u = gt.variable(unit="1")
        y = gt.variable(unit="1")

        def equations(self):
            yield self.y == self.k * self.u

    with pytest.raises(gt.ModelError, match="parameter 'k'"):
        cgen.generate({"y": Scale().causal(known="u", targets="y")}, tmp_path / "x", name="x")


def test_manifest_tells_what_it_was_made_from(small_folder: Path, small: Functions, tmp_path: Path) -> None:
    content = json.loads((small_folder / "manifest.json").read_text())
    assert content["statuses"][3] == {"code": 3, "name": "GT_SINGULAR", "sentence": gt.Status.SINGULAR.message}
    assert [m["title"] for m in content["models"]] == ["SliderCrank", "Pendulum"]
    assert {"name": "g", "value": 9.81, "unit": "m/s2"} in content["models"][1]["parameters"]
    slider = content["functions"][0]
    assert slider["outputs"][1] == {"member": "d_x_m_s", "signal": "der(x)", "shape": [], "unit": "m/s"}
    assert set(content["files"]) == {p.name for p in small_folder.iterdir()} - {"manifest.json"}
    longer = {"slider": SliderCrank(r=math.nextafter(0.1, 1)).causal(known="phi", targets=["x", "der(x)"])}
    folders = [
        cgen.generate(f, tmp_path / n, name="s").folder for f, n in (({"slider": small["slider"]}, "a"), (longer, "b"))
    ]
    hashes = {json.loads((f / "manifest.json").read_text())["parameters_sha256"] for f in folders}
    assert len(hashes) == 2, "the last bit of a parameter counts"


def test_provenance_is_kept_and_cannot_break_the_code(small: Functions, tmp_path: Path) -> None:
    nasty = {"robot": "x */ #error no\n#error no", "source": "naïve \\"}
    folder = cgen.generate({"slider": small["slider"]}, tmp_path / "x", name="x", provenance=nasty).folder
    assert json.loads((folder / "manifest.json").read_text())["provenance"] == nasty
    header = (folder / "gt_x.h").read_text()
    assert "robot: x * / #error no #error no" in header and header.isascii()


def test_one_table_of_statuses() -> None:
    header = (codegen_dir() / "runtime" / "gt_status.h").read_text()
    assert c_enum() in header and textwrap.indent(c_sentences(), "    ") in header
    for status in gt.Status:
        assert f"{status.c_name} = {int(status)}" in header and f'"{status.message}"' in header


def test_numbers_and_comments() -> None:
    assert [hexadecimal(x) for x in (float("nan"), float("inf"), float("-inf"))] == ["NAN", "INFINITY", "-INFINITY"]
    for x in (0.1, -0.0, 5e-324, 1.7976931348623157e308):
        assert float.fromhex(hexadecimal(x)) == x == float(decimal(x))
    assert comment(["one"]) == "/* one */\n"
    assert all(len(line) <= 110 for line in comment(["word " * 100], "    ").splitlines())
