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
    assert serial.structure.notes == (
        "not used: 1 shapes to be shown, 1 shapes for collisions, 1 transmissions, 1 elements of Gazebo, 1 materials",
    )
    telescope = gt.robots.from_urdf(URDF / "telescope.urdf", "tool_point")
    assert [n.partition(": ")[2].partition(" is ")[0] for n in telescope.structure.notes] == [
        "joint 'grip'", "joint 'grip_other'",
    ]  # fmt: skip
    assert all("stand still at 0.01" in n for n in telescope.structure.notes)


def test_several_ends_are_asked_about() -> None:
    with pytest.raises(
        gt.ModelError, match="has several ends: finger_left, finger_right, tool_point, cabinet; name the link"
    ):
        gt.robots.from_urdf(URDF / "telescope.urdf")
    with pytest.raises(gt.ModelError, match=r"has no link 'tool_pont'; did you mean tool_point"):
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


LINKS = '<link name="a"/><link name="b"/>'
ENDS = '<parent link="a"/><child link="b"/>'
WRONG = {
    f'<robot name="r">{LINKS}\n<joint name="j" type="floating">{ENDS}</joint></robot>':
        "line 2: joint 'j' is floating; expected one of continuous, prismatic, revolute, fixed; a base that moves is",
    f'<robot name="r">{LINKS}\n\n<joint name="j" type="planar">{ENDS}</joint></robot>': "line 3: joint 'j' is planar",
    '<!DOCTYPE r [\n<!ENTITY x "y">]><robot name="r"/>': "line 2: declares an entity",
    "<robot name='r'>\n<link name='a'></robot>": "line 2: is no XML: mismatched tag",
    "<sdf/>": "line 1: is SDF; expected URDF",
    "<model/>": "line 1: the outermost element is <model>; expected <robot>",
    '<robot name="r"><link name="${n}"/></robot>': "line 1: is xacro, a template; make the URDF first",
    '<robot name="r"/>': "line 1: holds no <link>",
    f'<robot name="r">{LINKS}</robot>': "line 1: several links have no parent: a, b; expected one",
    '<robot name="r"><link name="a"/>\n<link name="a"/></robot>': "line 2: a second link is called 'a'",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute"><parent link="a"/></joint></robot>':
        "line 2: joint 'j' has no <child>",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute">{ENDS}<axis xyz="0 0 0"/></joint></robot>':
        "line 2: the axis of joint 'j' is zero",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute">{ENDS}<origin xyz="0 0,1 0"/></joint></robot>':
        "line 2: xyz of <origin> takes three numbers; found '0 0,1 0'",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute">{ENDS}<limit lower="a"/></joint></robot>':
        "line 2: lower of <limit> takes a number; found 'a'",
    f'<robot name="r">{LINKS}\n<joint name="j" type="revolute">{ENDS}<limit lower="2" upper="1"/></joint></robot>':
        "line 2: the lower limit of joint 'j' is above the upper one",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute">{ENDS}<mimic joint="k"/></joint></robot>':
        "line 1: joint 'j' mimics 'k', which is no joint",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute"><parent link="a"/><child link="c"/></joint></robot>':
        "line 1: joint 'j' names the child 'c', which is no link",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute">{ENDS}</joint>\n<joint name="k" type="fixed">{ENDS}'
    "</joint></robot>": "line 2: link 'b' is the child of 'j' and of 'k'; a loop is no URDF",
    f'<robot name="r">{LINKS}<joint name="j" type="revolute">{ENDS}</joint><joint name="k" type="fixed">'
    '<parent link="b"/><child link="a"/></joint></robot>': "line 1: the joints go round in a circle",
    '<robot name="r"><link name="a"><inertial><mass value="1"/></inertial></link></robot>':
        "line 1: the <inertial> of link 'a' has no <inertia>",
    '<robot name="r">\n<link name="a"><inertial><mass value="-1"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" '
    'izz="0"/></inertial></link></robot>': "line 2: the mass of link 'a' is -1 kg; it cannot be negative",
    f'<robot name="r">{LINKS}<joint name="j" type="fixed">{ENDS}</joint></robot>': "no joint of URDF text moves",
}  # fmt: skip


@pytest.mark.parametrize("text", WRONG, ids=lambda t: WRONG[t][:40])
def test_a_wrong_file_is_one_sentence_with_its_line(text: str) -> None:
    with pytest.raises(gt.ModelError) as caught:
        gt.robots.from_urdf(text)
    message = str(caught.value)
    assert WRONG[text] in message and "URDF text" in message
    assert "\n" not in message and len(message) <= 300


def test_degrees_millimetres_and_impossible_inertias_are_doubted() -> None:
    text = (URDF / "parallel.urdf").read_text()
    text = text.replace('lower="-2.9" upper="2.9"', 'lower="-170" upper="170"').replace("0.45 0 0", "450 0 0")
    text = text.replace('ixx="0.03"', 'ixx="0.9"')
    notes = gt.robots.from_urdf(text).structure.notes
    assert [n.partition(": ")[2][:34] for n in notes] == [
        "no body has the inertia of link 'o",
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
    (dict(a=[0.1, 0.2], alpha=0.0, limits=[[0, 1], [1, 0]]), "limits takes a lower and a greater upper one"),
    (dict(a=[0.1], alpha=0.0, payload=-1.0), "a payload is a mass of 0 kg or more"),
    (dict(a=[0.1], alpha=0.0, smoothing="none"), "friction smoothing is one of tanh"),
    (dict(a=[0.1], alpha=0.0, c=[[0, 0, 0]], mc=[[0, 0, 0]]), "c and I say the same as mc and J"),
]


@pytest.mark.parametrize(("arguments", "sentence"), REFUSED, ids=[s for _, s in REFUSED])
def test_what_is_no_arm_is_refused(arguments, sentence) -> None:
    with pytest.raises(gt.ModelError, match=sentence):
        gt.robots.serial_arm(**arguments)


def test_urdf_cannot_say_moments_without_mass() -> None:
    arm = gt.robots.serial_arm(a=[0.1], alpha=0.0, J=[[0.1, 0, 0, 0.1, 0, 0.1]])
    with pytest.raises(gt.ModelError, match="has moments but no mass, which URDF cannot say"):
        gt.robots.to_urdf(arm)
