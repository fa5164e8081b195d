"""A synthetic D1 of the error sizes that the thesis prints, and its models 1 to 5 (Dressler 2012, section 5.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gtmodel.calibrate import Calibration, Choice, Measurements, calibrate
from gtmodel.calibrate.recognition import aligned
from gtmodel.calibrate.true_poses import moved, rows_of, true_poses
from gtmodel.calibrate.wandering import Wandering
from gtmodel.inference import Prior
from gtmodel.mechanics import Guideway, MeasuredGuideway
from gtmodel.robots.catalogue import gantry_tau, six_link_gantry_tau
from gtmodel.robots.clusters import ROWS
from gtmodel.robots.six_link import ARM, on_guideways

# means of Table 4.2 [m] and, ours, how far a cart shifts as the plate moves across (section 4.2 sees up to 0.1 mm)
ALONG, ACROSS = np.array([11e-6, 58e-6, 19e-6]), np.array([28e-6, 38e-6, 47e-6])
LOAD, CYCLIC, PERIOD = 20e-6, 5e-6, 0.01
POINTS = 2e-4  # of joints and lengths before the calibration; also the prior of plate joints
TRACKER, TARGET = 10e-6, np.radians(0.005)  # T-Mac: position, orientation
REPEATED = 13e-6 / 1.5958  # mean distance 13 um
CART = 5e-5  # what a cart is off a straight line, as noise of its coordinate
CART_POINTS = 28


class Recorded(NamedTuple):
    """Poses of 176 on a grid, every second held out; cart points (28, 3) of each cart in frames of their own."""

    fitted: Measurements
    held_out: Measurements
    at: np.ndarray
    carts: list[np.ndarray]


def recorded(seed: int) -> Recorded:
    """Synthetic measurement sets 1 and 2 of a D1 with this seed."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 1]))
    nominal = six_link_gantry_tau()
    known = {n: np.array(getattr(nominal, n)) for n in ("A", "B", "L")}
    truth = nominal.with_(**{n: a + POINTS * rng.standard_normal(a.shape) for n, a in known.items()})
    h = np.array(nominal.home, float)
    lines = [h[k] + np.linspace(-0.5, 0.5, n) for k, n in enumerate((11, 4, 4))]
    T = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    q, e, status = nominal.causal(known="T", targets=("q", "e"))(T)
    T, q, e = (a[np.asarray(status) == 0] for a in (T, q, e))
    v = np.array(truth.v)
    curves, off = [], {}
    at = np.linspace(q.min() - 0.02, q.max() + 0.02, CART_POINTS)
    for i, rows in enumerate(ROWS):
        u, seeds = v[rows[0]], np.random.SeedSequence([seed, 2, i])
        curves.append(Wandering(u, at[0], at[-1], ALONG[i], ACROSS[i], CYCLIC if i else 0.0, PERIOD, seeds))
        way = np.cross(u, rng.standard_normal(3))
        s = T @ way / np.linalg.norm(way)
        load = Wandering(u, s.min(), s.max(), LOAD / 1.4, LOAD / 1.4, 0.0, 1.0, np.random.SeedSequence([seed, 3, i]))
        off |= rows_of(curves[i](q[:, i]) + load(s), "A", rows)
    stands = true_poses(truth, q, {"T": T, "e": e}, off)
    seen = {
        "q": q,
        "T": stands["T"] + np.hypot(TRACKER, REPEATED) * rng.standard_normal(T.shape),
        "e": moved(stands["e"], TARGET * rng.standard_normal(T.shape)),
    }
    frame = Rotation.from_rotvec([0.2, -0.1, 0.4])
    carts = []
    for i, rows in enumerate(ROWS):
        points = np.array(truth.A)[rows].mean(axis=0) + at[:, None] * v[rows[0]] + curves[i](at)
        carts.append(frame.inv().apply(points - [1.0, 0.5, 0]) + TRACKER * rng.standard_normal(points.shape))
    m = Measurements(seen, {"q": CART, "T": float(np.hypot(TRACKER, REPEATED)), "e": TARGET})
    return Recorded(m.part(np.arange(0, len(q), 2)), m.part(np.arange(1, len(q), 2)), at, carts)


def mean_error(r: Recorded, model: int, piecewise: tuple[bool, bool, bool] = (False,) * 3) -> float:
    """Mean held-out positioning error [m]: models 1 and 2 have three links, 3 to 5 six; see fitted()."""
    c = fitted(r, model, piecewise)
    kept = r.held_out if model > 2 else without_orientation(r.held_out)
    return float(np.mean(np.linalg.norm(c.positioning_errors(kept)["T"], axis=1)))


def fitted(r: Recorded, model: int, piecewise: tuple[bool, bool, bool] = (False,) * 3) -> Calibration:
    """The model calibrated on the fitted poses, `piecewise` of carts for model 5, all for 2 and 4."""
    on = {2: (True,) * 3, 4: (True,) * 3, 5: piecewise}.get(model, (False,) * 3)
    six = model > 2
    robot: Any = six_link_gantry_tau() if six else gantry_tau("d1_nominal")
    arms = ARM if six else (0, 1, 2)
    A, v = np.array(robot.A), np.array(robot.v)
    free, unit, parts = ["L", *(["B"] if six else [])], [], []
    for k, i in enumerate(arms):
        if not on[i]:
            parts.append(Guideway)
            free += [f"A[{k}]", f"v[{k}]"]
            continue
        t, R, _ = aligned(r.carts[i], A[k] + r.at[:, None] * v[k])
        u = Rotation.from_matrix(R).as_quat(scalar_first=True)
        parts.append(MeasuredGuideway(at=r.at, points=r.carts[i], t=t, u=u))
        name = f"link[{k}].guideway" if six else f"arm[{k}].guideway"
        free += [f"{name}.t", f"{name}.u"]
        unit.append(f"{name}.u")
    if six:
        robot = robot.with_(**{**on_guideways([Guideway] * 3), "link": [dict(guideway=g) for g in parts]})
    else:
        robot = robot.with_(arm=[dict(guideway=g) for g in parts])
    m = r.fitted if six else without_orientation(r.fitted)
    choice = Choice(free=free, unit=unit)
    if six:  # the plate hardly turns: its joints stay as they were known
        choice = replace(
            choice, priors=[Prior(f"B[{k},{j}]", float(x), POINTS) for (k, j), x in np.ndenumerate(robot.B)]
        )
    return calibrate(robot, m, choice)


def without_orientation(m: Measurements) -> Measurements:
    return Measurements({n: m.values[n] for n in "qT"}, {n: m.noise[n] for n in "qT"})
