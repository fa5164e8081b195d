"""Triangles from STL files (binary and text) and OBJ files."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..results import ArgumentError

Array = np.ndarray
MOST_READ, MOST_DRAWN = 1_000_000, 5_000  # triangles
EXACT = 20  # times MOST_DRAWN: triangles up to which equal corners are found first
LARGEST = 60_000_000  # bytes
HEADER, TRIANGLE = 84, 50  # bytes of a binary STL
CELLS = (
    200,
    140,
    100,
    70,
    50,
    35,
    25,
    18,
    12,
    8,
    5,
    2,
)  # of the grid along the longest side, until few triangles remain


def read_mesh(path: Path) -> tuple[Array, Array]:
    """Return the vertices (v, 3), in the unit of the file, and at most MOST_DRAWN triangles (f, 3) of them.

    Vertices in the same cell of a grid are merged if there are more. Raises ArgumentError for a file that is missing,
    too large or no mesh.
    """
    try:
        about = path.stat()
    except OSError as error:
        raise ArgumentError(f"the mesh {path} cannot be read: {error.strerror}", "path") from error
    return _read(path, about.st_mtime_ns, about.st_size)


@lru_cache(maxsize=64)
def _read(path: Path, changed: int, size: int) -> tuple[Array, Array]:
    kind = path.suffix.lower()
    if kind not in (".stl", ".obj"):
        raise ArgumentError(f"{path.name} is neither STL nor OBJ; convert it, for instance with Blender", "path")
    if size > LARGEST:
        raise ArgumentError(
            f"{path.name} has {size / 1e6:.0f} MB; a view takes meshes up to {LARGEST / 1e6:.0f} MB: reduce it", "path"
        )
    try:
        content = path.read_bytes()
        vertices, faces = _stl(content) if kind == ".stl" else _obj(content.decode("utf-8", "replace"))
    except OSError as error:
        raise ArgumentError(f"the mesh {path} cannot be read: {error.strerror}", "path") from error
    except (ValueError, IndexError) as error:
        raise ArgumentError(f"{path.name} is no {kind[1:].upper()} file: {error}", "path") from error
    if not len(faces) or not np.isfinite(vertices).all():
        what = "no triangles" if not len(faces) else "numbers that are not finite"
        raise ArgumentError(f"{path.name} has {what}", "path")
    if len(faces) > MOST_READ:
        raise ArgumentError(
            f"{path.name} has {len(faces)} triangles; a view takes up to {MOST_READ}: reduce the mesh", "path"
        )
    if len(faces) <= EXACT * MOST_DRAWN:  # otherwise merged in a grid anyway
        vertices, faces = _merged(vertices, faces, np.unique(vertices, axis=0, return_inverse=True)[1])
    vertices, faces = _fewer(vertices, faces)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    inside_out = np.einsum("fi,fi->", a, np.cross(b, c)) < 0  # the volume, of a closed surface
    return vertices, faces[:, ::-1] if inside_out else faces


def _stl(content: bytes) -> tuple[Array, Array]:
    count = int.from_bytes(content[80:HEADER], "little") if len(content) >= HEADER else 0
    if count and len(content) >= HEADER + count * TRIANGLE:
        layout = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(content, layout, count, HEADER)["corners"].astype(float).reshape(-1, 3)
    else:
        words = content.decode("ascii", "replace").split()
        if not words or words[0] != "solid":
            raise ValueError("neither the length of a binary one nor 'solid' at its beginning")
        at = [k for k, word in enumerate(words) if word == "vertex"]
        corners = np.array([[float(x) for x in words[k + 1 : k + 4]] for k in at]).reshape(-1, 3)
        if len(corners) % 3:
            raise ValueError("its last triangle is not complete")
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _obj(text: str) -> tuple[Array, Array]:
    vertices, faces = list[list[float]](), list[list[int]]()
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(x) for x in words[1:4]])
        elif words[:1] == ["f"]:
            of_vertices = [int(word.split("/")[0]) for word in words[1:]]
            corners = [n - 1 if n > 0 else len(vertices) + n for n in of_vertices]
            faces += [[corners[0], *pair] for pair in pairwise(corners[1:])]
    numbers = np.array(faces, int).reshape(-1, 3)
    if numbers.size and not (numbers.min() >= 0 and numbers.max() < len(vertices)):
        raise ValueError("a face names a vertex that it does not have")
    return np.array(vertices, float).reshape(-1, 3), numbers


def _merged(vertices: Array, faces: Array, keys: Array) -> tuple[Array, Array]:
    """Vertices with equal keys become one, in their middle; triangles that lose a corner vanish."""
    _, number = np.unique(keys.reshape(-1), return_inverse=True)
    weights = np.bincount(number)
    middle = np.column_stack([np.bincount(number, weights=x) / weights for x in vertices.T])
    faces = number[faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    faces = faces[np.sort(first)]
    used, faces = np.unique(faces, return_inverse=True)
    return middle[used], faces.reshape(-1, 3)


def _fewer(vertices: Array, faces: Array) -> tuple[Array, Array]:
    """Merge vertices in ever larger cells until at most MOST_DRAWN triangles remain."""
    low, side = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    for cells in CELLS:  # of the last, 27 corners have fewer triangles
        if len(faces) <= MOST_DRAWN:
            break
        place = np.floor((vertices - low) / side * cells).astype(int)
        vertices, faces = _merged(vertices, faces, place @ [1, cells + 1, (cells + 1) ** 2])
    return vertices, faces
