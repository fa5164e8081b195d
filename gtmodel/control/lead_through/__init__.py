"""Lead-through with two force sensors, at handle and tool (Dressler 2012, chapter 8). Knows no robot; SI units and rad.

Wrenches
    calibrate_wrench -> WrenchCalibration   bias, mass and centre of a sensor's load from poses; contact wrenches
    lever_arm -> LeverArm                   where forces act; moment_about another point
    sign_test -> SignTest                   does the sensor report the force on the tool? asked before anything moves
    WrenchStatus                            why a wrench cannot be used
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .calibration import WrenchCalibration as WrenchCalibration, calibrate_wrench as calibrate_wrench
    from .lever import LeverArm as LeverArm, lever_arm as lever_arm
    from .sign import SignTest as SignTest, sign_test as sign_test
    from .status import WrenchStatus as WrenchStatus
    from .wrench import moment_about as moment_about

public(__name__)
