"""Conditions on known values, and what no target needs."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel import der
from gtmodel.compiler.causal import flat_of
from gtmodel.compiler.plan import make_plan


class Cart(gt.Model):
    """A cart that two forces push; nobody says how large each is. Its heading is a unit vector."""

    m = gt.parameter(2.0, unit="kg")
    x = gt.variable(unit="m")
    y = gt.variable(unit="m")
    F = gt.variable(unit="N")
    G = gt.variable(unit="N")
    h = gt.variable(2, unit="1", start=[1.0, 0.0])
    c = gt.variable(unit="1")

    def equations(self):
        yield self.y == 2 * self.x
        yield self.m * der(der(self.x)) == self.F + self.G
        yield gt.dot(self.h, self.h) == 1
        yield self.c == self.h[0] ** 2 - self.h[1] ** 2


def test_forces_that_nobody_gave_do_not_stand_in_the_way_of_kinematics():
    f = Cart().causal(known=["x", "h"], targets=["y", "der(y,2)", "c"])
    y, acceleration, c, status = f(0.3, 0.0, 1.5, [0.6, 0.8])
    assert status is gt.Status.OK
    assert (y, acceleration) == (0.6, 3.0)
    assert c == pytest.approx(-0.28, abs=1e-15)
    assert "not determined by the known variables, and not needed: F, G" in f.explain()


def test_a_target_among_them_is_refused_by_name():
    with pytest.raises(gt.ModelError, match="not determined: F, G"):
        Cart().causal(known=["x", "h"], targets="F")


def test_a_surplus_elsewhere_is_still_refused():
    with pytest.raises(gt.ModelError, match="too many equations or knowns among: Cart equation 1"):
        Cart().causal(known=["x", "y", "h"], targets="c")


def test_known_values_that_break_a_condition_get_a_status_and_leave_the_other_rows_alone():
    f = Cart().causal(known="h", targets="c")
    h = np.array([[0.6, 0.8], [0.6, 0.8 + 1e-5], [np.nan, 0.0], [1.0, 0.0]])
    c, status = f(h)
    assert status.tolist() == [gt.Status.OK, gt.Status.OUT_OF_RANGE, gt.Status.NOT_FINITE, gt.Status.OK]
    assert np.isnan(c[1:3]).all()
    assert c[[0, 3]] == pytest.approx([-0.28, 1.0])
    assert "do not satisfy Cart equation 3" in f.diagnose(h[1])
    assert "condition on the known values: Cart equation 3" in f.explain()


class Needle(gt.Model):
    """A needle of some length along h and what it says of its own motion, times two so that rates are not bare."""

    length = gt.parameter(1.0, positive=True)
    h = gt.variable(3, start=lambda self: [0.6 * self.length, 0.0, 0.8 * self.length])
    c = gt.variable()

    def equations(self):
        yield gt.dot(self.h, self.h) == self.length**2
        yield self.c == 2 * self.h[0] - self.h[1] * self.h[2] / self.length


def _on_the_sphere(rng: np.random.Generator, length: float, size: float) -> list[np.ndarray]:
    """A place, a velocity and an acceleration of a point that stays on a sphere."""
    h = rng.standard_normal(3)
    h *= length / np.linalg.norm(h)
    v = size * np.cross(rng.standard_normal(3), h)
    a = size**2 * np.cross(rng.standard_normal(3), h)
    return [h, v, a - h * (v @ v + a @ h) / length**2]


@pytest.mark.parametrize("length", [1e-4, 1.0, 3e3])
@pytest.mark.parametrize("order", [1, 2])
def test_rates_of_known_values_satisfy_their_condition_too(length: float, order: int):
    f = Needle(length=length).causal(known="h", targets=f"der(c,{order})")
    rng = np.random.default_rng(order)
    for _ in range(20):
        point = _on_the_sphere(rng, length, 10.0 ** rng.uniform(-3, 3))
        h, v, a = point
        *_, status = f(*point[: order + 1])
        assert status is gt.Status.OK
        expected = [
            2 * v[0] - (v[1] * h[2] + h[1] * v[2]) / length,
            2 * a[0] - (a[1] * h[2] + 2 * v[1] * v[2] + h[1] * a[2]) / length,
        ][order - 1]
        largest = np.abs(np.concatenate(point)).max()
        assert f(*point[: order + 1])[0] == pytest.approx(expected, rel=1e-9, abs=1e-12 * largest)
        for k in range(order + 1):  # along h a rate is no motion on the sphere; 1e-4 is coarser than six digits
            wrong = [*point[:k], point[k] + 1e-4 * (np.linalg.norm(point[k]) + length) / length * h, *point[k + 1 :]]
            value, status = f(*wrong[: order + 1])
            assert status is gt.Status.OUT_OF_RANGE and np.isnan(value)


def test_the_rate_of_a_condition_is_named():
    f = Needle().causal(known="h", targets="der(c)")
    h = np.array([0.6, 0.0, 0.8])
    assert f(h, np.zeros(3))[1] is gt.Status.OK
    assert "do not satisfy Needle equation 1' (" in f.diagnose(h, 0.5 * h)
    assert "condition on the known values: Needle equation 1' (" in f.explain()
    assert f.jacobian(h, 0.5 * h)[1] is gt.Status.OUT_OF_RANGE


class Clock(gt.Model):
    """A known pair whose radius grows with time."""

    x = gt.variable(2, start=[1.0, 0.0])
    y = gt.variable()

    def equations(self):
        yield gt.dot(self.x, self.x) == (1 + self.time) ** 2
        yield self.y == self.x[0] + self.x[1]


def test_a_condition_may_depend_on_time():
    f = Clock().causal(known="x", targets="der(y)")
    assert f([0.0, 3.0], [0.4, 1.0], 2.0) == (1.4, gt.Status.OK)
    for x, v, time in (([0.0, 3.0], [0.4, 1.1], 2.0), ([0.0, 3.0], [0.4, 1.0], 1.9)):
        assert f(x, v, time)[1] is gt.Status.OUT_OF_RANGE


class Hand(gt.Model):
    """What the hand of a clock sweeps: its direction is given, and is to be of length 1."""

    h = gt.variable(2, start=[1.0, 0.0])
    swept = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield gt.dot(self.h, self.h) == 1
        yield der(self.swept) == self.h[0] * der(self.h[1]) - self.h[1] * der(self.h[0])


@pytest.mark.parametrize(
    ("length", "named"), [(lambda t: 1.001 + 0 * t, "Hand equation 1 ("), (lambda t: 1 + t, "Hand equation 1' (")]
)
def test_a_simulation_names_the_condition_that_its_inputs_break(length, named):
    def hand(t):
        return np.array([np.cos(t), np.sin(t)]) * length(t)

    with pytest.raises(gt.ModelError) as caught:
        gt.simulate(Hand(), 1.0, inputs={"h": hand})
    assert named in str(caught.value)
    right = gt.simulate(Hand(), 1.0, inputs={"h": lambda t: np.array([np.cos(t), np.sin(t)])})
    assert right.trajectory["swept"][-1] == pytest.approx(1.0, abs=1e-8)


def test_a_function_that_does_not_read_them_asks_for_no_condition():
    f = Cart().causal(known=["x", "h"], targets="y")
    assert [s.name for s in f.inputs] == ["x"]
    assert f(0.5) == (1.0, gt.Status.OK)


class Crank(gt.Model):
    """A slider on a rod whose pivot moves on with time: sooner or later the slider lies behind it."""

    x = gt.variable(unit="m", start=1.0)
    a = gt.variable(unit="rad")
    L = gt.parameter(1.0, unit="m")
    speed = gt.parameter(1.0, unit="m/s")

    def equations(self):
        yield (self.x - self.speed * self.time) ** 2 + (self.L * gt.sin(self.a)) ** 2 == self.L**2


def test_a_plan_at_a_point_looks_at_its_own_time():
    flat = flat_of(Crank())
    x, a = (flat.groups[n][1][0] for n in ("x", "a"))
    for time, side in ((0.0, 1), (5.0, -1)):  # x = 4.0 lies behind the pivot at time 5
        w = {(x, 0): 1.0 if time == 0.0 else 4.0, (a, 0): 0.0}
        pairs = make_plan(flat, [a], [(x, 0)]).pairs
        plan = make_plan(flat, [a], [(x, 0)], at=(np.array([w[p] for p in pairs]), time))
        assert [r.value for b in plan.blocks for r in b.roots] == [side]


def test_newton_continues_a_home_pose_with_the_wanted_branches():
    robot = gt.robots.six_link_gantry_tau()
    ahead = robot.causal(known="q", targets=["T", "e"])
    behind = robot.causal(known="q", targets=["T", "e"], branches={f"link[{k}].ahead": -1 for k in range(6)})
    q = np.array([-0.5, -0.4, -0.5])
    values = {p.name: p.value for p in behind.flat.parameters}
    A, v, B = (np.array([[values[f"{n}[{i},{j}]"] for j in range(3)] for i in range(6)]) for n in "AvB")
    L = np.array([values[f"L[{i}]"] for i in range(6)])
    for f, side in ((ahead, 1), (behind, -1)):
        T, e, status = f(q)
        assert status is gt.Status.OK
        R = Rotation.from_quat(e, scalar_first=True).as_matrix()
        d = T + B @ R.T - A - q[[0, 1, 1, 2, 2, 2]][:, None] * v
        assert np.abs(np.linalg.norm(d, axis=1) - L).max() < 1e-10
        assert (side * np.einsum("ij,ij->i", d, v) > 0).all()


def test_a_branch_without_a_pose_is_refused():
    class Stuck(gt.Model):
        x = gt.variable(2, start=[1.0, 0.5])
        u = gt.variable(start=0.5)

        def equations(self):
            yield self.x[0] * gt.exp(self.x[1]) == 1 + self.u**2
            yield self.x[1] + gt.sin(self.x[0]) * self.x[1] ** 3 == self.u
            yield gt.branch("side", self.x[0])

    assert Stuck().causal(known="u", targets="x")(0.5)[1] is gt.Status.OK
    with pytest.raises(gt.ModelError, match="no pose with branch 'side' = -1"):
        Stuck().causal(known="u", targets="x", branches={"side": -1})
