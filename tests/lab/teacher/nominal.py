"""One simulation serves all tests that look at the same person and scenario, in every process and run.

Not in conftest.py: pytest and who imports from there have a module each, and so a simulation each.
"""

from caesura_lab.teacher.simulated_teaching import teach
from harness.once import once_a_version

nominal_once = once_a_version(teach)
