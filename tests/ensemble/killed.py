"""A task for spawned processes, as users get them. Each imports the module of its task; this one is light."""

import os
import signal
from pathlib import Path


def kills(marker: str) -> int:
    """Kill this process the first time, when there is no file `marker`; return 7 afterwards."""
    if not os.path.exists(marker):
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 7
