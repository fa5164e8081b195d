"""Pictures: one module per subject. Every function takes data, imports no study, and returns a matplotlib Figure."""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from . import (
        calibration as calibration,
        cameras as cameras,
        certificate as certificate,
        compliance as compliance,
        delayed as delayed,
        filters as filters,
        identification as identification,
        lead_through as lead_through,
        learning as learning,
        log as log,
        milling as milling,
        motion as motion,
        robot3d as robot3d,
        signals as signals,
        structure as structure,
        style as style,
        vibration as vibration,
        workspace as workspace,
    )

public(__name__)
