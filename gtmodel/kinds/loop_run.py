"""``gtmodel loop``: the C loop of a generated folder against a simulated controller, without and with its law."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
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
from gtmodel.loop.build import PROGRAM
from gtmodel.loop.plant import Plant
from gtmodel.loop.record import STATES, trajectory_of
from gtmodel.results import SolveStatus, Status, Trajectory
from gtmodel.results.folder import unfinished
from gtmodel.robots import actuator_closed_loop

from . import output, report
from .base import Context, InputError, Outcome, at_least, at_most
from .loop_bench import MARK, Bench, prepare
from .loop_motion import CYCLE_MS
from .loop_rows import HOLD_CYCLES, OneRun, Stop, rows_of, stopping
from .noted import noted
from .run import Finished

# what the first and the second run of a law are
LAWS = {
    "trajectory": ("the reference alone", "with feedforward"),
    "dynamics": ("the reference alone", "with inverse-dynamics feedforward"),
    "replay": ("the reference alone", "with a learned table"),
    "path": ("the programme alone", "with path correction"),
}
# Python and other work share the machine with the simulated controller: where that was silent for longer than the loop
# may hold, the run says nothing about the loop and is made again
ATTEMPTS = 5
FULL = "the log could not be written whole: make room on the disk"
STEP_LIMIT_M = 0.1
REACH_LIMIT_M = 1.0  # beyond the reference: the inverse of a slow drive asks for far more than it gets
# of an arm on springs; no values of the prototype are published
ELASTIC_HZ, ELASTIC_DAMPING = (0.5, 1000.0), 0.05
# with its law a run has to track this much better; path correction is slow beside the motion and has only to help
GAINS = {"trajectory": 0.5, "dynamics": 0.5, "replay": 0.5, "path": 1.0}
LEARNING, LEARNING_RUNS = 0.9, 30  # gain of Dressler 2012, section 7.3; simulated repetitions
PATH_GAIN_PER_S, PATH_LIMIT_M = 2.0, 0.03  # slow beside drives of 1.1 Hz with five samples of delay
# the end of a real-time run finds the loop waiting for the next datagram
GOING = (STATES.index("running"), STATES.index("holding"))


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
        out: for the loop's sources, logs and the picture; `folder`/loop if None. Nothing changes in it before the end,
            when all files are written or none; no other run may write there meanwhile.

    Raises InputError, one sentence.
    """
    job = context or Context(name=folder.name)
    if elastic_Hz is not None and not ELASTIC_HZ[0] <= elastic_Hz <= ELASTIC_HZ[1]:
        raise InputError(
            f"--elastic {elastic_Hz:g}: expected a frequency from {ELASTIC_HZ[0]:g} to {ELASTIC_HZ[1]:g} Hz"
        )
    if deceleration_m_s2 is not None and not 0 < deceleration_m_s2 < math.inf:
        raise InputError(f"--deceleration {deceleration_m_s2:g}: expected an acceleration above 0 m/s2")
    place = out or folder / "loop"
    if (place / MARK).exists() and not (place / output.RUN).exists() and not unfinished(place):
        raise InputError(
            f"--out {place} was written by an earlier gtmodel, which kept no list of its files; move it away"
        )
    with output.held(place, job) as mine, TemporaryDirectory(prefix="gtmodel-loop-") as work:
        bench = prepare(folder, peer, seconds, law, LAWS, reference, in_lockstep, Path(work), mine, job)
        finished = _runs(bench, elastic_Hz, deceleration_m_s2)
        if finished.outcome.status is SolveStatus.INTERRUPTED:
            return finished
        finished = replace(finished, outcome=noted(finished.outcome, job))
        return _written(bench, finished, {"folder": str(folder), "seconds": seconds})


def _runs(bench: Bench, elastic_Hz: float | None, deceleration_m_s2: float | None) -> Finished:
    """Both runs, and what they say; their logs are in the folder of the work."""
    job, law, peer = bench.context, bench.law, bench.peer
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
    for name, one in zip(("off", "on"), runs, strict=True):
        log = trajectory_of(one.log, 3, 1e-3 * CYCLE_MS, title=f"{bench.peer}, {one.label}: log of the loop")
        log.to_csv(bench.place / f"loop_{name}.csv")
    return Finished(outcome, time.monotonic() - job.began)


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
    log.unlink(missing_ok=True)  # of an attempt that is made again
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
        checks[f"{name}_running_at_the_end"] = at_least(float(running), 1.0, f"{one.label}: {state}, {why}")
        checks[f"{name}_log_complete"] = at_least(float(bool(one.report["log_complete"])), 1.0, FULL)
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
        rows=[*rows_of(runs, errors, bench.in_lockstep), *stopping(stop)],
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


def _figure(bench: Bench, runs: list[OneRun]) -> Any:
    from gtmodel.plot.tracking import tracking_figure

    time_s = 1e-3 * CYCLE_MS * np.arange(bench.cycles)
    wanted = Trajectory(time_s, {"T": bench.tcp_m, "q": bench.carts_m}, {"T": "m", "q": "m"})
    measured = {
        one.label: Trajectory(time_s[: len(one.tcp_m)], {"T": one.tcp_m, "q": one.carts_m}, {"T": "m", "q": "m"})
        for one in runs
    }
    return tracking_figure(wanted, measured, f"{bench.peer.upper()} on loopback, {bench.law}: simulated controller")


def _written(bench: Bench, finished: Finished, inputs: dict[str, Any]) -> Finished:
    """All files of the work, the picture and the summary in the folder, or why they are not."""
    outcome, wall_s = finished.outcome, finished.wall_s
    files: dict[str, bytes] = {}
    faults = output.pictured(outcome, files)
    if bench.peer == "rsi":
        files["rsi_configuration.xml"] = rsi_configuration("127.0.0.1", 49152).encode()
    summary = report.summary(bench.context.name, "loop", outcome, 0.0)
    files[MARK] = (json.dumps(summary, indent=1) + "\n").encode()
    files |= {path.name: path.read_bytes() for path in sorted(bench.place.iterdir())}
    inputs |= {"peer": bench.peer, "law": bench.law, "lockstep": bench.in_lockstep}
    try:
        output.put(bench.held, files, lambda files: output.record(inputs, wall_s, files), programs=(PROGRAM,))
    except InputError as error:
        return replace(finished, unwritten=str(error))
    shown = ("tracking.png", "loop_off.csv", "loop_on.csv", MARK)
    return replace(finished, files=[bench.held.path / n for n in shown if n in files], unwritten="; ".join(faults))
