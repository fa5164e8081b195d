"""Kind "identification": from a file to numbers, intervals, checks and pictures; and what is refused, with its key."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.kinds import identification
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load, validate
from gtmodel.results import SolveStatus
from tests.identify.plants import NOISE, SAMPLE_TIME, simulator

SHORT: dict[str, Any] = {
    "kind": "identification",
    "robot": "l1_tape",
    "variant": "links",
    "synthetic": {"duration_s": 12.0, "parameters": {"m_a": [0.5, 1.0, 1.5]}},
}


def solve(context: Context | None = None, **changes: object):
    data = {**SHORT, **changes}
    problem = validate(identification.Schema, {k: v for k, v in data.items() if v is not None})
    return identification.solve(problem, context or Context())


def test_the_shipped_problem():
    loaded = load("problems/inertia_l1.toml", ["synthetic.duration_s=16"])
    outcome = identification.solve(loaded.problem, Context())
    assert outcome.status is SolveStatus.SOLVED
    assert all(check.passed for check in outcome.checks.values()), outcome.checks
    assert list(outcome.values) == list(identification.VALUES)
    values = outcome.values
    assert len(values["parameters"]) == 13 and values["synthetic"].startswith("seed 2012, effort noise 30")
    for name, truth in values["truth"].items():
        low, high = values["intervals"].get(name, (-np.inf, np.inf))
        assert low - (high - low) < truth < high + (high - low)
    table = tomllib.loads(str(outcome.files["parameters.toml"]))
    assert table["m_p"]["unit"] == "kg" and table["synthetic"] == values["synthetic"]
    assert outcome.trajectory is not None and outcome.trajectory.synthetic == values["synthetic"]
    drawn = {name: draw() for name, draw in outcome.figures.items()}
    assert sorted(drawn) == ["efforts", "friction", "held_out"]
    assert all(len(figure.axes) == 3 for figure in drawn.values())


def test_left_out_links_are_reported():
    outcome = solve(variant="model_2", watch=["m_a"], synthetic={**SHORT["synthetic"], "duration_s": 30.0})
    assert not outcome.checks["nothing_left_out"].passed
    assert "error_in_standard_deviations" not in outcome.checks  # the truth of another model
    assert any("would explain" in s for s in outcome.values["sentences"])
    assert 9.13 + 0.75 < outcome.values["parameters"]["m_p"] < 9.13 + 1.5


def test_repeated_runs():
    outcome = solve(synthetic={**SHORT["synthetic"], "runs": 3, "processes": 0, "duration_s": 8.0})
    assert outcome.values["coverage"]["runs"] == 3 and outcome.values["coverage"]["band"][1] == 3
    assert any(row.label == "pooled coverage" for row in outcome.rows)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A CSV in millimetres and kilonewtons, as a stranger's logger might write it; forces 8 N off on every cart."""
    t = simulator(16.0).truth
    tau = t["tau"] + 8.0 + NOISE * np.random.default_rng(6).normal(size=t["tau"].shape)
    folder = tmp_path_factory.mktemp("logs")
    table = np.column_stack([t.time, 1e3 * np.round(t["q"], 6), 1e-3 * tau])
    header = "t [s],x1 [mm],x2 [mm],x3 [mm],F[0],F[1],F[2]"
    lines = ["# synthetic: seed 6, 30 N white", header, *(",".join(f"{v:.9g}" for v in row) for row in table)]
    (folder / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def measured(log: Path, **changes: object):
    keys = {
        "files": ["log.csv"],
        "held_out": ["log.csv"],
        "time": {"column": "t"},
        "position": {"column": ["x1", "x2", "x3"], "unit": "mm"},
        "effort": {"column": "F", "unit": "kN", "offset": "estimate", "per_session": []},
        "sample_time_s": SAMPLE_TIME,
    }
    return solve(Context(folder=log), synthetic=None, log={**keys, **changes})


def test_a_log_with_units_and_an_offset_of_its_own(log: Path):
    outcome = measured(log)
    assert outcome.status is SolveStatus.SOLVED and outcome.values["truth"] is None
    assert outcome.values["synthetic"] == "seed 6, 30 N white"  # carried over from the file
    offsets = outcome.values["corrections"]
    assert sorted(offsets) == [f"tau.offset[{i}]" for i in range(3)]
    for name, value in offsets.items():
        low, high = outcome.values["intervals"][name]
        assert abs(value - 8.0) < high - low < 40.0  # four standard deviations; parameters like the others
    assert outcome.values["parameters"]["m_p"] == pytest.approx(9.13, abs=0.6)
    assert outcome.values["held_out_rms"] == pytest.approx(outcome.values["noise"], rel=0.1)  # the same log


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"files": ["no.csv"]}, r"log.files\[0\]: there is no file 'no.csv'"),
        ({"files": []}, "log.files: is empty"),
        ({"position": {"column": "x4", "unit": "mm"}}, "log: .*no column 'x4'"),
        ({"position": {"column": "x1", "unit": "mm"}}, "log.position.column: has 1 columns; 'q' of the robot has 3"),
        ({"position": {"column": ["x1", "x2", "x3"], "unit": "m"}}, "the file says mm and the declaration m"),
        ({"effort": {"column": "F", "unit": "V"}}, "log.effort: .*give the scale"),
        (
            {"effort": {"column": "F", "unit": "kN", "scale": "estimate"}},
            "log: the scale of the efforts cannot be told",
        ),
        ({"sample_time_s": 0.002}, "log: .*expected 2 ms"),
    ],
)
def test_wrong_logs(log: Path, changes: dict[str, object], sentence: str):
    with pytest.raises(InputError, match=sentence):
        measured(log, **changes)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"synthetic": None}, r"log: expected one of \[log\] and \[synthetic\]; found none of them"),
        ({"variant": "model_5"}, "variant: there is no variant 'model_5'"),
        ({"variant": None}, "free: is missing"),
        ({"variant": None, "free": ["m_q"]}, "free: .*no parameter 'm_q'"),
        ({"variant": None, "free": ["L"]}, "free: .*not linear in parameter"),
        ({"watch": ["m_p"]}, "watch: .*named twice"),
        ({"robot": "d1_six_link"}, "variant: applies to three-link robots"),
        ({"inertia": "model_1"}, "inertia: a variant says"),
        ({"known": "p"}, "known: .*no variable 'p'"),
        ({"nonnegative": ["m_q"]}, "nonnegative: 'm_q' is no parameter"),
        ({"synthetic": {"half_range": 3.0}}, "synthetic.half_range: the motion leaves the reach"),
        ({"synthetic": {"duration_s": 3.0, "sample_time_s": 0.002}}, "synthetic: the tracking was identified at"),
    ],
)
def test_wrong_problems(changes: dict[str, object], sentence: str):
    with pytest.raises(InputError, match=sentence):
        solve(**changes)


DRIVE: dict[str, Any] = dict(
    robot="drive.py:Drive", variant=None, free=["m", "coulomb", "viscous"], known="x", targets="F"
)
WAY: dict[str, Any] = {"reference": "x", "centre": [0.0], "half_range": 0.1, "tracking": "exact", "duration_s": 12.0}
MODEL = """
import gtmodel as gt
from gtmodel import der
from gtmodel.mechanics import SignFriction, Mass, ForceMotor


class Drive(gt.Model):
    m = gt.parameter(100.0, unit="kg", positive=True)
    coulomb = gt.parameter(20.0, unit="N")
    viscous = gt.parameter(200.0, unit="kg/s")
    x = gt.variable(unit="m")
    F = gt.variable(unit="N", nominal=100.0)
    carriage = gt.part(Mass, m=m)
    motor = gt.part(ForceMotor)
    friction = gt.part(SignFriction, coulomb=coulomb, viscous=viscous)

    def equations(self):
        yield gt.connect(self.carriage.flange, self.motor.flange)
        yield gt.connect(self.carriage.flange, self.friction.flange)
        yield self.x == self.motor.flange.s
        yield self.F == self.motor.force
"""


def test_any_model_in_python(tmp_path: Path):
    (tmp_path / "drive.py").write_text(MODEL, encoding="utf-8")
    way = {**WAY, "effort_noise": 5.0, "parameters": {"m": 95.0}}
    outcome = solve(Context(folder=tmp_path), **DRIVE, synthetic=way)
    assert outcome.values["parameters"]["m"] == pytest.approx(95.0, abs=1.0)
    assert all(check.passed for check in outcome.checks.values())


@pytest.mark.parametrize(
    ("way", "cutoff", "sentence"),
    [
        ({"duration_s": 1.0}, None, "synthetic.ramp_s: a motion of .* cannot grow and fade"),
        ({"effort_noise": [1.0, 2.0]}, None, "synthetic.effort_noise: has 2 numbers; expected one, or 1"),
        ({"centre": [0.0, 1.0]}, None, "synthetic.centre: expected 1 numbers"),
        ({"half_range": [1.0, 1.0]}, None, "synthetic.half_range: has 2 numbers; expected one, or 1"),
        ({"tracking": "dressler_2012"}, None, "synthetic.tracking: is for three carts"),
        ({"reference": "y"}, None, "synthetic.reference: .*no variable 'y'"),
        ({}, 200.0, "synthetic: the cut-off is 200 Hz"),
        ({"duration_s": 2.5}, 0.5, "synthetic: .*lasts 2.496 s; expected more than"),
    ],
)
def test_wrong_motions(tmp_path: Path, way: dict[str, object], cutoff: float | None, sentence: str):
    (tmp_path / "drive.py").write_text(MODEL, encoding="utf-8")
    low_pass = {} if cutoff is None else {"cutoff_Hz": cutoff}
    with pytest.raises(InputError, match=sentence):
        solve(Context(folder=tmp_path), **DRIVE, synthetic={**WAY, **way}, filter=low_pass)


def test_explain():
    problem = validate(identification.Schema, SHORT)
    text = identification.explain(problem, Context())
    assert "m_a[2] [kg], free" in text and "from q, der(q), der(q,2)" in text


def test_the_robot_of_a_variant_is_the_catalogues():
    variant = gt.robots.inertia_variant("links")
    assert np.array_equal(np.asarray(variant.robot.A), np.asarray(gt.robots.gantry_tau("l1_tape").A))
