"""The six-link Gantry-Tau: against the three-link one, NumPy by hand and pinocchio's closed chain; D1 as printed."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status
from gtmodel.compiler.flat import flatten
from gtmodel.lang.declarations import Parameter
from gtmodel.robots.six_link import ARM, SixLink, six_link_gantry_tau
from tests.mechanics.balance import power_balance
from tests.oracle.six_link import SixLinkByHand, rotation
from tests.support.compare import relative_error
from tests.support.residuals import original_residuals

# Two roads of some thousand operations; poses lose two digits, and Newton stops at 1e-13 of the nominals.
ROUND_OFF = 1e-10
# Inverse and forward dynamics one after the other: a linear solve with masses from 2 to 38 kg between them.
TWO_SOLVES = 1e-10
RESIDUAL = 1e-10
COUNT = 25
TURNED_DEG = 5.0  # clusters are nearly parallel: carts that change sides turn the plate by less, other assemblies by 60

D1 = tomllib.loads(files("gtmodel.robots").joinpath("data", "gantry_tau.toml").read_text(encoding="utf-8"))[
    "d1_nominal"
]
L1 = gt.robots.gantry_tau("l1_tape")
A3, V3, L3 = (np.array(getattr(L1, k)) for k in "AvL")
HOME = np.array(L1.home)
# plate joints in world directions at home, sized like D1's and better conditioned; ours
B = np.array(
    [[0, -0.05, -0.10], [0, -0.11, -0.08], [0.03, 0, 0.14], [0.14, -0.09, 0.04], [0, 0, -0.14], [0.02, 0.12, 0.08]]
)
LINK_MASSES = np.array([1.0, 2.0, 2.5, 3.0, 3.5, 4.0])
FRICTION = dict(coulomb=[100.0, 120.0, 150.0], viscous=[50.0, 60.0, 70.0])
MASSES = dict(m_p=9.0, m_c=[13.0, 13.5, 38.0], **FRICTION)
INERTIA = np.array([[0.12, 0.01, 0.0], [0.01, 0.2, 0.02], [0.0, 0.02, 0.15]])


@cache
def nominal() -> SixLink:
    """Clusters exactly parallel: the plate keeps its orientation."""
    arm = list(ARM)
    return SixLink(A=A3[arm] + B, v=V3[arm], L=L3[arm], B=B, I_p=INERTIA, m_a=LINK_MASSES, home=HOME, **MASSES)


@cache
def three_link() -> gt.Model:
    links = [LINK_MASSES[np.array(ARM) == i].sum() for i in range(3)]
    return gt.robots.GantryTau(A=A3, v=V3, L=L3, m_a=links, home=HOME, **MASSES)


def perturbed_by(one_v: bool = False, **others) -> SixLink:
    """Every length, point and direction changed by up to 1 mm (per metre)."""
    rng = np.random.default_rng(5)

    def near(x, size):
        return np.array(x) + size * rng.uniform(-1, 1, np.shape(x))

    exact = nominal()
    v = exact.v if one_v else near(exact.v, 1e-3)
    changes = dict(
        A=near(exact.A, 1e-3), L=near(exact.L, 1e-3), B=near(exact.B, 1e-3), v=v, c_p=near(np.zeros(3), 0.05)
    )
    return exact.with_(**changes, **others)


@cache
def perturbed() -> SixLink:
    return perturbed_by()


def by_hand(r: SixLink) -> SixLinkByHand:
    names = ("A", "v", "L", "B", "m_p", "c_p", "I_p", "m_c", "m_a", "coulomb", "viscous", "velocity_scale")
    return SixLinkByHand(**{k: np.array(getattr(r, k), dtype=float) for k in names})


# A compilation takes a second or two: tests share one per causality.
FROM_CARTS = ["T", "e", "R", "der(T)", "plate.frame.w", "der(T,2)", "der(plate.frame.w)", "tau"]
FROM_POSITION = ["q", "R", "der(q)", "der(q,2)", "tau"]


def carts_known(r: SixLink, q, qd, qdd) -> dict[str, np.ndarray]:
    return dict(zip(FROM_CARTS, values(r.causal("q", FROM_CARTS), q, qd, qdd), strict=True))


def position_known(r: SixLink, T, Td, Tdd) -> dict[str, np.ndarray]:
    return dict(zip(FROM_POSITION, values(r.causal("T", FROM_POSITION), T, Td, Tdd), strict=True))


def poses(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return HOME + 0.3 * rng.uniform(-1, 1, (COUNT, 3)), rng.normal(size=(COUNT, 3)), 3 * rng.normal(size=(COUNT, 3))


def values(f: gt.CausalFunction, *arguments):
    *found, status = f(*arguments)
    assert np.all(np.asarray(status) == Status.OK)
    return found


@pytest.fixture(scope="module")
def states():
    """T, q and tau of the three-link robot with their derivatives."""
    T, Td, Tdd = poses(1)
    f = three_link().causal("T", ["q", "der(q)", "der(q,2)", "tau"])
    return (T, Td, Tdd, *values(f, T, Td, Tdd))


@pytest.fixture(scope="module")
def motion():
    """Cart motions near home of the perturbed robot, and their poses by hand."""
    hand = by_hand(perturbed())
    T, qd, qdd = poses(2)
    q = np.array(values(three_link().causal("T", "q"), T)[0])
    pose = [hand.pose(a, b, np.eye(3)) for a, b in zip(q, T, strict=True)]
    return hand, q, qd, qdd, np.array([p[0] for p in pose]), np.array([p[1] for p in pose])


class TestNominal:
    """With exactly parallel links it is the three-link robot."""

    def test_kinematics(self, states):
        T, Td, Tdd, q, qd, qdd, _ = states
        found = carts_known(nominal(), q, qd, qdd)
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (COUNT, 1))
        expected = {"T": T, "e": upright, "der(T)": Td, "der(T,2)": Tdd, "plate.frame.w": 0 * T}
        for name, value in expected.items():
            assert relative_error(found[name], value) < ROUND_OFF
        found = position_known(nominal(), T, Td, Tdd)
        for name, value in {"q": q, "der(q)": qd, "der(q,2)": qdd}.items():
            assert relative_error(found[name], value) < ROUND_OFF

    def test_inverse_dynamics(self, states):
        T, Td, Tdd, q, qd, qdd, tau = states
        assert relative_error(carts_known(nominal(), q, qd, qdd)["tau"], tau) < ROUND_OFF
        assert relative_error(position_known(nominal(), T, Td, Tdd)["tau"], tau) < ROUND_OFF

    def test_forward_dynamics(self, states):
        T, Td, Tdd, *_, tau = states
        f = nominal().causal("tau", "der(T,2)")
        assert [s.name for s in f.inputs] == ["T", "der(T)", "tau"]
        assert relative_error(values(f, T, Td, tau)[0], Tdd) < TWO_SOLVES

    def test_the_mean_of_a_clusters_v_moves_its_cart(self):
        # only what the links' v differ by tells; a perturbed v on one link of three counts a third
        r = nominal()
        v = np.array(r.v)
        v[4] *= 1.03
        flat = flatten(r.with_(v=v))
        cart = flat.bindings["cart[2].v"]
        p = dict(zip([x.name for x in flat.parameters], flat.p0, strict=True))
        assert p["v[4,0]"] == 1.03
        mean = np.asarray(ca.Function("v", [flat.p], [cart])(flat.p0)).reshape(-1)
        assert relative_error(mean, v[3:].mean(axis=0)) < 1e-15


class TestStructure:
    def test_freedoms(self):
        r = perturbed()
        found = [r.causal("q", FROM_CARTS), r.causal("T", FROM_POSITION), r.causal("tau", ["der(q,2)"], prefer="T")]
        assert [f.plan.structure.degrees_of_freedom for f in found] == [0, 0, 6]
        assert [f.plan.structure.index for f in found] == [3, 3, 3]

    def test_blocks(self):
        def kinds(f):
            return [b.kind for b in f.plan.blocks if b.kind not in ("explicit", "linear")]

        assert kinds(perturbed().causal("q", FROM_CARTS)) == ["Newton"]
        assert kinds(perturbed().causal("T", FROM_POSITION)) == ["Newton", "quadratic"]  # then the first cart


class TestPerturbed:
    """All 6 x 10 numbers off the nominal ones: the plate turns, and every |v| counts."""

    def test_the_plate_turns(self, motion):
        angles = [np.degrees(np.arccos((np.trace(R) - 1) / 2)) for R in motion[5]]
        assert np.max(angles) > 0.3

    def test_forward_kinematics(self, motion):
        _, q, qd, qdd, T, R = motion
        found = carts_known(perturbed(), q, qd, qdd)
        assert relative_error(found["T"], T) < ROUND_OFF
        assert relative_error(found["R"].reshape(COUNT, 9), R.reshape(COUNT, 9)) < ROUND_OFF
        assert relative_error([rotation(e).reshape(9) for e in found["e"]], R.reshape(COUNT, 9)) < ROUND_OFF

    def test_inverse_kinematics_from_the_position_alone(self, motion):
        hand, q, qd, qdd, T, R = motion
        Td = np.array([hand.twist(*x)[:3] for x in zip(q, T, R, qd, strict=True)])
        Tdd = np.array([hand.accelerations(*x)[:3] for x in zip(q, T, R, qd, qdd, strict=True)])
        found = position_known(perturbed(), T, Td, Tdd)
        for name, value in {"q": q, "der(q)": qd, "der(q,2)": qdd}.items():
            assert relative_error(found[name], value) < ROUND_OFF
        assert relative_error(found["R"].reshape(COUNT, 9), R.reshape(COUNT, 9)) < ROUND_OFF

    def test_velocities_and_accelerations(self, motion):
        hand, q, qd, qdd, T, R = motion
        found = carts_known(perturbed(), q, qd, qdd)
        twist = [hand.twist(*x) for x in zip(q, T, R, qd, strict=True)]
        change = [hand.accelerations(*x) for x in zip(q, T, R, qd, qdd, strict=True)]
        assert relative_error(np.hstack([found["der(T)"], found["plate.frame.w"]]), twist) < ROUND_OFF
        assert relative_error(np.hstack([found["der(T,2)"], found["der(plate.frame.w)"]]), change) < ROUND_OFF

    def test_inverse_dynamics_by_virtual_work(self, motion):
        hand, q, qd, qdd, T, R = motion
        expected = [hand.motor_forces(*x) for x in zip(q, T, R, qd, qdd, strict=True)]
        assert relative_error(carts_known(perturbed(), q, qd, qdd)["tau"], expected) < ROUND_OFF

    @pytest.mark.parametrize("prefer", ["T", "q"])
    def test_forward_dynamics_undo_inverse_dynamics(self, motion, prefer):
        hand, q, qd, qdd, T, R = motion
        tau = np.array([hand.motor_forces(*x) for x in zip(q, T, R, qd, qdd, strict=True)])
        Td = np.array([hand.twist(*x)[:3] for x in zip(q, T, R, qd, strict=True)])
        f = perturbed().causal("tau", ["der(q,2)"], prefer=prefer)
        assert [s.name for s in f.inputs] == [prefer, f"der({prefer})", "tau"]
        found = values(f, *((T, Td) if prefer == "T" else (q, qd)), tau)[0]
        assert relative_error(found, qdd) < TWO_SOLVES

    def test_every_equation_as_written_holds(self, motion):
        _, q, qd, qdd, *_ = motion
        given = {"q": q[0], "der(q)": qd[0], "der(q,2)": qdd[0]}
        assert np.max(np.abs(original_residuals(perturbed(), given, "q"))) < RESIDUAL * 1e3  # forces of 1e3 N
        assert power_balance(perturbed(), given, "q") < ROUND_OFF


class WithWrist(SixLink):
    """The serial wrist on the plate: five driven axes, as on D1 and L1."""

    p = gt.variable(2, unit="rad", start=[0.2, 0.3], prefer=1)
    wrist = gt.part(gt.mechanics.Wrist)

    def equations(self):
        yield from super().equations()
        yield gt.connect(self.plate.frame, self.wrist.mount)
        yield self.p == self.wrist.q


def test_a_wrist_on_the_plate(motion):
    _, q, qd, qdd, *_ = motion
    r = WithWrist(
        **{k: getattr(perturbed(), k) for k in SixLink._declared if isinstance(getattr(SixLink, k), Parameter)}
    )
    p, pd, pdd = np.random.default_rng(4).normal(size=(3, COUNT, 2))
    given = {"q": q, "der(q)": qd, "der(q,2)": qdd, "p": p, "der(p)": pd, "der(p,2)": pdd}
    for k in range(10):
        assert power_balance(r, {name: x[k] for name, x in given.items()}, ["q", "p"]) < ROUND_OFF


class TestPathRestriction:
    """tau[0], T[1] and T[2] known (Dressler 2012, section 3.5): one motor drives along x, the others keep the path."""

    @pytest.mark.parametrize("robot", [three_link, nominal])
    def test_two_states(self, robot):
        f = robot().causal(["tau[0]", "T[1]", "T[2]"], ["der(T,2)", "tau"])
        assert f.plan.structure.degrees_of_freedom == 2
        assert len(f.plan.states) == 2


@cache
def d1_inverse() -> gt.CausalFunction:
    return six_link_gantry_tau().causal("T", ["q", "e"])


class TestD1:
    """Dressler 2012, Table 5.9 model 3."""

    def test_orientation_and_position_over_a_metre(self):
        r = six_link_gantry_tau()
        side = np.linspace(-0.5, 0.5, 5)
        T = np.array(r.home) + np.array(np.meshgrid(side, side, side)).reshape(3, -1).T
        q, e = values(d1_inverse(), T)
        R = np.array([rotation(x) for x in e])
        zyz = np.degrees(
            [np.arctan2(R[:, 1, 2], R[:, 0, 2]), np.arccos(R[:, 2, 2]), np.arctan2(R[:, 2, 1], -R[:, 2, 0])]
        )
        # printed: variations from 0.1 to 0.5 deg, the second angle's the largest; our region need not be theirs
        spread = np.ptp(zyz, axis=1)
        assert np.all((spread > 0.1) & (spread < 0.6)) and np.argmax(spread) == 1
        assert relative_error(zyz.mean(axis=1), [85.0, 100.9, -88.6]) < 1e-3  # 0.1 deg
        # the three-link model of Table 5.8 puts the tool centre point within a tenth of a millimetre on average
        three = gt.robots.GantryTau(A=D1["A_m"], v=D1["v"], L=D1["L_m"], m_p=1.0, m_c=[1.0, 1.0, 1.0], home=r.home)
        (simple,) = values(three.causal("q", "T"), q)
        assert 0.02e-3 < np.mean(np.linalg.norm(simple - T, axis=1)) < 0.15e-3

    def test_forward_undoes_inverse_kinematics(self):
        r = six_link_gantry_tau()
        T = np.array(r.home) + np.random.default_rng(3).uniform(-0.5, 0.5, (COUNT, 3))
        q, e = values(d1_inverse(), T)
        back, again = values(r.causal("q", ["T", "e"]), q)
        assert relative_error(back, T) < ROUND_OFF
        assert relative_error(again, e) < ROUND_OFF

    def test_an_unknown_name_is_refused(self):
        with pytest.raises(gt.ModelError, match="no six-link robot 'd2'; there is d1_six_link"):
            six_link_gantry_tau("d2")


class TestAgainstPinocchio:
    """Uniform rods as rigid bodies on universal joints, a free plate, the six loops closed by an exact KKT solve."""

    def test_forward_dynamics(self):
        pytest.importorskip("pinocchio", reason="pinocchio, the oracle of closed chains, is not installed")
        from tests.oracle.six_link_closed_chain import ClosedChain

        r = perturbed_by(
            True, link=dict(rod=gt.mechanics.UniformRod), **{k: np.zeros(3) for k in ("coulomb", "viscous")}
        )
        hand = by_hand(r)
        chain = ClosedChain(hand)
        f = r.causal("tau", ["der(q,2)", "der(T,2)", "der(plate.frame.w)"], prefer="q")
        rng = np.random.default_rng(8)
        T0, qd, _ = poses(9)
        q = np.array(values(three_link().causal("T", "q"), T0)[0])
        tau = 200 * rng.normal(size=(COUNT, 3))
        found = np.hstack(values(f, q, qd, tau))
        for k in range(COUNT):
            T, R = hand.pose(q[k], T0[k], np.eye(3))
            assert relative_error(found[k], chain.accelerations(q[k], T, R, qd[k], tau[k])) < ROUND_OFF


@pytest.mark.parametrize(("links", "carts"), [((1,), (1,)), ((0,), (0,)), (range(6), range(3))])
def test_declared_branches_reach_the_inverse_kinematics_by_newton(links, carts):
    robot = six_link_gantry_tau()
    forward = robot.causal(known="q", targets="T")
    T, _ = forward(np.array([-0.2, -0.03, -0.2]))
    names = [f"link[{k}].rod.{end}.r" for k in range(6) for end in "ba"]
    inverse = robot.causal(known="T", targets=["q", "e", *names], branches={f"link[{k}].ahead": -1 for k in links})
    _, e, *ends, status = inverse(T)
    assert status is gt.Status.OK
    # the nearest of the plate's orientations there, whichever round-off the processor has
    assert np.degrees(2 * np.arccos(min(1.0, abs(e @ np.array(robot.home_e))))) < TURNED_DEG
    v = np.array([p.value for p in inverse.flat.parameters if p.name.startswith("v[")]).reshape(6, 3)
    side = [np.sign((ends[2 * k] - ends[2 * k + 1]) @ v[k]) for k in range(6)]
    arm = (0, 1, 1, 2, 2, 2)
    assert side == [-1.0 if arm[k] in carts else 1.0 for k in range(6)]


@pytest.mark.parametrize("others", [(1, -1), (-1, -1)])
def test_the_first_sign_of_a_configuration_moves_the_first_cart_alone(others):
    robot = six_link_gantry_tau()
    T, _ = robot.causal("q", "T")(np.array([-0.25, -0.03, -0.25]))
    found = []
    for first in (1, -1):
        branches = gt.robots.configuration(robot, (first, *others))
        q, e, status = robot.causal("T", ["q", "e"], branches=branches)(T)
        assert status is gt.Status.OK
        found.append(np.concatenate([q[1:], e]))
        turn = 2 * np.arccos(min(1.0, abs(e @ np.array(robot.home_e))))
        assert np.degrees(turn) < 5.0  # arm 1 has no say in the orientation, and the others keep their assembly
    assert np.abs(found[0] - found[1]).max() < 1e-9
