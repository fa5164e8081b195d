"""Kind "wrench_calibration" reads readings and poses from files of any form: the same numbers, by every road."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from tests.support import drifting_sensor

L = gt.control.lead_through
POSES, SAME = 30, 1e-9
RNG = np.random.default_rng(4310)  # synthetic: mass 1.3 kg, noise 0.05 N and 0.003 N m
TURNS = scipy.spatial.transform.Rotation.random(POSES, rng=RNG)
SENSOR = L.SyntheticSensor(mass=1.3, centre=(0.01, -0.02, 0.1), force_noise=0.05, moment_noise=0.003)
F, M = SENSOR.readings_at_rest(TURNS.as_matrix(), RNG)
TIME = 2.0 * np.arange(POSES)
EXPECTED: Any = L.wrench_study(
    gt.Trajectory(
        TIME, {"turn": TURNS.as_rotvec(), "force": F, "moment": M}, {"turn": "rad", "force": "N", "moment": "N.m"}
    )
)
NUMBERED = """
[readings.signals]
orientation = {{ column = {turn}, unit = "{unit}", representation = "{representation}" }}
force = {{ column = {force}, unit = "N" }}
moment = {{ column = {moment}, unit = "N.m" }}
"""
REPRESENTATIONS = {
    "quaternion w x y z": (TURNS.as_quat(scalar_first=True), "1"),
    "quaternion x y z w": (TURNS.as_quat(), "1"),
    "rotation vector": (TURNS.as_rotvec(degrees=True), "deg"),
    "matrix": (TURNS.as_matrix().reshape(-1, 9), "1"),
    "KUKA A B C": (TURNS.as_euler("ZYX", degrees=True), "deg"),
    "intrinsic zyx": (TURNS.as_euler("ZYX"), "rad"),
    "ABC": (TURNS.as_euler("ZYX", degrees=True), "deg"),
    "RPY": (TURNS.as_euler("xyz"), "rad"),
    "extrinsic xyz": (TURNS.as_euler("xyz", degrees=True), "deg"),
}


def table(path: Path, *columns: np.ndarray, sign: str = " ", decimal: str = ".", head: str = "") -> None:
    rows = np.column_stack(columns)
    text = "\n".join(sign.join(f"{x:.15g}".replace(".", decimal) for x in row) for row in rows)
    path.write_text(f"{head}{text}\n")


def numbers(first: int, count: int) -> str:
    return str([str(first + k) for k in range(count)])


def solved(folder: Path, text: str) -> Any:
    (folder / "wrench.toml").write_text(f'kind = "wrench_calibration"\n[readings]\n{text}')
    problem = load(folder / "wrench.toml")
    assert explain(problem, Context(folder=folder))
    return answer(problem, Context(folder=folder))


def same(study: Any) -> bool:
    """Whether mass, centre and interval are those of the numbers in memory."""
    pairs = [(s.mass, *s.centre, s.half_widths["mass"]) for s in (study, EXPECTED)]
    return study.usable == EXPECTED.usable and np.allclose(*pairs, rtol=SAME, atol=0.0)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_a_headerless_file_with_decimal_commas_and_any_orientation(tmp_path: Path, representation: str) -> None:
    turn, unit = REPRESENTATIONS[representation]
    table(tmp_path / "poses.txt", TIME, turn, F, M, sign=";", decimal=",")
    k = 2 + turn.shape[1]
    keys = NUMBERED.format(
        turn=numbers(2, k - 2), unit=unit, representation=representation, force=numbers(k, 3), moment=numbers(k + 3, 3)
    )
    assert same(
        solved(
            tmp_path,
            f'file = "poses.txt"\nheader = 0\ndecimal = "comma"\ntime = {{ column = "1", unit = "s" }}\n{keys}',
        )
    )


def test_units_and_scales_are_declared(tmp_path: Path) -> None:
    head = "stamp,Rx,Ry,Rz,Fx,Fy,Fz,Mx,My,Mz\n"
    table(tmp_path / "a.csv", 1e3 * TIME, TURNS.as_rotvec(), -F / 1e3, 1e3 * M, sign=",", head=head)
    assert same(solved(tmp_path, """file = "a.csv"
time = { column = "stamp", unit = "ms" }
[readings.signals]
orientation = { column = ["Rx", "Ry", "Rz"], unit = "rad" }
force = { column = ["Fx", "Fy", "Fz"], unit = "kN", scale = -1 }
moment = { column = ["Mx", "My", "Mz"], unit = "N.mm" }
"""))  # fmt: skip


def test_a_matlab_file(tmp_path: Path) -> None:
    values = {"t": TIME, "q": TURNS.as_quat(scalar_first=True), "F": F, "M": M}
    scipy.io.savemat(tmp_path / "a.mat", values)
    assert same(solved(tmp_path, """file = "a.mat"
time = { column = "t", unit = "s" }
[readings.signals]
orientation = { column = "q", unit = "1", representation = "quaternion w x y z" }
force = { column = "F", unit = "N" }
moment = { column = "M", unit = "N.m" }
"""))  # fmt: skip


APART = """file = "readings.txt"
header = 0
time = {{ column = "{time}", unit = "s" }}
{own}
[readings.signals]
orientation = {{ column = ["2", "3", "4", "5"], unit = "1", representation = "quaternion x y z w" }}
force = {{ column = ["2", "3", "4"], unit = "N" }}
moment = {{ column = ["5", "6", "7"], unit = "N.m" }}
[readings.poses]
file = "poses.txt"
{poses}
"""


def test_poses_in_their_own_file_are_the_nearest_in_time(tmp_path: Path) -> None:
    late = TIME + RNG.uniform(-0.05, 0.05, POSES)
    table(tmp_path / "readings.txt", TIME, F, M)
    table(tmp_path / "poses.txt", late, TURNS.as_quat())
    keys = APART.format(time="1", own="", poses="tolerance_s = 0.06")
    assert same(solved(tmp_path, keys))
    for other, key in (("tolerance_s = 0.01", "readings.file"), ("", "readings.poses.tolerance_s")):
        with pytest.raises(InputError) as caught:
            solved(tmp_path, APART.format(time="1", own="", poses=other))
        assert key in str(caught.value)


def test_poses_by_number_in_another_order_or_by_the_order_of_the_rows(tmp_path: Path) -> None:
    number = np.arange(POSES) + 7.0
    mixed = RNG.permutation(POSES)
    table(tmp_path / "readings.txt", number, F, M)
    table(tmp_path / "poses.txt", number[mixed], TURNS.as_quat()[mixed])
    assert same(solved(tmp_path, APART.format(time="", own="", poses='match = "number"\nnumber = "1"')))
    table(tmp_path / "poses.txt", number, TURNS.as_quat())
    assert same(solved(tmp_path, APART.format(time="", own="", poses='match = "order"')))
    for rows, match in ((number[1:], 'match = "order"'), (number[1:], 'match = "number"\nnumber = "1"')):
        table(tmp_path / "poses.txt", rows, TURNS.as_quat()[1:])
        with pytest.raises(InputError):
            solved(tmp_path, APART.format(time="", own="", poses=match))


def test_poses_interpolated_along_a_slow_turn_are_those_of_the_turn(tmp_path: Path) -> None:
    """A constant rate about a fixed axis, by its closed form, and signs of the quaternions that jump."""
    axis = np.array([0.6, 0.0, 0.8])
    start = scipy.spatial.transform.Rotation.from_rotvec([0.4, 1.1, -0.3])

    def at(t: np.ndarray) -> scipy.spatial.transform.Rotation:
        return start * scipy.spatial.transform.Rotation.from_rotvec(np.outer(0.11 * t, axis))

    turns = at(TIME)
    f, m = SENSOR.readings_at_rest(turns.as_matrix(), RNG)
    clock = np.linspace(-1.0, TIME[-1] + 1.0, 50)
    table(tmp_path / "readings.txt", TIME, f, m)
    table(tmp_path / "poses.txt", clock, at(clock).as_quat() * np.where(np.arange(50) % 3, 1, -1)[:, None])
    study = solved(tmp_path, APART.format(time="1", own="", poses='match = "interpolated"'))
    log = gt.Trajectory(
        TIME, {"turn": turns.as_rotvec(), "force": f, "moment": m}, {"turn": "rad", "force": "N", "moment": "N.m"}
    )
    assert study.mass == pytest.approx(L.wrench_study(log).mass, rel=1e-7)
    table(tmp_path / "poses.txt", clock[3:], at(clock[3:]).as_quat())
    with pytest.raises(InputError):
        solved(tmp_path, APART.format(time="1", own="", poses='match = "interpolated"'))


def test_sessions_whose_clock_restarts_and_temperatures_are_read(tmp_path: Path) -> None:
    session, kelvin = np.repeat([1.0, 2.0], POSES // 2), np.linspace(20.0, 30.0, POSES) + 273.15
    time = np.concatenate([TIME[: POSES // 2]] * 2)
    change = np.outer(np.where(session == 1.0, 1.5, 0.0), [1.0, 0.0, 0.0])
    names = [f"{w}[{k}]" for w in ("turn", "force", "moment") for k in range(3)]
    head = ",".join(["time", *names, "run", "T"]) + "\n"
    table(tmp_path / "a.csv", time, TURNS.as_rotvec(), F + change, M, session, kelvin, sign=",", head=head)
    keys = (
        'file = "a.csv"\nsession = "run"\ndrift = {drift}\n[readings.signals]\n'
        'temperature = {{ column = "T", unit = "K" }}\n'
    )
    left_out = solved(tmp_path, keys.format(drift='"none"'))
    assert not left_out.checks["force_session"].passed and "force_temperature" in left_out.checks
    study = solved(tmp_path, keys.format(drift='["session"]'))
    assert study.status.ok and study.force_changes["session_1"] == pytest.approx([1.5, 0.0, 0.0], abs=0.1)
    assert study.mass == pytest.approx(1.3, abs=0.01)


def test_pushes_are_read_as_the_poses_are(tmp_path: Path) -> None:
    push = RNG.normal(size=(9, 3)) * 20
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (9, 1))
    weight = np.tile([0.0, 0.0, -9.81 * 1.3], (9, 1))
    f, m = push + weight, np.cross([0.0, 0.0, 0.2], push) + np.cross(SENSOR.centre, weight)
    table(tmp_path / "readings.txt", TIME, F, M)
    table(tmp_path / "poses.txt", TIME, TURNS.as_quat())
    table(tmp_path / "pushes.txt", TIME[:9], f, m)
    table(tmp_path / "held.txt", TIME[:9], upright)
    own = 'pushes = "pushes.txt"\nforce_noise_N = 0.05\nmoment_noise_Nm = 0.003'
    study = solved(tmp_path, APART.format(time="1", own=own, poses='tolerance_s = 0.1\npushes = "held.txt"'))
    assert study.arm == pytest.approx([0.0, 0.0, 0.2], abs=0.005)
    with pytest.raises(InputError) as caught:
        solved(tmp_path, APART.format(time="1", own=own, poses="tolerance_s = 0.1"))
    assert "readings.poses.pushes" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ('representation = "quaternion w x y z"', "readings.signals.orientation.representation"),
        ('representation = "yaw pitch roll"', "readings.signals.orientation.representation"),
        ('representation = "KUKA A B C"', "readings.signals.orientation.representation"),
    ],
)
def test_a_wrong_representation_is_named(tmp_path: Path, change: str, key: str) -> None:
    names = [f"{w}[{k}]" for w in ("turn", "force", "moment") for k in range(3)]
    table(tmp_path / "a.csv", TIME, TURNS.as_rotvec(), F, M, sign=",", head=",".join(["time", *names]) + "\n")
    with pytest.raises(InputError) as caught:
        solved(
            tmp_path, f'file = "a.csv"\n[readings.signals]\norientation = {{ column = "turn", unit = "1", {change} }}\n'
        )
    assert key in str(caught.value)


def test_a_linear_drift_without_a_clock_asks_for_one(tmp_path: Path) -> None:
    table(tmp_path / "readings.txt", F, M)
    table(tmp_path / "poses.txt", TURNS.as_quat())
    with pytest.raises(InputError) as caught:
        solved(tmp_path, APART.format(time="", own='drift = "linear"', poses='match = "order"'))
    assert "readings.sample_time_s" in str(caught.value)


CLONE = Path(__file__).parents[2]


def test_the_shipped_file_is_that_of_its_seed_and_its_drift_is_named_and_estimated() -> None:
    assert (drifting_sensor.FOLDER / "poses.txt").read_text() == drifting_sensor.text()
    problem = CLONE / "problems/wrench_drift.toml"
    study: Any = answer(load(problem), Context(folder=problem.parent))
    assert study.status.ok and study.mass == pytest.approx(drifting_sensor.MASS, rel=0.003)
    assert study.mass == pytest.approx(drifting_sensor.MASS, abs=2 * study.half_widths["mass"])
    assert study.centre == pytest.approx(drifting_sensor.CENTRE, abs=1e-3)
    assert np.linalg.norm(study.force_drift) * 594 == pytest.approx(drifting_sensor.DRIFT, abs=0.1)
    assert any("seed 43" in note for note in study.notes)
    left_out = answer(load(problem, ['readings.drift="none"']), Context(folder=problem.parent))
    assert not left_out.checks["force_drift"].passed
    assert any("drift by 2" in note and 'drift = "linear"' in note for note in left_out.notes), left_out.notes


def write_bag(path: Path) -> None:
    """The readings and poses as topics, the poses a millisecond later."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, start = store.types, 1_700_000_000_000_000_000
    vector = types["geometry_msgs/msg/Vector3"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        wrench = bag.add_connection("/wrench", "geometry_msgs/msg/Wrench", typestore=store)
        pose = bag.add_connection("/turn", "geometry_msgs/msg/Quaternion", typestore=store)
        for k, q in enumerate(TURNS.as_quat()):
            stamp = start + round(1e9 * TIME[k])
            one = types["geometry_msgs/msg/Wrench"](vector(*F[k].tolist()), vector(*M[k].tolist()))
            bag.write(wrench, stamp, store.serialize_cdr(one, "geometry_msgs/msg/Wrench"))
            other = types["geometry_msgs/msg/Quaternion"](*q.tolist())
            bag.write(pose, stamp + 1_000_000, store.serialize_cdr(other, "geometry_msgs/msg/Quaternion"))


BAG = """file = "log"
[readings.signals]
orientation = { column = ["x", "y", "z", "w"], unit = "1", representation = "quaternion x y z w", stream = "/turn" }
force = { column = ["force.x", "force.y", "force.z"], unit = "N", stream = "/wrench" }
moment = { column = ["torque.x", "torque.y", "torque.z"], unit = "N.m", stream = "/wrench" }
"""


def test_topics_of_a_bag(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    write_bag(tmp_path / "log")
    assert same(solved(tmp_path, BAG + '[readings.poses]\nfile = "log"\ntolerance_s = 0.002\n'))
    apart = '[readings.poses]\nfile = "log"\ntolerance_s = {}\n'
    other_clock = BAG.replace('"N.m", stream = "/wrench"', '"N.m", stream = "/turn"')
    for text, key in (
        (BAG, "readings.signals.force"),
        (BAG + apart.format(0.0005), "readings.file"),
        (other_clock + apart.format(1.0), "readings"),
    ):
        with pytest.raises(InputError) as caught:
            solved(tmp_path, text)
        assert key in str(caught.value)
