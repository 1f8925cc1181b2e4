"""How XLA compiles a network for this machine."""

import functools

import jax

# Without a library for small products, XLA runs Eigen's convolutions on all cores.
CPU_OPTIONS: dict[str, str | bool] = {"xla_cpu_experimental_ynn_fusion_type": ""}


@functools.cache
def compiler_options() -> dict[str, str | bool]:
    """Return options of `jax.jit` or `compile` with which a network runs faster.

    They are for CPUs, where one frame is too little work for XLA's usual choice. Other
    devices have none, and nor has a version of XLA that does not know them. `jit` takes
    them at the top level only.
    """
    if jax.default_backend() != "cpu":
        return {}
    try:
        jax.jit(lambda x: x).lower(0.0).compile(compiler_options=CPU_OPTIONS)
    except jax.errors.JaxRuntimeError:
        return {}
    return CPU_OPTIONS
