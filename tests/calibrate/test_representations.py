"""Orientations of files in any representation, against rotations multiplied out by hand."""

from pathlib import Path

import numpy as np
import pytest

from gtmodel.calibrate import Measured, MeasuredSignal, read_poses
from gtmodel.geometry.rotations import matrices
from gtmodel.measurements.orientations import quaternions
from gtmodel.results import ArgumentError

AXES = {"x": 0, "y": 1, "z": 2}
SAME = 1e-12


def about(axis, angle):
    """The matrix of a turn about a coordinate axis, by hand."""
    i = AXES[axis]
    j, k = (i + 1) % 3, (i + 2) % 3
    R = np.eye(3)
    R[j, j] = R[k, k] = np.cos(angle)
    R[k, j], R[j, k] = np.sin(angle), -np.sin(angle)
    return R


@pytest.mark.parametrize("axes", ["zyx", "xyz", "zyz", "xzx"])
@pytest.mark.parametrize("kind", ["intrinsic", "extrinsic"])
def test_euler_angles_turn_in_the_order_of_their_columns(kind, axes):
    angles = np.random.default_rng(1).uniform(-3, 3, (20, 3))
    read = matrices(quaternions(angles, f"{kind} {axes}"))
    for R, row in zip(read, angles, strict=True):
        one, two, three = (about(a, x) for a, x in zip(axes, row, strict=True))
        by_hand = one @ two @ three if kind == "intrinsic" else three @ two @ one
        np.testing.assert_allclose(R, by_hand, atol=SAME)


def test_kuka_turns_about_z_then_the_new_y_then_the_new_x():
    A, B, C = 0.3, -0.7, 1.1
    (R,) = matrices(quaternions(np.array([[A, B, C]]), "KUKA A B C"))
    np.testing.assert_allclose(R, about("z", A) @ about("y", B) @ about("x", C), atol=SAME)


def test_roll_pitch_and_yaw_turn_about_the_axes_of_the_frame_in_this_order():
    roll, pitch, yaw = 0.3, -0.7, 1.1
    (R,) = matrices(quaternions(np.array([[roll, pitch, yaw]]), "RPY"))
    np.testing.assert_allclose(R, about("z", yaw) @ about("y", pitch) @ about("x", roll), atol=SAME)
    (R,) = matrices(quaternions(np.array([[yaw, pitch, roll]]), "ABC"))
    np.testing.assert_allclose(R, about("z", yaw) @ about("y", pitch) @ about("x", roll), atol=SAME)


def test_vectors_matrices_and_both_orders_of_a_quaternion_are_one_rotation():
    q = np.array([[0.8, 0.36, -0.48, 0.0]])
    (R,) = matrices(q)
    angle, axis = 2 * np.arccos(0.8), q[0, 1:] / 0.6
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, [1.0, 2.0, 3.0]
    readings = {
        "quaternion w x y z": q, "quaternion x y z w": q[:, [1, 2, 3, 0]], "rotation vector": angle * axis[None],
        "matrix": R.reshape(1, 9),
    }  # fmt: skip
    for representation, rows in readings.items():
        np.testing.assert_allclose(quaternions(rows, representation), q, atol=SAME)
    np.testing.assert_allclose(quaternions(pose.reshape(1, 16), "matrix"), q, atol=SAME)
    np.testing.assert_allclose(quaternions(pose[:3].reshape(1, 12), "matrix"), q, atol=SAME)


def test_a_file_of_poses_as_matrices_and_one_of_angles_in_degrees(tmp_path: Path):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = about("z", np.radians(30)) @ about("x", np.radians(10)), [500.0, -600.0, 700.0]
    names = [f"m{k}" for k in range(16)]
    (tmp_path / "m.csv").write_text(
        ",".join(["q", *names]) + "\n" + ",".join(map(str, [1.0, *pose.ravel().tolist()])) + "\n"
    )
    (tmp_path / "a.csv").write_text("q,x,y,z,A,B,C\n1,500,-600,700,30,0,10\n")
    q = MeasuredSignal("q", "mm")
    as_matrix = {"T": MeasuredSignal(names, "mm", representation="matrix"),
                 "e": MeasuredSignal(names, "1", representation="matrix")}  # fmt: skip
    as_angles = {"T": MeasuredSignal(["x", "y", "z"], "mm"),
                 "e": MeasuredSignal(["A", "B", "C"], "deg", representation="KUKA A B C", deviation=0.01)}  # fmt: skip
    a, b = (read_poses(tmp_path / f, Measured({"q": q, **s}, orientation="e")).measurements
            for f, s in (("m.csv", as_matrix), ("a.csv", as_angles)))  # fmt: skip
    for name in ("T", "e"):
        np.testing.assert_allclose(a.values[name], b.values[name], atol=SAME)
    np.testing.assert_allclose(b.covariance("e", 3), [np.radians(0.01) ** 2 * np.eye(3)], rtol=1e-9)  # a turn in rad


@pytest.mark.parametrize(
    ("representation", "columns", "unit", "sentence"),
    [
        ("euler", "abc", "deg", "expected one of quaternion w x y z.*; found 'euler'"),
        ("intrinsic zzx", "abc", "deg", "turns about one axis twice in a row"),
        ("KUKA A B C", "abc", "1", "consists of angles: set the unit to deg or rad"),
        ("matrix", "abc", "1", "'matrix' has 9 or 12 or 16 columns; found 3"),
        ("matrix", "ijklmnopq", "1", "the matrix of pose 1 is not a rotation: it is mirrored"),
        ("matrix", "ijklmnopa", "1", "the matrix of pose 1 is not a rotation: it deviates from orthogonality"),
    ],
)
def test_what_is_no_rotation_is_said(tmp_path: Path, representation, columns, unit, sentence):
    mirrored = np.diag([1.0, 1.0, -1.0]).ravel().tolist()
    names = [*"abc", *"ijklmnopq"]
    (tmp_path / "p.csv").write_text(
        ",".join(["cart", *names]) + "\n" + ",".join(map(str, [1.0, 30.0, 20.0, 10.0, *mirrored])) + "\n"
    )
    e = MeasuredSignal(list(columns), unit, representation=representation)
    T = MeasuredSignal(list("abc"), "mm")
    with pytest.raises(ArgumentError, match=sentence) as refused:
        read_poses(tmp_path / "p.csv", Measured({"q": MeasuredSignal("cart", "mm"), "T": T, "e": e}, orientation="e"))
    assert refused.value.argument.startswith("measured.signals.e")
