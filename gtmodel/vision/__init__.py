"""Camera models, starting values, pixel residuals, intersection of points, and calibration of cameras.

Cameras
    PinholeCamera               a component with a port for its frame, Brown's distortion, a status per mark
    project, undistort          points to pixels and back, with status codes; LENS names the nine parameters of a lens
    Board                       a chessboard of known size
Starts
    homography, focal_length, board_pose    from planar boards (Zhang), from points in space
Bundles, for gt.inference.bundle
    board_view, point_view, mark_view       pixel residuals as functions of lens, camera, and board, point or mark
    similarity_motions          the seven motions that pixels do not determine, by name
    BundleFile, read_bal, write_bal, bal_view   the files of "Bundle adjustment in the large"
Measurements
    CornerTable, read_corners   marks in pictures, from any detector
    intersect, IntersectedPoints    points from the pixels of several cameras, with covariance
    picture_test, PictureTest   tests whether residuals depend on the place in the picture
Calibration of cameras, in `stereo`
    stereo_study, StereoStudy   with BoardPictures, CameraFit, StereoStart
Packages
    detection      detects the marks of boards and of a tool's squares in pictures; needs OpenCV
    rendering      synthetic pictures with exact area coverage
    robot_cameras  joint calibration of a robot and cameras; placement of two cameras
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from ..geometry.pinhole import LENS as LENS, project as project, undistort as undistort
    from . import detection as detection, rendering as rendering, robot_cameras as robot_cameras, stereo as stereo
    from .bundle_files import (
        BundleFile as BundleFile,
        bal_view as bal_view,
        read_bal as read_bal,
        write_bal as write_bal,
    )
    from .camera import PinholeCamera as PinholeCamera
    from .corner_table import Board as Board, CornerTable as CornerTable, read_corners as read_corners
    from .residuals import PictureTest as PictureTest, picture_test as picture_test
    from .starts import board_pose as board_pose, focal_length as focal_length, homography as homography
    from .stereo import (
        BoardPictures as BoardPictures,
        CameraFit as CameraFit,
        StereoStart as StereoStart,
        StereoStudy as StereoStudy,
        stereo_study as stereo_study,
    )
    from .views import (
        IntersectedPoints as IntersectedPoints,
        board_view as board_view,
        intersect as intersect,
        mark_view as mark_view,
        point_view as point_view,
        similarity_motions as similarity_motions,
    )

public(__name__)
