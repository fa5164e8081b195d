"""Guideways that are not straight: tangent and force balance, against numpy and scipy, and in both robots."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import gtmodel as gt
from gtmodel import mechanics as m
from gtmodel.robots import on_guideways, six_link_gantry_tau
from tests.mechanics.balance import power_balance

ROUND_OFF = 1e-13
ROUND_TRIP = 1e-10  # m: the bound that is asked for; found are a few 1e-15
A, V = np.array([0.2, -1.3, 1.4]), np.array([0.97, -0.05, 0.01])
CASES = ["PiecewiseLinearGuideway", "PiecewiseLinearCyclicGuideway", "SplineGuideway"]
# synthetic: deviations of the size of Dressler 2012, Tables 4.1 and 4.2, at seven places, seed 7
AT = np.array([-0.65, -0.4, -0.25, 0.0, 0.3, 0.5, 0.7])
DEVIATION = 6e-5 * np.random.default_rng(7).standard_normal((3, len(AT), 3))
PERIOD, SINE, COSINE = 0.0131, 4e-5 * V, -2e-5 * V


def guideway(name: str, arm: int = 1, scale: float = 1.0) -> gt.Model:
    cyclic = dict(period=PERIOD, sine=SINE, cosine=COSINE) if "Cyclic" in name else {}
    return getattr(m, name)(at=AT, deviation=scale * DEVIATION[arm], **cyclic)


def position(name: str, q: np.ndarray, scale: float = 1.0, arm: int = 1) -> np.ndarray:
    """r(q) inside the points, by numpy or scipy."""
    e = scale * DEVIATION[arm]
    if name == "SplineGuideway":
        offset = CubicSpline(AT, e, bc_type="natural")(q)
    else:
        offset = np.column_stack([np.interp(q, AT, e[:, k]) for k in range(3)])
    if "Cyclic" in name:
        angle = (2 * np.pi * q / PERIOD)[:, None]
        offset = offset + np.sin(angle) * SINE + np.cos(angle) * COSINE
    return A + q[:, None] * V + offset


class Slide(gt.Model):
    """A guideway alone: moved at its flange, loaded at its frame."""

    q = gt.variable(unit="m")
    r = gt.variable(3, unit="m")
    push = gt.variable(unit="N")
    f = gt.input(3, unit="N")
    guideway = gt.part(m.Guideway, A=A, v=V)
    motor = gt.part(m.ForceMotor)
    load = gt.part(m.PointLoad)

    def equations(self):
        yield gt.connect(self.guideway.flange, self.motor.flange)
        yield gt.connect(self.guideway.frame, self.load.frame)
        yield self.q == self.guideway.flange.s
        yield self.r == self.guideway.frame.r
        yield self.push == self.motor.force
        yield self.f == self.load.force


@cache
def slide(name: str, scale: float = 1.0) -> gt.Model:
    return Slide(guideway=guideway(name, scale=scale))


def call(model: gt.Model, known: Any, targets: Any, **given: Any) -> list[np.ndarray]:
    f = model.causal(known, targets)
    *found, status = f(*[given[s.name] for s in f.inputs])
    assert np.all(status == gt.Status.OK)
    return found


@pytest.mark.parametrize("name", CASES)
def test_position_is_that_of_numpy_and_scipy(name):
    q = np.concatenate([np.linspace(-0.65, 0.7, 200), AT])
    (r,) = call(slide(name), "q", ["r"], q=q)
    assert np.max(np.abs(r - position(name, q))) < ROUND_OFF


@pytest.mark.parametrize("name", CASES)
def test_velocity_and_force_go_with_the_tangent(name):
    # a thousandfold deviation, so that the tangent is far from v; kinks are kept out of the central difference
    scale, h = 1000.0, 1e-5
    rng = np.random.default_rng(1)
    q = rng.uniform(-0.6, 0.65, 100)
    q = q[np.min(np.abs(q[:, None] - AT), axis=1) > h]
    force, speed = rng.normal(size=(len(q), 3)), rng.normal(size=len(q))
    tangent = (position(name, q + h, scale) - position(name, q - h, scale)) / (2 * h)
    velocity, push = call(slide(name, scale), ["q", "f"], ["der(r)", "push"], q=q, f=force, **{"der(q)": speed})
    assert np.max(np.abs(tangent - V)) > 0.1
    # the third derivatives, up to (2 pi / period)^3 4e-5, times h^2 / 6
    assert np.max(np.abs(velocity / speed[:, None] - tangent)) < 1e-7
    assert np.max(np.abs(push + np.sum(force * tangent, axis=1))) < 1e-6
    # virtual work: what the motor puts in comes out at the frame
    work = push * speed + np.sum(force * velocity, axis=1)
    assert np.max(np.abs(work)) < ROUND_OFF * np.max(np.abs(push * speed)) * 10


def test_without_deviations_it_is_the_straight_one():
    q = np.linspace(-2, 2, 41)
    (straight,) = call(Slide(), "q", ["r"], q=q)
    for name in ("PiecewiseLinearGuideway", "SplineGuideway"):
        assert np.array_equal(call(slide(name, 0.0), "q", ["r"], q=q)[0], straight)


def test_power_balance_of_a_robot_on_splines():
    robot = gt.robots.gantry_tau(
        "l1_tape", m_a=[2.0, 2.0, 2.0], arm=[dict(guideway=guideway("SplineGuideway", i, 300.0)) for i in range(3)]
    )
    values = {"T": [0.9, -0.8, 0.3], "der(T)": [0.5, -0.3, 0.4], "der(T,2)": [2.0, 1.0, -3.0]}
    assert power_balance(robot, values, "T") < 1e-12


class TestRobots:
    @pytest.mark.parametrize("name", CASES)
    def test_three_link_round_trip(self, name):
        scale = 20.0  # deviations above a millimetre, kinks of up to 2 per cent
        arms = [dict(guideway=guideway(name, i, scale)) for i in range(3)]
        robot = gt.robots.gantry_tau("l1_tape", arm=arms)
        T = np.array([1.4, -0.9, 0.3]) + np.random.default_rng(2).uniform(-1, 1, (100, 3)) * [0.9, 0.4, 0.4]
        (q,) = call(robot, "T", ["q"], T=T)
        (back,) = call(robot, "q", ["T"], q=q)
        assert np.max(np.abs(back - T)) < ROUND_TRIP
        # the carts by numpy close the links, where all three are within their points
        rows = np.all((q > AT[0]) & (q < AT[-1]), axis=1)
        assert np.sum(rows) > 10
        for i in range(3):
            e = position(name, q[rows, i], scale, i)
            cart = e - A - q[rows, i, None] * V + np.array(robot.A[i]) + q[rows, i, None] * np.array(robot.v[i])
            length = np.linalg.norm(T[rows] - cart, axis=1)
            assert np.max(np.abs(length - robot.L[i])) < ROUND_TRIP

    def test_six_link_round_trip(self):
        # one of each kind: a six-link robot takes seconds to compile
        robot = six_link_gantry_tau(**on_guideways([guideway(name, i) for i, name in enumerate(CASES)]))
        T = np.array(robot.home) + np.random.default_rng(4).uniform(-0.4, 0.4, (60, 3))
        q, e = call(robot, "T", ["q", "e"], T=T)
        back, e_back = call(robot, "q", ["T", "e"], q=q)
        assert np.max(np.abs(back - T)) < ROUND_TRIP
        assert np.max(np.abs(e_back - e)) < ROUND_TRIP

    def test_a_solution_on_a_kink(self):
        robot = gt.robots.gantry_tau("l1_tape", arm=dict(guideway=guideway("PiecewiseLinearGuideway", 1, 20.0)))
        q = np.array([[0.3, 0.5, 0.3], [0.0, 0.0, 0.0], [0.7, 0.7, 0.7], [-0.25, -0.25, -0.25]])
        (T,) = call(robot, "q", ["T"], q=q)
        assert np.max(np.abs(call(robot, "T", ["q"], T=T)[0] - q)) < ROUND_TRIP

    def test_a_guideway_leaves_rod_and_friction_of_the_catalogue_alone(self):
        part = dict(guideway=m.PiecewiseLinearGuideway(at=AT, deviation=0.0 * DEVIATION[0]))
        options = dict(smoothing="piecewise_linear", rod=m.UniformRod, m_a=[2.0, 3.0, 4.0])
        # slow enough for tanh and straight line to differ by 3 N, MidpointRod and UniformRod by more
        motion = {"T": [1.4, -0.9, 0.3], "der(T)": [0.02, 0.01, -0.03], "der(T,2)": [1.0, 2.0, 3.0]}
        arms = ({}, part, [part] * 3)
        straight, *bent = (
            call(gt.robots.gantry_tau("l1_tape", arm=arm, **options), "T", ["tau"], **motion)[0] for arm in arms
        )
        for tau in bent:
            assert np.max(np.abs(tau - straight)) < 1e-10 * np.max(np.abs(straight))

    def test_another_number_of_guideways(self):
        with pytest.raises(gt.ModelError, match="one guideway per arm, three; found 2"):
            on_guideways([m.Guideway, m.Guideway])

    def test_a_misspelt_word_and_missing_points(self):
        with pytest.raises(gt.ModelError, match="did you mean 'deviation'"):
            m.SplineGuideway(at=AT, deviations=DEVIATION[0])
        with pytest.raises(gt.ModelError, match=r"arm\[0\].guideway.at' of shape \(n,\) has no value"):
            gt.robots.gantry_tau("l1_tape", arm=dict(guideway=m.SplineGuideway)).causal("q", "T")
