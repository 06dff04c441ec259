"""A folder that keeps the distances of a long call part by part, so that a later call continues there.

A part is a file in NumPy's format with a checksum behind it, next to a manifest in JSON. Each file is written under a
temporary name, forced to the disk and then renamed: it is whole or absent, also after a kill or a loss of power. A part
that was damaged later is computed again. The manifest has a fingerprint of everything that the numbers depend on, and a
folder made for other inputs is refused. One call at a time may write.
"""

import hashlib
import io
import json
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jhd._distance.collections.blocks import MeasuredPairs
from jhd._runtime.files import replace_file
from jhd._runtime.programs import processor, source_sum

_FORMAT = "jhd pairwise 2"
# Bytes behind each part.
_CHECKSUM = hashlib.sha256().digest_size
_MANIFEST = "manifest.json"
_PART = np.dtype([("value", "<f8"), ("lower", "<f8"), ("upper", "<f8"), ("result", "<i8")])
_PACKAGES = ("jax", "jaxlib", "numpy", "equinox", "optimistix", "lineax")


class Store:
    """The parts of one table of distances.

    Args:
        folder: is created if it does not exist.
        about: everything that the numbers depend on; see `fingerprint_of`.

    Raises:
        ValueError: the folder belongs to other numbers, or holds files that do not belong to a store.
    """

    def __init__(self, folder: str | Path, about: dict[str, Any]):
        self._folder = Path(folder)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._check(about)

    def _check(self, about: dict[str, Any]) -> None:
        path, mine = self._folder / _MANIFEST, about["fingerprint"]
        if not path.exists():
            others = sorted(x.name for x in self._folder.iterdir() if not x.name.endswith(".partial"))
            if others:
                raise ValueError(f"store {self._folder} holds {others[0]} and no {_MANIFEST}; needs an empty folder.")
            _write(path, (json.dumps(about, indent=1, sort_keys=True) + "\n").encode())
            return
        try:
            known = json.loads(path.read_text(encoding="utf-8"))
            found = known["fingerprint"]
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"store {self._folder}: {_MANIFEST} is not a manifest of jhd.") from error
        if found != mine:
            differing = [key for key in sorted(about) if key != "fingerprint" and known.get(key) != about[key]]
            if not differing:
                raise ValueError(f"store {self._folder}: {_MANIFEST} is damaged; name another folder.")
            raise ValueError(
                f"store {self._folder} was made for other inputs ({', '.join(differing)}): its fingerprint is {found}, "
                f"the fingerprint of this call is {mine}. Name another folder, or pass the inputs it was made for."
            )

    def read(self, part: int) -> MeasuredPairs | None:
        """Return the distances of a part; None if they are missing or damaged."""
        try:
            stored = self._path(part).read_bytes()
        except OSError:
            return None
        body, checksum = stored[:-_CHECKSUM], stored[-_CHECKSUM:]
        if hashlib.sha256(body).digest() != checksum:
            return None
        rows = np.load(io.BytesIO(body), allow_pickle=False)
        return MeasuredPairs(*(rows[name] for name in _PART.names or ()))

    def write(self, part: int, found: MeasuredPairs) -> None:
        """Store a part."""
        rows = np.empty(found.value.shape, _PART)
        for name in _PART.names or ():
            rows[name] = getattr(found, name)
        body = io.BytesIO()
        np.save(body, rows, allow_pickle=False)
        _write(self._path(part), body.getvalue() + hashlib.sha256(body.getvalue()).digest())

    def _path(self, part: int) -> Path:
        return self._folder / f"part-{part:08d}.npy"


def fingerprint_of(
    collections: Sequence[Sequence[Any]], method: Any, pairs: int, each_once: bool = False
) -> dict[str, Any]:
    """Return everything that the numbers of a table depend on, by name, with one checksum."""
    about = {
        "format": _FORMAT,
        "shapes": [len(shapes) for shapes in collections],
        "pairs": pairs,
        "each pair once": each_once,
        "sum of shapes": _sum_of(collections),
        "method": f"{type(method).__name__} {_sum_of(method)}",
        "source": source_sum(),
        "versions": {name: _version(name) for name in _PACKAGES},
        "device": jax.devices()[0].device_kind,
        "precision": str(np.dtype(jax.dtypes.canonicalize_dtype(float))),
        "processor": hashlib.sha256(processor().encode()).hexdigest(),
    }
    text = json.dumps(about, sort_keys=True)
    return about | {"fingerprint": hashlib.sha256(text.encode()).hexdigest()}


def _sum_of(tree: Any) -> str:
    leaves, structure = jax.tree_util.tree_flatten(tree)
    total = hashlib.sha256(str(structure).encode())
    for leaf in leaves:
        array = np.ascontiguousarray(leaf)
        total.update(f"{array.dtype.str} {array.shape}\n".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def _write(path: Path, body: bytes) -> None:
    # With a unique name: the next call that writes this part replaces a file left by a killed call.
    replace_file(path, body, path.name + ".partial")
