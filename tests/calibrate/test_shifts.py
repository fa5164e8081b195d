"""A shift that offsets explain is named with its share."""

from dataclasses import replace

import numpy as np
import pytest

from gtmodel.calibrate import Choice, Fit, Measurements, calibrate, prepare, study
from gtmodel.calibrate.report.diagnostics import shift_of
from tests.calibrate.drawn import KINDS, drawing, drawn, measured_robot, poses_of
from tests.calibrate.hexapod import FIRST, SECOND, hexapod, measured
from tests.calibrate.test_hexapod import FRAMES, LEGS

HOMED = np.array([4e-4, -7e-4, 2e-4])  # m
FRAME = ("T.device", "T.target")


def second(kind: str, seed: int, **shift: np.ndarray) -> Measurements:
    values = drawn(kind, seed, 30)
    return Measurements({n: rows + shift.get(n, 0.0) for n, rows in values.items()}, KINDS[kind].noise)


@pytest.mark.parametrize("signal", ["q", "T"])
def test_a_shift_of_a_second_recording_is_named_with_its_share(signal: str) -> None:
    c = calibrate(drawing("three_link", 0), poses_of("three_link", drawn("three_link", 0, 60)).measurements)
    shift = shift_of(c.problem.on(second("three_link", 1, **{signal: HOMED})), c.x, refitted=False)
    assert shift is not None and shift.share > 0.9 and shift.actuators == (signal == "q")
    np.testing.assert_allclose(shift.offsets[0], HOMED, atol=1e-4)
    asked = {"q": "was the robot homed again?", "T": "was the device moved?"}[signal]
    assert shift.message.startswith(f"three offsets of {signal} (") and asked in shift.message
    assert f"explain {100 * shift.share:.0f} % of the squared error" in shift.message


def test_noise_and_another_effect_are_no_shift() -> None:
    c = calibrate(drawing("three_link", 0), poses_of("three_link", drawn("three_link", 0, 60)).measurements)
    alarms = [shift_of(c.problem.on(second("three_link", seed)), c.x, refitted=False) for seed in range(1, 11)]
    assert not any(alarms)
    waves = Measurements(drawn("three_link", 3, 30, unmodelled=10.0), KINDS["three_link"].noise)
    assert shift_of(c.problem.on(waves), c.x, refitted=False) is None


def test_what_the_unknowns_take_up_is_not_counted_where_they_were_fitted() -> None:
    """Base points take up all offsets of the carts."""
    m = second("three_link", 1, q=HOMED)
    c = calibrate(measured_robot("three_link"), m)
    assert shift_of(c.problem, c.x, refitted=True) is None
    still = calibrate(measured_robot("three_link"), m, Choice(free=["L"]))
    shift = shift_of(still.problem, still.x, refitted=True)
    assert shift is not None and shift.share > 0.5 and shift.signal == "q"


def test_the_hexapods_second_recording_was_moved_and_homed_anew() -> None:
    """As it is, the origin has moved; with the heights of both frames refitted the homing of the legs is left."""
    first = calibrate(prepare(hexapod(), measured(FIRST), actuators="n"))
    moved = shift_of(first.problem.on(measured(SECOND)), first.x, refitted=False)
    assert moved is not None and moved.signal == "T" and moved.share > 0.99 and "device moved" in moved.message
    still = [f"{f}.{n}" for f in FRAME for n in ("t[0]", "t[1]", *(f"u turned about {x}" for x in "xyz"))]
    robot, m = hexapod().with_(**first.parameters()), measured(SECOND, poses=FRAMES)
    c = calibrate(robot, m, Choice(fixed=(*LEGS, *still)), actuators="n")
    homed = shift_of(c.problem, c.x, refitted=True)
    assert homed is not None and homed.offsets.shape == (1, 6) and 0.5 < homed.share < 0.8
    assert homed.message.startswith("six offsets of n (") and "homed again" in homed.message


def test_several_sessions_have_offsets_each() -> None:
    a, b = second("three_link", 1, q=HOMED), second("three_link", 2, q=-HOMED)
    values = {n: np.vstack([np.asarray(a.values[n]), np.asarray(b.values[n])]) for n in a.values}
    m = Measurements(values, a.noise, sessions=["a"] * 30 + ["b"] * 30)
    c = calibrate(measured_robot("three_link"), m, Choice(free=["L"]))
    shift = shift_of(c.problem, c.x, refitted=True)
    assert shift is not None and shift.sessions == ("a", "b")
    np.testing.assert_allclose(shift.offsets, [HOMED, -HOMED], atol=3e-4)
    assert "six offsets of q in 2 sessions" in shift.message


def test_the_verdict_names_the_shift_in_place_of_more_poses() -> None:
    both = [drawn("three_link", seed, 30) for seed in (0, 1)]
    both[1]["q"] = both[1]["q"] + HOMED
    values = {n: np.vstack([b[n] for b in both]) for n in both[0]}
    poses = replace(poses_of("three_link", values), held_out=np.arange(60) >= 30)
    s = study(drawing("three_link", 0), poses, KINDS["three_link"].fit)
    assert s.prediction_proven is False and s.verdict is not None
    assert "three offsets of q (" in s.verdict[-1] and "was the robot homed again?" in s.verdict[-1]
    assert "measure more poses" not in s.verdict[-1]
    as_it_is = study(measured_robot("three_link"), poses_of("three_link", both[1]), Fit(free=[]))
    assert any("three offsets of q (" in said for said in as_it_is.verdict or ())
