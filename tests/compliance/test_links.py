"""Compliance of plates on links: closed form against the equation core, energies, and limits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy.linalg

import gtmodel as gt
from gtmodel import mechanics as m
from gtmodel.compliance import GROUPS, LinkGeometry, LinkMasses, LinkSprings, LinkStructure, tube
from gtmodel.results import Status
from gtmodel.robots import GantryTau

ROUNDING = 1e-9  # of sums of products of a dozen numbers, conditions below 1e4
LINEAR = 1e-7  # linearisation: equilibrium of the core's Newton to 1e-12 m, stretches of 1e-5 m
MASSES: dict[str, Any] = dict(coulomb=[0.0] * 3, viscous=[0.0] * 3, m_a=[1.0, 2.0, 3.0])
T0 = np.array([0.5, -0.6, 0.5])
LINK, ALONG, ACROSS = np.array([1e-7, 5e-8, 3e-8]), np.array([1e-7, 2e-7, 3e-7]), np.array([5e-8, 1e-7, 1.5e-7])
SPRINGS = LinkSprings(link=LINK, drive=ALONG, frame_across=ACROSS)
WRENCH = np.array([300.0, -200.0, -400.0, 20.0, -30.0, 40.0])


class Loaded(GantryTau):
    """The L1 on elastic links and guideways, without gravity, its axes held, a force F at the tool."""

    hold = gt.parameter(shape=3, unit="m")
    F = gt.input(3, unit="N")
    world = gt.part(m.World, g=[0.0, 0.0, 0.0])
    load = gt.part(m.PointLoad)

    def equations(self):
        yield from super().equations()
        yield gt.connect(self.load.frame, self.plate.frame)
        yield self.load.force == self.F
        yield self.q == self.hold


@pytest.fixture(scope="module")
def l1():
    return gt.robots.gantry_tau("l1_tape", **MASSES)


@pytest.fixture(scope="module")
def structure(l1):
    return LinkStructure(LinkGeometry(l1)(T0), SPRINGS)


@pytest.fixture(scope="module")
def f1():
    robot = gt.robots.f1_gantry_tau()
    return robot, LinkGeometry(robot)(robot.home + np.array([0.1, -0.05, 0.2]))


@pytest.fixture
def d1():
    robot = gt.robots.six_link_gantry_tau()
    return robot, LinkGeometry(robot)(robot.home + np.array([0.1, 0.1, -0.1]))


STIFF = LinkSprings(link=1e-7, joint=1e-8, drive=[1e-7, 2e-7, 3e-7], axis=[1e-6, 2e-6, 3e-6], cart=1e-8,
                    frame_along=2e-8, frame_across=[5e-8, 1e-7, 1.5e-7])  # fmt: skip


def test_the_equation_core_with_a_spring_in_every_rod_gives_the_same(l1, structure):
    p = structure.poses
    guideways = [m.CompliantGuideway(K=np.diag([1 / a, 1 / c, 1 / c])) for a, c in zip(ALONG, ACROSS, strict=True)]
    arms = [dict(rod=m.ElasticRod(k=1 / c), guideway=g) for c, g in zip(LINK, guideways, strict=True)]
    elastic = Loaded(**gt.robots.gantry_tau("l1_tape", arm=arms, **MASSES).__dict__["_modifiers"], hold=p.q[0])
    carts = [f"arm[{i}].rod.a.r" for i in range(3)]
    start = {"T": T0, **dict(zip(carts, p.a[0], strict=True))}
    linear = gt.linearize(elastic, "F", ["T", "tau"], start=start)
    gain = (linear.D - linear.C @ np.linalg.solve(linear.A, linear.B))[:3]
    C = structure.compliance()[0]
    np.testing.assert_allclose(C, gain, rtol=0, atol=LINEAR * np.abs(C).max())
    frequencies = np.sort(np.abs(np.linalg.eigvals(linear.A)))[::2] / (2 * np.pi)
    np.testing.assert_allclose(LinkMasses.of(l1).frequencies(structure, 12)[0], frequencies, rtol=LINEAR)

    # under a load that counts, Newton on the core's accelerations: what C leaves out is of second order
    rest = elastic.causal(known="F", targets=["der(T,2)", *(f"der({name},2)" for name in carts)])

    def moved(force):
        x = np.concatenate([T0, *p.a[0]])
        for _ in range(8):
            arguments = [*np.split(x, 4), force]
            *rates, status = rest(*arguments)
            slope, _ = rest.jacobian(*arguments)
            assert status == Status.OK
            x = x - np.linalg.solve(slope[:, :12], np.concatenate(rates))
        return x[:3] - T0

    errors = [np.linalg.norm(moved(f * WRENCH[:3]) - f * C @ WRENCH[:3]) for f in (10.0, 20.0)]
    assert 3.8 < errors[1] / errors[0] < 4.2
    assert errors[0] < 1e-2 * np.linalg.norm(10 * C @ WRENCH[:3])


def energy_hessian(robot, p, springs):
    """Second derivative of the springs' energy by plate, carts along and across, rotary axes: from geometry alone."""
    joints = robot.causal(known="q", targets=[f"{n}.a.r" for n in LinkGeometry(robot).links]).casadi
    x, s = ca.SX.sym("x", 6), ca.SX.sym("s", 3 * p.carts + p.q.shape[1] - p.carts)
    S = ca.skew(x[3:])
    R = ca.SX.eye(3) + S + S @ S / 2
    structure = LinkStructure(p, springs)
    frames, w = structure.frames[0], np.linalg.norm(p.cart_motion[0], axis=1)
    q = ca.SX(p.q[0])
    for i in range(p.carts):
        q[i] += s[3 * i] / w[i]
    for j in range(p.q.shape[1] - p.carts):
        q[p.carts + j] += s[3 * p.carts + j]
    a = joints.call([q])
    energy = ca.SX(0)
    for k, i in enumerate(p.stands_on):
        cart = a[k] + s[3 * i + 1] * frames[i, 1] + s[3 * i + 2] * frames[i, 2]
        stretch = ca.norm_2(p.T[0] + x[:3] + R @ p.arms[0, k] - cart) - p.lengths[0, k]
        energy += stretch**2 / (2 * structure.total[k])
    energy += ca.sum1(s**2 / (2 * structure.total[6:]))
    z = ca.vertcat(x, s)
    return structure, np.array(ca.Function("H", [z], [ca.hessian(energy, z)[0]])(0))


@pytest.mark.parametrize(
    ("posed", "springs"), [("f1", STIFF), pytest.param("d1", replace(STIFF, axis=0.0), marks=pytest.mark.proof)]
)
def test_stiffness_is_the_curvature_of_the_springs_energy(posed, springs, request):
    robot, poses = request.getfixturevalue(posed)
    structure, H = energy_hessian(robot, poses, springs)
    np.testing.assert_allclose(structure.stiffness()[0], H, rtol=0, atol=ROUNDING * np.abs(H).max())
    C = structure.compliance()[0]
    np.testing.assert_allclose(C, C.T, rtol=0, atol=ROUNDING * np.abs(C).max())  # reciprocity
    condensed = np.linalg.inv(H)[:6, :6]
    np.testing.assert_allclose(C, condensed, rtol=0, atol=1e-7 * np.abs(C).max())
    assert np.linalg.eigvalsh(C)[0] > 0 and np.linalg.eigvalsh(H)[0] > 0


def test_springs_in_series_and_in_parallel(f1):
    p = f1[1]
    whole = LinkStructure(p, STIFF)
    C = whole.compliance()
    np.testing.assert_allclose(sum(whole.compliance(g) for g in GROUPS), C, rtol=ROUNDING, atol=1e-20)
    # one spring in place of a rod with its joints, and of drive, bearing and frame
    one = replace(STIFF, link=1.2e-7, joint=0.0, cart=0.0, frame_along=0.0, drive=[1.2e-7, 2.2e-7, 3.2e-7],
                  frame_across=[6e-8, 1.1e-7, 1.6e-7])  # fmt: skip
    np.testing.assert_allclose(LinkStructure(p, one).compliance(), C, rtol=1e-12)
    rods = LinkStructure(p, LinkSprings(link=1e-7, joint=1e-8)).compliance()
    two = LinkStructure(p, LinkSprings(link=1e-7, joint=1e-8, parallel=2)).compliance()
    np.testing.assert_allclose(two, rods / 2, rtol=1e-12)
    # any softer spring softens in every direction
    for name in ("link", "joint", "drive", "axis", "cart", "frame_along", "frame_across"):
        softer = replace(STIFF, **{name: 1.5 * np.asarray(getattr(STIFF, name))})
        least = np.linalg.eigvalsh(LinkStructure(p, softer).compliance()[0] - C[0])[0]
        assert least > -ROUNDING * np.abs(C).max(), name


def test_work_of_the_load_is_that_of_the_springs(f1):
    s = LinkStructure(f1[1], STIFF)
    work = WRENCH @ s.deflection(WRENCH)[0] / 2
    assert work == pytest.approx(WRENCH @ s.compliance()[0] @ WRENCH / 2, rel=1e-12)
    assert work == pytest.approx(s.total @ s.spring_forces(WRENCH)[0] ** 2 / 2, rel=1e-12)
    assert sum(x[0] for x in s.shares(WRENCH).values()) == pytest.approx(1.0, rel=1e-12)


def test_the_frame_of_the_world_and_the_tool_point_do_not_matter(f1):
    p = f1[1]
    C = LinkStructure(p, STIFF).compliance()[0]
    Q = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    Q *= np.linalg.det(Q)
    assert p.R is not None
    turned = replace(p, T=p.T @ Q.T, R=Q @ p.R, a=p.a @ Q.T + 2.0, b=p.b @ Q.T + 2.0, moved=Q @ p.moved)
    turned = replace(turned, T=turned.T + 2.0)
    both = scipy.linalg.block_diag(Q, Q)
    found = LinkStructure(turned, STIFF).compliance()[0]
    np.testing.assert_allclose(found, both @ C @ both.T, rtol=0, atol=ROUNDING * np.abs(C).max())
    # seen from another point of the plate: displaced by rotation times arm
    d = np.array([0.1, -0.2, 0.3])
    X = np.eye(6)
    X[:3, 3:] = np.array([[0, d[2], -d[1]], [-d[2], 0, d[0]], [d[1], -d[0], 0]])
    elsewhere = LinkStructure(replace(p, T=p.T + d), STIFF).compliance()[0]
    np.testing.assert_allclose(elsewhere, X @ C @ X.T, rtol=0, atol=ROUNDING * np.abs(C).max())


def test_rigid_links_leave_the_drives_and_the_robots_own_inertia(l1, structure):
    only = LinkStructure(structure.poses, LinkSprings(link=0.0, drive=ALONG))
    J, _ = l1.causal(known="q", targets="T").jacobian(structure.poses.q[0])
    np.testing.assert_allclose(only.compliance()[0], (J * ALONG) @ J.T, rtol=1e-10)
    with pytest.raises(ValueError, match="rigid links have no finite stiffness"):
        only.stiffness()
    # nearly rigid links: the pencil of drives and joint-space inertia, from the compiled inverse dynamics
    nearly = LinkStructure(structure.poses, LinkSprings(link=1e-14, drive=ALONG))
    inverse = l1.causal(known="T", targets="tau")
    slope = inverse.jacobian(T0, np.zeros(3), np.zeros(3))[0][:, 6:9]  # d tau / d acceleration of T
    w2 = scipy.linalg.eigh(np.diag(1 / ALONG), slope @ J, eigvals_only=True)
    found = LinkMasses.of(l1).frequencies(nearly, 3)[0]
    np.testing.assert_allclose(found, np.sqrt(w2) / (2 * np.pi), rtol=1e-6)


def test_weights_load_the_drives_as_inverse_dynamics_says(l1, structure):
    masses = LinkMasses.of(l1)
    weight = masses.weight(structure)
    forces = structure.spring_forces(weight[:, :3], weight[:, 3:])[0]
    *_, status = found = l1.causal(known="T", targets="tau")(T0, np.zeros(3), np.zeros(3))
    assert status == Status.OK
    np.testing.assert_allclose(-forces[3::3], found[0], rtol=1e-9, atol=1e-9)
    sag = masses.sag(structure)[0]
    # Castigliano: a small force at the tool meets the weights' work
    x = np.linalg.solve(structure.stiffness()[0], weight[0])
    np.testing.assert_allclose(sag, x[:3], rtol=1e-7)


def test_frequencies_fall_with_payload_and_scale_with_springs(l1, structure):
    masses = LinkMasses.of(l1)
    f = masses.frequencies(structure, 12)
    heavier = replace(masses, m_p=masses.m_p + 5.0).frequencies(structure, 12)
    assert np.all(heavier <= f * (1 + ROUNDING)) and heavier[0, 0] < f[0, 0]
    softer = LinkStructure(structure.poses, LinkSprings(link=4 * LINK, drive=4 * ALONG, frame_across=4 * ACROSS))
    np.testing.assert_allclose(masses.frequencies(softer, 12), f / 2, rtol=1e-10)


@pytest.mark.parametrize("of", ["l1", "d1", "f1"])
def test_mode_shapes_vibrate_at_their_frequencies(of, request):
    """K x = w^2 M x, row by row: a Rayleigh quotient alone hardly sees a wrong shape. Shapes are M-orthogonal."""
    robot, poses = (request.getfixturevalue(of), None) if of == "l1" else request.getfixturevalue(of)
    axis = STIFF.axis if of == "f1" else 0.0
    s = request.getfixturevalue("structure") if poses is None else LinkStructure(poses, replace(STIFF, axis=axis))
    masses = LinkMasses.of(robot)
    frequencies, x = masses.shapes(s, 4)
    K, M = s.stiffness()[0], masses.matrix(s)[0]
    moves = np.abs(x).max(axis=0) > 0  # rigid supports stand still, and their stiffness is infinite
    K, M, x = K[moves][:, moves], M[moves][:, moves], x[:, moves]
    left, right = x @ K, (2 * np.pi * frequencies[:, None]) ** 2 * (x @ M)
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-7 * np.abs(left).max())
    np.testing.assert_allclose(frequencies, masses.frequencies(s, 4)[0], rtol=1e-10)
    energies = x @ M @ x.T
    assert np.abs(energies - np.diag(np.diag(energies))).max() < 1e-9 * np.diag(energies).min()


def test_a_pose_that_holds_nothing_is_nan(l1, structure):
    p = structure.poses
    flat = replace(p, T=p.a[:, :1].mean(axis=1), b=p.a + np.array([1.0, 0.0, 0.0]))  # all links parallel
    s = LinkStructure(flat, SPRINGS)
    assert np.isnan(s.compliance()).all() and np.isnan(LinkMasses.of(l1).frequencies(s)).all()
    unreachable = LinkGeometry(l1)(np.array([[0.5, -0.6, 9.0], [*T0]]))
    C = LinkStructure(unreachable, SPRINGS).compliance()
    assert np.isnan(C[0]).all() and np.allclose(C[1], structure.compliance()[0], rtol=1e-12)


def test_refusals(l1, structure):
    with pytest.raises(ValueError, match=r"link must be a compliance of zero or more; found -1"):
        LinkSprings(link=-1.0)
    with pytest.raises(ValueError, match=r"drive has 2 numbers; expected one, or 3"):
        LinkStructure(structure.poses, LinkSprings(link=1e-7, drive=[1e-7, 1e-7])).compliance()
    with pytest.raises(ValueError, match=r"number of parallel rods, 1 or more; found 0"):
        LinkSprings(link=1e-7, parallel=0)
    with pytest.raises(ValueError, match="a tube needs a modulus above 0"):
        tube(1e9, 0.02, 0.02, 1.0)
    with pytest.raises(ValueError, match="a compliant part has no mass"):
        replace(LinkMasses.of(l1), m_c=np.zeros(3), m_a=np.zeros(3)).frequencies(structure)
    with pytest.raises(gt.ModelError, match="a plate T on links and axes q; it has no links"):
        LinkGeometry(gt.robots.kr500())
    with pytest.raises(ValueError, match="expected masses of 3 carts and 3 links; found 3, 2"):
        replace(LinkMasses.of(l1), m_a=np.zeros(2)).matrix(structure)


def test_a_tube():
    # a rod of 1 m, 1 cm2 and 100 GPa deflects by 0.1 um/N
    outer = np.sqrt(4e-4 / np.pi)
    assert tube(1e11, outer, 0.0, 1.0) == pytest.approx(1e-7)
    assert tube(1e11, outer, outer / np.sqrt(2), [1.0, 2.0]) == pytest.approx([2e-7, 4e-7])


@pytest.mark.parametrize("parallel", [0, np.nan, [1, 1, np.inf]])
def test_rods_side_by_side_are_counted(parallel):
    with pytest.raises(ValueError, match="number of parallel rods"):
        LinkSprings(link=1e-7, parallel=parallel)


def test_a_load_that_is_no_number_is_refused(structure):
    with pytest.raises(ValueError, match="expected finite numbers"):
        structure.deflection([np.nan, 0.0, 0.0])


def test_a_pose_without_a_solution_does_not_take_the_loads_of_the_others(l1):
    out_of_reach = T0 + np.array([0.0, 50.0, 0.0])
    both = LinkStructure(LinkGeometry(l1)(np.vstack([T0, out_of_reach])), SPRINGS)
    load = np.array([[0.0, 0.0, -10.0], [np.nan] * 3])
    found = both.deflection(load)
    alone = LinkStructure(LinkGeometry(l1)(T0), SPRINGS).deflection(load[:1])
    assert np.array_equal(found[:1], alone) and np.isfinite(alone).all() and np.isnan(found[1]).all()
    with pytest.raises(ValueError, match="expected finite numbers"):
        both.deflection(load[::-1])
