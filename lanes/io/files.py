"""Files in and out: only ordinary files are read, and what is written gets its name when it is whole.

An output is written beside its place under a name of its own, ``STEM.partial.DIGITS.SUFFIX``, and then renamed. Whoever
writes one holds a lock on it, which the system takes back when the process ends, however it ends: the next run that
writes the same output removes what is left of dead ones, and touches nothing of those that live.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows removes no file that somebody has open, which does as well
    fcntl = None

PARTIAL = ".partial."
_DIGITS = 12
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def require_file(
    path: str | Path, kind: str, *, error: type[ValueError] = ValueError, max_bytes: int | None = None
) -> Path:
    """Refuse what cannot be read like a file, before anything waits for a pipe or fills the memory.

    Parameters
    ----------
    path : str or Path
    kind : str
        What it should be, for the sentence: "picture", "video".
    error : type
        Raised where it is something else than a file.
    max_bytes : int, optional
        Greatest size; no limit if None.

    Raises
    ------
    FileNotFoundError
        If there is nothing of that name.
    error
        If it is a folder, a pipe or a device, may not be read, is empty or too large.
    """
    path = Path(path)
    try:
        found = path.stat()
    except PermissionError as refused:
        raise error(f"{path}: may not be read ({refused.strerror}); ask for the right to, or copy it.") from refused
    except (OSError, ValueError) as missing:  # ValueError: a NUL in the name
        raise FileNotFoundError(f"{path}: there is no such {kind} file; check the name and the folder.") from missing
    if not stat.S_ISREG(found.st_mode):
        raise error(f"{path}: is {_KINDS.get(stat.S_IFMT(found.st_mode), 'no file')}; name a {kind} file.")
    if not os.access(path, os.R_OK):
        raise error(f"{path}: may not be read (Permission denied); ask for the right to, or copy it.")
    if not found.st_size:
        raise error(f"{path}: the file is empty; copy it again from its source.")
    if max_bytes is not None and found.st_size > max_bytes:
        raise error(
            f"{path}: is {found.st_size / 1e6:.0f} MB large, more than any {kind} file of use "
            f"({max_bytes / 1e6:g} MB); name another file."
        )
    return path


def read_text(
    path: str | Path, kind: str, *, error: type[ValueError] = ValueError, max_bytes: int | None = None
) -> str:
    """The text of a file, which must be UTF-8; refuses what `require_file` refuses."""
    data = require_file(path, kind, error=error, max_bytes=max_bytes).read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as wrong:
        raise error(f"{path}: is no text (byte {wrong.start} is not UTF-8); name a {kind} file.") from wrong


def list_files(folder: str | Path, suffixes: Collection[str]) -> list[Path]:
    """The files of a folder with one of `suffixes`, in lower case; neither hidden ones nor what is being written.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    ValueError
        If it may not be read.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: there is no such folder; name the folder that holds the files.")
    try:
        found = [path for path in folder.iterdir() if path.suffix.lower() in suffixes and path.is_file()]
    except PermissionError as error:
        raise ValueError(f"{folder}: may not be read ({error.strerror}); ask for the right to, or copy it.") from error
    # Some systems put hidden shadow files beside pictures.
    return [path for path in found if PARTIAL not in path.name and not path.name.startswith(".")]


def write_atomically(path: str | Path, data: bytes) -> None:
    """Write `data` beside `path` and rename it, so that an interruption never leaves half a file."""
    with atomic_write(Path(path)) as partial:
        partial.write_bytes(data)


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """A name to write to in the `with` block; the file becomes `path` at its end, or is removed if the block raises.

    Of two processes that write the same output, the one that ends last has its file there, whole.

    Raises
    ------
    OSError
        If the file cannot be written; the folder is created where needed.
    """
    with translate_write_errors(path):
        partial = PartialFile(path)
        try:
            yield partial.name
            partial.commit()
        finally:
            partial.discard()


class PartialFile:
    """A file that is being written beside `path`, as `name`; `commit` gives it its name, `discard` removes it."""

    def __init__(self, path: str | Path) -> None:
        # A link stays a link; what it points to is replaced.
        self.path = Path(os.path.realpath(path))
        _refuse_special(self.path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        remove_stale_partials(self.path)
        digits = secrets.token_hex(_DIGITS // 2)
        self.name = self.path.with_name(f"{self.path.stem}{PARTIAL}{digits}{self.path.suffix}")
        self._handle = _open_locked(self.name, os.O_EXCL)

    def commit(self) -> None:
        """Give the file its name; on the disk it is by then, so that a full one is known."""
        os.fsync(self._handle)
        if fcntl is None:
            self._close()
        os.replace(self.name, self.path)
        self._close()

    def discard(self) -> None:
        """Remove the file, unless it was committed."""
        if self._handle is not None:
            self.name.unlink(missing_ok=True)
            self._close()

    def _close(self) -> None:
        if self._handle is not None:
            os.close(self._handle)
        self._handle = None


def remove_stale_partials(path: Path) -> None:
    """Remove what dead processes left half-written of `path`, and of files that differ from it in the suffix."""
    ours = re.compile(re.escape(path.stem + PARTIAL) + rf"[0-9a-f]{{{_DIGITS}}}(\.\w+)?")
    with suppress(OSError), os.scandir(path.parent) as entries:
        leftovers = [Path(entry.path) for entry in entries if ours.fullmatch(entry.name)]
        for leftover in leftovers:
            _remove_unlocked(leftover)


@contextmanager
def exclusive_writer(path: Path, *, wait: bool = False) -> Iterator[None]:
    """Keep others from writing outputs that are called like `path` while the block runs: the run that is first wins.

    Parameters
    ----------
    path : Path
    wait : bool
        Begin when the others are done, instead of refusing to.

    Raises
    ------
    OSError
        If another process is at it, unless told to wait.
    """
    lock = Path(os.path.realpath(path))
    lock = lock.with_name(f"{lock.stem}{PARTIAL}lock")
    with translate_write_errors(path):
        lock.parent.mkdir(parents=True, exist_ok=True)
        try:
            handle = _open_locked(lock, wait=wait)
        except BlockingIOError as error:
            raise OSError("another run is writing it; wait until that is done") from error
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(handle)


@contextmanager
def translate_write_errors(path: Path) -> Iterator[None]:
    """What the system refuses in the `with` block becomes a sentence that names `path`."""
    try:
        yield
    except OSError as error:
        raise type(error)(
            f"{path}: cannot be written ({error.strerror or error}); choose another folder or free some space."
        ) from error


def _refuse_special(path: Path) -> None:
    """Nothing but an ordinary file is replaced: root could rename a file over /dev/null."""
    if path.exists() and not path.is_file():
        kind = _KINDS.get(stat.S_IFMT(path.stat().st_mode), "no file")
        raise OSError(f"it is {kind}")


def _open_locked(path: Path, flags: int = 0, *, wait: bool = False) -> int:
    """Create a file, or open it, and lock it until it is closed; BlockingIOError if another has it, unless we wait."""
    while True:
        handle = os.open(path, os.O_CREAT | os.O_RDWR | flags, 0o666)
        try:
            # A file system without locks: no run is refused there, and nothing is removed.
            if not _lock(handle, wait=wait) or _is_open_at(path, handle):
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _lock(handle: int, *, wait: bool = False) -> bool:
    """Lock an open file; False where that cannot be done at all, BlockingIOError if another process has it locked."""
    try:
        if fcntl:
            fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:
        return False
    return True


def _is_open_at(path: Path, handle: int) -> bool:
    """Whether it still has that name: somebody may have removed it before it was locked."""
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _remove_unlocked(path: Path) -> None:
    """Remove a file unless a living process has it locked, or the file system knows no locks."""
    with suppress(OSError):
        handle = os.open(path, os.O_RDWR)
        try:
            if _lock(handle):
                path.unlink()
        finally:
            os.close(handle)
