"""The kernels and steppers in NumPy: the reference that the compiled core is held to."""
