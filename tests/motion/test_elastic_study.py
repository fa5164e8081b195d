"""The elastic study, called on objects: the three roads to a tool at rest, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.motion.elastic import ElasticMesh, ElasticSolver, ElasticTool, elastic_study, plans
from gtmodel.motion.elastic.swing_study import RATIOS
from gtmodel.results import ArgumentError, SolveStatus

START, GOAL = [0.0, -0.9, 0.1], [0.9, -0.9, 0.45]
TOOL = ElasticTool(mass=5.0, frequency=6.0, damping=0.02)
FORCE = 700.0
COARSE = 24
HALF = 0.5 / 6.0 / np.sqrt(1 - 0.02**2)  # a period of the swing [s]


@pytest.fixture(scope="module")
def l1():
    return gt.robots.gantry_tau("l1_tape")


def studied(robot, tool=TOOL, start=START, goal=GOAL, force=FORCE, **options):
    return elastic_study(robot, start, goal, tool, force=force, **{"mesh": ElasticMesh(COARSE), **options})


@pytest.fixture(scope="module")
def found(l1):
    return studied(l1)


@pytest.fixture(scope="module")
def coarse(l1):
    """On 24 elements whatever they leave."""
    return studied(l1, mesh=ElasticMesh(COARSE, COARSE))


def test_the_barrier_strategy_reaches_the_solver(l1, monkeypatch) -> None:
    given = []

    def recorded(*args, **options):
        given.append(options["solver"].barrier)
        raise InterruptedError

    monkeypatch.setattr(plans, "collocate", recorded)
    for solver in (None, ElasticSolver("monotone"), ElasticSolver("adaptive")):
        with pytest.raises(InterruptedError):
            studied(l1, solver=solver)
    assert given == ["auto", "monotone", "adaptive"]


def test_a_coarse_mesh_is_refined_until_the_checks_hold(found, coarse) -> None:
    failed = {name for name, check in coarse.checks.items() if not check.passed}
    assert coarse.status is SolveStatus.CHECK_FAILED and coarse.elements == COARSE
    assert failed == set(plans.MENDED) and all(name in coarse.message for name in failed)
    assert COARSE < found.elements <= 160 and all(name in found.message for name in failed)
    assert any(row.value == found.elements for row in found.rows)
    for name in failed:
        assert found.checks[name].value < 0.25 * coarse.checks[name].value
    assert found.iterations > coarse.iterations  # those on both meshes


def test_shaped_and_elastic_motions_end_at_rest(found) -> None:
    assert found.status is SolveStatus.SOLVED
    m = found.motions
    assert list(m) == ["rigid", "ZV", "ZVD", "elastic"]
    assert m["rigid"]["residual_mm"] > 10.0
    for name, share in (("ZV", 1e-4), ("ZVD", 1e-4), ("elastic", 0.01)):
        assert m[name]["residual_mm"] < share * m["rigid"]["residual_mm"], name
    # the price: half a period, a period, and less than either
    assert m["ZV"]["final_time_s"] == pytest.approx(m["rigid"]["final_time_s"] + HALF)
    assert m["ZVD"]["final_time_s"] == pytest.approx(m["rigid"]["final_time_s"] + 2 * HALF)
    assert m["rigid"]["final_time_s"] <= m["elastic"]["final_time_s"] < m["ZV"]["final_time_s"]
    # robustness: three impulses before two, and a plan on the exact frequency has none
    off = {name: x["residual_10_percent_mm"] for name, x in m.items()}
    assert off["ZVD"] < off["ZV"] < off["elastic"]
    assert found.static == pytest.approx(9.81 / (2 * np.pi * 6.0) ** 2)
    assert found.resimulated_end < 5e-4
    assert found.values["static_mm"] == pytest.approx(1e3 * found.static)


def test_plans_keep_the_force_limit_at_every_instant_and_shaped_motions_that_pass_it_are_named(found) -> None:
    m = found.motions
    assert all(m[name]["peak_force_N"] <= FORCE * (1 + 1e-6) for name in ("rigid", "elastic"))  # IPOPT's tolerance
    named = {row.label.split()[0] for row in found.rows if "exceeds the force limit" in row.label}
    assert named == {name for name, x in m.items() if x["peak_force_N"] > 1.001 * FORCE}


def test_the_picture_shows_the_swing_and_what_is_left(found, monkeypatch) -> None:
    drawn = {}
    monkeypatch.setattr(
        "gtmodel.plot.motion.swing_figure",
        lambda swings, ratios, residuals, title: drawn.update(swings=swings, ratios=ratios, residuals=residuals),
    )
    found.figure("swing")
    assert list(drawn["swings"]) == list(drawn["residuals"]) == list(found.motions)
    for name, (t, x) in drawn["swings"].items():
        # after the rigid motion the drawn swing is within the envelope, after the shaped one nothing is left
        after = np.abs(x[t > found.motions[name]["final_time_s"]]).max(axis=0)
        assert 1e3 * after.max() <= found.motions[name]["residual_mm"] * 1.02 + 1e-3
        planned = drawn["residuals"][name][np.argmin(np.abs(RATIOS - 1.0))]
        assert 1e3 * planned == pytest.approx(found.motions[name]["residual_mm"])


def test_the_picture_has_both_panels(found) -> None:
    upper, lower = found.figure("swing").axes
    assert len(upper.lines) == len(lower.lines) == 4


def test_the_tool_is_carried_as_payload(l1) -> None:
    given = {"start": START, "goal": GOAL, "force": FORCE, "cost": plans.ElasticCost(), "solver": ElasticSolver()}
    task = plans.ElasticTask(robot=l1, tool=TOOL, **given)
    heavy = gt.robots.gantry_tau("l1_tape", payload=5.0)
    assert task.carrying.m_p == heavy.m_p and l1.m_p == heavy.m_p - 5.0
    assert task.models[0].m_p == heavy.m_p and task.models[1].m_p == l1.m_p


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"goal": [0.9, -0.9, 9.0]}, "goal"),
        ({"start": [0.9, -0.9, 9.0]}, "start"),
        ({"goal": START}, "goal"),
        ({"goal": [0.0, 1.0]}, "goal"),
        ({"force": 0.0}, "force"),
        ({"tool": replace(TOOL, frequency=1e6)}, "tool.frequency"),
    ],
)
def test_what_cannot_be_planned_is_named(l1, options, argument) -> None:
    with pytest.raises(ArgumentError) as caught:
        studied(l1, **options)
    assert caught.value.argument == argument


def test_robots_with_other_equations_are_refused(l1) -> None:
    class Braked(gt.robots.GantryTau):
        pass

    for robot in (Braked(**l1.__dict__["_modifiers"]), gt.robots.kr500()):
        with pytest.raises(ArgumentError) as caught:
            studied(robot)
        assert caught.value.argument == "robot"


@pytest.mark.parametrize("options", [{"mass": 0.0}, {"frequency": -1.0}, {"damping": 1.5}])
def test_tools_that_are_none_are_refused(options) -> None:
    with pytest.raises(ArgumentError) as caught:
        replace(TOOL, **options)
    assert caught.value.argument in options


def test_stopped_before_a_plan_it_says_so(l1) -> None:
    stopped = studied(l1, stop=lambda: True)
    assert stopped.status is SolveStatus.INTERRUPTED and stopped.motions is None and stopped.rows == []


def test_a_mesh_too_coarse_for_the_swing_is_named(found, coarse) -> None:
    # 24 elements in 1.1 s leave 3 % of the swing to the plan; 40 follow it
    assert len(coarse.notes) == 1 and coarse.notes[0] in str(coarse)
    assert "24" in coarse.notes[0] and "34" in coarse.notes[0] and not found.notes
    (stiff,) = plans.too_coarse(replace(TOOL, frequency=1000.0), ElasticMesh(40), 1.1)
    assert "such a stiff tool" in stiff and plans.too_coarse(TOOL, ElasticMesh(40), 1.1) == []
