"""Input shaping and residual vibration: closed forms, and an integrator that knows nothing of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gtmodel.control import Shaper, residual_vibration, zero_vibration, zero_vibration_derivative
from gtmodel.results import Trajectory

F, ZETA = 6.0, 0.03
ROUNDING = 1e-12


def motion() -> Trajectory:
    """A trapezoid of velocity, exact between its corners, and its positions, in two directions."""
    t = np.linspace(0.0, 0.8, 1601)
    v = np.interp(t, [0.0, 0.2, 0.6, 0.8], [0.0, 1.0, 1.0, 0.0])[:, None] * [1.0, -0.5]
    x = np.vstack([np.zeros(2), np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t)[:, None], axis=0)])
    return Trajectory(t, {"T": x, "der(T)": v}, {"T": "m", "der(T)": "m/s"})


def test_residual_vibration_is_what_an_integrator_finds():
    m = motion()
    w = 2 * np.pi * F

    def rates(t, x):
        a = np.interp(t, [0.0, 0.1999999, 0.2, 0.5999999, 0.6, 0.8], [5.0, 5.0, 0.0, 0.0, -5.0, -5.0])
        return [x[1], -2 * ZETA * w * x[1] - w * w * x[0] - a]

    end = solve_ivp(rates, (0.0, 0.8), [0.0, 0.0], rtol=1e-10, atol=1e-12, max_step=0.01).y[:, -1]
    w_d = w * np.sqrt(1 - ZETA**2)
    envelope = np.hypot(end[0], (end[1] + ZETA * w * end[0]) / w_d)
    found = residual_vibration(m.time, m["der(T)"], F, ZETA)
    assert found.shape == (2,)
    np.testing.assert_allclose(found, [envelope, envelope / 2], rtol=1e-5)


def test_two_impulses_cancel_and_three_stay_flat():
    for zeta in (0.0, ZETA, 0.3):
        zv, zvd = zero_vibration(F, zeta), zero_vibration_derivative(F, zeta)
        assert zv.residual(F, zeta) < ROUNDING and zvd.residual(F, zeta) < ROUNDING
        assert zv.times[-1] == pytest.approx(0.5 / F / np.sqrt(1 - zeta**2))
        assert zvd.times[-1] == pytest.approx(2 * zv.times[-1])
    # undamped: |cos| and its square; order one and two in the error of the frequency
    r = np.linspace(0.5, 1.5, 21)
    np.testing.assert_allclose(zero_vibration(F).residual(r * F), np.abs(np.cos(np.pi / 2 * r)), atol=ROUNDING)
    np.testing.assert_allclose(zero_vibration_derivative(F).residual(r * F), np.cos(np.pi / 2 * r) ** 2, atol=ROUNDING)


@pytest.mark.parametrize("make", [zero_vibration, zero_vibration_derivative])
def test_a_shaped_motion_leaves_what_the_shaper_says(make):
    m, shaper = motion(), make(F, ZETA)
    shaped = shaper(m, ["T", "der(T)"])
    np.testing.assert_allclose(shaped["T"][-1], m["T"][-1], rtol=1e-12)
    assert shaped.time[-1] == pytest.approx(0.8 + shaper.times[-1])
    assert np.abs(shaped["der(T)"]).max() <= np.abs(m["der(T)"]).max() * (1 + 1e-12)
    still = residual_vibration(shaped.time, shaped["der(T)"], F, ZETA)
    before = residual_vibration(m.time, m["der(T)"], F, ZETA)
    # corners of the trapezoid fall between the shaped motion's times
    assert np.all(still < 1e-4 * before)
    off = residual_vibration(shaped.time, shaped["der(T)"], 1.2 * F, ZETA)
    expected = shaper.residual(1.2 * F, ZETA) * residual_vibration(m.time, m["der(T)"], 1.2 * F, ZETA)
    np.testing.assert_allclose(off, expected, rtol=1e-3)


def turning(axis=(0.0, 0.6, 0.8)) -> Trajectory:
    """A turn by 2 rad about an axis, from rest to rest, as angle, quaternion, axis of the tool and matrix."""
    t = np.linspace(0.0, 0.8, 161)
    angle = 2.0 * (t / 0.8) ** 2 * (3 - 2 * t / 0.8)
    q = np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * np.array(axis)])
    w, v = q[:, :1], q[:, 1:]
    R = np.stack([e + 2 * np.cross(v, np.cross(v, e) + w * e) for e in np.eye(3)], axis=2)
    values = {"angle": angle, "Q": q, "der(Q)": np.gradient(q, t, axis=0), "R": R.reshape(-1, 9), "tool": R[:, :, 0]}
    return Trajectory(t, values, {"angle": "rad", "der(Q)": "1/s"})


@pytest.mark.parametrize("name", ["Q", "R", "tool", "der(Q)", "Q[1]"])
def test_what_lies_on_a_sphere_is_not_added(name):
    with pytest.raises(ValueError, match="shape an angle or a rotation vector"):
        zero_vibration(F)(turning(), [name])
    shaped = zero_vibration(F)(turning(), ["angle"])
    assert shaped["angle"][-1] == pytest.approx(2.0)


@pytest.mark.parametrize("shape", [(), (2,)])
@pytest.mark.parametrize("frequencies", [F, [F, 1.2 * F]])
def test_residual_vibration_of_any_shape(shape, frequencies):
    m = motion()
    velocity = m["der(T)"] if shape else m["der(T)"][:, 0]
    found = residual_vibration(m.time, velocity, frequencies, ZETA)
    assert found.shape == np.shape(frequencies) + shape
    alone = residual_vibration(m.time, m["der(T)"][:, :1], F, ZETA)[0]
    assert found.reshape(-1)[0] == pytest.approx(alone, rel=1e-12)
    with pytest.raises(ValueError, match=r"expected increasing times \(n,\)"):
        residual_vibration(m.time[:-1], velocity, frequencies)


def test_refusals():
    with pytest.raises(ValueError, match="start at 0 and increase"):
        Shaper(np.array([0.1]), np.array([1.0]))
    with pytest.raises(ValueError, match=r"sum to 1; found \[0.4, 0.4\]"):
        Shaper(np.array([0.0, 0.1]), np.array([0.4, 0.4]))
    with pytest.raises(ValueError, match="a mode needs a frequency above 0"):
        zero_vibration(6.0, 1.0)
    moving = Trajectory([0.0, 1.0], {"der(T)": [[1.0], [0.0]]}, {"der(T)": "m/s"})
    with pytest.raises(ValueError, match=r"'der\(T\)' does not begin and end at rest"):
        zero_vibration(F)(moving, ["der(T)"])
    with pytest.raises(ValueError, match="the motion does not begin and end at rest"):
        residual_vibration([0.0, 1.0], [1.0, 0.0], F)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(bad):
    m = motion()
    for times, amplitudes in (([0.0, bad], [0.5, 0.5]), ([0.0, 0.1], [0.5, bad])):
        with pytest.raises(ValueError, match="of a shaper"):
            Shaper(np.array(times), np.array(amplitudes))
    with pytest.raises(ValueError, match="a mode needs"):
        zero_vibration(bad)
    time, velocity = np.array(m.time), np.array(m["der(T)"])
    spoilt = np.arange(len(time)) == 5
    for t, v in ((time, np.where(spoilt[:, None], bad, velocity)), (np.where(spoilt, bad, time), velocity)):
        with pytest.raises(ValueError, match="not all finite"):
            residual_vibration(t, v, F)
