"""Full covariances of readings and noise, processes by matrices and steps with known inputs and time: against the
textbook's recursion in NumPy, and refusals in sentences."""

from __future__ import annotations

from typing import Any

import casadi as ca
import control
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering import (
    DiscreteProcess,
    ErrorState,
    InitialState,
    LinearProcess,
    ProcessModel,
    Readings,
    Sensor,
    StatePart,
    System,
    make,
)
from gtmodel.results import ArgumentError

ROUND_OFF = 1e-10  # relative, of two recursions over a hundred instants in other orders of summation
DT = 0.1
A = np.array([[1.0, DT, 0.0], [0.0, 0.9, 0.1], [0.0, -0.2, 0.8]])
B = np.array([[0.0], [DT], [0.3]])
C = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.0]])
D = np.array([[0.0], [0.1]])
Q = np.array([[0.02, 0.01, 0.0], [0.01, 0.03, -0.005], [0.0, -0.005, 0.01]])
R = np.array([[0.04, 0.03], [0.03, 0.05]])
COUNT = 100


def textbook(z: np.ndarray, u: np.ndarray, a: np.ndarray, q: np.ndarray, drive: Any) -> tuple[np.ndarray, float]:
    """Means (K, 3) and log-likelihood, from a start of mean zero and deviation one that lies on the first reading."""
    x, P, logs, means = np.zeros(3), np.eye(3), 0.0, []
    for k, row in enumerate(z):
        if k:
            x, P = a @ x + drive(k), a @ P @ a.T + q
        S = C @ P @ C.T + R
        e = row - C @ x - D @ u[k]
        K = P @ C.T @ np.linalg.inv(S)
        x, P = x + K @ e, P - K @ S @ K.T
        logs -= 0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2 * np.pi * S)[1])
        means.append(x)
    return np.array(means), logs


def readings(seed: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return DT * np.arange(COUNT), rng.normal(size=(COUNT, 2)), rng.normal(size=(COUNT, 1))


def start(size: int = 3) -> InitialState:
    return InitialState({}, {"x": np.ones(size)})


def known(time: np.ndarray, u: np.ndarray) -> gt.Trajectory:
    return gt.Trajectory(time, {"u": u})


@pytest.mark.parametrize("form", ["matrices", "state space", "step", "step of lists"])
@pytest.mark.parametrize("kind", ["kf", "ukf"])
def test_steps_with_known_inputs_and_full_covariances_are_the_textbooks(form: str, kind: str) -> None:
    time, z, u = readings()
    process: Any
    if form == "matrices":
        process = LinearProcess(A, C, Q, B=B, D=D, period=DT)
    elif form == "state space":
        process = LinearProcess.of(control.StateSpace(A, B, C, D, DT), Q)
    else:
        parts = [StatePart("x", size=3)]

        def step(x: Any, u: Any) -> dict[str, Any]:
            after = ca.DM(A) @ x.x + ca.DM(B) @ u.u
            return {"x": after if form == "step" else [after[0], after[1], after[2]]}

        outputs = {"y": lambda x, u: gt.vector([x.x[0] + 0.5 * x.x[2], x.x[1] + 0.1 * u.u])}
        process = DiscreteProcess(parts, DT, step, Q, outputs, inputs={"u": 1})
    system = System(process, [Sensor("y", covariance=R)])
    run = make(kind, system).run({"y": Readings(time, z)}, start(), inputs=known(time, u))
    means, logs = textbook(z, u, A, Q, lambda k: B @ u[k - 1])
    np.testing.assert_allclose(run["x"], means, rtol=0, atol=ROUND_OFF * 100)
    assert float(run.log_likelihood[0]) == pytest.approx(logs, rel=ROUND_OFF)


def test_a_continuous_state_space_is_that_of_the_matrix_exponential() -> None:
    from scipy.linalg import expm

    time, z, u = readings()
    a = np.array([[0.0, 1.0, 0.0], [-2.0, -0.4, 1.0], [0.0, 0.0, -0.5]])
    process = LinearProcess.of(control.StateSpace(a, np.zeros((3, 1)), C, D), Q)
    run = ErrorState(System(process, [Sensor("y", covariance=R)])).run(
        {"y": Readings(time, z)}, start(), inputs=known(time, u)
    )
    loan = expm(np.block([[-a, Q], [np.zeros((3, 3)), a.T]]) * DT)
    F = loan[3:, 3:].T
    means, logs = textbook(z, u, F, F @ loan[:3, 3:], lambda k: 0)
    np.testing.assert_allclose(run["x"], means, rtol=0, atol=1e-9)
    assert float(run.log_likelihood[0]) == pytest.approx(logs, rel=1e-9)


class Cart(gt.Model):
    """Two axes, driven by two accelerations at random; `bent`: with a drag, so that it is not linear."""

    bent = gt.parameter(0.0)
    x = gt.variable(2, unit="m")
    v = gt.variable(2, unit="m/s")
    a = gt.input(2, unit="m/s2")

    def equations(self) -> Any:
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == self.a - 0.1 * self.bent * gt.vector([self.v[0] ** 3, self.v[1] ** 3])


@pytest.mark.parametrize("bent", [0.0, 1e-9])
def test_full_densities_of_noise_are_those_of_the_covariance_they_leave(bent: float) -> None:
    density = np.array([[0.2, 0.1], [0.1, 0.4]])
    process = ProcessModel(Cart(bent=bent), noise={"a": density}, states=["x", "v"])
    system = System(process, [Sensor("tape", "x", deviation=0.01)])
    assert system.linear == (bent == 0.0)
    run = ErrorState(system).run(
        {"tape": Readings([0.0, 1.0], [[0.0, 0.0], [np.nan, np.nan]])}, InitialState({}, {"x": 1e-9, "v": 1e-9}),
        keep=True,
    )  # fmt: skip
    P = run.covariances[-1]
    expected = np.block([[density / 3, density / 2], [density / 2, density]])
    np.testing.assert_allclose(P, expected, rtol=0, atol=1e-4 if bent else 1e-12)
    for k, name in enumerate(("x", "v")):
        np.testing.assert_array_equal(run.covariance(name)[-1], P[2 * k : 2 * k + 2, 2 * k : 2 * k + 2])
    other = system.with_(noise={"a": 4 * density})
    assert np.allclose(other.transition(0.0, 1.0, np.zeros((1, 4)), *2 * [np.zeros(0)]).Q[..., 2:, 2:], 4 * density)
    with pytest.raises(ArgumentError) as refused:
        system.with_(noise={"a": np.array([[0.2, -0.1], [-0.1, 0.4]])})
    assert refused.value.argument == "noise.a"


def test_a_step_may_depend_on_time() -> None:
    parts = [StatePart("x")]
    process = DiscreteProcess(parts, DT, lambda x, u, t: {"x": x.x + t * u.f}, [1e-12], inputs={"f": 1})
    system = System(process, [Sensor("tape", "x", deviation=1.0)])
    time = DT * np.arange(11)
    log = {"tape": Readings(time[[0, 10]], [[0.0], [np.nan]])}
    force = gt.Trajectory(time, {"f": np.linspace(1.0, 2.0, 11)[:, None]})
    run = ErrorState(system).run(log, InitialState({}, {"x": 1e-6}), inputs=force)
    expected = sum(t * f for t, f in zip(time[:10], np.linspace(1.0, 2.0, 11), strict=False))
    assert float(run.x[-1, 0, 0]) == pytest.approx(expected, abs=1e-9)


def test_tuning_finds_the_noise_of_a_step() -> None:
    system = System(LinearProcess(A, C, Q, period=DT), [Sensor("y", covariance=R)])
    drawn = gt.filtering.draw(system, start(), DT * np.arange(400), seed=3)
    doubtful = system.with_(noise={"w": 9 * Q}, deviations={"y": 2 * system.deviations["y"]})
    tuned = gt.filtering.tune(doubtful, drawn.log, start(), ["w.density", "y.deviation"])
    for name, factor in (("w.density", 1 / 9), ("y.deviation", 1 / 2)):
        low, high = tuned.intervals[name]
        assert low < factor < high
    assert gt.filtering.consistency(ErrorState(system).run(drawn.log, start())).consistent


def test_missing_numbers_of_a_correlated_reading() -> None:
    """The first number alone is what its own variance says."""
    full, alone = (System(LinearProcess(A, C[:n], Q, period=DT), [Sensor("y", covariance=R[:n, :n])]) for n in (2, 1))
    x, y = (
        ErrorState(system).run({"y": Readings([0.0], [[0.7, np.nan][:n]])}, start())
        for system, n in ((full, 2), (alone, 1))
    )
    np.testing.assert_allclose(x["x"], y["x"], rtol=1e-12)


STATE = [StatePart("x", size=2)]


@pytest.mark.parametrize(
    ("changed", "argument"),
    [
        ({"step": lambda x: [x.x]}, "step"),
        ({"step": lambda x: x.x}, "step"),
        ({"step": lambda: {"x": 0}}, "step"),
        ({"step": lambda x, u, t, more: {"x": x.x}}, "step"),
        ({"step": "x"}, "step"),
        ({"step": lambda x: {"x": [1.0, 2.0, 3.0]}}, "step"),
        ({"step": lambda x: {"x": "one"}}, "step"),
        ({"outputs": {"y": 3}}, "outputs.y"),
        ({"inputs": {"u": 0}}, "inputs"),
        ({"covariance": [[1.0, 2.0], [2.0, 1.0]]}, "covariance"),
        ({"covariance": [[1.0, 0.5], [0.0, 1.0]]}, "covariance"),
    ],
)
def test_what_is_no_step_is_refused(changed: dict[str, Any], argument: str) -> None:
    given = {"states": STATE, "period": DT, "step": lambda x: {"x": x.x}, "covariance": [1.0, 1.0], **changed}
    with pytest.raises(ArgumentError) as refused:
        System(DiscreteProcess(**given), [Sensor("y" if "outputs" in changed else "x", deviation=0.1)])
    assert refused.value.argument == argument


@pytest.mark.parametrize(
    ("make_it", "argument"),
    [
        (lambda: LinearProcess(A, C[:, :2], Q), "C"),
        (lambda: LinearProcess(A[:2], C, Q), "A"),
        (lambda: LinearProcess(A, C, Q[:2]), "Q"),
        (lambda: LinearProcess(A, C, Q, B=np.eye(2)), "B"),
        (lambda: LinearProcess.of(control.StateSpace(A, B, C, D, True), Q), "plant"),
        (lambda: LinearProcess.of("plant", Q), "plant"),
        (lambda: System(LinearProcess(A, C, Q), [Sensor("y", covariance=np.zeros((2, 2)))]), "y.covariance"),
        (lambda: System(LinearProcess(A, C, Q), [Sensor("y", covariance=np.eye(3))]), "y.covariance"),
        (lambda: Sensor("y", covariance=R, deviation=1.0), "deviation"),
        (lambda: System(LinearProcess(A, C, Q), [Sensor("z", deviation=1.0)]), "sensors"),
    ],
)
def test_matrices_that_do_not_fit_are_refused(make_it: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as refused:
        make_it()
    assert refused.value.argument == argument


def test_deviations_of_a_full_covariance_change_in_proportion_only() -> None:
    system = System(LinearProcess(A, C, Q), [Sensor("y", covariance=R)])
    twice = system.with_(deviations={"y": 2 * system.deviations["y"]})
    np.testing.assert_allclose(twice.sensors["y"].covariance, 4 * R)
    with pytest.raises(ArgumentError):
        system.with_(deviations={"y": [1.0, 1.0]})
