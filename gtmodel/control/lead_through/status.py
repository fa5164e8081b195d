"""What a wrench is good for: one enumeration for calibration, start-up and the cycle."""

from __future__ import annotations

from ...results.status import NumberedStatus


class WrenchStatus(NumberedStatus):
    """Whether a force sensor's wrench may be used; OK is 0, all others say why not.

    `message` is the plain English shown to people; `ok` is True for OK only.

    >>> gt.control.lead_through.WrenchStatus.NO_FORCE.message
    'the force is not larger than its noise or the declared least force: it has no direction'
    """

    OK = 0, "the wrench can be used"
    NO_FORCE = 1, "the force is not larger than its noise or the declared least force: it has no direction"
    ONE_DIRECTION = 2, "all forces have nearly one direction: where they act along it is undetermined"
    WRONG_SIGN = 3, "the sensor reports the force by the tool, or its axes or gravity are turned over"
    NOT_FINITE = 4, "a number of the wrench or its age is not finite"
    SATURATED = 5, "a component of the wrench reaches the end of its range"
    STALE = 6, "the wrench is older than the law allows"
    SENSOR_FAULT = 7, "the sensor itself reports a fault"
    NO_ROTATION = 8, "the orientation of the tool is no rotation matrix"
    WRONG_LOAD = 9, "at rest the sensor does not read the weight of its calibration: another load, sensor or frame"
    DOUBTFUL = 10, "the readings do not follow bias and weight: look at the alarms, which say how"
