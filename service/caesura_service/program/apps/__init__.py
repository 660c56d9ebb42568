"""Builds the apps of a program from interpreted segments, each with its path."""
