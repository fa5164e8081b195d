"""What simulations of one model share, and what that must not change: numbers, the choice of states, the start."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from unittest import mock

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.consistency.initial import _Equations, initial_point, start_values
from gtmodel.compiler.rows import PointFunction
from gtmodel.compiler.states import choose
from gtmodel.simulation.choice import LARGEST_CHANGE, STRIDE, SWITCH_BELOW, StateSelection, Watch, choice_of
from gtmodel.simulation.prepare import prepare
from gtmodel.simulation.record import Wanted
from tests.simulation.models import SwingingPendulum, TwoMasses
from tests.simulation.robot import T0, l1

SAME = 1e-9  # closed form against Newton's method, and constants as parameters against constants in the equations


def drop(model, n=0, **more):
    """A short drop of the L1 from a random start, under random forces."""
    rng = np.random.default_rng(n)
    T, tau = T0 + 0.05 * rng.uniform(-1, 1, 3), 5 * rng.uniform(-1, 1, 3)
    return gt.simulate(model, 0.2, step=0.01, inputs={"tau": tau}, start={"T": T, "der(T)": 0.0}, **more)


def table(run):
    return np.column_stack(
        [np.reshape(run.trajectory[n], (len(run.trajectory.time), -1)) for n in run.trajectory.names]
    )


def fresh(cls, **given):
    """A model that shares nothing with another one."""
    return type(cls.__name__, (cls,), {})(**given)


class TestRepeated:
    def test_other_starts_and_inputs_give_the_numbers_of_a_fresh_model(self):
        used = l1()
        drop(used, 1)
        other = fresh(type(l1()), **l1().__dict__["_modifiers"])
        np.testing.assert_array_equal(table(drop(used, 2)), table(drop(other, 2)))
        np.testing.assert_array_equal(table(drop(used, 2)), table(drop(used, 2)))

    def test_nothing_is_made_anew(self):
        used = l1()
        drop(used, 1)
        with (
            mock.patch.object(ca, "integrator") as integrator,
            mock.patch("gtmodel.simulation.systems.Reduced") as made,
        ):
            drop(used, 3)
        assert not integrator.called and not made.called

    def test_another_function_of_time_is_another_input(self):
        model = fresh(TwoMasses)

        def end(force):
            run = gt.simulate(model, 1.0, step=0.5, inputs={"F": force}, start={"s": 0.0, "der(s)": 0.0})
            return run.trajectory["s"][-1]

        sine, cosine = end(lambda t: np.sin(t)), end(lambda t: np.cos(t))
        assert np.max(np.abs(sine - cosine)) > 1e-4
        np.testing.assert_array_equal(end(lambda t: np.sin(t)), sine)
        np.testing.assert_array_equal(end(lambda t: np.cos(t)), cosine)

    def test_other_tables_of_one_kind_share_everything_but_their_rows(self):
        model = fresh(TwoMasses)

        def end(values):
            run = gt.simulate(
                model, 1.0, step=0.5, inputs={"F": (np.linspace(0, 1, 5), values)}, start={"s": 0.0, "der(s)": 0.0}
            )
            return run.trajectory["s"][-1]

        first = end(np.ones(5))
        assert np.max(np.abs(end(np.linspace(0, 3, 5)) - first)) > 1e-4
        np.testing.assert_array_equal(end(np.ones(5)), first)
        constant = gt.simulate(model, 1.0, step=0.5, inputs={"F": 1.0}, start={"s": 0.0, "der(s)": 0.0})
        np.testing.assert_allclose(constant.trajectory["s"][-1], first, atol=1e-7)

    def test_a_constant_is_a_function_of_time_that_does_not_change(self):
        model = fresh(TwoMasses)
        runs = [
            gt.simulate(model, 1.0, inputs={"F": force}, start={"s": 0.0, "der(s)": 0.0}, tolerance=1e-11)
            for force in (3.0, lambda t: 3.0 + 0 * t)
        ]
        np.testing.assert_allclose(table(runs[0]), table(runs[1]), atol=SAME, rtol=SAME)

    def test_a_pulse_whose_time_is_a_constant_input_is_not_missed_the_second_time(self):
        class Pulsed(gt.Model):
            second = gt.parameter(1.0, unit="s")
            x = gt.variable(start=0.0, fixed=True)
            when = gt.input(unit="s")

            def equations(self):
                yield self.second * gt.der(self.x) == 1e4 * gt.exp(
                    -((1e4 * (self.time - self.when) / self.second) ** 2)
                )

        model = Pulsed()
        for when in (0.5, 7.77):
            x = gt.simulate(model, 10.0, inputs={"when": when}).trajectory["x"]
            assert x[-1] == pytest.approx(np.sqrt(np.pi), rel=1e-6)

    def test_progress_makes_no_difference_to_the_numbers(self):
        runs = [
            gt.simulate(SwingingPendulum(), 4.0, start={"x": 0.0, "der(x)": 7.0}, progress=progress)
            for progress in (None, lambda _: False)
        ]
        np.testing.assert_array_equal(table(runs[0]), table(runs[1]))
        assert [s.time for s in runs[0].switches] == [s.time for s in runs[1].switches]


class TestStart:
    @pytest.mark.parametrize("n", range(4))
    def test_in_closed_form_as_by_newton(self, n):
        rng = np.random.default_rng(n)
        given = {"T": T0 + 0.1 * rng.uniform(-1, 1, 3), "der(T)": rng.uniform(-1, 1, 3)}
        ready = prepare(l1(), {"tau": 0.0}, given, 0.0, Wanted(), (), 1e-9, "bdf")
        plan = ready.systems.plan
        held, guess = start_values(plan, given, ready.inputs.known)
        held |= {pair: 0.0 for pair in plan.pairs if pair[0] in ready.inputs.known}
        quick = initial_point(plan, held, guess)
        with mock.patch.object(_Equations, "in_closed_form", return_value=None):
            slow = initial_point(plan, held, guess)
        np.testing.assert_allclose(quick.w, slow.w, rtol=SAME, atol=SAME)
        assert quick.free == slow.free == frozenset()

    def test_beside_the_equations_is_left_to_those_who_say_why(self):
        with pytest.raises(gt.ModelError, match="no consistent start"):
            gt.simulate(l1(), 0.1, inputs={"tau": 0.0}, start={"T": [5.0, 5.0, 5.0], "der(T)": 0.0})


@pytest.fixture(scope="module")
def swing():
    """Points, times and states of a pendulum that turns over, row by row, and the selection that watches it."""
    model = SwingingPendulum()
    ready = prepare(model, None, {"x": 0.0, "der(x)": 7.0}, 0.0, Wanted(), (), 1e-9, "bdf")
    plan, flat = ready.systems.plan, ready.systems.plan.flat
    times = np.linspace(0.0, 0.2, 201)
    phi, L = 7.0 * times, 1.0  # any motion on the circle will do: the matrices depend on the point alone
    chain = {
        "x": [L * np.sin(phi), 7 * L * np.cos(phi), -49 * L * np.sin(phi)],
        "y": [-L * np.cos(phi), 7 * L * np.sin(phi), 49 * L * np.cos(phi)],
        "tension": [50 + 0 * phi, 0 * phi, 0 * phi],
    }
    points = np.column_stack([chain[flat.variables[i].name][k] for i, k in plan.pairs])
    return ready.systems.selection, ready.system.choice, points, times


class TestGoodRows:
    def test_end_where_the_quality_falls_below(self, swing):
        selection, choice, points, times = swing
        good = selection.good_rows(choice, points, times, SWITCH_BELOW)
        qualities = [selection.quality(choice, selection.matrix(w, t)) for w, t in zip(points, times, strict=True)]
        assert 0 < good < len(times) - 1
        assert qualities[good] < SWITCH_BELOW <= min(qualities[:good])

    @pytest.mark.parametrize("rows", [1, 2, STRIDE, STRIDE + 1, STRIDE + 2, 5 * STRIDE + 3])
    def test_all_where_nothing_changes(self, swing, rows):
        selection, choice, points, times = swing
        assert selection.good_rows(choice, points[:rows], times[:rows], SWITCH_BELOW) == rows - 1

    def test_looking_at_some_is_looking_at_all(self, swing):
        selection, choice, points, times = swing
        for begin in range(0, 150, 7):
            here = points[begin:], times[begin:]
            if selection.quality(choice, selection.matrix(here[0][0], here[1][0])) < SWITCH_BELOW:
                continue
            some = selection.good_rows(choice, *here, SWITCH_BELOW)
            assert some == selection._good_rows(choice, *here, SWITCH_BELOW)

    @pytest.mark.parametrize("row", [1, 5, STRIDE, 2 * STRIDE + 1])
    def test_not_over_a_jump_nor_over_what_is_no_number(self, swing, row):
        selection, choice, points, times = swing
        for value in (np.nan, np.inf):
            broken = points[: 3 * STRIDE].copy()
            broken[row:] = value
            assert selection.good_rows(choice, broken, times[: 3 * STRIDE], SWITCH_BELOW) < row
        jump = points[: 3 * STRIDE].copy()
        jump[row:] = points[200:201]
        assert selection.good_rows(choice, jump, times[: 3 * STRIDE], SWITCH_BELOW) < row

    def test_not_where_a_whole_turn_lies_between_two_rows(self, swing):
        selection, choice, points, _ = swing
        still = np.repeat(points[:1], 20, axis=0)  # the same pose in each row, at 7 rad/s
        assert selection.good_rows(choice, still, np.arange(20) * 2 * np.pi / 7, SWITCH_BELOW) == 0

    def test_a_motion_is_foreseen_as_far_as_the_states_last(self, swing):
        selection, choice, points, _ = swing
        assert selection.foresees(choice, points[0], 0.0, 0.05)
        assert not selection.foresees(choice, points[0], 0.0, 0.3)  # beyond a quarter of a turn
        assert not selection.foresees(choice, np.full_like(points[0], np.nan), 0.0, 0.01)

    def test_every_accepted_step_is_small(self, swing):
        selection, choice, points, times = swing
        some = points[::10], times[::10]
        good = selection.good_rows(choice, *some, SWITCH_BELOW)
        for a, b in zip(
            *(zip(some[0][k : good + k], some[1][k : good + k], strict=False) for k in (0, 1)), strict=False
        ):
            for watch in selection._distinct(choice):
                c, d = (selection.matrix(w, t)[watch.place][:, watch.solved] for w, t in (a, b))
                assert np.linalg.norm(np.linalg.solve(c, d - c)) <= LARGEST_CHANGE

    def test_near_a_judged_matrix_the_quality_is_bounded_from_below(self):
        rng, part = np.random.default_rng(0), ((0, 1, 2), (0, 1, 2, 3, 4))
        for size in (0.0, 1e-6, 1e-3, 0.1, 1.0):
            for _ in range(40):
                watch, a = Watch(part, [0, 1, 2], np.ones(5)), rng.normal(size=(3, 5))
                watch.quality(a, SWITCH_BELOW)
                near = a + size * rng.normal(size=a.shape)
                bound = watch.quality(near, SWITCH_BELOW)
                exact = Watch(part, [0, 1, 2], np.ones(5)).quality(near)
                assert bound <= exact * (1 + 1e-12)  # round-off of singular values
                assert (bound >= SWITCH_BELOW) == (exact >= SWITCH_BELOW)


@pytest.mark.parametrize("n", range(5))
def test_states_are_chosen_as_the_compiler_chooses_them(n):
    rng = np.random.default_rng(n)
    given = {"T": T0 + 0.2 * rng.uniform(-1, 1, 3), "der(T)": rng.uniform(-1, 1, 3)}
    ready = prepare(l1(), {"tau": 0.0}, given, 0.0, Wanted(), (), 1e-9, "bdf")
    plan = ready.systems.plan
    for prefer in ([], [i for name in ("q",) for i in plan.flat.lookup(name)[1]]):
        preferred = frozenset(plan.alias.resolve(i, 0)[1] for i in prefer)
        selection = StateSelection(plan, preferred, ca.SX(0, 1), np.zeros(0))
        m = selection.matrix(ready.initial.w, 0.0)
        pattern = set(zip(*plan.system.sparsity().get_triplet(), strict=True))
        expected = choice_of(choose(plan.flat, plan.structure, [m], preferred, pattern))
        if selection.quality(expected, m) >= SWITCH_BELOW:
            assert selection.choose(ready.initial.w, 0.0) == expected


class TestPointFunction:
    def test_sparse_empty_and_several(self):
        x, e, t = ca.SX.sym("x", 3), ca.SX.sym("e", 0), ca.SX.sym("t")
        f = ca.Function("f", [x, e, t], [ca.diag(x) * t, ca.SX(0, 1), ca.horzcat(x, 2 * x)])
        for value in (np.arange(3.0), np.ones(3)):
            given = PointFunction(f)(value, np.zeros(0), 2.0)
            for got, expected in zip(given, f(value, np.zeros(0), 2.0), strict=True):
                np.testing.assert_array_equal(got, expected.full())

    def test_results_are_new_and_threads_do_not_mix(self):
        x = ca.SX.sym("x", 50)
        f = PointFunction(ca.Function("f", [x], [x**2]))
        first = f(np.ones(50))[0]
        with ThreadPoolExecutor(4) as pool:
            results = list(pool.map(lambda k: f(np.full(50, float(k)))[0], range(400)))
        assert all((r == k**2).all() for k, r in enumerate(results)) and (first == 1).all()


class TestThreads:
    """One integrator of CasADi called by two threads at a time destroyed the heap; each thread has its own."""

    def test_threads_share_no_integrator(self):
        arguments = None, {"x": 0.6, "der(x)": 0.0}, 0.0, Wanted(), (), 1e-9, "bdf"
        pendulum = SwingingPendulum()
        own = [prepare(pendulum, *arguments).system.stepper for _ in range(2)]
        with ThreadPoolExecutor(1) as pool:
            other = [pool.submit(prepare, pendulum, *arguments).result().system.stepper for _ in range(2)]
        assert own[0] is own[1] and other[0] is other[1] and own[0] is not other[0]

    def test_numbers_of_simulations_at_the_same_time(self):
        pendulum, starts = SwingingPendulum(), [0.6, 0.5, 0.4] * 2

        def swing(x):
            return table(gt.simulate(pendulum, 0.2, start={"x": x, "der(x)": 0.0}))

        one_by_one = [swing(x) for x in starts]
        with ThreadPoolExecutor(4) as pool:
            for a, b in zip(pool.map(swing, starts), one_by_one, strict=True):
                np.testing.assert_array_equal(a, b)

    def test_a_simulation_within_the_progress_of_another(self):
        pendulum, inner = SwingingPendulum(), []

        def swing(x, progress=None):
            return table(gt.simulate(pendulum, 0.5, start={"x": x, "der(x)": 0.0}, progress=progress))

        outer, alone = swing(0.6), swing(0.4)
        np.testing.assert_array_equal(swing(0.6, lambda _: bool(inner.append(swing(0.4)))), outer)
        assert inner and all(np.array_equal(each, alone) for each in inner)
