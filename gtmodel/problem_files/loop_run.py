"""``gtmodel loop``: from a generated folder, whose manifest holds its problem, to the study and its folder."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, get_type_hints

from gtmodel._files import problems_dir
from gtmodel.loop import study
from gtmodel.loop.build import PROGRAM, manifest_of
from gtmodel.results import ArgumentError, SolveStatus, Study, Trajectory, as_json, written
from gtmodel.results.agreement import agree
from gtmodel.results.disk import is_marked, scratch
from gtmodel.results.folder import Held, unfinished

from . import run as output
from .base import Context, InputError
from .files import parse
from .from_options import options_of
from .load import load, validate
from .noted import noted
from .registry import get
from .run import Finished, answer

MARK = "loop.json"
REFERENCE = "reference.csv"
_PROBLEM = "l1_min_time.toml"
_ROBOT_KEYS = {"robot", "inertia", "payload_kg", "parameters", "friction"}
# how an argument of the study is called in a sentence of the command
_SAID = {name: f"--{name}" for name in ("peer", "law", "plant", "seconds", "elastic", "deceleration", "following")}
_SAID |= {"reference": "the reference", "timeout": "--plant-timeout"}


def run(
    folder: Path, out: Path, job: Context, *, reference: Path | None = None, plant: Path | None = None,
    plant_timeout: float | None = None, **asked: Any,
) -> Finished:  # fmt: skip
    """`gtmodel.loop.study` with the robot of a generated folder, written into `out`.

    Args:
        folder: of gtmodel codegen.
        out: for the loop's sources, logs and the picture. Nothing changes in it before the end, when all files are
            written or none; no other run may write there meanwhile.
        reference: CSV of the motion; the time-optimal one of l1_min_time if None.
        plant, plant_timeout: unit of the problem's table [plant], its longest call [s]; what the table says if None.
        asked: further arguments of the study.

    Raises InputError, one sentence.
    """
    try:
        for name, hint in get_type_hints(study, include_extras=True).items():
            if name in asked:  # before the folders: a slip of the pen costs nothing
                agree(asked[name], hint, name)
    except ArgumentError as error:
        raise _by_option(error) from error
    if reference is not None and not reference.is_file():
        raise InputError(f"--reference {reference}: there is no such file")
    if (out / MARK).exists() and not (out / written.RUN).exists() and not unfinished(out):
        raise InputError(
            f"--out {out} was written by an earlier gtmodel, which kept no list of its files; move it away"
        )
    with output.held(out, job) as mine:
        made: dict[str, bytes] = {}
        try:
            content = manifest_of(folder)
            for name in content["files"]:
                if name.endswith((".c", ".h")) and _warned(folder / name, job):
                    break
            if not content["problem"]:
                raise InputError(f"'{folder}' does not say which problem it is of; make it with gtmodel codegen")
            problem = validate(get("codegen").Schema, content["problem"])
            robot = problem.model(job)  # pyright: ignore[reportAttributeAccessIssue]
            motion = partial(_motion, problem, reference, job, made)
            unit = problem.plant_unit(folder, plant, plant_timeout)  # pyright: ignore[reportAttributeAccessIssue]
            declared = options_of(problem, "lead_through") | {"plant": unit}
            with job.under_way():
                result = study(robot, folder, motion, built=mine.path, **declared, **asked, **job.work())
        except ArgumentError as error:
            raise _by_option(error) from error
        if result.status is SolveStatus.INTERRUPTED:
            return Finished(result, time.monotonic() - job.began)
        wall_s = time.monotonic() - job.began
        result = noted(result.with_(files=made | dict(result.files)), job)
        inputs = {"folder": str(folder), "seconds": asked["seconds"], "peer": asked["peer"]}
        return _written(mine, result, job, wall_s, inputs | {"law": asked["law"], "lockstep": asked["in_lockstep"]})


def _by_option(error: ArgumentError) -> InputError:
    """What the study says of an argument, by the option of the command that gave it."""
    where = error.argument if "." in error.argument else ""
    return InputError(f"{_SAID.get(error.argument, where)} {error.message}".lstrip())


def _warned(path: Path, job: Context) -> bool:
    """What --write-failed wrote may be tried against a simulated controller, but not without a word: the first."""
    if not is_marked(path):
        return False
    job.distrust(path)
    return True


def _motion(problem: Any, path: Path | None, job: Context, made: dict[str, bytes]) -> Trajectory:
    """The reference motion from a file, or the time-optimal one of the shipped problem for this robot, which is kept
    in `made`."""
    if path is not None:
        _warned(path, job)
        return Trajectory.from_csv(path)
    job.progress("solving for the time-optimal motion")
    shipped = load(problems_dir() / _PROBLEM)
    own = problem.model_dump(mode="json", include=_ROBOT_KEYS, exclude_unset=True)
    wanted = {key: value for key, value in parse(shipped.content).items() if key not in _ROBOT_KEYS} | own
    solved = answer(replace(shipped, problem=validate(shipped.kind.Schema, wanted)), job)
    if not solved.status.ok:
        raise InputError(f"there is no time-optimal motion for this robot ({solved.message}); give one by --reference")
    made[REFERENCE] = str(solved.files[REFERENCE]).encode()
    with scratch() as place:
        file = place / REFERENCE
        file.write_bytes(made[REFERENCE])
        return Trajectory.from_csv(file)


def _written(folder: Held, result: Study, job: Context, wall_s: float, inputs: dict[str, Any]) -> Finished:
    """All files of the study, the picture and the summary in the folder, or why they are not."""
    files: dict[str, bytes] = {}
    faults = written.pictured(result, files)
    summary = as_json.summary(job.name, "loop", result, 0.0)
    files[MARK] = (json.dumps(summary, indent=1) + "\n").encode()
    files |= {name: content.encode() if isinstance(content, str) else content for name, content in result.files.items()}
    try:
        with output.said_of_out():
            written.put(folder, files, lambda files: written.record(inputs, wall_s, files), programs=(PROGRAM,))
    except InputError as error:
        return Finished(result, wall_s, unwritten=str(error))
    shown = ("tracking.png", "loop_off.csv", "loop_on.csv", MARK)
    return Finished(result, wall_s, [folder.path / n for n in shown if n in files], unwritten="; ".join(faults))
