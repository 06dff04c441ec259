"""What all tests share: compiled programs are kept, shapes and types are checked at run time, nothing is random.

The type checks of jaxtyping must be switched on before the package is imported, so this file imports nothing of it.
"""

import os
from pathlib import Path

import hypothesis
import jax
import jaxtyping

os.environ["MPLBACKEND"] = "Agg"

_FOLDER = os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parent.parent / ".jax_cache"))
# Tests in a process of their own find the same programs.
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
jax.config.update("jax_compilation_cache_dir", _FOLDER)
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)

# An int serves where a float is asked for, as PEP 484 has it; counters of loops are ints where a loop is unrolled and
# arrays where it is compiled; preparation of concrete curves runs on NumPy arrays.
_TYPES = "{int: int | jax.Array, float: float | int | jax.Array, jax.Array: jax.Array | numpy.ndarray}"
_RULES = f"beartype.BeartypeConf(hint_overrides=beartype.BeartypeHintOverrides({_TYPES}))"
_RULES = _RULES.replace("jax.", "__import__('jax').").replace("numpy.", "__import__('numpy').")
jaxtyping.install_import_hook("jhd", f"beartype.beartype(conf={_RULES})")

hypothesis.settings.register_profile("jhd", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("jhd")
