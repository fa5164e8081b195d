"""Robots by reference: a catalogue name, a TOML robot file, a URDF file, or a Model in Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gtmodel.calibrate.unknowns import merged
from gtmodel.lang import Model, ModelError
from gtmodel.robots import entries, names

from .._near import meant
from . import python_models
from .base import Context, InputError
from .files import parse, read

if TYPE_CHECKING:
    from gtmodel.robots import JointedMechanism, SerialArm

_WORDS = {
    "inertia": "inertia",
    "smoothing": "friction.smoothing",
    "velocity_scale": "friction.velocity_scale_m_s",
    "payload": "payload_kg",
}
# parameters that only the catalogue sets, and parameters that are options too
_OURS = {"name": "robot", "family": "robot"}
_BOTH = {"velocity_scale"}


def resolve(
    reference: str,
    context: Context,
    *,
    key: str = "robot",
    parameters: Mapping[str, Any] | None = None,
    inertia: str | None = None,
    smoothing: str | None = None,
    velocity_scale: float | None = None,
    payload: float | None = None,
    named_by: tuple[str, ...] = (),
) -> Model:
    """Return the model that a reference names.

    Args:
        reference: catalogue name ("l1_tape"), "robot.toml", "arm.urdf", "arm.urdf:tip" or "tree.urdf:*" (also .sdf,
            and .xml for MJCF), "package.module:Class" or "file.py:Class"; paths start at the problem's folder, then at
            the working directory.
        key: key of the reference in the file, for messages.
        parameters: values of the model's parameters by name.
        inertia, smoothing, velocity_scale [m/s], payload [kg]: options of robots of the catalogue and of robot files;
            None keeps the default.
        named_by: robot files that led to this reference, each naming the next.

    Raises InputError.
    """
    options = {"inertia": inertia, "smoothing": smoothing, "velocity_scale": velocity_scale, "payload": payload}
    given: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    if python_models.is_reference(reference):
        if given:
            first = next(iter(given))
            raise InputError(
                f"applies to robots of the catalogue and robot files only; '{reference}' is a model in Python: set it "
                "in [parameters]",
                _WORDS[first],
            )
        return python_models.resolve(reference, context, key, parameters)
    modifiers = dict(parameters or {})
    if python_models.is_arm_file(reference):
        _refuse_options(modifiers, given)
        arm = _from_description(reference, context, key, given, modifiers)
        context.models.append(arm)
        return arm
    name: str | None = None  # a robot file has the whole geometry
    if reference.endswith(".toml"):
        from .robot_file import is_python_robot  # here, as below: a robot of the catalogue needs no file

        data = _file(reference, context, key)
        if is_python_robot(data):
            return _calibrated(reference, data, context, key, given, modifiers, named_by)
        family, modifiers = _from_file(reference, data, context, key, modifiers)
    elif reference in names():
        name, family = reference, entries()[reference].family
    else:
        raise InputError(_unknown(reference), key)
    _refuse_options(modifiers, given)
    from gtmodel.robots import catalogue  # here: the keys of a kind need no robot

    try:
        model = catalogue.family_member(family, name, **given, **modifiers)
    except ModelError as error:
        at = _WORDS["inertia"] if "inertia model" in str(error) else "parameters" if parameters else key
        raise InputError(python_models.sentence_of(error), at) from error
    if parameters and family != "serial":
        from gtmodel.robots.plausible_lengths import implausible_model  # here: it knows the robots of six links

        if wrong := implausible_model(model):
            raise InputError(wrong[1], f"parameters.{wrong[0]}")
    context.models.append(model)
    return model


def _from_description(
    reference: str, context: Context, key: str, given: Mapping[str, Any], parameters: Mapping[str, Any]
) -> SerialArm | JointedMechanism:
    """The robot of a URDF, SDF or MJCF file, with notes about ignored elements. Raises InputError."""
    from gtmodel.robots import JointedMechanism
    from gtmodel.robots.from_file import robot_of

    ending = next(e for e in python_models.ARM_FILES if reference.endswith(e) or f"{e}:" in reference)
    form = python_models.ARM_FILES[ending]
    if "inertia" in given:
        raise InputError(f"applies to three-link robots only; an arm's {form} file contains its masses", "inertia")
    name, _, tip = reference.partition(ending)
    path = context.file(f"{name}{ending}", key, "robot", f"{form} file")
    try:
        robot = robot_of(path, tip.removeprefix(":") or None, **given, **parameters)
    except ModelError as error:
        at = "parameters" if "no declaration" in str(error) else key
        raise InputError(python_models.sentence_of(error), at) from error
    for note in robot.graph.notes if isinstance(robot, JointedMechanism) else robot.structure.notes:
        context.note(f"{path.name}: {note}")
    return robot


def _refuse_options(parameters: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Raises InputError if [parameters] names something that has a key of its own, or sets it a second time."""
    for name, word in (_WORDS | _OURS).items():
        if name not in parameters:
            continue
        if name in given:
            raise InputError(f"is set by {word} too; leave one of the two out", f"parameters.{name}")
        if name not in _BOTH:
            raise InputError(f"is not a parameter of a robot; use the key {word}", f"parameters.{name}")


def _file(reference: str, context: Context, key: str) -> dict[str, Any]:
    path = context.file(reference, key, "robot", "robot file")
    try:
        return parse(read(path))
    except InputError as error:
        inside = error.within(reference)
        raise (InputError(str(inside), key) if key else inside) from error


def _calibrated(
    reference: str, data: Mapping[str, Any], context: Context, key: str, given: dict[str, Any],
    modifiers: dict[str, Any], named_by: tuple[str, ...],
) -> Model:  # fmt: skip
    """Another robot with the parameters of a file, as a calibration writes it. Raises InputError."""
    parameters = data.get("parameters", {})
    if not isinstance(parameters, dict):
        raise InputError(f"expected a table [parameters] in '{reference}'; found {type(parameters).__name__}", key)
    if given and python_models.is_reference(data["robot"]):
        raise InputError(f"applies to robots of the catalogue and their files only; '{reference}' is a model in Python",
                         _WORDS[next(iter(given))])  # fmt: skip
    path = context.find(reference)
    place = str(path.resolve()) if path is not None else reference
    if place in named_by:
        raise InputError(
            f"'{reference}' names itself as robot, directly or through other files; name another robot", key
        )
    beside = replace(context, folder=path.resolve().parent) if path is not None else context
    file = data["robot"].rpartition(":")[0] or data["robot"]
    nearest = beside if (beside.folder / file).is_file() else context
    both = merged(parameters, modifiers)
    return resolve(data["robot"], nearest, key=key, parameters=both, named_by=(*named_by, place), **given)


def _from_file(
    reference: str, data: Mapping[str, Any], context: Context, key: str, modifiers: dict[str, Any]
) -> tuple[str, dict[str, Any]]:
    from .robot_file import checked

    try:
        family, robot = checked(data)
        geometry = robot.modifiers()
    except InputError as error:
        inside = error.within(reference, content=read(context.file(reference, key, "robot", "robot file")))
        raise (InputError(str(inside), key) if key else inside) from error
    return family, {**geometry, **modifiers}


def in_python(reference: str, context: Context) -> tuple[str, dict[str, Any]]:
    """Return the class and parameters that a robot file of a Python model names; else the reference itself."""
    from .robot_file import is_python_robot

    path = context.find(reference) if reference.endswith(".toml") else None
    data = parse(read(path)) if path is not None else {}
    return (data["robot"], data.get("parameters", {})) if is_python_robot(data) else (reference, {})


def _unknown(reference: str) -> str:
    hint = python_models.hint(reference) or meant(reference, names(), f"there are {', '.join(names())}")
    return f"there is no robot '{reference}'; {hint}"
