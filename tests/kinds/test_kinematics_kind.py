"""Kind "kinematics": points from a file or a grid, a status for each row; D1's orientation; what is refused."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.kinds import kinematics
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load, validate
from gtmodel.results import SolveStatus
from tests.support.commands import CLONE, Commands

L1: dict[str, Any] = {"kind": "kinematics", "robot": "l1_tape", "known": ["T"], "targets": ["q"], "points": "p.csv"}
BOX = {"center": [1.4, -0.9, 0.3], "half_width": [0.2, 0.1, 0.1], "counts": [2, 3, 4]}
GRID: dict[str, Any] = {k: v for k, v in L1.items() if k != "points"} | {"grid": BOX}
# the printed range: 0.1 to 0.5 deg; over this grid (0.18, 0.55, 0.24), to be met within 10 per cent
RANGE_DEG, PRINTED = np.array([0.18, 0.55, 0.24]), 0.1
ROUND_OFF = 1e-12


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def solve(data: dict[str, Any], context: Context | None = None, **changes: Any):
    return kinematics.solve(validate(kinematics.Schema, {**data, **changes}), context or Context())


def table(outcome: Any) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(str(outcome.files["points.csv"]))))


def numbers(rows: list[dict[str, str]], name: str, unit: str, count: int = 3) -> np.ndarray:
    return np.array([[float(row[f"{name}[{k}] [{unit}]"]) for k in range(count)] for row in rows])


class TestFile:
    def test_every_row_has_its_status_and_harms_no_other(self, here: Path) -> None:
        (here / "p.csv").write_text(
            "# measured by hand\nname,T[0] [mm],T[1] [m],T[2]\n"
            "a,1400,-0.9,0.3\nb,nan,-0.9,0.3\nc,1400,9.0,0.3\nd,,-0.9,0.3\ne,1500,-0.8,0.2\n"
        )
        context = Context(folder=here)
        outcome = solve(L1, context)
        rows = table(outcome)
        assert [r["status"] for r in rows] == ["ok", "not_finite", "out_of_range", "not_finite", "ok"]
        assert [r["row"] for r in rows] == list("01234")
        q = numbers(rows, "q", "m")
        assert np.all(np.isnan(q[1:4]))
        # every number is the causality's own, to the last digit
        f = gt.robots.gantry_tau("l1_tape").causal("T", "q")
        expected = np.array([f([1.4, -0.9, 0.3])[0], f([1.5, -0.8, 0.2])[0]])
        assert np.array_equal(q[[0, 4]], expected)
        assert np.array_equal(numbers(rows, "T", "m")[[0, 4], 0], [1.4, 1.5])
        v = outcome.values
        assert list(v) == list(kinematics.VALUES)
        assert outcome.status is SolveStatus.SOLVED
        assert v["rows"] == 5 and v["statuses"] == {"ok": 2, "out_of_range": 1, "not_finite": 2}
        assert np.array_equal(v["ranges"]["q"]["min"], expected.min(axis=0))
        assert np.array_equal(v["ranges"]["q"]["max"], expected.max(axis=0))
        assert outcome.message == "2 of 5 points have a solution; 1 out of range, 2 not finite"
        assert context.inputs["points"] == here / "p.csv"
        assert outcome.figures["targets"]().axes

    def test_what_was_written_can_be_read_and_goes_back(self, here: Path) -> None:
        there = solve(GRID)
        (here / "p.csv").write_text(str(there.files["points.csv"]))
        back = solve(L1, known=["q"], targets=["T"])
        assert back.values["statuses"] == {"ok": 24}
        T = [numbers(table(o), "T", "m") for o in (there, back)]
        assert np.max(np.abs(T[0] - T[1])) < ROUND_OFF

    def test_velocities_come_from_columns(self, here: Path) -> None:
        head = ",".join(f"{n}[{k}]" for n in ("T", "der(T)") for k in range(3))
        (here / "p.csv").write_text(f"{head}\n1.4,-0.9,0.3,0.1,0.2,0.3\n")
        outcome = solve(L1, targets=["q", "der(q)"])
        f = gt.robots.gantry_tau("l1_tape").causal("T", "der(q)")
        assert np.array_equal(numbers(table(outcome), "der(q)", "m/s")[0], f([1.4, -0.9, 0.3], [0.1, 0.2, 0.3])[0])

    def test_no_row_in_reach_is_not_solved(self, here: Path) -> None:
        (here / "p.csv").write_text("T[0],T[1],T[2]\n9,9,9\nnan,0,0\n")
        outcome = solve(L1)
        assert outcome.status is SolveStatus.INFEASIBLE and outcome.values["ranges"]["q"] == {"min": None, "max": None}
        assert [r["status"] for r in table(outcome)] == ["out_of_range", "not_finite"]

    @pytest.mark.parametrize(
        ("text", "sentence"),
        [
            ("", r"p.csv is empty; expected a header such as 'T\[0\],T\[1\],T\[2\]' and rows"),
            ("T[0],T[1],T[2]\n", "p.csv has a header but no rows"),
            ("T[0],T[1],t[2]\n1,2,3\n", r"line 1: there is no column 'T\[2\]'; did you mean"),
            ("a,b\n1,2\n", r"there is no column 'T\[0\]'; it has a, b"),
            ("T[0] [kg],T[1],T[2]\n1,2,3\n", r"column 'T\[0\]': the unit kg does not fit; the model has it in m"),
            ("T[0] [furlong],T[1],T[2]\n1,2,3\n", r"column 'T\[0\]': .*furlong"),
            ("T[0],T[1],T[2]\n1,2\n", "line 2: found 2 cells; expected 3"),
            ("T[0],T[1],T[2]\n1,two,3\n", "line 2, column 2: found 'two'; expected a number"),
            ("T[0];T[1];T[2]\n1;2;3\n", "not separated by ','"),
            ("T[0],T[1],T[2],T[0] [mm]\n1,2,3,4\n", r"line 1: 'T\[0\]' is there twice, in columns 1 and 4; leave one"),
            ("T[0],T[1],T[2]\n1,1_4.22e-1,3\n", "line 2, column 2: found '1_4.22e-1'; expected a number"),
            ('T[0],T[1],T[2]\n1,2,3\n1,"2,3\n', r"line 3: a quote \(\"\) is not closed"),
        ],
    )
    def test_wrong_files(self, here: Path, text: str, sentence: str) -> None:
        (here / "p.csv").write_text(text)
        with pytest.raises(InputError, match=sentence) as caught:
            solve(L1)
        assert caught.value.key == "points"


class TestKnownValues:
    F1 = gt.robots.catalogue.make("f1")
    HEAD = ",".join(f"T[{k}]" for k in range(3)) + "," + ",".join(f"e[{k}]" for k in range(4))

    def inverse(self, here: Path, *rows: np.ndarray) -> Any:
        (here / "p.csv").write_text("\n".join([self.HEAD, *(",".join(map(repr, row.tolist())) for row in rows)]) + "\n")
        return solve(L1, Context(folder=here), robot="f1", known=["T", "e"])

    def test_a_rounded_quaternion_is_brought_to_length_one(self, here: Path) -> None:
        exact, rounded = (
            np.array([*self.F1.home, *self.F1.home_e]),
            np.array([*self.F1.home, *np.round(self.F1.home_e, 3)]),
        )
        assert 1e-5 < abs(np.linalg.norm(rounded[3:]) - 1.0) < 1e-3
        outcome = self.inverse(here, exact, rounded)
        assert [r["status"] for r in table(outcome)] == ["ok", "ok"]
        assert ("quaternions brought to length 1", 1, "") in outcome.rows
        q, _ = self.F1.causal(["T", "e"], "q")(rounded[:3], rounded[3:] / np.linalg.norm(rounded[3:]))
        assert np.max(np.abs(numbers(table(outcome), "q", "?", 6)[1] - q)) < ROUND_OFF

    def test_what_breaks_a_condition_is_not_beyond_reach(self, here: Path) -> None:
        long, far = np.array([*self.F1.home, *self.F1.home_e]), np.array([*self.F1.home, *self.F1.home_e])
        long[3:] *= 1.01
        far[:3] += 9.0
        outcome = self.inverse(here, long, far)
        first, second = (r["status"] for r in table(outcome))
        assert first == kinematics.INCONSISTENT and second in ("out_of_range", "not_converged")
        assert outcome.status is SolveStatus.INFEASIBLE and outcome.values["statuses"][kinematics.INCONSISTENT] == 1
        assert "1 inconsistent known values (row 0: the known values do not satisfy" in outcome.message

    def test_a_vector_of_four_without_that_condition_stays(self, here: Path) -> None:
        (here / "point.py").write_text(
            "import gtmodel as gt\n\n\nclass Four(gt.Model):\n    w = gt.variable(4, unit='1')\n"
            "    y = gt.variable(unit='1')\n\n    def equations(self):\n        w = self.w\n"
            "        yield w[0] + w[1] + w[2] + w[3] == 1\n        yield self.y == 2 * w[0]\n"
        )
        (here / "p.csv").write_text("w[0],w[1],w[2],w[3]\n1,0,0,0\n1.0005,0,0,0\n0.6,0.3,0,0\n0.7071,0.7071,0,0\n")
        outcome = solve(L1, Context(folder=here), robot="point.py:Four", known=["w"], targets=["y"])
        assert [r["status"] for r in table(outcome)] == ["ok", *[kinematics.INCONSISTENT] * 3]


class TestGrid:
    def test_points_of_the_box(self) -> None:
        T = numbers(table(solve(GRID)), "T", "m")
        expected = [[x, y, z] for x in (1.2, 1.6) for y in (-1.0, -0.9, -0.8) for z in np.linspace(0.2, 0.4, 4)]
        assert np.max(np.abs(T - expected)) < ROUND_OFF

    def test_no_number_no_row(self) -> None:
        # no place is reached in both layers
        outcome = solve(L1 | {"robot": "d1_six_link"}, points="", grid={**BOX, "center": [9.0, 9.0, 9.0]},
                        orientation={"of": "R"})  # fmt: skip
        assert not any("layers" in row[0] or "ZYZ" in row[0] for row in outcome.rows)
        assert not any("nan" in str(row[1]) for row in outcome.rows)

    def test_interrupted_rows_say_so(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(kinematics, "CHUNK", 10)
        context = Context()
        context.progress = lambda *_: context.request_stop()
        outcome = solve(GRID, context)
        assert outcome.status is SolveStatus.INTERRUPTED
        assert outcome.values["statuses"] == {"ok": 10, "not_computed": 14}
        assert [r["status"] for r in table(outcome)][9:11] == ["ok", "not_computed"]

    def test_chunks_change_nothing(self, monkeypatch: pytest.MonkeyPatch) -> None:
        whole = solve(GRID).files
        monkeypatch.setattr(kinematics, "CHUNK", 7)
        assert solve(GRID).files == whole

    def test_the_other_side_by_branches(self) -> None:
        # arm 1's cart ahead of the plate: the other root of its quadratic
        rows = [table(solve(GRID, branches={"arm[0].ahead": s})) for s in (1, -1)]
        ahead, behind = (numbers(r, "q", "m") for r in rows)
        assert np.all(ahead[:, 0] < behind[:, 0]) and np.array_equal(ahead[:, 1:], behind[:, 1:])


class TestOrientation:
    def test_declared_problem_gives_the_printed_range(self) -> None:
        loaded = load(CLONE / "problems" / "d1_orientation.toml")
        outcome = kinematics.solve(loaded.problem, Context())  # type: ignore[arg-type]
        v = outcome.values
        assert outcome.status is SolveStatus.SOLVED and v["statuses"] == {"ok": 726} and v["zyz_singular_rows"] == 0
        assert np.max(np.abs(v["zyz_range_deg"] / RANGE_DEG - 1)) < PRINTED
        assert v["zyz_layer_range_deg"].shape == (6, 3) and np.max(v["layer_difference"]) < 0.05
        rows = table(outcome)
        angles = numbers(rows, "zyz", "deg")
        e = numbers(rows, "e", "1", 4)
        assert np.max(np.abs(angles - Rotation.from_quat(e[:, [1, 2, 3, 0]]).as_euler("ZYZ", degrees=True))) < 1e-10
        assert np.allclose(np.ptp(angles, axis=0), v["zyz_range_deg"], atol=1e-10)
        layers = outcome.figures["orientation_layers"]()
        assert len([a for a in layers.axes if a.get_ylabel() == "z [m]"]) == 3
        line = outcome.figures["orientation_points"]().axes[1].get_lines()[0].get_ydata()
        # the path goes on from layer to layer without a jump: the next layer begins where the last one ended in yz
        size = np.ptp(angles[:, 1])
        assert np.max(np.abs(np.diff(np.asarray(line)))) < 0.2 * size

    def test_points_from_a_file_with_rows_out_of_reach(self, here: Path) -> None:
        d1 = gt.robots.six_link_gantry_tau()
        T = np.array(d1.home) + np.array([[0, 0, 0], [0, 9, 0], [np.nan, 0, 0], [0.1, 0.1, 0.1]])
        (here / "p.csv").write_text("T[0],T[1],T[2]\n" + "\n".join(",".join(map(str, row)) for row in T.tolist()))
        outcome = solve(L1, robot="d1_six_link", orientation={"of": "R", "rotation_vector": True})
        rows = table(outcome)
        assert [r["status"] == "ok" for r in rows] == [True, False, False, True]
        assert rows[2]["status"] == "not_finite"
        angles, turns = numbers(rows, "zyz", "deg"), numbers(rows, "rotation_vector", "deg")
        assert np.all(np.isnan(angles[1:3])) and np.all(np.isfinite(angles[[0, 3]]))
        first, last = (Rotation.from_euler("ZYZ", a, degrees=True) for a in angles[[0, 3]])
        expected = (last * first.inv()).as_rotvec(degrees=True)
        # one of the two is the reference, and its turn is zero
        assert np.allclose(turns[3] - turns[0], expected, atol=1e-9)
        assert not any("R[" in name for name in rows[0])  # asked for as an orientation, not as a target
        assert outcome.values["layer_difference"] is None and "orientation_layers" not in outcome.figures
        assert outcome.figures["orientation_points"]().axes and outcome.figures["targets"]().axes


@pytest.mark.parametrize(
    ("data", "changes", "key", "sentence"),
    [
        (GRID, {"points": "p.csv"}, "points", "either points = a CSV file or a .grid.; found both"),
        (GRID, {"grid": None}, "points", "found neither"),
        (L1, {}, "points", "there is no file 'p.csv'"),
        (GRID, {"known": ["Q"]}, "known[0]", "did you mean|has no"),
        (GRID, {"targets": ["q", "quat"]}, "targets[1]", "quat"),
        (GRID, {"known": ["T", "q"]}, "known", "equations for"),
        (GRID, {"targets": ["der(q)"]}, "targets", r"need der\(T\) too, which a grid does not give"),
        (GRID, {"branches": {"plate": 1}}, "branches", "no branch 'plate'"),
        (GRID, {"orientation": {}}, "orientation.of", "'e'"),
        (GRID, {"orientation": {"of": "tau"}}, "orientation.of", r"shape \(3,\); expected a quaternion"),
        (GRID, {"grid": {**BOX, "center": None}}, "grid.center", "either center or center_where; found neither"),
        (GRID, {"grid": {**BOX, "center_where": {"q": [0.0, 0.0, 0.0]}}}, "grid.center", "found both"),
        (GRID, {"grid": {**BOX, "counts": [200, 200, 200]}}, "grid.counts", "8000000 points are more than 1000000"),
        (GRID, {"grid": {**BOX, "counts": [2, 0, 2]}}, "grid.counts[1]", "at least 1|greater|>= 1"),
        (GRID, {"grid": {**BOX, "half_width": [0.1, 0.1]}}, "grid.half_width", "3"),
        (GRID, {"grid": {**BOX, "directions": [[1.0, 0.0, 0.0]] * 3}}, "grid", "must span space"),
        (GRID, {"robot": "d1_six_link", "inertia": "model_2"}, "inertia", "three-link robots only"),
        (GRID, {"robot": "d1_six_link", "parameters": {"LL": 1.0}}, "parameters", "no declaration 'LL'"),
    ],
)
def test_wrong_problems(here: Path, data: dict[str, Any], changes: dict[str, Any], key: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        solve(data, **changes)
    assert caught.value.key == key and len(str(caught.value).splitlines()) == 1


def test_a_centre_out_of_reach(here: Path) -> None:
    box = {k: v for k, v in BOX.items() if k != "center"}
    with pytest.raises(InputError, match="T cannot be computed there: the input lies outside") as caught:
        solve(GRID, grid={**box, "center_where": {"q": [0.0, 50.0, 0.0]}})
    assert caught.value.key == "grid.center_where"
    with pytest.raises(InputError, match="'q' takes 3 numbers; found 2"):
        solve(GRID, grid={**box, "center_where": {"q": [0.0, 0.0]}})


def test_command_line(here: Path, gtmodel: Commands) -> None:
    (here / "p.csv").write_text("T[0],T[1],T[2]\n1.4,-0.9,0.3\nnan,0,0\n1.4,9,0\n")
    (here / "p.toml").write_text(
        'kind = "kinematics"\nrobot = "l1_tape"\nknown = ["T"]\ntargets = ["q"]\npoints = "p.csv"\n'
    )
    done = gtmodel("solve", "p.toml", "--json", "--plot", "--out", "out")
    assert done.code == 0 and done.json["status"] == "solved"
    assert done.json["values"]["statuses"] == {"ok": 1, "out_of_range": 1, "not_finite": 1}
    assert sorted(p.name for p in (here / "out").iterdir()) == ["points.csv", "result.json", "run.toml", "targets.png"]
    first = (here / "out" / "points.csv").read_bytes()
    assert gtmodel("solve", "p.toml", "--out", "again").code == 0
    assert (here / "again" / "points.csv").read_bytes() == first
    assert json.loads((here / "out" / "result.json").read_text())["values"]["rows"] == 3
    assert "sphere" not in gtmodel("explain", "p.toml").out and "quadratic" in gtmodel("explain", "p.toml").out
    assert gtmodel("schema", "kinematics").code == 0
    done = gtmodel("solve", "p.toml", "--set", "targets=['w']")
    assert done.code == 2 and "targets[0]" in done.sentence
