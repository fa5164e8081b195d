"""Old names work for one release more, and say so."""

from __future__ import annotations

import sys
import warnings

import numpy as np
import pytest

import gtmodel as gt
from gtmodel._lazy import _MOVED
from tests.support.commands import Commands

ROBOT = gt.robots.gantry_tau("l1_tape")
SIGNALS = """
[measurements.signals.q]
column = "q"
unit = "m"
noise = 1e-5
"""


@pytest.mark.parametrize(
    ("package", "name", "place"), [(p, n, there) for p, of in _MOVED.items() for n, there in of.items()]
)
def test_a_name_that_moved_is_the_same_and_warns(package: str, name: str, place: str) -> None:
    old = sys.modules[package] if package in sys.modules else __import__(package, fromlist=["_"])
    vars(old).pop(name, None)
    with pytest.warns(DeprecationWarning, match=f"{place}.{name}"):
        found = getattr(old, name)
    assert found is getattr(__import__(place, fromlist=["_"]), name)


def test_an_old_option_is_read_and_warns() -> None:
    with pytest.warns(FutureWarning, match="deviation"):
        signal = gt.calibrate.MeasuredSignal("q", "m", noise=1e-5)
    assert signal.noise_in_si == 1e-5
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert gt.calibrate.MeasuredSignal("q", "m", deviation=1e-5).noise_in_si == 1e-5


def test_an_old_alarm_is_accepted_and_warns() -> None:
    velocity = np.array([[0.2], [0.6], [1.0], [-0.2], [-0.6], [-1.0]])
    force = np.array([[180.0], [257.0], [330.0], [-95.0], [-159.0], [-224.0]])
    runs = gt.identify.Runs(velocity, force, np.zeros(6, int), np.ones(6), np.zeros((6, 1)))
    with pytest.warns(FutureWarning, match="copied_rows"):
        gt.identify.identify_friction(runs, np.array([[1.0]]), accept=["copied_runs"])


def test_the_command_line_says_it_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    done = Commands(capsys)("solve", "friction_l1", "--set", 'accept=["copied_runs"]')
    assert done.code == 0 and "friction_l1: the alarm copied_runs is called copied_rows" in done.err
    assert ".py" not in done.err  # the line of a program, as Python would show it
