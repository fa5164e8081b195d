"""Kind "calibration_plan": the declared plan from room to robot program, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtmodel.kinds import calibration_plan, calibration_plan_turns
from gtmodel.kinds.calibration_plan_device import measuring
from gtmodel.kinds.calibration_plan_steps import Plan, find_candidates
from gtmodel.kinds.calibration_plan_turns import turns_of
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load, validate
from gtmodel.results import ArgumentError, SolveStatus
from gtmodel.robots import catalogue as robots
from tests.support.commands import CLONE, Commands

FILE = CLONE / "problems" / "plan_calibration_l1.toml"
# coarser than declared: seconds less
COARSE = ["room.step_m=0.2", "curve=[12, 24]", "simulation.runs=6", "poses.held_out=5", "poses.starts=1"]
SMALL = {
    "kind": "calibration_plan", "robot": "l1_tape", "curve": [], "simulation": {"runs": 0},
    "room": {"low_m": [0.8, -1.0, 0.4], "high_m": [2.0, 0.0, 1.4], "step_m": 0.2},
    "poses": {"held_out": 4, "starts": 1, "number": 12},
    "device": {"kind": "laser_tracker", "at_m": [1.0, -4.5, 0.8]},
}  # fmt: skip
SAME_POINT = 1e-4  # mm, the files' last decimal


MECHANISMS: dict[str, object] = {}


@pytest.fixture(autouse=True)
def one_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same robot is compiled once for all tests here: most of a small plan's time."""
    made = calibration_plan_turns.limited_mechanism

    def once(model, home, bodies):
        key = repr((model, home, bodies.plate_joints))
        if key not in MECHANISMS:
            MECHANISMS[key] = made(model, home, bodies)
        return MECHANISMS[key]

    monkeypatch.setattr(calibration_plan_turns, "limited_mechanism", once)


def solve(context: Context | None = None, **changes: object):
    return calibration_plan.solve(validate(calibration_plan.Schema, {**SMALL, **changes}), context or Context())


def numbers(text: str) -> np.ndarray:
    return np.array([float(x) for x in re.findall(r"-?\d+\.\d+", text)])


def test_the_declared_plan_goes_from_the_room_to_the_robot_program(capsys, tmp_path: Path):
    sets = [part for s in COARSE for part in ("--set", s)]
    done = Commands(capsys)("solve", FILE, *sets, "--json", "--out", tmp_path / "out")
    assert done.code == 0 and done.json["status"] == "solved"
    v = done.json["values"]
    assert list(v) == list(calibration_plan.VALUES)
    assert v["approved"] and v["verdict"].startswith("approved: 20 poses and 5 held out")
    assert list(v["stages"]) == ["workspace", "obstacles", "safety", "device", "safety distance"]
    counts = list(v["stages"].values())
    assert counts == sorted(counts, reverse=True) and counts[0] > counts[1] > counts[2]
    assert v["workspace_left"] == pytest.approx(counts[-1] / counts[0])
    assert v["parameters"] == v["told"] == 21 and len(v["parameter_std"]) == 21
    assert v["condition"] == pytest.approx(1 / v["o2"]) and v["o4"] == pytest.approx(v["o2"] * v["o3"])
    assert v["simulated_error_m"] == pytest.approx(v["predicted_error_m"], rel=0.3)  # six runs
    assert v["predicted_greatest_m"] > v["predicted_error_m"]
    few, many = v["curve"]
    assert few["predicted_error_m"] > v["predicted_error_m"] > many["predicted_error_m"]
    assert v["enough_poses"] <= 20
    assert all(check["passed"] for check in done.json["checks"].values())
    rows = (tmp_path / "out" / "poses.csv").read_text().splitlines()
    table = [line.split(",") for line in rows if not line.startswith("#")]
    assert table[0] == ["pose", "purpose", *(f"{n}[{k}] [mm]" for n in "qT" for k in range(3))]
    purposes = [line[1] for line in table[1:]]
    assert purposes.count("calibrate") == 20 and purposes.count("verify") == 5
    assert purposes != sorted(purposes)  # in random order
    program = (tmp_path / "out" / "poses.mod").read_text()
    targets = [numbers(line) for line in program.splitlines() if line.startswith("    [[")]
    values = np.array([line[2:] for line in table[1:]], float)
    np.testing.assert_allclose(targets, np.hstack([values[:, 3:], values[:, :3]]), atol=SAME_POINT)
    A, L = np.array([[0.04, 0, 1.44], [0.25, -1.31, 1.46], [0, 0, 0]]), [2.05, 1.82, 1.81]
    d = values[:, None, 3:] / 1e3 - A - values[:, :3, None] / 1e3 * np.array([1.0, 0, 0])
    np.testing.assert_allclose(np.linalg.norm(d, axis=2), np.tile(L, (25, 1)), atol=1e-6)
    assert "MoveJ GtPoses{i}, v200, fine" in program and "tested against no controller" in program


def test_every_step_has_its_picture():
    done = solve(
        curve=[10, 16], simulation={"runs": 2}, obstacles=[{"low_m": [0.8, -1.0, 0.4], "high_m": [1.0, -0.8, 0.6]}]
    )
    assert list(done.figures) == [
        "1_workspace", "2_obstacles_and_safety", "3_device", "4_poses", "5_number_of_poses", "6_parameters",
        "7_predicted_error",
    ]  # fmt: skip
    shown = {name: draw() for name, draw in done.figures.items()}
    legend = shown["4_poses"].axes[0].get_legend_handles_labels()[1]
    assert any(t.startswith("calibrate: 12") for t in legend) and "held out: 4" in legend
    assert "synthetic" in shown["7_predicted_error"].axes[-1].get_ylabel()


def test_poses_are_added_until_the_accuracy_is_reached():
    first = solve(criteria={"accuracy_mm": 1.0})
    again = solve(criteria={"accuracy_mm": 1.0})
    assert again.values == first.values and again.files == first.files
    wanted = 0.8e3 * first.values["predicted_error_m"]
    done = solve(criteria={"accuracy_mm": wanted}, poses={**SMALL["poses"], "more": 6, "most": 30})
    assert done.values["rounds"] == [12, 18, 24][: len(done.values["rounds"])] and done.values["poses"] > 12
    assert done.values["approved"] and 1e3 * done.values["predicted_error_m"] <= wanted
    never = solve(criteria={"accuracy_mm": 1e-3}, poses={**SMALL["poses"], "most": 14})
    assert not never.values["approved"] and not never.checks["predicted_error_m"].passed
    assert never.status is SolveStatus.CHECK_FAILED and "predicted_error_m" in never.message
    assert "not approved with 14 poses: predicted_error_m; take more poses" in never.message


def test_a_wire_alone_is_not_approved_and_with_known_guideways_it_is():
    wire = {"kind": "distance", "at_m": [3.0, -3.0, 1.0]}
    done = solve(device=wire, poses={**SMALL["poses"], "number": 30})
    assert done.status is SolveStatus.CHECK_FAILED and not done.values["approved"]
    assert (done.values["told"], done.values["parameters"]) == (18, 21)
    assert "moves with what no pose tells" in done.message and done.values["predicted_error_m"] is None
    assert None in done.values["parameter_std"].values()
    held = solve(device=wire, fixed=["A"], poses={**SMALL["poses"], "number": 30}, simulation={"runs": 2},
                 criteria={"accuracy_mm": 1.0})  # fmt: skip
    assert held.values["approved"] and held.values["told"] == held.values["parameters"] == 12


@pytest.mark.parametrize("method", ["D", "condition", "grid"])
def test_methods_of_selection(method):
    done = solve(poses={**SMALL["poses"], "number": 40, "method": method}, criteria={"accuracy_mm": 1.0})
    assert done.values["approved"]
    assert done.values["poses"] == 40 if method != "grid" else 20 < done.values["poses"] < 80


@pytest.mark.parametrize(
    ("device", "more", "worse"),
    [
        ({"kind": "camera", "at_m": [1.4, -5.0, 0.8], "looks_at_m": [1.4, -0.5, 0.8]}, {}, 10.0),
        ({"kind": "plane", "normal": [0.0, 0.0, 1.0]}, {"free": ["L"]}, 0.1),
    ],
)
def test_other_devices(device, more, worse):
    tracked = solve(criteria={"accuracy_mm": 5.0}, **more).values["predicted_error_m"]
    done = solve(device=device, criteria={"accuracy_mm": 5.0}, simulation={"runs": 2}, **more)
    assert done.values["approved"] and done.values["predicted_error_m"] > worse * tracked
    assert done.values["told"] == (3 if more else 21)


F1 = {
    **SMALL, "robot": "f1",
    "room": {"low_m": [-0.4, 2.1, -0.2], "high_m": [0.0, 2.5, 0.2], "step_m": 0.2,
             "turns_deg": [[0, 0, 0], [20, 0, 0], [0, 20, 0], [0, 0, 20], [-15, -15, 0]]},
    "limits": {"actuators_m": [[-0.5, 2.0]] * 3, "axes_deg": [[-70, 70]] * 3},
    "device": {"kind": "laser_tracker", "at_m": [-0.2, -2.5, 0.3], "orientation_noise_urad": 90.0},
    "poses": {"held_out": 4, "starts": 1, "number": 40}, "criteria": {"accuracy_mm": 1.0},
}  # fmt: skip


@pytest.fixture
def one_f1(monkeypatch: pytest.MonkeyPatch) -> None:
    MECHANISMS.setdefault("f1", robots.f1_gantry_tau())
    monkeypatch.setattr(calibration_plan.Schema, "model", lambda *_: MECHANISMS["f1"])


def f1(**changes: object):
    return calibration_plan.solve(validate(calibration_plan.Schema, {**F1, **changes}), Context())


def test_an_f1_is_planned_with_turns_of_its_plate(one_f1: None):
    """72 raw parameters, nine of them a choice of coordinates (Table 5.4: six, and three lengths of quaternions)."""
    done = f1(simulation={"runs": 2})
    v = done.values
    assert v["approved"] and (v["told"], v["parameters"]) == (63, 72)
    assert v["simulated_error_m"] == pytest.approx(v["predicted_error_m"], rel=0.4)  # two runs
    rows = [line.split(",") for line in str(done.files["poses.csv"]).splitlines() if not line.startswith("#")]
    heads = [*(f"q[{k}] [mm]" for k in range(3)), *(f"q[{k}] [deg]" for k in range(3, 6))]
    assert rows[0] == ["pose", "purpose", *heads, *(f"T[{k}] [mm]" for k in range(3)), *(f"e[{k}]" for k in range(4))]
    table = np.array([row[2:] for row in rows[1:]], float)
    assert len(table) == 44 and len(np.unique(np.round(table[:, 9:], 6), axis=0)) == 5
    # the poses are those of the robot's forward kinematics, to the digits of the file
    q = np.hstack([table[:, :3] / 1e3, np.radians(table[:, 3:6])])
    T, e, status = robots.f1_gantry_tau().causal(known="q", targets=["T", "e"])(q)
    assert np.all(status == 0)
    np.testing.assert_allclose(1e3 * T, table[:, 6:9], atol=2e-3)  # 1e-4 deg and 1e-4 mm at some metres
    np.testing.assert_allclose(np.abs(np.sum(e * table[:, 9:], axis=1)), 1.0, atol=1e-9)
    assert "d, e, f the rotary axes in degrees" in str(done.files["poses.mod"])
    assert list(done.figures)[-1] == "7_predicted_error" and done.figures["6_parameters"]() is not None


def test_what_a_target_on_the_plate_shows_and_what_turned_poses_must_keep(one_f1: None):
    robot = robots.f1_gantry_tau()
    plate = Rotation.from_quat(np.array(robot.home_e), scalar_first=True)
    towards = plate.inv().apply([0.0, -1.0, 0.0]).tolist()
    seen = left(device={**F1["device"], "target_axis": towards, "acceptance_deg": 12.0})
    assert 0 < seen["device"] < seen["safety"]  # poses turned by 20 deg about other axes do not face the tracker
    assert 0 < left(limits={"axes_deg": [[-10, 10]] * 3})["workspace"] < seen["workspace"]
    assert left(limits={"axes_deg": [[-10, 10]] * 3}, safety={"axes_deg": 9.9})["safety"] == 0


def left(**changes: object) -> dict[str, int]:
    problem = validate(calibration_plan.Schema, {**F1, **changes})
    turns = turns_of(problem, problem.model(Context()))
    plan = Plan(problem, turns, measuring(problem, turns[0].robot.model))
    try:
        find_candidates(plan, lambda *_: False)
    except InputError as error:
        assert "passes the stage" in str(error)
    assert plan.found is not None
    return plan.found.counts


def test_a_stop_keeps_what_is_done():
    done = solve(Context(max_seconds=0.0))
    assert done.status is SolveStatus.INTERRUPTED and list(done.values["stages"]) == ["workspace"]
    assert list(done.figures) == ["1_workspace"]


@pytest.mark.parametrize(
    ("changes", "key", "sentence"),
    [
        ({"room": {"low_m": [9, 9, 9], "high_m": [10, 10, 10]}}, "room", "passes the stage 'workspace'"),
        ({"room": {"low_m": [0, 0, 0], "high_m": [2, 0, 2]}}, "room.high_m", "must be less"),
        ({"room": {"low_m": [0, 0, 0], "high_m": [2, 2, 2], "step_m": 0.001}}, "room.step_m", "points; take at least"),
        ({"device": {"kind": "laser_tracker", "at_m": [1, -4, 1], "farthest_m": 1.0}}, "room", "stage 'device'"),
        ({"device": {"kind": "camera", "at_m": [1, 1, 5], "looks_at_m": [1, 1, 0]}}, "device", "along its own 'up'"),
        ({"device": {"kind": "plane", "normal": [0, 0, 0]}}, "device", "normal of the plane is zero"),
        ({"poses": {"number": 12, "held_out": 5000}}, "poses.held_out", "5000 poses are to be held out"),
        ({"poses": {"number": 5}}, "poses.number", "take at least 7"),
        ({"poses": {"number": 5000, "held_out": 0}}, "poses.number", "5000 poses are asked for"),
        ({"safety": {"cone_deg": 40.0}, "limits": {"cone_deg": 40.0}}, "safety.cone_deg", "nothing is left"),
        ({"evaluation": {"low_m": [0, 0, 0], "high_m": [9, 9, 9]}}, "evaluation", "cannot reach"),
        ({"room": {**SMALL["room"], "turns_deg": [[5, 0, 0]]}}, "room.turns_deg", "is for an F1"),
        ({"limits": {"axes_deg": [[-9, 9]]}}, "limits.axes_deg", "has 0 rotary axes; found 1"),
        ({"robot": "f1", "limits": {"axes_deg": [[-9, 9]]}}, "limits.axes_deg", "has 3 rotary axes; found 1"),
        ({"robot": "f1", "home_m": [9, 9, 9]}, "room.turns_deg", "cannot be reached with the plate at"),
        ({"poses": {"number": 2, "method": "grid", "held_out": 0}}, "poses.number", "what no pose tells"),
        ({"free": ["B"]}, "", "hold no parameter 'B'"),
        ({"free": ["L"], "fixed": ["L"]}, "", "nothing is left free"),
    ],
)
def test_wrong_input_gets_a_sentence(changes, key, sentence):
    with pytest.raises((InputError, ArgumentError), match=sentence) as found:
        solve(**changes)
    assert key in (getattr(found.value, "key", key), getattr(found.value, "argument", ""))


def test_a_wrong_device_and_a_start_are_refused(tmp_path: Path):
    (tmp_path / "p.toml").write_text(FILE.read_text().replace('"laser_tracker"', '"sextant"'))
    with pytest.raises(InputError, match="device"):
        load(tmp_path / "p.toml")
    with pytest.raises(InputError, match="--start"):
        solve(Context(start={}))


def test_the_plan_explains_its_steps():
    text = calibration_plan.explain(validate(calibration_plan.Schema, SMALL), Context())
    for step in ("workspace:", "safety:", "device: range of the laser tracker", "12 to 60 poses by I, and 4 held out"):
        assert step in text
