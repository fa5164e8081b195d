"""rumoca as flattener: simulations of its flat text, and classes that it would truncate."""

from __future__ import annotations

import builtins
import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.cli import main
from gtmodel.modelica.reference import libraries
from gtmodel.modelica.rumoca import _marked
from tests.modelica import texts

pytest.importorskip("lark")
EXAMPLES = Path(__file__).parents[2] / "problems" / "models" / "library_examples.mo"
FOLDERS = libraries()
AGREE = 1e-6  # of the largest value: two integrations at 1e-9
NEEDED = "rumoca is not installed: pip install 'gtmodel[rumoca]'"

# parts in arrays, functions of a package, an enumeration, a record, initial equations and an input that is connected
PLANT = """package Plant
  type Mode = enumeration(slow, fast);
  record Pair Real a; Real b; end Pair;
  function square input Real x; output Real y; algorithm y := x*x; end square;
  connector Pin Real v; flow Real i; end Pin;
  model Ohm parameter Real R = 2; Pin p; Pin n; equation p.v - n.v = R*p.i; p.i + n.i = 0; end Ohm;
  model Store parameter Real C = 1; Pin p; Real v(start = 0, fixed = true); equation p.v = v; C*der(v) = p.i; end Store;
  model Source Pin p; input Real v; equation p.v = v; end Source;
  model Ladder
    parameter Mode mode = Mode.fast; parameter Real k[2, 2] = {{1, 2}, {-1, 1}}; parameter Real top = 3;
    Source source; Ohm ohm[3](R = {1, 2, 3}); Store store; Pair pair; Real x[2](start = {1, 2}); Real y; Real chosen;
  initial equation
    x[1] = 3; x[2] = top/2;
  equation
    connect(source.p, ohm[1].p); connect(ohm[1].n, ohm[2].p); connect(ohm[2].n, ohm[3].p); connect(ohm[3].n, store.p);
    source.v = top*sin(time);
    der(x) = -k*x;
    pair.a = square(store.v) + (if mode == Mode.fast then 1 else 2); pair.b = -pair.a;
    y = noEvent(if x[1] > 1 then x[1]^2 else 2*x[1] - 1) + pair.b; chosen = if x[1] > 1 then x[2] else -x[1];
  end Ladder;
end Plant;
"""


def both(reference: str, end: float, library: list[str], **parameters: Any) -> tuple[Any, Any]:
    made = [
        gt.modelica.load(reference, library=library, parameters=parameters, flattener=f)()
        for f in ("rumoca", "gtmodel")
    ]
    theirs, ours = (m.simulate(end).trajectory for m in made)
    return theirs, ours


def differing(theirs: Any, ours: Any, names: list[str]) -> list[str]:
    """Variables whose histories do not agree, or that stand still and tell nothing."""
    off = {name: np.max(np.abs(theirs[name] - ours[name])) for name in names}
    return [n for n in names if not off[n] <= AGREE * np.max(np.abs(ours[n])) or np.ptp(ours[n]) == 0]


def test_a_pendulum_of_index_three(tmp_path: Path) -> None:
    pytest.importorskip("rumoca", reason=NEEDED)
    file = tmp_path / "pendulum.mo"
    file.write_text(texts.PENDULUM)
    (tmp_path / "broken.mo").write_text("model Broken")  # what lies beside it is not read
    theirs, ours = both(str(file), 2.0, [])
    assert differing(theirs, ours, ["x", "y", "vx", "vy"]) == []
    assert np.max(np.abs(np.hypot(theirs["x"], theirs["y"]) - 1.0)) < 1e-6


def test_parts_in_arrays_functions_and_parameters(tmp_path: Path) -> None:
    pytest.importorskip("rumoca", reason=NEEDED)
    file = tmp_path / "plant.mo"
    file.write_text(PLANT)
    names = ["store.v", "ohm[2].p.i", "source.p.v", "x[1]", "x[2]", "pair.b", "y", "chosen"]
    assert differing(*both(f"{file}:Ladder", 2.0, []), names) == []
    first, _ = both(f"{file}:Ladder", 2.0, [], top=4.0)
    assert differing(*both(f"{file}:Ladder", 2.0, [], **{"top": 4.0, "store.C": 0.5}), names) == []
    assert first["x[2]"][0] == 2.0


@pytest.mark.slow
@pytest.mark.skipif(not FOLDERS, reason="MODELICAPATH names no folder with the Modelica Standard Library")
@pytest.mark.parametrize(
    ("name", "end", "names"),
    [
        ("LowPass", 0.5, ["capacitor.v", "resistor.i"]),
        ("Drive", 1.0, ["rotor.phi", "rotor.w", "load.phi", "load.w", "shaft.flange_a.tau"]),
    ],
)
def test_models_of_library_components(name: str, end: float, names: list[str]) -> None:
    pytest.importorskip("rumoca", reason=NEEDED)
    assert differing(*both(f"{EXAMPLES}:{name}", end, FOLDERS), names) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("model M Real x(start = 1); discrete Real n; equation der(x) = -x; when x < 0.5 then n = 1; end when; end M;",
         "when clauses"),
        ("model M parameter Real p(fixed = false); Real x; initial equation x = 2; p*x = 6; equation der(x) = -p*x; "
         "end M;", "fixed = false"),
        ("model M parameter Real p; Real x; equation der(x) = -p*x; end M;", "'p' of M has no value"),
        ("model M parameter Real p(fixed = false); Real x; initial algorithm p := 2; equation der(x) = -p*x; end M;",
         "initial algorithms"),
        ("model M Real x; equation der(x) = -y; end M;", r"did not flatten M: .*'y'"),
        ("optimization M(objective = x(finalTime)) Real x; equation der(x) = -1; end M;", "knows no optimization"),
    ],
    ids=["when", "fixed", "no value", "initial algorithm", "its own sentence", "optimization"],
)  # fmt: skip
def test_classes_that_the_flat_text_would_truncate_are_rejected(tmp_path: Path, text: str, words: str) -> None:
    pytest.importorskip("rumoca", reason=NEEDED)
    file = tmp_path / "m.mop"
    file.write_text(text)
    with pytest.raises(gt.modelica.ModelicaError, match=words):
        gt.modelica.load(file, flattener="rumoca")


def test_errors_name_the_flat_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What gtmodel does not take of it: a sample of its own cache folder, line and all."""
    pytest.importorskip("rumoca", reason=NEEDED)
    monkeypatch.setenv("GTMODEL_CACHE", str(tmp_path / "cache"))
    file = tmp_path / "m.mo"
    file.write_text("model M Real x(start = 1); Real y; equation der(x) = -x; y = delay(x, 0.1); end M;")
    with pytest.raises(gt.ModelError, match=r"delay.*M-\w+\.mo:\d+"):
        gt.modelica.load(file, flattener="rumoca")


def test_a_result_contains_the_flat_text_and_the_version(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rumoca", reason=NEEDED)
    (tmp_path / "plant.mo").write_text(PLANT)
    problem = tmp_path / "ladder.toml"
    problem.write_text('kind = "simulation"\nrobot = "plant.mo:Ladder"\nfinal_time_s = 0.5\nflattener = "rumoca"\n')
    out = tmp_path / "out"
    assert main(["solve", str(problem), "--out", str(out)]) == 0
    run = tomllib.loads((out / "run.toml").read_text())
    assert run["versions"]["rumoca"].startswith("0.10.") and "flat.mo" in run["files"] and run["input"]["flatsha256"]
    assert "'ohm[2].p.v'" in (out / "flat.mo").read_text()
    assert "flattened by rumoca" in json.dumps(json.loads((out / "result.json").read_text()))
    problem.write_text('kind = "simulation"\nrobot = "l1_tape"\nfinal_time_s = 0.5\nflattener = "rumoca"\n')
    capsys.readouterr()
    assert main(["solve", str(problem)]) == 2 and "flattener" in capsys.readouterr().err


def test_without_the_package_the_error_names_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def none(name: str, *rest: Any, **more: Any) -> Any:
        if name == "rumoca" and not rest[-1]:  # not gtmodel's own module of that name
            raise ModuleNotFoundError(name)
        return real(name, *rest, **more)

    file = tmp_path / "m.mo"
    file.write_text(texts.PENDULUM)
    monkeypatch.setattr(builtins, "__import__", none)
    with pytest.raises(gt.modelica.ModelicaError, match=r"pip install 'gtmodel\[rumoca\]'"):
        gt.modelica.load(file, flattener="rumoca")
    with pytest.raises(gt.modelica.ModelicaError, match="no flattener 'omc'; expected gtmodel or rumoca"):
        gt.modelica.load(file, flattener="omc")


def test_only_names_of_components_are_quoted() -> None:
    text = """class M "a.b"
  parameter Real a[1].b(start = 1, stateSelect = StateSelect.Prefer) = 2 "of a[1].b";
  Real[3] c.d;
  Real x;
equation
  c.d[2] = a[1].b + P.f(x, c.d)*1.5; // c.d
  x = Modelica.Constants.pi;
end M;
"""
    assert _marked(text) == text.replace("  parameter Real a[1].b(", "  parameter Real 'a[1].b'(").replace(
        "Real[3] c.d", "Real[3] 'c.d'").replace("c.d[2] = a[1].b + P.f(x, c.d)", "'c.d'[2] = 'a[1].b' + P.f(x, 'c.d')"
    ).replace("Prefer", "prefer")  # fmt: skip
