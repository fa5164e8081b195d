"""M, D, K by output error: the matrices whose simulated positions fit the measured ones best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from gtmodel.inference import nonlinear_fit, whiteness
from gtmodel.inference.covariance import carried, moved_together
from gtmodel.inference.nonlinear import by_differences, central
from gtmodel.results import Estimate

from ..linear.response import free_responses, simulate
from ..linear.state_space import held, second_order
from ..results import ArgumentError
from .physical_form import SecondOrder
from .record import Record, go_on

Form = Literal["symmetric", "free"]

PART = 1e-6  # relative to the largest entry of a null direction: smaller ones are rounding of the differences
REWEIGHTED = 4  # fits after the first, each with the outputs weighted by their noise in the previous one
SETTLED = 0.02  # a smaller change of a weight changes no printed interval
QUIETEST = 1e-6  # relative to the mean noise: least noise assumed for an output, also for a constant one


@dataclass(frozen=True, eq=False)
class OutputErrorFit:
    """The matrices from output error, with their covariance.

    `estimate`: entries "M[0,0]", "D[0,1]" ... with intervals (upper triangles if symmetric); `model`: the same as
    matrices; `residual` (p,) rms [m]; `notes` on undetermined entries and coloured residuals.
    """

    model: SecondOrder
    form: Form
    estimate: Estimate
    residual: np.ndarray
    fitted: np.ndarray
    notes: tuple[str, ...]


def output_error(
    record: Record,
    start: SecondOrder,
    *,
    form: Form = "symmetric",
    interrupted: Callable[[], bool] = lambda: False,
) -> OutputErrorFit:
    """Fit M, D, K of M x'' + D x' + K x = F u to positions x and inputs u with zero-order hold; F is known.

    Args:
        start: from `from_known`; its F is used.
        form: "symmetric": the unknowns are the Cholesky factors of M, D and K, which are thus positive definite for any
            data; "free": D may be any matrix, M and K symmetric of any sign (one force would not determine asymmetric
            ones).
        interrupted: called at each iteration; True ends the fit with FitStopped.

    Variable projection eliminates the initial state. Gauss-Newton uses central differences. The covariance assumes
    white noise of unknown size on the positions; `notes` say whether the residuals are white. Entries that the record
    does not determine, such as all of them if no force acts, keep the proportions of the start; their intervals are
    infinite. Raises ArgumentError for an unknown form, a start that is not positive definite for "symmetric", and no
    convergence.

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -90e3], [-90e3, 90e3]])
    >>> record = gt.vibration.structure_record(
    ...     M, D, K, force=50.0, hold=8, samples=2000, sample_time=0.004, noise=1e-6, seed=1
    ... )
    >>> form = gt.vibration.physical_form(gt.vibration.identify_subspace(record, order=4).system)
    >>> fit = gt.vibration.output_error(record, gt.vibration.from_known(form, force=[1.0, 0.0]))
    >>> low, high = fit.estimate.interval("M[0,0]")  # kg
    >>> bool(29.9 < low < 30.0 < high < 30.1)
    True
    """
    if form not in get_args(Form):
        raise ArgumentError(f"unknown form '{form}'; expected {' or '.join(get_args(Form))}")
    p = len(start.M)
    if record.y.shape[1] != p or record.u.shape[1] != start.F.shape[1]:
        raise ArgumentError(
            f"the record has {record.u.shape[1]} inputs and {record.y.shape[1]} outputs; the matrices need "
            f"{start.F.shape[1]} and {p}"
        )
    packing = _Symmetric(start) if form == "symmetric" else _Free(start)

    weights = np.ones(p)  # of the outputs

    def misfit(x: np.ndarray) -> np.ndarray:
        go_on(interrupted)
        return (weights * (_predict(record, *packing.unpack(x), start.F, weights) - record.y)).T.ravel()

    residuals = by_differences(misfit, record.y.size)
    ones = np.ones(len(packing.scale))
    raw = [f"x[{k}]" for k in range(len(ones))]
    with np.errstate(all="ignore"):
        fit = nonlinear_fit(residuals, ones, raw, scale=ones, hold_undetermined=True)
        for _ in range(REWEIGHTED):
            if fit.estimate is None:
                break
            before = weights
            weights = weights_of(record.y, _predict(record, *packing.unpack(fit.x), start.F, before))
            if settled(weights, before):
                break
            fit = nonlinear_fit(residuals, fit.x, raw, scale=ones, hold_undetermined=True)
    if fit.estimate is None:
        raise ArgumentError(
            f"the output-error fit did not converge: {fit.message}; use a longer record or a start nearer to the data"
        )
    names = [f"{X}[{i},{j}]" for X, i, j in packing.entries]

    def flat(x: np.ndarray) -> np.ndarray:
        matrices: dict[str, np.ndarray] = dict(zip("MDK", packing.unpack(x), strict=True))
        return np.array([matrices[X][i, j] for X, i, j in packing.entries])

    jacobian = central(flat, fit.x)
    e = fit.estimate
    M, D, K = packing.unpack(fit.x)
    sizes = np.array([np.abs({"M": M, "D": D, "K": K}[X]).max() for X, _, _ in packing.entries])
    null = jacobian @ e.null_space / sizes[:, None] if e.null_space.size else np.zeros((len(names), 0))
    null = np.where(np.abs(null) > PART * np.abs(null).max(axis=0), null, 0.0)
    estimate = Estimate(
        tuple(names), flat(fit.x), carried(jacobian, e.covariance), e.degrees_of_freedom, e.noise, e.known_noise,
        e.residuals, (), units=tuple({"M": "kg", "D": "N.s/m", "K": "N/m"}[X] for X, _, _ in packing.entries),
        notes=tuple(moved_together(null, tuple(names))), null_space=null * sizes[:, None],
    )  # fmt: skip
    fitted = _predict(record, M, D, K, start.F, weights)
    error = fitted - record.y
    notes = [*estimate.notes, *(f"coordinate {k + 1}: {whiteness(error[:, k]).message}" for k in range(p))]
    return OutputErrorFit(
        SecondOrder(M, D, K, start.F, 0.0), form, estimate, np.sqrt(np.mean(error**2, axis=0)), fitted, tuple(notes)
    )


def weights_of(y: np.ndarray, fitted: np.ndarray) -> np.ndarray:
    """(p,) weights that scale the noise of all outputs (N, p) to its mean, from the residuals of a fit.

    Least squares repeated with these weights is maximum likelihood for white noise of unknown size at each output.
    """
    size = np.sqrt(np.mean((fitted - y) ** 2, axis=0))
    mean = float(np.sqrt(np.mean(size**2)))
    return np.ones(len(size)) if mean == 0.0 else mean / np.maximum(size, QUIETEST * mean)


def settled(weights: np.ndarray, before: np.ndarray) -> bool:
    """Whether another fit with new weights would change nothing visible."""
    return bool(np.all(np.abs(weights / before - 1) < SETTLED))


def _predict(
    record: Record, M: np.ndarray, D: np.ndarray, K: np.ndarray, F: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Positions (N, p) from the input and the best-fitting initial state and rest positions, with weights (p,)."""
    A, B, C = second_order(M, D, K, F)
    if np.linalg.eigvals(A).real.max() * record.sample_time * len(record) > 100:
        raise ValueError("diverges")
    Ad, Bd = held(A, B, record.sample_time)
    forced = simulate(Ad, Bd, C, np.zeros((len(C), Bd.shape[1])), record.u)
    free = free_responses(Ad, C, len(record))
    # rest position of each output without a force
    free = np.concatenate([free, np.broadcast_to(np.eye(len(C)), (len(free), len(C), len(C)))], axis=2)
    n = free.shape[2]
    weighted = weights[:, None] * free
    size = np.linalg.norm(weighted, axis=(0, 1))
    remainder = (weights * (record.y - forced)).ravel()
    x0 = np.linalg.lstsq((weighted / size).reshape(-1, n), remainder, rcond=None)[0] / size
    return forced + free @ x0


class _Symmetric:
    """M, D and K as Cholesky factors, which keep them positive definite; entries are scaled by their start values."""

    def __init__(self, start: SecondOrder) -> None:
        self.p = len(start.M)
        self.lower = np.tril_indices(self.p)
        parts = []
        for name, X in (("M", start.M), ("D", start.D), ("K", start.K)):
            try:
                parts.append(np.linalg.cholesky((X + X.T) / 2)[self.lower])
            except np.linalg.LinAlgError:
                ends = np.linalg.eigvalsh((X + X.T) / 2)
                raise ArgumentError(
                    f"{name} of the start is not positive definite (eigenvalues {ends[0]:.4g} to {ends[-1]:.4g}); use "
                    "form = 'free', record longer, or start from its nearest positive definite form"
                ) from None
        self.factors = np.concatenate(parts)
        # an entry near zero is relative to its matrix
        self.scale = np.repeat([np.abs(x).max() for x in parts], len(parts[0]))
        self.entries = [(X, i, j) for X in "MDK" for i in range(self.p) for j in range(i, self.p)]

    def unpack(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrices of x, which is 1 at the start."""
        matrices = []
        for part in np.split(self.factors + self.scale * (x - 1), 3):
            L = np.zeros((self.p, self.p))
            L[self.lower] = part
            matrices.append(L @ L.T)
        return matrices[0], matrices[1], matrices[2]


class _Free:
    """Entries of the matrices, relative to the largest entry of each."""

    def __init__(self, start: SecondOrder) -> None:
        p = len(start.M)
        self.start = start
        half = [(i, j) for i in range(p) for j in range(i, p)]
        every = [(i, j) for i in range(p) for j in range(p)]
        self.entries = [(X, i, j) for X, indices in (("M", half), ("D", every), ("K", half)) for i, j in indices]
        self.scale = np.array([np.abs(getattr(start, X)).max() for X, _, _ in self.entries])

    def unpack(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        matrices = {"M": self.start.M.copy(), "D": self.start.D.copy(), "K": self.start.K.copy()}
        matrices["M"], matrices["K"] = (matrices["M"] + matrices["M"].T) / 2, (matrices["K"] + matrices["K"].T) / 2
        for (X, i, j), step in zip(self.entries, self.scale * (x - 1), strict=True):
            matrices[X][i, j] += step
            if X != "D" and i != j:
                matrices[X][j, i] += step
        return matrices["M"], matrices["D"], matrices["K"]
