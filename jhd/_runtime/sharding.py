"""Batches with an explicitly sharded axis: each device computes its own part."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, TypeVar

import jax
import numpy as np
from jax.custom_batching import custom_vmap
from jax.sharding import AxisType, Mesh, PartitionSpec, get_abstract_mesh

_R = TypeVar("_R")
_NO_MESH = Mesh(np.empty((), object), ())


def without_mesh() -> AbstractContextManager[object]:
    """A context without the mesh of `jax.set_mesh`, whose explicit axes would belong to the types of new arrays."""
    return nullcontext() if get_abstract_mesh().empty else jax.set_mesh(_NO_MESH)


def shared_by_devices(function: Callable[..., _R]) -> Callable[..., _R]:
    """The function, which under vmap of an explicitly sharded batch computes each part on its own device.

    For such arrays JAX needs the sharding of the results of every loop and every lookup. Within jax.shard_map each
    device has plain arrays. Other batches are computed as usual. Explicitly sharded arrays have no reverse-mode
    derivative here.
    """
    single = custom_vmap(function)

    @single.def_vmap
    def batch(_: int, batched: list[Any], *args: Any) -> tuple[_R, Any]:
        leaves, tree = jax.tree_util.tree_flatten(args)
        axes = [0 if is_batched else None for is_batched in jax.tree_util.tree_leaves(batched)]
        # A batch around this one may be sharded as well.
        members = shared_by_devices(
            jax.vmap(lambda *leaves: function(*jax.tree_util.tree_unflatten(tree, leaves)), in_axes=tuple(axes))
        )
        found = _on_own_devices(members, leaves, axes)(*leaves)
        return found, jax.tree_util.tree_map(lambda _: True, found)

    return lambda *args: single(*args) if may_be_shared(args) else function(*args)


def is_partitioned(values: Any) -> bool:
    """Whether arrays lie on several devices in such a way that a compiled function cannot call the host.

    Within jax.shard_map over all axes of a mesh each device calls by itself.
    """
    meshes = [jax.typeof(x).sharding.mesh for x in jax.tree_util.tree_leaves(values)]
    kinds = [set(mesh.axis_types) for mesh in meshes]
    return any(AxisType.Explicit in kind or (AxisType.Manual in kind and len(kind) > 1) for kind in kinds)


def may_be_shared(values: Any) -> bool:
    """Whether arrays are on explicit axes of a mesh; axes of a batch and of its members are not distinguished."""
    meshes = [jax.typeof(x).sharding.mesh for x in jax.tree_util.tree_leaves(values)]
    return any(AxisType.Explicit in mesh.axis_types for mesh in meshes)


def _on_own_devices(function: Callable[..., _R], leaves: list[Any], axes: list[int | None]) -> Callable[..., _R]:
    """The function, computed on the devices of the arrays that have a batch axis, for arguments like `leaves`."""
    shardings = [jax.typeof(x).sharding for x, axis in zip(leaves, axes, strict=True) if axis is not None]
    sharding = next((x for x in shardings if x.spec and x.spec[0] is not None), None)
    if sharding is None:
        return function
    names = sharding.spec[0]
    place, everywhere = PartitionSpec(names), PartitionSpec()
    shared = jax.shard_map(
        function,
        mesh=sharding.mesh,
        in_specs=tuple(everywhere if axis is None else place for axis in axes),
        out_specs=place,
        axis_names={names} if isinstance(names, str) else set(names),
    )
    return jax.jit(shared)
