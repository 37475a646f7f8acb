# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""The attributes of a linear Kalman filter, read before a step and written after it.

A filter keeps its state in plain attributes, which anybody may assign or write into at any time.
So a step reads all of them, and does what it can only where they are usual: numbers in arrays of
the right shape.  Anything else is left to Python, which converts it, or says what is wrong.

A new value is written into the array of the old one if nobody else holds that array, for a new
array costs more than the arithmetic that fills it.  Otherwise the attribute gets a new array.
"""

from cpython.dict cimport PyDict_GetItemWithError, PyDict_SetItem
from cpython.float cimport PyFloat_AS_DOUBLE, PyFloat_Check
from cpython.list cimport PyList_CheckExact, PyList_GET_ITEM, PyList_GET_SIZE
from cpython.long cimport PyLong_AsDouble, PyLong_AsLong, PyLong_CheckExact
from cpython.object cimport PyObject
from cpython.ref cimport Py_DECREF, Py_INCREF
from libc.math cimport isfinite, isnan
from libc.string cimport memcpy, memset

from fuzzykf.engine.compiled.kalman cimport FK_KALMAN_LARGEST, fk_kalman, fk_kalman_inverse

cimport numpy as cnp

import numpy as np

cnp.import_array()

cdef extern from *:
    """
    /* Whether an array may be written into, because the attribute alone knows it. */
    static inline int fk_is_ours(PyObject *object) {
    #ifdef Py_GIL_DISABLED
      (void)object;
      return 0;
    #else
      PyArrayObject *array = (PyArrayObject *)object;
      return Py_REFCNT(object) == 1 && PyArray_CHKFLAGS(array, NPY_ARRAY_OWNDATA | NPY_ARRAY_CARRAY) &&
             PyArray_BASE(array) == NULL;
    #endif
    }
    static inline unsigned int fk_version_of(PyTypeObject *type) { return type->tp_version_tag; }
    """
    bint fk_is_ours(PyObject *) noexcept
    unsigned int fk_version_of(type) noexcept

cdef object numpy_inverse = np.linalg.inv


# ------------------------------------------------------------------------------ what is usual

# Which classes leave the verbs as they are is asked once for every version of a class: Python
# gives a class a new number whenever it, or one of its bases, is changed.
cdef unsigned int known_versions[64]
cdef int known_answers[64]
memset(known_versions, 0, sizeof(known_versions))


cdef int overrides(object filter_) except -1:
    """What the class of a filter has changed; see `fuzzykf.kalman.stepper.LinearStepper`."""
    cdef unsigned int version = fk_version_of(type(filter_))
    cdef unsigned int k = version & 63
    cdef int answer
    if version != 0 and known_versions[k] == version:
        return known_answers[k]
    ask = getattr(type(filter_), "_overrides", None)
    answer = 3 if ask is None else ask()
    version = fk_version_of(type(filter_))  # which is given when the class is first looked at
    known_versions[version & 63] = version
    known_answers[version & 63] = answer
    return answer


cdef int is_plain(object filter_, dict d, bint verbs) except -1:
    """Whether a filter does what its class says, with an inverse of its own making.

    With ``verbs`` this includes predict and update themselves, without it only what they call.
    """
    if overrides(filter_) & (3 if verbs else 1):
        return 0
    if PyDict_GetItemWithError(d, "inv") != <PyObject *> numpy_inverse:
        return 0
    if PyDict_GetItemWithError(d, "get_prediction") != NULL:
        return 0
    return not (verbs and has_own_verbs(d))


cdef int has_own_verbs(dict d) except -1:
    """Whether predict or update has been replaced in one object."""
    return PyDict_GetItemWithError(d, "predict") != NULL or PyDict_GetItemWithError(d, "update") != NULL


cdef int is_begun(dict d) except -1:
    """Whether the state to which `reset` returns has been kept."""
    return PyDict_GetItemWithError(d, "_origin") != NULL


cdef inline int integer(PyObject *value) except -2:
    """A dimension that is covered here, or 0."""
    cdef long number
    if value == NULL or not PyLong_CheckExact(<object> value):
        return 0
    number = PyLong_AsLong(<object> value)
    return <int> number if 0 < number <= FK_KALMAN_LARGEST else 0


cdef int numbers(cnp.ndarray a, Py_ssize_t rows, Py_ssize_t columns, double *to) noexcept:
    """Copy a matrix of numbers, whatever its strides; 0 where its type is not usual."""
    cdef const char *start = <const char *> cnp.PyArray_DATA(a)
    cdef Py_ssize_t i, j, down = cnp.PyArray_STRIDE(a, 0), right = 0
    cdef int kind = cnp.PyArray_TYPE(a)
    if not cnp.PyArray_ISBEHAVED_RO(a):
        return 0
    if cnp.PyArray_NDIM(a) == 2:
        right = cnp.PyArray_STRIDE(a, 1)
    for i in range(rows):
        for j in range(columns):
            if kind == cnp.NPY_DOUBLE:
                to[i * columns + j] = (<const double *> (start + i * down + j * right))[0]
            elif kind == cnp.NPY_LONG:
                to[i * columns + j] = (<const long *> (start + i * down + j * right))[0]
            elif kind == cnp.NPY_INT:
                to[i * columns + j] = (<const int *> (start + i * down + j * right))[0]
            else:
                return 0
    return 1


cdef inline const double *matrix(PyObject *value, int rows, int columns, double *copy) noexcept:
    """The numbers of a matrix, where they are or in ``copy``; NULL where Python has to look at it."""
    cdef cnp.ndarray a
    if value == NULL or not cnp.PyArray_CheckExact(<object> value):
        return NULL
    a = <cnp.ndarray> value
    if cnp.PyArray_NDIM(a) != 2 or cnp.PyArray_DIM(a, 0) != rows or cnp.PyArray_DIM(a, 1) != columns:
        return NULL
    if cnp.PyArray_TYPE(a) == cnp.NPY_DOUBLE and cnp.PyArray_ISCARRAY_RO(a):
        return <const double *> cnp.PyArray_DATA(a)
    return copy if numbers(a, rows, columns, copy) else NULL


cdef inline const double *square(PyObject *value, int n, double *copy) noexcept:
    """`matrix`, or a number, which stands for that multiple of the identity."""
    cdef double number
    cdef int i
    if value != NULL and PyFloat_Check(<object> value):
        number = PyFloat_AS_DOUBLE(<object> value)
        memset(copy, 0, n * n * sizeof(double))
        for i in range(n):
            copy[i * n + i] = number
        return copy
    return matrix(value, n, n, copy)


cdef int read_state(dict d, Member *member) except -1:
    """Read the dimensions, x and P; 0 where they are not usual."""
    cdef fk_kalman *f = &member.f
    cdef const double *P
    cdef PyObject *value
    cdef cnp.ndarray x
    f.n = integer(PyDict_GetItemWithError(d, "dim_x"))
    f.m = integer(PyDict_GetItemWithError(d, "dim_z"))
    value = PyDict_GetItemWithError(d, "x")
    if f.n == 0 or f.m == 0 or value == NULL or not cnp.PyArray_CheckExact(<object> value):
        return 0
    x = <cnp.ndarray> value
    member.flat = cnp.PyArray_NDIM(x) == 1
    if cnp.PyArray_NDIM(x) not in (1, 2) or cnp.PyArray_DIM(x, 0) != f.n:
        return 0
    if not member.flat and cnp.PyArray_DIM(x, 1) != 1:
        return 0
    if not numbers(x, f.n, 1, f.x):
        return 0
    P = square(PyDict_GetItemWithError(d, "P"), f.n, f.P)
    if P == NULL:
        return 0
    if P != f.P:
        memcpy(f.P, P, f.n * f.n * sizeof(double))
    return 1


cdef int read_motion(dict d, Member *member) except -1:
    """Read F, Q and alpha; 0 where they are not usual."""
    cdef fk_kalman *f = &member.f
    cdef PyObject *alpha_sq = PyDict_GetItemWithError(d, "_alpha_sq")
    f.F = matrix(PyDict_GetItemWithError(d, "F"), f.n, f.n, member.F)
    f.Q = square(PyDict_GetItemWithError(d, "Q"), f.n, member.Q)
    if f.F == NULL or f.Q == NULL or alpha_sq == NULL or not PyFloat_Check(<object> alpha_sq):
        return 0
    f.alpha_sq = PyFloat_AS_DOUBLE(<object> alpha_sq)
    return 1


cdef int read_observation(dict d, Member *member) except -1:
    """Read H and R; 0 where they are not usual."""
    cdef fk_kalman *f = &member.f
    f.H = matrix(PyDict_GetItemWithError(d, "H"), f.m, f.n, member.H)
    f.R = square(PyDict_GetItemWithError(d, "R"), f.m, member.R)
    return f.H != NULL and f.R != NULL


cdef inline int whole_number(object z, double *value) except -1:
    """Read a whole number; 0 where it is too large for a float, of which the general way tells."""
    try:
        value[0] = PyLong_AsDouble(z)
    except OverflowError:
        return 0
    return 1


cdef int read_z(object z, int m, double *values) except -1:
    """Read an observation; 0 where it is incomplete or not usual."""
    cdef cnp.ndarray a
    cdef int i
    cdef PyObject *item
    if PyFloat_Check(z):
        values[0] = PyFloat_AS_DOUBLE(z)
        return m == 1 and isfinite(values[0])
    if PyLong_CheckExact(z):
        return m == 1 and whole_number(z, values)
    if cnp.PyArray_CheckExact(z):
        a = <cnp.ndarray> z
        if cnp.PyArray_NDIM(a) == 1 and cnp.PyArray_DIM(a, 0) == m:
            if not numbers(a, m, 1, values):
                return 0
        elif cnp.PyArray_NDIM(a) == 2 and cnp.PyArray_DIM(a, 0) == m and cnp.PyArray_DIM(a, 1) == 1:
            if not numbers(a, m, 1, values):
                return 0
        else:
            return 0
    elif PyList_CheckExact(z) and PyList_GET_SIZE(z) == m:
        for i in range(m):
            item = <PyObject *> PyList_GET_ITEM(z, i)
            if PyFloat_Check(<object> item):
                values[i] = PyFloat_AS_DOUBLE(<object> item)
            elif PyLong_CheckExact(<object> item):
                if not whole_number(<object> item, values + i):
                    return 0
            else:
                return 0
    else:
        return 0
    for i in range(m):
        if not isfinite(values[i]):
            return 0
    return 1


cdef int is_missing(object z, int m) except -1:
    """Whether nothing of an observation is there; 0 as well where that is for the general way to tell."""
    cdef double values[FK_KALMAN_LARGEST]
    cdef cnp.ndarray a
    cdef int i
    if z is None:
        return 1
    if PyFloat_Check(z):
        return m == 1 and isnan(PyFloat_AS_DOUBLE(z))
    if not cnp.PyArray_CheckExact(z):
        return 0
    a = <cnp.ndarray> z
    i = cnp.PyArray_NDIM(a)
    if not (
        (i == 1 or (i == 2 and cnp.PyArray_DIM(a, 1) == 1)) and cnp.PyArray_DIM(a, 0) == m and numbers(a, m, 1, values)
    ):
        return 0
    for i in range(m):
        if not isnan(values[i]):
            return 0
    return 1


# ------------------------------------------------------------------------------ what is written


cdef void entry(Entry *e, str name, const double *values, int rows, int columns) noexcept:
    e.name, e.values, e.rows, e.columns, e.array = <PyObject *> name, values, rows, columns, NULL


cdef int prior_entries(Member *member, Entry *entries, bint state) noexcept:
    """What a prediction writes; its x and P only with ``state``, for an update may follow."""
    cdef fk_kalman *f = &member.f
    cdef int n = f.n, column = 0 if member.flat else 1
    entry(entries, "x_prior", f.x_prior, n, column)
    entry(entries + 1, "P_prior", f.P_prior, n, n)
    if not state:
        return 2
    entry(entries + 2, "x", f.x_prior, n, column)
    entry(entries + 3, "P", f.P_prior, n, n)
    return 4


cdef int posterior_entries(Member *member, Entry *entries) noexcept:
    """What an update writes."""
    cdef fk_kalman *f = &member.f
    cdef int n = f.n, m = f.m, column = 0 if member.flat else 1
    fk_kalman_inverse(f, member.SI)
    entry(entries, "x", f.x, n, column)
    entry(entries + 1, "P", f.P, n, n)
    entry(entries + 2, "x_post", f.x, n, column)
    entry(entries + 3, "P_post", f.P, n, n)
    entry(entries + 4, "z", member.z, m, column)
    entry(entries + 5, "y", f.y, m, column)
    entry(entries + 6, "S", f.S, m, m)
    entry(entries + 7, "SI", member.SI, m, m)
    entry(entries + 8, "K", f.K, n, m)
    return 9


cdef double NO_INNOVATION[FK_KALMAN_LARGEST]
memset(NO_INNOVATION, 0, sizeof(NO_INNOVATION))


cdef int skip_entries(Member *member, Entry *entries) noexcept:
    """What an update without an observation writes."""
    cdef fk_kalman *f = &member.f
    cdef int n = f.n, column = 0 if member.flat else 1
    entry(entries, "x", f.x_prior, n, column)
    entry(entries + 1, "P", f.P_prior, n, n)
    entry(entries + 2, "x_post", f.x_prior, n, column)
    entry(entries + 3, "P_post", f.P_prior, n, n)
    entry(entries + 4, "y", NO_INNOVATION, f.m, column)
    return 5


cdef int skip(dict d, Member *member, Entry *entries, int count) except -1:
    """Write entries and those of an update without an observation, as `GaussianFilter._skip` does."""
    cdef cnp.npy_intp shape[2]
    cdef cnp.ndarray z
    shape[0], shape[1] = member.f.m, 1
    z = cnp.PyArray_SimpleNew(1 if member.flat else 2, shape, cnp.NPY_OBJECT)
    z.fill(None)
    count += skip_entries(member, entries + count)
    reserve(d, entries, count)
    commit(d, entries, count)
    PyDict_SetItem(d, "z", z)
    PyDict_SetItem(d, "_log_likelihood", 0.0)
    PyDict_SetItem(d, "_likelihood", 1.0)
    PyDict_SetItem(d, "_mahalanobis", 0.0)
    return 0


cdef void release(Entry *entries, int count) noexcept:
    cdef int k
    for k in range(count):
        if entries[k].array != NULL:
            Py_DECREF(<object> entries[k].array)
            entries[k].array = NULL


cdef int reserve(dict d, Entry *entries, int count) except -1:
    """Find or make the arrays for all entries; an error leaves everything as it was."""
    cdef int k
    cdef Entry *e
    cdef PyObject *old
    cdef cnp.npy_intp shape[2]
    cdef cnp.ndarray a
    cdef object made
    for k in range(count):
        e = entries + k
        old = PyDict_GetItemWithError(d, <object> e.name)
        if old != NULL and cnp.PyArray_CheckExact(<object> old):
            if fk_is_ours(old):
                a = <cnp.ndarray> old
                if (
                    cnp.PyArray_TYPE(a) == cnp.NPY_DOUBLE and cnp.PyArray_DIM(a, 0) == e.rows
                    and cnp.PyArray_NDIM(a) == (2 if e.columns else 1)
                    and (e.columns == 0 or cnp.PyArray_DIM(a, 1) == e.columns)
                ):
                    Py_INCREF(a)
                    e.array, e.is_new = old, False
                    continue
        shape[0], shape[1] = e.rows, e.columns
        try:
            made = cnp.PyArray_SimpleNew(2 if e.columns else 1, shape, cnp.NPY_DOUBLE)
        except BaseException:
            release(entries, k)
            raise
        Py_INCREF(made)
        e.array, e.is_new = <PyObject *> made, True
    return 0


cdef int commit(dict d, Entry *entries, int count) except -1:
    """Write all entries."""
    cdef int k
    cdef Entry *e
    for k in range(count):
        e = entries + k
        memcpy(
            cnp.PyArray_DATA(<cnp.ndarray> e.array), e.values, e.rows * max(e.columns, 1) * sizeof(double)
        )
        if e.is_new:
            PyDict_SetItem(d, <object> e.name, <object> e.array)
    release(entries, count)
    return 0


cdef int forget(dict d, str name) except -1:
    if PyDict_GetItemWithError(d, name) != <PyObject *> None:
        PyDict_SetItem(d, name, None)
    return 0


cdef int forget_likelihoods(dict d) except -1:
    """Set them to None: they are computed when they are read."""
    forget(d, "_log_likelihood")
    forget(d, "_likelihood")
    forget(d, "_mahalanobis")
    return 0
