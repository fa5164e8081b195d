"""A scene: points and frames in space over time, parts that join the points, bodies on the frames, and signals beside
it; one HTML page without a network.

The page is ours: a script of 300 lines on a plain canvas. A robot is bars, joints and plates, needs no meshes, and
shows in a browser without 3-D graphics too. viser 1.1.1 starts a server to write a page of 0.8 MB, and pins rich and
websockets below the releases used here; plotly writes 4.8 MB.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import Any, Literal

import numpy as np

from .._near import meant
from ..results import ArgumentError, Trajectory
from ..results.disk import path_of, write_whole
from ..results.page.page import MARK, written_here
from .bodies import VisibleBody, check_colour

Shape = Literal["bar", "joint", "cart", "face", "guideway", "path", "axes"]
DIGITS = 7  # of a coordinate behind the point: 0.1 um
SIGNIFICANT = 6  # digits of a signal
FIRST = ("N", "N.m", "m", "rad", "m/s", "rad/s")  # units whose signals are shown first
CHARTS = 6  # signals that are shown; the others are in trajectory.csv
LARGEST = 6_000_000  # bytes of a page
ENDINGS = {".html": "a page", ".png": "a picture", ".gif": "an animated picture", ".mp4": "a film"}
# a browser refuses the page any request to a network
ALONE = (
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'\">"
)


@dataclass(frozen=True)
class VisiblePart:
    """A part of a scene.

    shape: bar (two points), joint, cart or path (one), face (three or more, convex), guideway (two), axes (four: origin
    and the ends of x, y and z). points: names of its points in the scene. colour: as "#0072b2"; "" for that of the
    shape. name: shown at the pointer.
    """

    shape: Shape
    points: tuple[str, ...]
    name: str = ""
    colour: str = ""

    def __post_init__(self) -> None:
        if self.colour:
            check_colour(self.colour)


@dataclass(frozen=True, eq=False)
class RobotScene:
    """Points and frames in space over time, with the parts that join points and the bodies that frames carry.

    Args:
        points: by name, (n, 3) at each time or (3,) if it stands still [m].
        parts: what is drawn.
        time: (n,) [s]; one time for a scene that stands still; or numbers of separate poses, see `unit`.
        signals: shown beside the scene, at the same times.
        limits: (low, high) of signals by name, in the unit of the signal.
        title: of the page.
        unit: "s"; of separate poses what they are, such as "mode": the page then steps from one to the next.
        note: a sentence under the title, such as the scale of what is enlarged.
        frames: by name, (n, 3, 4) at each time or (3, 4): rotation to world coordinates, and position [m].
        bodies: surfaces, lines and marks, each in a frame or in the world.
        same: other names of points, for `at`: those that coincide at all times are one point.

    Raises ArgumentError for a part with an unknown point, a body with an unknown frame, and for points and frames with
    another number of times.

    >>> tip = gt.view.RobotScene({"a": [0.0, 0.0, 0.0], "b": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]},
    ...                     [gt.view.VisiblePart("bar", ("a", "b"))], time=[0.0, 1.0], title="a turning bar")
    >>> tip.html().count("<html"), tip.at("b", 1.0)
    (1, array([0., 1., 0.]))
    """

    points: Mapping[str, Any]
    parts: Sequence[VisiblePart]
    time: Any = (0.0,)
    signals: Trajectory | None = None
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    title: str = ""
    unit: str = "s"
    note: str = ""
    frames: Mapping[str, Any] = field(default_factory=dict)
    bodies: Sequence[VisibleBody] = ()
    same: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(np.atleast_1d(self.time))
        for what, of, own in (("points", self.points, (3,)), ("frames", self.frames, (3, 4))):
            for name, value in of.items():
                shape = np.shape(value)
                if shape not in (own, (count, *own)):
                    raise ArgumentError(f"'{name}': expected shape {own} or {(count, *own)}; found {shape}", what)
        for body in self.bodies:
            if body.frame and body.frame not in self.frames:
                raise ArgumentError(f"body '{body.name}' is in '{body.frame}', which is no frame", "bodies")
        for part in self.parts:
            if unknown := [name for name in part.points if name not in self.points]:
                raise ArgumentError(f"{part.shape} '{part.name}' joins '{unknown[0]}', which is no point", "parts")

    def at(self, point: str, time: float) -> np.ndarray:
        """Return where a point is at a time [s], (3,) [m]; between two times linear, as the page shows it.

        Raises ArgumentError for an unknown point.
        """
        known = {**self.same, **{name: name for name in self.points}}
        if point not in known:
            hint = meant(point, known, f"there are {', '.join(self.points)}")
            raise ArgumentError(f"the scene has no point '{point}'; {hint}", "point")
        return self._at(self.points[known[point]], time, 1) + 0.0  # -0 is 0

    def vertices_at(self, body: VisibleBody, time: float) -> np.ndarray:
        """Return where the vertices of a body are at a time [s], (v, 3) [m]."""
        return self.placed(body, body.vertices, time)

    def placed(self, body: VisibleBody, positions: Any, time: float) -> np.ndarray:
        """Return positions (n, 3) in the frame of a body as they are in the world at a time [s], (n, 3) [m]."""
        if not body.frame:
            return np.asarray(positions, float)
        pose = self._at(self.frames[body.frame], time, 2)
        return positions @ pose[:, :3].T + pose[:, 3]

    def _at(self, values: Any, time: float, dimensions: int) -> np.ndarray:
        value, times = np.asarray(values, float), np.atleast_1d(self.time)
        if value.ndim == dimensions:
            return value
        columns = value.reshape(len(value), -1).T
        return np.array([np.interp(time, times, x) for x in columns]).reshape(value.shape[1:])

    def document(self) -> dict[str, Any]:
        """Return the data of the page: title, note, time [s], points [m], parts, frames, bodies and signals."""
        names, frames = list(self.points), list(self.frames)
        return {
            "title": self.title,
            "unit": self.unit,
            "note": self.note,
            "time": _rounded(np.atleast_1d(self.time)),
            "points": {name: _rounded(self.points[name]) for name in names},
            "parts": [[p.shape, [names.index(n) for n in p.points], p.name, p.colour] for p in self.parts],
            "frames": {name: _rounded(_flat(self.frames[name])) for name in frames},
            "bodies": [_data(body, frames) for body in self.bodies],
            "signals": [] if self.signals is None else list(self._shown(self.signals)),
        }

    def _shown(self, signals: Trajectory) -> Any:
        units = {name: signals.unit(name) or "1" for name in signals.names}
        names = [n for n in signals.names if np.ndim(signals[n]) < 3 and np.isfinite(signals[n]).all()]
        order = sorted(names, key=lambda n: (FIRST.index(units[n]) if units[n] in FIRST else len(FIRST), len(n)))
        for name in order[:CHARTS]:
            rows = np.asarray(signals[name], float).reshape(len(signals.time), -1).T
            values = [[float(f"{x:.{SIGNIFICANT}g}") for x in row] for row in rows]
            limits = [*self.limits[name]] if name in self.limits else None
            yield {"name": name, "unit": units[name], "values": values, "limits": limits}

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> RobotScene:
        """Return the scene of a `document`. Raises ArgumentError for anything else."""
        try:
            names, frames = list(document["points"]), list(document["frames"])
            rows = document["signals"]
            values = {s["name"]: np.array(s["values"]).T.squeeze() for s in rows}
            units = {s["name"]: s["unit"] for s in rows}
            return cls(
                document["points"],
                [VisiblePart(shape, tuple(names[k] for k in of), name, colour)
                 for shape, of, name, colour in document["parts"]],
                document["time"], Trajectory(document["time"], values, units) if rows else None,
                {s["name"]: s["limits"] for s in rows if s["limits"]}, document["title"], document["unit"],
                document["note"],
                {name: np.reshape(v, (*np.shape(v)[:-1], 3, 4)) for name, v in document["frames"].items()},
                [VisibleBody(vertices, faces, edges, marker, name, colour, opacity, frame="" if at < 0 else frames[at])
                 for at, name, colour, opacity, marker, _, vertices, faces, edges in document["bodies"]],
            )  # fmt: skip
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise ArgumentError("this is no scene that gtmodel wrote", "document") from error

    def with_(self, **changes: Any) -> RobotScene:
        """Return a copy with other attributes."""
        return replace(self, **changes)

    def html(self) -> str:
        """Return the page; the same scene gives the same text."""
        folder = Path(__file__).parent
        style, script = ((folder / name).read_text(encoding="utf-8") for name in ("view.css", "view.js"))
        data = json.dumps(self.document(), ensure_ascii=False, separators=(",", ":"), allow_nan=False)
        data = data.replace("</", "<\\/")
        if (size := len((data + script).encode())) > LARGEST:
            raise ArgumentError(
                f"the page would have {size / 1e6:.1f} MB, more than {LARGEST / 1e6:.0f} MB; draw fewer points, "
                "instants or meshes"
            )
        title = escape(self.title or "scene")
        return (
            f'<!DOCTYPE html>\n<html lang="en"><head>{MARK}<meta charset="utf-8">{ALONE}<title>{title}</title>'
            f'<meta name="viewport" content="width=device-width"><style>\n{style}</style></head>'
            f'<body><h1>{title}</h1><main></main><script type="application/json" id="scene">'
            f"{data}</script><script>\n{script}</script></body></html>\n"
        )

    def write(self, path: str | Path, *, time: float | None = None) -> Path:
        """Write the page into a file .html, and return the path; a picture if the name ends in .png, an animated one if
        it ends in .gif, and a film, which the program ffmpeg encodes, if it ends in .mp4.

        time: of a picture [s]; by default the first. Raises ArgumentError for another ending, and for a file that
        gtmodel did not write; its own are written over.
        """
        from . import pictures  # here: a page needs no Pillow

        place = path_of(path)
        times = np.atleast_1d(self.time)
        if place.suffix not in ENDINGS:
            known = ", ".join(f"{ending} for {what}" for ending, what in ENDINGS.items())
            raise ArgumentError(f"{place} ends in none of {known}", "path")
        if place.exists() and not written_here(place):
            raise ArgumentError(f"{place} is there already and gtmodel did not write it; name another file", "path")
        if time is not None and not times[0] <= time <= times[-1]:
            begin, end = (f"{t:g} s" if self.unit == "s" else f"{self.unit} {t:g}" for t in (times[0], times[-1]))
            raise ArgumentError(f"the scene begins at {begin} and ends at {end}; found {time:g}", "time")
        made = {".html": lambda: self.html().encode(), ".png": lambda: pictures.png(self, time),
                ".gif": lambda: pictures.gif(self), ".mp4": lambda: pictures.mp4(self)}  # fmt: skip
        content = made[place.suffix]()
        try:
            write_whole(place, content, overwrite=True)
        except OSError as error:
            raise ArgumentError(f"{place} cannot be written: {error.strerror}", "path") from error
        return place

    def _repr_html_(self) -> str:
        style = "width:100%;height:640px;border:0"
        title = escape(f"{self.title or 'scene'}, in space")
        return (
            f'<iframe title="{title}" sandbox="allow-scripts" style="{style}" srcdoc="{escape(self.html())}"></iframe>'
        )


def _flat(frame: Any) -> np.ndarray:
    """Rotation and position as rows of twelve numbers."""
    value = np.asarray(frame, float)
    return value.reshape(*value.shape[:-2], 12)


def _data(body: VisibleBody, frames: Sequence[str]) -> list[Any]:
    """A body as the page has it: frame, name, colour, opacity, marker, whether it is closed, and numbers."""
    place = frames.index(body.frame) if body.frame else -1
    look = [place, body.name, body.colour, body.opacity, body.marker, body.closed]
    return [
        *look,
        _rounded(body.vertices.reshape(-1)),
        body.faces.reshape(-1).tolist(),
        body.edges.reshape(-1).tolist(),
    ]


def _rounded(values: Any) -> Any:
    return (np.round(np.asarray(values, float), DIGITS) + 0.0).tolist()  # -0 is 0
