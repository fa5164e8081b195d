"""From a discrete black-box model to M, D and K: continuous time, physical form, known forces or masses.

The matrix logarithm gives continuous time, with a check of its branch. With positions and velocities as states the
model gives M^-1 K and M^-1 D (Dressler 2012, eq. (6.14)). Known forces or masses then give symmetric M, D and K by
linear equations.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from .._lazy import hint
from ..linear.state_space import held
from ..results import ArgumentError
from .record import check_sample_time

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")

NEAR = 0.8  # of the Nyquist frequency: above, the samples alone do not distinguish an alias from the mode
ON_AXIS = 1e-6  # rad: a pole this near the negative real axis has no real logarithm
EXACT = 1e-8  # relative difference allowed between A and the exponential of its logarithm
ZERO = 1e-12  # a smaller pole is zero; its logarithm is not defined


class Continuous(NamedTuple):
    """x' = A x + B u, equal to the discrete model for a zero-order hold.

    `message`: a warning if the fastest pole is near the Nyquist frequency, else empty.
    """

    A: np.ndarray
    B: np.ndarray
    message: str


def continuous(A: np.ndarray, B: np.ndarray, sample_time: float) -> Continuous:
    """Return A_c = logm(A) / T_s on the principal branch, and B_c for a zero-order hold: the exact inverse of c2d.

    A (n, n), B (n, m), sample_time [s]. The principal branch assumes that every pole is below the Nyquist frequency;
    `message` warns if one is near it. Raises ArgumentError for a pole at zero or on the negative real axis, and for a
    logarithm that is not real or not exact.

    >>> model = gt.vibration.continuous(np.array([[0.9]]), np.array([[0.1]]), sample_time=0.004)
    >>> model.A.round(2), model.B.round(2)  # 1/s
    (array([[-26.34]]), array([[26.34]]))
    """
    check_sample_time(sample_time)
    poles = np.linalg.eigvals(A)
    nyquist = 0.5 / sample_time
    if np.abs(poles).min() < ZERO:
        raise ArgumentError("a pole of the model is at zero (a pure delay): it has no continuous form; lower the order")
    if np.any((poles.real < 0) & (np.abs(np.angle(poles)) > np.pi - ON_AXIS)):
        pole = poles[np.argmin(poles.real)].real
        raise ArgumentError(
            f"the pole {pole:.4g} is on the negative real axis, at the Nyquist frequency {nyquist:g} Hz: no real "
            "continuous model has it; lower the order or sample faster"
        )
    n, m = B.shape
    with warnings.catch_warnings():
        # ignore logm's own error estimate; the error is checked below
        warnings.simplefilter("ignore", RuntimeWarning)
        L = np.asarray(scipy.linalg.logm(A))
        # the logarithm of the matrix that also contains the input
        whole = np.asarray(scipy.linalg.logm(np.block([[A, B], [np.zeros((m, n)), np.eye(m)]])))
    if np.abs(np.imag(L)).max() > EXACT * np.abs(L).max():
        raise ArgumentError("the matrix logarithm is not real; lower the order or sample faster")
    A_c = np.real(L) / sample_time
    B_c = np.real(whole)[:n, n:] / sample_time
    A_back, B_back = held(A_c, B_c, sample_time)
    error = max(np.abs(A_back - A).max() / np.abs(A).max(), np.abs(B_back - B).max() / max(np.abs(B).max(), 1e-300))
    if error > EXACT:
        raise ArgumentError(
            f"the matrix logarithm is not exact: relative error {error:.2g}, expected {EXACT:g}; lower the order"
        )
    fastest = float(np.abs(np.angle(poles)).max() / (2 * np.pi * sample_time))
    message = ""
    if fastest > NEAR * nyquist:
        message = (
            f"a mode at {fastest:.4g} Hz is near the Nyquist frequency of {nyquist:.4g} Hz: these samples cannot "
            f"distinguish it from one at {2 * nyquist - fastest:.4g} Hz"
        )
    return Continuous(A_c, B_c, message)


UNIDENTIFIED = "M is not identifiable without a known force or mass; M^-1 K and M^-1 D are"
CONDITION = 1e10  # of T with scaled rows: above, the outputs and their rates are dependent


@dataclass(frozen=True, eq=False)
class PhysicalForm:
    """x'' + `M_inv_D` x' + `M_inv_K` x = `M_inv_F` u for the measured positions x.

    M_inv_K (p, p) [1/s2], M_inv_D (p, p) [1/s], M_inv_F (p, m) [unit of the output per s2 and unit of the input].
    `jump`: relative size of the direct effect of the input on the velocity, in units of the fastest mode. A structure
    has none; noise and a wrong order cause it. `notes`: entries that are not identifiable, modes near Nyquist.
    """

    M_inv_K: np.ndarray
    M_inv_D: np.ndarray
    M_inv_F: np.ndarray
    jump: float
    notes: tuple[str, ...]


def physical_form(system: StateSpace) -> PhysicalForm:
    """Return M^-1 K and M^-1 D of a discrete model of order 2 p whose p outputs are positions.

    A_c = logm(A) / T_s, T = [C; C A_c]; T A_c T^-1 = [[0, I], [-M^-1 K, -M^-1 D]]. The printed eq. (6.14) of Dressler
    2012 lacks an inverse; it should be X = (M s^2 + D s + K)^-1 B U. Raises ArgumentError for another order, a model in
    continuous time, a model without real logarithm, and outputs that are not independent positions.

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -90e3], [-90e3, 90e3]])
    >>> record = gt.vibration.structure_record(
    ...     M, D, K, force=50.0, hold=8, samples=2000, sample_time=0.004, noise=1e-6, seed=1
    ... )
    >>> form = gt.vibration.physical_form(gt.vibration.identify_subspace(record, order=4).system)
    >>> (form.M_inv_K / 100).round()  # 1/s2
    array([[ 50., -30.],
           [-75., 75.]])
    """
    A, B, C = (np.asarray(X) for X in (system.A, system.B, system.C))
    n, p = len(A), len(C)
    if not system.dt or system.dt is True:
        raise ArgumentError(f"the model has the sample time {system.dt}; expected a discrete model, in seconds")
    if n != 2 * p:
        raise ArgumentError(
            f"the model has order {n} and {p} outputs; positions and velocities of {p} coordinates need order {2 * p}: "
            f"set that order, or measure {n // 2} positions"
        )
    c = continuous(A, B, float(system.dt))
    T = np.vstack([C, C @ c.A])
    if np.linalg.cond(T / np.linalg.norm(T, axis=1, keepdims=True)) > CONDITION:
        raise ArgumentError(
            "the outputs and their rates are not independent: two outputs move alike or one does not move; leave one "
            "out"
        )
    A_p, B_p = T @ c.A @ np.linalg.inv(T), T @ c.B
    fastest = float(np.abs(np.linalg.eigvals(c.A)).max())
    jump = fastest * float(np.linalg.norm(B_p[:p])) / max(float(np.linalg.norm(B_p[p:])), 1e-300)
    notes = (UNIDENTIFIED, *([c.message] if c.message else []))
    return PhysicalForm(-A_p[p:, :p], -A_p[p:, p:], B_p[p:], jump, notes)


RANK = 1e-8  # relative to the largest singular value of the scaled equations: below, a mass is not determined


@dataclass(frozen=True, eq=False)
class SecondOrder:
    """M x'' + D x' + K x = F u: M [kg], D [N.s/m], K [N/m], all (p, p), F (p, m).

    `left`: relative 2-norm of the residual of the equations for M, zero for exact data. D is not made symmetric.
    `notes`: limitations, in sentences.
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
    """Return M, D, K with symmetric M and K, from known forces or masses.

    Args:
        form: M^-1 K, M^-1 D and M^-1 F.
        force: F (p, m), newtons on each coordinate per unit of each input; e1 for a force on the first. It adds the
            equations M M_inv_F = F.
        masses: known diagonal entries of M [kg], by coordinate from 0; D is then assumed symmetric too.

    The equations are scaled by their sizes and solved by least squares. Raises ArgumentError if neither is given, if
    they do not determine M (with the number of undetermined entries), and if M is not positive definite, as masses must
    be. `notes` report a K that is not positive definite.

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
        raise ArgumentError(f"{UNIDENTIFIED}; set the force on a coordinate in newtons, or a mass in kilograms")
    pairs = [(i, j) for i in range(p) for j in range(i, p)]
    basis = [_symmetric(p, i, j) for i, j in pairs]
    rows, right = [], []

    def add_equations(blocks: list[np.ndarray], values: np.ndarray, size: float) -> None:
        rows.append(np.stack([b.ravel() for b in blocks], axis=1) / size)
        right.append(values.ravel() / size)

    upper = np.triu_indices(p, 1)
    skew = [form.M_inv_K] + ([form.M_inv_D] if masses else [])
    for X in skew:
        size = np.linalg.norm(X)
        if len(upper[0]) and size:
            add_equations([(Q @ X - (Q @ X).T)[upper] for Q in basis], np.zeros(len(upper[0])), float(size))
    F = None
    if force is not None:
        F = np.asarray(force, float)
        F = F[:, None] if F.ndim == 1 else F
        if F.shape != form.M_inv_F.shape or not np.any(F):
            raise ArgumentError(
                f"the force has the shape {F.shape}; expected {form.M_inv_F.shape}, newtons on each coordinate per "
                "unit of each input, not all zero"
            )
        add_equations([Q @ form.M_inv_F for Q in basis], F, float(np.linalg.norm(form.M_inv_F)))
    for coordinate, mass in (masses or {}).items():
        if not (0 <= coordinate < p and mass > 0):
            raise ArgumentError(
                f"mass {mass} kg of coordinate {coordinate}: expected a coordinate from 0 to {p - 1}, a mass > 0"
            )
        add_equations([Q[coordinate, coordinate : coordinate + 1] for Q in basis], np.array([mass]), 1.0)
    G, g = np.vstack(rows), np.concatenate(right)
    s = np.linalg.svd(G, compute_uv=False)
    undetermined = len(pairs) - int(np.sum(s > RANK * s[0]))
    if undetermined:
        raise ArgumentError(
            f"{undetermined} of the {len(pairs)} entries of M are not determined: {UNIDENTIFIED}; set a force on a "
            "coordinate, or one more mass"
        )
    m = np.linalg.lstsq(G, g, rcond=None)[0]
    M = sum((x * Q for x, Q in zip(m, basis, strict=True)), np.zeros((p, p)))
    residual = float(np.linalg.norm(G @ m - g) / np.linalg.norm(g))
    least = float(np.linalg.eigvalsh(M)[0])
    if least <= 0:
        raise ArgumentError(
            f"M would have the eigenvalue {least:.4g} kg, but must be positive definite: check the sign and the "
            "coordinate of the force, the known masses and the signs of the outputs; noise on a small mass can also "
            "cause it"
        )
    K = M @ form.M_inv_K
    soft = float(np.linalg.eigvalsh((K + K.T) / 2)[0])
    notes: tuple[str, ...] = ()
    if soft <= 0:
        notes = (
            f"K is not positive definite, its least eigenvalue is {soft:.4g} N/m: the structure can move freely or is "
            "unstable, or a sign is wrong",
        )
    return SecondOrder(M, M @ form.M_inv_D, K, M @ form.M_inv_F if F is None else F, residual, notes)


def _symmetric(p: int, i: int, j: int) -> np.ndarray:
    Q = np.zeros((p, p))
    Q[i, j] = Q[j, i] = 1.0
    return Q
