"""``gtmodel view``: the page of a robot, or of what a result folder has in space."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from gtmodel import view
from gtmodel._report import refuse_another
from gtmodel.lang import Model
from gtmodel.problem_files import python_models, robots
from gtmodel.problem_files.base import Context, InputError, earlier_result
from gtmodel.problem_files.explaining import is_problem
from gtmodel.problem_files.files import find
from gtmodel.problem_files.load import validate
from gtmodel.problem_files.noted import noted
from gtmodel.problem_files.registry import get
from gtmodel.results import ArgumentError, Study, reading, written
from gtmodel.results.as_json import result
from gtmodel.results.read_bounds import json_of, toml_of
from gtmodel.results.reading import document
from gtmodel.results.study import cautioned
from gtmodel.view.space import ENDINGS

SUFFIX = ".html"


def write(what: str, out: Path | None, time: float | None, context: Context) -> Path:
    """Write the page of a robot, by its reference, of a result folder, or of a scene of it, FOLDER/SCENE; return its
    path. Raises InputError."""
    place = Path(what).parent if Path(what).name in (written.RESULT, written.RUN) else Path(what)
    is_result = (place / written.RESULT).is_file()
    is_scene = not is_result and (place.name.endswith(written.SCENE) or _inside_a_result(place))
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
        if is_scene and place.is_file():
            scene = _read(place)
        elif is_result or is_scene:
            scene = _of_result(*((place, "") if is_result else (place.parent, name)), context)
        else:
            scene = view.scene(_robot(what, context), title=name)
        return scene.write(target, time=time)
    except ArgumentError as error:
        raise InputError(error.message) from error


def _inside_a_result(place: Path) -> bool:
    """True for FOLDER/SCENE of a result folder; there may be no such file. Robots are names, files and FILE:CLASS."""
    return (
        len(place.parts) > 1
        and not place.exists()
        and ":" not in place.name
        and (place.parent / written.RESULT).is_file()
    )


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


def _of_result(folder: Path, name: str, context: Context) -> view.RobotScene:
    """The scene of that name in a result folder, the first if left out. Raises InputError and ArgumentError."""
    unsaid = f"{folder / written.RUN} does not say which problem was solved; solve it again, with --plot (plot=True)"
    try:
        run = toml_of((folder / written.RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(unsaid) from error
    kept = {p.name.removesuffix(written.SCENE): p for p in sorted(folder.glob(f"*{written.SCENE}"))}
    names = [*(run.get("scenes") or kept)]
    if name and name not in names:
        raise InputError(f"has no scene '{name}'; there are {', '.join(names) or 'none'}", file=str(folder))
    for other in names[1:] if not name else ():
        context.notice(f"there is more to see: gtmodel view {shlex.quote(str(folder / other))}")
    chosen = name or next(iter(names), "")
    if chosen in kept:
        return _read(kept[chosen])
    try:
        problem: Any = validate(get(run["problem"]["kind"]).Schema, run["problem"])
        context.folder = Path(run["input"]["problem"]).parent
        kind, start = run["problem"]["kind"], run["input"].get("start")
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(unsaid) from error
    stored = reading.read(folder)
    if names:
        context.start = earlier_result(Path(start), kind) if start else None
        return _again(problem, stored, context).view(chosen)
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


def _again(problem: Any, stored: Study, context: Context) -> Study:
    """The study of a result whose scenes were not kept: solved again, which gives the same values, or InputError."""
    context.notice("the folder keeps no scenes, as with --plot; solving again")
    study = noted(get(problem.kind).call(problem, context)(**context.work()), context)
    again = document(result("", None, study))["values"]
    if again != stored.values or study.status is not stored.status:
        raise InputError("its files were changed since, or the run was stopped early; solve it again, with --plot")
    return study


def _model(problem: Any, kind: str, context: Context) -> Model | None:
    """The model of a problem: its robot, or the first argument of its study."""
    if callable(getattr(problem, "model", None)):
        return problem.model(context)
    call = getattr(get(kind), "call", None)
    first = call(problem, context).arguments[:1] if call else []
    return first[0] if first and isinstance(first[0], Model) else None
