"""Serial arms of URDF files in pinocchio: kinematics and dynamics of what is read, with side branches locked."""

from __future__ import annotations

from pathlib import Path

import numpy as np

URDF = Path(__file__).parent / "urdf"
FILES = ("serial", "telescope", "parallel", "spindle")
TIPS = {"serial": None, "telescope": "tool_point", "parallel": None, "spindle": None}


# joints that follow others or stand still, as the files have them: leader ("" for none), multiplier, offset
COUPLED = {
    "telescope": {"extend_2": ("extend_1", 0.8, 0.05), "grip": ("", 0.0, 0.01), "grip_other": ("", 0.0, 0.01)},
    "spindle": {"follow": ("turn", -0.05, 0.02), "open": ("reach", 4.0, 0.0)},
}  # fmt: skip


class Pinocchio:
    """A file in pinocchio, with all joints of the file; couplings and locks are applied here, by q_all = G q + g."""

    def __init__(self, path: Path, tip: str, coupled: dict[str, tuple[str, float, float]] | None = None) -> None:
        import pinocchio as pin

        self.pin = pin
        self.model = pin.buildModelFromUrdf(str(path))
        self.data = self.model.createData()
        self.frame = self.model.getFrameId(tip)
        coupled = coupled or {}
        names = list(self.model.names)[1:]
        # pinocchio sorts branches by name: the arm's own order is that along its chain
        free = [name for name in names if name not in coupled]
        self.G, self.g = np.zeros((len(names), len(free))), np.zeros(len(names))
        for k, name in enumerate(names):
            leader, multiplier, self.g[k] = coupled.get(name, (name, 1.0, 0.0))
            if leader:
                self.G[k, free.index(leader)] = multiplier

    def configuration(self, q: np.ndarray) -> np.ndarray:
        """Angles as pinocchio keeps them: of a continuous joint cosine and sine."""
        values = self.G @ q + self.g
        pairs = zip(list(self.model.joints)[1:], values, strict=True)
        return np.concatenate([[np.cos(x), np.sin(x)] if joint.nq == 2 else [x] for joint, x in pairs])

    def tool(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Place and rotation."""
        self.pin.framesForwardKinematics(self.model, self.data, self.configuration(q))
        pose = self.data.oMf[self.frame]
        return pose.translation.copy(), pose.rotation.copy()

    def efforts(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Inverse dynamics."""
        return self.G.T @ self.pin.rnea(self.model, self.data, self.configuration(q), self.G @ v, self.G @ a)

    def masses(self, q: np.ndarray) -> np.ndarray:
        """Mass matrix."""
        M = np.triu(self.pin.crba(self.model, self.data, self.configuration(q)))
        return self.G.T @ (M + np.triu(M, 1).T) @ self.G
