"""GeoJSON and WKT files: the points, lines and rings that shapely reads."""

import json
import sys

import pytest

import jhd.io
from jhd._shapes.curve import BezierSegments

RING = [[0, 0], [4, 0], [0.1, 3], [0, 0]]
LINE = [[5, 5], [6, 7.5]]
GEOMETRIES = {"type": "Polygon", "coordinates": [RING]}, {"type": "LineString", "coordinates": LINE}
TEXTS = "POLYGON ((0 0, 4 0, 0.1 3, 0 0))", "LINESTRING (5 5, 6 7.5)"


def collection(kind):
    if kind == "features":
        features = [{"type": "Feature", "properties": None, "geometry": one} for one in (*GEOMETRIES, None)]
        return {"type": "FeatureCollection", "features": features}
    return {"type": "GeometryCollection", "geometries": list(GEOMETRIES)}


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.geojson", json.dumps(collection("features"))),
        ("a.GeoJSON", json.dumps(collection("geometries"), indent=1)),
        ("a.wkt", "\n\n".join(TEXTS)),
        ("a.wkt", f"SRID=25832;{TEXTS[0]}\nPOINT EMPTY\nLINESTRING\n(5 5,\n 6 7.5)\n"),
        ("a.WKT", f"\ufeffGEOMETRYCOLLECTION ({', '.join(TEXTS)})"),
    ],
)
def test_all_geometries_of_a_file_are_one_shape(name, content, tmp_path):
    (tmp_path / name).write_text(content, encoding="utf-8")
    found = jhd.io.load_shape(tmp_path / name)
    assert isinstance(found, BezierSegments)
    assert found.control_points.tolist() == [*([RING[k], RING[k + 1]] for k in range(3)), LINE]
    assert found.next_segment.tolist() == [1, 2, 0, -1]


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.wkt", "MULTIPOINT Z (1 2 3, 4 5 6)"), ("a.geojson", '{"type":"MultiPoint","coordinates":[[1,2,3],[4,5,6]]}')],
)
def test_points_in_space_are_a_point_set(name, content, tmp_path):
    (tmp_path / name).write_text(content, encoding="utf-8")
    found = jhd.io.load_shape(tmp_path / name)
    assert isinstance(found, BezierSegments) and found.degree == 0
    assert found.control_points[:, 0].tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


def test_a_character_that_ends_texts_is_refused(tmp_path):
    (tmp_path / "a.wkt").write_text("POINT (1 2)\nPOINT (1 2)\0, POINT (3 4)", encoding="utf-8")
    with pytest.raises(jhd.io.ParseError, match=r"a\.wkt:2: holds a null character"):
        jhd.io.load_shape(tmp_path / "a.wkt")


@pytest.mark.parametrize("name", ["a.wkt", "a.geojson"])
def test_without_shapely_the_extra_is_named(name, tmp_path, monkeypatch):
    (tmp_path / name).write_text(TEXTS[0] if name == "a.wkt" else json.dumps(GEOMETRIES[0]), encoding="utf-8")
    monkeypatch.setitem(sys.modules, "shapely", None)
    with pytest.raises(ImportError, match=rf"{name}: .* needs shapely: pip install jhd\[geometry\]\.$"):
        jhd.io.load_shape(tmp_path / name)
    with pytest.raises(FileNotFoundError, match=rf"no-{name}: no such file\.$"):
        jhd.io.load_shape(tmp_path / f"no-{name}")
