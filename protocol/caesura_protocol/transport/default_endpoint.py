"""Endpoints of clients, separate from the transports, whose import takes a second."""

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
ENDPOINT_VARIABLE = "CAESURA_CONNECT"  # of the environment: the endpoint where none is given
