"""What pictures hold is what they were given: every curve, at its place, told from the others, at its true height."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.transforms import Bbox
from scipy.signal import cont2discrete

from gtmodel.inference import autocorrelation
from gtmodel.plot.calibration import deviations_figure, predicted_figure
from gtmodel.plot.identification import efforts_figure, information_figure, levels_figure
from gtmodel.plot.milling import angle_figure, compensation_figure, lobes_figure
from gtmodel.plot.motion import motion_figure, space_figure, swing_figure
from gtmodel.plot.residuals import residuals_figure
from gtmodel.plot.robot3d import robot_figure
from gtmodel.plot.signals import signals_figure, tracking_figure
from gtmodel.plot.style import settings
from gtmodel.plot.vibration import poles_figure, response_figure
from gtmodel.results.trajectory import Trajectory

MANY = 11  # more than there are colours
TIME = np.linspace(0.0, 1.0, 20)
NAN = np.nan


def all_different(axes: Any, count: int) -> bool:
    lines = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
    looks = {(line.get_color(), line.get_linestyle(), line.get_marker()) for line in lines}
    return len(lines) == len(looks) == count


def test_no_line_joins_two_recordings() -> None:
    """Each recording has its own clock: drawn as they are, a line would run from the end of one to the next's start."""
    times, efforts = np.concatenate([TIME, TIME]), np.arange(40.0)[:, None]
    lines = [line for axes in efforts_figure(times, efforts, 0.9 * efforts, ["tau"], "N").axes for line in axes.lines]
    assert len(lines) == 3
    for line in lines:
        x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
        drawn = np.isfinite(x)
        assert np.all(np.diff(x[drawn]) > 0) and drawn.sum() == 40 and not drawn[20] and np.isnan(y[20])
        assert np.allclose(np.diff(x[21:]), np.diff(TIME))


def test_no_motion_is_missing_and_each_has_a_look_of_its_own() -> None:
    names = [f"m{k}" for k in range(MANY)]
    swing = swing_figure({n: (TIME, np.outer(TIME, np.ones(3))) for n in names}, TIME, dict.fromkeys(names, TIME))
    assert all(all_different(axes, MANY) for axes in swing.axes)
    run = Trajectory(TIME, {"T": np.ones((20, 3)), "q": np.ones((20, 3))}, {})
    tracking = tracking_figure(run, dict.fromkeys(names, run))
    assert all(all_different(axes, MANY) for axes in tracking.axes[3:])
    assert all(all_different(axes, MANY + 1) for axes in tracking.axes[:3])
    assert all_different(compensation_figure(TIME, TIME, dict.fromkeys(names, TIME)).axes[0], MANY + 1)
    poles: Any = poles_figure({n: np.array([-1 + 5j]) for n in names[:6]}, np.array([5.0])).axes[0]
    assert all_different(poles, 6)
    forces = Trajectory(TIME, {"T": np.ones((20, 3)), "der(T)": np.ones((20, 3)), "tau": np.ones((20, MANY))}, {})
    assert len(motion_figure(forces, force_limit=1.0).axes[3].get_lines()) == MANY + 2


@pytest.mark.parametrize("widths", [(1,) * 12, (3,) * 6, (12,), (2, 0, 5, 0, 3), (8, 8, 8, 8)])
def test_signals_of_one_unit_look_different(widths: tuple[int, ...]) -> None:
    signals = {f"s{k}": np.ones((20, w)) if w else np.ones(20) for k, w in enumerate(widths)}
    axes = signals_figure(Trajectory(TIME, signals, dict.fromkeys(signals, "m"))).axes[0]
    assert all_different(axes, sum(w or 1 for w in widths))


@pytest.mark.parametrize("count", [1, 2, 3, 5, 9])
def test_bars_stand_about_their_harmonic_and_name(count: int) -> None:
    told = {f"m{k}": [0.1, 0.2] for k in range(count)}
    figure = information_figure(
        {n: np.ones(2) for n in told}, ["p", "q"], told, amplitudes=np.ones((4, count)), frequency=0.5
    )
    for axes, first, apart in ((figure.axes[1], 0.0, 1.0), (figure.axes[2], 0.5, 0.5)):
        bars: Any = axes.patches
        middle = np.array([b.get_x() + b.get_width() / 2 for b in bars]).reshape(count, -1)
        places = first + apart * np.arange(middle.shape[1])
        assert np.allclose(middle.mean(axis=0), places)
        assert np.all(np.abs(middle - places) + bars[0].get_width() / 2 < 0.45 * apart)


@pytest.mark.parametrize("zeta", [0.02, 1e-3, 1e-5])
def test_a_sharp_peak_has_its_height(zeta: float) -> None:
    w, h = 2 * np.pi * 50.0, 1e-3
    A, B = np.array([[0.0, 1.0], [-(w**2), -2 * zeta * w]]), np.array([[0.0], [1.0]])
    found: Any = cont2discrete((A, B, np.array([[1.0, 0.0]]), np.zeros((1, 1))), h)
    line: Any = response_figure(found[:4], h, [50.0]).axes[0].get_lines()[0]
    assert np.max(line.get_ydata()) == pytest.approx(1 / (2 * zeta * w**2), rel=0.02)


def test_space_has_one_scale() -> None:
    run = Trajectory(TIME, {"T": np.outer(TIME, [1.0, 2.0, 4.0])}, {"T": "m"})
    axes: Any = space_figure([("a", run)]).axes[0]
    sizes = np.array([np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()), np.ptp(axes.get_zlim())])
    assert np.allclose(sizes / axes._box_aspect, (sizes / axes._box_aspect)[0])


def test_one_missing_number_takes_nothing_else_away() -> None:
    speeds, forces = np.array([[0.1], [NAN], [0.4]]), np.array([[1.0], [NAN], [2.0]])
    lines = levels_figure([("p", speeds, forces)], [np.sign], np.zeros(1)).axes[0].get_lines()
    assert np.max(np.asarray(lines[0].get_xdata())) == pytest.approx(1.05 * 0.4)
    space: Any = predicted_figure(np.eye(3), np.array([1e-6, NAN, 3e-6]), np.array([1e-6, NAN, 2e-6])).axes[0]
    assert "worst: 3 µm at (0, 0, 1) m" in space.get_title()


@pytest.mark.parametrize("std", [[1e-3, 1e-4], [1e-3, 1e-3], [1e-3, 0.0], [2e-3, 5e-5]])
def test_the_least_deviation_has_a_bar(std: list[float]) -> None:
    for units in (["m", "m"], ["m", "1"]):
        panels = deviations_figure(["a", "b"], np.array(std), units).axes
        assert len(panels) == len(set(units))
        for axes, own in zip(panels, [std] if len(panels) == 1 else [[s] for s in std], strict=True):
            low, high = axes.get_xlim()  # of millionths
            shown = [1e6 * s for s in own]
            assert low < min((s for s in shown if s > 0), default=np.inf) and high >= max(shown)


@pytest.mark.parametrize("size", [1e-10, 1e-4, 10.0])
def test_indices_of_any_size_have_numbers(size: float) -> None:
    angles = np.linspace(-3.0, 3.0, 61)
    index = size * (2 + np.cos(angles))
    none = np.full((61, 3), NAN)
    axes = angle_figure(angles, index, NAN * index, none, [25.0], reachable=np.ones(61, bool)).axes[0]
    low, high = axes.get_ylim()
    assert sum(low <= tick <= high for tick in axes.get_yticks()) >= 1


def test_an_unknown_depth_is_not_drawn_as_stable() -> None:
    speed, depth = np.linspace(10.0, 100.0, 5), 1e-3 * np.array([1.0, NAN, 2.0, np.inf, 1.0])
    axes: Any = lobes_figure(speed, depth, (50.0, 1e-3)).axes[0]
    corners: Any = axes.collections[0].get_paths()[0].vertices
    lowest = [corners[np.isclose(corners[:, 0], 60 * s), 1].min() for s in speed]
    assert np.allclose(lowest, [1.0, 0.0, 2.0, axes.get_ylim()[1], 1.0])


def test_the_least_of_the_predicted_deviations_has_a_bar() -> None:
    axes = information_figure({"a": np.ones(2)}, ["p", "q"], {"a": [0.1, 0.2], "b": [0.1, NAN]}).axes[1]
    assert axes.get_ylim()[0] < 0.5 * 10.0


def test_a_cut_beside_the_lobes_is_said() -> None:
    speed = np.linspace(10.0, 100.0, 20)
    for at, said in ((50.0, "declared cut"), (500.0, "declared cut at 30000 rpm, not shown")):
        legend: Any = lobes_figure(speed, 1e-3 * np.ones(20), (at, 1e-3)).legends[0]
        assert said in [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("sides", [(3.0, 0.5, 0.5), (0.5, 0.5, 3.0), (1.0, 4.0, 2.0)])
def test_a_picture_in_space_fills_its_room_and_covers_nothing(sides: tuple[float, float, float]) -> None:
    with settings():
        carts, joints = np.zeros((3, 3)), np.tile(sides, (3, 1))
        figure = robot_figure(carts, joints, joints[0], np.eye(3), ends=np.zeros((3, 2, 3)), title="a robot")
        figure.draw_without_rendering()
        axes: Any = figure.axes[0]
        names = [axis.get_tightbbox(None) for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
        (legend,), (title,) = figure.legends, figure.texts
        for box in names:
            assert legend.get_window_extent().y1 < box.y0 and box.y1 < title.get_window_extent().y0
            assert 0.0 < box.x0 and box.x1 < figure.bbox.x1
        whole = Bbox.union(names)
        room = title.get_window_extent().y0 - legend.get_window_extent().y1
        assert whole.height > 0.75 * room or whole.width > 0.75 * figure.bbox.width


def test_residuals_of_white_noise_lie_on_the_curves_and_of_a_slow_wave_do_not() -> None:
    """The normal plot's points and the density's area by hand; the autocorrelation of a sine by its closed form."""
    noise = np.random.default_rng(7).normal(2.0, 0.5, 4000)
    wave = np.sin(2 * np.pi * np.arange(4000) / 400)
    rho = [autocorrelation(r, 40)[1:] for r in (noise, wave, wave)]
    figure = residuals_figure([noise, wave, np.append(wave, NAN)], ["a", "b", "c"], ["N"] * 3, rho)
    (_, histogram, normal, lags), (_, _, _, slow) = np.array(figure.axes).reshape(3, 4)[:2]
    area = sum(bar.get_height() * bar.get_width() for bar in histogram.patches)
    assert area == pytest.approx(1.0)
    points, line = (np.array(drawn.get_xydata()) for drawn in normal.get_lines()[:2])
    slope = (line[1, 1] - line[0, 1]) / (line[1, 0] - line[0, 0])
    assert slope == pytest.approx(np.std(noise, ddof=1))
    deviations = np.abs(points[:, 1] - 2.0 - 0.5 * points[:, 0])[np.abs(points[:, 0]) < 2]
    assert deviations.max() < 0.06  # four standard deviations of an order statistic at 2 sigma, 0.5 sqrt(p q / n) / pdf
    tall = [abs(segment[1][1]) > 1.96 / np.sqrt(4000) for segment in lags.collections[0].get_segments()]
    assert sum(tall) <= 7  # of 40 at 5 %: more than 7 has probability 0.001
    by_hand = np.cos(2 * np.pi * np.arange(1, 41) / 400)
    drawn = np.array([segment[1][1] for segment in slow.collections[0].get_segments()])
    assert np.allclose(drawn, by_hand, atol=0.02)  # the sum of a lag has n - k of n terms
