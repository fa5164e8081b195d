"""Serial arms: URDF against pinocchio, Denavit-Hartenberg numbers against products of matrices, URDF written again."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from tests.robots.arm_oracle import COUPLED, FILES, TIPS, URDF, Pinocchio

G = 9.81
# relative; products of a dozen matrices
ROUND_OFF = 1e-12
AGREEMENT = 1e-10
pin = pytest.importorskip("pinocchio", reason="pinocchio, the oracle of serial arms, is not installed")


@pytest.fixture(scope="module", params=FILES)
def case(request: pytest.FixtureRequest):
    """An arm of a file with its functions, and the same in pinocchio."""
    path = URDF / f"{request.param}.urdf"
    arm = gt.robots.from_urdf(path, TIPS[request.param])
    function = arm.causal(known="q", targets=["T", "R", "tau"])
    return arm, function, Pinocchio(path, arm.structure.tool, COUPLED.get(request.param))


def drawn(arm: gt.Model, count: int, seed: int = 1) -> np.ndarray:
    """q, v, a (count, 3, n)."""
    return np.random.default_rng(seed).uniform(-2.0, 2.0, (count, 3, len(arm.structure.leaders)))


def test_a_file_is_pinocchios_arm(case) -> None:
    arm, function, oracle = case
    for q, v, a in drawn(arm, 12):
        T, R, tau, status = function(q, v, a)
        assert status is gt.Status.OK
        place, turn = oracle.tool(q)
        np.testing.assert_allclose(T, place, atol=AGREEMENT)
        np.testing.assert_allclose(R, turn, atol=AGREEMENT)
        expected = oracle.efforts(q, v, a)
        np.testing.assert_allclose(tau, expected, atol=AGREEMENT * np.abs(expected).max())


def test_its_mass_matrix_is_pinocchios(case) -> None:
    arm, function, oracle = case
    n = len(arm.structure.leaders)
    for q, *_ in drawn(arm, 4, 2):
        still = np.zeros((n, n))
        *_, at_rest, _ = function(q, np.zeros(n), np.zeros(n))
        *_, tau, status = function(np.tile(q, (n, 1)), still, np.eye(n))
        assert not status.any()
        expected = oracle.masses(q)
        np.testing.assert_allclose((tau - at_rest).T, expected, atol=AGREEMENT * expected.max())


def test_written_again_it_is_the_same_arm(case, tmp_path) -> None:
    arm, function, oracle = case
    file = tmp_path / "again.urdf"
    file.write_text(gt.robots.to_urdf(arm, "written again -- by a test"))
    again = gt.robots.from_urdf(file)
    followers = {n: c for n, c in COUPLED.get(arm.structure.name, {}).items() if c[0]}
    written = Pinocchio(file, again.structure.tool, followers)
    second = again.causal(known="q", targets=["T", "R", "tau"])
    np.testing.assert_allclose(again.joint_limits, arm.joint_limits, atol=0)
    for q, v, a in drawn(arm, 4, 3):
        for first, other in zip(function(q, v, a)[:3], second(q, v, a)[:3], strict=True):
            np.testing.assert_allclose(other, first, atol=AGREEMENT * max(1.0, np.abs(first).max()))
        expected = oracle.efforts(q, v, a)
        np.testing.assert_allclose(written.efforts(q, v, a), expected, atol=AGREEMENT * np.abs(expected).max())


def test_what_was_left_out_is_said() -> None:
    serial = gt.robots.from_urdf(URDF / "serial.urdf")
    assert serial.structure.notes == ("not used: 1 transmissions, 1 Gazebo elements",)
    telescope = gt.robots.from_urdf(URDF / "telescope.urdf", "tool_point")
    assert [n.partition(": ")[2].partition(" is ")[0] for n in telescope.structure.notes] == [
        "joint 'grip'", "joint 'grip_other'",
    ]  # fmt: skip
    assert all("locked at 0.01" in n for n in telescope.structure.notes)


def test_several_ends_are_asked_about() -> None:
    with pytest.raises(gt.ModelError, match="has several ends: finger_left, finger_right, tool_point, cabinet; name"):
        gt.robots.from_urdf(URDF / "telescope.urdf")
    with pytest.raises(gt.ModelError, match=r"has no link 'tool_pont'; did you mean 'tool_point'"):
        gt.robots.from_urdf(URDF / "telescope.urdf", "tool_pont")


def test_limits_of_a_follower_bind_its_leader() -> None:
    telescope = gt.robots.from_urdf(URDF / "telescope.urdf", "tool_point")
    limits = telescope.joint_limits
    assert limits is not None and limits.shape == (4, 2)
    np.testing.assert_allclose(limits[2], [0.0, 0.6])
    shorter = (URDF / "telescope.urdf").read_text().replace('lower="-1" upper="1"', 'lower="-1" upper="0.45"')
    stiff = gt.robots.from_urdf(shorter, "tool_point")
    assert stiff.joint_limits is not None
    np.testing.assert_allclose(stiff.joint_limits[2], [0.0, 0.5])


def test_a_follower_whose_leader_is_not_on_the_chain_stands_still() -> None:
    """The hand's right finger follows the left one: on a chain to it both stand where the left one may."""
    telescope = gt.robots.from_urdf(URDF / "telescope.urdf", "finger_right")
    assert [j.name for j in telescope.structure.joints] == ["slew", "luff", "extend_1", "extend_2", "hand_turn"]
    assert any("'grip_other' follows 'grip', which is not on the chain" in n for n in telescope.structure.notes)
    oracle = Pinocchio(URDF / "telescope.urdf", "finger_right", COUPLED["telescope"])
    function = telescope.causal(known="q", targets=["T", "tau"])
    for q, v, a in drawn(telescope, 3):
        T, tau, _ = function(q, v, a)
        np.testing.assert_allclose(T, oracle.tool(q)[0], atol=AGREEMENT)
        np.testing.assert_allclose(tau, oracle.efforts(q, v, a), atol=AGREEMENT * 1e3)


def test_a_follower_of_a_follower_follows_the_first() -> None:
    text = (URDF / "telescope.urdf").read_text()
    joint = '<axis xyz="0 0 1"/>\n    <limit lower="-3" upper="3" velocity="2" effort="20"/>'
    assert joint in text
    text = text.replace(joint, joint + '<mimic joint="extend_2" multiplier="2" offset="0.1"/>')
    arm = gt.robots.from_urdf(text, "tool_point")
    hand = arm.structure.joints[-1]
    assert (hand.leader, hand.multiplier, hand.offset) == (2, pytest.approx(1.6), pytest.approx(0.2))
    assert len(arm.structure.leaders) == 3
    with pytest.raises(gt.ModelError, match="mimics itself"):
        gt.robots.from_urdf(text.replace('mimic joint="extend_1"', 'mimic joint="hand_turn"'), "tool_point")


LINKS = '<link name="a"/><link name="b"/>'
ENDS = '<parent link="a"/><child link="b"/>'
WRONG = {
    f'<robot name="r">{LINKS}\n<joint name="j" type="floating">{ENDS}</joint></robot>':
        "line 2: joint 'j' is floating; expected one of continuous, prismatic, revolute, fixed; a serial arm",
    f'<robot name="r">{LINKS}\n\n<joint name="j" type="planar">{ENDS}</joint></robot>': "line 3: joint 'j' is planar",
    '<!DOCTYPE r [\n<!ENTITY x "y">]><robot name="r"/>': "line 2: declares an entity",
    "<robot name='r'>\n<link name='a'></robot>": "line 2: is not XML: mismatched tag",
    "<sdf/>": "line 1: the file is SDF; read it with from_sdf",
    "<robot>\n" + "<link>" * 60 + "</link>" * 60 + "</robot>": "line 2: has elements nested more than",
    "<model/>": "line 1: the outermost element is <model>; expected <robot>",
    '<robot name="r"><link name="${n}"/></robot>': "line 1: this is a xacro template",
    '<robot name="r"/>': "line 1: <robot> holds no <link>",
    f'<robot name="r">{LINKS}</robot>': "line 1: several links have no parent: a, b; expected one",
    '<robot name="r"><link name="a"/>\n<link name="a"/></robot>': "line 2: two elements <link> have the name 'a'",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute"><parent link="a"/></joint></robot>':
        "line 2: joint 'j' has no <child>",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute">{ENDS}<axis xyz="0 0 0"/></joint></robot>':
        "line 2: the axis of joint 'j' is zero",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute">{ENDS}<origin xyz="0 0,1 0"/></joint></robot>':
        "line 2: joint 'j': xyz of <origin> takes three numbers; found '0 0,1 0'",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute">{ENDS}<limit lower="a"/></joint></robot>':
        "line 2: joint 'j': lower of <limit> takes a number; found 'a'",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute">{ENDS}<limit lower="2" upper="1"/></joint></robot>':
        "line 2: the lower limit of joint 'j' is above the upper one",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute">{ENDS}<mimic joint="k"/></joint></robot>':
        "line 1: joint 'j' mimics 'k'",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute"><parent link="a"/><child link="c"/></joint></robot>':
        "line 1: the child 'c' of joint 'j'",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute">{ENDS}</joint>\n<joint name="k" type="fixed">{ENDS}'
    "</joint></robot>": "line 2: link 'b' is the child of 'j' and of 'k'; URDF has no loops",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute">{ENDS}</joint><joint name="k" type="fixed">'
    '<parent link="b"/><child link="a"/></joint></robot>': "line 1: the joints form a loop",
    '<robot name="r"><link name="a"><inertial><mass value="1"/></inertial></link></robot>':
        "line 1: the <inertial> of link 'a' has no <inertia>",
    '<robot name="r">\n<link name="a"><inertial><mass value="-1"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" '
    'izz="0"/></inertial></link></robot>': "line 2: the mass of link 'a' is -1 kg; it cannot be negative",
    f'<robot name="r">{LINKS}<joint name="j" type="fixed">{ENDS}</joint></robot>': "no joint of URDF text moves",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute">{ENDS}<origin rpx="0 0 1"/></joint></robot>':
        "line 2: <origin> of joint 'j' has the unknown attribute 'rpx'; did you mean 'rpy'?",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute">{ENDS}<limit Lower="-1" upper="1"/></joint></robot>':
        "line 2: <limit> of joint 'j' has the unknown attribute 'Lower'; did you mean 'lower'?",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute">{ENDS}\n<orgin xyz="0 0 1"/></joint></robot>':
        "line 2: <joint> of joint 'j' holds <orgin>, which it does not take; did you mean 'origin'?",
    '<robot name="r">\n<link name="a"><mass value="1"/></link></robot>':
        "line 2: <link> of link 'a' holds <mass>, which it does not take; it takes inertial",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute">{ENDS}<origin rpy="0 0 0" quat_xyzw="0 0 0 1"/></joint>'
    "</robot>": "line 1: joint 'j': <origin> has both rpy and quat_xyzw; expected one of them",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute">{ENDS}<origin quat_xyzw="0 0 1 1"/></joint></robot>':
        "line 1: joint 'j': quat_xyzw of <origin> has the norm 1.414; expected 1",
}  # fmt: skip


@pytest.mark.parametrize("text", WRONG, ids=lambda t: WRONG[t][:40])
def test_a_wrong_file_is_one_sentence_with_its_line(text: str) -> None:
    with pytest.raises(gt.ModelError) as caught:
        gt.robots.from_urdf(text)
    message = str(caught.value)
    assert WRONG[text] in message and "URDF text" in message
    assert "\n" not in message and len(message) <= 300


def test_a_quaternion_is_the_rotation_of_its_angles_and_what_is_not_used_is_said() -> None:
    """About x by 90 degrees, then about the fixed z by 90 degrees: (0.5, 0.5, 0.5, 0.5); it was passed over."""
    text = (
        f'<robot name="r" version="1.1">{LINKS}<joint name="j" type="revolute">{ENDS}<origin xyz="1 2 3" ORIGIN/>'
        '<limit lower="-1" upper="1" jerk="3"/></joint><gazebo reference="a"/></robot>'
    )
    by_quaternion = gt.robots.from_urdf(text.replace("ORIGIN", 'quat_xyzw="0.5 0.5 0.5 0.5"'))
    by_angles = gt.robots.from_urdf(text.replace("ORIGIN", f'rpy="{np.pi / 2} 0 {np.pi / 2}"'))
    np.testing.assert_allclose(by_quaternion.rpy, by_angles.rpy, atol=1e-15)
    np.testing.assert_allclose(by_quaternion.xyz, [[1.0, 2.0, 3.0]])
    assert "line 1: 'jerk' of <limit> of joint 'j' is not used" in by_quaternion.structure.notes


def test_degrees_millimetres_and_impossible_inertias_are_doubted() -> None:
    text = (URDF / "parallel.urdf").read_text()
    text = text.replace('lower="-2.9" upper="2.9"', 'lower="-170" upper="170"').replace("0.45 0 0", "450 0 0")
    text = text.replace('ixx="0.03"', 'ixx="0.9"')
    notes = gt.robots.from_urdf(text).structure.notes
    assert [n.partition(": ")[2][:34] for n in notes] == [
        "the inertia of link 'outer_arm' is",
        "the limits of joint 'turn' are -17",
        "the origin of joint 'elbow' is 450",
    ]


def about(axis: int, angle: float) -> np.ndarray:
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    M = np.eye(4)
    M[i, i] = M[j, j] = np.cos(angle)
    M[i, j], M[j, i] = -np.sin(angle), np.sin(angle)
    return M


def along(axis: int, distance: float) -> np.ndarray:
    M = np.eye(4)
    M[axis, 3] = distance
    return M


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_dh_numbers_are_products_of_matrices(convention) -> None:
    rng = np.random.default_rng(5)
    a, alpha, d, theta, beta = rng.uniform(-1.0, 1.0, (5, 5))
    tool, base = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
    arm = gt.robots.serial_arm(a, alpha, d, theta, beta, convention=convention, joints="rrprp", tool_xyz=tool,
                               base_xyz=base, base_rpy=[0.3, -0.2, 0.1])  # fmt: skip
    forward = arm.causal(known="q", targets=["T", "R"])
    for q in rng.uniform(-1.5, 1.5, (6, 5)):
        M = np.eye(4)
        M[:3, 3] = base
        M = M @ about(2, 0.1) @ about(1, -0.2) @ about(0, 0.3)
        for k in range(5):
            angle, shift = (theta[k], d[k] + q[k]) if k in (2, 4) else (theta[k] + q[k], d[k])
            front, back = about(2, angle) @ along(2, shift), along(0, a[k]) @ about(0, alpha[k]) @ about(1, beta[k])
            M = M @ (front @ back if convention == "standard" else back @ front)
        T, R, status = forward(q)
        assert status is gt.Status.OK
        np.testing.assert_allclose(T, M[:3, :3] @ tool + M[:3, 3], atol=ROUND_OFF)
        np.testing.assert_allclose(R, M[:3, :3], atol=ROUND_OFF)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_dh_arm_written_as_urdf_has_its_dynamics_in_pinocchio(convention, tmp_path) -> None:
    rng = np.random.default_rng(6)
    n = 5
    a, alpha, d, theta, beta = rng.uniform(-1.0, 1.0, (5, n))
    root = 0.2 * rng.normal(size=(n, 3, 3))
    arm = gt.robots.serial_arm(a, alpha, d, theta, beta, convention=convention, joints="rrprr", m=rng.uniform(1, 5, n),
                               c=rng.uniform(-0.2, 0.2, (n, 3)), I=root @ root.transpose(0, 2, 1) + 0.01 * np.eye(3),
                               base_rpy=[np.pi / 2, 0.1, 0.0], payload=2.0, tool_xyz=[0.1, 0.0, 0.2],
                               tool_rpy=[0.4, 0.0, 0.3])  # fmt: skip
    file = tmp_path / "arm.urdf"
    file.write_text(gt.robots.to_urdf(arm))
    oracle = Pinocchio(file, "tool")
    function = arm.causal(known="q", targets=["T", "R", "tau"])
    for q, v, w in drawn(arm, 4):
        T, R, tau, status = function(q, v, w)
        assert status is gt.Status.OK
        place, turn = oracle.tool(q)
        np.testing.assert_allclose(T, place, atol=AGREEMENT)
        np.testing.assert_allclose(R, turn, atol=AGREEMENT)
        expected = oracle.efforts(q, v, w)
        np.testing.assert_allclose(tau, expected, atol=AGREEMENT * np.abs(expected).max())


def tool_place(numbers, kinds, convention, tool, frame, q) -> np.ndarray:
    """The tool in another frame (t and small turns) by products of matrices."""
    M = along(0, frame[0]) @ along(1, frame[1]) @ along(2, frame[2])
    M = M @ about(0, frame[3]) @ about(1, frame[4]) @ about(2, frame[5])
    for (theta, d, a, alpha, beta), kind, x in zip(numbers, kinds, q, strict=True):
        joint = about(2, x) if kind == "r" else along(2, x)
        front, back = about(2, theta) @ along(2, d), along(0, a) @ about(0, alpha) @ about(1, beta)
        M = M @ (joint @ front @ back if convention == "standard" else back @ front @ joint)
    return M[:3, :3] @ tool + M[:3, 3]


SKEW = dict(a=[0.3, 0.25, 0.1, 0.2], alpha=[1.0, 0.7, -0.5, 0.4], d=[0.1, 0.2, 0.3, 0.1])
PUMA = dict(a=[0.16, 0.6, 0.12, 0, 0, 0], alpha=np.radians([-90, 0, -90, 90, -90, 0]), d=[0.45, 0, 0, 0.62, 0, 0.1])
SCARA = dict(a=[0.3, 0.25, 0.1], alpha=[0.0, np.pi, 0.0])


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize(
    ("numbers", "joints", "rank"),
    [(PUMA, "r" * 6, {"standard": 27, "modified": 26}), (SCARA, "rrp", 13), (SKEW, "rprr", 17), (SKEW, "prrr", 17),
     (SKEW, "rrrp", 17)],
    ids=["puma", "scara", "rprr", "prrr", "rrrp"],
)  # fmt: skip
def test_independent_geometry_is_all_that_positions_see(convention, numbers, joints, rank) -> None:
    """As many as the rank of the positions' derivatives in all numbers, tool and frame, and independent of each other.

    A PUMA's numbers in the modified convention give an arm whose axes 5 and 6 are one line.
    """
    arm = gt.robots.serial_arm(**numbers, joints=joints, convention=convention, tool_xyz=[0.12, 0.03, 0.05])
    n = len(joints)
    start = np.concatenate(
        [np.array([arm.theta, arm.d, arm.a, arm.alpha, arm.beta]).T.ravel(), arm.tool_xyz, np.zeros(6)]
    )
    names = [f"{x}[{k}]" for k in range(n) for x in ("theta", "d", "a", "alpha", "beta")]
    names += [f"tool_xyz[{k}]" for k in range(3)] + ["frame"] * 6
    configurations = np.random.default_rng(3).uniform(-1.2, 1.2, (25, n))

    def places(x: np.ndarray) -> np.ndarray:
        split = x[: 5 * n].reshape(n, 5), joints, convention, x[5 * n : 5 * n + 3], x[5 * n + 3 :]
        return np.concatenate([tool_place(*split, q) for q in configurations])

    h = 1e-6
    J = np.array([(places(start + h * e) - places(start - h * e)) / (2 * h) for e in np.eye(len(start))]).T
    free, notes = gt.robots.independent_geometry(arm)
    chosen = J[:, [k for k, name in enumerate(names) if name in free or name == "frame"]]
    expected = rank if isinstance(rank, int) else rank[convention]
    assert np.linalg.matrix_rank(J, 1e-6) == expected == chosen.shape[1] == np.linalg.matrix_rank(chosen, 1e-6)
    everything = [*free, *(x for x in names if any(note.startswith(f"{x} ") for note in notes))]
    left = {x for x in names if x != "frame" and not x.startswith("beta")} - set(everything)
    assert not left  # each number is free, or a sentence says why not


def test_of_a_urdf_it_asks_for_dh_numbers() -> None:
    with pytest.raises(gt.ModelError, match=r"calibrate as_dh\(arm\) instead"):
        gt.robots.independent_geometry(gt.robots.from_urdf(URDF / "parallel.urdf"))


def test_by_dh_numbers_it_is_the_same_arm(case) -> None:
    arm, function, _ = case
    other = gt.robots.as_dh(arm)
    assert gt.robots.as_dh(other) is other
    second = other.causal(known="q", targets=["T", "R", "tau"])
    for q, v, a in drawn(arm, 4, 4):
        for first, again in zip(function(q, v, a)[:3], second(q, v, a)[:3], strict=True):
            np.testing.assert_allclose(again, first, atol=AGREEMENT * max(1.0, np.abs(first).max()))
    nearly = np.abs(np.sin(np.asarray(other.alpha)[:-1])) < np.sin(np.radians(5.0))
    assert not np.any(np.asarray(other.d)[:-1][nearly])  # Hayati's numbers there


def test_friction_and_its_signs() -> None:
    arm = gt.robots.serial_arm(a=[0.3], alpha=0.0, viscous=[2.0], coulomb=[5.0], smoothing="sign")
    tau, _ = arm.causal(known="q", targets="tau")([[0.0], [0.0]], [[0.5], [-0.5]], np.zeros((2, 1)))
    np.testing.assert_allclose(tau[:, 0], [6.0, -6.0], atol=ROUND_OFF)


def test_it_swings_and_keeps_its_energy() -> None:
    arm = gt.robots.serial_arm(a=[0.5, 0.5], alpha=0.0, base_rpy=[np.pi / 2, 0.0, 0.0], m=[2.0, 1.0],
                               c=[[-0.25, 0, 0], [-0.2, 0.05, 0]], I=np.tile(0.02 * np.eye(3), (2, 1, 1)))  # fmt: skip
    run = arm.simulate(1.5, inputs={"tau": [0.0, 0.0]}, start={"q": [0.3, -0.5], "der(q)": [0.0, 0.0]})
    assert run.status.ok
    assert float(run.trajectory["q"][-1, 0]) < 0.0  # falls from the horizontal


REFUSED = [
    (dict(a=[0.1, 0.2], alpha=[0.0]), "'alpha' has 1 numbers; expected 2"),
    (dict(a=[0.1, 0.2], alpha=0.0, joints="rx"), "joints takes one of r, p for each of the 2 joints"),
    (dict(a=[0.1, 0.2], alpha=0.0, convention="craig"), "a convention is standard or modified"),
    (dict(a=[0.1, 0.2], alpha=0.0, names=["a", "a"]), "names takes 2 different names"),
    (dict(a=[0.1, 0.2], alpha=0.0, limits=[[0, 1], [1, 0]]), "limits of joint .joint_2. are 57.3 deg and 0 deg"),
    (dict(a=[0.1], alpha=0.0, payload=-1.0), "a payload is a mass of 0 kg or more"),
    (dict(a=[0.1, 0.2], alpha=0.0, limits=[[0, 1], [1]]), "'limits' takes numbers, the same count in each row"),
    (dict(a="long", alpha=0.0), "'a' takes numbers"),
    (dict(a=[0.1], alpha=0.0, smoothing="none"), "friction smoothing is one of tanh"),
    (dict(a=[0.1], alpha=0.0, c=[[0, 0, 0]], mc=[[0, 0, 0]]), "c and I describe the same as mc and J"),
]


@pytest.mark.parametrize(("arguments", "sentence"), REFUSED, ids=[s for _, s in REFUSED])
def test_what_is_no_arm_is_refused(arguments, sentence) -> None:
    with pytest.raises(gt.ModelError, match=sentence):
        gt.robots.serial_arm(**arguments)


def test_urdf_cannot_say_moments_without_mass() -> None:
    arm = gt.robots.serial_arm(a=[0.1], alpha=0.0, J=[[0.1, 0, 0, 0.1, 0, 0.1]])
    with pytest.raises(gt.ModelError, match="has moments but no mass"):
        gt.robots.to_urdf(arm)
