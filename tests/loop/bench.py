"""A loop program with what the loop in Python needs beside it: the same reference, laws and settings for both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

import gtmodel as gt
from gtmodel.compiler.causal import CausalFunction
from gtmodel.loop import (
    Channel,
    DrivePlant,
    DynamicsLaw,
    Exchange,
    Faults,
    LoopLimits,
    LoopProcess,
    LoopRun,
    PathLaw,
    PythonLoop,
    ReferenceTable,
    ReplayLaw,
    RobotSide,
    Settings,
    TrajectoryLaw,
    lockstep,
)
from gtmodel.loop.laws import LoopLaw
from gtmodel.loop.lead_through.law import GuidingLaw, numbers_of
from gtmodel.loop.lead_through.options import Guiding, SensorNumbers, SyntheticScene
from gtmodel.loop.lead_through.study import PlateScene, ServoPlant
from gtmodel.results import Status
from gtmodel.robots import actuator_closed_loop

DRIVES = actuator_closed_loop()
A, B = [*DRIVES["a"], 0.0, 0.0, 0.0], [*DRIVES["b"], 1.0, 1.0, 1.0]
KP, KD = [40_000.0] * 6, [1_500.0] * 6
STEP, HOLD, RAMP = 0.05, 25, 40
GUIDING = Guiding(
    tool=SensorNumbers(0.8, (0.0, 0.01, 0.06), (1.0, -2.0, 0.5), (0.1, 0.0, -0.05), (0.0, 0.05, 0.2), (0.1, 0.2, 1.5)),
    handle=SensorNumbers(0.4, (0.0, 0.0, -0.02), (-0.5, 0.3, 0.2)),
    scene=SyntheticScene(noise=0.05, noise_moment=0.002, seed=7),
)
FROM, BY = np.array([0.0, -0.9, 0.1]), np.array([0.3, -0.1, 0.15])


def text(values: Sequence[float]) -> str:
    return ",".join(map(repr, values))


@dataclass
class Pair:
    """The same run by the C loop and by the loop in Python: logs, runs, and the C loop's report."""

    c_log: bytes
    python_log: bytes
    c_run: LoopRun
    python_run: LoopRun
    report: dict
    python_loop: PythonLoop


@dataclass
class Bench:
    program: Path
    place: Path
    functions: dict[str, CausalFunction]

    @cached_property
    def reference(self) -> ReferenceTable:
        """A smooth motion of 1.2 s after a rest of 0.2 s; q, T and their derivatives every 4 ms."""
        s = np.clip((np.arange(400) - 50) / 300, 0.0, 1.0)
        duration = 300 * 0.004
        place = 10 * s**3 - 15 * s**4 + 6 * s**5
        rate = (30 * s**2 - 60 * s**3 + 30 * s**4) / duration
        second = (60 * s - 180 * s**2 + 120 * s**3) / duration**2
        T = FROM + place[:, None] * BY
        dT, ddT = rate[:, None] * BY, second[:, None] * BY
        robot = gt.robots.gantry_tau("l1_tape", inertia="model_2")
        q, dq, ddq, status = robot.causal("T", ["q", "der(q)", "der(q,2)"])(T, dT, ddT)
        assert np.all(status == Status.OK)
        return ReferenceTable(np.hstack([q, dq, ddq, T, dT, ddT]))

    @cached_property
    def corrections(self) -> ReferenceTable:
        random = np.random.default_rng(5)
        return ReferenceTable(np.cumsum(random.normal(0.0, 1e-4, (400, 3)), axis=0))

    @property
    def start_m(self) -> list[float]:
        return self.reference.rows[0, :3].tolist()

    def robot(self, protocol: str, **keys: object) -> RobotSide:
        plant = DrivePlant(self.start_m, DRIVES["a"], DRIVES["b"], DRIVES["delay"])
        return RobotSide(protocol, plant, **keys)  # type: ignore[arg-type]

    def guided(self, protocol: str, fault_from: int | None = None, **keys: object) -> RobotSide:
        """A robot that is led over a synthetic plate."""
        start, status = self.functions["carts"](GUIDING.scene.start, [0.0] * 3)[::2]
        assert status is Status.OK
        plant = ServoPlant(start.tolist(), GUIDING.scene.servo)
        scene = PlateScene(GUIDING, lambda q: self.functions["fk"](q)[0], plant, fault_from)
        return RobotSide(protocol, plant, wrenches=scene.wrenches, **keys)  # type: ignore[arg-type]

    def options(self, protocol: str, law: str, *, live: bool = True) -> list[str]:
        self.log.unlink(missing_ok=True)
        tables = self.place / "reference.table", self.place / "corrections.table"
        for path, table in zip(tables, (self.reference, self.corrections), strict=True):
            path.write_bytes(table.to_bytes())
        words = ["--peer", protocol, "--law", law, "--feedforward", "on", "--lockstep", "--delay-ms", "20"]
        words += ["--reference", str(tables[0]), "--corrections", str(tables[1]), "--log", str(self.log)]
        words += ["--a", text(A), "--b", text(B), "--kp", text(KP), "--kd", text(KD), "--lead-ms", "2", "--gain", "2"]
        gains = self.place / "gains.table"
        gains.write_bytes(numbers_of(GUIDING.law(), GUIDING.drift).to_bytes())
        words += ["--gains", str(gains)]
        words += ["--hold", str(HOLD), "--ramp", str(RAMP), "--step", repr(STEP), "--idle-ms", "9000"]
        return [*words, *(["--live"] if live else [])]

    @property
    def log(self) -> Path:
        return self.place / "loop.log"

    def law(self, protocol: str, name: str) -> LoopLaw:
        if name == "trajectory":
            return TrajectoryLaw(self.reference, 3, True, 20, 4, A, B)
        if name == "dynamics":
            return DynamicsLaw(self.reference, 3, self._inverse_dynamics, True, protocol == "egm", 2, KP, KD)
        if name == "replay":
            return ReplayLaw(self.reference, self.corrections, 3)
        if name == "lead_through":
            return GuidingLaw(GUIDING.law(), GUIDING.drift, 3, self._forward, self._carts, 4, HOLD)
        return PathLaw(3, self._forward, 2.0, LoopLimits().path_m)

    def python_loop(self, protocol: str, law: str, *, live: bool = True) -> PythonLoop:
        settings = Settings(dry=not live, hold_cycles=HOLD, ramp_cycles=RAMP, limits=LoopLimits(step_m=STEP))
        return PythonLoop(settings, Exchange(protocol, 3), self.law(protocol, law))  # type: ignore[arg-type]

    def both(
        self, protocol: str, law: str, cycles: int, faults: Faults | None = None, *, live: bool = True, waits: int = 0
    ) -> Pair:
        """One run in lock step by each of the two, with the same seed of faults in both directions."""

        def channels() -> tuple[Channel, Channel]:
            return Channel(faults or Faults()), Channel(faults or Faults())

        def robot() -> RobotSide:
            if law == "lead_through":
                return self.guided(protocol, waits=waits)
            programme = self._programme if law == "path" else None
            return self.robot(protocol, waits=waits, programme=programme)

        with LoopProcess(self.program, [*self.options(protocol, law, live=live), "--cycles", str(cycles)]) as process:
            run = lockstep(robot(), process.exchange, cycles, *channels())
            report = process.finish()
        python_loop = self.python_loop(protocol, law, live=live)
        python_run = lockstep(robot(), python_loop.exchange, cycles, *channels())
        return Pair(self.log.read_bytes(), bytes(python_loop.log), run, python_run, report, python_loop)

    def _programme(self, cycle: int, path_m: Sequence[float]) -> list[float]:
        """The robot's own motion; the path's correction moves the carts along x, as it does on this robot."""
        return [x + path_m[0] for x in self.reference.at(4 * cycle)[1][:3]]

    def _forward(self, q: list[float]) -> tuple[Status, list[float]]:
        T, status = self.functions["fk"](q)
        return status, T.tolist()

    def _carts(self, T: list[float], dT: list[float]) -> tuple[Status, list[float], list[float]]:
        q, dq, status = self.functions["carts"](T, dT)
        return status, q.tolist(), dq.tolist()

    def _inverse_dynamics(self, T: list[float], dT: list[float], ddT: list[float]) -> tuple[Status, list[float]]:
        tau, status = self.functions["inverse_dynamics"](T, dT, ddT)
        return status, tau.tolist()
