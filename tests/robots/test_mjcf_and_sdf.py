"""Serial arms from MJCF and SDF: MuJoCo and pinocchio as oracles, every detail of the formats in the files."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel import ModelError
from tests.robots.arm_oracle import URDF, Pinocchio

# Sums of some tens of products of numbers near 1, in another order than MuJoCo's.
ROUND_OFF = 1e-10

DEFAULTS = """<mujoco model="defaults">
  <compiler angle="degree" eulerseq="XyZ"/>
  <default>
    <joint damping="0.3" axis="0 1 0"/>
    <default class="heavy">
      <geom density="3000" euler="10 20 30"/>
      <default class="slow"><joint frictionloss="0.2" range="-100 120"/></default>
    </default>
    <default class="rail"><joint type="slide" range="-0.2 0.3" damping="5"/></default>
  </default>
  <worldbody>
    <body name="base" pos="0.1 0.2 0.3" euler="20 -30 50" childclass="heavy">
      <geom type="box" size="0.1 0.1 0.1"/>
      <body name="one" pos="0 0 0.4" quat="0.8 0.2 -0.3 0.5">
        <joint name="j1" class="slow" pos="0.05 -0.02 0.1" ref="25"/>
        <geom type="capsule" fromto="0 0 0 0.3 0.1 0.2" size="0.04"/>
        <geom type="sphere" size="0.06" pos="0.1 0 0" mass="0.7"/>
        <body name="two" pos="0.3 0.1 0.2" axisangle="1 1 0 40">
          <joint name="j2" axis="1 2 3"/>
          <joint name="j3" class="rail" axis="0 0 1" pos="0 0.1 0" ref="0.05"/>
          <geom type="cylinder" size="0.05 0.2" euler="0 90 0" density="800"/>
          <body name="three" pos="0 0 0.3" xyaxes="1 0.2 0 -0.1 1 0.3">
            <joint name="j4" pos="0 0 0.05"/>
            <inertial pos="0.02 0.03 0.04" euler="5 10 15" mass="1.5" diaginertia="0.02 0.03 0.04"/>
            <geom type="mesh" mesh="shape" class="main" mass="0"/>
            <body name="tool" zaxis="1 1 1" pos="0 0.1 0.1">
              <joint name="j5" axis="0 0 1" armature="0"/>
              <inertial pos="0 0 0.1" mass="0.4" fullinertia="0.01 0.012 0.014 0.001 0.002 -0.001"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>"""

RADIANS = """<mujoco model="radians">
  <compiler angle="radian" eulerseq="zyx" inertiafromgeom="true" autolimits="false"/>
  <worldbody>
    <body name="a" euler="0.3 -0.4 0.5">
      <joint name="first" axis="1 0 0" ref="0.2" armature="0.3"/>
      <inertial pos="0 0 0" mass="99" diaginertia="1 1 1"/>
      <geom type="ellipsoid" size="0.1 0.2 0.3" pos="0.1 0 0.2" euler="0.1 0.2 0.3" mass="2"/>
      <body name="b" pos="0.5 0 0">
        <joint name="second" type="slide" axis="0 1 1" range="-0.1 0.4" limited="true" actuatorfrcrange="-30 50"
          actuatorfrclimited="true"/>
        <geom type="capsule" size="0.05 0.3" pos="0 0.1 0" density="500"/>
        <body name="c" pos="0 0.2 0">
          <joint name="third" axis="0 0 1" ref="-0.3" armature="0.1"/>
          <geom type="box" size="0.1 0.05 0.02" pos="0.1 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="third" joint2="first" polycoef="0.1 -1.5 0 0 0"/></equality>
</mujoco>"""


def in_mujoco(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    text = text.replace('<geom type="mesh" mesh="shape" class="main" mass="0"/>', "")
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def deviation(text: str, tip: str, followed: np.ndarray, offset: np.ndarray) -> float:
    """The largest difference of poses and inverse dynamics at ten random states; infinite for a status that is not ok.

    MuJoCo's coordinates are followed @ q + offset. Friction and damping are left out of the efforts.
    """
    arm = gt.robots.from_mjcf(text)
    model, data = in_mujoco(text)
    smooth = arm.with_(viscous=np.zeros(model.nv), coulomb=np.zeros(model.nv))
    function = smooth.causal(known="q", targets=["T", "R", "tau"])
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, tip)
    rng, worst, M = np.random.default_rng(4), 0.0, np.zeros((model.nv, model.nv))
    for _ in range(10):
        q, v, a = rng.uniform(-0.9, 0.9, (3, followed.shape[1]))
        data.qpos, data.qvel = followed @ q + offset, followed @ v
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M)
        T, R, tau, status = function(q, v, a)
        # qfrc_bias: gravity, Coriolis and centrifugal terms
        expected = followed.T @ (M @ (followed @ a) + data.qfrc_bias)
        errors = [T - data.xpos[body], R - data.xmat[body].reshape(3, 3), tau - expected]
        worst = max(worst, *(np.abs(e).max() for e in errors)) if status.ok else np.inf
    return worst


def test_defaults_orientations_geoms_and_several_joints():
    assert deviation(DEFAULTS, "tool", np.eye(5), np.zeros(5)) < ROUND_OFF
    arm = gt.robots.from_mjcf(DEFAULTS)
    model, _ = in_mujoco(DEFAULTS)
    limited = model.jnt_limited.astype(bool)
    assert arm.structure.limits()[limited] == pytest.approx(model.jnt_range[limited], abs=ROUND_OFF)
    assert np.all(np.isinf(arm.structure.limits()[~limited]))
    assert np.asarray(arm.viscous) == pytest.approx(model.dof_damping[:, 0] if model.dof_damping.ndim > 1
                                                    else model.dof_damping)  # fmt: skip
    assert np.asarray(arm.coulomb) == pytest.approx(model.dof_frictionloss)


def test_radians_geoms_instead_of_inertials_and_a_following_joint():
    # q1 - ref1 = a + b (q2 - ref2): third = -0.3 + 0.1 - 1.5 (first - 0.2)
    couplings = np.array([[1.0, 0.0], [0.0, 1.0], [-1.5, 0.0]])
    assert deviation(RADIANS, "c", couplings, np.array([0.0, 0.0, 0.1])) < ROUND_OFF
    structure = gt.robots.from_mjcf(RADIANS).structure
    assert structure.limits()[1].tolist() == [-0.1, 0.4] and np.all(np.isinf(structure.limits()[0]))
    assert structure.effort_limits()[1] == 50.0


def drawn(rng: np.random.Generator) -> tuple[str, str]:
    """A synthetic arm of one to five bodies, with each detail of the format by chance, and its last body."""
    angle, sequence = rng.choice(["degree", "radian"]), "".join(rng.choice(list("xyzXYZ"), 3))
    scale = 60.0 if angle == "degree" else 1.0

    def numbers(count: int, size: float = 1.0) -> str:
        return " ".join(f"{x:.6g}" for x in size * rng.uniform(-1, 1, count))

    def turn() -> str:
        return str(rng.choice([
            f'quat="{numbers(4)}"', f'euler="{numbers(3, scale)}"', f'axisangle="{numbers(3)} {numbers(1, scale)}"',
            f'xyaxes="{numbers(6)}"', f'zaxis="{numbers(3)}"', "",
        ]))  # fmt: skip

    def joint(name: str) -> str:
        slide, pos, ref = rng.random() < 0.3, rng.random() < 0.5, rng.random() < 0.4
        size = 0.2 if slide else 0.5 * scale
        text = f'<joint name="{name}" type="{"slide" if slide else "hinge"}" axis="{numbers(3)}"'
        text += f' pos="{numbers(3, 0.2)}"' if pos else ""
        text += f' armature="{rng.uniform(0, 0.5):.6g}"' if rng.random() < 0.5 else ""
        return text + (f' ref="{numbers(1, size)}"/>' if ref else "/>")

    def mass() -> str:
        pose, size = f'pos="{numbers(3, 0.2)}" {turn()}', 0.02 + 0.1 * rng.random(3)
        kind = rng.choice(["sphere", "box", "capsule", "cylinder", "ellipsoid", "inertial", "fromto"])
        if kind == "inertial":
            return f'<inertial {pose} mass="{rng.uniform(0.5, 3):.6g}" diaginertia="0.02 0.03 0.04"/>'
        if kind == "fromto":
            return f'<geom type="capsule" size="{size[0]:.6g}" fromto="{numbers(6, 0.3)}"/>'
        return f'<geom type="{kind}" size="{" ".join(f"{x:.6g}" for x in size)}" {pose} density="700"/>'

    text, count = "", int(rng.integers(1, 6))
    for k in range(count):
        joints = "".join(joint(f"j{k}_{n}") for n in range(int(rng.integers(0 if k and k + 1 < count else 1, 3))))
        text += f'<body name="b{k}" pos="{numbers(3, 0.4)}" {turn()}>{joints}{mass()}'
    head = f'<mujoco model="drawn"><compiler angle="{angle}" eulerseq="{sequence}"/><worldbody>'
    return f"{head}{text}{'</body>' * count}</worldbody></mujoco>", f"b{count - 1}"


@pytest.mark.parametrize("seed", [0, 1, 2, *(pytest.param(n, marks=pytest.mark.proof) for n in (3, 4, 5))])
def test_drawn_arms(seed):
    """Synthetic arms, numbered by their seed."""
    text, tip = drawn(np.random.default_rng(seed))
    n = in_mujoco(text)[0].nv
    assert deviation(text, tip, np.eye(n), np.zeros(n)) < ROUND_OFF


def wrong(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    "text, line, sentence",
    [
        (wrong(RADIANS, '<joint name="third" axis="0 0 1"', '<joint name="third" type="ball" axis="0 0 1"'), 19,
         "joint 'third' is ball"),
        (wrong(RADIANS, '<joint name="first"', '<freejoint/><joint name="first"'), 5, "joint 'a_joint_1' is free"),
        (wrong(RADIANS, '<joint joint1="third" joint2="first" polycoef="0.1 -1.5 0 0 0"/>',
               '<connect body1="c" body2="a" anchor="0 0 0"/>'), 19, "this joint closes a loop"),
        (wrong(RADIANS, '<geom type="box"', '<geom type="mesh" mesh="x"'), 14, "mass of its mesh is not computed"),
        (wrong(RADIANS, 'eulerseq="zyx"', 'eulerseq="zy"'), 2, "eulerseq takes three"),
        (wrong(RADIANS, "<worldbody>", '<include file="arm.xml"/><worldbody>'), 3, "<include> is not read"),
        (wrong(RADIANS, 'axis="0 0 1" ref', 'axis="0 0 0" ref'), 13, "axis of joint 'third' is zero"),
        (wrong(RADIANS, 'name="third"', 'name="first"'), 13, "two joints have the name 'first'"),
        (wrong(RADIANS, 'name="b"', 'name="a"'), 8, "two bodies have the name 'a'"),
        (wrong(RADIANS, 'pos="0.5 0 0"', 'pos="0.5 0 x"'), 8, "pos of <body> takes three numbers"),
        (wrong(DEFAULTS, 'class="slow" pos', 'class="slo" pos'), 15, "class 'slo', which no <default> declares"),
        (wrong(RADIANS, 'limited="true" ', ""), 9, "has a range without limited"),
        (wrong(RADIANS, "actuatorfrcrange", "actuatorfrcrnge"), 9, "did you mean 'actuatorfrcrange'"),
        (wrong(RADIANS, "<inertial", "<inertal"), 6, "<body> holds the unknown <inertal>"),
        (wrong(RADIANS, 'ref="0.2"', 'ref="0.2" springdamper="1 1"'), 5, "unknown attribute 'springdamper'"),
        ("<robot/>", 1, "expected <mujoco>"),
        ("<mujoco><worldbody/></mujoco>", 1, "has a joint"),
        ("<mujoco>", 1, "is not XML"),
    ],
)  # fmt: skip
def test_wrong_mjcf(text, line, sentence):
    with pytest.raises(ModelError) as error:
        gt.robots.from_mjcf(text)
    assert f"line {line}: " in str(error.value) and sentence in str(error.value)


def sdf_of(urdf: Path) -> str:
    """The file of an arm as SDF, by hand: links placed in the model, joints in links, frames in between."""
    import pinocchio as pin

    from gtmodel.robots.serial.urdf_file import read_urdf

    model = pin.buildModelFromUrdf(str(urdf))
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    read, lines = read_urdf(urdf), ['<sdf version="1.9"><model name="twin">']
    for number, link in enumerate(read.links.values()):
        pose = data.oMf[model.getFrameId(link.name)]
        x, y, z, w = Rotation.from_matrix(pose.rotation).as_quat()
        p = " ".join(f"{v:.17g}" for v in [*pose.translation, x, y, z, w])
        lines.append(f'<frame name="f{number}"><pose rotation_format="quat_xyzw">{p}</pose></frame>')
        lines.append(f'<link name="{link.name}"><pose relative_to="f{number}"/>')
        m = link.m
        c = link.mc / m if m else np.zeros(3)
        J = np.zeros((3, 3))
        J[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]] = link.J
        J = J + np.triu(J, 1).T
        I = J - m * (c @ c * np.eye(3) - np.outer(c, c))
        lines.append(f"<inertial><pose>{' '.join(f'{v:.17g}' for v in c)} 0 0 0</pose><mass>{m:.17g}</mass><inertia>")
        lines += [f"<i{a}{b}>{I['xyz'.index(a), 'xyz'.index(b)]:.17g}</i{a}{b}>" for a, b in
                  ("xx", "xy", "xz", "yy", "yz", "zz")]  # fmt: skip
        lines.append("</inertia></inertial></link>")
    for j in read.joints.values():
        world = data.oMf[model.getFrameId(j.child)].rotation @ j.axis
        limit = f"<limit><lower>{j.lower}</lower><upper>{j.upper}</upper></limit>"
        dynamics = f"<dynamics><damping>{j.damping}</damping><friction>{j.friction}</friction></dynamics>"
        mimic = "" if j.leader is None else (
            f'<mimic joint="{j.leader}"><multiplier>{j.multiplier}</multiplier><offset>{j.offset}</offset>'
            "<reference>0</reference></mimic>"
        )  # fmt: skip
        xyz = " ".join(f"{v:.17g}" for v in world)
        lines.append(
            f'<joint name="{j.name}" type="{j.kind}"><parent>{j.parent}</parent><child>{j.child}</child>'
            f'<axis><xyz expressed_in="__model__">{xyz}</xyz>{limit}{dynamics}{mimic}</axis></joint>'
        )
    return "\n".join([*lines, "</model></sdf>"])


def test_an_sdf_equals_its_urdf_in_pinocchio():
    text = sdf_of(URDF / "serial.urdf")
    arm, twin = gt.robots.from_sdf(text), gt.robots.from_urdf(URDF / "serial.urdf")
    oracle = Pinocchio(URDF / "serial.urdf", twin.structure.tool)
    function = arm.causal(known="q", targets=["T", "R", "tau"])
    rng, n = np.random.default_rng(7), len(twin.structure.leaders)
    friction = twin.causal(known="q", targets="tau")
    for _ in range(10):
        q, v, a = rng.uniform(-0.8, 0.8, (3, n))
        T, R, tau, status = function(q, v, a)
        r, rotation = oracle.tool(q)
        assert status.ok
        assert T == pytest.approx(r, abs=ROUND_OFF) and R == pytest.approx(rotation, abs=ROUND_OFF)
        assert tau == pytest.approx(friction(q, v, a)[0], abs=ROUND_OFF)
        assert function(q, 0 * v, a)[2] == pytest.approx(oracle.efforts(q, 0 * v, a), abs=ROUND_OFF)
    assert arm.structure.limits() == pytest.approx(twin.structure.limits(), abs=1e-12)


BY_HAND = """<sdf version="1.9"><world name="w"><model name="two">
  <link name="upper"><pose degrees="true">0 0 0.5 0 90 0</pose><inertial><mass>0</mass></inertial></link>
  <link name="lower"><pose relative_to="elbow">0 0 0.1 0 0 0</pose><inertial><mass>0</mass></inertial></link>
  <joint name="shoulder" type="revolute"><pose>-0.2 0 0 0 0 0</pose>
    <parent>world</parent><child>upper</child><axis><xyz>0 1 0</xyz></axis></joint>
  <joint name="elbow" type="prismatic"><pose relative_to="upper">0.3 0 0 0 0 0</pose>
    <parent>upper</parent><child>lower</child>
    <axis><xyz expressed_in="__model__">0 0 1</xyz><limit><lower>-1</lower><upper>inf</upper></limit></axis></joint>
</model></world></sdf>"""


def test_an_sdf_by_hand():
    """Joint frames that are not those of their links: positions with rotations by NumPy."""
    arm = gt.robots.from_sdf(BY_HAND)
    assert arm.structure.limits()[1].tolist() == [-1.0, np.inf]
    R90 = Rotation.from_euler("y", 90, degrees=True)
    for phi, s in ((0.0, 0.0), (0.4, 0.2), (-1.1, -0.3)):
        shoulder = np.array([0, 0, 0.5]) + R90.apply([-0.2, 0, 0])
        turned = R90 * Rotation.from_euler("y", phi)
        # from the shoulder: 0.2 back to the link's origin, 0.3 to the elbow, s along the model's z = -x of the link
        expected = shoulder + turned.apply([0.2 + 0.3 - s, 0, 0.1])
        T, status = arm.causal(known="q", targets="T")([phi, s])
        assert status.ok and T == pytest.approx(expected, abs=1e-12)


LOOP = '<joint name="again" type="revolute"><parent>upper</parent><child>lower</child></joint></model>'


@pytest.mark.parametrize(
    "text, line, sentence",
    [
        (wrong(BY_HAND, "</model>", LOOP), 9, "closes a loop"),
        (wrong(BY_HAND, 'type="prismatic"', 'type="ball"'), 6, "joint 'elbow' is ball"),
        (wrong(BY_HAND, 'relative_to="upper"', 'relative_to="elbow"'), 6, "relative to each other"),
        (wrong(BY_HAND, 'relative_to="upper"', 'relative_to="uper"'), 6, "names 'uper', which is no link"),
        (wrong(BY_HAND, "<child>lower", "<child>lowr"), 6, "the child 'lowr' of joint 'elbow' is not a link"),
        (wrong(BY_HAND, "<xyz>0 1 0", "<xyz>0 0 0"), 5, "axis of joint 'shoulder' is zero"),
        (wrong(BY_HAND, "<mass>0</mass>", "<mass>-1</mass>"), 2, "it cannot be negative"),
        (wrong(BY_HAND, "<mass>0</mass>", "<mass>heavy</mass>"), 2, "takes a number; found 'heavy'"),
        (wrong(BY_HAND, "<link name=", "<include/><link name="), 2, "<include> inside a model is not read"),
        (wrong(BY_HAND, "</model>", '<link name="loose"/></model>'), 9, "no joint connects link 'loose' to 'world'"),
        (wrong(BY_HAND, "0 0 0.5 0 90 0", "0 0 0.5 0 90"), 2, "pose of <pose> takes six numbers"),
        (wrong(BY_HAND, "<lower>-1</lower>", "<loer>-1</loer>"), 8, "<limit> holds the unknown <loer>"),
        (wrong(BY_HAND, "<axis><xyz>0 1 0</xyz></axis>", "<axs/>"), 5, "<joint> holds the unknown <axs>"),
        ('<sdf version="1.9"/>', 1, "the file has 0 models"),
        ("<robot/>", 1, "expected <sdf>"),
    ],
)
def test_wrong_sdf(text, line, sentence):
    with pytest.raises(ModelError) as error:
        gt.robots.from_sdf(text)
    assert f"line {line}: " in str(error.value) and sentence in str(error.value), error.value
