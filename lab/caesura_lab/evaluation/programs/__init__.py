"""Programs judged by running them: round trips, and mutated programs."""
