"""Files that are written completely or not at all."""

import os
import secrets
from contextlib import suppress
from pathlib import Path


def replace_file(file: str | Path, content: bytes | str, beside: str | None = None) -> None:
    """Write the content to a temporary file in the same folder, and replace the file when all is on the disk.

    Readers find the old file or the new one. An interruption, a kill or a loss of power leaves the old one. A pipe or
    a device is written to directly. A link stays, and its target is replaced.

    Args:
        file: the file; one that exists is replaced and keeps its mode.
        content: bytes, or text that is written as UTF-8 with unchanged line ends.
        beside: name of the temporary file, for a single writer: the rest of a killed writer is overwritten. By default
            a unique hidden name, with an ending that no reader of jhd accepts.

    Raises:
        OSError: the folder cannot be written to, or the disk is full; it names the file.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    try:
        _replace(Path(os.path.realpath(file)), data, beside)
    except OSError as error:
        # The error of a full disk names no file, other errors name the temporary file.
        raise OSError(error.errno, error.strerror, str(file)) from error


def _replace(target: Path, data: bytes, beside: str | None) -> None:
    if target.exists() and not target.is_file():
        target.write_bytes(data)
        return
    # File systems limit the bytes of a name, and the longest name leaves no room for more.
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
    """Write the new name to the disk too, if folders can be opened and synchronized."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
