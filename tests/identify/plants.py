"""The thirteen-parameter plant of issue 6 and its synthetic logs: model 2 of Table 6.3 with links of 0.5, 1, 1.5 kg."""

from __future__ import annotations

from functools import cache

import numpy as np

import gtmodel as gt
from gtmodel.identify import LogSimulator, Regressor, Tracking, multisine
from gtmodel.measurements import Session

LINKS = [0.5, 1.0, 1.5]  # kg
NOISE = 30.0  # N, as of the notes
SAMPLE_TIME = 0.004
BAND = [0.2, 0.5, 1.1, 2.2]  # Hz
# fixed before the first look, and never changed
SEED = 2012


@cache
def plant() -> gt.robots.GantryTau:
    return gt.robots.inertia_variant("links", m_a=LINKS).robot


@cache
def regressor() -> Regressor:
    """Of all thirteen; link masses are 0 where they are held."""
    variant = gt.robots.inertia_variant("links")
    return Regressor(variant.robot, variant.free)


def truth() -> dict[str, float]:
    r = plant()
    values = np.concatenate([[r.m_p], r.m_c, r.m_a, r.coulomb, r.viscous]).astype(float)
    return dict(zip(regressor().names, values.tolist(), strict=True))


@cache
def simulator(duration: float = 60.0, motion: int = 1) -> LogSimulator:
    time = SAMPLE_TIME * np.arange(round(duration / SAMPLE_TIME))
    T = multisine(time, np.asarray(plant().home, dtype=float), np.full(3, 0.4), np.array(BAND), seed=motion)
    q, status = plant().causal("T", "q")(T)
    assert not np.any(status)
    return LogSimulator(plant(), q, SAMPLE_TIME, tracking=Tracking(**gt.robots.actuator_closed_loop()))


def session(sensors, seed: int, duration: float = 60.0, motion: int = 1) -> Session:
    return Session("synthetic", simulator(duration, motion).draw(seed, sensors), SAMPLE_TIME)
