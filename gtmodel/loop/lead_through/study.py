"""Runs of the C loop in which a hand leads the tool over a synthetic plate, with good and with faulty sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from ...compiler.causal import CausalFunction, compile_causal
from ...control.delayed import gain_limit
from ...control.lead_through import MountedSensor, ServoChain, force_loop
from ...control.lead_through.tool_run import ServoRun
from ...geometry.rotations import right_handed
from ...lang import Model
from ...results import ArgumentError, Quantity, Row, SolveStatus, Status, Work, at_least, at_most
from ..exchange import CYCLE_MS
from ..loop_result import LoopStudy
from ..one_run import ELASTIC_DAMPING, GOING, HOLD_CYCLES, Stop, again, driven
from ..plant import ElasticPlant, Plant
from ..process import FULL, STATES, LoopError, rows_of, trajectory_of
from ..robot_side import RobotSide
from ..wrenches import Wrench
from .law import numbers_of
from .options import Guiding

AT_FAULT = 1  # status of a faulty sensor


class ServoPlant:
    """Carts under servos that follow the change of the commanded positions, with delay, lag and mode. Exact for
    zero-order-hold commands; commanded speeds are not used."""

    def __init__(self, start_m: Sequence[float], servo: ServoChain, cycle_s: float = 0.004) -> None:
        self._last, self.cycle_s = np.array(start_m, dtype=float), cycle_s
        self._run = ServoRun(servo, cycle_s, self._last)

    @property
    def position_m(self) -> np.ndarray:
        """Position of the carts [m]."""
        return self._run.position

    @property
    def arm_m(self) -> np.ndarray:
        """Position of the carts [m]: the arm is rigid beyond the servo's mode."""
        return self._run.position

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None:
        position = np.array(position_m, dtype=float)
        self._run.advance((position - self._last) / self.cycle_s)
        self._last = position


class PlateScene:
    """Readings of the robot's force sensors in each cycle while a synthetic hand leads its tool over a plate.

    forward: carts (n,) -> tool centre point (3,). plant: moves the carts. fault_from: cycle in which the tool's sensor
    fails; None: never. `force`, `tip`: contact force and tool centre point of the cycles so far, (3,) each, no noise.
    """

    def __init__(
        self, guiding: Guiding, forward: Callable[[np.ndarray], np.ndarray], plant: Plant,
        fault_from: int | None = None,
    ) -> None:  # fmt: skip
        self.guiding, self.forward, self.plant, self.fault_from = guiding, forward, plant, fault_from
        self.law, self.rng = guiding.law(), np.random.default_rng(guiding.scene.seed)
        self.along = right_handed(np.array(guiding.normal))[1:]
        self.origin = forward(plant.arm_m) - guiding.scene.gap * guiding.scene.plate.normal
        self.force: list[np.ndarray] = []
        self.tip: list[np.ndarray] = []
        self.good: Wrench | None = None

    def wrenches(self) -> tuple[Wrench, Wrench] | None:
        """Return the wrenches of handle and tool in this cycle; None if they are not sent."""
        scene, cycle_s = self.guiding.scene, self.guiding.gains.cycle
        now = len(self.tip)
        tip = self.forward(self.plant.arm_m)
        speed = (tip - self.tip[-1]) / cycle_s if self.tip else np.zeros(3)
        force = scene.plate.force(tip - self.origin, speed, now * cycle_s)
        self.tip.append(tip)
        self.force.append(force)
        handle = self._read(self.law.handle, self.hand(now * cycle_s))
        tool = self._read(self.law.tool, force)
        if self.fault_from is None or now < self.fault_from:
            self.good = tool
            return handle, tool
        if scene.fault == "missing":
            return None
        if scene.fault == "reported":
            tool.status = AT_FAULT
        elif scene.fault == "saturated":
            tool.force_N[2] = self.guiding.gains.force_range
        elif self.good is not None:  # repeat the last good reading with growing age
            tool = Wrench(self.good.force_N, self.good.moment_N_m, now - self.fault_from + 1)
        return handle, tool

    def hand(self, time: float) -> np.ndarray:
        """Return the force of the hand (3,) [N]."""
        hand = self.guiding.scene.hand
        if time < hand.rest:
            return np.zeros(3)
        angle = 2 * math.pi * (time - hand.rest) / hand.period
        dragged = math.cos(angle) * self.along[0] + math.sin(angle) * self.along[1]
        return hand.drag * dragged - hand.push * np.array(self.guiding.normal)

    def _read(self, sensor: MountedSensor, force: np.ndarray) -> Wrench:
        """Return a sensor's reading under a force at the tool centre point, with bias, load and noise."""
        axes = np.array(sensor.turn).T  # rows: the sensor's axes
        g, f = axes @ np.array(self.law.gravity), axes @ force
        scene = self.guiding.scene
        reading = np.array(sensor.force_bias) + sensor.mass * g + f + scene.noise * self.rng.standard_normal(3)
        moment = np.array(sensor.moment_bias) + np.cross(sensor.first_moment, g) + np.cross(sensor.point, f)
        moment += scene.noise_moment * self.rng.standard_normal(3)
        return Wrench(reading.tolist(), moment.tolist())


SETTLED = 0.5  # [s] after first contact: several time constants of the default filter of the normal
FORCE_ERROR = 0.02  # [N] tolerance of the mean force: one percent of the thesis's reference
STEP_LIMIT_M = 0.02  # of a cart in a cycle: 5 m/s
REACH_LIMIT_M = 1.0
RUNS = ("led over the plate", "a sensor fails")
EXPECTED = {
    "stale": Status.STALE_INPUT,
    "missing": Status.STALE_INPUT,
    "saturated": Status.OUT_OF_RANGE,
    "reported": Status.OUT_OF_RANGE,
}


@dataclass(frozen=True)
class GuidedBench:
    """Data that both runs share; see `Bench`. deceleration [m/s2]: of the fastest cart when the robot is lost.
    following_m: largest distance of a cart from its last command [m]."""

    peer: Literal["egm", "rsi"]
    guiding: Guiding
    robot: Model
    forward: CausalFunction
    program: Path
    place: Path
    cycles: int
    in_lockstep: bool
    elastic_Hz: float | None
    deceleration: float
    following_m: float
    work: Work

    @property
    def cycle_s(self) -> float:
        """Cycle of the loop [s]."""
        return CYCLE_MS / 1000.0

    def tcp(self, carts_m: np.ndarray) -> np.ndarray:
        """Return the tool centre point [m]. Raises LoopError."""
        tcp, status = self.forward(carts_m)
        if np.any(np.asarray(status) != Status.OK):
            raise LoopError("the simulated robot left its workspace")
        return np.asarray(tcp)


@dataclass(frozen=True)
class LedRun:
    """Log, report and printed text; force on the tool [N], tool centre point and its command [m], (cycles, 3) each."""

    label: str
    log: bytes
    report: dict[str, Any]
    printed: str
    force: np.ndarray
    tip: np.ndarray
    command: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class GuidedLoop(LoopStudy):
    """Two runs of the loop in which a hand leads the tool over a synthetic plate; in the second a sensor fails.

    Forces are along the plate's normal, after settling.
    """

    force_reference: Annotated[float, Quantity("N", "contact force to hold along the normal")] = 0.0
    force_mean: Annotated[float | None, Quantity("N", "mean settled force; null: too little contact")] = None
    force_deviation: Annotated[float | None, Quantity("N", "standard deviation of the force per cycle")] = None
    force_least: Annotated[float | None, Quantity("N", "least force in a cycle")] = None
    force_largest: Annotated[float | None, Quantity("N", "largest force in a cycle")] = None
    gain_share: Annotated[float, Quantity("1", "force gain times stiffness, over its limit from eigenvalues")] = 0.0
    fault: Annotated[str, Quantity("", "fault of the tool's sensor in the second run")] = ""
    braking_time: Annotated[float | None, Quantity("s", "from the first braking cycle to the stop")] = None
    braking_way: Annotated[float | None, Quantity("m", "commanded distance from there to the stop")] = None
    braking: Annotated[float | None, Quantity("m/s2", "largest commanded deceleration of the tool")] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if not self.runs:
            return []
        rows = [Row("held force: mean", self.force_mean, "N"), Row("held force: deviation", self.force_deviation, "N")]
        rows += [
            Row("held force: least, largest", f"{self.force_least:.2f} {self.force_largest:.2f}", "N")
            for _ in range(self.force_least is not None)
        ]
        rows += [
            Row("force gain times stiffness, over its limit", self.gain_share, "1"),
            Row(f"sensor {self.fault}: braked in", self.braking_time, "s"),
            Row(f"sensor {self.fault}: stopping distance of the tool", self.braking_way, "m"),
        ]
        late = [Row(f"{r['label']}: late, lost", f"{r['late']} {r['lost']}") for r in self.runs]
        return [row for row in (*rows, *late) if row.value is not None]


def guided(bench: GuidedBench, title: str = "") -> LoopStudy:
    """Make and compare both runs; their logs are in the working folder. Raises LoopError, ArgumentError."""
    led = compile_causal(bench.robot, known="T", targets=["q", "der(q)"])
    start, _, status = led(np.array(bench.guiding.scene.start), np.zeros(3))
    if status is not Status.OK:
        raise ArgumentError("the robot cannot reach it: " + Status(status).message, "lead_through.scene.start")
    table = numbers_of(bench.guiding.law(), bench.guiding.drift)
    (bench.place / "gains.table").write_bytes(table.to_bytes())
    runs: list[LedRun] = []
    for n, label in enumerate(RUNS):
        bench.work.progress(f"{bench.peer}: {label}", n / 2)
        runs.append(
            again(bench, label, partial(_once, bench, label, np.asarray(start), bench.cycles // 2 if n else None))
        )
        if bench.work.interrupted():
            message = "stopped before both runs were complete"
            return GuidedLoop(status=SolveStatus.INTERRUPTED, message=message, title=title)
    return _study(bench, runs, title)


def _once(bench: GuidedBench, label: str, start: np.ndarray, fault_from: int | None) -> tuple[LedRun, bool, float]:
    plant: Plant = ServoPlant(start.tolist(), bench.guiding.scene.servo, bench.cycle_s)
    if bench.elastic_Hz is not None:
        plant = ElasticPlant(plant, bench.elastic_Hz, ELASTIC_DAMPING, bench.cycle_s)
    scene = PlateScene(bench.guiding, bench.tcp, plant, fault_from)
    robot = RobotSide(bench.peer, plant, cycle_ms=CYCLE_MS, wrenches=scene.wrenches)
    log = bench.place / ("loop_guided.log" if fault_from is None else "loop_fault.log")
    log.unlink(missing_ok=True)
    options = [*_options(bench, start), "--log", str(log)]
    options += ["--lockstep"] if bench.in_lockstep else []
    done, report, printed = driven(bench, robot, options)
    content = log.read_bytes()
    command = bench.tcp(rows_of(content)[:, 21:24]) if len(content) else np.zeros((0, 3))
    count = len(done.measured_m)
    led = LedRun(label, content, report, printed, np.array(scene.force)[:count], np.array(scene.tip)[:count], command)
    good = report["state"] in GOING if fault_from is None else report["state"] == STATES.index("stopped")
    return led, good, done.longest_gap_s


def _options(bench: GuidedBench, start: np.ndarray) -> list[str]:
    options = {
        "--peer": bench.peer,
        "--law": "lead_through",
        "--gains": str(bench.place / "gains.table"),
        "--cycle-ms": str(CYCLE_MS),
        "--hold": str(HOLD_CYCLES),
        "--idle-ms": "5000",
        "--lowest": ",".join(repr(float(x)) for x in start - REACH_LIMIT_M),
        "--highest": ",".join(repr(float(x)) for x in start + REACH_LIMIT_M),
        "--step": repr(STEP_LIMIT_M),
        "--following": repr(bench.following_m),
        "--deceleration": repr(bench.deceleration),
    }
    return [*(word for pair in options.items() for word in pair), "--live"]


def _study(bench: GuidedBench, runs: list[LedRun], title: str) -> GuidedLoop:
    p, scene = bench.guiding.gains, bench.guiding.scene
    held, braked = _held(bench, runs[0]), _braked(bench, runs[1])
    limit = gain_limit(force_loop(scene.servo, p.cycle)).gain
    share = p.force_gain * scene.plate.stiffness / limit
    expected, ended = EXPECTED[scene.fault], runs[1].report
    correct = ended["state"] == STATES.index("stopped") and ended["status"] == expected
    going = float(runs[0].report["state"] in GOING)
    why = f"{STATES[runs[0].report['state']]}, {Status(runs[0].report['status']).message}"
    error = abs(held.get("force_mean", np.nan) - p.force_reference)
    checks = {
        "guided_running_at_the_end": at_least(going, 1.0, why),
        "force_error_N": at_most(
            error, FORCE_ERROR, "the force has not settled, or friction or the shape of the plate disturbs it"
        ),
        "force_least_N": at_least(held.get("force_least", np.nan), 1e-6, "the contact was lost, or there was none"),
        "gain_share": at_most(share, 1.0, "reduce force_gain: the contact oscillates"),
        "fault_stopped": at_least(float(correct), 1.0, f"{STATES[ended['state']]}, {Status(ended['status']).message}"),
        "fault_deceleration_m_s2": at_most(braked.get("braking", np.nan), p.acceleration_limit * (1 + 1e-6)),
    }
    for name, one in zip(("guided", "fault"), runs, strict=True):
        checks[f"{name}_log_complete"] = at_least(float(bool(one.report["log_complete"])), 1.0, FULL)
        log = trajectory_of(one.log, 3, bench.cycle_s, title=f"{bench.peer}, {one.label}: log of the loop")
        log.to_csv(bench.place / f"loop_{name}.csv")
    real_time_granted = all(one.report["fifo"] and one.report["memory_locked"] for one in runs)
    timing = "in lock step" if bench.in_lockstep else "in real time" if real_time_granted else "not real-time"
    fastest = float(np.abs(rows_of(runs[0].log)[:, 27:30]).max(initial=0.0))
    return GuidedLoop(
        status=SolveStatus.SOLVED,
        message=f"synthetic plate and hand, {bench.peer} on loopback, {timing}; tested against simulators only",
        title=title,
        checks=checks,
        in_lockstep=bench.in_lockstep,
        notes=list(dict.fromkeys(line for one in runs for line in one.printed.splitlines())),
        peer=bench.peer,
        law="lead_through",
        plant="synthetic: servo with lag and delay, plate, hand",
        elastic=bench.elastic_Hz,
        cycles=bench.cycles,
        real_time=real_time_granted,
        deceleration=bench.deceleration,
        greatest_speed=fastest,
        stopping_distance=Stop(fastest, bench.deceleration).distance_m,
        runs=[{"label": one.label, **one.report} for one in runs],
        force_reference=p.force_reference,
        gain_share=float(share),
        fault=scene.fault,
        figures={"guiding": partial(_figure, bench, runs)},
        **held,
        **braked,
    )


def _held(bench: GuidedBench, run: LedRun) -> dict[str, Any]:
    """Return statistics of the settled force along the normal."""
    pressed = run.force @ bench.guiding.scene.plate.normal
    touched = np.flatnonzero(pressed > 0)
    first = int(touched[0]) + round(SETTLED / bench.cycle_s) if len(touched) else len(pressed)
    settled = pressed[first:]
    if not len(settled):
        return {}
    return {
        "force_mean": float(settled.mean()), "force_deviation": float(settled.std()),
        "force_least": float(settled.min()), "force_largest": float(settled.max()),
    }  # fmt: skip


def _braked(bench: GuidedBench, run: LedRun) -> dict[str, Any]:
    """Return time, distance and deceleration from the first braking cycle to the stop."""
    states = rows_of(run.log)[:, 3]
    braking = np.flatnonzero((states == STATES.index("braking")) | (states == STATES.index("ramping")))
    ended = np.flatnonzero(states == STATES.index("stopped"))
    if not len(braking) or not len(ended) or braking[0] < 2:
        return {}
    begin, end = int(braking[0]), int(ended[0])
    velocity = np.diff(run.command[begin - 2 : end + 1], axis=0) / bench.cycle_s
    return {
        "braking_time": float((end - begin + 1) * bench.cycle_s),
        "braking_way": float(np.linalg.norm(run.command[end] - run.command[begin - 1])),
        "braking": float(np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() / bench.cycle_s),
    }


def _figure(bench: GuidedBench, runs: list[LedRun]) -> Any:
    from ...plot.lead_through import guided_figure

    normal, gap = bench.guiding.scene.plate.normal, bench.guiding.scene.gap
    series: Mapping[str, Any] = {
        one.label: (
            one.force @ normal,
            np.linalg.norm(np.diff(one.command, axis=0), axis=1) / bench.cycle_s,
            1e3 * ((one.tip - one.tip[0]) @ normal + gap),
        )
        for one in runs
    }
    title = f"{bench.peer.upper()} on loopback, synthetic plate and hand; sensor {bench.guiding.scene.fault}"
    return guided_figure(bench.cycle_s, series, bench.guiding.gains.force_reference, title)
