"""glTF and 3MF files: every part at its place, as one mesh; what is not read is refused."""

import json

import numpy as np
import pytest

import jhd
import jhd.io
from tests.io.scenes import CORNERS, TRIANGLES, glb, gltf, header, model, package

MATRIX = [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 5, 6, 7, 1]  # by columns: a quarter turn about z, twice the size, moved
MOVED = np.stack([5 - 2 * CORNERS[:, 1], 6 + 2 * CORNERS[:, 0], 7 + 2 * CORNERS[:, 2]], axis=1)
HALF = 0.5**0.5


def faces(mesh):
    """The corners of all triangles, each from its smallest corner on, in order."""
    found = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)].tolist()
    return sorted(min(face[k:] + face[:k] for k in range(3)) for face in found)


def expected(*places, flipped=False):
    rows = TRIANGLES[:, ::-1] if flipped else TRIANGLES
    found = [face for points in places for face in points[rows].tolist()]
    return sorted(min(face[k:] + face[:k] for k in range(3)) for face in found)


def loaded(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    found = jhd.io.load_shape(tmp_path / name)
    assert isinstance(found, jhd.TriangleMesh)
    return found


@pytest.mark.parametrize(("name", "content"), [("a.glb", glb()), ("a.GLTF", gltf()), ("a.3mf", package())])
def test_a_mesh_keeps_its_numbers(name, content, tmp_path):
    mesh = loaded(tmp_path, name, content)
    assert faces(mesh) == expected(CORNERS) and mesh.is_closed
    assert faces(jhd.io.load_mesh(tmp_path / name)) == faces(mesh)


@pytest.mark.parametrize(
    "nodes",
    [
        [{"mesh": 0}, {"mesh": 0, "matrix": MATRIX}],
        [
            {"mesh": 0, "children": [1]},
            {"translation": [5, 6, 7], "children": [2]},
            {"matrix": [*MATRIX[:12], 0, 0, 0, 1], "mesh": 0},
        ],
    ],
)
@pytest.mark.parametrize("make", [gltf, glb])
def test_nodes_place_meshes(make, nodes, tmp_path):
    roots = [0] if "children" in nodes[0] else [0, 1]
    mesh = loaded(tmp_path, "a.glb", make(nodes=nodes, scenes=[{"nodes": roots}]))
    assert faces(mesh) == expected(CORNERS, MOVED)
    no_scene = make({("scenes",): None, ("scene",): None}, nodes=nodes)
    assert faces(loaded(tmp_path, "b.glb", no_scene)) == faces(mesh)


def test_a_node_turns_scales_and_mirrors(tmp_path):
    turned = {"mesh": 0, "translation": [5, 6, 7], "rotation": [0, 0, HALF, HALF], "scale": [2, 2, 2]}
    mesh = loaded(tmp_path, "a.gltf", gltf(nodes=[turned]))
    np.testing.assert_allclose(faces(mesh), expected(MOVED), atol=1e-14)
    mirrored = loaded(tmp_path, "b.gltf", gltf(nodes=[{"mesh": 0, "scale": [-1, 1, 1]}]))
    assert faces(mirrored) == expected(CORNERS * [-1, 1, 1], flipped=True)


def test_strips_fans_and_plain_corners_are_triangles(tmp_path):
    primitive = {"attributes": {"POSITION": 0}}
    for mode, rows in ((4, []), (5, [[0, 1, 2], [1, 3, 2]]), (6, [[1, 2, 0], [2, 3, 0]]), (1, None)):
        meshes = [{"primitives": [{**primitive, "mode": mode}, {**primitive, "indices": 1}]}]
        content = gltf(meshes=meshes)
        if mode == 4:
            with pytest.raises(jhd.io.ParseError, match="triangles have 4 corners; needs a multiple of 3"):
                loaded(tmp_path, "a.gltf", content)
            continue
        found = faces(loaded(tmp_path, "a.gltf", content))
        assert len(found) == 4 + len(rows or [])
        for face in CORNERS[rows].tolist() if rows else []:
            assert min(face[k:] + face[:k] for k in range(3)) in found


def test_a_buffer_next_to_the_file_and_strides_are_read(tmp_path):
    points = np.column_stack([CORNERS, np.ones(4)]).astype("<f4").tobytes()
    (tmp_path / "the buffer.bin").write_bytes(points + TRIANGLES.astype("<u2").tobytes())
    changes = {
        ("buffers", 0, "uri"): "the%20buffer.bin",
        ("bufferViews", 0, "byteStride"): 16,
        ("bufferViews", 0, "byteLength"): 64,
        ("bufferViews", 1, "byteOffset"): 64,
    }
    assert faces(loaded(tmp_path, "a.gltf", gltf(changes))) == expected(CORNERS)
    (tmp_path / "the buffer.bin").unlink()
    with pytest.raises(FileNotFoundError, match="the buffer.bin: no such file"):
        jhd.io.load_shape(tmp_path / "a.gltf")


def test_the_build_plate_places_objects_and_their_parts(tmp_path):
    transform = "0 2 0 -2 0 0 0 0 2 5 6 7"
    objects = '<object id="1">MESH</object><object id="7"><components><component objectid="1"/>'
    objects += f'<component objectid="1" transform="{transform}"/></components></object><object id="9">MESH</object>'
    assert faces(loaded(tmp_path, "a.3mf", package(objects, '<item objectid="7"/>'))) == expected(CORNERS, MOVED)
    item = f'<item objectid="1"/><item objectid="1" transform="{transform}"/>'
    assert faces(loaded(tmp_path, "b.3mf", package(items=item))) == expected(CORNERS, MOVED)


def test_vertices_of_extensions_are_left_out(tmp_path):
    names = 'xmlns:s="http://a/slice/2015/07" xmlns:m="http://a/material/2015/02" requiredextensions="m"'
    objects = '<s:slicestack><s:vertex x="1" y="2"/></s:slicestack><object id="1">MESH<s:triangle/></object>'
    assert faces(loaded(tmp_path, "a.3mf", package(objects, unit=names))) == expected(CORNERS)


def test_other_parts_of_a_package_are_read(tmp_path):
    relations = '<Relationships><Relationship Type="http://a/3dmodel" Target="/3D/main.model"/></Relationships>'
    main = model(
        '<object id="8"><components><component objectid="2" p:path="/3D/3dmodel.model"/></components></object>',
        '<item objectid="8" transform="1 0 0 0 1 0 0 0 1 0 0 0.5"/>',
    )
    content = package('<object id="2">MESH</object>', "", **{"_rels/.rels": relations, "3D/main.model": main})
    assert faces(loaded(tmp_path, "a.3mf", content)) == expected(CORNERS + [0, 0, 0.5])


def test_trimesh_reads_the_same(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    nodes = [{"mesh": 0, "children": [1], "translation": [1, 2, 3]}, {"mesh": 0, "rotation": [0.5, 0.5, 0.5, 0.5]}]
    mesh = loaded(tmp_path, "a.glb", glb(nodes=nodes))
    other = trimesh.load_scene(tmp_path / "a.glb").to_mesh()
    rounded = [
        jhd.TriangleMesh(np.round(x, 9), triangles)
        for x, triangles in ((mesh.vertices, mesh.triangles), (other.vertices, other.faces))
    ]
    assert faces(rounded[0]) == faces(rounded[1])
    scene = trimesh.Scene()
    for k in range(3):
        scene.add_geometry(
            trimesh.creation.icosphere(1, 1 + k),
            transform=trimesh.transformations.random_rotation_matrix(np.array([0.1, 0.2, 0.3])),
        )
    for name in ("b.glb", "b.gltf"):
        exported = scene.export(file_type=name[2:])
        for part, content in (exported if isinstance(exported, dict) else {name: exported}).items():
            (tmp_path / ("b.gltf" if part == "model.gltf" else part)).write_bytes(content)
        mesh = jhd.io.load_mesh(tmp_path / name)
        whole = scene.to_mesh()
        assert mesh.count == len(whole.faces) and mesh.is_closed
        np.testing.assert_allclose(np.sort(mesh.vertices, axis=0), np.sort(whole.vertices, axis=0), atol=1e-6)


def test_the_header_of_the_tests_is_right():
    assert json.loads(gltf()) == header()
