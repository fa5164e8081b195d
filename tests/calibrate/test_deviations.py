"""How precise a column is stands in the unit of the column; the old key, in SI, is read where that is the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.calibrate import Measured, MeasuredSignal, Measurements, read_poses
from gtmodel.problem_files import InputError
from gtmodel.results import ArgumentError

TABLE = "q[0],q[1],q[2],x,y,z\n0,0,0,500,-600,500\n10,0,0,503,-601,502\n"
Q = MeasuredSignal("q", "mm")
DIGITS = 1e-11  # twelve decimal digits are kept


def covariance(folder: Path, **signal: Any) -> np.ndarray:
    """Of T in SI, as the file is read."""
    (folder / "poses.csv").write_text(TABLE)
    signals = {"q": Q, "T": MeasuredSignal(["x", "y", "z"], **signal)}
    return read_poses(folder / "poses.csv", Measured(signals)).measurements.covariance("T", 3)[0]


@pytest.mark.parametrize(("signal", "expected"), [
    ({"unit": "mm", "deviation": 0.03}, np.diag([3e-5] * 3) ** 2),
    ({"unit": "mm", "deviation": [0.01, 0.02, 0.03]}, np.diag([1e-5, 2e-5, 3e-5]) ** 2),
    ({"unit": ["mm", "m", "um"], "deviation": [0.01, 0.02, 3.0]}, np.diag([1e-5, 2e-2, 3e-6]) ** 2),
    ({"unit": ["mm", "m", "um"], "deviation": 2.0}, np.diag([2e-3, 2.0, 2e-6]) ** 2),
    ({"unit": ["mm", "m", "mm"], "deviation": [[4.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]]},
     np.array([[4e-6, 1e-3, 0.0], [1e-3, 2.0, 0.0], [0.0, 0.0, 1e-6]])),
    ({"unit": "mm", "scale": -2.0, "deviation": 0.03}, np.diag([6e-5] * 3) ** 2),  # of the column, not the quantity
    ({"unit": "m", "noise": 3e-5}, np.diag([3e-5] * 3) ** 2),
])  # fmt: skip
def test_a_deviation_is_in_the_unit_of_its_column(tmp_path: Path, signal: dict[str, Any], expected: np.ndarray) -> None:
    """A deviation of 0.02 in a column of mm was read as 20 mm."""
    np.testing.assert_allclose(covariance(tmp_path, **signal), expected, rtol=DIGITS)


@pytest.mark.parametrize(("fields", "argument", "numbers"), [
    ({"unit": "mm", "noise": 3e-5}, "noise", ["3e-05 in SI is 0.03 mm", "deviation = 0.03"]),
    ({"unit": "deg", "noise": 0.01}, "noise", ["0.572957795131 deg"]),
    ({"unit": "mm", "noise": [[1e-6]]}, "noise", ["[[1.0]] (mm)^2"]),
    ({"unit": "m", "noise": 3e-5, "deviation": 3e-5}, "noise", []),
    ({"unit": "mm", "deviation": 0.0}, "deviation", ["0.0"]),
    ({"unit": "m", "noise": 0.0}, "noise", ["0.0"]),
    ({"unit": "mm", "deviation": [0.1, -0.1]}, "deviation", ["-0.1"]),
    ({"unit": "mm", "deviation": [[1.0, 0.0], [0.0, 0.0]]}, "deviation", ["0.0"]),
])  # fmt: skip
def test_what_is_no_deviation_of_a_column_is_refused(fields: dict[str, Any], argument: str, numbers: list[str]) -> None:
    """Zero was taken for "not stated"."""
    with pytest.raises(ArgumentError) as error:
        MeasuredSignal("T", **fields)
    assert error.value.argument == argument
    assert all(n in error.value.message for n in numbers)


def test_deviations_of_other_numbers_of_columns_are_refused_at_the_key(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError) as error:
        covariance(tmp_path, unit=["mm", "m", "mm"], deviation=[1.0, 2.0])
    assert error.value.argument == "measured.signals.T.deviation"


@pytest.mark.parametrize("size", [0.0, [1e-5, 0.0, 1e-5], np.zeros((3, 3)), np.full((4, 3, 3), -1.0)])
def test_measurements_without_error_are_refused(size: Any) -> None:
    """In memory too, when they are made and not when they are first weighed."""
    with pytest.raises(gt.lang.ModelError, match="noise of 'T'"):
        Measurements({"q": np.zeros((4, 3)), "T": np.ones((4, 3))}, noise={"T": size})


@pytest.mark.parametrize(("key", "value"), [("deviation", "0.0"), ("noise", "2e-5")])
def test_the_file_says_the_key(tmp_path: Path, key: str, value: str) -> None:
    (tmp_path / "poses.csv").write_text(TABLE)
    (tmp_path / "p.toml").write_text(
        'kind = "calibration"\nrobot = "l1_tape"\n[measurements]\nfile = "poses.csv"\n[measurements.signals]\n'
        f'q = {{ column = "q", unit = "mm" }}\nT = {{ column = ["x", "y", "z"], unit = "mm", {key} = {value} }}\n'
    )
    with pytest.raises(InputError) as error:
        gt.load(tmp_path / "p.toml")
    assert error.value.key == f"measurements.signals.T.{key}"
