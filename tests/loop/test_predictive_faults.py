"""What a network, a robot, a person or the model may do to the law "predictive": no divergence, exact counters, and a
stop where it cannot go on."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from gtmodel.cgen import generate
from gtmodel.loop import (
    LoopProcess,
    Servo,
    build,
    egm,
    expected_counters,
    real_time,
)
from gtmodel.loop.process import COUNTERS, STATES
from gtmodel.predictive import AxisServo
from gtmodel.results import ArgumentError, Status
from tests.loop.replanning import (
    CAP,
    CYCLES,
    FORCE,
    GOAL,
    HOLD,
    KD,
    KP,
    MASS,
    REACH,
    Replanning,
    Ride,
    Spoil,
    changed,
    controller,
    go,
)

AT = 18  # cycle of a fault: the carts move at about 0.9 m/s
STOPPED = 148  # cycles in which every stop has ended and the servo rests
PATIENCE = 10  # of the controller
NEAR_M = 1e-4  # of the goal, at the end
# of a cart: it never leaves the way to its goal by more; a cart that is lost at 1 m/s brakes within 0.12 m
AROUND_M = 0.15
WRAP = 1 << 32
NAN, INFINITE = float("nan"), float("inf")


def dropped(*cycles: int) -> Spoil:
    return lambda cycle, data: [] if cycle in cycles else [data]


def held_back(cycle: int, data: bytes) -> list[bytes]:
    """One datagram arrives after the next one."""
    kept.append(data)
    return [] if cycle == AT else [data, kept[AT]] if cycle == AT + 1 else [data]


kept: list[bytes] = []  # datagrams of a run


def late_for_good(cycle: int, data: bytes) -> list[bytes]:
    """Every datagram arrives a cycle late."""
    kept.append(data)
    return [] if cycle == 0 else [kept[cycle - 1]]


def replayed(cycle: int, data: bytes) -> list[bytes]:
    """Old datagrams arrive again, all at once."""
    kept.append(data)
    return [*kept[:AT], data] if cycle == AT else [data]


def edited(cycles: range, change: Callable[[egm.EgmRobot], None]) -> Spoil:
    def spoil(cycle: int, data: bytes) -> list[bytes]:
        robot = egm.decode_robot(data)
        if cycle in cycles:
            change(robot)
        return [egm.encode_robot(robot)]

    return spoil


def added(**values: int) -> Callable[[egm.EgmRobot], None]:
    def change(robot: egm.EgmRobot) -> None:
        for name, value in values.items():
            setattr(robot, name, getattr(robot, name) + value)

    return change


def frozen(robot: egm.EgmRobot) -> None:
    robot.feedback.external_mm = [0.0, 0.0, 0.0]


def motors_off(robot: egm.EgmRobot) -> None:
    robot.motor_state = egm.MOTORS_OFF


def goals(*changes: tuple[int, Any]) -> np.ndarray:
    """A row for each cycle; from a cycle on another goal."""
    rows = np.tile(GOAL, (CYCLES, 1))
    for cycle, goal in changes:
        rows[cycle:] = goal
    return rows


def once(at: range, goal: Any) -> np.ndarray:
    rows = goals()
    rows[at.start : at.stop] = goal
    return rows


FAR, MIDDLE = range(AT, 10**6), range(AT, AT + 1)


@dataclass(frozen=True)
class Fault:
    """One row: what happens, and what must follow. lost, refused, skipped: counters of the plan at the end."""

    name: str
    spoil: Spoil | None = None
    robot: dict[str, Any] = field(default_factory=dict)
    goals: np.ndarray = field(default_factory=goals)
    late: int = 0
    state: str = "running"
    status: Status = Status.OK
    lost: int = 0
    refused: int = 0
    skipped: int = 0
    others: dict[str, int] = field(default_factory=dict)  # further entries of the report
    target: np.ndarray | None = field(default_factory=lambda: GOAL)  # reached at the end; None: not
    cycles: int = CYCLES

    @property
    def length(self) -> int:
        """Cycles until all that must follow has followed."""
        return STOPPED if self.state == STOP else self.cycles


STOP, STALE, RANGE, INFINITY = "stopped", Status.STALE_INPUT, Status.OUT_OF_RANGE, Status.NOT_FINITE
FAULTS = [
    Fault("nothing"),
    Fault("one datagram lost", dropped(AT), lost=1),
    Fault("two datagrams lost", dropped(AT, AT + 1), lost=2),
    Fault("as many lost as may be", dropped(*range(AT, AT + HOLD)), lost=HOLD),
    Fault("one more lost", dropped(*range(AT, AT + HOLD + 1)), state=STOP, status=STALE, lost=HOLD, target=None),
    Fault("every third datagram lost", dropped(*range(3, CYCLES, 3)), lost=len(range(3, CYCLES, 3))),
    Fault("the robot falls silent", dropped(*range(AT, CYCLES)), state=STOP, status=STALE, lost=HOLD, target=None),
    Fault("each datagram twice", lambda cycle, data: [data, data]),
    Fault("a datagram behind the next one", held_back, lost=1),
    Fault("all datagrams a cycle late", late_for_good),
    Fault("old datagrams again", replayed),
    Fault("answers a cycle late", late=1),
    Fault("answers three cycles late", late=3, cycles=260),
    Fault("garbage beside", lambda cycle, data: [b"\xff\x00", data, data[:5]] if cycle == AT else [data]),
    Fault("a truncated datagram", lambda cycle, data: [data[:20]] if cycle == AT else [data], lost=1),
    Fault("a reading NaN", changed(MIDDLE, lambda q: q * NAN), lost=1),
    Fault("readings infinite", changed(range(AT, AT + HOLD), lambda q: q + INFINITE), lost=HOLD),
    Fault("readings NaN for good", changed(FAR, lambda q: q * NAN), state=STOP, status=STALE, lost=HOLD, target=None),
    Fault("a reading that jumps", changed(MIDDLE, lambda q: q + np.array([0.1, 0.0, 0.0])), lost=1),
    Fault("readings that jump within patience", changed(range(AT, AT + PATIENCE), lambda q: q + 0.1), lost=PATIENCE),
    Fault("readings that jump for good", changed(FAR, lambda q: q + 0.1), state=STOP, status=STALE,
          lost=PATIENCE + 1, target=None),
    Fault("an absurd reading", changed(MIDDLE, lambda q: q + 5.0), state=STOP, status=RANGE,
          others={"following_faults": 1}, target=None),
    Fault("encoders that stand still", edited(FAR, frozen), state=STOP, status=STALE, lost=PATIENCE + 1, target=None),
    Fault("numbers leap", edited(FAR, added(sequence=100, time_ms=400)), state=STOP, status=STALE, target=None),
    Fault("numbers leap by three", edited(FAR, added(sequence=3, time_ms=12)), lost=3, skipped=3),
    Fault("the clock stands for a cycle", edited(MIDDLE, added(time_ms=-4)), lost=1, others={"clock_faults": 1}),
    Fault("the clock goes wrong", edited(FAR, added(time_ms=400)), state=STOP, status=STALE,
          others={"clock_faults": 1}, target=None),
    Fault("numbers and clock run over", robot={"first_number": WRAP - AT, "first_ms": WRAP - 100}),
    Fault("the robot stops running", robot={"ends": AT}, state=STOP, status=STALE, target=None),
    Fault("the motors go off", edited(FAR, motors_off), state=STOP, status=STALE, target=None),
    Fault("a goal NaN", goals=once(range(AT, AT + 1), NAN), refused=1),
    Fault("a goal infinite", goals=once(range(AT, AT + HOLD), INFINITE), refused=HOLD),
    Fault("a goal NaN for good", goals=goals((AT, NAN)), state=STOP, status=INFINITY, refused=HOLD + 1, target=None),
    Fault("a goal NaN from the start", goals=goals((0, NAN)), state=STOP, status=INFINITY, refused=1, target=None),
    Fault("a goal beyond the limits", goals=goals((AT, [0.2, -0.1, 0.9])), target=np.array([0.2, -0.1, REACH])),
    Fault("a goal that moves", goals=goals((AT, -GOAL)), target=-GOAL),
    Fault("a start beyond the limits", robot={"start": [REACH + 0.05, 0.0, 0.0]}),
    Fault("a fifth heavier", robot={"mass": 1.2 * MASS, "noise": 1e-5, "seed": 1}),
    Fault("half as heavy", robot={"mass": 0.5 * MASS}),
    Fault("half of the motors' force", robot={"limits": [(0.004 * AT, FORCE / 2)]}),
    Fault("half of the force, unknown and heavier", robot={"limits": [(0.0, FORCE / 2)], "mass": 1.2 * MASS},
          cycles=260),
    Fault("a force that drifts", robot={"drift": 0.001}),  # 40 N/s
    Fault("two further cycles of delay", robot={"delay": 4}),
    Fault("a softer servo", robot={"servo": Servo(0.7 * KP, 0.7 * KD)}),
]  # fmt: skip


@pytest.fixture(scope="module")
def bench(compiler: str, tmp_path_factory: pytest.TempPathFactory) -> Replanning:
    place, law = tmp_path_factory.mktemp("replanning"), controller()
    generate({"law": law}, place / "generated", name="carts")
    return Replanning(law, build(place / "generated", place / "loop", 3), place / "loop")


def _ran(bench: Replanning, fault: Fault) -> tuple[Ride, list[list[int | None]]]:
    """The run of a row, and the numbers that arrived in each cycle, None for garbage."""
    history = list[list[int | None]]()
    kept.clear()

    def spoil(cycle: int, data: bytes) -> list[bytes]:
        arrived = [data] if fault.spoil is None else fault.spoil(cycle, data)
        history.append([cycle] if fault.spoil is None else [_number(one) for one in arrived])
        return arrived

    return bench.ride(bench.robot(**fault.robot), fault.goals, fault.length, spoil, fault.late), history


def _number(data: bytes) -> int | None:
    """Number of a datagram with three finite positions."""
    try:
        robot = egm.decode_robot(data)
    except egm.WireError:
        return None
    usable = len(robot.feedback.external_mm) == 3 and np.all(np.isfinite(robot.feedback.external_mm))
    return (robot.sequence + AT) % WRAP if usable else None  # a counter that runs over is unwrapped here


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name.replace(" ", "-"))
def test_a_fault_ends_as_the_table_says(bench: Replanning, fault: Fault) -> None:
    ride, history = _ran(bench, fault)
    report = ride.report
    counted = {name: report[name] for name in COUNTERS}
    assert counted == expected_counters(history)
    of_the_plan = {name: report[f"plan_{name}"] for name in ("lost", "refused", "skipped")}
    assert of_the_plan == {name: getattr(fault, name) for name in of_the_plan}
    unsolved = (ride["iterations"] == CAP) & (ride["kkt_residual"] > bench.law.program.qp.tolerance)
    assert report["plan_failed"] == np.count_nonzero(unsolved & (ride["state"] == STATES.index("running")))
    assert {name: report[name] for name in fault.others} == fault.others
    assert (STATES[report["state"]], Status(report["status"])) == (fault.state, fault.status)
    _is_safe(ride, fault)
    if fault.target is not None:
        assert np.abs(ride.measured[-1] - fault.target).max() < NEAR_M


def _is_safe(ride: Ride, fault: Fault) -> None:
    """Numbers are finite, planned forces within their limits exactly, the carts stay near their way, and stop."""
    rows = np.column_stack([ride.axes("command"), ride.axes("speed"), ride.axes("predicted"), ride.axes("force")])
    assert np.all(np.isfinite(rows))
    assert np.abs(ride.axes("force")).max() <= FORCE
    start = np.array(fault.robot.get("start", np.zeros(3)))
    ends = np.vstack([start, GOAL, GOAL if fault.target is None else fault.target])
    assert np.all(ride.measured > ends.min(axis=0) - AROUND_M)
    assert np.all(ride.measured < ends.max(axis=0) + AROUND_M)
    assert np.abs(np.diff(ride.axes("command"), axis=0)).max() <= 0.05
    if fault.state == STOP:
        assert not np.any(ride.axes("speed")[-1])
        assert np.abs(np.diff(ride.measured[-5:], axis=0)).max() < 1e-5


@pytest.mark.parametrize(
    ("protocol", "name"),
    [("egm", "a fifth heavier"), ("egm", "one more lost"), ("egm", "a goal NaN"), ("rsi", "two datagrams lost"),
     ("rsi", "garbage beside"), ("egm", "numbers leap by three")],
)  # fmt: skip
def test_the_log_equals_that_of_the_loop_in_python(bench: Replanning, protocol: str, name: str) -> None:
    fault = next(f for f in FAULTS if f.name == name)
    rides = [
        run(bench.robot(protocol, **fault.robot), fault.goals, AT + 9, fault.spoil) for run in (bench.ride, bench.twin)
    ]
    assert rides[0].log == rides[1].log
    assert np.array_equal(rides[0].measured, rides[1].measured)


@pytest.mark.parametrize("lost", [0, 1, 2, HOLD])
def test_rsi_goes_on_with_its_plan(bench: Replanning, lost: int) -> None:
    """RSI answers datagrams only: the robot holds its last correction meanwhile."""
    ride = bench.ride(bench.robot("rsi"), goals(), spoil=dropped(*range(AT, AT + lost)))
    assert (ride.report["late"], ride.report["plan_lost"]) == (lost, lost)
    assert STATES[ride.report["state"]] == "running"
    assert np.abs(ride.measured[-1] - GOAL).max() < NEAR_M
    assert np.abs(ride.axes("force")).max() <= FORCE


@pytest.mark.parametrize(
    ("peer", "rate", "cycles"),
    [
        ("egm", 22.0, 125),
        *[pytest.param(*of, marks=pytest.mark.proof) for of in (("egm", 200.0, 150), ("rsi", 500.0, 200))],
    ],
)
def test_servos_of_any_bandwidth_are_taken(bench: Replanning, peer: str, rate: float, cycles: int) -> None:
    """By the twin of the law in Python; the carts are a fifth heavier than the controller and its servo know."""
    kp, kd = rate**2 * MASS, 1.2 * rate * MASS
    law = controller(servo=AxisServo(kp, kd))
    robot = bench.robot(peer, servo=Servo(kp, kd, 32), mass=1.2 * MASS, noise=1e-5, seed=1)
    ride = bench.twin(robot, np.tile(GOAL, (cycles, 1)), cycles, law=law)
    assert STATES[int(ride["state"][-1])] == "running"
    assert np.abs(ride.measured[-1] - GOAL).max() < NEAR_M
    assert law.radius() < 1


@pytest.mark.parametrize(("peer", "rate"), [("egm", 80.0), ("rsi", 52.0)])
def test_the_spectral_radius_is_that_of_the_growth_under_another_servo(
    bench: Replanning, peer: str, rate: float
) -> None:
    """The controller knows a servo of 32 rad/s, and the carts have a stiffer one."""
    kp, kd = rate**2 * MASS, 1.2 * rate * MASS
    ride = bench.ride(bench.robot(peer, servo=Servo(kp, kd, 32)), np.tile(1e-4 * np.ones(3), (CYCLES, 1)), 100)
    missed = np.abs(ride.axes("measured") - ride.axes("predicted")).max(axis=1)
    early, late = missed[30:50].max(), missed[80:100].max()
    radius = bench.law.radius(AxisServo(kp, kd), speeds=peer == "egm")
    assert (late / early) ** (1 / 50) == pytest.approx(radius, abs=0.01)
    assert radius > 0.99 > bench.law.radius()


def test_a_controller_without_a_servo_is_none_for_the_loop(bench: Replanning) -> None:
    with pytest.raises(ArgumentError) as caught:
        bench.python_loop("egm", goals(), controller(servo=None))
    assert caught.value.argument == "controller"


def test_a_solver_that_stops_is_followed_by_the_plan_and_then_by_the_stop(bench: Replanning) -> None:
    loop, robot = bench.python_loop("egm", goals()), bench.robot()
    go(robot, loop.exchange, AT)
    loop.law._twin.method.max_iterations = 0  # type: ignore[attr-defined]
    measured = go(robot, loop.exchange, 130)
    ride = Ride(bytes(loop.log), measured, robot.plant)  # type: ignore[arg-type]
    states = [STATES[int(k)] for k in ride["state"]]
    assert states[: AT + PATIENCE] == ["running"] * (AT + PATIENCE)
    assert states[AT + PATIENCE] == "ramping" and states[-1] == STOP
    assert ride["plan_failed"][-1] == PATIENCE + 1
    assert Status(int(ride["status"][AT + PATIENCE])) is Status.NOT_CONVERGED
    _is_safe(ride, Fault("", state=STOP, target=None))


def test_a_solver_that_never_finds_a_solution_never_moves(bench: Replanning) -> None:
    ride = bench.twin(bench.robot(), goals(), 10, law=controller(2))
    assert STATES[int(ride["state"][-1])] == STOP and ride["plan_failed"][-1] == 1
    assert not np.any(ride.axes("speed")) and not np.any(ride.axes("command"))


def test_a_program_that_is_suspended_skips_cycles_or_stops(bench: Replanning) -> None:
    """In real time over UDP: the loop is stopped by a signal for some cycles while the robot goes on."""
    options = bench.options("egm", goals())
    with LoopProcess(bench.program, options) as process:
        robot, halted = bench.robot(), list[float]()

        def suspended(share: float) -> bool:
            if share >= 0.3 and not halted:
                os.kill(process._process.pid, signal.SIGSTOP)
                halted.append(time.monotonic())
            if halted and time.monotonic() - halted[0] > 0.016:
                os.kill(process._process.pid, signal.SIGCONT)
            return False

        real_time(robot, process, CYCLES, suspended)
        report = process.finish()
    ride = Ride((bench.place / "loop.log").read_bytes(), np.zeros((0, 3)), robot.plant, report)  # type: ignore[arg-type]
    assert np.abs(ride.axes("force")).max() <= FORCE
    assert np.abs(np.diff(ride.axes("command"), axis=0)).max() <= 0.05
    assert STATES[int(ride["state"][-1])] == STOP and not np.any(ride.axes("speed")[-1])
    assert report["plan_skipped"] + report["lost"] + report["late"] > 0
