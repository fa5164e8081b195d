"""``gtmodel view``: the page of a robot, or of what a result folder has in space."""

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
from gtmodel.results.read_bounds import json_of, toml_of
from gtmodel.results.study import cautioned
from gtmodel.view.space import ENDINGS

SUFFIX = ".html"


def write(what: str, out: Path | None, time: float | None, context: Context) -> Path:
    """Write the page of a robot, by its reference, of a result folder or of a scene in it; return its path. Raises
    InputError."""
    place = Path(what).parent if Path(what).name in (written.RESULT, written.RUN) else Path(what)
    is_result, is_scene = (place / written.RESULT).is_file(), what.endswith(written.SCENE)
    file, _, inner = place.name.partition(":")
    name = inner if python_models.is_reference(what) else Path(file).stem
    if not (is_result or is_scene) and place.is_dir():
        raise InputError(f"is a folder without {written.RESULT}; gtmodel solve PROBLEM --out DIR writes one", file=what)
    if is_result or is_scene:
        name = place.resolve().name.removesuffix(written.SCENE)
    target = out or Path(f"{name}{SUFFIX}")
    if target.suffix not in ENDINGS:
        known = ", ".join(f"{suffix} for {what}" for suffix, what in ENDINGS.items())
        raise InputError(f"-o {target} ends in none of {known}")
    if time is not None and target.suffix != ".png":
        raise InputError("--at belongs to a picture: -o FILE.png; a page begins at #SECONDS behind its address")
    refuse_another(target, "-o")
    try:
        if is_scene:
            scene = _read(place)
        elif is_result:
            scene = _of_result(place, context)
        else:
            scene = view.scene(_robot(what, context), title=name)
        return scene.write(target, time=time)
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


def _read(file: Path) -> view.RobotScene:
    """The scene in a file that gtmodel wrote. Raises InputError and ArgumentError."""
    try:
        data = json_of(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if isinstance(data, dict) and "fault" in data:
        raise InputError(f"{file} holds no scene, it could not be drawn: {data['fault']}")
    return view.RobotScene.of(data)


def _of_result(folder: Path, context: Context) -> view.RobotScene:
    first, *others = [*sorted(folder.glob(f"*{written.SCENE}")), None]
    if first is not None:
        for other in filter(None, others):
            context.notice(f"there is more to see: gtmodel view {shlex.quote(str(other))}")
        return _read(first)
    try:
        run = toml_of((folder / written.RUN).read_text(encoding="utf-8"))
        problem: Any = validate(get(run["problem"]["kind"]).Schema, run["problem"])
        context.folder = Path(run["input"]["problem"]).parent
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{folder / written.RUN} does not say which problem was solved; solve it again") from error
    stored, kind = reading.read(folder), run["problem"]["kind"]
    motion = stored.trajectory
    robot = _model(problem, kind, context) if motion is not None else None
    report = "gtmodel solve --report shows what this result has"
    if robot is None or motion is None:
        raise InputError(f"'{kind}' has nothing in space; {report}")
    force = getattr(getattr(problem, "limits", None), "force_N", None)
    limits = {} if force is None else {"tau": (-force, force)}
    try:
        scene = view.scene(robot, motion, limits=limits, title=problem.title or motion.title)
        return cautioned(scene, stored.status)
    except ArgumentError as error:
        raise InputError(f"'{kind}' has nothing in space: {error.message}; {report}") from error


def _model(problem: Any, kind: str, context: Context) -> Model | None:
    """The model of a problem: its robot, or the first argument of its study."""
    if callable(getattr(problem, "model", None)):
        return problem.model(context)
    call = getattr(get(kind), "call", None)
    first = call(problem, context).arguments[:1] if call else []
    return first[0] if first and isinstance(first[0], Model) else None
