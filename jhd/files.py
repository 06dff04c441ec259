"""Files that are written as a whole or not at all."""

import os
import secrets
from pathlib import Path


def replace_file(file: str | Path, content: bytes | str) -> None:
    """Writes the content beside the file and puts it in its place when all of it is on the disk.

    Whoever reads meanwhile finds the old file or the new one, and an interruption leaves the old one. What is no plain
    file (a pipe, a device) is written to; a link stays, and what it leads to is replaced.

    Args:
        file: the file; one that exists is replaced and keeps its mode.
        content: bytes, or text that is written as UTF-8 with its line ends as they are.

    Raises:
        OSError: the folder cannot be written to, or the disk is full.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    target = Path(os.path.realpath(file))
    if target.exists() and not target.is_file():
        target.write_bytes(data)
        return
    part = target.with_name(f".{target.name[:100]}-{secrets.token_hex(8)}")
    try:
        with open(part, "xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        if target.exists():
            part.chmod(target.stat().st_mode & 0o7777)
        part.replace(target)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
