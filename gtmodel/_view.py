"""``gtmodel view``: the page of a robot, or of the motion in a result folder."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from gtmodel import view
from gtmodel._report import refuse_another
from gtmodel.lang import Model
from gtmodel.problem_files import python_models, robots
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.explaining import is_problem
from gtmodel.problem_files.files import find
from gtmodel.problem_files.load import validate
from gtmodel.problem_files.registry import get
from gtmodel.results import ArgumentError, reading, written
from gtmodel.results.read_bounds import toml_of

SUFFIX, GIF = ".html", ".gif"


def write(what: str, out: Path | None, context: Context) -> Path:
    """Write the page of a robot, by its reference, or of a result folder; return its path. Raises InputError."""
    place = Path(what).parent if Path(what).name in (written.RESULT, written.RUN) else Path(what)
    is_result = (place / written.RESULT).is_file()
    file, _, inner = place.name.partition(":")
    name = place.resolve().name if is_result else inner if python_models.is_reference(what) else Path(file).stem
    target = out or Path(f"{name}{SUFFIX}")
    if target.suffix not in (SUFFIX, GIF):
        raise InputError(f"-o {target} ends neither in {SUFFIX}, for a page, nor in {GIF}, for an animated picture")
    refuse_another(target, "-o")
    try:
        scene = _of_result(place, context) if is_result else view.scene(_robot(what, context), title=name)
        return scene.write(target)
    except ArgumentError as error:
        raise InputError(error.message) from error


def _robot(what: str, context: Context) -> Model:
    try:
        return robots.resolve(what, context)
    except InputError as error:
        if not is_problem(what):
            raise
        find(what)  # raises InputError if there is no such file
        command = shlex.join(["gtmodel", "solve", what, "--out", "DIR"])
        raise InputError(f"is a problem; {command}, then gtmodel view DIR, shows its motion", file=what) from error


def _of_result(folder: Path, context: Context) -> view.RobotScene:
    try:
        run = toml_of((folder / written.RUN).read_text(encoding="utf-8"))
        problem: Any = validate(get(run["problem"]["kind"]).Schema, run["problem"])
        context.folder = Path(run["input"]["problem"]).parent
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{folder / written.RUN} does not say which problem was solved; solve it again") from error
    motion = reading.read(folder).trajectory
    if motion is None or not callable(getattr(problem, "model", None)):
        kind = run["problem"]["kind"]
        raise InputError(f"'{kind}' has no motion of a robot; gtmodel solve --report shows what this result has")
    force = getattr(getattr(problem, "limits", None), "force_N", None)
    limits = {} if force is None else {"tau": (-force, force)}
    return view.scene(problem.model(context), motion, limits=limits, title=problem.title or motion.title)
