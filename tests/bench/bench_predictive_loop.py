"""The law "predictive" of the loop on the L1 in C, over EGM, where something changes on the way: a goal moves, a wall
comes closer, the motors' force drops to half, a goal is out of reach.

The model is problems/models/l1_cell.py. The robot is synthetic: a plate 20 % heavier than the model knows, two cycles
of delay, encoder noise of 10 um (seed 1), an unknown force that drifts by 20 N/s, and motors that saturate.

Run: python tests/bench/bench_predictive_loop.py
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import gtmodel as gt
from gtmodel._files import problems_dir
from gtmodel.cgen import generate
from gtmodel.loop import (
    DisturbedPlant,
    LoopProcess,
    ReferenceTable,
    RigidBodyPlant,
    RobotSide,
    Servo,
    build,
    lockstep,
)
from gtmodel.loop.process import COLUMNS, STATES, rows_of
from gtmodel.predictive import AxisServo, ControlHorizon, Controller, Measurement

START, FIRST, SECOND, FORCE = [0.0, -0.9, 0.1], [0.5, -0.9, 0.3], [0.8, -0.9, 0.4], 700.0
HEAVIER, NOISE, DRIFT, SERVO = 0.2 * 9.13, 1e-5, 20.0, Servo()
AT, CYCLES = 70, 750  # cycle of a change, cycles of a run: 3 s
WALL_M_S = 0.2  # speed of the wall, which a plan does not know: it takes the wall to stand
NEAR_M, WALL_M = 1e-4, 5e-3  # of the goal at the end; how far the wall may come past the tool
STILL_M = 1e-5  # of the tool in a cycle
MARGIN = 1.45  # forces that the servo may ask for, over their limit


def controller(stages: int = 40) -> Controller:
    """The controller of the cell."""
    sys.path.insert(0, str(problems_dir() / "models"))
    from l1_cell import Cell

    return gt.predictive.controller(
        Cell(),
        ControlHorizon(period=0.004, stages=stages, length=0.01, delay=2, max_iterations=60),
        references=["goal", "force_limit", "wall"],
        limits={"robot.tau": (-FORCE, FORCE), "load": (-1.0, 1.0), "room": (0.0, np.inf)},
        prices={"room": (1e5, 1e5)},
        measured={"robot.q": Measurement(deviation=NOISE, jump=0.02)},
        disturbance={"robot.tau": 100.0},
        servo=AxisServo(SERVO.kp_N_m, SERVO.kd_N_s_m),
    )


@dataclass(frozen=True)
class Scene:
    """Goals, force limit and wall in each cycle; the motors' own limits (time, force)."""

    name: str
    rows: np.ndarray
    motors: Sequence[tuple[float, float]] = ((0.0, FORCE),)


def scenes() -> list[Scene]:
    """All scenes; each begins at the start and goes to the first goal."""
    plain = np.tile([*FIRST, FORCE, 2.0], (CYCLES, 1))
    plain[:25, :3] = START
    moved, wall, half = plain.copy(), plain.copy(), plain.copy()
    moved[AT:, :3] = [0.2, -0.85, 0.25]
    moved[2 * AT :, :3] = SECOND
    wall[25:, :3] = SECOND
    wall[:, 4] = np.clip(0.9 - WALL_M_S * (np.arange(CYCLES) - 300) * 0.004, 0.6, 1.0)
    half[AT:, 3] = FORCE / 2
    drop = [(0.0, FORCE), (0.004 * AT, FORCE / 2)]
    return [
        Scene("one goal", plain), Scene("the goal is moved twice", moved), Scene("a wall comes closer", wall),
        Scene("half of the force", half, drop),
    ]  # fmt: skip


def out_of_reach() -> Scene:
    """A goal that the arms cannot reach, from the first goal on."""
    rows = scenes()[0].rows
    rows[100:, 1] = -5.0
    return Scene("a goal out of reach", rows)


@dataclass(frozen=True)
class Outcome:
    """One run: tool centre point and planned forces (cycles, 3), forces asked for (cycles, substeps, 3), log."""

    scene: Scene
    T: np.ndarray
    planned: np.ndarray
    asked: np.ndarray
    log: np.ndarray
    report: dict

    @property
    def settled_s(self) -> float:
        """Time after which the tool stays within a millimetre of where it ends."""
        away = np.flatnonzero(np.linalg.norm(self.T - self.T[-1], axis=1) > 1e-3)
        return 0.004 * float(away[-1] + 1 if len(away) else 0)

    @property
    def error_m(self) -> float:
        """Distance to the last goal, or to its nearest point in front of the wall, as a mean over the last 0.1 s."""
        goal = self.scene.rows[-1, :3].copy()
        goal[0] = min(goal[0], self.scene.rows[-1, 4])
        return float(np.linalg.norm(np.mean(self.T[-25:], axis=0) - goal))

    @property
    def beyond(self) -> float:
        """Share of the forces asked for beyond the limit of their cycle, which acts two cycles later."""
        limit = np.concatenate([self.scene.rows[:2, 3], self.scene.rows[:-2, 3]])[2:]
        return float(np.mean(np.abs(self.asked) > limit[: len(self.asked), None, None]))

    @property
    def behind_wall_m(self) -> float:
        """How far the tool passes the wall."""
        return float((self.T[:, 0] - self.scene.rows[:, 4]).max())


class Cell:
    """The loop, built in `place`, with a synthetic robot."""

    def __init__(self, place: Path, law: Controller) -> None:
        generate({"law": law}, place / "generated", name="cell")
        self.place, self.program = place, build(place / "generated", place / "loop", 3)
        robot = gt.robots.gantry_tau("l1_tape", inertia="model_2", payload=HEAVIER)
        self.forward = robot.causal("tau", "der(T,2)", prefer="T")
        self.velocity, self.fk = robot.causal("T", ["q", "der(q)"]), robot.causal("q", "T")

    def run(self, scene: Scene, peer: str = "egm") -> Outcome:
        """Run one scene in lock step."""
        table, log = self.place / "goals.table", self.place / "loop.log"
        table.write_bytes(ReferenceTable(scene.rows).to_bytes())
        log.unlink(missing_ok=True)
        words = f"--peer {peer} --law predictive --lockstep --live --step 0.1 "
        words += f"--idle-ms 9000 --deceleration 20 --cycles {len(scene.rows)}"
        plant = DisturbedPlant(
            RigidBodyPlant(self.forward, self.velocity, START, SERVO), delay=2, noise=NOISE, seed=1,
            drift=DRIFT / float(np.max(SERVO.kp_N_m)), limits=scene.motors,
        )  # fmt: skip
        options = [*words.split(), "--reference", str(table), "--log", str(log)]
        with LoopProcess(self.program, options) as process:
            run = lockstep(RobotSide(peer, plant), process.exchange, len(scene.rows))  # type: ignore[arg-type]
            report = process.finish()
        rows, first = rows_of(log.read_bytes()), COLUMNS.index("force[0]")
        T, status = self.fk(run.arm_m)
        assert not np.any(status)
        return Outcome(scene, T, rows[:, first : first + 3], np.array(plant.forces_N), rows, report)


def main() -> int:
    """Print the table; return 1 if a bound does not hold."""
    with tempfile.TemporaryDirectory() as name:
        cell = Cell(Path(name), controller())
        outcomes = [cell.run(scene) for scene in scenes()]
        lost = cell.run(out_of_reach())
    heads = ("settled", "error", "planned", "asked", "beyond", "past wall", "iterations: mean, most", "unsolved")
    print(" " * 24, *heads, sep="  ")
    faults = 0
    for one in outcomes:
        iterations = one.log[:, COLUMNS.index("iterations")]
        limit = one.scene.rows[-1, 3]
        print(
            f"{one.scene.name:24} {one.settled_s:6.2f} s {1e3 * one.error_m:6.3f} mm "
            f"{np.abs(one.planned).max():7.1f} N {np.abs(one.asked).max():6.0f} N {100 * one.beyond:5.1f} % "
            f"{1e3 * max(0.0, one.behind_wall_m):6.2f} mm {iterations.mean():6.1f} {iterations.max():5.0f} "
            f"{one.report['plan_failed']:8.0f}"
        )
        good = one.error_m < NEAR_M and np.abs(one.planned).max() <= FORCE and one.behind_wall_m < WALL_M
        good &= STATES[one.report["state"]] == "running" and np.abs(one.asked[2 * AT :]).max() < MARGIN * limit
        faults += not good
    stopped = STATES[lost.report["state"]] == "stopped" and np.abs(np.diff(lost.T[-20:], axis=0)).max() < STILL_M
    ended, unsolved = STATES[lost.report["state"]], lost.report["plan_failed"]
    print(f"a goal out of reach: {ended} after {unsolved} cycles without a solution")
    return int(faults > 0 or not stopped or np.abs(lost.planned).max() > FORCE)


if __name__ == "__main__":
    sys.exit(main())
