"""Planar targets with their marks and their pattern, and the result of detecting one in a picture."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any

import numpy as np

from ...results.options import Options, Unit, Within
from ...results.refusal import ArgumentError
from ..rendering import Layer


def opencv() -> Any:
    """Return the module cv2. Raises ArgumentError if OpenCV is not installed."""
    try:
        import cv2
    except ImportError:
        raise ArgumentError(
            "detection needs OpenCV, which is not installed: pip install 'gtmodel[vision]', or use a corner table"
        ) from None
    return cv2


def charuco_board(target: Charuco) -> Any:
    """Return OpenCV's board for a target. Raises ArgumentError for an unknown dictionary."""
    cv2 = opencv()
    number = getattr(cv2.aruco, target.dictionary, None)
    if number is None or not target.dictionary.startswith("DICT_"):
        raise ArgumentError(
            f"OpenCV has no dictionary '{target.dictionary}'; use DICT_4X4_250, for example", "dictionary"
        )
    dictionary = cv2.aruco.getPredefinedDictionary(number)
    return cv2.aruco.CharucoBoard((target.columns, target.rows), target.side, target.marker, dictionary)


class DetectionStatus(IntEnum):
    """Outcome of a detection."""

    OK = 0
    TOO_DARK = 1
    TOO_BRIGHT = 2
    PARTLY_VISIBLE = 3
    NOT_SEEN = 4

    @property
    def ok(self) -> bool:
        """Whether the marks may be used."""
        return self is DetectionStatus.OK


SENTENCES = {
    DetectionStatus.OK: "the target was detected",
    DetectionStatus.TOO_DARK: "the picture is too dark: light the target, or expose longer",
    DetectionStatus.TOO_BRIGHT: "the picture is too bright and saturates: use a shorter exposure",
    DetectionStatus.PARTLY_VISIBLE: "the target is only partly in the picture, or partly covered",
    DetectionStatus.NOT_SEEN: "the target was not detected in the picture",
}


@dataclass(frozen=True, eq=False)
class Detection:
    """Marks of one picture: names `marks` (n), `corners` (n, 2) u, v [pixel], `sigma` (n,) [pixel] of each coordinate.

    The centre of the first pixel is (0, 0). If the detection failed there are no marks, and `message` gives the reason.
    """

    status: DetectionStatus
    marks: tuple[str, ...] = ()
    corners: np.ndarray = None  # type: ignore[assignment]
    sigma: np.ndarray = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.corners is None:
            object.__setattr__(self, "corners", np.zeros((0, 2)))
            object.__setattr__(self, "sigma", np.zeros(0))

    @property
    def message(self) -> str:
        """The status as a sentence."""
        return SENTENCES[self.status]


# An example, in sides: the thesis does not state the dimensions of its tool. The fifth square is off the cross, so that
# no rotation or reflection maps the pattern onto itself.
CENTRES = [[-2.0, -1.8], [2.0, -1.8], [0.3, 0.0], [-2.0, 1.8], [1.1, 1.8]]
DARK, LIGHT, MARGIN = 30.0, 210.0, 1.0  # of 255; of a side
OUTLINE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])  # clockwise as seen: y is down


@dataclass(frozen=True)
class FiveSquares(Options):
    """Black squares on a light plate, like the tool of Dressler 2012, section 5.5; 20 corners.

    Seen from the front, x is to the right, y down and z away. Marks are named "0.0" to "4.3": square and corner,
    clockwise from the upper left. The default layout is an example, not that of the thesis.

    >>> tool = gt.vision.detection.FiveSquares(side=0.04)
    >>> tool.points.shape, tool.marks[:5]
    ((20, 3), ('0.0', '0.1', '0.2', '0.3', '1.0'))
    """

    side: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "of each square"] = 0.04
    centres: Annotated[
        list[list[float]] | None, "centres of the squares, in sides of a square; the example layout if left out"
    ] = None

    def __post_init__(self) -> None:
        if self.centres is None:
            object.__setattr__(self, "centres", [list(c) for c in CENTRES])
        Options.__post_init__(self)
        c = np.asarray(self.centres, float)
        if c.ndim != 2 or c.shape[1] != 2 or len(c) < 2:
            raise ArgumentError(f"found {len(c)} centres; expected at least two, each [x, y]", "centres")
        _not_symmetric(c)

    @property
    def squares(self) -> np.ndarray:
        """(squares, 4, 3) [m] corners."""
        flat = self.side * (np.asarray(self.centres, float)[:, None] + OUTLINE)
        return np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], axis=2)

    @property
    def points(self) -> np.ndarray:
        """(4 squares, 3) [m] marks."""
        return self.squares.reshape(-1, 3)

    @property
    def marks(self) -> tuple[str, ...]:
        """Names of the marks."""
        return tuple(f"{k}.{c}" for k in range(len(self.points) // 4) for c in range(4))

    @property
    def layers(self) -> list[Layer]:
        """The plate and its squares, for rendering."""
        return [Layer([_plate(self.points, MARGIN * self.side)], LIGHT), Layer(list(self.squares), DARK)]


@dataclass(frozen=True)
class Chessboard(Options):
    """A board of black and white squares; its marks are the inner corners.

    `columns` and `rows` count the marks. Seen from the front, x is to the right and y down. The square at the lower
    right of mark "0" is black, and the marks are counted row by row. One of the numbers must be odd and the other even;
    otherwise the board looks the same when turned by 180 degrees.

    >>> board = gt.vision.detection.Chessboard(columns=9, rows=6, side=0.03)
    >>> board.points[10]
    array([0.03, 0.03, 0.  ])
    >>> gt.vision.detection.Chessboard(columns=7, rows=7, side=0.03)
    Traceback (most recent call last):
    gtmodel...: columns: a board of 7 by 7 corners looks the same when it is turned by 180 degrees; take one odd and...
    """

    columns: Annotated[int, Within(least=3, most=100), "marks along x"] = 9
    rows: Annotated[int, Within(least=3, most=100), "marks along y"] = 6
    side: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "of a square"] = 0.03

    def __post_init__(self) -> None:
        Options.__post_init__(self)
        if (self.columns + self.rows) % 2 == 0:
            raise ArgumentError(
                f"a board of {self.columns} by {self.rows} corners looks the same when it is turned by 180 degrees; "
                "take one odd and one even number",
                "columns",
            )

    @property
    def points(self) -> np.ndarray:
        """(columns rows, 3) [m] marks."""
        y, x = np.mgrid[: self.rows, : self.columns]
        return self.side * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)

    @property
    def marks(self) -> tuple[str, ...]:
        """Names of the marks."""
        return tuple(str(k) for k in range(self.columns * self.rows))

    @property
    def layers(self) -> list[Layer]:
        """The board and its squares, for rendering."""
        squares = [
            self.side * _cell(i, j)
            for j in range(-1, self.rows) for i in range(-1, self.columns) if (i + j) % 2 == 0
        ]  # fmt: skip
        corners = np.concatenate(squares)
        return [Layer([_plate(corners, MARGIN * self.side)], LIGHT), Layer(squares, DARK)]


@dataclass(frozen=True)
class Charuco(Options):
    """A chessboard whose white squares carry coded marks (ArUco), which identify the corners of a partly visible board.

    `columns` and `rows` count the squares, as in OpenCV; marks are the inner corners, named by OpenCV's numbers.

    >>> board = gt.vision.detection.Charuco(columns=7, rows=5, side=0.04, marker=0.03)
    >>> board.points.shape, board.marks[-1]
    ((24, 3), '23')
    """

    columns: Annotated[int, Within(least=3, most=50), "squares along x"] = 7
    rows: Annotated[int, Within(least=3, most=50), "squares along y"] = 5
    side: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "of a square"] = 0.04
    marker: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "side of a coded mark"] = 0.03
    dictionary: Annotated[str, "of OpenCV, such as DICT_4X4_250"] = "DICT_4X4_250"

    def __post_init__(self) -> None:
        Options.__post_init__(self)
        if self.marker >= self.side:
            raise ArgumentError(f"found {self.marker:g} m; expected less than the side of {self.side:g} m", "marker")

    @property
    def points(self) -> np.ndarray:
        """((columns - 1) (rows - 1), 3) [m] marks."""
        y, x = np.mgrid[1 : self.rows, 1 : self.columns]
        return self.side * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)

    @property
    def marks(self) -> tuple[str, ...]:
        """Names of the marks."""
        return tuple(str(k) for k in range((self.columns - 1) * (self.rows - 1)))

    @property
    def layers(self) -> list[Layer]:
        """The board with its coded marks, for rendering. Needs OpenCV."""

        board = charuco_board(self)
        cells = [self.side * _cell(i, j)
                 for j in range(self.rows) for i in range(self.columns) if (i + j) % 2 == 0]  # fmt: skip
        dictionary, size = board.getDictionary(), board.getDictionary().markerSize + 2
        bits = list[np.ndarray]()
        for place, number in zip(board.getObjPoints(), np.ravel(board.getIds()), strict=True):
            image = dictionary.generateImageMarker(int(number), size, borderBits=1)
            corner, bit = np.asarray(place, float)[0], self.marker / size
            for row, column in np.argwhere(image < 128):
                bits.append(np.array([*corner[:2], 0.0]) + bit * _cell(column, row))
        plate = _plate(np.concatenate(cells), MARGIN * self.side)
        return [Layer([plate], LIGHT), Layer(cells, DARK), Layer(bits, DARK)]


Target = FiveSquares | Chessboard | Charuco


def _cell(column: int, row: int) -> np.ndarray:
    """Corners (4, 3) of a cell of side 1."""
    return np.column_stack([OUTLINE + np.array([column + 0.5, row + 0.5]), np.zeros(4)])


def _plate(points: np.ndarray, margin: float) -> np.ndarray:
    low, high = points[:, :2].min(axis=0) - margin, points[:, :2].max(axis=0) + margin
    return np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])


def _not_symmetric(c: np.ndarray) -> None:
    """Raise ArgumentError if a quarter or half turn maps the squares onto themselves."""
    d = c - c.mean(axis=0)
    for turns in (1, 2, 3):
        k = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), turns)
        gap = np.linalg.norm(d[:, None] @ k.T - d[None], axis=2).min(axis=1).max()
        if gap < 0.5:
            raise ArgumentError(
                f"the squares look the same when turned by {90 * turns} degrees; move one by more than half a side",
                "centres",
            )
