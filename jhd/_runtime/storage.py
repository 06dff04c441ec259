"""The folder of compiled functions: its location, its safety, and its files, which are complete or absent.

The files are executable code. They are read only if the folder and the files belong to this user and nobody else can
write to them. A file gets its name only after it is completely written, and is read only if its checksum is right.
JHD_CACHE names the folder, or 0 for none. If the folder grows too large, the oldest files are removed.
"""

import hashlib
import os
import secrets
import stat
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

# Most bytes kept, some hundred executables; beyond it the oldest files are removed until a tenth is free.
LIMIT = 512 << 20
_SHARE = 0.9
_MARK = b"jhd program 1\n"
_SUM = hashlib.sha256().digest_size
# On Windows the location of a folder determines who can write to it; there are no modes.
_POSIX = os.name == "posix"
_OTHERS = stat.S_IWGRP | stat.S_IWOTH
# Seconds after which the use of a file is noted again, and after which an unfinished file counts as abandoned.
_HOUR = 3600.0


class Contents(NamedTuple):
    """Content of a folder: the number of files and their bytes."""

    files: int
    size: int


def cache_folder(platform: str, variable: Callable[[str], str | None] = os.getenv) -> Path:
    """The cache folder by the rules of the platform; a relative XDG_CACHE_HOME is ignored."""
    named = Path(variable("XDG_CACHE_HOME") or "")
    if named.is_absolute():
        return named / "jhd"
    local = variable("LOCALAPPDATA")
    if platform == "win32" and local:
        return Path(local) / "jhd" / "Cache"
    return Path.home() / ("Library/Caches" if platform == "darwin" else ".cache") / "jhd"


def chosen_folder() -> Path | None:
    """The folder that JHD_CACHE names, or the folder of the platform; None if JHD_CACHE is 0 or there is no home."""
    chosen = os.getenv("JHD_CACHE", "")
    if chosen == "0":
        return None
    try:
        return Path(chosen).expanduser().absolute() if chosen else cache_folder(sys.platform)
    except RuntimeError:  # the user has no home folder
        return None


def programs_folder() -> Path | None:
    """The folder of executables, which need not exist; None if none are kept."""
    folder = chosen_folder()
    return None if folder is None else folder / "programs"


def refusal(folder: Path) -> str | None:
    """The reason why an existing folder is not used; None if it is used."""
    try:
        found = folder.lstat()
    except OSError as error:
        return error.strerror or "it cannot be read"
    if not stat.S_ISDIR(found.st_mode):
        return "it is no folder"
    if not _POSIX:
        return None
    if found.st_uid != os.geteuid():
        return "it belongs to another user"
    return "others can write to it" if found.st_mode & _OTHERS else None


def made(folder: Path) -> bool:
    """Create the folder, for this user only, unless it exists; return whether it exists and is safe."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return False
    return refusal(folder) is None


def read(folder: Path, name: str) -> bytes | None:
    """The body stored under a name; None if there is none, it is damaged, or the file is not ours."""
    if refusal(folder) is not None:
        return None
    try:
        handle = os.open(folder / name, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0))
        with open(handle, "rb") as file:
            found = os.fstat(file.fileno())
            if not _ours(found):
                return None
            content = file.read()
        if time.time() - found.st_mtime > _HOUR:
            os.utime(folder / name)
    except OSError:
        return None
    body = content[len(_MARK) + _SUM :]
    return body if content[: len(_MARK) + _SUM] == _head(body) else None


def write(folder: Path, name: str, body: bytes) -> bool:
    """Store a body under a name, replacing any earlier one; return whether this was possible."""
    try:
        if not made(folder):
            return False
        part = folder / f".{name}-{secrets.token_hex(8)}"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        try:
            with open(os.open(part, flags, 0o600), "wb") as file:
                file.write(_head(body))
                file.write(body)
            part.replace(folder / name)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
        _make_room(folder)
    except OSError:  # read-only, full, or no folder at all
        return False
    return True


def contents(folder: Path) -> Contents:
    """The number and the bytes of the files in a folder."""
    sizes = [found.st_size for _, found in _files(folder)]
    return Contents(len(sizes), sum(sizes))


def _head(body: bytes) -> bytes:
    return _MARK + hashlib.sha256(body).digest()


def _ours(found: os.stat_result) -> bool:
    if not stat.S_ISREG(found.st_mode):
        return False
    return not _POSIX or (found.st_uid == os.geteuid() and not found.st_mode & _OTHERS)


def _files(folder: Path) -> list[tuple[Path, os.stat_result]]:
    """The files of a folder with their status, without files that disappear meanwhile."""
    found = []
    try:
        entries = list(os.scandir(folder))
    except OSError:
        return []
    for entry in entries:
        try:
            if entry.is_file(follow_symlinks=False):
                found.append((Path(entry.path), entry.stat(follow_symlinks=False)))
        except OSError:
            continue
    return found


def _make_room(folder: Path) -> None:
    """Remove unfinished files of killed processes, and the oldest files if there are too many bytes."""
    files = sorted(_files(folder), key=lambda file: file[1].st_mtime)
    size = sum(found.st_size for _, found in files)
    room = size if size <= LIMIT else int(_SHARE * LIMIT)
    for path, found in files:
        abandoned = path.name.startswith(".") and time.time() - found.st_mtime > _HOUR
        if abandoned or size > room:
            path.unlink(missing_ok=True)
            size -= found.st_size
