"""The hexapod as a declared calibration: one recording fitted and held out, the other judged with offsets of its own.

Recordings: Jugglebot project (Project-DeepBlue-Juggling/Jugglebot, MIT licence); see tests/calibrate/test_hexapod.py.
"""

import tomllib

import numpy as np
import pytest

from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer
from gtmodel.results import SolveStatus
from tests.calibrate.hexapod import PROBLEMS

LEG_MM = 0.45  # rms on the fitted half: the bound
PRINTED = 1e-6  # m: digits of the parameters in judge_hexapod.toml


def solved(name: str, *settings: str):
    loaded = load(PROBLEMS / name, ["sensitivity_step=0", *settings])
    return answer(loaded, Context(folder=PROBLEMS))


def leg_rms_mm(outcome) -> float:
    """Of the fitted poses: the objective is half the sum of squared length errors."""
    return float(1e3 * np.sqrt(2 * outcome.objective / (6 * outcome.values["poses"]["fitted"])))


@pytest.mark.parametrize("name", ["calibrate_hexapod.toml", "judge_hexapod.toml"])
def test_a_recording_that_is_not_there_is_named(name):
    with pytest.raises(InputError, match=r"there is no file 'nowhere\.csv'"):
        solved(name, "measurements.file=nowhere.csv")


def test_half_a_recording_is_fitted_and_the_other_half_foretold():
    outcome = solved("calibrate_hexapod.toml")
    values = outcome.values
    assert outcome.status is SolveStatus.SOLVED and values["poses"] == {"fitted": 54, "held_out": 54, "repeated": 0}
    assert leg_rms_mm(outcome) < LEG_MM
    assert values["fitted_mm"]["mean"] < values["held_out_mm"]["mean"] < 1.0 < values["a_priori_mm"]["mean"] / 4
    assert f"held-out error {values['held_out_mm']['mean']:.3g} mm" in outcome.message  # the headline
    assert values["prediction_proven"] and values["identifiability_after"]["rank"] == 60  # two frames besides the 48
    found = tomllib.loads(outcome.files["parameters.toml"])["parameters"]
    used = load(PROBLEMS / "judge_hexapod.toml").problem.model_dump()["parameters"]
    assert list(found) == list(used) == ["A", "B", "L0", "c"]
    for n in found:
        np.testing.assert_allclose(found[n], used[n], atol=PRINTED)


def test_the_other_recording_is_judged_with_six_offsets_and_frames_refitted():
    outcome = solved("judge_hexapod.toml")
    assert outcome.status is SolveStatus.SOLVED and len(outcome.values["unknowns"]) == 6 + 12
    assert leg_rms_mm(outcome) < LEG_MM and outcome.values["held_out_mm"]["mean"] < 0.9


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("measurements.signals.T.unit=m", "'T' spans 664 m with the declared unit m, .* the column is probably in mm"),
        pytest.param(  # two exchanged columns by their names: test_calibration_measurements.py
            'measurements.signals.n.column=["leg_length_4","leg_length_2","leg_length_6","leg_length_1","leg_length_3",'
            '"leg_length_5"]',
            "the columns leg_length_4, leg_length_6, leg_length_1, leg_length_3, leg_length_5 look exchanged: .* when "
            "read as leg_length_1, leg_length_3, leg_length_4, leg_length_5, leg_length_6",
            marks=pytest.mark.proof,
        ),
    ],
)
def test_a_wrong_unit_and_a_wrong_order_of_legs_are_recognised(setting, sentence):
    with pytest.raises(InputError, match=sentence):
        solved("calibrate_hexapod.toml", setting)
