"""The protocol of Caesura: keys, messages, codec and errors. It needs only pydantic, msgpack and numpy."""
