"""The studies of late corrections: their numbers against the functions they are made of, refusals, servo plants."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.control import ComputedTorque, Feedback
from gtmodel.plot.delayed import depth_figure
from gtmodel.results import ArgumentError
from tests.control.delayed.test_limit import CYCLE, LATE

D = gt.control.delayed
X = D.FeedbackAxis(17.0, 0.06, limit=0.25, gain_step=0.01)
Y = D.FeedbackAxis(12.0, 0.06, limit=0.016, gain_step=0.001)
SMALL = D.FeedbackBox(draws=20)
ROBOT = gt.robots.gantry_tau("l1_tape")
AT = {"T": [0.5, -0.9, 0.3], "der(T)": 0.0}


@pytest.fixture(scope="module")
def whole() -> Any:
    directions, path = [D.OffAxisRun(0.5), D.OffAxisRun(0.8, 0.03, 0.05)], D.SinePath(duration=2.0)
    return gt.control.delayed_feedback({"x": X, "y": Y}, box=SMALL, off_axis=directions, path=path)


def test_its_numbers_are_those_of_the_functions(whole: Any) -> None:
    study = whole
    assert study.status.ok
    for name, axis in (("x", X), ("y", Y)):
        loop = D.DelayedLoop(axis.plant(D.FeedbackTiming()), CYCLE, LATE)
        assert study.limit[name] == pytest.approx(axis.limit, rel=1e-9)
        margins = D.loop_margins(loop, study.recommended[name])
        assert study.gain_margin[name] == pytest.approx(margins.gain)
        assert study.phase_margin[name] == pytest.approx(margins.phase)
        assert study.delay_margin[name] == pytest.approx(margins.delay)
        assert study.disk_margin[name] == pytest.approx(margins.disk)
        assert study.recommended is not None and study.recommended[name] < study.limit[name]
        assert study.worst_limit is not None and study.worst_limit[name] < study.limit[name]


def test_both_readings_of_a_correction_are_answered() -> None:
    study = gt.control.delayed_feedback({"y": Y}, box=None, path=None)
    readings = study.readings["y"]
    assert readings["4 ms, not adding up"] == pytest.approx(0.016, rel=1e-9)
    # the same vibration after one command: m times cycle stays
    m = Y.equivalent_mass(D.FeedbackTiming())
    w = 2 * np.pi * 12.0
    for key, cycle, accumulate, mass in (
        ("12 ms, not adding up", 0.012, False, m / 3),
        ("4 ms, adding up", 0.004, True, m),
    ):
        plant = D.equivalent_plant(mass, 0.12 * w * mass, w**2 * mass, cycle, accumulate=accumulate)
        assert readings[key] == pytest.approx(D.gain_limit(D.DelayedLoop(plant, cycle, LATE)).gain, rel=1e-9)
    # a rigid arm, the stiffest there is: corrections that add up every 4 ms forbid the printed stable gain of 0.2
    stiff = gt.control.delayed_feedback({"x": D.FeedbackAxis(17.0, 0.06, mass=1e6)}, box=None, path=None).readings["x"]
    assert stiff["4 ms, adding up"] == pytest.approx(2 * np.sin(np.pi / 54), rel=1e-4)
    assert stiff["4 ms, adding up"] < 0.2 < stiff["12 ms, adding up"]


def test_the_same_vibration_follows_one_command_of_either_cycle() -> None:
    """What `readings` keeps: after the command the vibrations differ by the length of the pulse only."""
    w, t = 2 * np.pi * 12.0, np.linspace(0.02, 0.3, 50)
    long, short = (
        D.command_response(3.0 * 0.004 / cycle, 0.36 * w * 0.004 / cycle, 3 * w**2 * 0.004 / cycle, t + cycle / 2,
                           size=1e-3, cycle=cycle)
        for cycle in (0.012, 0.004)
    )  # fmt: skip
    assert np.max(np.abs(long - short)) < 0.05 * np.max(np.abs(short))


def test_runs_in_time_meet_the_limit() -> None:
    study = gt.control.delayed_feedback({"y": Y}, box=None, seed=3)
    assert study.simulated_limit is not None
    assert abs(study.simulated_limit["y"] / study.limit["y"] - 1) < 0.05
    assert [run.bounded for run in study.runs["y"]] == [True, False]


def test_a_cut_in_the_study_is_that_of_the_map() -> None:
    cutter = gt.milling.Cutter(0.0254, 2, gt.milling.CuttingCoefficients(6089.9, 9.04e8, 6601.7, 2.94e8))
    cut = gt.milling.Cut("climb", 0.00635, 0.00508, 0.000526)
    of = D.FeedbackCut("y", 32.25, [174.0, 220.0, 281.0], 10.4, 0.05, shares=[0.0], steps=8)
    both = gt.milling.CorrectedCut(of, cutter, cut)
    study = gt.control.delayed_feedback({"x": X, "y": Y}, box=None, path=None, cut=both)
    assert study.chatter_depth is not None
    f = np.array([17.0, 12.0, 10.4])
    mass = np.array(of.mass)
    robot = gt.milling.Oscillators.with_damping_ratio(mass, mass * (2 * np.pi * f) ** 2, [0.06, 0.06, 0.05])
    speed = 32.25 * (1 + study.spindle_speed_error)
    depth = gt.milling.stable_depth(robot, cutter, cut, speed, [1.0, 0.0, 0.0], low=1e-4, high=5e-3)
    assert study.chatter_depth["0"] == pytest.approx(depth, rel=0.03)  # eight steps of a cycle


def test_a_map_of_synthetic_commands_holds_its_truth() -> None:
    joints = np.deg2rad(np.random.default_rng(4).uniform([-65.0, 60.0], [-20.0, 115.0], (14, 2)))
    options = D.SyntheticCommands(repeatability=0.02, seed=2)
    table = [[-0.7, 1.5], [-0.8, 1.7]]
    study = D.feedback_map(options, joints.tolist(), table, gain_steps={"x": 0.05, "y": 0.01},
                           options=D.GainMap(points=3, draws=60))  # fmt: skip
    assert study.true_limit is not None and study.inside is not None
    for d in ("x", "y"):
        for true, median, low in zip(study.true_limit[d], study.median[d], study.quantile[d], strict=True):
            assert low < 1.05 * true and abs(median / true - 1) < 0.1  # one quantile in twenty lies above the truth
    low, high = gt.inference.binomial_band(14 * 6)
    assert low <= round(14 * 6 * study.inside["m, c and k"]) <= high
    assert any("synthetic" in note for note in study.notes)
    assert "map.csv" in study.files and "table.csv" in study.files


def test_a_map_that_is_stopped_keeps_the_table() -> None:
    joints = np.deg2rad(np.random.default_rng(4).uniform([-65.0, 60.0], [-20.0, 115.0], (12, 2)))
    measured = D.MeasuredPlants(joints, *D.true_plants(joints, D.SyntheticCommands()), ("x", "y"))
    asked: dict[str, Any] = {"asked": joints[:1].tolist(), "gain_steps": {"x": 0.1, "y": 0.01}}
    asks = iter(range(3))  # the field, and the table of both directions
    options = D.GainMap(points=3, draws=50)
    s = D.feedback_map(measured, **asked, options=options, stop=lambda: next(asks, None) is None)
    whole = D.feedback_map(measured, **asked, options=options)
    assert s.status is gt.SolveStatus.INTERRUPTED and whole.status.ok
    assert s.median == whole.median and s.recommended == whole.recommended
    assert not s.least and list(s.files) == ["table.csv"] and s.files["table.csv"] == whole.files["table.csv"]


def test_a_map_of_measured_plants() -> None:
    joints = np.deg2rad(np.random.default_rng(4).uniform([-65.0, 60.0], [-20.0, 115.0], (12, 2)))
    m, c, k = D.true_plants(joints, D.SyntheticCommands())
    measured = D.MeasuredPlants(joints, m, c, k, ("x", "y"))
    study = D.feedback_map(
        measured, asked=joints[:1].tolist(), gain_steps={"x": 0.1, "y": 0.01}, options=D.GainMap(points=3, draws=50)
    )
    exact = D.gain_limit(D.DelayedLoop(D.equivalent_plant(m[0, 0], c[0, 0], k[0, 0], CYCLE), CYCLE, LATE)).gain
    assert study.median["x"][0] == pytest.approx(exact, rel=0.03)
    assert study.true_limit is None and study.inside is None


def test_under_computed_torque_every_direction_is_the_same_second_order_system() -> None:
    """Exact inverse dynamics leave s^2 + 60 s + 900, wherever the tool is."""
    law = ComputedTorque(ROBOT, stiffness=900.0, damping=60.0)
    alone = D.CorrectedPlant(np.array([[0.0, 1.0], [-900.0, -60.0]]), np.array([0.0, 900.0]), np.array([1.0, 0.0]))
    limit = D.gain_limit(D.DelayedLoop(alone, CYCLE, 0.02))
    for direction in ([1.0, 0.0, 0.0], [0.6, 0.0, 0.8]):
        plant = D.servo_plant(ROBOT, law, AT, direction)
        mine = D.gain_limit(D.DelayedLoop(plant, CYCLE, 0.02))
        assert mine.gain == pytest.approx(limit.gain, rel=1e-6)
        assert mine.frequency == pytest.approx(limit.frequency, rel=1e-6)


def test_a_servo_plant_is_the_simulated_robot() -> None:
    """A step of 1 um of the reference along y: the tool's way by the nonlinear model, and by the plant."""
    law, direction = Feedback(4e4, 2e3), np.array([0.0, 1.0, 0.0])
    plant = D.servo_plant(ROBOT, law, AT, direction)
    # what a held correction is in references, from kinematics
    q = [np.asarray(ROBOT.causal("T", "q")(np.array(AT["T"]) + s * direction)[0]) for s in (-1e-6, 0.0, 1e-6)]
    start = {"plant.T": AT["T"], "der(plant.T)": 0.0}
    loop = gt.control.sampled_loop(ROBOT, law, 1e-3, 0.0)
    # the law holds the robot at rest only with an offset of the reference: the difference of two runs
    runs = [
        gt.simulate(loop, 0.05, inputs={"reference": q[1] + s * (q[2] - q[0]) / 2}, start=start, tolerance=1e-11)
        for s in (0, 1)
    ]
    times = np.linspace(0, 0.05, 11)
    ways = [
        np.array([np.interp(times, r.trajectory.time, r.trajectory["plant.T"][:, i]) for i in range(3)]) for r in runs
    ]
    moved = (ways[1] - ways[0])[1]
    from scipy.linalg import expm

    n = len(plant)
    block = np.block([[plant.A, plant.B[:, None]], [np.zeros((1, n + 1))]])
    expected = [plant.C @ expm(block * t)[:n, n] * 1e-6 for t in times]
    # the law samples at 1 ms there, and is continuous here
    assert np.max(np.abs(moved - expected)) < 0.03 * 1e-6


@pytest.mark.parametrize(
    ("wrong", "argument"),
    [
        (lambda: gt.control.delayed_feedback({}), "plants"),
        (lambda: gt.control.delayed_feedback({"y": D.FeedbackAxis(12.0, 0.1)}), "plants.y.mass"),
        (lambda: gt.control.delayed_feedback({"y": D.FeedbackAxis(12.0, 0.1, mass=1.0, limit=0.1)}), "plants.y.mass"),
        (lambda: gt.control.delayed_feedback({"y": Y}, D.FeedbackTiming(accumulate=True)), "plants.y.limit"),
        (
            lambda: gt.control.delayed_feedback(
                {"y": D.FeedbackAxis(12.0, 0.1, limit=0.1, gain=0.2)}, box=None, path=None
            ),
            "plants.y.gain",
        ),
        (
            lambda: gt.control.delayed_feedback({"y": D.rigid_plant(CYCLE)}, D.FeedbackTiming(accumulate=True)),
            "timing.accumulate",
        ),
        (lambda: gt.control.delayed_feedback({"y": Y}, off_axis=[D.OffAxisRun(0.5)], box=None, path=None), "off_axis"),
        (lambda: D.OffAxisRun(0.5, stable=0.1), "stable"),
        (lambda: D.OffAxisRun(0.5, stable=0.1, unstable=0.05), "stable"),
        (
            lambda: gt.control.delayed_feedback({"y": D.CorrectedPlant([[1.0]], [1.0], [1.0])}, box=None, path=None),
            "plants.y",
        ),
        (lambda: D.feedback_map(D.SyntheticCommands(), [[0.0, 1.0]], gain_steps={"x": 0.1, "y": 0.1}), "joints"),
        (lambda: D.feedback_map(D.SyntheticCommands(), [[0.0, 1.0]] * 5, gain_steps={"x": 0.1}), "synthetic.frequency"),
        (lambda: D.servo_plant(ROBOT, Feedback(4e4, 2e3), AT, [1.0, 1.0, 0.0]), "direction"),
        (lambda: D.servo_plant(ROBOT, Feedback(0.0, 2e3), AT, [1.0, 0.0, 0.0]), "law"),
    ],
)
def test_what_is_refused(wrong: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as fault:
        wrong()
    assert fault.value.argument == argument


def test_a_vibration_faster_than_the_samples_show_is_said() -> None:
    notes = [
        gt.control.delayed_feedback({"y": D.FeedbackAxis(f, 0.06, mass=1.0)}, box=None, path=None).notes
        for f in (124.0, 126.0)
    ]
    assert not notes[0] and "126 Hz" in notes[1][0]


def test_without_a_box_no_gain_is_recommended() -> None:
    study = gt.control.delayed_feedback({"y": Y}, box=None, path=None)
    assert study.recommended is None and study.worst_limit is None
    assert study.gain_margin["y"] == pytest.approx(2.0)  # at half the limit


def test_no_step_may_be_safe() -> None:
    weak = D.FeedbackAxis(12.0, 0.06, limit=0.009, gain_step=0.01)
    study = gt.control.delayed_feedback({"y": weak}, box=SMALL, path=None)
    assert study.recommended == {"y": 0.0} and study.gain == {} and "no step" in study.message


@pytest.mark.parametrize("depths", [{"0": 1.5e-3, "0.01": 1.8e-3}, {"0": 0.0}])
def test_no_depth_lies_on_the_frame_of_its_picture(depths: dict[str, float]) -> None:
    (panel,) = depth_figure(depths, depths).axes
    assert panel.get_ylim()[0] == 0 and panel.get_ylim()[1] > 1.05e3 * max(depths.values())


def test_pictures_are_drawn(whole: Any) -> None:
    assert set(whole.figures) == {"limits", "box", "runs", "directions"}
    for name in whole.figures:
        assert whole.figure(name).axes


def test_a_stopped_study_has_the_gain_of_the_axes_that_it_judged() -> None:
    asks = iter(range(3))  # both limits, and the worst case of x
    s = gt.control.delayed_feedback(
        {"x": X, "y": Y}, box=D.FeedbackBox(draws=20), path=None, stop=lambda: next(asks, None) is None
    )
    assert s.status is gt.SolveStatus.INTERRUPTED
    assert s.limit == pytest.approx({"x": X.limit, "y": Y.limit}, rel=1e-9)  # as they are declared
    assert s.worst_limit is not None and s.margin_limit is not None and s.recommended is not None
    assert 0 < s.margin_limit["x"] <= s.worst_limit["x"] / 2 < s.limit["x"] / 2  # a gain margin of 2
    assert s.recommended == {"x": D.recommended_gain(s.margin_limit["x"], X.gain_step)}
