"""Assembly modes as a study: six-link robots, bare platforms, random ones; certificate, commanded mode, pictures."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel import robots
from gtmodel.kinematics.assembly_modes import CommandedPose, bare, draw, modes_study, read_poses
from gtmodel.plot.robot3d import MARKED, modes_figure
from gtmodel.results import ArgumentError, SolveStatus, as_json
from gtmodel.results.written import png

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
# of a leg length at a mode read from the result [m]: rounding of metres
LEG = 1e-12
# commanded pose by Newton and by the homotopy [m]
SAME = 1e-10
CARTS = CommandedPose(q=[-0.2, 0.0, -0.2])
# P. Dietmaier 1998, as printed
PRINTED = tomllib.loads((PROBLEMS / "dietmaier_modes.toml").read_text(encoding="utf-8"))["platform"]
DIETMAIER = [np.array(PRINTED[key]) for key in ("A_m", "B_m", "L_m")]


def rotation(mode: dict) -> np.ndarray:
    return Rotation.from_quat(mode["quaternion"], scalar_first=True).as_matrix()


@pytest.fixture(scope="module")
def f1():
    return modes_study(
        robots.f1_gantry_tau(), CommandedPose([0.72, 0.26, 0.21], np.radians([0.3, -3.0, -0.6]).tolist())
    )


@pytest.fixture(scope="module")
def robot():
    return robots.six_link_gantry_tau()


@pytest.fixture(scope="module")
def d1(robot):
    return modes_study(robot, CARTS)


@pytest.fixture(scope="module")
def dietmaier():
    return modes_study(bare(*DIETMAIER))


class TestRobots:
    def test_f1_has_eight_real_modes_in_two_groups_of_four(self, f1) -> None:
        v = f1.values
        assert f1.status is SolveStatus.SOLVED and all(check.passed for check in f1.checks.values())
        assert (v["finite"], v["distinct"], v["real"], v["conjugate_pairs"]) == (40, 40, 8, 16)
        # Dressler 2012, section 4.5: above and below the carts; the robot works below
        carts = 1.45
        height = np.array([mode["tcp_m"][2] for mode in v["modes"]])
        assert np.sum(height > carts) == 4 and height[v["commanded"] - 1] < carts

    def test_modes_in_space_have_links_of_their_lengths(self, f1) -> None:
        view, L = f1.view(), np.asarray(robots.f1_gantry_tau().L).ravel()
        for k in range(6):
            link = view.points[f"plate joint {k + 1}"] - view.points[f"cart joint {k + 1}"]
            assert np.linalg.norm(link, axis=1) == pytest.approx(np.full(8, L[k]), abs=1e-9)
        assert view.unit == "mode" and view.at("tool centre point", 3.0) == pytest.approx(
            f1.values["modes"][2]["tcp_m"]
        )

    def test_commanded_mode_is_the_pose_that_newton_gives(self, f1) -> None:
        q = [0.72, 0.26, 0.21, *np.radians([0.3, -3.0, -0.6])]
        T, R, status = robots.f1_gantry_tau().causal("q", ["T", "R"])(q)
        mode = f1.values["modes"][f1.values["commanded"] - 1]
        assert status.name == "OK" and mode["commanded"] and sum(m["commanded"] for m in f1.values["modes"]) == 1
        assert mode["tcp_m"] == pytest.approx(T, abs=SAME) and rotation(mode) == pytest.approx(R, abs=SAME)

    def test_every_mode_closes_the_links_of_the_robots_own_equations(self, d1) -> None:
        """A and B from the printed table, by hand and not by the compiler."""
        robot = robots.six_link_gantry_tau()
        q = np.array([-0.2, 0.0, -0.2])
        A = np.asarray(robot.A) + q[[0, 1, 1, 2, 2, 2], None] * np.asarray(robot.v)
        assert d1.values["real"] == 6 == len(d1.values["modes"]) and d1.values["commanded"] == 6
        for mode in d1.values["modes"]:
            joints = mode["tcp_m"] + np.asarray(robot.B) @ rotation(mode).T
            assert np.linalg.norm(joints - A, axis=1) == pytest.approx(np.asarray(robot.L), abs=LEG)

    def test_nearest_mode_is_measured_between_centroids(self, d1) -> None:
        B = np.asarray(robots.six_link_gantry_tau().B).mean(axis=0)
        for mode in d1.values["modes"]:
            other = d1.values["modes"][mode["nearest_mode"] - 1]
            R, S = rotation(mode), rotation(other)
            gap = mode["tcp_m"] + R @ B - other["tcp_m"] - S @ B
            assert mode["nearest_mm"] == pytest.approx(1e3 * np.linalg.norm(gap))
            turned = np.degrees(Rotation.from_matrix(R.T @ S).magnitude())
            assert mode["nearest_deg"] == pytest.approx(turned)
        assert d1.values["nearest_mm"] == min(mode["nearest_mm"] for mode in d1.values["modes"])

    def test_tool_pose_gives_the_carts_it_belongs_to(self, d1, robot, tmp_path: Path) -> None:
        T = d1.each[0]["tcp_m"]
        (tmp_path / "poses.csv").write_text(
            "# synthetic\nx_m,y_m,z_m\n" + ",".join(map(repr, T.tolist())) + "\n9.0,9.0,9.0\n", encoding="utf-8"
        )
        s = modes_study(robot, read_poses(tmp_path / "poses.csv"))
        first, second = s.each
        assert first["q_m"] == pytest.approx([-0.2, 0.0, -0.2], abs=SAME) and first["commanded"] == 6
        # a pose out of reach does not harm the other, and says why
        assert s.status is SolveStatus.FAILED and s.message.startswith("pose 2: the inverse kinematics")
        assert second["status"] == "bad_input" and second["commanded"] is None and s.whole == 1

    def test_a_robot_moved_has_its_modes_moved(self, d1, robot) -> None:
        x = [1.0, 0.0, 0.0]
        moved = robots.six_link_gantry_tau(A=np.add(robot.A, x), home=np.add(robot.home, x))
        s = modes_study(moved, CARTS)
        assert s.commanded == 6
        assert s.modes[5]["tcp_m"][0] == pytest.approx(d1.modes[5]["tcp_m"][0] + 1.0, abs=SAME)


class TestPlatforms:
    def test_all_forty_of_dietmaier_are_real(self, dietmaier) -> None:
        s = dietmaier
        assert s.status.ok and s.real == 40 == len(s.modes) and s.conjugate_pairs == 0
        assert s.commanded is None and math.isnan(s.commanded_nearest_distance)
        assert len(s.files["modes.csv"].splitlines()) == 41  # type: ignore[arg-type]
        assert len(s.figure("modes").axes) == 40

    def test_commanded_pose_of_a_platform(self, dietmaier) -> None:
        mode = dietmaier.modes[12]
        T, e = np.array(mode["tcp_m"]), np.array(mode["quaternion"])
        assert modes_study(bare(*DIETMAIER, T, e)).commanded == 13
        s = modes_study(bare(*DIETMAIER, T + 1e-6 * np.eye(3)[0], e))
        assert s.commanded is None and not s.checks["commanded_error"].passed
        assert s.status is SolveStatus.CHECK_FAILED and "commanded_error" in s.message

    def test_architecturally_singular_platform_is_no_solution(self) -> None:
        angle = np.arange(6) * np.pi / 3
        hexagon = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        s = modes_study(bare(hexagon, 0.5 * hexagon, np.ones(6)))
        assert s.status is SolveStatus.FAILED and "architecturally singular" in s.message
        assert s.each[0]["status"] == "self_motion"


class TestDraws:
    def test_drawn_poses_are_among_the_modes(self) -> None:
        s = modes_study(draw(6, 7), title="platforms")
        assert s.status.ok and s.poses == 6 == s.whole and s.modes == []
        assert all(pose["commanded"] is not None and pose["real"] % 2 == 0 for pose in s.each)
        assert sum(s.real_counts.values()) == 6
        figure = s.figure("real_modes")
        assert "synthetic" in figure.get_suptitle()
        assert sum(bar.get_height() for bar in figure.axes[0].patches) == 6

    def test_seed_alone_decides(self) -> None:
        assert np.array_equal(draw(5, 7).L, draw(9, 7).L[:5]) and not np.array_equal(draw(5, 7).L, draw(5, 8).L)

    def test_an_interrupted_search_keeps_what_it_has(self) -> None:
        told: list[float | None] = []

        def progress(stage: object = None, fraction: float | None = None, numbers: object = None) -> None:
            told.append(fraction)

        s = modes_study(draw(17, 1), progress=progress, stop=lambda: any(told))
        assert told == [None, None, 0.0, 16 / 17] and s.status is SolveStatus.INTERRUPTED
        assert s.message.endswith("16 of 17 poses are complete")
        assert s.whole == 16 and s.finite == 40 and s.each[16]["status"] == "interrupted"

    def test_stopped_before_it_began(self) -> None:
        s = modes_study(draw(20, 1), stop=lambda: True)
        assert s.status is SolveStatus.INTERRUPTED and s.each == () and s.rows == []

    def test_same_result_again(self) -> None:
        assert as_json.result("", None, modes_study(draw(2, 3))) == as_json.result("", None, modes_study(draw(2, 3)))


class TestPictures:
    def test_the_commanded_panel_is_marked(self, f1) -> None:
        figure = f1.figures["modes"]()
        titles = [axes.get_title() for axes in figure.axes]
        assert len(titles) == 8 and titles[f1.values["commanded"] - 1] == f"{f1.values['commanded']}, commanded"
        assert [t for t in titles if "commanded" in t] == [titles[f1.values["commanded"] - 1]]
        marked = [to_hex(axes.title.get_color()) == MARKED for axes in figure.axes]
        assert marked.index(True) == f1.values["commanded"] - 1 and sum(marked) == 1

    def test_one_scale_for_all_panels(self, d1) -> None:
        figure = d1.figures["modes"]()
        assert len({(axes.get_xlim(), axes.get_ylim(), axes.get_zlim()) for axes in figure.axes}) == 1

    @pytest.mark.parametrize("flat", [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    def test_plates_in_space_in_a_plane_and_on_a_line(self, flat: list[float]) -> None:
        B = np.random.default_rng(1).uniform(-0.5, 0.5, (6, 3)) * flat

        def draw():
            return modes_figure(np.eye(6)[:, :3], B, np.eye(3)[None], np.ones((1, 3)), commanded=0)

        assert len(draw().axes) == 1 and png(draw) == png(draw)


T0, Q0, E0 = [0.0] * 3, [0.0] * 3, [1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("make", "poses", "argument"),
    [
        (lambda: gt.robots.gantry_tau("l1_tape"), None, "robot"),
        (robots.SixLink, None, "robot"),
        (robots.extra_carts, None, "robot"),
        (robots.extra_carts, CommandedPose(q=Q0), "robot"),
        (robots.f1_gantry_tau, CommandedPose(q=Q0, tcp=T0), "pose"),
        (robots.f1_gantry_tau, CommandedPose(axes=Q0), "pose.axes"),
        (robots.f1_gantry_tau, CommandedPose(quaternion=E0), "pose.quaternion"),
        (robots.f1_gantry_tau, CommandedPose(tcp=T0, quaternion=E0, zyz=T0), "pose"),
        (robots.f1_gantry_tau, CommandedPose(tcp=T0, quaternion=[2.0, 0.0, 0.0, 0.0]), "pose.quaternion"),
        (
            robots.f1_gantry_tau,
            [CommandedPose(tcp=T0, quaternion=e) for e in (E0, [1, 1, 0, 0])],
            "poses.quaternion",
        ),
        (robots.f1_gantry_tau, [], "poses"),
        (robots.six_link_gantry_tau, CommandedPose(q=Q0, axes=Q0), "pose.axes"),
        (robots.six_link_gantry_tau, CommandedPose(tcp=T0, zyz=T0), "pose.zyz"),
        (lambda: bare(np.zeros((6, 3)), np.zeros((6, 3)), np.ones(6)), None, "legs"),
        (lambda: draw(1, 1), CommandedPose(q=Q0), "pose"),
    ],
)
def test_what_cannot_be_used_is_named(make, poses, argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        modes_study(make(), poses)
    assert caught.value.argument == argument and caught.value.message


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a,b\n1,2\n",
        "q1_m,q2_m\n1,2\n",
        "q1_m,q2_m,q3_m,q4\n",
        "q1_m,q2_m,q3_m,q1_m\n",
        "q1_m,q2_m,q3_m\n",
        "# n\nq1_m,q2_m,q3_m\n1,2,3\n1,x,3\n",
        "q1_m,q2_m,q3_m\n1,2,inf\n",
        "q1_m,q2_m,q3_m\n1,2,1_0\n",
        'q1_m,q2_m,q3_m\n"1,2,3\n4,5,6\n',
        "q1_m,q2_m,q3_m\n1,2\n",
        "q1_m,q2_m,q3_m,q4_deg,q5_deg,q6_deg,q4_rad,q5_rad,q6_rad\n0,0,0,0,0,0,0,0,0\n",
    ],
)
def test_wrong_files_get_a_sentence(text: str, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ArgumentError) as caught:
        read_poses(tmp_path / "p.csv")
    assert "p.csv" in caught.value.message and caught.value.argument == "poses"


def test_a_file_of_a_spreadsheet_begins_with_a_mark(tmp_path: Path) -> None:
    text = "q1_m,q2_m,q3_m,q4_deg,q5_deg,q6_deg\n0.01,0,0,180,0,0\n0,0.01,0,0,0,0\n"
    (tmp_path / "p.csv").write_text(text, encoding="utf-8-sig")
    (tmp_path / "plain.csv").write_text(text, encoding="utf-8")
    marked, plain = (read_poses(tmp_path / name) for name in ("p.csv", "plain.csv"))
    assert marked == plain and marked[0] == CommandedPose(q=[0.01, 0.0, 0.0], axes=[np.pi, 0.0, 0.0])


def test_carts_too_far_apart_have_no_real_mode_and_infinities_are_null(robot) -> None:
    s = modes_study(robot, CommandedPose(q=[5.0, 0.0, 0.0]))
    assert s.status.ok and s.message.endswith("the links cannot be assembled at these carts")
    assert (s.finite, s.real, s.modes, s.commanded) == (40, 0, [], None)
    v = json.loads(as_json.result("", None, s))["values"]
    assert v["nearest_mm"] is None and v["each"][0]["tcp_m"] == [None] * 3
    assert "commanded_error" not in s.checks
