"""OpenCV, where it is installed, and its boards."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...results.refusal import ArgumentError

if TYPE_CHECKING:
    from .targets import Charuco


def opencv() -> Any:
    """The module cv2. Raises ArgumentError with what to install."""
    try:
        import cv2
    except ImportError:
        raise ArgumentError(
            "detection needs OpenCV, which is not installed: pip install 'gtmodel[vision]', or give a table of corners"
        ) from None
    return cv2


def charuco_board(target: Charuco) -> Any:
    """OpenCV's board of a target. Raises ArgumentError for an unknown dictionary."""
    cv2 = opencv()
    number = getattr(cv2.aruco, target.dictionary, None)
    if number is None or not target.dictionary.startswith("DICT_"):
        raise ArgumentError(f"OpenCV has no dictionary '{target.dictionary}'; take DICT_4X4_250", "dictionary")
    words = cv2.aruco.getPredefinedDictionary(number)
    return cv2.aruco.CharucoBoard((target.columns, target.rows), target.side, target.marker, words)
