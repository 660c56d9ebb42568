"""Random examples: thirty a property, so that all of the tests are quick, unless a property says otherwise.

`make test ARGS=--hypothesis-profile=default` has a hundred.
"""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("quick", max_examples=30, deadline=None)
settings.load_profile("quick")
