"""Intervals of what a bundle eliminates, and of what it keeps, against the truth of many draws. All data are synthetic.

Six cameras above 40 points, noise of 0.5 pixel, in the gauge of the true first camera: places of points, by coordinate
and as ellipsoids, lenses, and a distance between two cameras.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy

from gtmodel.inference import binomial_band
from gtmodel.inference.bundle import bundle_fit
from tests.inference.synthetic_bundle import scene

NOISE = 0.5
NORMAL = float(scipy.special.ndtri(0.975))
ELLIPSOID = float(scipy.special.chdtri(3, 0.05))
FEW = 25
PAIR = 1, 4  # cameras that are free


def hits_of(runs: int) -> dict[str, np.ndarray]:
    """How often 95 % regions hold the truth: along the axes of the points (40, 3), all three at once (40,), f, k1, k2
    of cameras (6, 3) and the distance of the pair (1,)."""
    exact = scene(noise=0.0, rough=0.0)
    exact = replace(exact, cameras=exact.true_cameras)
    fixed = exact.anchored()
    hits = {"axes": np.zeros((40, 3)), "ellipsoids": np.zeros(40), "lenses": np.zeros((6, 3)), "distance": np.zeros(1)}
    for seed in range(runs):
        uv = exact.uv + NOISE * np.random.default_rng([26, seed]).standard_normal(exact.uv.shape)
        one = replace(exact, uv=uv)
        fit = bundle_fit(one.groups(fixed), one.blocks(sigma=NOISE))
        assert fit.status.ok
        d, C = fit.values["point"] - exact.true_points, fit.local_covariance
        hits["axes"] += np.abs(d) < NORMAL * np.sqrt(np.einsum("nii->ni", C))
        hits["ellipsoids"] += np.einsum("ni,nij,nj->n", d, np.linalg.inv(C), d) < ELLIPSOID
        own = np.diag(fit.shared_covariance).reshape(6, 9)[:, 6:]
        hits["lenses"] += np.abs(fit.values["camera"] - exact.true_cameras)[:, 7:] < NORMAL * np.sqrt(own)
        error, std = distance(fit.values["camera"], fit.shared_covariance)
        hits["distance"] += abs(error - distance(exact.true_cameras, fit.shared_covariance)[0]) < NORMAL * std
    return hits


def distance(cameras: np.ndarray, C: np.ndarray) -> tuple[float, float]:
    """Between the centres c = -R' t of the pair, and its standard deviation by central differences of the moves."""
    group = scene().groups()[0]

    def of(step: np.ndarray) -> float:
        moved = group.moved(cameras, step.reshape(6, 9))
        a, b = (-turned(moved[k, :4]).T @ moved[k, 4:7] for k in PAIR)
        return float(np.linalg.norm(a - b))

    h = 1e-6
    slope = np.zeros(54)
    for k in (9 * n + j for n in PAIR for j in range(6)):
        slope[k] = (of(h * np.eye(54)[k]) - of(-h * np.eye(54)[k])) / (2 * h)
    return of(np.zeros(54)), float(np.sqrt(slope @ C @ slope))


def turned(q: np.ndarray) -> np.ndarray:
    return scipy.spatial.transform.Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix()


def test_regions_of_a_few_draws_are_not_far_off() -> None:
    hits = hits_of(FEW)
    shares = {name: h.mean() / FEW for name, h in hits.items()}
    # points of a draw share their cameras: a rough band, which a factor of 1.5 in the deviations leaves (81 and 99.7 %)
    assert all(0.9 <= shares[name] <= 0.985 for name in ("axes", "ellipsoids", "lenses")), shares
    low, _ = binomial_band(FEW)
    assert all(h.min() >= low for h in hits.values()), shares


@pytest.mark.proof
def test_regions_of_400_draws_hold_the_truth_as_often_as_they_say() -> None:
    hits = hits_of(400)
    low, high = binomial_band(400)
    outside = {name: h[(h < low) | (h > high)] for name, h in hits.items()}
    assert not any(len(h) for h in outside.values()), outside
    assert all(0.94 <= hits[name].mean() / 400 <= 0.96 for name in ("axes", "ellipsoids", "lenses"))
