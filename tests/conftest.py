"""Random examples: thirty a property, so that all of the tests are quick; `make test ARGS=--hypothesis-profile=default`
has a hundred. Where a property says how many, that many.
"""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("quick", max_examples=30, deadline=None)
settings.load_profile("quick")
