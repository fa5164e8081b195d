"""The background of a sequence of pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...results.refusal import ArgumentError


def background(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """The median (rows, columns) of pictures in which the tool stands elsewhere (Dressler 2012, Fig. 5.12: of ten).

    Raises ArgumentError for fewer than three pictures, and for pictures of several sizes.

    >>> pictures = [np.full((2, 3), level, np.uint8) for level in (10, 20, 90)]
    >>> gt.vision.detection.background(pictures)[0]
    array([20., 20., 20.])
    """
    if len(pictures) < 3:
        raise ArgumentError(f"expected three pictures or more; found {len(pictures)}", "pictures")
    sizes = {np.shape(p) for p in pictures}
    if len(sizes) > 1:
        raise ArgumentError(f"the pictures have {len(sizes)} sizes; give those of one camera", "pictures")
    return np.median(np.stack([np.asarray(p, float) for p in pictures]), axis=0)
