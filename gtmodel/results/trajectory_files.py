"""Files of trajectories: exact, and identical for equal trajectories."""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from .disk import PathLike, path_of, write_whole
from .read_bounds import json_of, swollen
from .trajectory_checks import COLUMN, TrajectoryError, columns, json_text

if TYPE_CHECKING:
    from .trajectory import Trajectory

TRAJECTORY = "trajectory.csv"  # file of every study with a trajectory


def write_csv(trajectory: Trajectory, path: PathLike, overwrite: bool) -> None:
    """Write a CSV file; see `Trajectory.to_csv`."""
    write_whole(path, csv_bytes(trajectory), overwrite=overwrite)


def csv_bytes(trajectory: Trajectory) -> bytes:
    """Return the content that `write_csv` writes."""
    values = {name: trajectory[name] for name in trajectory.names}
    origin = json_text(trajectory.provenance) if trajectory.provenance else ""
    notes = {"title": trajectory.title, "synthetic": trajectory.synthetic, "provenance": origin}
    lines = [f"# {key}: {text}" for key, text in notes.items() if text]
    lines += [f"# scalar: {name}" for name, v in values.items() if v.ndim == 1 and COLUMN.fullmatch(name)]
    cells = ["time [s]"]
    for name, value in values.items():
        cells += [_quoted(f"{column} [{trajectory.unit(name)}]") for column in columns(name, value)]
    lines.append(",".join(cells))
    table = np.column_stack([trajectory.time, *values.values()])
    lines += [",".join(map(repr, row)) for row in table.tolist()]
    return ("\n".join(lines) + "\n").encode()


def write_npz(trajectory: Trajectory, path: PathLike, overwrite: bool) -> None:
    """Write a NumPy .npz file; see `Trajectory.to_npz`."""
    header = {
        "signals": list(trajectory.units.items()),
        "title": trajectory.title,
        "provenance": json_text(trajectory.provenance),
        "synthetic": trajectory.synthetic,
    }
    arrays: dict[str, Any] = {f"value_{i}": trajectory[name] for i, name in enumerate(trajectory.names)}
    buffer = io.BytesIO()
    np.savez(buffer, header=np.array(json.dumps(header)), time=trajectory.time, **arrays)
    write_whole(path, buffer.getvalue(), overwrite=overwrite)


def read_npz(cls: type[Trajectory], path: PathLike) -> Trajectory:
    """Read a file of `write_npz`; see `Trajectory.from_npz`."""
    path_of(path)
    try:
        with np.load(path, allow_pickle=False) as data:
            fault = swollen(path, sum(entry.file_size for entry in data.zip.infolist()))
            if fault:
                raise TrajectoryError(f"it {fault}")
            header = json_of(str(data["header"]))
            signals = dict(header["signals"])
            return cls(
                data["time"],
                {name: data[f"value_{i}"] for i, name in enumerate(signals)},
                signals,
                title=header["title"],
                provenance=json_of(header["provenance"]),
                synthetic=header["synthetic"],
            )
    except FileNotFoundError:
        raise
    except Exception as error:
        raise TrajectoryError(f"{path} is not a trajectory written by to_npz() ({error}); write it again") from error


def _quoted(cell: str) -> str:
    """A header cell as CSV; names such as der(T,2) contain a comma."""
    return f'"{cell}"' if "," in cell else cell
