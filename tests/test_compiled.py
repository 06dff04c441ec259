"""Programs from the host: the same anywhere, and dropped before the process holds too many mappings."""

from weakref import WeakSet

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._runtime import compiled as module
from jhd._runtime.compiled import asking, compiled, make_room
from tests.sweeps import CPU_ONLY


@compiled
def _sine_of_square(x):
    return jnp.sin(x * x)


@pytest.mark.parametrize(
    "outer",
    [
        lambda f: f,
        jax.jit,
        jax.vmap,
        lambda f: jax.jit(jax.vmap(f)),
        lambda f: lambda x: jax.lax.map(f, x),
        lambda f: lambda x: jax.lax.scan(lambda carry, y: (carry, f(y)), 0.0, x)[1],
        lambda f: lambda x: jax.jvp(f, (x,), (jnp.zeros_like(x),))[0],
        lambda f: lambda x: jax.vmap(jax.value_and_grad(f))(x)[0],
    ],
)
def test_one_function_under_every_transformation(outer):
    x = jnp.linspace(0.0, 2.0, 5)
    np.testing.assert_allclose(outer(_sine_of_square)(x), np.sin(np.asarray(x) ** 2), rtol=1e-14)


def test_static_arguments_are_constants_of_the_program():
    def power(x, n):
        assert isinstance(n, int)
        return x**n

    assert compiled(power, static=(1,))(jnp.array(3.0), 2) == 9.0


def test_a_program_for_large_arguments_is_compiled_once(monkeypatch):
    # It is compiled before the memory that it takes can be asked for; to jit that would not be known.
    monkeypatch.setenv("JHD_CACHE", "0")
    total, compilations = compiled(lambda x, k: k * jnp.sum(x), static=(1,)), []

    def listener(event: str, *_: object, **__: object) -> None:
        compilations.append(event) if "backend_compile" in event else None

    jax.monitoring.register_event_duration_secs_listener(listener)
    try:
        assert [float(total(np.ones(1 << 18), 2)) for _ in range(2)] == [2.0**19] * 2
    finally:
        jax.monitoring.unregister_event_duration_listener(listener)
    assert len(compilations) == 1
    # Constants that are equal and of two types are two.
    chosen = compiled(lambda x, k: x[0] + (1 if k is True else 2), static=(1,))
    assert [float(chosen(np.zeros(1 << 18), k)) for k in (True, 1)] == [1.0, 2.0]


@pytest.mark.slow
def test_programs_are_dropped_near_the_limit_and_made_again(monkeypatch, tmp_path):
    traced = []
    # Those of other tests stay.
    monkeypatch.setattr(module, "_programs", WeakSet())

    @compiled
    def program(x):
        traced.append(x.shape)
        return 2.0 * x

    assert program(jnp.ones(3))[0] == 2.0
    program(jnp.zeros(3))
    make_room()
    program(jnp.ones(3))
    assert traced == [(3,)]
    few = tmp_path / "limit"
    few.write_text("10\n")
    monkeypatch.setattr(module, "_LIMIT", few)
    before = sum(p.count for p in module._programs)
    make_room()
    assert before > 0
    assert all(p.count == 0 for p in module._programs)
    monkeypatch.undo()
    assert program(jnp.ones(3))[0] == 2.0


def test_a_process_holds_a_stated_number_of_programs_and_those_used_last_stay(monkeypatch):
    monkeypatch.setattr(module, "_programs", WeakSet())
    monkeypatch.setattr(module, "MOST", 3)
    old, new = compiled(lambda x: 2.0 * x), compiled(lambda x: 3.0 * x)
    for size in (1, 2):
        old(np.zeros(size))
    for size in (1, 2, 1):
        new(np.zeros(size))
    assert sorted(holder.count for holder in module._programs) == [0, 2]
    assert old(np.ones(1))[0] == 2.0 and new(np.ones(1))[0] == 3.0


def test_systems_without_such_a_limit(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "_MAPPINGS", tmp_path / "nothing")
    make_room()
    assert _sine_of_square(jnp.zeros(())) == 0.0


def test_gradients_around_a_call_make_no_new_programs():
    program = compiled(lambda x: 2.0 * x)
    loss = lambda y: jnp.sum(y * program(jnp.ones(3)))  # noqa: E731
    jax.grad(loss)(jnp.zeros(3))
    counts = []
    for _ in range(3):
        jax.grad(loss)(jnp.zeros(3))
        counts.append(sum(p.count for p in module._programs))
    assert counts[0] == counts[-1]


def test_whoever_asks_is_heard_before_a_program_is_compiled_and_not_where_it_is_at_hand():
    asked = []

    def refuse():
        asked.append(0)
        raise TimeoutError

    double = compiled(lambda x: 2 * x)
    with asking(refuse), pytest.raises(TimeoutError):
        double(np.arange(3.0))
    double(np.arange(3.0))
    with asking(refuse):
        np.testing.assert_array_equal(double(np.arange(3.0)), [0, 2, 4])
        with pytest.raises(TimeoutError):
            double(np.arange(4.0))
    assert len(asked) == 2
    np.testing.assert_array_equal(double(np.arange(4.0)), [0, 2, 4, 6])


@CPU_ONLY
def test_flags_that_the_user_gave_to_the_compiler_go_before_the_level_of_a_program(monkeypatch):
    # Newer versions of XLA do not have the first one.
    emitters = {name: False for name in ("xla_cpu_use_fusion_emitters",) if module._is_option(name, False)}
    level = {"xla_backend_optimization_level": 2}
    assert not module._is_option("xla_no_such_option", False)
    try:
        for flags, options in (
            ("", emitters | level),
            ("--xla_backend_optimization_level=0", emitters),
            ("--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=true", {}),
        ):
            monkeypatch.setenv("XLA_FLAGS", flags)
            module._options.cache_clear()
            assert module._options(2) == options
        assert module._options(None) is None
        # Only programs that are to compile quickly do without windows.
        monkeypatch.setenv("XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=true")
        assert module._options(1) == {"xla_disable_hlo_passes": "tree_reduction_rewriter"}
        assert module._options(3) == {}
    finally:
        module._options.cache_clear()
