"""The numeric kernels behind recursion and propagation, in NumPy.

Functions on flat arrays, without checks: their callers own shapes, validity and
missing data.  A compiled twin of each may take its place here.
"""
