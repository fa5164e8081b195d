"""The filter of (7.21) on a model from data: its innovations, and its error against the mismatch of the model."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.control import learning

TS, NOISE = 0.004, 0.07
SAMPLES = 4000
LEVEL = 0.99


def excited(seed: int, frequency: float = 11.5, damping: float = 0.05) -> dict[str, np.ndarray]:
    """Motors and tool under a random reference, synthetic, with 1 um of noise of the gauges."""
    rng = np.random.default_rng(seed)
    r = 1e-3 * np.repeat(rng.normal(size=SAMPLES // 10), 10)
    made = {name: T(r) for name, T in learning.flexible_axis(frequency, damping).maps(SAMPLES).items()}
    made["tool"] = made["tool"] + 1e-6 * rng.normal(size=SAMPLES)
    return made


@pytest.mark.parametrize("seeds", [8, pytest.param(20, marks=pytest.mark.proof)])
def test_the_filter_of_an_identified_model_lies_in_its_band(seeds: int) -> None:
    log = excited(1)
    model = learning.identified_tool(log["motor"], log["tool"], order=3)
    r, nises = learning.SquarePath().samples(TS)[:, 1], []
    run = {name: T(r) for name, T in learning.flexible_axis(11.5, 0.05).maps(825).items()}
    for seed in range(seeds):
        rng = np.random.default_rng(100 + seed)
        felt = run["acceleration"] + NOISE * rng.normal(size=825)
        f = learning.most_likely_filter(model, run["motor"], felt, NOISE)
        nis = float(np.mean(f.innovations(run["motor"], felt) ** 2))
        nises.append(nis)
        z = learning.kalman_estimate(825, f)({"motor": run["motor"], "acceleration": felt})
        off = np.sqrt(np.mean((z - run["tool"])[100:725] ** 2))
        by_motors = np.sqrt(np.mean((run["motor"] - run["tool"])[100:725] ** 2))
        assert off < 0.2 * by_motors
    # all seeds at once: their sum has one chi-squared distribution, with no seed to excuse
    assert float(np.mean(nises)) in gt.filtering.chi_squared_band(825 * seeds, 1, LEVEL)
    # and how many lie outside a band of 95 % is binomial; more than this has a chance of 1 %
    outside = sum(nis not in gt.filtering.chi_squared_band(825, 1) for nis in nises)
    assert outside <= scipy.stats.binom.ppf(LEVEL, seeds, 0.05)
