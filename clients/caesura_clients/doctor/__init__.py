"""Diagnosis of everything between a robot and its segments, with a remedy for each fault.

`endpoint_check` connects to the endpoint, and `probes` queries and listens for a few seconds. The other
modules judge these facts and are pure: `service_checks` the service, `stations` each station, `signal` the
samples.
"""

from caesura_clients.doctor.findings import CheckResult, Grade
from caesura_clients.doctor.run_checks import examine, examine_recording

__all__ = ["CheckResult", "Grade", "examine", "examine_recording"]
