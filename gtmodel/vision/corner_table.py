"""Tables of marks in pictures, from any detector, and boards of known marks."""

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

    square: side of a square [m]; if None, it is unknown and lengths are in squares. identified: whether each corner
    is recognised individually, as on a ChArUco board.

    A board whose columns and rows are both even or both odd looks the same when turned by 180 degrees, and one with as
    many columns as rows also when turned by 90 degrees: a detector may count its corners from either end. Raises
    ArgumentError for such a board unless its corners are identified.

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
            raise ArgumentError(f"found a side of {self.square:g}; expected a positive length", "board.square")
        if not self.identified and (self.columns + self.rows) % 2 == 0:
            raise ArgumentError(
                f"{self.columns} x {self.rows} corners look the same when the board is turned by 180 degrees; use a "
                "board with one even and one odd number of corners, or one with coded marks",
                "board",
            )

    @property
    def points(self) -> np.ndarray:
        """Corners (columns * rows, 3) with z = 0, in metres, or in squares if `square` is None."""
        y, x = np.divmod(np.arange(self.columns * self.rows), self.columns)
        return np.column_stack([x, y, np.zeros(len(x))]) * (self.square or 1.0)


PICTURE, MARK = ("picture", "pair", "pose"), ("mark", "corner")


@dataclass(frozen=True, eq=False)
class CornerTable:
    """Marks observed by cameras, one observation per row.

    cameras, pictures: names; camera, picture (n,): their indices. Pictures of the same name were taken at the same
    time. X (n, 3): position of the mark on its board, in the board's unit of length; uv (n, 2) [pixel]: the detected
    position. sigma (n,) [pixel]: standard deviation stated by the detector, None if it states none. marks (n,): names.

    Raises ArgumentError if lengths do not match, values are not finite, or a sigma is not positive.
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
            raise ArgumentError(f"found columns of the shapes {shapes}; expected {n} rows in each", "corners")
        if not (np.all(np.isfinite(self.X)) and np.all(np.isfinite(self.uv))):
            raise ArgumentError("found a corner with a value that is not finite; remove its row", "corners")
        if self.sigma is not None and not np.all(np.isfinite(self.sigma) & (self.sigma > 0)):
            k = int(np.argmin(np.isfinite(self.sigma) & (self.sigma > 0)))
            raise ArgumentError(
                f"{self.label(k)} has a sigma of {self.sigma[k]:g} pixel; expected a positive standard deviation",
                "corners",
            )

    @property
    def n(self) -> int:
        """Number of observations."""
        return len(self.camera)

    def rows(self, keep: np.ndarray) -> CornerTable:
        """Return the observations of a mask or of indices; the names of cameras and pictures stay."""
        k = np.arange(self.n)[keep]
        return CornerTable(
            self.cameras, self.pictures, self.camera[k], self.picture[k], self.X[k], self.uv[k],
            tuple(self.marks[i] for i in k), None if self.sigma is None else self.sigma[k], self.source,
        )  # fmt: skip

    def without(self, pictures: Sequence[str]) -> CornerTable:
        """Return the table without the pictures of these names."""
        keep = [p for p, name in enumerate(self.pictures) if name not in pictures]
        number = np.cumsum(np.isin(np.arange(len(self.pictures)), keep)) - 1
        part = self.rows(np.isin(self.picture, keep))
        return replace(part, pictures=tuple(self.pictures[p] for p in keep), picture=number[part.picture])

    def label(self, row: int) -> str:
        """Return an observation in words, such as "corner 7 of picture 03 in left"."""
        picture, camera = self.pictures[self.picture[row]], self.cameras[self.camera[row]]
        return f"corner {self.marks[row]} of picture {picture} in {camera}"


def read_corners(path: str | Path) -> CornerTable:
    """Read a corner table from a CSV file with a header, in a wide or a long form; Z is 0 if left out.

    Wide: picture (or pair, pose), corner (or mark), X, Y, Z, and for each camera u_NAME, v_NAME; empty cells mean that
    the camera does not see the mark. Long: camera, picture, corner, X, Y, Z, u, v, sigma; sigma may be left out. X,
    Y, Z are in the board's unit of length, u, v and sigma in pixels.

    Raises ArgumentError with the line if the file has neither form, a column occurs twice, a row has more cells than
    the header, or only one of u and v is present.

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
        cells = [(row, line, cameras.index(row["camera"]), "u", "v") for row, line in rows]
    else:
        cameras = tuple(c[2:] for c in columns if c.startswith("u_"))
        if not cameras or set(cameras) != {c[2:] for c in columns if c.startswith("v_")}:
            raise ArgumentError(
                f"{path.name} has the columns {', '.join(columns)}; expected camera, u and v, or u_NAME and v_NAME for "
                "each camera",
                "corners",
            )
        cells = [(row, line, c, f"u_{name}", f"v_{name}") for c, name in enumerate(cameras) for row, line in rows]
    for row, line, _, u, v in cells:
        if _empty(row, u) != _empty(row, v):
            missing, present = (u, v) if _empty(row, u) else (v, u)
            raise ArgumentError(
                f"line {line} of {path.name} has {present} but not {missing}; fill in both, or leave both empty if the "
                "mark is not visible",
                "corners",
            )
    cells = [c for c in cells if not _empty(c[0], c[3])]
    pictures = tuple(dict.fromkeys(str(row[picture]) for row, _ in rows))
    places = {name: k for k, name in enumerate(pictures)}

    def numbers(name: str) -> list[float]:
        return [_number(row, name, line, path) for row, line, *_ in cells]

    X = np.array([numbers(c) if c in columns else [0.0] * len(cells) for c in ("X", "Y", "Z")]).T.reshape(-1, 3)
    uv = np.array([[_number(row, u, line, path), _number(row, v, line, path)] for row, line, _, u, v in cells])
    sigma = np.array(numbers("sigma")) if "camera" in columns and "sigma" in columns else None
    return CornerTable(
        cameras, pictures, np.array([c for _, _, c, _, _ in cells]),
        np.array([places[row[picture]] for row, *_ in cells]), X, uv.reshape(-1, 2),
        tuple(str(row[mark]) for row, *_ in cells), sigma, path.name,
    )  # fmt: skip


def _one_of(columns: Sequence[str], names: Sequence[str], path: Path) -> str:
    present = [n for n in names if n in columns]
    if not present:
        raise ArgumentError(
            f"{path.name} has the columns {', '.join(columns)}; expected {' or '.join(names)}", "corners"
        )
    return present[0]


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
