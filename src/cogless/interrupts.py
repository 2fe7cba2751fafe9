"""Handle Ctrl-C and SIGTERM alike: as a request to end that keeps finished results."""

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
    """Requests to end that are put off.

    `count`: number of requests so far. `message`: text that the first request writes; a second request then
    ends at once. Without a message all requests wait.
    """

    message: str
    count: int = 0

    def put_off(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal: count the request, and write the message."""
        self.count += 1
        if self.message and self.count > 1:
            raise KeyboardInterrupt
        with suppress(OSError):  # The signal may have interrupted a print, so print can't be used.
            os.write(2, self.message.encode())


@contextmanager
def deferred(message: str = "") -> Iterator[Deferred]:
    """Put off Ctrl-C and SIGTERM, such as while finished results are written. `message`: see Deferred."""
    requests = Deferred(message)
    if current_thread() is not main_thread():  # Signals interrupt only the main thread.
        yield requests
        return
    handled = [number for number in REQUESTS if callable(signal.getsignal(number))]
    before = {number: signal.signal(number, requests.put_off) for number in handled}
    try:
        yield requests
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
