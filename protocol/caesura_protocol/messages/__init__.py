"""All messages on the wire, as frozen models. Each field states its shape and unit.

Times are seconds on the session's clock, positions metres in the base frame, forces newtons of the
environment on the robot, in the base frame. Readers ignore unknown header fields.
"""

from caesura_protocol.messages.apps import *
from caesura_protocol.messages.bridge_control import *
from caesura_protocol.messages.command_and_reply import *
from caesura_protocol.messages.corrections import *
from caesura_protocol.messages.field_types import *
from caesura_protocol.messages.limits import *
from caesura_protocol.messages.message import *
from caesura_protocol.messages.program import *
from caesura_protocol.messages.program_edits import *
from caesura_protocol.messages.results import *
from caesura_protocol.messages.samples import *
from caesura_protocol.messages.session_and_service_status import *
from caesura_protocol.messages.session_commands import *
from caesura_protocol.messages.snapshot import *
