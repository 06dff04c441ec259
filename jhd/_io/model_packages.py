"""Triangles of 3MF packages: all objects that the build plate names, transformed as it says.

Follows the 3MF core specification 1.3 and the references to other parts of its production extension. Coordinates keep
the unit of the package, by default millimeters.
"""

import zipfile
from collections.abc import Callable, Iterator
from functools import cached_property
from io import BytesIO
from typing import Any
from xml.parsers import expat

import numpy as np

from jhd._io.clouds import number_in
from jhd._io.errors import ParseError, shown
from jhd._io.scenes import ScenePart, joined
from jhd._shapes.mesh import TriangleMesh

_RELATIONS, _USUAL = "_rels/.rels", "3D/3dmodel.model"
# Extensions that do not change the triangles, and the extension that is read.
_HARMLESS = ("material", "trianglesets", "production")
# Largest size of all members together: _TIMES times the size of the package, plus _ALWAYS bytes.
_TIMES, _ALWAYS = 64, 1 << 26


class _Placed:
    """A reference to an object by its key, with the matrix that places it."""

    def __init__(self, attributes: dict[str, str]):
        words = attributes.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split()
        self.key = attributes["objectid"]
        # The production extension names the part of the package in an attribute of its own.
        self.part = next((value for name, value in attributes.items() if name.endswith(" path")), None)
        self.matrix = np.eye(4)
        # Rows of the file multiply from the left.
        self.matrix[:3] = np.array([_float(word) for word in words]).reshape(4, 3).T


class _Object:
    """The mesh of an object, or the objects that it consists of."""

    def __init__(self) -> None:
        self.points: list[tuple[float, ...]] = []
        self.triangles: list[tuple[int, ...]] = []
        self.components: list[_Placed] = []

    @cached_property
    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """The points and triangles."""
        points, triangles = np.array(self.points, float), np.array(self.triangles, np.int64)
        return points.reshape(-1, 3), triangles.reshape(-1, 3)


def read_3mf(file: str, content: bytes) -> TriangleMesh:
    """The triangles of all items on the build plate.

    Raises:
        ParseError: content that is no 3MF package, or an object that is missing or contains itself.
    """
    try:
        with zipfile.ZipFile(BytesIO(content)) as package:
            whole = sum(info.file_size for info in package.infolist())
            if whole > _TIMES * len(content) + _ALWAYS:
                raise ParseError(f"would take {whole} bytes in memory, from a file of {len(content)}.", file)
            return joined(file, _parts(file, package))
    except ParseError:
        raise
    except Exception as error:  # zipfile and zlib have many kinds of errors for bytes that are not theirs
        raise ParseError(f"3MF: {' '.join(str(error)[:200].split())}", file) from None


def _parts(file: str, package: zipfile.ZipFile) -> Iterator[ScenePart]:
    models: dict[str, tuple[dict[str, _Object], list[_Placed], str]] = {}

    def model(name: str) -> tuple[dict[str, _Object], list[_Placed], str]:
        if name not in models:
            models[name] = _model(file, package, name)
        return models[name]

    start = _start(file, package)
    waiting = [(start, item, np.eye(4), 0) for item in reversed(model(start)[1])]
    while waiting:
        name, placed, above, level = waiting.pop()
        name = name if placed.part is None else placed.part.lstrip("/")
        objects, _, unit = model(name)
        # Objects inside objects, which must not contain themselves.
        if placed.key not in objects or level > 100:
            what = "is not there" if placed.key not in objects else "contains itself, or too many levels of others"
            raise ParseError(f"3MF: the object {shown(placed.key)} in {shown(name)} {what}.", file)
        if unit != model(start)[2]:
            raise ParseError(f"3MF: {shown(name)} has the unit {shown(unit)}; needs the unit of {shown(start)}.", file)
        found = objects[placed.key]
        with np.errstate(all="ignore"):
            matrix = above @ placed.matrix
        # One without triangles counts too, so that very many are noticed.
        yield ScenePart(*found.arrays, matrix)
        waiting += [(name, component, matrix, level + 1) for component in reversed(found.components)]


def _start(file: str, package: zipfile.ZipFile) -> str:
    """The name of the part of the package that holds the build plate."""
    found: list[str] = []

    def begun(tag: str, attributes: dict[str, str]) -> None:
        if tag == "Relationship" and attributes.get("Type", "").endswith("/3dmodel"):
            found.append(attributes["Target"].lstrip("/"))

    if _RELATIONS in package.namelist():
        _parse(file, package, _RELATIONS, begun)
    return found[0] if found else _USUAL


def _model(file: str, package: zipfile.ZipFile, name: str) -> tuple[dict[str, _Object], list[_Placed], str]:
    """The objects of a part of the package by their numbers, the items on its build plate, and its unit."""
    objects: dict[str, _Object] = {}
    items: list[_Placed] = []
    units: list[str] = []
    current = _Object()

    def begun(tag: str, attributes: dict[str, str]) -> None:
        nonlocal current
        if tag == "vertex":
            current.points.append(tuple(_float(attributes[axis]) for axis in "xyz"))
        elif tag == "triangle":
            current.triangles.append(tuple(_index(attributes[corner]) for corner in ("v1", "v2", "v3")))
        elif tag == "object":
            current = objects[attributes["id"]] = _Object()
        elif tag == "component":
            current.components.append(_Placed(attributes))
        elif tag == "item":
            items.append(_Placed(attributes))
        elif tag == "model":
            units.append(attributes.get("unit", "millimeter"))

    _parse(file, package, name, begun)
    return objects, items, units[0] if units else "millimeter"


def _parse(file: str, package: zipfile.ZipFile, name: str, begun: Callable[[str, dict[str, str]], Any]) -> None:
    """Call a function for each element in the root's namespace, with its local name and its attributes."""
    if name not in package.namelist():
        raise ParseError(f"3MF: the package has no part {shown(name)}.", file)
    parser = expat.ParserCreate(namespace_separator=" ")

    def refuse(*_: Any) -> None:
        raise ValueError("entities are not read")

    spaces: dict[str | None, str] = {}
    roots: list[str] = []

    def element(tag: str, attributes: dict[str, str]) -> None:
        space, _, plain = tag.rpartition(" ")
        if not roots:
            roots.append(space)
            for prefix in attributes.get("requiredextensions", "").split():
                if not any(f"/{word}/" in spaces.get(prefix, "") for word in _HARMLESS):
                    raise ValueError(f"needs the extension {shown(spaces.get(prefix, prefix))}, which is not read")
        # Extensions have vertices and triangles of their own.
        if space == roots[0]:
            begun(plain, attributes)

    parser.EntityDeclHandler = refuse
    parser.StartNamespaceDeclHandler = lambda prefix, space: spaces.update({prefix: space})
    parser.StartElementHandler = element
    try:
        parser.Parse(package.read(name), True)
    except (KeyError, ValueError, expat.ExpatError) as error:
        told = f"the attribute {error} is missing" if isinstance(error, KeyError) else str(error)[:200]
        raise ParseError(f"3MF: {shown(name)}, line {parser.CurrentLineNumber}: {told}.", file) from None


def _float(word: str) -> float:
    number = number_in(word)
    if number is None:
        raise ValueError(f"needs a number; found {shown(word)}")
    return number


def _index(word: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 19):
        raise ValueError(f"needs a whole number; found {shown(word)}")
    return int(word)
