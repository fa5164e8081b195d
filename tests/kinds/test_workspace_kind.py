"""Kind "workspace": the L1's printed numbers from the file, reasons, limits, pictures; and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from gtmodel.compiler.sharing import shared
from gtmodel.kinds import workspace
from gtmodel.kinematics.mechanism import mechanism_of
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load, validate
from gtmodel.results import ArgumentError, SolveStatus, Status
from tests.kinematics.by_hand import L1, disc_intersection_area
from tests.support.commands import CLONE, Commands

# the step's square, on boundaries with corners
AREA = 2e-3
SMALL = {"kind": "workspace", "title": "Small", "robot": "l1_tape", "section": {"step_m": 0.1}}


def solve(context: Context | None = None, **changes: object):
    return workspace.solve(validate(workspace.Schema, {**SMALL, **changes}), context or Context())


class TestNumbers:
    def test_the_declared_problem(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        commands = Commands(capsys)
        done = commands("solve", CLONE / "problems" / "l1_workspace.toml", "--set", "volume.sections=5", "--set",
                        "volume.tolerance=0.1", "--set", "section.step_m=0.04", "--json", "--plot", "--out",
                        tmp_path / "out")  # fmt: skip
        assert done.code == 0 and done.json["status"] == "solved"
        values = done.json["values"]
        assert list(values) == list(workspace.VALUES)
        # notes on the L1: 3.1 to 3.3 m2, about 2.3 x 2 m; 30 deg 1.6 m2, 1.5 x 1.4 m; 45 deg 2.6-2.8 m2, 2.0 x 1.8 m
        assert values["kinematic_area_m2"] == pytest.approx(disc_intersection_area(L1.A[:, 1:], L1.L), rel=AREA)
        thirty, forty_five = values["cones"]
        assert thirty["area_m2"] == pytest.approx(1.6, abs=0.1) and 2.6 < forty_five["area_m2"] < 2.8
        assert [thirty["width_m"], thirty["height_m"]] == pytest.approx([1.5, 1.4], abs=0.1)
        assert [forty_five["width_m"], forty_five["height_m"]] == pytest.approx([2.0, 1.8], abs=0.1)
        assert thirty["area_m2"] < values["area_m2"] < forty_five["area_m2"]
        assert values["guideway_rectangle_m2"] == pytest.approx(1.31 * 1.46)
        assert values["area_ratio"] == pytest.approx(values["area_m2"] / (1.31 * 1.46))
        assert values["volume_ratio"] == pytest.approx(values["volume_m3"] / (1.31 * 1.46 * 3.0))
        (sentence,) = values["assumptions"]
        assert "home pose" in sentence and "not known" in sentence
        assert [p["reachable"] for p in values["points"]] == [True, False, False]
        assert all(check["passed"] for check in done.json["checks"].values())
        assert not values["on_edge"]
        files = {p.name for p in (tmp_path / "out").iterdir()}
        assert files == {"result.json", "boundary.csv", "section.png", "robot.png", "run.toml"}
        rows = np.loadtxt(tmp_path / "out" / "boundary.csv", delimiter=",", skiprows=1)
        y, z = rows[:, 1:3].T
        assert abs(np.sum(y * np.roll(z, -1) - z * np.roll(y, -1))) / 2 == pytest.approx(values["area_m2"], rel=1e-6)
        np.testing.assert_array_equal(rows[:, 4:], rows[:, 1:3])  # guideways along x: (u, v) = (y, z)

    def test_same_input_same_bytes(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        (tmp_path / "w.toml").write_text('kind = "workspace"\nrobot = "l1_tape"\n[section]\nstep_m = 0.1\n')
        for name in ("one", "two"):
            shared.cache_clear()  # compiled anew
            assert Commands(capsys)("solve", tmp_path / "w.toml", "--out", tmp_path / name).code == 0
        for file in ("result.json", "boundary.csv"):
            assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()

    @pytest.mark.parametrize("robot", ["l1_vision", "l1_camera", "d1_nominal"])
    def test_guideways_of_any_direction(self, robot: str) -> None:
        outcome = solve(robot=robot)
        assert outcome.status is SolveStatus.SOLVED and 2.9 < outcome.values["area_m2"] < 5.0
        assert all(check.passed for check in outcome.checks.values())

    def test_every_limit_takes_something_away(self) -> None:
        whole = solve().values["area_m2"]
        joints = [[0.0, 0.0, 0.1], [0.0, -0.1, 0.0], [0.0, 0.1, -0.1]]
        box = {"name": "table", "low_m": [0.9, -1.0, -0.3], "high_m": [1.9, -0.4, 0.2]}
        beam = {"from_m": [1.0, -0.6, -1.0], "to_m": [1.0, -0.6, 0.5], "radius_m": 0.05, "skip_links": [1]}
        for key, name, more in (
            ("limits", "actuator limits", {"actuators_m": [[-0.4, 3.0]] * 3}),
            ("limits", "Cartesian limits", {"tcp_high_m": [9.0, -0.2, 9.0]}),
            ("limits", "ball-joint cones of 20 deg", {"cone_deg": 20.0}),
            ("obstacles", "obstacles", [box]),
            ("beams", "link-frame clearance", [beam]),
            (
                "bodies",
                "link-link clearance",
                {"plate_joints_m": joints, "link_radius_m": 0.065, "link_clearance": True},
            ),
        ):
            outcome = solve(**{key: more})
            assert 0.0 < outcome.values["area_m2"] < whole, name
            assert outcome.values["reasons"][f"outside the {name}"] > 0

    def test_nothing_is_reached(self) -> None:
        outcome = solve(limits={"tcp_low_m": [9.0, 9.0, 9.0]})
        assert outcome.status is SolveStatus.INFEASIBLE and "no point of the section is reached" in outcome.message
        assert outcome.values["area_m2"] == 0.0 and json.dumps(outcome.values["reasons"])
        for draw in outcome.figures.values():
            draw()

    def test_what_leaves_the_window_says_so(self) -> None:
        outcome = solve(section={"step_m": 0.1, "low_m": [-0.7, 0.4], "high_m": [-0.2, 0.9]})
        assert outcome.values["on_edge"] and outcome.message.startswith(
            "the cross-section reaches the edge of the grid"
        )
        assert outcome.values["area_m2"] == pytest.approx(0.25) and outcome.values["volume_on_edge"] is None

    @pytest.mark.parametrize("sections", [3, 6])
    def test_the_volume_does_not_depend_on_the_sections_to_begin_with(self, sections: int) -> None:
        """Without added ones 26.7 m3 and 0.0 m3."""
        limits = {"cone_deg": 40.0, "actuators_m": [[-1.5, 1.5]] * 3}
        volume = {"low_m": -10.0, "high_m": 12.0, "sections": sections, "tolerance": 0.05}
        outcome = solve(volume=volume, limits=limits)
        assert outcome.status.ok and outcome.values["volume_m3"] == pytest.approx(5.53, rel=0.02)
        assert outcome.values["volume_error_m3"] < 0.05 * outcome.values["volume_m3"]

    def test_a_volume_with_too_few_sections_fails_its_check(self) -> None:
        few = {"low_m": -10.0, "high_m": 12.0, "sections": 4, "most_sections": 8}
        outcome = solve(volume=few, limits={"actuators_m": [[-1.5, 1.5]] * 3})
        assert outcome.status is SolveStatus.CHECK_FAILED and not outcome.checks["volume_error"].passed
        away = solve(volume={"low_m": 30.0, "high_m": 40.0, "sections": 3, "most_sections": 5},
                     limits={"actuators_m": [[-1.5, 1.5]] * 3})  # fmt: skip
        assert not away.checks["volume_error"].passed and "none of 5 sections is reached" in away.message

    def test_sections_are_as_near_as_an_obstacle_is_thin(self) -> None:
        box = {"name": "post", "low_m": [0.4, -1.0, -0.3], "high_m": [0.5, -0.4, 0.2]}
        problem = validate(
            workspace.Schema,
            {**SMALL, "obstacles": [box], "volume": {"low_m": -1.0, "high_m": 1.0, "sections": 3}},
        )
        robot = mechanism_of(problem.model(Context()))
        assert workspace._to_begin_with(problem, robot.section()) >= 21

    def test_a_volume_may_be_cut_where_the_section_is_not(self) -> None:
        outcome = solve(section={"step_m": 0.2}, volume={"low_m": 0.5, "high_m": 0.7, "sections": 2})
        assert outcome.values["volume_on_edge"] and not outcome.values["on_edge"]
        assert any(row.label == "cut" and "volume" in row.value for row in outcome.rows)

    def test_six_links_reach_farther_by_the_plate(self) -> None:
        # the plate's joints are up to 0.2 m from the tool centre point
        problem = validate(workspace.Schema, {**SMALL, "robot": "d1_six_link"})
        robot = mechanism_of(problem.model(Context()))
        section = robot.section()
        low, high = workspace._window(problem, robot, section)
        pierced, L = section.pierced(robot.anchors, robot.directions), robot.lengths[:, None] + 0.05
        by_links = (pierced - L).max(axis=0), (pierced + L).min(axis=0)
        u, v = (np.linspace(low[k] - 0.2, high[k] + 0.2, 61) for k in range(2))
        uv = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
        uv = uv[np.any((uv < by_links[0]) | (uv > by_links[1]), axis=1)]
        reached = uv[robot.inverse(section.points(uv)).status == Status.OK]
        assert len(reached) and np.all((reached > low) & (reached < high))
        # of the joints themselves, wherever the links are drawn
        moved = mechanism_of(robot.model, None, np.ones((6, 3)))
        np.testing.assert_allclose(moved.plate_arms, robot.plate_arms, rtol=1e-12)

    def test_few_points_of_a_section_not_reached(self) -> None:
        outcome = solve(
            section={"step_m": 0.5}, limits={"tcp_low_m": [0.0, -0.5, 0.7], "tcp_high_m": [9.0, -0.45, 0.75]}
        )
        assert outcome.status is SolveStatus.INFEASIBLE and outcome.message.endswith("try a smaller section.step_m")

    def test_a_coarse_grid_says_so(self) -> None:
        outcome = solve(section={"step_m": 0.4})
        assert not outcome.checks["area_change_at_double_step"].passed
        assert outcome.status is SolveStatus.CHECK_FAILED and "area_change_at_double_step" in outcome.message
        assert outcome.message.endswith("; use a smaller section.step_m")

    def test_stopped(self) -> None:
        context = Context()
        context.request_stop()
        assert solve(context).status is SolveStatus.INTERRUPTED


@pytest.mark.parametrize(
    ("changes", "key", "sentence"),
    [
        ({"home_m": [0.0, 9.0, 0.0]}, "home_m", "cannot be reached"),
        ({"limits": {"actuators_m": [[0.0, 1.0]]}}, "limits.actuators_m", "has 3 carts; found 1 pairs"),
        ({"limits": {"actuators_m": [[1.0, 0.0]] * 3}}, "limits.actuators_m", "less than its upper"),
        (
            {"limits": {"actuators_m": [[-1500.0, 1500.0]] * 3}},
            "limits.actuators_m",
            "a stroke of 3000 m is more than 100 times the longest link, 2.05 m; give metres, not millimetres",
        ),
        ({"section": {"step_m": 5.0}}, "section.step_m", "so that no point lies within it; take a step below"),
        ({"bodies": {"link_clearance": True}}, "bodies.link_clearance", "give bodies.plate_joints_m"),
        ({"bodies": {"plate_joints_m": [[0.0, 0.0, 0.0]]}}, "bodies.plate_joints_m", "has 3 links; found 1 joints"),
        ({"obstacles": [{"low_m": [0, 0, 0.0], "high_m": [1, 1, 0.0]}]}, "obstacles.high_m", "less than its upper"),
        ({"beams": [{"from_m": [0, 0, 0.0], "to_m": [1, 1, 0.0], "skip_links": [4]}]}, "beams.skip_links", "no link 4"),
        (
            {"beams": [{"from_m": [1.2, -0.6, 0.5], "to_m": [1.6, -0.6, 0.5], "skip_links": [1, 2, 3]}]},
            "beams[0].skip_links",
            "names all links",
        ),
        ({"volume": {"low_m": 1.0, "high_m": 0.0}}, "volume.high_m", "less than the last"),
        ({"volume": {"low_m": 0.0, "high_m": 1.0, "sections": 9, "most_sections": 5}}, "volume.most_sections", "than"),
        ({"section": {"step_m": 1e-6}}, "section.step_m", "larger step"),
        ({"section": {"low_m": [0.0, 0.0], "high_m": [0.0, 1.0]}}, "section.high_m", "less than its upper"),
    ],
)
def test_what_is_refused(changes: dict, key: str, sentence: str) -> None:
    with pytest.raises((ArgumentError, InputError), match=sentence) as caught:
        solve(**changes)
    assert getattr(caught.value, "key", key) == key and "\n" not in str(caught.value)


def test_a_start_is_refused_and_a_misspelt_key_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="leave it out"):
        solve(Context(start={}))
    (tmp_path / "w.toml").write_text('kind = "workspace"\nrobot = "l1_tape"\n[limits]\ncones_deg = 3.0\n')
    done = Commands(capsys)("solve", tmp_path / "w.toml")
    assert done.code == 2 and "cone_deg" in done.sentence


def test_a_model_without_links_on_guideways(tmp_path: Path) -> None:
    (tmp_path / "point.py").write_text(
        "import gtmodel as gt\n\n\nclass Point(gt.Model):\n    T = gt.variable(3, unit='m')\n"
        "    q = gt.variable(3, unit='m')\n\n    def equations(self):\n        yield self.T == self.q\n"
    )
    with pytest.raises(ArgumentError, match="no links on guideways"):
        solve(Context(folder=tmp_path), robot=f"{tmp_path / 'point.py'}:Point")


def test_explain_tells_the_tests_and_the_assumption() -> None:
    loaded = load(CLONE / "problems" / "l1_workspace.toml")
    text = workspace.explain(loaded.problem, Context())
    assert text.index("inverse kinematics") < text.index("actuator limits") < text.index("ball-joint cones of 40 deg")
    assert "not known" in text
