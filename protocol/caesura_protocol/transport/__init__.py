"""The network interface of clients and service: Zenoh, and an implementation in memory."""
