"""One demonstration after another, sans I/O: messages in, typed outputs out. No zenoh, clock or thread."""
