"""How much of each pixel polygons cover, exactly: the signed areas to the right of their edges, summed row by row."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...results.refusal import ArgumentError

SHORT = 0.5  # pixel: pieces of an edge, so that each crosses at most one line of the grid either way


def coverage(outlines: list[np.ndarray], size: tuple[int, int]) -> np.ndarray:
    """Share (rows, columns) of each pixel's area inside closed outlines, each (n, 2) of u, v [pixel].

    The centre of the first pixel is (0, 0). `size`: width and height. Outlines turn the same way round and do not
    overlap. Raises ArgumentError for an outline that is not finite.

    >>> square = np.array([[0.5, 0.5], [2.0, 0.5], [2.0, 1.5], [0.5, 1.5]])
    >>> gt.vision.rendering.coverage([square], (4, 3))
    array([[0. , 0. , 0. , 0. ],
           [0. , 1. , 0.5, 0. ],
           [0. , 0. , 0. , 0. ]])
    """
    width, height = size
    sums = np.zeros((height, width + 1))
    for outline in outlines:
        a = _outline(outline) + 0.5  # pixel j from j to j + 1
        _add(sums, *_cut(a, np.roll(a, -1, axis=0)))
    return np.clip(np.abs(np.cumsum(sums[:, :width], axis=1)), 0.0, 1.0)


def _outline(outline: ArrayLike) -> np.ndarray:
    a = np.asarray(outline, float)
    if a.ndim != 2 or a.shape[1] != 2 or len(a) < 3 or not np.all(np.isfinite(a)):
        raise ArgumentError(f"an outline is three or more finite points (n, 2); its shape is {a.shape}", "outlines")
    return a


def _cut(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges in pieces that lie in one pixel each."""
    counts = np.maximum(1, np.ceil(np.linalg.norm(end - start, axis=1) / SHORT)).astype(int)
    edge = np.repeat(np.arange(len(start)), counts)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    k = np.arange(len(edge)) - first[edge]
    step = (end - start)[edge] / counts[edge, None]
    a = start[edge] + k[:, None] * step
    b = start[edge] + (k + 1)[:, None] * step
    line = np.maximum(np.floor(a), np.floor(b))
    crosses = np.floor(a) != np.floor(b)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(crosses, (line - a) / (b - a), 1.0)
    t = np.sort(t, axis=1)
    at = [np.zeros(len(a)), t[:, 0], t[:, 1], np.ones(len(a))]
    points = [a + s[:, None] * (b - a) for s in at]
    return np.concatenate(points[:-1]), np.concatenate(points[1:])


def _add(sums: np.ndarray, a: np.ndarray, b: np.ndarray) -> None:
    height, columns = sums.shape
    middle, rise = (a + b) / 2, b[:, 1] - a[:, 1]
    row, column = np.floor(middle[:, 1]).astype(int), np.floor(middle[:, 0]).astype(int)
    inside = (row >= 0) & (row < height) & (column < columns - 1) & (rise != 0)
    row, column, rise, x = row[inside], column[inside], rise[inside], middle[inside, 0]
    right = np.where(column < 0, 0.0, x - column)  # left of the picture: all of it is to the right
    column = np.maximum(column, 0)
    np.add.at(sums, (row, column), rise * (1 - right))
    np.add.at(sums, (row, column + 1), rise * right)
