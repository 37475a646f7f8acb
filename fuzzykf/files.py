"""Bytes in and out: the one place that opens files.

What is written replaces a regular file whole or not at all.  What is read ends at a limit, so
that neither a device without end nor a few bytes that unpack to many take all memory.
"""

from __future__ import annotations

import gzip
import io
import os
import stat
import sys
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fuzzykf.errors import FileFormatError, ParameterError

if sys.platform != "win32":
    import fcntl

if TYPE_CHECKING:
    from collections.abc import Iterator
    from os import PathLike
    from typing import IO

__all__ = [
    "LIMIT_VARIABLE",
    "as_path",
    "check_writable",
    "is_stdout",
    "read_bytes",
    "write_bytes",
    "write_text",
]

#: Environment variable that raises what a file may hold.
LIMIT_VARIABLE = "FUZZYKF_MAX_BYTES"

#: How a file ends that is not whole yet; it begins with a dot and the name of what it will be.
PART = ".part"

_PIECE = 1 << 20

# --------------------------------------------------------------------------- out


def as_path(path: Any) -> str:
    """Return the name of a file.

    Raises
    ------
    ParameterError
        If it is none: a number would be taken for a file that is open already.
    """
    try:
        name = os.fsdecode(path)
    except TypeError as error:
        raise ParameterError(f"path: got {type(path).__name__}, expected the name of a file") from error
    if not name or "\0" in name:
        raise ParameterError(f"path: got {name!r}, expected the name of a file")
    return name


def is_stdout(path: str | PathLike[str]) -> bool:
    """Whether a path stands for standard output: ``-``, or its name among the devices."""
    if os.fspath(path) == "-":
        return True
    try:
        return os.path.samestat(os.stat(path), os.fstat(sys.stdout.fileno()))
    except (OSError, ValueError, AttributeError):  # nothing there, or output goes to no file
        return False


def check_writable(path: str | PathLike[str]) -> None:
    """Refuse what cannot be written to, as far as it can be known before.

    Raises
    ------
    OSError
        If it is a folder, lies in none, or the permissions do not let it be written.
    """
    if is_stdout(path):
        return
    name = os.fspath(path)
    there = _stat(name)
    if there is None or stat.S_ISREG(there.st_mode):
        folder = _target(name).parent
        if not folder.is_dir():
            raise FileNotFoundError(2, "there is no such folder", str(folder))
        if not os.access(folder, os.W_OK):
            raise PermissionError(13, "the folder is not writable", str(folder))
    if there is None:
        return
    if stat.S_ISDIR(there.st_mode):
        raise IsADirectoryError(21, "expected a file, found a folder", name)
    if not (there.st_mode & 0o222 and os.access(name, os.W_OK)):  # the mode counts for root as well
        mode = stat.S_IMODE(there.st_mode)
        raise PermissionError(13, f"its permissions (mode {mode:04o}) do not let it be written", name)


def write_text(path: str | PathLike[str], text: str) -> None:
    """Write a text file in UTF-8, atomically: a reader sees the old file or the new one, whole.

    Parameters
    ----------
    path : path-like
        An existing file keeps its mode and owner.  Devices and pipes work; ``-`` is standard output.
    text : str

    Raises
    ------
    OSError
        If the file cannot be written; an existing one is then as it was.
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | PathLike[str], content: bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, whole.

    A file that is replaced keeps its mode and, where the system lets, its owner; a link goes
    on pointing to it.  Devices and pipes are written to.

    Parameters
    ----------
    path : path-like
        ``-`` is standard output.
    content : bytes

    Raises
    ------
    OSError
        If it cannot be written: a folder, a read-only file, a full disk.
    """
    name = as_path(path)
    if is_stdout(name):
        _print(content)
        return
    check_writable(name)
    there = _stat(name)
    try:
        if there is None or stat.S_ISREG(there.st_mode):
            _replace(_target(name), content, there)
        else:
            with open(name, "r+b" if stat.S_ISBLK(there.st_mode) else "wb", buffering=0) as stream:
                _write_all(stream, content)
    except OSError as error:
        if error.filename is None and error.errno is not None:  # a full disk does not say where
            error.filename = name
        raise


def _print(content: bytes) -> None:
    sys.stdout.flush()
    buffer = getattr(sys.stdout, "buffer", None)
    if buffer is None:  # output of a notebook, or a text stream that stands for it
        sys.stdout.write(content.decode("utf-8"))
    else:
        _write_all(buffer, content)
    sys.stdout.flush()


def _stat(name: str) -> os.stat_result | None:
    try:
        return os.stat(name)
    except (FileNotFoundError, NotADirectoryError):
        return None


def _target(name: str) -> Path:
    """Return where a link leads, which need not be there."""
    return Path(os.path.realpath(name))


def _write_all(stream: IO[bytes], content: bytes) -> None:
    rest = memoryview(content)
    while rest:
        rest = rest[stream.write(rest) :]


def _replace(target: Path, content: bytes, there: os.stat_result | None) -> None:
    _clean(target)
    with _part_of(target) as (handle, part):
        with os.fdopen(os.dup(handle), "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        if there is None:
            umask = os.umask(0)
            os.umask(umask)
            part.chmod(0o666 & ~umask)  # what is not whole yet is private
        else:
            part.chmod(_keep_owner(part, there))
        part.replace(target)


def _keep_owner(part: Path, there: os.stat_result) -> int:
    """Give a new file the owner of the old one; return the mode that goes with whose it is now."""
    mode, owners = stat.S_IMODE(there.st_mode), (there.st_uid, there.st_gid)
    if _owners(part) != owners:
        for owner in (there.st_uid, -1):  # the group alone, if the owner is not ours to give
            with suppress(PermissionError):
                os.chown(part, owner, there.st_gid)
                break
    # what a program may do in the name of its owner or group is no business of another one
    return mode if _owners(part) == owners else mode & 0o777


def _owners(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_uid, found.st_gid


@contextmanager
def _part_of(target: Path) -> Iterator[tuple[int, Path]]:
    """Make a file beside the one it will be; it is gone if it does not get so far.

    Its writer holds a lock on it, by which `_clean` knows that it lives.
    """
    while True:
        handle, name = tempfile.mkstemp(prefix=_begin(target), suffix=PART, dir=target.parent)
        _lock(handle, wait=True)  # at most for another's `_clean`
        if os.fstat(handle).st_nlink:  # nobody took it for a rest before it was locked
            break
        os.close(handle)
    try:
        yield handle, Path(name)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    finally:
        os.close(handle)


def _begin(target: Path) -> str:
    return f".{target.name[:50]}."  # the longest names that there can be leave no room for more


def _clean(target: Path) -> None:
    """Remove what writers of a file have left that were killed."""
    begin = _begin(target)
    with suppress(OSError), os.scandir(target.parent) as entries:
        for entry in entries:
            middle = entry.name.removeprefix(begin).removesuffix(PART)
            # eight letters, as tempfile makes them: the rests of other files may begin alike
            if entry.name == f"{begin}{middle}{PART}" and len(middle) == 8 and "." not in middle:
                with suppress(OSError):
                    _remove_unlocked(entry.path)


def _remove_unlocked(name: str) -> None:
    if sys.platform == "win32":
        os.unlink(name)  # fails while it is open
        return
    handle = os.open(name, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        if _lock(handle):
            os.unlink(name)
    finally:
        os.close(handle)


def _lock(handle: int, *, wait: bool = False) -> bool:
    """Lock an open file until it is closed; False if somebody else has, or files cannot be locked here."""
    if sys.platform == "win32":
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


# --------------------------------------------------------------------------- in


def read_bytes(
    path: str | PathLike[str], max_bytes: int | None, usual: int, *, unpack: bool = False
) -> bytes:
    """Read a file that holds no more than it may.

    Parameters
    ----------
    path : path-like
    max_bytes : int or None
        How much it may hold, unpacked; None means what `LIMIT_VARIABLE` says, or else ``usual``.
    usual : int
    unpack : bool
        Whether it is compressed by gzip.

    Raises
    ------
    OSError
        If it is missing or cannot be opened.
    FileFormatError
        If it holds more; gzip.BadGzipFile, zlib.error or EOFError if it is not compressed, or not to its end.
    ParameterError
        If the limit is no whole number of at least 1.
    """
    limit = _limit(max_bytes, usual)
    refusal = FileFormatError(
        f"{path}: holds more than {limit:,} bytes, the limit; raise it by max_bytes=..., or by the "
        f"environment variable {LIMIT_VARIABLE}, if you trust the file"
    )
    pieces: list[bytes] = []
    size = 0
    with open(as_path(path), "rb", buffering=0) as stream:
        if os.fstat(stream.fileno()).st_size > limit:
            raise refusal
        counted = _Counted(stream, limit, refusal)
        whole = gzip.GzipFile(fileobj=counted) if unpack else counted
        while piece := whole.read(_PIECE):
            size += len(piece)
            if size > limit:
                raise refusal
            pieces.append(piece)
    return b"".join(pieces)


class _Counted(io.RawIOBase):
    """A stream that ends in an error at the limit: what is packed may unpack to nothing, without end."""

    def __init__(self, stream: IO[bytes], limit: int, refusal: Exception) -> None:
        self._stream, self._left, self._refusal = stream, limit, refusal

    def read(self, size: int = -1) -> bytes:
        piece = self._stream.read(size)
        self._left -= len(piece)
        if self._left < 0:
            raise self._refusal
        return piece


def _limit(max_bytes: int | None, usual: int) -> int:
    if max_bytes is not None:
        return _checked(max_bytes)
    told = os.environ.get(LIMIT_VARIABLE, "")
    if not told:
        return usual
    if not (told.isascii() and told.isdigit() and 0 < len(told) < 19 and int(told)):
        raise ParameterError(f"{LIMIT_VARIABLE}: got {told!r}, expected a whole number of at least 1")
    return int(told)


def _checked(max_bytes: object) -> int:
    if isinstance(max_bytes, bool) or not isinstance(max_bytes, int) or max_bytes < 1:
        raise ParameterError(f"max_bytes: got {max_bytes!r}, expected a whole number of at least 1")
    return max_bytes
