"""Predictive controllers of component models: against IPOPT, the linear-quadratic regulator, C, and in closed loop."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel import Status, cgen, der
from gtmodel.linear.state_space import held
from gtmodel.predictive import AxisServo, ControlHorizon, Controller, Measurement, controller
from gtmodel.results import ArgumentError

PLAN = 1e-6  # of inputs, relative to 1 + their size: converge() stops at changes of 1e-7
COST = 1e-8
LQR = 1e-9
OFFSET = 1e-5  # [m] of 1 m, after 6 s
CLIPPED = 1e-5  # [N] beyond a limit: the programs are solved to 1e-6 of their cost


class Cart(gt.Model):
    m = gt.parameter(2.0, unit="kg")
    push = gt.parameter(0.0, unit="N")
    x = gt.variable(unit="m")
    v = gt.variable(unit="m/s")
    force = gt.input(unit="N", min=-4.0, max=4.0)

    def equations(self) -> Any:
        yield der(self.x) == self.v
        yield self.m * der(self.v) == self.force + self.push


class VanDerPol(gt.Optimization):
    x1 = gt.variable(start=0.0, fixed=True)
    x2 = gt.variable(start=1.0, fixed=True)
    u = gt.input(max=0.75)

    def equations(self) -> Any:
        yield der(self.x1) == (1 - self.x2**2) * self.x1 - self.x2 + self.u
        yield der(self.x2) == self.x1

    def objective(self) -> Any:
        return gt.integral(self.x1**2 + self.x2**2 + self.u**2)


class CartPole(gt.Model):
    M = gt.parameter(1.0, unit="kg")
    m = gt.parameter(0.2, unit="kg")
    length = gt.parameter(0.5, unit="m")
    g = gt.parameter(9.81, unit="m/s2")
    x = gt.variable(unit="m")
    angle = gt.variable(unit="rad")
    force = gt.input(unit="N", min=-20.0, max=20.0)

    def equations(self) -> Any:
        a, w = der(self.angle, 2), der(self.angle)
        swing = a * gt.cos(self.angle) - w**2 * gt.sin(self.angle)
        yield (self.M + self.m) * der(self.x, 2) - self.m * self.length * swing == self.force
        yield self.length * a == self.g * gt.sin(self.angle) + der(self.x, 2) * gt.cos(self.angle)


def cart(horizon: ControlHorizon | None = None, **changes: Any) -> Controller:
    options: dict[str, Any] = {
        "tolerances": {"x": 0.05, "v": 1.0, "force": 4.0}, "targets": {"x": 0.0, "v": 0.0}, "references": ["x"],
        "limits": {"v": (-1.0, 1.0)},
    }  # fmt: skip
    return controller(Cart(), horizon or ControlHorizon(period=0.05, stages=12), **options | changes)


def observed(**changes: Any) -> Controller:
    horizon = ControlHorizon(period=0.05, stages=10, length=0.08, delay=2, patience=3)
    return cart(horizon, measured={"x": Measurement(1e-4, jump=0.2)}, disturbance={"force": 1.0}, **changes)


def swing_up() -> Controller:
    tolerances = {"x": 0.3, "angle": 0.3, "der(x)": 2.0, "der(angle)": 4.0, "force": 10.0}
    return controller(
        CartPole(), ControlHorizon(period=0.02, stages=60, length=0.03), tolerances=tolerances,
        targets={"x": 0.0, "angle": 0.0}, limits={"x": (-1.0, 1.0)},
    )  # fmt: skip


def set_point() -> Controller:
    return controller(
        gt.robots.gantry_tau("l1_tape"), ControlHorizon(period=0.004, stages=40, length=0.01),
        tolerances={"T": 1e-2, "der(T)": 0.5, "der(T,2)": 20.0}, targets={"T": [0.9, -0.9, 0.45]}, references=["T"],
        limits={"tau": (-700.0, 700.0), "der(q)": (-1.5, 1.5)},
    )  # fmt: skip


def on_a_line() -> Controller:
    """One input for three forces: their limits are soft, since no plan need keep them."""
    model = gt.load_robot(f"{gt.shipped('models/l1_on_a_line.py')}:OnALine")
    return controller(
        model, ControlHorizon(period=0.004, stages=40, length=0.01),
        tolerances={"s": 0.02, "der(s)": 2.0, "drive": 100.0}, targets={"s": 1.0},
        limits={"robot.tau": (-700.0, 700.0)}, prices={"robot.tau": (1e4, 1e4)},
    )  # fmt: skip


def arm() -> Controller:
    torque = np.array([150.0, 150.0, 150.0, 28.0, 28.0, 28.0])
    return controller(
        gt.load_robot(gt.shipped("models/ur_like.urdf")),
        ControlHorizon(period=0.004, stages=20, length=0.02, causality="inverse"),
        tolerances={"q": 0.01, "der(q)": 1.0, "der(q,2)": 20.0}, targets={"q": [0.1, -1.2, 1.3, -0.5, 0.4, 0.2]},
        limits={"tau": np.column_stack([-torque, torque])},
    )  # fmt: skip


def by_ipopt(law: Controller, x0: np.ndarray) -> tuple[float, np.ndarray]:
    """Least cost and inputs of the same stages, from the same start; excesses of soft limits are unknowns."""
    program, s = law.program, law.program.statement
    count, n, m, p = program.qp.count, program.qp.stage.states, program.qp.stage.inputs, law.references_of({})
    x, v = ca.MX.sym("x", n, count + 1), ca.MX.sym("v", m, count)
    cost, excess = program.final_cost(x[:, count], p[:, count]), list[Any]()
    g, low, high = [x[:, 0] - x0], [np.zeros(n)], [np.zeros(n)]

    def limited(k: int, values: Any, end: bool) -> None:
        nonlocal cost
        for i, row in enumerate(s.rows):
            price = program.qp.stage.rows[i].price
            if price is None and not end:
                g.append(values[i] / row.size)
                low.append(np.array([row.low / row.size]))
                high.append(np.array([row.high / row.size]))
            elif price is not None:
                for sign, bound in ((1, row.high), (-1, row.low)):
                    e = ca.MX.sym("e")
                    excess.append(e)
                    cost += price[0] * e + price[1] * e**2 / 2
                    g.append(sign * (values[i] - bound) / row.size - e)
                    low.append(np.array([-np.inf]))
                    high.append(np.zeros(1))

    for k in range(count):
        cost += program.cost(x[:, k], v[:, k], p[:, k])
        g.append(x[:, k + 1] - program.step(x[:, k], v[:, k], p[:, k]))
        low.append(np.zeros(n))
        high.append(np.zeros(n))
        limited(k, program.rows(x[:, k], v[:, k], v[:, k], p[:, k]), False)
    limited(count, program.rows(x[:, count], v[:, count - 1], v[:, count - 1], p[:, count]), True)
    unknowns = ca.vertcat(ca.vec(x), ca.vec(v), *excess)
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-11,
               "ipopt.bound_relax_factor": 0.0}  # fmt: skip
    solver = ca.nlpsol("whole", "ipopt", {"x": unknowns, "f": cost, "g": ca.vertcat(*g)}, options)
    line = np.linspace(0, 1, count + 1)[:, None] * (program.standstill.x - x0) + x0
    guess = np.concatenate([line.ravel(), np.tile(law.first, count), np.zeros(len(excess))])
    least = np.concatenate([np.full(len(guess) - len(excess), -np.inf), np.zeros(len(excess))])
    o = solver(x0=guess, lbg=np.concatenate(low), ubg=np.concatenate(high), lbx=least)
    assert solver.stats()["success"]
    return float(o["f"]), np.asarray(o["x"].full())[n * (count + 1) : n * (count + 1) + m * count, 0].reshape(-1, m)


@pytest.mark.parametrize(
    ("made", "x0"),
    [
        (lambda: controller(VanDerPol(), ControlHorizon(period=0.1, stages=60)), [0.0, 1.0]),
        (swing_up, [0.0, 0.0, np.pi, 0.0]),
        (on_a_line, [0.0, 0.0]),
        pytest.param(
            arm,
            np.ravel(np.column_stack([[0.4, -1.0, 1.0, -0.3, 0.2, 0.0], np.zeros(6)])).tolist(),
            marks=pytest.mark.proof,
        ),
        pytest.param(set_point, [0.5, 0.0, -0.9, 0.0, 0.2, 0.0], marks=pytest.mark.proof),
    ],
    ids=["van der Pol", "cart-pendulum", "L1 on a line", "arm from URDF", "L1"],
)
def test_the_converged_plan_is_the_optimum_of_ipopt(made: Any, x0: list[float]) -> None:
    law = made()
    plan = law.converge(x0)
    cost, v = by_ipopt(law, np.array(x0))
    assert plan.status == Status.OK
    assert plan.cost == pytest.approx(cost, rel=COST)
    assert np.max(np.abs(plan.v - v) / (1 + np.abs(v))) < PLAN


def test_without_limits_the_first_input_is_that_of_the_linear_quadratic_regulator() -> None:
    law = cart(ControlHorizon(period=0.05, stages=20, causality="explicit", tolerance=1e-12), limits={})
    A, B = held(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [0.5]]), 0.05)
    Q, R = np.diag([1 / 0.05**2, 1.0]), np.array([[1 / 4.0**2]])
    P = scipy.linalg.solve_discrete_are(A, B, Q, R)
    gain = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    x = np.array([0.02, -0.03])
    force = law.begin().step({"x": x[0], "v": x[1]}).values["force"]
    assert np.abs(force + gain @ x).max() < LQR


def test_both_causalities_of_a_cart_give_the_same_force() -> None:
    forces = [
        cart(ControlHorizon(period=0.05, stages=20, causality=c)).begin().step({"x": 0.3, "v": 0.1}).values["force"][0]
        for c in ("explicit", "inverse")
    ]
    assert forces[0] == pytest.approx(forces[1], abs=1e-4)  # a force held, and an acceleration held, of one mass
    assert "operations" in cart().explain()


def moved(law: Controller, m: float, push: float, cycles: int, upset: Any = None) -> tuple[np.ndarray, list[Any]]:
    """The cart of another mass under another force in closed loop, exactly discretised."""
    A, B = held(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0 / m]]), law.period)
    run, x, results = law.begin(), np.array([1.0, 0.0]), list[Any]()
    queue = [0.0] * law.program.horizon.delay
    for k in range(cycles):
        reading = {"x": x[0]} if law.estimates else {"x": x[0], "v": x[1]}
        r = run.step(upset(k, reading) if upset else reading, {"x": 0.0})
        results.append(r)
        if r.status != Status.OK:
            break
        queue.append(float(r.values["force"][0]))
        x = A @ x + B[:, 0] * (queue.pop(0) + push)
    return x, results


def test_a_wrong_mass_and_a_constant_force_leave_no_offset_behind_a_delay() -> None:
    x, results = moved(observed(), m=2.4, push=0.7, cycles=120)
    assert abs(x[0]) < OFFSET
    assert max(abs(r.values["force"][0]) for r in results) <= 4.0  # exactly
    assert max(r.values["clipped"][0] for r in results) < CLIPPED


def test_without_an_estimate_the_same_force_leaves_an_offset() -> None:
    assert abs(moved(cart(), m=2.0, push=0.7, cycles=60)[0][0]) > 100 * OFFSET


@pytest.mark.parametrize("reading", [np.nan, 1e30, -5.0])
def test_a_lost_or_absurd_reading_never_reaches_an_output_and_is_counted(reading: float) -> None:
    upset = lambda k, r: {"x": reading} if 10 <= k < 13 else r  # noqa: E731
    x, results = moved(observed(), m=2.0, push=0.0, cycles=16, upset=upset)
    assert [int(r.values["lost"][0]) for r in results[9:14]] == [0, 1, 2, 3, 0]
    assert all(np.isfinite(r.values["force"][0]) and abs(r.values["force"][0]) <= 4.0 for r in results)
    assert 0 <= x[0] <= 1


def test_too_many_lost_readings_end_in_a_status() -> None:
    results = moved(observed(), 2.0, 0.0, 20, lambda k, r: {"x": np.nan} if k >= 5 else r)[1]
    assert len(results) == 9 and results[-1].status == Status.STALE_INPUT and not results[-1].values
    assert moved(observed(), 2.0, 0.0, 1, lambda k, r: {"x": np.nan})[1][0].status == Status.NOT_FINITE


def test_without_a_solution_the_plan_moves_on_and_then_ends_in_a_status() -> None:
    law = observed()
    run = law.begin()
    plan = run.step({"x": 1.0}).plan
    run.twin.method.max_iterations = 0
    results = [run.step({"x": 1.0}) for _ in range(4)]
    share = 0.05 / 0.08
    assert results[0].values["force"][0] == pytest.approx(2.0 * (plan[0, 0] + share * (plan[1, 0] - plan[0, 0])))
    assert [int(r.values["failed"][0]) for r in results[:3]] == [1, 2, 3]
    assert results[3].status == Status.NOT_CONVERGED


def test_a_previewed_step_of_the_reference_is_answered_before_it_comes() -> None:
    law = cart(ControlHorizon(period=0.05, stages=20, preview=True))
    goal = np.where(np.arange(21) >= 10, 0.5, 0.0)
    force = law.begin().step({"x": 0.0, "v": 0.0}, {"x": goal}).values["force"][0]
    assert force > 0.01
    assert abs(law.begin().step({"x": 0.0, "v": 0.0}, {"x": np.zeros(21)}).values["force"][0]) < 1e-6


def test_a_soft_limit_of_a_state_holds_and_a_cheap_one_is_named() -> None:
    dear, cheap = (cart(prices={"v": price}).converge([2.0, 0.0]) for price in ((1e5, 1.0), (1.0, 1.0)))
    assert np.min(dear.x[:, 1]) > -1.0 - 1e-6 and dear.notes == []
    assert np.min(cheap.x[:, 1]) < -1.1 and "'v'" in cheap.notes[0]


def test_a_goal_beyond_its_own_limit_is_said() -> None:
    law = cart(limits={"x": (-1.0, 1.0)})
    assert law.converge([0.5, 0.0], {"x": 0.9}).notes == []
    assert "'x' is outside its limits" in law.converge([0.5, 0.0], {"x": 1.2}).notes[-1]


def test_a_limit_that_is_a_reference_may_drop() -> None:
    class Weak(gt.Optimization):
        limit = gt.parameter(2.0)
        x = gt.variable(start=1.0, fixed=True)
        u = gt.input()

        def equations(self) -> Any:
            yield der(self.x) == self.u

        def objective(self) -> Any:
            return gt.integral(100 * self.x**2 + self.u**2)

        def constraints(self) -> Any:
            yield gt.between(-self.limit, self.u, self.limit)

    run = controller(Weak(), ControlHorizon(period=0.05, stages=20), references=["limit"]).begin()
    inputs = [run.step({"x": 1.0}, {"limit": limit}).values["u"][0] for limit in (2.0, 1.0)]
    assert inputs == pytest.approx([-2.0, -1.0], abs=1e-4)


def test_the_filter_has_the_same_dynamics_wherever_the_slope_of_a_reading_is() -> None:
    """A height of a link is read; one radian further its slope has halved."""

    class Link(gt.Model):
        angle = gt.variable(unit="rad")
        height = gt.variable()
        torque = gt.input(unit="1/s2")

        def equations(self) -> Any:
            yield der(self.angle, 2) == self.torque
            yield self.height == gt.sin(self.angle)

    law = controller(
        Link(), ControlHorizon(period=0.01, stages=5), tolerances={"angle": 0.1, "torque": 1.0}, targets={"angle": 0.0},
        measured={"height": Measurement(deviation=1e-3)}, disturbance={"torque": 1.0},
    )  # fmt: skip
    locate, correct = law.program.locate, law.program.correct
    x, y, d = ca.SX.sym("x", 2), ca.SX.sym("y"), ca.SX.sym("d")
    moved = ca.vertcat(*correct(x, d, *locate(x, y)[1:])[:2])
    slope = ca.Function("slope", [x, d, y], [ca.jacobian(moved, ca.vertcat(x, d))])
    at_rest, further = (slope([angle, 0.3], 0.0, np.sin(angle)).full() for angle in (0.0, 1.0))
    assert np.abs(at_rest - np.eye(3)).max() > 0.1
    assert further == pytest.approx(at_rest, abs=1e-6)  # the step of Gauss and Newton is regularised by 1e-9


def test_an_optimization_may_limit_a_state_by_a_parameter() -> None:
    class Walled(gt.Optimization):
        wall = gt.parameter(2.0, unit="m")
        x = gt.variable(unit="m")
        v = gt.input(unit="m/s", min=-1.0, max=1.0)
        place = gt.parameter(0.1, unit="m")
        speed = gt.parameter(1.0, unit="m/s")

        def equations(self) -> Any:
            yield der(self.x) == self.v

        def objective(self) -> Any:
            return gt.integral(((self.x - self.place) / self.place) ** 2 + (self.v / self.speed) ** 2)

        def constraints(self) -> Any:
            yield self.x <= self.wall

    law = controller(Walled(), ControlHorizon(period=0.05, stages=20), references=["wall"])
    ends = [law.converge([-0.5], {"wall": wall}).x[-1, 0] for wall in (2.0, 0.05, -0.2)]
    assert ends == pytest.approx([0.1, 0.05, -0.2], abs=5e-3)


def test_the_controller_as_a_sampled_block_round_a_plant() -> None:
    loop = observed().around(Cart(m=2.4, push=0.7))
    run = gt.simulate(loop, 2.5, start={"plant.x": 0.5, "plant.v": 0.0}, inputs={"law.x_goal": 0.0})
    assert abs(run.trajectory["plant.x"][-1]) < 1e-2
    assert np.max(np.abs(run.trajectory["law.force"])) <= 4.0


def test_a_controller_that_reads_all_states_closes_a_loop_with_their_units() -> None:
    law = cart()
    run = gt.simulate(law.around(Cart()), 3.0, start={"plant.x": 0.5, "plant.v": 0.0}, inputs={"law.x_goal": 0.0})
    assert abs(run.trajectory["plant.x"][-1]) < 1e-2
    assert law.radius() < 1


def test_a_simulated_controller_that_gives_up_ends_the_run() -> None:
    loop = cart(ControlHorizon(period=0.05, stages=12, max_iterations=1)).around(Cart())
    start = {"plant.x": 0.5, "plant.v": 0.0}
    run = gt.simulate(loop, 2.0, start=start, inputs={"law.x_goal": 0.0}, throw=False)
    assert not run.status.ok and "no solution" in run.message


@pytest.mark.proof
def test_the_l1_with_another_payload_reaches_its_goal_behind_two_cycles() -> None:
    robot, goal = gt.robots.gantry_tau("l1_tape"), [0.5, -0.9, 0.3]
    law = controller(
        robot, ControlHorizon(period=0.004, stages=40, length=0.01, delay=2),
        tolerances={"T": 1e-3, "der(T)": 0.5, "der(T,2)": 20.0}, targets={"T": goal}, references=["T"],
        limits={"tau": (-700.0, 700.0), "der(q)": (-1.5, 1.5)}, measured={"q": Measurement(1e-5, jump=0.02)},
        disturbance={"tau": 100.0},
    )  # fmt: skip
    start = {"plant.T": [0.2, -0.9, 0.2], "der(plant.T)": np.zeros(3)}
    run = gt.simulate(law.around(robot.with_(m_p=1.2 * 9.13)), 0.6, start=start, inputs={"law.T_goal": goal})
    assert np.abs(run.trajectory["plant.T"][-1] - goal).max() < 1e-4
    assert np.abs(run.trajectory["law.tau"]).max() <= 700.0


@pytest.mark.parametrize(
    ("real", "points"),
    [("double", 200), pytest.param("float", 12, marks=pytest.mark.proof)],
)
def test_c_equals_python_bit_for_bit(real: str, points: int, tmp_path: Path) -> None:
    bare = cart(ControlHorizon(period=0.05, stages=1), references=[], limits={})  # no filter, delay, goal or soft limit
    laws = {"observed": observed(outputs=["v"]), "bare": bare}
    cgen.generate(laws, tmp_path / "c", name="mpc", real=real)
    report = cgen.check(tmp_path / "c", laws, points=points)
    assert report.message.startswith("the C code equals Python bit for bit"), report.message
    assert all(report.rows_ok[name] > points / 2 for name in laws)
    assert '"max_iterations": 25' in (tmp_path / "c" / "manifest.json").read_text()


@pytest.mark.proof
def test_c_of_the_l1_and_of_a_preview_equals_python(tmp_path: Path) -> None:
    laws = {"l1": set_point(), "preview": cart(ControlHorizon(period=0.05, stages=6, preview=True))}
    cgen.generate(laws, tmp_path / "c", name="mpc")
    report = cgen.check(tmp_path / "c", laws, points=200)
    assert report.message.startswith("the C code equals Python bit for bit"), report.message


@pytest.mark.parametrize(
    ("argument", "wrong"),
    [
        ("length", lambda: ControlHorizon(period=0.05, stages=20, length=0.01)),
        ("tolerances", lambda: cart(tolerances={}, targets={})),
        ("tolerances", lambda: cart(tolerances=["x"])),
        ("limits", lambda: cart(limits=["v"])),
        ("measured", lambda: cart(measured=["x"])),
        ("tolerances", lambda: cart(tolerances={"y": 1.0}, targets={})),
        ("tolerances.x", lambda: cart(tolerances={"x": 0.0}, targets={"x": 0.0})),
        ("tolerances", lambda: controller(VanDerPol(), ControlHorizon(period=0.1, stages=5), tolerances={"x1": 1.0})),
        ("targets", lambda: cart(targets={})),
        ("targets", lambda: cart(targets={"x": 0.0, "v": 0.0, "m": 1.0})),
        ("targets.x", lambda: cart(targets={"x": [1.0, 2.0]})),
        ("references", lambda: cart(references=["m"])),
        ("limits.v", lambda: cart(limits={"v": (1.0, -1.0)})),
        ("limits.v", lambda: cart(limits={"v": 1.0})),
        ("limits.v", lambda: cart(limits={"v": (False, True)})),
        ("limits.v", lambda: cart(limits={"v": (-1.0, True)})),
        ("targets", lambda: cart(limits={"x": (-1.0, 1.0)}, targets={"x": 2.0, "v": 0.0})),
        ("measured", lambda: cart(disturbance={"force": 1.0})),
        ("measured", lambda: cart(measured={"v": Measurement(1e-3)}, disturbance={"force": 1.0})),
        ("measured.x", lambda: cart(measured={"x": 1e-3}, disturbance={"force": 1.0})),
        ("disturbance", lambda: cart(measured={"x": Measurement(1e-3)})),
        ("disturbance", lambda: cart(measured={"x": Measurement(1e-3)}, disturbance={"x": 1.0})),
        ("outputs", lambda: cart(outputs=["y"])),
        ("outputs", lambda: cart(outputs=["x", "x"])),
        ("outputs", lambda: cart(outputs=["force"])),  # returned anyway
        ("references", lambda: cart(references=["x", "x"])),
        ("horizon.stages", lambda: cart(ControlHorizon(period=0.05, stages=1, terminal=False))),
        (
            "targets",
            lambda: controller(
                Cart(push=5.0),
                ControlHorizon(period=0.05, stages=5),
                tolerances={"x": 1.0, "force": 1.0},
                targets={"x": 0.0},
            ),
        ),
        ("tolerances", lambda: cart(tolerances={"x": 1e-300, "force": 1.0}, targets={"x": 0.0})),
        ("measured", lambda: cart(measured={"x": Measurement(1e-300)}, disturbance={"force": 1.0})),
        ("goals", lambda: cart().converge([1.0, 0.0], {"x": np.nan})),
        ("servo", lambda: cart().radius(AxisServo(1.0, 1.0))),
        ("servo", lambda: cart(servo=AxisServo(1.0, 1.0))),  # nothing is measured
        ("servo", lambda: observed(servo=1.0)),
        ("servo.stiffness", lambda: observed(servo=AxisServo((1.0, 1.0), 1.0))),
        ("servo", lambda: observed(servo=AxisServo(1.0, 1.0)).block()),
        ("stiffness", lambda: AxisServo(0.0, 1.0)),
        ("measured", lambda: cart().begin().step({"x": 1.0})),
        ("goals", lambda: cart().begin().step({"x": 1.0, "v": 0.0}, {"v": 1.0})),
        ("x", lambda: cart().begin([np.nan, 0.0])),
        ("x", lambda: cart().begin([0.0, 0.0, 0.0])),
        ("x", lambda: cart().converge([1.0])),
        ("x", lambda: cart().converge({"x": 1.0})),
        ("d", lambda: cart().converge([1.0, 0.0], d=1.0)),
        ("x.goal", lambda: cart().begin().step({"x": 1.0, "v": 0.0}, {"x": "a"})),
        ("measured.x", lambda: cart().begin().step({"x": [1.0, 2.0], "v": 0.0})),
        ("horizon", lambda: controller(Cart(), 0.05, tolerances={"x": 1.0})),  # type: ignore[arg-type]
        ("limits.v", lambda: cart(limits={"v": (-np.inf, np.inf)})),
        ("limits.force", lambda: cart(limits={"force": (5.0, 6.0)})),  # the model allows -4 to 4
        ("prices", lambda: cart(prices={"w": (1.0, 1.0)})),
        ("prices.v", lambda: cart(prices={"v": (-1.0, 1.0)})),
        ("disturbance", lambda: cart(measured={"x": Measurement(1e-4)}, disturbance={"force": 1.0, "g": 1.0})),
        ("plant", lambda: cart().around(Cart)),  # type: ignore[arg-type]
    ],
)
def test_wrong_arguments_are_named(argument: str, wrong: Any) -> None:
    with pytest.raises(ArgumentError) as caught:
        wrong()
    assert caught.value.argument == argument


def test_a_limit_with_a_price_is_not_promised_exactly() -> None:
    notes = "\n".join(cart(prices={"force": (10.0, 10.0)}).notes())
    assert "linearised stages: nothing\n" in notes and "price allows it: v, force\n" in notes


def test_without_a_jump_no_constant_is_beyond_single_precision() -> None:
    f = cart(measured={"x": Measurement(1e-4)}, disturbance={"force": 1.0}).program.correct
    places = [k for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CONST]
    assert max(abs(f.instruction_constant(k)) for k in places) < np.finfo(np.float32).max


def test_what_is_no_controller_is_refused_with_its_line() -> None:
    class Fast(VanDerPol):
        def objective(self) -> Any:
            return gt.integral(self.x1 + self.u**2)

    class Ends(VanDerPol):
        def constraints(self) -> Any:
            yield self.x1.at(self.final_time) == 0.0

    class Late(VanDerPol):
        second = gt.parameter(1.0, unit="s")

        def equations(self) -> Any:
            yield der(self.x1) == self.u * gt.sin(self.time / self.second)
            yield der(self.x2) == self.x1

    class Static(gt.Model):
        y = gt.variable()
        u = gt.input()

        def equations(self) -> Any:
            yield self.y == self.u**2

    with pytest.raises(gt.ModelError, match="no state"):
        controller(Static(), ControlHorizon(period=0.1, stages=5), tolerances={"y": 1.0}, targets={"y": 1.0})
    for model, words in ((Fast(), "sum of squares"), (Ends(), "one instant"), (Late(), "time")):
        with pytest.raises(gt.ModelError, match=words):
            controller(model, ControlHorizon(period=0.1, stages=5))


def test_a_goal_out_of_reach_ends_in_a_counted_stop() -> None:
    """The plan leaves the domain of the model's root: no program has a solution."""

    class Bead(gt.Model):  # on a quarter circle of 1 m, driven along x
        x = gt.variable(unit="m", start=0.0)
        height = gt.variable(unit="m")
        one = gt.parameter(1.0, unit="m")
        speed = gt.input(unit="m/s", min=-2.0, max=2.0)

        def equations(self) -> Any:
            yield der(self.x) == self.speed
            yield self.height == gt.sqrt(self.one**2 - self.x**2)

    law = controller(
        Bead(), ControlHorizon(period=0.05, stages=10, patience=4, terminal=False),
        tolerances={"height": 0.1, "speed": 1.0}, targets={"height": 0.9}, references=["height"],
    )  # fmt: skip
    run, x, counted = law.begin(), 0.5, list[int]()
    for _ in range(60):
        r = run.step({"x": x}, {"height": -5.0})
        if r.status != Status.OK:
            break
        counted.append(int(r.values["failed"][0]))
        assert abs(r.values["speed"][0]) <= 2.0
        x = min(x + 0.05 * float(r.values["speed"][0]), 0.999)
    assert len(counted) < 60 and counted[-4:] == [1, 2, 3, 4]
