"""Kind "elastic_motion": the three roads to a tool at rest, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.kinds import elastic_motion
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.results import SolveStatus

COARSE = "mesh.elements=24"


def solved(*changes: str):
    return elastic_motion.solve(load("problems/elastic_l1.toml", [COARSE, *changes]).problem, Context())  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def shipped():
    return solved()


@pytest.fixture(scope="module")
def coarse():
    """On 24 elements whatever they leave."""
    return solved("mesh.most_elements=24")


def test_the_barrier_strategy_reaches_the_solver(monkeypatch) -> None:
    given = []

    def recorded(*args, **options):
        given.append(options["solver"].barrier)
        raise InterruptedError

    monkeypatch.setattr(elastic_motion, "collocate", recorded)
    for settings in ((), ("solver.barrier=monotone",), ("solver.barrier=adaptive",)):
        with pytest.raises(InterruptedError):
            solved(*settings)
    assert given == ["auto", "monotone", "adaptive"]


def test_a_coarse_mesh_is_refined_until_the_checks_hold(shipped, coarse) -> None:
    failed = {name for name, check in coarse.checks.items() if not check.passed}
    assert coarse.status is SolveStatus.CHECK_FAILED and coarse.values["elements"] == 24
    assert failed == set(elastic_motion.MENDED) and all(name in coarse.message for name in failed)
    assert 24 < shipped.values["elements"] <= 160 and all(name in shipped.message for name in failed)
    assert any(row.value == shipped.values["elements"] for row in shipped.rows)
    for name in failed:
        assert shipped.checks[name].value < 0.25 * coarse.checks[name].value
    assert shipped.iterations > coarse.iterations  # those on both meshes


def test_shaped_and_elastic_motions_end_at_rest(shipped) -> None:
    assert shipped.status is SolveStatus.SOLVED and list(shipped.values) == list(elastic_motion.VALUES)
    m = shipped.values["motions"]
    assert list(m) == ["rigid", "ZV", "ZVD", "elastic"]
    assert m["rigid"]["residual_mm"] > 10.0
    for name, share in (("ZV", 1e-4), ("ZVD", 1e-4), ("elastic", 0.01)):
        assert m[name]["residual_mm"] < share * m["rigid"]["residual_mm"], name
    # the price: half a period, a period, and less than either
    half = 0.5 / 6.0 / np.sqrt(1 - 0.02**2)
    assert m["ZV"]["final_time_s"] == pytest.approx(m["rigid"]["final_time_s"] + half)
    assert m["ZVD"]["final_time_s"] == pytest.approx(m["rigid"]["final_time_s"] + 2 * half)
    assert m["rigid"]["final_time_s"] <= m["elastic"]["final_time_s"] < m["ZV"]["final_time_s"]
    # robustness: three impulses before two, and a plan on the exact frequency has none
    off = {name: x["residual_10_percent_mm"] for name, x in m.items()}
    assert off["ZVD"] < off["ZV"] < off["elastic"]
    assert shipped.values["static_mm"] == pytest.approx(1e3 * 9.81 / (2 * np.pi * 6.0) ** 2)
    assert shipped.values["resimulated_end_mm"] < 0.5


def test_plans_keep_the_force_limit_at_every_instant_and_shaped_motions_that_pass_it_are_named(shipped) -> None:
    m = shipped.values["motions"]
    assert all(m[name]["peak_force_N"] <= 700.0 * (1 + 1e-6) for name in ("rigid", "elastic"))  # IPOPT's tolerance
    named = {row.label.split()[0] for row in shipped.rows if "passes the force limit" in row.label}
    assert named == {name for name, x in m.items() if x["peak_force_N"] > 700.7}


def test_the_picture_has_both_panels_and_shows_the_swing(shipped) -> None:
    upper, lower = shipped.figures["swing"]().axes
    assert len(upper.lines) == len(lower.lines) == 4
    ends = shipped.values["motions"]
    # after the rigid motion the drawn swing is within the envelope, after the shaped one nothing is left
    for line, name in zip(upper.lines, ends, strict=True):
        t, x = (np.asarray(a) for a in line.get_data())
        after = np.abs(x[t > ends[name]["final_time_s"]])
        assert after.max() <= ends[name]["residual_mm"] * 1.02 + 1e-3


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ('robot="f1"', r"^inertia: |^robot: "),
        ("goal.tcp_m=[0.9, -0.9, 9.0]", r"^goal.tcp_m: cannot be reached: "),
        ("goal.tcp_m=[0.0, -0.9, 0.1]", r"^goal.tcp_m: is where the motion starts"),
        ("tool.frequency_Hz=1e6", r"^tool.frequency_Hz: is too fast to be followed"),
        ("tool.damping=1.5", r"tool.damping: "),
    ],
)
def test_what_cannot_be_planned_says_so(change, sentence) -> None:
    with pytest.raises(InputError, match=sentence):
        solved(change)


def test_explain_says_what_is_assumed() -> None:
    text = elastic_motion.explain(load("problems/elastic_l1.toml").problem, Context())  # type: ignore[arg-type]
    assert "5 kg on a spring, 6 Hz" in text and "follows its motion exactly" in text


def test_a_mesh_too_coarse_for_the_swing_is_named(shipped, coarse) -> None:
    # 24 elements in 1.1 s leave 3 % of the swing to the plan; the shipped 40 follow it
    (said,) = [str(row.value) for row in coarse.rows if row.label == "look at this"]
    assert not any(row.label == "look at this" for row in shipped.rows)
    assert said.startswith("mesh.elements = 24 are 3.6 to a period") and said.endswith("take at least 34")
    stiff = load("problems/elastic_l1.toml", ["tool.frequency_Hz=1000.0"]).problem
    assert "a tool so stiff hardly swings" in elastic_motion._too_coarse(stiff, 1.1)[0]  # type: ignore[arg-type]
    assert elastic_motion._too_coarse(load("problems/elastic_l1.toml").problem, 1.1) == []  # type: ignore[arg-type]
