"""Inverse kinematics of serial arms by `causal`: closed forms with branches, other starts of Newton, and statuses."""

from __future__ import annotations

from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import mechanics
from gtmodel.geometry.rotations import rotation_about
from tests.robots.arm_oracle import Pinocchio

ARM = Path(__file__).parents[2] / "problems" / "models" / "arm.urdf"
HOME = np.array([-0.6, 0.4, 1.0, 0.2, 0.8, 0.3])
ROUND_OFF = 1e-12  # of positions in metres, rotations and angles away from singular poses
NEAR_SINGULAR = 1e-5  # rad: next to a double root half of the digits of an angle are lost
UR = dict(
    a=[0.0, -0.425, -0.3922, 0.0, 0.0, 0.0], d=[0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996],
    alpha=[np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0],
)  # fmt: skip
X, Y, Z = np.eye(3)


def pose_by_dh(a: list, d: list, alpha: list, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standard Denavit-Hartenberg parameters, written out."""
    pose = np.eye(4)
    for ak, dk, t, qk in zip(a, d, alpha, q, strict=True):
        c, s, ct, st = np.cos(qk), np.sin(qk), np.cos(t), np.sin(t)
        pose = pose @ [[c, -s * ct, s * st, ak * c], [s, c * ct, -c * st, ak * s], [0, st, ct, dk], [0, 0, 0, 1]]
    return pose[:3, 3], pose[:3, :3]


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Largest difference of angles in each row, without full turns."""
    return np.max(np.abs((a - b + np.pi) % (2 * np.pi) - np.pi), axis=-1)


def chain(axes: np.ndarray, shifts: np.ndarray, start: list[float] | None = None) -> gt.Builder:
    """Revolute joints about these axes, each followed by a shift, with motors, written by hand."""
    m = gt.Builder("hand")
    q = m.variable("q", len(axes), unit="rad", start=start)
    T, R = m.variable("T", 3, unit="m"), m.variable("R", (3, 3), unit="1")
    end = m.part("ground", mechanics.Ground()).frame
    for k, (axis, d) in enumerate(zip(axes, shifts, strict=True)):
        joint = m.part(f"joint_{k}", mechanics.Revolute(axis=axis))
        link = m.part(f"link_{k}", mechanics.FixedTranslation(d=d))
        motor = m.part(f"motor_{k}", mechanics.TorqueMotor())
        m.add(gt.connect([end, joint.b, joint.shaft], [joint.a, link.a, motor.shaft]), q[k] == joint.shaft.phi)
        end = link.b
    m.add(end.r == T, end.R == R)
    return m


@cache
def from_home() -> gt.CausalFunction:
    return gt.robots.serial_arm(**UR, start=HOME).causal(["T", "R"], "q")


@pytest.fixture(scope="module")
def urdf() -> gt.Model:
    return gt.robots.from_urdf(ARM, start=HOME)


@pytest.fixture(scope="module")
def oracle(urdf: gt.Model) -> Pinocchio:
    return Pinocchio(ARM, urdf.structure.tool)


def test_position_and_rotation_of_a_urdf_arm_give_joints_rates_and_torques_of_pinocchio(urdf, oracle) -> None:
    bare = urdf.with_(viscous=np.zeros(6), coulomb=np.zeros(6))
    inverse = bare.causal(["T", "R"], ["q", "der(q)", "der(q,2)", "tau"])
    assert [s.name for s in inverse.inputs] == ["T", "der(T)", "der(T,2)", "R", "der(R)", "der(R,2)"]
    rng, h = np.random.default_rng(3), 1e-3
    for _ in range(5):
        q, v, a = HOME + rng.uniform(-0.2, 0.2, 6), rng.standard_normal(6), rng.standard_normal(6)
        # derivatives of the pose by differences of sixth order: pinocchio computes poses only
        poses = [oracle.tool(q + t * v + t**2 / 2 * a) for t in h * np.arange(-3, 4)]
        T, R = (np.array(x) for x in zip(*poses, strict=True))
        first = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60 / h
        second = np.array([2, -27, 270, -490, 270, -27, 2]) / 180 / h**2
        values = [x for y in (T, R) for x in (y[3], np.tensordot(first, y, 1), np.tensordot(second, y, 1))]
        found, rate, acceleration, tau, status = inverse(*values)
        assert status is gt.Status.OK
        np.testing.assert_allclose(found, q, atol=ROUND_OFF)
        np.testing.assert_allclose(rate, v, atol=1e-9)  # round-off 1e-16 / h, amplified by the inverse Jacobian
        np.testing.assert_allclose(acceleration, a, atol=1e-6)  # 1e-16 / h^2
        np.testing.assert_allclose(tau, oracle.efforts(q, v, a), atol=1e-4)


@pytest.mark.parametrize("arm", ["ur5e", *[pytest.param(a, marks=pytest.mark.proof) for a in ("puma", "kr")]])
def test_the_posture_of_a_reachable_pose_is_among_the_branches(arm: str) -> None:
    dh = {
        "ur5e": UR,
        "puma": dict(a=[0, 0.4318, 0.0203, 0, 0, 0], d=[0, 0, 0.15005, 0.4318, 0, 0],
                     alpha=[np.pi / 2, 0, -np.pi / 2, np.pi / 2, -np.pi / 2, 0]),
        "kr": dict(a=[0.16, 0.68, 0.035, 0, 0, 0], d=[0.645, 0, 0, 0.6, 0, 0.12],
                   alpha=[-np.pi / 2, 0, np.pi / 2, -np.pi / 2, np.pi / 2, 0]),
    }[arm]  # fmt: skip
    model = gt.robots.serial_arm(**dh)
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (100, 6))
    T, R = (np.array(x) for x in zip(*[pose_by_dh(**dh, q=row) for row in q], strict=True))
    names, among = ("shoulder", "elbow", "wrist"), np.zeros(len(q), dtype=bool)
    for signs in product((1, -1), repeat=3):
        inverse = model.causal(["T", "R"], "q", branches=dict(zip(names, signs, strict=True)))
        assert not inverse.kernels
        found, status = inverse(T, R)
        good = status == gt.Status.OK
        for row, t, r in zip(found[good], T[good], R[good], strict=True):
            at, turned = pose_by_dh(**dh, q=row)
            np.testing.assert_allclose(at, t, atol=1e-9)
            np.testing.assert_allclose(turned, r, atol=1e-9)
        among |= good & (apart(found, q) < NEAR_SINGULAR)
    assert among.all()


@pytest.mark.proof
def test_general_arm_has_no_closed_form_and_other_starts_solve_it() -> None:
    rng = np.random.default_rng(5)
    dh = dict(a=rng.uniform(0.0, 0.5, 6), d=rng.uniform(0.0, 0.5, 6), alpha=rng.uniform(-2.0, 2.0, 6))
    inverse = gt.robots.serial_arm(**dh).causal(["T", "R"], "q")
    assert len(inverse.kernels) == 1
    assert "the start values are singular: the home pose is a regular one near them" in inverse.explain()
    q = rng.uniform(-np.pi, np.pi, (60, 6))
    T, R = (np.array(x) for x in zip(*[pose_by_dh(**dh, q=row) for row in q], strict=True))
    found, status = inverse(T, R)
    assert np.isin(status, (gt.Status.OK, gt.Status.SINGULAR)).all() and np.sum(status == gt.Status.OK) >= 59
    for row, t, r in zip(found[status == 0], T[status == 0], R[status == 0], strict=True):
        at, turned = pose_by_dh(**dh, q=row)
        np.testing.assert_allclose(at, t, atol=ROUND_OFF)
        np.testing.assert_allclose(turned, r, atol=ROUND_OFF)
    alone = [inverse(t, r)[0] for t, r in zip(T[:5], R[:5], strict=True)]  # a row does not depend on the others
    np.testing.assert_array_equal(alone, found[:5])
    _, status = inverse([3.5, 0.0, 0.0], np.eye(3))
    assert status is gt.Status.OUT_OF_RANGE and "from joint 1 at most" in inverse.diagnose([3.5, 0.0, 0.0], np.eye(3))


def test_scara_of_the_documentation_reaches_every_target() -> None:
    scara = gt.robots.serial_arm(a=[0.3, 0.25, 0.0], alpha=[0.0, np.pi, 0.0], joints="rrp")
    rng = np.random.default_rng(2)
    radius, turn = rng.uniform(0.06, 0.54, 200), rng.uniform(-np.pi, np.pi, 200)
    T = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), rng.uniform(-0.3, 0.3, 200)])
    for sign in (1, -1):
        q, status = scara.causal("T", "q", branches={"elbow": sign})(T)
        assert not status.any()
        x = 0.3 * np.cos(q[:, 0]) + 0.25 * np.cos(q[:, 0] + q[:, 1])
        y = 0.3 * np.sin(q[:, 0]) + 0.25 * np.sin(q[:, 0] + q[:, 1])
        np.testing.assert_allclose(np.column_stack([x, y, -q[:, 2]]), T, atol=ROUND_OFF)
        assert len(np.unique(np.sign(q[:, 1]))) == 1


def test_fewer_joints_than_the_pose_has_numbers_leave_conditions() -> None:
    dh = dict(a=[0.3, 0.25, 0.0, 0.0], alpha=[0.0, np.pi, 0.0, 0.0])
    scara = gt.robots.serial_arm(**dh, joints="rrpr", start=[0.3, 0.8, 0.1, 0.2])
    q = np.array([0.5, 0.6, 0.05, -0.4])
    T, R, _ = scara.causal("q", ["T", "R"])(q)
    inverse = scara.causal(["T", "R"], "q")
    found, status = inverse(T, R)
    assert status is gt.Status.OK
    np.testing.assert_allclose(found, q, atol=ROUND_OFF)
    assert inverse(T, R @ rotation_about(X, 0.01))[1] is gt.Status.OUT_OF_RANGE


@pytest.mark.parametrize("general", [False, pytest.param(True, marks=pytest.mark.proof)])
def test_a_matrix_that_is_no_rotation_is_out_of_range(general: bool) -> None:
    dh = {**UR, "alpha": [1.2, 0.3, 0.2, 1.4, -1.0, 0.0]} if general else UR
    T, R = pose_by_dh(**dh, q=HOME)
    inverse = gt.robots.serial_arm(**dh, start=HOME).causal(["T", "R"], "q") if general else from_home()
    assert bool(inverse.kernels) is general
    assert inverse(T, R)[1] is gt.Status.OK
    for wrong in (np.diag([1.0, 1.0, 1.001]), np.diag([1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, -1.0])):
        assert inverse(T, R @ wrong)[1] is gt.Status.OUT_OF_RANGE
        assert "R is a rotation matrix" in inverse.diagnose(T, R @ wrong)
    assert inverse(T, R.round(7))[1] is gt.Status.OK  # as read from a file
    # half a turn away is another pose, not another solution of this one
    found, status = inverse(T, R @ rotation_about(X, np.pi))
    assert status is not gt.Status.OK or apart(found, HOME) > 0.1
    if general:
        *_, status = inverse(T, R @ rotation_about(X, np.pi), guess={"q": HOME})
        assert status is not gt.Status.OK or apart(found, HOME) > 0.1


def test_joints_stay_within_their_limits() -> None:
    limits = np.tile([-0.5, 4.5], (6, 1))  # the middle is 2 rad: angles may need a full turn
    arm = gt.robots.serial_arm(**UR, limits=limits, start=np.full(6, 1.0))
    inverse = [arm.causal(["T", "R"], "q", branches=dict(zip(("shoulder", "elbow", "wrist"), s, strict=True)))
               for s in product((1, -1), repeat=3)]  # fmt: skip
    q = np.random.default_rng(4).uniform(*limits.T, (50, 6))
    T, R = (np.array(x) for x in zip(*[pose_by_dh(**UR, q=row) for row in q], strict=True))
    answers = [f(T, R) for f in inverse]
    found = np.array([a[0] for a in answers])
    among = np.nanmin(np.max(np.abs(found - q), axis=2), axis=0)
    assert np.all(among < NEAR_SINGULAR)
    assert np.nanmin(found) >= -0.5 and np.nanmax(found) <= 4.5
    T, R = pose_by_dh(**UR, q=np.full(6, -1.0))
    outside = [f for f in inverse if f(T, R)[1] is gt.Status.OUT_OF_RANGE]
    assert outside and any("within the limits of q[" in f.diagnose(T, R) for f in outside)


def test_starts_of_an_arm_select_its_branches_and_wrong_ones_are_refused() -> None:
    other = np.array([0.3, -1.0, 1.2, -0.5, 0.8, 0.0])
    from_other = gt.robots.serial_arm(**UR, start=other).causal(["T", "R"], "q")
    for start, inverse in ((HOME, from_home()), (other, from_other)):
        T, R = pose_by_dh(**UR, q=start + 0.05)
        q, status = inverse(T, R)
        assert status is gt.Status.OK
        np.testing.assert_allclose(q, start + 0.05, atol=ROUND_OFF)
    for wrong in ([0.0] * 5, [[0.0] * 6, [0.0] * 5 + [np.nan]]):
        with pytest.raises(gt.ModelError, match="start takes 6"):
            gt.robots.serial_arm(**UR, start=wrong)
    with pytest.raises(gt.ModelError, match="start of joint"):
        gt.robots.serial_arm(**UR, start=[2.0] * 6, limits=[[-1.0, 1.0]] * 6)
    with pytest.raises(gt.ModelError, match=r"no branch 'elbo'; it has elbow, shoulder, wrist"):
        gt.robots.serial_arm(**UR).causal(["T", "R"], "q", branches={"elbo": 1})


def test_chains_of_joints_by_hand_have_closed_forms_too() -> None:
    planar = chain([Z, Z], [[0.4, 0.0, 0.0], [0.3, 0.0, 0.0]])
    for elbow in (1, -1):
        inverse = planar.causal(["T[0]", "T[1]"], "q", branches={"elbow": elbow})
        (first, second), status = inverse(0.45, 0.2)
        assert status is gt.Status.OK and not inverse.kernels
        # law of cosines
        cosine = (0.45**2 + 0.2**2 - 0.4**2 - 0.3**2) / (2 * 0.4 * 0.3)
        assert abs(second) == pytest.approx(np.arccos(cosine), abs=ROUND_OFF)
        at = 0.4 * np.exp(1j * first) + 0.3 * np.exp(1j * (first + second))
        assert at == pytest.approx(0.45 + 0.2j, abs=ROUND_OFF)
    assert inverse(0.8, 0.0)[1] is gt.Status.OUT_OF_RANGE
    assert inverse(0.7, 0.0)[1] is gt.Status.SINGULAR  # stretched
    axes, shifts = [Z, Y, Y, X, Y, X], [[0, 0, 0.4], [0.1, 0, 0.5], [0.1, 0, 0.1], [0.3, 0, 0], [0, 0, 0], [0.05, 0, 0]]
    start = [0.1, 0.3, 0.5, 0.2, 0.6, 0.1]
    arm = chain(axes, shifts, start)
    inverse = arm.causal(["T", "R"], "q")
    assert not inverse.kernels
    for q in np.array(start) + np.random.default_rng(0).uniform(-0.3, 0.3, (20, 6)):
        T, R = np.zeros(3), np.eye(3)
        for axis, d, angle in zip(axes, shifts, q, strict=True):
            R = R @ rotation_about(axis, angle)
            T = T + R @ d
        found, status = inverse(T, R)
        assert status is gt.Status.OK
        np.testing.assert_allclose(found, q, atol=ROUND_OFF)


def test_messages_count_degrees_of_freedom() -> None:
    planar = gt.robots.serial_arm(a=[0.3, 0.2], alpha=0.0)
    with pytest.raises(gt.ModelError, match=r"T has 3 degrees of .* mechanism has 2: name 2 .*'T\[0\]', 'T\[1\]'"):
        planar.causal("T", "q")
    seven = gt.robots.serial_arm(a=0.1, alpha=[1.5, -1.5, 1.5, -1.5, 1.5, -1.5, 0.0])
    with pytest.raises(gt.ModelError, match=r"T and R fix 6 degrees of .* mechanism has 7: 1 more .*'q\[0\]'"):
        seven.causal(["T", "R"], "q")
    assert seven.causal(["T", "R", "q[2]"], "q").inputs[-1].name == "q[2]"


RAIL = {name: [first, *UR[name]] for name, first in (("a", 0.0), ("d", 0.0), ("alpha", 0.6))} | {"joints": "prrrrrr"}
TURNED = dict(a=[0.3, 0.25, 0.0, 0.2, 0.1], alpha=[0.0, np.pi, 0.0, 0.4, 0.2], joints="rrprr", tool_xyz=[0.1, 0, 0.05])


@pytest.mark.parametrize(
    ("given", "joint", "branches"),
    [(TURNED, 4, ("elbow",)), pytest.param(RAIL, 0, ("shoulder", "elbow", "wrist"), marks=pytest.mark.proof)],
)
def test_a_known_joint_at_an_end_leaves_the_closed_form_of_the_others(given, joint, branches) -> None:
    arm = gt.robots.serial_arm(**given)
    draw = np.random.default_rng(7)
    sliding = np.array([kind == "p" for kind in given["joints"]])
    q = np.where(sliding, draw.uniform(0.1, 0.8, (50, len(sliding))), draw.uniform(-3.0, 3.0, (50, len(sliding))))
    forward = arm.causal("q", ["T", "R"])
    T, R, _ = forward(q)
    nearest = np.full(len(q), np.inf)
    for signs in product((-1, 1), repeat=len(branches)):
        inverse = arm.causal(["T", "R", f"q[{joint}]"], "q", branches=dict(zip(branches, signs, strict=True)))
        assert not inverse.kernels
        found, status = inverse(T, R, q[:, joint])
        good = np.asarray(status) == gt.Status.OK
        again = forward(found[good])
        np.testing.assert_allclose(again[0], T[good], atol=ROUND_OFF)
        np.testing.assert_allclose(again[1], R[good], atol=ROUND_OFF)
        off = np.where(sliding, np.abs(found - q), np.abs((found - q + np.pi) % (2 * np.pi) - np.pi)).max(axis=1)
        nearest = np.fmin(nearest, np.where(good, off, np.inf))
    assert nearest.max() < NEAR_SINGULAR


def test_kind_of_a_variable_is_checked() -> None:
    with pytest.raises(gt.ModelError, match="kind 'rotation' must have shape"):
        gt.variable(3, kind="rotation")
    with pytest.raises(gt.ModelError, match="the kind of a variable must be 'rotation'"):
        gt.variable((3, 3), kind="unit")


def test_c_code_of_a_closed_form_equals_python(tmp_path: Path) -> None:
    scara = gt.robots.serial_arm(a=[0.3, 0.25, 0.0, 0.0], alpha=[0.0, np.pi, 0.0, 0.0], joints="rrpr",
                                 start=[0.3, 0.8, 0.1, 0.2])  # fmt: skip
    functions = {"inverse": scara.causal(["T", "R"], "q")}
    gt.cgen.generate(functions, tmp_path / "scara", name="scara")
    report = gt.cgen.check(tmp_path / "scara", functions, points=200, seed=1)
    assert report.passed, str(report)
    assert report.rows_ok["inverse"] > 50  # half of the points are poses that four joints reach
