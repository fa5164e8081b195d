"""Feedforward and computed torque in closed loop: the better the model, the smaller the error."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.control import ComputedTorque, Feedback, Feedforward, track, tracking_loop
from gtmodel.lang import ModelError
from gtmodel.results import Trajectory, TrajectoryError
from gtmodel.robots.catalogue import gantry_tau, make

PLANT = gantry_tau("l1_tape", "model_2", m_a=[0.5, 1.0, 1.5])
NEAR = gantry_tau("l1_tape", "model_2", m_p=9.0, m_c=[13.7, 13.5, 38.6], m_a=[0.6, 0.9, 1.4])  # as if identified
FAR = gantry_tau("l1_tape", "model_1")  # other friction, no link masses
GAINS = (4e4, 2e3)  # N/m, kg/s
RATES = (400.0, 40.0)  # 1/s2, 1/s
CENTRE = np.array([1.0, -0.8, 0.5])
INTEGRATED_M = 1e-5  # of the integrator at 1e-7 of nominals: forces of 1e-5 N and accelerations of some m/s2
TWO_ROADS = 1e-9  # N, of some hundreds


def reference() -> Trajectory:
    t = np.linspace(0.0, 0.5, 51)
    T = CENTRE + 0.06 * np.sin(2 * np.pi * t)[:, None] ** 4 * [1.0, -0.6, 0.8]
    q, status = PLANT.causal("T", "q")(T)
    assert not status.any()
    return Trajectory(t, {"q": q}, {"q": "m"}, synthetic="no noise")


REFERENCE = reference()
START = {"T": CENTRE, "der(T)": np.zeros(3)}


class TestClosedLoop:
    def test_the_error_shrinks_with_the_model(self) -> None:
        laws = {
            "none": Feedback(*GAINS),
            "far": Feedforward(FAR, *GAINS),
            "near": Feedforward(NEAR, *GAINS),
            "exact": Feedforward(PLANT, *GAINS),
        }
        rms = {name: np.max(track(PLANT, law, REFERENCE, START).rms) for name, law in laws.items()}
        assert rms["none"] > 2 * rms["far"] > 4 * rms["near"] > 8 * rms["exact"]
        assert rms["exact"] < INTEGRATED_M

    def test_computed_torque_forgets_an_error_as_its_gains_say(self) -> None:
        off = {"T": CENTRE + np.array([0.02, -0.01, 0.01]), "der(T)": np.zeros(3)}
        run = track(PLANT, ComputedTorque(PLANT, *RATES), REFERENCE, off)
        t, first = REFERENCE.time, run.error[0]
        # critically damped: e = e0 (1 + w t) exp(-w t), whatever the motion and the coupling
        w = np.sqrt(RATES[0])
        np.testing.assert_allclose(run.error, first * ((1 + w * t) * np.exp(-w * t))[:, None], atol=10 * INTEGRATED_M)

    def test_what_the_loop_spends_is_what_the_model_needs(self) -> None:
        run = track(PLANT, Feedforward(PLANT, *GAINS), REFERENCE, START)
        modelled = Feedforward(PLANT).modelled(REFERENCE)
        assert modelled.synthetic == "no noise" and modelled.unit("tau") == "N"
        # the curves through the reference's rows are of third and of fifth degree, and differ in their end pieces
        off = (run.trajectory["forces"] - modelled["tau"])[5:-5]
        assert np.max(np.abs(off)) < 0.01 * modelled.scale("tau")
        assert "simulated" in (run.trajectory.synthetic or "")


class TestForces:
    def test_one_gain_stands_for_all_actuators(self) -> None:
        rows = [ca.SX(ca.DM(x)) for x in np.random.default_rng(2).normal(size=(5, 3))]
        one, three = (law.forces(rows[:3], *rows[3:]) for law in (Feedback(2.0, 3.0), Feedback((2.0,) * 3, (3.0,) * 3)))
        first, second = (ca.DM(e).full() for e in (one, three))
        np.testing.assert_array_equal(first, second)
        assert np.all(first != 0)

    def test_needed_is_the_inverse_dynamics(self) -> None:
        q = REFERENCE["q"]
        v, a = np.gradient(q, REFERENCE.time, axis=0), np.ones_like(q)
        forces, status = Feedforward(PLANT).needed(q, v, a)
        exact, _ = PLANT.causal("q", "tau")(q, v, a)
        np.testing.assert_allclose(forces, exact, atol=TWO_ROADS)
        assert not status.any()

    def test_given_derivatives_are_taken(self) -> None:
        still = Trajectory(REFERENCE.time, {n: REFERENCE["q"] * (n == "q") for n in ("q", "der(q)", "der(q,2)")})
        gravity = Feedforward(PLANT).modelled(still)["tau"]
        np.testing.assert_allclose(np.sum(gravity, axis=1), 0.0, atol=TWO_ROADS)  # v = (1,0,0), vertical gravity

    def test_any_model_feeds_forward_even_by_newton(self) -> None:
        six: Any = make("d1_six_link")
        T = six.home + 0.05 * np.sin(2 * np.pi * REFERENCE.time)[:, None] ** 4 * np.ones(3)
        law = Feedforward(six, known="T")
        assert np.all(np.isfinite(law.modelled(Trajectory(REFERENCE.time, {"T": T}))["tau"]))


class TestRefusals:
    def test_out_of_reach(self) -> None:
        far = Trajectory(REFERENCE.time, {"q": REFERENCE["q"] + np.linspace(0, 9, 51)[:, None] * [1.0, 0.0, -1.0]})
        with pytest.raises(
            TrajectoryError, match=r"cannot follow the motion at .* s: the input lies outside the range"
        ):
            Feedforward(PLANT).modelled(far)

    def test_gains(self) -> None:
        with pytest.raises(ValueError, match=r"damping must be .*; found -1"):
            Feedback(1.0, -1.0)
        with pytest.raises(ValueError, match="stiffness must be"):
            ComputedTorque(PLANT, (1.0, np.nan, 1.0))

    def test_a_plant_without_forces(self) -> None:
        class Free(gt.Model):
            q = gt.variable(2, unit="m")

            def equations(self):
                yield gt.der(self.q, 2) == 0 * gt.der(self.q, 2)

        with pytest.raises(ModelError, match="must declare 'q' and 'tau' as vectors"):
            tracking_loop(Free(), Feedback(1.0, 1.0))

    @pytest.mark.parametrize("gain", [(1.0, 2.0), (1.0,), (1.0,) * 4, ((1.0, 2.0, 3.0),)])
    def test_gains_of_another_number(self, gain: Any) -> None:
        for law in (Feedback(gain, 1.0), Feedback(1.0, gain), Feedforward(PLANT, gain, 1.0)):
            with pytest.raises(ModelError, match="expected one number, or 3 numbers"):
                tracking_loop(PLANT, law).causal("reference", "plant.q")

    def test_a_motion_in_another_unit(self) -> None:
        wrong = Trajectory(REFERENCE.time, {"q": REFERENCE["q"]}, {"q": "rad"})
        with pytest.raises(TrajectoryError, match="'q' in m; the motion has it in rad"):
            Feedforward(PLANT).modelled(wrong)
