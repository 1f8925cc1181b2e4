"""`jit`: `jax.jit` as a decorator whose result keeps the signature for type checkers.

    @jit
    def within(cloud): ...

    @jit(static_argnames="spec")
    def project(cloud, *, spec): ...

`functools.partial(jax.jit, ...)` hides parameters and result from a type checker.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar, overload

import jax

Function = TypeVar("Function", bound=Callable[..., Any])


@overload
def jit(function: Function, /) -> Function: ...
@overload
def jit(
    *,
    static_argnames: str | Sequence[str] = (),
    compiler_options: dict[str, Any] | None = None,
) -> Callable[[Function], Function]: ...
def jit(function: Any = None, /, **options: Any) -> Any:
    """Return what `jax.jit` makes of a function, or a decorator with these options.

    A type checker sees the function itself: its parameters, its result, its docstring.
    """
    if function is None:
        return lambda decorated: jax.jit(decorated, **options)
    return jax.jit(function)
