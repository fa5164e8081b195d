"""Subspace identification: N4SID, MOESP and CVA on one LQ factor, with order selection and held-out prediction.

A and C come from the subspace; B, D and the initial state from linear least squares on the simulated outputs. The order
is selected by the prediction of held-out samples; the gap of the singular values is reported too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np

from .._lazy import hint
from .._pickling import Portable
from ..linear.response import free_responses, simulate, states
from ..results import ArgumentError
from .options import BLOCK_ROWS, HELD_OUT, LARGEST
from .record import Record, go_on, project

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")

SLACK = 0.02  # relative to the least held-out error, which varies by about 1 % among orders that are high enough
NOTHING = 1e-9  # relative to the rms of the outputs: smaller errors are rounding, and no order is better than another
NOISE_FREE = 1e-12  # relative to the largest singular value: smaller ones are rounding


class OrderTrial(NamedTuple):
    """A tested order: largest modulus of its poles, and rms error on held-out samples, None if it is unstable."""

    order: int
    radius: float
    held_out_rms: float | None


def largest_order(block_rows: int, outputs: int) -> int:
    """The largest order that `block_rows` can determine; shift invariance needs one block row. Raises ArgumentError."""
    if block_rows < 2:
        raise ArgumentError(f"{block_rows} block rows cannot determine any order; use at least 2")
    return (block_rows - 1) * outputs


def gap(singular_values: np.ndarray, largest: int) -> int:
    """The order, from 1, after which the singular values fall by the greatest factor."""
    s = np.maximum(singular_values[: largest + 1], NOISE_FREE * singular_values[0])
    return int(np.argmax(s[:-1] / s[1:])) + 1 if len(s) > 1 else 1


def choose(trials: Sequence[OrderTrial], gap_order: int, size: float) -> tuple[int, str]:
    """The least order within SLACK of the best held-out error, with the reason. `size`: rms of the outputs.

    Raises ArgumentError if every order is unstable.
    """
    stable = {t.order: t.held_out_rms for t in trials if t.held_out_rms is not None}
    if not stable:
        worst = ", ".join(f"{t.order} ({t.radius:.4g})" for t in trials)
        raise ArgumentError(
            f"every order is unstable, with the largest poles {worst}; record longer, or use more block rows"
        )
    bound = (1 + SLACK) * min(stable.values()) + NOTHING * size
    n = next(order for order in sorted(stable) if stable[order] <= bound)
    reason = f"smallest order within {100 * SLACK:g} % of the best held-out error"
    agrees = (
        "the singular values fall most after the same order"
        if gap_order == n
        else f"the singular values fall most after {gap_order}"
    )
    return n, f"{reason}; {agrees}"


def input_matrices(
    record: Record, A: np.ndarray, C: np.ndarray, *, feedthrough: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """B (n, m), D (p, m), x0 (n,) and the output offset (p,) whose simulated outputs fit the measured ones best in the
    2-norm.

    Without `feedthrough` D is zero. A must be stable over the record: powers of an unstable one overflow.
    """
    N, p, m, n = len(record), len(C), record.u.shape[1], len(A)
    F = np.zeros((p, N, m * n + n + p))
    for i in range(p):
        # the transposed system gives C_i (qI - A)^-1 u_j for all states at once
        for j in range(m):
            F[i, :, j * n : (j + 1) * n] = states(A.T, np.outer(record.u[:, j], C[i]), np.zeros(n))
    F[:, :, m * n : m * n + n] = np.moveaxis(free_responses(A, C, N), 1, 0)
    F[range(p), :, range(m * n + n, m * n + n + p)] = 1.0
    right = record.y.T
    if feedthrough:
        # each row of D affects one output: eliminate output by output
        F, right, fit = _without(F, right, record.u)
    size = np.linalg.norm(F, axis=(0, 1))
    size[size == 0] = 1.0
    x = np.linalg.lstsq((F / size).reshape(p * N, -1), right.ravel(), rcond=None)[0] / size
    D = np.zeros((p, m))
    if feedthrough:
        D = np.stack([fit[i][0] - fit[i][1] @ x for i in range(p)])  # pyrefly: ignore[unbound-name]
    return x[: m * n].reshape(m, n).T, D, x[m * n : m * n + n], x[m * n + n :]


def _without(
    F: np.ndarray, right: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Rows after eliminating the direct effect of u, and the terms of D in the remaining unknowns: D_i = d - G x."""
    plus = np.linalg.pinv(u)
    fit = [(plus @ r, plus @ f) for r, f in zip(right, F, strict=True)]
    reduced = [f - u @ g for f, (_, g) in zip(F, fit, strict=True)]
    remainder = [r - u @ d for r, (d, _) in zip(right, fit, strict=True)]
    return np.stack(reduced), np.stack(remainder), fit


Method = Literal["n4sid", "moesp", "cva"]

UNSTABLE = 1 + 1e-9  # modulus of a pole; allows rounding of a pole on the unit circle


@dataclass(frozen=True, eq=False)
class SubspaceModel(Portable):
    """x[k+1] = A x + B u, y = C x + D u + offset, fitted to all samples.

    `system` is a discrete-time control.StateSpace; `initial_state` (n,); `offset` (p,) of the outputs, which the system
    lacks; `singular_values` of the weighted projection, largest first; `order` n with the reason `why`; `gap_order`
    after which the singular values fall most; `trials` by tested order, with the errors on held-out samples;
    `held_out_fit` (p,) on held-out samples in percent (100: exact, 0: no better than the mean), predicted from the
    initial state of the fitted samples; `residual` (p,) rms over all samples, in the unit of the outputs;
    `first_held_out` the first held-out sample. `prediction` (N, p) of the model fitted without the held-out samples;
    `fitted` (N, p) of `system`. `synthetic` as in the record.
    """

    system: StateSpace
    method: Method
    order: int
    why: str
    initial_state: np.ndarray
    offset: np.ndarray
    singular_values: np.ndarray
    gap_order: int
    trials: tuple[OrderTrial, ...]
    held_out_fit: np.ndarray
    residual: np.ndarray
    first_held_out: int
    prediction: np.ndarray
    fitted: np.ndarray
    synthetic: str | None

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues of A (n,)."""
        return np.linalg.eigvals(self.system.A)


def identify_subspace(
    record: Record,
    *,
    order: int | None = None,
    method: Method = "moesp",
    block_rows: int | None = None,
    largest: int = LARGEST,
    feedthrough: bool = False,
    held_out: float = HELD_OUT,
    interrupted: Callable[[], bool] = lambda: False,
) -> SubspaceModel:
    """Fit a state-space model with any number of inputs and outputs.

    Args:
        order: number of states; if left out, the error on held-out samples selects it.
        method: "moesp" (past outputs and inputs as instruments), "n4sid" (states from oblique projections), "cva".
        block_rows: of past and future each; more than order / outputs.
        largest: largest order to try if `order` is left out.
        feedthrough: fit D; otherwise it is zero, as from a force or a reference to a position.
        held_out: share of the samples at the end for validation only, 0 < share < 1.
        interrupted: called before each order; True ends the fit with FitStopped.

    A and C come from the subspace; B, D, the initial state and the output offset from least squares on simulated
    outputs. Offsets of inputs and outputs have no effect. Sources: Verhaegen and Verdult 2007, chapter 9; Van Overschee
    and De Moor 1996, chapter 4. Raises ArgumentError for too few samples, too little excitation, an order that is too
    high, and an unstable model.

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -90e3], [-90e3, 90e3]])
    >>> record = gt.vibration.structure_record(
    ...     M, D, K, force=50.0, hold=8, samples=2000, sample_time=0.004, noise=1e-6, seed=1
    ... )
    >>> model = gt.vibration.identify_subspace(record, order=4)
    >>> model.system.nstates, bool(model.held_out_fit.min() > 99)  # percent
    (4, True)
    """
    if method not in get_args(Method):
        raise ArgumentError(f"unknown method '{method}'; expected {', '.join(get_args(Method))}")
    if not 0 < held_out < 1:
        raise ArgumentError(f"the held-out share is {held_out:g}; expected a number between 0 and 1, such as 0.33")
    p = record.y.shape[1]
    blocks = BLOCK_ROWS if block_rows is None else block_rows
    most = largest_order(blocks, p)
    if order is not None and not 1 <= order <= most:
        raise ArgumentError(
            f"order {order} requested; {blocks} block rows of {p} outputs determine 1 to {most}: lower it, or use more "
            "block rows"
        )
    split = round((1 - held_out) * len(record))
    fitting = record.rows(0, split)
    part = SubspaceProjection(fitting, blocks, method)
    determined = int(np.sum(part.singular_values > NOISE_FREE * part.singular_values[0]))
    if order is not None and order > determined:
        raise ArgumentError(
            f"order {order} requested, but only {determined} singular values are above rounding: "
            f"lower it to {determined}"
        )
    orders = range(1, min(largest, most, max(determined, 1)) + 1) if order is None else [order]
    trials, predictions = [], {}
    for n in orders:
        go_on(interrupted)
        A, C = part.dynamics(n)
        trial = OrderTrial(n, float(np.abs(np.linalg.eigvals(A)).max()), None)
        if trial.radius <= UNSTABLE:
            B, D, x0, offset = input_matrices(fitting, A, C, feedthrough=feedthrough)
            predictions[n] = simulate(A, B, C, D, record.u, x0) + offset
            error = predictions[n][split:] - record.y[split:]
            trial = trial._replace(held_out_rms=float(np.sqrt(np.mean(error**2))))
        trials.append(trial)
    gap_order = gap(part.singular_values, most)
    n, why = (
        choose(trials, gap_order, float(np.sqrt(record.y.var(axis=0).mean()))) if order is None else (order, "as set")
    )
    go_on(interrupted)
    whole = SubspaceProjection(record, blocks, method)
    A, C = whole.dynamics(n)
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    if radius > UNSTABLE or n not in predictions:
        worst = max(radius, next(t.radius for t in trials if t.order == n))
        raise ArgumentError(
            f"the model of order {n} is unstable: a pole has the modulus {worst:.6g}, expected at most 1; use another "
            "order, more block rows or a longer recording"
        )
    B, D, x0, offset = input_matrices(record, A, C, feedthrough=feedthrough)
    from .._control import control

    fitted = simulate(A, B, C, D, record.u, x0) + offset
    return SubspaceModel(
        control.StateSpace(A, B, C, D, record.sample_time),
        method, n, why, x0, offset, whole.singular_values, gap_order, tuple(trials),
        fit_percent(record.y[split:], predictions[n][split:]),
        np.sqrt(np.mean((fitted - record.y) ** 2, axis=0)),
        split, predictions[n], fitted, record.synthetic,
    )  # fmt: skip


def fit_percent(measured: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """100 (1 - |y - y_hat| / |y - mean|) by column (p,); 100 is exact, 0 is no better than the mean."""
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    error = np.linalg.norm(measured - predicted, axis=0)
    return 100 * (1 - error / np.where(spread > 0, spread, 1.0))


class SubspaceProjection:
    """The weighted projection of a record, which gives A and C of any order."""

    def __init__(self, record: Record, blocks: int, method: Method) -> None:
        self.method = method
        self.P = project(record, blocks)
        P, L = self.P, self.P.L
        past, future = P.past, P.future
        self._weight = np.eye(P.p * blocks)
        # MOESP and CVA project out the future inputs
        weighted = _oblique(L, past, future) if method == "n4sid" else L[future, past]
        if method == "cva":
            S = L[future, past.start :]
            w, V = np.linalg.eigh(S @ S.T)
            floor = max(w[-1], 1e-300) * np.finfo(float).eps * len(w)
            self._weight = V @ np.diag(1 / np.sqrt(np.maximum(w, floor))) @ V.T
            weighted = self._weight @ weighted
        self._U, self.singular_values, _ = np.linalg.svd(weighted, full_matrices=False)

    def dynamics(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """A (n, n) and C (p, n)."""
        p = self.P.p
        G = self._U[:, :n] * np.sqrt(np.maximum(self.singular_values[:n], np.finfo(float).tiny))
        if self.method == "cva":
            G = np.linalg.solve(self._weight, G)
        if self.method == "n4sid":
            return self._by_states(G)
        return np.linalg.lstsq(G[:-p], G[p:], rcond=None)[0], G[:p]

    def _by_states(self, G: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A, C from the regression of successive projected states (Van Overschee and De Moor, algorithm 1)."""
        P, L = self.P, self.P.L
        m, p, n = P.m, P.p, G.shape[1]
        first = L[P.future, : P.past.stop]  # Z_i: outputs projected on all inputs and the past outputs
        # one step later: the first future block has become past
        known = np.vstack([L[P.inputs][:m], L[P.past], L[P.future][:p]])
        later_inputs = L[P.inputs][m:]
        basis = np.vstack([later_inputs, known])
        later_outputs = L[P.future][p:]
        Z = later_outputs @ np.linalg.pinv(basis, rcond=1e-12) @ basis
        columns = L.shape[1]
        X = np.linalg.lstsq(G, np.pad(first, ((0, 0), (0, columns - first.shape[1]))), rcond=None)[0]
        X_next = np.linalg.lstsq(G[:-p], Z, rcond=None)[0]
        left = np.vstack([X_next, L[P.future][:p]])
        right = np.vstack([X, L[P.inputs]])
        solution = np.linalg.lstsq(right.T, left.T, rcond=None)[0].T
        return solution[:n, :n], solution[n:, :n]


def _oblique(L: np.ndarray, past: slice, future: slice) -> np.ndarray:
    """The oblique projection of the future outputs along the future inputs onto the past, in LQ coordinates."""
    along = L[future, past] @ np.linalg.pinv(L[past, past], rcond=1e-12)
    return along @ L[past, : past.stop]
