"""Work for processes that others end. They import this module and no other: each took a second of CPU."""

from __future__ import annotations

import os
import threading
from pathlib import Path


def never_ends(folder: Path) -> None:
    """Work that says which process does it, and goes on."""
    (folder / str(os.getpid())).touch()
    threading.Event().wait()
