"""Printed numbers and equations of Cvitanic 2021 that need no study, computed anew; the rows of docs/theses.toml."""

from __future__ import annotations

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from tests.theses.table import KR500, assert_is_ours

FUSION, TESTS = KR500["fusion"], KR500["milling_tests"]
ORIGINS, AXES = (np.array(KR500["geometry"][key], float) for key in ("joint_origins_m", "joint_axes"))
RATE = FUSION["sample_rate_Hz"]


def arm(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flange (3,), its rotation (3, 3) and Jacobian (6, 6), translations first, by the product of joints."""
    p, R = np.zeros(3), np.eye(3)
    places, axes = [], []
    for origin, axis, angle in zip(ORIGINS, AXES, q, strict=True):
        p = p + R @ origin
        places.append(p)
        axes.append(R @ axis)
        R = R @ Rotation.from_rotvec(axis * angle).as_matrix()
    return p, R, np.array([np.r_[np.cross(z, p - at), z] for at, z in zip(places, axes, strict=True)]).T


def test_maximum_stiffness() -> None:
    stiffness = np.diag(KR500["static_stiffness"]["complete_pose_MNm_rad"])
    found = []
    for q in np.radians(KR500["static_stiffness"]["poses_deg"]):
        inverse = np.linalg.inv(arm(q)[2])
        found.append(np.linalg.norm((inverse.T @ stiffness @ inverse)[:3, :3], 2))
    assert_is_ours("maximum-stiffness", max(found))


def test_a_rigid_tool_does_not_explain_figure_42() -> None:
    printed = np.array([[2.4, 0.0, 0.325], [2.4, 0.0, 0.325], [2.7, 0.3, 0.325]])
    flanges = [arm(q) for q in np.radians(KR500["appendix_a"]["poses_deg"])]
    turns = np.vstack([R for _, R, _ in flanges])
    wanted = np.concatenate([tip - p for tip, (p, _, _) in zip(printed, flanges, strict=True)])
    tool = np.linalg.lstsq(turns, wanted)[0]
    left = (turns @ tool - wanted).reshape(3, 3)
    assert_is_ours("figure-42-tool", 1e3 * np.abs(left).max())
    assert np.abs(left[:, 2]).max() < 0.006  # heights agree


def test_frequencies_of_table_16() -> None:
    f = np.sqrt(1e6 * np.array(TESTS["k_MN_m"]) / TESTS["m_kg"]) / (2 * np.pi)
    assert_is_ours("table-4-range", [f[10:].min(), f[10:].max()])
    assert_is_ours("table-4-lower", [f[:4].min(), f[4:8].min()])


def test_deflections_of_tables_5_and_6() -> None:
    mean, most = np.array(TESTS["deflection_mean_mm"]), np.array(TESTS["deflection_max_mm"])
    assert_is_ours("high-speed", mean[2] - mean[3])
    assert_is_ours("mean-deflection", [most[::2].mean(), most[1::2].mean()])
    p = scipy.stats.ttest_rel(most[::2], most[1::2]).pvalue
    assert_is_ours("p-value", p)
    assert p > 0.05


def test_rows_of_table_16() -> None:
    table = np.hstack([TESTS[key] for key in ("m_kg", "c_N_s_m", "k_MN_m")])
    poses = np.column_stack([TESTS["tcp_mm"], TESTS["angle_A_deg"]])
    assert len(np.unique(poses, axis=0)) == 9
    assert_is_ours("table-16-rows", len(np.unique(table, axis=0)))


def test_second_modes_of_table_17() -> None:
    ratio = np.array(KR500["appendix_a"]["second_modes_k_MN_m"]) / TESTS["k_MN_m"]
    assert_is_ours("table-17", ratio.min())
    assert {tuple(at) for at in np.argwhere(ratio < 2)} == {(4, 1), (6, 1)}
    first = np.sqrt(1e6 * np.array(TESTS["k_MN_m"]) / TESTS["m_kg"]) / (2 * np.pi)
    slower = np.array(KR500["appendix_a"]["second_modes_Hz"]) < first
    assert np.all(slower[:8, 1]) and slower.sum() == 8 and ratio[:, 2].min() > 50


def test_state_equations() -> None:
    a, dt = 3.0, 1 / RATE
    moved = scipy.integrate.quad(lambda t: a * t, 0, dt)[0]
    assert_is_ours("eq-21", moved / (a * dt**2))


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Of two quaternions, scalar first."""
    return np.r_[p[0] * q[0] - p[1:] @ q[1:], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])]


RATE_0, ANGULAR = np.array([0.3, -0.5, 0.8]), np.array([-0.4, 0.9, 0.2])  # rad/s, rad/s2, in the fixed frame


def turning(t: float) -> Rotation:
    """A body whose angular velocity is RATE_0 + ANGULAR t in the fixed frame, from rest orientation."""
    run = scipy.integrate.solve_ivp(
        lambda s, q: product(np.r_[0.0, (RATE_0 + ANGULAR * s) / 2], q), (0, t), [1.0, 0, 0, 0], rtol=1e-12, atol=1e-14
    )
    return Rotation.from_quat(run.y[:, -1], scalar_first=True)


STEP, AT = 1e-3, 0.4  # s


def differences(values: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivative in the middle of three."""
    before, now, after = values
    return (after - before) / (2 * STEP), (after - 2 * now + before) / STEP**2


def test_quaternion_derivatives() -> None:
    w = np.r_[0.0, RATE_0 + ANGULAR * AT]
    quaternions = [turning(t).as_quat(scalar_first=True) for t in (AT - STEP, AT, AT + STEP)]
    first, second = differences(quaternions)
    q = quaternions[1]
    np.testing.assert_allclose(first, product(w / 2, q), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(second, product(np.r_[-(w @ w) / 4, ANGULAR / 2], q), rtol=1e-4, atol=1e-4)


def test_acceleration_of_the_target() -> None:
    imu, arm_of = np.array([0.1, 0.2, -0.1]), np.array([0.05, -0.08, 0.12])
    w, turned = RATE_0 + ANGULAR * AT, [turning(t) for t in (AT - STEP, AT, AT + STEP)]
    own = differences([R.apply(imu) for R in turned])[1]
    target = differences([R.apply(imu + arm_of) for R in turned])[1]
    r = turned[1].apply(arm_of)
    np.testing.assert_allclose(target, own + np.cross(ANGULAR, r) + np.cross(w, np.cross(w, r)), rtol=1e-4, atol=1e-5)


def magnitude(sigma: float, axes: int) -> list[float]:
    """Mean and standard deviation of the length of independent normal errors on one or three axes."""
    mean = sigma * np.sqrt(2 / np.pi) * (1 if axes == 1 else 2)
    return [mean, np.sqrt(axes * sigma**2 - mean**2)]


def test_sensor_errors_of_table_8() -> None:
    one_for_all = np.sqrt(3)  # the length of (n, n, n)
    position = 1e3 * FUSION["tracker_noise_m"]
    assert_is_ours("table-8-position", magnitude(position, axes=3))
    np.testing.assert_allclose(magnitude(one_for_all * position, axes=1), [0.0089, 0.0066], rtol=0.015)
    assert_is_ours("table-8-orientation", magnitude(FUSION["orientation_noise_deg"], axes=1))
    assert_is_ours("table-8-rate", magnitude(one_for_all * FUSION["gyro_noise_deg_s_rtHz"] * np.sqrt(RATE), axes=1))
    density = FUSION["accelerometer_noise_m_s2_rtHz"]
    assert_is_ours("table-8-acceleration", magnitude(one_for_all * density * np.sqrt(RATE), axes=1)[0])
    assert FUSION["accelerometer_bias_m_s2"] > 0.00018
    assert_is_ours("table-9-position", magnitude(one_for_all * 0.64, axes=1)[0])
    assert_is_ours("table-9-rate", magnitude(one_for_all * 0.16 * np.sqrt(RATE), axes=1)[0])


def sine() -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and place (n, 2) [m] of the motion of section 4.2.2 at the printed feed rate."""
    x = np.linspace(0, 0.05, 200_001)
    y = FUSION["sine_amplitude_m"] * np.sin(2 * np.pi * FUSION["sine_frequency_1_m"] * x)
    arc = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    t = np.arange(0, 5, 1 / RATE)
    places = np.interp(FUSION["feed_m_s"] * t, arc, x)
    return t, np.column_stack([places, np.interp(places, x, y)])


def test_covariances_of_appendix_b() -> None:
    sigma = [FUSION["tracker_noise_m"], FUSION["accelerometer_noise_m_s2_rtHz"] * np.sqrt(RATE)]
    assert_is_ours("appendix-b-r", np.square(sigma))
    dt = 1 / RATE
    F, H = np.array([[1, dt, dt**2], [0, 1, dt], [0, 0, 1]]), np.array([[1.0, 0, 0], [0, 0, 1]])  # (21) to (23)
    Q, R = np.diag(FUSION["Q_diagonal"]), np.diag(FUSION["R_diagonal"])
    t, places = sine()
    rng = np.random.default_rng(0)
    squares = []
    for truth in places.T:
        rate = np.gradient(truth, dt)
        acceleration = np.gradient(rate, dt)
        z = np.column_stack([truth, acceleration]) + rng.standard_normal((len(t), 2)) * np.sqrt(np.diag(R))
        x, P = np.array([truth[0], rate[0], acceleration[0]]), np.diag([1e-8, 1e-4, 1e-2])
        for k in range(len(t)):
            x, P = F @ x, F @ P @ F.T + Q
            S, innovation = H @ P @ H.T + R, z[k] - H @ x
            gain = P @ H.T @ np.linalg.inv(S)
            x, P = x + gain @ innovation, P - gain @ S @ gain.T
            if k >= 200:
                squares.append(innovation @ np.linalg.solve(S, innovation))
    assert_is_ours("appendix-b-q", np.mean(squares))


def test_first_peak_of_the_sine() -> None:
    t, places = sine()
    assert_is_ours("sine-peak", t[np.argmax(places[:3000, 1])])


def test_reductions_of_table_11() -> None:
    robot = np.array([[0.93, 0.80, 0.93, 0.93, 2.03, 0.97], [0.80, 0.97, 1.10, 0.85, 1.02, 1.23]])  # mm/s
    fusion = np.array([[0.76, 0.51, 0.51, 0.64, 1.27, 0.64], [0.64, 0.64, 0.72, 0.64, 0.72, 0.80]])
    three, five = 100 * (1 - fusion / robot)
    assert_is_ours("table-11-3-axis", three.max())
    assert_is_ours("table-11-5-axis", five.max())
    assert abs(three[3:].max() - 37.4) < 0.1


def test_equivalent_force() -> None:
    command, cycle, feed = 1e-4, KR500["closed_loop"]["cycle_s"], 0.04
    needed = 2 * command / cycle**2  # moves by the command in one cycle from rest
    assert abs(needed * cycle**2 / 2 - command) < 1e-18
    assert_is_ours("eq-30", needed / (command / cycle**2))
    assert_is_ours("eq-31", (feed * cycle) / cycle**2 - feed / cycle)
    assert (0.012 / 0.004) ** 2 == 9


def test_conservative_gains_of_table_14() -> None:
    for axis in "xy":
        gains = KR500["closed_loop"][f"max_stable_gain_{axis}"]
        assert np.all(np.array(gains["predicted"]) <= gains["actual"])
