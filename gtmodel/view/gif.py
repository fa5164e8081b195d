"""A scene as an animated picture for slides and mail, seen as on the page of the scene."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from ..results.page.page import MARK

if TYPE_CHECKING:
    from .space import RobotScene

Array = np.ndarray
# colour, and radius in sizes of the robot; as in view.js
LOOK = {
    "bar": ("#4d4d4d", 0.008), "joint": ("#222222", 0.010), "cart": ("#555555", 0.022), "face": ("#8db3d9", 0.002),
    "guideway": ("#b0b0b0", 0.005), "path": ("#d55e00", 0.002), "axes": ("", 0.004),
}  # fmt: skip
AXES = ("#d55e00", "#009e73", "#0072b2")
AZIMUTH, ELEVATION = -0.96, 0.35  # rad, of the camera
FILLED, FINER = 0.8, 2  # share of the picture; drawn larger and made smaller, so that edges are smooth
LONGEST = 65_000  # ms of one picture in a GIF


def gif(scene: RobotScene, *, width: int = 640, height: int = 480, rate: float = 20.0, speed: float = 1.0) -> bytes:
    """Return the motion of a scene as a GIF, in orthographic view, repeated without end.

    width, height: in pixels. rate: pictures per second. speed: of the motion; 1 is real time.
    """
    from PIL import Image

    times = np.atleast_1d(np.asarray(scene.time, float))
    count = max(1, round((times[-1] - times[0]) / speed * rate) + 1)
    shown = np.linspace(times[0], times[-1], count)
    camera = _Camera(scene, FINER * width, FINER * height)
    drawn = (camera.picture(t).resize((width, height)) for t in shown)
    pictures = [picture.convert("P", palette=Image.Palette.ADAPTIVE, colors=64) for picture in drawn]
    buffer = io.BytesIO()
    how = {"duration": min(LONGEST, round(1e3 / rate)), "loop": 0, "disposal": 2, "comment": MARK.encode()}
    pictures[0].save(buffer, "GIF", save_all=True, append_images=pictures[1:], **how)
    return buffer.getvalue()


class _Camera:
    """Projection that fits all points at all times into the picture."""

    def __init__(self, scene: RobotScene, width: int, height: int) -> None:
        self.scene, self.shape = scene, (width, height)
        ca, sa, ce, se = np.cos(AZIMUTH), np.sin(AZIMUTH), np.cos(ELEVATION), np.sin(ELEVATION)
        self.out = np.array([ce * ca, ce * sa, se])
        self.across = np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce]])
        points = np.vstack([np.reshape(p, (-1, 3)) for p in scene.points.values()])
        self.size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        flat = points @ self.across.T
        self.middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
        self.scale = FILLED * float(np.min(np.array([width, height]) / np.maximum(np.ptp(flat, axis=0), 1e-9)))

    def seen(self, points: Array) -> list[tuple[float, float]]:
        """Pixels of points (n, 3)."""
        u, v = (self.scale * (np.reshape(points, (-1, 3)) @ self.across.T - self.middle)).T
        width, height = self.shape
        return list(zip((width / 2 + u).tolist(), (height / 2 - v).tolist(), strict=True))

    def picture(self, time: float) -> Any:
        """The scene at a time [s], from far to near."""
        from PIL import Image, ImageDraw

        image = Image.new("RGB", self.shape, "white")
        pen = ImageDraw.Draw(image)
        at = {name: self.scene.at(name, time) for name in self.scene.points}
        depth = {name: float(p @ self.out) for name, p in at.items()}
        parts = sorted(self.scene.parts, key=lambda part: (part.shape != "path", _mean(depth, part.points)))
        for part in parts:
            usual, radius = LOOK[part.shape]
            colour, r = part.colour or usual, max(1.0, self.scale * self.size * radius)
            places = self.seen(np.array([at[name] for name in part.points]))
            if part.shape == "path":
                pen.line(self.seen(np.asarray(self.scene.points[part.points[0]])), fill=colour, width=FINER)
            elif part.shape == "face":
                pen.polygon(places, fill=colour, outline="#555555")
            elif part.shape == "axes":
                for end, paint in zip(places[1:], AXES, strict=True):
                    pen.line([places[0], end], fill=paint, width=round(2 * r))
            elif part.shape in ("bar", "guideway"):
                pen.line(places, fill=colour, width=round(2 * r))
            else:
                (x, y), draw = places[0], pen.rectangle if part.shape == "cart" else pen.ellipse
                draw([x - r, y - r, x + r, y + r], fill=colour)
        return image


def _mean(depth: dict[str, float], names: tuple[str, ...]) -> float:
    return sum(depth[name] for name in names) / len(names)
