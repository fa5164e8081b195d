"""Wrong mechanisms: one sentence each, with the joint or part and the line where the user declared it."""

from __future__ import annotations

import re

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.mechanics import (
    Fixed,
    FixedTranslation,
    FreeBody,
    GearPair,
    Ground,
    Inertia,
    PlanarLoopClosure,
    Prismatic,
    Revolute,
    Screw,
    Spherical,
    TorqueMotor,
    Universal,
)
from tests.support.mechanisms import (
    Bar,
    Bennett,
    FiveBar,
    Folded,
    FourBar,
    InLine,
    RigidUPU,
    Watt,
    X,
    Z,
    dropped,
)

LINE = r"(test_wrong_mechanisms|mechanisms)\.py:\d+"


def changed(cls, **parts):
    return type(cls.__name__, (cls,), parts)


class Rod(gt.Model):
    """A rod without a body from the ground to a pin, by two ball joints."""

    ground, pin = gt.part(Ground), gt.part(Revolute)
    low, high = gt.part(Spherical), gt.part(Spherical)
    bar, base = (gt.part(FixedTranslation, d=[d, 0.0, 0.0]) for d in (0.5, 0.8))
    crank = gt.part(FixedTranslation, d=[-0.3, 0.0, 0.0])

    def equations(self):
        yield gt.connect([self.ground.frame, self.low.b, self.bar.b], [self.low.a, self.bar.a, self.high.a])
        yield gt.connect([self.ground.frame, self.base.b, self.pin.b], [self.base.a, self.pin.a, self.crank.a])
        yield gt.connect(self.crank.b, self.high.b)


class Triangle(gt.Model):
    """Three bars with three pins: a truss."""

    ground = gt.part(Ground)
    motor = gt.part(TorqueMotor)
    left = gt.part(Bar, L=0.5)
    right = gt.part(Bar, L=0.6)
    foot = gt.part(FixedTranslation, d=[0.7, 0.0, 0.0])
    pin = gt.part(Revolute)

    def equations(self):
        yield gt.connect([self.ground.frame, self.left.b], [self.left.a, self.right.a])
        yield gt.connect([self.ground.frame, self.foot.b, self.right.b], [self.foot.a, self.pin.a, self.pin.b])
        yield gt.connect(self.motor.shaft, self.left.shaft)


class Braced(FourBar):
    """A four-bar whose crank and rocker are welded together."""

    brace = gt.part(FixedTranslation, d=[0.1, 0.2, 0.0])

    def equations(self):
        yield from super().equations()
        yield gt.connect([self.crank.link, self.brace.b], [self.brace.a, self.rocker.link])


class Welded(FourBar):
    """A four-bar whose pin is bypassed by a connection."""

    def equations(self):
        yield from super().equations()
        yield gt.connect(self.rocker.b, self.coupler.b)


class Pinned(FourBar):
    """A four-bar whose coupler is also pinned to the ground."""

    foot = gt.part(FixedTranslation, d=[0.3, 0.4, 0.0])
    nail = gt.part(Revolute)

    def equations(self):
        yield from super().equations()
        yield gt.connect([self.ground.frame, self.foot.b, self.nail.b], [self.foot.a, self.nail.a, self.coupler.link])


class TwoGrounds(gt.Model):
    """A body that a fixed part and its own coordinates hold."""

    ground = gt.part(Ground)
    post = gt.part(Fixed)
    body = gt.part(FreeBody, m=1.0, I=np.eye(3))

    def equations(self):
        yield gt.connect([self.ground.frame, self.post.b], [self.post.a, self.body.frame])


class Apart(gt.Model):
    """A body on two universal joints whose centres coincide on it, and are a metre apart on the ground."""

    ground = gt.part(Ground)
    foot = gt.part(FixedTranslation, d=[1.0, 0.0, 0.0])
    near = gt.part(Universal)
    far = gt.part(Universal)
    body = gt.part(FreeBody, m=1.0, I=np.eye(3))

    def equations(self):
        yield gt.connect([self.ground.frame, self.ground.frame], [self.near.a, self.foot.a])
        yield gt.connect([self.foot.b, self.near.b, self.far.b], [self.far.a, self.body.frame, self.body.frame])


def follow(model):
    return model.causal("crank.phi", "rocker.phi")


WRONG = {
    "three bars": (lambda: dropped(Triangle).causal("left.phi", "right.phi"), "mobility is 0.*locked.*'?left.joint"),
    "bars too short": (
        lambda: follow(dropped(FourBar).with_(lengths=[0.3, 0.2, 0.1, 0.8])),
        r"gap of 0\.\d+ m or rad remains at 'pin'",
    ),
    "redundant": (lambda: follow(FourBar()), r"closed by 'pin', and 3 .*position along z.*mobility is 1"),
    "redundant twice": (lambda: follow(Watt()), r"and 6 .*'pin', 'second_pin'"),
    "two of one": (
        lambda: dropped(FourBar).causal(["crank.phi", "rocker.phi"], "pin.a.r"),
        "2 positions .*mobility is 1",
    ),
    "angles and tool": (lambda: dropped(FiveBar).causal(["q", "T"], "tau"), "5 positions .*mobility is 2"),
    "tool in space": (lambda: dropped(FiveBar).causal("T", "q"), r"3 positions .*T\[2\].*mobility is 2"),
    "tilted pin": (
        lambda: follow(dropped(changed(FourBar, pin=gt.part(Revolute, axis=[0.0, 0.1, 1.0])))),
        r"gap of 0\.\d+ m or rad remains at 'pin'",
    ),
    "base out of plane": (
        lambda: follow(dropped(changed(FourBar, base=gt.part(FixedTranslation, d=[0.8, 0.0, 0.05])))),
        r"gap of 0\.\d+ m or rad remains at 'pin'",
    ),
    "no motor": (
        lambda: follow(dropped(changed(FourBar, motor=gt.part(Inertia, J=1.0)))),
        "crank.phi is known, and 1 motor too few.*connect a motor",
    ),
    "no loop to cut": (lambda: follow(dropped(FourBar, "base")), "'base', which closes no loop"),
    "slide of zero": (lambda: changed(FourBar, pin=gt.part(Prismatic, v=np.zeros(3)))().mobility(), "'pin.v' must be"),
    "axis of zero": (lambda: changed(FourBar, pin=gt.part(Revolute, axis=np.zeros(3)))().mobility(), "'pin.axis' must"),
    "brace": (lambda: follow(dropped(Braced)), r"cannot be assembled.*'rocker.joint'"),
    "bypassed pin": (lambda: follow(dropped(Welded)), r"cannot be assembled.*'coupler.joint'"),
    "nailed coupler": (lambda: follow(dropped(Pinned)), r"mobility is 0.*'?nail|cannot be assembled.*"),
    "fixed twice": (lambda: TwoGrounds().mobility(), "post.*two components fix it in the world"),
    "in line": (lambda: follow(InLine()), "start .*'pin', is singular: it has 2 instantaneous .*mobility 0"),
    "in line, dropped": (lambda: follow(dropped(InLine)), "start .*'pin', is singular: it has 2 .*mobility 0"),
    "folded": (lambda: follow(dropped(Folded)), "start .*'pin', is singular: it has 2 instantaneous .*mobility 1"),
    "legs that do not move": (
        lambda: dropped(RigidUPU).causal([f"leg[{k}].length" for k in range(6)], "T"),
        r"start .*'leg\[\d\].ball.first', is singular: it has 3 instantaneous .*mobility 0",
    ),
    "unequal links": (lambda: changed(Bennett, link=unequal())().mobility(), r"gap of 0\.\d+ m .*'joint\[2\]'"),
    "centres apart": (lambda: Apart().mobility(), r"cannot be assembled: a gap of 0.5 m or rad.*'near.second'"),
    "thread without a lead": (lambda: changed(FourBar, pin=gt.part(Screw))().mobility(), "'pin.lead' .* has no value"),
    "rod between balls without a body": (lambda: Rod().mobility(), "orientation of 'bar', which ball joints alone"),
    "gear of no radius": (lambda: GearPair(radius_1=0.0, radius_2=0.1), "'radius_1' is declared positive"),
}


def unequal():
    return gt.parts(4, gt.mechanics.FixedDH, a_x=[0.5, 0.8, 0.5, 0.9], alpha=[0.6, 1.2, 0.6, 1.2])


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_mechanism_is_one_sentence_with_joint_and_line(name):
    act, sentence = WRONG[name]
    with pytest.raises(gt.ModelError, match=sentence) as error:
        act()
    text = str(error.value)
    assert "\n" not in text
    if "no value" not in text:  # its line is where gtmodel declares the parameter
        assert re.search(LINE, text), text


def test_a_closure_in_another_plane_says_what_it_leaves_free():
    model = changed(FourBar, pin=gt.part(PlanarLoopClosure, first=X, second=Z))()
    m = model.mobility()
    assert (m.mobility, m.redundant) == (2, 1)
    assert m.constraints[0].names == ("position along z",)


def test_a_ball_joint_frees_what_a_pin_does_not():
    assert changed(FourBar, pin=gt.part(Spherical))().mobility().redundant == 1
