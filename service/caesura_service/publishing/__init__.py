"""The results that a session publishes: its state, its messages and its events."""
