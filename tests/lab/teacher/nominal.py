"""One simulation of every scenario serves all tests that look at the thesis' person.

Not in conftest.py: pytest and who imports from there have a module each, and so a simulation each.
"""

from functools import cache

from caesura_lab.teacher.simulated_teaching import teach

nominal_once = cache(teach)
