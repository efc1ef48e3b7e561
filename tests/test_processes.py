"""Work in processes: results come back, errors too, and one process is this one."""

import os

import pytest

from experiments.processes import calls


@pytest.mark.parametrize("workers", [1, 2])
def test_a_call_gives_what_the_function_gives(workers):
    with calls(workers) as call:
        assert call(divmod, 17, 5) == (3, 2)
        assert (call(os.getpid) == os.getpid()) == (workers == 1)
        with pytest.raises(ZeroDivisionError):
            call(divmod, 1, 0)
        assert call(abs, -2) == 2  # and goes on
