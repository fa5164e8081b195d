"""Receptance of a tool, displacement over force by frequency with its noise and coherence, from records of hits; and
experiments, a receptance at a pose, from such records or from CSV files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ...lang.units import UnitError, convert, parse_unit
from ...measurements.signal_table import CsvTable
from ...results import ArgumentError
from ...results.disk import path_of
from .options import ModalFitting

Response = Literal["acceleration", "velocity", "displacement"]
ORDER = {"displacement": 0, "velocity": 1, "acceleration": 2}  # order of the time derivative
UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s2"}

# relative to the largest power: a line below it is round-off, 1e-13 of the amplitude
SILENT = 1e-26
TAPER = 0.1  # share of a force window in which it falls to zero
CUT = 0.1  # of a hit's peak: a force window that cuts off more has cut off a second hit
STILL = 0.05  # of the response's peak: largest remainder at the end of a record, because of leakage
SEEN = 5.0  # standard deviations of noise: a larger response is significant
POOL = 41  # lines over which the noise of the response is averaged


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Complex receptance H (n,) [m/N], x = H F, at ascending frequencies (n,) [Hz].

    `variance` (n,): expected squared absolute error of H [m2/N2], None if unknown; `coherence` (n,). `decay` [1/s]:
    exponential window on force and response; H then belongs exactly to s = j omega + decay. `wider`: factor on standard
    errors because that window correlates neighbouring lines. `hits`: number of averaged hits. `degrees_of_freedom` of
    each variance. `synthetic`: seed and noise of synthetic data.
    """

    frequency: np.ndarray
    receptance: np.ndarray
    variance: np.ndarray | None = None
    coherence: np.ndarray | None = None
    decay: float = 0.0
    wider: float = 1.0
    hits: int = 1
    degrees_of_freedom: float = np.inf
    synthetic: str | None = None

    def __post_init__(self) -> None:
        f, H = self.frequency, self.receptance
        if f.ndim != 1 or f.shape != H.shape or len(f) < 3:
            raise ValueError(
                f"frequencies {f.shape} and receptance {H.shape} differ; expected (n,) each, with n of 3 or more"
            )
        if not (np.all(np.isfinite(f)) and np.all(np.isfinite(H))):
            raise ValueError("a frequency response has numbers that are not finite; leave those lines out")
        if f[0] <= 0 or np.any(np.diff(f) <= 0):
            raise ValueError("frequencies must be above zero and ascending; sort the lines and leave out 0 Hz")
        v = self.variance
        if v is not None and (v.shape != f.shape or not np.all(v > 0)):
            raise ValueError(f"the variance has the shape {v.shape}; expected {f.shape}, all above zero")

    @property
    def s(self) -> np.ndarray:
        """Points of H in the Laplace plane [1/s]."""
        return 2j * np.pi * self.frequency + self.decay

    def between(self, low: float, high: float) -> FrequencyResponse:
        """The lines from low to high [Hz]. Raises ValueError for fewer than eight."""
        rows = (self.frequency >= low) & (self.frequency <= high)
        if np.count_nonzero(rows) < 8:
            raise ValueError(
                f"{np.count_nonzero(rows)} lines are between {low:.4g} and {high:.4g} Hz; expected 8 or more: record "
                "longer, or use a wider band"
            )
        arrays = [None if a is None else a[rows] for a in (self.variance, self.coherence)]
        return FrequencyResponse(
            self.frequency[rows], self.receptance[rows], arrays[0], arrays[1],
            self.decay, self.wider, self.hits, self.degrees_of_freedom, self.synthetic,
        )  # fmt: skip


def frequency_response(
    force: ArrayLike,
    response: ArrayLike,
    sample_rate: float,
    *,
    measures: Response = "acceleration",
    estimator: Literal["H1", "H2"] = "H1",
    force_window: float | None = None,
    decay: float = 0.0,
    synthetic: str | None = None,
) -> FrequencyResponse:
    """Return the receptance averaged over hits, from force [N] and response (hits, T) or (T,) at `sample_rate` [Hz].

    `measures`: acceleration [m/s2], velocity [m/s] or displacement [m]. H1 = G_xF / G_FF is unbiased for noise on the
    response, H2 = G_xx / G_Fx for noise on the force; lines without force are dropped. `force_window` [s]: the force is
    set to zero that long after each hit; `decay` [1/s]: exponential window on both signals, for records that end before
    the response has decayed. With two or more hits the coherence gives the noise of the response (H1) or of the force
    (H2), averaged over 41 lines.

    Raises ValueError for wrong shapes, a window that cuts off a second hit, and a response that has not decayed.

    >>> m, c, k = np.array([200.0]), np.array([4000.0]), np.array([3e6])  # kg, N.s/m, N/m
    >>> force, acceleration = gt.vibration.synthetic_hits(
    ...     m, c, k, sample_rate=1000.0, duration=4.0, hits=4, noise=0.01, seed=1
    ... )
    >>> measured = gt.vibration.frequency_response(force, acceleration, sample_rate=1000.0)
    >>> measured.hits, float(measured.frequency[0])  # Hz
    (4, 0.25)
    >>> near = np.searchsorted(measured.frequency, 15.0)
    >>> exact = gt.vibration.receptance(measured.s, m, c, k)
    >>> bool(abs(measured.receptance[near] / exact[near] - 1) < 0.01)
    True
    """
    from scipy import signal

    F, x = (np.atleast_2d(np.asarray(a, float)) for a in (force, response))
    if F.ndim != 2 or F.shape != x.shape or F.shape[1] < 16:
        raise ValueError(f"force {F.shape} and response {x.shape} differ; expected (hits, samples) each, 16 or more")
    if not (np.all(np.isfinite(F)) and np.all(np.isfinite(x))):
        raise ValueError("a record has numbers that are not finite; leave that hit out")
    if not (sample_rate > 0 and decay >= 0):
        raise ValueError(f"found a sample rate of {sample_rate:g} Hz and a decay of {decay:g} 1/s; expected above zero")
    T = F.shape[1]
    window = np.exp(-decay * np.arange(T) / sample_rate)
    if force_window is not None:
        F = _windowed(F, force_window, sample_rate)
    F, x = F * window, x * window
    _check_end(x, decay)

    def spectrum(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        # one segment per hit, without 0 Hz
        return signal.csd(a.ravel(), b.ravel(), sample_rate, "boxcar", T, 0, detrend=False)[1][1:]

    f = np.fft.rfftfreq(T, 1 / sample_rate)[1:]
    GFF, GFx, Gxx = np.real(spectrum(F, F)), spectrum(F, x), np.real(spectrum(x, x))
    for what, power in (("force", GFF), ("response", Gxx)):
        if power.max() <= 0:
            raise ValueError(f"the {what} is zero throughout; check the column of the record")
    # drop lines without force; H2 also divides by the part of the response that the force explains
    excited = GFF > SILENT * GFF.max()
    if estimator == "H2":
        excited &= np.abs(GFx) ** 2 > SILENT * GFF.max() * Gxx.max()
    f, GFF, GFx, Gxx = f[excited], GFF[excited], GFx[excited], Gxx[excited]
    derived = (2j * np.pi * f + decay) ** ORDER[measures]
    H = (GFx / GFF if estimator == "H1" else Gxx / GFx.conj()) / derived
    # a response of exactly zero has coherence zero
    coherence = np.minimum(np.abs(GFx) ** 2 / np.where(Gxx > 0, GFF * Gxx, 1.0), 1.0)
    hits = len(F)
    variance = None
    if hits > 1:
        # (1 - coherence) of n averages has lost one of n degrees of freedom
        noise = np.maximum(1 - coherence, np.finfo(float).eps) * hits / (hits - 1)
        if estimator == "H1":
            variance = _level(Gxx * noise) / (hits * GFF * np.abs(derived) ** 2)
        else:
            variance = _level(GFF * noise) / (hits * GFF) * np.abs(H) ** 2
    wider = float(np.sqrt(T / np.sum(window**2)))
    degrees_of_freedom = 2.0 * (hits - 1) * min(POOL, len(f)) / wider**2
    return FrequencyResponse(f, H, variance, coherence, decay, wider, hits, degrees_of_freedom, synthetic)


def command_force(command: ArrayLike, cycle: float) -> np.ndarray:
    """Return the equivalent force per unit of mass [m/s2] of position commands (T,) [m] at cycles of `cycle` s.

    F = step / cycle^2 for one cycle (Cvitanic 2021, eq. (30)). Masses and stiffnesses fitted to it are scaled (m
    without unit, c in 1/s, k in 1/s2); frequency and damping ratio are those of the arm. The matching response is the
    deviation from the delayed command. Raises ValueError for another shape and a cycle that is not positive.

    >>> gt.vibration.command_force([0.0, 0.0, 1e-3, 1e-3], cycle=0.004)
    array([ 0. , 0. , 62.5, 0. ])
    """
    u = np.asarray(command, float)
    if u.ndim != 1 or not cycle > 0:
        raise ValueError(f"expected commands (T,) and a cycle above zero; found {u.shape} and {cycle:g} s")
    return np.diff(u, prepend=u[:1]) / cycle**2


def _windowed(F: np.ndarray, length: float, rate: float) -> np.ndarray:
    """Each row set to zero from `length` seconds after its peak on; the last tenth falls smoothly."""
    from scipy.signal.windows import tukey

    n = round(length * rate)
    if n < 2:
        raise ValueError(f"a force window of {length:g} s is shorter than two samples at {rate:g} Hz")
    falling = tukey(2 * n, TAPER)[n:]
    windowed = F.copy()
    for k, row in enumerate(windowed):
        peak = int(np.argmax(np.abs(row)))
        if row[peak] == 0:
            raise ValueError(f"the force of hit {k + 1} is zero throughout; check the column of the record")
        end = min(peak + n, len(row))
        lost = np.abs(row[end:]).max(initial=0.0) / np.abs(row[peak])
        if lost > CUT:
            raise ValueError(
                f"hit {k + 1} has a second peak of {lost:.0%} of the first after the force window of {length:g} s: a "
                "double hit; leave it out, or use a longer window"
            )  # fmt: skip
        row[peak:end] *= falling[: end - peak]
        row[end:] = 0.0
    return windowed


def _check_end(x: np.ndarray, decay: float) -> None:
    """Check the last twentieth of each response by the means of its quarters, so that noise alone does not count."""
    last = x[:, -max(x.shape[1] // 20, 8) :]
    parts = np.array_split(last, 4, axis=1)
    size = np.array([np.abs(np.mean(part, axis=1)) for part in parts]).max(axis=0)
    # noise of such a mean, estimated from the differences of neighbours
    noise = SEEN * np.sqrt(np.mean(np.diff(last, axis=1) ** 2, axis=1) / 2 / parts[0].shape[1])
    remainder = np.where(size > noise, size, 0.0) / np.abs(x).max(axis=1)
    k = int(np.argmax(remainder))
    if remainder[k] > STILL:
        what = "set a decay, or record longer" if decay == 0 else "set a larger decay, or record longer"
        raise ValueError(
            f"the response of hit {k + 1} has not decayed: {remainder[k]:.0%} of its peak at the end; {what}"
        )


def _level(power: np.ndarray) -> np.ndarray:
    """Moving average over POOL lines, narrower at the ends."""
    half = min(POOL, len(power)) // 2
    total = np.concatenate([[0.0], np.cumsum(power)])
    k = np.arange(len(power))
    low, high = np.maximum(k - half, 0), np.minimum(k + half + 1, len(power))
    return (total[high] - total[low]) / (high - low)


_PLACE = {"x": "m", "y": "m", "z": "m", "A": "rad"}
_INDEX = "x [m],y [m],z [m],A [deg],direction,file"
_RECORD = "time [s],force [N],acceleration [m/s2]"
_RESPONSE = "frequency [Hz],real [m/N],imaginary [m/N]"
JITTER = 1e-3  # of the sample time
PER_FORCE = {"m/N": 0, "m/(N.s)": 1, "m/(N.s2)": 2}  # receptance, mobility, inertance: orders of s


@dataclass(frozen=True, eq=False)
class Experiment:
    """A frequency response at a pose (4,), x, y, z [m] and A [rad], in x, y or z (`direction` 0, 1, 2).

    source: name for messages; files: the files read, by their names in the index.
    """

    pose: np.ndarray
    direction: int
    response: FrequencyResponse
    source: str
    files: Mapping[str, Path] = field(default_factory=dict)


def read_experiments(index: str | Path, fit: ModalFitting | None = None) -> list[Experiment]:
    """Read all experiments of an index file, in the order of their first rows.

    index: CSV file with the columns x [m], y [m], z [m], A [deg], direction and file. Rows of the same pose and
    direction are hits of one experiment, unless a column `experiment` separates them. Files are looked up next to the
    index, then in the working directory. fit: estimator and windows of hits. Raises ArgumentError.
    """
    path, fit = path_of(index, "index"), fit or ModalFitting()
    table = CsvTable(path)
    for name in (*_PLACE, "direction", "file"):
        if name not in table.names:
            raise ArgumentError(f"{table.where}: there is no column '{name}'; expected {_INDEX}")
    poses = np.column_stack([_si(table, name, unit) for name, unit in _PLACE.items()])
    names = table.texts("experiment") if "experiment" in table.names else [""] * len(poses)
    groups: dict[tuple[object, ...], list[tuple[str, str]]] = {}
    for k, (direction, file) in enumerate(zip(table.texts("direction"), table.texts("file"), strict=True)):
        where = f"{path.name} line {table.lines[k]}"
        if direction not in ("x", "y", "z"):
            raise ArgumentError(f"{where}: found the direction '{direction}'; expected x, y or z")
        groups.setdefault((*poses[k].tolist(), direction, names[k]), []).append((file, where))
    experiments = []
    for key, files in groups.items():
        paths = {name: _existing(name, path.parent, where) for name, where in files}
        response = _response(files, fit, paths)
        experiments.append(Experiment(np.array(key[:4], float), "xyz".index(str(key[4])), response, files[0][0], paths))
    return experiments


def _response(files: Sequence[tuple[str, str]], fit: ModalFitting, paths: Mapping[str, Path]) -> FrequencyResponse:
    """Response of the hits of one experiment, or of its one receptance file."""
    tables = [CsvTable(paths[name]) for name, _ in files]
    (name, where), first = files[0], tables[0]
    try:
        if "frequency" in first.names:
            if len(files) > 1:
                raise ArgumentError(f"{where}: {name} is a frequency response; each experiment can have only one")
            return _receptance(first, name)
        measures = next((m for m in ORDER if m in first.names), None)
        if measures is None or "force" not in first.names or "time" not in first.names:
            raise ArgumentError(f"{name}: expected the columns {_RECORD} (or velocity, displacement), or {_RESPONSE}")
        forces, responses, steps = [], [], []
        for (file, _), table in zip(files, tables, strict=True):
            if measures not in table.names or len(table.lines) != len(first.lines):
                raise ArgumentError(f"{file}: hits of one experiment must have the columns and length of {name}")
            forces.append(_si(table, "force", "N"))
            responses.append(_si(table, measures, UNITS[measures]))
            steps.append(_step(_si(table, "time", "s"), file))
        if np.ptp(steps) > JITTER * steps[0]:
            raise ArgumentError(f"{name}: the hits of this experiment have different sample rates")
        return frequency_response(
            # pyrefly: ignore[bad-argument-type]
            forces, responses, 1 / steps[0], measures=measures, estimator=fit.estimator,
            force_window=fit.force_window, decay=fit.decay,
        )  # fmt: skip
    except ArgumentError:
        raise
    except ValueError as error:
        raise ArgumentError(f"{name}: {error}") from error


def _receptance(table: CsvTable, name: str) -> FrequencyResponse:
    if "real" not in table.names or "imaginary" not in table.names:
        raise ArgumentError(f"{name}: expected the columns {_RESPONSE}")
    f, unit = _si(table, "frequency", "Hz"), table.units[table.place("real")]
    try:
        order = next(
            (n for u, n in PER_FORCE.items() if parse_unit(u).dimension == parse_unit(unit or "m/N").dimension), None
        )
    except UnitError as error:
        raise ArgumentError(f"{name}, column 'real': {error}") from error
    if order is None:
        raise ArgumentError(f"{name}, column 'real': expected a unit like one of {', '.join(PER_FORCE)}; found {unit}")
    target = next(u for u, n in PER_FORCE.items() if n == order)
    H = _si(table, "real", target) + 1j * _si(table, "imaginary", target)
    return FrequencyResponse(f, H / (2j * np.pi * f) ** order)


def _si(table: CsvTable, name: str, unit: str) -> np.ndarray:
    unit_of_column = table.units[table.place(name)]
    if not unit_of_column:
        raise ArgumentError(f"{table.file}: the column '{name}' has no unit; write it as '{name} [{unit}]'")
    try:
        return np.asarray(convert(table.numbers(name), unit_of_column, unit), float)
    except UnitError as error:
        raise ArgumentError(f"{table.where}, column '{name}': {error}") from error


def _step(t: np.ndarray, name: str) -> float:
    steps = np.diff(t)
    if len(t) < 16 or not steps[0] > 0 or np.ptp(steps) > JITTER * steps.mean():
        raise ArgumentError(f"{name}: the samples are not evenly spaced; expected 16 or more with steps within 0.1 %")
    return float((t[-1] - t[0]) / (len(t) - 1))


def _existing(name: str, folder: Path, where: str) -> Path:
    path = next((p for p in (folder / name, Path(name)) if p.is_file()), None)
    if path is None:
        raise ArgumentError(f"{where}: there is no file '{name}' in {folder} or in the working directory")
    return path
