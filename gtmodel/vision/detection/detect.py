"""The marks of a target in one picture."""

from __future__ import annotations

import numpy as np

from ...results.refusal import ArgumentError
from .boards import detect_charuco, detect_chessboard
from .detection import Detection, DetectionStatus
from .squares import detect_squares
from .targets import Chessboard, FiveSquares, Target

DARK, BRIGHT = 45.0, 225.0  # of 255: the lightest and the darkest hundredth of a picture that is neither
SATURATED = 0.3  # share of pixels at 255


def detect(picture: np.ndarray, target: Target, background: np.ndarray | None = None) -> Detection:
    """Marks of a target in a grey picture (rows, columns) of 8 bits, to a fraction of a pixel.

    A picture that is too dark or too bright, and a target that is not whole in it, are statuses; of a `Charuco` a part
    is enough. `background`: the median of pictures of the same camera, of FiveSquares alone. Raises ArgumentError for
    what is no grey picture, and where OpenCV is missing.

    >>> from gtmodel.vision import detection, rendering
    >>> tool = detection.FiveSquares(side=0.04)
    >>> camera = lambda p: 1400 * p[:, :2] / (p[:, 2:] + 1.5) + [319.5, 239.5]
    >>> picture = rendering.rendered(tool.layers, camera, (640, 480))
    >>> seen = detection.detect(picture, tool)
    >>> seen.status.name, bool(np.abs(seen.corners - camera(tool.points)).max() < 0.1)
    ('OK', True)
    >>> detection.detect(picture // 8, tool).message
    'the picture is too dark: light the target, or expose longer'
    """
    image = np.asarray(picture)
    if image.ndim != 2 or image.dtype != np.uint8:
        raise ArgumentError(
            f"expected a grey picture (rows, columns) of 8 bits; found {image.dtype} of shape {image.shape}", "picture"
        )
    if background is not None and np.shape(background) != image.shape:
        raise ArgumentError(
            f"the background is {np.shape(background)} and the picture {image.shape}; take them of one camera",
            "background",
        )
    light = _light(image)
    if light is not None:
        return Detection(light)
    if isinstance(target, FiveSquares):
        return detect_squares(image, target, background)
    return detect_chessboard(image, target) if isinstance(target, Chessboard) else detect_charuco(image, target)


def _light(image: np.ndarray) -> DetectionStatus | None:
    """Too dark or too bright for edges that can be trusted."""
    low, high = np.percentile(image, [1, 99])
    if high < DARK:
        return DetectionStatus.TOO_DARK
    if low > BRIGHT or np.mean(image == 255) > SATURATED:
        return DetectionStatus.TOO_BRIGHT
    return None
