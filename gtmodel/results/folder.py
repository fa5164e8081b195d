"""Folders that are written whole. A process may be killed at any instruction: the next one takes back or completes.

A process holds a folder by a locked file in it, which the system unlocks when the process ends, however it ends. New
files grow in a folder of their own, then one file says what will replace what, then the names are changed. Before that
file is there the folder is as it was; from then on everything is there to complete it.

On Windows, and on file systems without locks, no process sees that another one holds a folder: a second run takes the
first for one that broke off, and takes back or completes what it is writing, so that the first may end with a
FolderError or leave files of both. Run one at a time there; what a write that broke off left is settled all the same.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

MARK = ".gtmodel-writing"
NEW = ".gtmodel-new"
_PLAN = ".plan.json"  # in NEW: file name -> [hash before, hash after], null where there is no file
_HEAD = b"gtmodel writes here: process "
_TRIES = 100  # a mark that its holder takes away between our opening and our locking it


class FolderError(Exception):
    """A folder that cannot be held or written; the text is the predicate of a sentence about the folder."""


def refuse_impossible(folder: Path) -> None:
    """Raises FolderError for a name that no disk takes."""
    try:
        os.stat(folder)
    except ValueError:
        raise FolderError("holds the sign NUL, which no name of a folder does; name another one") from None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise FolderError("is a longer name than the disk takes; name another folder") from None


def unfinished(folder: Path) -> bool:
    """True while gtmodel holds a folder, and after a run that broke off while it did."""
    mark = folder / MARK
    try:
        content = b"" if mark.is_symlink() else mark.read_bytes()
    except OSError:
        return False
    # a mark is empty, or cut, where the process was killed between making and writing it
    return not mark.is_symlink() and (content.startswith(_HEAD) or _HEAD.startswith(content))


def others(folder: Path) -> list[str]:
    """Names in a folder, sorted; without those that writing it needs."""
    return sorted(p.name for p in folder.iterdir() if p.name not in (MARK, NEW))


class Held:
    """A folder that this process alone may write; `message` says what an earlier run left undone, or nothing."""

    def __init__(self, path: Path, message: str = "") -> None:
        self.path = path
        self.message = message
        self.written = False

    def write(self, files: Mapping[str, bytes], remove: Iterable[str] = (), programs: Collection[str] = ()) -> None:
        """Write `files` by name and take away those of `remove` that exist: all of it, or nothing.

        programs: names of files that can be executed; by nobody be written but the owner.

        Raises FolderError; then the folder is as it was, unless the system failed while names were changed, which
        the next holder completes.
        """
        if not all(name == Path(name).name and name not in (MARK, NEW, _PLAN) for name in (*files, *remove)):
            raise ValueError(f"names of files in {self.path} hold no folder; found {[*files, *remove]}")
        new = self.path / NEW
        try:
            plan = {name: [_hash(self.path / name), _sha256(content)] for name, content in files.items()}
            plan |= {name: [_hash(self.path / name), None] for name in sorted(set(remove) - set(files))}
            new.mkdir()
        except OSError as error:
            raise FolderError(_because(error)) from error
        try:
            for name, content in files.items():
                _put(new / name, content, program=name in programs)
            _put(new / f"{_PLAN}.part", json.dumps(plan, indent=1).encode())
        except OSError as error:
            shutil.rmtree(new, ignore_errors=True)
            raise FolderError(_because(error)) from error
        try:
            os.replace(new / f"{_PLAN}.part", new / _PLAN)
            self.written = True
            _complete(self.path, plan)
        except OSError as error:
            if all((new / name).exists() for name in files):  # not one name was changed
                shutil.rmtree(new, ignore_errors=True)
            raise FolderError(_because(error)) from error


@contextmanager
def holding(folder: Path) -> Iterator[Held]:
    """Make a folder if need be and hold it alone; what an earlier run left undone is taken back or completed first.

    A folder that was made for it and stays empty goes again. Raises FolderError where it is a file, cannot be written,
    is held by another process, or holds a file that somebody changed after a write broke off.
    """
    if folder.exists() and not folder.is_dir():
        raise FolderError("is a file; name a folder")
    if folder.is_symlink() and not folder.exists():
        raise FolderError(f"is a link to {os.readlink(folder)}, which is not there; make that folder, or name another")
    missing = [p for p in (folder, *folder.parents) if not p.exists()]
    held = Held(folder)
    lock = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock, left = _lock(folder / MARK)
        held.message = _recovered(folder) if left else ""
    except BaseException as error:
        _release(folder, lock, missing)
        if isinstance(error, OSError):
            raise FolderError(_because(error)) from error
        raise
    try:
        yield held
    finally:
        _release(folder, lock, [] if held.written else missing)


def _release(folder: Path, lock: int | None, made: Iterable[Path]) -> None:
    """Leave the folder; the mark stays where something is left to complete, what was made for nothing goes."""
    if lock is not None:
        _let_go(lock, None if _undone(folder) else folder / MARK)
    for path in made:
        with suppress(OSError):
            path.rmdir()


def _lock(mark: Path) -> tuple[int, bool]:
    """The mark, locked and with this process's number in it; True when one that broke off had left it."""
    for _ in range(_TRIES):
        lock = os.open(mark, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        alone = False
        try:
            content = os.read(lock, 200)
            if not (content.startswith(_HEAD) or _HEAD.startswith(content)):
                raise FolderError(f"holds a file {mark.name} that gtmodel did not write; move it away")
            if not _locked(lock):
                number = content.removeprefix(_HEAD).decode(errors="replace").strip() or "unknown"
                raise FolderError(
                    f"is in use by another run of gtmodel, process {number}; wait, or name another folder"
                )
            if os.path.samestat(os.fstat(lock), os.stat(mark)):
                alone = True
                os.ftruncate(lock, 0)
                os.lseek(lock, 0, os.SEEK_SET)
                os.write(lock, _HEAD + f"{os.getpid()}\n".encode())
                return lock, bool(content)
        except FileNotFoundError:
            pass  # its holder has just gone
        except BaseException:
            _let_go(lock, mark if alone else None)
            raise
        os.close(lock)
    raise FolderError("is in use by other runs of gtmodel; name another folder")


def _let_go(lock: int, mark: Path | None) -> None:
    """Unlock, and take the mark away before, where there is one: no other process may have it by then."""
    if fcntl is None:  # Windows, where a file that is open cannot be taken away
        os.close(lock)
    if mark is not None:
        with suppress(OSError):
            os.unlink(mark)
    if fcntl is not None:
        os.close(lock)


def _locked(lock: int) -> bool:
    if fcntl is not None:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            pass  # a file system without locks: as on Windows
    return True


def _undone(folder: Path) -> bool:
    return (folder / NEW / _PLAN).exists()


def _recovered(folder: Path) -> str:
    """Complete what was decided, take back what was not; a sentence on it."""
    new = folder / NEW
    if not _undone(folder):
        if new.is_dir() and not new.is_symlink():
            shutil.rmtree(new)
        return f"an earlier run of gtmodel broke off before or after it wrote into {folder}; no file is half written"
    plan = json.loads((new / _PLAN).read_bytes())
    for name, (before, after) in plan.items():
        if (new / name).exists() and _hash(folder / name) not in (before, after, None):
            raise FolderError(
                f"holds {name}, changed after a run of gtmodel broke off while it wrote there; move that file away"
            )
    _complete(folder, plan)
    return f"an earlier run of gtmodel broke off while it wrote into {folder}; its files were completed"


def _complete(folder: Path, plan: Mapping[str, list[str | None]]) -> None:
    """Change the names, as often as it takes: what is done already is passed over."""
    new = folder / NEW
    for name in plan:
        if (new / name).exists():
            os.replace(new / name, folder / name)
    for name, (before, after) in plan.items():
        # what somebody changed meanwhile is theirs
        if after is None and before is not None and _hash(folder / name) == before:
            os.unlink(folder / name)
    # the plan last: without it what remains would be taken back
    for path in sorted(new.iterdir(), key=lambda p: p.name == _PLAN):
        os.unlink(path)
    os.rmdir(new)


def _put(path: Path, content: bytes, program: bool = False) -> None:
    mode = 0o755 if program else 0o666
    with open(path, "xb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _hash(path: Path) -> str | None:
    """Of a file; None where there is none. Raises OSError for a folder of that name."""
    try:
        return _sha256(path.read_bytes())
    except FileNotFoundError:
        return None


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _because(error: OSError) -> str:
    where = f" ({Path(error.filename).name})" if error.filename else ""
    return f"cannot be written: {error.strerror or error}{where}"
