"""Sums of products over observations that belong together: sorted once, then added by np.add.reduceat or by BLAS."""

from __future__ import annotations

import numpy as np

LONG = 12  # members of a group on average: above, one product of whole groups is faster than one per member
PIECE = 1 << 22  # numbers of products that are held at a time


class GroupedSums:
    """Members with `keys` (n,), integers; `unique` (k,) are the keys in rising order."""

    def __init__(self, keys: np.ndarray) -> None:
        ordered = bool(np.all(keys[1:] >= keys[:-1])) if len(keys) else True
        self.order = None if ordered else np.argsort(keys, kind="stable")
        rising = keys if self.order is None else keys[self.order]
        first = np.flatnonzero(np.concatenate([[True], rising[1:] != rising[:-1]])) if len(keys) else np.zeros(0, int)
        self.edges = np.append(first, len(keys))
        self.unique = rising[first]

    def products(
        self, A: np.ndarray, B: np.ndarray, a: np.ndarray | None = None, b: np.ndarray | None = None
    ) -> np.ndarray:
        """Sums (k, p, q) of A[a[n]]' B[b[n]] over the members n of each group; A (., m, p) and B (., m, q), a and b
        n itself if left out."""
        out = np.empty((len(self.unique), A.shape[2], B.shape[2]))
        n = self.edges[-1]
        if not n:
            return out
        a = self.order if a is None else a if self.order is None else a[self.order]
        b = self.order if b is None else b if self.order is None else b[self.order]
        members = max(PIECE // (A.shape[2] * B.shape[2]), 1)
        many = n > LONG * len(self.unique)
        begin = 0
        while begin < len(self.unique):
            end = int(np.searchsorted(self.edges, self.edges[begin] + members, side="right")) - 1
            end = min(max(end, begin + 1), len(self.unique))
            rows = slice(self.edges[begin], self.edges[end])
            left, right = A[rows] if a is None else A[a[rows]], B[rows] if b is None else B[b[rows]]
            starts = self.edges[begin : end + 1] - self.edges[begin]
            if many:
                p, q, m = A.shape[2], B.shape[2], A.shape[1]
                flat, other = left.reshape(-1, p), right.reshape(-1, q)
                for k in range(end - begin):
                    part = slice(starts[k] * m, starts[k + 1] * m)
                    np.matmul(flat[part].T, other[part], out=out[begin + k])
            else:
                each = np.matmul(left.transpose(0, 2, 1), right)
                np.add.reduceat(each, starts[:-1], axis=0, out=out[begin:end])
            begin = end
        return out

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Sums (k, ...) of values (n, ...)."""
        ordered = values if self.order is None else values[self.order]
        if not len(self.unique):
            return np.zeros((0, *values.shape[1:]))
        return np.add.reduceat(ordered, self.edges[:-1], axis=0)
