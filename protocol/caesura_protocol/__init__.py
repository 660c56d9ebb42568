"""The wire of Caesura: keys, messages, codec and errors. Needs pydantic, msgpack and numpy, nothing else."""
