"""Every outcome of an optimization other than "solved" names file and line of the text, as text and as data."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import SolveStatus

pytest.importorskip("lark")

CART = """optimization Cart(objective = {objective}, finalTime = 1{header})
  Real x(start = 1, fixed = true);
  Real v(start = 0, fixed = true);
  Real cost(start = 0{fixed});
  input Real u(min = -1, max = 1);
equation
  der(x) = v;
  der(v) = u;
  der(cost) = u^2 + {rate};
constraint
  {constraint};
end Cart;
"""
PLAIN = {
    "objective": "cost(finalTime)", "header": "", "fixed": ", fixed = true", "rate": "0", "constraint": "x <= 2",
}  # fmt: skip
CASES = [
    ("infeasible", {"constraint": "x(finalTime)^2 <= 0.01"}, {}, SolveStatus.INFEASIBLE, 11),
    ("mesh", {"objective": "cost(finalTime)^2", "rate": "sin(40*time)"}, {}, SolveStatus.CHECK_FAILED, 4),
    ("integral", {"rate": "x*sin(40*time)^2"}, {}, SolveStatus.CHECK_FAILED, 1),
    ("limit", {}, {"max_iterations": 1}, SolveStatus.ITERATION_LIMIT, 1),
    ("time", {}, {"max_seconds": 0.0}, SolveStatus.INTERRUPTED, 1),
    ("surplus", {"constraint": "x(finalTime) = 0.9; x(0.5) = 0.99; x(0.3)*v(0.2) = 7"}, {}, SolveStatus.INFEASIBLE, 11),
]


def problem(tmp_path: Path, **changes: str) -> Path:
    file = tmp_path / "cart.mop"
    file.write_text(CART.format(**{**PLAIN, **changes}))
    return file


@pytest.mark.parametrize(("changes", "options", "status", "line"), [c[1:] for c in CASES], ids=[c[0] for c in CASES])
def test_the_line_of_the_text(
    tmp_path: Path, changes: dict[str, str], options: dict[str, float], status: SolveStatus, line: int
) -> None:
    model = gt.modelica.load(problem(tmp_path, **changes))()
    ended = gt.solve(model, gt.Mesh(4), solver=gt.SolverOptions(**options), throw=False)
    assert ended.status is status, ended.message
    assert ended.where is not None and ended.where.file.endswith("cart.mop") and ended.where.line == line, ended.message
    assert f"({ended.where})" in ended.message


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"fixed": ""}, 4),
        ({"constraint": "x >= 2"}, 2),
        ({"constraint": "x(3) >= 2"}, 1),
        ({"header": ", startTime = 5"}, 1),
    ],
    ids=["adrift", "bounds cross", "outside", "backwards"],
)
def test_rejections_name_the_line_of_the_text(tmp_path: Path, changes: dict[str, str], line: int) -> None:
    model = gt.modelica.load(problem(tmp_path, **changes))()
    with pytest.raises(gt.ModelError) as caught:
        gt.solve(model, gt.Mesh(4))
    assert caught.value.where is not None and caught.value.where.line == line, caught.value


def test_the_command_line_prints_it_and_json_has_it(tmp_path: Path) -> None:
    file = problem(tmp_path, constraint="x(finalTime)^2 <= 0.01")
    run = subprocess.run(
        [sys.executable, "-m", "gtmodel", "solve", str(file), "--json", "--set", "mesh.elements=4"],
        capture_output=True, text=True, env={**os.environ, "MODELICAPATH": ""}, check=False,
    )  # fmt: skip
    answer = json.loads(run.stdout)
    assert run.returncode == 1 and answer["status"] == "infeasible"
    assert answer["values"]["where"].endswith("cart.mop:11") and f"({answer['values']['where']})" in answer["message"]


def test_coefficients_of_very_different_size_are_not_singular(tmp_path: Path) -> None:
    """d, then der(n), which follow one after the other however small the coefficient of der(n) is beside that of d."""
    file = tmp_path / "scale.mo"
    file.write_text(
        "model M Real x(start=1, fixed=true); Real d; Real n(start=0, fixed=true);\n"
        "equation der(x) = -x; d = 1e-9*x^2; der(n) = 1e9*d; end M;"
    )
    end = gt.modelica.load(file)().simulate(1.0).trajectory
    assert end is not None
    assert end["n"][-1] == pytest.approx(0.5 * (1 - np.exp(-2.0)), rel=1e-5)  # the integrator keeps 1e-9 a step


def test_singular_equations_are_rejected(tmp_path: Path) -> None:
    file = tmp_path / "singular.mo"
    file.write_text(
        "model M Real x(start=1, fixed=true); Real y; Real z;\n"
        "equation der(x) = -x;\n y + z = x;\n 2*y + 2*z = sin(x);\nend M;"
    )
    with pytest.raises(gt.ModelError) as caught:
        gt.modelica.load(file)().simulate(1.0)
    assert caught.value.where is not None and caught.value.where.line in (3, 4)


def test_a_base_class_beside_an_imported_package_of_its_name(tmp_path: Path) -> None:
    """`Icons` is a package of the imported SIunits and of the file; the one that has the class is meant."""
    file = tmp_path / "icons.mo"
    file.write_text(
        "package P package Q package Icons end Icons; end Q; package Icons partial model Wall end Wall; end Icons;\n"
        "model M import P.Q.*; extends Icons.Wall; Real x(start=1, fixed=true); equation der(x) = -x; end M; end P;"
    )
    assert gt.modelica.load(f"{file}:P.M")().simulate(1.0).status is SolveStatus.SOLVED
    file.write_text(file.read_text().replace("extends Icons.Wall", "extends Icons.Wal"))
    with pytest.raises(gt.modelica.ModelicaError, match="no class 'Wal'") as caught:
        gt.modelica.load(f"{file}:P.M")
    assert caught.value.where is not None and caught.value.where.line == 2
