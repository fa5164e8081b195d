"""Models 2 and 4 of D1: guideways as straight pieces through points of another recording, whose frame is calibrated."""

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from gtmodel.calibrate import Choice, Measurements, calibrate, prepare
from gtmodel.mechanics import MeasuredGuideway
from tests.calibrate.synthetic import true_robot

RECOVERED = 1e-9  # m, 1 or rad: as in test_recovery
AT = np.linspace(-0.8, 0.8, 9)
FRAMES = Rotation.from_rotvec([[0.3, -0.2, 0.5], [0.1, 0.4, -0.2], [-0.3, 0.2, 0.1]])
ORIGINS = np.array([[0.5, 0.1, -0.4], [-0.2, 0.3, 0.6], [0.4, -0.5, 0.2]])


def bends(size: float) -> np.ndarray:
    """Deviations (3, 9, 3) [m] of the guideways' points, robot coordinates."""
    return size * np.random.default_rng(4).standard_normal((3, len(AT), 3))


@cache
def bent_robot(bend: float = 5e-3):
    """L1 with guideways that deviate by normal errors at nine points, given in frames of their own (synthetic, seed 4).

    Errors of 5 mm, so that the turn about a guideway is told at 1e-9; real ones are a hundredth of that.
    """
    robot = true_robot("three_link")
    arms = []
    for A, v, e, frame, origin in zip(np.array(robot.A), np.array(robot.v), bends(bend), FRAMES, ORIGINS, strict=True):
        world = A + AT[:, None] * v + e
        own = frame.inv().apply(world - origin)
        arms.append(dict(guideway=MeasuredGuideway(at=AT, points=own, t=origin, u=frame.as_quat(scalar_first=True))))
    return robot.with_(arm=arms)


def test_the_guideway_goes_through_its_points_in_the_robots_frame():
    robot = bent_robot()
    T, r, status = robot.causal(known="q", targets=("T", "arm[1].guideway.frame.r"))(np.full((1, 3), AT[3]))
    expected = np.array(robot.A)[1] + AT[3] * np.array(robot.v)[1] + bends(5e-3)[1][3]
    assert status[0] == 0 and np.all(np.isfinite(T))
    np.testing.assert_allclose(r[0], expected, atol=1e-12)


def test_frames_and_lengths_are_found_with_unit_quaternions():
    robot = bent_robot()
    q = np.random.default_rng(6).uniform(-0.6, 0.6, (150, 3))
    T, status = robot.causal(known="q", targets="T")(q)
    m = Measurements({"q": q[status == 0], "T": T[status == 0]})
    frames = [f"arm[{i}].guideway" for i in range(3)]
    choice = Choice(
        free=("L", *(f"{f}.t" for f in frames), *(f"{f}.u" for f in frames)), unit=[f"{f}.u" for f in frames]
    )
    p = prepare(robot, m, choice)
    assert len(p.unknowns.names) == 3 * 7 and [len(b.columns) for b in p.lengths] == [7, 7, 7]
    rng = np.random.default_rng(1)
    c = calibrate(
        p, start={n: x + 2e-3 * rng.standard_normal() for n, x in zip(p.unknowns.names, p.unknowns.start, strict=True)}
    )
    assert c.status.ok and np.abs(c.x - p.unknowns.start).max() < RECOVERED
    assert np.abs(c.residuals).max() < RECOVERED < np.abs(c.start).max()


def test_nearly_straight_points_do_not_tell_the_turn_about_them():
    robot = bent_robot(3e-5)
    q = np.random.default_rng(6).uniform(-0.6, 0.6, (100, 3))
    T, _ = robot.causal(known="q", targets="T")(q)
    choice = Choice(free=("L[0]", "arm[0].guideway.t", "arm[0].guideway.u"), unit=["arm[0].guideway.u"])
    identified = prepare(robot, Measurements({"q": q, "T": T}), choice).identifiability(sigma=5e-5)
    (weakest,) = [d for d in identified.near if d.std > 100]
    along = np.array([weakest.weights.get(f"arm[0].guideway.u turned about {a}", 0.0) for a in "xyz"])
    v = FRAMES[0].inv().apply(np.array(robot.v)[0])
    np.testing.assert_allclose(np.abs(along @ v) / np.linalg.norm(along) / np.linalg.norm(v), 1, atol=1e-2)
