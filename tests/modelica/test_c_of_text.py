"""Generated C of a model in text against Python, both loaded and printed from the same text."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.cgen import generate
from gtmodel.cgen.interface import interfaces
from gtmodel.cgen.points import draw, evaluate
from gtmodel.cgen.verification.comparison import call
from gtmodel.compiler.causal import flat_of
from gtmodel.fmu.table import fmi_name, texts_of
from gtmodel.modelica.classes import identifier
from tests.cgen.calls import shared_library

pytest.importorskip("lark")
MODELS = Path(__file__).parents[2] / "problems" / "models"
ROWS = 400
T, Q = (tuple(f"{n}[{i}]" for i in (1, 2, 3)) for n in "Tq")
CAUSALITIES = {
    "Robot": {"fk": (Q, T), "ik": (T, Q)},
    "Leg": {"forward": (("a[1]", "a[2]"), ("foot[1]", "foot[2]")), "load": (("a[1]", "a[2]", "lift"), ("need",))},
}
# two links, with a function, an array of components and a condition of parameters
LEG = """
function along input Real r; input Real angle; output Real d[2]; algorithm
  d := r*{cos(angle), sin(angle)}; end along;
model Link parameter Real r = 1; parameter Boolean bent = false; Real d[2]; Real angle; equation
  d = along(r, if bent then angle + 0.25 else angle); end Link;
model Leg
  parameter Real m[:] = {1, 0.5, 0.125};
  Link link[2](r = {1, 0.75}, bent = {false, true});
  Real a[2]; Real foot[2]; Real lift; Real need;
equation
  link[1].angle = a[1]; link[2].angle = a[1] + a[2];
  foot = link[1].d + link[2].d;
  need = sum(m[i]*lift^i for i in 1:3)/(1 + foot*foot) + atan2(foot[1], 2 + foot[2]);
end Leg;
"""


def printed(reference: str) -> Any:
    world: dict[str, object] = {"__name__": "printed"}
    exec(gt.modelica.python_of(reference), world)
    return next(c for c in world.values() if isinstance(c, type) and issubclass(c, gt.Model))()


def python_name(name: str) -> str:
    return f"der({identifier(name[4:-1])})" if name.startswith("der(") else identifier(name)


def functions_of(model: Any, causalities: Mapping[str, Any], naming: Any = str) -> dict[str, Any]:
    return {
        key: model.causal(known=[naming(k) for k in known], targets=[naming(t) for t in targets])
        for key, (known, targets) in causalities.items()
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", CAUSALITIES)
def test_c_of_a_text_equals_its_python_bit_for_bit(name: str, tmp_path: Path) -> None:
    (tmp_path / "leg.mo").write_text(LEG)
    reference = f"{MODELS / 'gantry_tau.mop' if name == 'Robot' else tmp_path / 'leg.mo'}:{name}"
    functions = functions_of(gt.modelica.load(reference)(), CAUSALITIES[name])
    folder = generate(functions, tmp_path / "c", name="text").folder
    library = shared_library(folder, tmp_path)
    again = functions_of(printed(reference), CAUSALITIES[name], python_name)
    faces, others = interfaces(functions, "text"), interfaces(again, "text")
    for face, other in zip(faces, others, strict=True):
        rows = draw(face, ROWS, seed=28)
        values, status = call(library, face, rows)
        assert np.mean(status == gt.Status.OK) > 0.1 and np.ptp(values[status == gt.Status.OK], axis=0).min() > 0
        for who in (face, other):
            here, said = evaluate(who, rows)
            assert np.array_equal(said, status)
            ok = status == gt.Status.OK
            assert np.array_equal(here[ok], values[ok])


TANK = """model Tank "two in a row"
  model One
    parameter Real A(unit = "m2") = 1; parameter Real a(unit = "m3/s") = 0.02; parameter Real top(unit = "m") = 1;
    Real h(unit = "m"); input Real q(unit = "m3/s"); Real out(unit = "m3/s");
  equation A*der(h) = q - out; out = a*sqrt(h/top); end One;
  One tank[2](h(start = {1, 0.5}, each fixed = true));
  input Real q(unit = "m3/s", start = 0.01); output Real out(unit = "m3/s");
equation tank[1].q = q; tank[2].q = tank[1].out; out = tank[2].out; end Tank;
"""


def test_indices_in_names_of_units_count_from_one(tmp_path: Path) -> None:
    file = tmp_path / "tank.mo"
    file.write_text(TANK)

    class Plant(gt.Model):  # a text as parts of a model in Python, whose own names count from zero
        row = gt.parts(2, gt.modelica.load(f"{file}:Tank"))

        def equations(self) -> Any:
            yield self.row[1].q == self.row[0].out

    for model, names in (
        (gt.modelica.load(f"{file}:Tank")(), ["tank[1].h", "tank[2].h"]),
        (Plant(), [f"row[{i}].tank[{k}].h" for i in (1, 2) for k in (1, 2)]),
    ):
        flat = flat_of(model)
        assert [fmi_name(v.name, texts_of(flat)) for v in flat.variables if v.name.endswith(".h")] == names


@pytest.mark.slow
def test_a_unit_of_a_text_has_the_names_of_the_text_and_its_motion(tmp_path: Path) -> None:
    file = tmp_path / "tank.mo"
    file.write_text(TANK)
    model = gt.modelica.load(f"{file}:Tank")()
    unit = gt.fmu.export(model, tmp_path / "tank.fmu", known="q", targets=["out"], stop=0.5)
    assert {v.name: v.start for v in unit.table.of("state")} == {"tank[1].h": 1.0, "tank[2].h": 0.5}
    assert [(v.name, v.unit) for v in unit.table.of("output")] == [("out", "m3/s")]
    fmpy = pytest.importorskip("fmpy")
    run = model.simulate(0.5, inputs={"q": 0.05}, tolerance=1e-11).trajectory
    rows = fmpy.simulate_fmu(str(tmp_path / "tank.fmu"), stop_time=0.5, start_values={"q": 0.05}, output=["out"])
    assert rows["out"][-1] == pytest.approx(run["out"][-1], rel=1e-8)
