"""A causality on many points, called on objects: files, grids, a status for each row, D1's orientation, refusals."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.kinematics.causality import Orientation, PointGrid, causality_study, evaluation
from gtmodel.kinematics.causality.options import INCONSISTENT
from gtmodel.results import ArgumentError, SolveStatus

BOX = {"center": [1.4, -0.9, 0.3], "half_width": [0.2, 0.1, 0.1], "counts": [2, 3, 4]}
GRID = PointGrid(**BOX)
# the printed range: 0.1 to 0.5 deg; over this grid (0.18, 0.55, 0.24), to be met within 10 per cent
RANGE_DEG, PRINTED = np.array([0.18, 0.55, 0.24]), 0.1
ROUND_OFF = 1e-12


@pytest.fixture(scope="module")
def l1():
    return gt.robots.gantry_tau("l1_tape")


@pytest.fixture(scope="module")
def d1():
    return gt.robots.six_link_gantry_tau()


@pytest.fixture(scope="module")
def f1():
    return gt.robots.catalogue.make("f1")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "p.csv"


def table(study: Any) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(str(study.files["points.csv"]))))


def numbers(rows: list[dict[str, str]], name: str, unit: str, count: int = 3) -> np.ndarray:
    return np.array([[float(row[f"{name}[{k}] [{unit}]"]) for k in range(count)] for row in rows])


class TestFile:
    def test_every_row_has_its_status_and_harms_no_other(self, l1, file: Path) -> None:
        file.write_text(
            "# measured by hand\nname,T[0] [mm],T[1] [m],T[2]\n"
            "a,1400,-0.9,0.3\nb,nan,-0.9,0.3\nc,1400,9.0,0.3\nd,,-0.9,0.3\ne,1500,-0.8,0.2\n"
        )
        s = causality_study(l1, "T", "q", file)
        rows = table(s)
        assert [r["status"] for r in rows] == ["ok", "not_finite", "out_of_range", "not_finite", "ok"] == s.words
        assert [r["row"] for r in rows] == list("01234")
        q = numbers(rows, "q", "m")
        assert np.all(np.isnan(q[1:4]))
        # every number is the causality's own, to the last digit
        f = l1.causal("T", "q")
        expected = np.array([f([1.4, -0.9, 0.3])[0], f([1.5, -0.8, 0.2])[0]])
        assert np.array_equal(q[[0, 4]], expected) and np.array_equal(s.targets["q"], q, equal_nan=True)
        assert np.array_equal(numbers(rows, "T", "m")[[0, 4], 0], [1.4, 1.5])
        assert s.status is SolveStatus.SOLVED and s.count == 5
        assert s.statuses == {"ok": 2, "out_of_range": 1, "not_finite": 2}
        assert np.array_equal(s.ranges["q"]["min"], expected.min(axis=0))
        assert np.array_equal(s.ranges["q"]["max"], expected.max(axis=0))
        assert s.message == "2 of 5 points have a solution; 1 out of range, 2 not finite"
        assert s.figure("targets").axes

    def test_what_was_written_can_be_read_and_goes_back(self, l1, file: Path) -> None:
        there = causality_study(l1, "T", "q", GRID)
        file.write_text(str(there.files["points.csv"]))
        back = causality_study(l1, ["q"], ["T"], file)
        assert back.statuses == {"ok": 24}
        assert np.max(np.abs(there.known["T"] - back.targets["T"])) < ROUND_OFF

    def test_velocities_come_from_columns(self, l1, file: Path) -> None:
        head = ",".join(f"{n}[{k}]" for n in ("T", "der(T)") for k in range(3))
        file.write_text(f"{head}\n1.4,-0.9,0.3,0.1,0.2,0.3\n")
        s = causality_study(l1, "T", ["q", "der(q)"], file)
        f = l1.causal("T", "der(q)")
        expected = f([1.4, -0.9, 0.3], [0.1, 0.2, 0.3])[0]
        assert np.array_equal(numbers(table(s), "der(q)", "m/s")[0], expected)
        given = {"T": [[1.4, -0.9, 0.3]], "der(T)": [[0.1, 0.2, 0.3]]}
        assert causality_study(l1, "T", ["q", "der(q)"], given).files == s.files

    def test_no_row_in_reach_is_not_solved(self, l1) -> None:
        s = causality_study(l1, "T", "q", [[9, 9, 9], [np.nan, 0, 0]])
        assert s.status is SolveStatus.INFEASIBLE and s.ranges["q"] == {"min": None, "max": None}
        assert s.words == ["out_of_range", "not_finite"]

    @pytest.mark.parametrize(
        "text",
        [
            "",
            "T[0],T[1],T[2]\n",
            "T[0],T[1],t[2]\n1,2,3\n",
            "a,b\n1,2\n",
            "T[0] [kg],T[1],T[2]\n1,2,3\n",
            "T[0] [furlong],T[1],T[2]\n1,2,3\n",
            "T[0],T[1],T[2]\n1,2\n",
            "T[0],T[1],T[2]\n1,two,3\n",
            "T[0];T[1];T[2]\n1;2,5;3\n",
            "T[0],T[1],T[2],T[0] [mm]\n1,2,3,4\n",
            "T[0],T[1],T[2]\n1,1_4.22e-1,3\n",
            'T[0],T[1],T[2]\n1,2,3\n1,"2,3\n',
        ],
    )
    def test_wrong_files(self, l1, file: Path, text: str) -> None:
        file.write_text(text)
        with pytest.raises(ArgumentError) as caught:
            causality_study(l1, "T", "q", file)
        assert caught.value.argument == "points" and "p.csv" in caught.value.message


class TestKnownValues:
    def test_a_rounded_quaternion_is_brought_to_length_one(self, f1) -> None:
        rounded = np.round(f1.home_e, 3)
        assert 1e-5 < abs(np.linalg.norm(rounded) - 1.0) < 1e-3
        s = causality_study(f1, ["T", "e"], "q", {"T": [f1.home] * 2, "e": [f1.home_e, rounded]})
        assert s.words == ["ok", "ok"] and s.normalised == 1
        assert ("normalised quaternions", 1, "") in s.rows
        q, _ = f1.causal(["T", "e"], "q")(f1.home, rounded / np.linalg.norm(rounded))
        assert np.max(np.abs(s.targets["q"][1] - q)) < ROUND_OFF

    def test_what_breaks_a_condition_is_not_beyond_reach(self, f1) -> None:
        T, e = np.array([f1.home, np.add(f1.home, 9.0)]), np.array([np.multiply(f1.home_e, 1.01), f1.home_e])
        s = causality_study(f1, ["T", "e"], "q", {"T": T, "e": e})
        assert s.words[0] == INCONSISTENT and s.words[1] in ("out_of_range", "not_converged")
        assert s.status is SolveStatus.INFEASIBLE and s.statuses[INCONSISTENT] == 1
        assert "1 inconsistent known values (row 0: the known values do not satisfy" in s.message

    def test_a_vector_of_four_without_that_condition_stays(self) -> None:
        class Four(gt.Model):
            w = gt.variable(4, unit="1")
            y = gt.variable(unit="1")

            def equations(self):
                w = self.w
                yield w[0] + w[1] + w[2] + w[3] == 1
                yield self.y == 2 * w[0]

        w = [[1, 0, 0, 0], [1.0005, 0, 0, 0], [0.6, 0.3, 0, 0], [0.7071, 0.7071, 0, 0]]
        assert causality_study(Four(), "w", "y", w).words == ["ok", *[INCONSISTENT] * 3]


class TestGrid:
    def test_points_of_the_box(self, l1) -> None:
        T = causality_study(l1, "T", "q", GRID).known["T"]
        expected = [[x, y, z] for x in (1.2, 1.6) for y in (-1.0, -0.9, -0.8) for z in np.linspace(0.2, 0.4, 4)]
        assert np.max(np.abs(T - expected)) < ROUND_OFF

    def test_no_number_no_row(self, d1) -> None:
        # no place is reached in both layers
        s = causality_study(d1, "T", "q", PointGrid(**{**BOX, "center": [9.0, 9.0, 9.0]}), orientation=Orientation("R"))
        assert not any("layers" in row[0] or "ZYZ" in row[0] for row in s.rows)
        assert not any("nan" in str(row[1]) for row in s.rows)

    def test_interrupted_rows_say_so(self, l1, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(evaluation, "CHUNK", 10)
        told: list[float | None] = []
        s = causality_study(
            l1, "T", "q", GRID, progress=lambda stage=None, fraction=None, numbers=None: told.append(fraction),
            stop=lambda: bool(told),
        )  # fmt: skip
        assert s.status is SolveStatus.INTERRUPTED and s.statuses == {"ok": 10, "not_computed": 14}
        assert s.words[9:11] == ["ok", "not_computed"] == [r["status"] for r in table(s)][9:11]

    def test_chunks_change_nothing(self, l1, monkeypatch: pytest.MonkeyPatch) -> None:
        whole = causality_study(l1, "T", "q", GRID).files
        monkeypatch.setattr(evaluation, "CHUNK", 7)
        assert causality_study(l1, "T", "q", GRID).files == whole

    def test_the_other_side_by_branches(self, l1) -> None:
        # arm 1's cart ahead of the plate: the other root of its quadratic
        ahead, behind = (
            causality_study(l1, "T", "q", GRID, branches={"arm[0].ahead": s}).targets["q"] for s in (1, -1)
        )
        assert np.all(ahead[:, 0] < behind[:, 0]) and np.array_equal(ahead[:, 1:], behind[:, 1:])


class TestOrientation:
    def test_the_printed_range(self, d1) -> None:
        """Dressler 2012, section 4.2, over the grid of the shipped problem."""
        box = PointGrid(
            center_where={"q": [0.0, 0.0, 0.0]}, half_width=[0.6, 0.5, 0.5], counts=[6, 11, 11],
            directions=[[0.997665, -0.066013, -0.005268], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        )  # fmt: skip
        s = causality_study(d1, "T", ["q", "e"], box, orientation=Orientation("e"))
        assert s.status is SolveStatus.SOLVED and s.statuses == {"ok": 726} and s.zyz_singular_rows == 0
        assert np.max(np.abs(np.degrees(s.zyz_range) / RANGE_DEG - 1)) < PRINTED
        assert s.zyz_layer_range.shape == (6, 3) and np.max(s.layer_difference) < 0.05
        rows = table(s)
        angles, e = numbers(rows, "zyz", "deg"), numbers(rows, "e", "1", 4)
        assert np.max(np.abs(angles - Rotation.from_quat(e[:, [1, 2, 3, 0]]).as_euler("ZYZ", degrees=True))) < 1e-10
        assert np.allclose(np.ptp(angles, axis=0), np.degrees(s.zyz_range), atol=1e-10)
        layers = s.figure("orientation_layers")
        assert len([a for a in layers.axes if a.get_ylabel() == "z [m]"]) == 3
        line = s.figure("orientation_points").axes[1].get_lines()[0].get_ydata()
        # the path goes on from layer to layer without a jump: the next layer begins where the last one ended in yz
        assert np.max(np.abs(np.diff(np.asarray(line)))) < 0.2 * np.ptp(angles[:, 1])

    def test_rows_out_of_reach(self, d1) -> None:
        T = np.array(d1.home) + np.array([[0, 0, 0], [0, 9, 0], [np.nan, 0, 0], [0.1, 0.1, 0.1]])
        s = causality_study(d1, "T", "q", T, orientation=Orientation("R", rotation_vector=True))
        rows = table(s)
        assert s.ok.tolist() == [True, False, False, True] and s.words[2] == "not_finite"
        angles, turns = numbers(rows, "zyz", "deg"), numbers(rows, "rotation_vector", "deg")
        assert np.all(np.isnan(angles[1:3])) and np.all(np.isfinite(angles[[0, 3]]))
        first, last = (Rotation.from_euler("ZYZ", a, degrees=True) for a in angles[[0, 3]])
        expected = (last * first.inv()).as_rotvec(degrees=True)
        # one of the two is the reference, and its turn is zero
        assert np.allclose(turns[3] - turns[0], expected, atol=1e-9)
        assert not any("R[" in name for name in rows[0])  # asked for as an orientation, not as a target
        assert s.layer_difference is None and "orientation_layers" not in s.figures
        assert s.figure("orientation_points").axes and s.figure("targets").axes


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"known": ["Q"]}, "known[0]"),
        ({"targets": ["q", "quat"]}, "targets[1]"),
        ({"known": ["T", "q"]}, "known"),
        ({"targets": ["der(q)"]}, "targets"),
        ({"branches": {"plate": 1}}, "branches"),
        ({"orientation": Orientation()}, "orientation.of"),
        ({"orientation": Orientation("tau")}, "orientation.of"),
        ({"points": PointGrid(**{**BOX, "center": None})}, "points.center"),
        ({"points": PointGrid(**BOX, center_where={"q": [0.0, 0.0, 0.0]})}, "points.center"),
        ({"points": PointGrid(**{**BOX, "counts": [200, 200, 200]})}, "points.counts"),
        ({"points": PointGrid(**BOX, directions=[[1.0, 0.0, 0.0]] * 3)}, "points.directions"),
        (
            {"points": PointGrid(**{**BOX, "center": None}, center_where={"q": [0.0, 50.0, 0.0]})},
            "points.center_where",
        ),
        ({"points": PointGrid(**{**BOX, "center": None}, center_where={"q": [0.0, 0.0]})}, "points.center_where"),
        ({"points": {"q": [[0.0, 0.0, 0.0]]}}, "points"),
        ({"points": [0.0, 0.0, 0.0]}, "points"),
        ({"points": [[0.0, 0.0, 0.0]], "targets": ["der(q)"]}, "points"),
        (
            {"points": {"T": [[0.0, 0.0, 0.0]], "der(T)": [[0.0, 0.0, 0.0]] * 2}, "targets": ["der(q)"]},
            "points",
        ),
    ],
)
def test_what_cannot_be_used_is_named(l1, changes: dict[str, Any], argument: str) -> None:
    given = {"known": "T", "targets": "q", "points": GRID, **changes}
    with pytest.raises(ArgumentError) as caught:
        causality_study(l1, **given)
    assert caught.value.argument == argument and len(str(caught.value).splitlines()) == 1
