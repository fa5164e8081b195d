"""Platforms on struts: a tripod in closed form both ways, and a hexapod."""

from __future__ import annotations

from functools import cache

import numpy as np

import gtmodel as gt
from gtmodel import Status
from gtmodel.mechanics import Anchor, AnyQuaternion, PointMass, RigidPlate, Strut
from tests.mechanics.balance import power_balance
from tests.support.compare import relative_error
from tests.support.residuals import arguments, original_residuals

# Some hundred operations; the platforms are well conditioned.
ROUND_OFF = 1e-12
RESIDUAL = 1e-10
GRAVITY = np.array([0.0, 0.0, -9.81])


class Tripod(gt.Model):
    """A point mass on three struts; branch `above`: over the plane of the feet."""

    A = gt.parameter([[1.0, 0.0, 0.0], [-0.5, 0.9, 0.1], [-0.4, -0.8, 0.05]], unit="m")
    r = gt.variable(3, unit="m", start=[0.0, 0.0, 1.0], prefer=1)
    L = gt.variable(3, unit="m")
    force = gt.input(3, unit="N")
    foot = gt.parts(3, Anchor, r=A)
    strut = gt.parts(3, Strut)
    mass = gt.part(PointMass, m=4.0)

    def equations(self):
        for i, strut in enumerate(self.strut):
            yield gt.connect(self.foot[i].point, strut.a)
            yield gt.connect(strut.b, self.mass.frame)
            yield self.L[i] == strut.length
            yield self.force[i] == strut.force
        yield self.mass.frame.r == self.r
        yield gt.branch("above", self.r[2])


def test_tripod_both_ways():
    model = Tripod()
    r, v, a = np.array([0.2, -0.1, 0.9]), np.array([0.3, 0.5, -0.2]), np.array([1.0, 2.0, 3.0])
    ab = r - np.array(model.A)
    length = np.linalg.norm(ab, axis=1)
    unit = ab / length[:, None]
    inverse = model.causal("r", ["L", "der(L)", "force"])
    assert "Newton" not in {b.kind for b in inverse.plan.blocks}
    L, rate, force, status = inverse(r, v, a)
    assert status == Status.OK
    assert relative_error(L, length) < ROUND_OFF
    assert relative_error(rate, unit @ v) < ROUND_OFF
    assert relative_error(force, np.linalg.solve(unit.T, 4 * (a - GRAVITY))) < ROUND_OFF
    forward = model.causal("L", "r")
    assert "sphere pencil" in {b.kind for b in forward.plan.blocks}
    back, status = forward(L)
    assert status == Status.OK
    assert relative_error(back, r) < ROUND_OFF
    below, status = model.causal("L", "r", branches={"above": -1})(L)
    assert status == Status.OK and below[2] < 0
    values = {"r": r, "der(r)": v, "force": force}
    assert np.max(np.abs(original_residuals(model, values, "force"))) < RESIDUAL
    assert power_balance(model, values, "force") < ROUND_OFF


M, C, I = 6.0, np.array([0.02, -0.01, 0.05]), np.diag([0.1, 0.12, 0.2])
ANGLES = np.radians([-10, 10, 110, 130, 230, 250])
FEET = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES])
TURNED = np.radians([-50, 50, 70, 170, 190, 290])
JOINTS = 0.5 * np.column_stack([np.cos(TURNED), np.sin(TURNED), 0 * TURNED])


class Hexapod(gt.Model):
    """A plate on six struts: pose r, e and leg lengths L."""

    r = gt.variable(3, unit="m", start=[0.0, 0.0, 1.0], prefer=1)
    e = gt.variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0])
    L = gt.variable(6, unit="m", start=1.2)
    force = gt.input(6, unit="N")
    foot = gt.parts(6, Anchor, r=FEET)
    strut = gt.parts(6, Strut)
    plate = gt.part(RigidPlate, m=M, c=C, I=I, B=JOINTS)

    def equations(self):
        for i, strut in enumerate(self.strut):
            yield gt.connect(self.foot[i].point, strut.a)
            yield gt.connect(strut.b, self.plate.point[i])
            yield self.L[i] == strut.length
            yield self.force[i] == strut.force
        yield self.plate.frame.r == self.r
        yield self.e == self.plate.attitude.e


@cache
def inverse() -> gt.CausalFunction:
    return Hexapod(plate=dict(attitude=AnyQuaternion)).causal(["r", "e"], ["L", "force", "plate.frame.R"])


def test_hexapod_from_its_pose_in_closed_form():
    f = inverse()
    assert {b.kind for b in f.plan.blocks} <= {"explicit", "linear", "quadratic"}
    e = np.array([0.9, 0.1, -0.2, 0.15])
    r = np.array([0.1, 0.05, 0.95])
    values = {"r": r, "e": e} | {f"der({n},{k})" if k > 1 else f"der({n})": 0 * x for k in (1, 2) for n, x in
                                 (("r", r), ("e", e))}  # fmt: skip
    L, force, R, status = f(*arguments(f, values))
    assert status == Status.OK
    legs = r + JOINTS @ R.T - FEET
    assert relative_error(L, np.linalg.norm(legs, axis=1)) < ROUND_OFF
    unit = legs / L[:, None]
    # at rest the pushes carry the weight and its moment about r
    arm, weight = R @ C, -M * GRAVITY
    wrench = np.vstack([unit.T, np.cross(JOINTS @ R.T, unit).T])
    assert relative_error(wrench @ force, np.concatenate([weight, np.cross(arm, weight)])) < 10 * ROUND_OFF


def test_hexapod_from_its_lengths_by_newton():
    f = Hexapod().causal("L", ["r", "e"])
    assert "Newton" in {b.kind for b in f.plan.blocks}
    rng = np.random.default_rng(2)
    for _ in range(5):
        e = np.array([1.0, *rng.uniform(-0.15, 0.15, 3)])
        e /= np.linalg.norm(e)
        r = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.15, 0.15, 3)
        g = inverse()
        zero = {f"der({n})": np.zeros(k) for n, k in (("r", 3), ("e", 4))}
        zero |= {f"der({n},2)": np.zeros(k) for n, k in (("r", 3), ("e", 4))}
        L = g(*arguments(g, {"r": r, "e": e} | zero))[0]
        back, again, status = f(L)
        assert status == Status.OK
        assert relative_error(back, r) < 100 * ROUND_OFF
        assert relative_error(again * np.sign(again[0]), e) < 100 * ROUND_OFF  # -e is the same orientation
