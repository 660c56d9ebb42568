"""Bayesian online changepoint detection with segment models that classify. Pure: arrays in, arrays out."""
