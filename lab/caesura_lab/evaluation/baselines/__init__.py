"""Methods of other authors, with their signals, features and settings."""
