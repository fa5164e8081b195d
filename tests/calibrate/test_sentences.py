"""What contradicts the poses is named: a prior, a sign, a scale of zero, many outliers; legs on held-out poses."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gtmodel.calibrate import Known, made_poses, study
from gtmodel.calibrate.report import movement
from gtmodel.calibrate.report.values import _notes
from gtmodel.inference import identifiability
from gtmodel.results import ArgumentError, SolveStatus
from gtmodel.results.suspicion import Inspection
from tests.calibrate.shipped import L1, fit, measured, robot, shipped, solved, written


def test_a_prior_far_from_the_poses_is_named() -> None:
    noisy = measured("l1", signals={"q": {"deviation": 0.1}, "T": {"deviation": 0.05}})
    outcome = solved("l1", how=noisy, priors={"L[0]": Known(value=5.0, std=1e-6), "L[1]": Known(std=1.0)})
    v = outcome.values
    contradictions = [s for s in v["notes"] if "contradicts the poses" in s]
    assert len(contradictions) == 1 and contradictions[0].startswith(
        "the prior L[0] = 5 m +- 1e-06 contradicts the poses, which give 2.047"
    )
    assert v["verdict"][-1] == f"prediction not proven: {contradictions[0]}" and v["prediction_proven"] is False
    fine = solved("l1", how=noisy, priors={"L[0]": Known(std=0.01)}).values
    assert not any("contradicts" in s for s in fine["notes"])


def test_a_note_is_shown_once() -> None:
    stated = measured("l1", signals={"q": {"deviation": 1e-3}, "T": {"deviation": 1e-3}})
    outcome = solved("l1", how=stated)
    (note,) = [s for s in outcome.notes if "residuals of the fitted poses are 57.1 times the stated noise" in s]
    (of_all,) = [s for s in outcome.verdict if s.startswith("residuals are ")]
    for sentence in (note, of_all):
        assert str(outcome).count(sentence) == outcome._repr_html_().count(sentence) == 1


def test_two_directions_in_one_sentence_are_one_note() -> None:
    said = "the data do not determine a and b apart from each other"
    nothing = SimpleNamespace(names=(), start=np.zeros(0), units=())
    problem = SimpleNamespace(
        unknowns=nothing, closure=SimpleNamespace(flat=SimpleNamespace(bindings={})), values=lambda x: {}
    )
    c = SimpleNamespace(
        estimate=SimpleNamespace(notes=(said, said)), x=np.zeros(0), values={}, problem=problem,
        status=SolveStatus.SOLVED,
    )  # fmt: skip
    silent = SimpleNamespace(reasons=(), notes=(), coloured=False)
    nothing_else = {
        "priors": [],
        "outliers": [],
        "suspect": "",
        "parts": (),
        "refitted": None,
        "far": [],
        "inspection": Inspection(),
        "left": ({}, []),
    }
    nothing_else |= {"after": None, "apart": None}
    findings = SimpleNamespace(calibration=c, confidence=silent, lines=range(9), **nothing_else)
    assert _notes(findings) == [said]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("q", "sentence"),
    [
        ({"scale": 0.0}, "other than 0"),
        ({"scale": -1.0}, r"q\[0\], q\[1\], q\[2\] look reversed: .* 12\.\d mm with the other sign"),
    ],
)
def test_scales_that_cannot_be(q, sentence) -> None:
    with pytest.raises(ArgumentError, match=sentence):
        solved("l1", how=measured("l1", signals={"q": q}))


def test_one_cart_that_counts_the_other_way(tmp_path: Path) -> None:
    path = written(tmp_path, "l1", lambda r: [r[0], str(-float(r[1])), *r[2:]])
    with pytest.raises(ArgumentError, match=r"the column q\[1\] looks reversed"):
        solved("l1", path)


def test_many_outliers_are_said(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)

    def spoilt(row: list[str]) -> list[str]:
        return row if rng.uniform() > 0.3 else [*row[:5], str(float(row[5]) + 5.0 * rng.standard_normal())]

    v = solved("l1", written(tmp_path, "l1", spoilt), loss="cauchy").values
    assert any("poses" in s and "have outliers, too many for chance" in s for s in v["notes"])
    assert not any("seldom chance" in s for s in shipped("l1").values["notes"])


def test_legs_on_held_out_poses_are_a_value() -> None:
    v = shipped("l1").values
    assert list(v["held_out_link_rms_mm"]) == list(v["link_errors_mm"])
    for link, rms in v["held_out_link_rms_mm"].items():
        assert 0.8 * v["link_errors_mm"][link] < rms < 2.0 * v["link_errors_mm"][link]
    assert solved("l1", held_out=0).values["held_out_link_rms_mm"] is None


def test_guideway_errors_alone_keep_their_intervals() -> None:
    """Synthetic L1, seed 1, without shifts by load: smooth errors explain the residuals, and the truth is inside."""
    made = made_poses(robot("l1"), replace(L1, load=0.0, point_error=1e-3, poses=120))
    v = study(robot("l1"), made, fit("l1")).values
    assert v["intervals_hold"] and v["colour_tested"]
    assert any(s.startswith("residuals depend on the cart positions") for s in v["notes"])
    assert any("noise of this recording and smooth errors of the carts" in s for s in v["verdict"])
    inside = [u["interval_95"][0] <= v["truth"][u["name"]] <= u["interval_95"][1] for u in v["unknowns"]]
    assert sum(inside) >= 18  # of 21 in three arms of some three independent intervals


def test_few_poses_are_said_to_be_untested(tmp_path: Path) -> None:
    v = solved("l1", written(tmp_path, "l1", rows=slice(None, None, 5))).values
    assert v["poses"]["fitted"] == 20 and not v["colour_tested"] and v["intervals_hold"]
    assert any("20 fitted poses are too few to test whether residuals are coloured" in s for s in v["notes"])
    assert any("95 % intervals cover the noise of this recording; 20 poses are too few" in s for s in v["verdict"])


def test_what_is_undetermined_is_said_with_the_movement_that_was_seen() -> None:
    """A parameter of a free gauge that moved by 9 m stays near nothing; one that was determined is not named."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        names = ("a", "b", "c")
        J = np.column_stack([np.ones(6), np.ones(6), rng.standard_normal(6)])  # a + b alone is told, and c
        start, moved = rng.standard_normal(3), 10.0 ** rng.uniform(-3, 1, 3)
        unknowns = SimpleNamespace(names=names, start=start, units=("m", "m", "rad"))
        c = SimpleNamespace(x=start + moved, problem=SimpleNamespace(unknowns=unknowns))
        determined = identifiability(1e3 * J, names, scale=np.ones(3))
        sentence = movement.undetermined(c, determined)  # type: ignore[arg-type]
        farthest = int(np.argmax(moved[:2]))
        assert (
            f"{names[farthest]} moved farthest, by {moved[farthest]:.3g} m" in sentence
            and "among 2 such parameters" in sentence
        )
        assert "near" not in sentence


def test_parameters_that_drift_together_are_named_together() -> None:
    """Offsets along parallel axes: their sum is determined alone, or hardly their difference."""
    names, rng = ("a", "d[1]", "d[2]"), np.random.default_rng(6)
    for near in (0.0, 1e-7):
        J = np.column_stack([rng.standard_normal(8), np.ones(8), np.ones(8) + near * rng.standard_normal(8)])
        determined = identifiability(J / 1e-5, names, scale=np.full(3, 1e-3))
        assert determined.redundant + len(determined.near) == 1
        for moved, said in (([0.0, 9.45, -9.4499], 1), ([2e-3, 5e-3, -5e-3], 0), ([3.0, 0.05, 0.05], 0)):
            unknowns = SimpleNamespace(names=names, start=np.zeros(3), units=("m",) * 3)
            c = SimpleNamespace(x=np.array(moved), problem=SimpleNamespace(unknowns=unknowns))
            sentences = movement.drifted(c, determined)  # type: ignore[arg-type]
            assert len(sentences) == said
            if said:
                assert "d[1] by 9.45 m" in sentences[0] and "d[2] by -9.45 m" in sentences[0]
                assert ("do not determine" if not near else "no better than prior knowledge") in sentences[0]
