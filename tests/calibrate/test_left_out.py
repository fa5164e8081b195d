"""Poses left out in turn: equal to refits by hand, judged by what a sound model has."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from gtmodel.calibrate import Choice, Fit, calibrate, folds_of, leave_out, prepare, study
from gtmodel.results import ArgumentError, SolveStatus
from tests.calibrate.drawn import drawing, drawn, poses_of


def fitted(kind: str, seed: int, poses: int, choice: Choice | None = None, unmodelled: float = 0.0):
    m = poses_of(kind, drawn(kind, seed, poses, unmodelled)).measurements
    return calibrate(prepare(drawing(kind, seed), m, choice)), m


DELTA = Choice(fixed=["angle[2]"])


@pytest.mark.parametrize("count", [None, 3])
def test_it_equals_refits_by_hand(count: int | None) -> None:
    c, m = fitted("delta", 1, 12, DELTA)
    folds = folds_of(12, count)
    left = leave_out(c, folds)
    assert sorted(k for f in left.folds for k in f.tolist()) == list(range(12))
    for fold in folds:
        rest = [k for k in range(12) if k not in fold]
        by_hand = calibrate(drawing("delta", 1), m.part(rest), DELTA).positioning_errors(m.part(fold))
        np.testing.assert_allclose(left.errors["T"][fold], by_hand["T"], rtol=0, atol=1e-12)


def test_linear_leverages_foretell_the_errors_of_the_refits() -> None:
    """To the first order a pose that is left out is missed by r / (1 - h), of its residual r and leverage h."""
    c, m = fitted("delta", 2, 20, DELTA)
    u, J = c.problem.unknowns, c.problem.jacobian(c.x)
    A = J.reshape(-1, J.shape[2]) * u.sizes
    H = A @ np.linalg.pinv(A)
    for k in (0, 7, 13):
        rows = slice(3 * k, 3 * k + 3)
        missed = np.linalg.solve(np.eye(3) - H[rows, rows], c.residuals[k])
        rest = np.setdiff1d(np.arange(20), [k])
        again = calibrate(c.problem.on(m.part(rest))).on(m.part([k]))[0]
        np.testing.assert_allclose(again, missed, rtol=1e-2, atol=1e-8)


def test_sound_models_have_the_ratio_that_is_expected_and_pass() -> None:
    judged = [leave_out(fitted("three_link", seed, 14)[0]).judged for seed in range(12)]
    assert all(j.passed for j in judged)
    rms = np.sqrt(np.mean([j.ratio**2 for j in judged]))
    assert rms > 2 and np.mean([j.expected for j in judged]) == pytest.approx(rms, rel=0.15)


def test_poses_at_the_same_actuators_stay_together_and_wrong_folds_are_refused() -> None:
    assert [f.tolist() for f in folds_of(5, None, [np.array([1, 4])])] == [[0], [1, 4], [2], [3]]
    with pytest.raises(ArgumentError, match="9 folds of 5 poses; take from 2 to 5"):
        folds_of(5, 9)
    c, _ = fitted("delta", 1, 6, DELTA)
    with pytest.raises(ArgumentError, match="stopped after 0 of 6 refits"):
        leave_out(c, stop=lambda: True)
    with pytest.raises(ArgumentError, match="one table of measurements"):
        leave_out(replace(c, problem=replace(c.problem, beside=(c.problem,))))


class TestStudy:
    """Nine parameters of a delta printer from ten poses, all fitted."""

    ASKED = Fit(fixed=["angle[2]"], sensitivity_step=0.0)

    def solved(self, method: Literal["leave_one_out", "folds"], folds: int = 10, effect: float = 0.0, **more: Any):
        poses = poses_of("delta", drawn("delta", 4, 10, effect))
        return study(drawing("delta", 4), poses, self.ASKED, method=method, folds=folds, **more), poses

    def test_headline_table_and_verdict_are_of_poses_left_out(self) -> None:
        s, poses = self.solved("leave_one_out")
        assert s.poses == {"fitted": 10, "held_out": 10, "repeated": 0}
        c = calibrate(drawing("delta", 4), poses.measurements, DELTA)
        left = leave_out(c)
        assert s.held_out is not None and s.held_out["rms"] == pytest.approx(
            np.sqrt(np.mean(np.sum(left.errors["T"] ** 2, axis=1))), rel=1e-6
        )
        assert s.checks["held_out_over_fitted"].value == pytest.approx(left.judged.ratio, rel=1e-6)
        assert s.prediction_proven and s.verdict is not None
        assert s.verdict[-1].startswith("prediction proven on 10 poses by cross-validation: mean 0.0")
        assert s.files["poses.csv"].count("left out in turn") == 10

    def test_folds_and_an_effect_that_is_lacking(self) -> None:
        s, _ = self.solved("folds", 5)
        assert s.verdict is not None and "10 poses by cross-validation in 5 folds" in s.verdict[-1]
        wrong, _ = self.solved("folds", 5, effect=5.0)
        assert wrong.prediction_proven is False

    def test_interrupted_it_claims_nothing(self) -> None:
        asked = iter([False] * 12)
        s, _ = self.solved("leave_one_out", stop=lambda: not next(asked, False) and next(asked, None) is None)
        assert s.status is SolveStatus.INTERRUPTED and s.prediction_proven is not True

    def test_what_does_not_go_together_is_refused(self) -> None:
        poses = poses_of("delta", drawn("delta", 4, 10))
        held = replace(poses, held_out=np.arange(10) > 6)
        for given, sentence in (([poses, poses], "one table of measurements"), (held, "holds out poses already")):
            with pytest.raises(ArgumentError, match=sentence):
                study(drawing("delta", 4), given, self.ASKED, method="leave_one_out")
