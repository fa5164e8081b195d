"""Information of each pose on the unknowns, before anything is measured: whitened Jacobians per pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..inference import Identifiability, identifiability
from ..inference.covariance import spectrum
from ..inference.weighting import prior_rows
from ..lang.source import ModelError
from .implicit import require_noise_enough
from .problem import CalibrationProblem, noise_covariance

# relative part of a prediction's Jacobian in undetermined directions above which it cannot be predicted
LEAK = 1e-6


@dataclass(frozen=True, eq=False)
class PoseInformation:
    """Information of N candidate poses on n unknowns `names`, in units of `sizes`, their expected errors.

    `rows` (N, k, n): Jacobian of the measurements at a pose divided by their noise; `priors` (p, n) likewise. `basis`
    (n, r): orthonormal basis of the combinations that all poses together determine. The information of poses is the sum
    of rows' rows: J' (B S B')^-1 J with Jacobians J in the unknowns and B in the noise, whose covariance is S.
    """

    names: tuple[str, ...]
    sizes: np.ndarray
    rows: np.ndarray
    priors: np.ndarray
    basis: np.ndarray

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def rank(self) -> int:
        """Number of combinations of unknowns that all poses together determine."""
        return self.basis.shape[1]

    @property
    def reduced(self) -> np.ndarray:
        """Rows (N, k, r) in the determined combinations."""
        return self.rows @ self.basis

    def matrix(self, selection: ArrayLike | None = None) -> np.ndarray:
        """Return the information (r, r) of some poses (default all) and the priors, in the determined combinations."""
        rows = self._stacked(selection)
        return rows.T @ rows

    def covariance(self, selection: ArrayLike | None = None) -> np.ndarray:
        """Return the predicted covariance (n, n) of the unknowns, in their units, from some poses (default all).

        It covers the combinations that all poses determine, for a fit with cost "orthogonal", which is optimal. Raises
        ModelError if the selected poses determine fewer.
        """
        decomposition = spectrum(self._stacked(selection))
        if decomposition.rank < self.rank:
            count = len(self) if selection is None else len(np.asarray(selection))
            raise ModelError(
                f"{count} poses determine fewer than the {self.rank} combinations that all {len(self)} do; select more "
                "poses"
            )
        return self.sizes[:, None] * (self.basis @ decomposition.inverse @ self.basis.T) * self.sizes

    def std(self, selection: ArrayLike | None = None) -> dict[str, float]:
        """Return the predicted standard deviation by unknown; infinite if no pose separates it from others."""
        std = np.sqrt(np.diag(self.covariance(selection)))
        lost = 1 - np.sum(self.basis**2, axis=1) > LEAK
        return dict(zip(self.names, np.where(lost, np.inf, std).tolist(), strict=True))

    def identifiability(self, selection: ArrayLike | None = None) -> Identifiability:
        """Return how well some poses (default all) determine each unknown, with the observability indices O1 to O5."""
        selected = self.rows if selection is None else self.rows[np.asarray(selection)]
        rows = np.vstack([selected.reshape(-1, len(self.names)), self.priors]) / self.sizes
        return identifiability(rows, self.names, scale=self.sizes, poses=len(selected))

    def _stacked(self, selection: ArrayLike | None) -> np.ndarray:
        selected = self.reduced if selection is None else self.reduced[np.asarray(selection)]
        return np.vstack([selected.reshape(-1, self.rank), self.priors @ self.basis])


def pose_information(problem: CalibrationProblem) -> PoseInformation:
    """Return the information of the poses of a problem, measured or only commanded, from the device's noise.

    The noise of every signal counts; that of the actuators only if stated. Raises ModelError if the noise cannot close
    the equations, or if the model does not reach a pose.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T}, noise={"T": 2e-5})
    >>> problem = gt.calibrate.prepare(robot, poses)
    >>> info = gt.calibrate.pose_information(problem)
    >>> info.rank, round(1e6 * info.std()["L[0]"])  # um
    (21, 182)
    """
    u, read = problem.unknowns, problem.reading
    if not u.names:
        raise ModelError("no parameter is free, so that poses have nothing to determine")
    S = noise_covariance(problem, "orthogonal")
    N, n = len(problem.measurements), len(u.names)
    blocks_rows = []
    for b in problem.blocks_of("orthogonal"):
        labels = tuple(problem.labels[k] for k in b.rows)
        require_noise_enough(b, read.data, S, problem.begin(b, S), u.start[b.columns], labels)
        _, J = problem.adjustment(b, S).per_pose(u.start[b.columns])
        lost = np.flatnonzero(~np.all(np.isfinite(J), axis=(1, 2)))
        if lost.size:
            raise ModelError(f"the model cannot close pose {lost[0]} (from 0); choose poses that it reaches")
        rows = np.zeros((N, J.shape[1], n))
        rows[:, :, b.columns] = J * u.sizes[b.columns]
        blocks_rows.append(rows)
    P, _ = prior_rows(u.priors, u.names)
    return made(u.names, u.sizes, np.concatenate(blocks_rows, axis=1), P * u.sizes)


def made(names: Sequence[str], sizes: np.ndarray, rows: np.ndarray, priors: np.ndarray) -> PoseInformation:
    """PoseInformation from scaled, whitened rows (N, k, n) and priors (p, n)."""
    s = spectrum(np.vstack([rows.reshape(-1, len(names)), priors]))
    return PoseInformation(tuple(names), np.asarray(sizes, float), rows, priors, s.V[:, : s.rank])
