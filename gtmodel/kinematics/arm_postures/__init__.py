"""All postures of a serial arm for one pose, a table of poses or a path.

Study: postures_study returns a PosturesStudy. ToolPose: one pose, with its orientation in any representation;
ToolPoses: many as arrays; read_tool_poses: from a file with declared columns, ToolColumns.
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .options import (
        PosturesStudy as PosturesStudy,
        ToolColumns as ToolColumns,
        ToolPose as ToolPose,
        ToolPoses as ToolPoses,
    )
    from .postures_study import postures_study as postures_study, read_tool_poses as read_tool_poses

public(__name__)
