"""Measurements that were read wrong: each recognised, in one sentence with the number seen; nothing is overwritten."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gtmodel.calibrate import Known, Measurements, calibration_study, study
from gtmodel.calibrate.measured import misreadings
from gtmodel.calibrate.measured.misreadings import Witness
from gtmodel.results import ArgumentError
from tests.calibrate.shipped import data, file_of, measured, robot, solved, written

Change = Callable[[list[str]], list[str]]


def order(*columns: int) -> Change:
    """The first columns in another order."""
    return lambda row: [row[k] for k in columns] + row[len(columns) :]


def refused(folder: Path, name: str = "l1", change: Change = list, rows: slice = slice(None), frame: str = "robot",
            **signals: dict) -> str:  # fmt: skip
    """What the study says of the changed poses."""
    path = written(folder, name, change, rows)
    with pytest.raises(ArgumentError) as error:
        solved(name, path, how=measured(name, signals=signals, frame=frame))
    return str(error.value)


class TestUnits:
    def test_millimetres_for_metres(self, tmp_path: Path) -> None:
        said = refused(tmp_path, T={"unit": "m"})
        assert said.startswith("poses.values.T: 'T' spans 2009 m ") and "980 times the robot's size of 2.05 m" in said
        assert said.endswith('probably in mm; if it is right, accept = ["unit"]')

    def test_metres_for_millimetres(self, tmp_path: Path) -> None:
        said = refused(tmp_path, change=lambda r: [*(repr(float(x) / 1e3) for x in r[:3]), *r[3:]])
        assert "'q' spans 0.003442 m with the declared unit mm" in said and "probably in m" in said

    def test_both_wrong_alike(self, tmp_path: Path) -> None:
        assert "probably in mm" in refused(tmp_path, q={"unit": "um"}, T={"unit": "um"})

    def test_a_factor_that_is_no_thousand(self, tmp_path: Path) -> None:
        said = refused(tmp_path, change=lambda r: [*r[:3], *(repr(float(x) / 2.54) for x in r[3:])])
        assert "'T' spreads 0.39" in said and "times as far as the robot's model predicts" in said

    def test_degrees_for_radians(self, tmp_path: Path) -> None:
        said = refused(tmp_path, "f1", q={"unit": ["mm"] * 3 + ["rad"] * 3})
        assert "17 turns: the column is probably in degrees" in said

    def test_the_files_header_contradicts(self) -> None:
        with pytest.raises(ArgumentError) as error:
            solved("l1", how=measured("l1", signals={"T": {"unit": "m"}}))
        assert error.value.message == (
            "l1_synthetic.csv line 3: 'T[0]' is in mm here and declared in m; correct one of them"
        )


class TestAxes:
    @pytest.mark.parametrize(("columns", "read"), [((1, 0, 2), "y, x, z"), ((1, 2, 0), "z, x, y")])
    def test_exchanged(self, tmp_path: Path, columns: tuple[int, ...], read: str) -> None:
        said = refused(tmp_path, change=order(0, 1, 2, *(3 + k for k in columns)))
        assert said.startswith("poses.values.T: the axes of 'T' look swapped")
        assert f"by 12.2 mm when ({read}) is read as (x, y, z)" in said
        assert ("left-handed" in said) == (columns == (1, 0, 2))  # a cyclic exchange is a turn

    def test_reversed_seen_by_a_device_that_stands_unknown(self, tmp_path: Path) -> None:
        said = refused(tmp_path, change=lambda r: [*r[:4], repr(-float(r[4])), *r[5:]], frame="device")
        assert re.search(r"'T' is left-handed: .* 681 mm rms .* 3\.7 mm when mirrored", said)

    def test_a_quaternion_with_its_scalar_last(self, tmp_path: Path) -> None:
        said = refused(tmp_path, "f1", change=lambda r: [*r[:9], *r[10:], r[9]])
        assert re.search(r"with its scalar last: .* 164 deg rms .* 8\.4 deg when", said)


class TestColumns:
    @pytest.mark.parametrize("value", ["0", "-976.4645"])
    @pytest.mark.parametrize("column", [0, 1, 2])
    def test_a_dead_channel(self, tmp_path: Path, column: int, value: str) -> None:
        said = refused(tmp_path, change=lambda r: [*r[:column], value, *r[column + 1 :]])
        assert f"q[{column}] is " in said and "at all 200 poses while the others change" in said

    @pytest.mark.parametrize("columns", [(1, 0, 2), (2, 1, 0), (1, 2, 0)])
    def test_of_arms_exchanged(self, tmp_path: Path, columns: tuple[int, ...]) -> None:
        said = refused(tmp_path, change=order(*columns))
        changed = [k for k in range(3) if columns[k] != k]
        back = [columns.index(k) for k in changed]
        assert f"the columns {', '.join(f'q[{k}]' for k in changed)} look exchanged" in said
        assert f"by 12.2 mm when read as {', '.join(f'q[{k}]' for k in back)}" in said

    @pytest.mark.parametrize("frame", ["robot", "device"])
    def test_of_actuators_and_position_exchanged(self, tmp_path: Path, frame: str) -> None:
        said = refused(tmp_path, change=order(3, 4, 5, 0, 1, 2), frame=frame)
        before, left = {"robot": ("2.09 m", "12.2 mm"), "device": ("1.04 m", "3.7 mm")}[frame]
        assert said.startswith("poses.values.q: 'q' and 'T' look exchanged: ")
        assert f"by {before} rms" in said and f"by {left} " in said and 'accept = ["exchanged_signals"]' in said

    def test_rotary_axes_of_the_f1(self, tmp_path: Path) -> None:
        every_third = slice(None, None, 3)
        said = refused(tmp_path, "f1", change=order(0, 1, 2, 4, 3), rows=every_third)
        assert "the columns q[3], q[4] look exchanged" in said

    def test_without_forward_kinematics_residuals_tell_where_lengths_are_known(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """By lengths as drawn; else by fits of all orders, or, where with all parameters free the arms of three links
        only change their names, by what moved far."""
        monkeypatch.setattr(calibration_study, "witness_of", lambda model, data: Witness(None, 2.0))
        path = written(tmp_path, "l1", order(1, 0, 2))
        with pytest.raises(ArgumentError, match=r"q\[0\], q\[1\] look exchanged: links miss by 194 mm .* as q\[1\], q"):
            solved("l1", path)
        monkeypatch.setattr(misreadings, "misread_columns", lambda *_: None)
        with pytest.raises(
            ArgumentError, match=r"q\[0\], q\[1\] look exchanged: links are left with .* read as q\[1\], q"
        ):
            solved("l1", path, fixed=["L"])
        notes = solved("l1", path).notes
        assert any(re.match(r"A\[\d,1\] moved by -?1\.3\d* m from its start value", n) for n in notes)

    def test_a_signal_of_another_size(self, tmp_path: Path) -> None:
        said = refused(tmp_path, q={"column": ["q[1]", "q[2]"]})
        assert said == "poses.values.q.column: has 2 columns; 'q' of the robot has 3"


class TestRows:
    def test_too_few_for_the_unknowns(self, tmp_path: Path) -> None:
        """Said, with what they leave open, and not refused."""
        few = solved("l1", written(tmp_path, "l1", rows=slice(10)), how=measured("l1"))
        said = "5 poses give 5 equations of arm[0].rod for 7 unknowns (A[0,0] to L[0]); measure at least 7"
        assert few.verdict is not None and any(s.startswith(said) for s in few.verdict)
        assert few.identifiability_after is not None and few.identifiability_after["rank"] == 15
        assert not few.intervals_hold and few.prediction_proven is not True

    @pytest.mark.parametrize(
        ("cell", "seen"), [("nan", "found 'nan'"), ("", "the cell is empty"), ("inf", "found 'inf'")]
    )
    def test_no_number(self, tmp_path: Path, cell: str, seen: str) -> None:
        _, rows = data("l1")
        first = rows[20][0]
        said = refused(tmp_path, change=lambda r: [cell if r[0] == first else r[0], *r[1:]])
        assert said.startswith("measured.file: poses.csv line 24, column 'q[0]': " + seen)

    def test_copied(self, tmp_path: Path) -> None:
        head, rows = data("l1")
        path = file_of(tmp_path / "poses.csv", head, [*rows, rows[7]])
        with pytest.raises(
            ArgumentError, match="1 of 201 poses are copies of others in every digit, the first line 204 "
        ):
            solved("l1", path)

    def test_measured_twice_is_repeatability_and_stays_in_one_half(self, tmp_path: Path) -> None:
        head, rows = data("l1")
        rng = np.random.default_rng(4)
        again = [[*r[:3], *(f"{float(x) + 0.02 * rng.standard_normal():.4f}" for x in r[3:])] for r in rows[:40]]
        o = solved("l1", file_of(tmp_path / "poses.csv", head, [*rows, *again]))
        assert o.poses == {"fitted": 120, "held_out": 120, "repeated": 40}
        # two of a pair are each a half of their difference from the mean: 0.02 sqrt(3 / 2) mm
        assert o.repeatability == pytest.approx(0.0245e-3, rel=0.25)


class TestOptions:
    @pytest.mark.parametrize(
        ("changes", "argument"),
        [
            ({"variant": "f1_unit"}, "fit.variant"),
            ({"fixed": ["Q"]}, "fit.fixed"),
            ({"priors": {"Z": Known(std=0.1)}}, "fit.priors"),
            ({"cost": "orthogonal"}, "fit.cost"),
            ({"held_out": 1}, "held_out"),
        ],
    )
    def test_wrong_ones(self, changes: dict, argument: str) -> None:
        with pytest.raises(ArgumentError) as caught:
            solved("l1", **changes)
        assert caught.value.argument == argument

    @pytest.mark.parametrize(
        ("how", "argument"),
        [
            ({"position": "Z"}, "measured.position"),
            ({"signals": {"q": {"delay": "estimate"}}}, "measured.signals.q.rate"),
            ({"signals": {"q": {"scale": 0.0}}}, "measured.signals.q.scale"),
        ],
    )
    def test_wrong_ways_to_read(self, how: dict, argument: str) -> None:
        with pytest.raises(ArgumentError) as caught:
            solved("l1", how=measured("l1", **how))
        assert caught.value.argument == argument

    def test_poses_in_memory_are_refused_by_their_names(self) -> None:
        for values, argument in (
            ({"q": np.ones((9, 3)), "T": np.ones((9, 2))}, "poses.values.T"),
            ({"q": np.ones((9, 3)), "T": np.ones((9, 3)), "Q": np.ones((9, 3))}, "poses.values.Q"),
            ({"T": np.ones((9, 3))}, "poses"),
            ({"q": np.ones((9, 3))}, "poses"),
        ):
            with pytest.raises(ArgumentError) as caught:
                study(robot("l1"), Measurements(values))
            assert caught.value.argument == argument
