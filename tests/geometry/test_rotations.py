"""Rotations by an independent road: scipy's Rotation, exponentials of cross matrices, differences; rows of NumPy
against CasADi columns and expressions of the language."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.geometry import expressions, quaternions, rotations

ALIKE = 1e-15  # of numbers of size 1, by the same operations in the same order
EXACT = 1e-14  # by another road
RATES = 1e-8  # by central differences of step 1e-6


def drawn() -> np.ndarray:
    """Rotation vectors (200, 3) [rad]: over all angles, tiny ones, none, half turns and nearly half turns."""
    rng = np.random.default_rng(41)
    axes = rng.standard_normal((200, 3))
    axes[:12] = np.vstack(
        [np.eye(3), -np.eye(3), [[0, 1, 1], [0, 1, -1], [0, -1, 1], [1, 0, -1], [-1, 0, 1], [1, 1, 0]]]
    )
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    size = rng.uniform(0.0, np.pi, 200)
    size[:30], size[30:60], size[60:90] = (
        np.pi,
        10.0 ** rng.uniform(-300, -3, 30),
        np.pi - 10.0 ** rng.uniform(-15, -3, 30),
    )
    size[90] = 0.0
    return size[:, None] * axes


VECTORS = drawn()
SCIPY = Rotation.from_rotvec(VECTORS)
MATRICES, UNIT = SCIPY.as_matrix(), SCIPY.as_quat(scalar_first=True)


def by_columns(f: Callable[..., Any], *rows: np.ndarray) -> np.ndarray:
    """f of CasADi columns at each row."""
    x = [ca.SX.sym("x", r.shape[1]) for r in rows]
    made = ca.Function("f", x, [ca.densify(f(*x))])
    shape = made.size_out(0)
    columns = made.map(len(rows[0]))(*[r.T for r in rows]).full()
    return columns.reshape(shape[0], len(rows[0]), -1).transpose(1, 0, 2).squeeze()


def by_expression(f: Callable[..., Any], *numbers: np.ndarray) -> np.ndarray:
    """f of parameters of a model."""
    m = gt.Builder()
    x = [m.parameter(f"x{k}", value, unit="1") for k, value in enumerate(numbers)]
    made = f(*x)
    symbols = ca.symvar(made.sx)
    flat = dict(
        zip([f"x{k}[{i}]" for k, v in enumerate(numbers) for i in range(len(v))], np.concatenate(numbers), strict=True)
    )
    values = ca.Function("f", symbols, [ca.densify(made.sx)])(*[flat[s.name()] for s in symbols])
    return values.full().squeeze()


def test_quaternion_matrix() -> None:
    np.testing.assert_allclose(quaternions.quaternion_matrix(UNIT), MATRICES, atol=EXACT)
    np.testing.assert_allclose(quaternions.quaternion_matrix(3.0 * UNIT[7]), 9.0 * MATRICES[7], atol=9 * EXACT)


def test_quaternion_of_a_rotation() -> None:
    q = quaternions.quaternion_of(MATRICES)
    assert np.all(q[:, 0] >= 0)
    np.testing.assert_allclose(q * np.sign(np.sum(q * UNIT, axis=1, keepdims=True)), UNIT, atol=EXACT)
    largest = quaternions.quaternion_of(MATRICES, positive="largest")
    np.testing.assert_allclose(np.max(largest, axis=1), np.max(np.abs(largest), axis=1), atol=ALIKE)
    np.testing.assert_allclose(np.abs(np.sum(largest * q, axis=1)), 1.0, atol=EXACT)
    one_by_one = np.array([quaternions.quaternion_of(R) for R in MATRICES])  # by another body
    np.testing.assert_allclose(one_by_one, q, atol=EXACT)


def test_half_turns_have_one_quaternion() -> None:
    """Of both the one whose first entry that is not zero is positive."""
    axes = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [0, 0.6, -0.8], [0.6, -0.8, 0]])
    turns = 2 * axes[:, :, None] * axes[:, None] - np.eye(3)
    np.testing.assert_allclose(quaternions.quaternion_of(turns), np.hstack([np.zeros((5, 1)), axes]), atol=ALIKE)


def test_what_is_not_finite_becomes_nan() -> None:
    damaged = MATRICES[:3].copy()
    damaged[1, 0, 2] = np.nan
    q = quaternions.quaternion_of(damaged)
    assert np.isnan(q[1]).all() and np.isfinite(q[[0, 2]]).all()


def test_product_conjugate_and_turned_vectors() -> None:
    other = np.roll(UNIT, 71, axis=0)
    expected = (SCIPY * Rotation.from_quat(other, scalar_first=True)).as_matrix()
    np.testing.assert_allclose(quaternions.quaternion_matrix(quaternions.product(UNIT, other)), expected, atol=EXACT)
    np.testing.assert_allclose(
        quaternions.product(UNIT, quaternions.conjugate(UNIT)), np.eye(1, 4).repeat(200, 0), atol=EXACT
    )
    v = np.random.default_rng(3).standard_normal((200, 3))
    np.testing.assert_allclose(by_columns(expressions.rotated, UNIT, v), SCIPY.apply(v), atol=10 * EXACT)
    np.testing.assert_allclose(by_columns(expressions.rotated_back, UNIT, v), SCIPY.inv().apply(v), atol=10 * EXACT)


def test_rotation_vectors_there_and_back() -> None:
    np.testing.assert_allclose(quaternions.quaternion_matrix(quaternions.exponential(VECTORS)), MATRICES, atol=EXACT)
    np.testing.assert_allclose(rotations.rotation_by(VECTORS), MATRICES, atol=EXACT)
    np.testing.assert_allclose(rotations.rotation_by(quaternions.logarithm(UNIT)), MATRICES, atol=EXACT)
    np.testing.assert_allclose(quaternions.logarithm(-UNIT[60:]), VECTORS[60:], atol=EXACT)
    assert np.array_equal(quaternions.logarithm(np.array([1.0, 0, 0, 0])), np.zeros(3))
    np.testing.assert_allclose(rotations.rotation_vector(MATRICES[60:], np.eye(3)), VECTORS[60:], atol=EXACT)


def test_rodrigues_is_the_exponential_of_the_cross_matrix() -> None:
    for v in VECTORS[::5]:
        size = float(np.linalg.norm(v))
        axis = v / size if size else np.eye(3)[0]
        np.testing.assert_allclose(
            rotations.rotation_about(axis, size), expm(rotations.cross_matrix(v)), atol=10 * EXACT
        )
    size = np.linalg.norm(VECTORS[91:], axis=1)
    np.testing.assert_allclose(rotations.rotation_about(VECTORS[91:] / size[:, None], size), MATRICES[91:], atol=EXACT)


def test_cross_matrices_cross() -> None:
    a, b = np.random.default_rng(1).standard_normal((2, 7, 5, 3))
    np.testing.assert_allclose(np.einsum("...ij,...j->...i", rotations.cross_matrix(a), b), np.cross(a, b), atol=ALIKE)


def test_jacobians_of_rotation_vectors() -> None:
    v = np.vstack([1e-6 * np.eye(3), [[9e-3, 3e-3, 0], [9.9e-3, 0, 1e-4], [1.1e-2, 0, 0], [1.0, -2.0, 0.5]]])
    h = 1e-6 * np.eye(3)
    for k in range(3):
        step = Rotation.from_rotvec(h[k])
        by = [Rotation.from_rotvec(v + s * h[k]) * Rotation.from_rotvec(-v) for s in (1, -1)]
        np.testing.assert_allclose(
            rotations.left_jacobian(v)[:, :, k], (by[0].as_rotvec() - by[1].as_rotvec()) / 2e-6, atol=RATES
        )
        by = [Rotation.from_rotvec(v) * s for s in (step, step.inv())]
        slope = (by[0].as_rotvec() - by[1].as_rotvec()) / 2e-6
        np.testing.assert_allclose(rotations.inverse_right_jacobian(v)[:, :, k], slope, atol=RATES)
    both = rotations.left_jacobian(-v) @ rotations.inverse_right_jacobian(
        v
    )  # of the opposite vector the left one is the right one
    np.testing.assert_allclose(both, np.eye(3)[None].repeat(len(v), 0), atol=1e-13)  # the series end at 1e-14


def test_small_turns() -> None:
    turn = np.random.default_rng(2).uniform(-1e-6, 1e-6, (200, 3))
    expected = (SCIPY * Rotation.from_rotvec(turn)).as_matrix()
    np.testing.assert_allclose(quaternions.quaternion_matrix(quaternions.turned(UNIT, turn)), expected, atol=EXACT)
    change = np.einsum("nij,nj->ni", quaternions.turn_matrix(UNIT), turn)
    np.testing.assert_allclose(quaternions.turned(UNIT, turn) - UNIT, change, atol=1e-11)  # second order in the turn
    np.testing.assert_allclose(
        4 * np.swapaxes(quaternions.turn_matrix(UNIT), 1, 2) @ change[..., None], turn[..., None], atol=EXACT
    )


def test_angle_between_quaternions() -> None:
    other = quaternions.product(UNIT, quaternions.exponential(VECTORS[::-1]))
    size = np.linalg.norm(VECTORS[::-1], axis=1)
    got = quaternions.angle_between(-2.0 * UNIT, other)
    np.testing.assert_allclose(got[size < 3], size[size < 3], atol=4 * EXACT)
    np.testing.assert_allclose(got, size, atol=1e-6)  # of the arc sine near 1


def test_turns_with_a_purpose() -> None:
    rng = np.random.default_rng(5)
    for a, b in rng.standard_normal((20, 2, 3)):
        a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
        turn = rotations.shortest_rotation(a, b)
        np.testing.assert_allclose(turn @ a, b, atol=10 * EXACT)
        assert rotations.angle_between(turn, np.eye(3)) == pytest.approx(np.arccos(a @ b), abs=1e-12)
        frame = rotations.right_handed(5 * a)
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=EXACT)
        np.testing.assert_allclose(frame[0], a, atol=EXACT)
        assert np.linalg.det(frame) == pytest.approx(1.0, abs=EXACT)


def test_angles_of_rotations() -> None:
    zyz, singular = rotations.zyz(UNIT[91:])
    assert not singular.any()
    np.testing.assert_allclose(Rotation.from_euler("ZYZ", zyz).as_matrix(), MATRICES[91:], atol=EXACT)
    for a in zyz[:20]:
        turned = Rotation.from_euler("ZYZ", a).as_matrix()
        np.testing.assert_allclose(quaternions.quaternion_matrix(quaternions.zyz_quaternion(*a)), turned,
                                   atol=EXACT)  # fmt: skip
        rpy = a * [1.0, 0.45, 1.0]
        np.testing.assert_allclose(
            rotations.rotation_of_rpy(rpy), Rotation.from_euler("xyz", rpy).as_matrix(), atol=EXACT
        )
        turned = Rotation.from_euler("xyz", rpy).as_quat(scalar_first=True)
        np.testing.assert_allclose(np.abs(quaternions.rpy_quaternion(*rpy) @ turned), 1.0, atol=EXACT)
        np.testing.assert_allclose(rotations.rpy_of_rotation(rotations.rotation_of_rpy(rpy)), rpy, atol=100 * EXACT)


def test_poses() -> None:
    t = np.random.default_rng(4).standard_normal((200, 3))
    a, b = rotations.poses_of(MATRICES, t), rotations.poses_of(MATRICES[::-1], t[::-1])
    np.testing.assert_allclose(rotations.matrices_of(a), MATRICES, atol=EXACT)
    p = np.array([0.3, -0.2, 0.7])
    inner = np.einsum("nij,j->ni", MATRICES[::-1], p) + t[::-1]
    expected = np.einsum("nij,nj->ni", MATRICES, inner) + t
    got = by_columns(expressions.applied, rotations.composed(a, b), np.tile(p, (200, 1)))
    np.testing.assert_allclose(got, expected, atol=10 * EXACT)
    nothing = rotations.composed(rotations.inverse_poses(a), a)
    np.testing.assert_allclose(nothing, np.eye(1, 7).repeat(200, 0), atol=10 * EXACT)


ALIKE_IN_ALL: list[tuple[Callable[..., Any], list[np.ndarray]]] = [
    (quaternions.product, [UNIT, UNIT[::-1]]), (quaternions.conjugate, [UNIT]),
    (quaternions.quaternion_matrix, [UNIT]), (quaternions.turn_matrix, [UNIT]),
    (quaternions.small_turn, [UNIT, VECTORS]),
    (rotations.cross_matrix, [VECTORS]), (lambda v: rotations.rotation_about(v, 0.7), [UNIT[:, 1:]]),
]  # fmt: skip


@pytest.mark.parametrize(("f", "rows"), ALIKE_IN_ALL)
def test_rows_columns_and_expressions_are_alike(f: Callable[..., Any], rows: list[np.ndarray]) -> None:
    made = f(*rows)
    np.testing.assert_allclose(by_columns(f, *rows), made, atol=ALIKE, rtol=0)
    for k in range(0, 200, 40):
        columns = f(*[ca.DM(r[k]) for r in rows]).full().squeeze()
        np.testing.assert_allclose(columns, made[k], atol=ALIKE, rtol=0)
        np.testing.assert_allclose(f(*[r[k] for r in rows]), made[k], atol=ALIKE, rtol=0)
        np.testing.assert_allclose(by_expression(f, *[r[k] for r in rows]), made[k], atol=ALIKE, rtol=0)


def test_rows_and_columns_of_turns_are_alike() -> None:
    """Bodies of their own: CasADi's are smooth at zero, NumPy's are exact at all rotations."""
    np.testing.assert_allclose(
        by_columns(quaternions.exponential, VECTORS), quaternions.exponential(VECTORS), atol=ALIKE, rtol=0
    )
    np.testing.assert_allclose(
        by_columns(quaternions.logarithm, UNIT), quaternions.logarithm(UNIT), atol=4 * ALIKE, rtol=0
    )  # up to pi
    turn = np.random.default_rng(6).uniform(-0.5, 0.5, (200, 3))
    np.testing.assert_allclose(
        by_columns(quaternions.turned, UNIT, turn), quaternions.turned(UNIT, turn), atol=ALIKE, rtol=0
    )


def test_velocity_and_kinematics_of_a_quaternion_undo_each_other() -> None:
    """w in the body's axes gives rates of e; these give the velocity in outer coordinates, R w."""
    m = gt.Builder()
    e, w = m.variable("e", 4, unit="1"), m.variable("w", 3, unit="rad/s")
    rates = [x.sx for x in expressions.quaternion_kinematics(e, w)]
    velocity = expressions.quaternion_velocity(e).sx
    f = ca.Function("f", [e.sx, w.sx], [ca.substitute(velocity, gt.der(e).sx, ca.vertcat(*rates))])
    for q, v in zip(UNIT[91:100], VECTORS[91:100], strict=True):
        np.testing.assert_allclose(f(q, v).full()[:, 0], quaternions.quaternion_matrix(q) @ v, atol=10 * EXACT)


def test_numbers_of_casadi_are_columns_too() -> None:
    q = ca.DM([0.8, 0.6, 0.0, 0.0])
    assert (quaternions.conjugate(q).full().ravel() == [0.8, -0.6, 0.0, 0.0]).all()
    assert np.allclose(quaternions.quaternion_matrix(q).full(), quaternions.quaternion_matrix(np.array(q).ravel()))
