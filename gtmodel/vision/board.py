"""Boards of known marks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
