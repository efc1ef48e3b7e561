"""Processes side by side: most of a diagnosis is Python between short compiled runs, which threads would wait for."""

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager

from .devices import prepare_process


@contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of fresh processes, JAX set up in each; an error, or an interrupt, ends them and what they work on."""
    # A forked process would inherit JAX's threads' locks, held or not.
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), prepare_process) as pool:
        try:
            yield pool
        except BaseException:  # or what runs would be waited for
            for process in multiprocessing.active_children():
                process.terminate()
            pool.shutdown(cancel_futures=True)
            raise
