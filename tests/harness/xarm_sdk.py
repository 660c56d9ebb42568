"""The maker's SDK of the xArm, imported so that it writes into no home folder.

At its import it makes a folder for its log in the home folder. Two processes of a test run that import it at
once on a new machine fail: one makes the folder between the other's look and the other's making it.
"""

from __future__ import annotations

import os
import tempfile
from functools import cache
from importlib import import_module

import pytest

from harness.once import RUN


@cache
def xarm_api() -> type:
    """The SDK's `XArmAPI`. A test without the SDK is skipped."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", tempfile.mkdtemp(dir=os.environ.get(RUN)))
        try:
            api: type = import_module("xarm.wrapper").XArmAPI
        except ModuleNotFoundError:
            pytest.skip("xarm-python-sdk is not installed")
        return api
