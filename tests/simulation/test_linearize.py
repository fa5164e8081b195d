"""Linear models: against finite differences, formulas, and the nonlinear motion itself."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.linalg import eigh

import gtmodel as gt
from gtmodel import ModelError, der
from gtmodel.simulation import linearize, natural_modes, simulate
from tests.simulation.models import DriveTrain, FourBarInAngles, TwoMasses
from tests.simulation.robot import T0, l1
from tests.support.models import Pendulum, SeriesRLC

ROUND_OFF = 1e-10
# central differences with steps of 1e-5: their square times third derivatives of some 10
DIFFERENCES = 1e-7


def differences(f, x, h=1e-5):
    columns = [(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(len(x))]
    return np.column_stack(columns)


class TestPendulum:
    @pytest.mark.parametrize("side", [-1.0, 1.0])
    def test_hanging_and_standing(self, side):
        system = linearize(Pendulum(L=0.5), [], ["x", "der(x)"], start={"x": 0.0, "y": 0.5 * side, "der(x)": 0.0})
        assert list(system.state_labels) == ["x", "der(x)"]
        # x'' = side g / L x
        assert np.asarray(system.A) == pytest.approx(np.array([[0.0, 1.0], [side * 9.81 / 0.5, 0.0]]), abs=ROUND_OFF)
        assert np.asarray(system.C) == pytest.approx(np.eye(2), abs=ROUND_OFF)
        assert system.params["rates"] == {"x": pytest.approx(0.0), "der(x)": pytest.approx(0.0)}
        if side < 0:
            (mode,) = natural_modes(system)
            assert mode.frequency_Hz == pytest.approx(np.sqrt(9.81 / 0.5) / (2 * np.pi), rel=1e-12)
            assert mode.damping == pytest.approx(0.0, abs=1e-12) and set(mode.states) <= {"x", "der(x)"}

    def test_beside_the_pivot_in_the_height(self):
        system = linearize(Pendulum(), [], ["y", "x"], start={"x": 1.0, "y": 0.0, "der(y)": 0.0})
        assert list(system.state_labels) == ["y", "der(y)"]
        assert system.params["rates"]["der(y)"] == pytest.approx(-9.81)

    def test_in_full_swing(self):
        f = Pendulum().causal((), "der(x,2)", prefer="x")
        x = np.array([0.6, 1.3])
        system = linearize(Pendulum(), [], ["x", "y"], start={"x": 0.6, "y": -0.8, "der(x)": 1.3})
        assert np.asarray(system.A)[1] == pytest.approx(
            differences(lambda s: np.array([f(*s)[0]]), x)[0], abs=DIFFERENCES
        )


class TestRobot:
    def test_against_finite_differences(self):
        robot = l1()
        point = {"T": T0, "der(T)": [0.3, -0.2, 0.1]}
        tau = np.array([50.0, 20.0, -30.0])
        system = linearize(robot, "tau", ["T", "q"], start=point, input_values={"tau": tau}, prefer="T")
        f = robot.causal("tau", "der(T,2)", prefer="T")
        order = [
            list(system.state_labels).index(f"{a}T[{i}]{b}") for a, b in (("", ""), ("der(", ")")) for i in range(3)
        ]
        x = np.concatenate([T0, point["der(T)"]])
        by_state = differences(lambda s: f(s[:3], s[3:], tau)[0], x)
        by_force = differences(lambda u: f(x[:3], x[3:], u)[0], tau, 1.0)
        A, B, C = (np.asarray(m) for m in (system.A, system.B, system.C))
        rows = order[3:]
        assert A[np.ix_(rows, order)] == pytest.approx(by_state, rel=1e-6, abs=1e-5)
        assert B[rows] == pytest.approx(by_force, rel=1e-8)
        ik = robot.causal("T", "q")
        assert C[3:][:, order[:3]] == pytest.approx(differences(lambda T: ik(T)[0], T0), abs=DIFFERENCES)
        assert C[:3][:, order] == pytest.approx(np.eye(3, 6), abs=ROUND_OFF)
        assert np.asarray(system.D) == pytest.approx(np.zeros((6, 3)), abs=ROUND_OFF)
        assert list(system.input_labels) == [f"tau[{i}]" for i in range(3)]
        assert list(system.output_labels) == [f"{n}[{i}]" for n in "Tq" for i in range(3)]
        rates = system.params["rates"]
        assert [rates[f"der(T[{i}])"] for i in range(3)] == pytest.approx(f(x[:3], x[3:], tau)[0], abs=1e-9)

    def test_a_small_push_moves_the_robot_as_its_linear_model_says(self):
        robot = l1(friction=0.3)
        hold = robot.causal("T", "tau")(T0, np.zeros(3), np.zeros(3))[0]
        system = linearize(robot, "tau", "T", start={"T": T0, "der(T)": 0.0}, input_values={"tau": hold}, prefer="T")
        assert all(abs(r) < 1e-9 for r in system.params["rates"].values())
        t = np.linspace(0.0, 0.2, 21)
        push = np.array([1.0, -0.5, 0.8])
        y = control.forced_response(system, t, np.outer(push, np.ones(21))).outputs
        moved = []
        for size in (0.1, 0.2):
            run = simulate(
                robot,
                0.2,
                step=0.01,
                inputs={"tau": hold + size * push},
                start={"T": T0, "der(T)": 0.0},
                tolerance=1e-11,
            )
            moved.append(np.max(np.abs((run.trajectory["T"] - T0).T / size - y)))
        # what the linear model leaves out grows with the push
        assert moved[0] < 2e-3 * np.max(np.abs(y)) and moved[1] > 1.5 * moved[0]


def test_newton_unknowns_follow_the_states():
    model = FourBarInAngles()
    start = {"phi": 0.5, "der(phi)": 2.0}
    system = linearize(model, "torque", ["psi", "der(psi)"], start=start)
    f = model.causal("torque", ["der(phi,2)", "psi", "der(psi)"], prefer="phi")
    x = np.array([0.5, 2.0])
    expected = differences(lambda s: np.array(f(*s, 0.0)[:3]), x)
    assert np.asarray(system.A) == pytest.approx(np.array([[0.0, 1.0], expected[0]]), abs=DIFFERENCES)
    assert np.asarray(system.C) == pytest.approx(expected[1:], abs=DIFFERENCES)
    assert np.asarray(system.B)[1, 0] == pytest.approx(f(*x, 1.0)[0] - f(*x, 0.0)[0], abs=ROUND_OFF)


class TestModes:
    def test_of_two_masses_against_the_eigenvalue_problem(self):
        model = TwoMasses()
        M, _, S = model.matrices()
        system = linearize(model, "F", "s")
        found = natural_modes(system)
        expected = np.sqrt(eigh(S, M, eigvals_only=True)) / (2 * np.pi)
        assert [m.frequency_Hz for m in found] == pytest.approx(expected, rel=1e-10)
        assert [m.damping for m in found] == pytest.approx([0.0, 0.0], abs=1e-10)

    def test_with_damping_against_the_matrix_polynomial(self):
        model = TwoMasses(d=[3.0, 8.0])
        M, Dm, S = model.matrices()
        companion = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, S), -np.linalg.solve(M, Dm)]])
        expected = sorted((e for e in np.linalg.eigvals(companion) if e.imag > 0), key=abs)
        found = natural_modes(linearize(model, "F", "s"))
        assert [m.eigenvalue for m in found] == pytest.approx(expected, rel=1e-10)
        assert [m.damping for m in found] == pytest.approx([-e.real / abs(e) for e in expected], rel=1e-10)

    def test_of_the_drive_train(self):
        found = natural_modes(linearize(DriveTrain(), "torque", "phi"))
        w = np.sqrt(4e3 * (1 / (1e-3 * 50.0**2) + 1 / 5.0))
        assert found[-1].frequency_Hz == pytest.approx(w / (2 * np.pi), rel=1e-10)
        assert all(m.frequency_Hz < 1e-4 for m in found[:-1])  # it turns freely

    def test_of_the_series_circuit(self):
        system = linearize(SeriesRLC(), "u", "capacitor.v")
        assert list(system.output_labels) == ["capacitor:v"] and "capacitor:v" in system.state_labels
        (mode,) = natural_modes(system)
        assert abs(mode.eigenvalue) == pytest.approx(np.sqrt(1 / (0.5 * 0.1)), rel=1e-12)
        assert mode.damping == pytest.approx(2.0 / (2 * 0.5) / abs(mode.eigenvalue), rel=1e-12)


class TestRefused:
    def test_an_input_whose_derivative_is_needed(self):
        class Lead(gt.Model):
            x = gt.variable(unit="1")
            u = gt.input(unit="1")
            tau = gt.parameter(1.0, unit="s")

            def equations(self):
                yield self.tau * der(self.x) == self.u + self.tau * der(self.u) - self.x

        with pytest.raises(ModelError, match="the model needs the derivative of input 'u'; filter it first"):
            linearize(Lead(), "u", "x")

    def test_what_control_cannot_hold(self):
        with pytest.raises(ModelError, match="a single output without an input"):
            linearize(Pendulum(), [], "y")

    def test_wrong_names(self):
        with pytest.raises(ModelError, match="has no variable 'v'"):
            linearize(Pendulum(), [], "v")
        with pytest.raises(ModelError, match="input_values: 'x' is not an input"):
            linearize(Pendulum(), [], "y", input_values={"x": 1.0})
        with pytest.raises(ModelError, match="'tau' takes 3 finite numbers"):
            linearize(l1(), "tau", "T", input_values={"tau": [1.0, 2.0]})

    def test_a_misspelt_keyword(self):
        with pytest.raises(TypeError, match="unexpected keyword argument 'starts'"):
            linearize(Pendulum(), [], "y", starts={})  # type: ignore[call-arg]


def test_sign_has_no_slope_to_linearise():
    class Slide(gt.Model):
        u = gt.input(unit="m/s2")
        v = gt.variable(unit="m/s")
        k = gt.parameter(1.0, unit="m/s2")

        def equations(self):
            yield gt.der(self.v) == self.u - self.k * gt.sign(self.v)

    with pytest.raises(gt.ModelError, match=r"'Slide equation 1' contains sign\(\)"):
        gt.linearize(Slide(), "u", "v")
