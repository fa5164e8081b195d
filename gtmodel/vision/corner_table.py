"""Tables of marks in pictures, whatever detector made them, and boards of known marks."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..results.disk import path_of
from ..results.refusal import ArgumentError


@dataclass(frozen=True)
class Board:
    """A chessboard with columns x rows inner corners, counted row by row from one end.

    square: side of a square [m]; None where it is not known, and then lengths are in squares. identified: whether each
    corner was recognised by itself, as on a ChArUco board.

    A board whose columns and rows are both even or both odd looks the same when turned by 180 degrees, and one with as
    many columns as rows when turned by 90 degrees or 180: a detector counts its corners from either end. Unless they
    are identified it is refused. Raises ArgumentError.

    >>> gt.vision.Board(9, 6, square=0.025).points[[0, 1, 9]]
    array([[0.   , 0.   , 0.   ],
           [0.025, 0.   , 0.   ],
           [0.   , 0.025, 0.   ]])
    >>> gt.vision.Board(8, 6)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: board: 8 x 6 corners look the same when the board is turned by 180 degrees...
    """

    columns: int
    rows: int
    square: float | None = None
    identified: bool = False

    def __post_init__(self) -> None:
        if self.columns < 2 or self.rows < 2:
            raise ArgumentError(f"found {self.columns} x {self.rows} corners; expected at least 2 x 2", "board")
        if self.square is not None and not (np.isfinite(self.square) and self.square > 0):
            raise ArgumentError(f"a square has a positive side; found {self.square:g}", "board.square")
        if not self.identified and (self.columns + self.rows) % 2 == 0:
            raise ArgumentError(
                f"{self.columns} x {self.rows} corners look the same when the board is turned by 180 degrees; take one "
                "with an even and an odd number of corners, or marks that carry an identity",
                "board",
            )

    @property
    def points(self) -> np.ndarray:
        """Corners (columns * rows, 3), z = 0 [m], or in squares."""
        y, x = np.divmod(np.arange(self.columns * self.rows), self.columns)
        return np.column_stack([x, y, np.zeros(len(x))]) * (self.square or 1.0)


PICTURE, MARK = ("picture", "pair", "pose"), ("mark", "corner")


@dataclass(frozen=True, eq=False)
class CornerTable:
    """Marks that cameras saw, one observation a row.

    cameras, pictures: their names; camera, picture (n,): which of them; pictures of one name were taken at the same
    moment. X (n, 3): the mark on its board, in lengths of the board; uv (n, 2) [pixel]: where it was seen. sigma (n,)
    [pixel]: the detector's own standard deviation, None where it gives none. marks (n,): their names.

    Raises ArgumentError for lengths that do not fit, values that are not finite and a sigma that is not positive.
    """

    cameras: tuple[str, ...]
    pictures: tuple[str, ...]
    camera: np.ndarray
    picture: np.ndarray
    X: np.ndarray
    uv: np.ndarray
    marks: tuple[str, ...]
    sigma: np.ndarray | None = None
    source: str = field(default="", repr=False)

    def __post_init__(self) -> None:
        n = len(self.camera)
        shapes = [np.shape(self.picture), np.shape(self.X), np.shape(self.uv), (len(self.marks),)]
        if shapes != [(n,), (n, 3), (n, 2), (n,)] or (self.sigma is not None and np.shape(self.sigma) != (n,)):
            raise ArgumentError(
                f"the columns of the corners have the shapes {shapes}; expected {n} rows of each", "corners"
            )
        if not (np.all(np.isfinite(self.X)) and np.all(np.isfinite(self.uv))):
            raise ArgumentError("a corner has a value that is not finite; leave its row out", "corners")
        if self.sigma is not None and not np.all(np.isfinite(self.sigma) & (self.sigma > 0)):
            k = int(np.argmin(np.isfinite(self.sigma) & (self.sigma > 0)))
            raise ArgumentError(
                f"{self.label(k)} has a sigma of {self.sigma[k]:g} pixel; expected a positive standard deviation",
                "corners",
            )

    @property
    def n(self) -> int:
        """Observations."""
        return len(self.camera)

    def rows(self, keep: np.ndarray) -> CornerTable:
        """The observations of a mask or of indices; names of cameras and pictures stay."""
        k = np.arange(self.n)[keep]
        return CornerTable(
            self.cameras, self.pictures, self.camera[k], self.picture[k], self.X[k], self.uv[k],
            tuple(self.marks[i] for i in k), None if self.sigma is None else self.sigma[k], self.source,
        )  # fmt: skip

    def without(self, pictures: Sequence[str]) -> CornerTable:
        """The table without pictures of these names."""
        left = [p for p, name in enumerate(self.pictures) if name not in pictures]
        number = np.cumsum(np.isin(np.arange(len(self.pictures)), left)) - 1
        some = self.rows(np.isin(self.picture, left))
        return replace(some, pictures=tuple(self.pictures[p] for p in left), picture=number[some.picture])

    def label(self, row: int) -> str:
        """An observation in words: "corner 7 of picture 03 in left"."""
        picture, camera = self.pictures[self.picture[row]], self.cameras[self.camera[row]]
        return f"corner {self.marks[row]} of picture {picture} in {camera}"


def read_corners(path: str | Path) -> CornerTable:
    """A corner table of a CSV file with a header, in one of two forms; Z may be left out, and is then 0.

    Wide: picture (or pair, pose), corner (or mark), X, Y, Z, and for each camera u_NAME, v_NAME; an empty cell is a
    mark that the camera does not see. Long: camera, picture, corner, X, Y, Z, u, v, sigma; sigma may be left out. X,
    Y, Z in lengths of the board, u, v and sigma in pixels.

    Raises ArgumentError for a file that is none of both, with the line; also where a column stands twice, a row has
    more cells than the header, or only one of u and v is there.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "corners.csv"
    ...     _ = file.write_text("pair,corner,X,Y,u_left,v_left,u_right,v_right\\n01,0,0,0,244.4,94.1,127.9,110.3\\n")
    ...     table = gt.vision.read_corners(file)
    >>> table.cameras, table.n, table.uv[1]
    (('left', 'right'), 2, array([127.9, 110.3]))
    """
    path = path_of(path)
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            file_header = list(reader.fieldnames or ())
            rows = [(file_row, line) for line, file_row in enumerate(reader, 2)]
    except (OSError, UnicodeDecodeError) as error:
        raise ArgumentError(f"cannot read {path.name}: {error}", "corners") from None
    if not rows:
        raise ArgumentError(f"{path.name} has no rows of corners", "corners")
    columns = tuple(rows[0][0])
    picture, mark = _one_of(columns, PICTURE, path), _one_of(columns, MARK, path)
    for name in ("X", "Y"):
        _one_of(columns, (name,), path)
    twice = [c for c in columns if file_header.count(c) > 1]
    if twice:
        raise ArgumentError(f"{path.name} has the column {twice[0]} more than once", "corners")
    for row, line in rows:
        if None in row:
            raise ArgumentError(f"line {line} of {path.name} has more cells than the header", "corners")
    if "camera" in columns:
        for name in ("u", "v"):
            _one_of(columns, (name,), path)
        cameras = tuple(dict.fromkeys(str(row["camera"]) for row, _ in rows))
        seen = [(row, line, cameras.index(row["camera"]), "u", "v") for row, line in rows]
    else:
        cameras = tuple(c[2:] for c in columns if c.startswith("u_"))
        others = tuple(c[2:] for c in columns if c.startswith("v_"))
        lost = set(cameras) ^ set(others)
        if not cameras or lost:
            raise ArgumentError(
                f"{path.name} has the columns {', '.join(columns)}; expected camera, u and v, or u_NAME and v_NAME of "
                "each camera",
                "corners",
            )
        seen = [(row, line, c, f"u_{name}", f"v_{name}") for c, name in enumerate(cameras) for row, line in rows]
    for row, line, _, u, v in seen:
        if _empty(row, u) != _empty(row, v):
            gone, there = (u, v) if _empty(row, u) else (v, u)
            raise ArgumentError(
                f"line {line} of {path.name} has a {there} and no {gone}; expected both, or none for a mark that is "
                "not seen",
                "corners",
            )
    seen = [s for s in seen if not _empty(s[0], s[3])]
    pictures = tuple(dict.fromkeys(str(row[picture]) for row, _ in rows))
    places = {name: k for k, name in enumerate(pictures)}

    def numbers(name: str) -> list[float]:
        return [_number(row, name, line, path) for row, line, *_ in seen]

    X = np.array([numbers(c) if c in columns else [0.0] * len(seen) for c in ("X", "Y", "Z")]).T.reshape(-1, 3)
    uv = np.array([[_number(row, u, line, path), _number(row, v, line, path)] for row, line, _, u, v in seen])
    sigma = np.array(numbers("sigma")) if "camera" in columns and "sigma" in columns else None
    return CornerTable(
        cameras, pictures, np.array([c for _, _, c, _, _ in seen]),
        np.array([places[row[picture]] for row, *_ in seen]), X, uv.reshape(-1, 2),
        tuple(str(row[mark]) for row, *_ in seen), sigma, path.name,
    )  # fmt: skip


def _one_of(columns: Sequence[str], names: Sequence[str], path: Path) -> str:
    there = [n for n in names if n in columns]
    if not there:
        raise ArgumentError(
            f"{path.name} has the columns {', '.join(columns)}; expected {' or '.join(names)}", "corners"
        )
    return there[0]


def _empty(row: Mapping[str, str | None], name: str) -> bool:
    return not (row[name] or "").strip()


def _number(row: Mapping[str, str | None], name: str, line: int, path: Path) -> float:
    try:
        value = float(row[name] or "")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise ArgumentError(
            f"line {line} of {path.name} has '{row[name]}' in the column {name}; expected a number", "corners"
        )
    return value
