"""Removal of wrong corners, pictures and poses, and tests of the remaining residuals.

The tests are those of all fits, in `gtmodel.vision.residuals` and `gtmodel.measurements.inspection`.
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
ROUGH = 20  # iterations of each
AGAIN = 12  # fits, each without the outliers of the one before
LEAST = 1e-9  # standard deviations: smaller noise is round-off


@dataclass(frozen=True, eq=False)
class RobustFit:
    """The remaining pictures, and descriptions of the removed pictures, corners, and poses; a pose is removed if its
    pictures all contradict the actuator readings. `fit`: fit of the remaining pictures, or a failed fit; `noise`: of
    most corners, in units of their sigma."""

    pictures: RobotPictures
    fit: BundleFit
    noise: float = 1.0
    wrong_pictures: tuple[str, ...] = ()
    wrong_corners: tuple[str, ...] = ()
    wrong_poses: tuple[str, ...] = ()


def robust_fit(ready: Prepared, p: RobotPictures, stop: Callable[[], bool] | None) -> RobustFit:
    """Fit with a robust loss, then repeat without outliers, removing the most improbable picture of each pose first."""
    gross, N = ready.setting.removal, len(p.poses)
    fit, bad = _robust(ready, p, gross, stop)
    if bad is None:
        return RobustFit(p, fit)
    wrong, poses = set(bad.pictures), set[int]()
    single = [p.where(int(k)) for k in np.flatnonzero(bad.corners & ~np.isin(p.picture, bad.pictures))]
    rest = p.corners(~bad.corners)
    for _ in range(AGAIN):
        fit = ready.fit(rest, values=fit.values, covariance=False, stop=stop)
        if not fit.status.ok:
            break
        far = gross_errors(rest, fit.residuals["corners"], gross).corners
        single += [rest.where(int(k)) for k in np.flatnonzero(far)]
        if not far.any():  # only then: a single corner far off shifts the mean of its picture
            more = _shifted(rest, fit.residuals["corners"])
            poses |= {k for k in _open_poses(fit.residuals["links"]) if not any(q % N == k for q in more)}
            wrong |= set(more)
            far = np.isin(rest.picture, more) | np.isin(rest.pose, list(poses))
        if not far.any():
            break
        rest = rest.corners(~far)
    pictures, lost = _named(p, wrong, poses)
    return RobustFit(rest, fit, bad.noise, pictures, tuple(single), lost)


def _robust(
    ready: Prepared, p: RobotPictures, gross: float, stop: Callable[[], bool] | None
) -> tuple[BundleFit, GrossErrors | None]:
    """Fit with Huber's loss until its noise settles, beginning with that of the starting values; None if it fails."""
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


def _shifted(p: RobotPictures, residuals: np.ndarray) -> list[int]:
    """Return the indices of pictures offset as a whole; only the most improbable of each pose, as it shifts the pose
    and thereby the residuals of the other pictures."""
    tested, pictures = shifted_pictures(p, residuals)
    order = tested.beyond()
    worst = {int(pictures[k]) % len(p.poses): int(pictures[k]) for k in order[::-1]}
    return sorted(worst.values())


def _open_poses(links: np.ndarray) -> list[int]:
    """Return the poses with an outlier among the residuals of each closure equation."""
    tested = outliers(links.reshape(-1), groups=np.tile(np.arange(links.shape[1]), len(links)))
    return sorted({int(k) // links.shape[1] for k in tested.beyond()})


def _named(p: RobotPictures, wrong: set[int], poses: set[int]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names of wrong pictures, and of poses whose pictures are all wrong, as their actuator readings are."""
    N = len(p.poses)
    every = np.unique(p.picture)
    by_pose = {n: set(every[every % N == n].tolist()) for n in {k % N for k in wrong} | poses}
    lost = {n for n, pictures in by_pose.items() if n in poses or (len(pictures) > 1 and pictures <= wrong)}
    pictures = tuple(p.picture_name(k) for k in sorted(wrong) if k % N not in lost)
    return pictures, tuple(p.poses[n] for n in sorted(lost))


def suspicions(joint: JointFit) -> list[Suspicion]:
    """Test the remaining residuals: their size against the stated noise, and a drift of each camera's pictures from
    pose to pose."""
    p, e = joint.pictures, joint.residuals
    corners = scaled(p, e)
    kinds = {"over_noise": (corners, "sigma_pixel", f" (residuals show {noise_of(corners):.2g} times its value)"),
             "actuators_over_noise": (joint.fit.residuals["links"], "actuator_noise", "")}  # fmt: skip
    if "device" in joint.fit.residuals and p.device is not None:
        far = joint.fit.residuals["device"] / p.device.noise
        worst = p.poses[int(p.device.pose[np.argmax(np.linalg.norm(far, axis=1))])]
        kinds["device_over_noise"] = far, "second_device_noise", f" (largest residual at pose {worst})"
    tests, free = list[Suspicion](), joint.estimate.degrees_of_freedom / sum(r.size for r, _, _ in kinds.values())
    for name, (r, key, more) in kinds.items():
        remedy = f"correct {key}{more}, or look for effects that the models of robot and cameras do not include"
        judged = chi_squared_over_noise(float(np.sum(r**2)), free * r.size).suspicion(name, remedy)
        tests.append(replace(judged, evidence=f"{name.replace('_', ' ')}: {judged.evidence}"))
    means, which, camera = picture_means(p, e)
    steady = "check whether the camera or the target's mount has moved; calibrate the poses before and after separately"
    for k, name in enumerate(p.cameras):
        ordered = means[camera == k][np.argsort(which[camera == k])]
        least = ROUNDING * float(np.sqrt(len(p) / len(means))) / float(np.mean(p.sigma[p.camera == k]))
        colour = coloured(np.zeros((*ordered.shape, 0)), ordered, steady, name=f"steady_{name}", least=least)
        tests.append(replace(colour, evidence=f"pictures of {name}, in the order of the poses: {colour.evidence}"))
    return tests
