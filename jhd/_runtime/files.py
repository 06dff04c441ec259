"""Files that are written completely or not at all."""

import os
import secrets
from contextlib import suppress
from pathlib import Path


def replace_file(file: str | Path, content: bytes | str, beside: str | None = None) -> None:
    """Writes the content beside the file, and puts it in its place when all of it is on the disk.

    Whoever reads meanwhile finds the old file or the new one; an interruption leaves the old one, and so does a kill or
    a loss of power. What is no plain file (a pipe, a device) is written to; a link stays, and what it leads to is
    replaced.

    Args:
        file: the file; one that exists is replaced and keeps its mode.
        content: bytes, or text that is written as UTF-8 with its line ends as they are.
        beside: the name that it has in the same folder until then, for a single writer: what a killed one left is
            written over. By default a hidden one of its own, whose ending no reader of jhd takes.

    Raises:
        OSError: the folder cannot be written to, or the disk is full; it names the file.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    try:
        _replace(Path(os.path.realpath(file)), data, beside)
    except OSError as error:
        # A full disk names no file, and other errors the one beside.
        raise OSError(error.errno, error.strerror, str(file)) from error


def _replace(target: Path, data: bytes, beside: str | None) -> None:
    if target.exists() and not target.is_file():
        target.write_bytes(data)
        return
    # File systems count bytes, and the longest name that they take leaves no room for more.
    short = os.fsdecode(os.fsencode(target.name)[:100])
    part = target.with_name(f".{short}-{secrets.token_hex(8)}" if beside is None else beside)
    try:
        with open(part, "xb" if beside is None else "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        if target.exists():
            part.chmod(target.stat().st_mode & 0o7777)
        part.replace(target)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    _sync_folder(target.parent)


def _sync_folder(folder: Path) -> None:
    """The new name is on the disk too, where folders can be opened and synchronized."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
