"""Kind "friction": synthetic and measured logs, Table 6.1's mass, and what is refused, with its key."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtmodel.kinds import friction
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load, validate
from gtmodel.results import SolveStatus

PATTERN = [-176.9, -14.6, 191.5]
TRUTH = {
    "coulomb_plus_N": [189.12, 262.59, 239.06],
    "coulomb_minus_N": [145.69, 119.23, 177.22],
    "viscous_plus_kg_s": [205.03, 190.0, 185.94],
    "viscous_minus_kg_s": [158.01, 133.76, 197.52],
    "mass_kg": 22.38,
}
COLUMNS = {"position_m": {"column": "q", "unit": "m"}, "force_N": {"column": "f", "unit": "N"}}
SHORT: dict[str, Any] = {
    "kind": "friction",
    "robot": "l1_tape",
    "pose": [{"name": "star", "holding_N": PATTERN, "holding_mass_kg": 22.38}],
    "synthetic": {**TRUTH, "velocities_m_s": [0.2, 0.5, 1.0], "seed": 5},
}


def problem(**changes: Any) -> friction.Schema:
    data = {**SHORT, **changes}
    return validate(friction.Schema, {k: v for k, v in data.items() if v is not None})


@pytest.fixture(scope="module")
def shipped():
    return friction.solve(load("problems/friction_l1.toml").problem, Context())  # type: ignore[arg-type]


def test_slopes_of_the_synthetic_logs_are_within_one_percent(shipped) -> None:
    v = shipped.values
    assert shipped.status is SolveStatus.SOLVED and list(v) == list(friction.VALUES)
    for key in ("viscous_plus_kg_s", "viscous_minus_kg_s"):
        assert np.allclose(v[key], TRUTH[key], rtol=0.01), key
    assert shipped.checks["slope_error"].passed and v["runs"] == 150
    # levels are left open by the choice of the mass, their sum is not
    for key in ("plus", "minus"):
        half = np.array(TRUTH["coulomb_plus_N"]) + TRUTH["coulomb_minus_N"]
        assert np.allclose(v["coulomb_plus_N"] + v["coulomb_minus_N"], half, atol=2.0), key


def test_what_is_synthetic_says_so(shipped) -> None:
    assert shipped.values["synthetic"].startswith("seed 61, white force noise 5 N")
    assert shipped.files["parameters.toml"].startswith("# synthetic: seed 61")
    assert "synthetic: seed 61" in shipped.figures["friction"]()._suptitle.get_text()
    kept = tomllib.loads(shipped.files["parameters.toml"])
    assert kept["viscous_plus_kg_s"] == list(shipped.values["viscous_plus_kg_s"])


def test_poses_tell_the_mass_where_friction_does_not_change() -> None:
    loaded = load("problems/friction_l1.toml", ["gravity=poses"]).problem
    values = friction.solve(loaded, Context()).values  # type: ignore[arg-type]
    low, high = values["mass_interval_kg"]
    assert low < 22.38 < high and high - low < 0.1
    assert np.allclose(values["coulomb_plus_N"], TRUTH["coulomb_plus_N"], atol=1.0)
    assert np.allclose(values["coulomb_minus_N"], TRUTH["coulomb_minus_N"], atol=1.0)


def test_table_6_1_by_three_norms() -> None:
    outcome = friction.solve(load("problems/table_6_1.toml").problem, Context())  # type: ignore[arg-type]
    norms = outcome.values["mass_by_norm_kg"]
    assert norms["two"] == pytest.approx(22.7, abs=0.05)  # the thesis: 22.38 by eye
    assert norms["one"] == pytest.approx([19.63, 25.99], abs=0.01)
    assert norms["maximum"] < 18.0
    # fc+ - fc- by cart is the same combination of forces whatever the mass
    after = np.array(outcome.values["coulomb_plus_N"]) + outcome.values["coulomb_minus_N"]
    assert np.allclose(after, np.array(TRUTH["coulomb_plus_N"]) + TRUTH["coulomb_minus_N"], atol=1e-9)
    assert "actuator 3" in [axes.get_title() for axes in outcome.figures["friction"]().axes]


def test_measured_logs_with_a_drive_gain(tmp_path: Path) -> None:
    made = friction._sessions(problem(), Context(), np.array([PATTERN]) / 22.38)[0][1].trajectory
    header = "t," + ",".join([f"pos{i}" for i in (1, 2, 3)] + [f"amp{i}" for i in (1, 2, 3)])
    rows = np.column_stack([1e3 * made.time, 1e3 * made["q"], made["force"] / 40.0])
    text = "\n".join([header, *(",".join(f"{x:.9g}" for x in row) for row in rows)])
    (tmp_path / "star.csv").write_text(text + "\n", encoding="utf-8")
    log = {
        "time": {"column": "t", "unit": "ms"},
        "position_m": {"column": ["pos1", "pos2", "pos3"], "unit": "mm"},
        "force_N": {"column": ["amp1", "amp2", "amp3"], "unit": "A", "scale": 40.0},
    }
    measured = problem(synthetic=None, log=log, pose=[{**SHORT["pose"][0], "files": ["star.csv"]}])
    context = Context(folder=tmp_path)
    found, direct = friction.solve(measured, context).values, friction.solve(problem(), Context()).values
    assert found["viscous_plus_kg_s"] == pytest.approx(direct["viscous_plus_kg_s"], rel=1e-5)
    assert found["mass_kg"] == pytest.approx(direct["mass_kg"], rel=1e-5)
    assert found["synthetic"] is None and context.inputs["pose[0].files[0]"].name == "star.csv"
    for change, key, said in (
        ({"force_N": {**log["force_N"], "offset": "estimate"}}, "log.force_N.offset", "do not tell it apart"),
        ({"force_N": {**log["force_N"], "scale": 1.0}}, "log.force_N", "is in A and the quantity in N; give the scale"),
        ({"force_N": {**log["force_N"], "column": "amp"}}, "pose[0]", "there is no column 'amp'; did you mean 'amp3'"),
        ({"force_N": {**log["force_N"], "column": "amp1"}}, "log.force_N.column", "has 1 columns; the robot has 3"),
        ({"steady_acceleration_m_s2": 1e-9}, "pose[0]", "'star.csv' holds no steady motion of 0.2 s"),
        ({"sample_time_s": 0.002}, "pose[0]", "the samples are 4 ms apart; expected 2 ms"),
    ):
        wrong = problem(synthetic=None, log={**log, **change}, pose=[{**SHORT["pose"][0], "files": ["star.csv"]}])
        with pytest.raises(InputError, match=said.replace("[", r"\[")) as caught:
            friction.solve(wrong, Context(folder=tmp_path))
        assert caught.value.key == key


@pytest.mark.parametrize(
    ("changes", "key", "said"),
    [
        ({"synthetic": None}, "log", "found none of them; expected one of"),
        ({"printed": TRUTH}, "printed", "expected one of"),
        ({"pose": [{}]}, "pose[0]", "expected either tcp_m or holding_N"),
        ({"pose": [{"holding_N": PATTERN}]}, "pose[0].holding_mass_kg", "is missing"),
        ({"pose": [{"tcp_m": [0.5, -0.9]}]}, "pose[0].tcp_m", "expected a list of 3 numbers"),
        ({"pose": [{"tcp_m": [0.5, -9.0, 0.3]}]}, "pose[0].tcp_m", "cannot be reached"),
        ({"pose": [*SHORT["pose"], {"holding_N": [1.0], "holding_mass_kg": 1.0}]}, "pose", "have 3, 1 carts"),
        ({"gravity": "poses"}, "pose", "loads the actuators alike in all poses"),
        ({"synthetic": {**SHORT["synthetic"], "coulomb_plus_N": [1.0]}}, "synthetic.coulomb_plus_N", "has 1 numbers"),
        ({"synthetic": {**SHORT["synthetic"], "velocities_m_s": [0.5, 0.5]}}, "pose", "1 velocities in direction plus"),
        ({"synthetic": None, "printed": TRUTH, "pose": SHORT["pose"] * 2}, "pose", "belong to one pose"),
        ({"synthetic": None, "log": COLUMNS}, "pose[0].files", "is empty; name a CSV or .mat file"),
    ],
)  # fmt: skip
def test_refusals_name_the_key(changes: dict[str, Any], key: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        friction.solve(problem(**changes), Context())
    assert caught.value.key == key and "\n" not in str(caught.value)


def test_the_explanation_shows_the_pattern() -> None:
    text = friction.explain(problem(), Context())
    assert "star: forces that hold one kilogram -7.904, -0.6524, 8.557 N/kg" in text


def test_results_are_json(shipped) -> None:
    from gtmodel.results import as_json

    assert json.loads(as_json.result("friction_l1.toml", "friction", shipped))["values"]["runs"] == 150


def test_a_plant_without_viscous_friction_has_no_relative_error_of_it() -> None:
    nothing = [f"synthetic.{way}=[0,0,0]" for way in ("viscous_plus_kg_s", "viscous_minus_kg_s")]
    outcome = friction.solve(load("problems/friction_l1.toml", nothing).problem, Context())  # type: ignore[arg-type]
    assert set(outcome.checks) == {"least_friction_N"}
    assert all(abs(v) < 1.0 for v in outcome.values["viscous_plus_kg_s"])


def test_a_robot_that_its_tool_point_does_not_place() -> None:
    with pytest.raises(InputError, match="robot: a tool centre point alone does not place it"):
        friction.solve(load("problems/friction_l1.toml", ["robot=f1"]).problem, Context())  # type: ignore[arg-type]


def test_each_slope_is_held_against_its_own_noise_and_advice_asks_for_what_is_not_done_yet() -> None:
    flat = {**TRUTH, "viscous_minus_kg_s": [158.01, 1e-3, 197.52]}
    outcome = friction.solve(problem(synthetic={**flat, "velocities_m_s": [0.2, 0.5, 1.0], "seed": 5}), Context())
    # the largest relative error is that of the flat line, and all of it is noise
    assert outcome.checks["slope_error"].passed
    assert outcome.checks["slope_error"].value < outcome.checks["slope_error"].bound
    choice = outcome.checks["least_friction_N"].advice
    symmetric = friction.solve(problem(directions="symmetric"), Context()).checks["least_friction_N"].advice
    assert "poses" in choice and symmetric != choice and "gravity =" not in symmetric
