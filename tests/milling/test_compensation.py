"""Compensation: what the offset leaves, by simulation; perfect where theory says so."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim

from gtmodel.milling import Oscillators, compensate, cutting_force, path_offset, responses, tool_error
from tests.milling.thesis import CUT, CUTTER, OSCILLATORS, X

O = OSCILLATORS[0]
STEP = 1 / 2500
TIME = STEP * np.arange(4001)
# enters the material over half a second, then 64.5 Hz teeth
RAMP = np.clip(TIME / 0.5, 0, 1)[:, None]


def force(step=STEP):
    F, own = cutting_force(CUTTER, CUT, 64.5 / 2, X, rate=1 / step)
    return RAMP * np.stack([np.interp(TIME, own * np.arange(len(F)), F[:, j]) for j in range(3)], axis=1)


def test_without_an_offset_it_is_the_discretised_response() -> None:
    F = force()
    np.testing.assert_allclose(tool_error(O, F, STEP), next(iter(responses(O, F, STEP))), atol=1e-12)


def test_against_the_simulation_of_scipy() -> None:
    F, moved = force()[:600], 1e-4 * np.sin(30 * TIME[:600, None] + np.arange(3))
    y = tool_error(O, F, STEP, moved)
    for j in range(3):
        m, c, k = O.m[0, j], O.c[0, j], O.k[0, j]
        A, B = [[0, 1], [-k / m, -c / m]], [[0, c / m], [1 / m, k / m - (c / m) ** 2]]
        start = [moved[0, j] + F[0, j] / k, -c / m * moved[0, j]]
        both = np.column_stack([F[:, j], moved[:, j]])
        expected = lsim((A, B, [[1, 0]], [[0, 0]]), both, TIME[:600], X0=start)[1]
        np.testing.assert_allclose(y[:, j], expected, atol=1e-12)


def test_the_dynamic_offset_leaves_nothing_and_the_static_one_something() -> None:
    F = force()
    static, dynamic = (compensate(O, F, STEP, model=m) for m in ("static", "dynamic"))
    before, left = dynamic.rms()
    assert left < 5e-3 * before  # the offset is straight between samples of 0.4 ms
    assert static.rms()[1] > 20 * left
    # a constant force: both the same, once the offset has settled
    still = np.tile([[100.0, -50.0, 20.0]], (9, 1))
    np.testing.assert_allclose(path_offset(O, still, STEP), -still / O.k, rtol=1e-12)
    np.testing.assert_allclose(tool_error(O, still, STEP, -still / O.k), 0, atol=1e-18)


def test_second_order_in_the_step() -> None:
    left = []
    for n in (1, 2, 4):
        step = STEP / n
        t = step * np.arange(600 * n + 1)
        F = 1e3 * np.sin(60 * t)[:, None] ** 2 * [1.0, 0.5, 0.2]
        left.append(compensate(O, F, step).rms()[1])
    assert np.allclose(np.log2(np.array(left[:2]) / left[1:]), 2, atol=0.15)


def test_a_robot_that_follows_only_slow_offsets_removes_the_mean() -> None:
    F = force()
    slow = compensate(O, F, STEP, bandwidth=5.0)
    late = slice(2000, 3500)
    mean = np.linalg.norm(slow.before[late].mean(axis=0)), np.linalg.norm(slow.after[late].mean(axis=0))
    assert mean[1] < 0.02 * mean[0]
    # the vibration at the teeth's frequency stays
    np.testing.assert_allclose(slow.after[late].std(axis=0), slow.before[late].std(axis=0), rtol=0.05)


def test_an_error_of_the_model_shows() -> None:
    F = force()
    soft = compensate(O, F, STEP, bandwidth=5.0, true=Oscillators(O.m, O.c, 0.8 * O.k))
    # a quarter more deflection than was offset: the mean error is a quarter of what the model took away
    late = slice(2000, 3500)
    left, removed = soft.after[late].mean(axis=0), soft.offset[late].mean(axis=0)
    np.testing.assert_allclose(left, -0.25 * removed, rtol=0.1)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: path_offset(O, force(), STEP, model="magic"), "the model is 'magic'; expected one of static, dynamic"),
        (lambda: path_offset(O, force(), STEP, bandwidth=1e4), "bandwidth is 10000 Hz; expected between 0 and 1250 Hz"),
        (lambda: path_offset(O, np.zeros((5, 2)), STEP), r"the force has the shape \(5, 2\)"),
        (lambda: tool_error(O, np.zeros((5, 3)), STEP, np.zeros((4, 3))), r"the offset has the shape \(4, 3\)"),
        (lambda: tool_error(O, np.zeros((5, 3)), 0.0), "the step is 0 s"),
    ],
)
def test_wrong_inputs(make, sentence) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()
