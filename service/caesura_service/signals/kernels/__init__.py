"""The arithmetic of conditioning, compiled: that of `numpy_operations.py`, under the same names.

Every function releases the interpreter, allocates nothing and fills the last array that it is given. Arrays
must be contiguous and writeable, so that each function is compiled for one type of array.
"""
