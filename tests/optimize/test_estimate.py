"""Estimation with covariance: against closed forms of linear regression and against SciPy. Data are synthetic."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit
from scipy.stats import t as student

import gtmodel as gt
from gtmodel import ModelError, der
from gtmodel.optimize import Mesh, SolverOptions, estimate, multi_start, solve, transcribe

TIGHT = SolverOptions(tolerance=1e-11)
# least squares by two roads; the collocation error of these smooth problems is below it
ROADS = 1e-5
SEED, NOISE = 7, 0.02
TIMES = np.linspace(0.0, 2.0, 25)


def noisy(values: np.ndarray, seed: int = SEED) -> np.ndarray:
    """Synthetic: normal noise of standard deviation 0.02."""
    return values + NOISE * np.random.default_rng(seed).standard_normal(values.shape)


def line(data: np.ndarray, sigma: Any = None, **changes: Any) -> gt.Optimization:
    class Line(gt.Optimization):
        """x = a + b t, both unknown."""

        b = gt.free(0.0)
        x = gt.variable(start=0.1)
        final_time = 2.0

        def equations(self):
            yield der(self.x) == self.b

        def objective(self):
            return gt.misfit(self.x, TIMES, data, sigma=sigma)

    return type("Line", (Line,), changes)()


def decay(data: np.ndarray, **changes: Any) -> gt.Optimization:
    class Decay(gt.Optimization):
        """x' = -k x^2 from an unknown start, measured through y = c x."""

        k = gt.free(0.5, min=0.01)
        c = gt.parameter(1.0)
        x = gt.variable(start=1.0, min=0.0, nominal=2.0)
        y = gt.variable()
        final_time = 2.0

        def equations(self):
            yield der(self.x) == -self.k * self.x**2
            yield self.y == self.c * self.x

        def objective(self):
            return gt.misfit(self.y, TIMES, data)

    return type("Decay", (Decay,), changes)()


class TestLinear:
    @pytest.mark.parametrize("sigma", [None, NOISE])
    def test_regression(self, sigma):
        data = noisy(0.3 + 1.2 * TIMES)
        e = estimate(solve(line(data, sigma), Mesh(4, 2), solver=TIGHT))
        X = np.column_stack([TIMES, np.ones_like(TIMES)])
        best, rest, *_ = np.linalg.lstsq(X, data, rcond=None)
        variance = NOISE**2 if sigma else rest[0] / (len(TIMES) - 2)
        covariance = variance * np.linalg.inv(X.T @ X)
        assert e.names == ("b", "x at the start")
        assert e.values == pytest.approx(best, rel=1e-7)
        assert e.covariance == pytest.approx(covariance, rel=1e-6)
        assert e.degrees_of_freedom == len(TIMES) - 2 and e.known_noise is (sigma is not None)
        low, high = e.interval("b", 0.9)
        q = 1.6448536269514722 if sigma else student.ppf(0.95, 23)
        assert (high - low) / 2 == pytest.approx(q * np.sqrt(covariance[0, 0]), rel=1e-6)
        assert "x at the start" in str(e) and "25 measured values" in str(e)
        assert e.correlation[0, 1] == pytest.approx(covariance[0, 1] / np.sqrt(np.prod(np.diag(covariance))), rel=1e-6)

    def test_a_fixed_start_is_not_estimated(self):
        data = noisy(0.3 + 1.2 * TIMES)
        e = estimate(solve(line(data, x=gt.variable(start=0.3, fixed=True)), Mesh(4, 2), solver=TIGHT))
        assert e.names == ("b",)
        assert e.values[0] == pytest.approx(TIMES @ (data - 0.3) / (TIMES @ TIMES), rel=1e-7)
        assert e.std[0] == pytest.approx(e.noise / np.linalg.norm(TIMES), rel=1e-6)

    def test_a_constraint_takes_a_freedom_away(self):
        """a = b / 4 by a point constraint: x = b (t + 1/4)."""
        data = noisy(0.3 + 1.2 * TIMES)
        held = line(data, constraints=lambda self: [self.x.at(0.0) == self.b / 4])
        e = estimate(solve(held, Mesh(4, 2), solver=TIGHT))
        column = TIMES + 0.25
        assert e.degrees_of_freedom == len(TIMES) - 1
        assert e.std == pytest.approx(e.noise / np.linalg.norm(column) * np.array([1.0, 0.25]), rel=1e-6)
        assert abs(e.correlation[0, 1]) == pytest.approx(1.0, abs=1e-6)

    def test_one_at_its_bound_is_held(self):
        data = noisy(0.3 + 1.2 * TIMES)
        e = estimate(solve(line(data, b=gt.free(0.5, max=1.0)), Mesh(4, 2), solver=TIGHT))
        assert e.names == ("x at the start",) and e.held == ("b",) and "b is held at its bound" in str(e)
        assert e.std[0] == pytest.approx(e.noise / np.sqrt(len(TIMES)), rel=1e-5)

    def test_vectors_and_weights(self):
        """Two lines with one slope, of which one is measured ten times better."""
        rng = np.random.default_rng(SEED)
        sigma = np.array([0.1, 0.01])
        data = np.column_stack([TIMES, TIMES + 1.0]) + sigma * rng.standard_normal((len(TIMES), 2))

        class Two(gt.Optimization):
            b = gt.free(0.0)
            x = gt.variable(2, start=[0.0, 1.0], fixed=True)
            final_time = 2.0

            def equations(self):
                yield der(self.x[0]) == self.b
                yield der(self.x[1]) == self.b

            def objective(self):
                return gt.misfit(self.x, TIMES, data, sigma=sigma)

        e = estimate(solve(Two(), Mesh(3, 2), solver=TIGHT))
        information = (TIMES @ TIMES) * np.sum(1 / sigma**2)
        assert e.std[0] == pytest.approx(information**-0.5, rel=1e-6)
        assert e.noise == pytest.approx(1.0, abs=0.3)


class TestNonlinear:
    def test_scipy(self):
        data = noisy(1.5 / (1 + 0.8 * 1.5 * TIMES))
        e = estimate(solve(decay(data), Mesh(20, 3), solver=TIGHT))
        best, covariance = curve_fit(
            lambda t, k, x: x / (1 + k * x * t), TIMES, data, [0.5, 1.0], ftol=1e-14, xtol=1e-14
        )
        assert e.names == ("k", "x at the start")
        assert e.values == pytest.approx(best, rel=ROADS)
        assert e.covariance == pytest.approx(covariance, rel=1e-3)  # SciPy's slopes are differences

    def test_a_system_without_closed_form(self):
        """van der Pol's constant from its orbit, by SciPy's integrator and curve_fit."""

        def orbit(t: np.ndarray, mu: float) -> np.ndarray:
            f = lambda _, x: [x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]]  # noqa: E731
            return solve_ivp(f, (0.0, 2.0), [1.0, 0.5], "DOP853", t, rtol=1e-11, atol=1e-12).y[0]

        data = noisy(orbit(TIMES, 0.9))

        class Orbit(gt.Optimization):
            mu = gt.free(0.3)
            x = gt.variable(start=1.0, fixed=True)
            v = gt.variable(start=0.5, fixed=True)
            final_time = 2.0

            def equations(self):
                yield der(self.x) == self.v
                yield der(self.v) == self.mu * (1 - self.x**2) * self.v - self.x

            def objective(self):
                return gt.misfit(self.x, TIMES, data)

        for options in (TIGHT, SolverOptions(tolerance=1e-11, formulation="dae")):
            e = estimate(solve(Orbit(), Mesh(15, 3), solver=options))
            best, covariance = curve_fit(orbit, TIMES, data, [0.3])
            assert e.values == pytest.approx(best, rel=ROADS)
            assert e.std[0] == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-3)

    @pytest.mark.proof
    def test_intervals_hold_what_they_say(self):
        """Of 400 synthetic sets the 90 % interval of k holds the truth in 90 % +- 4 standard deviations (1.5 %)."""
        truth, hits = 1.5 / (1 + 0.8 * 1.5 * TIMES), 0
        for seed in range(400):
            low, high = estimate(solve(decay(noisy(truth, seed)), Mesh(8, 3))).interval("k", 0.9)
            hits += low < 0.8 < high
        assert abs(hits / 400 - 0.9) < 0.06


class TestRefused:
    def test_what_the_data_do_not_determine(self):
        data = noisy(1.5 / (1 + 0.8 * 1.5 * TIMES))
        with pytest.raises(ModelError, match=r"the data do not determine .*; fix one of them") as caught:
            estimate(solve(decay(data, c=gt.free(1.0, min=0.1, max=9.0)), Mesh(5, 3)))
        # x = y / c: only k / c and c x are told
        assert all(name in str(caught.value) for name in ("k", "c", "x at the start"))

    @pytest.mark.parametrize(
        "changes, sentence",
        [
            ({"objective": lambda self: self.x.at(2.0) ** 2}, r"objective contains no gt.misfit\(...\)"),
            (
                {"objective": lambda self: gt.misfit(self.x, [0.5, 1.0, 1.5], [1, 2, 4]) + self.b**2},
                "the objective contains terms other than misfits",
            ),
            ({"objective": lambda self: gt.misfit(self.x, [0.5, 1.5], [1, 2])}, "2 measured values for 2 unknowns"),
            (
                {"objective": lambda self: gt.misfit(self.x, [0, 1, 2], [1, 2, 4])
                    + gt.misfit(self.x, [0, 1, 2], [1, 2, 4], sigma=1.0)},
                "give sigma to all misfits, or to none",
            ),
            ({"objective": lambda self: gt.misfit(self.x, [0.5, 1.5], [1, 2, 3])}, r"found \(2,\) and \(3,\)"),
            ({"objective": lambda self: gt.misfit(self.x, [], [])}, "at least one measured value"),
            ({"objective": lambda self: gt.misfit(self.x, [0.5], [np.nan])}, "at least one measured value"),
            ({"objective": lambda self: gt.misfit(self.x, [0.5], [1.0], sigma=0.0)}, "sigma is a standard deviation"),
            ({"objective": lambda self: gt.misfit(3.0, [0.5], [1.0])}, "takes a scalar or a vector expression; found"),
            ({"objective": lambda self: gt.misfit(self.x, [3.0], [1.0])}, "the instant 3 s of .at.. lies outside"),
        ],
    )  # fmt: skip
    def test_wrong_problems(self, changes, sentence):
        with pytest.raises(ModelError, match=sentence):
            estimate(solve(line(TIMES, **changes), Mesh(4, 2), throw=False))

    def test_no_solution(self):
        s = solve(line(TIMES), Mesh(4, 2), throw=False, solver=SolverOptions(max_iterations=0))
        with pytest.raises(ModelError, match="not solved, so there is no estimate: the iteration limit"):
            estimate(s)

    def test_names(self):
        e = estimate(solve(line(noisy(TIMES)), Mesh(4, 2)))
        with pytest.raises(ValueError, match="'a' was not estimated; these were: b, x at the start"):
            e.interval("a")
        with pytest.raises(ValueError, match="between 0 and 1; found 95"):
            e.interval("b", 95)


def test_many_starts_of_an_estimation():
    data = noisy(1.5 / (1 + 0.8 * 1.5 * TIMES))
    m = multi_start(transcribe(decay(data), Mesh(6, 3)), 4, seed=2)
    assert len(m.optima) == 1 and estimate(m.best).values[0] == pytest.approx(0.8, abs=0.1)
