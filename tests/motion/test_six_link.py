"""Motions of the six-link D1: no closed form, all equations collocated as they stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtmodel import SolveStatus
from gtmodel.motion.motion_study import solved
from gtmodel.motion.options import JointCone
from gtmodel.motion.path_parametrization import along_guideways, link_ends
from gtmodel.motion.planning import plan_of
from gtmodel.results import ArgumentError, Work
from tests.support.motions import d1, six_link

LENGTHS_M = 1e-9


def test_ends_of_the_declared_problem():
    """Both ends are reached on the declared branch, every link of its length."""
    plan = plan_of(six_link())
    joints, tips, status = link_ends(plan.robot, np.array([plan.start, plan.goal]))
    assert np.all(status == 0) and joints.shape == (2, 6, 3)
    lengths = np.linalg.norm(tips - joints, axis=2)
    assert np.max(np.abs(lengths - np.asarray(plan.robot.L, float))) < LENGTHS_M
    assert np.min(along_guideways(plan.robot, tips, joints)) > 0.02
    assert np.ptp(tips - plan.start, axis=1).max() > 0.1  # the plate has a size: its joints are not the TCP


@pytest.mark.parametrize("end", ["start", "goal"])
def test_an_end_out_of_reach_is_named_with_cones_of_the_plate_too(end: str):
    """The cones turn with the plate at the start, where it has no rotation if the start is out of reach."""
    problem = six_link()
    cones = [JointCone(arm=0, end="plate", axis=[0.0, 0.0, 1.0], half_angle=0.6)]
    far = replace(getattr(problem, end), tcp=[-1.6, -40.4, -0.1])
    problem = replace(problem, limits=replace(problem.limits, joint_cones=cones), **{end: far})
    with pytest.raises(ArgumentError, match="out of reach") as error:
        plan_of(problem)
    assert error.value.argument == f"{end}.tcp"


@pytest.mark.proof
def test_declared_problem():
    """On few elements: ends, forces of the motion by Newton, and every link of its length and on its branch."""
    problem = six_link(mesh__elements=5)
    o = solved(problem, Work())
    assert o.status is SolveStatus.SOLVED
    run = o.trajectory
    assert np.allclose(run["T"][0], problem.begin, rtol=0, atol=1e-9)
    robot = d1()
    rows = slice(8, None, 8)  # at the start what is no state is extrapolated
    T = run["T"][rows]
    joints, tips, status = link_ends(robot, T)
    assert np.all(status == 0) and joints.shape == (len(T), 6, 3)
    L = np.asarray(robot.L, float)
    assert np.max(np.abs(np.linalg.norm(tips - joints, axis=2) - L)) < LENGTHS_M
    along = along_guideways(robot, tips, joints)
    assert np.min(along) > 0.02
    assert (
        np.max(np.abs(along - run["along_guideway"][rows])) < 1e-6
    )  # the optimum is on the branch that Newton follows
    tau, status = robot.causal("T", "tau")(T, run["der(T)"][rows], run["der(T,2)"][rows])
    assert np.all(status == 0) and np.max(np.abs(tau - run["tau"][rows])) < 1e-4
    assert 100 < o.exported_peak_force <= 700.0 * (1 + 1e-9)
