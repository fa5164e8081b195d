"""Bodies of a scene: vertices with triangles, lines or marks, fixed to a frame of the scene or to the world."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from ..results import ArgumentError

Array = np.ndarray
Marker = Literal["", "disc", "ring", "cross", "square", "triangle"]
MARKERS: tuple[Marker, ...] = ("disc", "cross", "ring", "square", "triangle")
# Okabe-Ito, which colour-blind readers tell apart; the same as in gtmodel.plot.style, which needs matplotlib
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
HEX = re.compile(r"#[0-9a-fA-F]{6}")
SOLID, CLEAR = "#b9c3cc", 0.4  # colour of a surface that has none, and opacity of an ellipsoid
AROUND = 24  # corners of a circle
MOST_DOTS, MOST_OF_GRID = 20_000, 2500  # of one group, and of a section
LEVELS = ("#440154", "#3e4a89", "#26828e", "#35b779", "#b5de2b")  # viridis, dark to light
MOST_ELLIPSOIDS, SHARE = 60, 0.06  # drawn, and half length of the largest one in sizes of the positions' volume


def check_colour(colour: Any) -> None:
    """Raise ArgumentError for a colour that is not written as "#0072b2": page and pictures read its digits."""
    if not (isinstance(colour, str) and HEX.fullmatch(colour)):
        raise ArgumentError(f"expected red, green and blue in hexadecimal, as '#0072b2'; found {colour!r}", "colour")


@dataclass(frozen=True, eq=False)
class VisibleBody:
    """Vertices with what joins them, in coordinates of a frame.

    Args:
        vertices: (v, 3) [m].
        faces: (f, 3) numbers of vertices; counter-clockwise seen from outside.
        edges: (e, 2) numbers of vertices, drawn as lines.
        marker: drawn at each vertex: "disc", "ring", "cross", "square" or "triangle"; groups with markers are in the
            legend of the page.
        name: shown in the legend and at the pointer. colour: as "#0072b2". opacity: of the faces, up to 1.
        frame: name of a frame of the scene; "" for the world.

    Raises ArgumentError for numbers that are not finite, for faces and edges of unknown vertices, and for a colour
    that is written in another way.

    >>> square = gt.view.VisibleBody([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], faces=[[0, 1, 2], [0, 2, 3]])
    >>> square.closed
    False
    """

    vertices: Any
    faces: Any = ()
    edges: Any = ()
    marker: Marker = ""
    name: str = ""
    colour: str = SOLID
    opacity: float = 1.0
    frame: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, float).reshape(-1, 3)
        if not len(vertices) or not np.isfinite(vertices).all():
            raise ArgumentError(f"'{self.name}': expected rows of three finite numbers", "vertices")
        check_colour(self.colour)
        object.__setattr__(self, "vertices", vertices)
        for what, size in (("faces", 3), ("edges", 2)):
            indices = np.array(getattr(self, what), int).reshape(-1, size)
            if indices.size and not (indices.min() >= 0 and indices.max() < len(vertices)):
                raise ArgumentError(f"'{self.name}': there are {len(vertices)} vertices, numbered from 0", what)
            object.__setattr__(self, what, indices)

    @property
    def closed(self) -> bool:
        """True if the faces enclose a volume: then those that look away are hidden behind the others."""
        sides = np.vstack([self.faces[:, [k, (k + 1) % 3]] for k in range(3)])
        if not len(sides):
            return False
        count = len(self.vertices)
        there, back = (np.unique(s @ [count, 1], return_counts=True) for s in (sides, sides[:, ::-1]))
        return bool(np.array_equal(there[0], back[0]) and there[1].max() == 1)

    @property
    def extent(self) -> float:
        """Diagonal of the box around the vertices [m]."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    def moved(self, R: Any, r: Any) -> VisibleBody:
        """Return the body turned by R (3, 3) and displaced by r (3,) [m], in its frame."""
        return replace(self, vertices=self.vertices @ np.asarray(R, float).T + np.asarray(r, float))

    def with_(self, **changes: Any) -> VisibleBody:
        """Return a copy with other attributes."""
        return replace(self, **changes)

    def corners(self) -> Array:
        """Return the corners (8, 3) of the box around the vertices [m]."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        return np.array([[(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]]
                         for i in (0, 1) for j in (0, 1) for k in (0, 1)])  # fmt: skip


def box() -> tuple[Array, Array]:
    """Return vertices and faces of the cube with edges 1 about the origin; vertex 4 i + 2 j + k is at i of z, j of y, k
    of x."""
    corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]) / 2
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])


def ball(rings: int = AROUND // 2, around: int = AROUND) -> tuple[Array, Array]:
    """Return vertices and faces of the unit sphere."""
    turns, polar = 2 * np.pi * np.arange(around) / around, np.pi * np.arange(1, rings) / rings
    middle = [[np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)] for p in polar for a in turns]
    vertices = np.array([[0.0, 0.0, 1.0], *middle, [0.0, 0.0, -1.0]])
    last, faces = len(vertices) - 1, list[tuple[int, int, int]]()
    for k in range(around):
        n = (k + 1) % around
        faces += [(0, 1 + k, 1 + n), (last, last - around + n, last - around + k)]
        for row in range(rings - 2):
            a, b = 1 + row * around + k, 1 + row * around + n
            faces += [(a, a + around, b), (b, a + around, b + around)]
    return vertices, np.array(faces)


def ellipsoid(
    covariance: Any, centre: Any, *, scale: float = 1.0, name: str = "", colour: str = COLOURS[0]
) -> VisibleBody:  # fmt: skip
    """Return the surface of equal probability of a position, e' C^-1 e = scale^2.

    Args:
        covariance: C (3, 3) [m2]; a matrix without full rank gives a flat body.
        centre: (3,) [m], world coordinates.
        scale: enlargement of the standard deviations; state it where the picture is shown.

    Raises ArgumentError for a matrix that is no covariance.

    >>> error = gt.view.ellipsoid(np.diag([1e-6, 4e-6, 0.0]), [0.0, 0.0, 1.0], scale=100.0)
    >>> np.ptp(error.vertices, axis=0).round(3)
    array([0.195, 0.4  , 0.   ])
    """
    C = np.array(covariance, float)
    if C.shape != (3, 3) or not np.isfinite(C).all():
        raise ArgumentError(f"expected a finite matrix of shape (3, 3); found shape {C.shape}", "covariance")
    values, axes = np.linalg.eigh((C + C.T) / 2)
    if values[0] < -1e-9 * max(values[-1], 0.0) or not np.allclose(C, C.T, rtol=1e-6, atol=1e-9 * np.abs(C).max()):
        raise ArgumentError("expected a symmetric matrix without negative eigenvalues", "covariance")
    axes = axes * (np.sign(np.linalg.det(axes)) or 1.0)
    vertices, faces = ball(8, 14)
    radii = scale * np.sqrt(np.maximum(values, 0.0))
    return VisibleBody((vertices * radii) @ axes.T + np.asarray(centre, float), faces, (), "", name, colour, CLEAR)


def ellipsoids(positions: Any, covariances: Any, *, name: str = "error") -> tuple[list[VisibleBody], str]:
    """Return the ellipsoids of one standard deviation of positions, all enlarged so that the largest can be seen, and a
    sentence that states by how much; of more than 60 positions a part is drawn.

    Args:
        positions: (n, 3) [m]. covariances: (n, 3, 3) [m2].

    >>> _, note = gt.view.ellipsoids([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], np.tile(1e-6 * np.eye(3), (2, 1, 1)))
    >>> note
    'Ellipsoids: one standard deviation of each position, enlarged 60 times.'
    """
    T, C = np.asarray(positions, float).reshape(-1, 3), np.asarray(covariances, float).reshape(-1, 3, 3)
    known, C = _known(T, C)
    if not len(known):
        return [], ""
    factor = _factor(known, float(np.sqrt(np.linalg.eigvalsh(C)[:, -1].max())))
    every, part = _part(len(known))
    note = f"Ellipsoids: one standard deviation of each position, enlarged {factor:.10g} times{part}."
    chosen = zip(known[::every], C[::every], strict=True)
    return [ellipsoid(of, centre, scale=factor, name=name) for centre, of in chosen], note


def error_boxes(positions: Any, corners: Any, *, name: str = "error") -> tuple[list[VisibleBody], str]:
    """Return parallelepipeds of the errors that are possible at positions, all enlarged so that the largest can be
    seen, and a sentence that states by how much; of more than 60 positions a part is drawn.

    Args:
        positions: (n, 3) [m]. corners: (n, 8, 3) errors at the corners [m], in the order of
            `gt.kinematics.accuracy.SIGNS`.

    >>> corners = 1e-4 * gt.kinematics.accuracy.SIGNS
    >>> (body,), note = gt.view.error_boxes([[0.0, 0.0, 1.0]], corners[None])
    >>> body.closed, note
    (True, 'Boxes: possible errors of each position, enlarged 300 times.')
    """
    T, e = np.asarray(positions, float).reshape(-1, 3), np.asarray(corners, float).reshape(-1, 8, 3)
    known, e = _known(T, e)
    if not len(known):
        return [], ""
    factor = _factor(known, float(np.linalg.norm(e, axis=2).max()))
    every, part = _part(len(known))
    faces, bodies = box()[1], list[VisibleBody]()
    for centre, of in zip(known[::every], e[::every], strict=True):
        outwards = np.linalg.det(of[[1, 2, 4]] - of[0]) > 0
        looking = faces if outwards else faces[:, ::-1]
        bodies.append(VisibleBody(centre + factor * of, looking, (), "", name, COLOURS[0], CLEAR))
    return bodies, f"Boxes: possible errors of each position, enlarged {factor:.10g} times{part}."


def _known(positions: Array, values: Array) -> tuple[Array, Array]:
    """The positions, and what belongs to them, whose numbers are all finite."""
    finite = np.isfinite(positions).all(axis=1) & np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    return positions[finite], values[finite]


def _part(count: int) -> tuple[int, str]:
    """Of that many positions, every how many are drawn, and words for it."""
    every = -(-count // MOST_ELLIPSOIDS)
    return every, f", {-(-count // every)} of {count} positions" if every > 1 else ""


def error_lines(positions: Any, errors: Any, *, colour: str = COLOURS[1]) -> tuple[list[VisibleBody], str]:
    """Return a line from each position along its error, all enlarged so that the longest can be seen, and a sentence
    that states by how much.

    Args:
        positions: (n, 3) [m]. errors: (n, 3) [m].

    >>> gt.view.error_lines([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, 0.0, 1e-3], [0.0, 2e-3, 0.0]])[1]
    'Lines: errors of the positions, enlarged 30 times.'
    """
    T, e = np.asarray(positions, float).reshape(-1, 3), np.asarray(errors, float).reshape(-1, 3)
    known, e = _known(T, e)
    if not len(known):
        return [], ""
    factor = _factor(known, float(np.linalg.norm(e, axis=1).max()))
    body = lines(known, known + factor * e, name="error", colour=colour)
    return [body], f"Lines: errors of the positions, enlarged {factor:.10g} times."


def _factor(positions: Array, largest: float) -> float:
    """Enlargement, with one digit, by which the largest error gets a share of the volume of the positions."""
    factor = SHARE * (float(np.linalg.norm(np.ptp(positions, axis=0))) or 1.0) / max(largest, 1e-15)
    digit = 10.0 ** np.floor(np.log10(factor))
    return float(np.floor(factor / digit * (1 + 1e-12)) * digit)


def dots(
    positions: Any, *, marker: Marker = "disc", name: str = "", colour: str = COLOURS[0]
) -> VisibleBody:  # fmt: skip
    """Return marks at positions (n, 3) [m], world coordinates; of more than 20,000 every second, third ... is drawn,
    and the name says so.

    >>> gt.view.dots(np.zeros((50_000, 3)), name="reachable").name
    'reachable (every 3rd of 50000)'
    """
    rows = np.asarray(positions, float).reshape(-1, 3)
    every = -(-len(rows) // MOST_DOTS)
    if every > 1:
        ending = {2: "nd", 3: "rd"}.get(every, "th")
        name = f"{name} (every {every}{ending} of {len(rows)})".strip()
    return VisibleBody(rows[:: max(every, 1)], (), (), marker, name, colour)


def groups(positions: Any, labels: Sequence[str]) -> list[VisibleBody]:
    """Return marks at positions (n, 3) [m], one group for each label, the frequent ones first, by marker and colour.

    >>> [g.name for g in gt.view.groups(np.zeros((3, 3)), ["reached", "not reached", "reached"])]
    ['reached: 2', 'not reached: 1']
    """
    rows, words = np.asarray(positions, float).reshape(-1, 3), np.asarray(labels, object)
    names = sorted(dict.fromkeys(words.tolist()), key=lambda n: -int(np.sum(words == n)))
    return [
        dots(rows[words == n], marker=MARKERS[k % len(MARKERS)], name=f"{n}: {int(np.sum(words == n))}",
             colour=COLOURS[k % len(COLOURS)])
        for k, n in enumerate(names)
    ]  # fmt: skip


def levels(positions: Any, values: Any, name: str, unit: str) -> list[VisibleBody]:
    """Return marks at positions (n, 3) [m], world coordinates, in five groups by their value (n,), from low to high,
    each a fifth of the positions; positions without a finite value are left out.

    >>> [g.name for g in gt.view.levels(np.zeros((10, 3)), np.arange(10.0), "error", "mm")][:2]
    ['error 0 to 1.8 mm: 2', 'error 1.8 to 3.6 mm: 2']
    """
    rows, x = _known(np.asarray(positions, float).reshape(-1, 3), np.asarray(values, float))
    bounds = np.unique(np.quantile(x, np.linspace(0, 1, len(LEVELS) + 1))) if len(x) else x
    at = np.clip(np.searchsorted(bounds, x, side="right") - 1, 0, max(len(bounds) - 2, 0))
    return [
        dots(rows[at == k], marker="square", colour=LEVELS[k],
             name=f"{name} {' to '.join(f'{b:.3g}' for b in bounds[k : k + 2])} {unit}: {int(np.sum(at == k))}")
        for k in range(max(len(bounds) - 1, len(bounds[:1])))
    ]  # fmt: skip


def thinned(shape: tuple[int, int]) -> tuple[Array, str]:
    """Return which rows of a grid of points are drawn: every second, third ... in both directions if there are more
    than 2500; and a sentence that says so.

    >>> rows, note = gt.view.thinned((100, 60))
    >>> rows[:3], len(rows), note
    (array([0, 2, 4]), 1500, 'Every second point of the grid in both directions.')
    """
    every = max(1, int(np.ceil(np.sqrt(shape[0] * shape[1] / MOST_OF_GRID))))
    word = {2: "second", 3: "third"}.get(every, f"{every}th")
    rows = np.arange(shape[0] * shape[1]).reshape(shape)[::every, ::every].ravel()
    return rows, f"Every {word} point of the grid in both directions." if every > 1 else ""


def lines(starts: Any, ends: Any, *, name: str = "", colour: str = "#777777") -> VisibleBody:
    """Return straight lines between rows of positions (n, 3) [m], world coordinates.

    >>> len(gt.view.lines(np.zeros((2, 3)), np.ones((2, 3))).edges)
    2
    """
    a, b = (np.asarray(x, float).reshape(-1, 3) for x in (starts, ends))
    n = len(a)
    return VisibleBody(np.vstack([a, b]), (), np.column_stack([np.arange(n), n + np.arange(n)]), "", name, colour)


def frustum(
    rays: Any, R: Any, centre: Any, depth: float, *, name: str = "", colour: str = COLOURS[1]
) -> VisibleBody:  # fmt: skip
    """Return what a camera sees, as the pyramid from its centre through the corners of its picture.

    Args:
        rays: (4, 3) directions to the corners in camera coordinates, with third component 1, in turn.
        R: (3, 3), from camera to world coordinates. centre: (3,) [m]. depth: of the pyramid along the camera's axis
            [m].

    >>> corners = [[-0.4, -0.3, 1.0], [0.4, -0.3, 1.0], [0.4, 0.3, 1.0], [-0.4, 0.3, 1.0]]
    >>> gt.view.frustum(corners, np.eye(3), [0.0, 0.0, 0.0], 2.0).vertices[1]
    array([-0.8, -0.6,  2. ])
    """
    corners = depth * np.asarray(rays, float).reshape(4, 3)
    edges = [(0, k) for k in range(1, 5)] + [(k, k % 4 + 1) for k in range(1, 5)]
    body = VisibleBody(np.vstack([np.zeros(3), corners]), (), edges, "", name, colour)
    return body.moved(R, centre)
