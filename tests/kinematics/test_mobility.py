"""Mobility of mechanisms: against ranks of hand-written twists, and what exact dimensions and singular poses do."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

import gtmodel as gt
from gtmodel.cli import app
from tests.support import mechanisms
from tests.support.twists import counted

X, Y, Z = np.eye(3)
RNG = np.random.default_rng(5)


@cache
def report(name):
    return getattr(mechanisms, name)().mobility()


def planar(*pairs, axis=Z):
    """Revolute joints with parallel axes between pairs of bodies, at random points, which do not change the rank."""
    return [(i, j, "R", RNG.uniform(-1, 1, 3), axis) for i, j in pairs]


def bennett():
    """Axes and points of Bennett's linkage, by Denavit and Hartenberg's matrices."""
    a, alpha, beta, first = 0.5, np.radians(35.0), np.radians(70.0), 1.0
    b = a * np.sin(beta) / np.sin(alpha)
    second = 2 * np.arctan(np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2) / np.tan(first / 2))
    at, joints = np.eye(4), []
    for k, (theta, length, twist) in enumerate(
        [(first, a, alpha), (second, b, beta), (-first, a, alpha), (-second, b, beta)]
    ):
        joints.append((k, (k + 1) % 4, "R", at[:3, 3], at[:3, 2]))
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(twist), np.sin(twist)
        at = at @ [[c, -s * ca, s * sa, length * c], [s, c * ca, -c * sa, length * s], [0, sa, ca, 0], [0, 0, 0, 1]]
    assert np.allclose(at, np.eye(4), atol=1e-12)  # closed
    return joints


def sarrus():
    points = RNG.uniform(-1, 1, (6, 3))
    legs = [[(0, 1), (1, 2), (2, 5)], [(0, 3), (3, 4), (4, 5)]]
    return [
        (i, j, "R", points[3 * n + k], axis)
        for n, (leg, axis) in enumerate(zip(legs, (X, Y), strict=True))
        for k, (i, j) in enumerate(leg)
    ]


def delta():
    """Arms 1 to 3, rods 4 to 9, platform 10 at a height at which the rods close."""
    joints = []
    for n in range(6):
        k, y = n // 2, (-0.05, 0.05)[n % 2]
        R = np.array([[np.cos(t := 2 * np.pi / 3 * k), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1]])
        q = 0.3
        elbow = R @ [0.2 + 0.3 * np.cos(q), y, -0.3 * np.sin(q)]
        reach = 0.2 + 0.3 * np.cos(q) - 0.05
        corner = R @ [0.05, y, -0.3 * np.sin(q) - np.sqrt(0.64 - reach**2)]
        joints += [(k + 1, n + 4, "S", elbow), (n + 4, 10, "S", corner)]
        joints += [(0, k + 1, "R", R @ [0.2, 0, 0], R @ Y)] if n % 2 == 0 else []
    return joints


def gough(legs):
    """Six legs at the pose T = (0, 0, 0.9) m: cylinder 2k+1, piston 2k+2, platform 13. legs: kinds of foot, slide and
    head, and the angle of the axes in the platform against those in the base."""
    foot_kind, slide, head_kind, twist = legs
    feet = [[0.6 * np.cos(t), 0.6 * np.sin(t), 0.0] for t in np.radians([10.0, 50.0, 130.0, 170.0, 250.0, 290.0])]
    heads = [[0.35 * np.cos(t), 0.35 * np.sin(t), 0.9] for t in np.radians([-25.0, 85.0, 95.0, 205.0, 215.0, 325.0])]
    joints = []
    for k, (foot, head) in enumerate(zip(np.array(feet), np.array(heads), strict=True)):
        along = (head - foot) / np.linalg.norm(head - foot)
        first = np.cross(Z, along) / np.linalg.norm(np.cross(Z, along))
        second = np.cross(along, first)
        c, s = np.cos(twist), np.sin(twist)
        axes = c * second - s * first, c * first + s * second
        joints += [
            (0, 2 * k + 1, foot_kind, foot, *([first, second] if foot_kind == "U" else [])),
            (2 * k + 1, 2 * k + 2, slide, foot, along),
            (2 * k + 2, 13, head_kind, head, *(axes if head_kind == "U" else [])),
        ]
    return joints


SPHERICAL = [(k, (k + 1) % 4, "R", np.zeros(3), axis) for k, axis in enumerate(RNG.uniform(-1, 1, (4, 3)))]
SPATIAL = [
    (0, 1, "R", [0, 0, 0], Z), (1, 2, "R", [0.2, 0, 0], [0, 1, 0.3]), (2, 3, "S", [0.7, 0.3, 0.4]),
    (3, 0, "C", [0.7, 0.3, 0], X),
]  # fmt: skip
LOADER = [
    *planar((0, 1), (1, 2), (1, 4), (2, 3), (3, 4), (0, 5), (6, 1), (0, 7), (8, 2), axis=Y),
    (5, 6, "P", np.zeros(3), [0.6, 0, 0.8]),
    (7, 8, "P", np.zeros(3), [0.8, 0, -0.6]),
]
BY_HAND = {
    "FourBar": planar((0, 1), (1, 2), (2, 3), (3, 0)),
    "BallFourBar": [*planar((0, 1), (1, 2), (3, 0)), (2, 3, "S", [0.5, 0.6, 0.0])],
    "Spatial": SPATIAL,
    "SphericalFourBar": SPHERICAL,
    "Bennett": bennett(),
    "Sarrus": sarrus(),
    "Watt": planar((0, 1), (1, 2), (2, 3), (3, 0), (3, 4), (4, 5), (5, 0)),
    "Stephenson": planar((0, 1), (1, 2), (2, 3), (3, 0), (2, 4), (4, 5), (5, 0)),
    "FiveBar": planar((0, 1), (1, 2), (2, 3), (3, 4), (4, 0)),
    "PlanarPlatform": planar(*[p for k in range(3) for p in ((0, 2 * k + 1), (2 * k + 1, 2 * k + 2), (2 * k + 2, 7))]),
    "Delta": delta(),
    "Gough": gough(("U", "P", "S", 0.0)),
    "GoughUCU": gough(("U", "C", "U", 0.4)),
    "GoughSPS": gough(("S", "P", "S", 0.0)),
    "ParallelUPU": gough(("U", "P", "U", 0.0)),
    "Loader": LOADER,
}
# name: mobility, idle freedoms, redundant constraints, generic: Grübler's count and the notes of this table's sources
EXPECTED = {
    "FourBar": (1, 0, 3, False),
    "PlanarFourBar": (1, 0, 0, True),
    "BallFourBar": (1, 0, 1, False),
    "Spatial": (1, 0, 0, True),
    "SphericalFourBar": (1, 0, 3, False),
    "Bennett": (1, 0, 3, False),
    "Sarrus": (1, 0, 1, False),
    "Watt": (1, 0, 6, False),
    "Stephenson": (1, 0, 6, False),
    "FiveBar": (2, 0, 3, False),
    "PlanarPlatform": (3, 0, 6, False),
    "Delta": (3, 6, 0, True),
    "Gough": (6, 0, 0, True),
    "GoughUCU": (6, 0, 0, True),
    "GoughSPS": (6, 6, 0, True),
    "ParallelUPU": (3, 0, 3, False),
    "RigidUPU": (0, 0, 3, False),
    "Loader": (2, 0, 9, False),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_freedoms_redundant_constraints_and_what_they_depend_on(name):
    m = report(name)
    idle = sum(i.count for i in m.idle)
    assert (m.mobility, idle, m.redundant, m.generic) == EXPECTED[name]
    assert m.gap < 1e-10
    if name in BY_HAND:  # ranks equal those of twists written by hand
        equations, rank, freedoms, redundant = counted(BY_HAND[name])
        assert (m.mobility + idle, m.redundant) == (freedoms, redundant)
        assert equations - rank == m.equations - m.rank


def test_legs_with_universal_joints_at_both_ends_do_not_move_in_spite_of_their_rank():
    # every leg allows a small turn of the platform's axes against it: three freedoms by rank, as counted by hand
    _, rank, freedoms, _ = counted(gough(("U", "P", "U", 0.5)))
    m = report("RigidUPU")
    assert (rank, freedoms) == (75, 3)
    assert (m.instantaneous, m.mobility, m.distance) == (3, 0, 0.0)


def test_a_four_bar_in_line_is_rigid_to_second_order():
    m = report("InLine")
    assert (m.instantaneous, m.mobility, m.second_order) == (2, 0, "rigid")
    assert m.distance == 0.0


def test_a_folded_parallelogram_is_where_two_motions_meet():
    m = report("Folded")
    assert (m.instantaneous, m.mobility, m.second_order) == (2, 1, "branches")
    assert m.distance > 0.1


def test_redundant_constraints_and_reactions_are_named_by_joint_and_direction():
    m = report("FourBar")
    (constraint,) = m.constraints
    assert constraint.joint == "pin"
    assert constraint.names == ("position along z", "rotation about x", "rotation about y")
    assert "mechanisms.py:" in constraint.where
    assert {u.joint for u in m.reactions} == {"crank.joint", "coupler.joint", "rocker.joint", "pin"}
    assert all(u.names == ("force along z", "torque about x", "torque about y") for u in m.reactions)


def test_the_self_stress_of_sarrus_is_a_torque_about_the_common_normal_of_both_groups():
    assert all(u.names == ("torque about z",) for u in report("Sarrus").reactions)


def test_spins_of_ball_ended_rods_are_named():
    assert [i.part for i in report("Delta").idle] == [f"rod[{n}].body" for n in range(6)]


def test_outputs_tell_what_counts():
    m = mechanisms.GoughSPS().mobility(outputs=["T"])
    assert m.mobility + sum(i.count for i in m.idle) == 12
    assert m.mobility == 3
    with pytest.raises(gt.ModelError, match="no variable 'P'"):
        mechanisms.GoughSPS().mobility(outputs="P")


def test_a_mechanism_that_cannot_be_assembled_names_the_closing_joint_and_the_gap():
    with pytest.raises(gt.ModelError, match=r"gap of 0\.\d+ m .*'pin'.*mechanisms.py:\d+"):
        mechanisms.FourBar(lengths=[0.3, 0.2, 0.1, 0.8]).mobility()


def test_robots_of_the_library():
    assert gt.robots.gantry_tau("l1_tape").mobility().mobility == 3
    m = gt.robots.six_link_gantry_tau().mobility()
    assert (m.mobility, m.redundant) == (3, 0)


def test_the_command_line_says_the_same():
    out = run("explain", "l1_tape", "--mobility")
    assert out.startswith("GantryTau: mobility 3;")


def run(*arguments):
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    return result.output
