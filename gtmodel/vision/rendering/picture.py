"""Synthetic pictures of planar shapes through a projection, with exact pixel coverage, blur and noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ...results.options import Options, Within
from ...results.refusal import ArgumentError

SHORT = 0.5  # pixel: length of the pieces of an edge; each crosses at most one grid line per direction


def coverage(outlines: list[np.ndarray], size: tuple[int, int]) -> np.ndarray:
    """Return the share (rows, columns) of each pixel's area inside closed outlines, each (n, 2) of u, v [pixel].

    The centre of the first pixel is (0, 0). `size`: width and height. Outlines must have the same orientation and must
    not overlap. Raises ArgumentError for an outline that is not finite.

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
        raise ArgumentError(f"found an outline of shape {a.shape}; expected at least three finite points", "outlines")
    return a


def _cut(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut edges into pieces that lie in one pixel each."""
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
    cuts = [np.zeros(len(a)), t[:, 0], t[:, 1], np.ones(len(a))]
    points = [a + s[:, None] * (b - a) for s in cuts]
    return np.concatenate(points[:-1]), np.concatenate(points[1:])


def _add(sums: np.ndarray, a: np.ndarray, b: np.ndarray) -> None:
    height, columns = sums.shape
    middle, rise = (a + b) / 2, b[:, 1] - a[:, 1]
    row, column = np.floor(middle[:, 1]).astype(int), np.floor(middle[:, 0]).astype(int)
    inside = (row >= 0) & (row < height) & (column < columns - 1) & (rise != 0)
    row, column, rise, x = row[inside], column[inside], rise[inside], middle[inside, 0]
    right = np.where(column < 0, 0.0, x - column)  # an edge left of the picture covers whole pixels
    column = np.maximum(column, 0)
    np.add.at(sums, (row, column), rise * (1 - right))
    np.add.at(sums, (row, column + 1), rise * right)


Project = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Exposure(Options):
    """Blur, noise and brightness of a synthetic picture.

    >>> gt.vision.rendering.Exposure(gain=0.2).blur
    0.7
    """

    blur: Annotated[float, Within(least=0.0), "standard deviation of the Gaussian blur, pixel"] = 0.7
    noise: Annotated[float, Within(least=0.0), "standard deviation of the grey level, of 255"] = 2.0
    background: Annotated[float, "grey level behind the shapes, of 255"] = 120.0
    gain: Annotated[float, Within(least=0.0), "factor on all grey levels; levels above 255 saturate"] = 1.0
    seed: Annotated[int, Within(least=0), "of the noise"] = 1


@dataclass(frozen=True, eq=False)
class Layer:
    """Planar shapes of one grey level, of 255: corners (k, 3) [m] of each, in the frame of the projection."""

    shapes: Sequence[np.ndarray]
    level: float


def rendered(
    layers: Sequence[Layer], project: Project, size: tuple[int, int], exposure: Exposure | None = None
) -> np.ndarray:
    """Render a synthetic 8-bit picture (rows, columns) of layers, each drawn over the ones before.

    `project` maps points (n, 3) [m] to (n, 2) [pixel] with distortion; straight edges may become curved. `size`: width
    and height [pixel]. The same seed gives the same bytes. Raises ArgumentError for a shape that cannot be projected,
    for example behind the camera.

    >>> square = np.array([[-1.0, -1.0, 4.0], [1.0, -1.0, 4.0], [1.0, 1.0, 4.0], [-1.0, 1.0, 4.0]])
    >>> pinhole = lambda p: 20 * p[:, :2] / p[:, 2:] + [9.5, 7.0]
    >>> picture = gt.vision.rendering.rendered([gt.vision.rendering.Layer([square], 20.0)], pinhole, (20, 15))
    >>> picture.shape, picture.dtype
    ((15, 20), dtype('uint8'))
    """
    from scipy.ndimage import gaussian_filter

    e = exposure or Exposure()
    width, height = size
    light = np.full((height, width), float(e.background))
    for layer in layers:
        share = coverage([_bent(shape, project) for shape in layer.shapes], size)
        light += share * (layer.level - light)
    light *= e.gain
    if e.blur > 0:
        light = gaussian_filter(light, e.blur, mode="nearest")
    rng = np.random.default_rng(e.seed)
    return np.clip(np.rint(light + e.noise * rng.standard_normal(light.shape)), 0, 255).astype(np.uint8)


def _bent(shape: np.ndarray, project: Project) -> np.ndarray:
    """Return the projected outline, with a point every few pixels so that curved edges stay curved."""
    corners = np.asarray(shape, float)
    uv = _projected(corners, project)
    lengths = np.linalg.norm(np.roll(uv, -1, axis=0) - uv, axis=1)
    counts = np.clip(np.ceil(lengths / 2.0), 1, 1000).astype(int)
    points = [a + np.linspace(0, 1, n, endpoint=False)[:, None] * (b - a)
              for a, b, n in zip(corners, np.roll(corners, -1, axis=0), counts, strict=True)]  # fmt: skip
    return _projected(np.concatenate(points), project)


def _projected(points: np.ndarray, project: Project) -> np.ndarray:
    uv = np.asarray(project(points), float)
    if not np.all(np.isfinite(uv)):
        raise ArgumentError("a shape lies behind the camera, or outside the range of its lens model", "layers")
    return uv
