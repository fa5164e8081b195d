"""The C loop over EGM and RSI with a functional mock-up unit as its plant, beside plants of another origin."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.toolchain import find
from gtmodel.loop import study
from gtmodel.loop.process import rows_of
from gtmodel.results import ArgumentError, SolveStatus, Trajectory
from tests.loop import units
from tests.loop.smooth import smooth
from tests.support import wild_units

pytest.importorskip("fmpy")
if isinstance(find(), str):
    pytest.skip("no C compiler: no unit", allow_module_level=True)

SECONDS = 0.8
# carts and commands [m] of a record: the same Runge and Kutta in C and by CasADi, with sums in another order
ROUND_OFF_M = 1e-12
POSITIONS, COMMANDS = units.POSITIONS, units.COMMANDS
# servo that a unit with held forces cannot follow: c h / m is beyond 2
UNSTABLE = 80_000.0


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("code")
    robot = units.robot()
    functions = {"fk": robot.causal("q", "T"), "inverse_dynamics": robot.causal("T", "tau")}
    gt.cgen.generate(functions, folder, name="l1")
    return folder


@pytest.fixture(scope="module")
def run(code: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A study of the loop in lock step, with the program of the first one."""
    place = tmp_path_factory.mktemp("place")
    made: list[Path] = []

    def _run(peer: str, plant: Any = None, **more: Any) -> Any:
        asked = {"seconds": SECONDS, "in_lockstep": True, "built": made[0] if made else None} | more
        s = study(units.robot(), code, smooth(), peer=peer, plant=plant, **asked)
        if not made:
            for name in ("gt_loop", "gt_loop.sha256"):
                (place / name).write_bytes(s.files[name])
            (place / "gt_loop").chmod(0o700)
            made.append(place)
        return s

    return _run


def _twin(servo: gt.loop.Servo) -> Any:
    unit = units.rigid()
    parts = math.ceil(0.004 / servo.substeps / unit.table.step)
    return lambda cycle_s: units.HeldServo(servo, parts, cycle_s)


@pytest.mark.parametrize("peer", [pytest.param("egm", marks=pytest.mark.proof), "rsi"])
def test_a_unit_of_the_drives_gives_the_log_of_the_drives(run: Any, peer: str) -> None:
    """Bit for bit: the C of a sampled block behind FMI, and NumPy, with the same C loop and datagrams."""
    built_in = run(peer)
    assert built_in.status.ok and np.max(np.ptp(rows_of(built_in.files["loop_on.log"])[:, 15:18], axis=0)) > 0.1
    for version in (3, 2):
        s = run(peer, units.drives_plant(units.drives(version)))
        assert s.status.ok and s.plant == f"unit 'drives' (FMI {version}.0)", s.message
        for log in ("loop_off.log", "loop_on.log"):
            assert s.files[log] == built_in.files[log]
        assert any("synthetic" in note and "drives" in note for note in s.notes)
        assert "plant_stopped_s" in s.values and s.values["plant_stopped_s"] is None
    title = s.figure("tracking").get_suptitle()
    assert "synthetic" in title and "drives" in title


@pytest.mark.parametrize("peer", ["egm", pytest.param("rsi", marks=pytest.mark.proof)])
def test_a_unit_of_the_robot_gives_the_log_of_its_equations(run: Any, peer: str) -> None:
    """Forces of the servo held for half a millisecond, by the unit and by CasADi; and any object may be the plant."""
    s, other = (run(peer, p, law="dynamics") for p in (units.rigid_plant(units.rigid()), _twin(gt.loop.Servo())))
    assert s.status.ok, s.message
    assert s.plant == "unit 'rigid' (FMI 3.0) under a servo"
    for log in ("loop_off.log", "loop_on.log"):
        a, b = rows_of(s.files[log]), rows_of(other.files[log])
        assert a.shape == b.shape and np.max(np.abs(a - b)[:, 15:27]) < ROUND_OFF_M
        assert np.max(np.abs(a[:, 15:18] - a[0, 15:18])) > 0.1


def test_the_same_run_gives_the_same_bytes(run: Any) -> None:
    first, again = (run("egm", units.rigid_plant(units.rigid()), law="dynamics", seconds=0.4) for _ in range(2))
    assert set(first.files) == set(again.files)
    assert all(first.files[name] == again.files[name] for name in first.files)


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_unit_without_an_answer_ends_the_run_and_keeps_it(run: Any, tmp_path: Path, lockstep: bool) -> None:
    servo = gt.loop.Servo(kd_N_s_m=UNSTABLE)
    unit = units.rigid_plant(units.rigid(), damping=UNSTABLE)
    s = run("egm", unit, in_lockstep=lockstep)
    assert s.status is SolveStatus.FAILED and len(s.runs) == 1
    # label, time, and the unit's own sentence
    assert s.message.startswith("the reference alone: 'rigid' stopped between ")
    assert "outside the range where a solution exists" in s.message
    assert 0.0 < s.plant_stopped < 0.1 and f"{s.plant_stopped:.6g}" in s.message
    rows = math.floor(s.plant_stopped / 0.004 + 1e-6) + 1
    (tmp_path / "log.csv").write_bytes(s.files["loop_off.csv"])
    log = Trajectory.from_csv(tmp_path / "log.csv")
    assert "loop_on.csv" not in s.files and len(log) > 0
    drawn = s.figure("tracking")
    assert "stopped at" in drawn.get_suptitle()
    assert any(len(line.get_xdata()) == rows for axes in drawn.axes for line in axes.get_lines())
    assert any(row.label == "the plant failed at" for row in s.rows)
    if lockstep:
        twin = run("egm", _twin(servo))
        assert twin.plant_stopped == pytest.approx(s.plant_stopped, abs=1e-9)
        assert twin.runs[0]["cart_largest_mm"] == pytest.approx(s.runs[0]["cart_largest_mm"], rel=1e-6)
        assert len(log) == rows


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_unit_that_ends_its_process_ends_the_run_and_keeps_it(run: Any, tmp_path: Path, lockstep: bool) -> None:
    """The robot falls silent, and the loop brakes until it stands; status, time and log are there."""
    (path := tmp_path / "wild.fmu").write_bytes(wild_units.wild(2))
    given = wild_units.starts(wild_units.How.EXITS, when=0.4, carts=units.start())
    s = run("egm", gt.fmu.PlantUnit(path, POSITIONS, command=COMMANDS, start=given), in_lockstep=lockstep)
    assert s.status is SolveStatus.FAILED and len(s.runs) == 1
    assert "ended its process in fmi2DoStep, with exit code 0" in s.message
    assert s.plant_stopped == pytest.approx(0.4, abs=1e-9)
    rows = rows_of(s.files["loop_off.log"])[:, 21:24]  # commands [m]
    if lockstep:  # up to the last datagram, 100 cycles after the first
        speed = np.diff(rows, axis=0) / 0.004
        assert len(rows) == 101 and np.max(np.abs(speed[-1])) > 0.1
        assert np.max(np.abs(np.diff(speed, axis=0))) / 0.004 <= s.deceleration * (1 + 1e-6)
    else:  # it goes on alone until it stands, in rows whose times depend on the machine
        assert np.max(np.abs(rows[-1] - rows[-2])) < 1e-9


def test_a_loop_in_python_keeps_what_was_measured_too() -> None:
    plant = units.rigid_plant(units.rigid(), damping=UNSTABLE)(0.004)
    done = gt.loop.lockstep(gt.loop.RobotSide("rsi", plant), lambda datagrams: [], cycles=100)
    assert "stopped between" in done.stopped and done.stopped_s is not None
    assert len(done.measured_m) == math.floor(done.stopped_s / 0.004 + 1e-6) + 1
    good = gt.loop.lockstep(
        gt.loop.RobotSide("rsi", units.drives_plant(units.drives(3))(0.004)), lambda d: [], cycles=3
    )
    assert good.stopped == "" and good.stopped_s is None


def test_a_unit_that_begins_elsewhere_is_no_hidden_jump(run: Any) -> None:
    """A hundredth of a micrometre is what two kinematics may differ by; 4 are a jump."""
    near, far = ({"T[1]": x} for x in (1e-8, 4e-6))
    assert run("egm", units.rigid_plant(units.rigid(), start=near), law="dynamics", seconds=0.1).runs
    with pytest.raises(ArgumentError, match="mm apart") as refusal:
        run("egm", units.rigid_plant(units.rigid(), start=far), law="dynamics", seconds=0.1)
    assert refusal.value.argument == "plant.start"


@pytest.mark.parametrize(
    ("plant", "law", "argument"),
    [
        (lambda: units.drives_plant(units.drives(3)), "dynamics", "plant.stiffness"),
        (lambda: units.drives_plant(units.drives(3)), "lead_through", "plant"),
        (
            lambda: gt.fmu.PlantUnit(units.drives(3), POSITIONS[:2], command=COMMANDS[:2]),
            "trajectory",
            "plant.position",
        ),
        (lambda: gt.fmu.PlantUnit("no.fmu", POSITIONS, command=COMMANDS), "trajectory", "plant.file"),
        (lambda: units.drives_plant(units.drives(3), start={"T": 0.0}), "trajectory", "plant.start"),
    ],
)
def test_a_plant_that_does_not_fit_is_refused_by_its_key(run: Any, plant: Any, law: str, argument: str) -> None:
    with pytest.raises(ArgumentError) as refusal:
        run("egm", plant(), law=law, lead_through=None if law != "lead_through" else _guiding())
    assert refusal.value.argument == argument and "\n" not in refusal.value.message


def _guiding() -> gt.loop.Guiding:
    return gt.loop.Guiding(tool=gt.loop.SensorNumbers(mass=0.8), handle=gt.loop.SensorNumbers(mass=0.4))


def test_the_servo_inside_of_a_unit_is_what_the_law_knows(run: Any) -> None:
    """The stiffness of a unit that takes positions is what the law divides the model's forces by."""
    runs = [
        run("egm", units.drives_plant(units.drives(3), stiffness=k, damping=0.0), law="dynamics", seconds=0.1)
        for k in (2e4, 4e4)
    ]
    offs = []
    for s in runs:
        on, off = (rows_of(s.files[f"loop_{n}.log"])[:, 21:24] for n in ("on", "off"))
        offs.append((on - off)[5])
    assert np.max(np.abs(offs[1])) > 1e-4
    assert offs[0] == pytest.approx(2 * offs[1], rel=1e-9)  # force over stiffness
