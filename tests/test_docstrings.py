"""What `gt.` offers is documented where it stands: each public object has a docstring, and each example runs."""

from __future__ import annotations

import ast
import doctest
import inspect
import io
import linecache
import multiprocessing
import pickle
import re
import textwrap
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from docs._ext.public_names import LIBRARIES, public
from gtmodel._pickling import dumps
from tests.support.pickled import content, content_of, trail, trail_of

LACKING = Path(__file__).parent / "suites" / "without_example.txt"
"""Names that a user calls directly and whose docstring holds no example yet; the list may only become shorter."""


def called_directly(item: Any) -> bool:
    """A function, or a class whose objects a user makes: not what only comes back from a study or a fit."""
    if not inspect.isclass(item):
        return True
    made = (gt.Model, gt.results.Options)
    return issubclass(item, made) and item.__module__.split(".")[1] != "kinds"


@pytest.mark.parametrize("library", ["", *LIBRARIES])
def test_every_public_object_has_a_docstring(library: str) -> None:
    bare = [name for name, item in public(library).items() if not (inspect.getdoc(item) or "").strip()]
    assert not bare


SHAPE = re.compile(r"\((\.\.\.|\w+|-?\d+)( \w+)?,|scalar|rows")
ARRAYS = re.compile(r"ndarray|ArrayLike|\bArray\b")


def functions(library: str) -> dict[str, Any]:
    return {name: item for name, item in public(library).items() if inspect.isfunction(item)}


@pytest.mark.parametrize("library", ["", *LIBRARIES])
def test_a_function_says_what_it_raises(library: str) -> None:
    silent = []
    for name, item in functions(library).items():
        body = ast.parse(textwrap.dedent(inspect.getsource(inspect.unwrap(item))))
        raises = any(isinstance(node, ast.Raise) and node.exc is not None for node in ast.walk(body))
        if raises and "aises" not in (inspect.getdoc(item) or ""):
            silent.append(name)
    assert not silent


@pytest.mark.parametrize("library", ["", *LIBRARIES])
def test_a_function_of_arrays_says_their_shapes(library: str) -> None:
    silent = [
        name
        for name, item in functions(library).items()
        if ARRAYS.search(str(inspect.signature(inspect.unwrap(item)))) and not SHAPE.search(inspect.getdoc(item) or "")
    ]
    assert not silent


@pytest.fixture(scope="module")
def worker() -> Iterator[Executor]:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        yield pool


def unlike(value: Any, worker: Executor) -> list[str]:
    """How a value differs in another process; the standard pickle must take all but CasADi's expressions."""
    try:
        data = dumps(value)
        if not isinstance(value, (ca.SX, ca.MX)):
            pickle.dumps(value)
        if worker.submit(content_of, data).result() == content(value):
            return []
        lines = zip(trail(value), worker.submit(trail_of, data).result(), strict=False)
        return ["differs", *(f"{a} | {b}" for a, b in lines if a != b)][:4]
    except Exception as error:  # every fault of a library at once
        return [f"{type(error).__name__}: {error}"[:400]]


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.proof)])
@pytest.mark.parametrize("library", ["", *LIBRARIES])
def test_examples_run_and_what_they_make_pickles(
    library: str, every: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, worker: Executor
) -> None:
    """Of each type the first value that an example of the library makes is pickled; by -m proof every one."""
    seen = set[type]()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(linecache, "checkcache", lambda *_: None)  # at each example all files read so far: 2 s
    finder, failed, unpickled = doctest.DocTestFinder(recurse=True), [], []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE, verbose=False)
    methods = {} if library else {"Model.causal": gt.Model.causal}  # bound from elsewhere: the finder skips it
    for name, item in (public(library) | methods).items():
        told: list[str] = []
        for example in finder.find(inspect.unwrap(item), name, globs={"gt": gt, "np": np}):
            if runner.run(example, out=told.append, clear_globs=False).failed:
                failed.append("".join(told))
            for variable, value in example.globs.items():
                if variable[:2] != "__" and not isinstance(value, (ModuleType, FunctionType, type, io.IOBase)):
                    if type(value) in seen and not every:
                        continue
                    seen.add(type(value))
                    unpickled += [f"{name}, {variable}: {line}" for line in unlike(value, worker)]
    assert not failed, "\n".join(failed)
    assert not unpickled, "\n".join(unpickled)


def test_the_list_of_what_lacks_an_example_becomes_shorter() -> None:
    lacking = {
        f"{library}.{name}".lstrip(".")
        for library in ["", *LIBRARIES]
        for name, item in public(library).items()
        if called_directly(item) and ">>>" not in (item.__doc__ or "")
    }
    listed = set(LACKING.read_text(encoding="utf-8").split())
    assert not lacking - listed, "give these an example"
    assert not listed - lacking, "these have one now: take them off the list"
