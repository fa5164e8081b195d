"""The loop of an arm with joints in rad: equal to the loop in Python byte for byte; datagrams in degrees; the study."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.cgen import generate
from gtmodel.loop import (
    Channel,
    DynamicsLaw,
    Exchange,
    Faults,
    LoopLimits,
    LoopProcess,
    PythonLoop,
    RobotSide,
    Settings,
    TrajectoryLaw,
    build,
    egm,
    lockstep,
    rsi,
)
from gtmodel.loop.loop_study import there_and_back
from gtmodel.loop.one_run import drives_of, joint_servo
from gtmodel.loop.plant import DrivePlant, RigidBodyPlant
from gtmodel.results import ArgumentError, Status, Trajectory

ARM = gt.robots.serial_arm(a=[0.4, 0.3], alpha=[0.0, 0.0], m=[4.0, 2.0], c=[[-0.2, 0, 0], [-0.15, 0, 0]],
                           base_rpy=[np.pi / 2, 0.0, 0.0], rotor_inertia=[0.5, 0.2])  # fmt: skip
FROM, BY, ROWS = np.array([0.3, 0.5]), np.array([0.8, -0.6]), 151
CYCLES, HOLD, RAMP = 260, 25, 40
DRIVES = drives_of(6)
FAULTS = Faults(lost=0.05, delayed=0.2, repeated=0.05, garbage=0.02, longest_delay=3, seed=44)


def motion() -> Trajectory:
    """From rest to rest in 0.6 s, every 4 ms."""
    s, duration = np.linspace(0.0, 1.0, ROWS)[:, None], 0.004 * (ROWS - 1)
    place, rate, second = s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)
    values = {"q": FROM + place * BY, "der(q)": rate * BY / duration, "der(q,2)": second * BY / duration**2}
    return Trajectory(0.004 * np.arange(ROWS), values, {"q": "rad", "der(q)": "rad/s", "der(q,2)": "rad/s2"})


@pytest.fixture(scope="module")
def functions():
    return {"fk": ARM.causal("q", "T"), "inverse_dynamics": ARM.causal("q", "tau")}


@pytest.fixture(scope="module")
def folder(functions, tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("arm")
    generate(functions, place, name="arm")
    return place


@pytest.fixture(scope="module")
def program(folder, tmp_path_factory) -> Path:
    return build(folder, tmp_path_factory.mktemp("arm_loop"), axes=2, joints=True)


def plant(law: str) -> DrivePlant | RigidBodyPlant:
    if law == "trajectory":
        return DrivePlant(FROM.tolist(), DRIVES["a"][:2], DRIVES["b"][:2], DRIVES["delay"])
    forward = ARM.causal(known="tau", targets="der(q,2)", prefer="q")
    return RigidBodyPlant(forward, None, FROM.tolist(), joint_servo(ARM, FROM))


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
@pytest.mark.parametrize(("law", "faults"), [("trajectory", FAULTS), ("dynamics", Faults())])
def test_the_log_equals_the_twins(functions, program, tmp_path, protocol, law, faults) -> None:
    table, servo = there_and_back(ARM, motion(), CYCLES, joints=2), joint_servo(ARM, FROM)
    kp, kd = ([*x, *[1.0] * 4] for x in (servo.kp_N_m, servo.kd_N_s_m))
    (tmp_path / "reference.table").write_bytes(table.to_bytes())

    def torques(q, dq, ddq):
        tau, status = functions["inverse_dynamics"](q, dq, ddq)
        return status, tau.tolist()

    laws = {
        "trajectory": TrajectoryLaw(table, 2, True, 20, 4, DRIVES["a"], DRIVES["b"]),
        "dynamics": DynamicsLaw(table, 2, torques, True, protocol == "egm", 2, kp, kd, joints=True),
    }
    text = {n: ",".join(map(repr, x)) for n, x in (("a", DRIVES["a"]), ("b", DRIVES["b"]), ("kp", kp), ("kd", kd))}
    words = ["--peer", protocol, "--law", law, "--feedforward", "on", "--lockstep", "--live", "--delay-ms", "20"]
    words += ["--reference", str(tmp_path / "reference.table"), "--log", str(tmp_path / "log"), "--lead-ms", "2"]
    words += [word for name, values in text.items() for word in (f"--{name}", values)]
    words += ["--hold", str(HOLD), "--ramp", str(RAMP), "--step", "0.2", "--following", "2", "--idle-ms", "9000"]

    def run(answering):
        robot = RobotSide(protocol, plant(law), joints=True)
        return lockstep(robot, answering, CYCLES, Channel(faults), Channel(faults))

    with LoopProcess(program, [*words, "--cycles", str(CYCLES)]) as process:
        by_c = run(process.exchange)
        report = process.finish()
    limits = LoopLimits(step_m=0.2, following_m=2.0)
    settings = Settings(dry=False, hold_cycles=HOLD, ramp_cycles=RAMP, limits=limits)
    twin = PythonLoop(settings, Exchange(protocol, 2, joints=True), laws[law])
    by_python = run(twin.exchange)
    assert (tmp_path / "log").read_bytes() == bytes(twin.log)
    assert np.array_equal(by_c.measured_m, by_python.measured_m) and report["log_complete"]
    off = np.abs(by_c.measured_m - table.rows[:CYCLES, :2]).max()
    assert np.ptp(by_c.measured_m[:, 0]) > 0.79
    assert off < (0.1 if faults.lost else 0.02)  # rad; three cycles of 2.5 rad/s, and the servo's sag at the start


def test_datagrams_hold_joints_in_degrees() -> None:
    """Read by the codecs alone: EGM absolute with speeds, RSI as corrections from the start."""
    rest = DrivePlant([0.5, -1.0], [0.0, 0.0], [1.0, 1.0], 1)
    answers = []
    for protocol in ("egm", "rsi"):
        robot = RobotSide(protocol, rest, joints=True)  # type: ignore[arg-type]
        peer = Exchange(protocol, 2, joints=True)  # type: ignore[arg-type]
        feedback = peer.read(robot.datagram())
        assert feedback is not None
        np.testing.assert_allclose(feedback.position_m[:2], [0.5, -1.0], rtol=0, atol=1e-8)  # RSI sends 1e-6 deg
        peer.begin(feedback)
        command = gt.loop.exchange.Command([0.6, -1.1, 0, 0, 0, 0], [2.0, 0.0, 0, 0, 0, 0])
        answers.append(peer.write(feedback, command))
    sensor, correction = egm.decode_sensor(answers[0]), rsi.decode_sensor(answers[1])
    np.testing.assert_allclose(sensor.joints_deg, np.degrees([0.6, -1.1]), rtol=1e-15)
    np.testing.assert_allclose(sensor.joint_speeds_deg_s, np.degrees([2.0, 0.0]), rtol=1e-15)
    assert sensor.external_mm == [] and correction.ek_mm == [0.0] * 6
    np.testing.assert_allclose(correction.ak_deg[:2], np.degrees([0.1, -0.1]), rtol=0, atol=2e-6)


def test_the_study_of_an_arm(folder, program) -> None:
    s = gt.loop.study(
        ARM, folder, motion(), peer="rsi", law="dynamics", seconds=1.2, in_lockstep=True, built=program.parent
    )
    assert s.status.ok, s.message
    assert s.greatest_joint_speed == pytest.approx(0.8 * 1.875 / 0.6, rel=1e-3) and s.greatest_speed is None
    assert set(s.runs[1]) >= {"tcp_rms_mm", "joint_largest_mrad"} and "cart_largest_mm" not in s.runs[1]


@pytest.mark.parametrize(
    ("changed", "where"),
    [({"law": "path"}, "law"), ({"law": "replay"}, "law"), ({"reference": motion().select(["q"])}, "reference")],
)
def test_what_joints_do_not_do(folder, program, changed, where) -> None:
    given = {"reference": motion(), "peer": "egm", "seconds": 0.1, "in_lockstep": True, "built": program.parent}
    with pytest.raises(ArgumentError) as caught:
        gt.loop.study(ARM, folder, **given | changed)
    assert caught.value.argument == where


def test_the_reference_of_joints_is_one_of_the_tool(functions) -> None:
    rows = there_and_back(ARM, motion(), 400, joints=2).rows
    T, status = functions["fk"](rows[:, :2])
    assert not np.any(status) and status[0] == Status.OK
    np.testing.assert_allclose(rows[:, 6:9], T, atol=1e-14)
    assert rows.shape[1] == 15
