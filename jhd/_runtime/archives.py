"""Archives of arrays (.npz files) from untrusted sources: no pickles, and no more memory than the file can justify."""

import io
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

# Largest size of all members together: _TIMES times the size of the file, plus _ALWAYS bytes.
_TIMES, _ALWAYS = 64, 1 << 26


def read_arrays(file: str | Path, names: Iterable[str] | None = None) -> Mapping[str, np.ndarray]:
    """The arrays of an .npz file, read-only.

    Args:
        file: the file.
        names: names of the arrays to read, which must all exist; by default all names.

    Raises:
        OSError: the file cannot be opened.
        ValueError: the file is no archive of arrays, is damaged, lacks a name, or claims to hold far more than its
            size.
    """
    with Path(file).open("rb") as stream:
        try:
            return _read(stream, names)
        except (MemoryError, RecursionError) as error:
            raise ValueError(f"the archive asks for too much: {type(error).__name__}.") from None
        except ValueError:
            raise
        except Exception as error:
            # zipfile, zlib and NumPy's reader of headers have many kinds of errors for bytes that are not theirs.
            raise ValueError(f"the archive cannot be read: {type(error).__name__}: {str(error)[:100]}") from error


def _read(stream: io.BufferedReader, names: Iterable[str] | None) -> Mapping[str, np.ndarray]:
    size = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    with zipfile.ZipFile(stream) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        if len(members) < len(archive.infolist()):
            raise ValueError("a name occurs twice in the archive.")
        wanted = list(members) if names is None else list(names)
        missing = [name for name in wanted if name not in members]
        if missing:
            raise ValueError(f"the archive has no {missing[0]!r}.")
        whole = sum(members[name].file_size for name in wanted)
        if whole > _TIMES * size + _ALWAYS:
            raise ValueError(f"the archive would take {whole} bytes in memory, from a file of {size}.")
        return {name: _member(archive, members[name]) for name in wanted}


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    with archive.open(info) as stream:
        content = io.BytesIO(stream.read(info.file_size))
    header = np.lib.format.read_magic(content)
    if header not in ((1, 0), (2, 0)):
        raise ValueError(f"{info.filename} is of version {header}; needs 1.0 or 2.0.")
    read = np.lib.format.read_array_header_1_0 if header == (1, 0) else np.lib.format.read_array_header_2_0
    shape, by_column, dtype = read(content)
    if dtype.hasobject:
        raise ValueError(f"{info.filename} holds objects of Python, which are not read.")
    count = 1
    for length in shape:
        count *= length
    start = content.tell()
    if min(shape, default=0) < 0 or start + count * dtype.itemsize != len(content.getbuffer()):
        raise ValueError(f"{info.filename} is said to be of shape {shape}, which its {info.file_size} bytes are not.")
    rows = np.frombuffer(content.getbuffer(), dtype, count, start)
    return rows.reshape(shape[::-1]).T if by_column else rows.reshape(shape)
