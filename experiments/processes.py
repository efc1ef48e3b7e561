"""Calls that are answered in processes of their own, for work that is done in threads of this one."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from didim_jax.processes import processes


@contextmanager
def calls(workers: int) -> Iterator[Callable[..., Any]]:
    """A way to call a function of a module in one of several processes; a single one is this process itself.

    A call waits for its result: as many threads as there are processes keep all of them at work.
    """
    if workers == 1:
        yield lambda work, *arguments: work(*arguments)
        return
    with processes(workers) as pool:
        yield lambda work, *arguments: pool.submit(work, *arguments).result()
