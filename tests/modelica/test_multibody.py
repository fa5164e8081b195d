"""MultiBody in text: motions against Lagrange's equations written by hand, and unsupported components."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import gtmodel as gt
from gtmodel.cli import main
from gtmodel.modelica.translate import translated

pytest.importorskip("lark")
MODELS = Path(__file__).parent / "multibody.mo"
AGREE = 1e-6  # of the largest value: an integrator at 1e-9 beside one at 1e-11
KEPT = 1e-6  # J, over a second at the same tolerance, where about 10 J go to and fro
G = 9.81


def simulated(name: str, end: float = 1.0, **options: Any) -> Any:
    return gt.modelica.load(f"{MODELS}:{name}")().simulate(end, **options).trajectory


def lagrange(
    n: int, energies: Callable[[Any, Any], tuple[Any, Any]], force: Callable[[Any, Any], Any]
) -> Callable[[float, np.ndarray], np.ndarray]:
    """q'' from the kinetic and potential energy of q and q', and generalized forces."""
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    kinetic, potential = energies(q, v)
    momentum = ca.gradient(kinetic, v)
    known = ca.gradient(kinetic - potential, q) - ca.jtimes(momentum, q, v) + force(q, v)
    rates = ca.Function("rates", [q, v], [ca.vertcat(v, ca.solve(ca.jacobian(momentum, v), known))])
    return lambda _, y: rates(y[:n], y[n:]).full()[:, 0]


def moved(rates: Callable[[float, np.ndarray], np.ndarray], start: list[float], end: float = 1.0) -> np.ndarray:
    return solve_ivp(rates, (0.0, end), start, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]


def differing(ours: Any, theirs: dict[str, float]) -> list[str]:
    """Variables whose last value is not the one that is given by name."""
    return [n for n, x in theirs.items() if not abs(ours[n][-1] - x) <= AGREE * np.max(np.abs(ours[n]))]


def speed(point: Any, q: Any, v: Any) -> Any:
    """Squared velocity of a point that q places."""
    return ca.sumsqr(ca.jtimes(point, q, v))


def test_a_double_pendulum_with_a_box_a_damper_and_a_motor() -> None:
    """The box has 7700 kg/m3, 0.5 m by 0.06 m by 0.06 m; phi counts from x upwards, gravity pulls along -y."""
    mass, width = 7700 * 0.5 * 0.06**2, 0.06

    def energies(q: Any, v: Any) -> tuple[Any, Any]:
        first, both = q[0], q[0] + q[1]
        box = 0.25 * ca.vertcat(ca.cos(first), ca.sin(first))
        end = 2 * box + ca.vertcat(0.2 * ca.cos(both) - 0.03 * ca.sin(both), 0.2 * ca.sin(both) + 0.03 * ca.cos(both))
        turning = mass / 12 * (0.5**2 + width**2) * v[0] ** 2 + 0.02 * (v[0] + v[1]) ** 2
        kinetic = (mass * speed(box, q, v) + 2 * speed(end, q, v) + turning) / 2
        return kinetic, G * (mass * box[1] + 2 * end[1])

    ours = simulated("DoublePendulum", inputs={"u": 3.0})
    rates = lagrange(2, energies, lambda q, v: ca.vertcat(3.0 - 0.1 * v[0], 0))
    theirs = moved(rates, [-0.7, -0.4, 0.3, 0.0])
    both = theirs[0] + theirs[1]
    expected = dict(zip(("r1.phi", "r2.phi", "r1.w", "r2.w"), theirs, strict=True)) | {
        "b2.frame_b.r_0[1]": 0.5 * np.cos(theirs[0]) + 0.4 * np.cos(both),
        "b2.frame_b.r_0[2]": 0.5 * np.sin(theirs[0]) + 0.4 * np.sin(both),
        "r1.tau": 3.0 - 0.1 * theirs[2], "r1.a": rates(0.0, theirs)[2],
    }  # fmt: skip
    assert differing(ours, expected) == []


def test_a_slide_on_a_ramp_agrees_with_its_closed_form() -> None:
    ours = simulated("Ramp")
    limit, lag = (20 - 3 * G / 2) / 4, 3 / 4
    v, travel = limit * (1 - np.exp(-1 / lag)), 0.1 + limit * (1 - lag * (1 - np.exp(-1 / lag)))
    assert differing(ours, {"slide.s": travel, "slide.v": v}) == []
    x, y = travel * np.cos(np.pi / 6), 1 + travel / 2
    assert differing(ours, {"body.r_0[1]": x, "body.r_0[2]": y}) == []


def test_a_spherical_pendulum_agrees_with_euler_s_equation() -> None:
    """Inertia about the pivot; quaternion, scalar first, from the body to the world."""
    c, gravity = np.array([0.1, -0.4, 0.05]), np.array([0.0, -G, 0.0])
    inertia = np.diag([0.03, 0.02, 0.04]) + 2 * (c @ c * np.eye(3) - np.outer(c, c))
    inertia[0, 1] = inertia[1, 0] = inertia[0, 1] + 0.002

    def turn(e: np.ndarray) -> np.ndarray:
        s, v = e[0], e[1:]
        cross = np.cross(np.eye(3), v).T * -1
        return (s * s - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * s * cross

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        e, w = y[:4], y[4:]
        de = 0.5 * np.concatenate([[-e[1:] @ w], e[0] * w + np.cross(e[1:], w)])
        torque = np.cross(c, 2 * turn(e).T @ gravity)
        return np.concatenate([de, np.linalg.solve(inertia, torque - np.cross(w, inertia @ w))])

    a, b, d = 0.3, -0.2, 0.5  # about x, the new y, the new z
    about = [np.array([np.cos(x / 2), *(np.sin(x / 2) * np.eye(3)[k])]) for k, x in enumerate((a, b, d))]
    e = about[0]
    for f in about[1:]:
        e = np.concatenate([[e[0] * f[0] - e[1:] @ f[1:]], e[0] * f[1:] + f[0] * e[1:] + np.cross(e[1:], f[1:])])
    theirs = moved(rates, [*e, *(turn(e).T @ [1.0, 2.0, -0.5])])
    ours = simulated("SphericalPendulum")
    assert differing(ours, {f"body.frame_b.r_0[{k + 1}]": x for k, x in enumerate(turn(theirs[:4]) @ c)}) == []
    assert np.ptp(ours["energy.stored"]) <= KEPT


@pytest.mark.proof
def test_a_four_bar_linkage_agrees_with_its_one_coordinate_model() -> None:
    def energies(q: Any, v: Any) -> tuple[Any, Any]:
        crank = ca.vertcat(ca.cos(q[0]), ca.sin(q[0]))
        left, right = 0.3 * crank, ca.DM([0.7, 0.0])
        gap = right - left  # the joint between coupler and rocker: where two circles meet, above
        d = ca.norm_2(gap)
        along = (0.8**2 - 0.6**2 + d**2) / (2 * d)
        e = gap / d
        joint = left + along * e + ca.sqrt(0.8**2 - along**2) * ca.vertcat(-e[1], e[0])
        coupler, rocker = (joint - left) / 0.8, (joint - right) / 0.6
        middle = left + 0.4 * coupler + 0.05 * ca.vertcat(-coupler[1], coupler[0])
        turning = 0.01 * v[0] ** 2 + 0.1 * speed(coupler, q, v) + 0.05 * speed(rocker, q, v)
        places = ((1.0, 0.15 * crank), (2.0, middle), (1.5, right + 0.3 * rocker))
        kinetic = (sum(m * speed(p, q, v) for m, p in places) + turning) / 2
        return kinetic, G * sum(m * p[1] for m, p in places)

    ours = simulated("FourBar", 0.5)
    theirs = moved(lagrange(1, energies, lambda q, v: 0), [1.2, 2.0], 0.5)
    assert differing(ours, {"crank.phi": theirs[0], "crank.w": theirs[1]}) == []
    assert np.ptp(ours["energy.stored"]) <= KEPT


@pytest.mark.proof
def test_a_spatial_loop_agrees_with_its_one_coordinate_model() -> None:
    """A crank about x, a rod between a ball and a fork, and a slider along x: seven coordinates, one loop."""

    def slider(q: Any) -> tuple[Any, Any, Any]:
        tip = 0.2 * ca.vertcat(0, ca.cos(q), ca.sin(q))
        y, z = -0.1 - tip[1], 0.1 - tip[2]
        return tip, ca.vertcat(ca.sqrt(0.7**2 - y**2 - z**2), -0.1, 0.1), ca.vertcat(0, y, z)

    def energies(q: Any, v: Any) -> tuple[Any, Any]:
        tip, end, _ = slider(q[0])
        along = (end - tip) / 0.7
        a, b = ca.atan2(along[1], along[0]), -ca.asin(along[2])  # the fork's angles, about z and the new y
        da, db = ca.jtimes(a, q, v), ca.jtimes(b, q, v)
        w = ca.vertcat(-da * ca.sin(b), db, da * ca.cos(b))  # in the rod
        turning = 0.005 * v[0] ** 2 + 0.001 * w[0] ** 2 + 0.03 * (w[1] ** 2 + w[2] ** 2)
        places = ((1.0, tip / 2), (0.8, (tip + end) / 2), (1.2, end))
        kinetic = (sum(m * speed(p, q, v) for m, p in places) + turning) / 2
        return kinetic, G * sum(m * p[1] for m, p in places)

    ours = simulated("SliderCrank")
    theirs = moved(lagrange(1, energies, lambda q, v: 0), [0.4, 3.0])
    end = float(slider(theirs[0])[1][0]) - 0.3
    assert differing(ours, {"crank.phi": theirs[0], "crank.w": theirs[1], "slider.s": end}) == []
    assert np.ptp(ours["energy.stored"]) <= KEPT


def test_mass_of_a_hollow_box_and_a_pipe_agree_with_the_library() -> None:
    text = gt.modelica.python_of(f"{MODELS}:Solids")
    box = 7700 * 0.5 * (0.1 * 0.08 - 0.05 * 0.04)
    pipe = 2700 * np.pi * 0.4 * (0.1**2 - 0.08**2) / 4
    assert f"m={box}"[:12] in text and f"m={pipe}"[:12] in text
    across = 2700 * np.pi * 0.4 / 4 * (0.1**2 * (0.4**2 + 0.75 * 0.1**2) - 0.08**2 * (0.4**2 + 0.75 * 0.08**2)) / 12
    axial = 2700 * np.pi * 0.4 / 4 * (0.1**4 - 0.08**4) / 8

    def inertia(name: str) -> np.ndarray:
        (given,) = [line for line in text.splitlines() if f"{name}_body_part = " in line]
        return np.array(eval(given.partition("I=")[2].partition(", attitude=")[0]))

    I = inertia("pipe")
    assert np.allclose(I, np.diag([across, axial, across]), rtol=1e-12, atol=1e-15)  # along y
    I = inertia("box")
    solid, hole = 7700 * 0.5 * 0.1 * 0.08, 7700 * 0.5 * 0.05 * 0.04  # width 0.1 along y, height 0.08 along z

    def square(width: float, height: float) -> np.ndarray:
        return np.array([width**2 + height**2, 0.25 + height**2, 0.25 + width**2]) / 12

    assert np.allclose(I, np.diag(solid * square(0.1, 0.08) - hole * square(0.05, 0.04)), rtol=1e-12, atol=1e-15)


def test_a_force_and_a_torque_in_either_frame_hold_an_arm() -> None:
    """At 30 degrees: weight at 0.2 m, a force across the arm at 0.5 m, a torque of the world about z."""
    model = gt.modelica.load(f"{MODELS}:Held")()
    f = model.causal(known=["joint.phi"], targets=["push", "tip.r[1]", "tip.r[2]"])
    push, x, y, status = f(np.pi / 6, 0.0, 0.0)
    assert status.ok
    assert push == pytest.approx((2 * G * 0.2 * np.cos(np.pi / 6) - 1.5) / 0.5, rel=1e-12)
    assert (x, y) == pytest.approx((0.5 * np.cos(np.pi / 6), 0.25), rel=1e-12)


def test_a_swing_up_is_the_same_as_text_and_as_printed_python(tmp_path: Path) -> None:
    solved = gt.solve(gt.modelica.load(f"{MODELS}:SwingUp")(), gt.Mesh(12))
    assert solved.trajectory["arm.joint.phi"][-1] == pytest.approx(np.pi / 2, abs=1e-8)
    names: dict[str, Any] = {}
    exec(gt.modelica.python_of(f"{MODELS}:SwingUp"), names)
    again = gt.solve(names["SwingUp"](), gt.Mesh(12))
    assert again.objective == pytest.approx(solved.objective, rel=1e-9)


def test_a_body_on_a_spring_and_a_damper_agrees_with_its_closed_form() -> None:
    ours = simulated("Hung")
    rest, fade = 0.5 + 2 * G / 150, 3 / 4
    turn = np.sqrt(150 / 2 - fade**2)
    swing = (0.8 - rest) * np.exp(-fade) * (np.cos(turn) + fade / turn * np.sin(turn))
    force = 150 * (rest + swing - 0.5) + 3 * ours["slide.v"][-1]
    assert differing(ours, {"slide.s": rest + swing, "strut.s": rest + swing, "strut.f": force}) == []


class Furuta(gt.Optimization):
    """The shipped problem by Lagrange's equations: angles of the arm and of the pendulum, 0 where it hangs."""

    final_time = 1.2
    u = gt.input(min=-0.4, max=0.4)
    arm = gt.variable(start=0.0, fixed=True)
    arm_w = gt.variable(start=0.0, fixed=True)
    rod = gt.variable(start=0.0, fixed=True)
    rod_w = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield gt.der(self.arm) == self.arm_w
        yield gt.der(self.rod) == self.rod_w
        v, w, s, c = self.arm_w, self.rod_w, gt.sin(self.rod), gt.cos(self.rod)
        dv, dw = gt.der(self.arm_w), gt.der(self.rod_w)
        across, coupled = 0.1 * 0.2**2 + 0.0015, 0.1 * 0.2 * 0.25
        about_vertical = 0.005 + 0.1 * 0.25**2 + across * s**2 + 1e-5 * c**2
        yield about_vertical * dv + coupled * (c * dw - s * w**2) + 2 * (across - 1e-5) * s * c * v * w == (
            self.u - 0.001 * v
        )
        yield coupled * c * dv + across * dw - (across - 1e-5) * s * c * v**2 + 0.1 * G * 0.2 * s == 0

    def objective(self):
        return gt.integral(self.u**2)

    def constraints(self):
        end = self.final_time
        for x, value in ((self.arm, 0.0), (self.arm_w, 0.0), (self.rod, np.pi), (self.rod_w, 0.0)):
            yield x.at(end) == value


def test_the_shipped_furuta_pendulum_agrees_with_lagrange_s_equations() -> None:
    text = gt.modelica.load(f"{MODELS.parents[2]}/problems/models/furuta_pendulum.mop:SwingUp")
    mesh = gt.Mesh(20)
    solved = gt.solve(text(), mesh, throw=False)
    names = {"arm": "shoulder.phi", "arm_w": "shoulder.w", "rod": "hinge.phi", "rod_w": "hinge.w", "u": "u"}
    guess = gt.Trajectory(solved.trajectory.time, {k: solved.trajectory[v] for k, v in names.items()})
    by_hand = gt.solve(Furuta(), mesh, guess=guess, throw=False)
    assert solved.objective == pytest.approx(by_hand.objective, rel=1e-6)
    again = solved.trajectory["hinge.phi"] - by_hand.trajectory["rod"]
    assert np.max(np.abs(again)) < 1e-4  # rad: a flat optimum to the square root of the tolerance


def test_inverse_dynamics_of_the_same_text(capsys: pytest.CaptureFixture[str]) -> None:
    """The pendulum of the tests at rest, level: what the motor holds, and where a frame is."""
    file = f"{MODELS}:SwingUp"
    assert main(["explain", file, "--known", "arm.joint.phi", "--targets", "u", "--full"]) == 0
    assert "multibody.mo" in capsys.readouterr().out
    held = gt.modelica.load(file)().causal(known="arm.joint.phi", targets=["u", "arm.tip.r_0[1]"])
    u, x, status = held(0.3, 0.0, 2.0)
    assert status.ok
    assert (u, x) == pytest.approx((G * 0.25 * np.cos(0.3) + 2 * (0.25**2 + 0.02), 0.5 * np.cos(0.3)), rel=1e-12)
    with pytest.raises(gt.ModelError, match=r"arm\.tip\.r_0"):
        gt.modelica.load(file)().causal(known="arm.joint.phi", targets="arm.tip.r_00")


def test_forces_of_a_frame_are_those_on_its_component() -> None:
    """Links that hang still, in an array: the second bears itself and the third, its joint feels the opposite."""
    ours = simulated("Cut", 0.1)
    assert differing(ours, {"below": 5 * G, "by_joint": -5 * G, "link[3].frame_b.r_0[2]": -0.9}) == []


def test_a_planar_loop_without_its_constraint_is_rejected() -> None:
    with pytest.raises(gt.modelica.ModelicaError, match="RevolutePlanarLoopConstraint"):
        gt.modelica.load(f"{MODELS}:Redundant")


REFUSED = [
    ("Modelica.Mechanics.MultiBody.Joints.Assemblies.JointUPS joint;", "Joints.Assemblies", 3),
    ("inner Modelica.Mechanics.MultiBody.World two;", "one World", 3),
    ("Modelica.Mechanics.MultiBody.Joints.Revolute joint(useAxisFlang = true);", "useAxisFlange", 3),
    ("Modelica.Mechanics.MultiBody.Joints.Revolute joint(n = {0, 0, 0});", "direction", 3),
    ("Modelica.Mechanics.MultiBody.Joints.Revolute joint;", "orientation", 3),
    ("Modelica.Mechanics.MultiBody.Parts.Body body(r_cm = {0, 0, 0});", "r_CM", 3),
    ("Real x = world.frame_b.q;", "frame_b", 3),
]


@pytest.mark.parametrize(("line", "said", "where"), REFUSED)
def test_unsupported_components_are_rejected_with_their_line(tmp_path: Path, line: str, said: str, where: int) -> None:
    file = tmp_path / "text.mo"
    file.write_text(f"model M\n  inner Modelica.Mechanics.MultiBody.World world(g = 9.81);\n  {line}\nend M;\n")
    with pytest.raises(gt.ModelError, match=said) as error:
        gt.modelica.load(file)().simulate(0.1)
    assert f"text.mo:{where}" in str(error.value)


def test_point_gravity_and_a_missing_world_are_rejected(tmp_path: Path) -> None:
    file = tmp_path / "text.mo"
    multibody = "Modelica.Mechanics.MultiBody"
    file.write_text(
        f"model M\n  inner {multibody}.World world(gravityType =\n    {multibody}.Types.GravityTypes.PointGravity);\n"
        "end M;\n"
    )
    with pytest.raises(gt.modelica.ModelicaError, match="PointGravity") as error:
        gt.modelica.load(file)
    assert "text.mo:2" in str(error.value)
    file.write_text(f"model M\n  {multibody}.Parts.Body body(m = 1);\nend M;\n")
    with pytest.raises(gt.modelica.ModelicaError, match="inner") as error:
        gt.modelica.load(file)
    assert "text.mo:2" in str(error.value)


def test_default_gravity_gives_a_warning() -> None:
    (note,) = translated(f"{MODELS}:Open").warnings
    assert "9.81" in note and "multibody.mo" in note
    assert differing(simulated("Open", 0.5), {"body.r_0[2]": -G * 0.5**2 / 2}) == []
