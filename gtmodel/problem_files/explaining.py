"""``gtmodel explain``: the certificate of a causality of a robot, or what a problem asks for."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from gtmodel.compiler.causal import compile_causal, flat_of
from gtmodel.modelica import flat_of_text, python_of
from gtmodel.modelica.reference import is_reference, libraries, whole
from gtmodel.robots import SerialArm, description

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
) -> str:
    """The text for a robot (see `robots.resolve`) or for a problem file.

    known, targets, prefer: names, several in one text separated by commas. Raises InputError, and ModelError
    with file and line for a causality that does not exist.
    """
    given, wanted, kept = split(known), split(targets), split(prefer)
    if _is_problem(what) or (is_reference(what) and not (given or wanted or kept)):
        if given or wanted or kept:
            raise InputError("a problem file says itself what is known; leave --known and --targets out")
        loaded = load(what, settings)
        return run.explain(loaded, run.context_of(loaded))
    context = Context()
    model = resolve(whole(what) if is_reference(what) else what, context, key="")
    if not wanted and isinstance(model, SerialArm):
        return description(model)
    if not wanted:
        raise InputError(f"name its --targets; top-level names are {flat_of(model).top()}")
    return "\n".join([compile_causal(model, given, wanted, kept).explain(), *context.notes])


def printed(what: str, flat: bool, *options: Iterable[str]) -> str:
    """A class of a Modelica text as a Python module, or as flat Modelica. Raises InputError for anything else."""
    if not is_reference(what) or any(options):
        raise InputError("--python and --flat take a class of a Modelica text, as f.mop:VDP_Opt, and no other options")
    return (flat_of_text if flat else python_of)(what, library=libraries())


def split(texts: Iterable[str]) -> list[str]:
    """Names out of texts, split at the commas that stand outside parentheses: "der(T,2),q" holds two."""
    names: list[str] = []
    for text in texts:
        depth, start = 0, 0
        for n, letter in enumerate(f"{text},"):
            depth += (letter in "([") - (letter in ")]")
            if letter == "," and depth <= 0:
                names.append(f"{text},"[start:n].strip())
                start = n + 1
    return [name for name in names if name]


def _is_problem(what: str) -> bool:
    """A TOML file is a problem unless it is plainly a robot file."""
    if not what.endswith(".toml"):
        return what in shipped_names()
    try:
        data = parse(read(Path(what)))
    except InputError:
        return True
    return not is_robot_file(data)
