"""The keys of kind "stereo"."""

from __future__ import annotations

from pydantic import Field

from gtmodel.problem_files.base import FileSection, Problem, Source
from gtmodel.problem_files.from_options import Made
from gtmodel.vision.stereo import options

RESULT = "gtmodel.vision.StereoStudy"


class CornersSection(FileSection):
    """Corners of the board in all pictures: a CSV with the columns picture, corner, X, Y [squares] and u_NAME, v_NAME
    [pixel] of each camera, or camera, picture, corner, X, Y, u, v, sigma."""

    file: str = Field(description="path from the problem's folder")
    source: Source = ""
    leave_out: list[str] = Field(default=[], description="names of pictures that are not taken")


class Schema(Problem):
    """Lenses of one or more cameras and where these stand, from corners of a board in their pictures."""

    corners: CornersSection
    board: Made[options.BoardPictures]
    fit: Made[options.CameraFit] = Made[options.CameraFit].left_out()
    start: Made[options.StereoStart] = Made[options.StereoStart].left_out()
