"""The arithmetic of one step of the filter, compiled.

The reference is `run_length_filter.py`, `evidence_window.py` and the channel models. Every function releases
the interpreter, allocates nothing and works on the arrays of `layout.py`, which `model_set_conversion.py`
fills.
"""
