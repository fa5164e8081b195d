"""Estimators as maps: against the recursion of (7.22) step by step, python-control's gain, the filter of (7.17)."""

from __future__ import annotations

import control
import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.control import learning
from gtmodel.results import SolveStatus
from gtmodel.results.refusal import ArgumentError

TS, N, NOISE = 0.004, 825, 0.07
FULL = slice(100, 725)
SAME = 1e-9
LEVEL = 0.99


def signals(seed: int, *, frequency: float = 11.5, damping: float = 0.05, size: int = N) -> dict[str, np.ndarray]:
    """A run along y, synthetic, with 0.07 m/s2 of noise of the accelerometer and 1 um of the motors."""
    rng = np.random.default_rng(seed)
    path = learning.SquarePath(corrected=size - 200)
    r = path.samples(TS)[:, 1]
    made = {name: T(r) for name, T in learning.flexible_axis(frequency, damping).maps(size).items()}
    made["acceleration"] = made["acceleration"] + NOISE * rng.normal(size=size)
    made["motor"] = made["motor"] + 1e-6 * rng.normal(size=size)
    return made


def filter_of(off: float = 0.0) -> learning.ExtendedKalman:
    return learning.ExtendedKalman(learning.tool_model(11.5 * (1 + off), 0.05), 1e-12, NOISE)


def test_the_gain_is_that_of_python_control() -> None:
    f = filter_of()
    A, _, H = f.extended
    expected, P, _ = control.dlqe(A, np.eye(4), H, f.process * np.eye(4), [[NOISE**2]])
    assert np.abs(f.gain - np.asarray(expected)[:, 0]).max() < 1e-6 * np.abs(expected).max()
    assert np.abs(f.covariance - P).max() < 1e-6 * np.abs(P).max()
    # (7.21) entry by entry: the acceleration is the second difference backward
    C, x, u = np.array([1.0, 0.0]), np.random.default_rng(1).normal(size=4), np.array([0.3, -0.2])
    z = [C @ x[:2], *(C @ (np.asarray(f.model.A) @ x[:2] + np.asarray(f.model.B) @ u) for _ in range(1))]
    after = f.extended[0] @ x + f.extended[1] @ u
    assert after[2] == pytest.approx((z[1] - z[0]) / TS)
    assert after[3] == pytest.approx(((z[1] - z[0]) / TS - x[2]) / TS)


def test_the_map_is_the_recursion_of_7_22() -> None:
    f, run = filter_of(), signals(1)
    A, B, _ = f.extended
    x, made, innovations = np.zeros(4), np.zeros(N), np.zeros(N)
    zc = np.append(run["motor"], run["motor"][-1])
    reading = np.append(0.0, run["acceleration"][:-1])  # x_a is one sample late
    for k in range(N):
        made[k] = x[0]
        innovations[k] = reading[k] - x[3]
        x = A @ x + B @ zc[k : k + 2] + f.gain * innovations[k]
    estimate = learning.kalman_estimate(N, f)
    assert np.abs(estimate(run) - made).max() < SAME
    assert (
        np.abs(f.innovations(run["motor"], run["acceleration"]) * np.sqrt(f.innovation_variance) - innovations).max()
        < 1e-8
    )


@pytest.mark.parametrize("name", ["kinematic", "measured", "complementary", "kalman"])
def test_responses_are_those_of_the_maps(name: str) -> None:
    estimate = {
        "kinematic": lambda: learning.kinematic(N), "measured": lambda: learning.measured(N),
        "complementary": lambda: learning.complementary_estimate(N, 4.5),
        "kalman": lambda: learning.kalman_estimate(N, filter_of()),
    }[name]()  # fmt: skip
    t = TS * np.arange(N)
    for f in (6.0, 11.0, 25.0):
        for signal, F in estimate.maps.items():
            x = np.cos(2 * np.pi * f * t)
            middle = slice(350, 500)
            waves = np.column_stack([np.cos(2 * np.pi * f * t), -np.sin(2 * np.pi * f * t), np.ones(N), t])
            seen = np.linalg.lstsq(waves[middle], F(x)[middle], rcond=None)[0]
            expected = estimate.responses[signal](np.array([f]))[0]
            scale = max(abs(expected), (2 * np.pi * f) ** -2 if signal == "acceleration" else 1e-2)
            assert abs(seen[0] + 1j * seen[1] - expected) < 0.02 * scale, (signal, f)


def test_the_complementary_map_is_the_filter_of_7_17() -> None:
    run = signals(2)
    t = TS * np.arange(N)
    z = gt.filtering.complementary(
        gt.Trajectory(t, {"z": run["motor"]}, {"z": "m"}),
        gt.Trajectory(t, {"a": run["acceleration"]}, {"a": "m/s2"}), 2.63,
    )["z"]  # fmt: skip
    assert np.abs(learning.complementary_estimate(N, 2.63)(run) - z).max() < 1e-11


@pytest.mark.parametrize("seeds", [8, pytest.param(20, marks=pytest.mark.proof)])
def test_the_innovations_of_the_right_model_lie_in_their_band_and_those_of_a_wrong_one_do_not(seeds: int) -> None:
    nises = []
    for seed in range(seeds):
        run = signals(seed)
        f = learning.most_likely_filter(learning.tool_model(11.5, 0.05), run["motor"], run["acceleration"], NOISE)
        nis = float(np.mean(f.innovations(run["motor"], run["acceleration"]) ** 2))
        band = gt.filtering.chi_squared_band(N, 1)
        nises.append(nis)
        wrong = learning.ExtendedKalman(learning.tool_model(11.5 * 1.2, 0.05), f.process, NOISE)
        assert float(np.mean(wrong.innovations(run["motor"], run["acceleration"]) ** 2)) > 2 * band.high
    # all seeds at once, and how many lie outside their band of 95 %: more has a chance of 1 %
    assert float(np.mean(nises)) in gt.filtering.chi_squared_band(N * seeds, 1, LEVEL)
    outside = sum(nis not in gt.filtering.chi_squared_band(N, 1) for nis in nises)
    assert outside <= scipy.stats.binom.ppf(LEVEL, seeds, 0.05)


def test_the_error_grows_with_the_mismatch_of_the_model_and_the_order_is_that_of_figure_7_1() -> None:
    run = signals(4)

    def error(estimate: learning.ToolEstimate) -> float:
        return float(np.sqrt(np.mean((estimate(run) - run["tool"])[FULL] ** 2)))

    kalman = []
    for off in (0.0, 0.03, 0.1, 0.2):
        f = learning.most_likely_filter(
            learning.tool_model(11.5 * (1 + off), 0.05), run["motor"], run["acceleration"], NOISE
        )
        kalman.append(error(learning.kalman_estimate(N, f)))
    assert np.all(np.diff(kalman) > 0), kalman
    assert kalman[-1] < error(learning.complementary_estimate(N, 2.63)) < error(learning.kinematic(N))


def test_refusals() -> None:
    with pytest.raises(ArgumentError) as error:
        learning.kinematic(5)({"tool": np.zeros(5)})
    assert error.value.argument == "signals"
    with pytest.raises(ArgumentError) as error:
        learning.ExtendedKalman(control.StateSpace([[0.5]], [[1.0]], [[1.0]], [[1.0]], TS), 1e-9, NOISE)
    assert error.value.argument == "model" and "feedthrough" in error.value.message
    with pytest.raises(ArgumentError) as error:
        learning.ExtendedKalman(learning.tool_model(11.5, 0.05), 0.0, NOISE)
    assert error.value.argument == "process"
    with pytest.raises(ArgumentError) as error:
        learning.complementary_estimate(9, 3.0)
    assert error.value.argument == "size"
    with pytest.raises(ArgumentError) as error:
        learning.complementary_estimate(500, 125.0)
    assert error.value.argument == "cutoff"
    with pytest.raises(ArgumentError) as error:
        learning.flexible_axis(11.5, -0.1)
    assert error.value.argument == "damping"


def test_the_synthetic_tool_is_that_of_its_differential_equation() -> None:
    # scipy integrates z'' = w2 (z_c - z) + 2 zeta w (z_c' - z') behind a lag of 20 ms and five samples
    w, zeta, lag = 2 * np.pi * 11.5, 0.05, 0.02
    r = learning.SquarePath().samples(TS)[:300, 1]

    def slope(t: float, x: np.ndarray) -> list[float]:
        k = int(t / TS + 1e-9) - 5
        rate = ((r[k] if k >= 0 else 0.0) - x[0]) / lag
        return [rate, x[2], w**2 * (x[0] - x[1]) + 2 * zeta * w * (rate - x[2])]

    x, rows = np.zeros(3), []
    for k in range(300):
        rows.append(x)
        x = scipy.integrate.solve_ivp(slope, (TS * k, TS * (k + 1) - 1e-12), x, rtol=1e-10, atol=1e-14).y[:, -1]
    maps = learning.flexible_axis(11.5, 0.05).maps(300)
    assert np.abs(maps["motor"](r) - np.array(rows)[:, 0]).max() < 1e-10
    assert np.abs(maps["tool"](r) - np.array(rows)[:, 1]).max() < 1e-9


def test_a_model_whose_lasting_part_the_acceleration_does_not_show_is_refused_and_a_fading_one_is_not() -> None:
    run, tool = signals(6), learning.tool_model(11.5, 0.05)
    hidden = {}
    for pole in (0.9, 1.0):
        A = scipy.linalg.block_diag(tool.A, [[pole]])
        hidden[pole] = control.StateSpace(A, np.vstack([tool.B, [[1, 1]]]), [[1, 0, 0]], np.zeros((1, 2)), TS)
    plain = learning.most_likely_filter(tool, run["motor"], run["acceleration"], NOISE)
    with_it = learning.most_likely_filter(hidden[0.9], run["motor"], run["acceleration"], NOISE)
    both = [learning.kalman_estimate(N, f)(run) for f in (plain, with_it)]
    assert np.abs(both[0] - both[1]).max() < SAME
    with pytest.raises(ArgumentError) as error:
        learning.most_likely_filter(hidden[1.0], run["motor"], run["acceleration"], NOISE)
    assert error.value.argument == "model"


def test_a_run_with_nan_gives_no_filter() -> None:
    run = signals(6)
    felt = run["acceleration"].copy()
    felt[5] = np.nan
    with pytest.raises(ArgumentError) as error:
        learning.most_likely_filter(learning.tool_model(11.5, 0.05), run["motor"], felt, NOISE)
    assert error.value.argument == "acceleration"


@pytest.mark.parametrize(("cutoff", "order"), [(2.63, 2), (4.5, 1), (10.0, 3)])
def test_the_complementary_maps_are_dense_matrices_with_their_transposes(cutoff: float, order: int) -> None:
    size, t = 200, TS * np.arange(200)
    zero, one = np.zeros((size, size)), np.eye(size)
    made = learning.complementary_estimate(size, cutoff, order=order)
    for name, slow, felt in (("motor", one, zero), ("acceleration", zero, one)):
        matrix = gt.filtering.complementary(
            gt.Trajectory(t, {"z": slow}, {"z": "m"}), gt.Trajectory(t, {"a": felt}, {"a": "m/s2"}), cutoff, order=order
        )["z"]
        F, scale = made.maps[name], np.abs(matrix).max()
        assert np.abs(F.dense() - matrix).max() < 1e-11 * scale
        assert np.abs(F.adjoint.dense() - matrix.T).max() < 1e-11 * scale


def test_case_2a_learns_over_runs_longer_than_a_matrix() -> None:
    path, one = learning.SquarePath(corrected=1200), learning.LearningRobot(frequency=(7.4,), damping=(0.2,))
    s = learning.study(one, path, learning.LearningDesign(case="2A", iterations=3))
    assert s.status is SolveStatus.SOLVED and max(s.bound) < 1
    assert s.sigma == pytest.approx(s.bound, abs=0.1) and s.error[0][-1] < 0.3 * s.error[0][0]


def test_the_curve_of_the_error_against_the_mismatch_is_that_of_the_recursion() -> None:
    run, off = signals(4), (-0.2, -0.1, -0.03, 0.0, 0.03, 0.1, 0.2)
    s = learning.mismatch(run, 11.5, 0.05, off=off, title="synthetic, seed 4")
    assert np.all(np.diff(s.kalman[:4]) < 0) and np.all(np.diff(s.kalman[3:]) > 0)  # least where the model is right
    assert max(s.kalman[1:-1]) < s.complementary < s.kinematics
    assert s.kalman[0] > s.complementary  # 20 % too low a frequency costs more than no model
    # one of them by the steps of (7.22)
    f = learning.most_likely_filter(learning.tool_model(11.5 * 1.1, 0.05), run["motor"], run["acceleration"], NOISE)
    A, B, _ = f.extended
    x, made = np.zeros(4), np.zeros(N)
    zc, reading = np.append(run["motor"], run["motor"][-1]), np.append(0.0, run["acceleration"][:-1])
    for k in range(N):
        made[k] = x[0]
        x = A @ x + B @ zc[k : k + 2] + f.gain * (reading[k] - x[3])
    assert s.kalman[5] == pytest.approx(float(np.sqrt(np.mean((made - run["tool"])[FULL] ** 2))), rel=1e-9)
    assert len(s.rows) == 2 + len(off) and s.figure("mismatch").axes
    for wrong, argument in (({"motor": run["motor"]}, "run"), ({**run, "tool": run["tool"][:700]}, "run")):
        with pytest.raises(ArgumentError) as error:
            learning.mismatch(wrong, 11.5, 0.05)
        assert error.value.argument == argument
