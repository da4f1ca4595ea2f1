"""Connect to a Dask cluster: one of processes on this computer, or one that is already running."""

from __future__ import annotations

import contextlib
import logging
import os
import tempfile
from collections.abc import Iterator
from typing import Any

from gcs_autotune.errors import CannotOpenLink, UsageError

__all__ = ["cluster_of", "dask"]

_PATIENCE = 10.0
"""Time [s] to wait for the answer of a scheduler. Project choice."""


def dask() -> Any:
    """Return ``distributed``.

    Raises
    ------
    UsageError
        It is not installed.
    """
    try:
        import distributed
    except ImportError as error:
        raise UsageError(f"`study` needs Dask and pyarrow. Run pip install 'gcs-autotune[study]' ({error})") from None
    return distributed


@contextlib.contextmanager
def cluster_of(workers: int, scheduler: str = "") -> Iterator[Any]:
    """Yield a Dask client: of *workers* processes that end with it (0: one per core), or of the *scheduler*.

    Raises
    ------
    UsageError
        Dask is not installed. CannotOpenLink: no scheduler answers at the address.
    """
    distributed = dask()
    for name in ("distributed", *logging.root.manager.loggerDict):  # some of Dask's loggers have a level of their own
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)  # killed workers are reported by their cases
    if scheduler:
        with _connected(distributed, scheduler) as client:
            yield client
        return
    import dask as settings

    with (
        tempfile.TemporaryDirectory(prefix="gcs-autotune-dask-", ignore_cleanup_errors=True) as folder,
        settings.config.set({"distributed.scheduler.allowed-failures": 0}),
    ):
        cluster = distributed.LocalCluster(
            n_workers=workers or os.cpu_count() or 1,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,
            local_directory=folder,
            silence_logs=logging.CRITICAL,
        )
        try:
            with distributed.Client(cluster) as client:
                yield client
        finally:
            with contextlib.suppress(TimeoutError):  # a busy machine ends workers late, when all rows are on disk
                cluster.close()


@contextlib.contextmanager
def _connected(distributed: Any, scheduler: str) -> Iterator[Any]:
    try:
        client = distributed.Client(scheduler, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise CannotOpenLink(
            f"no Dask scheduler answers at {scheduler}: {error}. Use the address that `dask scheduler` printed, as "
            "tcp://HOST:PORT"
        ) from error
    try:
        yield client
    finally:
        client.close(timeout=_PATIENCE)
