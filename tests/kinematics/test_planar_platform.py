"""All assembly modes of a planar platform on three rods: completeness by a scan of the angle, and in a model."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.kinematics import planar_modes
from problems.models.mechanisms import ThreeArms

ROUND_OFF = 1e-9  # lengths of order one; a nearly double solution loses half of the digits of 1e-15 twice
SIX = np.array([1.26, 2.14, -1.54])  # motor angles of the shipped 3-RRR with six real modes


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def elbows(q):
    return np.array(ThreeArms().A) + 0.3 * np.column_stack([np.cos(q), np.sin(q)])


def by_scan(E, B, L):
    """Number of real modes: for each angle the third length error at both intersections of the first two circles."""
    t = np.linspace(-np.pi, np.pi, 20001)
    d = np.einsum("ijn,kj->nki", rotation(t), B) - E  # corners from the ends of the rods, for x = 0
    apart = d[:, 1] - d[:, 0]
    length = np.linalg.norm(apart, axis=1)
    along = (L[1] ** 2 - L[0] ** 2 - length**2) / (2 * length)
    across = np.sqrt(np.where(L[0] ** 2 > along**2, L[0] ** 2 - along**2, np.nan))
    unit = apart / length[:, None]
    errors = []
    for side in (1, -1):
        x = -d[:, 0] + along[:, None] * unit + side * across[:, None] * np.column_stack([-unit[:, 1], unit[:, 0]])
        errors.append(np.linalg.norm(x + d[:, 2], axis=1) - L[2])
    inside = np.isfinite(errors[0])
    edges = inside & ~(np.roll(inside, 1) & np.roll(inside, -1))  # where the circles touch both sides go on as one
    return sum(int(np.sum(e[:-1] * e[1:] < 0)) for e in errors) + int(np.sum((errors[0] * errors[1])[edges] < 0))


def test_the_pose_that_made_the_lengths_is_among_the_modes_and_none_is_missing():
    rng = np.random.default_rng(4404)
    counts = []
    for n in range(100):
        E, B, x = rng.uniform(-1, 1, (3, 2)), rng.uniform(-0.5, 0.5, (3, 2)), rng.uniform(-1, 1, 2)
        angle = rng.uniform(-np.pi, np.pi)
        L = np.linalg.norm(x + B @ rotation(angle).T - E, axis=1)
        found, angles = planar_modes(E, B, L)
        for p, a in zip(found, angles, strict=True):
            assert np.allclose(np.linalg.norm(p + B @ rotation(a).T - E, axis=1), L, atol=ROUND_OFF)
        k = int(np.argmin(np.abs(np.exp(1j * angles) - np.exp(1j * angle))))
        assert np.allclose([*found[k], np.exp(1j * angles[k])], [*x, np.exp(1j * angle)], atol=1e-7)
        counts.append(len(angles))
        assert n >= 25 or len(angles) == by_scan(E, B, L)
    assert set(counts) <= {2, 4, 6}


@cache
def six_modes():
    """Poses, angles and sides of the elbows of the six modes."""
    arms, B = ThreeArms(), np.array(ThreeArms().B)
    x, angles = planar_modes(elbows(SIX), B, arms.lower)
    sides = []
    for place, angle in zip(x, angles, strict=True):
        corners, bent = place + B @ rotation(angle).T - arms.A, elbows(SIX) - arms.A
        left = corners[:, 0] * bent[:, 1] - corners[:, 1] * bent[:, 0]
        sides.append({f"elbow_{k}": 1 if side > 0 else -1 for k, side in enumerate(left)})
    return x, angles, sides


def test_a_3_rrr_has_six_modes_and_its_closed_inverse_returns_the_motor_angles_from_each():
    x, angles, sides = six_modes()
    assert len(angles) == 6 == by_scan(elbows(SIX), np.array(ThreeArms().B), np.full(3, 0.35))
    for place, angle, branches in zip(x, angles, sides, strict=True):
        q, status = ThreeArms().causal(["x", "angle"], "q", branches=branches)(place, angle)
        assert status == gt.Status.OK
        assert np.allclose(np.exp(1j * q), np.exp(1j * SIX), atol=ROUND_OFF)


@pytest.mark.parametrize("mode", [0, 3, *(pytest.param(m, marks=pytest.mark.proof) for m in (1, 2, 4, 5))])
def test_the_forward_function_of_the_model_has_each_mode_as_its_home(mode):
    x, angles, sides = six_modes()
    model = ThreeArms(x={"start": x[mode]}, angle={"start": angles[mode]}, q={"start": SIX})
    found, angle, status = model.causal("q", ["x", "angle"], branches=sides[mode])(SIX)
    assert status == gt.Status.OK
    assert np.allclose([*found, angle], [*x[mode], angles[mode]], atol=ROUND_OFF)


def test_rods_that_do_not_reach_have_no_mode():
    x, angle = planar_modes([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]], [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]], [1.0, 1.0, 1.0])
    assert x.shape == (0, 2)
    assert angle.shape == (0,)


@pytest.mark.parametrize(
    ("E", "B", "argument"), [(np.zeros((2, 2)), np.eye(3)[:, :2], "E"), (np.eye(3)[:, :2], np.zeros((3, 2)), "B")]
)
def test_wrong_points(E, B, argument):
    with pytest.raises(gt.results.ArgumentError) as error:
        planar_modes(E, B, [1.0, 1.0, 1.0])
    assert error.value.argument == argument
