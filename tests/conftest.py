"""Random examples: thirty a property, so that all of the tests are quick, unless a property says otherwise.

`make test ARGS=--hypothesis-profile=default` has a hundred.
"""

from __future__ import annotations

from hypothesis import Phase, settings

settings.register_profile("quick", max_examples=30, deadline=None)
settings.register_profile(  # for `make mutations`: whether it fails, not how little it takes
    "unshrunk", max_examples=30, deadline=None, derandomize=True, phases=(Phase.explicit, Phase.generate)
)
settings.load_profile("quick")
