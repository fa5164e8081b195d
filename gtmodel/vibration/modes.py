"""Modes of M x'' + D x' + K x = f, the meaning of the signs of its matrices (Dressler 2012, eq. (6.15)), the nearest
symmetric positive definite M, D and K, and the study of printed matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Unpack

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..inference.nonlinear import by_differences, nonlinear_fit
from ..linear.state_space import frequency_and_damping, second_order
from ..results import ArgumentError, Check, Row, SolveStatus, Work, at_most
from ..results.work import WorkOptions, study_function
from .options import Matrices
from .vibration_result import VibrationStudy, numbers, pairs_of, rows_of

REAL = 1e-9  # relative: smaller imaginary, or real, parts are rounding errors
FREE = 1e-7  # relative to the largest pole: the poles of a free motion are only accurate to the square root of rounding
SYMMETRIC = 1e-9  # relative asymmetry from rounding
# sign changes of D and K, as printed first
SIGNS = {"as printed": (1, 1), "K flipped": (1, -1), "D flipped": (-1, 1), "D and K flipped": (-1, -1)}


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of a matrix triple of p coordinates, slowest first.

    `eigenvalues` (p,) of M^-1 K [1/s2]; `frequency_Hz` (p,) = sqrt(abs) / 2 pi, from det(M lambda + K) = 0 with
    lambda = -eigenvalue; `shapes` (p, p) by column, largest entry 1, complex if the eigenvalues are. `poles` (2p,)
    [1/s] of M s^2 + D s + K, with `pole_Hz` = abs / 2 pi and `damping` = -Re / abs. `stable`: all poles are left of the
    imaginary axis by more than rounding. `notes`: sentences on definiteness and signs.
    """

    eigenvalues: np.ndarray
    frequency_Hz: np.ndarray
    shapes: np.ndarray
    poles: np.ndarray
    notes: tuple[str, ...]

    @property
    def pole_Hz(self) -> np.ndarray:
        """Moduli of the poles over 2 pi (2p,) [Hz]."""
        return frequency_and_damping(self.poles)[0]

    @property
    def damping(self) -> np.ndarray:
        """Damping ratios of the poles (2p,), 0 on the imaginary axis, negative for poles that grow."""
        return np.where(on_axis(self.poles), 0.0, frequency_and_damping(self.poles)[1])

    @property
    def stable(self) -> bool:
        """Whether all poles are left of the imaginary axis by more than rounding."""
        return bool(np.all((np.real(self.poles) < 0) & ~on_axis(self.poles)))


def modes(M: ArrayLike, D: ArrayLike, K: ArrayLike) -> Modes:
    """Return the modes of M x'' + D x' + K x = 0; M, D, K (p, p) [kg, N.s/m, N/m], of any sign, symmetric or not.

    The matrices are used as they are: `notes` report asymmetric, indefinite and unstable ones. Raises ArgumentError for
    unequal shapes, numbers that are not finite, and a singular M.

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -90e3], [-90e3, 90e3]])
    >>> m = gt.vibration.modes(M, D, K)
    >>> m.frequency_Hz.round(2), m.stable
    (array([ 5.84, 16.81]), True)
    """
    M, D, K = matrices(M, D, K)
    pairs: Any = scipy.linalg.eig(K, M)
    values, shapes = pairs
    if np.abs(np.imag(values)).max() <= REAL * np.abs(values).max():
        values, shapes = np.real(values), np.real(shapes)
    order = np.argsort(np.abs(values), kind="stable")
    shapes = shapes[:, order]
    shapes = shapes / shapes[np.argmax(np.abs(shapes), axis=0), np.arange(len(M))]
    poles = _sorted(pencil_poles(M, D, K))
    notes = [f"{name} is {definiteness(X)}" for name, X in (("M", M), ("D", D), ("K", K))]
    notes += _signs(values[order], poles)
    return Modes(values[order], np.sqrt(np.abs(values[order])) / (2 * np.pi), shapes, poles, tuple(notes))


def on_axis(poles: np.ndarray) -> np.ndarray:
    """Poles that neither grow nor decay within rounding: undamped vibrations and free motions."""
    size = np.abs(poles)
    return (np.abs(np.real(poles)) <= REAL * size) | (size <= FREE * size.max(initial=0.0))


def pencil_poles(M: np.ndarray, D: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Roots (2p,) of det(M s^2 + D s + K) = 0 [1/s]."""
    return np.linalg.eigvals(second_order(M, D, K, M[:, :0])[0])


def definiteness(X: np.ndarray) -> str:
    """In words: the sign of x'X x from the symmetric part, and the eigenvalues of an asymmetric X."""
    ends = np.linalg.eigvalsh((X + X.T) / 2)
    size = np.abs(ends).max()
    if size == 0 and not np.any(X):
        return "zero"
    if ends[0] > REAL * size:
        text = "positive definite"
    elif ends[-1] < -REAL * size:
        text = "negative definite"
    elif ends[0] >= -REAL * size:
        text = "positive semidefinite"
    elif ends[-1] <= REAL * size:
        text = "negative semidefinite"
    else:
        text = "indefinite"
    if np.abs(X - X.T).max() <= SYMMETRIC * np.abs(X).max():
        return f"symmetric and {text}"
    eigenvalues = ", ".join(_number(v) for v in sorted(np.linalg.eigvals(X), key=lambda v: (v.real, v.imag)))
    return f"not symmetric; its symmetric part is {text}, its eigenvalues are {eigenvalues}"


def matrices(*values: ArrayLike) -> tuple[np.ndarray, ...]:
    """Square matrices of one size, M first. Raises ArgumentError."""
    arrays = tuple(np.asarray(X, float) for X in values)
    shape = arrays[0].shape
    if len(shape) != 2 or shape[0] != shape[1] or shape[0] == 0 or any(X.shape != shape for X in arrays):
        raise ArgumentError(
            f"the matrices have the shapes {', '.join(str(X.shape) for X in arrays)}; expected equal square ones"
        )
    if not all(np.isfinite(X).all() for X in arrays):
        raise ArgumentError("a matrix has a number that is not finite; expected finite numbers")
    if np.linalg.cond(arrays[0]) > 1 / np.finfo(float).eps:
        raise ArgumentError("M is singular: a coordinate has no inertia; leave it out, or set its mass")
    return arrays


def _signs(values: np.ndarray, poles: np.ndarray) -> list[str]:
    notes = []
    if np.iscomplexobj(values):
        notes.append("M^-1 K has complex eigenvalues: no undamped modes exist")
    elif np.all(values > 0):
        notes.append("M^-1 K has positive eigenvalues only: every mode is a vibration")
    else:
        n = int(np.sum(values <= 0))
        notes.append(f"M^-1 K has {n} of {len(values)} eigenvalues that are not positive: without damping they diverge")
    neutral = on_axis(poles)
    unstable, count = poles[(np.real(poles) > 0) & ~neutral], int(np.sum(neutral))
    if not unstable.size and not count:
        notes.append("M s^2 + D s + K is stable")
    elif not unstable.size:
        notes.append(f"M s^2 + D s + K is undamped: {count} of {len(poles)} poles neither grow nor decay")
    else:
        growth = np.real(unstable).max()
        notes.append(
            f"M s^2 + D s + K is unstable: {unstable.size} of {len(poles)} poles grow, by up to {growth:.4g} 1/s"
        )
    return notes


def sign_question(M: ArrayLike, D: ArrayLike, K: ArrayLike) -> tuple[str, ...]:
    """Test which sign changes of D, K or both make M s^2 + D s + K stable: one sentence for each, with the poles.

    Source of the question: the printed K of Dressler 2012, eq. (6.15).

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -90e3], [-90e3, 90e3]])
    >>> gt.vibration.sign_question(M, D, -K)[1]
    'K flipped: stable, poles at 5.837, 16.81 Hz'
    """
    M, D, K = matrices(M, D, K)
    sentences = []
    for name, (d, k) in SIGNS.items():
        m = modes(M, d * D, k * K)
        frequencies = ", ".join(f"{f:.4g}" for f in _distinct(m.pole_Hz))
        sentences.append(f"{name}: {'stable' if m.stable else 'unstable'}, poles at {frequencies} Hz")
    return tuple(sentences)


def _distinct(numbers: np.ndarray) -> Sequence[float]:
    distinct: list[float] = []
    for x in sorted(numbers):
        if not distinct or x - distinct[-1] > 1e-9 * max(x, 1e-300):
            distinct.append(float(x))
    return distinct


def _sorted(poles: np.ndarray) -> np.ndarray:
    """By modulus; of a pair, the positive imaginary part first."""
    return np.array(sorted(poles, key=lambda s: (round(abs(s), 9), round(s.real, 9), -s.imag)))


def _number(v: complex) -> str:
    return f"{v.real:.5g}" if abs(v.imag) <= REAL * abs(v) else f"{v.real:.5g}{v.imag:+.5g}i"


@dataclass(frozen=True, eq=False)
class DefiniteForm:
    """Symmetric positive definite M and K (p, p) with the original M^-1 K, and the nearest symmetric D >= 0.

    trace(M) is the original one. `asymmetry`: relative size of the part of D that no choice of M makes symmetric;
    `raised`: relative size of the part added to make D positive semidefinite; both are 0 for a passive structure.
    `notes` report them.
    """

    M: np.ndarray
    D: np.ndarray
    K: np.ndarray
    asymmetry: float
    raised: float
    notes: tuple[str, ...]


def definite_form(M: ArrayLike, D: ArrayLike, K: ArrayLike) -> DefiniteForm:
    """Return a passive structure with the frequencies and shapes of M x'' + K x = 0 and damping as near to D as
    possible.

    With M^-1 K = V diag(w^2) V^-1, M = V^-T S V^-1 and K = V^-T S diag(w^2) V^-1 are symmetric positive definite for
    every diagonal S > 0. S makes D = M (M^-1 D) as symmetric as possible in modal coordinates of unit mass; its
    symmetric part there is then projected onto the positive semidefinite matrices. Raises ArgumentError for wrong
    shapes, a singular M, and an eigenvalue of M^-1 K that is not real and positive: no passive structure has it.

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -80e3], [-90e3, 90e3]])  # not symmetric, as printed or measured
    >>> nearest = gt.vibration.definite_form(M, D, K)
    >>> np.allclose(nearest.K, nearest.K.T)
    True
    >>> gt.vibration.modes(nearest.M, nearest.D, nearest.K).frequency_Hz.round(3)
    array([ 6.379, 16.611])
    >>> gt.vibration.modes(M, D, K).frequency_Hz.round(3)
    array([ 6.379, 16.611])
    """
    M0, D0, K0 = matrices(M, D, K)
    p = len(M0)
    X_K, X_D = np.linalg.solve(M0, K0), np.linalg.solve(M0, D0)
    values, V = np.linalg.eig(X_K)
    if np.abs(np.imag(values)).max() > REAL * np.abs(values).max() or np.any(np.real(values) <= 0):
        eigenvalues = ", ".join(f"{v:.4g}" for v in values)
        raise ArgumentError(
            f"M^-1 K has the eigenvalues {eigenvalues} 1/s2; for symmetric positive definite M and K all are positive: "
            "check the signs of M and K"
        )
    V = np.real(V)
    C = np.linalg.solve(V, X_D @ V)
    size = max(float(np.linalg.norm(C)), 1e-300)
    upper = np.triu_indices(p, 1)

    def scaled(x: np.ndarray) -> np.ndarray:
        e = np.exp(np.append(0.0, x) / 2)
        return C * e[:, None] / e[None, :]

    x = np.zeros(p - 1)
    if p > 1 and np.any(C[upper]):
        residuals = by_differences(lambda x: (scaled(x) - scaled(x).T)[upper] / size, len(upper[0]))
        x = nonlinear_fit(residuals, x, [f"x[{k}]" for k in range(p - 1)], sigma=1.0, hold_undetermined=True).x
    S = scaled(x)
    asymmetry = float(np.linalg.norm(S - S.T) / 2 / max(float(np.linalg.norm(S)), 1e-300))
    w, Q = np.linalg.eigh((S + S.T) / 2)
    clipped = np.maximum(w, 0.0)
    raised = float(np.linalg.norm(clipped - w) / max(float(np.linalg.norm(w)), 1e-300))
    # mass-normalised shapes P with P' M P = 1
    W = np.exp(np.append(0.0, x) / 2)[:, None] * np.linalg.inv(V)
    m, d = W.T @ W, W.T @ (Q * clipped) @ Q.T @ W
    k = W.T @ np.diag(np.real(values)) @ W
    size = abs(float(np.trace(M0))) / float(np.trace(m))
    notes = ["M and K are symmetric and positive definite, with the frequencies and shapes of the original M^-1 K"]
    if asymmetry > REAL:
        notes.append(f"{100 * asymmetry:.3g} % of the damping is not symmetric for any M: that part was dropped")
    if raised > REAL:
        notes.append(
            f"the damping is not passive: {100 * raised:.3g} % was added to make D positive semidefinite"
        )  # fmt: skip
    return DefiniteForm(size * m, size * d, size * k, asymmetry, raised, tuple(notes))


_TRIED = ("as printed", "D and K flipped", "K flipped", "D flipped")  # for a passive structure, in this order


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MatricesStudy(VibrationStudy):
    """Modes of printed matrices, which are never changed without a note."""

    def _model_rows(self) -> list[Row]:
        rows = [
            Row(
                "modes of det(M lambda + K) = 0", numbers([] if self.frequency is None else self.frequency, ".6g"), "Hz"
            ),
            *(Row("signs", w) for w in self.signs or ()),
        ]
        d = self.definite
        if d:
            rows += [
                Row(f"nearest passive structure ({d['signs']}): M", rows_of(d["M_kg"]), "kg"),
                Row("D", rows_of(d["D_kg_s"]), "kg/s"),
                Row("K", rows_of(d["K_N_m"]), "N/m"),
            ]
        return rows


@study_function
def matrices_study(matrices: Matrices, **work_options: Unpack[WorkOptions]) -> MatricesStudy:
    """Compute the modes of M x'' + D x' + K x = f as printed, the signs that make them stable, and the nearest passive
    structure.

    matrices: M [kg], D [kg/s] and K [N/m], and modes [Hz] printed with them, to be reproduced. The study is too fast
    for progress, max_seconds or stop to matter. Raises ArgumentError.

    >>> from gtmodel.vibration import Matrices, matrices_study
    >>> s = matrices_study(Matrices(M=[[2.0]], D=[[0.4]], K=[[200.0]]))
    >>> round(float(s.frequency[0]), 3), s.stable
    (1.592, True)
    """
    work = Work(**work_options)
    M, D, K = (np.array(getattr(matrices, name), float) for name in "MDK")
    try:
        printed = modes(M, D, K)
        signs = sign_question(M, D, K)
    except ValueError as error:
        raise ArgumentError(str(error), "matrices") from error
    by_signs = {name: modes(M, d * D, k * K) for name in _TRIED for d, k in [SIGNS[name]]}
    chosen, definite, refused = _passive(M, D, K, by_signs)
    notes = [*printed.notes, *(definite.notes if definite else [refused])]
    if definite and chosen != "as printed":
        notes.append(f"probably {chosen} is meant: this is inferred from stability, not printed")
    return MatricesStudy(
        status=SolveStatus.SOLVED,
        message="stable as printed" if printed.stable else "unstable as printed; see the signs",
        title=work.title,
        checks=_checks(matrices, printed),
        figures={"poles": partial(_figure, by_signs, definite, chosen, work.title or "poles")},
        notes=notes,
        frequency=printed.frequency_Hz,
        damping=printed.damping,
        poles=pairs_of(printed.poles),
        M=M,
        D=D,
        K=K,
        stable=printed.stable,
        signs=list(signs),
        definite=None
        if definite is None
        else {"signs": chosen, "M_kg": definite.M, "D_kg_s": definite.D, "K_N_m": definite.K},
    )


def _passive(
    M: np.ndarray, D: np.ndarray, K: np.ndarray, by_signs: dict[str, Modes]
) -> tuple[str, DefiniteForm | None, str]:
    """The first choice of signs that is stable, and its passive structure or the reason why there is none."""
    stable = [name for name, m in by_signs.items() if m.stable]
    if not stable:
        return "", None, "no choice of signs of D and K is stable, so there is no passive structure"
    d, k = SIGNS[stable[0]]
    try:
        return stable[0], definite_form(M, d * D, k * K), ""
    except ArgumentError as error:
        return stable[0], None, str(error)


def _checks(options: Matrices, printed: Modes) -> dict[str, Check]:
    if not options.published:
        return {}
    if len(options.published) != len(printed.frequency_Hz):
        raise ArgumentError(
            f"has {len(options.published)} modes; the matrices have {len(printed.frequency_Hz)}", "matrices.published"
        )
    error = float(np.abs(np.sort(options.published) - printed.frequency_Hz).max())
    return {"published_Hz": at_most(error, options.published_digits)}


def _figure(by_signs: dict[str, Modes], definite: DefiniteForm | None, chosen: str, title: str) -> Any:
    from ..plot.vibration import poles_figure

    poles = {name: by_signs[name].poles for name in dict.fromkeys(["as printed", chosen]) if name}
    if definite:
        poles["nearest passive structure"] = modes(definite.M, definite.D, definite.K).poles
    return poles_figure(poles, by_signs["as printed"].frequency_Hz, title=title)
