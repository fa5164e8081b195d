"""Residuals of measured carts on synthetic points with known errors."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from gtmodel import mechanics as m
from gtmodel.kinematics import MeasurementError, backlash, cyclic_term, fit_guideway
from gtmodel.kinematics.transmission import strongest
from gtmodel.results import ArgumentError
from tests.mechanics.test_guideways import Slide
from tests.support.guideway_data import ACROSS, ALONG, MEAN, P0, UM, V, cart

ROUND_OFF = 1e-12
UNIT = V / np.linalg.norm(V)


class TestFit:
    @pytest.mark.parametrize("number", [0, 1, 2])
    def test_sizes_are_those_put_in(self, number):
        data = cart(number, seed=11, noise=0.0)
        fit = fit_guideway(data.q, data.P)
        # the line absorbs nothing of errors that have neither constant nor slope
        assert np.max(np.abs(fit.v - V)) < 1e-9 and np.max(np.abs(fit.P0 - P0)) < 1e-9
        s = fit.statistics()
        assert s["along_mean"] == pytest.approx(ALONG[number], rel=1e-4)
        assert s["across_mean"] == pytest.approx(ACROSS[number], rel=1e-4)
        # Table 4.2 is not a decomposition of Table 4.1, yet of its size
        assert s["mean"] == pytest.approx(MEAN[number], rel=0.25)
        assert 0 < s["std"] < s["mean"] < s["max"]

    def test_residuals_are_those_of_polyfit_and_split_at_a_right_angle(self):
        data = cart(1, seed=3)
        fit = fit_guideway(data.q, data.P)
        lines = [np.polynomial.Polynomial.fit(data.q, data.P[:, k], 1) for k in range(3)]
        expected = data.P - np.column_stack([line(data.q) for line in lines])
        assert np.max(np.abs(fit.e - expected)) < ROUND_OFF
        assert np.max(np.abs(fit.across @ fit.v)) < ROUND_OFF
        assert np.max(np.abs(np.outer(fit.along, fit.direction) + fit.across - fit.e)) < ROUND_OFF
        size = np.linalg.norm(fit.e, axis=1)
        assert np.max(np.abs(size**2 - fit.along**2 - np.sum(fit.across**2, axis=1))) < ROUND_OFF * UM
        s = fit.statistics()
        assert s["mean"] == pytest.approx(size.mean()) and s["std"] == pytest.approx(size.std(ddof=1))

    def test_e_along_is_a_length_also_where_v_is_not_unit(self):
        # printed e.v would be four per cent short of the 50 um put in on a camera-calibrated set
        v = 0.964 * UNIT
        q = np.linspace(0, 1, 5)
        bump = 50 * UM * np.array([1, -2, 0, 2, -1])  # orthogonal to constant and slope
        bump -= np.polynomial.Polynomial.fit(q, bump, 1)(q)
        fit = fit_guideway(q, np.outer(q, v) + np.outer(bump, UNIT))
        assert np.max(np.abs(fit.along - bump)) < ROUND_OFF
        assert np.max(np.abs(fit.e @ fit.v - bump)) > 0.03 * np.max(np.abs(bump))

    def test_the_part_with_these_deviations_goes_through_the_points(self):
        data = cart(2, seed=5)
        order = np.random.default_rng(0).permutation(len(data.q))
        fit = fit_guideway(data.q[order], data.P[order])

        slide = Slide(guideway=m.PiecewiseLinearGuideway(A=fit.P0, v=fit.v, **fit.modifiers()))
        r, status = slide.causal("q", "r")(data.q)
        assert np.all(status == 0) and np.max(np.abs(r - data.P)) < ROUND_OFF

    def test_repeated_places_are_averaged_and_deviations_turned(self):
        q = np.array([0.0, 1.0, 1.0, 2.0])
        P = np.outer(q, V) + 1e-5 * np.random.default_rng(1).normal(size=(4, 3))
        fit = fit_guideway(q, P)
        R = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
        got = fit.modifiers(R)
        assert list(got["at"]) == [0, 1, 2]
        assert np.allclose(got["deviation"][1], R @ (fit.e[1] + fit.e[2]) / 2, atol=ROUND_OFF)

    Q, P = np.linspace(0, 1, 6), np.outer(np.linspace(0, 1, 6), V)

    @pytest.mark.parametrize(
        ("q", "P", "sentence"),
        [
            (Q[:2], P[:2], "need at least 3 points; found 2"),
            (Q, P[:, :2], r"points of shape \(n, 3\); found \(6,\) and \(6, 2\)"),
            (np.where(Q == 0.4, np.nan, Q), P, "row 2 .* is not finite; remove such rows"),
            (Q, np.where(Q[:, None] > 0.5, np.inf, P), "row 3 and 2 more"),
            (Q, 1e3 * P, "997.7|999.7.* m per metre of q.*one of them is in millimetres"),
            (1e3 * Q, P, "1000 m, more than 20 m; give metres, not millimetres"),
            (90 * Q, 90 * P, "90 m, more than 20 m; give metres, not millimetres"),
            (20.5 * Q, 20.5 * P, "20.5 m, more than 20 m; give metres"),
            (0.01e3 * Q, 1e-3 * P, "do not move|move .* in millimetres|move by less"),
            (0 * Q, P, "q spans only 0 m; the cart has to move"),
            (Q, 0 * P, "move by less than 1 mm while q spans 1 m"),
            (Q, 3 * P, "move 2.999 m per metre of q.*check the units"),
        ],
    )
    def test_wrong_measurements(self, q, P, sentence):
        with pytest.raises(MeasurementError, match=sentence):
            fit_guideway(q, P)

    @pytest.mark.parametrize("span", np.geomspace(0.0201, 19.9, 7))
    def test_every_length_is_taken_in_one_unit_only(self, span: float) -> None:
        fit_guideway(span * self.Q, span * self.P)
        with pytest.raises(MeasurementError, match="give metres, not millimetres"):
            fit_guideway(1e3 * span * self.Q, 1e3 * span * self.P)
        # a gantry of 60 m may be said to be one
        assert fit_guideway(60 * self.Q, 60 * self.P, longest=80.0).v == pytest.approx(V, rel=1e-12)


class TestBacklash:
    @pytest.mark.parametrize(
        ("q", "P", "sentence"),
        [
            (1.0, 1e3, "one of them is in millimetres"),
            (30.0, 30.0, "more than 20 m; give metres"),
            (1.0, np.diag([1.0, -1.0, 1.0]), "lines .* deg apart"),
        ],
    )
    def test_a_backward_run_in_other_units_or_of_another_guideway_is_refused(self, q, P, sentence) -> None:
        forward = np.linspace(0, 1, 20)
        points = np.outer(forward, [0.6, 0.7, 0.3871])
        with pytest.raises(MeasurementError, match=sentence):
            backlash(forward, points, q * forward[::-1], points[::-1] @ (P * np.eye(3)))

    def runs(self, width: float, seed: int, noise: float = 3e-6, shift: float = 0.0):
        data = cart(1, seed, points=60, noise=0.0)
        rng = np.random.default_rng(seed + 1)
        q_b = data.q[::-1] + shift
        back = np.column_stack([np.interp(q_b, data.q, data.P[:, k]) for k in range(3)])
        forward = data.P - np.outer(np.full(60, width / 2), UNIT) + noise * rng.normal(size=(60, 3))
        return data.q, forward, q_b, back + width / 2 * UNIT + noise * rng.normal(size=(60, 3))

    def test_forty_micrometres_within_the_interval(self):
        # the width of Fig. 4.3; synthetic
        found = [backlash(*self.runs(40e-6, seed)) for seed in range(100)]
        covered = sum(low <= 40e-6 <= high for low, high in (b.interval("width") for b in found))
        assert 88 <= covered <= 100  # 95 of 100 expected; fewer than 88 has a chance of 0.15 per cent
        with pytest.raises(ArgumentError, match="'across' was not estimated"):
            found[0].interval("across")
        spread = np.std([b.width for b in found], ddof=1)
        assert spread == pytest.approx(np.mean([b.standard_error for b in found]), rel=0.25)
        assert all(b.significant and b.pairs == 60 for b in found)
        assert np.max([np.linalg.norm(b.across) for b in found]) < 5e-6

    def test_none_is_seldom_found(self):
        assert sum(backlash(*self.runs(0.0, seed)).significant for seed in range(60)) <= 9  # 3 expected

    def test_places_between_the_others(self):
        q, forward, q_b, back = self.runs(40e-6, 3, shift=0.007)
        inside = q_b <= q[-1]
        b = backlash(q, forward, q_b[inside], back[inside])
        # straight lines between smooth errors 23 mm apart
        assert b.width == pytest.approx(40e-6, abs=3e-6) and b.pairs == 58

    def test_swapped_runs_are_negative_play(self):
        q, forward, q_b, back = self.runs(40e-6, 4)
        b = backlash(q, back[::-1], q_b, forward[::-1])
        assert b.width == pytest.approx(-40e-6, abs=3e-6) and b.significant

    def test_wrong_runs(self):
        q, forward, q_b, back = self.runs(40e-6, 5)
        with pytest.raises(MeasurementError, match=r"q of the backward run has to fall .* does not at 59 of 59"):
            backlash(q, forward, q_b[::-1], back[::-1])
        with pytest.raises(MeasurementError, match="q of the forward run has to rise"):
            backlash(q_b, back, q_b, back)
        with pytest.raises(MeasurementError, match="0 places in common, at least 3"):
            backlash(q, forward, q_b + 3.0, back + 3.0 * V)


class TestCyclic:
    def noisy(self, seed: int, amplitude: float = 20e-6, period: float = 0.0131, points: int = 250):
        rng = np.random.default_rng(seed)
        q = np.sort(rng.uniform(-0.65, 0.7, points))
        along = amplitude * np.sin(2 * np.pi * q / period + 0.4)
        return fit_guideway(q, np.outer(q, V) + np.outer(along, UNIT) + 10e-6 * rng.normal(size=(points, 3)))

    def test_period_and_amplitude_within_their_errors(self):
        found = [cyclic_term(self.noisy(seed)) for seed in range(15)]
        assert all(c.significant and c.aliases == () for c in found)
        z = [(c.period - 0.0131) / c.period_error for c in found] + [
            (c.amplitude - 20e-6) / c.amplitude_error for c in found
        ]
        assert np.max(np.abs(z)) < 4 and 0.6 < np.std(z) < 1.5
        c = found[0]
        assert c.period_error < 2e-5 and c.amplitude_error < 2e-6
        assert np.arctan2(c.cosine, c.sine) == pytest.approx(0.4, abs=0.15)

    def test_noise_alone_is_not_found(self):
        assert sum(cyclic_term(self.noisy(seed, amplitude=0.0)).significant for seed in range(12)) == 0

    @pytest.mark.parametrize(("chance", "low", "high"), [(0.2, 23, 57), (0.05, 2, 20)])
    def test_false_alarms_are_as_frequent_as_they_say(self, chance, low, high):
        # synthetic white noise, 200 runs: within three standard deviations of the binomial law
        assert low <= np.sum(self.alarms() < chance) <= high

    @staticmethod
    @cache
    def alarms() -> np.ndarray:
        q = np.linspace(0, 1, 21)
        noise = 1e-5 * np.random.default_rng(6).normal(size=(200, 21, 3))
        return np.array([cyclic_term(fit_guideway(q, np.outer(q, V) + e)).false_alarm for e in noise])

    def test_a_fit_that_does_not_end_has_infinite_errors(self):
        # synthetic noise at eight places; sine and cosine of about two points per period grow without end
        q = np.linspace(0, 1, 8)
        noise = 1e-5 * np.random.default_rng(1446).normal(size=(8, 3))
        c = cyclic_term(fit_guideway(q, np.outer(q, [1, 0, 0]) + noise))
        assert c.period_error == np.inf and c.amplitude_error == np.inf
        assert np.isfinite(c.period) and np.isfinite(c.amplitude) and not c.significant

    def test_the_strongest_is_that_of_least_squares(self):
        rng = np.random.default_rng(8)
        q, e = np.sort(rng.uniform(size=30)), rng.normal(size=30)
        frequencies = np.linspace(2, 14, 61)
        columns = [np.ones(30), q]
        left = [
            np.linalg.lstsq(np.column_stack([*columns, np.sin(w * q), np.cos(w * q)]), e)[1][0]
            for w in 2 * np.pi * frequencies
        ]
        best, chance = strongest(q, e, frequencies)
        assert best == np.argmin(left)
        # no smaller than for one frequency, no greater than for as many as were tried, each by itself
        single = (np.min(left) / np.linalg.lstsq(np.column_stack(columns), e)[1][0]) ** 13
        assert single < chance < 61 * single
        assert strongest(q, e + 100 * np.sin(2 * np.pi * 5 * q), frequencies)[1] < 1e-20

    def test_the_part_with_this_term_has_its_offset(self):
        c = cyclic_term(self.noisy(2))
        part = m.PiecewiseLinearCyclicGuideway(at=[0.0, 1.0], deviation=np.zeros((2, 3)), **c.modifiers(UNIT))
        assert part.period == c.period and np.allclose(part.sine, c.sine * UNIT)

    def test_even_points_cannot_tell_aliases(self):
        # teeth every 13.1 mm seen every 50 mm look like a much longer wave (Dressler 2012, section 4.2)
        q = np.arange(-0.65, 0.7001, 0.05)
        along = 40e-6 * np.sin(2 * np.pi * q / 0.0131)
        c = cyclic_term(fit_guideway(q, np.outer(q, V) + np.outer(along, UNIT)))
        assert c.significant and c.period > 0.1
        assert np.min(np.abs(np.array(c.aliases) - 0.0131)) < 1e-4
        shorter = cyclic_term(fit_guideway(q, np.outer(q, V) + np.outer(along, UNIT)), periods=(0.0125, 0.014))
        assert shorter.period == pytest.approx(0.0131, rel=1e-3)

    def test_a_perfect_guideway(self):
        q = np.linspace(0, 1, 9)
        c = cyclic_term(fit_guideway(q, np.outer(q, [1.0, 0.0, 0.0])))
        assert not c.significant and c.amplitude < 1e-12

    def test_wrong_questions(self):
        fit = self.noisy(1, points=100)
        with pytest.raises(MeasurementError, match="at least 8 places; found 6"):
            cyclic_term(fit_guideway(TestFit.Q, TestFit.P + 1e-5 * np.eye(6, 3)))
        with pytest.raises(MeasurementError, match="cannot be searched; expected 0 < shortest < longest"):
            cyclic_term(fit, periods=(0.2, 0.1))
        with pytest.raises(MeasurementError, match="frequencies; raise the shortest period"):
            cyclic_term(fit, periods=(1e-6, 0.1))
