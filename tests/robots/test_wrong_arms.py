"""Wrong arms: one sentence each, with the joint and the line where the user declared it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import mechanics
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.robots import resolve

URDF = """<robot name="lever">
  <link name="base"/>
  <link name="upper"/>
  <link name="lower"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 0.5" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" velocity="2" effort="60"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/>
    <child link="lower"/>
    <origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="2" effort="30"/>
  </joint>
</robot>
"""
ELBOW = URDF.index('<joint name="elbow"')

# the part of the elbow that is replaced, the wrong part, what the sentence says, its line
FILES: dict[str, tuple[str, str, str, int]] = {
    "axis of zero": ('axis xyz="0 1 0"', 'axis xyz="0 0 0"', "the axis of joint 'elbow' is zero", 16),
    "axis of two numbers": ('axis xyz="0 1 0"', 'axis xyz="0 1"', "joint 'elbow'.*three numbers.*'0 1'", 16),
    "origin in words": ('xyz="0.4 0 0"', 'xyz="0.4 0 zero"', "joint 'elbow'.*three numbers.*zero", 15),
    "origin that is infinite": ('xyz="0.4 0 0"', 'xyz="inf 0 0"', "joint 'elbow'.*three numbers", 15),
    "limit in words": ('lower="-2"', 'lower="minus"', "joint 'elbow'.*lower of <limit> takes a number", 17),
    "limits exchanged": ('lower="-2" upper="2"', 'lower="2" upper="-2"', "lower limit of joint 'elbow' is above", 17),
    "mistyped attribute": ('upper="2"', 'uper="2"', "joint 'elbow'.*uper.*upper", 17),
    "mistyped kind": ('type="revolute"', 'type="revolut"', "joint 'elbow' is revolut; expected one of", 12),
    "floating": ('type="revolute"', 'type="floating"', "joint 'elbow' is floating.*fixed base", 12),
    "no parent": ('<parent link="upper"/>', "", "joint 'elbow' has no <parent>", 12),
    "unknown child": ('child link="lower"', 'child link="hand"', "child 'hand' of joint 'elbow' is not a link", 12),
    "loop": ('child link="lower"', 'child link="upper"', "link 'upper' is the child of 'shoulder' and of 'elbow'", 12),
    "same name": ('name="elbow"', 'name="shoulder"', "two elements <joint> have the name 'shoulder'.*line 5", 12),
    "mimics nobody": ("</joint>", '<mimic joint="wrist"/></joint>', "'elbow' mimics 'wrist', which is not a joint", 12),
    "mimics itself": ("</joint>", '<mimic joint="elbow"/></joint>', "joint 'elbow' mimics itself", 12),
    "mimic without a joint": ("</joint>", "<mimic/></joint>", "joint 'elbow'.*<mimic> has no attribute 'joint'", 18),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_wrong_urdf_is_one_sentence_with_joint_and_line(name: str, tmp_path: Path) -> None:
    right, wrong, sentence, line = FILES[name]
    part = URDF[ELBOW:]
    assert right in part
    (tmp_path / "lever.urdf").write_text(URDF[:ELBOW] + part.replace(right, wrong, 1))
    with pytest.raises(gt.ModelError, match=sentence) as error:
        gt.robots.from_urdf(tmp_path / "lever.urdf")
    said(str(error.value), rf"lever\.urdf, line {line}: ")


TOML = """family = "serial"
names = ["turn", "shoulder", "elbow"]
a_m = [0.0, 0.4, 0.3]
alpha_deg = [90.0, 0.0, 0.0]
d_m = [0.5, 0.0, 0.0]
limits_deg = [[-170, 170], [-90, 90], [-120, 120]]
"""

ROBOTS: dict[str, tuple[str, str, str, int]] = {
    "a number too few": ("a_m = [0.0, 0.4, 0.3]", "a_m = [0.0, 0.4]", "'a' has 2 numbers; expected 3", 3),
    "limits exchanged": ("[-120, 120]", "[120, -120]", "limits of joint 'elbow' are 120 deg and -120 deg", 6),
    "limits too few": (", [-120, 120]", "", r"limits takes .* each of the 3 joints; found the shape \(2, 2\)", 6),
    "twist in radians": ("[90.0, 0.0, 0.0]", "[1.5708, 0.0, 0.0]", "alpha_deg: .*radians", 4),
    "length in millimetres": ("[0.0, 0.4, 0.3]", "[0.0, 400.0, 300.0]", "a_m: .*millimetres", 3),
    "kind of joint": ('family = "serial"', 'family = "serial"\njoints = "rrx"', "joints takes one of r, p.*'rrx'", 2),
    "two names": ('"shoulder", "elbow"', '"elbow", "elbow"', "names takes 3 different names.*elbow, elbow", 2),
    "start beyond a limit": ("d_m =", "start_deg = [0, 0, 150]\nd_m =", "the start of joint 'elbow' is 150 deg", 5),
    "start too short": ("d_m =", "start_deg = [0, 0]\nd_m =", "start takes 3 joint coordinates", 5),
    "mistyped key": ("alpha_deg", "alpha_degrees", "alpha_degrees: .*alpha_deg", 4),
    "negative mass": ("d_m =", "m_kg = [1.0, 1.0, -2.0]\nd_m =", "the link that joint 'elbow' moves is -2 kg", 5),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_a_wrong_robot_file_is_one_sentence_with_joint_and_line(name: str, tmp_path: Path) -> None:
    right, wrong, sentence, line = ROBOTS[name]
    assert right in TOML
    (tmp_path / "arm.toml").write_text(TOML.replace(right, wrong, 1))
    with pytest.raises(InputError, match=sentence) as error:
        resolve("arm.toml", Context(folder=tmp_path))
    said(str(error.value), rf"arm\.toml: \w+: .*\(line {line}\)")


X, Y, Z = np.eye(3)


class Loose(gt.Model):
    """Two links; the elbow is connected to nothing before it."""

    q = gt.variable(2, unit="rad", start=[0.3, 0.3])
    T = gt.variable(3, unit="m")
    ground = gt.part(mechanics.Ground)
    shoulder, elbow = gt.part(mechanics.Revolute), gt.part(mechanics.Revolute)
    upper = gt.part(mechanics.FixedTranslation, d=[0.4, 0.0, 0.0])
    lower = gt.part(mechanics.FixedTranslation, d=[0.3, 0.0, 0.0])
    motor = gt.parts(2, mechanics.TorqueMotor)

    def equations(self):
        yield gt.connect(
            [self.ground.frame, self.shoulder.b, self.elbow.b], [self.shoulder.a, self.upper.a, self.lower.a]
        )
        for k, joint in enumerate((self.shoulder, self.elbow)):
            yield gt.connect(joint.shaft, self.motor[k].shaft)
            yield self.q[k] == joint.shaft.phi
        yield self.T == self.lower.b.r


def chain(axes: Any, *, motors: bool = True, factor: float = 1.0) -> gt.Builder:
    """Revolute joints about axes, each followed by 0.3 m along z."""
    m = gt.Builder("hand")
    q = m.variable("q", len(axes), unit="rad", start=np.full(len(axes), 0.3))
    T, R = m.variable("T", 3, unit="m"), m.variable("R", (3, 3), unit="1")
    end = m.part("ground", mechanics.Ground()).frame
    for k, axis in enumerate(axes):
        joint = m.part(f"joint_{k}", mechanics.Revolute(axis=axis))
        link = m.part(f"link_{k}", mechanics.FixedTranslation(d=[0.05, 0.0, 0.3]))
        if motors:
            m.add(gt.connect(joint.shaft, m.part(f"motor_{k}", mechanics.TorqueMotor()).shaft))
        m.add(gt.connect([end, joint.b], [joint.a, link.a]), factor * q[k] == joint.shaft.phi)
        end = link.b
    m.add(end.r == T, end.R == R)
    return m


SIX = [Z, Y, Y, X, Y, X]
BY_HAND: dict[str, tuple[Callable[[], Any], str]] = {
    "axis of zero": (lambda: chain([Z, Y, 0 * X]).causal("q", "T"), "'axis' must be a direction"),
    "hangs on nothing": (lambda: Loose().causal("q", "T"), r"elbow\.a \(robots/test_wrong_arms"),
    "without motors": (lambda: chain(SIX, motors=False).causal("q", "tau"), "tau"),
    "position for six joints": (lambda: chain(SIX).causal("T", "q"), r"3 numbers|6 are needed|mechanism has 6"),
    "seven joints": (lambda: chain([*SIX, Z]).causal(["T", "R"], "q"), r"mechanism has 7: 1 more .*'q\[0\]'"),
    "half the angle": (lambda: gt.kinematics.chain_of(chain(SIX, factor=0.5)), "q turns or moves .* by its own value"),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_a_wrong_arm_by_hand_is_one_sentence_with_joint_and_line(name: str) -> None:
    act, sentence = BY_HAND[name]
    with pytest.raises((gt.ModelError, gt.results.ArgumentError), match=sentence) as error:
        act()
    said(str(error.value), "" if name == "half the angle" else r"test_wrong_arms\.py:\d+")


def said(text: str, line: str) -> None:
    assert "\n" not in text and re.search(line, text), text
