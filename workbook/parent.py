"""The make that started this process: what it started ends with it, in whatever way it ends."""

import os
import threading
import time
from pathlib import Path


def make_lives() -> bool:
    """Whether the make that MAKE_PID names lives, and is no zombie; True where none is named."""
    process = int(os.environ.get("MAKE_PID", 0))
    try:
        os.kill(process, 0)  # of 0, this process's own group
        state = Path(f"/proc/{process or 'self'}/stat").read_text()
    except ProcessLookupError:
        return False
    except OSError:  # no /proc, or another user's
        return True
    return ") Z " not in state


def end_with_make() -> None:
    """End this process when make ends without waiting for it, even if nobody has waited for make."""

    def watch() -> None:
        while make_lives():
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
