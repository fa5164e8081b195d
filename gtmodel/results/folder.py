"""Folders that are written completely or not at all, even if the process is killed at any instruction.

A process holds a folder through a locked file in it, which the system unlocks when the process ends. New files are
written into a subfolder, then a plan file lists the replacements, then the files are renamed. Before the plan exists,
the folder is unchanged and the next run discards the new files; after that, the next run can complete the write.

On Windows and on file systems without locks, a process cannot see that another one holds a folder. A second run then
takes the first for a killed one and discards or completes its write; the first may end with a FolderError, or the
folder may contain files of both. Run one at a time there. Recovery after a killed run works there too.
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
_PLAN = ".plan.json"  # in NEW: file name -> [hash before, hash after], null for no file
_HEAD = b"gtmodel writes here: process "
_TRIES = 100  # the holder may remove the mark between our opening and locking it


class FolderError(Exception):
    """A folder that cannot be locked or written; the text is the predicate of a sentence about the folder."""


def refuse_impossible(folder: Path) -> None:
    """Raises FolderError for a name that no file system accepts."""
    try:
        os.stat(folder)
    except ValueError:
        raise FolderError("contains the character NUL, which is not allowed in a name; name another folder") from None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise FolderError("is longer than a name may be on this disk; name another folder") from None


def unfinished(folder: Path) -> bool:
    """Return True while gtmodel holds a folder, and after a run that was killed while it did."""
    mark = folder / MARK
    try:
        content = b"" if mark.is_symlink() else mark.read_bytes()
    except OSError:
        return False
    # a mark is empty or cut if the process was killed between creating and writing it
    return not mark.is_symlink() and (content.startswith(_HEAD) or _HEAD.startswith(content))


def others(folder: Path) -> list[str]:
    """Return the names in a folder, sorted, without the auxiliary files of this module."""
    return sorted(p.name for p in folder.iterdir() if p.name not in (MARK, NEW))


class Held:
    """A folder that only this process may write; `message` says what an earlier run left unfinished, or is empty."""

    def __init__(self, path: Path, message: str = "") -> None:
        self.path = path
        self.message = message
        self.written = False

    def write(self, files: Mapping[str, bytes], remove: Iterable[str] = (), programs: Collection[str] = ()) -> None:
        """Write `files` by name and delete the files in `remove` that exist: everything, or nothing.

        programs: names of executable files, which only the owner may write.

        Raises FolderError; the folder is then unchanged, unless the system failed during the renaming, which the next
        holder completes.
        """
        if not all(name == Path(name).name and name not in (MARK, NEW, _PLAN) for name in (*files, *remove)):
            raise ValueError(f"expected file names without folders in {self.path}; found {[*files, *remove]}")
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
            if all((new / name).exists() for name in files):  # no file was renamed
                shutil.rmtree(new, ignore_errors=True)
            raise FolderError(_because(error)) from error


@contextmanager
def holding(folder: Path) -> Iterator[Held]:
    """Create a folder if necessary and lock it; first discard or complete what an earlier run left unfinished.

    A folder created here that stays empty is removed. Raises FolderError if it is a file, cannot be written, is locked
    by another process, or contains a file that somebody changed after an interrupted write.
    """
    if folder.exists() and not folder.is_dir():
        raise FolderError("is a file; name a folder")
    if folder.is_symlink() and not folder.exists():
        raise FolderError(
            f"is a link to {os.readlink(folder)}, which does not exist; create it, or name another folder"
        )
    missing = [p for p in (folder, *folder.parents) if not p.exists()]
    held = Held(folder)
    lock = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock, unfinished_before = _lock(folder / MARK)
        held.message = _recovered(folder) if unfinished_before else ""
    except BaseException as error:
        _release(folder, lock, missing)
        if isinstance(error, OSError):
            raise FolderError(_because(error)) from error
        raise
    try:
        yield held
    finally:
        _release(folder, lock, [] if held.written else missing)


def _release(folder: Path, lock: int | None, created: Iterable[Path]) -> None:
    """Leave the folder; the mark stays if a write is unfinished; folders created in vain are removed."""
    if lock is not None:
        _let_go(lock, None if _undone(folder) else folder / MARK)
    for path in created:
        with suppress(OSError):
            path.rmdir()


def _lock(mark: Path) -> tuple[int, bool]:
    """The locked mark with the number of this process; True if a killed process had left it."""
    for _ in range(_TRIES):
        lock = os.open(mark, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        alone = False
        try:
            content = os.read(lock, 200)
            if not (content.startswith(_HEAD) or _HEAD.startswith(content)):
                raise FolderError(f"contains a file {mark.name} that gtmodel did not write; move it away")
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
            pass  # its holder has just removed it
        except BaseException:
            _let_go(lock, mark if alone else None)
            raise
        os.close(lock)
    raise FolderError("is in use by other runs of gtmodel; name another folder")


def _let_go(lock: int, mark: Path | None) -> None:
    """Remove the mark, if there is one, and unlock it; in this order, so that no other process locks it in between."""
    if fcntl is None:  # Windows cannot delete an open file
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
            pass  # a file system without locks
    return True


def _undone(folder: Path) -> bool:
    return (folder / NEW / _PLAN).exists()


def _recovered(folder: Path) -> str:
    """Complete a write with a plan, discard one without; a sentence about it."""
    new = folder / NEW
    if not _undone(folder):
        if new.is_dir() and not new.is_symlink():
            shutil.rmtree(new)
        return f"an earlier run of gtmodel was killed before or after it wrote into {folder}; no file is incomplete"
    plan = json.loads((new / _PLAN).read_bytes())
    for name, (before, after) in plan.items():
        if (new / name).exists() and _hash(folder / name) not in (before, after, None):
            raise FolderError(
                f"contains {name}, changed after a run of gtmodel was killed while writing there; move that file away"
            )
    _complete(folder, plan)
    return f"an earlier run of gtmodel was killed while it wrote into {folder}; its files were completed"


def _complete(folder: Path, plan: Mapping[str, list[str | None]]) -> None:
    """Rename the files; steps that were done before are skipped."""
    new = folder / NEW
    for name in plan:
        if (new / name).exists():
            os.replace(new / name, folder / name)
    for name, (before, after) in plan.items():
        # keep files that somebody changed in the meantime
        if after is None and before is not None and _hash(folder / name) == before:
            os.unlink(folder / name)
    # the plan last: without it the rest would be discarded
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
    """Hash of a file; None if there is no file. Raises OSError for a folder of that name."""
    try:
        return _sha256(path.read_bytes())
    except FileNotFoundError:
        return None


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _because(error: OSError) -> str:
    where = f" ({Path(error.filename).name})" if error.filename else ""
    return f"cannot be written: {error.strerror or error}{where}"
