"""Calling a CausalFunction: rows, statuses, diagnoses, and wrong arguments. Data never throws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

import gtmodel as gt
from gtmodel import Status
from gtmodel.compiler.rows import _FewRows
from tests.support.examples import examples
from tests.support.models import FourBar, Pendulum, SliderCrank
from tests.support.rods import ThreeRods

RODS = ThreeRods()
IK = RODS.causal("T", "q")
T = np.array([1.5, -0.5, 0.8])
FAR = np.array([1.5, -5.0, 0.8])


class TestRows:
    def test_shapes(self):
        f = RODS.causal("T", ["q", "der(q)", "rod[0].tension"])
        q, qd, tension, status = f(T, 0.1 * T, 0 * T)
        assert (q.shape, qd.shape, type(tension), status) == ((3,), (3,), float, Status.OK)
        q, qd, tension, status = f(np.tile(T, (5, 1)), 0.1 * T, 0 * T)  # single arguments go with every row
        assert (q.shape, qd.shape, tension.shape, status.shape) == ((5, 3), (5, 3), (5,), (5,))
        assert f(np.tile(T, (1, 1)), T, T)[0].shape == (1, 3)

    def test_no_rows(self):
        q, status = IK(np.zeros((0, 3)))
        assert (q.shape, status.shape) == ((0, 3), (0,))
        jacobian, status = IK.jacobian(np.zeros((0, 3)))
        assert (jacobian.shape, status.shape) == ((0, 3, 3), (0,))

    @examples(25)
    @given(st.integers(0, 2**32 - 1))
    def test_each_row_equals_the_scalar_call(self, seed):
        rng = np.random.default_rng(seed)
        rows = T + rng.uniform(-3, 3, (7, 3))  # many of them out of reach
        rows[rng.random((7, 3)) < 0.05] = np.nan
        q, status = IK(rows)
        jacobian, jacobian_status = IK.jacobian(rows)
        for k, row in enumerate(rows):
            single, code = IK(row)
            assert status[k] == code == jacobian_status[k]
            assert np.array_equal(q[k], single, equal_nan=True)
            assert np.array_equal(jacobian[k], IK.jacobian(row)[0], equal_nan=True)

    @pytest.mark.filterwarnings("error")
    def test_few_rows_have_the_statuses_of_each_row_by_itself(self, monkeypatch):
        """Second road: `status_codes` of every row, without the test whether all rows are clearly good."""
        f = RODS.causal("T", ["q", "der(q,2)", "rod[0].tension"])
        rng = np.random.default_rng(4)
        calls = []
        for size in (0.1, 3.0, 1e6, 1e200):
            for n in (1, 2, 50):
                rows = [T + size * rng.uniform(-1, 1, (n, 3)), *(size * rng.standard_normal((2, n, 3)))]
                rows[2][rng.random((n, 3)) < 0.01] = rng.choice([np.nan, np.inf])
                calls.append((rows, f(*rows)))
        assert {int(code) for _, results in calls for code in results[-1]} >= {
            0,
            Status.OUT_OF_RANGE,
            Status.NOT_FINITE,
        }
        monkeypatch.setattr(_FewRows, "all_good", lambda self: False)
        for rows, results in calls:
            assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(results, f(*rows), strict=True))

    def test_bad_rows_do_not_harm_others(self):
        rows = np.array([T, FAR, T, [np.nan, 0, 0], [np.inf, 0, 0], T])
        q, status = IK(rows)
        assert status.tolist() == [0, Status.OUT_OF_RANGE, 0, Status.NOT_FINITE, Status.NOT_FINITE, 0]
        alone = IK(T)[0]
        assert all(np.array_equal(q[k], alone) for k in (0, 2, 5))
        assert np.all(np.isnan(q[[1, 3, 4]]))

    def test_arguments_are_not_written_to(self):
        rows = np.array([T, FAR])
        rows.flags.writeable = False
        IK(rows)
        assert np.array_equal(rows, [T, FAR])

    def test_lists_and_integers_are_numbers(self):
        f = FourBar().causal("theta", "C")
        assert np.array_equal(f(1)[0], f(1.0)[0])
        assert np.array_equal(f([0.5, 1])[0], f(np.array([0.5, 1.0]))[0])


class TestStatus:
    def test_out_of_range_by_a_discriminant(self):
        q, status = IK(FAR)
        assert status == Status.OUT_OF_RANGE
        assert np.all(np.isnan(q))
        assert "outside the range" in IK.diagnose(FAR)
        assert "no real solution" in IK.diagnose(FAR)
        assert IK.diagnose(T) == Status.OK.message

    def test_at_the_rim_the_position_is_known_and_the_velocity_not(self):
        crank = SliderCrank()
        reach = crank.causal(["s", "force"], ["P"])
        rim = 0.3 + 0.8  # stretched: both solutions meet
        assert reach(rim * (1 - 1e-12))[1] == Status.OK
        assert reach(rim * (1 + 1e-12))[1] == Status.OUT_OF_RANGE
        speed = crank.causal(["s", "force"], ["der(P)"])
        # which of the two causes comes first is decided by the last bit
        assert speed(rim, 0.1)[1] in (Status.SINGULAR, Status.OUT_OF_RANGE)

    def test_singular_by_a_pivot(self):
        # a bob straight below its pivot with x as the state is regular; beside it, y cannot be told from x
        f = Pendulum().causal((), ["der(y)"], prefer="x")
        assert f(0.6, 1.0)[1] == Status.OK
        value, status = f(1.0, 1.0)
        assert status == Status.SINGULAR
        assert np.isnan(value)
        assert "pivot" in f.diagnose(1.0, 1.0)

    def test_not_finite_wins_over_everything(self):
        assert IK([np.nan, -5.0, 0.8])[1] == Status.NOT_FINITE

    def test_status_is_the_enumeration(self):
        assert isinstance(IK(T)[1], Status)
        assert IK(np.array([T]))[1].dtype.kind == "i"

    def test_jacobian_has_a_status_too(self):
        jacobian, status = IK.jacobian(FAR)
        assert status == Status.OUT_OF_RANGE
        assert np.all(np.isnan(jacobian))

    def test_jacobian_against_complex_free_differences(self):
        jacobian, _ = IK.jacobian(T)
        h = 1e-4  # sixth-order differences: truncation 1e-24, round-off 1e-12
        steps = [sum(c * IK(T + k * h * e)[0] for c, k in ((-1, -3), (9, -2), (-45, -1), (45, 1), (-9, 2), (1, 3)))
                 for e in np.eye(3)]  # fmt: skip
        assert np.allclose(jacobian, np.array(steps).T / (60 * h), rtol=0, atol=1e-10)


class TestWrongArguments:
    @pytest.mark.parametrize(
        "arguments, sentence",
        [
            ((), r"q_from_T takes 1 argument \(T\); found 0"),
            ((T, T), r"takes 1 argument \(T\); found 2"),
            (([1.0, 2.0],), r"'T' must have shape \(3,\) or \(n, ...\); found \(2,\)"),
            ((np.zeros((4, 2)),), r"'T' must have shape \(3,\) or \(n, ...\); found \(4, 2\)"),
            ((1.0,), r"'T' must have shape \(3,\) or \(n, ...\); found \(\)"),
        ],
    )
    def test_number_and_shape(self, arguments, sentence):
        with pytest.raises(TypeError, match=sentence):
            IK(*arguments)
        with pytest.raises(TypeError, match=sentence):
            IK.jacobian(*arguments)
        with pytest.raises(TypeError, match=sentence):
            IK.diagnose(*arguments)

    def test_rows_must_agree(self):
        f = RODS.causal("T", "der(q)")
        with pytest.raises(TypeError, match=r"'der\(T\)' has 3 rows, another argument has 2"):
            f(np.zeros((2, 3)), np.zeros((3, 3)))

    def test_a_misspelt_keyword(self):
        with pytest.raises(TypeError, match="branch"):
            RODS.causal("T", "q", branch={})

    @pytest.mark.parametrize(
        "known, targets, sentence",
        [
            ("T", (), "there is no target; name at least one variable to compute"),
            ("T", "rod[0].tensoin", r"no variable 'rod\[0\]\.tensoin'; did you mean 'rod\[0\]\.tension' or"),
            ("X", "q", "no variable 'X'; top-level names are q, T, tau"),
            ("der(T)", "q", r"'der\(T\)' cannot be known without"),
            (["T", "T[0]"], "q", r"a known variable is named twice in T, T\[0\]"),
        ],
    )
    def test_names(self, known, targets, sentence):
        with pytest.raises(gt.ModelError, match=sentence):
            RODS.causal(known, targets)

    def test_suggestions_are_different_names(self):
        with pytest.raises(gt.ModelError) as error:
            RODS.causal("T", "rod[0].tensoin")
        suggested = [w for w in str(error.value).split("did you mean ")[1].rstrip("?").split(" or ")]
        assert len(set(suggested)) == len(suggested) == 3


class TestNames:
    @pytest.mark.parametrize(
        "asked, named", [("der(q)", "der(q)"), ("der(der(q))", "der(q,2)"), ("der(q, 2)", "der(q,2)"), ("q[1]", "q[1]")]
    )
    def test_spellings_of_one_derivative(self, asked, named):
        assert RODS.causal("T", asked).outputs[0].name == named

    def test_units_of_signals(self):
        f = RODS.causal("T", ["q", "der(q)", "der(q,2)", "tau"])
        assert [s.unit for s in f.outputs] == ["m", "m/s", "m/s2", "N"]
        assert [s.unit for s in f.inputs] == ["m", "m/s", "m/s2"]

    def test_a_known_variable_may_be_a_target(self):
        f = RODS.causal("T", ["T", "der(T)", "q"])
        found = f(T, 2 * T)
        assert np.array_equal(found[0], T)
        assert np.array_equal(found[1], 2 * T)

    def test_names_that_are_one_in_c(self):
        class Part(gt.Model):
            b = gt.variable(unit="1")

            def equations(self):
                yield self.b == 3

        class Whole(gt.Model):
            a = gt.part(Part)
            a_b = gt.variable(unit="1")
            margins = gt.variable(unit="1")
            parameters = gt.input(unit="1")
            parameters_ = gt.input(unit="1")

            def equations(self):
                yield self.a_b == self.parameters + self.parameters_
                yield self.margins == 2 * self.a_b

        f = Whole().causal(["parameters", "parameters_"], ["a.b", "a_b", "margins"])
        assert f(1.0, 2.0) == (3.0, 3.0, 6.0, Status.OK)
        assert len({f.casadi.name_out(k) for k in range(f.casadi.n_out())}) == 5
        assert f.casadi_parametric.n_in() == 3

    def test_functions_are_made_once(self):
        assert RODS.causal("T", "q") is RODS.causal(["T"], ["q"])

    def test_time_is_the_last_argument(self):
        class Moving(gt.Model):
            a = gt.parameter(2.0, unit="m/s2")
            x = gt.variable(unit="m")
            v = gt.variable(unit="m/s")

            def equations(self):
                yield self.x == self.a * self.time**2 / 2
                yield self.v == gt.der(self.x)

        f = Moving().causal((), ["x", "v", "der(v)"])
        assert f(3.0) == (9.0, 6.0, 2.0, Status.OK)
        x, v, a, status = f(np.array([1.0, 2.0]))
        assert (x.tolist(), v.tolist(), a.tolist(), status.tolist()) == ([1, 4], [2, 4], [2, 2], [0, 0])


def test_newton_does_not_jump_to_a_neighbouring_solution():
    class TwoSolutions(gt.Model):
        u = gt.variable()
        x = gt.variable(start=0.5)

        def equations(self):
            yield (self.x - self.u) ** 2 + gt.sin(self.x - self.u) ** 2 * 0.1 == 1.0

    # inputs two apart put the other solution exactly where the first one stood
    u = np.linspace(-6, 6, 25)
    x, status = TwoSolutions().causal("u", "x")(u)
    assert not np.any(status) and len(np.unique(np.sign(x - u))) == 1


class Wavy(gt.Model):
    """y + a sin(w y) == x folds back and forth; the branch of y = 0 ends where 1 + a w cos(w y) vanishes."""

    x = gt.input()
    y = gt.variable(start=0.0)
    a = gt.parameter(0.3)
    w = gt.parameter(9.0)

    def equations(self):
        yield self.y + self.a * gt.sin(self.w * self.y) == self.x


@pytest.mark.parametrize(("a", "w"), [(0.3, 9.0), (0.1, 40.0)])
def test_newton_does_not_jump_over_folds(a, w):
    fold = np.arccos(-1 / (a * w)) / w
    end = fold + a * np.sin(w * fold)
    x = np.linspace(-3, 3, 601)
    y, status = Wavy(a=a, w=w).causal(known="x", targets="y")(x)
    ok = status == gt.Status.OK
    assert np.array_equal(ok, np.abs(x) < end)
    assert np.abs(y[ok]).max() < fold


class Late(gt.Model):
    """No solution before one second."""

    x = gt.variable(start=1.0, unit="1")
    second = gt.parameter(1.0, unit="s")

    def equations(self):
        yield self.x**2 == self.time / self.second - 1


def test_a_model_that_begins_to_have_solutions_later_than_time_zero():
    f = Late().causal(targets="x")
    x, status = f(np.array([5.0, 2.0, 0.5]))
    assert status.tolist() == [gt.Status.OK, gt.Status.OK, gt.Status.OUT_OF_RANGE]
    assert x[:2] == pytest.approx([2.0, 1.0])


class Hidden(gt.Model):
    """Structurally sound, but x' + y' is known twice: x = 1, z = -1, y = -t is the only solution."""

    x = gt.variable()
    y = gt.variable()
    z = gt.variable()
    second = gt.parameter(1.0, unit="s")

    def equations(self):
        yield self.second * (gt.der(self.x) + gt.der(self.y)) == self.z
        yield self.x + self.y == 1 - self.time / self.second
        yield self.z + self.x == 0


def test_a_hidden_singularity_is_named():
    with pytest.raises(gt.ModelError, match=r"rank 1 .*singular.*Hidden equation 1 .*Hidden equation 2"):
        Hidden().causal(targets="x")


@pytest.mark.parametrize("targets", [None, [1], 3])
def test_targets_are_names(targets):
    with pytest.raises(gt.ModelError, match="targets takes names of variables"):
        Hidden().causal(targets=targets)


def test_a_constant_has_an_empty_jacobian():
    class Two(gt.Model):
        x = gt.variable()

        def equations(self):
            yield self.x == 2

    jacobian, status = Two().causal(targets="x").jacobian()
    assert jacobian.shape == (1, 0)
    assert status is gt.Status.OK
