"""``gtmodel loop``: run the loop of a generated folder, whose manifest contains its problem, and write the result."""

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

from .problem_files import run as output
from .problem_files.base import Context, InputError
from .problem_files.files import parse
from .problem_files.from_options import key_of, options_of
from .problem_files.load import load, validate
from .problem_files.noted import noted
from .problem_files.registry import get
from .problem_files.run import Finished, answer

MARK = "loop.json"
REFERENCE = "reference.csv"
_PROBLEM = "l1_min_time.toml"
_ROBOT_KEYS = {"robot", "inertia", "payload_kg", "parameters", "friction"}
# names of the study's arguments in messages of the command
_OPTIONS = {name: f"--{name}" for name in ("peer", "law", "plant", "seconds", "elastic", "deceleration", "following")}
_OPTIONS |= {"reference": "the reference", "timeout": "--plant-timeout"}


def run(
    folder: Path, out: Path, job: Context, *, reference: Path | None = None, plant: Path | None = None,
    plant_timeout: float | None = None, **arguments: Any,
) -> Finished:  # fmt: skip
    """Run `gtmodel.loop.study` with the robot of a generated folder and write the result into `out`.

    Args:
        folder: folder written by gtmodel codegen.
        out: folder for sources, logs and the picture. It changes only at the end, when all files are written or none;
            no other run may write there in the meantime.
        reference: CSV file of the motion; the time-optimal motion of l1_min_time if None.
        plant, plant_timeout: FMU and time limit of its calls [s]; None: those of the problem's table [plant].
        arguments: further arguments of the study.

    Raises InputError with one sentence.
    """
    try:
        for name, hint in get_type_hints(study, include_extras=True).items():
            if name in arguments:  # before the folders, so that a typing error costs no time
                agree(arguments[name], hint, name)
    except ArgumentError as error:
        raise _by_option(error) from error
    if reference is not None and not reference.is_file():
        raise InputError(f"--reference {reference}: there is no such file")
    if (out / MARK).exists() and not (out / written.RUN).exists() and not unfinished(out):
        raise InputError(
            f"--out {out} was written by an earlier gtmodel, which stored no list of its files; move it away"
        )
    with output.held(out, job) as target:
        generated: dict[str, bytes] = {}
        try:
            manifest = manifest_of(folder)
            for name in manifest["files"]:
                if name.endswith((".c", ".h")) and _warned(folder / name, job):
                    break
            if not manifest["problem"]:
                raise InputError(f"'{folder}' does not name its problem; generate it with gtmodel codegen")
            problem: Any = validate(get("codegen").Schema, manifest["problem"])
            job.folder = folder  # paths in the manifest start there
            robot = problem.model(job)
            motion = partial(_motion, problem, robot, reference, job, generated)
            unit = problem.plant_unit(folder, plant, plant_timeout)
            options = options_of(problem, "lead_through", "disturbances") | {"plant": unit}
            with job.under_way():
                result = study(robot, folder, motion, built=target.path, **options, **arguments, **job.work())
        except ArgumentError as error:
            raise _by_option(error) from error
        if result.status is SolveStatus.INTERRUPTED:
            return Finished(result, time.monotonic() - job.began)
        wall_s = time.monotonic() - job.began
        result = noted(result.with_(files=generated | dict(result.files)), job)
        inputs = {"folder": str(folder), "seconds": arguments["seconds"], "peer": arguments["peer"]}
        return _written(
            target, result, job, wall_s, inputs | {"law": arguments["law"], "lockstep": arguments["in_lockstep"]}
        )


def _by_option(error: ArgumentError) -> InputError:
    """The study's error about an argument as an error about the option of the command."""
    where = f"{key_of(get('codegen').Schema, error.argument, {})}:" if "." in error.argument else ""
    return InputError(f"{_OPTIONS.get(error.argument, where)} {error.message}".lstrip())


def _warned(path: Path, job: Context) -> bool:
    """True for a file that --write-failed marked: the loop may run it in simulation, with a warning."""
    if not is_marked(path):
        return False
    job.distrust(path)
    return True


def _motion(problem: Any, robot: Any, path: Path | None, job: Context, files: dict[str, bytes]) -> Trajectory:
    """The reference motion from a file, or the time-optimal motion for this robot of the shipped problem, which is also
    stored in `files`."""
    if path is not None:
        _warned(path, job)
        return Trajectory.from_csv(path)
    if hasattr(robot, "structure"):  # a serial arm
        raise InputError(
            "--reference is missing: name a motion of the joints, such as reference.csv of an arm_trajectory"
        )
    job.progress("solving for the time-optimal motion")
    shipped = load(problems_dir() / _PROBLEM)
    robot_keys = problem.model_dump(mode="json", include=_ROBOT_KEYS, exclude_unset=True)
    data = {key: value for key, value in parse(shipped.content).items() if key not in _ROBOT_KEYS} | robot_keys
    solved = answer(replace(shipped, problem=validate(shipped.kind.Schema, data)), job)
    if not solved.status.ok:
        raise InputError(f"found no time-optimal motion for this robot ({solved.message}); name one with --reference")
    files[REFERENCE] = str(solved.files[REFERENCE]).encode()
    with scratch() as folder:
        file = folder / REFERENCE
        file.write_bytes(files[REFERENCE])
        return Trajectory.from_csv(file)


def _written(folder: Held, result: Study, job: Context, wall_s: float, inputs: dict[str, Any]) -> Finished:
    """Write all files of the study, the picture and the summary, or return why they are not written."""
    files: dict[str, bytes] = {}
    faults = written.pictured(result, files)
    summary = as_json.summary(job.name, "loop", result, 0.0)
    files[MARK] = (json.dumps(summary, indent=1) + "\n").encode()
    files |= {name: content.encode() if isinstance(content, str) else content for name, content in result.files.items()}
    try:
        with output.about_out():
            written.put(folder, files, lambda files: written.record(inputs, wall_s, files), programs=(PROGRAM,))
    except InputError as error:
        return Finished(result, wall_s, unwritten=str(error))
    shown = ("tracking.png", "loop_off.csv", "loop_on.csv", MARK)
    return Finished(result, wall_s, [folder.path / n for n in shown if n in files], unwritten="; ".join(faults))
