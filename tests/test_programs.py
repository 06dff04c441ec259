"""Programs between processes: the same bits, no name for two of them, and nothing kept that could not be read."""

import dataclasses
import gc
import os
import sys
import types
from contextlib import nullcontext
from functools import partial, wraps
from pathlib import Path
from typing import Any
from weakref import WeakSet

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental.compilation_cache.compilation_cache import reset_cache

import jhd
from jhd._distance.normalization import directions
from jhd._distance.normalization.host_callback import from_host
from jhd._distance.witness import balance
from jhd._runtime import compiled as compiled_module
from jhd._runtime import programs
from jhd._runtime.compiled import asking, compiled
from jhd._runtime.jax_internals import host_device
from jhd._runtime.programs import NotKeptError, is_ours, name_of_program
from tests.processes import at_once
from tests.sweeps import CPU_ONLY

pytestmark = CPU_ONLY


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """An empty folder for the programs of this test."""
    monkeypatch.setenv("JHD_CACHE", str(tmp_path))
    # The package may have been edited since the tests began; what these keep goes with them.
    monkeypatch.setattr(programs, "_STARTED", float("inf"))
    programs._surroundings.cache_clear()
    # What JAX has read from a cache of its own cannot be kept again.
    jax.config.update("jax_enable_compilation_cache", False)
    reset_cache()
    yield tmp_path / "programs"
    jax.config.update("jax_enable_compilation_cache", True)
    reset_cache()
    programs._surroundings.cache_clear()


@pytest.fixture
def sample(monkeypatch):
    """A module of the package with what a test writes into it; the second result counts how often it is traced."""
    module: Any = types.ModuleType("jhd.sample")
    monkeypatch.setitem(sys.modules, module.__name__, module)

    def write(source):
        exec("import jax\nimport jax.numpy as jnp\nimport numpy as np\ntraced = []\n" + source, vars(module))
        programs._slots.cache_clear()
        return module

    yield write
    programs._slots.cache_clear()


def files(folder):
    return sorted(path.name for path in folder.iterdir()) if folder.exists() else []


def in_a_new_process(function, **options):
    """The function as another process compiles it: nothing of it is known but what lies on disk."""
    return compiled(function, **options)


SQUARE = "def square(x):\n    traced.append(1)\n    return {'twice': 2 * x, 'square': x * x}"


def test_a_program_is_traced_once_and_then_read(folder, sample):
    module = sample(SQUARE)
    x = jnp.linspace(0.0, 1.0, 7)
    first = in_a_new_process(module.square)(x)
    assert len(files(folder)) == 1
    second = in_a_new_process(module.square)(x)
    assert module.traced == [1]
    assert jax.tree_util.tree_structure(first) == jax.tree_util.tree_structure(second)
    assert all(np.array_equal(first[key], second[key]) for key in first)
    assert all(first[key].weak_type == second[key].weak_type for key in first)


def test_a_program_that_lies_on_disk_needs_no_permission_to_be_compiled(folder, sample):
    module, x = sample(SQUARE), jnp.linspace(0.0, 1.0, 7)

    def refuse():
        raise TimeoutError

    with asking(refuse), pytest.raises(TimeoutError):
        in_a_new_process(module.square)(x)
    assert files(folder) == []
    first = in_a_new_process(module.square)(x)
    with asking(refuse):
        np.testing.assert_array_equal(in_a_new_process(module.square)(x)["square"], first["square"])


@pytest.fixture(scope="module")
def distance():
    """A distance, found before any folder is named."""
    return jhd.hausdorff(jhd.polyline([(0, 0), (4, 0)]), jhd.polyline([(0, 0), (4, 3)]))


def test_a_solution_is_read_with_its_structure_and_bits(distance, folder):
    for _ in range(2):
        read = in_a_new_process(directions.larger)(*distance.directions)
        assert jax.tree_util.tree_structure(read) == jax.tree_util.tree_structure(distance)
        assert jax.tree_util.tree_all(jax.tree_util.tree_map(np.array_equal, read, distance))
    assert any(name.startswith("larger-") for name in files(folder))


def test_a_damaged_program_is_compiled_again_and_replaced(folder, sample):
    module = sample(SQUARE)
    in_a_new_process(module.square)(jnp.ones(3))
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert in_a_new_process(module.square)(jnp.ones(3))["twice"][0] == 2.0
    assert len(module.traced) == 2
    in_a_new_process(module.square)(jnp.ones(3))
    assert len(module.traced) == 2


def test_a_program_that_does_not_run_is_compiled_again_and_replaced(folder, sample, monkeypatch):
    module = sample(SQUARE)
    in_a_new_process(module.square)(jnp.ones(3))

    def failing(*_):
        raise jax.errors.JaxRuntimeError("NOT_FOUND: Function not found")

    with monkeypatch.context() as patch:
        patch.setattr(
            compiled_module, "load", lambda *_: (failing, jax.tree_util.tree_structure({"square": 0, "twice": 0}))
        )
        assert in_a_new_process(module.square)(jnp.ones(3))["twice"][0] == 2.0
    assert len(module.traced) == 2
    assert in_a_new_process(module.square)(jnp.ones(3))["twice"][0] == 2.0
    assert len(module.traced) == 2


def test_what_jax_has_read_from_its_own_cache_has_lost_its_code_and_is_not_kept(folder, sample, tmp_path):
    module = sample(SQUARE)
    reset_cache()
    mine = {"jax_compilation_cache_dir": str(tmp_path / "of-jax"), "jax_persistent_cache_min_compile_time_secs": 0.0}
    before = {name: getattr(jax.config, name) for name in mine}
    jax.config.update("jax_enable_compilation_cache", True)
    for name, value in mine.items():
        jax.config.update(name, value)
    try:
        in_a_new_process(module.square)(jnp.ones(3))
        (path,) = folder.iterdir()
        for count in (2, 3):
            path.unlink(missing_ok=True)
            assert in_a_new_process(module.square)(jnp.ones(3))["twice"][0] == 2.0
            assert len(module.traced) == count
        assert files(folder) == []
    finally:
        for name, value in before.items():
            jax.config.update(name, value)


def test_a_program_under_the_name_of_another_is_not_taken_for_it(folder, sample):
    module = sample(SQUARE)
    in_a_new_process(module.square)(jnp.ones(3))
    in_a_new_process(module.square)(jnp.ones(4))
    first, second = folder.iterdir()
    first.write_bytes(second.read_bytes())
    for count in (3, 4):
        assert in_a_new_process(module.square)(jnp.ones(count))["twice"].shape == (count,)


@pytest.mark.parametrize(
    "argument",
    [
        jnp.ones(4),
        jnp.ones((3, 1)),
        jnp.ones(3, jnp.float32),
        jnp.ones(3, int),
        np.ones(3, bool),
        1.0,
        1,
        True,
        np.float64(1.0),
        np.float32(1.0),
        np.ones((), np.float32),
        (jnp.ones(3),),
        [jnp.ones(3)],
        {"x": jnp.ones(3)},
        {"y": jnp.ones(3)},
        (jnp.ones(3), None),
        jhd.polyline([(0, 0), (1, 1)]),
        jhd.BezierCurve([(0, 0), (1, 1)]),
    ],
)
def test_every_kind_of_argument_has_a_program_of_its_own(folder, sample, argument):
    module = sample("def same(x):\n    traced.append(1)\n    return jax.tree_util.tree_map(lambda x: x * x, x)")
    in_a_new_process(module.same)(jnp.ones(3))
    for _ in range(2):
        made = in_a_new_process(module.same)(argument)
        assert jax.tree_util.tree_structure(made) == jax.tree_util.tree_structure(argument)
        kinds = [[jax.typeof(x) for x in jax.tree_util.tree_leaves(tree)] for tree in (made, argument)]
        assert kinds[0] == kinds[1]
    assert len(module.traced) == len(files(folder)) == 2


def test_the_same_kind_from_elsewhere_is_the_same_program(folder, sample):
    module = sample(SQUARE)
    program = in_a_new_process(module.square)
    for x in (jnp.ones(3), np.ones(3), np.zeros(3)):
        program(x)
    program(jnp.float64(1.0))
    program(np.float64(2.0))
    assert len(module.traced) == 2


def test_known_numbers_in_the_rule_of_a_derivative_have_the_program_of_any_others(folder, sample):
    program = in_a_new_process(sample(SQUARE).square)

    @jax.custom_jvp
    def scaled(x, known):
        return x * known**2

    @scaled.defjvp
    def rule(primals, tangents):
        return scaled(*primals), program(primals[1])["square"] * tangents[0]

    # JAX hands numbers of NumPy on as literals.
    for known, expected in ((np.asarray(3.0), 9.0), (np.arange(3.0), [0, 1, 4])):
        assert jax.grad(lambda x, known=known: scaled(x, known).sum())(jnp.ones(known.shape)).tolist() == expected
    assert len(files(folder)) == 2


def test_functions_as_constants_are_told_by_their_names_and_the_constants_of_their_modules(monkeypatch):
    def name(function):
        return name_of_program(directions.larger, jax.tree_util.tree_structure(0), [], (), function)

    assert name(balance.from_place) != name(balance.from_pair)
    before = name(balance.from_place)
    monkeypatch.setattr(balance, "_FLAT", 0.5)
    assert name(balance.from_place) != before
    with pytest.raises(NotKeptError):
        name(lambda rows: rows)


def test_static_arguments_are_told_apart_by_type_too(folder, sample):
    module = sample("def scaled(x, n):\n    traced.append(n)\n    return 7 * x if n is True else x * n + n")
    for _ in range(2):
        program = in_a_new_process(module.scaled, static=(1,))
        assert [float(program(jnp.ones(()), n)) for n in (1, True, 1.0, 3)] == [2.0, 7.0, 2.0, 6.0]
    assert module.traced == [1, True, 1.0, 3]
    assert len(files(folder)) == 4


@pytest.mark.parametrize(
    "context",
    [
        lambda: jax.default_matmul_precision("highest"),
        lambda: jax.numpy_dtype_promotion("strict"),
        lambda: jax.numpy_rank_promotion("raise"),
        lambda: jax.enable_x64(False),
    ],
)
def test_settings_of_jax_have_programs_of_their_own(folder, sample, context):
    module = sample(SQUARE)
    x = np.ones(3, np.float32)
    in_a_new_process(module.square)(x)
    for _ in range(2):
        with context():
            in_a_new_process(module.square)(x)
    in_a_new_process(module.square)(x)
    assert len(module.traced) == len(files(folder)) == 2


@pytest.mark.parametrize(
    "context", [jax.disable_jit, lambda: jax.debug_nans(True), lambda: jax.default_device(jax.devices()[0])]
)
def test_what_runs_in_another_way_is_left_to_jit(folder, sample, context):
    module = sample(SQUARE)
    with context():
        assert in_a_new_process(module.square)(jnp.ones(3))["twice"][0] == 2.0
    assert files(folder) == []


def test_nan_is_still_looked_for_where_it_is_asked_for(folder, sample):
    module = sample("def root(x):\n    return jnp.sqrt(x)")
    program = in_a_new_process(module.root)
    assert np.isnan(program(jnp.array(-1.0)))
    with jax.debug_nans(True), pytest.raises(FloatingPointError):
        program(jnp.array(-1.0))


def test_a_constant_that_somebody_set_has_a_program_of_its_own(folder, sample, monkeypatch):
    module = sample("FACTOR = 2\ndef helper(x):\n    return x\ndef scaled(x):\n    return FACTOR * helper(x)")
    assert in_a_new_process(module.scaled)(1.0) == 2.0
    with monkeypatch.context() as patch:
        patch.setattr(module, "FACTOR", 3)
        assert in_a_new_process(module.scaled)(1.0) == 3.0
    with monkeypatch.context() as patch:
        patch.setattr(module, "helper", lambda x: 5 * x)
        assert in_a_new_process(module.scaled)(1.0) == 10.0
    assert in_a_new_process(module.scaled)(1.0) == 2.0
    assert len(files(folder)) == 3


def test_only_functions_that_the_source_has_under_their_names_are_kept(folder, sample):
    module = sample(
        "def scaled(x, n=2):\n    return n * x\ndef maker(n):\n    return lambda x: n * x\ndouble = maker(2)"
    )

    @wraps(module.scaled)
    def other(x):
        return 7 * x

    strange = [partial(module.scaled, n=3), module.maker(3), module.double, other, lambda x: 3 * x, jnp.sin]
    assert not any(map(is_ours, strange))
    assert is_ours(module.scaled)
    assert [float(compiled(f)(jnp.ones(()))) for f in strange[:5]] == [3.0, 3.0, 2.0, 7.0, 3.0]
    assert files(folder) == []


class Strange(eqx.Module):
    """A structure of a user's, whose source is nowhere."""

    x: Any
    kind: Any = eqx.field(static=True)


@pytest.mark.parametrize("argument", [Strange(jnp.ones(3), 1), jax.tree_util.Partial(jnp.sin, jnp.ones(3))])
def test_structures_of_others_are_not_kept(folder, sample, argument):
    module = sample("def same(x):\n    return x")
    assert jax.tree_util.tree_structure(in_a_new_process(module.same)(argument)) == jax.tree_util.tree_structure(
        argument
    )
    assert files(folder) == []


@pytest.mark.parametrize("value", [np.ones(3), object(), lambda: 0, jnp.ones(()), {1, object()}, Strange(1, 2)])
def test_what_has_no_unique_text_has_no_name(sample, value):
    module = sample(SQUARE)
    tree = jax.tree_util.tree_structure(((1.0,), {}))
    with pytest.raises(NotKeptError):
        name_of_program(module.square, tree, (), (), value)


@dataclasses.dataclass(frozen=True)
class Setting:
    """A part of a context in a form that only a future version of JAX has."""

    value: int

    def __reduce__(self):
        return Setting, (self.value,)


def test_an_unknown_part_of_a_context_has_a_text_if_its_class_says_how_it_is_pickled(sample, monkeypatch):
    module, tree = sample(SQUARE), jax.tree_util.tree_structure(((1.0,), {}))
    monkeypatch.setattr(Setting, "__module__", "jhd.sample")
    module.Setting = Setting
    names = {name_of_program(module.square, tree, (), (Setting(i), frozenset("abc"[:i])), ()) for i in (1, 2, 1)}
    assert len(names) == 2
    # Equal sets can differ in their order.
    sets = frozenset((0, 8)), frozenset((8, 0))
    assert len({name_of_program(module.square, tree, (), (given,), ()) for given in sets}) == 1


def test_a_plain_distance_is_kept_on_disk_with_the_installed_jax(folder):
    before = dict(programs.refused)
    for program in compiled_module._programs:
        program.clear()
    jhd.hausdorff(jhd.point_set(np.zeros((1, 2))), jhd.point_set(np.ones((1, 2))))
    assert files(folder)
    assert programs.refused == before


def test_a_program_that_is_not_kept_says_why(folder, sample):
    module = sample(SQUARE)
    in_a_new_process(module.square)(1.0)
    assert "square" not in programs.refused
    with pytest.raises(TypeError):
        in_a_new_process(module.square)(Strange(1.0, 1))
    assert "Strange" in programs.refused.pop("square")


@pytest.mark.parametrize("source", ["edited since", "not there"])
def test_without_the_source_that_runs_nothing_is_kept(folder, sample, monkeypatch, tmp_path, source):
    module = sample(SQUARE)
    monkeypatch.setattr(programs, "_STARTED", 0.0)
    if source == "not there":
        monkeypatch.setattr(programs, "__file__", str(tmp_path / "_runtime" / "programs.py"))
    assert in_a_new_process(module.square)(jnp.ones(3))["twice"][0] == 2.0
    assert files(folder) == []


def test_versions_processor_and_flags_are_part_of_a_name(folder, monkeypatch):
    before = programs._surroundings()
    for change in (
        lambda: monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", "") + " --xla_cpu_enable_fast_math=false"),
        lambda: monkeypatch.setattr(programs, "processor", lambda: "another one"),
        lambda: monkeypatch.setattr(jax, "__version__", "another one"),
    ):
        change()
        programs._surroundings.cache_clear()
        assert programs._surroundings() != before
        before = programs._surroundings()


def test_programs_that_call_the_host_are_not_kept(folder, sample):
    source = (
        "def called(x):\n    return jax.pure_callback(lambda x: np.asarray(x) + 1, jax.ShapeDtypeStruct((), float), x)"
    )
    module = sample(source)
    assert in_a_new_process(module.called)(jnp.ones(())) == 2.0
    assert files(folder) == []


def _in_a_program(function, x):
    """What a function of the host answers, called from a compiled function."""
    return jax.jit(lambda x: from_host(function, jax.ShapeDtypeStruct(x.shape, x.dtype), x))(x)


def test_a_program_is_read_in_a_call_of_the_host_as_well(folder, sample):
    module, x = sample(SQUARE), jnp.linspace(0.0, 1.0, 7)
    plain = in_a_new_process(module.square)(x)["square"]
    again = in_a_new_process(module.square)
    found = _in_a_program(lambda x: again(x)["square"], x)
    assert len(files(folder)) == 1 and module.traced == [1]
    np.testing.assert_array_equal(found, plain)
    np.testing.assert_array_equal(again(x)["square"], plain)
    assert module.traced == [1]


def test_a_call_of_the_host_computes_on_a_device_that_no_program_occupies(folder, sample):
    module, seen = sample(SQUARE), []
    square = in_a_new_process(module.square)

    def host(x):
        seen.extend([jnp.sin(x), square(x)["square"]])
        return x

    _in_a_program(host, jnp.ones(3))
    assert all(x.devices() == {host_device()} for x in seen)
    assert host_device() not in jax.devices()
    # What was made there serves elsewhere, without another program.
    assert square(seen[0])["twice"].devices() == set(jax.devices()[:1])
    assert module.traced == [1] and len(files(folder)) == 1


def test_with_the_cache_off_nothing_is_kept_nor_read(folder, sample, monkeypatch):
    module = sample(SQUARE)
    in_a_new_process(module.square)(jnp.ones(3))
    monkeypatch.setenv("JHD_CACHE", "0")
    in_a_new_process(module.square)(jnp.ones(3))
    assert len(module.traced) == 2


def test_under_a_trace_nothing_is_kept(folder, sample):
    module = sample("def twice(x):\n    return 2 * x")
    program = in_a_new_process(module.twice)
    assert jax.jit(program)(1.0) == jax.vmap(program)(jnp.ones(1))[0] == 2.0
    assert jax.grad(program)(1.0) == 2.0
    assert files(folder) == []


@pytest.mark.slow
def test_what_is_kept_is_dropped_with_all_programs_and_read_again(folder, sample, monkeypatch, tmp_path):
    # Those of other tests stay.
    monkeypatch.setattr(compiled_module, "_programs", WeakSet())
    module = sample(SQUARE)
    program = in_a_new_process(module.square)
    program(jnp.ones(3))
    assert sum(p.count for p in compiled_module._programs) > 0
    (tmp_path / "limit").write_text("10\n")
    monkeypatch.setattr(compiled_module, "_LIMIT", tmp_path / "limit")
    compiled_module.make_room()
    assert sum(p.count for p in compiled_module._programs) == 0
    assert program(jnp.ones(3))["twice"][0] == 2.0
    assert module.traced == [1]


def in_processes(count, script, folder, **environment):
    """The outputs of this many processes that run a script at once, with one folder."""
    root = str(Path(jhd.__file__).parents[1])
    env = {**os.environ, "PYTHONPATH": root, "JHD_CACHE": str(folder), **environment}
    env.pop("JAX_COMPILATION_CACHE_DIR", None)
    return at_once([[sys.executable, "-c", script]] * count, env=env)


@pytest.mark.slow
def test_a_process_that_never_saw_lapack_runs_a_program_that_calls_it(tmp_path):
    store = """
import jax, jax.numpy as jnp
from jhd._runtime import programs
x = jnp.array([[3.0, 1.0], [1.0, 2.0]])
run = jax.jit(lambda x: [jnp.linalg.svd(x, compute_uv=False)]).lower(x).compile()
print(programs.store("svd", run, jax.tree_util.tree_structure([0])))
"""
    load = """
import jax, numpy as np
from jhd._runtime import programs
run, made = programs.load("svd", jax.devices()[0])
print([float(x).hex() for x in run(np.array([[3.0, 1.0], [1.0, 2.0]]))[0]])
"""
    assert in_processes(1, store, tmp_path) == ["True\n"]
    (out,) = in_processes(1, load, tmp_path)
    found = [float.fromhex(x) for x in out.strip("[]\n").replace("'", "").split(", ")]
    np.testing.assert_allclose(found, [(5 + 5**0.5) / 2, (5 - 5**0.5) / 2], rtol=1e-14)


@pytest.mark.slow
def test_results_stay_on_the_devices_of_the_arguments_and_only_those_of_the_first_are_kept(tmp_path):
    script = """
import jax, numpy as np
from jax.sharding import NamedSharding, PartitionSpec
from jhd._distance.search.tree_pairs import _middles
first, second = jax.devices()
boxes = np.arange(96.0).reshape(2, 6, 8)
for place in (first, second, NamedSharding(jax.make_mesh((2,), ("i",)), PartitionSpec("i"))):
    x = jax.device_put(boxes, place)
    y = _middles(x, x)
    print(sorted(device.id for device in y.devices()), y.committed)
with jax.default_device(second):
    print(sorted(device.id for device in _middles(boxes, boxes).devices()))
"""
    (out,) = in_processes(1, script, tmp_path, JAX_NUM_CPU_DEVICES="2")
    assert out.splitlines() == ["[0] True", "[1] True", "[0, 1] True", "[1]"]
    assert files(tmp_path / "programs") == []
    uncommitted = script.split("for place")[0] + "print(_middles(boxes, boxes).devices() == {first})"
    assert in_processes(1, uncommitted, tmp_path, JAX_NUM_CPU_DEVICES="2") == ["True\n"]
    assert len(files(tmp_path / "programs")) == 1


@pytest.mark.exhaustive
def test_eight_processes_with_one_empty_folder_answer_alike_and_so_do_those_after_them(tmp_path):
    script = """
import numpy as np, jhd
corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
a, b = (jhd.TriangleMesh(corners @ [[1, x, 0], [0, 1, 0], [0, 0, 1]] + [x, 0, 0], faces) for x in (0.0, 0.3))
s = jhd.hausdorff(a, b)
out = [np.asarray(x).tobytes().hex() for x in (s.lower, s.upper, s.value, s.witness.feet)]
print(out)
"""
    (without,) = in_processes(1, script, 0)
    assert in_processes(8, script, tmp_path) == [without] * 8
    assert not [path for path in (tmp_path / "programs").iterdir() if path.name.startswith(".")]
    before = files(tmp_path / "programs")
    counting = """
import jax
compiled = []
jax.monitoring.register_event_duration_secs_listener(lambda event, *_, **__: compiled.append(event))
"""
    asserting = "assert not [event for event in compiled if 'backend_compile' in event], compiled"
    assert in_processes(1, counting + script + asserting, tmp_path) == [without]
    assert files(tmp_path / "programs") == before


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("collecting", [False, True])
def test_garbage_waits_while_a_program_is_made_and_is_looked_for_as_before_after_it(folder, sample, collecting, fails):
    result = "x.nothing" if fails else "2 * x"
    made = sample(f"import gc\ndef f(x):\n    traced.append(gc.isenabled())\n    return {result}\n")
    (gc.enable if collecting else gc.disable)()
    try:
        with pytest.raises(AttributeError) if fails else nullcontext():
            compiled(made.f)(np.arange(3.0))
        assert made.traced == [False]
        assert gc.isenabled() == collecting
    finally:
        gc.enable()
