"""The workspace study, called on objects: the L1's printed numbers, reasons, limits, pictures; and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.flat_cache import shared
from gtmodel.kinematics.mechanism import mechanism_of
from gtmodel.kinematics.workspace import Beam, Bodies, Box, CrossSection, Sections, WorkspaceLimits, workspace_study
from gtmodel.kinematics.workspace.reach import task_of
from gtmodel.kinematics.workspace.workspace_study import _initial_sections
from gtmodel.results import ArgumentError, SolveStatus, Status
from gtmodel.results.as_json import result
from tests.kinematics.by_hand import L1, disc_intersection_area

# the step's square, on boundaries with corners
AREA = 2e-3
COARSE = CrossSection(step=0.1)
STROKES = WorkspaceLimits(actuators=[[-1.5, 1.5]] * 3)


@pytest.fixture(scope="module")
def l1():
    return gt.robots.gantry_tau("l1_tape")


def reached(robot, limits: WorkspaceLimits | None = None, **options):
    return workspace_study(robot, limits, **{"section": COARSE, **options})


@pytest.fixture(scope="module")
def whole(l1):
    return reached(l1)


@pytest.fixture(scope="module")
def printed(l1):
    """As in the notes on the L1, with the example strokes of the shipped problem."""
    return workspace_study(
        l1, WorkspaceLimits(actuators=[[-1.5, 1.5]] * 3, cone=np.radians(40.0)), section=CrossSection(step=0.04),
        volume=Sections(-1.5, 4.0, sections=5, tolerance=0.1), compare_cones=np.radians([30.0, 45.0]).tolist(),
        points=[[0.5, -0.6, 0.7], [0.5, -0.6, 2.4], [0.5, 0.9, 0.2]],
    )  # fmt: skip


def test_the_printed_numbers(printed) -> None:
    s = printed
    assert s.status is SolveStatus.SOLVED and all(check.passed for check in s.checks.values())
    # notes on the L1: 3.1 to 3.3 m2, about 2.3 x 2 m; 30 deg 1.6 m2, 1.5 x 1.4 m; 45 deg 2.6-2.8 m2, 2.0 x 1.8 m
    assert s.kinematic_area == pytest.approx(disc_intersection_area(L1.A[:, 1:], L1.L), rel=AREA)
    thirty, forty_five = s.cones
    assert thirty["angle_deg"] == 30.0 and forty_five["angle_deg"] == 45.0
    assert thirty["area_m2"] == pytest.approx(1.6, abs=0.1) and 2.6 < forty_five["area_m2"] < 2.8
    assert [thirty["width_m"], thirty["height_m"]] == pytest.approx([1.5, 1.4], abs=0.1)
    assert [forty_five["width_m"], forty_five["height_m"]] == pytest.approx([2.0, 1.8], abs=0.1)
    assert thirty["area_m2"] < s.area < forty_five["area_m2"]
    assert s.guideway_rectangle == pytest.approx(1.31 * 1.46)
    assert s.area_ratio == pytest.approx(s.area / (1.31 * 1.46))
    assert s.volume_ratio == pytest.approx(s.volume / (1.31 * 1.46 * 3.0))
    (sentence,) = s.assumptions
    assert "home pose" in sentence and "not known" in sentence
    assert [p["reachable"] for p in s.points] == [True, False, False]
    assert not s.on_edge


def test_the_boundary_encloses_the_area(printed) -> None:
    rows = np.loadtxt(printed.files["boundary.csv"].splitlines(), delimiter=",", skiprows=1)
    y, z = rows[:, 1:3].T
    assert abs(np.sum(y * np.roll(z, -1) - z * np.roll(y, -1))) / 2 == pytest.approx(printed.area, rel=1e-6)
    np.testing.assert_array_equal(rows[:, 4:], rows[:, 1:3])  # guideways along x: (u, v) = (y, z)
    assert {*printed.figures} == {"section", "robot"} and all(printed.figure(name).axes for name in printed.figures)


def test_same_input_same_bytes(whole) -> None:
    shared.cache_clear()  # compiled anew
    again = reached(gt.robots.gantry_tau("l1_tape"))
    assert result("", None, again) == result("", None, whole) and again.files == whole.files


@pytest.mark.parametrize("robot", ["l1_vision", "l1_camera", "d1_nominal"])
def test_guideways_of_any_direction(robot: str) -> None:
    s = reached(gt.robots.gantry_tau(robot))
    assert s.status is SolveStatus.SOLVED and 2.9 < s.area < 5.0
    assert all(check.passed for check in s.checks.values())


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("actuator limits", {"limits": WorkspaceLimits(actuators=[[-0.4, 3.0]] * 3)}),
        ("Cartesian limits", {"limits": WorkspaceLimits(tcp_high=[9.0, -0.2, 9.0])}),
        ("ball-joint cones of 20 deg", {"limits": WorkspaceLimits(cone=np.radians(20.0))}),
        ("obstacles", {"obstacles": [Box(name="table", low=[0.9, -1.0, -0.3], high=[1.9, -0.4, 0.2])]}),
        ("link-frame clearance", {"beams": [Beam([1.0, -0.6, -1.0], [1.0, -0.6, 0.5], 0.05, [1])]}),
        (
            "link-link clearance",
            {"bodies": Bodies(0.065, plate_joints=[[0, 0, 0.1], [0, -0.1, 0], [0, 0.1, -0.1]], link_clearance=True)},
        ),
    ],
)
def test_every_limit_takes_something_away(l1, whole, name, options) -> None:
    s = reached(l1, **options)
    assert 0.0 < s.area < whole.area and s.reasons[f"outside the {name}"] > 0


def test_nothing_is_reached(l1) -> None:
    s = reached(l1, WorkspaceLimits(tcp_low=[9.0, 9.0, 9.0]))
    assert s.status is SolveStatus.INFEASIBLE and "no point of the section is reached" in s.message
    assert s.area == 0.0 and json.dumps(s.reasons) and s.files == {}
    assert all(s.figure(name).axes for name in s.figures)


def test_few_points_of_a_section_not_reached(l1) -> None:
    limits = WorkspaceLimits(tcp_low=[0.0, -0.5, 0.7], tcp_high=[9.0, -0.45, 0.75])
    s = reached(l1, limits, section=CrossSection(step=0.5))
    assert s.status is SolveStatus.INFEASIBLE and s.message.endswith("try a smaller step")


def test_what_leaves_the_window_says_so(l1) -> None:
    s = reached(l1, section=CrossSection(step=0.1, low=[-0.7, 0.4], high=[-0.2, 0.9]))
    assert s.on_edge and s.message.startswith("the cross-section reaches the edge of the grid")
    assert s.area == pytest.approx(0.25) and s.volume_on_edge is None


@pytest.mark.parametrize("sections", [3, 6])
def test_the_volume_does_not_depend_on_the_initial_sections(l1, sections: int) -> None:
    """Without added ones 26.7 m3 and 0.0 m3."""
    limits = WorkspaceLimits(cone=np.radians(40.0), actuators=[[-1.5, 1.5]] * 3)
    s = reached(l1, limits, volume=Sections(-10.0, 12.0, sections, 0.05))
    assert s.status.ok and s.volume == pytest.approx(5.53, rel=0.02)
    assert s.volume_error < 0.05 * s.volume


def test_a_volume_with_too_few_sections_fails_its_check(l1) -> None:
    s = reached(l1, STROKES, volume=Sections(-10.0, 12.0, 4, most_sections=8))
    assert s.status is SolveStatus.CHECK_FAILED and not s.checks["volume_error"].passed
    away = reached(l1, STROKES, volume=Sections(30.0, 40.0, 3, most_sections=5))
    assert not away.checks["volume_error"].passed and "none of 5 sections is reached" in away.message


def test_sections_are_as_near_as_an_obstacle_is_thin(l1) -> None:
    box = Box(name="post", low=[0.4, -1.0, -0.3], high=[0.5, -0.4, 0.2])
    task = task_of(l1, WorkspaceLimits(), None, COARSE, Bodies(), [box], [])
    assert _initial_sections(Sections(-1.0, 1.0, 3), task, [box], []) >= 21


def test_a_volume_may_be_cut_where_the_section_is_not(l1) -> None:
    s = reached(l1, section=CrossSection(step=0.2), volume=Sections(0.5, 0.7, 2, 0.2))
    assert s.volume_on_edge and not s.on_edge
    assert any(row.label == "cut" and "volume" in row.value for row in s.rows)


def test_six_links_reach_farther_by_the_plate() -> None:
    # the plate's joints are up to 0.2 m from the tool centre point
    task = task_of(gt.robots.six_link_gantry_tau(), WorkspaceLimits(), None, COARSE, Bodies(), [], [])
    robot, section = task.robot, task.section
    pierced, L = section.pierced(robot.anchors, robot.directions), robot.lengths[:, None] + 0.05
    by_links = (pierced - L).max(axis=0), (pierced + L).min(axis=0)
    u, v = (np.linspace(task.low[k] - 0.2, task.high[k] + 0.2, 31) for k in range(2))
    uv = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    uv = uv[np.any((uv < by_links[0]) | (uv > by_links[1]), axis=1)]
    reachable = uv[robot.inverse(section.points(uv)).status == Status.OK]
    assert len(reachable) and np.all((reachable > task.low) & (reachable < task.high))
    # of the joints themselves, wherever the links are drawn
    moved = mechanism_of(robot.model, None, np.ones((6, 3)))
    np.testing.assert_allclose(moved.plate_arms, robot.plate_arms, rtol=1e-12)


def test_a_coarse_grid_says_so(l1) -> None:
    s = reached(l1, section=CrossSection(step=0.4))
    assert not s.checks["area_change_at_double_step"].passed
    assert s.status is SolveStatus.CHECK_FAILED and "area_change_at_double_step" in s.message
    assert s.message.endswith("; use a smaller step of the section")


def test_stopped_it_keeps_what_was_mapped(l1) -> None:
    assert reached(l1, stop=lambda: True).status is SolveStatus.INTERRUPTED
    stages: list[str | None] = []
    s = reached(l1, progress=lambda stage=None, *_: stages.append(stage), stop=lambda: "workspace" in stages)
    assert s.status is SolveStatus.INTERRUPTED and s.area is None and s.kinematic_area > 0
    assert [row.label for row in s.rows] == ["where inverse kinematics exists"]


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"home": [0.0, 9.0, 0.0]}, "home"),
        ({"limits": WorkspaceLimits(actuators=[[0.0, 1.0]])}, "limits.actuators"),
        ({"limits": WorkspaceLimits(actuators=[[1.0, 0.0]] * 3)}, "limits.actuators"),
        ({"limits": WorkspaceLimits(actuators=[[-1500.0, 1500.0]] * 3)}, "limits.actuators"),
        ({"limits": WorkspaceLimits(tcp_low=[0, 0, 1.0], tcp_high=[1, 1, 0.0])}, "limits.tcp_high"),
        ({"section": CrossSection(step=5.0)}, "section.step"),
        ({"section": CrossSection(step=1e-6)}, "section.step"),
        ({"section": CrossSection(low=[0.0, 0.0], high=[0.0, 1.0])}, "section.high"),
        ({"bodies": Bodies(link_clearance=True)}, "bodies.link_clearance"),
        ({"bodies": Bodies(plate_joints=[[0.0, 0.0, 0.0]])}, "bodies.plate_joints"),
        ({"obstacles": [Box(low=[0, 0, 0.0], high=[1, 1, 0.0])]}, "obstacles[0].high"),
        ({"beams": [Beam([0, 0, 0.0], [1, 1, 0.0], skip_links=[4])]}, "beams[0].skip_links"),
        ({"beams": [Beam([1.2, -0.6, 0.5], [1.6, -0.6, 0.5], skip_links=[1, 2, 3])]}, "beams[0].skip_links"),
        ({"volume": Sections(1.0, 0.0)}, "volume.high"),
        ({"volume": Sections(0.0, 1.0, 9, most_sections=5)}, "volume.most_sections"),
    ],
)
def test_what_cannot_be_used_is_named(l1, options, argument) -> None:
    with pytest.raises(ArgumentError) as caught:
        reached(l1, **options)
    assert caught.value.argument == argument and "\n" not in str(caught.value)


def test_a_model_without_links_on_guideways() -> None:
    class Point(gt.Model):
        T = gt.variable(3, unit="m")
        q = gt.variable(3, unit="m")

        def equations(self):
            yield self.T == self.q

    with pytest.raises(ArgumentError) as caught:
        reached(Point())
    assert caught.value.argument == "robot"
