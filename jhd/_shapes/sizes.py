"""The functions behind the methods `length` and `area` of shapes, by name.

They need cells of searches, so a module of a higher layer adds them when it is imported: jhd._distance.sizes.
"""

from collections.abc import Callable

from jhd._results.bounds import Bounds

SIZE_OF: dict[str, Callable[..., Bounds]] = {}
"""Functions of a shape and the options of the method."""
