"""A package, so that pytest closes the browser of its tests after the last of them."""
