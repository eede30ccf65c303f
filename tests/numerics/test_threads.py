"""Work on several threads stops on request, and asks in the thread that waits."""

import threading
import time

import pytest
import torch

from texsss.errors import Cancelled
from texsss.numerics.threads import in_threads


@pytest.mark.parametrize("threads", [1, 2])
def test_order_errors_and_questions(threads):
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    asked: list[threading.Thread] = []

    def cancel() -> bool:
        asked.append(threading.current_thread())
        return False

    def work(item: int) -> int:
        time.sleep(0.05)
        if item == 7:
            raise ZeroDivisionError
        return item * item

    try:
        assert in_threads(work, range(4), cancel) == [0, 1, 4, 9]
        assert len(asked) >= 3 and set(asked) == {threading.main_thread()}
        with pytest.raises(ZeroDivisionError):
            in_threads(work, [1, 7, 2, 3], cancel)
        start = time.monotonic()
        with pytest.raises(Cancelled):
            in_threads(work, range(100), lambda: time.monotonic() - start > 0.1)
        assert time.monotonic() - start < 1
        assert torch.get_num_threads() == threads
    finally:
        torch.set_num_threads(before)
