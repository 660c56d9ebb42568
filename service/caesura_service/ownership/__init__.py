"""The stations and sessions that an instance holds, and how it takes them over."""
