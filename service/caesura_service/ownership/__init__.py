"""The stations and sessions that an instance owns, and how it takes them over."""
