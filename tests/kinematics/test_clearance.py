"""Distances of an arm's links from each other and from obstacles, against dense samples of the chain's axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import gtmodel as gt
from gtmodel.geometry.rotations import rotation_of_rpy
from gtmodel.kinematics import BoxObstacle, CapsuleObstacle, Clearance, LinkCapsule, PlaneObstacle, chain_of
from gtmodel.results import ArgumentError

URDF = Path("problems/models/ur_like.urdf")
BOX = BoxObstacle([0.5, 0.1, 0.3], [0.3, 0.2, 0.4], [0.3, -0.2, 0.5])
BALL = CapsuleObstacle([0.2, -0.5, 0.4], [0.2, -0.5, 0.4], 0.1)
BAR = CapsuleObstacle([0.2, 0.5, 0.0], [0.5, 0.6, 0.9], 0.05)
WALL = PlaneObstacle([-0.6, 0.0, 0.0], [2.0, 0.0, 0.0])
DENSE = np.linspace(0.0, 1.0, 61)
SHAPES = ["base", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"]


@pytest.fixture(scope="module")
def arm() -> gt.robots.SerialArm:
    return gt.robots.from_urdf(URDF, base_xyz=[0.1, 0.0, 0.05], base_rpy=[0.0, 0.0, 0.4])


@pytest.fixture(scope="module")
def near(arm) -> gt.kinematics.LinkDistances:
    return gt.kinematics.link_distances(arm, Clearance(obstacles=[BALL, BAR], boxes=[BOX], planes=[WALL]))


def placed_by_the_chain(arm, q: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray, float]]:
    """Both ends of each link's capsule by the product of exponentials: the joints' axes alone, no frames of links."""
    chain = chain_of(arm)
    R, p = (x[:, 0] for x in chain.exponentials(q[None]))
    R0, r0 = rotation_of_rpy(np.asarray(arm.base_rpy)), np.asarray(arm.base_xyz)
    frames = [(R0, r0)]  # of the links at q = 0, from the placements of the file
    for xyz, rpy in zip(arm.xyz, arm.rpy, strict=True):
        before = frames[-1]
        frames.append((before[0] @ rotation_of_rpy(np.asarray(rpy)), before[1] + before[0] @ np.asarray(xyz)))
    return {
        s.link: (*(R[s.body] @ (frames[s.body][0] @ x + frames[s.body][1]) + p[s.body] for x in (s.begin, s.end)),
                 s.radius)
        for s in arm.structure.shapes
    }  # fmt: skip


def brute(a, b) -> tuple[float, float]:
    """Least distance of samples of two capsules, and by how much it may exceed the true one."""
    p, q = (x[0] + DENSE[:, None] * (x[1] - x[0]) for x in (a, b))
    spacing = (np.linalg.norm(a[1] - a[0]) + np.linalg.norm(b[1] - b[0])) / (len(DENSE) - 1)
    return float(np.min(np.linalg.norm(p[:, None] - q[None], axis=2))) - a[2] - b[2], spacing


def test_distances_are_those_of_dense_samples(arm, near) -> None:
    postures = np.random.default_rng(44).uniform(-2.5, 2.5, (10, 6))
    found = near.distances(postures)
    R, center, half = rotation_of_rpy(np.array(BOX.rpy)), np.array(BOX.center), np.array(BOX.size) / 2
    for q, row in zip(postures, found, strict=True):
        links = placed_by_the_chain(arm, q)
        others = {"obstacles[0]": (np.array(BALL.begin), np.array(BALL.end), BALL.radius),
                  "obstacles[1]": (np.array(BAR.begin), np.array(BAR.end), BAR.radius)}  # fmt: skip
        for (first, second), distance in zip(near.names, row, strict=True):
            a = links[first]
            points = a[0] + DENSE[:, None] * (a[1] - a[0])
            if second == "planes[0]":
                least, spacing = float(np.min(points[:, 0])) + 0.6 - a[2], 1e-12
            elif second == "boxes[0]":
                out = np.maximum(np.abs((points - center) @ R) - half, 0.0)
                least = float(np.min(np.linalg.norm(out, axis=1))) - a[2]
                spacing = np.linalg.norm(a[1] - a[0]) / (len(DENSE) - 1)
            else:
                least, spacing = brute(a, others.get(second) or links[second])
            assert least - spacing <= distance <= least + 1e-9, (first, second)


def test_the_least_distance_names_pair_and_row(near) -> None:
    postures = np.random.default_rng(45).uniform(-2.5, 2.5, (40, 6))
    least, every = near.least(postures), near.distances(postures)
    assert least.distance == every.min() and every[least.row].min() == every.min()
    assert near.names[int(np.argmin(every[least.row]))] == least.pair


@pytest.mark.parametrize("seed", [46, 47])
def test_along_a_motion_no_instant_is_nearer_than_the_bound(near, seed) -> None:
    """Dense samples of the cubics by SciPy; their own error is the way of a link between two of them."""
    draw = np.random.default_rng(seed)
    time, samples = np.array([0.0, 0.3, 0.4, 1.0]), 4001
    q, v = draw.uniform(-1.5, 1.5, (4, 6)), draw.uniform(-3.0, 3.0, (4, 6))
    least = near.least_along(time, q, v)
    instants = np.linspace(0.0, 1.0, samples)
    motion = CubicHermiteSpline(time, q, v)
    every = near.distances(motion(instants))
    step = np.abs(np.diff(every, axis=0)).max()
    assert every.min() - step - 1e-4 <= least.distance <= every.min()
    there = near.least(motion(least.time))
    assert (there.distance - 1e-4, there.pair) == (pytest.approx(least.distance, abs=1e-12), least.pair)
    assert time[least.row] <= least.time <= time[least.row + 1]


def test_a_post_between_two_rows_is_met() -> None:
    """A slide along x and a rod that swings with it: a thin post stands between the only two rows."""
    slide, turn = (
        gt.robots.serial_arm(a=[0.0, 0.4], alpha=0.0, joints=joints, **offset)
        for joints, offset in (("pr", {"theta": [0.0, 0.0]}), ("rr", {}))
    )
    rod = LinkCapsule("link_2", [-0.4, 0, 0], [0, 0, 0], 0.01)
    for arm, q, post in (
        (turn, [[0.0, 0.0], [1.0, 1.0]], [0.4 * np.cos(0.9), 0.4 * np.sin(0.9), 0.0]),
        (slide, [[-1.0, 0.0], [1.0, 0.0]], [0.2, 0.0, 0.4]),
    ):
        ball = CapsuleObstacle(post, post, 0.01)
        near = gt.kinematics.link_distances(arm, Clearance(capsules=[rod], obstacles=[ball]))
        assert near.least(q).distance > 0.1
        least = near.least_along(np.array([0.0, 1.0]), np.array(q), np.zeros((2, 2)))
        assert least.distance == pytest.approx(-0.02, abs=1.01e-4) and 0.3 < least.time < 0.7


def test_neighbours_and_ignored_pairs_are_not_compared(arm, near) -> None:
    own = [set(n) for n in near.names if n[1] in SHAPES]
    assert len(own) == 15  # seven bodies in a row: 21 pairs, six of them neighbours
    assert all(abs(SHAPES.index(a) - SHAPES.index(b)) > 1 for a, b in map(sorted, own))
    fewer = gt.kinematics.link_distances(arm, Clearance(ignored=[["wrist_3", "forearm"]]))
    assert len(fewer.pairs) == 14 and {"forearm", "wrist_3"} not in [set(n) for n in fewer.names]
    assert not any(n[0] == "base" and n[1] not in SHAPES for n in near.names)  # neither of the two moves


def test_capsules_of_the_file_and_declared_ones() -> None:
    text = """<robot name="r"><link name="base"/>
      <link name="arm">
        <collision><geometry><sphere radius="0.1"/></geometry></collision>
        <collision><origin xyz="0 0 1" rpy="0 1.5707963267948966 0"/>
          <geometry><cylinder radius="0.2" length="0.6"/></geometry></collision>
        <collision><geometry><mesh filename="arm.stl"/></geometry></collision></link>
      <link name="hand"><collision><geometry><box size="0.06 0.5 0.08"/></geometry></collision></link>
      <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
      <joint name="mount" type="fixed"><parent link="arm"/><child link="hand"/><origin xyz="1 0 0"/></joint></robot>"""
    arm = gt.robots.from_urdf(text)
    ball, rod, hand = arm.structure.shapes
    assert (ball.begin, ball.end, ball.radius) == ((0, 0, 0), (0, 0, 0), 0.1)
    np.testing.assert_allclose([rod.begin, rod.end], [[-0.3, 0, 1], [0.3, 0, 1]], atol=1e-15)
    np.testing.assert_allclose([hand.begin, hand.end], [[1, -0.25, 0], [1, 0.25, 0]], atol=1e-15)
    assert hand.radius == pytest.approx(0.05) and hand.body == rod.body == 1  # fixed to the link that turns
    assert arm.structure.notes == ("not used: 1 collision meshes",)
    ours = LinkCapsule("arm", [0, 0, 0], [0, 0, 0.5], 0.03)
    near = gt.kinematics.link_distances(arm, Clearance(capsules=[ours], planes=[WALL]))
    assert [(b.name, b.radius) for b in near.bodies[:2]] == [("hand", hand.radius), ("arm", 0.03)]


@pytest.mark.parametrize(
    ("given", "where"),
    [
        ({"capsules": [LinkCapsule("elbow", [0, 0, 0], [0, 0, 1], 0.1)]}, "capsules[0].link"),
        ({"ignored": [["forearm"]]}, "ignored[0]"),
        ({"ignored": [["forearm", "hand"]]}, "ignored[0]"),
        ({"planes": [PlaneObstacle([0, 0, 0], [0, 0, 0])]}, "planes[0].normal"),
    ],
)
def test_wrong_declarations(arm, given, where) -> None:
    with pytest.raises(ArgumentError) as caught:
        gt.kinematics.link_distances(arm, Clearance(**given))
    assert caught.value.argument == where


def test_a_robot_without_links_or_shapes() -> None:
    for robot, where in ((gt.robots.gantry_tau("l1_tape"), "robot"), (gt.robots.serial_arm([1.0], 0.0), "capsules")):
        with pytest.raises(ArgumentError) as caught:
            gt.kinematics.link_distances(robot, Clearance())
        assert caught.value.argument == where
