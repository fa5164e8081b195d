"""Printed numbers and equations of Dressler 2012 that need no study, computed anew; the rows of docs/theses.toml."""

from __future__ import annotations

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

import gtmodel as gt
from tests.kinematics.support.f1 import f1
from tests.theses.table import assert_is_ours, gantry_tau

ROBOTS, DYNAMICS = gantry_tau(), gantry_tau(dynamics=True)
LOOP = DYNAMICS["actuator_closed_loop"]
M, D, K = (np.array(DYNAMICS["compliance_physical"][name]) for name in "MDK")
CYCLE = LOOP["sample_time_s"]
G = 9.81


def test_saving_of_table_3_1() -> None:
    free, line = (DYNAMICS["optimal_trajectory"][name][0] for name in ("free_w0", "path_w0"))
    assert_is_ours("table-3.1-saving", 100 * (1 - free / line))


def test_solutions_of_the_three_link_robot() -> None:
    robot = gt.robots.gantry_tau("l1_tape")
    T = np.array([[1.0, -0.6, 0.7]])
    inverse = set()
    for signs in np.ndindex(2, 2, 2):
        branches = gt.robots.configuration(robot, [1 - 2 * s for s in signs])
        q, status = robot.causal("T", "q", branches=branches)(T)
        assert status[0] == gt.Status.OK
        inverse.add(tuple(np.round(q[0], 9)))
    assert_is_ours("inverse-branches", len(inverse))
    forward = set()
    for side in (1, -1):
        q = np.array([sorted(inverse)[0]])
        p, status = robot.causal("q", "T", branches=gt.robots.configuration(robot, forward=side))(q)
        assert status[0] == gt.Status.OK
        forward.add(tuple(np.round(p[0], 6)))
    assert_is_ours("forward-branches", len(forward))


def test_deviations_of_table_4_1() -> None:
    e = ROBOTS["actuator_errors"]
    mean, std = (np.array([e[f"residual_{of}_um"][name] for name in ("D1", "L1")]) for of in ("mean", "std"))
    assert_is_ours("table-4.1-std", np.mean(std / mean))


def test_directions_are_not_of_length_one() -> None:
    assert_is_ours("eq-4.13-unit", np.linalg.norm(ROBOTS["l1_camera"]["v"], axis=1).min())


def test_sign_of_newtons_step() -> None:
    """Arm 3 of the F1 of Table 5.5, a centimetre and half a degree beside a solution."""
    robot, (R, T) = f1(), f1().home
    arm, moved = [3, 4, 5], [2, 4, 5]
    q = robot.inverse(R, T)
    ends = T + robot.B[arm] @ R.T

    def e(part: np.ndarray) -> np.ndarray:
        """(4.28)"""
        trial = q.copy()
        trial[moved] = part
        return robot.L[arm] ** 2 - np.sum((ends - robot.cart_joints(trial)[arm]) ** 2, axis=1)

    def errors(sign: float) -> list[float]:
        part, found = q[moved] + [0.01, 0.01, -0.01], []
        for _ in range(4):
            J = np.array([(e(part + h) - e(part - h)) / 2e-5 for h in 1e-5 * np.eye(3)]).T
            part = part + sign * np.linalg.solve(J, e(part))
            found.append(np.abs(e(part)).max())
        return found

    printed, turned = errors(1.0), errors(-1.0)
    assert np.all(np.diff(printed) > 0) and printed[-1] > 5 * printed[0]
    assert turned[-1] < 1e-12


def test_guideways_of_table_5_1() -> None:
    v = np.array(ROBOTS["l1_tracker_2008"]["v"])
    v /= np.linalg.norm(v, axis=1)[:, None]
    mean = v.mean(axis=0) / np.linalg.norm(v.mean(axis=0))
    assert_is_ours("table-5.1-guideways", np.degrees(np.arccos(v @ mean)).mean())


def test_costs_of_table_5_8() -> None:
    one, two, three = 5.458e-6, 3.661e-6, 3.515e-7  # m^4, model 1
    assert_is_ours("table-5.8-cost", min(one, two) / three)


def test_tables_5_8_and_5_9_agree() -> None:
    six, nominal = ROBOTS["d1_six_link"], np.array(ROBOTS["d1_nominal"]["A_m"])[[0, 1, 1, 2, 2, 2]]
    A, B = np.array(six["A_m"]), np.array(six["B_m"])

    def distance(angles: np.ndarray) -> np.ndarray:
        R = Rotation.from_euler("ZYZ", angles, degrees=True).as_matrix()
        return (A - B @ R.T - nominal).ravel()

    found = scipy.optimize.least_squares(distance, [85.0, 100.9, -88.6])
    np.testing.assert_allclose(found.x, [85.1, 100.9, -88.5], atol=0.05)
    assert_is_ours("table-5.9-consistent", 1e3 * np.linalg.norm(found.fun.reshape(6, 3), axis=1).max())


def test_norms_of_the_quaternions() -> None:
    norms = [np.linalg.norm(ROBOTS["f1"][name]) for name in ("u1_2", "u1_3", "u2_3")]
    assert_is_ours("f1-norms", [min(norms), max(norms)])


def test_principal_components_of_the_f1() -> None:
    values = np.array([2.34, 4.17, 7.52])
    vectors = np.array([[0.27, 0.72, 0.74], [-0.36, -0.62, 0.69], [0.90, -0.44, 0.07]])
    assert_is_ours("f1-principal-ratio", np.sqrt(values[1:] / values[0]))
    lengths = np.linalg.norm(vectors, axis=0)
    assert np.argmax(np.abs(lengths - 1)) == 1 and abs(lengths[1] - 1.047) < 1e-3
    assert np.abs(np.delete(lengths, 1) - 1).max() < 0.015  # rounding to two digits
    assert_is_ours("f1-principal-vector", np.cross(vectors[:, 2], vectors[:, 0]))


def test_differences_of_table_5_6() -> None:
    vision, tracker, camera = (ROBOTS[name] for name in ("l1_vision", "l1_tracker", "l1_camera"))
    apart = [np.abs(np.subtract(vision[key], tracker[key])).max() for key in ("L_m", "A_m")]
    assert_is_ours("table-5.6-differences", 1e3 * max(apart))
    assert_is_ours("table-5.7-differences", 1e3 * np.subtract(tracker["L_m"], camera["L_m"])[1:])


def test_the_noise_amplification_index() -> None:
    least, most = 0.3, 64.0  # section 5.6: singular values of the simulated calibration
    condition = most / least
    assert round(most**2 / least) == 13653 and abs(most / condition - least) < 1e-12  # the two printed sides
    assert_is_ours("eq-5.14", [least**2 / most, least / condition])


def gravity(L: np.ndarray, A: np.ndarray, mass: float, y: float, z: float, side: int) -> np.ndarray | None:
    """J^T G of (6.5) and (6.7) at a place of the section; None where a link does not reach."""
    dy, dz = y - A[:, 1], z - A[:, 2]
    squares = L**2 - dy**2 - dz**2
    if np.any(squares < 1e-6):
        return None
    dx = side * np.sqrt(squares)
    J_inv = np.column_stack([np.ones(3), dy / dx, dz / dx])
    return None if abs(np.linalg.det(J_inv)) < 1e-9 else np.linalg.solve(J_inv.T, [0.0, 0.0, mass * G])


def nearest(target: np.ndarray) -> np.ndarray:
    """The forces nearest to a column of Table 6.2 over the section of Table 5.1's robot (3,) [N]."""
    robot, mass = ROBOTS["l1_tracker_2008"], DYNAMICS["friction_constant_velocity"]["accumulated_mass_kg"]
    L, A = np.array(robot["L_m"]), np.array(robot["A_m"])

    def forces(place: np.ndarray | tuple[float, float], side: int) -> np.ndarray:
        found = gravity(L, A, mass, place[0], place[1], side)
        return np.full(3, 1e4) if found is None else found

    def distance(place: np.ndarray | tuple[float, float], side: int) -> float:
        return float(np.abs(forces(place, side) - target).max())

    grid = [(y, z) for y in np.arange(0.0, 5.5, 0.1) for z in np.arange(-2.5, 2.5, 0.1)]
    ends = []
    for side in (1, -1):
        for start in sorted(grid, key=lambda place: distance(place, side))[:3]:
            found = scipy.optimize.minimize(
                distance, start, (side,), "Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-7, "maxiter": 2000}
            )
            ends.append(forces(found.x, side))
    return min(ends, key=lambda found: np.abs(found - target).max())


def test_columns_of_table_6_2() -> None:
    columns = {name: np.array(column) for name, column in DYNAMICS["gravity_contribution_N"].items()}
    assert_is_ours("table-6.2-sums", max(abs(c.sum()) for c in columns.values()))
    assert_is_ours("table-6.2-diamond", nearest(columns["diamond"]))
    for name in ("star", "plus"):
        np.testing.assert_allclose(nearest(columns[name]), columns[name], atol=0.05)


def test_residuals_of_table_6_3() -> None:
    models = [DYNAMICS["inertia"][f"model_{n}"] for n in (1, 2, 3, 4)]
    e = np.array([m["residual"] for m in models])
    assert_is_ours("table-6.3-best", 1 + np.argmin(e.sum(axis=1)))
    assert np.all(np.argmin(e, axis=0) == 1)
    friction = DYNAMICS["friction_constant_velocity"]
    table = np.maximum(friction["viscous_minus_kg_s"], friction["viscous_plus_kg_s"])
    assert_is_ours("table-6.3-viscous", np.sum(np.array(models[1]["viscous_kg_s"]) > table))


def test_a_torque_of_a_cart_is_a_force() -> None:
    effort = gt.robots.gantry_tau("l1_tape").causal("T", "tau").outputs[0]
    assert effort.unit == "N"


def test_bandwidth_of_the_actuators() -> None:
    found = []
    for a, b in zip(LOOP["a"], LOOP["b"], strict=True):

        def gain(f: float, a: float = a, b: float = b) -> float:
            return abs(b / (1 - a * np.exp(-2j * np.pi * f * CYCLE)))

        found.append(scipy.optimize.brentq(lambda f, gain=gain: gain(f) - gain(0.0) / np.sqrt(2), 0.1, 20.0))
    assert_is_ours("eq-6.11-bandwidth", found)


def test_the_response_has_an_inverse() -> None:
    """With the sign of K that is stable: at a mode the structure without damping responds most, not least."""
    modes = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, -K)))
    np.testing.assert_allclose(np.sort(modes) / (2 * np.pi), [13.826, 103.337], rtol=1e-4)
    for w in modes:
        below, at, above = (abs(np.linalg.det(-(x**2) * M - K)) for x in (0.9 * w, w, 1.1 * w))
        assert at < 1e-9 * min(below, above)  # the size of (6.14) as printed


def test_definiteness_of_the_compliance_matrices() -> None:
    value = np.linalg.eigvals(K)[0]
    assert_is_ours("k-eigenvalues", [value.real, abs(value.imag)])
    assert value.real < 0
    assert np.linalg.eigvals(M).min() > 0
    assert_is_ours("m-definite", np.linalg.eigvalsh((M + M.T) / 2)[0])
    assert_is_ours("d-definite", [np.trace(D), np.linalg.det(D)])


def test_a_hundred_radians_per_second() -> None:
    assert_is_ours("hundred-rad", 100 / (2 * np.pi))


GAMMA, DELTA = DYNAMICS["ilc"]["gamma"], DYNAMICS["ilc"]["delta_samples"]
B_Q, A_Q = scipy.signal.butter(2, DYNAMICS["ilc"]["q_cutoff_Hz"] * 2 * CYCLE)


def test_convergence_of_the_learning_control() -> None:
    """(7.16) with the matrices of (7.9) to (7.11), 825 samples."""
    n, none = 825, np.zeros(825)
    impulse = np.eye(n)[0]
    causal = scipy.linalg.toeplitz(scipy.signal.lfilter(B_Q, A_Q, impulse), none)
    Q = causal.T @ causal
    ahead = GAMMA * np.eye(n)[np.minimum(np.arange(n) + DELTA, n - 1)]
    sigma = []
    for a, b in zip(LOOP["a"], LOOP["b"], strict=True):
        response = np.zeros(n)
        response[LOOP["delay_samples"] :] = b * a ** np.arange(n - LOOP["delay_samples"])
        loop = Q @ (np.eye(n) - ahead @ scipy.linalg.toeplitz(response, none))
        sigma.append(np.sqrt(scipy.linalg.eigh(loop.T @ loop, eigvals_only=True, subset_by_index=[n - 1, n - 1])[0]))
    assert_is_ours("ilc-sigma", sigma)


def test_error_of_the_learning_control() -> None:
    """10 mm forth and back with 2 m/s2 and up to 0.09 m/s, five iterations on the models (6.11)."""
    side, fastest, rate = 0.01, 0.09, 2.0
    ramp = fastest / rate
    end = 2 * ramp + (side - fastest * ramp) / fastest
    t = np.arange(0, end, CYCLE)
    rise = np.where(
        t < ramp, rate * t**2 / 2,
        np.where(t < end - ramp, fastest * (t - ramp / 2), side - rate * (end - t) ** 2 / 2),
    )  # fmt: skip
    r = np.concatenate([np.zeros(400), rise, np.full(150, rise[-1]), rise[-1] - rise, np.zeros(250)])
    left = []
    for a, b in zip(LOOP["a"], LOOP["b"], strict=True):
        u, errors = np.zeros(len(r)), []
        for _ in range(6):
            y = scipy.signal.lfilter([*[0.0] * LOOP["delay_samples"], b], [1, -a], r + u)
            error = r - y
            errors.append(np.linalg.norm(error))
            ahead = np.r_[error[DELTA:], np.full(DELTA, error[-1])]
            u = scipy.signal.filtfilt(B_Q, A_Q, u + GAMMA * ahead)
        left.append(100 * errors[5] / errors[0])
    assert_is_ours("ilc-error", left)


def test_the_extended_model() -> None:
    rng = np.random.default_rng(0)
    A, B, C = 0.3 * rng.standard_normal((4, 4)), rng.standard_normal((4, 2)), rng.standard_normal((2, 4))
    none, one = np.zeros((2, 2)), np.eye(2)
    dynamics = np.block([
        [A, np.zeros((4, 4))],
        [C @ (A - np.eye(4)) / CYCLE, none, none],
        [C @ (A - np.eye(4)) / CYCLE**2, -one / CYCLE, none],
    ])  # fmt: skip
    inputs = np.vstack([B, C @ B / CYCLE, C @ B / CYCLE**2])
    x, states = np.zeros(8), []
    for u in rng.standard_normal((50, 2)):
        states.append(x)
        x = dynamics @ x + inputs @ u
    z, velocity, acceleration = (np.array(states) @ part for part in (np.vstack([C.T, none, none]),
        np.vstack([np.zeros((4, 2)), one, none]), np.vstack([np.zeros((4, 2)), none, one])))  # fmt: skip
    np.testing.assert_allclose(velocity[1:], np.diff(z, axis=0) / CYCLE, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(acceleration[1:], np.diff(velocity, axis=0) / CYCLE, rtol=1e-9, atol=1e-6)
    outputs = np.block([[C, none, none], [np.zeros((2, 4)), none, one]])
    measured = acceleration[-1]  # (7.22) subtracts outputs @ x, four numbers, from these two
    assert len(outputs @ states[-1]) == 4 != len(measured)
    np.testing.assert_array_equal((outputs @ states[-1])[2:], measured)
