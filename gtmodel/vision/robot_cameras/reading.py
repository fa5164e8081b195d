"""Read and write corners and actuator readings as tables."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ...results.disk import path_of, write_whole
from ...results.refusal import ArgumentError
from ..detection.marks import CornerRow, corners_csv
from ..detection.targets import Target
from .pictures import RobotPictures, SecondDevice


def read_pictures(
    corners: str | Path, actuators: str | Path, target: Target, unit: str = "mm", sigma: float = 0.1,
    device: str | Path | None = None, device_noise: float = 10e-6,
) -> RobotPictures:  # fmt: skip
    """Read pictures of a robot from two CSV files.

    corners: columns camera, pose, mark, u, v [pixel] and sigma [pixel], as `detection.corners_csv` writes them; without
    a column sigma, `sigma` is used. actuators: columns pose, one per actuator in `unit`, and for a moving robot as many
    rates [unit/s], "rate1" and so on; the names of the poses are those of the corners. device: columns pose, x, y, z
    [unit] with positions measured by a second device at some poses, with the standard deviation `device_noise` [m].
    target: defines the marks. Lines that begin with # are ignored, but a first line that contains "synthetic" is kept
    in the result.

    Raises ArgumentError with file and line for a cell that is not a number, a mark that the target does not have, and a
    pose without actuators or with several rows of them.

    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> made = gt.vision.robot_cameras.made_pictures(gt.vision.robot_cameras.SyntheticRobotCameras(counts=[3, 3, 3]))
    >>> folder = Path(mkdtemp())
    >>> gt.vision.robot_cameras.write_pictures(made.pictures, folder / "corners.csv", folder / "carts.csv")
    >>> tool = gt.vision.detection.FiveSquares(side=0.04)
    >>> pictures = gt.vision.robot_cameras.read_pictures(folder / "corners.csv", folder / "carts.csv", tool, "m")
    >>> len(pictures), pictures.cameras
    (1080, ('left', 'right'))
    """
    corners, actuators = path_of(corners, "corners"), path_of(actuators, "actuators")
    readings: dict[str, list[float]] = {}
    for name, row, line in _rows(actuators, "actuators"):
        if name in readings:
            raise ArgumentError(f"{actuators.name}, line {line}: pose {name} occurs twice; keep one", "actuators")
        readings[name] = row
    head = _table(actuators, "actuators")[0][1:]
    moving = sum(name.startswith("rate") for name in head)
    if moving not in (0, len(head) / 2):
        raise ArgumentError(
            f"{actuators.name} has {moving} rates for {len(head) - moving} actuators; expected as many, or none",
            "actuators",
        )
    factor = _factor(unit)
    rows = list(_corner_rows(corners, sigma))
    if not rows:
        raise ArgumentError(f"{corners.name} has no corners", "corners")
    cameras = tuple(dict.fromkeys(r[0] for r in rows))
    poses = tuple(dict.fromkeys(r[1] for r in rows))
    missing = [p for p in poses if p not in readings]
    if missing:
        raise ArgumentError(f"pose {missing[0]} has corners but no row in {actuators.name}", "actuators")
    marks = {m: k for k, m in enumerate(target.marks)}
    unknown = next((r for r in rows if r[2] not in marks), None)
    if unknown:
        raise ArgumentError(
            f"{corners.name}, line {unknown[6]}: the target has no mark '{unknown[2]}'; expected {target.marks[0]} to "
            f"{target.marks[-1]}",
            "corners",
        )
    index = [{n: k for k, n in enumerate(names)} for names in (cameras, poses)]
    table = factor * np.array([readings[p] for p in poses])
    with corners.open(encoding="utf-8") as file:
        first = file.readline().strip()
    return RobotPictures(
        cameras, poses, target.marks,
        np.array([index[0][r[0]] for r in rows]), np.array([index[1][r[1]] for r in rows]),
        np.array([marks[r[2]] for r in rows]), np.array([r[3:5] for r in rows]), np.array([r[5] for r in rows]),
        table[:, : len(head) - moving], target.points, _device(device, factor, device_noise, index[1]),
        rates=table[:, len(head) - moving :] if moving else None,
        synthetic=first.lstrip("# ") if first.startswith("#") and "synthetic" in first else "",
    )  # fmt: skip


def _device(path: str | Path | None, factor: float, noise: float, poses: dict[str, int]) -> SecondDevice | None:
    if path is None:
        return None
    path = path_of(path, "device")
    rows = [(name, row, line) for name, row, line in _rows(path, "device") if name in poses]
    wrong = [line for _, row, line in rows if len(row) != 3]
    if wrong or not rows:
        fault = f", line {wrong[0]}: expected pose, x, y, z" if wrong else " contains no pose of the pictures"
        raise ArgumentError(f"{path.name}{fault}", "device")
    return SecondDevice(np.array([poses[n] for n, *_ in rows]), factor * np.array([r for _, r, _ in rows]), noise)


def write_pictures(
    pictures: RobotPictures, corners: str | Path, actuators: str | Path, *, overwrite: bool = False
) -> None:
    """Write the two files of read_pictures(), with actuators in metres.

    Raises FileExistsError if a file exists, unless `overwrite`.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> V = gt.vision.robot_cameras
    >>> seen = V.made_pictures(V.SyntheticRobotCameras(counts=[3, 3, 3])).pictures
    >>> with TemporaryDirectory() as folder:
    ...     V.write_pictures(seen, Path(folder) / "corners.csv", Path(folder) / "actuators.csv")
    ...     print((Path(folder) / "actuators.csv").read_text().splitlines()[0])
    pose,q1,q2,q3
    """
    p = pictures
    text = corners_csv(corner_rows(p), p.synthetic.removeprefix("synthetic, "))
    write_whole(corners, text.encode(), overwrite=overwrite)
    table, names = p.actuators, [f"q{k + 1}" for k in range(p.actuators.shape[1])]
    if p.rates is not None:
        table, names = np.column_stack([table, p.rates]), [*names, *(f"rate{k + 1}" for k in range(len(names)))]
    lines = [f"{pose},{','.join(f'{x:.7f}' for x in q)}" for pose, q in zip(p.poses, table, strict=True)]
    write_whole(actuators, "\n".join([f"pose,{','.join(names)}", *lines, ""]).encode(), overwrite=overwrite)


def corner_rows(p: RobotPictures) -> list[CornerRow]:
    """Return corners as rows of the table.

    >>> V = gt.vision.robot_cameras
    >>> V.corner_rows(V.made_pictures(V.SyntheticRobotCameras(counts=[3, 3, 3])).pictures)[0].mark
    '0.0'
    """
    rows = list[CornerRow]()
    for k in range(len(p)):
        camera, pose, mark = p.cameras[int(p.camera[k])], p.poses[int(p.pose[k])], p.marks[int(p.mark[k])]
        rows.append(CornerRow(camera, pose, mark, float(p.uv[k, 0]), float(p.uv[k, 1]), float(p.sigma[k])))
    return rows


def _corner_rows(path: Path, sigma: float) -> Iterator[tuple[str, str, str, float, float, float, int]]:
    """Yield camera, pose, mark, u, v, sigma, line."""
    head, body = _table(path, "corners")
    missing = [n for n in ("camera", "pose", "mark", "u", "v") if n not in head]
    if missing:
        raise ArgumentError(f"{path.name} has no column '{missing[0]}'; found {', '.join(head)}", "corners")
    column = {n: head.index(n) for n in head}
    for line, cells in body:
        u, v = (_number(cells[column[n]], path, line, "corners") for n in ("u", "v"))
        noise = _number(cells[column["sigma"]], path, line, "corners") if "sigma" in column else sigma
        yield cells[column["camera"]], cells[column["pose"]], cells[column["mark"]], u, v, noise, line


def _rows(path: Path, argument: str) -> Iterator[tuple[str, list[float], int]]:
    """Yield name, numbers and line of each row."""
    head, body = _table(path, argument)
    if head[0] != "pose" or len(head) < 2:
        raise ArgumentError(f"{path.name} begins with {', '.join(head[:4])}; expected pose, q1, ...", argument)
    for line, cells in body:
        yield cells[0], [_number(c, path, line, argument) for c in cells[1:]], line


def _table(path: Path, argument: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ArgumentError(f"{path.name} cannot be read: {error}", argument) from error
    numbered = [(k, text) for k, text in enumerate(lines, 1) if text.strip() and not text.startswith("#")]
    rows: Sequence[list[str]] = [[c.strip() for c in row] for row in csv.reader(text for _, text in numbered)]
    if len(rows) < 2:
        raise ArgumentError(f"{path.name} has no rows below its header", argument)
    for (line, _), row in zip(numbered, rows, strict=True):
        if len(row) != len(rows[0]):
            raise ArgumentError(f"{path.name}, line {line}: {len(row)} cells; the header has {len(rows[0])}", argument)
    return rows[0], [(line, row) for (line, _), row in zip(numbered[1:], rows[1:], strict=True)]


def _number(text: str, path: Path, line: int, argument: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ArgumentError(f"{path.name}, line {line}: '{text}' is not a finite number", argument)
    return value


def _factor(unit: str) -> float:
    """Return metres or radians per unit."""
    lengths = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "rad": 1.0, "deg": np.pi / 180}
    if unit not in lengths:
        raise ArgumentError(f"expected one of {', '.join(lengths)}; found '{unit}'", "unit")
    return lengths[unit]
