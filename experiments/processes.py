"""Work in processes of its own: most of a diagnosis is Python, which threads would wait for in turn."""

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from didim_jax.devices import prepare_process


@contextmanager
def processes(workers: int) -> Iterator[Callable[..., Any]]:
    """A way to call a function of a module in one of several processes; a single one is this process itself.

    A call waits for its result: as many threads as there are processes keep all of them at work.
    """
    if workers == 1:
        yield lambda work, *arguments: work(*arguments)
        return
    # A forked process would inherit JAX's threads' locks, held or not.
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), prepare_process) as pool:
        try:
            yield lambda work, *arguments: pool.submit(work, *arguments).result()
        except BaseException:  # interrupted: what runs would be waited for
            for process in multiprocessing.active_children():
                process.terminate()
            pool.shutdown(cancel_futures=True)
            raise
