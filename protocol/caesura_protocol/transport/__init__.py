"""The network as both sides use it: Zenoh, and its twin in memory."""
