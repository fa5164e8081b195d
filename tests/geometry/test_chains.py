"""Serial chains: pose by matrix exponentials, closed forms with names, all postures of arms of every structure."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from gtmodel.geometry.chains import (
    Chain,
    ElbowAngle,
    LockedJoint,
    Postures,
    closed_form,
    elbow_angle,
    postures,
)
from gtmodel.geometry.rotations import nearest_rotation, within_pi
from gtmodel.results import ArgumentError, Status
from tests.support import chains as arms

ROUND_OFF = 1e-12  # products of at most seven rotations and sums of metres
RESIDUAL = 1e-9  # of every posture that is returned
SAME = 1e-6  # rad or m: next to singular positions half of the digits of an angle are lost
PANDA = np.radians([[-166, 166], [-101, 101], [-166, 166], [-176, -4], [-166, 166], [-1, 215], [-166, 166]])
TURNS = np.tile([[-2 * np.pi, 2 * np.pi]], (6, 1))
X, Y, Z = np.eye(3)
TWISTS = 1e-4 * np.random.default_rng(0).standard_normal(6)


def gantry() -> Chain:
    return Chain([X, Y, Z, Z, Y, Z], np.zeros((6, 3)), [False] * 3 + [True] * 3, [0, 0, -0.1])


def stanford() -> Chain:
    points = np.tile([0, 0.1, 0.4], (6, 1))
    return Chain([Z, Y, Z, Z, Y, Z], points, [True, True, False, True, True, True], [0, 0.1, 0.6])


def youbot() -> Chain:
    heights = np.array([0, 0.1, 0.25, 0.4, 0.4])
    return Chain([Z, Y, Y, Y, Z], np.column_stack([[0.033] * 5, 0 * heights, heights]), T=[0.033, 0, 0.6])


def lifted() -> Chain:
    points = [[0, 0, 0], [0, 0, 0], [0.3, 0, 0], [0.5, 0, 0]]
    return Chain([Z, Z, Z, Z], points, [False, True, True, True], [0.5, 0, 0.1])


def quill() -> Chain:
    points = [[0, 0, 0], [0.3, 0, 0], [0.5, 0, 0], [0.5, 0, 0]]
    return Chain([Z, Z, Z, -Z], points, [True, True, True, False], [0.55, 0, 0.1])


def three(*directions, points, T) -> Chain:
    return Chain(directions, points, T=T)


def cylindrical() -> Chain:
    return Chain([Z, Z, X], np.zeros((3, 3)), [True, False, False], [0.3, 0.05, 0.1])


def cuspidal() -> Chain:
    """An orthogonal arm of three joints with offsets (Wenger)."""
    return three(Z, -Y, Z, points=[[0, 0, 0], [1, 0, 0], [3, -1, 0]], T=[4.5, -1, 0])


def cuspidal_with_wrist() -> Chain:
    arm = cuspidal()
    return Chain([*arm.axes, X, Y, X], [*arm.points, *np.tile(arm.T, (3, 1))], T=[4.9, -1, 0])


# arm, orientation known, largest count of postures; all of them in closed form with names
NAMED = {
    "ur5e": (arms.ur5e(), True, 8),
    "puma": (arms.puma560(), True, 8),
    "kr500": (arms.kr500(), True, 8),
    "kr500_origin_along_axis_4": (arms.kr500(0.4), True, 8),
    "panda_q7_locked": (arms.panda().locked(6, 0.5), True, 8),
    "axes_345_parallel": (arms.ur5e().reversed(), True, 8),
    "gantry_with_wrist": (gantry(), True, 2),
    "stanford": (stanford(), True, 8),
    "youbot": (youbot(), True, 4),
    "scara": (arms.scara(), True, 2),
    "scara_lift_first": (lifted(), True, 2),
    "scara_quill_last": (quill(), True, 2),
    "2r": (arms.planar(0.4, 0.3), False, 2),
    "3r_planar": (arms.planar(0.4, 0.3, 0.2), True, 2),
    "3r": (arms.anthropomorphic(), False, 4),
    "3r_1_parallel_2": (three(Z, Z, Y, points=[[0, 0, 0], [0.3, 0, 0.1], [0.55, 0, 0.15]], T=[0.8, 0, 0.2]), False, 4),
    "3r_1_meets_2": (three(Z, Y, X, points=[[0, 0, 0], [0, 0, 0], [0, 0.1, 0.35]], T=[0.1, 0.2, 0.8]), False, 4),
    "3r_2_meets_3": (three(Z, Y, X, points=[[0, 0, 0], [0.2, 0, 0.3], [0.2, 0, 0.3]], T=[0.4, 0.2, 0.8]), False, 4),
    "cylindrical": (cylindrical(), False, 2),
}


def nearest(chain: Chain, found: Postures, q: np.ndarray) -> np.ndarray:
    """Distance of the nearest posture from given ones (m,), whole turns left out."""
    apart = found.q - q[:, None]
    apart = np.abs(np.where(chain.revolute, within_pi(apart), apart)).max(axis=2)
    return np.where(np.isnan(apart), np.inf, apart).min(axis=1)


def residual(chain: Chain, found: Postures, T: np.ndarray, R: np.ndarray, oriented: bool = True) -> float:
    row = np.nonzero(found.exists)[0]
    at, turned = chain.pose(found.q[found.exists])
    off = np.abs(at - T[row]).max()
    return float(max(off, np.abs(turned - R[row]).max())) if oriented else float(off)


def smallest(chain: Chain, q: np.ndarray) -> np.ndarray:
    return np.linalg.svd(chain.jacobian(q), compute_uv=False)[:, -1]


def again(chain: Chain, count: int, oriented: bool = True) -> tuple[Postures, int, float]:
    """Postures of random reachable poses, how often that of the draw is among them, and the largest pose error."""
    q = arms.draw(chain, 3, count)
    T, R = chain.pose(q)
    found = postures(chain, T, R if oriented else None)
    return found, int((nearest(chain, found, q) < SAME).sum()), residual(chain, found, T, R, oriented)


# chains


def by_exponentials(chain: Chain, q: np.ndarray) -> np.ndarray:
    M = np.eye(4)
    for h, o, turns, angle in zip(chain.axes, chain.points, chain.revolute, q, strict=True):
        screw = np.zeros((4, 4))
        if turns:
            screw[:3, :3] = np.cross(h, np.eye(3)).T
        screw[:3, 3] = -np.cross(h, o) if turns else h
        M = M @ expm(screw * angle)
    end = np.eye(4)
    end[:3, :3], end[:3, 3] = chain.R, chain.T
    return M @ end


@pytest.mark.parametrize("chain", [arms.panda(), arms.scara(), stanford()], ids=["panda", "scara", "stanford"])
def test_pose_is_the_product_of_exponentials_and_the_jacobian_its_derivative(chain: Chain) -> None:
    q = arms.draw(chain, 1, 5)
    T, R = chain.pose(q)
    J, step = chain.jacobian(q), 1e-6
    for k, row in enumerate(q):
        M = by_exponentials(chain, row)
        np.testing.assert_allclose(T[k], M[:3, 3], atol=ROUND_OFF)
        np.testing.assert_allclose(R[k], M[:3, :3], atol=ROUND_OFF)
        (a, A), (b, B) = chain.pose(row - step * np.eye(len(chain))), chain.pose(row + step * np.eye(len(chain)))
        np.testing.assert_allclose(J[k, :3], ((b - a) / (2 * step)).T, atol=1e-8)
        turning = (B - A) / (2 * step) @ R[k].T
        w = np.array([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]])
        np.testing.assert_allclose(J[k, 3:], w, atol=1e-8)


def forward(gain: float = 1.0, coupled: float = 0.0) -> ca.Function:
    """Two turning joints and one that slides, written by hand."""
    u = ca.SX.sym("u", 3)
    c, s = ca.cos(gain * u[0]), ca.sin(gain * u[0])
    first = ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))
    angle = u[1] + coupled * u[0] * u[2] ** 2
    c, s = ca.cos(angle), ca.sin(angle)
    second = ca.vertcat(ca.horzcat(1, 0, 0), ca.horzcat(0, c, -s), ca.horzcat(0, s, c))
    R = first @ second
    return ca.Function("f", [u], [first @ ca.DM([0.1, 0.2, 0.3]) + R @ ca.vertcat(0.0, 0.4, 0.5 + u[2]), R])


def test_the_chain_of_a_hand_written_function() -> None:
    f = forward()
    chain = Chain.of_function(f)
    assert chain is not None and chain.revolute == (True, True, False)
    np.testing.assert_allclose(chain.axes, [Z, X, Z], atol=ROUND_OFF)
    q = arms.draw(chain, 2, 4)
    T, R = chain.pose(q)
    for k, row in enumerate(q):
        np.testing.assert_allclose(T[k], np.asarray(f(row)[0]).ravel(), atol=ROUND_OFF)
        np.testing.assert_allclose(R[k], np.asarray(f(row)[1]), atol=ROUND_OFF)


@pytest.mark.parametrize("f", [forward(gain=2.0), forward(coupled=1e-3)], ids=["a gear", "no product"])
def test_functions_that_are_no_chain(f: ca.Function) -> None:
    assert Chain.of_function(f) is None


def test_a_locked_joint_leaves_the_pose() -> None:
    chain, q = arms.panda(), arms.draw(arms.panda(), 4, 1)[0]
    for joint in (0, 3, -1):
        locked = chain.locked(joint, q[joint])
        for a, b in zip(locked.pose(np.delete(q, joint)), chain.pose(q), strict=True):
            np.testing.assert_allclose(a, b, atol=ROUND_OFF)


def test_wrong_arguments_are_named() -> None:
    for argument, call in {
        "axes": lambda: Chain([[0, 0, 0]], [[0, 0, 0]]),
        "q": lambda: arms.ur5e().pose(np.zeros(5)),
        "joint": lambda: arms.ur5e().locked(6, 0.0),
        "T": lambda: postures(arms.ur5e(), np.zeros((2, 2)), np.eye(3)),
        "R": lambda: postures(arms.ur5e(), np.zeros((2, 3)), np.eye(3)),
        "limits": lambda: postures(arms.ur5e(), np.zeros(3), np.eye(3), limits=np.zeros((5, 2))),
        "redundancy": lambda: postures(arms.ur5e(), np.zeros(3), np.eye(3), redundancy=ElbowAngle(0.0)),
        "direction": lambda: postures(
            arms.iiwa14(), np.zeros(3), np.eye(3), redundancy=ElbowAngle(0.0, (0.0, 0.0, 0.0))
        ),
    }.items():
        with pytest.raises(ArgumentError) as caught:
            call()
        assert caught.value.argument == argument


# closed forms


@pytest.mark.parametrize("name", NAMED)
def test_all_postures_of_arms_with_a_closed_form(name: str) -> None:
    chain, oriented, most = NAMED[name]
    found, returned, off = again(chain, 100, oriented)
    assert returned == 100 and off < RESIDUAL
    assert found.complete and len(found.names) == most == found.exists.sum(axis=1).max()
    assert len(set(found.names)) == most


@pytest.mark.proof
@pytest.mark.parametrize("name", NAMED)
def test_1000_poses_of_arms_with_a_closed_form(name: str) -> None:
    chain, oriented, _ = NAMED[name]
    _, returned, off = again(chain, 1000, oriented)
    assert returned == 1000 and off < RESIDUAL


@pytest.mark.parametrize("name", NAMED)
def test_slopes_tell_the_branch(name: str) -> None:
    chain, oriented, most = NAMED[name]
    form = closed_form(chain, oriented=oriented)
    assert form is not None and not form.near
    q = arms.draw(chain, 5, 50)
    T, R = chain.pose(q)
    found = postures(chain, T, R if oriented else None)
    slopes = np.asarray(form.slope_function(q.T)).T
    for k in range(len(q)):
        (branch,) = np.flatnonzero((form.signs == np.sign(slopes[k])).all(axis=1)) if most > 1 else (0,)
        apart = found.q[k, branch] - q[k]
        assert np.all(np.abs(np.where(chain.revolute, within_pi(apart), apart)) < SAME)


@pytest.mark.parametrize("name", ["ur5e", "puma", "kr500", "panda_q7_locked", "3r_1_meets_2", "3r"])
def test_slopes_are_factors_of_the_determinant(name: str) -> None:
    """On a way through all postures the determinant changes its sign where a slope does, and only there. The elbow's
    slope does with the shoulder's: with the wrist behind the base, up and down change."""
    chain, oriented, _ = NAMED[name]
    form = closed_form(chain, oriented=oriented)
    assert form is not None
    stops = arms.draw(chain, 6, 5)
    q = np.concatenate([a + np.linspace(0, 1, 2001)[:, None] * (b - a) for a, b in pairwise(stops)])
    J = chain.jacobian(q)[:, : 6 if oriented else 3]
    slopes = np.sign(np.asarray(form.slope_function(q.T)))
    changes = np.diff(np.sign(np.linalg.det(J))) != 0
    assert changes.any()
    np.testing.assert_array_equal(changes, (np.diff(slopes, axis=1) != 0).any(axis=0))


def test_names_are_those_of_the_geometry() -> None:
    """By the places of elbow and wrist at the postures, not by the closed form."""
    chain = arms.kr500()
    q = arms.draw(chain, 7, 40)
    found = postures(chain, *chain.pose(q))
    for k, (names, row) in enumerate(zip([found.names] * len(q), found.q, strict=True)):
        for name, angles in zip(names, row, strict=True):
            if np.isnan(angles).any():
                continue
            R, p = (x[:, 0] for x in chain.exponentials(angles[None]))
            heading = R[1] @ X  # the shoulder is in front of axis 1
            shoulder, elbow, wrist = (R[i] @ chain.points[j] + p[i] for i, j in ((1, 1), (2, 2), (3, 4)))
            side = "front" if heading @ wrist > 0 else "back"
            ahead = heading if side == "front" else -heading
            normal = np.cross(ahead, Z)
            bent = np.cross(elbow - shoulder, wrist - shoulder) @ normal
            up = "up" if bent < 0 else "down"  # above the line from shoulder to wrist, seen with the wrist ahead
            assert name.startswith(f"{side}, {up}, "), (k, name)
    assert postures(arms.planar(0.4, 0.3), [0.5, 0.0, 0.0]).q[0, 0, 0] > 0  # the left elbow


def test_singular_and_unreachable_poses_say_so() -> None:
    chain = arms.ur5e()
    bent = np.radians([20.0, -60.0, 90.0, 30.0, 50.0, 40.0])
    for joint, angle in ((4, 0.0), (2, 0.0)):  # wrist, elbow
        q = bent.copy()
        q[joint] = angle
        T, R = chain.pose(q)
        found = postures(chain, T, R)
        assert (found.status == Status.SINGULAR).any()
        assert residual(chain, found, T, R) < 3e-8  # a double root: half of the digits
    far = postures(chain, [2.0, 0.0, 0.0], np.eye(3))
    assert np.all(far.status == Status.OUT_OF_RANGE) and not far.exists.any() and not far.beyond.any()
    for T, R in (([np.nan, 0, 0], np.eye(3)), ([0.3, 0, 0.3], np.full((3, 3), np.inf))):
        assert np.all(postures(chain, T, R).status == Status.NOT_FINITE)
    assert np.all(postures(chain, [0.3, 0.1, 0.3], np.diag([1.0, 1.0, -1.0])).status == Status.OUT_OF_RANGE)
    # fewer joints than degrees of freedom: a pose beside what they reach
    scara = arms.scara()
    T, R = scara.pose([0.3, 0.5, 0.1, 0.2])
    assert postures(scara, T, R).exists.all()
    tilted = R @ np.array([[1, 0, 0], [0, np.cos(1e-3), -np.sin(1e-3)], [0, np.sin(1e-3), np.cos(1e-3)]])
    assert np.all(postures(scara, T, tilted).status == Status.OUT_OF_RANGE)
    assert np.all(postures(arms.planar(0.4, 0.3), [0.5, 0.0, 1e-3]).status == Status.OUT_OF_RANGE)


def hostile(chain: Chain, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses at random, far, on axis 1, singular, and next to all of these."""
    rng = np.random.default_rng(seed)
    q = rng.choice([0.0, np.pi / 2, np.pi, 1e-9, 0.3, -1.0], (count, len(chain)))
    q = np.where(rng.random(q.shape) < 0.5, q, rng.uniform(-np.pi, np.pi, q.shape))
    T, R = chain.pose(q)
    T += rng.choice([0.0, 1e-13, 1e-9, 1e-3, 1.0], (count, 1)) * rng.standard_normal((count, 3))
    T[rng.random(count) < 0.05, :2] = 0.0
    return T, R


def worst_ok(chain: Chain, oriented: bool, count: int, seed: int) -> float:
    """The largest pose error of postures with the status OK."""
    T, R = hostile(chain, count, seed)
    with np.errstate(all="ignore"):
        found = postures(chain, T, R if oriented else None)
    good = found.status == Status.OK
    at, turned = chain.pose(found.q[good])
    row = np.nonzero(good)[0]
    return float(max(np.abs(at - T[row]).max(), np.abs(turned - R[row]).max() if oriented else 0.0))


@pytest.mark.parametrize("name", NAMED)
def test_no_hostile_pose_has_a_wrong_ok(name: str) -> None:
    chain, oriented, _ = NAMED[name]
    assert worst_ok(chain, oriented, 2000, 8) < RESIDUAL


@pytest.mark.proof
@pytest.mark.parametrize("name", NAMED)
def test_no_wrong_ok_among_100000_hostile_poses(name: str) -> None:
    chain, oriented, _ = NAMED[name]
    assert max(worst_ok(chain, oriented, 20_000, seed) for seed in range(5)) < RESIDUAL


def test_instructions_of_closed_forms() -> None:
    """Besides 15 inputs and the outputs, about 100 operations; Newton's method takes more for each step."""
    for name, most in {"ur5e": 165, "puma": 170, "kr500": 170, "3r": 75}.items():
        chain, oriented, _ = NAMED[name]
        form = closed_form(chain, oriented=oriented)
        assert form is not None and form.function.n_instructions() <= most, name


# calibrated arms, general arms, seven joints


def share(chain: Chain, found: Postures, q: np.ndarray, regular: np.ndarray) -> float:
    """How often the posture of the draw is among those of regular poses."""
    return float(np.mean(nearest(chain, found, q)[regular] < SAME))


def disturbed(count: int) -> tuple[float, float]:
    chain = arms.ur5e(TWISTS)
    q = arms.draw(chain, 3, count)
    T, R = chain.pose(q)
    found = postures(chain, T, R)
    return share(chain, found, q, smallest(chain, q) > 1e-3), residual(chain, found, T, R)


def test_a_calibrated_arm_takes_its_nominal_closed_form_and_newton_steps() -> None:
    returned, off = disturbed(100)
    assert returned >= 0.998 and off < RESIDUAL


def test_three_newton_steps_without_further_polishing() -> None:
    chain = arms.ur5e(TWISTS)
    form = closed_form(chain)
    assert form is not None and form.near and form.structure == "nearly: axes 2 3 4 parallel, 5 and 6 meet"
    q = arms.draw(chain, 3, 100)
    T, R = chain.pose(q)
    solved, exists, _ = form.values(T, R)
    away = (smallest(chain, q) > 0.02)[:, None] & exists
    assert away.any(axis=1).mean() > 0.5
    np.testing.assert_allclose(chain.pose(solved[away])[0], T[np.nonzero(away)[0]], atol=RESIDUAL)


@pytest.mark.proof
def test_1000_poses_of_a_calibrated_arm() -> None:
    returned, off = disturbed(1000)
    assert returned >= 0.998 and off < RESIDUAL


def general(seed: int, count: int) -> tuple[Postures, np.ndarray, float, float]:
    chain = arms.random_arm(seed)
    q = arms.draw(chain, 5, count)
    T, R = chain.pose(q)
    found, regular = postures(chain, T, R), smallest(chain, q) > 1e-3
    return found, regular, share(chain, found, q, regular), residual(chain, found, T, R)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_general_arms_have_all_their_postures(seed: int) -> None:
    found, regular, returned, off = general(seed, 25)
    assert closed_form(arms.random_arm(seed)) is None and found.complete and found.names == ()
    assert returned >= 0.998 and off < RESIDUAL
    assert np.all(found.exists[regular].sum(axis=1) % 2 == 0)


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_1000_poses_of_general_arms(seed: int) -> None:
    _, _, returned, off = general(seed, 1000)
    assert returned >= 0.998 and off < RESIDUAL


def test_the_arm_with_sixteen_postures() -> None:
    """Manseur, Doty 1989, with six printed digits."""
    R = [[-0.760117, -0.641689, 0.102262], [0.133333, 0, 0.991071], [-0.635959, 0.766965, 0.085558]]
    T, R = np.array([[-1.140175, 0, 0]]), nearest_rotation(np.array(R))[None]
    chain = arms.manseur_doty()
    found = postures(chain, T, R)
    assert found.exists.sum() == 16 and residual(chain, found, T, R) < RESIDUAL
    apart = np.abs(within_pi(found.q[0][:, None] - found.q[0])).max(axis=2) + 10 * np.eye(16)
    assert apart.min() > 1e-3


@pytest.mark.parametrize("chain", [cuspidal_with_wrist(), arms.panda().locked(4, 0.3)], ids=["cuspidal", "panda_q5"])
def test_wrists_on_arms_in_general_position_by_a_quartic(chain: Chain) -> None:
    found, returned, off = again(chain, 100)
    assert returned == 100 and off < RESIDUAL
    assert found.method == "quartic" and found.names == () and found.complete


def test_three_joints_in_general_position() -> None:
    found, returned, off = again(cuspidal(), 200, oriented=False)
    assert returned == 200 and off < RESIDUAL and found.exists.sum(axis=1).max() == 4
    # three parallel axes and a place alone: no isolated postures, nothing complete
    found = postures(arms.planar(0.4, 0.3, 0.2), [0.5, 0.1, 0.0])
    assert not found.complete and found.exists.any()


def test_structured_arms_without_a_closed_form() -> None:
    chain = arms.panda().locked(2, 0.3)
    q = arms.draw(chain, 3, 30)
    T, R = chain.pose(q)
    found = postures(chain, T, R)
    assert np.mean(nearest(chain, found, q)[smallest(chain, q) > 1e-3] < SAME) >= 0.9
    assert not found.complete and residual(chain, found, T, R) < RESIDUAL


def declared_elbow(chain: Chain, count: int, limits=None) -> tuple[Postures, float, float, float]:
    """Postures, share with that of the draw, largest pose error and largest error of the elbow's angle."""
    q = arms.draw(chain, 4, count, limits)
    T, R = chain.pose(q)
    angle = elbow_angle(chain, q)
    found = postures(chain, T, R, redundancy=ElbowAngle(angle))
    step = 1e-6
    rates = np.stack(
        [within_pi(elbow_angle(chain, q + e) - elbow_angle(chain, q - e)) / (2 * step) for e in step * np.eye(7)],
        axis=1,
    )
    seven = np.linalg.svd(np.concatenate([chain.jacobian(q), rates[:, None]], axis=1), compute_uv=False)[:, -1]
    row = np.nonzero(found.exists)[0]
    turned = np.abs(within_pi(elbow_angle(chain, found.q[found.exists]) - angle[row])).max()
    return found, share(chain, found, q, seven > 1e-3), residual(chain, found, T, R), float(turned)


def test_spherical_shoulder_and_wrist_with_a_declared_elbow() -> None:
    found, returned, off, turned = declared_elbow(arms.iiwa14(), 200)
    assert returned >= 0.998 and off < RESIDUAL and turned < SAME
    assert len(found.names) == 8 and np.all(found.exists.sum(axis=1) == 8)


def test_panda_with_a_declared_elbow() -> None:
    _, returned, off, turned = declared_elbow(arms.panda(), 20, PANDA)
    assert returned >= 0.998 and off < RESIDUAL and turned < SAME


@pytest.mark.proof
def test_1000_poses_of_arms_with_a_declared_elbow() -> None:
    for chain, limits in ((arms.iiwa14(), None), (arms.panda(), PANDA)):
        _, returned, off, turned = declared_elbow(chain, 1000, limits)
        assert returned >= 0.998 and off < RESIDUAL and turned < SAME


def test_panda_with_a_locked_joint() -> None:
    chain, q = arms.panda(), arms.draw(arms.panda(), 4, 100, PANDA)
    q[:, 6] = 0.5
    T, R = chain.pose(q)
    found = postures(chain, T, R, limits=PANDA, redundancy=LockedJoint(6, 0.5))
    assert np.all(nearest(chain, found, q) < SAME) and residual(chain, found, T, R) < RESIDUAL
    np.testing.assert_array_equal(found.q[found.exists][:, 6], 0.5)


def test_seven_joints_by_iteration_within_limits() -> None:
    chain, q = arms.panda(), arms.draw(arms.panda(), 5, 40, PANDA)
    T, R = chain.pose(q)
    found = postures(chain, T, R, limits=PANDA)
    assert found.exists.any(axis=1).all() and not found.complete and residual(chain, found, T, R) < RESIDUAL
    assert np.all((found.q[found.exists] >= PANDA[:, 0] - 1e-8) & (found.q[found.exists] <= PANDA[:, 1] + 1e-8))
    repeated = postures(chain, T, R, limits=PANDA)
    np.testing.assert_array_equal(found.q, repeated.q)  # fixed starts


# turns, limits, order


def test_limits_and_turns() -> None:
    chain = arms.ur5e()
    narrow = np.radians([[-400, -30], [-180, 180], [-150, 150], [-360, 360], [-360, 360], [0, 720]])
    q = arms.draw(chain, 9, 60, narrow)
    T, R = chain.pose(q)
    found = postures(chain, T, R, limits=narrow)
    assert np.all(nearest(chain, found, q) < SAME)
    inside = found.q[found.exists]
    assert np.all((inside >= narrow[:, 0] - 1e-8) & (inside <= narrow[:, 1] + 1e-8))
    assert found.beyond.any() and np.all(found.status[found.beyond] == Status.OUT_OF_RANGE)
    free = postures(chain, T, R)
    for k in range(10):
        turns, branch = free.within(narrow, k)
        assert np.abs(turns - q[k]).max(axis=1).min() < SAME  # this very turn of it
        np.testing.assert_array_equal(np.unique(branch), np.flatnonzero(found.exists[k]))


def test_nearest_first_and_no_turn_unasked() -> None:
    chain = arms.ur5e()
    q = arms.draw(chain, 10, 30, TURNS)
    T, R = chain.pose(q)
    found = postures(chain, T, R, near=q)
    np.testing.assert_allclose(found.q[:, 0], q, atol=SAME)
    distance = np.linalg.norm(found.q - q[:, None], axis=2)
    assert np.all(np.diff(np.nan_to_num(distance, nan=1e9), axis=1) >= 0)
    assert np.all(found.branch[:, 0] < 8) and found.names[found.branch[0, 0]]


def test_sets_of_postures_equal_those_of_eaik() -> None:
    """Ostermeier, Kuelz, Althoff 2025; its answers are judged by their residual."""
    eaik = pytest.importorskip(
        "eaik.IK_HP", reason="EAIK, the oracle of closed forms, is not installed: pip install --no-deps EAIK"
    )
    for chain in (*(NAMED[n][0] for n in ("ur5e", "puma", "kr500", "panda_q7_locked")), arms.panda().locked(4, 0.3)):
        offsets = np.vstack([chain.points[:1], np.diff(chain.points, axis=0), [chain.T - chain.points[-1]]])
        robot = eaik.HPRobot(chain.axes, offsets)
        q = arms.draw(chain, 3, 50)
        T, R = chain.pose(q)
        found = postures(chain, T, R)
        for k in range(len(q)):
            M = np.eye(4)
            M[:3, :3], M[:3, 3] = R[k] @ chain.R.T, T[k]
            theirs = np.array(robot.IK(M).Q).reshape(-1, 6)
            at, turned = chain.pose(theirs)
            off = np.maximum(np.abs(at - T[k]).max(axis=1), np.abs(turned - R[k]).max(axis=(1, 2)))
            apart = np.abs(within_pi(theirs[off < RESIDUAL][:, None] - found.q[k][found.exists[k]])).max(axis=2)
            assert apart.min(axis=0).max() < SAME and apart.min(axis=1).max() < SAME
