"""Loops of orientation are found and named; loops through points are fine."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.flat import flatten
from gtmodel.mechanics import Fixed, FixedTranslation, FreeBody, Ground, PointOnFrame, Spherical, UniformRod


class Truss(gt.Model):
    """A triangle of rigid parts: a loop of orientation without a joint."""

    ground = gt.part(Ground)
    arm = gt.part(FixedTranslation, d=[0.3, 0.0, 0.0])
    base = gt.part(FixedTranslation, d=[0.3, 0.4, 0.0])
    lever = gt.part(FixedTranslation, d=[0.0, 0.4, 0.0])

    def equations(self):
        yield gt.connect(self.ground.frame, self.arm.a)
        yield gt.connect(self.ground.frame, self.base.a)
        yield gt.connect(self.arm.b, self.lever.a)
        yield gt.connect(self.lever.b, self.base.b)


def test_a_loop_of_orientation_is_named_with_its_line_and_the_remedy():
    with pytest.raises(gt.ModelError) as error:
        flatten(Truss())
    text = str(error.value)
    line = Truss.equations.__code__.co_firstlineno + 4
    assert f"test_trees.py:{line}" in text
    loop = text.split(" (")[0]
    for name in ("arm", "lever", "base"):
        assert name in loop
    assert "nine numbers for three degrees of freedom" in text
    assert "rods or spherical joints" in text


class HeldBody(gt.Model):
    """A free body bolted to the world: both say how it is oriented."""

    ground = gt.part(Ground)
    post = gt.part(Fixed)
    body = gt.part(FreeBody, m=1.0, I=np.eye(3))

    def equations(self):
        yield gt.connect(self.ground.frame, self.post.a)
        yield gt.connect(self.post.b, self.body.frame)


def test_two_roots_in_one_tree_are_named():
    with pytest.raises(gt.ModelError, match=r"loop of .*(body|ground).*two components fix it.*test_trees.py:\d+"):
        flatten(HeldBody())


class ThroughPoints(gt.Model):
    """The same body held by a spherical joint and a rod: loops, but not of orientation."""

    ground = gt.part(Ground)
    joint = gt.part(Spherical)
    body = gt.part(FreeBody, m=1.0, I=np.eye(3))
    foot = gt.part(PointOnFrame, d=[1.0, 0.0, -1.0])
    eye = gt.part(PointOnFrame, d=[0.0, 0.0, -1.0])
    rod = gt.part(UniformRod, L=1.0, m=0.1)

    def equations(self):
        yield gt.connect(self.ground.frame, self.joint.a)
        yield gt.connect(self.joint.b, self.body.frame)
        yield gt.connect(self.body.frame, self.eye.frame)
        yield gt.connect(self.ground.frame, self.foot.frame)
        yield gt.connect(self.eye.point, self.rod.a)
        yield gt.connect(self.foot.point, self.rod.b)


def test_loops_through_points_are_fine():
    flat = flatten(ThroughPoints())
    assert len(flat.equations) == len(flat.variables)


def test_edges_take_overdetermined_ports_only():
    class Wrong(gt.Model):
        point = gt.port(gt.mechanics.PointFrame)

        def equations(self):
            yield gt.tree_root(self.point)

    with pytest.raises(gt.ModelError, match=r"tree_root\(\) takes ports of an overdetermined connector; found Point"):
        flatten(Wrong())
