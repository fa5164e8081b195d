"""The folder of a result. What gtmodel wrote it may replace; what a person wrote or changed it never touches."""

from __future__ import annotations

import hashlib
import io
import platform
import tempfile
import textwrap
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import tomli_w

from gtmodel.results.folder import FolderError, Held, holding, others, unfinished
from gtmodel.results.trajectory_files import csv_bytes

from . import report
from .base import TRAJECTORY, Context, InputError, Outcome
from .load import Loaded
from .verdict import marked, told

RUN = "run.toml"
_OURS = "gtmodel"
_PACKAGES = ("casadi", "numpy", "scipy", "pydantic")
_DPI = 150
_SAID, _SAID_POINTS = "#b00020", 9.0  # colour and size of what stands above the picture of a failed result
_LETTERS, _LINE = 1.7, 1.25  # letters in a width and lines in a height of as many points as the size


class NotDrawn(InputError):
    """A picture could not be drawn; `files` are those written all the same."""

    def __init__(self, sentence: str, files: list[Path]) -> None:
        super().__init__(sentence)
        self.files = files


def refuse_foreign(folder: Path) -> None:
    """Raises InputError unless the folder is new, empty, or holds an earlier result just as it was written."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(f"--out {folder} is a file; name a folder")
    try:
        if not others(folder):
            return
    except OSError as error:
        raise InputError(f"--out {folder} cannot be read: {error.strerror}") from error
    written = _written(folder)
    if written is None:
        raise InputError(f"--out {folder} holds files that gtmodel did not write; name a new folder or empty this one")
    for name, digest in written.items():
        path = folder / name
        if path.is_file() and _sha256(path.read_bytes()) != digest:
            raise InputError(f"{path} was changed after gtmodel wrote it; move it away or name another folder")


@contextmanager
def held(folder: Path, context: Context) -> Iterator[Held]:
    """The folder for this run alone, tried before the work; what an earlier run left undone is settled first.

    Raises InputError as `refuse_foreign` does, where the folder cannot be written, and while another run has it.
    """
    if not unfinished(folder):
        refuse_foreign(folder)
    try:
        with holding(folder) as mine:
            refuse_foreign(folder)
            if mine.told:
                context.notice(mine.told)
            yield mine
    except FolderError as error:
        raise InputError(f"--out {folder} {error}") from error


def _written(folder: Path) -> dict[str, str] | None:
    """File names and hashes of an earlier result; None when there is none in the folder."""
    try:
        run = tomllib.loads((folder / RUN).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return None
    files = run.get("files")
    if run.get("program") != _OURS or not isinstance(files, dict):
        return None
    return {name: str(digest) for name, digest in files.items() if name == Path(name).name}


def write(
    folder: Path | Held, loaded: Loaded, context: Context, outcome: Outcome, *, wall_s: float, plot: bool
) -> list[Path]:
    """Write an outcome with its run.toml, all files or none; returns the files written.

    result.json, trajectory.csv where there is a trajectory (marked where it must not be relied on), the kind's own
    files, pictures when `plot` is set, and run.toml. Files of an earlier result in the folder are replaced or removed.

    Raises InputError as `refuse_foreign` does, or where the folder cannot be written; NotDrawn when all is written but
    a picture.
    """
    if isinstance(folder, Path):
        with held(folder, context) as mine:
            return write(mine, loaded, context, outcome, wall_s=wall_s, plot=plot)
    files = {"result.json": report.result(loaded.name, loaded.problem.kind, outcome)}
    if outcome.trajectory is not None and outcome.status.ok:
        files[TRAJECTORY] = csv_bytes(outcome.trajectory)
    elif outcome.trajectory is not None and TRAJECTORY not in outcome.machine_files:
        files[TRAJECTORY] = marked(TRAJECTORY, csv_bytes(outcome.trajectory), told(outcome), by="")
    for name, content in outcome.files.items():
        files[name] = content.encode() if isinstance(content, str) else content
    faults = pictured(outcome, files) if plot else []
    written = put(folder, files, lambda files: _run(loaded, context, wall_s, files))
    if faults:
        raise NotDrawn(faults[0], written)
    return written


def put(
    folder: Held, files: dict[str, bytes], run: Callable[[Mapping[str, bytes]], bytes], programs: Collection[str] = ()
) -> list[Path]:
    """Write `files` and their run.toml into a folder, and take away those of an earlier run; returns what was written.

    Raises InputError as `refuse_foreign` does, where a name is taken by a file of another origin, and where the folder
    cannot be written.
    """
    place = folder.path
    refuse_foreign(place)
    earlier = _written(place) or {}
    for name in files:
        if name not in earlier and (place / name).exists():
            raise InputError(f"{place / name} was not written by gtmodel; move it away or name another folder")
    whole = {**files, RUN: run(files)}
    try:
        folder.write(whole, remove=set(earlier) - set(whole), programs=programs)
    except FolderError as error:
        raise InputError(f"--out {place} {error}") from error
    return [place / name for name in whole]


def elsewhere(loaded: Loaded, context: Context, outcome: Outcome, *, wall_s: float) -> list[Path]:
    """Write an outcome, without pictures, into a new folder among the temporary ones; no files where that fails."""
    try:
        place = Path(tempfile.mkdtemp(prefix=f"{loaded.path.stem}-"))
    except OSError:
        return []
    try:
        return write(place, loaded, context, outcome, wall_s=wall_s, plot=False)
    except InputError:
        place.rmdir()
        return []


def pictured(outcome: Outcome, files: dict[str, bytes]) -> list[str]:
    """Add the pictures to `files`; a sentence on each that cannot be drawn: it must not cost the numbers."""
    faults = []
    said = "" if outcome.status.ok else f"{_not_ok(outcome)}: {told(outcome)}"
    for name, draw in outcome.figures.items():
        file = name if name.endswith(".png") else f"{name}.png"
        try:
            files[file] = png(draw, said)
        except Exception as error:
            said = " ".join(str(error).split())
            faults.append(f"{file} could not be drawn ({type(error).__name__}: {said}); please report it")
    return faults


def _not_ok(outcome: Outcome) -> str:
    return "check failed" if outcome.status.converged else "not solved"


def _run(loaded: Loaded, context: Context, wall_s: float, files: Mapping[str, bytes]) -> bytes:
    inputs: dict[str, Any] = {"problem": str(loaded.path), "problem_sha256": _sha256(loaded.content)}
    if loaded.settings:
        inputs["set"] = list(loaded.settings)
    if context.max_seconds is not None:
        inputs["max_seconds"] = context.max_seconds
    for name, path in context.inputs.items():
        inputs[name] = str(path)
        inputs[f"{name}_sha256"] = _sha256(path.read_bytes()) if path.is_file() else ""
    return record(inputs, wall_s, files, {"problem": loaded.problem.model_dump(mode="json", exclude_none=True)})


def record(
    inputs: Mapping[str, Any], wall_s: float, files: Mapping[str, bytes], more: Mapping[str, Any] | None = None
) -> bytes:
    """run.toml: what a folder was made of, and the hashes of its `files`, which tell what a person changed."""
    run = {
        "program": _OURS,
        "wall_s": wall_s,
        "input": dict(inputs),
        "versions": versions(),
        "files": {name: _sha256(content) for name, content in files.items()},
        **(more or {}),
    }
    note = "# How this folder was made. gtmodel replaces the files listed here, as long as nobody changed them.\n"
    return (note + tomli_w.dumps(run)).encode()


def versions() -> dict[str, str]:
    """Versions of gtmodel, of Python and of the packages that numbers depend on."""
    from gtmodel import __version__

    found = {_OURS: __version__, "python": platform.python_version(), "platform": platform.platform()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not found"
    return found


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def png(draw: Any, said: str = "") -> bytes:
    """A picture as a file, the same bytes for the same picture. said: what stands above it, of a failed result."""
    buffer = io.BytesIO()
    figure = draw()
    more = _headed(figure, said) if said else {}
    _as_written(figure)
    # matplotlib's own version stays out of the file: same input, same bytes
    figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None}, **more)
    return buffer.getvalue()


def _headed(figure: Any, said: str) -> dict[str, Any]:
    """Write a text above a figure, on paper added there; what savefig needs for it."""
    from matplotlib.transforms import Bbox

    width, height = figure.get_size_inches()
    inch = 72.0 / _SAID_POINTS  # lines in an inch, and about half the letters
    lines = textwrap.wrap(" ".join(said.split()), max(20, int(_LETTERS * inch * width)))
    text = figure.text(0.5, 1.0, "\n".join(lines), ha="center", va="bottom", color=_SAID, fontsize=_SAID_POINTS)
    text.set_in_layout(False)  # the picture itself stays as it was
    above = (len(lines) + 1) * _LINE / inch
    text.set_y(1.0 + 0.5 * _LINE / inch / height)
    return {"bbox_inches": Bbox([[0.0, 0.0], [width, height + above]])}


def _as_written(figure: Any) -> None:
    """Titles and names are a person's own words: a "$" in them begins no formula. Matplotlib's own ticks stay."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if "$" in text.get_text() and "\\mathdefault" not in text.get_text():
            text.set_parse_math(False)
