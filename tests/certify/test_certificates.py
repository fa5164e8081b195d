"""Certificates of closed forms: no statement is violated at random points, and planted errors are found."""

from __future__ import annotations

from decimal import Decimal
from functools import cache, partial

import casadi as ca
import numpy as np
import pytest
from mpmath import mpf

import gtmodel as gt
from gtmodel.certify import subdivision, tape
from gtmodel.certify.certificate_study import study
from gtmodel.certify.tape import IntervalTape, MeanValue
from gtmodel.cgen.newton_steps import run
from gtmodel.compiler.rewriting import Instruction
from gtmodel.results import ArgumentError
from tests.certify.exact import Exact

BOX = {"T": [[0.0, 0.8], [-1.1, -0.7], [0.05, 0.55]]}  # m, of the notes: 0.8 x 0.4 x 0.5
CARTS = {"q": [[-1.44, -0.64], [-1.54, -0.74], [-1.49, -0.69]]}
PROOF = pytest.param(1_000_000, marks=pytest.mark.proof)


@cache
def l1(known: str, targets: str, name: str = "l1_tape") -> gt.CausalFunction:
    return gt.robots.gantry_tau(name).causal(known=known, targets=targets)


class Arm(gt.Model):
    """A planar arm of two joints; stretched and folded poses are singular."""

    q = gt.variable(2, unit="1", start=[0.3, 1.0])
    x = gt.variable(unit="1")
    y = gt.variable(unit="1")

    def equations(self):
        yield self.x == gt.cos(self.q[0]) + 0.8 * gt.cos(self.q[0] + self.q[1])
        yield self.y == gt.sin(self.q[0]) + 0.8 * gt.sin(self.q[0] + self.q[1])


def test_the_inverse_kinematics_needs_one_box():
    s = study(l1("T", "q"), BOX)
    assert s.status.ok and s.proved == 1.0 and s.boxes == 1
    assert set(s.claims.values()) == {"proved"}
    assert s.values["undecided"] == 0.0 and s.files["boxes.csv"].count("\n") == 2


@pytest.mark.parametrize("points", [2000, PROOF])
@pytest.mark.parametrize("name", ["l1_tape", "l1_tracker"])
@pytest.mark.parametrize("box", [BOX, CARTS], ids=["inverse", "forward"])
def test_no_statement_is_violated_at_random_points(box, name, points):
    """Fifty digits at random points, corners and faces: exact values in the ranges, round-off within the bounds."""
    (known,) = box
    f = l1(known, "q" if known == "T" else "T", name)
    s = study(f, box)
    assert s.proved == 1.0
    rng = np.random.default_rng(3)
    lo, hi = np.array(box[known]).T
    share = rng.random((points, 3))
    share[: points // 10] = np.round(share[: points // 10])  # corners
    share[points // 10 : points // 5, 0] = np.round(share[points // 10 : points // 5, 0])  # faces
    x = lo + share * (hi - lo)
    double, status = f(x)
    assert not status.any()
    single_x = x.astype(np.float32)
    single, at = run(f.closed, [single_x.T])[0].astype(float).T.tolist(), Exact(f.closed, Decimal)
    bounds = [[Decimal(y) for y in (*s.ranges[n], s.errors[n], s.float_errors[n])] for n in s.errors]
    lists = x.tolist(), single_x.astype(float).tolist(), double.tolist(), single
    for here, there, values, rounded in zip(*lists, strict=True):
        exact, near = at(here), at(there)
        for i, (low, high, error, float_error) in enumerate(bounds):
            assert low <= exact[i] <= high
            assert abs(exact[i] - Decimal(values[i])) <= error
            assert abs(near[i] - Decimal(rounded[i])) <= float_error


def test_error_bounds_are_near_what_is_observed():
    """At most 100 times the largest round-off of 300 points."""
    for box in (BOX, CARTS):
        (known,) = box
        f = l1(known, "q" if known == "T" else "T")
        s = study(f, box)
        lo, hi = np.array(box[known]).T
        x = np.random.default_rng(5).uniform(lo, hi, (300, 3))
        values = f(x)[0]
        at = Exact(f.closed)
        exact = [at(row)[:3] for row in x]
        for i, bound in enumerate(s.errors.values()):
            observed = max(abs(e[i] - mpf(v)) for e, v in zip(exact, values[:, i], strict=True))
            assert observed <= bound <= 100 * observed


@pytest.mark.parametrize("name", ["l1_tape", "d1_nominal"])
def test_inverse_dynamics_and_regularity_over_the_box_of_the_controller(name):
    T = {"l1_tape": [[-0.05, 0.95], [-1.15, -0.65], [0.05, 0.55]],
         "d1_nominal": [[-1.76, -1.16], [-4.79, -4.19], [-0.28, 0.32]]}[name]  # fmt: skip
    box = {"T": T, "der(T)": [[-1.5, 1.5]], "der(T,2)": [[-10.0, 10.0]]}
    f = l1("T", "tau", name)
    s = study(f, box, bounds={"tau": [[-6000.0, 6000.0]]})
    assert s.proved == 1.0
    lo, hi = (np.repeat(x, 1) for x in np.array([*T, *[[-1.5, 1.5]] * 3, *[[-10.0, 10.0]] * 3]).T)
    x = np.random.default_rng(1).uniform(lo, hi, (500, 9))
    tau, status = f(x[:, :3], x[:, 3:6], x[:, 6:])
    low, high = np.array(list(s.ranges.values())).T
    assert not status.any() and np.all((tau >= low) & (tau <= high))
    regular = study(l1("T", "q", name), {"T": T}, regular=True)
    J, _ = l1("T", "q", name).jacobian(x[:, :3])
    least = np.linalg.svd(J, compute_uv=False)[:, -1].min()
    assert 0 < regular.least_singular_value <= least


def test_a_box_that_touches_the_end_of_the_reach_is_never_proved():
    f = l1("T", "q")
    a, b = np.array([0.4, -0.9, 0.3]), np.array([0.4, -0.9, 4.0])
    while np.abs(b - a).max() > np.spacing(4.0):  # last point that is reached
        middle = 0.5 * (a + b)
        a, b = (middle, b) if f(middle)[1] == 0 else (a, middle)
        if np.array_equal(middle, a) and np.nextafter(a[2], 9.0) == b[2]:
            break
    beyond = study(f, {"T": [[0.4, 0.5], [-0.9, -0.9], [0.3, float(b[2])]]}, max_boxes=2000)
    assert not beyond.status.ok and 0 < beyond.proved < 1.0
    assert beyond.claims["status OK"] == "refuted" and "arm[" in beyond.message
    point = beyond.counter_examples[0]["point"]
    assert f([point["T[0]"], point["T[1]"], point["T[2]"]])[1] != 0
    inside = study(f, {"T": [[0.4, 0.5], [-0.9, -0.9], [0.3, float(a[2])]]}, max_boxes=2000)
    assert inside.proved < 1.0 and inside.undecided > 0  # the end itself is within round-off


def test_a_box_that_touches_the_end_of_a_stroke_is_never_proved():
    f = l1("T", "q")
    reached = float(f([0.0, -1.1, 0.05])[0][1])
    s = study(f, BOX, bounds={"q": [[-2.0, 0.0], [-2.0, reached], [-2.0, 0.0]]}, max_boxes=3000)
    assert s.proved < 1.0 and any(name.startswith("q[1]") and word != "proved" for name, word in s.claims.items())
    assert s.claims["status OK"] == "proved"


def test_a_singular_pose_is_named_and_never_proved():
    fk = Arm().causal(known="q", targets=["x", "y"])
    good = study(fk, {"q": [[-3.0, 3.0], [0.1, 3.0]]}, regular=True)
    assert good.proved == 1.0 and 0 < good.least_singular_value <= 0.1
    touching = study(fk, {"q": [[-3.0, 3.0], [0.0, 1.0]]}, regular=True, max_boxes=2000)
    assert touching.proved < 1.0 and touching.undecided > 0 and "Jacobian" in touching.message
    across = study(fk, {"q": [[-3.0, 3.0], [-0.9, 1.0]]}, regular=True, max_boxes=2000)
    assert any("opposite signs" in word for word in across.claims.values())

    class Kink(gt.Model):
        a = gt.variable(start=0.5)
        y = gt.variable()

        def equations(self):
            yield self.y == gt.absolute(self.a)

    kink = study(Kink().causal(known="a", targets="y"), {"a": [[-0.4, 1.0]]}, regular=True, max_boxes=200)
    assert kink.undecided > 0 and not any("opposite" in word for word in kink.claims.values())  # no zero between them


def of_one(y) -> gt.CausalFunction:
    """The function y of one number a."""

    class One(gt.Model):
        a = gt.variable(start=0.5)
        y = gt.variable()

        def equations(self):
            yield self.y == y(self.a)

    return One().causal(known="a", targets="y")


@pytest.mark.parametrize("y", [
    lambda a: a + 0.5 * gt.absolute(a), lambda a: gt.maximum(a, 2 * a),
    lambda a: a + gt.sign(a),
], ids=["kink", "maximum", "jump"])  # fmt: skip
def test_there_is_no_jacobian_at_a_kink_or_a_jump(y):
    """Also on the face of a box, and in a box of one point."""
    f = of_one(y)
    for low, high in ((0.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (-1.0, 1.0)):
        s = study(f, {"a": [[low, high]]}, regular=True, max_boxes=400)
        assert not s.status.ok and 0 < s.undecided < (1e-8 if high > low else 1.1)
        assert s.claims["status OK"] == "proved"
    beside = study(f, {"a": [[0.1, 1.0]]}, regular=True)
    assert beside.proved == 1.0 and 0 < beside.least_singular_value <= f.jacobian(0.5)[0].item()


def test_the_sign_of_a_zero_decides_the_side_of_the_cut():
    f = of_one(lambda a: gt.atan2(-a, -1.0))
    s = study(f, {"a": [[0.0, 1.0]]})
    observed = abs(np.arctan2(0.0, -1.0) - f(0.0)[0])  # -0.0 is computed
    assert s.proved == 1.0 and observed > 6.0 and observed <= s.errors["y"]


def test_a_counter_example_in_float_lies_in_the_box_and_has_all_its_digits():
    """0.1 is no number of float: the one next to it lies outside and violates the bound, all inside keep it."""
    square = of_one(lambda a: a * a)
    s = study(square, {"a": [[0.05, 0.1]]}, bounds={"y": [[0.0, 0.0100000002]]}, real="float", max_boxes=100)
    assert not s.counter_examples
    s = study(of_one(gt.asin), {"a": [[-1.0, float(np.nextafter(1.0, 2.0))]]}, max_boxes=100)
    assert "(a = 1.0000000000000002)" in s.claims["finite results"]


def test_a_part_too_small_for_the_sum_of_the_volumes_is_still_undecided():
    class Near(gt.Model):
        a = gt.variable(3, start=[1.0, 1.0, 1.0])
        y = gt.variable()

        def equations(self):
            yield self.y == 1 / (self.a[0] ** 2 + self.a[1] ** 2 + self.a[2] ** 2)

    s = study(Near().causal(known="a", targets="y"), {"a": [[-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.001]]})
    assert not s.status.ok and s.proved < 1.0 and 0 < s.undecided < 1e-20


def test_wide_angles_and_jumps_stay_sound():
    q = ca.SX.sym("q", 2)
    f = ca.Function("f", [q], [ca.vertcat(ca.atan2(q[0], q[1]), ca.if_else(q[0] < 0.1, q[1], q[0]), ca.sin(9 * q[0]),
                                          ca.fabs(q[0]) + ca.fmin(q[0], q[1]), ca.floor(q[1]))])  # fmt: skip
    assert _outside(f, np.array([-1.0, -1.0]), np.array([1.0, 1.0])) == 0


def _outside(f: ca.Function, lo: np.ndarray, hi: np.ndarray) -> int:
    """How many values at random points of random boxes lie outside of the enclosures, natural and of mean value."""
    rng = np.random.default_rng(8)
    middle, size = rng.uniform(lo, hi, (200, len(lo))).T, 10.0 ** rng.uniform(-4, -0.3, (len(lo), 200))
    ends = middle - size * (middle - lo[:, None]), middle + size * (hi[:, None] - middle)
    t = IntervalTape(f)
    natural = t.over(*ends)
    values, _ = MeanValue(t, range(t.outputs)).over(*ends)
    x = ends[0] + rng.random(ends[0].shape) * (ends[1] - ends[0])
    at = Exact(f)
    exact = np.array([[float(v) for v in at(p)] for p in x.T]).T
    slack = 1e-15 * (1 + np.abs(exact))  # of the conversion to double
    outside = (exact < natural.lo - slack) | (exact > natural.hi + slack)
    centred = ((exact < values.lo - slack) | (exact > values.hi + slack)) & natural.continuous
    return int(outside.sum() + centred.sum())


def _derivatives_outside(f: ca.Function, lo: np.ndarray, hi: np.ndarray) -> int:
    """How many differences of fifty digits, 1e-20 apart, lie outside of the enclosed slopes."""
    at, form = Exact(f), MeanValue(IntervalTape(f), range(f.numel_out(0)))
    middle = 0.5 * (lo + hi)
    slopes = form.slopes((middle - 1e-3)[:, None], (middle + 1e-3)[:, None])
    outside = 0
    for k in range(len(lo)):
        step = [mpf(float(x)) + (mpf("1e-20") if i == k else 0) for i, x in enumerate(middle)]
        for i in range(form.count):
            d = (at(step)[i] - at(middle)[i]) / mpf("1e-20")
            outside += not slopes.lo[i, k, 0] <= d <= slopes.hi[i, k, 0]
    return outside


def test_planted_errors_are_found(monkeypatch):
    f = l1("q", "T").closed
    lo, hi = np.array(CARTS["q"]).T
    assert _outside(f, lo, hi) == 0

    assert _derivatives_outside(f, lo, hi) == 0
    real = tape.with_jacobian

    def wrong_sign(*a):
        chosen, slope = real(*a)
        entry = chosen.outputs  # of the first output by the second input
        slope.steps.append(Instruction(ca.OP_NEG, [slope.sources[entry]]))
        slope.sources[entry] = len(slope.steps) - 1
        return chosen, slope

    # the mean-value form alone takes either sign: its way is symmetric
    monkeypatch.setattr(tape, "with_jacobian", wrong_sign)
    assert _derivatives_outside(f, lo, hi) > 0
    monkeypatch.setattr(tape, "with_jacobian", real)
    # a missing operation, one after the other: each must be seen
    steps = IntervalTape(f).steps
    original = IntervalTape.__init__
    missed = []
    for k in (k for k, s in enumerate(steps) if s.op in (ca.OP_SUB, ca.OP_DIV, ca.OP_SQRT, ca.OP_TWICE)):

        def lacking(self, g, constants=(), k=k):  # fmt: skip
            original(self, g, constants)
            if g is f:
                self.steps[k] = self.steps[k]._replace(op=ca.OP_ASSIGN, reads=self.steps[k].reads[:1])

        monkeypatch.setattr(IntervalTape, "__init__", lacking)
        if not _outside(f, lo, hi):
            missed.append(k)
    assert not missed


def test_time_limit_and_wrong_arguments(monkeypatch):
    f = l1("q", "T")
    s = study(f, CARTS, stop=lambda: True)
    assert s.status.value == "interrupted" and s.undecided > 0 and s.proved < 1.0
    calls = iter([False] * 8 + [True] * 99)
    monkeypatch.setattr(subdivision, "BLOCK", 2)
    part = study(f, CARTS, stop=lambda: next(calls))
    assert part.status.value == "interrupted" and 0 < part.undecided < 1.0 and part.proved + part.undecided == 1.0
    for arguments, named in (
        (dict(box={"T": [[0, 1]]}), "box"),
        (dict(box={}), "box"),
        (dict(box={"q": [[-1e308, 1e308]]}), "box"),  # the width is infinite
        (dict(box=CARTS, bounds={"q": [[0, 1]]}), "bounds"),
        (dict(box=CARTS, bounds={"T": [[1, 0]]}), "bounds"),
    ):
        with pytest.raises(ArgumentError) as error:
            study(f, **arguments)
        assert error.value.argument == named


@pytest.mark.parametrize("wide", [False, True])
def test_a_serial_arm_has_no_singular_pose_in_a_box_of_its_joints(wide):
    """Pose (12 numbers) by six joints, or position alone; the bound is below the singular values of random joints."""
    fk = gt.robots.kr500().causal(known="q", targets=["T"] if wide else ["T", "R"])
    middle = np.radians([10.0, -80.0, 90.0, 20.0, 50.0, 0.0])
    lo, hi = middle - 0.02, middle + 0.02
    s = study(fk, {"q": np.stack([lo, hi], axis=1).tolist()}, regular=True, max_boxes=5000)
    assert s.proved == 1.0
    q = np.random.default_rng(0).uniform(lo, hi, (200, 6))
    least = np.linalg.svd(fk.jacobian(q)[0], compute_uv=False)[:, -1].min()
    assert 0.3 * least < s.least_singular_value <= least
    stretched = np.radians([10.0, -80.0, 90.0, 20.0, 0.0, 0.0])  # axes 4 and 6 in line
    if not wide:
        box = {"q": np.stack([stretched - 0.02, stretched + 0.02], axis=1).tolist()}
        assert study(fk, box, regular=True, max_boxes=300).proved < 1.0


def test_the_largest_box_around_a_point():
    """The reach ends inside the given box: the largest proved box ends at most 1 % before it."""
    f = l1("T", "q")
    centre = np.array([0.4, -0.9, 0.3])
    box = {"T": [[-0.6, 1.4], [-1.9, 0.1], [-0.7, 3.3]]}
    s = study(f, box, around={"T": centre.tolist()}, max_boxes=20_000)
    assert s.status.ok and s.proved == 1.0 and 0.1 < s.scale < 1.0
    lo, hi = np.array(box["T"]).T
    corners = np.array([[(lo, hi)[k >> i & 1][i] for i in range(3)] for k in range(8)])
    assert not f(centre + s.scale * (corners - centre))[1].any()
    assert f(centre + (s.scale + 0.02) * (corners - centre))[1].any()
    with pytest.raises(ArgumentError, match="inside the box"):
        study(f, box, around={"T": [5.0, 0.0, 0.0]})


class Wave(gt.Model):
    """A function whose bound cuts a box into many."""

    a = gt.variable(2, start=[0.3, 0.2])
    y = gt.variable()

    def equations(self):
        yield self.y == gt.sin(3 * self.a[0]) * gt.cos(2 * self.a[1])


def test_a_stopped_proof_continues_and_workers_change_no_byte(monkeypatch):
    monkeypatch.setattr(subdivision, "BLOCK", 32)
    f = Wave().causal(known="a", targets="y")
    prove = partial(study, f, {"a": [[-2.0, 2.0], [-2.0, 2.0]]}, bounds={"y": [[-2.0, 0.9]]}, max_boxes=1500)
    whole = prove()
    assert 0 < whole.proved < 1 and whole.boxes > 500
    for checks in (3, 15):
        calls = iter([False] * checks)
        part = prove(stop=lambda calls=calls: next(calls, True))
        assert part.status.value == "interrupted" and 1 < len(part.cuts) < len(whole.cuts)
        again = prove(cuts=part.cuts)
        assert (again.values, again.files) == (whole.values, whole.files)
    more = prove(cuts=whole.cuts, max_boxes=4000)  # not only after a stop
    assert more.proved > whole.proved and more.boxes > whole.boxes
    with gt.workers.using(workers=2):
        assert (prove().values, prove().files) == (whole.values, whole.files)
    for text in ("A", "A...", "D..", "A.", "?.."):
        with pytest.raises(ArgumentError) as error:
            prove(cuts=text)
        assert error.value.argument == "cuts"
