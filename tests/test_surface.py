"""What `gt.` offers: libraries imported when first used, and problem files as calls."""

from __future__ import annotations

import subprocess
import sys

import pytest

import gtmodel as gt
from gtmodel.problem_files import InputError
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer


def fault_of(code: str) -> str:
    """What a new process says of a program that fails; nothing of one that runs to its end."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    return done.stderr or "failed" if done.returncode else ""


def test_libraries_are_listed_and_imported_when_first_used() -> None:
    program = (
        "import sys, gtmodel as gt\n"
        "for name in ('robots', 'milling', 'vibration', 'compliance', 'matplotlib', 'pydantic'):\n"
        "    assert name in sys.modules or f'gtmodel.{name}' not in sys.modules, name\n"
        "assert 'matplotlib' not in sys.modules and 'pydantic' not in sys.modules\n"
        "assert 'robot3d' in dir(gt.plot) and callable(gt.plot.robot3d.robot_figure)\n"
        "assert {'robots', 'milling', 'load'} <= set(dir(gt))\n"
        "gt.simulation, gt.robots\n"
        "assert callable(gt.simulate)\n"
        "import gtmodel.simulation\n"
        "assert callable(gt.simulate)\n"
    )
    assert fault_of(program) == ""


@pytest.mark.parametrize("name", ["control", "identify", "motion"])  # their folders lean on each other
def test_any_library_may_be_imported_first(name: str) -> None:
    assert fault_of(f"import gtmodel.{name}") == ""


def test_every_listed_name_is_there() -> None:
    for name in gt.__all__:
        assert getattr(gt, name) is not None
    with pytest.raises(AttributeError):
        gt.nothing_of_this_name  # noqa: B018


def test_a_problem_file_and_its_call_give_equal_values() -> None:
    settings = ["section.step_m=0.4"]
    call = gt.load("compliance_l1", *settings)
    assert "study" in repr(call) and call.options["frequencies"] == 3
    by_file = answer(load("problems/compliance_l1.toml", settings), Context())
    assert str(call().values) == str(by_file.values)


def test_a_file_that_is_wrong_is_refused_at_its_key() -> None:
    with pytest.raises(InputError) as caught:
        gt.load("compliance_l1", "section.step_m=0")
    assert caught.value.key == "section.step_m"


def test_a_call_without_what_the_file_does_not_hold_names_it() -> None:
    with pytest.raises(gt.results.ArgumentError) as caught:
        gt.load("l1_controller")()
    assert caught.value.argument == "folder"
