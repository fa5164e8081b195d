"""What a part looks like: boxes, cylinders, spheres and mesh files, placed in a frame of the part.

A class declares `visual`: a dictionary, or a property that returns one, from names of its frames or points to one solid
or several. They are drawn only and change no equation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..geometry.rotations import rotation_of_rpy
from ..results import ArgumentError
from .bodies import AROUND, SOLID, VisibleBody, ball, box, check_colour
from .mesh_file import read_mesh

Array = np.ndarray
ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class VisibleSolid(ABC):
    """Base class of what a part looks like: its place and its colour.

    xyz: position of its centre in the frame of the part [m]. rpy: its orientation there, Rz(yaw) Ry(pitch) Rx(roll)
    [rad]. colour: as "#0072b2"; grey by default.
    """

    xyz: tuple[float, float, float] = ORIGIN
    rpy: tuple[float, float, float] = ORIGIN
    colour: str = SOLID

    @abstractmethod
    def surface(self) -> tuple[Array, Array]:
        """Return vertices (v, 3) [m] and faces (f, 3), in coordinates of the solid."""

    def body(self, frame: str = "") -> VisibleBody:
        """Return the solid in a frame of a scene. Raises ArgumentError."""
        vertices, faces = self.surface()
        placed = vertices @ rotation_of_rpy(np.array(self.rpy, float)).T + np.array(self.xyz, float)
        return VisibleBody(placed, faces, (), "", frame, self.colour, frame=frame)

    def __post_init__(self) -> None:
        for name in ("xyz", "rpy", "size"):
            if hasattr(self, name):
                object.__setattr__(self, name, _three(getattr(self, name), name))
        for name in ("radius", "length"):
            if hasattr(self, name):
                _positive(getattr(self, name), name)
        check_colour(self.colour)


def _three(value: Any, name: str) -> tuple[float, float, float]:
    try:
        a, b, c = (float(x) for x in value)
    except (TypeError, ValueError):
        raise ArgumentError(f"expected three numbers; found {value!r}", name) from None
    if not np.isfinite([a, b, c]).all():
        raise ArgumentError(f"expected three finite numbers; found {value!r}", name)
    return a, b, c


def _positive(value: Any, name: str) -> None:
    if not (isinstance(value, (int, float, np.floating)) and 0 < value < np.inf):
        raise ArgumentError(f"expected a positive number [m]; found {value!r}", name)


@dataclass(frozen=True)
class Cuboid(VisibleSolid):
    """A box with the edges `size` (3,) [m] along its axes.

    >>> print(gt.view.Cuboid((0.2, 0.1, 0.05)).body().extent.__round__(4))
    0.2291
    """

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        for edge in self.size:
            _positive(edge, "size")

    def surface(self) -> tuple[Array, Array]:
        corners, faces = box()
        return corners * self.size, faces


@dataclass(frozen=True)
class Cylinder(VisibleSolid):
    """A cylinder about its z axis, its origin in the middle: radius and length [m].

    >>> rod = gt.view.Cylinder(0.01, 0.4, rpy=(0.0, np.pi / 2, 0.0))  # along x
    >>> np.ptp(rod.body().vertices, axis=0).round(3)
    array([0.4 , 0.02, 0.02])
    """

    radius: float
    length: float

    def surface(self) -> tuple[Array, Array]:
        turns = 2 * np.pi * np.arange(AROUND) / AROUND
        circle = self.radius * np.column_stack([np.cos(turns), np.sin(turns)])
        half = np.full((AROUND, 1), self.length / 2)
        vertices = np.vstack([np.hstack([circle, -half]), np.hstack([circle, half])])
        k, n = np.arange(AROUND), (np.arange(AROUND) + 1) % AROUND
        sides = np.vstack([np.column_stack([k, n, k + AROUND]), np.column_stack([n, n + AROUND, k + AROUND])])
        fan = np.column_stack([np.zeros(AROUND - 2, int), k[1:-1], n[1:-1]])
        return vertices, np.vstack([sides, fan[:, ::-1], fan + AROUND])


@dataclass(frozen=True)
class Sphere(VisibleSolid):
    """A sphere about its origin, of a radius [m], or an ellipsoid with half axes `stretch` times the radius.

    >>> len(gt.view.Sphere(0.02).body().vertices) > 100
    True
    """

    radius: float
    stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def surface(self) -> tuple[Array, Array]:
        vertices, faces = ball()
        return self.radius * vertices * _three(self.stretch, "stretch"), faces


@dataclass(frozen=True)
class Capsule(VisibleSolid):
    """A cylinder about its z axis, of a length [m], with half a sphere at each end.

    >>> print(np.ptp(gt.view.Capsule(0.05, 0.2).body().vertices, axis=0).round(2))
    [0.1 0.1 0.3]
    """

    radius: float
    length: float

    def surface(self) -> tuple[Array, Array]:
        vertices, faces = ball(rings=13)  # odd: no ring at the equator, so that each belongs to one end
        shift = np.sign(vertices[:, 2:]) * [0.0, 0.0, self.length / 2]
        return self.radius * vertices + shift, faces


@dataclass(frozen=True)
class MeshFile(VisibleSolid):
    """The surface in an STL or OBJ file.

    Args:
        path: of the file, from the working directory; in `visual` of a class, from the folder of its Python file.
        scale: metres for each unit of the file: one number, or three for x, y and z; 0.001 for a file in millimetres.

    Files of more than 5,000 triangles are drawn with fewer, by merging close vertices; more than 1,000,000 are refused.
    `body` raises ArgumentError for a file that is missing or is no mesh.
    """

    path: str | Path
    scale: float | tuple[float, float, float] = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for factor in np.atleast_1d(np.array(self.scale, float)).tolist():
            _positive(abs(factor), "scale")

    def surface(self) -> tuple[Array, Array]:
        vertices, faces = read_mesh(Path(self.path))
        mirrored = float(np.prod(np.broadcast_to(self.scale, 3))) < 0
        return vertices * np.array(self.scale, float), faces[:, ::-1] if mirrored else faces


Visual = Mapping[str, Any]
"""Frames or points of a model, by name, with one solid or several."""


def solids_of(visual: Any, owner: str) -> Iterator[tuple[str, VisibleSolid]]:
    """Yield the frame and each solid of a `visual`. owner: for messages. Raises ArgumentError."""
    if not isinstance(visual, Mapping):
        raise ArgumentError(
            f"visual of {owner} is {type(visual).__name__}; expected a dictionary from frames to solids, such as "
            '{"frame": gt.view.Cuboid((0.2, 0.1, 0.1))}', "visual",
        )  # fmt: skip
    for frame, given in visual.items():
        for solid in (
            [given] if isinstance(given, VisibleSolid) else given if isinstance(given, (list, tuple)) else [given]
        ):
            if not isinstance(solid, VisibleSolid):
                raise ArgumentError(
                    f"visual of {owner}: '{frame}' has {solid!r}; expected gt.view.Cuboid, Cylinder, Sphere, Capsule "
                    "or MeshFile, or a list of these", "visual",
                )  # fmt: skip
            yield frame, solid
