"""Calibration of cameras from pictures of a board.

Study
    stereo_study        corners -> lenses, camera poses, named gross errors, residuals over the picture
    BoardPictures, CameraFit, StereoStart, StereoStudy
Parts
    camera_starts, calibrated, gross_errors     starting values, the fit, wrong corners and pictures
    SyntheticBoards, made_corners               synthetic corners
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from ..residuals import GrossErrors as GrossErrors, gross_errors as gross_errors
    from .calibration import CameraStarts as CameraStarts, calibrated as calibrated, camera_starts as camera_starts
    from .options import (
        BoardPictures as BoardPictures,
        CameraFit as CameraFit,
        StereoStart as StereoStart,
        StereoStudy as StereoStudy,
    )
    from .study import explained_pictures as explained_pictures, stereo_study as stereo_study
    from .synthetic import SyntheticBoards as SyntheticBoards, made_corners as made_corners

public(__name__)
