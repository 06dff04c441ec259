"""What is prepared of a shape is made once, found again by its numbers, and forgotten when nobody holds it."""

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np
import pytest

import jhd
from jhd._distance.search.targets import target_of
from jhd._shapes.prepared import Prepared, prepared, working
from jhd._triangles.closest_point import triangle_tree

CORNERS = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def mesh(scale=1.0):
    return jhd.TriangleMesh(CORNERS * scale, FACES)


def test_the_same_numbers_find_what_was_made():
    assert prepared(mesh()) is prepared(mesh())
    assert triangle_tree(mesh()) is triangle_tree(mesh())
    assert prepared(mesh(2.0)) is not prepared(mesh())


def test_arrays_that_only_look_alike_are_told_apart():
    other = jhd.TriangleMesh(CORNERS, FACES[:, [1, 2, 0]])
    assert prepared(other) is not prepared(mesh())


def test_every_part_is_made_once():
    made = []
    held = Prepared(mesh())
    for _ in range(3):
        assert held._part(lambda m, made=made: made.append(m) or m.count) == 4
        assert held._part(made.append) is None
    # Functions made anew are other functions; the method is the same one.
    assert len(made) == 4 and repr(held) == "Prepared(TriangleMesh, 4 parts made)"


def test_the_last_few_are_held_and_the_others_only_by_who_holds_them():
    held, lost = prepared(mesh(3.0)), weakref.ref(prepared(mesh(5.0)))
    for scale in range(10, 40):
        prepared(mesh(float(scale)))
    gc.collect()
    assert prepared(mesh(3.0)) is held and lost() is None


@pytest.mark.parametrize("kind", ["patches", "spline", "implicit", "mesh"])
def test_a_shape_is_prepared_once_for_all_that_is_asked_about_it(kind):
    corners = np.array([[[0.0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 1]]])
    shape = {
        "patches": lambda: jhd.BezierPatch(corners),
        "spline": lambda: jhd.BSplineSurface(corners, [0.0, 0, 1, 1], [0.0, 0, 1, 1]),
        "implicit": lambda: jhd.ImplicitSurface.parse("z - x*y", [-1] * 3, [1] * 3),
        "mesh": mesh,
    }[kind]
    held = jhd.prepare(shape())
    targets = [target_of(working(shape())) for _ in range(2)]
    assert targets[0] is targets[1] and jhd.prepare(shape()) is held


def test_what_is_held_does_not_change_with_an_array_that_its_owner_changes():
    # JAX shares the memory of large arrays that are aligned to 64 bytes.
    corners = np.tile(CORNERS, (500, 1))
    room = np.empty(corners.nbytes + 64, np.uint8)
    start = -room.ctypes.data % 64
    places = room[start : start + corners.nbytes].view(np.float64).reshape(corners.shape)
    places[...] = corners
    held = jhd.prepare(jhd.TriangleMesh(places, FACES))
    places += 1
    assert jhd.prepare(jhd.TriangleMesh(corners, FACES)) is held
    np.testing.assert_array_equal(held.shape.vertices, corners)


def test_threads_may_ask_at_once():
    meshes = [mesh(1 + k / 64) for k in range(64)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda k: prepared(meshes[k % 64])._part(lambda m: m.count), range(2048)))
    assert found == [4] * 2048


def test_known_shapes_are_prepared_in_compiled_functions_and_traced_ones_are_refused():
    curve = jhd.BSplineCurve.uniform([(0, 0), (2, 0), (1, 2)], periodic=True)
    held = jhd.prepare(curve)
    jax.jit(lambda x: (x, assert_is(jhd.prepare(curve), held))[0])(1.0)
    with pytest.raises(TypeError, match="shape is traced; prepare needs concrete numbers"):
        jax.jit(jhd.prepare)(curve)


def assert_is(found, wanted):
    assert found is wanted
