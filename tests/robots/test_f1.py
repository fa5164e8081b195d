"""The F1: printed geometry against NumPy and mpmath by hand, inverse against forward, dynamics, statuses."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cache
from importlib.resources import files

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status
from gtmodel.geometry.quaternions import product, quaternion_of
from gtmodel.robots import f1_geometry
from tests.mechanics.balance import power_balance
from tests.oracle.f1_by_hand import F1ByHand, from_quaternion
from tests.support.compare import relative_error

# Some thousand operations, poses lose two digits, and Newton stops at 1e-13 of the nominals.
ROUND_OFF = 1e-10
# both ends are refined until round-off: 30 digits against double precision, condition about 10
EXACT = 1e-12
# central differences with a step of 1e-5: 1e-10 from truncation, 1e-11 from round-off, of a Jacobian of order one
DIFFERENCES = 1e-8
COUNT = 100
HALF_BOX_M, HALF_TURN_RAD = 0.25, np.radians(15)

TABLE = tomllib.loads(files("gtmodel.robots").joinpath("data", "gantry_tau.toml").read_text(encoding="utf-8"))["f1"]


@cache
def robot() -> gt.robots.F1:
    return gt.robots.f1_gantry_tau()


@cache
def hand() -> F1ByHand:
    return F1ByHand.printed(TABLE)


@cache
def forward() -> gt.CausalFunction:
    return robot().causal("q", ["T", "e", "R"])


@cache
def inverse() -> gt.CausalFunction:
    return robot().causal(["T", "e"], "q")


@cache
def parallel() -> gt.robots.F1:
    return gt.robots.f1_gantry_tau(parallel=True)


@cache
def five_dof() -> gt.robots.F1FiveDof:
    return gt.robots.f1_five_dof(parallel=True)


WITH_JOINTS = ["T", "e", "R", "link[1].a.r", "link[2].a.r"]


@cache
def home_q() -> np.ndarray:
    q, status = inverse()(robot().home, robot().home_e)
    assert status is Status.OK
    return q


def axes(seed: int, count: int = COUNT) -> np.ndarray:
    """Axes within a quarter of a metre and 15 degrees of home."""
    rng = np.random.default_rng(seed)
    size = np.repeat([HALF_BOX_M, HALF_TURN_RAD], 3)
    return home_q() + size * rng.uniform(-1, 1, (count, 6))


def poses(seed: int, count: int = COUNT) -> tuple[np.ndarray, np.ndarray]:
    """T within 0.3 m of home, e turned by up to 15 degrees about each axis."""
    rng = np.random.default_rng(seed)
    T = np.asarray(robot().home) + 0.3 * rng.uniform(-1, 1, (count, 3))
    w = HALF_TURN_RAD * rng.uniform(-1, 1, (count, 3))
    e = np.array([turned(np.asarray(robot().home_e), x) for x in w])
    return T, e


def turned(e: np.ndarray, w: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(w)
    a, x = np.cos(angle / 2), np.sin(angle / 2) * w / angle
    return np.append(a * e[0] - x @ e[1:], a * e[1:] + e[0] * x + np.cross(x, e[1:]))


def ok(*found):
    *values, status = found
    assert np.all(np.asarray(status) == Status.OK)
    return values[0] if len(values) == 1 else values


class TestKinematics:
    def test_blocks(self):
        # the inverse splits by arms, as section 4.5 does by hand: one quadratic, then two and three unknowns
        kinds = [b.kind for b in inverse().plan.blocks if b.kind not in ("explicit", "linear")]
        assert kinds == ["condition", "quadratic", "Newton", "Newton"]
        assert [b.size for b in inverse().plan.newton] == [2, 3]
        (block,) = forward().plan.newton
        assert [s.name() for s in block.unknowns] == [f"T[{i}]" for i in range(3)] + [f"e[{i}]" for i in range(4)]

    def test_every_link_keeps_its_length(self):
        q = axes(1)
        T, e, R = ok(*forward()(q))
        assert relative_error(R, [from_quaternion(x) for x in e]) < ROUND_OFF
        lengths = [np.linalg.norm(hand().links(*x), axis=1) for x in zip(q, T, R, strict=True)]
        assert relative_error(lengths, np.broadcast_to(hand().L, (COUNT, 6))) < ROUND_OFF

    def test_forward_kinematics_is_the_stewart_platforms(self):
        q = axes(2)
        T, _, R = ok(*forward()(q))
        start = np.asarray(robot().home), from_quaternion(np.asarray(robot().home_e))
        expected = [hand().pose(x, *start) for x in q]
        assert relative_error(T, [x for x, _ in expected]) < ROUND_OFF
        assert relative_error(R, [x for _, x in expected]) < ROUND_OFF

    def test_thirty_digits(self):
        q = axes(3, 3)
        T, e, _ = ok(*forward()(q))
        for x, *found in zip(q, T, e, strict=True):
            exact = hand().exact_pose(x, found[0] + 1e-3, found[1] - 1e-3)
            assert relative_error(np.concatenate(found), np.concatenate(exact)) < EXACT

    def test_inverse_of_forward_and_forward_of_inverse(self):
        q = axes(4)
        T, e, _ = ok(*forward()(q))
        assert relative_error(ok(*inverse()(T, e)), q) < ROUND_OFF
        T, e = poses(5)
        found = ok(*forward()(ok(*inverse()(T, e))))
        assert relative_error(found[0], T) < ROUND_OFF
        same = found[1] * np.sign(np.sum(found[1] * e, axis=1))[:, None]
        assert relative_error(same, e) < ROUND_OFF

    def test_arm_1_above_and_below(self):
        T, e = poses(6)
        above = ok(*inverse()(T, e))
        branches = gt.robots.configuration(robot(), (-1,))
        below = ok(*robot().causal(["T", "e"], "q", branches=branches)(T, e))
        assert np.all(below[:, 0] < above[:, 0] - 1.0)
        lengths = [
            np.linalg.norm(hand().links(q, t, from_quaternion(x))[0]) for q, t, x in zip(below, T, e, strict=True)
        ]
        assert relative_error(lengths, np.full(COUNT, hand().L[0])) < ROUND_OFF

    def test_quaternions_are_raw(self):
        # the hand takes them as printed; of length 1 they would move the plate by millimetres
        names = ("u1_2", "u1_3", "u2_3")
        unit = {k: getattr(hand(), k) / np.linalg.norm(getattr(hand(), k)) for k in names}
        T, _, R = ok(*forward()(home_q()))
        assert np.linalg.norm(replace(hand(), **unit).pose(home_q(), T, R)[0] - T) > 1e-3

    def test_jacobian(self):
        q, step = axes(7, 5), 1e-5
        whole, status = forward().jacobian(q)
        assert not status.any()
        J = whole[:, :3]
        T, _, R = ok(*forward()(q))
        for k in range(6):
            shift = step * np.eye(6)[k]
            ahead, behind = (ok(*forward()(q + s))[0] for s in (shift, -shift))
            assert relative_error(J[:, :, k], (ahead - behind) / (2 * step)) < DIFFERENCES
        for n in range(len(q)):  # by geometry: links keep their lengths
            d = hand().links(q[n], T[n], R[n])
            moved = np.array([
                (hand().cart_joints(q[n] + s) - hand().cart_joints(q[n] - s)) / (2 * step) for s in step * np.eye(6)
            ])  # fmt: skip
            twist = np.linalg.solve(hand().rows(d, R[n]), np.sum(d * moved, axis=2).T)
            assert relative_error(J[n], twist[:3]) < DIFFERENCES


class TestFiveDof:
    """q4 = -q5 (Dressler 2012, eqs. (4.25), (4.26), (4.32))."""

    @pytest.fixture(scope="class")
    @staticmethod
    def found():
        """Axes of the 5-DOF road at random poses, T, R, and those of the 6-DOF road with the same axes."""
        five = five_dof()
        rng = np.random.default_rng(8)
        T = np.asarray(five.home) + 0.3 * rng.uniform(-1, 1, (COUNT, 3))
        angles = 0.3 * rng.uniform(-1, 1, (COUNT, 2))
        q = ok(*five.causal(["T", "angles"], "q")(T, angles))
        back, R, e = ok(*five.causal("q", ["T", "R", "e"])(q))
        six = parallel().causal("q", WITH_JOINTS)
        return T, angles, q, back, R, e, ok(*six(np.column_stack([q[:, :4], -q[:, 3], q[:, 4]])))

    def test_round_trip_in_closed_form(self, found):
        T, angles, q, back, *_ = found
        assert relative_error(back, T) < ROUND_OFF and np.array_equal(q[:, 3:], angles)
        five = five_dof()
        for f in (five.causal(["T", "angles"], "q"), five.causal("q", ["T", "R", "e"])):
            assert not f.plan.newton

    def test_equals_the_six_dof_road(self, found):
        T, *_, R, e, six = found
        assert relative_error(six[0], T) < ROUND_OFF
        assert relative_error(six[2], R) < ROUND_OFF
        assert relative_error([from_quaternion(x) for x in e], R) < ROUND_OFF

    def test_link_clusters_stay_parallel(self, found):
        *_, (T, _, R, a, b) = found
        B = np.asarray(parallel().B)
        links = [T + np.einsum("nij,j->ni", R, B[k]) - joint for k, joint in ((1, a), (2, b))]
        assert relative_error(*links) < ROUND_OFF

    def test_a_twisted_plate_leaves_them_not(self, found):
        *_, q, _, R, _, _ = found
        six = parallel()
        both = np.column_stack([q[:, :4], 0.1 - q[:, 3], q[:, 4]])[:5]
        _, _, R, a, b = ok(*six.causal("q", WITH_JOINTS)(both))
        spread = np.einsum("nij,j->ni", R, six.B[2] - np.asarray(six.B[1])) - (b - a)
        assert np.all(np.linalg.norm(spread, axis=1) > 1e-3)

    def test_angles_from_the_orientation(self, found):
        _, angles, *_, R, _, _ = found
        back, twist = ok(*gt.robots.f1_rotation(parallel=True).causal("R", ["angles", "twist"])(R))
        assert relative_error(back, angles) < ROUND_OFF
        assert np.max(np.abs(twist)) < ROUND_OFF

    def test_eight_inverse_and_two_forward_solutions(self):
        five = gt.robots.f1_five_dof()
        T, angles = np.asarray(five.home), [0.1, -0.1]
        solutions = set()
        for signs in np.ndindex(2, 2, 2):
            branches = gt.robots.configuration(five, [1 - 2 * s for s in signs])
            solutions.add(tuple(np.round(ok(*five.causal(["T", "angles"], "q", branches=branches)(T, angles)), 6)))
        assert len(solutions) == 8
        q = [*home_q()[:3], 0.1, -0.1]
        below, above = (
            ok(*five.causal("q", "T", branches=gt.robots.configuration(five, forward=s))(q)) for s in (1, -1)
        )
        assert below[2] < home_q()[:3].min() + 1.2 < above[2]

    def test_starts_the_six_dof_newton(self):
        # where q4 = -q5 the closed form is 15 mm and 4 degrees off at most on the printed set, else up to 12 cm
        five = gt.robots.f1_five_dof().causal("q", ["T", "e"])
        q = axes(9)
        T0, e0 = ok(*five(np.column_stack([q[:, :3], (q[:, 3] - q[:, 4]) / 2, q[:, 5]])))
        e0 *= np.sign(e0 @ np.asarray(robot().home_e))[:, None]
        home_road, start = forward()(q), forward()(q, guess={"T": T0, "e": e0})
        assert not start[-1].any()
        for a, b in zip(home_road[:-1], start[:-1], strict=True):
            assert relative_error(a, b) < ROUND_OFF
        (kernel,) = forward()._built.kernels
        _, good = kernel._correct(np.vstack([T0.T, e0.T]), q.T)  # with no continuation at all
        assert np.mean(good) > 0.9


class TestDynamics:
    def test_gravity_by_the_slope_of_the_energy(self):
        masses = {k: np.asarray(getattr(robot(), k), float) for k in ("m_p", "m_a", "m_c")}
        table = {k: getattr(hand(), k) for k in ("A0", "v", "L", "A", "B", "u1_2", "u1_3", "u2_3", "r3")}
        by_hand = F1ByHand(**table, masses=masses)
        q, step, rest = axes(10, 3), 1e-5, np.zeros((3, 6))
        T, _, R = ok(*forward()(q))
        tau = ok(*robot().causal("q", "tau")(q, rest, rest))
        for n in range(len(q)):
            jacobian = [
                (by_hand.potential_energy(q[n] + s, *by_hand.pose(q[n] + s, T[n], R[n]))
                 - by_hand.potential_energy(q[n] - s, *by_hand.pose(q[n] - s, T[n], R[n]))) / (2 * step)
                for s in step * np.eye(6)
            ]  # fmt: skip
            assert relative_error(tau[n], jacobian) < DIFFERENCES

    def test_power_balance(self):
        # SI sizes of 1e3 W; the accelerations come out of a linear solve
        rng = np.random.default_rng(11)
        values = {"q": axes(11, 1)[0], "der(q)": rng.normal(size=6) / 2, "der(q,2)": rng.normal(size=6)}
        assert power_balance(robot(), values, "q") < ROUND_OFF


class TestStatus:
    def test_bad_rows_leave_the_good_ones_alone(self):
        q = axes(12, 6)
        q[1, 4] = np.nan
        q[3, 0] = 40.0  # no plate reaches so far
        q[4, 2] = np.inf
        T, e, R, status = forward()(q)
        wanted = [Status.OK, Status.NOT_FINITE, Status.OK, Status.NOT_CONVERGED, Status.NOT_FINITE, Status.OK]
        assert status.tolist() == wanted
        for n, row in enumerate(q):
            *alone, one = forward()(row)
            assert one == status[n]
            for a, b in zip(alone, (T[n], e[n], R[n]), strict=True):
                assert np.array_equal(a, b, equal_nan=True)
            assert np.isnan(alone[0]).all() == (one != Status.OK)
        assert "continuation from the home pose" in forward().diagnose(q[3])

    def test_out_of_reach_and_no_unit_quaternion(self):
        T, e = poses(13, 4)
        T[1] += [5.0, 0.0, 0.0]
        e[2] *= 1.01
        q, status = inverse()(T, e)
        assert status[0] == Status.OK and status[3] == Status.OK
        assert status[1] != Status.OK and np.isnan(q[1]).all()
        assert status[2] == Status.OUT_OF_RANGE
        assert "the known values do not satisfy plate.attitude" in inverse().diagnose(T[2], e[2])


class TestGuess:
    def test_a_wrong_guess_is_a_sentence(self):
        q = home_q()
        with pytest.raises(TypeError, match=r"the guess of 'T' must have shape \(3,\) or \(1, ...\); found \(2,\)"):
            forward()(q, guess={"T": [0.0, 1.0]})

    def test_what_a_guess_leaves_open_is_completed(self):
        assert forward()(home_q(), guess={"T": robot().home})[-1] == Status.OK

    def test_a_useless_guess_is_left(self):
        far = {"T": np.asarray(robot().home) + 50.0, "e": robot().home_e}
        for a, b in zip(forward()(home_q(), guess=far), forward()(home_q()), strict=True):
            assert np.array_equal(a, b)

    def test_a_guess_on_the_other_side_chooses_it(self):
        # the mirror image through the plane of the virtual cart joints is near another assembly mode
        five = five_dof()
        q5 = [*home_q()[:3], 0.0, 0.0]
        above, e = ok(*five.causal("q", ["T", "e"], branches={"plate_below": -1})(q5))
        six = parallel().causal("q", WITH_JOINTS)
        T, *_, status = six([*home_q()[:3], 0.0, 0.0, 0.0], guess={"T": above, "e": e})
        assert status is Status.OK and relative_error(T, above) < ROUND_OFF


class TestGeometry:
    def test_the_flipped_sign_and_the_wahba_fit(self):
        # millimetres with the repaired sign of 1u_2, hundreds with the printed one
        assert f1_geometry.home_rotation(f1_geometry.of_table(TABLE))[1] < 0.01
        as_printed = {**TABLE, "u1_2": [*TABLE["u1_2"][:3], -TABLE["u1_2"][3]]}
        assert f1_geometry.home_rotation(f1_geometry.of_table(as_printed))[1] > 0.1

    def test_the_parallel_set_is_near_the_printed_one(self):
        printed = f1_geometry.of_table(TABLE)
        near = f1_geometry.parallel(printed)
        assert max(np.abs(near[k] - printed[k]).max() for k in "ABL") < 0.01
        assert f1_geometry.home_rotation(near)[1] < ROUND_OFF

    @pytest.mark.parametrize("seed", range(4))
    def test_quaternion_of_a_rotation(self, seed):
        e = np.random.default_rng(seed).normal(size=4) * [0.01 if seed == 1 else 1.0, 1.0, 1.0, 1.0]
        e /= np.linalg.norm(e)
        found = quaternion_of(from_quaternion(e))
        assert relative_error(found * np.sign(found @ e), e) < EXACT

    def test_another_name_is_refused(self):
        with pytest.raises(gt.ModelError, match="there is no F1 robot 'f2'; there is f1"):
            gt.robots.f1_gantry_tau("f2")


def test_opposite_quaternions_are_one_attitude():
    """Up to half a turn from the home pose: Newton went a longer way for -e, which did not always end."""
    rng, r = np.random.default_rng(23), robot()
    axes = rng.standard_normal((COUNT, 3))
    half = np.radians(90) * rng.uniform(0.0, 1.0, COUNT)
    turn = np.column_stack([np.cos(half), np.sin(half)[:, None] * axes / np.linalg.norm(axes, axis=1)[:, None]])
    e = np.array([product(r.home_e, t) for t in turn])
    T = r.home + rng.uniform(-HALF_BOX_M, HALF_BOX_M, (COUNT, 3))
    q, status = inverse()(T, e)
    other, opposite = inverse()(T, -e)
    assert np.array_equal(status, opposite) and np.array_equal(q, other, equal_nan=True)
    assert np.sum(status == Status.OK) > COUNT / 2
    k = int(np.argmin(np.where(status == Status.OK, half, np.inf)))
    (one, said, _), (mirrored, again, _) = (inverse().casadi(T[k], sign * e[k]) for sign in (1, -1))
    assert int(said) == int(again) == Status.OK and np.array_equal(one.full(), mirrored.full())
