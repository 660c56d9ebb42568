"""What was found in a recording, for somebody to look at: gathered, then drawn, then written."""
