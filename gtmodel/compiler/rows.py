"""Closed-form functions on many rows, with a status for each row, and at one point, on NumPy memory."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Sequence
from itertools import pairwise
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from ..results.status import Status
from .blocks import VERDICTS
from .columns.kernel import FEWEST, kernel_of

if TYPE_CHECKING:
    from .analysis.sizes import Sizes
    from .causal import CausalFunction


def densified(f: ca.Function) -> ca.Function:
    """Return the same function with dense results."""
    if all(f.sparsity_out(k).is_dense() for k in range(f.n_out())):
        return f
    symbols = f.sx_in()
    return ca.Function(f.name(), symbols, [ca.densify(r) for r in f.call(symbols)])


class BoundFunction:
    """A function with dense arguments and results on a fixed number of rows, in memory of its own.

    `run()` evaluates `arguments`, arrays (rows, size), into `results`, arrays (rows, entries). All of them together are
    `given` and `got`.
    """

    def __init__(self, f: ca.Function, rows: int = 1) -> None:
        self.shapes = [f.size_out(k) for k in range(f.n_out())]
        self.given, self.arguments = _memory(rows, [f.numel_in(k) for k in range(f.n_in())])
        self.got, self.results = _memory(rows, [f.numel_out(k) for k in range(f.n_out())])
        self._buffer, self.run = (f if rows == 1 else f.map(rows)).buffer()
        set_arg: Any = self._buffer.set_arg
        set_res: Any = self._buffer.set_res
        buffers: list[tuple[Any, list[Any]]] = [(set_arg, self.arguments), (set_res, self.results)]
        for setter, arrays in buffers:
            for k, a in enumerate(arrays):
                if a.size:
                    setter(k, memoryview(a))


def _memory(rows: int, sizes: Sequence[int]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return zeros, and their parts as arrays (rows, size)."""
    memory = np.zeros(rows * sum(sizes))
    parts = np.split(memory, rows * np.cumsum(sizes, dtype=int))
    return memory, [part.reshape(rows, size) for part, size in zip(parts, sizes, strict=False)]


class PointFunction:
    """A function of columns, called with arrays or numbers; returns each result as a new array of its shape.

    Calls from several threads run one after the other.
    """

    def __init__(self, f: ca.Function) -> None:
        self._f = f
        f = densified(f)
        self._bound = BoundFunction(f)
        self._arguments = [a[0] for a in self._bound.arguments]
        bound = self._bound
        self._results = [r.reshape(c, rows).T for r, (rows, c) in zip(bound.results, bound.shapes, strict=True)]
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return PointFunction, (self._f,)

    def __call__(self, *values: Any) -> list[np.ndarray]:
        with self._lock:
            for argument, value in zip(self._arguments, values, strict=True):
                argument[:] = value
            self._bound.run()
            return [r.copy() for r in self._results]


# a pivot below this fraction of its typical size is singular. A pivot that is a square root, as for a link at right
# angles to its guideway, has an error of the root of round-off, 1e-8
PIVOT_TOLERANCE = 1e-7
# rows per mapped function: they fit into the cache, and creating the function costs no more than some rows
BLOCK = 512
# rows per call of a small function, and its largest number of operations: a call costs as much as some forty operations
GROUP, SMALL = 16, 256
# functions bound to fewer rows than a kernel takes, and the largest number of entries of one
BOUND, ENTRIES = 128, 20_000

# idle ones by (hash of the function, rows), with the function kept alive so that its hash stays unique; a list holds
# one for each thread that ran at the same time, or none if the function has no dense form
_bound: OrderedDict[tuple[int, int], tuple[ca.Function, list[BoundFunction] | None]] = OrderedDict()


def _few_rows(f: ca.Function, columns: Sequence[np.ndarray], n: int) -> list[np.ndarray] | None:
    """`map_columns` in kept memory; None for many or sparse entries."""
    key = f.__hash__(), n
    entry = _bound.get(key)
    if entry is None:
        entries = [f.sparsity_in(k) for k in range(f.n_in())] + [f.sparsity_out(k) for k in range(f.n_out())]
        fits = all(e.is_dense() for e in entries) and n * sum(e.numel() for e in entries) <= ENTRIES
        entry = _bound[key] = f, [] if fits else None
        while len(_bound) > BOUND:
            _bound.popitem(last=False)
    idle = entry[1]
    if idle is None:
        return None
    try:
        few = idle.pop()
    except IndexError:
        few = BoundFunction(f, n)
    for argument, column in zip(few.arguments, columns, strict=True):
        argument[...] = column.T
    few.run()
    results = [r.copy().reshape(n * c, rows).T for r, (rows, c) in zip(few.results, few.shapes, strict=True)]
    idle.append(few)
    return results


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
    if n < FEWEST and (few := _few_rows(f, columns, n)) is not None:
        return few
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


# fraction of the limit of one row below which a sum of squares over many rows is safe in spite of round-off
_SURELY = 0.999
# largest sum of squares of inputs that their weights are applied to: it cannot overflow
_USUAL = 1e200
# numbers of rows below FEWEST whose memory is kept
_KEPT = 16


class JudgedFunction:
    """A closed-form function of columns with the margins as last output, and the status codes of its results.

    `status_codes` defines the codes; a few operations tell that all rows are clearly good, as most are.
    """

    def __init__(self, f: ca.Function, margins: Sequence[Any], sizes: Sizes) -> None:
        self._f, self._margins, self._sizes = f, margins, sizes
        scaled = [m.kind in ("pivot", "branch") for m in margins]
        # other margins may be zero: the limit is the largest negative number
        least = -np.nextafter(0.0, 1.0)
        low = [PIVOT_TOLERANCE * m.scale if s else least for m, s in zip(margins, scaled, strict=True)]
        self.low = np.array(low)
        self.high = np.array([-x if m.kind == "pivot" else -np.inf for m, x in zip(margins, low, strict=True)])
        weights = {place: weight for weight, places in sizes.groups for place in places}
        weight = [weights.get(k, 0.0) for k in range(f.n_in())]  # the unknowns of Newton blocks have none
        self.weight = np.repeat(weight, [f.numel_in(k) for k in range(f.n_in())])
        self.most = _SURELY * sizes.most
        self.kept: dict[int, list[_FewRows]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return JudgedFunction, (self._f, self._margins, self._sizes)

    def __call__(
        self,
        columns: Sequence[np.ndarray],
        unknowns: Sequence[np.ndarray] = (),
        iteration: np.ndarray | None = None,
        answers: bool = False,
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the outputs (entries, n) for arguments (size, n), and status codes (n,).

        answers: return no margins, and NaN in rows whose status is not OK.
        """
        inputs = [*columns, *unknowns]
        n = inputs[0].shape[1] if inputs else 1
        if 0 < n < FEWEST:
            clear = iteration is None or not np.count_nonzero(iteration)
            results, good = self._of_few(inputs, n, answers and clear)
            if good and clear:
                return results, np.zeros(n, dtype=int)
        else:
            kernel = kernel_of(self._f, n)
            if kernel is not None:
                judge = BlockJudge(self, len(columns), iteration)
                results, codes = kernel.run(inputs, judge, answers)
                assert codes is not None
                return _side_by_side(self._f, results), codes
            results = map_columns(self._f, inputs)
        codes = self.codes(columns, results, iteration)
        if answers:
            results = results[:-1]
            bad = np.flatnonzero(codes)
            for r in results:
                r.T[bad] = np.nan
        return results, codes

    def codes(
        self, columns: Sequence[np.ndarray], results: Sequence[np.ndarray], iteration: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the `status_codes` of results (entries, n), the margins last."""
        return status_codes(self._margins, columns, results, iteration, sizes=self._sizes)

    def _of_few(self, inputs: Sequence[np.ndarray], n: int, answers: bool) -> tuple[list[np.ndarray], bool]:
        """Evaluate in kept memory; return the outputs, and whether all rows are clearly good, then only the answers."""
        idle = self.kept.get(n)
        if idle is None:
            while len(self.kept) >= _KEPT:
                self.kept.pop(next(iter(self.kept)), None)
            idle = self.kept[n] = []
        few = idle.pop() if idle else _FewRows(self, self._f, n)
        for argument, column in zip(few.arguments, inputs, strict=True):
            argument[...] = column.T
        few.run()
        good = few.all_good()
        results = [r.copy().T for r in (few.answers if good and answers else few.results)]
        idle.append(few)
        return results, good

    def all_good(self, inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray]) -> bool:
        """Return whether all columns are clearly good: finite, away from each limit, and far smaller than allowed."""
        *values, margins = outputs
        if not all(np.isfinite(v).all() for v in values):
            return False
        if len(margins):
            below = ~(np.minimum.reduce(margins, axis=1) > self.low)  # NaN among them
            if below.any() and not np.all(np.maximum.reduce(margins[below], axis=1) < self.high[below]):
                return False
        with np.errstate(over="ignore"):  # infinity exceeds the limit too
            rows = [row for column in inputs for row in column]
            total = sum(w * float(row @ row) for w, row in zip(self.weight.tolist(), rows, strict=True) if w)
        return bool(total <= self.most)


class _FewRows(BoundFunction):
    """A JudgedFunction bound to a number of rows."""

    def __init__(self, judged: JudgedFunction, f: ca.Function, n: int) -> None:
        super().__init__(f, n)
        sizes = [a.shape[1] for a in self.arguments]
        weights = np.split(judged.weight, np.cumsum(sizes))
        self._weight = np.concatenate([np.tile(w, n) for w in weights])
        self._most, self._weighted = judged.most, np.zeros_like(self.given)
        self.answers, self._margins = self.results[:-1], self.results[-1].reshape(-1)
        self._values = self.got[: self.got.size - self._margins.size]
        self._low, self._high = np.tile(judged.low, n), np.tile(judged.high, n)
        self._above = np.zeros(self._low.shape, dtype=bool)

    def all_good(self) -> bool:
        """The same as `JudgedFunction.all_good`, for what has just been computed."""
        given, values, above = self.given, self._values, self._above
        # vdot does not warn of an overflow; NaN is not below either
        if not (np.vdot(values, values) < np.inf and np.vdot(given, given) < _USUAL):
            return False
        np.greater(self._margins, self._low, above)
        if np.count_nonzero(above) < above.size and not np.all(above | (self._margins < self._high)):
            return False
        return bool(np.multiply(given, self._weight, self._weighted).dot(given) <= self._most)


class BlockJudge:
    """A JudgedFunction block by block, as a column kernel asks for it."""

    def __init__(self, judged: JudgedFunction, arguments: int, iteration: np.ndarray | None = None) -> None:
        """`arguments`: number of inputs with limits of size; the unknowns of Newton blocks have none."""
        self._judged, self._arguments, self._iteration = judged, arguments, iteration
        self.limits = judged.low, judged.high, judged.weight, judged.most

    def codes(
        self, rows: slice, inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray], plainly: bool
    ) -> np.ndarray | None:
        iteration = None if self._iteration is None else self._iteration[rows]
        if plainly or self._judged.all_good(inputs, outputs):
            return iteration if iteration is not None and iteration.any() else None
        return self._judged.codes(inputs[: self._arguments], outputs, iteration)


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
        margins = [PlainMargin(m.kind, m.scale) for m in function.margins]
        self._judged = JudgedFunction(function.closed, margins, function.sizes)
        self._shapes = [s.shape for s in function.outputs]

    def __call__(self, *arguments: Any) -> tuple[Any, ...]:
        """Return arrays (n, ...) of the targets and int codes (n,) of `Status`; rows without a solution are NaN."""
        arrays = [np.asarray(a, dtype=float) for a in arguments]
        columns = [a.reshape(a.shape[0], -1).T for a in arrays]
        results, status = self._judged(columns, answers=True)
        values = [r.T for r in results]
        return (*(v.reshape(len(status), *s) for v, s in zip(values, self._shapes, strict=True)), status)
