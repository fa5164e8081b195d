"""Pixels as residual blocks: what a camera sees of a board, or of single points."""

from __future__ import annotations

import casadi as ca

from ..geometry.expressions import applied
from ..geometry.pinhole import LENS, pixel


def board_view() -> ca.Function:
    """(lens (9,), camera pose (7,), board pose (7,), data (5,): X, Y, Z on the board, u, v) -> (error (2,) [pixel],
    margins (2,)).

    The camera's pose takes outer coordinates to its own, the board's takes its own to outer ones. The error is the
    predicted less the measured pixel.

    >>> f = gt.vision.board_view()
    >>> lens, still = [500.0, 500.0, 320.0, 240.0, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0, 0]
    >>> error, margins = f(lens, still, [1.0, 0, 0, 0, 0, 0, 2.0], [0.1, 0.0, 0.0, 344.0, 240.0])
    >>> error.full().ravel()
    array([1., 0.])
    """
    lens, camera, board, data = _symbols(7, 5)
    uv, margins = pixel(applied(camera, applied(board, data[:3])), lens)
    return ca.Function("board_view", [lens, camera, board, data], [uv - data[3:], margins])


def point_view() -> ca.Function:
    """(lens (9,), camera pose (7,), point (3,), data (2,): u, v) -> (error (2,) [pixel], margins (2,)); the point in
    outer coordinates, otherwise as board_view().

    >>> f = gt.vision.point_view()
    >>> lens, still = [500.0, 500.0, 320.0, 240.0, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0, 0]
    >>> f(lens, still, [0.1, 0, 2.0], [344.0, 240.0])[0].full().ravel()
    array([1., 0.])
    """
    lens, camera, point, data = _symbols(3, 2)
    uv, margins = pixel(applied(camera, point), lens)
    return ca.Function("point_view", [lens, camera, point, data], [uv - data, margins])


def mark_view() -> ca.Function:
    """(lens (9,), camera pose (7,), frame pose (7,), mark (3,), data (2,): u, v) -> (error (2,) [pixel], margins (2,)):
    a mark at unknown coordinates in a frame that moves, otherwise as board_view().

    >>> gt.vision.mark_view().n_in()
    5
    """
    lens, camera, frame, data = _symbols(7, 2)
    mark = ca.SX.sym("mark", 3)
    uv, margins = pixel(applied(camera, applied(frame, mark)), lens)
    return ca.Function("mark_view", [lens, camera, frame, mark, data], [uv - data, margins])


def _symbols(seen: int, data: int) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    return ca.SX.sym("lens", len(LENS)), ca.SX.sym("camera", 7), ca.SX.sym("seen", seen), ca.SX.sym("data", data)
