"""The compliance study, called on objects."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compliance import (
    ArmSprings,
    CartSprings,
    ComplianceMap,
    FrameSprings,
    Load,
    RodSprings,
    Springs,
    arm_poses,
    softest_and_stiffest,
    study,
    translational_compliance,
)  # fmt: skip
from gtmodel.results import ArgumentError, SolveStatus

COARSE = 0.3
FORCE = [300.0, 200.0, -300.0]
RODS = RodSprings(modulus=7e10, outer_diameter=0.04, inner_diameter=0.036, joint=1e8)
ROUND_OFF = 1e-9  # sums of a dozen products


@pytest.fixture(scope="module")
def l1():
    return gt.robots.gantry_tau("l1_tape")


@pytest.fixture(scope="module")
def of_l1(l1):
    springs = Springs(RODS, CartSprings(drive=1e7, across=5e7), FrameSprings(along=2e7, across=3e7))
    return study(l1, springs, Load(FORCE), map=ComplianceMap(step=COARSE))


def test_stiffness_deflection_and_work_belong_together(of_l1):
    s = of_l1
    assert s.status is SolveStatus.SOLVED and all(check.passed for check in s.checks.values())
    np.testing.assert_allclose(s.compliance @ FORCE, s.deflection, rtol=ROUND_OFF)
    np.testing.assert_allclose(1 / np.linalg.eigvalsh(s.compliance)[::-1], s.stiffness, rtol=ROUND_OFF)
    assert s.work == pytest.approx(np.dot(FORCE, s.deflection) / 2)
    assert sum(s.shares.values()) == pytest.approx(1.0) and s.rotation is None
    assert np.all(np.diff(s.frequencies) > 0)
    for name in ("softest_N_m", "deflection_m", "frequency_Hz"):
        assert s.map[name]["least"] < s.map[name]["greatest"]
    rows = s.files["map.csv"].splitlines()
    assert rows[0] == "u_m,v_m,x_m,y_m,z_m,softest_N_m,deflection_m,frequency_Hz"
    assert len(rows) == 1 + s.map["points"] and "nan" not in s.files["map.csv"]


def test_pictures_draw_what_was_mapped(of_l1, monkeypatch):
    assert {*of_l1.figures} == {"softest", "deflection", "frequency", "shares"}
    assert all(of_l1.figure(name).axes for name in of_l1.figures)
    drawn = []
    monkeypatch.setattr("gtmodel.plot.compliance.map_figure", lambda u, v, values, **_: drawn.append(values))
    for name, column, scale in (("softest", "softest_N_m", 1e-6), ("deflection", "deflection_m", 1e6)):
        of_l1.figure(name)
        assert np.nanmax(drawn[-1]) == pytest.approx(scale * of_l1.map[column]["greatest"])


def test_nothing_changes_along_parallel_guideways(l1, of_l1):
    springs = Springs(RODS, CartSprings(drive=1e7, across=5e7), FrameSprings(along=2e7, across=3e7))
    there = [of_l1.pose[0] + 1.0, *of_l1.pose[1:]]
    moved = study(l1, springs, Load(FORCE), pose=there, map=ComplianceMap(step=COARSE, along=there[0]))
    np.testing.assert_allclose(moved.compliance, of_l1.compliance, rtol=ROUND_OFF)
    assert moved.map["softest_N_m"]["least"] == pytest.approx(of_l1.map["softest_N_m"]["least"])


def test_drives_alone_take_all_the_work(l1):
    found = study(
        l1, Springs(RodSprings(stiffness=1e15), CartSprings(drive=1e7)), Load(FORCE), map=ComplianceMap(step=COARSE)
    )
    assert found.shares["drives"] == pytest.approx(1.0, abs=1e-6)


def test_an_arm_is_as_soft_as_its_joints_say():
    robot = gt.robots.kr500()
    k, q = [2e6, 2e6, 1.5e6, 4e5, 4e5, 2e5], np.deg2rad([0.0, -80.0, 100.0, 10.0, 40.0, 0.0])
    found = study(robot, ArmSprings(k, q.tolist()), map=ComplianceMap(step=COARSE))
    poses = arm_poses(robot, q[None], np.zeros(3))
    C = translational_compliance(poses.J, 1 / np.array(k))
    np.testing.assert_allclose(found.stiffness, softest_and_stiffest(C)[0][0], rtol=ROUND_OFF)
    assert found.frequencies is None and found.sag is None and found.shares is None
    assert "beyond the joints' limits" in found.reasons and {*found.figures} == {"softest"}


def test_joints_of_an_arm_share_the_loads_work():
    robot = gt.robots.kr500()
    k, q = np.array([2e6, 2e6, 1.5e6, 4e5, 4e5, 2e5]), np.deg2rad([0.0, -80.0, 100.0, 10.0, 40.0, 0.0]).tolist()
    load, coarse, tool = Load(FORCE, [10.0, -20.0, 5.0]), ComplianceMap(step=0.5), [0.1, 0.05, 0.4]
    found = study(robot, ArmSprings(k.tolist(), q, tool), load, map=coarse)
    assert list(found.shares) == [f"joint_{n}" for n in range(1, 7)]
    assert sum(found.shares.values()) == pytest.approx(1.0)
    for n in (0, 2, 4):  # by itself, among joints that are as good as rigid
        alone = study(robot, ArmSprings(np.where(np.arange(6) == n, k, 1e20).tolist(), q, tool), load, map=coarse)
        assert found.shares[f"joint_{n + 1}"] == pytest.approx(alone.work / found.work, rel=1e-9)
    row = next(row.value for row in found.rows if row.label == "shares of the work of the load")
    assert row.startswith("joint 1 ") and row.count("%") == 6
    bars = found.figure("shares").axes[0].patches
    assert [round(b.get_width() / 100, 6) for b in bars[::-1]] == [round(x, 6) for x in found.shares.values()]


RIGID = Springs(RodSprings(stiffness=1e7))


@pytest.mark.parametrize(
    ("springs", "options", "argument"),
    [
        (Springs(RodSprings(joint=1e8)), {}, "springs.links"),
        (Springs(RodSprings(stiffness=1e7, modulus=7e10)), {}, "springs.links"),
        (Springs(RodSprings(stiffness=1e7, inner_diameter=0.1)), {}, "springs.links"),
        (Springs(RodSprings(stiffness=[1e7, 1e7])), {}, "springs.links"),
        (Springs(RodSprings(stiffness=1e7), CartSprings(axis=1e3)), {}, "springs.carts.axis"),
        (RIGID, {"load": Load(moment=[1.0, 0.0, 0.0])}, "load.moment"),
        (RIGID, {"pose": [0.0, 0.0, 9.0]}, "pose"),
        (RIGID, {"map": ComplianceMap(low=[5.0, 0.0])}, "map.high"),
        (RIGID, {"map": ComplianceMap(step=1e-5)}, "map.step"),
        (ArmSprings([1e6] * 6, [0.0] * 6), {}, "robot"),
    ],
)
def test_what_cannot_be_used_is_named(l1, springs, options, argument):
    with pytest.raises(ArgumentError) as caught:
        study(l1, springs, **options)
    assert caught.value.argument == argument


def test_a_diameter_in_millimetres_is_refused():
    for name in ("outer_diameter", "inner_diameter"):
        with pytest.raises(ArgumentError, match=f"{name}: must be .* at most 1; found 40; give it in metres"):
            RodSprings(modulus=7e10, **{"outer_diameter": 0.04, name: 40.0})


def test_an_arm_names_its_own():
    robot = gt.robots.kr500()
    for springs, options, argument in (
        (ArmSprings([1e6], [0.0] * 6), {}, "springs.joint"),
        (ArmSprings([1e6] * 6, [0.0, -1.4, 1.7, 0.2, 0.7, 0.0]), {"pose": [9.0, 0.0, 0.0]}, "pose"),
        (RIGID, {}, "robot"),
    ):
        with pytest.raises(ArgumentError) as caught:
            study(robot, springs, **options)
        assert caught.value.argument == argument


def test_a_section_out_of_reach_says_why(l1):
    found = study(l1, RIGID, map=ComplianceMap(low=[4.0, 4.0], high=[5.0, 5.0], step=COARSE))
    assert found.status is SolveStatus.INFEASIBLE and found.message
    assert found.files == {} and found.map == {"points": 0}


def test_interrupted_it_keeps_the_reported_pose(l1):
    found = study(l1, RIGID, stop=lambda: True)
    assert found.status is SolveStatus.INTERRUPTED and len(found.stiffness) == 3 and found.map == {}
