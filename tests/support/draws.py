"""Drawn motions: the declared suite tests/suites/trajectory_draws.toml as changes of the reference motion."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from gtmodel.motion.path_parametrization import along_guideways
from gtmodel.robots.catalogue import gantry_tau
from gtmodel.robots.links import link_names

from .motions import l1

SUITE = Path(__file__).resolve().parents[1] / "suites" / "trajectory_draws.toml"


def suite() -> dict:
    return tomllib.loads(SUITE.read_text(encoding="utf-8"))


def draws(count: int | None = None, seed: int | None = None) -> list[dict[str, Any]]:
    """The first `count` draws, each as changes of `tests.support.motions.asked`; with another seed others."""
    s = suite()
    rng = np.random.default_rng(s["seed"] if seed is None else seed)
    low, high = np.array([s[k] for k in ("x_m", "y_m", "z_m")]).T
    found: list[dict[str, Any]] = []
    while len(found) < (s["count"] if count is None else count):
        start, goal = rng.uniform(low, high), rng.uniform(low, high)
        force, payload = rng.uniform(*s["force_N"]), rng.uniform(*s["payload_kg"])
        scale = float(np.exp(rng.uniform(*np.log(s["velocity_scale_m_s"]))))
        energy = s["energy"][rng.integers(len(s["energy"]))]
        if np.linalg.norm(goal - start) >= s["distance_m"] and _possible(s, (start, goal), force, payload):
            found.append(
                {
                    "start__tcp": start.tolist(),
                    "goal__tcp": goal.tolist(),
                    "limits__force": float(force),
                    "robot": l1(payload=float(payload), velocity_scale=scale),
                    "cost__energy": energy,
                }
            )
    return found


@cache
def _robot(name: str, inertia: str, payload: float):
    return gantry_tau(name, inertia=inertia, payload=payload)


def _possible(s: dict, ends: tuple[np.ndarray, ...], force: float, payload: float) -> bool:
    robot, loaded = (_robot(s["robot"], s["inertia"], mass) for mass in (0.0, 1.0))
    joints = link_names(robot)
    place = robot.causal("T", joints)
    zero = np.zeros(3)
    for T in ends:
        *found, status = place(T, *[zero] * (len(place.inputs) - 1))
        if status or np.min(along_guideways(robot, T, found)) < s["link_along_guideway_m"]:
            return False
        weight, with_one = (r.causal("T", "tau")(T, zero, zero)[0] for r in (robot, loaded))
        tau = weight + payload * (with_one - weight)  # linear in the payload
        if np.max(np.abs(tau) + np.asarray(robot.coulomb)) > s["static_share"] * force:
            return False
    return True
