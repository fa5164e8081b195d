"""Kind "optimization": forms and controls from the file."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.commands import Commands

MODEL = """
import gtmodel as gt
from gtmodel import der


class Implicit(gt.Optimization):
    x = gt.variable(start=1.0, fixed=True)
    y = gt.variable(start=1.0)
    u = gt.input(min=-1.0, max=1.0)
    final_time = 1.0

    def equations(self):
        yield der(self.x) == self.y
        yield self.y + 0.3 * gt.sin(self.y) + self.y**3 == self.u - self.x

    def objective(self):
        return gt.integral(self.x**2 + 0.1 * self.u**2)
"""

PROBLEM = """
kind = "optimization"
model = "own.py:Implicit"
[mesh]
elements = 8
control = "{control}"
[solver]
formulation = "{formulation}"
"""
# Two forms of one discrete problem, each stopped by IPOPT at 1e-8 of its scaled conditions.
SOLVER = 1e-6


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Commands:
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(MODEL, encoding="utf-8")
    return Commands(capsys)


def problem(control: str = "polynomial", formulation: str = "auto") -> str:
    Path("problem.toml").write_text(PROBLEM.format(control=control, formulation=formulation), encoding="utf-8")
    return "problem.toml"


def test_forms_and_controls(gtmodel: Commands) -> None:
    found = {}
    for control, formulation in (("bernstein", "torn"), ("bernstein", "dae"), ("linear", "auto"), ("constant", "auto")):
        done = gtmodel("solve", problem(control, formulation), "--json")
        assert done.code == 0, done.out
        assert done.json["values"]["violation_between_nodes"] < SOLVER
        found[control, formulation] = done.json["objective"]
    assert found["bernstein", "torn"] == pytest.approx(found["bernstein", "dae"], rel=SOLVER)
    assert found["bernstein", "torn"] < found["linear", "auto"] < found["constant", "auto"]


def test_explain_tells_what_is_not_eliminated(gtmodel: Commands) -> None:
    assert "torn form, unknown at each point: der(x)" in gtmodel("explain", problem()).out


def test_refused(gtmodel: Commands) -> None:
    done = gtmodel("solve", problem("spline"))
    assert done.code == 2 and "mesh.control" in done.err
    done = gtmodel("solve", problem(formulation="explicit"))
    assert done.code == 2 and "no closed form" in done.err and "'torn' or 'dae'" in done.err


def test_compiled_elements_give_the_same(gtmodel: Commands, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("GTMODEL_CACHE", str(tmp_path / "cache"))
    plain, fast = (
        gtmodel("solve", problem(), "--json", "--set", f"solver.compile={word}") for word in ("false", "true")
    )
    assert (plain.code, fast.code) == (0, 0)
    assert fast.json["objective"] == pytest.approx(plain.json["objective"], rel=SOLVER)
    assert fast.json["iterations"] == plain.json["iterations"]
    assert any((tmp_path / "cache").glob("*.so"))


def test_no_compiler_is_one_sentence(gtmodel: Commands, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    done = gtmodel("solve", problem(), "--set", "solver.compile=true")
    assert done.code == 2 and "solver.compile: compile=True needs a compiler" in done.err


def test_a_tolerance_out_of_range(gtmodel: Commands) -> None:
    done = gtmodel("solve", problem(), "--set", "solver.tolerance=2")
    assert done.code == 2 and "tolerance must lie between 0 and 1; found 2" in done.err


def test_blocks_and_free_lengths_from_the_file(gtmodel: Commands) -> None:
    import gtmodel as gt

    file = Path(problem())
    text = file.read_text(encoding="utf-8").replace('[mesh]\nelements = 8\ncontrol = "polynomial"', TABLES)
    file.write_text(text, encoding="utf-8")
    done = gtmodel("solve", "problem.toml", "--json")
    assert done.code == 0, done.err
    mesh = gt.Mesh(
        8, control="linear", length_ratio=(0.5, 2.0), length_limits=(0.07, 0.2),
        length_cost=gt.LengthCost(uneven=0.001, rates={"x": 0.1}),
        blocks=gt.Blocks(sizes={"u": (1, 3, 4)}, step_max={"u": 0.1}, step_penalty={"u": 0.01}),
    )  # fmt: skip
    namespace: dict[str, object] = {}
    exec(MODEL, namespace)
    solution = gt.solve(namespace["Implicit"](), mesh)  # type: ignore[operator]
    assert done.json["objective"] == pytest.approx(solution.objective, rel=SOLVER)


TABLES = """[mesh]
elements = 8
control = "linear"
length_ratio = [0.5, 2.0]
shortest_element_s = 0.07
longest_element_s = 0.2
length_cost = { uneven = 0.001, rates = { x = 0.1 } }
[mesh.blocks.u]
sizes = [1, 3, 4]
step_max = 0.1
step_penalty = 0.01"""


@pytest.mark.parametrize(
    "setting, key",
    [
        ("mesh.blocks.u.sizes=[1,2]", "mesh: block sizes of 'u' sum to 3, but the mesh has 8 elements"),
        ("mesh.blocks.u.sizes=0", "mesh.blocks.u.sizes"),
        ("mesh.blocks.q.sizes=2", "unknown control 'q'; controls of Implicit are u"),
        ("mesh.longest_element_s=0.1", "mesh: length_limits needs free element lengths"),
        ("mesh.length_ratio=[2.0,3.0]", "mesh: length_ratio"),
    ],
)
def test_wrong_blocks_and_lengths(gtmodel: Commands, setting: str, key: str) -> None:
    done = gtmodel("solve", problem(), "--set", setting)
    assert done.code == 2 and key in done.err and "Traceback" not in done.err
