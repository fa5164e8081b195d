"""Any compiled model as a process: Jacobians, covariance of its noise, and what a turn or a sign may not change."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering import ErrorState, InitialState, ProcessModel, Readings, Sensor, System, make
from gtmodel.filtering.transition import CurvedTransition
from tests.support import turning_body as body

JACOBIAN = 1e-7  # of the scale of the entries
TURNED = 1e-10
H = 1e-3  # s
STEP = 2e-3  # of the differences, fourth order: their error is 1e-11


class DisturbedL1(gt.Model):
    """The L1 with its motor forces as known inputs, and forces on the carts that nobody measures."""

    robot = gt.part(gt.robots.gantry_tau("l1_tape"))
    command = gt.input(3, unit="N")
    disturbance = gt.input(3, unit="N")

    def equations(self) -> Any:
        yield self.robot.tau == self.command + self.disturbance


class ElasticTool(gt.Model):
    """A tool on a spring that stiffens, its base driven by white jerk: motor positions and an accelerometer."""

    soft = gt.parameter(400.0, unit="1/s2")
    stiffening = gt.parameter(1e4, unit="1/m2")
    damping = gt.parameter(2.0, unit="1/s")
    motor = gt.variable(unit="m")
    v = gt.variable(unit="m/s")
    a = gt.variable(unit="m/s2")
    z = gt.variable(unit="m")
    w = gt.variable(unit="m/s")
    jerk = gt.input(unit="m/s3")
    force = gt.input(unit="m/s2")
    felt = gt.variable(unit="m/s2")

    def equations(self) -> Any:
        d = self.motor - self.z
        yield gt.der(self.motor) == self.v
        yield gt.der(self.v) == self.a
        yield gt.der(self.a) == self.jerk
        yield gt.der(self.z) == self.w
        yield self.felt == self.soft * d * (1 + self.stiffening * d**2) + self.damping * (self.v - self.w)
        yield gt.der(self.w) == self.felt + self.force


L1_STATES = ["robot.T", "der(robot.T)"]


@pytest.fixture(scope="module")
def l1() -> System:
    process = ProcessModel(DisturbedL1(), {"disturbance": 4.0}, inputs=["command"], states=L1_STATES)
    sensors = [Sensor("carts", "robot.q", deviation=1e-5), Sensor("tracker", "robot.T", deviation=2e-5)]
    return System(process, sensors)


@pytest.fixture(scope="module")
def tool() -> System:
    states = ["motor", "v", "a", "z", "w"]
    process = ProcessModel(ElasticTool(), {"jerk": 10.0, "force": 0.01}, states=states)
    return System(process, [Sensor("motor", deviation=1e-5), Sensor("unit", "felt", deviation=0.07)])


@pytest.fixture(scope="module")
def rigid() -> System:
    return body.tracked()


def points(system: System, rng: np.random.Generator, count: int = 8) -> np.ndarray:
    """States inside the workspace, with rates."""
    n = system.space.dimension
    scale = np.concatenate([np.full(p.dimension, SCALES.get(p.name, 1.0)) for p in system.space.parts])
    centre = system.space.point({"robot.T": [0.5, -0.9, 0.3]} if "robot.T" in _names(system) else {})
    return system.space.plus(np.tile(centre, (count, 1)), rng.uniform(-1, 1, (count, n)) * scale)


SCALES = {"robot.T": 0.1, "motor": 0.01, "z": 0.01, "Q": 1.5, "w": 3.0, "alpha": 20.0, "a": 5.0}


def _names(system: System) -> list[str]:
    return [part.name for part in system.space.parts]


def differences(space_out: Any, space: Any, f: Any, x: np.ndarray) -> np.ndarray:
    """d minus(f(plus(x, d)), f(x)) / dd (m, k, n) by differences of fourth order."""
    at, columns = f(x), []
    steps = STEP * np.concatenate([np.full(p.dimension, min(1.0, SCALES.get(p.name, 1.0))) for p in space.parts])
    for n, step in enumerate(steps):
        total = 0.0
        for factor, weight in ((1, 8), (-1, -8), (2, -1), (-2, 1)):
            d = np.zeros((len(x), space.dimension))
            d[:, n] = factor * step
            total = total + weight * space_out.minus(f(space.plus(x, d)), at)
        columns.append(total / (12 * step))
    return np.stack(columns, axis=2)


@pytest.mark.parametrize("name", ["rigid", "l1", "tool"])
def test_jacobians_are_those_of_differences_on_the_manifold(name, request):
    system: System = request.getfixturevalue(name)
    x = points(system, np.random.default_rng(7))
    u = np.full(sum(system.dynamics.inputs.values()), 30.0)
    step = system.transition(0.0, H, x, u, u)
    other = differences(system.space, system.space, lambda y: system.transition(0.0, H, y, u, u).x, x)
    assert np.max(np.abs(step.F - other)) < JACOBIAN
    names = tuple(system.sensors)
    seen = system.group(names).space
    H_ = system.reading(names)(0.0, x, u, system.read(names, 0.0, x, u))[1]
    other = differences(seen, system.space, lambda y: system.read(names, 0.0, y, u), x)
    assert np.max(np.abs(H_ - other)) < JACOBIAN * max(1.0, np.abs(other).max())


def test_the_l1_under_unknown_forces_is_tracked_from_its_carts(l1):
    # synthetic: the true motion is the model's own, with steps of force that the filter only knows as noise
    t = 0.004 * np.arange(120)
    rng = np.random.default_rng(5)
    command = np.column_stack([40 * np.sin(8 * t), 25 * np.cos(5 * t), -20 * np.sin(6 * t)])
    x, u_now = l1.space.point({"robot.T": [0.5, -0.9, 0.3]})[None], command[0]
    truth, deviation = [x[0]], np.sqrt(4.0 / 0.004)
    for k in range(1, len(t)):
        pushed = rng.normal(size=3) * deviation
        x = l1.transition(t[k - 1], 0.004, x, u_now + pushed, command[k] + pushed).x
        u_now = command[k]
        truth.append(x[0])
    truth = np.array(truth)
    carts = l1.read(("carts",), 0.0, truth, np.zeros(3))
    log = {"carts": Readings(t, carts + rng.normal(size=carts.shape) * 1e-5)}
    start = InitialState({"robot.T": truth[0, :3]}, {"robot.T": 1e-3, "der(robot.T)": 1e-2})
    given = gt.Trajectory(t, {"command": command}, {"command": "N"})
    for name in ("ekf", "iekf", "ukf"):
        run = make(name, l1).run(
            log, start, inputs=given, truth={"robot.T": truth[:, :3], "der(robot.T)": truth[:, 3:]}
        )
        assert run.status == gt.results.SolveStatus.SOLVED
        assert 6 * 0.6 < run.nees[20:].mean() < 6 * 1.6  # one run: NEES is correlated in time, so no exact band
        assert run.nis.mean() == pytest.approx(3.0, abs=3.3 * np.sqrt(2 * 3 / len(t)))  # 99.9 % band


class TestCovarianceOfNoise:
    def curved(self, system: System) -> CurvedTransition:
        return CurvedTransition(system.dynamics, system.space, system.rates, 1.0)

    @pytest.mark.parametrize("dt", [1e-3, 0.01, 0.1])
    def test_three_integrators_are_van_loan_s(self, dt):
        process = ProcessModel(gt.filtering.TranslatingBody(), {"jerk": 0.3}, states=["p", "v", "a"])
        system = System(process, [Sensor("p", deviation=1.0)])
        u = np.zeros(0)
        exact, made = (s(0.0, dt, np.zeros((1, 9)), u, u) for s in (system.transition, self.curved(system)))
        scale = np.sqrt(np.outer(np.diag(exact.Q), np.diag(exact.Q)))
        assert np.max(np.abs(made.Q[0] - exact.Q) / scale) < 1e-13

    def test_an_oscillator_is_van_loan_s_to_the_order_of_the_step(self):
        class Oscillator(gt.Model):
            x = gt.variable(unit="m")
            v = gt.variable(unit="m/s")
            f = gt.input(unit="m/s2")
            stiffness = gt.parameter(100.0, unit="1/s2")
            damping = gt.parameter(2.0, unit="1/s")

            def equations(self) -> Any:
                yield gt.der(self.x) == self.v
                yield gt.der(self.v) == self.f - self.stiffness * self.x - self.damping * self.v

        system = System(ProcessModel(Oscillator(), {"f": 1.0}, states=["x", "v"]), [Sensor("x", deviation=1.0)])
        assert system.linear
        u, errors = np.zeros(0), []
        for dt in (0.02, 0.01, 0.005):
            exact, made = (s(0.0, dt, np.zeros((1, 2)), u, u).Q for s in (system.transition, self.curved(system)))
            errors.append(np.max(np.abs(made[0] - exact) / np.sqrt(np.outer(np.diag(exact), np.diag(exact)))))
        assert errors[-1] < 1e-8
        assert np.log2(errors[0] / errors[1]) > 3.5 and np.log2(errors[1] / errors[2]) > 3.5

    @pytest.mark.parametrize(("name", "bound"), [("rigid", 0.01), ("l1", 0.01), ("tool", 0.01)])
    def test_of_one_step_it_is_that_of_many_small_ones(self, name, bound, request):
        # the Jacobian at the begin of a step stands for the whole step: the error falls with its length
        system: System = request.getfixturevalue(name)
        x = points(system, np.random.default_rng(3), 4)
        u, parts, errors = np.full(sum(system.dynamics.inputs.values()), 30.0), 64, []
        for dt in (H, H / 2):
            one = system.transition(0.0, dt, x, u, u)
            fine = system.transition(0.0, dt / parts, x, u, u)
            for k in range(1, parts):
                fine = fine.then(system.transition(k * dt / parts, dt / parts, fine.x, u, u))
            scale = np.sqrt(fine.Q.diagonal(0, 1, 2))
            errors.append(np.max(np.abs(one.Q - fine.Q) / scale[:, :, None] / scale[:, None, :]))
        assert errors[0] < bound
        assert errors[1] < 0.6 * errors[0]


QUARTER = np.array([0.5, 0.5, -0.5, 0.5])  # scalar first


def rotation(q: np.ndarray) -> np.ndarray:
    return np.array([body.turned_back((q * [1, -1, -1, -1])[None], e[None])[0] for e in np.eye(3)]).T


def times(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """p * q for rows q."""
    s, u = p[0], p[1:]
    return np.column_stack([s * q[:, 0] - q[:, 1:] @ u, s * q[:, 1:] + q[:, :1] * u + np.cross(u, q[:, 1:])])


def test_turning_the_whole_scene_turns_the_estimate():
    t = H * np.arange(300)
    log, start = body.noisy(t, 4), body.beginning()
    turn = np.array([0.3, -0.5, 0.7, np.sqrt(1 - 0.83)])
    R = rotation(turn)
    assert np.allclose(R @ R.T, np.eye(3))
    run = ErrorState(body.tracked()).run(log, start)
    turned_log = dict(log, position=Readings(t, log["position"].values @ R.T))
    turned_log["orientation"] = Readings(t, times(turn, log["orientation"].values))
    mean = {n: R @ v if n in ("p", "v", "a") else v for n, v in start.mean.items()}
    mean["Q"] = times(turn, np.array([start.mean["Q"]]))[0]
    turned = ErrorState(body.tracked(gravity=R @ body.G)).run(turned_log, InitialState(mean, body.SPREAD))
    for name in ("p", "v", "a"):
        assert np.max(np.abs(turned[name] - run[name] @ R.T)) < TURNED * max(1.0, np.abs(run[name]).max())
    back = times(turn * [1, -1, -1, -1], turned["Q"])
    assert np.max(np.abs(back * np.sign(np.sum(back * run["Q"], axis=1))[:, None] - run["Q"])) < TURNED
    assert np.max(np.abs(turned["w"] - run["w"])) < TURNED
    assert np.max(np.abs(turned["alpha"] - run["alpha"]) / run.deviation["alpha"]) < TURNED
    assert np.allclose(turned.nis, run.nis, rtol=1e-8)


SIGNS = ["ekf", "iekf", "ukf", "imm", "particle"]


@pytest.mark.parametrize("name", SIGNS)
def test_the_sign_of_a_measured_quaternion_changes_nothing(name, rigid):
    t = H * np.arange(60)
    log = body.noisy(t, 9)
    signs = np.where(np.random.default_rng(2).random(len(t)) < 0.5, -1.0, 1.0)
    flipped = dict(log, orientation=Readings(t, log["orientation"].values * signs[:, None]))
    system: Any = [rigid, rigid.with_(noise={"angular_jerk": 1e6})] if name == "imm" else rigid
    options = {"particles": 50} if name == "particle" else {}
    runs = [make(name, system, **options).run(given, body.beginning()) for given in (log, flipped)]
    assert np.array_equal(runs[0].x, runs[1].x)
    assert np.array_equal(runs[0].log_likelihood, runs[1].log_likelihood)


def test_of_an_additive_quaternion_filter_it_changes_the_estimate():
    t = H * np.arange(60)
    process = ProcessModel(body.TrackedBody(), body.DENSITIES, states=body.STATES)
    d = body.DEVIATIONS
    sensors = [Sensor("position", "p", deviation=d["position"]), Sensor("orientation", "Q", deviation=d["orientation"])]
    system = System(process, sensors)
    log = {name: r for name, r in body.noisy(t, 9).items() if name in system.sensors}
    start = body.beginning()
    runs = {}
    for sign in (1.0, -1.0):
        given = dict(log, orientation=Readings(t, log["orientation"].values * np.where(t > 0.03, sign, 1.0)[:, None]))
        runs[sign] = make("additive", system, quaternions=["Q"]).run(given, start)
    assert np.allclose(np.linalg.norm(runs[1.0]["Q"], axis=1), 1.0, rtol=0, atol=1e-14)
    # with the sign that it expects it agrees with the filter of the error of the state ...
    own = ProcessModel(body.TrackedBody(), body.DENSITIES, states=body.STATES, quaternions=["Q"])
    other = System(own, [sensors[0], Sensor("orientation", "Q", deviation=2 * d["orientation"], kind="quaternion")])
    errors = ErrorState(other).run(log, start)
    assert np.max(np.abs(errors["Q"] - runs[1.0]["Q"])) < 3 * d["orientation"]
    # ... with the other one it is lost
    assert np.max(np.abs(runs[-1.0]["w"] - runs[1.0]["w"])) > 10.0
