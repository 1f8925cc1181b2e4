"""Writes `enhance_points` of a model as one ONNX file, for runtimes without JAX.

    xyz [n, 3]      the radar's points in metres: x forward, y left, z up
    valid [n]       which of them are points; n is the model's capacity
    velocity [n]    m/s, positive when a target recedes
    power [n]       of any scale, such as the SNR as a ratio
        -> cloud_xyz [m, 3], cloud_valid, cloud_velocity, cloud_confidence [m]

The file's metadata hold these units, the grid, the model's purpose, the digest of its
weights, and the versions that made it. jax2onnx converts the function (extra `onnx`).
"""

import contextlib
import hashlib
import io
import json
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jradar import __version__
from jradar.errors import UsageError, optional
from jradar.files import atomic_path
from jradar.model import Model, enhance_points
from jradar.types import PointCloud

ONNX = ".onnx"
FORMAT = "jradar onnx 1"
OPSET = 21  # of 2024; the lowest with the GroupNormalization that jax2onnx writes
OUTPUTS = "xyz", "valid", "velocity", "confidence"
INPUTS = {
    "xyz": "metres, x forward, y left, z up",
    "valid": "true for points, false for the rest of the capacity",
    "velocity": "m/s, positive when a target recedes; 0 if unknown",
    "power": "of any scale, such as the SNR as a ratio, not in dB; 1 if unknown",
}


def export_onnx(path: Path | str, model: Model) -> None:
    """Write `enhance_points` of a model of one pass, for a capacity of its points.

    The cloud is that of `enhance_points`, to rounding. What JAX compiled before is
    compiled again when it is next called. Raises UsageError for a model that draws
    samples or does not see points, ValueError for one of maps, and ImportError without
    the extra `onnx`.
    """
    method, capacity = model.spec.method, model.spec.points.capacity
    if method == "diffusion":
        raise UsageError(
            f"a model of the method {method!r} draws samples in several steps, and "
            "ONNX files hold no random numbers: expected one pass, such as jradar-sim"
        )
    convert = _converter()

    def function(*points):
        key = jax.random.key(0)  # which one pass does not use
        fields = enhance_points(key, PointCloud(*points), model)._asdict()
        return [fields[name] for name in OUTPUTS if fields[name] is not None]

    kinds = {name: ((capacity,), jnp.float32) for name in INPUTS}
    kinds |= {"xyz": ((capacity, 3), jnp.float32), "valid": ((capacity,), jnp.bool_)}
    inputs: list[Any] = [jax.ShapeDtypeStruct(*kind) for kind in kinds.values()]
    without = model.spec.method == "regression"  # confidence
    outputs = [name for name in OUTPUTS if not (without and name == "confidence")]
    with atomic_path(path) as scratch:  # first: it refuses a folder at once
        converted = convert(
            function,
            inputs,
            model_name="jradar",
            opset=OPSET,
            input_names=[*INPUTS],
            output_names=[f"cloud_{name}" for name in outputs],
        )
        del converted.graph.value_info[:]  # some shapes in loops are wrong
        for name, value in _metadata(model, capacity).items():
            entry = converted.metadata_props.add()
            entry.key, entry.value = name, value
        scratch.write_bytes(converted.SerializeToString())


def running(path: Path | str, capacity: int) -> list[str]:
    """Return lines of Python that run the file on points `xyz [k, 3]`."""
    return [
        "import numpy, onnxruntime",
        f"session = onnxruntime.InferenceSession({str(path)!r})",
        f"n, k = {capacity}, len(xyz)  # the file's capacity, and your points",
        "points = {'xyz': numpy.zeros((n, 3), 'f4'), 'valid': numpy.arange(n) < k,",
        "          'velocity': numpy.zeros(n, 'f4'), 'power': numpy.ones(n, 'f4')}",
        "points['xyz'][:k] = xyz",
        "cloud, valid, *_ = session.run(None, points)",
        "dense = cloud[valid]",
    ]


def _metadata(model: Model, capacity: int) -> dict[str, str]:
    digest = hashlib.sha256()
    for leaf in jax.tree.leaves(model):
        digest.update(np.asarray(leaf).tobytes())
    view = model.spec.frame_grid.view
    return {
        "format": FORMAT,
        "jradar": __version__,
        "opset": str(OPSET),
        "purpose": model.card.purpose,
        "trained_on": model.card.trained_on,
        "sha256_of_weights": digest.hexdigest(),
        "capacity": str(capacity),
        "inputs": json.dumps(INPUTS),
        "outputs": "as the inputs; confidence: the probability that a surface is near",
        "azimuth_rad": json.dumps(view.azimuth),
        "elevation_rad": json.dumps(view.elevation),
        "max_range_m": str(view.max_range_m),
        "near_m": str(view.near_m),
    }


def _converter() -> Any:
    """Return `to_onnx`, which then knows the primitive `stack`, too."""
    with _quiet():
        jax2onnx = optional("jax2onnx", need="ONNX files need jax2onnx", extra="onnx")
        plugins = optional(
            "jax2onnx.plugins.plugin_system", need="ONNX files need it", extra="onnx"
        )
        known = plugins.PLUGIN_REGISTRY

        class Stack(plugins.PrimitiveLeafPlugin):
            """`stack` of newer JAX, as its parts joined along a new axis."""

            def lower(self, ctx: Any, eqn: Any) -> None:
                """Convert one equation by those of the equal function."""
                axis = eqn.params["axis"]

                def joined(*parts):
                    return jnp.concatenate(
                        [jnp.expand_dims(p, axis) for p in parts], axis
                    )

                shapes = [v.aval.update(weak_type=False) for v in eqn.invars]
                inner = jax.make_jaxpr(joined)(*shapes).jaxpr
                for ours, theirs in zip(inner.invars, eqn.invars, strict=True):
                    ctx.bind_value_for_var(ours, ctx.get_value_for_var(theirs))
                for equation in inner.eqns:
                    known[equation.primitive.name].lower(ctx, equation)
                for theirs, ours in zip(eqn.outvars, inner.outvars, strict=True):
                    ctx.bind_value_for_var(theirs, ctx.get_value_for_var(ours))

        def convert(*arguments: Any, **options: Any) -> Any:
            with _quiet():
                if "stack" not in known:
                    plugins.import_all_plugins()
                    plugins.register_primitive(jaxpr_primitive="stack")(Stack)
                try:
                    return jax2onnx.to_onnx(*arguments, **options)
                finally:  # it traces with primitives that only it knows
                    jax.clear_caches()

    return convert


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Leave out what jax2onnx prints, and logs of libraries that are not there."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        logging.disable(before)
