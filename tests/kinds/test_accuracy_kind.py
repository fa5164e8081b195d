"""Kind "accuracy": the windows printed for D1 (Dressler 2012, section 4.3), checks, pictures; and what is refused."""

import copy
from pathlib import Path

import numpy as np
import pytest

from gtmodel.kinds import accuracy
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load, validate
from gtmodel.results import SolveStatus
from tests.support.commands import CLONE, Commands

SMALL = {
    "kind": "accuracy",
    "robot": "d1_nominal",
    "section": {"step_m": 0.2},
    "cases": [{"name": "lengths", "length_um": [32.0, 77.0, 54.0]}],
    "monte_carlo": {"samples": 2000, "seed": 3},
}


def solve(context: Context | None = None, **changes: object):
    return accuracy.solve(validate(accuracy.Schema, {**copy.deepcopy(SMALL), **changes}), context or Context())


class TestNumbers:
    def test_the_declared_problem_and_the_printed_windows(
        self, capsys: pytest.CaptureFixture[str], tmp_path: Path
    ) -> None:
        done = Commands(capsys)("solve", CLONE / "problems" / "d1_accuracy.toml", "--set", "section.step_m=0.1",
                                "--json", "--plot", "--out", tmp_path / "out")  # fmt: skip
        assert done.code == 0 and done.json["status"] == "solved"
        assert list(done.json["values"]) == list(accuracy.VALUES)
        one, two = done.json["values"]["cases"]
        assert 140 < one["min_um"] < one["max_um"] < 230 and one["centre_um"] == pytest.approx(200, abs=10)
        assert 75 < two["min_um"] < two["max_um"] < 180
        # case 1 largest beside a guideway, case 2 near guideway 2
        guideways = np.array(done.json["values"]["guideways_m"])
        assert np.linalg.norm(guideways - one["max_at_m"], axis=1).min() < 0.15
        assert two["nearest_guideway"] == 2 and np.linalg.norm(guideways[1] - two["max_at_m"]) < 0.15
        # least in the lower right corner
        window = np.array(done.json["values"]["window_m"])
        np.testing.assert_allclose(one["min_at_m"], [window[1, 0], window[0, 1]], atol=0.15)
        # most of it orthogonal to link 1, whose error is the smallest
        assert np.argmax(one["shape"]["faces_um2"]) == 0
        assert one["shape"]["longest_diagonal_um"] == pytest.approx(2 * one["centre_um"], rel=1e-9)
        assert one["reached_min_um"] <= one["min_um"] and one["max_um"] <= one["reached_max_um"]
        checks = done.json["checks"]
        assert len(checks) == 6 and all(check["passed"] for check in checks.values())
        files = {p.name for p in (tmp_path / "out").iterdir()}
        assert files == {
            "result.json", "errors.csv", "run.toml", "error_1.png", "error_2.png", "faces.png", "robot.png"
        }  # fmt: skip
        table = np.genfromtxt(tmp_path / "out" / "errors.csv", delimiter=",", names=True)
        assert table["error_1_um"].max() == pytest.approx(one["max_um"], rel=1e-5)
        assert table["error_2_um"].min() == pytest.approx(two["min_um"], rel=1e-5)

    def test_the_error_of_one_point_by_hand(self) -> None:
        outcome = solve()
        (case,) = outcome.values["cases"]
        plane, robot = outcome.values["section"], validate(accuracy.Schema, SMALL).model(Context())
        low, high = np.array(outcome.values["window_m"])
        normal = np.array(plane["normal"])
        up = np.array([0.0, 0, 1]) - normal[2] * normal
        up /= np.linalg.norm(up)
        u, v = (low + high) / 2
        T = np.array(plane["point_m"]) + u * np.cross(up, normal) + v * up
        q, _ = robot.causal("T", "q")(T)
        d = T - (np.array(robot.A) + q[:, None] * np.array(robot.v))
        U = d / np.linalg.norm(d, axis=1, keepdims=True)
        signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
        error = max(np.linalg.norm(np.linalg.solve(U, s * [32.0, 77.0, 54.0])) for s in signs)
        assert case["centre_um"] == pytest.approx(error, rel=1e-9)

    def test_lengths_and_spheres_are_the_same_errors(self) -> None:
        ellipsoid = {"name": "spheres", "along_um": [32.0, 77.0, 54.0], "across_um": [32.0, 77.0, 54.0]}
        lengths, support, projection = solve(
            cases=[*SMALL["cases"], ellipsoid, {**ellipsoid, "name": "iterated", "method": "projection"}]
        ).values["cases"]
        assert lengths["max_um"] == pytest.approx(support["max_um"], rel=1e-12)
        assert lengths["max_um"] == pytest.approx(projection["max_um"], rel=1e-4)
        assert projection["method"] == "iterative projection" and support["method"] == "the support function"

    def test_method_for_all_cases(self) -> None:
        case = {"name": "case 2", "along_um": [11.0, 58.0, 19.0], "across_um": [28.0, 38.0, 47.0]}
        outcomes = [solve(cases=[case], method=m) for m in ("projection", "support")]
        less, bound = (outcome.values["cases"][0] for outcome in outcomes)
        assert 0.9 * bound["max_um"] < less["max_um"] < bound["max_um"]
        # the iteration is no bound: synthetic draws may exceed it, and no check says otherwise
        assert [any("monte_carlo" in name for name in outcome.checks) for outcome in outcomes] == [False, True]

    def test_errors_too_large_for_first_order_fail_their_check(self) -> None:
        outcome = solve(cases=[{"name": "huge", "length_um": [5e4, 5e4, 5e4]}])
        assert not outcome.checks["huge_first_order_against_exact"].passed
        assert outcome.status is SolveStatus.CHECK_FAILED and "huge_first" in outcome.message

    def test_errors_without_a_robot_are_not_solved(self) -> None:
        outcome = solve(cases=[{"name": "absurd", "length_um": [1e6, 1e6, 1e6]}])
        assert outcome.status is SolveStatus.FAILED and "absurd: at some points" in outcome.message
        assert "the errors are too large" in outcome.message

    @pytest.mark.parametrize("method", ["support", "projection"])
    def test_some_errors_may_be_zero(self, method: str) -> None:
        # only link 3 is wrong: the point moves across the other two
        lengths, one, along = solve(method=method, cases=[
            {"name": "lengths", "length_um": [0.0, 0.0, 10.0]},
            {"name": "balls", "along_um": [0.0, 0.0, 10.0], "across_um": [0.0, 0.0, 10.0]},
            {"name": "along", "along_um": [0.0, 5.0, 10.0], "across_um": [0.0, 0.0, 0.0]},
        ]).values["cases"]  # fmt: skip
        assert lengths["max_um"] == pytest.approx(one["max_um"], rel=1e-3)
        assert 0.0 < along["max_um"] < np.inf
        assert lengths["shape"]["faces_um2"] == [0.0, 0.0, 0.0]
        assert 2 * lengths["centre_um"] == pytest.approx(lengths["shape"]["longest_diagonal_um"], rel=1e-9)

    def test_stopped_and_out_of_reach(self) -> None:
        context = Context()
        context.request_stop()
        assert solve(context).status is SolveStatus.INTERRUPTED
        nowhere = solve(section={"step_m": 0.2, "low_m": [5.0, 5.0], "high_m": [6.0, 6.0]})
        assert nowhere.status is SolveStatus.INFEASIBLE and "outside the range" in nowhere.message


@pytest.mark.parametrize(
    ("changes", "key", "sentence"),
    [
        ({"cases": [{"name": "none"}]}, "cases[0]", "give either length_um"),
        ({"cases": [{"name": "half", "along_um": [1.0, 1.0, 1.0]}]}, "cases[0]", "give either length_um"),
        (
            {"cases": [{"name": "x", "length_um": [1.0, 1.0, 1.0], "across_um": [1.0, 1.0, 1.0]}]},
            "cases[0]",
            "give either length_um",
        ),
        (
            {"cases": [{"name": "x", "length_um": [0.0, 0.0, 0.0]}]},
            "cases[0].length_um",
            "all errors are zero; give at least one",
        ),
        ({"cases": SMALL["cases"] * 2}, "cases[1].name", "two cases are called 'lengths'"),
        ({"section": {"low_m": [0.0, 0.0], "high_m": [0.0, 1.0]}}, "section.high_m", "less than its upper"),
        ({"section": {"step_m": 1e-5}}, "section.step_m", "larger step"),
        ({"robot": "d1_nominl"}, "robot", "did you mean 'd1_nominal'"),
    ],
)
def test_what_is_refused(changes: dict, key: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        solve(**changes)
    assert caught.value.key == key and "\n" not in str(caught.value)


def test_a_start_is_refused() -> None:
    with pytest.raises(InputError, match="leave it out"):
        solve(Context(start={}))


def test_explain_names_region_and_method() -> None:
    text = accuracy.explain(load(CLONE / "problems" / "d1_accuracy.toml").problem, Context())
    assert "rectangle from (u, v) = (-5.078, -0.6949)" in text and "corners by the support function" in text


@pytest.mark.parametrize("samples", [100, 1000, 20000])
def test_few_draws_are_not_asked_to_come_near_the_corner(samples: int) -> None:
    """The farthest of so many draws of three errors that count alike: never nearer in a thousand than is asked."""
    rng = np.random.default_rng(samples)
    runs = 200
    farthest = [np.abs(rng.uniform(-1, 1, (samples, 3)).mean(axis=1)).max() for _ in range(runs)]
    assert min(farthest) >= 1 - accuracy._nearest(samples) - 0.01
    if samples == 100:
        assert np.mean(np.array(farthest) < 0.9) > 0.5  # the fixed bound refused most of them
