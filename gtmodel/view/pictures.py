"""A scene as a picture, as an animated picture and as a film, for slides and mail, seen as on the page of the scene."""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..results import ArgumentError
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
FLOOR = "#d8d8d8"
# sizes of the robot by which joints count as nearer, to be before bars that end in them, and guideways as farther
NEARER, BEHIND = 0.015, 0.05
PIECES = 8  # of a bar, so that it is behind one part and before another
LETTERS, MARGIN = 12, 8  # pixels: height of letters, and from the edge of the picture
Item = tuple[float, Callable[[Any], object]]  # depth, and what draws it


def png(scene: RobotScene, time: float | None = None, *, width: int = 1200, height: int = 900) -> bytes:
    """Return a picture of a scene at a time [s], by default the first, in orthographic view.

    width, height: in pixels.
    """
    from PIL.PngImagePlugin import PngInfo

    at = float(np.atleast_1d(scene.time)[0]) if time is None else time
    buffer, mark = io.BytesIO(), PngInfo()
    mark.add_text("Comment", MARK)
    _Camera(scene, width, height).small(at).save(buffer, "PNG", pnginfo=mark)
    return buffer.getvalue()


def gif(scene: RobotScene, *, width: int = 640, height: int = 480, rate: float = 20.0, speed: float = 1.0) -> bytes:
    """Return the motion of a scene as a GIF, in orthographic view, without end; of separate poses, one a second.

    width, height: in pixels. rate: pictures per second. speed: of the motion; 1 is real time.
    """
    from PIL import Image

    camera = _Camera(scene, width, height)
    instants, rate = _instants(scene, rate, speed)
    pictures = [camera.small(t).convert("P", palette=Image.Palette.ADAPTIVE, colors=64) for t in instants]
    buffer = io.BytesIO()
    how = {"duration": min(LONGEST, round(1e3 / rate)), "loop": 0, "disposal": 2, "comment": MARK.encode()}
    pictures[0].save(buffer, "GIF", save_all=True, append_images=pictures[1:], **how)
    return buffer.getvalue()


def mp4(scene: RobotScene, *, width: int = 1280, height: int = 960, rate: float = 25.0, speed: float = 1.0) -> bytes:
    """Return the motion of a scene as a film, H.264 in MP4, in orthographic view. The program ffmpeg encodes it.

    width, height: in pixels, even. rate: pictures per second. speed: of the motion; 1 is real time. Raises
    ArgumentError if ffmpeg is not found or fails.
    """
    ffmpeg = shutil.which("ffmpeg")
    if ffmpeg is None:
        raise ArgumentError("a film needs the program ffmpeg, which was not found; install it, or write a .gif", "path")
    camera = _Camera(scene, width, height)
    instants, rate = _instants(scene, rate, speed)
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder, "film.mp4")
        source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{rate:g}", "-i", "-"]
        same = ["-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact", "-threads", "1"]
        coding = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-metadata", f"comment={MARK}"]
        command = [ffmpeg, "-v", "error", *source, *same, *coding, str(film)]
        with open(Path(folder, "faults"), "w+b") as faults:
            with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=faults, stderr=faults) as coder:
                assert coder.stdin is not None
                with suppress(BrokenPipeError):  # it has failed, and says why
                    for t in instants:
                        coder.stdin.write(camera.small(t).tobytes())
                    coder.stdin.close()
            if coder.returncode:
                faults.seek(0)
                raise ArgumentError(
                    f"ffmpeg failed: {' '.join(faults.read().decode(errors='replace').split())}", "path"
                )
        return film.read_bytes()


def _instants(scene: RobotScene, rate: float, speed: float) -> tuple[Array, float]:
    """The times shown and the pictures per second."""
    times = np.atleast_1d(np.asarray(scene.time, float))
    if scene.unit != "s":
        return times, speed
    return np.linspace(times[0], times[-1], max(1, round((times[-1] - times[0]) / speed * rate) + 1)), rate


class _Camera:
    """Projection that fits everything at all times into the picture."""

    def __init__(self, scene: RobotScene, width: int, height: int) -> None:
        self.scene, self.shape = scene, (FINER * width, FINER * height)
        ca, sa, ce, se = np.cos(AZIMUTH), np.sin(AZIMUTH), np.cos(ELEVATION), np.sin(ELEVATION)
        self.out = np.array([ce * ca, ce * sa, se])
        self.across = np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce]])
        times = np.atleast_1d(scene.time)
        moving = [scene.placed(b, b.corners(), t) for b in scene.bodies for t in (times[::8] if b.frame else times[:1])]
        points = np.vstack([*(np.reshape(p, (-1, 3)) for p in scene.points.values()), *moving])
        self.size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        self.low, self.high = points.min(axis=0), points.max(axis=0)
        decade = 10.0 ** np.floor(np.log10(self.size / 8))
        self.step = decade * next(m for m in (1, 2, 5, 10) if m * decade >= self.size / 8)  # of the floor's grid [m]
        flat = points @ self.across.T
        self.middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
        self.scale = FILLED * float(np.min(np.array(self.shape) / np.maximum(np.ptp(flat, axis=0), 1e-9)))

    def small(self, time: float) -> Any:
        """The scene at a time [s], in the size that was asked for."""
        return self.picture(time).resize((self.shape[0] // FINER, self.shape[1] // FINER))

    def seen(self, points: Array) -> list[tuple[float, float]]:
        """Pixels of points (n, 3)."""
        u, v = (self.scale * (np.reshape(points, (-1, 3)) @ self.across.T - self.middle)).T
        width, height = self.shape
        return list(zip((width / 2 + u).tolist(), (height / 2 - v).tolist(), strict=True))

    def picture(self, time: float) -> Any:
        """The scene at a time [s], from far to near, with its legend."""
        from PIL import Image, ImageDraw

        image = Image.new("RGB", self.shape, "white")
        pen = ImageDraw.Draw(image, "RGBA")
        self.floor(pen)
        items = [*self.parts(time), *self.bodies(time)]
        for _, draw in sorted(items, key=lambda item: item[0]):
            draw(pen)
        self.write(pen, time)
        return image

    def floor(self, pen: Any) -> None:
        """Grid below everything, with a step of 1, 2 or 5, as on the page."""
        step = self.step
        first, last = np.floor(self.low[:2] / step) - 1, np.ceil(self.high[:2] / step) + 1
        for k in (0, 1):
            for x in np.arange(first[k], last[k] + 1):
                ends = np.array([[x, first[1 - k]], [x, last[1 - k]]])[:, [k, 1 - k]] * step
                pen.line(self.seen(np.column_stack([ends, np.full(2, self.low[2])])), fill=FLOOR, width=FINER // 2)

    def write(self, pen: Any, time: float) -> None:
        """Title and instant, the legend of groups with markers, and the note with the width of the grid."""
        from matplotlib import get_data_path
        from PIL import ImageFont

        # Pillow's own letters lack µ, ä and most others
        font = ImageFont.truetype(Path(get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), FINER * LETTERS)
        line = FINER * LETTERS * 1.4
        groups, left, top = [b for b in self.scene.bodies if b.marker and b.name], FINER * MARGIN, FINER * MARGIN
        times, unit = np.atleast_1d(self.scene.time), self.scene.unit
        instant = f"{time:.2f} s" if unit == "s" else f"{unit} {time:g} of {times[-1]:g}"  # not all may be shown
        head = ", ".join(filter(None, [self.scene.title, instant if len(times) > 1 else ""]))
        width = self.shape[0] - 2 * left
        heads = _lines(pen, head, font, width)
        for k, words in enumerate(heads):
            pen.text((left, top + k * line), words, fill="#222222", font=font)
        for k, body in enumerate(groups, len(heads)):
            y = top + k * line
            _mark(pen, left + 2 * LETTERS / 2, y + line / 2.2, body.marker, body.colour)
            pen.text((left + 2 * LETTERS, y), body.name, fill="#222222", font=font)
        note = f"{self.scene.note} Grid: {self.step:.10g} m.".strip()
        for k, words in enumerate(reversed(_lines(pen, note, font, width)), 1):
            pen.text((left, self.shape[1] - k * line - top), words, fill="#444444", font=font)

    def parts(self, time: float) -> Iterator[Item]:
        """What joins points."""
        at = {name: self.scene.at(name, time) for name in self.scene.points}
        for part in self.scene.parts:
            usual, radius = LOOK[part.shape]
            colour, r = part.colour or usual, max(1.0, self.scale * self.size * radius)
            points = np.array([at[name] for name in part.points])
            places, depth = self.seen(points), float(np.mean(points @ self.out))
            if part.shape == "path":
                way = self.seen(np.asarray(self.scene.points[part.points[0]]))
                yield -np.inf, lambda pen, way=way, colour=colour: pen.line(way, fill=colour, width=FINER)
            elif part.shape == "face":
                yield depth, lambda pen, p=places, c=colour: pen.polygon(p, fill=c, outline="#555555")
            elif part.shape == "axes":
                for end, paint in zip(places[1:], AXES, strict=True):
                    yield depth, lambda pen, a=places[0], b=end, c=paint, r=r: _line(pen, a, b, c, r)
            elif part.shape in ("bar", "guideway"):
                ends = points[0] + np.linspace(0.0, 1.0, PIECES + 1)[:, None] * (points[1] - points[0])
                behind = BEHIND * self.size if part.shape == "guideway" else 0.0
                for (a, b), middle in zip(
                    pairwise(self.seen(ends)), (ends[:-1] + ends[1:]) / 2 @ self.out, strict=True
                ):
                    yield float(middle) - behind, lambda pen, a=a, b=b, c=colour, r=r: _line(pen, a, b, c, r)
            else:
                (x, y), cart = places[0], part.shape == "cart"
                depth += NEARER * self.size
                box = [x - r, y - r, x + r, y + r]
                yield (
                    depth,
                    lambda pen, cart=cart, box=box, c=colour: (pen.rectangle if cart else pen.ellipse)(box, fill=c),
                )

    def bodies(self, time: float) -> Iterator[Item]:
        """Triangles, lines and marks; of a closed body only the triangles that face the camera."""
        light = self.out + 0.6 * self.across[1]
        for body in self.scene.bodies:
            world = self.scene.vertices_at(body, time)
            pixels, depth = self.seen(world), world @ self.out
            if len(body.faces):
                a, b, c = np.moveaxis(world[body.faces], 1, 0)
                normals = np.cross(b - a, c - a)
                lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
                shown = normals @ self.out > 0 if body.closed else np.ones(len(normals), bool)
                bright = 0.55 + 0.4 * np.abs(normals @ light) / (1.17 * lengths)
                rgb = np.array([int(body.colour[k : k + 2], 16) for k in (1, 3, 5)])
                alpha = round(255 * body.opacity)
                for face, s in zip(body.faces[shown], bright[shown], strict=True):
                    paint = (*(int(x) for x in np.round(rgb * s)), alpha)
                    corners = [pixels[k] for k in face]
                    yield float(depth[face].mean()), lambda pen, p=corners, c=paint: pen.polygon(p, fill=c)
            for i, j in body.edges:
                ends = pixels[i], pixels[j]
                yield (float(depth[[i, j]].mean()),
                       lambda pen, e=ends, c=body.colour: pen.line(e, fill=c, width=round(1.2 * FINER)))  # fmt: skip
            if body.marker:
                for (x, y), z in zip(pixels, depth, strict=True):
                    yield float(z), lambda pen, x=x, y=y, b=body: _mark(pen, x, y, b.marker, b.colour)


def _lines(pen: Any, text: str, font: Any, width: float) -> list[str]:
    """A text in lines that are no wider than that, in pixels."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and pen.textlength(longer, font=font) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def _line(pen: Any, a: tuple[float, float], b: tuple[float, float], colour: str, r: float) -> None:
    pen.line([a, b], fill=colour, width=round(2 * r))


def _mark(pen: Any, x: float, y: float, marker: str, colour: str) -> None:
    s, width = 3.5 * FINER, round(1.5 * FINER)
    box = [x - s, y - s, x + s, y + s]
    if marker == "disc":
        pen.ellipse(box, fill=colour)
    elif marker == "ring":
        pen.ellipse(box, outline=colour, width=width)
    elif marker == "square":
        pen.rectangle(box, fill=colour)
    elif marker == "triangle":
        pen.polygon([(x, y - s), (x + s, y + s), (x - s, y + s)], fill=colour)
    else:
        pen.line([(x - s, y - s), (x + s, y + s)], fill=colour, width=width)
        pen.line([(x - s, y + s), (x + s, y - s)], fill=colour, width=width)
