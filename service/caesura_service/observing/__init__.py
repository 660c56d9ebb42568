"""What an operator sees of a running service: numbers for Prometheus, health, and logs."""
