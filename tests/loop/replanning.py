"""Three carts on rails under a predictive controller: its model, the loop in C and in Python, and a synthetic robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import gtmodel as gt
from gtmodel.loop import (
    DisturbedPlant,
    Exchange,
    LoopLimits,
    LoopProcess,
    PredictiveLaw,
    PythonLoop,
    ReferenceTable,
    RobotSide,
    Servo,
    Settings,
    egm,
)
from gtmodel.loop.process import COLUMNS, rows_of
from gtmodel.predictive import AxisServo, ControlHorizon, Controller, Measurement

MASS, LOAD, FORCE = 40.0, np.array([80.0, -50.0, 60.0]), 700.0
REACH, SPEED = 0.5, 1.0  # soft limits of positions [m] and speeds [m/s]
HOLD, DECELERATION = 5, 5.0
KP, KD = 40_000.0, 1_500.0
SERVO = AxisServo(KP, KD)
GOAL = np.array([0.2, -0.1, 0.15])
CAP = 60  # iterations in a cycle: a soft limit that is crossed takes about 35 from a cold start
CYCLES = 150  # 0.6 s


class Carts(gt.Model):
    m = gt.parameter(MASS, unit="kg")
    q = gt.variable(3, unit="m")
    tau = gt.input(3, unit="N", min=-FORCE, max=FORCE)

    def equations(self) -> Any:
        for k in range(3):
            yield self.m * gt.der(self.q[k], 2) == self.tau[k] - float(LOAD[k])


def controller(max_iterations: int = CAP, servo: AxisServo | None = SERVO, **keys: Any) -> Controller:
    horizon = ControlHorizon(period=0.004, stages=12, length=0.02, delay=2, max_iterations=max_iterations, **keys)
    return gt.predictive.controller(
        Carts(),
        horizon,
        tolerances={"q": 0.001, "der(q)": 0.5, "tau": 200.0},
        targets={"q": np.zeros(3)},
        references=["q"],
        limits={"der(q)": (-SPEED, SPEED), "q": (-REACH, REACH)},
        prices={"q": (1e6, 1e6)},  # beyond what a goal behind the limit is worth
        measured={"q": Measurement(deviation=1e-5, jump=0.02)},
        disturbance={"tau": 100.0},
        servo=servo,
    )


class CartPlant:
    """The carts under their servo, mass by mass; exact for the forces of a substep."""

    def __init__(self, start: Sequence[float], mass: float = MASS, servo: Servo | None = None) -> None:
        self.position_m, self.speed, self.mass = np.array(start, float), np.zeros(3), mass
        self.servo, self.limit_N, self.force_N = servo or Servo(KP, KD, 4), np.inf, np.zeros((0, 3))

    @property
    def arm_m(self) -> np.ndarray:
        return self.position_m

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None:
        u, du, h, forces = np.array(position_m), np.array(speed_m_s), 0.004 / self.servo.substeps, []
        q, dq = self.position_m.copy(), self.speed
        for k in range(self.servo.substeps):
            forces.append(self.servo.kp_N_m * (u + k * h * du - q) + self.servo.kd_N_s_m * (du - dq))
            ddq = (np.clip(forces[-1], -self.limit_N, self.limit_N) - LOAD) / self.mass
            q, dq = q + h * dq + h * h / 2 * ddq, dq + h * ddq
        self.position_m, self.speed, self.force_N = q, dq, np.array(forces)


Spoil = Callable[[int, bytes], list[bytes]]  # cycle, its datagram -> what arrives in this cycle


@dataclass
class Ride:
    """A run: rows of the log by column, plant positions (cycles, 3), the loop's report if it ran in C."""

    log: bytes
    measured: np.ndarray
    plant: DisturbedPlant
    report: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        return rows_of(self.log)[:, COLUMNS.index(name)]

    def axes(self, name: str) -> np.ndarray:
        """Column of each axis, (cycles, 3)."""
        return np.stack([self[f"{name}[{k}]"] for k in range(3)], axis=1)


@dataclass
class Replanning:
    """The bench: program in `place`, and its controller."""

    law: Controller
    program: Path
    place: Path

    def robot(self, protocol: str = "egm", start: Sequence[float] = (0.0, 0.0, 0.0), **keys: Any) -> RobotSide:
        mine = {name: keys.pop(name) for name in ("mass", "servo") if name in keys}
        theirs = {name: keys.pop(name) for name in ("waits", "ends", "first_number", "first_ms") if name in keys}
        disturbances: dict[str, Any] = {"delay": 2} | keys
        plant = DisturbedPlant(CartPlant(start, **mine), **disturbances)
        return RobotSide(protocol, plant, **theirs)  # type: ignore[arg-type]

    def python_loop(self, protocol: str, goals: np.ndarray, law: Controller | None = None) -> PythonLoop:
        own = PredictiveLaw(law or self.law, ReferenceTable(goals), 3, protocol == "egm", 4, HOLD)
        limits = LoopLimits(step_m=0.05)
        settings = Settings(dry=False, hold_cycles=HOLD, deceleration_m_s2=DECELERATION, limits=limits)
        return PythonLoop(settings, Exchange(protocol, 3), own)  # type: ignore[arg-type]

    def options(self, protocol: str, goals: np.ndarray) -> list[str]:
        table, log = self.place / "goals.table", self.place / "loop.log"
        table.write_bytes(ReferenceTable(goals).to_bytes())
        log.unlink(missing_ok=True)
        words = f"--peer {protocol} --law predictive --live --hold {HOLD} --deceleration {DECELERATION} --step 0.05 "
        return [*words.split(), "--idle-ms", "9000", "--reference", str(table), "--log", str(log)]

    def ride(
        self, robot: RobotSide, goals: np.ndarray, cycles: int = CYCLES, spoil: Spoil | None = None, late: int = 0
    ) -> Ride:
        """Run the C loop in lock step. late: cycles by which answers come late."""
        options = [*self.options(robot.protocol, goals), "--lockstep", "--cycles", str(cycles)]
        with LoopProcess(self.program, options) as process:
            measured = go(robot, process.exchange, cycles, spoil, late)
            report = process.finish()
        return Ride((self.place / "loop.log").read_bytes(), measured, robot.plant, report)  # type: ignore[arg-type]

    def twin(
        self, robot: RobotSide, goals: np.ndarray, cycles: int = CYCLES, spoil: Spoil | None = None,
        law: Controller | None = None,
    ) -> Ride:  # fmt: skip
        """Run the loop in Python."""
        loop = self.python_loop(robot.protocol, goals, law)
        measured = go(robot, loop.exchange, cycles, spoil)
        return Ride(bytes(loop.log), measured, robot.plant)  # type: ignore[arg-type]


def go(
    robot: RobotSide, exchange: Callable[[list[bytes]], list[bytes]], cycles: int, spoil: Spoil | None = None,
    late: int = 0,
) -> np.ndarray:  # fmt: skip
    """Run a robot against a loop cycle by cycle; return its positions (cycles, 3)."""
    measured, answers = list[np.ndarray](), list[list[bytes]]()
    for cycle in range(cycles):
        measured.append(np.array(robot.plant.arm_m))
        data = robot.datagram()
        answers.append(exchange([data] if spoil is None else spoil(cycle, data)))
        robot.step(answers[cycle - late] if cycle >= late else [])
    return np.array(measured)


def changed(at: range, change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Return what changes the measured positions [m] of these cycles."""

    def spoil(cycle: int, data: bytes) -> list[bytes]:
        if cycle not in at:
            return [data]
        robot = egm.decode_robot(data)
        robot.feedback.external_mm = (1e3 * change(np.array(robot.feedback.external_mm) / 1e3)).tolist()
        return [egm.encode_robot(robot)]

    return spoil
