"""Data that searches prepare for a shape: trees, samples, covers, each computed at first use and kept with the shape.

A caller that holds a Prepared keeps these data. The last few are also held here, so asking again about the same numbers
costs no more than to compare them.
"""

import hashlib
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar
from weakref import WeakValueDictionary

import jax
import numpy as np
from jax.core import eval_context

from jhd._runtime.arrays import array_of, is_traced
from jhd._shapes.as_shape import ShapeLike, check_shape, taken_as
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.patch import AbstractPatch

_R = TypeVar("_R")

# Most shapes held here: the two of a pair and two before them, each as it is, in its unit, in common coordinates and
# as a surface whose zeros are covered. Most bytes of their numbers; the data made of them take about ten times as
# many. A mesh of a million triangles has 24 MB.
_HELD, _MOST_BYTES = 16, 1 << 28


class Prepared:
    """A shape together with the search data computed for it so far; made by `prepare`.

    Args:
        shape: a shape in its working form, with numbers that are not traced.
    """

    def __init__(self, shape: object):
        # Copies: a JAX array can share the memory of a NumPy array, which its owner may change later.
        self.shape = jax.tree_util.tree_map(_copied, shape)
        self.size = sum(np.asarray(leaf).nbytes for leaf in jax.tree_util.tree_leaves(shape))
        self._parts: dict[Callable[[Any], Any], Any] = {}

    def _part(self, build: Callable[..., _R]) -> _R:
        """The result of a function of the shape, computed once.

        Args:
            build: a function that takes the shape; its result is stored under the function itself.
        """
        if build not in self._parts:
            self._parts[build] = build(self.shape)
        return self._parts[build]

    def __repr__(self) -> str:
        return f"Prepared({type(self.shape).__name__}, {len(self._parts)} parts made)"


def _copied(leaf: Any) -> Any:
    if not isinstance(leaf, jax.Array):
        return np.array(leaf)
    with jax.ensure_compile_time_eval():
        return array_of(np.array(leaf))


_changing = threading.Lock()
_known: WeakValueDictionary[bytes, Prepared] = WeakValueDictionary()
_last: deque[Prepared] = deque()


def prepare(shape: ShapeLike) -> Prepared:
    """Compute search data of a surface, a mesh or a point set once, and keep them for as long as the result is held.

    Distances look up trees, samples and covers by the numbers of a shape, and compute missing data. The last few shapes
    are always kept; hold the result if you query many others in between. Data of a pair of shapes are kept only for the
    last few pairs. Curves need no preparation.

    >>> import jhd
    >>> patch = jhd.BezierPatch([[[0.0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 1]]])
    >>> jhd.prepare(patch) is jhd.prepare(patch)
    True

    Args:
        shape: any shape, or an object that `as_shape` converts to one. Its numbers must not be traced.

    Returns:
        An object that keeps the search data. Hold it, and pass the shape itself to other functions.

    Raises:
        TypeError: an object that is not a shape, or a traced one.
    """
    shape = taken_as("shape", shape)
    check_shape("shape", shape)
    if is_traced(shape):
        raise TypeError("shape is traced; prepare needs concrete numbers: call it outside of jit, vmap and grad.")
    # Inside compiled functions, operations on known numbers would be traced otherwise.
    with eval_context():
        return prepared(working(shape))


def working(shape: Any) -> Any:
    """The form of a shape that searches take: segments of curves, patches of parametric surfaces."""
    # Functions of the class, as a method of a Module is made anew wherever it is taken.
    if isinstance(shape, AbstractCurve):
        return type(shape).segments(shape)
    return type(shape).patches(shape) if isinstance(shape, AbstractPatch) else shape


def prepared(shape: Any) -> Prepared:
    """The Prepared of an object with these arrays, which are not traced; see `prepare`."""
    leaves, form = jax.tree_util.tree_flatten(shape)
    hashed = hashlib.blake2b(str(form).encode())
    for leaf in leaves:
        array = np.ascontiguousarray(leaf)
        hashed.update(f"{array.dtype.char}{np.shape(leaf)}".encode())
        hashed.update(array.data)
    key = hashed.digest()
    with _changing:
        found = _known.get(key)
        if found is None:
            found = _known[key] = Prepared(shape)
        if found in _last:
            _last.remove(found)
        _last.append(found)
        # Four entries stay: both shapes of a pair, each as it is and in its unit.
        while len(_last) > _HELD or (len(_last) > 4 and sum(each.size for each in _last) > _MOST_BYTES):
            _last.popleft()
    return found
