"""Corners, pictures and poses that do not belong to the others: left out one after another, and what then is alarming.

The rules are those of all fits: `gtmodel.vision.residuals` and `gtmodel.measurements.inspection`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...inference import chi_squared_over_noise
from ...inference.bundle import BundleFit
from ...measurements.inspection.residual_tests import coloured, outliers
from ...results.status import SolveStatus
from ...results.suspicion import Suspicion
from ..residuals import ROUNDING, SETTLED, GrossErrors, gross_errors, noise_of, picture_means, scaled, shifted_pictures
from .pictures import RobotPictures

if TYPE_CHECKING:
    from .joint import JointFit, Prepared

ROUNDS = 8  # of robust fits, until the noise settles
ROUGH = 20  # steps of each
AGAIN = 12  # fits without what the one before found
LEAST = 1e-9  # deviations: a smaller noise is rounding


@dataclass(frozen=True, eq=False)
class RobustFit:
    """What was left, and in words what was not: pictures that are wrong as a whole, corners, and poses none of whose
    pictures belongs to their row of the actuators. `fit`: of what was left, or one that failed; `noise`: of most
    corners, in units of their sigma."""

    pictures: RobotPictures
    fit: BundleFit
    noise: float = 1.0
    wrong_pictures: tuple[str, ...] = ()
    wrong_corners: tuple[str, ...] = ()
    wrong_poses: tuple[str, ...] = ()


def robust_fit(ready: Prepared, p: RobotPictures, stop: Callable[[], bool] | None) -> RobustFit:
    """A robust fit, then fits without what lies beside the others, the most unlikely of each pose first."""
    gross, N = ready.setting.removal, len(p.poses)
    fit, bad = _robust(ready, p, gross, stop)
    if bad is None:
        return RobustFit(p, fit)
    wrong, poses = set(bad.pictures), set[int]()
    single = [p.where(int(k)) for k in np.flatnonzero(bad.corners & ~np.isin(p.picture, bad.pictures))]
    left = p.corners(~bad.corners)
    for _ in range(AGAIN):
        fit = ready.fit(left, values=fit.values, covariance=False, stop=stop)
        if not fit.status.ok:
            break
        far = gross_errors(left, fit.residuals["corners"], gross).corners
        single += [left.where(int(k)) for k in np.flatnonzero(far)]
        if not far.any():  # one corner far off moves the mean of its picture
            more = _beside(left, fit.residuals["corners"])
            poses |= {k for k in _off(fit.residuals["links"]) if not any(q % N == k for q in more)}
            wrong |= set(more)
            far = np.isin(left.picture, more) | np.isin(left.pose, list(poses))
        if not far.any():
            break
        left = left.corners(~far)
    pictures, lost = _named(p, wrong, poses)
    return RobustFit(left, fit, bad.noise, pictures, tuple(single), lost)


def _robust(
    ready: Prepared, p: RobotPictures, gross: float, stop: Callable[[], bool] | None
) -> tuple[BundleFit, GrossErrors | None]:
    """By Huber's loss, whose noise begins with what the start leaves and settles; None where that failed."""
    noise = max(noise_of(scaled(p, ready.corner_residuals(p))), LEAST)
    fit, bad, values = None, None, ready.start
    for _ in range(ROUNDS):
        fit = ready.fit(p, values=values, noise=noise, limit=ROUGH, covariance=False, stop=stop)
        if not fit.status.ok and fit.status is not SolveStatus.ITERATION_LIMIT:
            return fit, None
        values, bad = fit.values, gross_errors(p, fit.residuals["corners"], gross)
        if fit.status.ok and abs(bad.noise - noise) <= SETTLED * bad.noise:
            break
        noise = max(bad.noise, LEAST)
    assert fit is not None
    return fit, bad


def _beside(p: RobotPictures, residuals: np.ndarray) -> list[int]:
    """Numbers of the pictures that lie beside the others as a whole; of each pose the most unlikely: it moves the pose
    and so the others."""
    beside, pictures = shifted_pictures(p, residuals)
    order = beside.beyond()
    worst = {int(pictures[k]) % len(p.poses): int(pictures[k]) for k in order[::-1]}
    return sorted(worst.values())


def _off(links: np.ndarray) -> list[int]:
    """Poses at which the closure equations, each by the size it has at the others, do not hold."""
    beside = outliers(links.reshape(-1), groups=np.tile(np.arange(links.shape[1]), len(links)))
    return sorted({int(k) // links.shape[1] for k in beside.beyond()})


def _named(p: RobotPictures, wrong: set[int], poses: set[int]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Words for pictures, and for poses that lost all of several pictures: those do not belong to the actuators."""
    N = len(p.poses)
    every = np.unique(p.picture)
    there = {n: set(every[every % N == n].tolist()) for n in {k % N for k in wrong} | poses}
    lost = {n for n, own in there.items() if n in poses or (len(own) > 1 and own <= wrong)}
    pictures = tuple(p.picture_name(k) for k in sorted(wrong) if k % N not in lost)
    return pictures, tuple(p.poses[n] for n in sorted(lost))


def suspicions(joint: JointFit) -> list[Suspicion]:
    """Of what was left: residuals of each kind against the noise that was stated for it, and whether the pictures of a
    camera move slowly from pose to pose."""
    p, e = joint.pictures, joint.residuals
    corners = scaled(p, e)
    kinds = {"over_noise": (corners, "sigma_pixel", f", {noise_of(corners):.2g} times that,"),
             "actuators_over_noise": (joint.fit.residuals["links"], "actuator_noise", "")}  # fmt: skip
    if "device" in joint.fit.residuals and p.device is not None:
        far = joint.fit.residuals["device"] / p.device.noise
        worst = p.poses[int(p.device.pose[np.argmax(np.linalg.norm(far, axis=1))])]
        kinds["device_over_noise"] = far, "second_device_noise", f", largest at pose {worst},"
    tests, free = list[Suspicion](), joint.estimate.degrees_of_freedom / sum(r.size for r, _, _ in kinds.values())
    for name, (r, key, more) in kinds.items():
        remedy = f"state {key} as it is{more} or look for what the models of robot and cameras leave out"
        judged = chi_squared_over_noise(float(np.sum(r**2)), free * r.size).suspicion(name, remedy)
        tests.append(replace(judged, evidence=f"{name.replace('_', ' ')}: {judged.evidence}"))
    means, which, camera = picture_means(p, e)
    steady = "has the camera, or what stands, moved between poses? calibrate the parts before and after by themselves"
    for k, name in enumerate(p.cameras):
        own = means[camera == k][np.argsort(which[camera == k])]
        least = ROUNDING * float(np.sqrt(len(p) / len(means))) / float(np.mean(p.sigma[p.camera == k]))
        colour = coloured(np.zeros((*own.shape, 0)), own, steady, name=f"steady_{name}", least=least)
        tests.append(replace(colour, evidence=f"pictures of {name}, in the order of the poses: {colour.evidence}"))
    return tests
