"""Joint calibration of a robot and cameras: pixels, closure equations and carts in one least-squares problem.

study, RobotCamerasStudy   robot parameters, cameras and errors on held-out poses, jointly and in two steps
RobotPictures, SecondDevice   corners and actuator readings at poses
read_pictures, write_pictures   read and write them as two CSV files
CameraStart, RobotCameras     cameras as known beforehand, and what is estimated
joint_fit, JointFit        fit of all corners and closure equations, with the poses eliminated
two_step_fit, TwoStepFit   intersect positions first, then calibrate the robot with them
picture_map, PictureMap    tests whether residuals depend on the place in the picture: radial part, quadratic map
SyntheticRobotCameras, made_pictures   synthetic pictures of a robot with known errors
predicted_positions        error over the workspace due to noise, predicted before or after the measurement
places_study, camera_places, CameraPlaces   placement of two cameras
hand_eye, HandEye          pose of a camera on the plate of an arm, or of a fixed camera
aligned_errors             errors relative to positions in another frame
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .hand_eye import HandEye as HandEye, hand_eye as hand_eye
    from .joint import JointFit as JointFit, joint_fit as joint_fit
    from .options import (
        CameraPlaces as CameraPlaces,
        CameraStart as CameraStart,
        RobotCameras as RobotCameras,
        RobotCamerasStudy as RobotCamerasStudy,
        SyntheticRobotCameras as SyntheticRobotCameras,
    )
    from .pictures import RobotPictures as RobotPictures, SecondDevice as SecondDevice
    from .predicted import (
        PlacedCameras as PlacedCameras,
        PredictedPositions as PredictedPositions,
        camera_places as camera_places,
        predicted_positions as predicted_positions,
    )
    from .reading import corner_rows as corner_rows, read_pictures as read_pictures, write_pictures as write_pictures
    from .study import (
        PictureMap as PictureMap,
        aligned_errors as aligned_errors,
        picture_map as picture_map,
        places_study as places_study,
        study as study,
    )
    from .synthetic import (
        MadePictures as MadePictures,
        made_hand_eye as made_hand_eye,
        made_pictures as made_pictures,
    )
    from .two_step import TwoStepFit as TwoStepFit, two_step_fit as two_step_fit

public(__name__)
