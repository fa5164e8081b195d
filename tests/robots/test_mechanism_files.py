"""Mechanisms from SDF, MJCF and URDF: counts by hand, circles that meet, MuJoCo and pinocchio as oracles."""

from __future__ import annotations

import pickle

import mujoco
import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError
from gtmodel.geometry.rotations import rotation_about
from gtmodel.problem_files.base import InputError
from tests.robots.arm_oracle import COUPLED, URDF, Pinocchio

# Sums of some tens of products of numbers near 1, in another order than the oracle's.
ROUND_OFF = 1e-10
# Newton's method ends below this; angles follow from it by lengths near 1.
CLOSED = 1e-9

# Bars in the xz plane: start and end [m] in the drawn pose, and the bar or the world that carries the start.
FOUR_BAR = {
    "crank": ((0.0, 0.0), (0.1, 0.28), "world"),
    "coupler": ((0.1, 0.28), (0.72, 0.6), "crank"),
    "rocker": ((0.8, 0.0), (0.72, 0.6), "world"),
}
FIVE_BAR = {
    "left": ((0.0, 0.0), (-0.2, 0.35), "world"),
    "upper": ((-0.2, 0.35), (0.2, 0.65), "left"),
    "right": ((0.4, 0.0), (0.6, 0.35), "world"),
    "other": ((0.6, 0.35), (0.2, 0.65), "right"),
}
ENDS = {"four": ("coupler", "rocker"), "five": ("upper", "other")}  # of the bars that the last pin joins
BARS = {"four": FOUR_BAR, "five": FIVE_BAR}
DRIVEN = {"four": ["crank_pin"], "five": ["left_pin", "right_pin"]}
MASS = 0.7  # kg, of each bar, with its centre in the middle


def length_and_angle(bars, name):
    start, end, _ = bars[name]
    d = np.subtract(end, start)
    return float(np.hypot(*d)), float(np.arctan2(d[1], d[0]))


def sdf(which):
    """Links along their bars; every joint turns about -y, which is anticlockwise in the xz plane."""
    bars, (first, second), lines = BARS[which], ENDS[which], []
    axis = '<axis><xyz expressed_in="__model__">0 -1 0</xyz>{}</axis>'
    for name, (start, _, carrier) in bars.items():
        L, angle = length_and_angle(bars, name)
        lines.append(
            f'<link name="{name}"><pose>{start[0]} 0 {start[1]} 0 {-angle:.17g} 0</pose><inertial>'
            f"<pose>{L / 2:.17g} 0 0 0 0 0</pose><mass>{MASS}</mass><inertia><ixx>0</ixx>"
            f"<iyy>{MASS * L**2 / 12:.17g}</iyy><izz>{MASS * L**2 / 12:.17g}</izz></inertia></inertial></link>"
        )
        effort = "<limit><effort>30</effort></limit>" if f"{name}_pin" in DRIVEN[which] else ""
        lines.append(f'<joint name="{name}_pin" type="revolute"><parent>{carrier}</parent><child>{name}</child>'
                     f"{axis.format(effort)}</joint>")  # fmt: skip
    L, _ = length_and_angle(bars, first)
    lines.append(f'<joint name="tip" type="revolute"><pose>{L:.17g} 0 0 0 0 0</pose><parent>{second}</parent>'
                 f"<child>{first}</child>{axis.format('')}</joint>")  # fmt: skip
    return "\n".join(['<sdf version="1.9"><model name="bars">', *lines, "</model></sdf>"])


def mjcf(which, closure=None):
    """The same with nested bodies parallel to the world, and a connect in place of the last pin."""
    bars, (first, second) = BARS[which], ENDS[which]

    def body(name):
        start, end, carrier = bars[name]
        at = np.subtract(start, bars[carrier][0]) if carrier != "world" else start
        half, (L, angle) = np.subtract(end, start) / 2, length_and_angle(bars, name)
        inside = "".join(body(n) for n, bar in bars.items() if bar[2] == name)
        return (
            f'<body name="{name}" pos="{at[0]} 0 {at[1]}"><joint name="{name}_pin" axis="0 -1 0"/>'
            f'<inertial pos="{half[0]:.17g} 0 {half[1]:.17g}" euler="0 {-np.degrees(angle):.17g} 0" mass="{MASS}" '
            f'diaginertia="1e-12 {MASS * L**2 / 12:.17g} {MASS * L**2 / 12:.17g}"/>{inside}</body>'
        )

    tip = np.subtract(bars[first][1], bars[first][0])
    closure = (
        closure or f'<connect name="tip" body1="{first}" body2="{second}" anchor="{tip[0]:.17g} 0 {tip[1]:.17g}"/>'
    )
    motors = "".join(f'<motor joint="{name}"/>' for name in DRIVEN[which])
    bodies = "".join(body(n) for n, bar in bars.items() if bar[2] == "world")
    return (f'<mujoco model="bars"><option gravity="0 0 -9.81"/><worldbody>{bodies}</worldbody>\n'
            f"<equality>{closure}</equality><actuator>{motors}</actuator></mujoco>")  # fmt: skip


def joint(bars, first, second, turns):
    """The point in the plane where the ends of two bars meet, by circles; turns: of their carriers."""
    centres, radii = [], []
    for name in (first, second):
        start, _, carrier = bars[name]
        if carrier != "world":
            L, angle = length_and_angle(bars, carrier)
            angle += turns[carrier]
            start = np.add(bars[carrier][0], L * np.array([np.cos(angle), np.sin(angle)]))
        centres.append(np.asarray(start, float))
        radii.append(length_and_angle(bars, name)[0])
    d = centres[1] - centres[0]
    D = np.hypot(*d)
    along = (radii[0] ** 2 - radii[1] ** 2 + D**2) / (2 * D)
    across = np.sqrt(radii[0] ** 2 - along**2)
    return centres[0] + along * d / D + across * np.array([-d[1], d[0]]) / D


@pytest.mark.parametrize("which", ["four", "five"])
@pytest.mark.parametrize("write, redundant", [(sdf, 3), (mjcf, 1)])
def test_planar_loops(which, write, redundant):
    """n bars and n + 1 pins in the plane: 3 n - 2 (n + 1). In space the last pin holds five directions, three of them
    already held by the other pins; a connect holds three, one of them already held."""
    model = gt.robots.mechanism(write(which))
    report, n = model.mobility(), len(BARS[which])
    assert (report.mobility, report.redundant, report.generic) == (3 * n - 2 * (n + 1), redundant, False)


@pytest.mark.parametrize("write, which", [(sdf, "four"), (mjcf, "five")])
def test_the_last_pin_is_where_circles_about_the_other_pins_meet(write, which):
    first, second = ENDS[which]
    forward = gt.robots.mechanism(write(which)).causal("q", ["tip.joint.a.r", "tip.joint.b.r"])
    for turn in (0.0, 0.3, -0.2):
        q = turn * np.array([1.0, -0.7])[: len(DRIVEN[which])]
        a, b, status = forward(q)
        turns = dict(zip((n.removesuffix("_pin") for n in DRIVEN[which]), q, strict=True))
        expected = joint(BARS[which], first, second, turns)
        assert status.ok and np.linalg.norm(a - b) < CLOSED
        assert a == pytest.approx([expected[0], 0.0, expected[1]], abs=CLOSED)


def test_efforts_of_a_loop_equal_those_of_its_tree_under_the_constraint():
    """Both files against MuJoCo's tree of three hinges, moved so that the tips stay together."""
    model = mujoco.MjModel.from_xml_string(mjcf("four"))
    data, M = mujoco.MjData(model), np.zeros((3, 3))
    ends = {n: [*np.insert(np.subtract(FOUR_BAR[n][1], FOUR_BAR[n][0]), 1, 0.0)] for n in ("coupler", "rocker")}
    q, rate, acceleration = 0.25, 1.3, -2.0

    def gap(function):
        """The derivatives in x and z by the hinges of the vector between both tips, or their rates."""
        total = np.zeros((3, 3))
        for sign, (name, end) in zip((1, -1), ends.items(), strict=True):
            one, body = np.zeros((3, 3)), data.body(name)
            function(model, data, one, None, body.xpos + body.xmat.reshape(3, 3) @ end, body.id)
            total += sign * one
        return total[[0, 2]]

    for write in (mjcf, sdf):
        targets = ["crank_pin.phi", "coupler_pin.phi", "rocker_pin.phi", "tau"]
        inverse = gt.robots.mechanism(write("four")).causal("q", targets)
        *data.qpos[:], effort, status = inverse([q], [rate], [acceleration])
        mujoco.mj_fwdPosition(model, data)
        G = gap(mujoco.mj_jac)
        N = np.array([1.0, *np.linalg.solve(G[:, 1:], -G[:, 0])])
        data.qvel[:] = N * rate
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fullM(model, data, M)
        rest = -G[:, 0] * acceleration - gap(mujoco.mj_jacDot) @ data.qvel
        a = np.array([acceleration, *np.linalg.solve(G[:, 1:], rest)])
        assert status.ok
        assert effort == pytest.approx([N @ (M @ a + data.qfrc_bias)], abs=CLOSED)


def test_a_weld_and_sites_close_loops_too():
    """The rocker ends in a hinge to a small body, which a weld holds to the coupler: four pins in space again."""
    at = {n: " ".join(map(str, np.insert(np.subtract(FOUR_BAR[n][1], FOUR_BAR[n][0]), 1, 0.0))) for n in ENDS["four"]}
    site = f'<site name="a" pos="{at["coupler"]}"/>'
    small = f'<body name="knuckle" pos="{at["rocker"]}"><joint name="pin" axis="0 -1 0"/><site name="b"/></body>'
    text = mjcf("four", '<weld name="tip" site1="a" site2="b"/>')
    text = text.replace("</body></worldbody>", f"{small}</body></worldbody>").replace(
        '<joint name="coupler_pin"', f'{site}<joint name="coupler_pin"'
    )
    report = gt.robots.mechanism(text).mobility()
    assert (report.mobility, report.redundant) == (1, 3)


TREE = """<mujoco model="tree"><compiler angle="radian"/>
  <default><geom density="2000"/></default>
  <worldbody>
    <body name="trunk" pos="0.1 0.2 0.3" euler="0.2 -0.3 0.4"><joint name="waist" axis="0 0 1" damping="0.4"/>
      <geom type="box" size="0.1 0.15 0.2" pos="0 0 0.2"/>
      <body name="left arm" pos="0 0.2 0.4">
        <joint name="left" axis="1 0 0.2" ref="0.3" armature="0.05" stiffness="4" springref="0.2"/>
        <geom type="capsule" fromto="0 0 0 0 0.3 0.1" size="0.04"/>
        <body name="hand" pos="0 0.3 0.1" zaxis="0 0 -1">
          <joint name="hand" type="slide" axis="0 1 1" frictionloss="0.3"/>
          <geom type="sphere" size="0.06" pos="0.02 0 0"/></body></body>
      <body name="right arm" pos="0 -0.2 0.4">
        <joint name="right" axis="1 0 0" range="-1 2"/><joint name="twist" axis="0 1 0" pos="0 -0.1 0"/>
        <geom type="cylinder" fromto="0 0 0 0.1 -0.3 0" size="0.05"/></body>
    </body>
  </worldbody></mujoco>"""


def test_a_tree_equals_mujoco():
    """Poses of all bodies, mass matrix, gravity and a spring, with names that Python does not allow."""
    robot = gt.robots.mechanism(TREE)
    assert robot.graph.q == ("waist", "left", "hand", "right", "twist")
    model = mujoco.MjModel.from_xml_string(TREE)
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    dynamics = robot.causal("q", ["left_arm.frame.R", "hand.frame.r", "right_arm.frame.r", "hand.frame.R", "tau"])
    q, M = rng.uniform(-0.8, 0.8, 5), np.zeros((5, 5))
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    accelerations = np.vstack([np.zeros(5), np.eye(5)])
    *pose, efforts, status = dynamics(np.tile(q, (6, 1)), np.zeros((6, 5)), accelerations)
    assert np.all(status == gt.Status.OK)
    assert efforts[1:] - efforts[0] == pytest.approx(M, abs=ROUND_OFF)
    assert efforts[0] == pytest.approx(data.qfrc_bias - data.qfrc_passive, abs=ROUND_OFF)
    for value, expected in zip(
        pose,
        (data.body("left arm").xmat.reshape(3, 3), data.body("hand").xpos, data.body("right arm").xpos,
         data.body("hand").xmat.reshape(3, 3)),
        strict=True,
    ):  # fmt: skip
        assert value[0] == pytest.approx(expected, abs=ROUND_OFF)


def test_a_urdf_with_all_its_branches_equals_pinocchio():
    path = URDF / "telescope.urdf"
    robot = gt.load_robot(f"{path}:*")
    coupled = {"extend_2": COUPLED["telescope"]["extend_2"], "grip_other": ("grip", 1.0, 0.0)}
    oracle = Pinocchio(path, "finger_left", coupled)
    names = [n for n in list(oracle.model.names)[1:] if n not in coupled]  # pinocchio sorts branches by name
    order = [names.index(n) for n in robot.graph.q]
    rng = np.random.default_rng(4)
    q, a = rng.uniform(-0.3, 0.3, (2, len(order)))
    r, tau, status = robot.causal("q", ["finger_left.frame.r", "tau"])(q, 0 * q, a)
    theirs, accelerations = np.zeros(len(order)), np.zeros(len(order))
    theirs[order], accelerations[order] = q, a
    assert status.ok
    assert r == pytest.approx(oracle.tool(theirs)[0], abs=ROUND_OFF)
    assert tau == pytest.approx(oracle.efforts(theirs, 0 * theirs, accelerations)[order], abs=ROUND_OFF)


OTHER_JOINTS = """<sdf version="1.9"><model name="kinds">
  <link name="arm"/><link name="cross"><pose>0.3 0 0 0 0 0</pose></link><link name="nut"><pose>0 0 1 0 0 0</pose></link>
  <joint name="turn" type="revolute"><parent>world</parent><child>arm</child><axis><xyz>0 0 1</xyz></axis></joint>
  <joint name="gimbal" type="universal"><parent>arm</parent><child>cross</child>
    <axis><xyz>1 0 0</xyz></axis><axis2><xyz>0 1 0</xyz></axis2></joint>
  <joint name="spindle" type="screw"><parent>world</parent><child>nut</child>
    <axis><xyz>0 0 1</xyz></axis><screw_thread_pitch>0.02</screw_thread_pitch></joint>
</model></sdf>"""


def test_universal_and_screw_joints():
    robot = gt.robots.mechanism(OTHER_JOINTS, driven=[])
    joints = ["turn.phi", "gimbal.joint.shaft_1.phi", "gimbal.joint.shaft_2.phi", "spindle.joint.shaft.phi"]
    pose = robot.causal(targets=["cross.frame.r", "cross.frame.R", "nut.frame.r"], prefer=joints)
    values = dict(zip(joints, (0.5, 0.3, -0.4, np.pi), strict=True))
    r, R, top, status = pose(*(values[x.name] for x in pose.inputs))
    x, y, z = np.eye(3)
    assert status.ok
    assert r == pytest.approx(0.3 * np.array([np.cos(0.5), np.sin(0.5), 0.0]), abs=ROUND_OFF)
    assert R == pytest.approx(rotation_about(z, 0.5) @ rotation_about(x, 0.3) @ rotation_about(y, -0.4), abs=ROUND_OFF)
    assert top == pytest.approx([0.0, 0.0, 1.0 + 0.02 / 2], abs=ROUND_OFF)  # half a turn


SPATIAL = """<sdf version="1.9"><model name="rssr">
  <link name="crank"/><link name="rod"><pose>0 0.2 0 0 0 0</pose></link>
  <link name="rocker"><pose>0.6 0 0.1 0 0 0</pose></link>
  <joint name="motor" type="revolute"><parent>world</parent><child>crank</child><axis><xyz>1 0 0</xyz></axis></joint>
  <joint name="lower" type="ball"><parent>crank</parent><child>rod</child></joint>
  <joint name="pivot" type="revolute"><parent>world</parent><child>rocker</child><axis><xyz>0 1 0.2</xyz></axis></joint>
  <joint name="upper" type="ball"><pose>0.5 0.3 0.3 0 0 0</pose><parent>rocker</parent><child>rod</child></joint>
</model></sdf>"""


def test_a_rod_between_ball_joints_spins():
    """Three bodies, 18 freedoms; two pins hold 5 each, two balls 3 each: 2, of which the rod's spin is idle."""
    report = gt.robots.mechanism(SPATIAL).mobility()
    assert (report.mobility, sum(i.count for i in report.idle), report.redundant) == (1, 1, 0)
    assert [i.part for i in report.idle] == ["rod"]


FOLLOWERS = """<mujoco model="cam"><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
  <body name="disk"><joint name="turn" axis="0 0 1" ref="0.2"/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 2"/></body>
  <body name="tappet"><joint name="lift" type="slide" ref="0.1"/>
    <inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/></body>
  <body name="stop" pos="0 0 1"><joint name="lock" ref="0.3"/></body>
  <body name="plate"><freejoint/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/></body></worldbody>
  <equality><joint joint1="lift" joint2="turn" polycoef="0.01 0.3 0.2 0 -0.1"/>
  <joint joint1="lock" polycoef="0.1 1 0 0 0"/></equality></mujoco>"""


def test_a_joint_that_follows_another_by_a_polynomial_acts_on_its_effort():
    """s - 0.1 = p(phi - 0.2); by the power, tau = 2 phi'' + 3 s'' ds/dphi. A free plate without gravity stays, and a
    joint that an equality locks 0.1 rad from its drawn pose is fixed there."""
    robot = gt.robots.mechanism(FOLLOWERS)
    assert robot.graph.q == ("turn",)
    s, tau, R, status = robot.causal("q", ["lift.s", "tau", "stop.frame.R"])([0.7], [1.5], [0.4])
    assert R == pytest.approx(rotation_about(np.eye(3)[2], 0.1), abs=ROUND_OFF)
    p = np.polynomial.Polynomial([0.01, 0.3, 0.2, 0.0, -0.1])
    slope, curve = p.deriv()(0.5), p.deriv(2)(0.5)
    assert status.ok
    assert s == pytest.approx(0.1 + p(0.5), abs=ROUND_OFF)
    assert tau == pytest.approx([2 * 0.4 + 3 * (slope * 0.4 + curve * 1.5**2) * slope], abs=ROUND_OFF)
    acceleration, status = robot.causal(targets="der(plate.frame.r,2)", prefer=["plate.r", "plate.frame.w"])(
        [1.0, 2.0, 0.5], 0.1, 0.2, 0.0
    )
    assert status.ok and acceleration == pytest.approx(np.zeros(3), abs=ROUND_OFF)


def wrong(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


FOUR = mjcf("four")
CONNECT = FOUR[FOUR.index("<connect") : FOUR.index("</equality>")]


@pytest.mark.parametrize(
    "text, line, sentence",
    [
        (wrong(FOUR, 'body2="rocker"', 'body2="rockr"'), 2, "did you mean 'rocker'"),
        (wrong(FOUR, CONNECT, '<connect site1="a" site2="b"/>'), 2, "names 'a', which is not a site"),
        (wrong(FOUR, CONNECT, '<weld body1="coupler" torquescale="0"/>'), 2, "write <connect>"),
        (wrong(FOUR, CONNECT, '<tendon tendon1="a"/>'), 2, "<tendon> of <equality> is not read"),
        (wrong(FOUR, '<motor joint="crank_pin"/>', '<motor joint="crank"/>'), 2, "names 'crank', which is not a joint"),
        (wrong(FOUR, CONNECT, '<joint joint1="crank_pin" joint2="crank_pin"/>'), 1, "follows itself"),
        (
            wrong(OTHER_JOINTS, "screw_thread_pitch>0.02</screw_", "thread_pitch>0.02</"),
            7,
            "did you mean 'screw_thread_pitch'",
        ),
        (wrong(OTHER_JOINTS, "<axis2><xyz>0 1 0</xyz></axis2>", ""), 4, "has no <axis2>"),
        (wrong(OTHER_JOINTS, 'type="screw"', 'type="gearbox"'), 6, "joint 'spindle' is gearbox"),
        ("<machine/>", 1, "expected <robot> of URDF, <sdf>, or <mujoco> of MJCF"),
    ],
)
def test_wrong_mechanisms(text, line, sentence):
    with pytest.raises(ModelError) as error:
        gt.robots.mechanism(text)
    assert f"line {line}: " in str(error.value) and sentence in str(error.value), error.value


@pytest.mark.parametrize(
    "options, sentence",
    [
        ({"driven": ["crank"]}, "did you mean 'crank_pin'"),
        ({"driven": ["tip"]}, "line 2: joint 'tip' is ball and cannot be driven"),
        ({"start": {"crnk_pin": 0.1}}, "did you mean 'crank_pin'"),
        ({"redundant": "keep"}, "redundant is 'error' or 'drop'"),
        ({"smoothing": "smooth"}, "friction smoothing is one of"),
    ],
)
def test_wrong_options(options, sentence):
    with pytest.raises(ModelError) as error:
        gt.robots.mechanism(FOUR, **options)
    assert sentence in str(error.value)


def test_a_loop_that_does_not_close_quotes_the_file():
    text = wrong(FOUR, CONNECT, '<connect site1="a" site2="b"/>')
    text = wrong(text, '<joint name="coupler_pin"', '<site name="a" pos="2 0 0"/><joint name="coupler_pin"')
    text = wrong(text, '<joint name="rocker_pin"', '<site name="b" pos="0.1 0 0"/><joint name="rocker_pin"')
    with pytest.raises(ModelError, match=r"gap of .* m .*'connect_3.joint'.*robot text:2"):
        gt.robots.mechanism(text).mobility()


def test_the_door_reads_loops_and_whole_trees(tmp_path):
    (tmp_path / "bars.sdf").write_text(sdf("four"))
    path = str(tmp_path / "bars.sdf")
    robot = gt.load_robot(path)
    assert robot.graph.q == ("crank_pin",)
    again = pickle.loads(pickle.dumps(robot))
    assert type(again) is type(robot) and again.graph == robot.graph
    assert gt.load_robot(f"{path}:*").graph == robot.graph
    with pytest.raises(InputError, match="this joint closes a loop"):
        gt.load_robot(f"{path}:coupler")
    with pytest.raises(InputError, match="a payload acts at the tool of a serial arm"):
        gt.load_robot(path, payload=1.0)
