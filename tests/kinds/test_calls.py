"""What a shipped problem file means is one call of a library on objects: nothing of the file is left in it."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
import pytest

import gtmodel as gt
from gtmodel.kinematics.assembly_modes.six_links import Hands
from gtmodel.problem_files.load import load
from gtmodel.problem_files.registry import schema_of
from gtmodel.problem_files.run import answer, context_of
from tests.support import recordings

PROBLEMS = sorted((Path(__file__).parents[2] / "problems").glob("*.toml"))
SOLVED = [path for path in PROBLEMS if tomllib.loads(path.read_text(encoding="utf-8"))["kind"] != "codegen"]
"""Those that give values; of the others tests/cgen compares the folders."""
SEVERAL = ("axis_trajectory", "trajectory_table", "codegen", "certificate")
"""Kinds of one machine axis after another, of several robots, and of compiled systems and functions."""
COSTLY = tuple(f"{name}_controller" for name in ("planar_3rrr", "rotary_delta", "five_bar", "ur_like"))
"""As l1_controller and f1_controller of the same kind, for other robots; the guides of docs/ generate their code."""
CHOSEN = [pytest.param(p, marks=pytest.mark.proof) if p.stem in COSTLY else p for p in PROBLEMS]
FEWER = {"dynamic_stiffness_kr500": ("synthetic.poses=12",)}
"""What makes a call cheaper that computes its own measurements."""
WITHOUT_ROBOT = ("optimization", "modes")
"""Kinds of a model that has another key than `robot`."""


def _parts(value: Any, path: str = "", seen: set[int] | None = None) -> Iterator[tuple[str, Any]]:
    """Everything that an argument holds, with its path."""
    seen = set() if seen is None else seen
    if id(value) in seen:
        return
    seen.add(id(value))
    yield path, value
    if isinstance(value, dict):
        inner = {f"[{key!r}]": one for key, one in value.items()}
    elif isinstance(value, (list, tuple)):
        inner = {f"[{k}]": one for k, one in enumerate(value)}
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        inner = {f".{field.name}": getattr(value, field.name) for field in dataclasses.fields(value)}
    else:
        return
    for name, one in inner.items():
        yield from _parts(one, path + name, seen)


@pytest.mark.parametrize("path", CHOSEN, ids=lambda p: p.stem)
def test_a_problem_file_means_a_call_on_objects(path: Path, tmp_path: Path) -> None:
    settings = (*recordings.elsewhere(path.stem, tmp_path), *FEWER.get(path.stem, ()))
    call = gt.load(path, *settings)
    library = call.study.__module__.split(".")[1]
    assert library not in ("kinds", "problem_files") and hasattr(gt, library)
    for name, value in _parts({"arguments": call.arguments, "options": call.options}):
        module = type(value).__module__
        assert not isinstance(value, (pydantic.BaseModel, Path)), name
        assert not module.startswith(("gtmodel.kinds", "gtmodel.problem_files")), name
    kind = load(path).problem.kind
    robot = schema_of(kind).model_fields.get("robot")
    if kind in WITHOUT_ROBOT or (robot is not None and robot.is_required() and kind not in SEVERAL):
        models = [value for _, value in _parts(call.arguments) if isinstance(value, (gt.Model, Hands))]
        assert models, f"the call of kind '{kind}' passes no model: pass problem.model(context)"


@pytest.mark.proof
@pytest.mark.parametrize("path", SOLVED, ids=lambda p: p.stem)
def test_file_and_call_give_the_same_values(path: Path, tmp_path: Path) -> None:
    """A sample of this stands in the libraries' own tests, with calls written by hand."""
    settings = recordings.elsewhere(path.stem, tmp_path)
    loaded = load(path, settings)
    by_file = answer(loaded, context_of(loaded))
    by_call = gt.load(path, *settings)()
    assert by_call.status == by_file.status and str(by_call) == str(by_file)
    assert _text(by_call.values) == _text(by_file.values)


def _text(values: Any) -> str:
    return json.dumps(values, default=lambda value: np.asarray(value).tolist(), sort_keys=True)
