"""Diagnosis of everything between a robot and its segments, with a remedy for each fault.

`reach` looks at the endpoint, `probed` asks and listens for a few seconds; everything else only judges what
they brought and is pure: `instances` the service, `stations` each station, `signal` the samples themselves.
"""

from caesura_clients.doctor.findings import CheckResult, Grade
from caesura_clients.doctor.run_checks import examine, examine_recording

__all__ = ["CheckResult", "Grade", "examine", "examine_recording"]
