"""Serial chains: axes as lines, closed forms found from them, all postures of a pose."""

from .chain import Chain as Chain
from .closed import (
    BranchSign as BranchSign,
    ClosedForm as ClosedForm,
    Expressions as Expressions,
    closed_form as closed_form,
)
from .elbow import ElbowAngle as ElbowAngle, elbow_angle as elbow_angle
from .path import PostureJump as PostureJump, PosturePath as PosturePath, along_path as along_path
from .postures import LockedJoint as LockedJoint, Postures as Postures, postures as postures
