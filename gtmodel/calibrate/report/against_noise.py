"""How large errors of measured poses are, fitted and held out together, beside the noise that was stated for them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...inference import FALSE_ALARM, OverNoise, chi_squared_over_noise
from ...inference.held_out import MATTERS
from ...inference.make_estimate import RANK
from ...inference.normal_equations import triangle
from ...inference.weighting import prior_rows
from ..block_rows import BlockRows
from ..calibration import Calibration
from ..problem import CalibrationProblem, noise_covariance


def against_noise(
    c: Calibration,
    held_out: Sequence[CalibrationProblem] = (),
    *,
    false_alarm: float = FALSE_ALARM,
    matters: float = MATTERS,
) -> OverNoise | None:
    """Judge the errors of all poses, those of the fit and of problems of held-out ones, against the stated noise.

    The errors are orthogonal distances, the smallest changes of all that was measured that close a pose, in units of
    their covariance. Their sum of squares at the unknowns that explain all poses best is chi-squared with as many
    degrees of freedom as errors and priors less determined unknowns; these unknowns are one Gauss-Newton step away, so
    that the cost of the fit does not matter. An error that the fit has taken up is found in the held-out poses, and
    few spare equations of the fit are no lack of power. None where a noise is not stated, or no pose closes by it.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> rng = np.random.default_rng(1)
    >>> T = rng.uniform([0.0, -1.0, 0.2], [1.0, 0.0, 0.8], (30, 3))
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T + 1e-4 * rng.normal(size=T.shape)}, {"q": 1e-6, "T": 1e-4})
    >>> c = gt.calibrate.calibrate(robot, poses.part(np.arange(20)))
    >>> judged = gt.calibrate.against_noise(c, [c.problem.on(poses.part(np.arange(20, 30)))])
    >>> judged.passed, judged.degrees_of_freedom  # 90 errors, 21 unknowns
    (True, 69)
    """
    if not all(n in p.measurements.noise for p in (*c.problem.parts, *held_out) for n in p.reading.places):
        return None
    u = c.problem.unknowns
    n = len(u.names)
    size = np.append(u.sizes, 1.0)
    P, p = prior_rows(u.priors, u.names)
    R, errors = triangle(np.zeros((0, 0)), np.column_stack([P, P @ c.x - p]) * size), 0
    for poses in (*c.problem.parts, *held_out):
        S = noise_covariance(poses, "orthogonal")
        for block in poses.blocks_of("orthogonal"):
            rows = BlockRows(block, poses.reading.data, 1.0, S, poses.begin(block, S))
            for A in rows(c.x[block.columns]):
                closed = A[np.isfinite(A[:, -1])]
                full = np.zeros((len(closed), n + 1))
                full[:, [*block.columns.tolist(), n]] = closed
                R = triangle(R, full * size)
                errors += len(closed)
    if not errors:
        return None
    U, s, _ = np.linalg.svd(R[:, :-1], full_matrices=False)
    inside = U[:, s > RANK * s.max(initial=0.0)]
    r = R[:, -1]
    left = r - inside @ (inside.T @ r)
    spare = errors + len(P) - inside.shape[1]
    return chi_squared_over_noise(float(left @ left), spare, false_alarm=false_alarm, matters=matters)
