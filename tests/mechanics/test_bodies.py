"""Rigid bodies that move freely: against pinocchio, and by what must stay constant."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status
from gtmodel.mechanics import (
    Anchor,
    AnyQuaternion,
    FrameLoad,
    FreeBody,
    Ground,
    PointOnFrame,
    Spherical,
    UnitQuaternion,
    World,
    ZYZAngles,
)
from tests.mechanics.balance import power_balance
from tests.support.compare import relative_error
from tests.support.residuals import arguments, original_residuals

# Some hundred operations on numbers of order 1 to 1e2; nothing here is ill-conditioned.
ROUND_OFF = 1e-12
RESIDUAL = 1e-10

M, C = 3.0, np.array([0.1, -0.2, 0.15])
I = np.array([[0.3, 0.02, -0.01], [0.02, 0.4, 0.03], [-0.01, 0.03, 0.2]])


class LoadedBody(gt.Model):
    """A free body that a load pushes and turns."""

    r = gt.variable(3, unit="m", prefer=1)
    w = gt.variable(3, unit="rad/s", prefer=1)
    force = gt.input(3, unit="N")
    torque = gt.input(3, unit="N.m")
    body = gt.part(FreeBody, m=M, c=C, I=I)
    load = gt.part(FrameLoad)

    def equations(self):
        yield gt.connect(self.body.frame, self.load.frame)
        yield self.r == self.body.frame.r
        yield self.w == self.body.frame.w
        yield self.force == self.load.force
        yield self.torque == self.load.torque


@cache
def loaded(attitude: type = UnitQuaternion) -> gt.Model:
    return LoadedBody(body=dict(attitude=attitude))


def rotation(e: np.ndarray) -> np.ndarray:
    """Rotation of a quaternion of any length: columns are e x e* for the unit vectors x."""
    a, v = e[0], e[1:]
    return ((a * a - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * a * np.cross(np.eye(3), v)) / (e @ e)


def quaternion_rates(e, w, turn):
    """e' = w e / 2 and e'' of a unit quaternion, w and its derivative in world coordinates."""

    def half_product(x, y):
        return 0.5 * np.concatenate([[-x @ y[1:]], y[0] * x + np.cross(x, y[1:])])

    first = half_product(w, e)
    return first, half_product(turn, e) + half_product(w, first)


def draw(seed: int, upper: bool = False) -> dict[str, np.ndarray]:
    """Position, quaternion, velocities and accelerations of a body.

    upper: e[0] > 0.2, on the side of the start values and not near the plane where e[0] changes its side.
    """
    rng = np.random.default_rng(seed)
    e = rng.normal(size=4)
    if upper:
        e[0] = 0.5 + abs(e[0])
    s = {k: rng.normal(size=3) for k in ("r", "v", "a", "w", "turn")}
    s["e"] = e / np.linalg.norm(e)
    s["de"], s["dde"] = quaternion_rates(s["e"], s["w"], s["turn"])
    return s


def wrench(s):
    """Newton and Euler about the centre of mass, moved to the frame's origin: the force and torque that must act."""
    R = rotation(s["e"])
    arm, inertia = R @ C, R @ I @ R.T
    a_c = s["a"] + np.cross(s["turn"], arm) + np.cross(s["w"], np.cross(s["w"], arm))
    force = M * (a_c - np.array([0, 0, -9.81]))
    return force, inertia @ s["turn"] + np.cross(s["w"], inertia @ s["w"]) + np.cross(arm, force)


def test_wrench_against_pinocchio():
    pin = pytest.importorskip("pinocchio", reason="pinocchio, the oracle of free bodies, is not installed")
    oracle = pin.Model()
    oracle.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    oracle.appendBodyToJoint(1, pin.Inertia(M, C, I), pin.SE3.Identity())
    work = oracle.createData()
    for seed in range(10):
        s = draw(seed)
        R = rotation(s["e"])
        q = np.concatenate([s["r"], s["e"][1:], s["e"][:1]])
        spatial = R.T @ (s["a"] - np.cross(s["w"], s["v"]))
        tau = pin.rnea(
            oracle, work, q, np.concatenate([R.T @ s["v"], R.T @ s["w"]]), np.concatenate([spatial, R.T @ s["turn"]])
        )
        force, torque = wrench(s)
        assert relative_error(np.concatenate([R.T @ force, R.T @ torque]), tau) < ROUND_OFF


class TestInverseDynamics:
    """Motion known, load asked for."""

    def test_quaternion_of_any_length(self):
        f = loaded(AnyQuaternion).causal(["r", "body.attitude.e"], ["force", "torque", "w", "der(w)"])
        assert {b.kind for b in f.plan.blocks} == {"explicit"}
        for seed in range(10):
            s = draw(seed)
            rng = np.random.default_rng(seed)
            n, dn, ddn = rng.uniform(0.5, 2), *rng.normal(size=2)
            e = (n * s["e"], dn * s["e"] + n * s["de"], ddn * s["e"] + 2 * dn * s["de"] + n * s["dde"])
            force, torque, w, turn, status = f(
                *arguments(f, {"r": s["r"], "der(r)": s["v"], "der(r,2)": s["a"], "body.attitude.e": e[0],
                               "der(body.attitude.e)": e[1], "der(body.attitude.e,2)": e[2]})
            )  # fmt: skip
            assert status == Status.OK
            assert relative_error(w, s["w"]) < ROUND_OFF * 10  # divided twice by |e|^2, down to 1/4
            assert relative_error(turn, s["turn"]) < ROUND_OFF * 10
            expected = wrench(s)
            assert relative_error(force, expected[0]) < ROUND_OFF * 10
            assert relative_error(torque, expected[1]) < ROUND_OFF * 10

    def test_angles(self):
        f = loaded(ZYZAngles).causal(["r", "body.attitude.angles"], ["body.frame.R", "w", "der(w)"])
        rng = np.random.default_rng(1)
        a, da, dda = rng.uniform(0.3, 2.5, 3), rng.normal(size=3), rng.normal(size=3)
        name = "body.attitude.angles"
        R, w, turn, status = f(*arguments(f, {name: a, f"der({name})": da, f"der({name},2)": dda}))
        assert status == Status.OK

        def matrix(t):
            x = a + da * t + dda * t * t / 2
            (ca, cb, cc), (sa, sb, sc) = np.cos(x), np.sin(x)
            about_z = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
            about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
            return about_z @ about_y @ np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])

        assert relative_error(R, matrix(0.0)) < ROUND_OFF
        # R' R^T is skew and its axial vector is w: by complex step, and der(w) by differences of that
        step, h = 1e-30, 1e-4

        def velocity(t):
            spin = (matrix(t + 1j * step).imag / step) @ matrix(t).T
            return np.array([spin[2, 1], spin[0, 2], spin[1, 0]])

        assert relative_error(w, velocity(0.0)) < ROUND_OFF
        assert relative_error(turn, (velocity(h) - velocity(-h)) / (2 * h)) < 1e-6  # h^2


class TestForwardDynamics:
    """Load known, motion asked for: states r, three of e, and w."""

    TARGETS = (
        "der(r,2)",
        "der(w)",
        "body.attitude.e",
        "der(body.attitude.e)",
        "der(body.attitude.e,2)",
        "body.frame.R",
    )

    def solve(self, s, force, torque):
        model = loaded()
        f = model.causal(["force", "torque"], list(self.TARGETS))
        values = {"r": s["r"], "der(r)": s["v"], "w": s["w"], "body.attitude.e": s["e"],
                  "der(body.attitude.e)": s["de"], "force": force, "torque": torque}  # fmt: skip
        *found, status = f(*arguments(f, values))
        assert status == Status.OK
        return dict(zip(self.TARGETS, found, strict=True))

    @pytest.mark.parametrize("seed", range(6))
    def test_forward_after_inverse_is_the_identity(self, seed):
        s = draw(seed, upper=True)
        found = self.solve(s, *wrench(s))
        assert relative_error(found["der(r,2)"], s["a"]) < ROUND_OFF * 10
        assert relative_error(found["der(w)"], s["turn"]) < ROUND_OFF * 10
        assert relative_error(found["body.attitude.e"], s["e"]) < ROUND_OFF
        assert relative_error(found["der(body.attitude.e)"], s["de"]) < ROUND_OFF * 10
        assert relative_error(found["der(body.attitude.e,2)"], s["dde"]) < ROUND_OFF * 100  # divided by e[0]

    def test_without_load_momenta_are_constant_and_e_keeps_its_length(self):
        s = draw(3, upper=True)
        found = self.solve(s, np.zeros(3), np.zeros(3))
        R = found["body.frame.R"]
        arm, inertia = R @ C, R @ I @ R.T
        turn, e, de, dde = (found[k] for k in self.TARGETS[1:5])
        a_c = found["der(r,2)"] + np.cross(turn, arm) + np.cross(s["w"], np.cross(s["w"], arm))
        assert relative_error(a_c, [0, 0, -9.81]) < ROUND_OFF * 10
        assert np.max(np.abs(inertia @ turn + np.cross(s["w"], inertia @ s["w"]))) < ROUND_OFF * 10
        assert abs(e @ e - 1) < ROUND_OFF
        assert abs(e @ de) < ROUND_OFF
        assert abs(e @ dde + de @ de) < ROUND_OFF * 10

    def test_every_equation_as_written_holds(self):
        s = draw(3, upper=True)
        values = {"r": s["r"], "der(r)": s["v"], "w": s["w"], "body.attitude.e": s["e"],
                  "der(body.attitude.e)": s["de"], "force": s["a"], "torque": s["v"]}  # fmt: skip
        assert np.max(np.abs(original_residuals(loaded(), values, ["force", "torque"]))) < RESIDUAL
        assert power_balance(loaded(), values, ["force", "torque"]) < ROUND_OFF


class PointedPendulum(gt.Model):
    """A body on a spherical joint between points."""

    world = gt.part(World, g=[1.0, -2.0, -9.0])
    anchor = gt.part(Anchor)
    point = gt.part(PointOnFrame)
    body = gt.part(FreeBody, m=M, c=C, I=I)
    w = gt.variable(3, unit="rad/s")

    def equations(self):
        yield self.w == self.body.frame.w
        yield gt.connect(self.anchor.point, self.point.point)
        yield gt.connect(self.point.frame, self.body.frame)


class FramedPendulum(gt.Model):
    """The same on a spherical joint between frames."""

    world = gt.part(World, g=[1.0, -2.0, -9.0])
    ground = gt.part(Ground)
    joint = gt.part(Spherical)
    body = gt.part(FreeBody, m=M, c=C, I=I)
    w = gt.variable(3, unit="rad/s")

    def equations(self):
        yield self.w == self.body.frame.w
        yield gt.connect(self.ground.frame, self.joint.a)
        yield gt.connect(self.joint.b, self.body.frame)


@pytest.mark.parametrize("pendulum", [PointedPendulum, FramedPendulum])
def test_spherical_joint(pendulum):
    # about a fixed point: (I + m(|c|^2 - c c)) turn + w x (.) w = c x m g, world axes
    s = draw(3, upper=True)
    R = rotation(s["e"])
    f = pendulum().causal((), ["der(w)"])
    values = {"body.attitude.e": s["e"], "der(body.attitude.e)": s["de"], "w": s["w"]}
    turn, status = f(*arguments(f, values))
    assert status == Status.OK
    about_point = R @ (I + M * (C @ C * np.eye(3) - np.outer(C, C))) @ R.T
    torque = np.cross(R @ C, M * np.array([1.0, -2.0, -9.0]))
    expected = np.linalg.solve(about_point, torque - np.cross(s["w"], about_point @ s["w"]))
    assert relative_error(turn, expected) < ROUND_OFF * 10


class Tumbling(gt.Model):
    """A free body in weightlessness, spinning about its middle axis, which is unstable; h is its angular momentum."""

    world = gt.part(World, g=[0.0, 0.0, 0.0])
    body = gt.part(FreeBody, m=1.0, I=np.diag([0.1, 0.2, 0.3]))
    w = gt.variable(3, unit="rad/s", start=[0.1, 3.0, 0.1])
    e = gt.variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0])
    h = gt.variable(3)

    def equations(self):
        R = self.body.frame.R
        yield self.w == self.body.frame.w
        yield self.e == self.body.attitude.e
        yield R @ (self.body.I @ (self.w @ R)) == self.h

    def initial_equations(self):
        yield self.body.frame.r == np.zeros(3)
        yield gt.der(self.body.frame.r) == np.zeros(3)
        yield self.w == [0.1, 3.0, 0.1]
        yield self.e[1:] == np.zeros(3)


def test_a_tumbling_body_changes_its_states_and_keeps_its_momentum():
    # every component of e passes through zero: no fixed choice of three of them lasts
    run = gt.simulate(Tumbling(), 5.0, outputs=["h", "e"], tolerance=1e-9)
    h, e = run.trajectory["h"], run.trajectory["e"]
    assert len(run.switches) > 2
    assert np.all(np.ptp(np.sign(e), axis=0) == 2)
    drift = 1e-6  # a thousand steps of 1e-9
    assert np.max(np.ptp(h, axis=0)) < drift
    assert run.energy_error < drift
    assert np.max(np.abs(np.sum(e**2, axis=1) - 1)) < ROUND_OFF  # an equation, not an integral


def test_a_body_that_falls_has_energy_that_moves():
    """Kinetic and potential energy are terms of their own: their sum, which stays, is no measure of what moved."""
    for body in (FreeBody(m=2.0, I=0.01 * np.eye(3)), gt.mechanics.PointMass(m=2.0)):
        run = body.simulate(1.0)
        assert run.status.value == "solved" and run.checks["energy_balance"].value < 1e-6
        fallen = np.ptp(run.trajectory["frame.r"][:, 2])
        assert fallen == pytest.approx(9.81 / 2, rel=1e-8)
