"""Monitoring of a running service: Prometheus metrics, health, and logs."""
