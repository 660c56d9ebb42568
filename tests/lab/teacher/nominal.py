"""One simulation of every scenario serves all tests that look at the thesis' person, in every process.

Not in conftest.py: pytest and who imports from there have a module each, and so a simulation each.
"""

from caesura_lab.teacher.simulated_teaching import teach
from harness.once import once_a_run

nominal_once = once_a_run(teach)
