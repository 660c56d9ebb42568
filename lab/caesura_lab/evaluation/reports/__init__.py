"""Reports of scores: tables, typical errors, calibration and its diagram."""
