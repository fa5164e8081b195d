"""A mechanism of one's own: calibrated, written as a robot file, read again as the same model."""

from pathlib import Path

import numpy as np
import pytest
import tomli_w

import gtmodel as gt
from gtmodel.calibrate.unknowns import merged
from gtmodel.compiler.causal import flat_of
from gtmodel.problem_files import Context, InputError, robots
from gtmodel.problem_files.explaining import of

OWN = '''"""Three legs on carts along x hold a point."""

import gtmodel as gt


class Leg(gt.Model):
    L = gt.parameter(1.2, unit="m", positive=True)
    A = gt.parameter([0.0, 0.0, 0.0], unit="m")
    m = gt.parameter(1.0, unit="kg")
    q = gt.variable(unit="m")
    p = gt.variable(3, unit="m")

    def equations(self):
        d = self.p - self.A - gt.vector([self.q, 0.0, 0.0])
        yield gt.dot(d, d) == self.L**2
        yield gt.branch("behind", d[0])


class Three(gt.Model):
    A = gt.parameter([[0.0, 0.0, 0.0], [0.2, -1.0, 0.0], [0.1, 0.0, 1.0]], unit="m", shape=(3, 3))
    q = gt.variable(3, unit="m")
    T = gt.variable(3, unit="m", start=[1.0, 0.3, 0.3])
    leg = gt.parts(3, Leg, A=A)

    def equations(self):
        for k in range(3):
            yield self.leg[k].q == self.q[k]
            yield self.leg[k].p == self.T
'''
A = np.array([[0.01, -0.01, 0.0], [0.2, -1.01, 0.01], [0.1, 0.0, 0.99]])
L = np.array([1.1, 1.6, 1.3])
PROBLEM = {
    "kind": "calibration", "robot": "own.py:Three", "parameters": {"leg": {"m": 2.5}}, "sensitivity_step": 0.0,
    "measurements": {"file": "poses.csv", "signals": {"q": {"column": "q", "unit": "mm"},
                                                      "T": {"column": "T", "unit": "mm"}}},
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Synthetic poses of the known mechanism, seed 0, noise 10 um, and the file that its calibration wrote."""
    at = tmp_path_factory.mktemp("own")
    (at / "own.py").write_text(OWN)
    rng = np.random.default_rng(0)
    T = rng.uniform(-0.3, 0.3, (40, 3)) + np.array([1.0, 0.0, 0.3])
    d = T[:, None] - A
    q = d[:, :, 0] - np.sqrt(L**2 - d[:, :, 1] ** 2 - d[:, :, 2] ** 2)
    rows = np.hstack([q, T + 1e-5 * rng.standard_normal(T.shape)])
    heads = [f"{name}[{k}] [mm]" for name in "qT" for k in range(3)]
    lines = [",".join(f"{1e3 * x:.4f}" for x in row) for row in rows]
    (at / "poses.csv").write_text("# synthetic: seed 0, 10 um\n" + "\n".join([",".join(heads), *lines]) + "\n")
    (at / "out").mkdir()
    (at / "out" / "parameters.toml").write_text(str(solved(at).files["parameters.toml"]))
    return at


def solved(folder: Path, **changes: object):
    path = folder / "problem.toml"
    path.write_text(tomli_w.dumps({**PROBLEM, **changes}))
    return gt.load(path)()


def values(model) -> dict[str, float]:
    return {p.name: p.value for p in flat_of(model).parameters}


def test_the_file_is_the_model_with_its_calibrated_parameters(folder: Path):
    first = solved(folder)
    model = robots.resolve("out/parameters.toml", Context(folder=folder))
    assert type(model).__name__ == "Three"
    found = values(model)
    assert {n: found[n] for n in first.values["parameters"]} == first.values["parameters"]
    assert [found[f"leg[{k}].L"] for k in range(3)] == pytest.approx(L, abs=1e-3)
    assert found["leg[1].m"] == 2.5  # as it was given, though nothing measured moves with it
    text = str(first.files["parameters.toml"])
    assert "# of the measurement" not in text and "gtmodel reads this file as a robot" in text


def test_calibrated_again_it_stays_and_names_its_class(folder: Path):
    again = solved(folder, robot="out/parameters.toml", parameters={})
    assert again.iterations is not None and again.iterations <= 1
    assert again.values["unknowns"][0]["value"] == pytest.approx(A[0, 0], abs=1e-3)
    assert 'robot = "own.py:Three"' in str(again.files["parameters.toml"])
    assert again.values["fitted_mm"]["mean"] == pytest.approx(solved(folder).values["fitted_mm"]["mean"], rel=1e-6)


def test_a_problem_may_say_more_and_a_catalogue_option_is_refused(folder: Path):
    context = Context(folder=folder)
    model = robots.resolve("out/parameters.toml", context, parameters={"leg": {"m": 4.0}})
    assert values(model)["leg[2].m"] == 4.0 and values(model)["leg[2].L"] != 1.2
    with pytest.raises(InputError, match="is a model in Python"):
        robots.resolve("out/parameters.toml", context, payload=2.0)
    (folder / "bad.toml").write_text('robot = "own.py:Three"\nparameters = 3\n')
    with pytest.raises(InputError, match=r"expected a table \[parameters\] in 'bad.toml'"):
        robots.resolve("bad.toml", context)
    (folder / "lost.toml").write_text('robot = "gone.py:Three"\n[parameters]\n')
    with pytest.raises(InputError, match=r"no Python file 'gone\.py'"):
        robots.resolve("lost.toml", context)


def test_the_command_line_explains_it_as_a_robot(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(folder)
    assert "leg[0]" in of("out/parameters.toml", ["T"], ["q"])


def test_merged_modifiers_of_parts():
    assert merged({"leg": {"m": 1, "L": 2}}, {"leg": [{"L": 3}, {"L": 4}]}) == {
        "leg": [{"m": 1, "L": 3}, {"m": 1, "L": 4}]
    }
    assert merged({"leg": [{"m": 1}, {"m": 2}]}, {"leg": {"m": 5}, "A": 1}) == {"leg": [{"m": 5}, {"m": 5}], "A": 1}
    assert merged({"a": {"b": {"c": 1}}}, {"a": {"b": {"d": 2}}}) == {"a": {"b": {"c": 1, "d": 2}}}
