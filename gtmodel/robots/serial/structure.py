"""What a serial arm is made of, apart from its numbers: joints in their order, their limits, names and couplings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

JointKind = Literal["revolute", "prismatic"]
Style = Literal["rpy", "standard", "modified"]


@dataclass(frozen=True)
class ArmJoint:
    """A moving joint: its name, kind and the link that it moves; limits in rad or m, rad/s or m/s, N.m or N.

    A joint with a `leader`, the place of another one among the joints of the arm, follows it (mimic of URDF): its
    coordinate is multiplier times the leader's plus offset.
    """

    name: str
    kind: JointKind
    link: str
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf
    leader: int | None = None
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class ArmStructure:
    """The joints of an arm from the base to the tool, and how they are placed.

    style: by xyz and rpy ("rpy"), or by standard or modified Denavit-Hartenberg numbers. smoothing: of friction. notes:
    what was left out of the file it came from, in sentences.
    """

    name: str
    joints: tuple[ArmJoint, ...]
    style: Style
    base: str = "base"
    tool: str = "tool"
    smoothing: str = "tanh"
    notes: tuple[str, ...] = ()

    @property
    def leaders(self) -> list[int]:
        """Places of the joints that follow no other, in the order of q."""
        return [k for k, joint in enumerate(self.joints) if joint.leader is None]

    def coordinate(self, k: int) -> tuple[int, float, float]:
        """Of joint k: the place in q, and multiplier and offset of what stands there."""
        joint = self.joints[k]
        if joint.leader is None:
            return self.leaders.index(k), 1.0, 0.0
        return self.leaders.index(joint.leader), joint.multiplier, joint.offset

    def geared(self, k: int) -> bool:
        """Whether joint k turns and follows one that slides, or the reverse: as nut and spindle."""
        leader = self.joints[k].leader
        return leader is not None and self.joints[leader].kind != self.joints[k].kind

    @property
    def kinds(self) -> set[str]:
        """Kinds of joints that there are."""
        return {joint.kind for joint in self.joints}

    def limits(self) -> np.ndarray:
        """Of q (n, 2), lower and upper; those of followers too, as far as they bind."""
        low, high = (np.full(len(self.leaders), v) for v in (-np.inf, np.inf))
        for k, joint in enumerate(self.joints):
            at, multiplier, offset = self.coordinate(k)
            if multiplier == 0.0:
                continue
            ends = sorted([(joint.lower - offset) / multiplier, (joint.upper - offset) / multiplier])
            low[at], high[at] = max(low[at], ends[0]), min(high[at], ends[1])
        return np.column_stack([low, high])
