"""Answers queries for the samples of a session from the journal, decimated to the width of a plot."""

from caesura_service.decimation.reader import SampleReader

__all__ = ["SampleReader"]
