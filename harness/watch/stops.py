"""Being asked to stop, told apart from what packers raise."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from shading_atlas_bench.harness.errors import StopAsked


@contextmanager
def stops_apart() -> Iterator[None]:
    """Ctrl-C and SIGTERM raise StopAsked in the block, where it is the main thread's; ignored signals stay ignored."""

    def stop(_signal: int, _frame: object) -> None:
        raise StopAsked

    main = threading.current_thread() is threading.main_thread()
    asking = [signal.SIGINT, signal.SIGTERM] if main else []
    handlers = {number: signal.getsignal(number) for number in asking}
    before = {number: handler for number, handler in handlers.items() if handler not in (signal.SIG_IGN, None)}
    for number in before:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
