"""Synthetic robots with known errors and poses that they really reach; seeds and sizes stand where they are used."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import gtmodel as gt
from gtmodel.calibrate import Measurements
from gtmodel.robots import f1_gantry_tau, six_link_gantry_tau

GEOMETRY = {"three_link": ("A", "v", "L"), "six_link": ("A", "v", "L", "B"), "f1": ("A0", "v", "L", "A", "B", "r3")}
GEOMETRY["f1_unit"] = GEOMETRY["f1"]
SIGNALS = {"three_link": ("T",), "six_link": ("T", "e"), "f1": ("T", "e"), "f1_unit": ("T", "e")}


def disturbed(robot: Any, names: tuple[str, ...], size: float, seed: int) -> Any:
    """The robot with normal errors of a size [m or 1] in some parameters."""
    rng = np.random.default_rng(seed)
    values = {n: np.array(getattr(robot, n), float) for n in names}
    return robot.with_(**{n: a + size * rng.standard_normal(a.shape) for n, a in values.items()})


@cache
def true_robot(kind: str, seed: int = 1) -> Any:
    """The robot that was measured: the printed one with errors of 1 mm; the F1 as printed, its quaternions raw;
    "f1_unit" with their directions only."""
    if kind == "three_link":
        return disturbed(gt.robots.gantry_tau("l1_tracker_2008"), GEOMETRY[kind], 1e-3, seed)
    if kind == "six_link":
        return disturbed(six_link_gantry_tau(), ("A", "v", "L"), 1e-3, seed)
    f1 = f1_gantry_tau()
    if kind == "f1":
        return f1
    us = {n: np.array(getattr(f1, n), float) for n in ("u1_2", "u1_3", "u2_3")}
    return f1.with_(**{n: u / np.linalg.norm(u) for n, u in us.items()})


@cache
def poses(kind: str, number: int, seed: int = 2) -> dict[str, np.ndarray]:
    """Actuators and the pose without noise, by the robot's own forward kinematics."""
    robot = true_robot(kind)
    rng = np.random.default_rng(seed)
    if kind.startswith("f1"):
        q = np.array([0.72, 0.26, 0.21, 0, 0, 0]) + rng.uniform(-1, 1, (number + 20, 6)) * np.repeat([0.3, 0.5], 3)
    else:
        q = rng.uniform(-0.6, 0.6, (number + 20, 3))
    *pose, status = robot.causal(known="q", targets=SIGNALS[kind])(q)
    reached = np.flatnonzero(status == 0)[:number]
    assert len(reached) == number
    return {"q": q[reached], **{n: a[reached] for n, a in zip(SIGNALS[kind], pose, strict=True)}}


def measured(kind: str, number: int, noise: dict[str, float], seed: int, known: bool = True) -> Measurements:
    """The poses with normal noise; of quaternions as small turns [rad] about their own axes."""
    rng = np.random.default_rng(seed)
    values = dict(poses(kind, number))
    for name, sigma in noise.items():
        if name == "e":
            turn = sigma * rng.standard_normal((number, 3))
            values[name] = _turned(values[name], turn)
        else:
            values[name] = values[name] + sigma * rng.standard_normal(values[name].shape)
    return Measurements(values, noise if known else {})


def geometry(robot: Any, names: tuple[str, ...]) -> dict[str, float]:
    """Scalar parameters by name, as an Estimate has them."""
    drawn = {}
    for name in names:
        a = np.array(getattr(robot, name), float)
        for index in np.ndindex(a.shape):
            drawn[f"{name}[{','.join(map(str, index))}]"] = float(a[index])
    return drawn


def _turned(e: np.ndarray, turn: np.ndarray) -> np.ndarray:
    w, v = e[:, :1], e[:, 1:]
    half = turn / 2
    u = np.hstack([w - np.sum(v * half, axis=1, keepdims=True), v + w * half + np.cross(v, half)])
    return u / np.linalg.norm(u, axis=1, keepdims=True)
