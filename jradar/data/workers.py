"""Jobs in this process, in several processes of this machine, or in a Dask cluster.

A failure, Ctrl-C or SIGTERM ends the processes of this machine at once: what they were
doing is lost, so a job has to be one that can be done again.
"""

import contextlib
import logging
import os
import signal
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from multiprocessing import resource_tracker
from typing import Any, TypeVar

LONGEST_DEATH_S = 10.0
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
    cluster does the jobs. Raises the first error of a job, and ImportError without the
    extra `data` if several workers are asked for.
    """
    if scheduler is None and workers == 1:
        for job in jobs:
            yield job, function(job)
        return
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise ImportError("several workers need: pip install 'jradar[data]'") from error
    here = scheduler is None
    with _local(workers) if here else Client(scheduler, timeout=10) as client:
        futures = {client.submit(function, job, pure=False): job for job in jobs}
        for future in as_completed(futures):
            yield futures[future], future.result()


@contextlib.contextmanager
def _local(workers: int) -> Iterator[Any]:
    """Yield the client of a cluster on this machine.

    Its processes are started with SIGINT blocked, because a terminal sends Ctrl-C to
    them too.
    """
    from distributed import Client, LocalCluster

    options: dict[str, Any] = {
        "threads_per_worker": 1,
        "dashboard_address": "127.0.0.1:0",  # None would take port 8787, or warn
        "host": "127.0.0.1",  # workers read files of this machine
        "local_directory": os.environ.get("TMPDIR", "/tmp"),
        "silence_logs": logging.CRITICAL,  # errors of jobs are raised here
    }
    resource_tracker.ensure_running()  # it would unblock SIGINT
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        cluster = LocalCluster(n_workers=workers, **options)
        client = Client(cluster)
    except BaseException:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        raise
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        yield client
    except BaseException:
        for nanny in cluster.workers.values():
            nanny.auto_restart = False
        _kill([nanny.pid for nanny in cluster.workers.values()])
        raise
    finally:
        client.close()
        cluster.close()


def _kill(pids: list[int]) -> None:
    """End processes and wait until they are gone: none writes another file."""
    import psutil

    processes = []
    for pid in pids:
        with contextlib.suppress(psutil.NoSuchProcess):
            processes.append(psutil.Process(pid))
            processes[-1].kill()
    deadline = time.monotonic() + LONGEST_DEATH_S
    while any(map(_alive, processes)) and time.monotonic() < deadline:
        time.sleep(0.01)


def _alive(process):
    import psutil

    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
