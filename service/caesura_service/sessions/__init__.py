"""One session: its lifecycle, the order of its batches, its journal."""
