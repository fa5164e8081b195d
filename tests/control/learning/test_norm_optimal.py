"""Norm-optimal laws: closed form of sigma, equal to matrices by hand, bounds by their conditions of optimality."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from gtmodel.control import learning
from gtmodel.results import SolveStatus
from gtmodel.results.refusal import ArgumentError
from tests.control.learning import by_hand

SAME = 1e-9
OPTIMAL = 1e-7  # of the gradient, over its size without bounds
SOS = scipy.signal.butter(2, 10.0, fs=250, output="sos")


def tool(size: int) -> learning.Lifted:
    return learning.flexible_axis(11.5, 0.05).maps(size)["tool"]


@pytest.mark.parametrize(("change", "effort"), [(0.1, 0.01), (0.5, 0.0), (0.003, 0.2)])
def test_sigma_has_its_closed_form(change: float, effort: float) -> None:
    n = 300
    b, a = learning.ACTUATORS[0]
    T = by_hand.actuator(b, a, n)
    law = learning.norm_optimal_law(learning.delayed_lag(b, a, 5), n, change, effort)
    least = np.linalg.svd(T, compute_uv=False)[-1]
    expected = change / (change + effort + least**2)
    assert learning.largest_gain(law.map(learning.toeplitz(T[:, 0]))) == pytest.approx(expected, abs=SAME)
    assert effort or expected == pytest.approx(1.0, abs=1e-12)
    # (7.6) by matrices
    square = T.T @ T
    Q = np.linalg.solve(square + (change + effort) * np.eye(n), square + change * np.eye(n))
    L = np.linalg.solve(square + change * np.eye(n), T.T)
    assert np.abs(law.Q.dense() - Q).max() < SAME
    assert np.abs(law.L.dense() - L).max() < SAME


def test_long_runs_by_conjugate_gradients_are_those_of_matrices() -> None:
    n = 1100
    law = learning.norm_optimal_law(tool(n), n, 0.1, 0.05)
    T = tool(n).dense()
    e = np.sin(np.arange(n) / 30)
    expected = np.linalg.solve(T.T @ T + 0.15 * np.eye(n), T.T @ e)
    assert np.abs(law.update(np.zeros(n), e) - expected).max() < 1e-9


def test_the_update_minimises_its_norm() -> None:
    n = 200
    T, rng = tool(n), np.random.default_rng(3)
    u, e = rng.normal(size=(2, n))
    law = learning.norm_optimal_law(T, n, 0.2, 0.1)

    def cost(new: np.ndarray) -> float:
        rest = e - T(new - u)
        return float(rest @ rest + 0.1 * new @ new + 0.2 * (new - u) @ (new - u))

    best = law.update(u, e)
    assert all(cost(best) < cost(best + 1e-3 * d) for d in rng.normal(size=(20, n)))
    # without bounds the quadratic program is the same
    free = learning.bounded_update(T, u, e, 0.2, 0.1)
    assert np.abs(free - best).max() < 1e-8


def test_bounds_are_kept_and_the_rest_is_optimal() -> None:
    n, largest, step = 300, 0.002, 1e-4
    T = tool(n)
    x = np.repeat([0.0, 0.01, 0.0], 100)
    e = 0.3 * (x - T(x))
    u = learning.bounded_update(T, np.zeros(n), e, 0.05, 0.01, largest=largest, largest_step=step)
    assert np.abs(u).max() <= largest
    assert np.abs(np.diff(u, prepend=0.0)).max() <= step * (1 + 1e-9)
    assert np.abs(u).max() > 0.999 * largest or np.abs(np.diff(u)).max() > 0.999 * step  # they are active
    # stationary: the gradient is a sum of active bounds' gradients, of the right signs
    M = T.dense()
    gradient = (M.T @ M + 0.06 * np.eye(n)) @ u - M.T @ e
    D = np.eye(n) - np.eye(n, k=-1)
    active = [s * row for row, d in zip(D, D @ u, strict=True) for s in (1, -1) if s * d > step * (1 - 1e-7)]
    active += [s * np.eye(n)[k] for k in range(n) for s in (1, -1) if s * u[k] > largest * (1 - 1e-7)]
    from scipy.optimize import nnls

    left = nnls(np.array(active).T, -gradient)[1] if active else np.linalg.norm(gradient)
    assert left < OPTIMAL * np.linalg.norm(M.T @ e)


def test_the_inverse_model_contracts_faster_than_the_shift() -> None:
    n = 300
    T = tool(n)
    Q = learning.weighted(learning.input_window(n)) @ learning.zero_phase(SOS, n)
    by_shift = learning.LearningLaw(Q, learning.shifted(n, 0.9, 10))
    by_inverse = learning.model_inverse_law(T, n, 1e-3, Q)
    assert learning.largest_gain(by_inverse.map(T)) < 0.5 * learning.largest_gain(by_shift.map(T))


def test_refusals() -> None:
    unstable = learning.delayed_lag(0.1, 1.01, 5)
    for law in (learning.norm_optimal_law, learning.model_inverse_law):
        with pytest.raises(ArgumentError) as error:
            law(unstable, 100, 0.1)
        assert error.value.argument == "plant" and "1.01" in error.value.message
    with pytest.raises(ArgumentError) as error:
        learning.norm_optimal_law(tool(100), 100, 0.0)
    assert error.value.argument == "change"
    with pytest.raises(ArgumentError) as error:
        learning.norm_optimal_law(tool(100), 100, 1.0, -1.0)
    assert error.value.argument == "effort"
    with pytest.raises(ArgumentError) as error:
        learning.bounded_update(tool(100), np.zeros(100), np.ones(100), 1.0, largest=0.0)
    assert error.value.argument == "largest"
    with pytest.raises(ArgumentError) as error:
        learning.norm_optimal_law(tool(90), 100, 1.0)
    assert error.value.argument == "plant"
    with pytest.raises(ArgumentError) as error:
        learning.inverse(learning.weighted([1.0, -1.0]))
    assert error.value.argument == "map"


def test_within_bounds_the_iteration_ends_at_its_limit_and_contracts_by_sigma() -> None:
    n, change, effort = 200, 0.05, 0.02
    T = tool(n)
    M, x = T.dense(), np.repeat([0.0, 0.01, 0.0, 0.004], 50)
    e0 = 0.3 * (x - T(x))
    for bounds in ({"largest": 0.0015}, {"largest_step": 1e-4}, {"largest": 0.0015, "largest_step": 1e-4}):
        end = learning.bounded_limit(T, e0, effort, **bounds)
        sigma = change / (change + effort + np.linalg.svd(M, compute_uv=False)[-1] ** 2)
        u, off = np.zeros(n), np.linalg.norm(end)
        for _ in range(30):  # 0.714^30 = 4e-5
            u = learning.bounded_update(T, u, e0 - T(u), change, effort, **bounds)
            assert np.linalg.norm(u - end) <= sigma * off * (1 + 1e-6) + 1e-12
            off = np.linalg.norm(u - end)
        assert off < 1e-4 * np.linalg.norm(end)
    # the limit by another solver: bounded least squares, without the bound on the step
    stacked = np.vstack([M, np.sqrt(effort) * np.eye(n)])
    other = scipy.optimize.lsq_linear(stacked, np.append(e0, np.zeros(n)), (-0.0015, 0.0015), tol=1e-14).x
    end = learning.bounded_limit(T, e0, effort, largest=0.0015)
    assert np.abs(end - other).max() < 1e-5 * np.abs(end).max()  # that solver ends inside its bounds


def test_the_study_says_the_floor_of_a_law_within_bounds() -> None:
    bounded = learning.LearningDesign(law="norm_optimal", largest=0.0005, iterations=6)
    path, robot = learning.SquarePath(corrected=250), learning.LearningRobot(frequency=(7.4,), damping=(0.2,))
    s = learning.study(robot, path, bounded)
    assert s.status is SolveStatus.SOLVED
    assert s.reached == pytest.approx(s.floor, rel=0.2) and s.not_learned[0] > 0.5
    assert "bounds on the input" in s.message


def test_runs_too_long_for_a_quadratic_program_are_refused() -> None:
    with pytest.raises(ArgumentError) as error:
        learning.bounded_update(tool(3001), np.zeros(3001), np.ones(3001), 0.1, largest=1.0)
    assert error.value.argument == "largest" and "3001" in error.value.message


def test_without_a_weight_of_the_effort_the_refusal_does_not_speak_of_divergence() -> None:
    n = 300
    law = learning.norm_optimal_law(tool(n), n, 0.1)
    with pytest.raises(ArgumentError) as error:
        learning.rate(law, tool(n))
    assert error.value.argument == "law" and "diverges" not in error.value.message and "effort" in error.value.message
