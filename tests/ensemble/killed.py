"""A task for processes as users get them: each imports the module of its task, which here is light."""

import os
import signal
from pathlib import Path


def kills(marker: str) -> int:
    """Kills its process the first time."""
    if not os.path.exists(marker):
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 7
