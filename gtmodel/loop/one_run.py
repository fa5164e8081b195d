"""One run of the C loop against a simulated controller: its bench, plant, command line and log."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol, Self, TypeVar

import numpy as np

from ..compiler.causal import CausalFunction, compile_causal
from ..lang import Model
from ..results import Status, Trajectory, Work
from ..results.refusal import naming
from ..robots import actuator_closed_loop
from .disturbed import Disturbances
from .exchange import CYCLE_MS
from .laws import ReferenceTable
from .plant import DrivePlant, ElasticPlant, Plant, PlantSource, PlantStopped, RigidBodyPlant, Servo
from .process import STATES, LoopError, LoopProcess
from .robot_side import RobotSide
from .run import LoopRun, lockstep, real_time

Peer = Literal["egm", "rsi"]
Reference = Trajectory | Callable[[], Trajectory]
# labels of the first and the second run of a law
LAWS = {
    "trajectory": ("the reference alone", "with feedforward"),
    "dynamics": ("the reference alone", "with inverse-dynamics feedforward"),
    "replay": ("the reference alone", "with a learned table"),
    "path": ("the programme alone", "with path correction"),
    "predictive": ("computed torque", "an optimum in every cycle"),
}
WITH_SERVO = ("dynamics", "predictive")  # laws for a robot whose servo is known
LONGEST_S = 3600.0
# frequency range and damping of an arm on springs; no values of the prototype are published
ELASTIC_HZ, ELASTIC_DAMPING = (0.5, 1000.0), 0.05
# path correction integrates, which is slow compared with a time-optimal motion
SLOWER = {"path": 10.0, "predictive": 1.2}
# default of the C program
HOLD_CYCLES = 5
# distance of a cart from its last command: a slow drive under its inverse lags further than a real robot would allow
FOLLOWING_M = 0.25


@dataclass(frozen=True)
class Stop:
    """Stop of a cart when the robot is lost at the reference's greatest speed: hold the speed, then brake."""

    speed_m_s: float
    deceleration_m_s2: float

    @classmethod
    def of(cls, reference: np.ndarray, deceleration: float | None) -> Self:
        """Take the greatest speed from the rows of a reference, and its greatest deceleration if None."""
        n = (reference.shape[1] - 9) // 3
        speeds, accelerations = np.abs(reference[:, n : 2 * n]), np.abs(reference[:, 2 * n : 3 * n])
        # if the carts rest, any deceleration will do
        return cls(float(np.max(speeds)), deceleration or float(np.max(accelerations)) or 1.0)

    @property
    def distance_m(self) -> float:
        """Distance of the held cycles at full speed and a ramp in whole cycles."""
        step = 1e-3 * CYCLE_MS
        ramp = math.ceil(self.speed_m_s / (self.deceleration_m_s2 * step))
        return self.speed_m_s * step * (HOLD_CYCLES + max(0, ramp - 1) / 2)


@dataclass(frozen=True)
class Bench:
    """Data that both runs share; the reference has a row per cycle, see `there_and_back`.

    program: the loop, built in `place`, the working folder that only this user can write. elastic_Hz: frequency of an
    arm on springs; None: rigid. plant: source of the plant of a run; None: the law chooses. servo: the servo as the law
    dynamics knows it. following_m: largest distance of a cart from its last command [m].
    disturbances: of the plant. goals: of the law predictive, every 4 ms.
    """

    peer: Peer
    law: str
    robot: Model
    forward: CausalFunction
    program: Path
    place: Path
    reference: ReferenceTable
    cycles: int
    in_lockstep: bool
    elastic_Hz: float | None
    stop: Stop
    work: Work
    plant: PlantSource | None = None
    servo: Servo = field(default_factory=Servo)
    following_m: float = FOLLOWING_M
    disturbances: Disturbances = field(default_factory=Disturbances)
    goals: ReferenceTable | None = None

    @property
    def axes(self) -> int:
        """Number of carts or joints."""
        return self.forward.inputs[0].shape[0]

    @property
    def joints(self) -> bool:
        """Whether the axes are joints [rad], not carts [m]."""
        return turns(self.forward)

    @property
    def carts_m(self) -> np.ndarray:
        """Reference of the carts (cycles, n) [m], or joints [rad]."""
        return self.reference.rows[: self.cycles, : self.axes]

    @property
    def tcp_m(self) -> np.ndarray:
        """Reference of the tool centre point (cycles, 3) [m]."""
        return self.reference.rows[: self.cycles, 3 * self.axes : 3 * self.axes + 3]


# the simulated controller shares the machine with other work: if it was silent for longer than the loop may hold, the
# run tells nothing about the loop and is repeated
ATTEMPTS = 5
STEP_LIMIT_M = 0.1
REACH_LIMIT_M = 1.0  # beyond the reference: the inverse of a slow drive commands far more than the cart moves
LEARNING, LEARNING_RUNS = 0.9, 30  # gain of Dressler 2012, section 7.3; simulated repetitions
PATH_GAIN_PER_S, PATH_LIMIT_M = 2.0, 0.03  # slow compared with drives of 1.1 Hz with five samples of delay
# at the end of a real-time run the loop waits for the next datagram
GOING = (STATES.index("running"), STATES.index("holding"))


R = TypeVar("R")


class Running(Protocol):
    """The part of a bench that a repeatable run needs."""

    @property
    def peer(self) -> str: ...
    @property
    def in_lockstep(self) -> bool: ...
    @property
    def work(self) -> Work: ...
    @property
    def program(self) -> Path: ...
    @property
    def cycles(self) -> int: ...


@dataclass(frozen=True)
class OneRun:
    """One run: log, report and printed text of the loop; measured carts and tool centre point (cycles, 3) [m].

    forces_N: what the servo asked for, (substeps of all cycles, n); empty without a servo. stopped, stopped_s: why and
    when [s] the plant failed on the way; the arrays end there.
    """

    label: str
    log: bytes
    report: dict[str, Any]
    printed: str
    carts_m: np.ndarray
    tcp_m: np.ndarray
    forces_N: np.ndarray
    stopped: str = ""
    stopped_s: float | None = None

    @property
    def going(self) -> bool:
        """Whether the loop was running at the end."""
        return self.report["state"] in GOING


def run_of(bench: Bench, label: str, *, active: bool) -> OneRun:
    """Make one run; see `again`."""
    return again(bench, label, partial(_once, bench, label, active=active))


def again(bench: Running, label: str, once: Callable[[], tuple[R, bool, float]]) -> R:
    """Return the run of `once`; repeat it if the simulated controller was silent for longer than the loop may hold.

    once: returns the run, whether it ended as expected, and its longest gap [s]. Raises LoopError.
    """
    for attempt in range(ATTEMPTS):
        one, expected, gap_s = once()
        valid = expected or gap_s < 1e-3 * CYCLE_MS * HOLD_CYCLES
        if valid or bench.in_lockstep or bench.work.interrupted() or attempt == ATTEMPTS - 1:
            return one
        bench.work.progress(f"{bench.peer}: {label}: simulated controller {1e3 * gap_s:.0f} ms late, repeating the run")
    raise LoopError(label)


def driven(bench: Running, robot: RobotSide, options: Sequence[str]) -> tuple[LoopRun, dict[str, Any], str]:
    """Run the program with a simulated controller; return the run, the loop's report and its printed text."""
    # in real time late cycles add to the count, so the loop ends on request instead
    limited = ["--cycles", str(bench.cycles)] if bench.in_lockstep else []

    def stopped(share: float) -> bool:
        return bench.work.interrupted()

    with LoopProcess(bench.program, [*options, *limited]) as process:
        if bench.in_lockstep:
            done = lockstep(robot, process.exchange, bench.cycles, stopped=stopped)
            process.end()
        else:
            done = real_time(robot, process, bench.cycles, stopped)
        return done, process.finish(), process.printed


def _once(bench: Bench, label: str, *, active: bool) -> tuple[OneRun, bool, float]:
    plant, programme = _plant(bench), None
    with naming("disturbances."):
        disturbed = bench.disturbances.around(plant, bench.servo, 1e-3 * CYCLE_MS)
    if bench.disturbances != Disturbances() or bench.law == "predictive":
        plant = disturbed
    if bench.elastic_Hz is not None:
        plant = ElasticPlant(plant, bench.elastic_Hz, ELASTIC_DAMPING, 1e-3 * CYCLE_MS)
    if bench.law == "path":
        programme = _programme(bench)
    robot = RobotSide(bench.peer, plant, cycle_ms=CYCLE_MS, programme=programme, joints=bench.joints)
    log = bench.place / ("loop_on.log" if active else "loop_off.log")
    log.unlink(missing_ok=True)  # of an earlier attempt
    options = [*_options(bench, active), "--deceleration", repr(bench.stop.deceleration_m_s2), "--log", str(log)]
    done, report, printed = driven(bench, robot, options)
    carts, tcp, why, when = _until(done, *bench.forward(done.arm_m))
    forces = np.concatenate([np.zeros((0, bench.axes)), *disturbed.forces_N])
    one = OneRun(label, log.read_bytes(), report, printed, carts, tcp, forces, why, when)
    return one, one.going or bool(why), done.longest_gap_s


def _until(done: LoopRun, tcp: np.ndarray, status: np.ndarray) -> tuple[np.ndarray, np.ndarray, str, float | None]:
    """Return carts and tool centre point until the robot leaves its workspace or stops, and why and when.

    Raises LoopError."""
    outside = np.flatnonzero(status != Status.OK)
    if not len(outside):
        return done.measured_m, tcp, done.stopped, done.stopped_s
    n, when = int(outside[0]), 1e-3 * CYCLE_MS * float(outside[0])
    why = f"the simulated robot left the workspace of its model at {when:g} s"
    if n == 0:
        raise LoopError(why)
    return done.measured_m[:n], tcp[:n], why, when


def plant_at_start(plant: PlantSource) -> Plant:
    """Return a plant at its start, with the cycle of the loop. Raises ArgumentError about `plant`."""
    with naming("plant."):
        return plant(CYCLE_MS / 1000.0)


def _plant(bench: Bench) -> Plant:
    if bench.plant is not None:
        return plant_at_start(bench.plant)
    start = bench.carts_m[0]
    if bench.law in WITH_SERVO and bench.joints:
        forward = compile_causal(bench.robot, known="tau", targets="der(q,2)", prefer="q")
        return RigidBodyPlant(forward, None, start.tolist(), bench.servo, CYCLE_MS / 1000.0)
    if bench.law in WITH_SERVO:
        forward = compile_causal(bench.robot, known="tau", targets="der(T,2)", prefer="T")
        velocity = compile_causal(bench.robot, known="T", targets=["q", "der(q)"])
        return RigidBodyPlant(forward, velocity, bench.tcp_m[0].tolist(), bench.servo, CYCLE_MS / 1000.0)
    drives = drives_of(bench.axes)
    return DrivePlant(start.tolist(), drives["a"], drives["b"], drives["delay"])


def turns(forward: CausalFunction) -> bool:
    """Return whether the axes of a robot are joints that turn, by the unit of q."""
    return forward.inputs[0].unit == "rad"


def drives_of(axes: int) -> dict[str, Any]:
    """Return the drives of eq. (6.11), those of three carts, repeated for more axes."""
    drives = actuator_closed_loop()
    return drives | {name: np.resize(drives[name], axes).tolist() for name in "ab"}


def lag_of(axes: int) -> float:
    """Return how long the slowest of these drives is behind its command at constant speed [s]."""
    drives = drives_of(axes)
    return 1e-3 * CYCLE_MS * float(drives["delay"] + max(a / (1 - a) for a in drives["a"]))


JOINT_RATE = 150.0  # rad/s: natural frequency of the servo of each joint, with the others held
JOINT_DAMPING = 1.0  # of the servo


def joint_servo(robot: Model, q: np.ndarray) -> Servo:
    """Return a servo of the joints, by the diagonal of the mass matrix at q (n,) [rad]."""
    n = len(q)
    inverse = compile_causal(robot, known="q", targets="tau")
    rows = np.vstack([np.zeros(n), np.eye(n)])
    tau, status = inverse(np.tile(q, (n + 1, 1)), np.zeros((n + 1, n)), rows)
    if np.any(status != Status.OK):
        raise LoopError("the torques at the start of the reference cannot be computed")
    inertia = np.diag(tau[1:] - tau[0])
    return Servo(tuple((JOINT_RATE**2 * inertia).tolist()), tuple((2 * JOINT_DAMPING * JOINT_RATE * inertia).tolist()))


def _options(bench: Bench, active: bool) -> list[str]:
    """Return the loop's command-line options."""
    drives, servo = drives_of(bench.axes), bench.servo
    lowest = bench.carts_m.min(axis=0) - REACH_LIMIT_M
    highest = bench.carts_m.max(axis=0) + REACH_LIMIT_M
    table = str(bench.place / "reference.table")
    law = bench.law if active or bench.law in ("dynamics", "path") else "trajectory"
    law = "dynamics" if bench.law == "predictive" and not active else law
    if law == "predictive":
        assert bench.goals is not None
        table = str(bench.place / "goals.table")
        Path(table).write_bytes(bench.goals.to_bytes())
    # a position sent without a speed is held for a cycle: half a cycle of lead centres it
    lead_ms = (0 if bench.peer == "egm" else CYCLE_MS // 2) + CYCLE_MS * bench.disturbances.delay
    options = {
        "--peer": bench.peer,
        "--law": law,
        "--feedforward": "on" if active or bench.law == "predictive" else "off",
        "--reference": table,
        "--cycle-ms": str(CYCLE_MS),
        "--hold": str(HOLD_CYCLES),
        "--idle-ms": "5000",
        "--lowest": _text(lowest),
        "--highest": _text(highest),
        "--step": repr(STEP_LIMIT_M),
        "--following": repr(bench.following_m),
        "--path-limit": repr(PATH_LIMIT_M),
        "--delay-ms": str(CYCLE_MS * drives["delay"]),
        "--a": _text(drives["a"]),
        "--b": _text(drives["b"]),
        "--kp": _text(np.broadcast_to(servo.kp_N_m, bench.axes)),
        "--kd": _text(np.broadcast_to(servo.kd_N_s_m, bench.axes)),
        "--lead-ms": str(lead_ms),
        "--gain": repr(PATH_GAIN_PER_S if active else 0.0),
    }
    if law == "replay":
        path = bench.place / "corrections.table"
        path.write_bytes(_learned(bench).to_bytes())
        options["--corrections"] = str(path)
    words = [word for pair in options.items() for word in pair]
    return [*words, "--live", *(["--lockstep"] if bench.in_lockstep else [])]


def _text(values: Sequence[float] | np.ndarray) -> str:
    return ",".join(repr(float(x)) for x in values)


def _learned(bench: Bench) -> ReferenceTable:
    """Learn corrections from repeated simulated runs of the drives: u + 0.9 e(k + 5) (Dressler 2012, section 7.3)."""
    reference, delay = bench.carts_m, actuator_closed_loop()["delay"]
    # speeds that the law sends; RSI has none
    speeds = bench.reference.rows[: bench.cycles, bench.axes : 2 * bench.axes] * float(bench.peer == "egm")
    correction = np.zeros_like(reference)
    for _ in range(LEARNING_RUNS):
        plant, measured = _plant(bench), np.zeros_like(reference)
        for k, command in enumerate(reference + correction):
            measured[k] = plant.position_m
            try:
                plant.step(command.tolist(), speeds[k].tolist())
            except PlantStopped as error:
                raise LoopError(f"while learning from repeated runs: {error}") from error
        error = reference - measured
        correction += LEARNING * np.vstack([error[delay:], np.repeat(error[-1:], delay, axis=0)])
    return ReferenceTable(correction, CYCLE_MS)


def _programme(bench: Bench) -> Callable[[int, Sequence[float]], Sequence[float]]:
    """Return the robot's own motion: the reference, with its tool centre point shifted by the path correction."""
    inverse = compile_causal(bench.robot, known="T", targets="q")

    def carts(cycle: int, path_m: Sequence[float]) -> Sequence[float]:
        q, status = inverse(bench.tcp_m[cycle] + np.array(path_m))
        if status is not Status.OK:
            raise LoopError(
                f"the path corrected by {1e3 * np.array(path_m).round(4)} mm leaves the workspace in cycle {cycle}"
            )
        return q.tolist()

    return carts
