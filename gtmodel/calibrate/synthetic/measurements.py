"""Synthetic calibration measurements: a robot with known errors (also of guideways and carts) at the poses of a grid,
written to a file and read back like a measured one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy

from ...compiler.causal import compile_causal
from ...geometry.rotations import right_handed
from ...lang import Model, ModelError
from ...results import ArgumentError
from ...results.disk import scratch
from ...results.table import csv_text
from ...robots import links
from ..measured.options import Measured, MeasuredSignal
from ..measured.poses import MeasuredPoses
from ..measured.reading_file import read_poses
from ..sensitivity import moved, rows_of, true_poses
from .options import Synthetic

WAVES = 5  # of the smooth part: wavelengths from twice the range to two fifths of it
FINE = 2001  # points over the range from which sizes are computed


@dataclass(frozen=True, eq=False)
class GuidewayError:
    """Deviation e(q) (n, 3) [m] of a point from A + q v, in world coordinates: a synthetic guideway error.

    Smooth random waves across and along `direction` with their straight line over `low`..`high` removed, and with means
    `along` and `across` [m] of |e_par| and |e_perp| there (as in Dressler 2012, Table 4.2); and along it a sine of
    amplitude `cyclic` [m] and `period` [m] (section 4.2).
    """

    direction: np.ndarray
    low: float
    high: float
    along: float
    across: float
    cyclic: float
    period: float
    seed: np.random.SeedSequence

    def __call__(self, q: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng(self.seed)
        amplitude = rng.standard_normal((3, WAVES)) / np.arange(1, WAVES + 1)
        phase = rng.uniform(0, 2 * np.pi, (3, WAVES + 1))
        fine = np.linspace(self.low, self.high, FINE)
        smooth, base = self._waves(q, amplitude, phase), self._waves(fine, amplitude, phase)
        for k in range(3):
            line = np.polynomial.Polynomial.fit(fine, base[k], 1)
            smooth[k], base[k] = smooth[k] - line(q), base[k] - line(fine)
        axes = right_handed(self.direction)
        sizes = np.mean(np.abs(base[0])), np.mean(np.hypot(base[1], base[2]))
        scale = np.array([self.along / sizes[0], *[self.across / sizes[1]] * 2])
        turn = 2 * np.pi * np.asarray(q, float) / self.period + phase[0, WAVES]
        return (scale[:, None] * smooth).T @ axes + self.cyclic * np.sin(turn)[:, None] * axes[0]

    def _waves(self, q: np.ndarray, amplitude: np.ndarray, phase: np.ndarray) -> np.ndarray:
        s = np.pi * (np.asarray(q, float) - self.low) / (self.high - self.low)
        k = np.arange(1, WAVES + 1)
        return np.sum(amplitude[:, :, None] * np.sin(k[:, None] * s + phase[:, :WAVES, None]), axis=1)


REFLECTOR = np.array([0.03, 0.03, 0.03])  # m from the last joint of its cart; our choice
MARGIN = 0.01  # m beyond the poses, the range of the guideway errors
STREAM = 5  # first index of the seeds used here


def tilts(s: Synthetic, curves: Sequence[GuidewayError]) -> list[GuidewayError]:
    """Small rotations [rad] of each cart along its guideway, with the stated mean angle."""
    size = s.cart_tilt / np.sqrt(2.0)
    return [
        GuidewayError(c.direction, c.low, c.high, size, size, 0.0, 1.0, np.random.SeedSequence([s.seed, STREAM, i]))
        for i, c in enumerate(curves)
    ]


def levers(points: np.ndarray, rows: Sequence[int]) -> np.ndarray:
    """Joints (m, 3) [m] of a cart relative to its reflector."""
    return points[list(rows)] - points[rows[-1]] - REFLECTOR


def cart_points(
    s: Synthetic, number: int, points: np.ndarray, v: np.ndarray, rows: Sequence[Sequence[int]],
    curves: Sequence[GuidewayError], q: np.ndarray,
) -> tuple[np.ndarray, list[np.ndarray]]:  # fmt: skip
    """Coordinates (n,) [m] over the range of the poses and, per cart, reflector positions (n, 3) [m] with device noise.

    The reflector positions are in a separate frame. During this recording the tool centre point does not move across
    the guideways, so the load, whose effect depends on the pose, shifts no cart; only `cart_drift` does."""
    coordinates = np.round(np.linspace(q[:, :3].min() - MARGIN, q[:, :3].max() + MARGIN, number), 7)
    R = scipy.spatial.transform.Rotation.from_euler("ZYZ", s.cart_device_zyz)
    rng = np.random.default_rng(np.random.SeedSequence([s.seed, STREAM + 1]))
    sigma = np.broadcast_to(np.asarray(s.position_noise, float), 3)
    reflectors = []
    for i, (cart, curve) in enumerate(zip(rows, curves, strict=True)):
        k, size = cart[-1], s.cart_drift[i] / np.sqrt(2.0)
        seeds = np.random.SeedSequence([s.seed, STREAM + 2, i])
        drift = GuidewayError(curve.direction, curve.low, curve.high, size, size, 0.0, 1.0, seeds)
        world = points[k] + REFLECTOR + coordinates[:, None] * v[k] + curve(coordinates) + drift(coordinates)
        reflectors.append(R.inv().apply(world - np.array(s.cart_device_t)) + sigma * rng.standard_normal(world.shape))
    return coordinates, reflectors


KEY = "synthetic"
# mean length of a 3D normal error, in standard deviations of one coordinate: 2 sqrt(2 / pi)
MEAN_DISTANCE = 1.5957691216
# decimals in the file: 0.1 um, 1e-9, 1e-6 deg
DECIMALS = {"mm": 4, "1": 9, "deg": 6}
PER_SI = {"mm": 1e3, "1": 1.0, "deg": 180 / np.pi}


class Carts(NamedTuple):
    """The parameter whose rows are points on the carts, the rows of each cart, and all parameters that are lengths."""

    points: str
    rows: Sequence[Sequence[int]]
    lengths: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class SyntheticFile:
    """The CSV text, its note, the robot that was measured; `carts`: the CSV text of cart points, if requested."""

    text: str
    note: str
    robot: Model
    turns: bool
    rotary: bool
    carts: str | None = None


def carts_of(model: Model) -> Carts:
    """The carts of a Gantry-Tau of the library. Raises ArgumentError for other robots."""
    if hasattr(model, "A0"):
        return Carts("A0", [[0], [1], [2]], ("A0", "A", "B", "L", "r3"))
    A = np.shape(getattr(model, "A", ()))
    if A == (6, 3) and hasattr(model, "B"):
        return Carts("A", links.ROWS, ("A", "B", "L"))
    if A == (3, 3) and hasattr(model, "v"):
        return Carts("A", [[0], [1], [2]], ("A", "L"))
    raise ArgumentError("applies to Gantry-Tau robots with three, six or F1 links; for this robot, measure poses", KEY)


def disturbed(model: Model, s: Synthetic) -> Model:
    """The robot with the errors: points, lengths and guideways with random errors of the stated sizes."""
    carts, robot = carts_of(model), _any(model)
    rng = np.random.default_rng(np.random.SeedSequence([s.seed, 1]))
    changed: dict[str, Any] = {}
    for name in carts.lengths:
        value = np.array(getattr(robot, name), float)
        changed[name] = value + s.point_error * rng.standard_normal(value.shape)
    v = np.array(robot.v, float)
    rows = carts.rows if len(v) == 6 else [[0], [1], [2]]
    for cart in rows:
        u = v[cart[0]] / np.linalg.norm(v[cart[0]])
        axis = np.cross(u, rng.standard_normal(3))
        turn = scipy.spatial.transform.Rotation.from_rotvec(s.misalignment / np.sqrt(2.0) * axis / np.linalg.norm(axis))
        v[cart] = turn.apply(v[cart]) * (1 + s.scale_error * rng.standard_normal())
    return robot.with_(**changed, v=v)


def make(model: Model, s: Synthetic) -> SyntheticFile:
    """Poses of the grid that the model reaches, as the disturbed robot takes them and the device measures them.

    Raises ArgumentError if the model reaches no pose, or if the disturbed robot cannot take one.
    """
    for a, b, axis in zip(s.low, s.high, "xyz", strict=True):
        if a > b:
            raise ArgumentError(f"the lower {axis} is {a:g} m and the upper {b:g} m; exchange them", f"{KEY}.low")
    carts, truth = carts_of(model), disturbed(model, s)
    rng = np.random.default_rng(np.random.SeedSequence([s.seed, 2]))
    q, near = _commanded(model, s, rng)
    names = ["mm"] * 3 + ["deg"] * (q.shape[1] - 3)
    readings = {"q": (_in_units(q, names), names)}
    q = readings["q"][0] / np.array([PER_SI[u] for u in names])
    errors = _guideway_errors(truth, carts, s, q)
    rotations, points = tilts(s, errors), np.array(getattr(truth, carts.points), float)
    deviations: dict[str, np.ndarray] = {}
    for i, curve in enumerate(errors):
        shift = curve(q[:, i]) + _by_load(near["T"], curve, s, i)
        for k, lever in zip(carts.rows[i], levers(points, carts.rows[i]), strict=True):
            deviations |= rows_of(shift + np.cross(rotations[i](q[:, i]), lever), carts.points, [k])
    try:
        poses = true_poses(truth, q, near, deviations)
    except ModelError as error:
        raise ArgumentError(str(error), KEY) from error
    lost = np.flatnonzero(~np.all(np.isfinite(poses["T"]), axis=1))
    if lost.size:
        raise ArgumentError(
            f"the disturbed robot cannot take {lost.size} of {len(q)} poses, the first with the carts at "
            f"{np.round(q[lost[0], :3], 3).tolist()} m; choose a smaller grid or smaller errors",
            f"{KEY}.low",
        )
    for name, rows in _readings(poses, s, rng).items():
        units = ["mm"] * 3 if name == "T" else ["1"] * 4
        readings[name] = (_in_units(rows, units), units)
    note = _note(s, len(q))
    carts_text = None
    if s.cart_points is not None:
        v = np.broadcast_to(np.array(_any(truth).v, float), points.shape)
        coordinates, reflectors = cart_points(s, s.cart_points, points, v, carts.rows, errors, q)
        columns = {"q": coordinates[:, None]} | {f"P{i + 1}": rows for i, rows in enumerate(reflectors)}
        tables = {n: (_in_units(a, ["mm"] * a.shape[1]), ["mm"] * a.shape[1]) for n, a in columns.items()}
        carts_text = _text(tables, note, "cart points")
    return SyntheticFile(_text(readings, note), note, truth, "e" in readings, q.shape[1] > 3, carts_text)


def stated_noise(s: Synthetic, rotary: bool) -> dict[str, list[float]]:
    """Standard deviations [m, rad] by signal; for a cart, all deviations from its line count as noise."""
    device, load, cyclic = (np.broadcast_to(np.asarray(x, float), 3) for x in (s.position_noise, s.load, s.cyclic))
    carts = np.hypot(np.hypot(s.along, s.across), np.hypot(load, cyclic)) + 1e-7
    return {
        "q": carts.tolist() + ([1e-6] * 3 if rotary else []),
        "T": np.hypot(device, s.repeatability / MEAN_DISTANCE).tolist(),
        "e": [s.orientation_noise] * 3,
    }


def _commanded(model: Model, s: Synthetic, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Actuators (N, k) at the reachable poses of the grid, from the nominal model, and these poses."""
    lines = [np.linspace(a, b, n) for a, b, n in zip(s.low, s.high, s.counts, strict=True)]
    T = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    robot = _any(model)
    if hasattr(robot, "A0"):
        turn = s.turn * rng.uniform(-1, 1, T.shape)
        e = moved(np.tile(np.array(robot.home_e, float), (len(T), 1)), turn)
        q, status = compile_causal(model, known=["T", "e"], targets=["q"])(T, e)
        near = {"T": T, "e": e}
    elif hasattr(robot, "B"):
        q, e, status = compile_causal(model, known=["T"], targets=["q", "e"])(T)
        near = {"T": T, "e": e}
    else:
        q, status = compile_causal(model, known=["T"], targets=["q"])(T)
        near = {"T": T}
    reached = np.flatnonzero(np.asarray(status) == 0)
    if not reached.size:
        raise ArgumentError(f"none of the {len(T)} grid points is within reach; move the grid", f"{KEY}.low")
    if s.poses is not None:
        if s.poses > reached.size:
            raise ArgumentError(f"only {reached.size} grid points are within reach; choose fewer, or refine the grid",
                             f"{KEY}.poses")  # fmt: skip
        reached = reached[np.round(np.linspace(0, reached.size - 1, s.poses)).astype(int)]
    return q[reached], {n: rows[reached] for n, rows in near.items()}


def _guideway_errors(truth: Model, carts: Carts, s: Synthetic, q: np.ndarray) -> list[GuidewayError]:
    v = np.array(_any(truth).v, float)
    curves, cyclic = [], np.broadcast_to(np.asarray(s.cyclic, float), 3)
    for i in range(3):
        low, high = float(q[:, i].min()), float(q[:, i].max())
        direction = v[carts.rows[i][0] if len(v) == 6 else i]
        curves.append(
            GuidewayError(
                direction, low - 0.01, high + 0.01, s.along[i], s.across[i], float(cyclic[i]),
                s.cyclic_period, np.random.SeedSequence([s.seed, 3, i]),
            )
        )  # fmt: skip
    return curves


def _by_load(T: np.ndarray, curve: GuidewayError, s: Synthetic, i: int) -> np.ndarray:
    """Shift (N, 3) of a cart that depends on the position of the plate across the guideway."""
    load = np.broadcast_to(s.load, 3)[i]
    if load == 0:
        return np.zeros(T.shape)
    seeds = np.random.SeedSequence([s.seed, 4, i])
    way = np.cross(curve.direction, np.random.default_rng(seeds).standard_normal(3))
    place = T @ (way / np.linalg.norm(way))
    size = load / np.sqrt(2.0)
    return GuidewayError(curve.direction, place.min() - 0.01, place.max() + 0.01, size, size, 0.0, 1.0, seeds)(place)


def _readings(poses: dict[str, np.ndarray], s: Synthetic, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Readings of the device in its frame, with the robot's repeatability and the device's noise."""
    T = poses["T"]
    sigma = np.broadcast_to(np.asarray(s.position_noise, float), 3)
    T = T + s.repeatability / MEAN_DISTANCE * rng.standard_normal(T.shape)
    R = scipy.spatial.transform.Rotation.from_euler("ZYZ", s.device_zyz)
    readings = {"T": R.inv().apply(T - np.array(s.device_t)) + sigma * rng.standard_normal(T.shape)}
    if "e" in poses:
        turns = R.inv() * scipy.spatial.transform.Rotation.from_quat(poses["e"], scalar_first=True)
        noise = s.orientation_noise * rng.standard_normal(T.shape)
        e = moved(turns.as_quat(scalar_first=True), noise)
        readings["e"] = e * np.where(np.sum(e * e[0], axis=1, keepdims=True) < 0, -1.0, 1.0)
    return readings


def _note(s: Synthetic, poses: int) -> str:
    noise, cyclic, load, along, across = (
        ", ".join(f"{1e6 * x:g}" for x in np.atleast_1d(a))
        for a in (s.position_noise, s.cyclic, s.load, s.along, s.across)
    )
    tilt = f"; carts tilt by {np.degrees(s.cart_tilt):g} deg" if s.cart_tilt else ""
    return (
        f"seed {s.seed}, {poses} poses; {s.device} noise {noise} um, {np.degrees(s.orientation_noise):g} deg; "
        f"repeatability {1e6 * s.repeatability:g} um; guideways apart by {np.degrees(s.misalignment):g} deg, carts by "
        f"{along} um along and {across} um across (means), cyclic {cyclic} um, by load {load} um; points and lengths "
        f"off by {1e3 * s.point_error:g} mm{tilt}"
    )


def _text(tables: dict[str, tuple[np.ndarray, list[str]]], note: str, what: str = "calibration poses") -> str:
    columns, forms = {}, {}
    for name, (rows, units) in tables.items():
        for k, unit in enumerate(units):
            head = (f"{name}[{k}]" if len(units) > 1 else name) + (f" [{unit}]" if unit != "1" else "")
            columns[head], forms[head] = rows[:, k], f".{DECIMALS[unit]}f"
    return csv_text(columns, forms, [f"title: {what}", f"synthetic: {note}"])


def _in_units(rows: np.ndarray, units: Sequence[str]) -> np.ndarray:
    return np.column_stack([np.round(rows[:, k] * PER_SI[u], DECIMALS[u]) for k, u in enumerate(units)])


def _any(model: Model) -> Any:
    return model


FILE, CARTS = "measurements.csv", "carts.csv"


def made_poses(robot: Model, synthetic: Synthetic, held_out: Path | str | None = None) -> MeasuredPoses:
    """Return synthetic poses: a robot with known errors, commanded to a grid and measured by a device.

    robot: a Gantry-Tau of the library. held_out: a file with the same columns that no fit uses. The result includes the
    text of the file and the robot with the errors. Raises ArgumentError.

    >>> grid = gt.calibrate.Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[3, 3, 2], seed=1)
    >>> poses = gt.calibrate.made_poses(gt.robots.gantry_tau("l1_tape"), grid)
    >>> poses.measurements.values["T"].shape[1], list(poses.files)
    (3, ['measurements.csv'])
    """
    file = make(robot, synthetic)
    signals = {
        "q": MeasuredSignal("q", ["mm"] * 3 + (["deg"] * 3 if file.rotary else [])),
        "T": MeasuredSignal("T", "mm"),
    } | ({"e": MeasuredSignal("e", "1")} if file.turns else {})
    away = any([*synthetic.device_t, *synthetic.device_zyz])
    frame: Literal["robot", "device"] = "device" if away else "robot"
    measured = Measured(signals, orientation="e" if file.turns else None, frame=frame)
    with scratch() as place:
        path = place / FILE
        path.write_text(file.text, encoding="utf-8")
        poses = read_poses(path, measured, held_out)
    if synthetic.state_noise:
        stated = stated_noise(synthetic, file.rotary)
        m = replace(poses.measurements, noise={n: np.array(stated[n]) for n in signals})
        poses = replace(poses, measurements=m)
    files = {FILE: file.text} | ({CARTS: file.carts} if file.carts is not None else {})
    return replace(poses, truth=file.robot, files=files)
