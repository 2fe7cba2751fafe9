"""Ctrl-C and SIGTERM: the same request to end, which keeps what is finished."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import current_thread, main_thread
from types import FrameType

REQUESTS = (signal.SIGINT, signal.SIGTERM)


def end_as_by_ctrl_c() -> None:
    """Let SIGTERM, by which batch systems and `timeout` end a command, do what Ctrl-C does."""
    if current_thread() is main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, signal.default_int_handler)


@dataclass
class Deferred:
    """`count`: requests to end that came while they were put off. `message`: written at the first, after
    which a second one ends at once; without one all wait."""

    message: str
    count: int = 0

    def put_off(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        self.count += 1
        if self.message and self.count > 1:
            raise KeyboardInterrupt
        with suppress(OSError):  # not by print, which may be what was interrupted
            os.write(2, self.message.encode())


@contextmanager
def deferred(message: str = "") -> Iterator[Deferred]:
    """Put off Ctrl-C and SIGTERM, such as while finished results are written. `message`: see Deferred."""
    requests = Deferred(message)
    if current_thread() is not main_thread():  # it alone is interrupted
        yield requests
        return
    handled = [number for number in REQUESTS if callable(signal.getsignal(number))]
    before = {number: signal.signal(number, requests.put_off) for number in handled}
    try:
        yield requests
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
