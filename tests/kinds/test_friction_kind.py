"""Kind "friction": the shipped problems, logs by their keys, and where refusals stand in the file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtmodel.identify import constant_velocity_log
from gtmodel.kinds import friction
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import Loaded, load, validate
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import SolveStatus, as_json

EMPS = str(Path("problems/models/emps.py").resolve()) + ":Emps"  # one axis
PATTERN = [-176.9, -14.6, 191.5]
TRUTH = {
    "coulomb_plus_N": [189.12, 262.59, 239.06],
    "coulomb_minus_N": [145.69, 119.23, 177.22],
    "viscous_plus_kg_s": [205.03, 190.0, 185.94],
    "viscous_minus_kg_s": [158.01, 133.76, 197.52],
    "mass_kg": 22.38,
}
STAR = {"name": "star", "holding_N": PATTERN, "holding_mass_kg": 22.38}
MADE = {**TRUTH, "velocities_m_s": [0.2, 0.5, 1.0], "seed": 5}
COLUMNS = {"position_m": {"column": "q", "unit": "m"}, "force_N": {"column": "f", "unit": "N"}}


def loaded(**changes: Any) -> Loaded:
    data = {"kind": "friction", "robot": "l1_tape", "pose": [STAR], "synthetic": MADE, **changes}
    problem = validate(friction.Schema, {k: v for k, v in data.items() if v is not None})
    return Loaded(Path("friction.toml"), b"", (), friction, problem, False)  # type: ignore[arg-type]


def solved(context: Context | None = None, **changes: Any) -> Any:
    return answer(loaded(**changes), context or Context())


def test_shipped_problems_are_solved() -> None:
    found = answer(load("problems/friction_l1.toml"), Context())
    assert found.status is SolveStatus.SOLVED and found.rows
    assert json.loads(as_json.result("friction_l1.toml", "friction", found))["values"]["runs"] == 150
    of_table = answer(load("problems/table_6_1.toml"), Context())
    assert of_table.status is SolveStatus.SOLVED and list(of_table.values) == list(found.values) and of_table.rows


def test_measured_logs_with_a_drive_gain(tmp_path: Path) -> None:
    plus, minus, forth, back = (np.array(TRUTH[k]) for k in list(TRUTH)[:4])

    def law(v: np.ndarray) -> np.ndarray:
        return PATTERN + np.where(v > 0, plus + forth * v, np.where(v < 0, -minus + back * v, 0.0))

    log = constant_velocity_log(MADE["velocities_m_s"], law, np.full(3, 30.0), seed=5, noise=5.0).trajectory
    header = "t," + ",".join([f"pos{i}" for i in (1, 2, 3)] + [f"amp{i}" for i in (1, 2, 3)])
    rows = np.column_stack([1e3 * log.time, 1e3 * log["q"], log["force"] / 40.0])
    text = "\n".join([header, *(",".join(f"{x:.9g}" for x in row) for row in rows)])
    (tmp_path / "star.csv").write_text(text + "\n", encoding="utf-8")
    keys = {
        "time": {"column": "t", "unit": "ms"},
        "position_m": {"column": ["pos1", "pos2", "pos3"], "unit": "mm"},
        "force_N": {"column": ["amp1", "amp2", "amp3"], "unit": "A", "scale": 40.0},
    }
    given: dict[str, Any] = {"synthetic": None, "pose": [{**STAR, "files": ["star.csv"]}]}
    context = Context(folder=tmp_path)
    found, direct = solved(context, log=keys, **given), solved()
    assert found.viscous_plus == pytest.approx(direct.viscous_plus, rel=1e-5)
    assert found.mass == pytest.approx(direct.mass, rel=1e-5)
    assert found.synthetic is None and context.inputs["pose[0].files[0]"].name == "star.csv"
    for change, key in (
        ({"force_N": {**keys["force_N"], "offset": "estimate"}}, "log.force_N.offset"),
        ({"force_N": {**keys["force_N"], "scale": 1.0}}, "log.force_N"),
        ({"force_N": {**keys["force_N"], "column": "amp"}}, "pose[0]"),
        ({"force_N": {**keys["force_N"], "column": "amp1"}}, "log.force_N.column"),
        ({"steady_acceleration_m_s2": 1e-9}, "pose[0]"),
        ({"sample_time_s": 0.002}, "pose[0]"),
    ):
        with pytest.raises(InputError) as caught:
            solved(Context(folder=tmp_path), log={**keys, **change}, **given)
        assert caught.value.key == key and caught.value.message
    # an alarm about the columns is refused with the key that accepts it
    reverse = {**keys, "force_N": {**keys["force_N"], "scale": -40.0}}
    with pytest.raises(InputError, match=r'accept = \["driving_friction"\]'):
        solved(Context(folder=tmp_path), log=reverse, **given)
    accepted = ["exchanged_columns", "driving_friction", "negative_mass"]
    assert any(n.startswith("accepted") for n in solved(context, log=reverse, accept=accepted, **given).notes)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"synthetic": None}, "log"),
        ({"printed": TRUTH}, "printed"),
        ({"pose": [{}]}, "pose[0]"),
        ({"pose": [{"holding_N": PATTERN}]}, "pose[0].holding_mass_kg"),
        ({"pose": [{"tcp_m": [0.5, -0.9]}]}, "pose[0].tcp_m"),
        ({"pose": [STAR, {"holding_N": [1.0], "holding_mass_kg": 1.0}]}, "pose"),
        ({"gravity": "poses"}, "pose"),
        ({"synthetic": {**MADE, "coulomb_plus_N": [1.0]}}, "synthetic.coulomb_plus_N"),
        ({"synthetic": {**MADE, "velocities_m_s": [0.5]}}, "synthetic.velocities_m_s"),
        ({"synthetic": {**MADE, "velocities_m_s": [0.5, 0.5]}}, "pose"),
        ({"synthetic": None, "printed": TRUTH, "pose": [STAR, STAR]}, "pose"),
        ({"synthetic": None, "printed": {**TRUTH, "viscous_plus_kg_s": [1.0]}}, "printed.viscous_plus_kg_s"),
        ({"synthetic": None, "log": COLUMNS}, "pose[0].files"),
        ({"robot": "f1", "pose": [{"tcp_m": [0.5, -0.9, 0.3]}]}, "robot"),
    ],
)
def test_refusals_name_the_key(changes: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError) as caught:
        solved(**changes)
    assert caught.value.key == key and "\n" not in str(caught.value)


def test_a_robot_without_a_plate_is_led_to_identification() -> None:
    for pose in ({}, {"tcp_m": [0.5, -0.9, 0.3]}, {"holding_N": [0.0] * 3, "holding_mass_kg": 22.4}):
        with pytest.raises(InputError, match=r'holding_N.*kind = "identification"'):
            solved(robot=EMPS, pose=[pose])


def test_the_explanation_shows_the_pattern() -> None:
    assert "star: cart forces that hold one kilogram -7.904, -0.6524, 8.557 N/kg" in explain(loaded(), Context())
