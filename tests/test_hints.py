"""Annotations of everything public can be asked for, and what they need is imported only then."""

from __future__ import annotations

import functools
import inspect
import subprocess
import sys
import typing
from collections.abc import Iterator
from typing import Any

import pytest

import gtmodel as gt
from tests.test_docstrings import LIBRARIES, public

FUNCTION_OF = {property: "fget", functools.cached_property: "func", classmethod: "__func__", staticmethod: "__func__"}


def annotated(item: Any) -> Iterator[Any]:
    """A function, or a class with its methods and properties, inherited ones too."""
    yield item
    for base in item.__mro__ if inspect.isclass(item) else ():
        for name, member in vars(base).items():
            function = getattr(member, FUNCTION_OF.get(type(member), ""), member)
            if inspect.isfunction(function) and base.__module__.startswith("gtmodel") and name.strip("_") == name:
                yield function
    if inspect.isclass(item) and inspect.isfunction(item.__init__):
        yield item.__init__


@pytest.mark.parametrize("library", ["", *LIBRARIES])
def test_types_of_what_is_public_are_known(library: str) -> None:
    unknown = {}
    for name, item in public(library).items():
        for part in annotated(item):
            try:
                typing.get_type_hints(part, include_extras=True)
            except (NameError, TypeError, AttributeError) as error:
                unknown[f"{name}: {part.__qualname__}"] = str(error)
    assert not unknown


def test_they_are_the_classes_themselves() -> None:
    from control import StateSpace

    from gtmodel.identify.inertia import Identification

    assert typing.get_type_hints(gt.linearize)["return"] is StateSpace
    hints = typing.get_type_hints(gt.identify.IdentificationStudy)
    assert hints["fit"] == Identification | None


def test_a_result_is_declared_without_what_made_it() -> None:
    code = (
        "import sys, typing\n"
        "from gtmodel.identify.identification_result import IdentificationStudy\n"
        "from gtmodel.optimize.optimization_result import OptimizationStudy\n"
        "heavy = {'gtmodel.identify.inertia', 'gtmodel.optimize.solution', 'casadi', 'matplotlib'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
        "typing.get_type_hints(IdentificationStudy)\n"
        "assert 'gtmodel.identify.inertia' in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
