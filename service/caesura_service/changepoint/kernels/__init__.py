"""The arithmetic of one step of the filter, compiled.

It is that of `online.py`, `window.py` and the channel models, which stay the reference. Every function
releases the interpreter, allocates nothing and works on the arrays of `layout.py`, which `describe.py` fills.
"""
