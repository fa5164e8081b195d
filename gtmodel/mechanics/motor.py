"""Motors."""

from __future__ import annotations

from .. import lang as gt
from .frames import Flange


class ForceMotor(gt.Model):
    """An ideal linear motor: pushes the flange with `force` [N] in the direction of positive s."""

    flange = gt.port(Flange)
    force = gt.variable(unit="N", nominal=100.0, description="motor force along positive s")

    def equations(self):
        yield self.flange.f == -self.force
