cdef int level  # of the instruction set in use: 0 is portable
