"""M, D and K from M^-1 K, M^-1 D and what is known of forces or masses: linear equations, symmetric M and K."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..results import ArgumentError
from .physical_form import UNIDENTIFIED, PhysicalForm

RANK = 1e-8  # of the largest singular value of the scaled equations: below, a mass is not determined


@dataclass(frozen=True, eq=False)
class SecondOrder:
    """M x'' + D x' + K x = F u: M [kg], D [N.s/m], K [N/m], all (p, p), F (p, m).

    `left`: relative 2-norm of what the equations for M leave, zero where data are exact. D is as the data have it, not
    made symmetric. `notes`: what limits it, in sentences.
    """

    M: np.ndarray
    D: np.ndarray
    K: np.ndarray
    F: np.ndarray
    left: float
    notes: tuple[str, ...] = ()


def from_known(
    form: PhysicalForm,
    *,
    force: ArrayLike | None = None,
    masses: Mapping[int, float] | None = None,
) -> SecondOrder:
    """M, D, K with symmetric M and K, from what is known of forces or masses.

    Args:
        form: M^-1 K, M^-1 D and M^-1 F.
        force: F (p, m), newtons on each coordinate per unit of each input; e1 for a force on the first. Then M times
            M_inv_F is F.
        masses: diagonal entries of M that are known [kg], by coordinate from 0; D is then taken to be symmetric too.

    Equations are scaled by their sizes and solved by least squares. Raises ArgumentError where neither is given, where
    they do not determine M, with the number of entries that stay open, and where M is not positive definite, which no
    masses are. A K that is not positive definite is said in `notes`.

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -90e3], [-90e3, 90e3]])
    >>> record = gt.vibration.structure_record(
    ...     M, D, K, force=50.0, hold=8, samples=2000, sample_time=0.004, noise=1e-6, seed=1
    ... )
    >>> form = gt.vibration.physical_form(gt.vibration.identify_subspace(record, order=4).system)
    >>> np.diag(gt.vibration.from_known(form, force=[1.0, 0.0]).M).round(1)  # kg
    array([30., 12.])
    >>> np.diag(gt.vibration.from_known(form, masses={0: 30.0, 1: 12.0}).K / 1e3).round()  # N/mm
    array([150., 90.])
    """
    p = len(form.M_inv_K)
    if force is None and not masses:
        raise ArgumentError(f"{UNIDENTIFIED}; give the force on a coordinate in newtons, or a mass in kilograms")
    pairs = [(i, j) for i in range(p) for j in range(i, p)]
    basis = [_symmetric(p, i, j) for i, j in pairs]
    rows, right = [], []

    def demand(blocks: list[np.ndarray], wanted: np.ndarray, size: float) -> None:
        rows.append(np.stack([b.ravel() for b in blocks], axis=1) / size)
        right.append(wanted.ravel() / size)

    upper = np.triu_indices(p, 1)
    skew = [form.M_inv_K] + ([form.M_inv_D] if masses else [])
    for X in skew:
        size = np.linalg.norm(X)
        if len(upper[0]) and size:
            demand([(Q @ X - (Q @ X).T)[upper] for Q in basis], np.zeros(len(upper[0])), float(size))
    F = None
    if force is not None:
        F = np.asarray(force, float)
        F = F[:, None] if F.ndim == 1 else F
        if F.shape != form.M_inv_F.shape or not np.any(F):
            raise ArgumentError(
                f"the force has the shape {F.shape}; expected {form.M_inv_F.shape}, newtons on each coordinate per "
                "unit of each input, not all zero"
            )
        demand([Q @ form.M_inv_F for Q in basis], F, float(np.linalg.norm(form.M_inv_F)))
    for at, mass in (masses or {}).items():
        if not (0 <= at < p and mass > 0):
            raise ArgumentError(
                f"mass {mass} kg of coordinate {at}: expected a coordinate from 0 to {p - 1}, a mass > 0"
            )
        demand([Q[at, at : at + 1] for Q in basis], np.array([mass]), 1.0)
    G, g = np.vstack(rows), np.concatenate(right)
    s = np.linalg.svd(G, compute_uv=False)
    open_ones = len(pairs) - int(np.sum(s > RANK * s[0]))
    if open_ones:
        raise ArgumentError(
            f"{open_ones} of the {len(pairs)} entries of M stay open with what is known: {UNIDENTIFIED}; give a force "
            "on a coordinate, or one more mass"
        )
    m = np.linalg.lstsq(G, g, rcond=None)[0]
    M = sum((x * Q for x, Q in zip(m, basis, strict=True)), np.zeros((p, p)))
    left = float(np.linalg.norm(G @ m - g) / np.linalg.norm(g))
    least = float(np.linalg.eigvalsh(M)[0])
    if least <= 0:
        raise ArgumentError(
            f"M comes out with the eigenvalue {least:.4g} kg, and no structure has it: look at the sign and the "
            "coordinate of the force, at the known masses and at the signs of the outputs; noise on a small mass does "
            "it too"
        )
    K = M @ form.M_inv_K
    soft = float(np.linalg.eigvalsh((K + K.T) / 2)[0])
    notes: tuple[str, ...] = ()
    if soft <= 0:
        notes = (
            f"K is not positive definite, its least eigenvalue is {soft:.4g} N/m: the structure is free to move, "
            "unstable, or a sign is wrong",
        )
    return SecondOrder(M, M @ form.M_inv_D, K, M @ form.M_inv_F if F is None else F, left, notes)


def _symmetric(p: int, i: int, j: int) -> np.ndarray:
    Q = np.zeros((p, p))
    Q[i, j] = Q[j, i] = 1.0
    return Q
