"""What was taught, for other people's tools."""
