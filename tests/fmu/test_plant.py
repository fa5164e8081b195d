"""A unit as the plant of a loop and of learning control."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.fmu.running import UnitStopped
from gtmodel.loop import RigidBodyPlant
from tests.fmu.makers import l1

pytest.importorskip("fmpy")
TCP = [1.3, -0.5, 0.9]
CYCLE = 0.004


@pytest.fixture(scope="module", params=[3, 2])
def robot_unit(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("plant") / "robot.fmu"
    f = l1().causal(known="tau", targets=["q", "der(q)"], prefer="T")
    gt.fmu.export(f, path, version=request.param, start={"T": TCP}, stop=0.2)
    return path


def test_the_plant_of_the_loop_is_the_robot_of_the_loop(robot_unit):
    """Beside RigidBodyPlant, which has an integrator of its own."""
    numbers = {name: [f"{name}[{k}]" for k in (1, 2, 3)] for name in ("tau", "q")}
    plant = gt.fmu.FmuPlant(
        robot_unit, numbers["q"], force=numbers["tau"], speed=[f"der(q[{k}])" for k in (1, 2, 3)], cycle_s=CYCLE
    )
    other = RigidBodyPlant(
        l1().causal(known="tau", targets="der(T,2)", prefer="T"), l1().causal(known="T", targets=["q", "der(q)"]), TCP
    )
    begin = other.position_m.copy()
    assert plant.position_m == pytest.approx(begin, abs=1e-9)
    assert plant.arm_m.tolist() == plant.position_m.tolist()
    moved = 0.0
    for k in range(60):
        s = 0.01 * (1 - np.cos(2 * np.pi * k / 60))
        speed = 0.01 * 2 * np.pi / 60 / CYCLE * np.sin(2 * np.pi * k / 60)
        for p in (plant, other):
            p.step((begin + s).tolist(), [speed] * 3)
        moved = max(moved, np.max(np.abs(plant.position_m - begin)))
        # the servo of the unit holds its force over a substep of half a millisecond
        assert plant.position_m == pytest.approx(other.position_m, abs=3e-4)
    assert moved > 0.015


def test_a_robot_side_speaks_for_it(robot_unit):
    """The simulated controller of EGM takes it as any plant."""
    from gtmodel.loop import RobotSide

    numbers = {name: [f"{name}[{k}]" for k in (1, 2, 3)] for name in ("tau", "q")}
    plant = gt.fmu.FmuPlant(robot_unit, numbers["q"], force=numbers["tau"], speed=[f"der(q[{k}])" for k in (1, 2, 3)])
    side = RobotSide("egm", plant)
    assert side.start_m.tolist() == plant.position_m.tolist()


def test_a_plant_without_an_answer_stops_with_the_time(robot_unit):
    unit = gt.fmu.RunningUnit(robot_unit)
    unit.set(["tau[1]"], [4000.0])
    with pytest.raises(UnitStopped, match="stopped between"):
        for _ in range(2000):
            unit.step(CYCLE)


WRONG = {
    "command": {"position": ["q[1]"]},
    "speed": {"position": ["q[1]"], "force": ["tau[1]"]},
    "force": {"position": ["q[1]"], "force": ["tau[1]", "tau[2]"], "speed": ["der(q[1])"]},
    "position": {"position": ["nothing"], "force": ["tau[1]"], "speed": ["der(q[1])"]},
}


@pytest.mark.parametrize("argument", WRONG)
def test_names_that_do_not_fit_are_refused(robot_unit, argument):
    with pytest.raises(gt.results.ArgumentError) as refusal:
        gt.fmu.FmuPlant(robot_unit, **WRONG[argument])
    assert refusal.value.argument == argument


def test_a_file_that_is_no_unit_is_refused(tmp_path):
    (tmp_path / "no.fmu").write_text("nothing")
    with pytest.raises(gt.results.ArgumentError, match="path"):
        gt.fmu.RunningUnit(tmp_path / "no.fmu")


@pytest.mark.parametrize(
    ("given", "argument"),
    [
        ({"sample_time": float("nan")}, "sample_time"),
        ({"reference": np.full((5, 3), np.nan)}, "reference"),
        ({"inputs": ["tau[1]"] * 3}, "inputs"),
        ({"inputs": ["q[1]", "q[2]", "q[3]"]}, "inputs"),
        ({"outputs": {"motor": ["tau[1]", "tau[2]", "tau[3]"]}}, "outputs"),
    ],
)
def test_what_is_no_experiment_is_refused(robot_unit, given, argument):
    names = {name: [f"{name}[{k}]" for k in (1, 2, 3)] for name in ("tau", "q")}
    whole = {
        "reference": np.zeros((5, 3)), "names": ("a", "b", "c"), "inputs": names["tau"], "sample_time": 0.004,
        "outputs": {"motor": names["q"]},
    }  # fmt: skip
    keys = whole | given
    reference = keys.pop("reference")
    with pytest.raises(gt.results.ArgumentError) as refusal:
        gt.fmu.FmuExperiment(robot_unit, reference, **keys)
    assert refusal.value.argument == argument


def test_a_run_of_another_shape_is_refused(robot_unit):
    names = {name: [f"{name}[{k}]" for k in (1, 2, 3)] for name in ("tau", "q")}
    experiment = gt.fmu.FmuExperiment(
        robot_unit, np.zeros((5, 3)), names=("a", "b", "c"), inputs=names["tau"], sample_time=0.004,
        outputs={"motor": names["q"]},
    )  # fmt: skip
    for shape in ((3,), (5, 1), (4, 3)):
        with pytest.raises(gt.results.ArgumentError, match="inputs"):
            experiment.run(np.zeros(shape))


@pytest.mark.parametrize("given", [{"cycle_s": 0.0}, {"cycle_s": float("inf")}, {"steps": 0}, {"steps": 10**6}])
def test_cycles_that_are_none_are_refused(robot_unit, given):
    names = {name: [f"{name}[{k}]" for k in (1, 2, 3)] for name in ("tau", "q")}
    speeds = [f"der({q})" for q in names["q"]]
    with pytest.raises(gt.results.ArgumentError) as refusal:
        gt.fmu.FmuPlant(robot_unit, names["q"], force=names["tau"], speed=speeds, **given)
    assert refusal.value.argument == next(iter(given))


class Axes(gt.Model):
    """Two linear axes whose motors follow by a lag and whose tools swing behind them."""

    lag = gt.parameter(0.021, unit="s")
    frequency = gt.parameter([7.6, 11.2], unit="1/s")
    damping = gt.parameter([0.22, 0.055])
    command = gt.input(2, unit="m")
    motor = gt.variable(2, unit="m", prefer=1)
    tool = gt.variable(2, unit="m", prefer=1)

    def equations(self):
        for k in range(2):
            w = 2 * np.pi * self.frequency[k]
            yield self.lag * gt.der(self.motor[k]) == self.command[k] - self.motor[k]
            swing = 2 * self.damping[k] * w * (gt.der(self.motor[k]) - gt.der(self.tool[k]))
            yield gt.der(self.tool[k], 2) == w**2 * (self.motor[k] - self.tool[k]) + swing


def test_learning_control_on_a_unit_that_is_not_its_model(tmp_path):
    """Axes with other lag and frequencies than the law's model: the error of the tool shrinks as it learns."""
    learning = gt.control.learning
    robot, path = learning.LearningRobot(delay=0), learning.SquarePath(corrected=250)
    f = Axes().causal(known="command", targets=["motor", "tool"], prefer=["motor", "tool"])
    place = tmp_path / "axes.fmu"
    gt.fmu.export(f, place, stop=0.02, start={"command": [0.0, 0.0], "motor": [0.0, 0.0], "tool": [0.0, 0.0],
                                             "der(tool)": [0.0, 0.0]})  # fmt: skip
    synthetic = learning.SyntheticExperiment(robot, path)
    experiment = gt.fmu.FmuExperiment(
        place, synthetic.reference, names=robot.axes, sample_time=robot.sample_time,
        corrected=synthetic.corrected, inputs=["command[1]", "command[2]"],
        outputs={"motor": ["motor[1]", "motor[2]"], "tool": ["tool[1]", "tool[2]"]},
    )  # fmt: skip
    first = experiment.run(np.zeros_like(experiment.reference))
    again = experiment.run(np.zeros_like(experiment.reference))
    assert all(np.array_equal(first[s], again[s]) for s in first)
    study = learning.study(robot, path, learning.LearningDesign(case="3", iterations=5), experiment=experiment)
    assert "FMU" in study.trajectory.synthetic
    assert max(study.tool_share) < 0.3
