"""Pictures of vibration models: order, held-out prediction, frequency response, decay, step response, poles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from ..linear.state_space import continuous_poles
from .style import BLUE, GREEN, MEASURED, MODELLED, ORANGE, colour, curve, key_below, styled, with_panels

GREY = "#777777"
POINTS = 1200  # of a frequency response
PEAK = np.linspace(-8, 8, 65)  # additional points around a peak, in half widths
MARKERS = "xo+s^dv*"
MOST_RIGHT_ANGLES = 5  # ticks every 90 degrees on the phase axis; beyond, every 180 degrees
MOST_NAMED = 6  # modes in a title
WINDOW = 3.0  # s of a long recording that are drawn
Sampled = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@styled
def order_figure(
    singular_values: np.ndarray, trials: Sequence[tuple[int, float | None]], chosen: int, *, title: str = ""
) -> Figure:
    """Draw singular values, and the rms error [m] on held-out samples by order; None: unstable, drawn as a cross."""
    figure, (left, right) = with_panels(8.0, 3.8, columns=2, title=title)
    count = min(len(singular_values), 2 * max(n for n, _ in trials))
    relative = np.maximum(singular_values[:count] / singular_values[0], 1e-16)
    left.semilogy(np.arange(1, count + 1), relative, "o", color=BLUE, markersize=4)
    left.axvline(chosen + 0.5, color=ORANGE, linestyle="--", linewidth=1)
    left.set(
        xlabel="number of the singular value",
        ylabel="singular value / largest one [1]",
        title="singular values of the data",
    )
    stable = [(n, 1e6 * e) for n, e in trials if e is not None]
    right.semilogy([n for n, _ in stable], [e for _, e in stable], "o-", color=BLUE, markersize=4)
    unstable = [n for n, e in trials if e is None]
    if unstable:
        top = max(e for _, e in stable) if stable else 1.0
        right.plot(unstable, [top] * len(unstable), "x", color=ORANGE, label="unstable")
    right.axvline(chosen, color=ORANGE, linestyle="--", linewidth=1, label=f"chosen order: {chosen}")
    right.set(xlabel="order", ylabel="rms error [µm]", title="error on held-out samples")
    right.xaxis.get_major_locator().set_params(integer=True)
    key_below(figure, right)
    return figure


@styled
def prediction_figure(
    time: np.ndarray, y: np.ndarray, predicted: np.ndarray, first: int, fit: np.ndarray, *, title: str = ""
) -> Figure:
    """Draw measured and predicted outputs (N, p) [m] at the start of the held-out samples; fit: (p,) in percent."""
    rows = slice(first, min(len(time), first + max(int(WINDOW / (time[1] - time[0])), 2)))
    figure, panels = with_panels(8.0, 1.2 + 2.0 * y.shape[1], y.shape[1], title=title, sharex=True)
    for k, axes in enumerate(panels):
        axes.plot(time[rows], 1e3 * predicted[rows, k], label="predicted", **MODELLED)
        axes.plot(time[rows], 1e3 * y[rows, k], label="measured", **MEASURED)
        axes.set(ylabel=f"position {k + 1} [mm]", title=f"position {k + 1}: fit {fit[k]:.4g} %")
    panels[-1].set(xlabel="time [s]")
    key_below(figure, panels[0])
    return figure


@styled
def response_figure(
    system: Sampled, sample_time: float, modes_Hz: Sequence[float] | np.ndarray, *, title: str = "", unit: str = "m/N"
) -> Figure:
    """Draw magnitude and phase from each input to each output up to the Nyquist frequency, with the modes as lines."""
    nyquist = 0.5 / sample_time
    low = min(0.2 * min(modes_Hz), 0.1 * nyquist) if len(modes_Hz) else 1e-3 * nyquist
    A, B, C, D = system
    f = _lines(np.linalg.eigvals(A), sample_time, np.geomspace(low, 0.999 * nyquist, POINTS))
    z = np.exp(2j * np.pi * f * sample_time)
    G = C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, B.astype(complex)) + D
    figure, (size, phase) = with_panels(8.0, 5.4, 2, title=title, grid=False, sharex=True, height_ratios=[2, 1])
    for i in range(G.shape[1]):
        for j in range(G.shape[2]):
            label = f"position {i + 1}" + (f", input {j + 1}" if G.shape[2] > 1 else "")
            look = curve(i * G.shape[2] + j)
            size.loglog(f, np.abs(G[:, i, j]), label=label, **look)
            phase.semilogx(f, np.rad2deg(np.unwrap(np.angle(G[:, i, j]))), **look)
    for n, mode in enumerate(modes_Hz):
        for axes in (size, phase):
            axes.axvline(mode, color=GREY, linestyle=":", linewidth=1, label="mode" if n == 0 else None)
    frequencies = ", ".join(f"{mode:.4g}" for mode in modes_Hz[:MOST_NAMED]) + ", ..." * (len(modes_Hz) > MOST_NAMED)
    size.set_title(f"modes at {frequencies} Hz" if len(modes_Hz) else "no modes")
    size.set(ylabel=f"magnitude [{unit}]")
    phase.set(xlabel="frequency [Hz]", ylabel="phase [deg]")
    phase.yaxis.set_major_locator(MultipleLocator(90 if np.ptp(phase.get_ylim()) < MOST_RIGHT_ANGLES * 90 else 180))
    for axes in (size, phase):
        axes.grid(alpha=0.3, which="both")
    key_below(figure, size)
    return figure


def _lines(poles: np.ndarray, sample_time: float, f: np.ndarray) -> np.ndarray:
    """Return f (k,) [Hz] with points added around the peaks of the poles z (n,), which even a fine grid may miss."""
    with np.errstate(divide="ignore"):
        s = continuous_poles(poles, sample_time) / (2 * np.pi)
    s = s[np.isfinite(s) & (s.imag > 0)]
    more = (s.imag[:, None] + np.abs(s.real)[:, None] * PEAK).ravel()
    return np.union1d(f, more[(more > f[0]) & (more < f[-1])])


@styled
def step_figure(
    runs: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]],
    by_delay: Mapping[int, float],
    delay: int,
    *,
    title: str = "",
) -> Figure:
    """Draw recordings (time, reference, measured, model; (N,) [s, m]) and the rms error [m] over the delay."""
    figure, (left, right) = with_panels(8.0, 4.0, columns=2, title=title, width_ratios=[2, 1])
    for n, (time, u, y, model) in enumerate(runs):
        left.plot(time, 1e3 * model, label="model" if n == 0 else None, **MODELLED)
        left.plot(time, 1e3 * y, label="measured" if n == 0 else None, **MEASURED)
        left.plot(time, 1e3 * u, "--", color=GREY, linewidth=0.8, zorder=4, label="reference" if n == 0 else None)
    left.set(xlabel="time [s]", ylabel="position [mm]", title="step responses")
    right.plot(list(by_delay), [1e6 * e for e in by_delay.values()], "o-", color=BLUE, markersize=3)
    right.axvline(delay, color=ORANGE, linestyle="--", linewidth=1, label=f"chosen delay: {delay}")
    right.set(xlabel="delay [samples]", ylabel="rms error [µm]", yscale="log", title="error by delay")
    key_below(figure)
    return figure


@styled
def decay_figure(
    time: np.ndarray, y: np.ndarray, fitted: np.ndarray, rest: np.ndarray, peaks_Hz: Sequence[float], *, title: str = ""
) -> Figure:
    """Draw decays (N, p) [m] with the fit, and their spectra with the detected peaks."""
    p = y.shape[1]
    figure, panels = with_panels(9.0, 1.4 + 1.9 * p, p, 2, title=title, sharex="col")
    panels = panels.reshape(p, 2)
    f = np.fft.rfftfreq(len(time), time[1] - time[0])
    top = min(f[-1], 4 * max(peaks_Hz))
    for k, (left, right) in enumerate(panels):
        left.plot(time, 1e3 * fitted[:, k], label="fitted damped sines", **MODELLED)
        left.plot(time, 1e3 * y[:, k], label="measured", **MEASURED)
        left.set(ylabel=f"position {k + 1} [mm]")
        for values, look in ((fitted, MODELLED), (y, dict(color="black", linewidth=0.8, zorder=3))):
            spectrum = np.abs(np.fft.rfft(values[:, k] - rest[k])) * (time[1] - time[0])
            right.semilogy(f[1:], spectrum[1:], **look)
        for n, peak in enumerate(peaks_Hz):
            right.axvline(peak, color=GREY, linestyle=":", linewidth=1, label="peak" if n == 0 else None)
        right.set(ylabel="spectrum [m s]", xlim=(0, top))
    panels[0, 0].set_title("decay")
    panels[0, 1].set_title("spectrum; peaks at " + ", ".join(f"{peak:.4g}" for peak in peaks_Hz) + " Hz")
    key_below(figure, *panels[0])
    panels[-1, 0].set(xlabel="time [s]")
    panels[-1, 1].set(xlabel="frequency [Hz]")
    return figure


@styled
def poles_figure(poles: Mapping[str, np.ndarray], circles_Hz: np.ndarray, *, title: str = "") -> Figure:
    """Draw poles [1/s] by name in the complex plane, divided by 2 pi, with circles at undamped frequencies."""
    figure, (axes,) = with_panels(6.6, 6.4)
    angle = np.linspace(0, 2 * np.pi, 361)
    for radius in circles_Hz:
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), color=GREY, linewidth=0.8, linestyle=":")
        axes.annotate(f"{radius:.5g} Hz", (0, radius), xytext=(3, 3), textcoords="offset points", fontsize=8)
    for n, (name, values) in enumerate(poles.items()):
        marker, c = MARKERS[n % len(MARKERS)], (ORANGE, BLUE, GREEN)[n] if n < 3 else colour(n)
        fill = "none" if marker == "o" else c
        real, imaginary = np.real(values) / (2 * np.pi), np.imag(values) / (2 * np.pi)
        axes.plot(real, imaginary, marker, linestyle="none", color=c, label=name, markersize=8, markerfacecolor=fill)
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set(xlabel="real part / 2 pi [Hz]", ylabel="imaginary part / 2 pi [Hz]", title=title, aspect="equal")
    key_below(figure, axes, columns=3)
    return figure
