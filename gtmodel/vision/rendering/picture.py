"""Synthetic pictures: flat shapes at poses, seen through a projection, blurred and with noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...results.options import Options, Within
from ...results.refusal import ArgumentError
from .coverage import coverage

Project = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Exposure(Options):
    """What the sensor makes of the light. Synthetic.

    >>> gt.vision.rendering.Exposure(gain=0.2).blur
    0.7
    """

    blur: Annotated[float, Within(least=0.0), "standard deviation of a normal blur, pixel"] = 0.7
    noise: Annotated[float, Within(least=0.0), "standard deviation of a pixel, of 255"] = 2.0
    background: Annotated[float, "level before the shapes, of 255"] = 120.0
    gain: Annotated[float, Within(least=0.0), "factor on all levels: below 1 darker; above 255 a pixel saturates"] = 1.0
    seed: Annotated[int, Within(least=0), "of the noise"] = 1


@dataclass(frozen=True, eq=False)
class Layer:
    """Flat shapes of one grey level, of 255: corners (k, 3) [m] of each, in the frame that the projection takes."""

    shapes: Sequence[np.ndarray]
    level: float


def rendered(
    layers: Sequence[Layer], project: Project, size: tuple[int, int], exposure: Exposure | None = None
) -> np.ndarray:
    """A picture (rows, columns) of 8 bits: layers, each over those before. Synthetic.

    `project`: points (n, 3) [m] to (n, 2) [pixel], distortion included; edges are bent as it says. `size`: width and
    height [pixel]. The same seed gives the same bytes. Raises ArgumentError for a shape that the projection does not
    take, as behind the camera.

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
    """The outline in the picture, with a point every few pixels so that bent edges stay bent."""
    corners = np.asarray(shape, float)
    there = _projected(corners, project)
    lengths = np.linalg.norm(np.roll(there, -1, axis=0) - there, axis=1)
    counts = np.clip(np.ceil(lengths / 2.0), 1, 1000).astype(int)
    points = [a + np.linspace(0, 1, n, endpoint=False)[:, None] * (b - a)
              for a, b, n in zip(corners, np.roll(corners, -1, axis=0), counts, strict=True)]  # fmt: skip
    return _projected(np.concatenate(points), project)


def _projected(points: np.ndarray, project: Project) -> np.ndarray:
    uv = np.asarray(project(points), float)
    if not np.all(np.isfinite(uv)):
        raise ArgumentError("a shape lies behind the camera or beyond what its lens model covers", "layers")
    return uv
