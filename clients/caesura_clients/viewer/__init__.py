"""Shows a live session in third-party viewers. Data flows one way: a viewer changes nothing."""
