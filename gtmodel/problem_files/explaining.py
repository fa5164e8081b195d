"""``gtmodel explain``: the certificate of a robot's causality, or the task that a problem states."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from gtmodel.compiler.causal import compile_causal, flat_of
from gtmodel.kinematics.mobility import mobility
from gtmodel.modelica import flat_of_text, python_of
from gtmodel.modelica.reference import is_reference, libraries, whole
from gtmodel.robots import JointedMechanism, SerialArm, description

from . import run
from .base import Context, InputError
from .files import parse, read, shipped_names
from .load import load
from .robot_file import is_robot_file
from .robots import resolve


def of(
    what: str,
    known: Iterable[str] = (),
    targets: Iterable[str] = (),
    prefer: Iterable[str] = (),
    settings: Iterable[str] = (),
    full: bool = True,
) -> str:
    """Return the text for a robot (see `robots.resolve`) or for a problem file.

    known, targets, prefer: names; one text may contain several, separated by commas. full: False for a summary. Raises
    InputError, and ModelError with file and line for a causality that does not exist.
    """
    known, targets, prefer = split(known), split(targets), split(prefer)
    if is_problem(what) or (is_reference(what) and not (known or targets or prefer)):
        if known or targets or prefer:
            raise InputError("a problem file states what is known; leave --known, --targets and --prefer out")
        loaded = load(what, settings)
        return run.explain(loaded, replace(run.context_of(loaded), full=full))
    context = Context()
    model = resolve(whole(what) if is_reference(what) else what, context, key="")
    if not targets and isinstance(model, SerialArm | JointedMechanism):
        return description(model) if isinstance(model, SerialArm) else model.description()
    if not targets:
        raise InputError(f"name its --targets; top-level names are {flat_of(model).top()}")
    return "\n".join([compile_causal(model, known, targets, prefer).explain(full), *context.notes])


def mobility_of(what: str, *options: Iterable[str]) -> str:
    """Return the mobility of a robot as text.

    Raises InputError for a problem file and for other options, and ModelError for a mechanism that cannot be assembled.
    """
    if is_problem(what) or any(options):
        raise InputError("--mobility takes a robot, such as l1_tape or FILE.py:CLASS, and no other options")
    context = Context()
    model = resolve(whole(what) if is_reference(what) else what, context, key="")
    return "\n".join([str(mobility(model)), *context.notes])


def printed(what: str, flat: bool, *options: Iterable[str]) -> str:
    """Return a class of a Modelica text as a Python module or as flat Modelica. Raises InputError for anything else."""
    if not is_reference(what) or any(options):
        raise InputError("--python and --flat need a Modelica class, such as f.mop:VDP_Opt, and take no other options")
    return (flat_of_text if flat else python_of)(what, library=libraries())


def split(texts: Iterable[str]) -> list[str]:
    """Split texts into names at the commas outside parentheses: "der(T,2),q" contains two names."""
    names: list[str] = []
    for text in texts:
        depth, start = 0, 0
        for n, letter in enumerate(f"{text},"):
            depth += (letter in "([") - (letter in ")]")
            if letter == "," and depth <= 0:
                names.append(f"{text},"[start:n].strip())
                start = n + 1
    return [name for name in names if name]


def is_problem(what: str) -> bool:
    """Return True for a TOML file that is not clearly a robot file, and for a shipped problem."""
    if not what.endswith(".toml"):
        return what in shipped_names()
    try:
        return not is_robot_file(parse(read(Path(what))))
    except InputError:
        return True
