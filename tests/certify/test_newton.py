"""Certificates of functions with a Newton block: the solutions and the answers of the code, against fifty digits."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from mpmath import matrix, mp, mpf

import gtmodel as gt
from gtmodel.certify.intervals import Interval
from gtmodel.certify.newton_form import REAL, NewtonProver, _shrinking
from gtmodel.certify.tape import _lifted
from gtmodel.certify.tube import KernelDerivatives, Tube
from gtmodel.cgen.newton_stages import evaluate_stages, stages
from gtmodel.cgen.newton_steps import CONTRACTION
from gtmodel.results import ArgumentError
from tests.certify.exact import Exact

MIDDLE = np.array([-1.46, -4.49, 0.02])  # m, about the middle of the controller's box
MOVED = 0.004  # m in a cycle: 1 m/s and 4 ms


@cache
def six_links() -> gt.CausalFunction:
    return gt.robots.six_link_gantry_tau("d1_six_link").causal(known="T", targets=["q", "e"])


def box(width: float) -> dict[str, list[list[float]]]:
    return {"T": [[c - width / 2, c + width / 2] for c in MIDDLE.tolist()]}


def solved(residual: Exact, z: np.ndarray, a: np.ndarray) -> list:
    """The solution near z with fifty digits."""
    m = len(z)
    z = [mpf(float(x)) for x in z]
    for _ in range(4):
        values = residual([*z, *a])
        J = matrix(m, m)
        for j in range(m):
            for i in range(m):
                J[i, j] = values[m + j * m + i]
        step = mp.lu_solve(J, matrix(values[:m]))
        z = [x - s for x, s in zip(z, step, strict=True)]
    assert max(abs(s) for s in step) < mpf("1e-40")
    return z


@pytest.mark.parametrize("points", [20, pytest.param(10_000, marks=pytest.mark.proof)])
def test_the_code_reaches_the_solution_from_its_last_answer(points):
    f = six_links()
    s = gt.certify.study(f, box(0.02), moving=gt.certify.InputSpeed(speed={"T": 1.0}, period=0.004))
    assert s.status.ok and s.proved == 1.0 and s.steps <= 4 and set(s.claims.values()) == {"proved"}
    assert max(s.errors.values()) < 2e-13
    cut = stages(f, "x")
    rng = np.random.default_rng(2)
    lo, hi = np.array(s.box["T[0]"] and list(s.box.values())).T
    now = lo + np.round(rng.random((points, 3)), 1) * (hi - lo)
    before = now + rng.uniform(-MOVED, MOVED, now.shape)
    start = f.unknowns(before)[0][0]
    values, status = evaluate_stages(cut, [now], start, f.sizes)
    assert not status.any()
    residual, body = Exact(f.kernels[0].residual), Exact(cut.body)
    observed = dict.fromkeys(s.errors, mpf(0))
    for k in range(points):
        z = solved(residual, f.unknowns(now[k : k + 1])[0][0][0], now[k])
        exact = body([*now[k], *z])
        for i, (name, bound) in enumerate(s.errors.items()):
            low, high = s.ranges[name]
            assert low <= exact[i] <= high
            observed[name] = max(observed[name], abs(exact[i] - mpf(values[k, i])))
            assert observed[name] <= bound
    assert all(s.errors[name] <= 1000 * x for name, x in observed.items())


def test_steps_that_are_said_to_shrink_pass_the_test_of_the_code():
    """The worst steps from every distance e; a fifth of the distance left is too much."""
    rng = np.random.default_rng(0)
    left, quiet = rng.uniform(0.0, 0.2, 4000), 10.0 ** rng.uniform(-17, -10.3, 4000)
    good = _shrinking(left, quiet)
    assert good[(left < 0.15) & (quiet < 1e-12)].all() and not good[left > 0.1755].any()
    q, r = left[good, None], quiet[good, None]
    e = 10.0 ** np.linspace(-13, 0, 400)
    after = (1 + q) * (q * e + r) + 2 * r
    assert np.all(after <= np.maximum(CONTRACTION * ((1 - q) * e - 2 * r), REAL.round_off))


def test_without_a_motion_the_tolerance_bounds_the_error():
    s = gt.certify.study(six_links(), box(0.02))
    assert s.proved == 1.0 and s.steps is None and "tolerance" in s.notes[0]
    assert 1e-12 < max(s.errors.values()) < 1e-9  # the code accepts residuals of 1e-11


def test_too_fast_a_motion_is_not_proved():
    s = gt.certify.study(six_links(), box(0.001), moving=gt.certify.InputSpeed(speed={"T": 50.0}), max_boxes=15)
    assert not s.status.ok and s.undecided == 1.0
    assert not any(word == "proved" for name, word in s.claims.items() if name == "status OK" or "last cycle" in name)


def test_a_box_beyond_the_reach_is_not_proved():
    s = gt.certify.study(six_links(), {"T": [[-1.4, -1.4], [-4.49, -4.49], [1.0, 6.0]]}, max_boxes=40)
    assert s.proved < 1.0 and s.claims["status OK at the solution"] != "proved"


def _slopes_outside(d: KernelDerivatives, z: np.ndarray, a: np.ndarray) -> int:
    """How many first and second derivatives of the residual, as differences of fifty digits, lie outside their
    enclosures: the first at a point, the second over a box around it."""
    first = d.at(z[:, None], a[:, None])[1]
    around = Interval(z[:, None] - 1e-3, z[:, None] + 1e-3)
    second = d.over(around, a[:, None] - 1e-3, a[:, None] + 1e-3)[1]
    _, _, _, constants = _lifted(d.residual)
    at, both, step = Exact(d.first.function), d.m + d.k, mpf("1e-20")
    tiny = mpf("1e-25")  # round-off of the differences
    here = at([*z, *a, *constants])
    outside = 0
    for c in range(both):
        there = at([mpf(float(x)) + (step if i == c else 0) for i, x in enumerate([*z, *a])] + constants)
        change = [(y - x) / step for x, y in zip(here, there, strict=True)]
        for i in range(d.m):
            low, high = first.lo[0, i, c], first.hi[0, i, c]
            outside += not low - 1e-15 <= change[i] <= high + 1e-15  # 1e-20 times a second derivative
            for e in range(both):
                x = change[d.m * (1 + e) + i]
                outside += not second.lo[0, i, e, c] - tiny <= x <= second.hi[0, i, e, c] + tiny
    return outside


def test_a_wrong_sign_in_a_jacobian_is_found(monkeypatch):
    f = six_links()
    d = KernelDerivatives(f.kernels[0])
    z = f.unknowns(MIDDLE[None])[0][0][0]
    assert _slopes_outside(d, z, MIDDLE) == 0
    real = d.first.over

    def wrong(*a, **k):
        e = real(*a, **k)
        low, high = e.lo.copy(), e.hi.copy()
        row = d.m + int(np.argmax(np.abs(low[d.m :, 0])))
        low[row], high[row] = -e.hi[row], -e.lo[row]
        return replace(e, lo=low, hi=high)

    monkeypatch.setattr(d.first, "over", wrong)
    assert _slopes_outside(d, z, MIDDLE) > 0


def test_solutions_of_fifty_digits_lie_in_the_tube_and_turn_as_it_says():
    f = six_links()
    kernel = f.kernels[0]
    lo, hi = MIDDLE[:, None] - 0.03, MIDDLE[:, None] + 0.03
    tube = Tube(KernelDerivatives(kernel), np.asarray(kernel.scale), f.unknowns(MIDDLE[None])[0][0].T, lo, hi)
    assert tube.proved.all()
    slopes, residual = tube.around(np.zeros(1)).derivative(), Exact(kernel.residual)
    rng = np.random.default_rng(4)
    for _ in range(6):
        a = np.clip(MIDDLE + 0.03 * np.round(rng.uniform(-1.5, 1.5, 3), 1), lo[:, 0], hi[:, 0])
        z = solved(residual, f.unknowns(a[None])[0][0][0], a)
        da = [mpf(float(x)) - mpf(float(y)) for x, y in zip(a, tube.middle[:, 0], strict=True)]
        for i in range(6):
            line = mpf(float(tube.centre[i, 0])) + sum(
                mpf(float(t)) * d for t, d in zip(tube.tangents.lo[i, :, 0], da, strict=True)
            )
            assert abs(z[i] - line) <= tube.w[i, 0]
        for k in range(3):
            step = mpf("1e-20")
            moved = [mpf(float(x)) + (step if i == k else 0) for i, x in enumerate(a)]
            there = solved(residual, f.unknowns(a[None])[0][0][0], moved)
            for i in range(6):
                assert slopes.lo[i, k, 0] <= (there[i] - z[i]) / step <= slopes.hi[i, k, 0]


def test_no_singular_pose_with_newtons_method():
    f = gt.robots.six_link_gantry_tau("d1_six_link").causal(known="T", targets="q")
    s = gt.certify.study(f, box(0.2), regular=True, max_boxes=1000)
    assert s.status.ok and s.proved == 1.0
    T = MIDDLE + np.random.default_rng(6).uniform(-0.1, 0.1, (300, 3))
    least = np.linalg.svd(f.jacobian(T)[0], compute_uv=False)[:, -1].min()
    assert 0.2 * least < s.least_singular_value <= least


def test_wrong_arguments():
    f = six_links()
    for arguments, named in (
        (dict(real="float"), "real"),
        (dict(moving=gt.certify.InputSpeed(speed={"q": 1.0})), "moving.speed"),
    ):
        with pytest.raises(ArgumentError) as error:
            gt.certify.study(f, box(0.01), **arguments)
        assert error.value.argument == named


def test_a_residual_that_jumps_is_not_proved():
    class Jumping(gt.Model):
        a = gt.variable(start=0.5)
        z = gt.variable(start=0.5)

        def equations(self):
            yield self.z + 0.3 * gt.sin(self.z) == self.a + 1e-3 * gt.sign(self.a - 0.4)

    f = Jumping().causal(known="a", targets="z")
    assert len(f.kernels) == 1
    s = gt.certify.study(f, {"a": [[0.3, 0.5]]}, max_boxes=30)
    assert 0 < s.proved < 1.0 and not s.status.ok


@pytest.mark.proof
def test_all_statements_over_half_of_the_reach_of_six_links():
    """A slice 0.2 m thick across the guideways, along which the reach hardly changes, with all that is reached of it:
    one solution, no singular pose, and the code follows 1 m/s. Only the size of the reach is sampled, not what is
    proved. About 70 s of CPU, 21,000 boxes."""
    f = gt.robots.six_link_gantry_tau("d1_six_link").causal(known="T", targets="q")
    lo, hi, far = MIDDLE - [0.1, 1.2, 1.3], MIDDLE + np.array([0.1, 1.5, 1.4]), np.array([0.1, 2.4, 2.4])
    T = np.random.default_rng(0).uniform(MIDDLE - far, MIDDLE + far, (20_000, 3))
    reached = T[f(T)[1] == 0]
    assert np.all((reached > lo) & (reached < hi))
    slice_ = {"T": np.stack([lo, hi], axis=1).tolist()}
    s = gt.certify.study(f, slice_, moving=gt.certify.InputSpeed(speed={"T": 1.0}), regular=True, max_boxes=30_000)
    reach = len(reached) / len(T) * 4.8**2
    assert s.proved * 2.7 * 2.7 > 0.5 * reach and s.steps <= 4


class TwoSolutions(gt.Model):
    """z and about -z solve the equation, and no declared branch tells them apart."""

    a = gt.variable(start=1.5)
    z = gt.variable(start=1.2)

    def equations(self):
        yield self.z**2 + 0.1 * gt.sin(self.z) == self.a


def test_boxes_with_different_solutions_are_not_proved_together(monkeypatch):
    """Each box alone holds one solution, but code that follows one of them never meets the other."""
    f = TwoSolutions().causal(known="a", targets="z")
    assert len(f.kernels) == 1
    right = gt.certify.study(f, {"a": [[0.1, 2.0]]}, max_boxes=50)
    assert right.proved == 1.0 and right.boxes > 3
    real = NewtonProver.solutions

    def other(self, a):
        z = -np.ones_like(a)
        for _ in range(40):
            z = -np.sqrt(a - 0.1 * np.sin(z))
        return np.where(a < 1.0, real(self, a), z)

    monkeypatch.setattr(NewtonProver, "solutions", other)
    s = gt.certify.study(f, {"a": [[0.1, 2.0]]}, max_boxes=50)
    assert not s.status.ok and s.undecided > 0
    assert "undecided" in s.claims["exactly one solution in the region of the assembly mode"]


def test_a_fold_is_never_proved():
    """At a = -0.0025 about both solutions meet: boxes that touch the fold, hold it, or begin beside it."""
    f = TwoSolutions().causal(known="a", targets="z")
    z = -0.05  # 2 z + 0.1 cos z = 0 near here
    for _ in range(20):
        z -= (2 * z + 0.1 * np.cos(z)) / (2 - 0.1 * np.sin(z))
    fold = z**2 + 0.1 * np.sin(z)
    for low in (fold, np.nextafter(fold, 1.0), fold - 0.1):
        s = gt.certify.study(f, {"a": [[low, 1.0]]}, max_boxes=300)
        assert not s.status.ok and s.proved < 1.0
    for around in (0.0, 1e-12):
        s = gt.certify.study(f, {"a": [[fold - around, fold + around]]}, max_boxes=300)
        assert s.proved < 1.0
    assert gt.certify.study(f, {"a": [[fold + 0.01, 1.0]]}, max_boxes=300).proved == 1.0


def _random_model(seed: int) -> gt.Model:
    c = np.round(np.random.default_rng(seed).normal(size=8) * (0.1, 0.5, 1.5)[seed % 3], 2).tolist()

    class Random(gt.Model):
        a = gt.variable(2, start=[0.1, 0.2])
        z = gt.variable(2, start=[0.1, 0.2])
        y = gt.variable()

        def equations(self):
            z, a = self.z, self.a
            yield z[0] + c[0] * gt.sin(z[1]) + c[1] * z[0] * z[1] + c[2] * z[0] ** 3 == a[0]
            yield z[1] + c[3] * gt.cos(z[0]) + c[4] * z[0] ** 2 + c[5] * gt.exp(0.3 * z[0] * z[1]) == a[1]
            yield self.y == gt.sqrt(2 + c[6] * z[0] * z[1]) + c[7] * a[0] * z[1]

    return Random()


@pytest.mark.parametrize("count", [8, pytest.param(150, marks=pytest.mark.proof)])
def test_random_equations(count):
    """The code of random equations follows its solution at the greatest speed, from answers as wrong as allowed; values
    of fifty digits lie in the ranges, round-off and singular values within their bounds."""
    proved = 0
    for seed in range(count):
        f = _random_model(seed).causal(known="a", targets=["z", "y"])
        rng = np.random.default_rng(seed + 1000)
        middle, half, speed = rng.uniform(-0.5, 0.5, 2), 10 ** rng.uniform(-4, 0, 2), 10 ** rng.uniform(-3, 2.5)
        lo, hi = middle - half, middle + half
        moving = gt.certify.InputSpeed(speed={"a": speed}, period=0.004)
        box = {"a": np.stack([lo, hi], axis=1).tolist()}
        s = gt.certify.study(f, box, moving=moving, regular=True, max_boxes=300)
        if not s.status.ok:
            continue
        proved += 1
        cut, kernel, points = stages(f, "x"), f.kernels[0], 8
        residual, body = Exact(kernel.residual), Exact(cut.body)
        now = lo + np.clip(rng.uniform(-0.1, 1.1, (points, 2)), 0, 1) * (hi - lo)
        before = now + rng.choice([-1, 1], (points, 2)) * 0.004 * speed * (1 - 1e-12)
        # follow the solution from the middle of the box, whose solution is that of the certificate
        z, z_before = (np.tile(f.unknowns(middle[None])[0][0][0], (points, 1)) for _ in range(2))
        for share in np.linspace(0, 1, 25)[1:]:
            z = _corrected(kernel, z, middle + share * (now - middle))
        z_before = z.copy()
        for share in np.linspace(0, 1, 25)[1:]:
            z_before = _corrected(kernel, z_before, now + share * (before - now))
        start = z_before + rng.choice([-1, 1], z.shape) * 0.99e-9
        values, status = evaluate_stages(cut, [now], start, f.sizes)
        assert not status.any()
        least = np.linalg.svd(f.jacobian(now)[0], compute_uv=False)[:, -1].min()
        assert 0 < s.least_singular_value <= least * (1 + 1e-9) or np.abs(f.unknowns(now)[0][0] - z).max() > 1e-6
        for k in range(points):
            exact = body([*now[k], *solved(residual, z[k], now[k])])
            for i, (name, bound) in enumerate(s.errors.items()):
                low, high = s.ranges[name]
                assert low <= exact[i] <= high and abs(exact[i] - mpf(values[k, i])) <= bound
    assert proved > 0.3 * count


def _corrected(kernel, z: np.ndarray, a: np.ndarray) -> np.ndarray:
    for _ in range(3):
        r, J = kernel._evaluate(z.T, a.T)[:2]
        z = z - np.linalg.solve(J, np.asarray(r).T.reshape(len(z), -1, 1))[:, :, 0]
    return z
