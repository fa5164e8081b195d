"""The simulation study, called on objects: numbers, checks, pictures, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Trajectory
from gtmodel.results import ArgumentError, SolveStatus
from gtmodel.simulation import simulation_study
from tests.support.models import Pendulum as Cartesian
from tests.support.own_models import PENDULUM

G, L, M = 9.81, 0.5, 1.0  # of the driven pendulum in own_models
DROP = {"inputs": {"tau": 0.0}, "start": {"T": [0.5, -0.9, 0.3], "der(T)": 0.0}}


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory):
    path = tmp_path_factory.mktemp("own") / "pendulum.py"  # equations are told by their lines
    path.write_text(PENDULUM, encoding="utf-8")
    space: dict = {"__name__": "pendulum"}
    exec(compile(PENDULUM, str(path), "exec"), space)
    return space["Pendulum"]()


@pytest.fixture(scope="module")
def l1():
    return gt.robots.gantry_tau("l1_tape")


def swing(pendulum, **changes):
    given = {"start": {"phi": 0.01, "der(phi)": 0.0}, "inputs": {"tau": 0.0}, "step": 0.01, "tolerance": 1e-11,
             "title": "Swing", **changes}  # fmt: skip
    return simulation_study(pendulum, given.pop("final_time", 1.0), **given)


class TestNumbers:
    def test_small_swing_against_the_cosine(self, pendulum) -> None:
        s = swing(pendulum)
        assert s.status is SolveStatus.SOLVED
        t = s.trajectory
        assert len(t) == 101 and t.unit("der(phi)") == "rad/s" and t.title == "Swing"
        # sin(phi) differs from phi by phi^3/6
        assert t["phi"] == pytest.approx(0.01 * np.cos(math.sqrt(G / L) * t.time), abs=1e-6)
        assert s.end_time == 1.0 and s.end["phi"] == t["phi"][-1]
        assert s.states == ["phi", "der(phi)"] and s.switches == 0 and s.chosen == {}
        # this model declares no energies
        assert s.energy_error is None and "energy" not in s.figures
        assert list(s.checks) == ["equations_residual"] and s.checks["equations_residual"].passed

    def test_what_is_left_open_is_told(self, pendulum) -> None:
        s = swing(pendulum, start={})
        assert s.chosen == {"phi": 0.0, "der(phi)": 0.0}
        assert ("chosen start of phi", 0.0) in [row[:2] for row in s.rows]

    def test_robot_with_friction_keeps_its_energy_balance(self) -> None:
        robot = gt.robots.gantry_tau("l1_tape", smoothing="piecewise_linear", velocity_scale=0.01)
        s = simulation_study(robot, 0.2, step=0.01, **DROP, outputs=["arm[0].friction.force"])
        check = s.checks["energy_balance"]
        assert check.passed and check.value < 1e-6 and check.bound == 1e-4
        assert s.energy_dissipated > 0 > s.energy_stored and s.energy_supplied == 0.0
        assert s.energy_stored + s.energy_dissipated == pytest.approx(0.0, abs=2 * s.energy_error)
        assert "arm[0].friction.force" in s.end and len(s.end["T"]) == 3

    def test_a_loose_tolerance_fails_the_check_and_says_what_to_do(self, l1) -> None:
        s = simulation_study(l1, 0.2, step=0.01, tolerance=1e-2, inputs={"tau": 0.0}, start={"T": [0.5, -0.9, 0.3]})
        assert s.status is SolveStatus.CHECK_FAILED and not s.checks["energy_balance"].passed
        assert "energy_balance" in s.message and s.message.endswith("; use a smaller tolerance")

    def test_states_that_change_on_the_way(self) -> None:
        s = simulation_study(Cartesian(), 1.0, step=0.01, tolerance=1e-11, start={"x": 1.0, "y": 0.0}, prefer=["x"])
        assert s.switches == 2 and "states switched 2 times" in s.message

    def test_a_trajectory_drives_as_the_function_does(self, pendulum) -> None:
        t = np.linspace(0.0, 1.0, 51)
        torque = Trajectory(t, {"tau": np.sin(5 * t)}, {"tau": "N.m"})
        s = swing(pendulum, inputs={"tau": (torque, "cubic")}, start={"phi": 0.0})
        # phi'' + w^2 phi = sin(5 t) / (M L^2), to third order in phi
        w2 = G / L
        expected = (np.sin(5.0) - 5 / math.sqrt(w2) * np.sin(math.sqrt(w2))) / (M * L**2) / (w2 - 25)
        assert s.trajectory["phi"][-1] == pytest.approx(expected, rel=0.1)
        assert s.trajectory["tau"] == pytest.approx(np.sin(5 * s.trajectory.time), abs=1e-5)


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"start": {"phi": 0.0, "ph": 1.0}}, "start.ph"),
        ({"inputs": {"tao": 0.0}}, "inputs.tao"),
        ({"outputs": ["phi", "omega"]}, "outputs[1]"),
        ({"keep": ["phi", "omega"]}, "keep[1]"),
        ({"prefer": ["x"]}, "prefer[0]"),
        ({"step": 2.0}, "step"),
        ({"step": 1e-9}, "step"),
        ({"max_step": 1e-9}, "max_step"),
    ],
)
def test_what_cannot_be_used_is_named(pendulum, changes: dict, argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        swing(pendulum, **changes)
    assert caught.value.argument == argument


class TestRunning:
    def test_progress_and_a_request_to_stop(self, pendulum) -> None:
        shown = []

        def progress(stage=None, fraction=None, numbers=None):
            shown.append((stage, fraction, numbers))

        s = swing(pendulum, step=0.001, progress=progress, stop=lambda: bool(shown) and shown[-1][1] > 0.5)
        assert s.status is SolveStatus.INTERRUPTED
        assert shown[0][0] == "simulating" and shown[0][2] == {"time_s": pytest.approx(shown[0][1])}
        assert 0.4 < s.trajectory.time[-1] < 0.7 and s.end_time == s.trajectory.time[-1]
        assert s.trajectory.title == "Swing (interrupted)" and "stopped by request" in s.message

    def test_time_limit_keeps_what_there_is(self, pendulum) -> None:
        s = swing(pendulum, final_time=1e5, step=0.5, start={"phi": 1.0}, tolerance=1e-9, max_seconds=0.4)
        assert s.status is SolveStatus.INTERRUPTED and s.end_time < 1e5 and len(s.trajectory) > 10

    def test_pictures(self, l1) -> None:
        s = simulation_study(l1, 0.05, inputs={"tau": 0.0}, start={"T": [0.5, -0.9, 0.3]}, tolerance=1e-6)
        assert list(s.figures) == ["signals", "energy"]
        signals, energy = (s.figure(name) for name in s.figures)
        assert [a.get_ylabel() for a in signals.axes] == ["q, T [m]", "der(T) [m/s]", "tau [N]"]
        legend = [t.get_text() for t in signals.axes[0].get_legend().get_texts()]
        assert legend == [f"{n}[{i}]" for n in "qT" for i in range(3)]
        assert signals.axes[-1].get_xlabel() == "time [s]"
        assert len(energy.axes[0].get_legend().get_texts()) == 3
