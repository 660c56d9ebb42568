"""The maker's SDK of the xArm, imported so that it writes into no home folder.

At its import it makes a folder for its log in the home folder. Two processes of a test run that import it at
once on a new machine fail: one makes the folder between the other's look and the other's making it.
"""

from __future__ import annotations

import os
import tempfile
from functools import cache
from importlib import import_module
from typing import Any
from unittest.mock import Mock, create_autospec

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


class RecordedApi:
    """The SDK's methods with their signatures; each returns 0 unless a test says otherwise.

    `create_autospec` of the class makes all 271 of them for each arm, which takes as long as a test.
    """

    def __init__(self) -> None:
        self._calls = Mock()

    def __getattr__(self, name: str) -> Any:
        method = getattr(xarm_api(), name)  # what the SDK lacks is an AttributeError
        if not callable(method):
            raise AssertionError(f"{name}: a test states what it is")
        made = create_autospec(method.__get__(object()), return_value=0)
        self._calls.attach_mock(made, name)
        setattr(self, name, made)
        return made

    @property
    def mock_calls(self) -> list[Any]:
        """All calls in their order."""
        return list(self._calls.mock_calls)
