"""Interprets segments by their neighbours: what was pressed, carried, set down, or moved in one stroke."""
