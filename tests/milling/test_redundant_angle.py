"""The angle about the spindle: every solution holds the tool where it should; words of the guideline."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtmodel.kinematics import Chain
from gtmodel.milling import ANGLES, Findings, angle_sweep, choices, guideline, nearest_mode, tool_rotations
from gtmodel.robots.kuka import FLANGE, kr500_limits
from tests.milling.thesis import OSCILLATORS, PRINTED

O, AXES = (np.array(PRINTED["geometry"][k], float) for k in ("joint_origins_m", "joint_axes"))
ARM = Chain(AXES, np.cumsum(O, axis=0), T=O.sum(axis=0), R=FLANGE)
TOOL, SPINDLE = np.array([0.3, 0.0, 0.25]), np.array([1.0, 0.0, 0.0])
PLACE = np.array([-0.01073, -2.40047, 0.30341])


def flange(q):
    T, R = np.zeros(3), np.eye(3)
    for o, a, angle in zip(O, AXES, q, strict=True):
        T = T + R @ o
        R = R @ Rotation.from_rotvec(angle * a).as_matrix()
    return T, R @ FLANGE


def test_every_solution_holds_the_tool() -> None:
    sweep = angle_sweep(ARM, kr500_limits(), PLACE, tool=TOOL, spindle=SPINDLE)
    assert len(sweep.angles) == 361 and 0 < sweep.reachable.sum() < 361
    assert np.all(sweep.in_reach[sweep.reachable])
    low, high = kr500_limits().T
    assert np.all((sweep.q >= low - 1e-8) & (sweep.q <= high + 1e-8))
    start = tool_rotations(0.0, [0, 0, -1], SPINDLE)[0]
    for s in range(0, len(sweep.q), 29):
        T, R = flange(sweep.q[s])
        np.testing.assert_allclose(T + R @ TOOL, PLACE, atol=1e-9)
        np.testing.assert_allclose(R @ SPINDLE, [0, 0, -1], atol=1e-9)
        turned = Rotation.from_rotvec([0, 0, sweep.angles[sweep.row[s]]]).as_matrix() @ start
        np.testing.assert_allclose(R, turned, atol=1e-9)
    # one solution of each branch at most, and the least of any value is that of its angle
    assert len(np.unique(np.stack([sweep.row, sweep.branch]), axis=1).T) == len(sweep.q)
    value = np.sin(np.arange(len(sweep.q)))
    least, which = sweep.least(value)
    for n in np.flatnonzero(sweep.reachable)[::17]:
        assert least[n] == value[sweep.row == n].min() == value[which[n]]
    assert np.all(np.isnan(least) == ~sweep.reachable) and np.all((which < 0) == ~sweep.reachable)


def test_unreachable_everywhere_and_limits_as_the_reason() -> None:
    far = angle_sweep(ARM, kr500_limits(), [9.0, 0, 0])
    assert not far.reachable.any() and not far.in_reach.any() and np.all(np.isnan(far.least([])[0]))
    narrow = np.deg2rad(np.tile([[-1.0, 1.0]], (6, 1)))
    held = angle_sweep(ARM, narrow, PLACE, tool=TOOL, spindle=SPINDLE)
    assert not held.reachable.any() and held.in_reach.any()
    with pytest.raises(ValueError, match="not all zero"):
        angle_sweep(ARM, kr500_limits(), PLACE, spindle=[0, 0, 0])


@pytest.mark.parametrize("axis", [[0, 0, -1.0], [1.0, 0, 0], [0.3, -0.4, -0.5]])
@pytest.mark.parametrize("spindle", [[0, 0, 1.0], [1.0, 0, 0]])
def test_orientations_are_rotations_about_the_axis(axis, spindle) -> None:
    R = tool_rotations(ANGLES[::40], axis, spindle)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1)
    np.testing.assert_allclose(R @ spindle, np.tile(axis / np.linalg.norm(axis), (len(R), 1)), atol=1e-12)


def test_guideline_in_words() -> None:
    angles = np.deg2rad([49.0, 52.0, 110.0])
    f = Findings(
        angles, np.array([3e-3, 2e-3, 1e-3]), np.array([2e-4, 1e-4, 3e-4]), OSCILLATORS[0], OSCILLATORS[1], 32.25, 2,
        (0.1, -0.04), (0.3, 0.2), np.array([32.25, 50.0]), np.array([1e-4, 5e-5]), np.array([3e-4, 2e-4]),
    )  # fmt: skip
    said = guideline(f)
    assert f.choices == (2, 1) and f.ratio == pytest.approx(3)
    assert said[0].startswith("use the dynamic model: at 64.5 Hz its angle 52 deg deflects 0.1 mm")
    assert "6.28 Hz above the mode along y at 58.2 Hz" in said[1]
    assert "by +30 % or +20 % at the static choice, by +10 % or -4 % at the dynamic one" in said[3]
    assert "the speed gains 50 %" in said[4] and said[5].endswith("deflects least, 0.2 mm, at 3000 rpm")
    near = nearest_mode(OSCILLATORS[4], 30.0)
    assert (near.harmonic, near.axis) == (2, 1) and "2 times the tooth frequency" in near.message
    calm = replace(f, dynamic=np.full(3, 1e-4), speeds=f.speeds[:1], best_by_speed=f.best_by_speed[:1])
    assert "the static model will do" in guideline(calm)[0] and guideline(calm)[-1] == "no other speed was tried"
    none_better = replace(
        f, at_dynamic=OSCILLATORS[4], speed=30.0, speeds=np.array([30.0, 50.0]), best_by_speed=np.array([1e-4, 2e-4])
    )
    said = guideline(none_better)
    assert "a mode less than 5 Hz" in said[4] and "none of 2 speeds" in said[5]
    assert replace(f, static_row=0).choices == (0, 1)
    with pytest.raises(ValueError, match="no angle is both reachable and covered"):
        choices([np.nan, 1.0], [1.0, np.nan])
