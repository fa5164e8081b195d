"""A calibration that is stopped, and one whose held-out poses do not all close."""

from dataclasses import replace

import numpy as np
import pytest

from gtmodel.calibrate import CalibrationStudy, Choice, Cost, calibrate, prepare, read_poses, study
from gtmodel.calibrate.report import findings
from gtmodel.results import SolveStatus
from tests.calibrate.shipped import MEASURED, fit, path_of, robot, solved
from tests.calibrate.synthetic import measured, true_robot


def stopped_after(asked: int) -> CalibrationStudy:
    """The shipped L1, asked to stop once so many questions were answered with no."""
    answers = iter([False] * asked)
    return study(robot("l1"), read_poses(path_of("l1"), MEASURED["l1"]), fit("l1"), stop=lambda: next(answers, True))


def test_a_stopped_fit_keeps_its_best_parameters_and_claims_nothing():
    outcome, begun = stopped_after(3), stopped_after(1)
    v = outcome.values
    assert outcome.status is SolveStatus.INTERRUPTED and "stopped after 2 iterations" in outcome.message
    assert outcome.objective is not None and begun.objective is not None and outcome.objective < begun.objective
    assert not v["numerics_sound"] and v["prediction_proven"] is None
    assert all(u["interval_95"] is None for u in v["unknowns"])


@pytest.mark.parametrize("cost", ["length", "orthogonal"])
def test_calibrate_asks_once_per_iteration(cost: Cost):
    answers = iter([False, False, True])
    problem = prepare(true_robot("three_link"), measured("three_link", 20, {"q": 1e-5, "T": 1e-5}, 3))
    start = {"A[0,0]": float(problem.unknowns.start[0]) + 0.05}
    c = calibrate(problem, cost=cost, start=start, stop=lambda: next(answers, True))
    assert c.status is SolveStatus.INTERRUPTED and c.iterations == 2 and c.estimate is None
    assert np.sum(c.residuals**2) < np.sum(c.start**2)


def test_a_pose_that_does_not_close_is_its_own_row_only():
    m = measured("three_link", 12, {"T": 1e-5}, 3)
    c = calibrate(prepare(true_robot("three_link"), m, Choice(fixed=("A", "v"))))
    good = c.positioning_errors(m)["T"]
    T = np.array(m.values["T"])
    q = np.array(m.values["q"])
    q[4] += [3.0, -3.0, 3.0]  # carts so far apart that the links cannot meet
    apart = c.positioning_errors(replace(m, values={"q": q, "T": T}))["T"]
    assert np.all(np.isnan(apart[4]))
    np.testing.assert_allclose(np.delete(apart, 4, 0), np.delete(good, 4, 0), atol=1e-12)


def test_held_out_poses_that_do_not_close_are_no_proof(monkeypatch: pytest.MonkeyPatch):
    def one_lost(*given):
        prediction = predicted(*given)
        return {n: replace(p, errors=np.vstack([np.full((1, 3), np.nan), p.errors[1:]])) for n, p in prediction.items()}

    predicted = findings._predicted
    monkeypatch.setattr(findings, "_predicted", one_lost)
    outcome = solved("l1")
    assert outcome.values["prediction_proven"] is False and not outcome.checks["held_out_poses_lost"].passed
    assert any("1 of 100 held-out poses do not close" in s for s in outcome.values["verdict"])
    assert ",," in str(outcome.files["poses.csv"])
