"""Points, lines and the rings of polygons in GeoJSON and WKT files, read with shapely.

Coordinates are taken as they stand, in the unit of the file: GeoJSON holds degrees if it follows its standard. All
geometries of a file become one shape.
"""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from jhd._io.described import load_json
from jhd._io.errors import ParseError, read_text
from jhd._shapes.curve import BezierSegments

GEOMETRY_SUFFIXES = (".geojson", ".wkt")
# Collections inside collections: the reader of shapely calls itself for each.
_MOST_LEVELS = 100
_BRACKET = re.compile("[()]")
_REFERENCE_SYSTEM = re.compile(r"\s*SRID=\d+;", re.I)


def load_geometry(file: str | Path) -> BezierSegments:
    """The points, lines and rings of all geometries in a .geojson or .wkt file.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: text that cannot be read, a file without geometries, or curved ones.
        ImportError: shapely is not installed.
    """
    is_text = Path(file).suffix.lower() == ".wkt"
    parts = _texts(read_text(file), file) if is_text else [(None, x) for x in _members(load_json(file), file)]
    shapely = _shapely(file)
    read = shapely.from_wkt if is_text else shapely.from_geojson
    found = [_parsed(read, text, file, line) for line, text in parts]
    try:
        return BezierSegments.from_shapely(found[0] if len(found) == 1 else shapely.GeometryCollection(found))
    except (TypeError, ValueError) as error:
        raise ParseError(str(error), file) from None


def _members(content: Any, file: object) -> list[str]:
    """Each geometry of a GeoJSON file as text; features may have none."""
    kind = content.get("type") if isinstance(content, dict) else None
    if kind not in ("Feature", "FeatureCollection"):
        return [json.dumps(content)]
    features = content.get("features") if kind == "FeatureCollection" else [content]
    if not isinstance(features, list) or not all(isinstance(feature, dict) for feature in features):
        raise ParseError("'features' is missing, or not a list of objects.", file)
    found = [json.dumps(feature["geometry"]) for feature in features if feature.get("geometry") is not None]
    if not found:
        raise ParseError("holds no geometry.", file)
    return found


def _shapely(file: object) -> Any:
    try:
        import shapely
    except ImportError as error:
        raise ImportError(f"{file}: reading GeoJSON and WKT needs shapely: pip install jhd[geometry].") from error
    return shapely


def _parsed(read: Any, text: str, file: object, line: int | None) -> Any:
    try:
        # Numbers beyond the range of doubles are infinite, which is refused later.
        with np.errstate(all="ignore"):
            return read(text)
    except Exception as error:  # shapely has several kinds of errors, from different libraries
        raise ParseError(" ".join(str(error)[:200].split()), file, line) from None


def _texts(text: str, file: object) -> list[tuple[int, str]]:
    """The geometries of a WKT file, each beginning on a line of its own, with the number of this line."""
    parts: list[tuple[int, str]] = []
    level = 0
    for number, line in enumerate(text.splitlines(), start=1):
        if "\0" in line:
            raise ParseError("holds a null character, at which readers of WKT stop.", file, number)
        content = line if level else _REFERENCE_SYSTEM.sub("", line, count=1)
        if level or (parts and not _is_whole(parts[-1][1])):
            parts[-1] = (parts[-1][0], f"{parts[-1][1]}\n{content}")
        elif content.strip():
            parts.append((number, content))
        for sign in _BRACKET.findall(content):
            level += (sign == "(") - (sign == ")")
            if level > _MOST_LEVELS or level < 0:
                message = f"brackets are nested deeper than {_MOST_LEVELS}" if level > 0 else "a bracket closes nothing"
                raise ParseError(f"{message}.", file, number)
    if not parts:
        raise ParseError("holds no geometry.", file)
    return parts


def _is_whole(text: str) -> bool:
    """Whether a text without open brackets is a complete geometry."""
    return text.rstrip().endswith((")", ";")) or text.rstrip().upper().endswith("EMPTY")
