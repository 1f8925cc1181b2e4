"""Data parallelism: the batch is split over all devices of all processes.

Every process calls `batch_at` for the whole batch and keeps its own rows, so that the
number of devices does not change the training data. Parameters are replicated.

    JAX_COORDINATOR_ADDRESS=host:port JAX_NUM_PROCESSES=2 JAX_PROCESS_ID=0 python ...

starts the first of two processes; under SLURM and MPI the address is enough.
"""

import os
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

from jradar.errors import UsageError
from jradar.training.step import Step


def join_processes() -> None:
    """Join the other processes, if the environment names a coordinator.

    Call it before anything else of JAX. Raises UsageError for a variable that is not a
    whole number.
    """
    if not os.environ.get("JAX_COORDINATOR_ADDRESS"):
        return
    numbers = []
    for name in ("JAX_NUM_PROCESSES", "JAX_PROCESS_ID"):
        text = os.environ.get(name)
        if text and not text.isdecimal():
            raise UsageError(f"{name}={text}, expected a whole number")
        numbers.append(int(text) if text else None)
    jax.distributed.initialize(num_processes=numbers[0], process_id=numbers[1])


def data_mesh() -> Mesh:
    """Return all devices of all processes along the axis `batch`."""
    devices = jax.devices()
    return jax.make_mesh(
        (len(devices),), ("batch",), axis_types=(AxisType.Auto,), devices=devices
    )


def replicate(tree: Any, mesh: Mesh) -> Any:
    """Return the tree with its arrays and keys copied to all devices."""
    whole = NamedSharding(mesh, PartitionSpec())

    def put(leaf):
        if not jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key):
            return jax.device_put(np.asarray(leaf), whole)
        data = jax.device_put(np.asarray(jax.random.key_data(leaf)), whole)
        return jax.random.wrap_key_data(data, impl=jax.random.key_impl(leaf))

    return jax.tree.map(put, tree)


def shard_batch(batch: Any, mesh: Mesh) -> Any:
    """Return the batch with its rows spread over the devices.

    Raises ValueError if the rows do not divide by the number of devices.
    """
    rows = NamedSharding(mesh, PartitionSpec("batch"))

    def put(array):
        if len(array) % mesh.size:
            raise ValueError(
                f"a batch of {len(array)} on {mesh.size} devices: expected a multiple "
                "of the number of devices"
            )
        host = np.asarray(array)
        return jax.make_array_from_callback(host.shape, rows, lambda i: host[i])

    return jax.tree.map(put, batch)


def parallel_step(step: Step, mesh: Mesh) -> Step:
    """Return the step for batches on the host, with replicated results."""
    if mesh.size > 1:
        step = jax.jit(step, out_shardings=NamedSharding(mesh, PartitionSpec()))
    return lambda state, key, batch: step(state, key, shard_batch(batch, mesh))


def preempted(step: int) -> bool:
    """Return whether all processes agree to save and end at this step.

    In a run of several processes, JAX's own handler catches SIGTERM. Every process must
    call this function at every step.
    """
    several = jax.process_count() > 1
    return several and multihost_utils.reached_preemption_sync_point(step)


def wait_for_all(what: str) -> None:
    """Wait until every process has reached this call."""
    if jax.process_count() > 1:
        multihost_utils.sync_global_devices(what)
