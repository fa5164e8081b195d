"""Entry points: Modelica texts at the command line and in problem files."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import gtmodel as gt
from gtmodel.cli import main
from tests.modelica import texts

pytest.importorskip("lark")
CLONE = Path(__file__).parents[2]
VDP = CLONE / "problems" / "models" / "van_der_pol.mop"


def said(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    code = main([str(w) for w in words])
    out, err = capsys.readouterr()
    return code, out, err


def _values(record: dict[str, Any], name: str) -> Iterator[Any]:
    """Of a key at any depth."""
    for key, value in record.items():
        if key == name:
            yield value
        elif isinstance(value, dict):
            yield from _values(value, name)


def test_a_class_is_solved(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out_folder = tmp_path / "out"
    code, out, _ = said(capsys, "solve", f"{VDP}:Fast", "--out", out_folder, "--set", "mesh.elements=20",
                        "--set", "mesh.control=linear")  # fmt: skip
    assert code == 0 and "the first guess is a simulation from 0 s to 2 s" in out
    result = json.loads((out_folder / "result.json").read_text())
    assert result["values"]["final_time_s"] == pytest.approx(2.2811587, rel=2e-3)  # of 20 elements
    code, out, _ = said(capsys, "solve", f"{VDP}:Quiet", "--json", "--set", "mesh.elements=20")
    quiet = json.loads(out)["objective"]
    code, out, _ = said(capsys, "solve", f"{VDP}:VanDerPol.QuietExtended", "--json", "--set", "mesh.elements=20",
                        "--set", "parameters.mu=2")  # fmt: skip
    assert json.loads(out)["objective"] != pytest.approx(quiet, rel=1e-3)


def test_a_model_is_simulated_until_its_stop_time(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "pendulum.mo"
    file.write_text(texts.PENDULUM)
    code, out, _ = said(capsys, "solve", file, "--json", "--out", tmp_path / "out")
    assert code == 0 and json.loads(out)["kind"] == "simulation"
    stored = json.loads((tmp_path / "out" / "result.json").read_text())
    assert stored["trajectory"]["time_s"][-1] == 2.0


def test_listing_of_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = said(capsys, "list", VDP)
    assert code == 0 and "VanDerPol.Fast" in out and "to rest in least time" in out
    code, _, err = said(capsys, "solve", VDP)
    assert code == 2 and "VanDerPol.Quiet, VanDerPol.QuietExtended" in err
    code, _, err = said(capsys, "solve", f"{VDP}:Fats")
    assert code == 2 and "Fast" in err
    code, _, err = said(capsys, "solve", CLONE / "nothing.mop")
    assert code == 2 and "nothing.mop" in err


def test_a_class_is_explained_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = said(capsys, "explain", f"{VDP}:Fast")
    assert code == 0 and "free: final_time" in out
    code, out, _ = said(capsys, "explain", f"{VDP}:Fast", "--python")
    assert code == 0 and out == gt.modelica.python_of(f"{VDP}:Fast") + "\n"
    code, out, _ = said(capsys, "explain", f"{VDP}:QuietComponent", "--flat")
    assert code == 0 and out == gt.modelica.flat_of_text(f"{VDP}:QuietComponent") + "\n" and "'sys.x1'" in out
    robot = CLONE / "problems" / "models" / "gantry_tau.mop"
    code, out, _ = said(
        capsys, "explain", f"{robot}:Robot", "--known", "T[1],T[2],T[3]", "--targets", "q[1],q[2],q[3]", "--full"
    )
    assert code == 0 and "gantry_tau.mop:" in out
    assert said(capsys, "explain", "l1_tape", "--python")[0] == said(capsys, "explain", "l1_tape", "--flat")[0] == 2


def test_an_error_names_file_and_line_and_prints_it(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "wrong.mop"
    file.write_text(
        "optimization O(objectiveIntegrand = x^2)\n  Real x(fixed = true);\nequation\n  der(x) = y;\nend O;\n"
    )
    code, _, err = said(capsys, "solve", file)
    assert code == 2 and "wrong.mop:4" in err and "der(x) = y;" in err


def test_problem_files_name_texts_libraries_and_a_guess(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MODELICAPATH", raising=False)  # the one library is that of the problem
    (tmp_path / "library.mo").write_text(
        "package Library model Integrator Real x(start = 1, fixed = true); input Real u; equation der(x) = u; "
        "end Integrator; end Library;"
    )
    (tmp_path / "rest.mop").write_text(
        "optimization Rest(objectiveIntegrand = x^2 + u^2) extends Library.Integrator(u(min = -1)); end Rest;"
    )
    one_file = (tmp_path / "library.mo").read_text() + (tmp_path / "rest.mop").read_text()
    (tmp_path / "both.mop").write_text(one_file)
    problem = tmp_path / "rest.toml"
    mesh = "[mesh]\nelements = 5\n"
    problem.write_text(f'kind = "optimization"\nmodel = "rest.mop:Rest"\nlibrary = ["library.mo"]\n{mesh}')
    code, out, _ = said(capsys, "solve", problem, "--json", "--out", tmp_path / "first")
    first = json.loads(out)["objective"]
    assert code == 0 and first == pytest.approx(0.7616, abs=1e-4)  # tanh(1)
    record = tomllib.loads((tmp_path / "first" / "run.toml").read_text())
    for entry, file in (("model", "rest.mop"), ("library1", "library.mo")):
        content = (tmp_path / file).read_bytes()
        assert [v for v in _values(record, f"{entry}sha256")] == [hashlib.sha256(content).hexdigest()]
    problem.write_text(f'kind = "optimization"\nmodel = "both.mop:Rest"\nguess = "first"\n{mesh}')
    code, out, _ = said(capsys, "solve", problem, "--json")
    assert code == 0 and json.loads(out)["objective"] == pytest.approx(first, rel=1e-12)
    assert gt.solve(gt.modelica.load(tmp_path / "both.mop")(), gt.Mesh(5)).objective == (
        gt.solve(gt.modelica.load(tmp_path / "rest.mop", library=[tmp_path / "library.mo"])(), gt.Mesh(5)).objective
    )


def test_a_gantry_tau_in_text_equals_the_catalogue(tmp_path: Path) -> None:
    """Forward and inverse kinematics of the three-link robot, by both, at poses around home."""
    import numpy as np

    robot = gt.modelica.load(f"{CLONE / 'problems' / 'models' / 'gantry_tau.mop'}:Robot")()
    catalogue = gt.robots.gantry_tau("l1_tape")
    T, q = ([f"{n}[{i}]" for i in (1, 2, 3)] for n in "Tq")
    inverse, forward = robot.causal(known=T, targets=q), robot.causal(known=q, targets=T)
    theirs = catalogue.causal(known="T", targets="q")
    for shift in np.random.default_rng(2).uniform(-0.15, 0.15, (20, 3)):
        pose = np.array(catalogue.home) + shift
        *carts, status = inverse(*pose)
        assert status.ok and np.allclose(carts, theirs(pose)[0], rtol=0, atol=1e-13)
        *back, status = forward(*carts)
        assert status.ok and np.allclose(back, pose, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_c_code_of_a_robot_in_text_equals_python_bit_for_bit(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    robot = CLONE / "problems" / "models" / "gantry_tau.mop"
    T, q = ([f"{n}[{i}]" for i in (1, 2, 3)] for n in "Tq")
    ranges = [(1.2, 1.6), (-0.6, -0.3), (0.8, 1.1), (-0.6, -0.5), (-0.4, -0.3), (-0.1, 0.0)]
    box = dict(zip([*T, *q], ranges, strict=True))
    lines = ['kind = "codegen"', f'robot = "{robot.as_posix()}:Robot"', 'name = "tau"']
    for name, known, targets in (("ik", T, q), ("fk", q, T)):
        lines += [
            "[[functions]]",
            f'name = "{name}"',
            f"known = {json.dumps(known)}",
            f"targets = {json.dumps(targets)}",
        ]
    lines += ["[box]", *(f'"{name}" = [[{low}, {high}]]' for name, (low, high) in box.items())]
    problem = tmp_path / "tau.toml"
    problem.write_text("\n".join(lines) + "\n")
    code, out, err = said(capsys, "codegen", problem, "-o", tmp_path / "c", "--check")
    assert code == 0, err
    assert "equals Python bit for bit" in out


def test_a_model_with_inputs_is_simulated_with_their_start_values(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "cart.mo"
    file.write_text("model Cart Real x(start = 1, fixed = true); input Real u(start = 2); input Real w; equation "
                    "der(x) = u + 10*w; end Cart;")  # fmt: skip

    def end(*settings: str) -> float:
        out = tmp_path / f"out{len(settings)}"
        code, shown, _ = said(capsys, "solve", file, "--out", out, *settings)
        assert code == 0 and "held at their start values" in shown
        return json.loads((out / "result.json").read_text())["trajectory"]["values"]["x"][-1]

    assert end() == pytest.approx(3.0) and end("--set", "inputs.u=-1") == pytest.approx(0.0, abs=1e-9)
    code, out, _ = said(capsys, "explain", file, "--known", "u,w", "--targets", "der(x)", "--full")  # its only class
    assert code == 0 and "der(x)  from" in out
    code, _, err = said(capsys, "explain", f"{file}:Card", "--known", "u", "--targets", "x")
    assert code == 2 and "did you mean 'Cart'" in err


def test_a_class_of_a_package_in_folders_is_named_by_its_file(tmp_path: Path) -> None:
    """`package.mo:P.A.B`, where A lies in a folder of its own and B in a file there."""
    (tmp_path / "P" / "A").mkdir(parents=True)
    (tmp_path / "P" / "package.mo").write_text("package P constant Real k = 2; end P;")
    (tmp_path / "P" / "A" / "package.mo").write_text("within P; package A end A;")
    (tmp_path / "P" / "A" / "B.mo").write_text("within P.A; model B Real x = k; end B;")
    for name in ("P.A.B", "A.B"):
        model = gt.modelica.load(f"{tmp_path}/P/package.mo:{name}")()
        assert model.causal(targets="x")()[0] == 2.0


def test_classes_of_neighbouring_files_are_found(tmp_path: Path) -> None:
    """Its own class of a name has precedence over one of a file beside it."""
    text = "model Plant Real x = k; parameter Real k = 3; end Plant; model Own Real x = 0; end Own;"
    (tmp_path / "plant.mo").write_text(text)
    (tmp_path / "own.mop").write_text("model Own Plant p; Real x = 1; end Own;")
    translation = gt.modelica.translate.translated(tmp_path / "own.mop")
    values = translation.model().causal(targets=["p.x", "x"])()
    assert [float(v) for v in values[:2]] == [3.0, 1.0]
    assert [f.name for f in translation.libraries] == ["plant.mo"]
