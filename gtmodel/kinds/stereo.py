"""Kind "stereo": lens parameters and poses of cameras from images of a board."""

from __future__ import annotations

from pydantic import Field

from gtmodel import vision
from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Problem, Source
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.results.refusal import naming
from gtmodel.vision import CornerTable, read_corners, stereo
from gtmodel.vision.stereo import options

RESULT = "gtmodel.vision.StereoStudy"


class CornersSection(FileSection):
    """Corners of the board in all images: a CSV with the columns picture, corner, X, Y [squares] and u_NAME, v_NAME
    [pixel] of each camera, or camera, picture, corner, X, Y, u, v, sigma."""

    file: str = Field(description="path from the problem's folder")
    source: Source = ""
    leave_out: list[str] = Field(default=[], description="names of images to leave out")


class Schema(Problem):
    """Lens parameters and poses of one or more cameras from the corners of a board in their images."""

    corners: CornersSection
    board: Made[options.BoardPictures]
    fit: Made[options.CameraFit] = Made[options.CameraFit].left_out()
    start: Made[options.StereoStart] = Made[options.StereoStart].left_out()


ARGUMENTS = {"corners": "corners.file"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the corners in the file."""
    if context.start is not None:
        raise InputError("--start: a calibration of cameras starts from its images; leave it out")
    board, fit, start = options_of(problem, "board", "fit", "start").values()
    return Call(vision.stereo_study, _table(problem, context), board, fit, start, title=problem.title)


def explain(problem: Schema, context: Context) -> str:
    """Describe the images of each camera and the unit of length."""
    lines = stereo.explained_pictures(_table(problem, context), problem.board.options())
    return "\n".join([f"{problem.heading}: {lines[0]}", *lines[1:]])


def _table(problem: Schema, context: Context) -> CornerTable:
    keys = problem.corners
    path = context.file(keys.file, "corners.file", source=keys.source)
    with naming("corners.file", refusal=InputError):
        table = read_corners(path)
    unknown = [name for name in keys.leave_out if name not in table.pictures]
    if unknown:
        raise InputError(
            f"there is no picture '{unknown[0]}'; there are {', '.join(table.pictures)}", "corners.leave_out"
        )
    return table.without(keys.leave_out) if keys.leave_out else table
