"""Jobs in this process, in several processes of this machine, or in a Dask cluster.

A failure, Ctrl-C or SIGTERM ends the processes of this machine at once, and their work
is lost. So every job must be one that can be done again.
"""

import concurrent.futures
import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from jradar.errors import optional

PATIENCE_S = 10  # for a scheduler, and for its first worker

Job = TypeVar("Job")
Result = TypeVar("Result")


def run_jobs(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    workers: int = 1,
    scheduler: str | None = None,
) -> Generator[tuple[Job, Result], None, None]:
    """Yield each job with its result, in the order in which jobs end.

    One worker is this process. With `scheduler`, the address of a Dask cluster, that
    cluster does the jobs; one whose worker dies is done by another. Raises the first
    error of a job; OSError if a process of this machine dies, or for a cluster without
    workers, or with those of another version; ImportError without the extra `data`.
    """
    if scheduler is None and workers == 1:
        for job in jobs:
            yield job, function(job)
        return
    with _processes(workers) if scheduler is None else _cluster(scheduler) as pool:
        futures = {pool.submit(function, job): job for job in jobs}
        for future in concurrent.futures.as_completed(futures):
            yield futures[future], future.result()


@contextlib.contextmanager
def _processes(workers: int) -> Iterator[concurrent.futures.Executor]:
    """Yield processes that ignore Ctrl-C, because this one handles it.

    Unless all jobs end, they are killed, so that none writes another file.
    """
    others = {*multiprocessing.active_children()}
    pool = concurrent.futures.ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), initializer=_begin
    )
    try:
        yield pool
    except BaseException as error:
        for process in {*multiprocessing.active_children()} - others:
            process.kill()
            process.join()
        if isinstance(error, BrokenProcessPool):
            raise OSError(
                f"one of {workers} processes died: for lack of memory, use fewer "
                "workers; a script starts them under `if __name__ == '__main__':`"
            ) from error
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """Leave Ctrl-C to the process that started this one, and end when it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if (parent := multiprocessing.parent_process()) is not None:

        def wait() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=wait, daemon=True).start()


@contextlib.contextmanager
def _cluster(scheduler: str) -> Iterator[Any]:
    distributed = optional("distributed", need="clusters need Dask", extra="data")
    try:
        client = distributed.Client(scheduler, timeout=PATIENCE_S)
    except (OSError, ValueError) as error:
        raise OSError(
            f"no Dask scheduler at {scheduler} ({error}): start one by `dask scheduler`"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE_S)
        except TimeoutError as error:
            raise OSError(
                f"the Dask cluster at {scheduler} has no workers: start some by "
                f"`dask worker {scheduler}`"
            ) from error
        _check_versions(client)
        yield client.get_executor(pure=False)


def _check_versions(client: Any) -> None:
    """Raise OSError for a worker without this version of jradar."""
    found = client.get_versions(packages=["jradar"])
    here = found["client"]["packages"]["jradar"]
    for address, worker in found["workers"].items():
        if (version := worker["packages"].get("jradar")) != here:
            has = f"has jradar {version}" if version else "has no jradar"
            raise OSError(
                f"the worker at {address} {has}: install {here} there, as here"
            )
