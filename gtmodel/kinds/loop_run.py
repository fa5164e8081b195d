"""``gtmodel loop``: the C loop of a generated folder against a simulated controller, without and with its law."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gtmodel.compiler.causal import compile_causal
from gtmodel.loop import (
    DrivePlant,
    ElasticPlant,
    LoopError,
    LoopProcess,
    RigidBodyPlant,
    RobotSide,
    Servo,
    Table,
    lockstep,
    real_time,
    rsi_configuration,
)
from gtmodel.loop.plant import Plant
from gtmodel.loop.record import STATES, trajectory_of
from gtmodel.results import SolveStatus, Status, Trajectory
from gtmodel.robots import actuator_closed_loop

from . import report
from .base import Check, Context, InputError, Outcome, Row, at_most
from .loop_bench import MARK, Bench, prepare
from .loop_motion import CYCLE_MS
from .run import Finished

# what the first and the second run of a law are
LAWS = {
    "trajectory": ("the reference alone", "with feedforward"),
    "dynamics": ("the reference alone", "with inverse-dynamics feedforward"),
    "replay": ("the reference alone", "with a learned table"),
    "path": ("the programme alone", "with path correction"),
}
# as long as the C program holds by itself
HOLD_CYCLES = 5
# Python and other work share the machine with the simulated controller: where that was silent for longer than the loop
# may hold, the run says nothing about the loop and is made again
ATTEMPTS = 5
STEP_LIMIT_M = 0.1
REACH_LIMIT_M = 1.0  # beyond the reference: the inverse of a slow drive asks for far more than it gets
# of an arm on springs; no values of the prototype are published
ELASTIC_HZ, ELASTIC_DAMPING = (0.5, 1000.0), 0.05
# with its law a run has to track this much better; path correction is slow beside the motion and has only to help
GAINS = {"trajectory": 0.5, "dynamics": 0.5, "replay": 0.5, "path": 1.0}
LEARNING, LEARNING_RUNS = 0.9, 30  # gain of Dressler 2012, section 7.3; simulated repetitions
PATH_GAIN_PER_S, PATH_LIMIT_M = 2.0, 0.03  # slow beside drives of 1.1 Hz with five samples of delay
# edges of the histogram that is printed, among the loop's powers of two; loop.json holds all
REPLIES_US, PERIODS_US, COMPUTING_US = (64, 512, 4096), (2048, 4096, 8192), (4, 16, 64)
# the end of a real-time run finds the loop waiting for the next datagram
GOING = (STATES.index("running"), STATES.index("holding"))


@dataclass
class OneRun:
    """One run: its log, the loop's report, what it said; carts and tool centre point measured (cycles, 3) [m]."""

    label: str
    log: bytes
    report: dict[str, Any]
    said: str
    carts_m: np.ndarray
    tcp_m: np.ndarray
    programme_tcp_m: np.ndarray


def run(
    folder: Path,
    peer: str,
    seconds: float,
    *,
    law: str = "trajectory",
    reference: Path | None = None,
    in_lockstep: bool = False,
    elastic_Hz: float | None = None,
    deceleration_m_s2: float | None = None,
    out: Path | None = None,
    context: Context | None = None,
) -> Finished:
    """Build the loop with a generated folder and run it on loopback against a simulated controller.

    Args:
        folder: of gtmodel codegen, made from a problem with a robot of three carts.
        peer: egm or rsi.
        seconds: of each of the two runs; with `in_lockstep` they go as fast as the machine allows.
        law: one of LAWS; it chooses the plant: drives of eq. (6.11), or for `dynamics` the rigid-body robot.
        elastic_Hz: the arm hangs on the carts by springs of this frequency, which no law knows; None: it is rigid.
        deceleration_m_s2: of the fastest cart when the robot is lost, behind the cycles that are held; the largest that
            the reference asks of a cart if None.
        reference: CSV with T, der(T), der(T,2) every 4 ms; the time-optimal motion of l1_min_time if None.
        out: for the loop's sources, logs and the picture; `folder`/loop if None.

    Raises InputError, one sentence.
    """
    job = context or Context(name=folder.name)
    if elastic_Hz is not None and not ELASTIC_HZ[0] <= elastic_Hz <= ELASTIC_HZ[1]:
        raise InputError(
            f"--elastic {elastic_Hz:g}: expected a frequency from {ELASTIC_HZ[0]:g} to {ELASTIC_HZ[1]:g} Hz"
        )
    if deceleration_m_s2 is not None and not 0 < deceleration_m_s2 < math.inf:
        raise InputError(f"--deceleration {deceleration_m_s2:g}: expected an acceleration above 0 m/s2")
    bench = prepare(folder, peer, seconds, law, LAWS, reference, in_lockstep, out, job)
    stop = Stop.of(bench, deceleration_m_s2)
    runs: list[OneRun] = []
    try:
        for n, label in enumerate(LAWS[law]):
            job.progress(f"{peer}: {label}", n / 2)
            runs.append(_run(bench, label, elastic_Hz, stop, active=n == 1))
            if job.interrupted():
                outcome = Outcome(status=SolveStatus.INTERRUPTED, message="stopped before both runs were compared")
                return Finished(outcome, time.monotonic() - job.began)
    except LoopError as error:
        return Finished(Outcome(status=SolveStatus.FAILED, message=str(error)), time.monotonic() - job.began)
    outcome = _outcome(bench, runs, elastic_Hz, stop)
    return Finished(outcome, time.monotonic() - job.began, _write(bench, runs, outcome))


@dataclass(frozen=True)
class Stop:
    """What a cart does when the robot is lost at the reference's greatest speed: it holds, then brakes."""

    speed_m_s: float
    deceleration_m_s2: float

    @classmethod
    def of(cls, bench: Bench, deceleration_m_s2: float | None) -> Stop:
        """Of the reference's carts; where they rest any deceleration will do."""
        rates = np.abs(bench.reference.rows[: bench.cycles, 3:9])
        return cls(float(np.max(rates[:, :3])), deceleration_m_s2 or float(np.max(rates[:, 3:])) or 1.0)

    @property
    def distance_m(self) -> float:
        """Held cycles at full speed, then a ramp in whole cycles."""
        step = 1e-3 * CYCLE_MS
        ramp = math.ceil(self.speed_m_s / (self.deceleration_m_s2 * step))
        return self.speed_m_s * step * (HOLD_CYCLES + max(0, ramp - 1) / 2)


def _run(bench: Bench, label: str, elastic_Hz: float | None, stop: Stop, *, active: bool) -> OneRun:
    """One run; made again where the simulated controller was silent for longer than the loop may hold."""
    for attempt in range(ATTEMPTS):
        one, gap_s = _once(bench, label, elastic_Hz, stop, active=active)
        held = one.report["state"] in GOING or gap_s < 1e-3 * CYCLE_MS * HOLD_CYCLES
        if held or bench.in_lockstep or bench.context.interrupted() or attempt == ATTEMPTS - 1:
            return one
        bench.context.progress(f"{bench.peer}: {label}: the simulated controller was {1e3 * gap_s:.0f} ms late, again")
    raise LoopError(label)


def _once(bench: Bench, label: str, elastic_Hz: float | None, stop: Stop, *, active: bool) -> tuple[OneRun, float]:
    plant, programme = _plant(bench), None
    if elastic_Hz is not None:
        plant = ElasticPlant(plant, elastic_Hz, ELASTIC_DAMPING, 1e-3 * CYCLE_MS)
    if bench.law == "path":
        programme = _programme(bench)
    robot = RobotSide(bench.peer, plant, cycle_ms=CYCLE_MS, programme=programme)
    log = bench.place / ("loop_on.log" if active else "loop_off.log")
    log.unlink(missing_ok=True)  # of an earlier run in this folder, which gtmodel wrote
    options = [*_options(bench, active), "--deceleration", repr(stop.deceleration_m_s2), "--log", str(log)]
    # in real time a late cycle is one more, and the loop ends when it is asked to
    options += ["--cycles", str(bench.cycles)] if bench.in_lockstep else []

    def stopped(share: float) -> bool:
        return bench.context.interrupted()

    with LoopProcess(bench.program, options) as process:
        if bench.in_lockstep:
            done = lockstep(robot, process.exchange, bench.cycles, stopped=stopped)
            process.end()
        else:
            done = real_time(robot, process, bench.cycles, stopped)
        found = process.finish()
        said = process.said
    tcp, status = bench.forward(done.arm_m)
    if np.any(status != Status.OK):
        raise LoopError(f"{label}: the simulated robot left its workspace")
    programme_tcp, _ = bench.forward(done.planned_m)
    one = OneRun(label, log.read_bytes(), found, said, done.measured_m, tcp, programme_tcp)
    return one, done.longest_gap_s


def _plant(bench: Bench) -> Plant:
    start = bench.carts_m[0]
    if bench.law == "dynamics":
        forward = compile_causal(bench.robot, known="tau", targets="der(T,2)", prefer="T")
        velocity = compile_causal(bench.robot, known="T", targets=["q", "der(q)"])
        return RigidBodyPlant(forward, velocity, bench.tcp_m[0].tolist(), Servo(), CYCLE_MS / 1000.0)
    drives = actuator_closed_loop()
    return DrivePlant(start.tolist(), drives["a"], drives["b"], drives["delay"])


def _options(bench: Bench, active: bool) -> list[str]:
    """The loop's command line."""
    drives, servo = actuator_closed_loop(), Servo()
    lowest = bench.carts_m.min(axis=0) - REACH_LIMIT_M
    highest = bench.carts_m.max(axis=0) + REACH_LIMIT_M
    table = str(bench.place / "reference.table")
    law = bench.law if active or bench.law in ("dynamics", "path") else "trajectory"
    options = {
        "--peer": bench.peer,
        "--law": law,
        "--feedforward": "on" if active else "off",
        "--reference": table,
        "--cycle-ms": str(CYCLE_MS),
        "--hold": str(HOLD_CYCLES),
        "--idle-ms": "5000",
        "--lowest": _text(lowest),
        "--highest": _text(highest),
        "--step": repr(STEP_LIMIT_M),
        "--path-limit": repr(PATH_LIMIT_M),
        "--delay-ms": str(CYCLE_MS * drives["delay"]),
        "--a": _text(drives["a"]),
        "--b": _text(drives["b"]),
        "--kp": _text([servo.kp_N_m] * 3),
        "--kd": _text([servo.kd_N_s_m] * 3),
        # a position without a speed is held for a cycle: half a cycle ahead it is right in the middle
        "--lead-ms": "0" if bench.peer == "egm" else str(CYCLE_MS // 2),
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


def _learned(bench: Bench) -> Table:
    """Corrections that repeated simulated runs of the drives leave: u + 0.9 e(k + 5) (Dressler 2012, section 7.3)."""
    wanted, delay = bench.carts_m, actuator_closed_loop()["delay"]
    correction = np.zeros_like(wanted)
    for _ in range(LEARNING_RUNS):
        plant, measured = _plant(bench), np.zeros_like(wanted)
        for k, command in enumerate(wanted + correction):
            measured[k] = plant.position_m
            plant.step(command.tolist(), [0.0] * 3)
        error = wanted - measured
        correction += LEARNING * np.vstack([error[delay:], np.repeat(error[-1:], delay, axis=0)])
    return Table(correction, CYCLE_MS)


def _programme(bench: Bench) -> Callable[[int, Sequence[float]], Sequence[float]]:
    """The robot's own motion: the reference, its tool centre point moved by the path correction."""
    inverse = compile_causal(bench.robot, known="T", targets="q")

    def carts(cycle: int, path_m: Sequence[float]) -> Sequence[float]:
        q, status = inverse(bench.tcp_m[cycle] + np.array(path_m))
        if status is not Status.OK:
            raise LoopError(
                f"the path corrected by {1e3 * np.array(path_m).round(4)} mm leaves the workspace in cycle {cycle}"
            )
        return q.tolist()

    return carts


def _outcome(bench: Bench, runs: list[OneRun], elastic_Hz: float | None, stop: Stop) -> Outcome:
    errors = [_errors(bench, one) for one in runs]
    plain, active = (e["tcp_rms_mm"] for e in errors)
    bound = GAINS[bench.law]
    checks = {"rms_error_ratio": at_most(active / plain, bound)}
    for name, one in zip(("off", "on"), runs, strict=True):
        running = one.report["state"] in GOING
        state, why = STATES[one.report["state"]], Status(one.report["status"]).sentence
        checks[f"{name}_running_at_the_end"] = Check(float(running), None, running, f"{one.label}: {state}, {why}")
        checks[f"{name}_log_complete"] = Check(
            float(one.report["log_complete"]), None, bool(one.report["log_complete"])
        )
    real_time_granted = all(one.report["fifo"] and one.report["memory_locked"] for one in runs)
    timing = "in lock step" if bench.in_lockstep else "in real time" if real_time_granted else "not real-time"
    message = f"{bench.peer} on loopback, {timing}; tested against simulators only"
    return Outcome(
        status=SolveStatus.SOLVED,
        message=message,
        checks=checks,
        values={
            "peer": bench.peer,
            "law": bench.law,
            "plant": "rigid body under a servo" if bench.law == "dynamics" else "drives of eq. (6.11)",
            "elastic_Hz": elastic_Hz,
            "cycles": bench.cycles,
            "real_time": real_time_granted,
            "hold_cycles": HOLD_CYCLES,
            "deceleration_m_s2": stop.deceleration_m_s2,
            "greatest_speed_m_s": stop.speed_m_s,
            "stopping_distance_m": stop.distance_m,
            "runs": [{"label": one.label, **e, **one.report} for one, e in zip(runs, errors, strict=True)],
        },
        rows=[*_rows(runs, errors, bench.in_lockstep), *_stopping(stop)],
        figures={"tracking": lambda: _figure(bench, runs)},
    )


def _errors(bench: Bench, one: OneRun) -> dict[str, float]:
    tcp = 1e3 * np.linalg.norm(one.tcp_m - bench.tcp_m[: len(one.tcp_m)], axis=1)
    carts = 1e3 * np.abs(one.carts_m - bench.carts_m[: len(one.carts_m)])
    return {
        "tcp_rms_mm": float(np.sqrt(np.mean(tcp**2))),
        "tcp_largest_mm": float(tcp.max()),
        "cart_largest_mm": float(carts.max()),
    }


def _rows(runs: list[OneRun], errors: list[dict[str, float]], in_lockstep: bool) -> list[Row]:
    rows: list[Row] = []
    for one, error in zip(runs, errors, strict=True):
        rows += [
            Row(f"{one.label}: rms error of T", error["tcp_rms_mm"], "mm"),
            Row(f"{one.label}: largest error of T", error["tcp_largest_mm"], "mm"),
            Row(
                f"{one.label}: late, lost, repeated", " ".join(str(one.report[k]) for k in ("late", "lost", "repeated"))
            ),
        ]
        if not in_lockstep:
            rows += [
                Row(f"{one.label}: replies later than a cycle", str(one.report["missed_deadlines"])),
                Row(f"{one.label}: worst reply, worst period", " ".join(_worst_ms(one.report)), "ms"),
                Row(f"{one.label}: longest computing of a cycle", f"{one.report['compute_worst_us']}", "us"),
                Row(f"{one.label}: computing", _histogram(one.report["compute_below_us"], COMPUTING_US)),
                Row(f"{one.label}: replies", _histogram(one.report["reply_below_us"], REPLIES_US)),
                Row(f"{one.label}: periods", _histogram(one.report["period_below_us"], PERIODS_US)),
            ]
    for line in dict.fromkeys(line for one in runs for line in one.said.splitlines()):
        rows.append(Row("the loop says", line))
    return rows


def _stopping(stop: Stop) -> list[Row]:
    return [
        Row("greatest speed of a cart", stop.speed_m_s, "m/s"),
        Row(f"a lost robot: held for {HOLD_CYCLES} cycles, then braked at", stop.deceleration_m_s2, "m/s2"),
        Row("a lost robot: way to the stop from that speed", stop.distance_m, "m"),
    ]


def _worst_ms(found: dict[str, Any]) -> list[str]:
    return [f"{found[f'{what}_worst_us'] / 1000:.2f}" for what in ("reply", "period")]


def _histogram(below_us: dict[str, int], edges_us: Sequence[int]) -> str:
    """The loop's fine classes added up: how many lie below each edge and not below the one before, and the rest."""
    cells, before = [], 0
    for edge in edges_us:
        up_to = sum(count for us, count in below_us.items() if int(us) <= edge)
        cells.append(f"<{edge / 1000:.2g} ms: {up_to - before}")
        before = up_to
    return ", ".join([*cells, f"more: {sum(below_us.values()) - before}"])


def _figure(bench: Bench, runs: list[OneRun]) -> Any:
    from gtmodel.plot.tracking import tracking_figure

    time_s = 1e-3 * CYCLE_MS * np.arange(bench.cycles)
    wanted = Trajectory(time_s, {"T": bench.tcp_m, "q": bench.carts_m}, {"T": "m", "q": "m"})
    measured = {
        one.label: Trajectory(time_s[: len(one.tcp_m)], {"T": one.tcp_m, "q": one.carts_m}, {"T": "m", "q": "m"})
        for one in runs
    }
    return tracking_figure(wanted, measured, f"{bench.peer.upper()} on loopback, {bench.law}: simulated controller")


def _write(bench: Bench, runs: list[OneRun], outcome: Outcome) -> list[Path]:
    place = bench.place
    for name, one in zip(("off", "on"), runs, strict=True):
        log = trajectory_of(one.log, 3, 1e-3 * CYCLE_MS, title=f"{bench.peer}, {one.label}: log of the loop")
        log.to_csv(place / f"loop_{name}.csv", overwrite=True)
    if bench.peer == "rsi":
        (place / "rsi_configuration.xml").write_text(rsi_configuration("127.0.0.1", 49152), encoding="utf-8")
    figure = outcome.figures["tracking"]()
    figure.savefig(place / "tracking.png", dpi=150, metadata={"Software": None})
    summary = report.summary(bench.context.name, "loop", outcome, 0.0)
    (place / MARK).write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    return [place / name for name in ("tracking.png", "loop_off.csv", "loop_on.csv", MARK)]
