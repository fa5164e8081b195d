"""What a demonstration of the loop needs: the robot, the reference and the program, from a generated folder."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from gtmodel._files import problems_dir
from gtmodel.cgen import GenerationError
from gtmodel.compiler.causal import CausalFunction, compile_causal
from gtmodel.lang import Model
from gtmodel.loop import Table
from gtmodel.loop.build import build, built_before, manifest_of
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.load import parse, read, validate
from gtmodel.results import Trajectory
from gtmodel.results.folder import Held
from gtmodel.results.marks import is_marked

from . import trajectory
from .codegen import keys as codegen
from .loop_motion import CYCLE_MS, there_and_back

Peer = Literal["egm", "rsi"]
MARK = "loop.json"
LONGEST_S = 3600.0
# path correction integrates, which is slow beside a time-optimal motion
SLOWER = {"path": 10.0}
_ROBOT_KEYS = {"robot", "inertia", "payload_kg", "parameters", "friction"}


@dataclass
class Bench:
    """What all runs of a command share; the reference has a row per cycle, see `there_and_back`.

    place: the folder of the work, this user's alone; held: where all of it is written to at the end.
    """

    peer: Peer
    law: str
    robot: Model
    program: Path
    place: Path
    held: Held
    reference: Table
    cycles: int
    in_lockstep: bool
    context: Context
    forward: CausalFunction

    @property
    def carts_m(self) -> np.ndarray:
        """Reference of the carts (cycles, 3) [m]."""
        return self.reference.rows[: self.cycles, :3]

    @property
    def tcp_m(self) -> np.ndarray:
        """Reference of the tool centre point (cycles, 3) [m]."""
        return self.reference.rows[: self.cycles, 9:12]


def prepare(
    folder: Path,
    peer: str,
    seconds: float,
    law: str,
    laws: Mapping[str, Any],
    motion: Path | None,
    in_lockstep: bool,
    place: Path,
    held: Held,
    job: Context,
) -> Bench:
    """Check what was asked for, build the program, make the reference. Raises InputError, one sentence."""
    if peer not in ("egm", "rsi"):
        raise InputError(f"--peer {peer}: expected egm or rsi")
    if law not in laws:
        raise InputError(f"--law {law}: expected {', '.join(laws)}")
    if not 0 < seconds <= LONGEST_S or not math.isfinite(seconds):
        raise InputError(f"--seconds {seconds:g}: expected a time above 0 and up to {LONGEST_S:g} s")
    if motion is not None and not motion.is_file():
        raise InputError(f"--reference {motion}: there is no such file")
    try:
        content = manifest_of(folder)
        _warn([folder / name for name in content["files"] if name.endswith((".c", ".h"))], job)
        if not content["problem"]:
            raise InputError(f"'{folder}' does not say which problem it was made from; make it with gtmodel codegen")
        problem = validate(codegen.Schema, content["problem"])
        robot = problem.model(job)
        forward = compile_causal(robot, known="q", targets="T")
        if [s.shape for s in (*forward.inputs, *forward.outputs)] != [(3,), (3,)]:
            raise InputError("the loop's simulated robots have three carts and a position T; this folder's has not")
        job.progress("building the loop")
        built_before(held.path, place)
        program = build(folder, place, 3)
    except GenerationError as error:
        raise InputError(str(error)) from error
    cycles = max(1, round(1000 * seconds / CYCLE_MS))
    table = there_and_back(robot, _motion(problem, motion, place, job), cycles, SLOWER.get(law, 1.0))
    (place / "reference.table").write_bytes(table.to_bytes())
    return Bench(cast("Peer", peer), law, robot, program, place, held, table, cycles, in_lockstep, job, forward)


def _warn(paths: Iterable[Path], job: Context) -> None:
    """What --write-failed wrote may be tried against a simulated controller, but not without a word: the first."""
    bad = next((path for path in paths if is_marked(path)), None)
    if bad is not None:
        job.distrust(bad)


def _motion(problem: codegen.Schema, path: Path | None, place: Path, job: Context) -> Trajectory:
    """The reference motion from a file, or the time-optimal one of the shipped problem for this robot."""
    if path is not None:
        _warn([path], job)
        return Trajectory.from_csv(path)
    job.progress("solving for the time-optimal motion")
    data = parse(read(problems_dir() / "l1_min_time.toml"))
    own = problem.model_dump(mode="json", include=_ROBOT_KEYS, exclude_unset=True)
    wanted = {key: value for key, value in data.items() if key not in _ROBOT_KEYS} | own
    solved = trajectory.solve(validate(trajectory.Schema, wanted), job)
    if not solved.status.ok:
        raise InputError(f"there is no time-optimal motion for this robot ({solved.message}); give one by --reference")
    found = place / "reference.csv"
    found.write_text(str(solved.files["reference.csv"]), encoding="utf-8")
    return Trajectory.from_csv(found)
