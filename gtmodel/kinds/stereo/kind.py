"""Kind "stereo": lenses of cameras and where these stand, from pictures of a board."""

from __future__ import annotations

from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.problem_files.from_options import options_of
from gtmodel.results import ArgumentError
from gtmodel.vision import CornerTable, read_corners, stereo_study
from gtmodel.vision.stereo import explained_pictures

from .keys import Schema

NAME = "stereo"
ARGUMENTS = {"corners": "corners.file"}


def call(problem: Schema, context: Context) -> Call:
    """The study of the corners that the file names."""
    if context.start is not None:
        raise InputError("--start: a calibration of cameras starts from its pictures; leave it out")
    board, fit, start = options_of(problem, "board", "fit", "start").values()
    return Call(stereo_study, _table(problem, context), board, fit, start, title=problem.title)


def explain(problem: Schema, context: Context) -> str:
    """What each camera saw, and in what lengths the result will be."""
    lines = explained_pictures(_table(problem, context), problem.board.options())
    return "\n".join([f"{problem.title or NAME}: {lines[0]}", *lines[1:]])


def _table(problem: Schema, context: Context) -> CornerTable:
    keys = problem.corners
    path = context.file(keys.file, "corners.file", source=keys.source)
    try:
        table = read_corners(path)
    except ArgumentError as error:
        raise InputError(error.message, "corners.file") from error
    unknown = [name for name in keys.leave_out if name not in table.pictures]
    if unknown:
        raise InputError(
            f"there is no picture '{unknown[0]}'; there are {', '.join(table.pictures)}", "corners.leave_out"
        )
    return table.without(keys.leave_out) if keys.leave_out else table
