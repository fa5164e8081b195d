"""Kind "modes": six-link robots, bare platforms, random ones; certificate, commanded mode, pictures, refusals."""

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from scipy.spatial.transform import Rotation

from gtmodel import robots
from gtmodel.kinds import hand_poses, modes
from gtmodel.plot.assembly_modes import MARKED, modes_figure
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load, validate
from gtmodel.results import SolveStatus, as_json
from gtmodel.results.written import png
from tests.support.commands import Commands

CLONE = Path(__file__).resolve().parents[2]
# of a leg length at a mode read from the result [m]: rounding of metres
LEG = 1e-12
# commanded pose by Newton and by the homotopy [m]
SAME = 1e-10


def shipped(name: str, *settings: str):
    loaded = load(CLONE / "problems" / f"{name}.toml", settings)
    return modes.solve(loaded.problem, Context())  # type: ignore[arg-type]


def solve(context: Context | None = None, **keys: object):
    return modes.solve(validate(modes.Schema, {"kind": "modes", **keys}), context or Context())


def rotation(mode: dict) -> np.ndarray:
    return Rotation.from_quat(mode["quaternion"], scalar_first=True).as_matrix()


@pytest.fixture(scope="module")
def f1():
    return shipped("f1_modes")


@pytest.fixture(scope="module")
def d1():
    return shipped("d1_modes")


class TestRobots:
    def test_f1_has_eight_real_modes_in_two_groups_of_four(self, f1) -> None:
        v = f1.values
        assert f1.status is SolveStatus.SOLVED and all(check.passed for check in f1.checks.values())
        assert list(v) == list(modes.VALUES)
        assert (v["found"], v["distinct"], v["real"], v["conjugate_pairs"]) == (40, 40, 8, 16)
        # Dressler 2012, section 4.5: above and below the carts; the robot works below
        carts = 1.45
        height = np.array([mode["tcp_m"][2] for mode in v["modes"]])
        assert np.sum(height > carts) == 4 and height[v["commanded"] - 1] < carts

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

    def test_tool_pose_gives_the_carts_it_belongs_to(self, d1, tmp_path: Path) -> None:
        T = d1.values["each"][0]["tcp_m"]
        (tmp_path / "poses.csv").write_text(
            "# synthetic\nx_m,y_m,z_m\n" + ",".join(map(repr, T.tolist())) + "\n9.0,9.0,9.0\n", encoding="utf-8"
        )
        context = Context(folder=tmp_path)
        outcome = solve(context, robot="d1_six_link", poses="poses.csv")
        first, second = outcome.values["each"]
        assert first["q_m"] == pytest.approx([-0.2, 0.0, -0.2], abs=SAME)
        assert first["commanded"] == 6 and context.inputs["poses"] == tmp_path / "poses.csv"
        # a pose out of reach does not harm the other, and says why
        assert outcome.status is SolveStatus.FAILED and outcome.message.startswith("pose 2: the inverse kinematics")
        assert second["status"] == "bad_input" and second["commanded"] is None and outcome.values["whole"] == 1

    def test_robot_file(self, d1, tmp_path: Path) -> None:
        """A user's own robot: the D1 moved by 1 m has its modes moved by 1 m."""
        robot = robots.six_link_gantry_tau()
        lists = {"A_m": np.add(robot.A, [1.0, 0.0, 0.0]), "v": robot.v, "B_m": robot.B, "L_m": robot.L}
        text = "".join(f"{key} = {np.asarray(x).tolist()}\n" for key, x in lists.items())
        (tmp_path / "mine.toml").write_text(f'family = "six_link"\nhome_zyz_deg = [85.0, 100.9, -88.6]\n{text}')
        outcome = solve(Context(folder=tmp_path), robot="mine.toml", pose={"q_m": [-0.2, 0.0, -0.2]})
        assert outcome.values["commanded"] == 6
        assert outcome.values["modes"][5]["tcp_m"][0] == pytest.approx(
            d1.values["modes"][5]["tcp_m"][0] + 1.0, abs=SAME
        )


class TestPlatforms:
    def test_all_forty_of_dietmaier_are_real(self) -> None:
        outcome = shipped("dietmaier_modes")
        v = outcome.values
        assert outcome.status.ok and v["real"] == 40 == len(v["modes"]) and v["conjugate_pairs"] == 0
        assert v["commanded"] is None and math.isnan(v["commanded_nearest_mm"])
        assert len(outcome.files["modes.csv"].splitlines()) == 41  # type: ignore[arg-type]
        assert len(outcome.figures["modes"]().axes) == 40

    def test_commanded_pose_of_a_platform(self) -> None:
        problem = load(CLONE / "problems" / "dietmaier_modes.toml").problem
        platform = problem.model_dump()["platform"]
        v = shipped("dietmaier_modes").values["modes"][12]
        pose = {"tcp_m": v["tcp_m"].tolist(), "quaternion": v["quaternion"].tolist()}
        assert solve(platform=platform, pose=pose).values["commanded"] == 13
        pose["tcp_m"][0] += 1e-6
        outcome = solve(platform=platform, pose=pose)
        assert outcome.values["commanded"] is None and not outcome.checks["commanded_error"].passed
        assert outcome.status is SolveStatus.CHECK_FAILED and "commanded_error" in outcome.message

    def test_architecturally_singular_platform_is_no_solution(self) -> None:
        angle = np.arange(6) * np.pi / 3
        hexagon = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        platform = {"A_m": hexagon.tolist(), "B_m": (0.5 * hexagon).tolist(), "L_m": [1.0] * 6}
        outcome = solve(platform=platform)
        assert outcome.status is SolveStatus.FAILED and "architecturally singular" in outcome.message
        assert outcome.values["each"][0]["status"] == "self_motion"


class TestDraws:
    def test_drawn_poses_are_among_the_modes(self) -> None:
        outcome = shipped("random_modes", "draw.seed=7", "draw.platforms=6")
        v = outcome.values
        assert outcome.status.ok and v["poses"] == 6 == v["whole"] and v["modes"] == []
        assert all(pose["commanded"] is not None and pose["real"] % 2 == 0 for pose in v["each"])
        assert sum(v["real_counts"].values()) == 6
        figure = outcome.figures["real_modes"]()
        assert "synthetic" in figure.get_suptitle()
        assert sum(bar.get_height() for bar in figure.axes[0].patches) == 6

    def test_seed_alone_decides(self) -> None:
        def legs(seed: int, count: int) -> np.ndarray:
            return modes._hands(validate(modes.Schema, {"kind": "modes", "draw": {"platforms": count, "seed": seed}}),
                                Context()).L  # fmt: skip

        assert np.array_equal(legs(7, 5), legs(7, 9)[:5]) and not np.array_equal(legs(7, 5), legs(8, 5))

    def test_an_interrupted_search_keeps_what_it_has(self) -> None:
        context = Context()
        stops: list[float | None] = []

        def progress(stage: object = None, fraction: float | None = None, numbers: object = None) -> None:
            stops.append(fraction)
            if fraction:
                context.request_stop()

        context.progress = progress  # type: ignore[assignment]
        outcome = solve(context, draw={"platforms": 17, "seed": 1})
        assert stops == [0.0, 16 / 17] and outcome.status is SolveStatus.INTERRUPTED
        assert outcome.message.endswith("16 of 17 poses were searched")
        assert outcome.values["whole"] == 16 and outcome.values["found"] == 40
        assert outcome.values["each"][16]["status"] == "interrupted"

    def test_stopped_before_it_began(self) -> None:
        assert solve(Context(stop_requested=True), draw={}).status is SolveStatus.INTERRUPTED


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


REFUSED = [
    ({}, "give one of robot, platform and draw; found none"),
    ({"robot": "f1", "draw": {}}, "draw: give one of robot, platform and draw; found robot and draw"),
    ({"robot": "l1_tape"}, "robot: assembly modes are those of six links; 'l1_tape' is a GantryTau, which is neither a "
     "SixLink nor an F1"),
    ({"draw": {}, "pose": {"q_m": [0.0, 0.0, 0.0]}}, "pose: random platforms are in random poses; leave it out"),
    ({"draw": {}, "parameters": {"L": 1.0}}, "parameters: are those of a robot; leave them out"),
    ({"draw": {}, "poses": "p.csv"}, "poses: are those of a robot; leave them out"),
    ({"draw": {"seed": -1}}, "draw.seed: must be greater than or equal to 0; found -1"),
    ({"robot": "f1", "poses": "p.csv"}, "poses: there is no file 'p.csv'"),
    ({"robot": "f1", "poses": "p.csv", "pose": {}}, "poses: give either pose or poses"),
    ({"robot": "f1", "pose": {"q_m": [0.0, 0.0, 0.0], "tcp_m": [0.0, 0.0, 0.0]}}, "pose: give either q_m or tcp_m"),
    ({"robot": "f1", "pose": {"q_deg": [0.0, 0.0, 0.0]}}, "pose.q_deg: rotary axes need the carts q_m beside them"),
    ({"robot": "f1", "pose": {"q_m": [0.0] * 3, "q_deg": [0.0] * 3, "q_rad": [0.0] * 3}},
     "pose: give either q_rad or q_deg"),
    ({"robot": "f1", "pose": {"quaternion": [1.0, 0.0, 0.0, 0.0]}},
     "pose.quaternion: an orientation needs tcp_m beside it"),
    ({"robot": "f1", "pose": {"tcp_m": [0.0] * 3, "quaternion": [2.0, 0.0, 0.0, 0.0]}},
     "pose.quaternion: must be of length 1; found [2.0, 0.0, 0.0, 0.0] of length 2"),
    ({"robot": "d1_six_link", "pose": {"q_m": [0.0] * 3, "q_rad": [0.0] * 3}},
     "pose.q_rad: the robot has no rotary axes; leave it out"),
    ({"robot": "d1_six_link", "pose": {"tcp_m": [0.0] * 3, "zyz_deg": [0.0] * 3}},
     "pose.zyz_deg: the robot's orientation follows from tcp_m; leave it out"),
    ({"platform": {"A_m": [[0.0] * 3] * 6, "B_m": [[0.0] * 3] * 6, "L_m": [1.0] * 6}},
     "platform: legs 1 and 2 join the same two points"),
    ({"platform": {"A_m": [[0.0] * 3] * 6, "B_m": [[0.0] * 3] * 6, "L_m": [1.0] * 6}, "pose": {"q_m": [0.0] * 3}},
     "pose.q_m: a platform has no carts; give tcp_m with quaternion or zyz_deg"),
    ({"platform": {"A_m": [[0.0] * 3] * 6, "B_m": [[0.0] * 3] * 6, "L_m": [1.0] * 6}, "pose": {"tcp_m": [0.0] * 3}},
     "pose: the commanded pose of a platform is tcp_m with either quaternion or zyz_deg"),
]  # fmt: skip


@pytest.mark.parametrize(("keys", "sentence"), REFUSED)
def test_wrong_problems_get_a_sentence(keys: dict, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        solve(**keys)
    assert str(caught.value).startswith(sentence)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "p.csv is empty; expected a header such as 'q1_m,q2_m,q3_m' and rows"),
        ("a,b\n1,2\n", "p.csv lacks the columns q1_m, q2_m, q3_m or x_m, y_m, z_m; it has a, b"),
        ("q1_m,q2_m\n1,2\n", "p.csv lacks the columns q3_m; it has q1_m, q2_m"),
        ("q1_m,q2_m,q3_m,q4\n", "p.csv has columns that are none of a pose: q4"),
        ("q1_m,q2_m,q3_m,q1_m\n", "p.csv line 1: 'q1_m' is there twice, in columns 1 and 4; leave one of them out"),
        ("q1_m,q2_m,q3_m\n", "p.csv has no rows"),
        ("# n\nq1_m,q2_m,q3_m\n1,2,3\n1,x,3\n", "p.csv line 4: expected 3 finite numbers; found '1,x,3'"),
        ("q1_m,q2_m,q3_m\n1,2,inf\n", "p.csv line 2: expected 3 finite numbers; found '1,2,inf'"),
        ("q1_m,q2_m,q3_m\n1,2,1_0\n", "p.csv line 2: expected 3 finite numbers; found '1,2,1_0'"),
        (
            'q1_m,q2_m,q3_m\n"1,2,3\n4,5,6\n',
            'p.csv line 2: a quote (") is not closed before the next comma or the end of the line; close it or take it '
            "out",
        ),
        ("q1_m,q2_m,q3_m\n1,2\n", "p.csv line 2: expected 3 finite numbers; found '1,2'"),
        ("q1_m,q2_m,q3_m,q4_deg,q5_deg,q6_deg\n0,0,0,0,0,0\n", "the robot has no rotary axes; leave it out"),
    ],
)
def test_wrong_files_get_a_sentence(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        solve(Context(folder=tmp_path), robot="d1_six_link", poses="p.csv")
    assert caught.value.sentence == sentence and caught.value.key.startswith("poses")


def test_a_file_of_a_spreadsheet_begins_with_a_mark(tmp_path: Path) -> None:
    text = "q1_m,q2_m,q3_m\n0.01,0,0\n0,0.01,0\n"
    (tmp_path / "p.csv").write_text(text, encoding="utf-8-sig")
    (tmp_path / "plain.csv").write_text(text, encoding="utf-8")
    marked, plain = (hand_poses.of_file(name, Context(folder=tmp_path)) for name in ("p.csv", "plain.csv"))
    assert marked == plain and marked[0].q_m == [0.01, 0.0, 0.0]


def test_a_row_with_a_wrong_quaternion_is_named(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("x_m,y_m,z_m,e0,e1,e2,e3\n0,2,0,1,0,0,0\n0,2,0,1,1,0,0\n", encoding="utf-8")
    with pytest.raises(InputError, match="pose 2 must be of length 1"):
        solve(Context(folder=tmp_path), robot="f1", poses="p.csv")


def test_carts_too_far_apart_have_no_real_mode_and_infinities_are_null(capsys: pytest.CaptureFixture[str]) -> None:
    gtmodel = Commands(capsys)
    done = gtmodel("solve", CLONE / "problems" / "d1_modes.toml", "--set", "pose.q_m=[5.0, 0.0, 0.0]", "--json")
    v = done.json["values"]
    assert done.code == 0 and done.json["message"].endswith("the links cannot be assembled at these carts")
    assert (v["found"], v["real"], v["modes"], v["commanded"]) == (40, 0, [], None)
    assert v["nearest_mm"] is None and v["each"][0]["tcp_m"] == [None] * 3
    assert "commanded_error" not in done.json["checks"]


def test_same_result_again_and_explained(capsys: pytest.CaptureFixture[str]) -> None:
    keys = {"draw": {"platforms": 2, "seed": 3}}
    assert as_json.result("draw", "modes", solve(**keys)) == as_json.result("draw", "modes", solve(**keys))
    explained = Commands(capsys)("explain", CLONE / "problems" / "dietmaier_modes.toml")
    assert explained.code == 0 and "leg 6: A = (" in explained.out
