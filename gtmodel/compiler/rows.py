"""Closed-form functions on many rows, with a status for each row, and at one point, on NumPy memory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from ..results.status import Status
from .blocks import VERDICTS
from .columns.kernel import kernel_of

if TYPE_CHECKING:
    from .analysis.sizes import Sizes
    from .causal import CausalFunction


def densified(f: ca.Function) -> ca.Function:
    """Return the same function with dense results."""
    if all(f.sparsity_out(k).is_dense() for k in range(f.n_out())):
        return f
    symbols = f.sx_in()
    return ca.Function(f.name(), symbols, [ca.densify(r) for r in f.call(symbols)])


class PointFunction:
    """A function of columns, called with arrays or numbers; returns each result as a new array of its shape.

    Calls from several threads run one after the other.
    """

    def __init__(self, f: ca.Function) -> None:
        self._f = f
        f = densified(f)
        self._arguments = [np.zeros(f.numel_in(k)) for k in range(f.n_in())]
        self._results = [np.zeros((f.size2_out(k), f.size1_out(k))) for k in range(f.n_out())]
        self._buffer, self._run = f.buffer()
        set_arg: Any = self._buffer.set_arg
        set_res: Any = self._buffer.set_res
        buffers: list[tuple[Any, list[Any]]] = [(set_arg, self._arguments), (set_res, self._results)]
        for setter, arrays in buffers:
            for k, a in enumerate(arrays):
                if a.size:
                    setter(k, memoryview(a))
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return PointFunction, (self._f,)

    def __call__(self, *values: Any) -> list[np.ndarray]:
        with self._lock:
            for argument, value in zip(self._arguments, values, strict=True):
                argument[:] = value
            self._run()
            return [r.T.copy() for r in self._results]


# a pivot below this fraction of its typical size is singular. A pivot that is a square root, as for a link at right
# angles to its guideway, has an error of the root of round-off, 1e-8
PIVOT_TOLERANCE = 1e-7
# rows per mapped function: they fit into the cache, and creating the function costs no more than some rows
BLOCK = 512
# rows per call of a small function, and its largest number of operations: a call costs as much as some forty operations
GROUP, SMALL = 16, 256


def map_columns(
    f: ca.Function, columns: Sequence[np.ndarray], made: dict[int, ca.Function] | None = None
) -> list[np.ndarray]:
    """Evaluate a function on many columns: inputs (size, n), results (r, n * c) for outputs of shape (r, c).

    `made`: a cache of f mapped to numbers of columns, kept by the caller. A `ColumnKernel` evaluates many rows, with
    the same results to the last bit.
    """
    n = columns[0].shape[1] if columns else 1
    if n == 0:
        return [np.zeros((f.size1_out(k), 0)) for k in range(f.n_out())]
    kernel = kernel_of(f, n)
    if kernel is not None:
        return _side_by_side(f, kernel.run(columns)[0])
    dense = all(f.sparsity_out(k).is_dense() for k in range(f.n_out()))
    dense = dense and all(f.sparsity_in(k).is_dense() for k in range(f.n_in()))
    if not dense:
        g = f if n == 1 else f.map(n)
        return [np.array(r.full()) for r in g.call([ca.DM(c) for c in columns])]
    inputs = [np.ascontiguousarray(c.T, dtype=float) for c in columns]
    results = [np.empty((n, f.numel_out(k))) for k in range(f.n_out())]
    size, g = 0, f
    edges = [*range(0, n, BLOCK), n]
    if made is not None and n > GROUP and n % GROUP:
        edges = sorted({*edges, n - n % GROUP})
    for begin, end in pairwise(edges):
        if end - begin != size:
            size = end - begin
            if n == 1:
                g = f
            else:
                g = f.map(size) if made is None else made.get(size) or made.setdefault(size, _grouped(f, size))
        buffer, run = g.buffer()
        set_arg: Any = buffer.set_arg
        set_res: Any = buffer.set_res
        views: list[Any] = [a[begin:end] for a in (*inputs, *results)]
        for k, view in enumerate(views):
            if view.size == 0:
                continue
            if k < len(inputs):
                set_arg(k, memoryview(view))
            else:
                set_res(k - len(inputs), memoryview(view))
        run()
    return _side_by_side(f, results)


def _side_by_side(f: ca.Function, results: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the entries of the outputs (n, r c), stacked by columns, as (r, n c)."""
    shapes = [f.size_out(k) for k in range(len(results))]
    return [r.reshape(len(r) * c, rows).T for r, (rows, c) in zip(results, shapes, strict=True)]


def judged_columns(
    f: ca.Function,
    columns: Sequence[np.ndarray],
    margins: Sequence[Any],
    sizes: Sizes,
    unknowns: Sequence[np.ndarray] = (),
    iteration: np.ndarray | None = None,
    answers: bool = False,
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the results of map_columns for outputs of one column, and their `status_codes`.

    answers: return no margins, and NaN in rows whose status is not OK.
    """
    kernel = kernel_of(f, columns[0].shape[1]) if columns else None
    if kernel is None:
        results = map_columns(f, [*columns, *unknowns])
        codes = status_codes(margins, columns, results, iteration, sizes=sizes)
        if answers:
            results = results[:-1]
            bad = np.flatnonzero(codes != Status.OK)
            for r in results:
                r.T[bad] = np.nan
        return results, codes
    judge = BlockJudge(margins, sizes, columns, unknowns, iteration)
    results, codes = kernel.run([*columns, *unknowns], judge, answers)
    assert codes is not None
    return _side_by_side(f, results), codes


def _grouped(f: ca.Function, size: int) -> ca.Function:
    """Return f mapped to `size` columns; a small function is expanded for GROUP columns at a time."""
    if size % GROUP or not f.is_a("SXFunction") or f.n_instructions() > SMALL:
        return f.map(size)
    return f.map(GROUP).expand().map(size // GROUP)


def status_codes(
    margins: Iterable[Any],
    columns: Sequence[np.ndarray],
    results: Sequence[np.ndarray],
    iteration: np.ndarray | None,
    tolerance: float = PIVOT_TOLERANCE,
    sizes: Sizes | None = None,
) -> np.ndarray:
    """Return the status code of each column, from inputs, `iteration` codes, margins (last of results) and outputs.

    The first cause counts, and a condition on known values before an iteration. `tolerance`: fraction of the typical
    size below which a pivot is singular or a branch is left; limits have the precision of the margins. `sizes`: limits
    of the inputs.
    """
    n = results[-1].shape[1]
    number = results[-1].dtype.type
    code = np.zeros(n, dtype=int) if iteration is None else iteration.copy()
    for m, row in zip(margins, results[-1], strict=True):
        with np.errstate(invalid="ignore"):
            if m.kind in ("pivot", "branch"):
                good = (np.abs(row) if m.kind == "pivot" else row) > number(tolerance) * number(m.scale)
            else:
                good = row >= 0
        if not good.all():
            first = code == 0 if m.kind != "condition" else np.isin(code, (0, Status.NOT_CONVERGED, Status.SINGULAR))
            code[first & ~good] = VERDICTS[m.kind]
    code[(code == 0) & ~_finite(results[:-1], n)] = Status.NOT_FINITE
    if sizes is not None:
        code[~sizes.within(columns)] = Status.OUT_OF_RANGE
    code[~_finite(columns, n)] = Status.NOT_FINITE
    return code


def _finite(columns: Sequence[np.ndarray], n: int) -> np.ndarray:
    """Return in which of n columns all numbers are finite."""
    finite = np.ones(n, dtype=bool)
    for column in columns:
        for row in column:
            finite &= np.isfinite(row)
    return finite


# fraction of the limit of one row below which a sum of squares over a whole block is safe in spite of round-off
_SURELY = 0.999


class BlockJudge:
    """`status_codes` block by block, with fewer passes if all rows are clearly good."""

    def __init__(
        self,
        margins: Sequence[Any],
        sizes: Sizes,
        columns: Sequence[np.ndarray],
        unknowns: Sequence[np.ndarray] = (),
        iteration: np.ndarray | None = None,
    ) -> None:
        """`columns`: arguments with limits of size; the unknowns of Newton blocks have none."""
        self._margins, self._sizes, self._arguments, self._iteration = margins, sizes, len(columns), iteration
        scaled = [m.kind in ("pivot", "branch") for m in margins]
        # other margins may be zero: the limit is the largest negative number
        least = -np.nextafter(0.0, 1.0)
        low = [PIVOT_TOLERANCE * m.scale if s else least for m, s in zip(margins, scaled, strict=True)]
        high = [-x if m.kind == "pivot" else -np.inf for m, x in zip(margins, low, strict=True)]
        weights = {place: weight for weight, places in sizes.groups for place in places}
        weight = [weights[k] for k, c in enumerate(columns) for _ in c] + [0.0 for z in unknowns for _ in z]
        self.limits = np.array(low), np.array(high), np.array(weight), _SURELY * sizes.most

    def codes(
        self, rows: slice, inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray], plainly: bool
    ) -> np.ndarray | None:
        columns = inputs[: self._arguments]
        iteration = None if self._iteration is None else self._iteration[rows]
        if plainly or self._all_good(columns, outputs):
            return iteration if iteration is not None and iteration.any() else None
        return status_codes(self._margins, columns, outputs, iteration, sizes=self._sizes)

    def _all_good(self, columns: Sequence[np.ndarray], outputs: Sequence[np.ndarray]) -> bool:
        *values, margins = outputs
        low, high, _, most = self.limits
        if not all(np.isfinite(v).all() for v in values):
            return False
        if len(margins):
            below = ~(np.minimum.reduce(margins, axis=1) > low)  # NaN among them
            if below.any() and not np.all(np.maximum.reduce(margins[below], axis=1) < high[below]):
                return False
        total = 0.0
        with np.errstate(over="ignore"):  # infinity exceeds the limit too
            for weight, places in self._sizes.groups:
                total += weight * sum(float(row @ row) for place in places for row in columns[place])
        return bool(total <= most)


class PlainMargin(NamedTuple):
    """The data of a margin that the status of a row needs, without symbols of the model."""

    kind: str
    scale: float


class RowFunction:
    """A closed-form CausalFunction without its model: takes rows, returns rows and status codes.

    Arguments are arrays (n, ...) as for the CausalFunction; the results are identical. Raises ModelError for a function
    with Newton blocks, which need the model.
    """

    def __init__(self, function: CausalFunction) -> None:
        newton = [b for b in function.plan.blocks if b.kind == "Newton"]
        if newton:
            raise ModelError(
                f"{function.name} solves {len(newton)} block(s) by Newton's method; call the CausalFunction itself"
            )
        self._function = function.closed
        self._margins = [PlainMargin(m.kind, m.scale) for m in function.margins]
        self._sizes = function.sizes
        self._shapes = [s.shape for s in function.outputs]

    def __call__(self, *arguments: Any) -> tuple[Any, ...]:
        """Return arrays (n, ...) of the targets and int codes (n,) of `Status`; rows without a solution are NaN."""
        arrays = [np.asarray(a, dtype=float) for a in arguments]
        columns = [a.reshape(a.shape[0], -1).T for a in arrays]
        results, status = judged_columns(self._function, columns, self._margins, self._sizes, answers=True)
        values = [r.T for r in results]
        return (*(v.reshape(len(status), *s) for v, s in zip(values, self._shapes, strict=True)), status)
