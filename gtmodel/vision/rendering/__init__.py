"""Synthetic pictures of flat targets: exact area coverage of every pixel, distortion, blur and noise with a seed.

coverage          how much of each pixel polygons cover
Exposure          blur, noise, brightness, seed
rendered          a picture of targets at poses, through any projection
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .picture import Exposure as Exposure, Layer as Layer, coverage as coverage, rendered as rendered

public(__name__)
