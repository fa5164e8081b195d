"""Synthetic pictures of planar targets with exact area coverage of every pixel, distortion, blur and seeded noise.

coverage          share of each pixel that polygons cover
Exposure          blur, noise, brightness, seed
rendered          a picture of targets, through any projection
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .picture import Exposure as Exposure, Layer as Layer, coverage as coverage, rendered as rendered

public(__name__)
