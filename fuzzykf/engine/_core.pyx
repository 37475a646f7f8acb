# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""The compiled twins of the kernels of `fuzzykf.engine`: signatures and meaning are theirs.

Arrays of any type and stride are converted, wrong shapes are refused; the arithmetic is in
``src/``.  The interpreter lock is released wherever a whole series is at work.
"""

from cpython.float cimport PyFloat_AS_DOUBLE, PyFloat_Check
from libc.math cimport isfinite
from libc.stdint cimport uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memmove, memset

cimport numpy as cnp

import numpy as np

cnp.import_array()

cdef extern from "src/series.h" nogil:
    ctypedef struct fk_kernel:
        int M1, M2, m, q, w, blocks, stride, is_signed, is_scalar
        double *cells
        double *mask
    ctypedef struct fk_summary:
        int stride
        const double *cells
        const double *twice
        const double *noise
        const double *nodes
        const double *weights
        const unsigned char *atoms
    ctypedef struct fk_state:
        double *table
        double *sign
        int linear, log_known
        double total
    ctypedef struct fk_output:
        double *x
        double *P
        double *x_prior
        double *P_prior
        double *mu
        double *modes
        double *means
        double *log_likelihood
    ctypedef struct fk_engine:
        const char *instructions
        void (*log_pairs)(const fk_kernel *, const double *, double *) noexcept nogil
        void (*posterior)(int, int, const double *, const double *, double *, double *) noexcept nogil
        int (*forward_backward)(
            int, int, const double *, const double *, const double *, double *, double *, double *, double *
        ) noexcept nogil
    const fk_engine *fk_engines
    int fk_levels() noexcept
    int fk_padded(int) noexcept
    size_t fk_table_size(int, int) noexcept
    size_t fk_scratch_size(int, int) noexcept
    int fk_cell_size(int, int, int) noexcept
    void fk_fill(
        fk_kernel *, int, int, double, const double *, const double *, const double *, const double *,
        const double *, const double *, const double *, const double *
    ) noexcept
    double fk_first(
        int, int, int, const double *, const double *, const double *, const double *, const double *,
        double *, int, double *
    ) noexcept
    void fk_forward_backward_logs(
        int, int, const double *, const double *, const double *, double *, double *, double *, double *
    ) noexcept
    double fk_log_likelihood(const fk_state *) noexcept
    void fk_to_logs(fk_state *, int) noexcept
    const double *fk_probabilities(const fk_engine *, const fk_state *, int, double *) noexcept
    void fk_advance(const fk_engine *, const fk_kernel *, fk_state *, fk_state *, const double *, double *) noexcept
    void fk_summarise(
        const fk_engine *, const fk_summary *, const fk_state *, int, int, size_t, const fk_output *, double *,
        double *
    ) noexcept
    int fk_filter(
        const fk_engine *, const fk_kernel *, const fk_summary *, fk_state *, fk_state *, const double *, size_t,
        const fk_output *, size_t, double *, double *, double *
    ) noexcept


cdef const fk_engine *engine = &fk_engines[fk_levels() - 1]


def instructions():
    """Name of the set of instructions in use."""
    return engine.instructions.decode()


def available_instructions():
    """Names of the sets that this processor can run, the best one last."""
    return tuple(fk_engines[k].instructions.decode() for k in range(fk_levels()))


def use_instructions(str name):
    """Choose another set, for tests and measurements; it holds for the whole process."""
    global engine
    for k in range(fk_levels()):
        if fk_engines[k].instructions.decode() == name:
            engine = &fk_engines[k]
            return
    raise ValueError(f"name: got {name!r}, expected one of {available_instructions()}")


# --------------------------------------------------------------------------- memory


cdef class Buffer:
    """Zeros at an address that is a multiple of 64."""

    cdef void *raw
    cdef double *data

    def __cinit__(self, size_t size):
        self.raw = calloc(size * sizeof(double) + 64, 1)
        if self.raw == NULL:
            raise MemoryError
        self.data = <double *> ((<uintptr_t> self.raw + 63) // 64 * 64)

    def __dealloc__(self):
        free(self.raw)


cdef cnp.ndarray doubles(object value, str name, tuple shape):
    """Return a contiguous array of doubles of this shape, which may be ``value`` itself; -1 admits any."""
    cdef cnp.ndarray array
    cdef int k
    cdef int expected = <int> len(shape)
    array = cnp.PyArray_FROMANY(value, cnp.NPY_DOUBLE, 0, 0, cnp.NPY_ARRAY_CARRAY_RO | cnp.NPY_ARRAY_FORCECAST)
    if cnp.PyArray_NDIM(array) == expected:
        for k in range(expected):
            if shape[k] != -1 and cnp.PyArray_DIM(array, k) != <Py_ssize_t> shape[k]:
                break
        else:
            return array
    raise ValueError(f"{name}: got shape {np.shape(array)}, expected {shape}")


cdef inline double *at(cnp.ndarray array) noexcept:
    return <double *> cnp.PyArray_DATA(array)


cdef inline double *at_or_null(object array) noexcept:
    return NULL if array is None else <double *> cnp.PyArray_DATA(<cnp.ndarray> array)


cdef void load(double *to, const double *source, int rows, int M) noexcept nogil:
    """Spread the rows of a table (rows, M) over whole vectors."""
    cdef int r
    for r in range(rows):
        memcpy(to + r * fk_padded(M), source + r * M, M * sizeof(double))


cdef void store(double *to, const double *source, int rows, int M) noexcept nogil:
    cdef int r
    for r in range(rows):
        memcpy(to + r * M, source + r * fk_padded(M), M * sizeof(double))


cdef class Workspace:
    """Two states that change places, and room for the arithmetic of a step."""

    cdef Buffer memory
    cdef fk_state one, two
    cdef double *p
    cdef double *x
    cdef double *scratch

    def __cinit__(self, Kernel kernel):
        cdef fk_kernel *k = &kernel.k
        cdef int M = max(k.M1, k.M2)
        cdef size_t table = fk_table_size(M, k.m), row = fk_padded(M)
        cdef size_t moments = fk_padded(k.m + k.m * k.m)
        self.memory = Buffer(2 * table + 3 * row + moments + fk_scratch_size(M, k.m))
        cdef double *data = self.memory.data
        self.one.table, self.two.table = data, data + table
        data += 2 * table
        if k.is_signed:
            self.one.sign, self.two.sign = data, data + row
        self.p = data + 2 * row
        self.x = data + 3 * row
        self.scratch = data + 3 * row + moments


# --------------------------------------------------------------------------- tables


cdef class Kernel:
    """Tables of one step in the layout of the compiled core; see `fuzzykf.engine.switching.Kernel`."""

    cdef fk_kernel k
    cdef Buffer memory

    @property
    def shape(self):
        """M1, M2, m, q."""
        return self.k.M1, self.k.M2, self.k.m, self.k.q

    def __copy__(self):
        return self

    def __deepcopy__(self, memo):
        return self

    def __reduce__(self):
        raise TypeError("the tables of the compiled core are made anew, not pickled")


def pack(transition, factor, Axx, H, G, c, C, Ayy, Ny):
    cdef int M1, M2, m, q, w, i, j, size, blocks, r
    if np.ndim(transition) != 2 or np.ndim(H) != 4 or np.ndim(G) != 4:
        raise ValueError("transition, H, G: expected arrays of 2, 4 and 4 axes")
    M1, M2 = np.shape(transition)
    m, w, q = np.shape(H)[2], np.shape(H)[3], np.shape(G)[3]
    if min(M1, M2, m, q, w) < 1:
        raise ValueError(f"expected at least one node, state and observation, got {(M1, M2, m, q, w)}")
    cdef cnp.ndarray t = doubles(transition, "transition", (M1, M2))
    cdef cnp.ndarray f_ = doubles(factor, "factor", (M1, M2, q, q)), A_ = doubles(Axx, "Axx", (M1, M2, m, m))
    cdef cnp.ndarray H_ = doubles(H, "H", (M1, M2, m, w)), G_ = doubles(G, "G", (M1, M2, m, q))
    cdef cnp.ndarray c_ = doubles(c, "c", (M1, M2, m)), C_ = doubles(C, "C", (M1, M2, m, m))
    cdef cnp.ndarray Y_ = doubles(Ayy, "Ayy", (M1, M2, q, w)), N_ = doubles(Ny, "Ny", (M1, M2, q))
    cdef Kernel kernel = Kernel.__new__(Kernel)
    cdef fk_kernel *k = &kernel.k
    blocks, size = fk_padded(M2) // 8, fk_cell_size(m, q, w)
    kernel.memory = Buffer((<size_t> M1 * blocks * size + blocks) * 8)
    k.M1, k.M2, k.m, k.q, k.w, k.blocks, k.stride = M1, M2, m, q, w, blocks, size
    k.is_signed = bool((np.asarray(t) < 0.0).any())
    k.is_scalar = m == 1 and q == 1 and w == 1 and not k.is_signed
    k.cells = kernel.memory.data
    cdef double *mask = kernel.memory.data + <size_t> M1 * blocks * size * 8
    k.mask = mask
    for j in range(M2):
        mask[j] = 1.0
    for i in range(M1):
        for j in range(M2):
            r = i * M2 + j
            fk_fill(
                k, i, j, at(t)[r], at(f_) + r * q * q, at(A_) + r * m * m, at(H_) + r * m * w,
                at(G_) + r * m * q, at(c_) + r * m, at(C_) + r * m * m, at(Y_) + r * q * w, at(N_) + r * q
            )
    return kernel


cdef class Summary:
    """What the moments before an observation and the estimate of the switch need."""

    cdef fk_summary s
    cdef Buffer memory
    cdef cnp.ndarray nodes, weights, atoms

    def __cinit__(self, Kernel kernel, transition, offset, twice, noise, nodes, weights, atoms):
        cdef fk_kernel *k = &kernel.k
        cdef int M1 = k.M1, M2 = k.M2, m = k.m, w = k.w, size = 1 + m * (1 + w), i, j, r, t
        cdef cnp.ndarray T = doubles(transition, "transition", (M1, M2))
        cdef cnp.ndarray b = doubles(offset, "offset", (1 + w, M1 * M2 * m))
        cdef double *cell
        cdef cnp.ndarray twice_ = doubles(twice, "twice", (M1 * m * m, m * m))
        cdef cnp.ndarray noise_ = doubles(noise, "noise", (M1, m * m))
        cdef size_t cells = <size_t> M1 * k.blocks * size * 8, ld = fk_padded(M1)
        cdef double *to_noise
        cdef double *to_twice
        self.nodes, self.weights = doubles(nodes, "nodes", (M2,)), doubles(weights, "weights", (M2,))
        self.atoms = np.array(atoms, dtype=np.uint8)
        if self.atoms.shape[0] != M2:
            raise ValueError(f"atoms: expected shape ({M2},)")
        self.memory = Buffer(cells + (m * m + m * m * m * m) * ld)
        to_noise = self.memory.data + cells
        to_twice = to_noise + m * m * ld
        for i in range(M1):
            for r in range(m * m):
                to_noise[r * ld + i] = at(noise_)[i * m * m + r]
                for t in range(m * m):
                    to_twice[(t * m * m + r) * ld + i] = at(twice_)[(i * m * m + t) * m * m + r]
        for i in range(M1):
            for j in range(M2):
                cell = self.memory.data + (<size_t> i * k.blocks + j // 8) * size * 8 + j % 8
                cell[0] = at(T)[i * M2 + j]
                for r in range(m):
                    for t in range(1 + w):
                        cell[8 * (1 + r * (1 + w) + t)] = at(b)[<size_t> t * M1 * M2 * m + (i * M2 + j) * m + r]
        self.s.stride, self.s.cells = size, self.memory.data
        self.s.twice, self.s.noise = to_twice, to_noise
        self.s.nodes, self.s.weights = at(self.nodes), at(self.weights)
        self.s.atoms = <const unsigned char *> cnp.PyArray_DATA(self.atoms)


# --------------------------------------------------------------------------- kernels


def first_step(log_initial, mean, covariance, factor, y):
    cdef cnp.ndarray y_ = doubles(y, "y", (-1,))
    cdef int M = np.shape(log_initial)[0], q = <int> y_.shape[0], d = np.shape(mean)[1], m = d - q
    if M < 1 or m < 0 or q < 1:
        raise ValueError(f"expected at least one node and one observation, got {(M, m, q)}")
    cdef cnp.ndarray l_ = doubles(log_initial, "log_initial", (M,)), mean_ = doubles(mean, "mean", (M, d))
    cdef cnp.ndarray S_ = doubles(covariance, "covariance", (M, d, d)), f_ = doubles(factor, "factor", (M, q, q))
    cdef cnp.ndarray table = np.empty((1 + m + m * m, M))
    cdef Buffer scratch = Buffer(q * (1 + m))
    value = fk_first(M, m, q, at(l_), at(mean_), at(S_), at(f_), at(y_), at(table), M, scratch.data)
    return table, value


cdef int start(Workspace work, Kernel kernel, object table, object sign) except -1:
    """Put a state into the workspace."""
    cdef fk_kernel *k = &kernel.k
    cdef int rows = 1 + k.m + k.m * k.m
    cdef cnp.ndarray source = doubles(table, "table", (rows, k.M1)), signs
    load(work.one.table, at(source), rows, k.M1)
    work.one.linear = 0
    if k.is_signed:
        signs = doubles(np.ones(k.M1) if sign is None else sign, "sign", (k.M1,))
        memcpy(work.one.sign, at(signs), k.M1 * sizeof(double))
    return 0


def step(Kernel kernel not None, table, sign, window, y):
    cdef fk_kernel *k = &kernel.k
    cdef int M2 = k.M2, rows = 1 + k.m + k.m * k.m
    cdef cnp.ndarray w_ = doubles(window, "window", (k.w,)), y_ = doubles(y, "y", (k.q,)), signs
    cdef Workspace work = Workspace(kernel)
    cdef Buffer u = Buffer(1 + k.w + k.q)
    start(work, kernel, table, sign)
    u.data[0] = 1.0
    memcpy(u.data + 1, at(w_), k.w * sizeof(double))
    memcpy(u.data + 1 + k.w, at(y_), k.q * sizeof(double))
    fk_advance(engine, k, &work.one, &work.two, u.data, work.scratch)
    value = fk_log_likelihood(&work.two)
    fk_to_logs(&work.two, M2)
    cdef cnp.ndarray out = np.empty((rows, M2))
    store(at(out), work.two.table, rows, M2)
    if not k.is_signed:
        return out, None, value
    signs = np.empty(M2)
    memcpy(at(signs), work.two.sign, M2 * sizeof(double))
    return out, signs, value


def run(Kernel kernel not None, table, sign, U):
    cdef fk_kernel *k = &kernel.k
    cdef int width = 1 + k.w + k.q, M2 = k.M2, rows = 1 + k.m + k.m * k.m
    cdef cnp.ndarray u = doubles(U, "U", (-1, width))
    cdef Py_ssize_t n = u.shape[0], t
    if n > 1 and k.M1 != M2:
        raise ValueError(f"table: {k.M1} nodes become {M2}, expected as many before as after")
    cdef cnp.ndarray tables = np.empty((n, rows, M2)), log_likelihood = np.empty(n)
    cdef cnp.ndarray signs = np.empty((n, M2)) if k.is_signed else None
    cdef Workspace work = Workspace(kernel)
    start(work, kernel, table, sign)
    cdef fk_state *one = &work.one
    cdef fk_state *two = &work.two
    cdef fk_state *swap
    cdef double *to = at(tables)
    cdef double *values = at(log_likelihood)
    cdef double *to_signs = at_or_null(signs)
    cdef const double *source = at(u)
    cdef fk_state copy
    with nogil:
        for t in range(n):
            fk_advance(engine, k, one, two, source + t * width, work.scratch)
            values[t] = fk_log_likelihood(two)
            store(to + t * rows * M2, two.table, rows, M2)
            if two.linear:
                copy = two[0]
                copy.table = work.p
                memcpy(work.p, two.table, fk_padded(M2) * sizeof(double))
                fk_to_logs(&copy, M2)
                memcpy(to + t * rows * M2, work.p, M2 * sizeof(double))
            if to_signs != NULL:
                memcpy(to_signs + t * M2, two.sign, M2 * sizeof(double))
            swap = one
            one = two
            two = swap
    return tables, signs, log_likelihood


def log_pairs(Kernel kernel not None, U):
    cdef fk_kernel *k = &kernel.k
    cdef int width = 1 + k.w + k.q
    cdef cnp.ndarray u = doubles(U, "U", (-1, width))
    cdef Py_ssize_t n = u.shape[0], pairs = <Py_ssize_t> k.M1 * k.M2, t
    cdef cnp.ndarray out = np.empty((n, pairs))
    cdef double *to = at(out)
    cdef const double *source = at(u)
    with nogil:
        for t in range(n):
            engine.log_pairs(k, source + t * width, to + t * pairs)
    return out


def node_mean(p, means):
    cdef cnp.ndarray x_ = doubles(means, "means", (-1, -1))
    cdef int m = <int> x_.shape[0], M = <int> x_.shape[1], ld = fk_padded(M)
    cdef cnp.ndarray p_ = doubles(p, "p", (M,)), mean = np.empty(m)
    cdef Buffer table = Buffer(<size_t> (1 + m) * ld)
    memcpy(table.data, at(p_), M * sizeof(double))
    load(table.data + ld, at(x_), m, M)
    engine.posterior(M, m, table.data, table.data, at(mean), NULL)
    return mean


def step_many(Kernel kernel not None, table, U):
    cdef fk_kernel *k = &kernel.k
    cdef int width = 1 + k.w + k.q, M1 = k.M1, M2 = k.M2, rows = 1 + k.m + k.m * k.m
    if k.is_signed:
        raise ValueError("kernel: expected transitions without negative weights")
    cdef cnp.ndarray u = doubles(U, "U", (-1, width))
    cdef Py_ssize_t s = u.shape[0], t
    cdef cnp.ndarray tables = doubles(table, "table", (s, rows, M1))
    cdef cnp.ndarray new = np.empty((s, rows, M2)), log_likelihood = np.empty(s)
    cdef Workspace work = Workspace(kernel)
    cdef double *to = at(new)
    cdef double *values = at(log_likelihood)
    cdef const double *state = at(tables)
    cdef const double *source = at(u)
    with nogil:
        for t in range(s):
            load(work.one.table, state + t * rows * M1, rows, M1)
            work.one.linear = 0
            fk_advance(engine, k, &work.one, &work.two, source + t * width, work.scratch)
            values[t] = fk_log_likelihood(&work.two)
            fk_to_logs(&work.two, M2)
            store(to + t * rows * M2, work.two.table, rows, M2)
    return new, log_likelihood


def forward_backward(first, transition, log_emission):
    cdef cnp.ndarray e = doubles(log_emission, "log_emission", (-1, -1, -1))
    cdef int T = <int> e.shape[0], M = <int> e.shape[1]
    if M < 1 or e.shape[2] != M:
        raise ValueError(f"log_emission: got shape {np.shape(e)}, expected (T, M, M)")
    cdef cnp.ndarray f_ = doubles(first, "first", (M,)), t_ = doubles(transition, "transition", (M, M))
    cdef cnp.ndarray gamma = np.empty((T + 1, M)), xi = np.empty((T, M, M)), log_likelihood = np.empty(T)
    cdef Buffer scratch = Buffer(T + 3 * M)
    cdef const double *start_ = at(f_)
    cdef const double *move = at(t_)
    cdef const double *emission = at(e)
    cdef double *to_gamma = at(gamma)
    cdef double *to_xi = at(xi)
    cdef double *to_values = at(log_likelihood)
    with nogil:
        if not engine.forward_backward(T, M, start_, move, emission, to_gamma, to_xi, to_values, scratch.data):
            fk_forward_backward_logs(T, M, start_, move, emission, to_gamma, to_xi, to_values, scratch.data)
    return gamma, xi, log_likelihood


# --------------------------------------------------------------------------- whole series, summarised


cdef tuple FIELDS = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood")


cdef fk_output outputs(dict out, Py_ssize_t s, Py_ssize_t n, int m, int M) except *:
    """Addresses of the arrays to fill, (s, n, ...), after a check of each."""
    cdef dict shapes = {
        "x": (m,), "P": (m, m), "x_prior": (m,), "P_prior": (m, m), "mu": (M,), "switch": (),
        "switch_mean": (), "log_likelihood": (),
    }
    for name, array in out.items():
        if not (
            isinstance(array, np.ndarray) and array.dtype == np.float64 and array.flags.carray
            and array.shape == (s, n, *shapes[name])
        ):
            raise ValueError(f"{name}: expected a contiguous array of float64, shape {(s, n, *shapes[name])}")
    cdef fk_output o
    o.x, o.P, o.x_prior = at_or_null(out.get("x")), at_or_null(out.get("P")), at_or_null(out.get("x_prior"))
    o.P_prior, o.mu = at_or_null(out.get("P_prior")), at_or_null(out.get("mu"))
    o.modes, o.means = at_or_null(out.get("switch")), at_or_null(out.get("switch_mean"))
    o.log_likelihood = at_or_null(out.get("log_likelihood"))
    return o


def filter_series(Kernel kernel not None, Summary summary not None, law, ys, dict out):
    """Filter complete series, one after the other, from the initial law on.

    Parameters
    ----------
    kernel : Kernel
        Constant tables of an observation that depends on the one before it; no negative weights.
    summary : Summary
    law : tuple
        log_initial, mean, covariance, factor, as in `first_step`.
    ys : ndarray, shape (s, n, q)
    out : dict of str to ndarray, shape (s, n, ...)
        Filled in.  ``x_prior`` and ``P_prior`` of the first observation are not.

    Returns
    -------
    before, last : ndarray, shape (1 + m + m*m, M)
        The states of the last series after the last two observations.
    """
    cdef fk_kernel *k = &kernel.k
    cdef int M = k.M1, m = k.m, q = k.q, d = k.m + k.q, width = 1 + 2 * k.q, rows = 1 + k.m + k.m * k.m, r
    if k.is_signed or k.w != q or k.M2 != M:
        raise ValueError("kernel: expected constant tables without negative weights, of order one")
    cdef cnp.ndarray y = doubles(ys, "ys", (-1, -1, q))
    cdef Py_ssize_t s = y.shape[0], n = y.shape[1], a, t
    if s < 1 or n < 1:
        raise ValueError("ys: expected at least one observation")
    cdef cnp.ndarray l_ = doubles(law[0], "log_initial", (M,)), mean = doubles(law[1], "mean", (M, d))
    cdef cnp.ndarray S_ = doubles(law[2], "covariance", (M, d, d)), f_ = doubles(law[3], "factor", (M, q, q))
    cdef fk_output o = outputs(out, s, n, m, M)
    cdef Workspace work = Workspace(kernel)
    cdef Buffer rows_u = Buffer(<size_t> n * width), root = Buffer(q * (1 + m))
    cdef double *u = rows_u.data
    cdef const double *one
    cdef const double *log_initial = at(l_)
    cdef const double *means = at(mean)
    cdef const double *covariances = at(S_)
    cdef const double *factors = at(f_)
    cdef const double *series = at(y)
    cdef fk_state *last = &work.one
    cdef fk_state *before = &work.two
    cdef int ld = fk_padded(M)
    with nogil:
        for t in range(n):
            u[t * width] = 1.0
        for a in range(s):
            one = series + a * n * q
            for t in range(1, n):
                memcpy(u + t * width + 1, one + (t - 1) * q, 2 * q * sizeof(double))
            work.one.total = fk_first(
                M, m, q, log_initial, means, covariances, factors, one, work.one.table, ld, root.data
            )
            work.one.linear, work.one.log_known = 0, 1
            fk_summarise(engine, &summary.s, &work.one, M, m, a * n, &o, work.p, work.x)
            r = fk_filter(
                engine, k, &summary.s, &work.one, &work.two, u + width, n - 1, &o, a * n + 1, work.p, work.x,
                work.scratch
            )
        if r:
            last = &work.two
            before = &work.one
        fk_to_logs(last, M)
        fk_to_logs(before, M)
    cdef cnp.ndarray tables = np.empty((2, rows, M))
    store(at(tables), before.table, rows, M)
    store(at(tables) + rows * M, last.table, rows, M)
    return tables[0].copy(), tables[1].copy()


# --------------------------------------------------------------------------- streaming


cdef class Stepper:
    """The state of a switching filter, and `step`; see `fuzzykf.engine.stepper.Stepper`.

    Once `_arm` has handed over a state and the tables of all steps to come, observations that
    are complete go through the compiled step alone.  The attributes are made when they are read.
    """

    cdef Kernel kernel  # None unless armed
    cdef Workspace work
    cdef Buffer windows
    cdef double *u  # (1, w, y) of the latest step
    cdef double *window  # the latest observations, newest first
    cdef fk_state *now
    cdef fk_state *old
    cdef bint ahead  # whether the compiled state is newer than the attributes
    cdef Py_ssize_t n
    cdef bint predicted
    cdef object belief, before, z, tables
    cdef double log_likelihood

    def _arm(self, tables, table, window, mass):
        """See `fuzzykf.engine.stepper.Stepper`."""
        cdef Kernel kernel = tables.kernel
        cdef cnp.ndarray w = doubles(window, "window", (kernel.k.w,))
        self._sync()
        if kernel.k.is_signed or kernel.k.M1 != kernel.k.M2 or kernel.k.w % kernel.k.q:
            raise ValueError("tables: expected constant tables without negative weights")
        self.work = Workspace(kernel)
        start(self.work, kernel, table, None)
        cdef cnp.ndarray p
        if kernel.k.is_scalar and mass is not None:  # as the state went on, had it not been interrupted
            p = doubles(mass, "mass", (kernel.k.M1,))
            if (<object> p).min() > 1e-250:
                memcpy(self.work.one.table, at(p), kernel.k.M1 * sizeof(double))
                memset(self.work.one.table + kernel.k.M1, 0, (fk_padded(kernel.k.M1) - kernel.k.M1) * sizeof(double))
                self.work.one.linear = 1
        self.windows = Buffer(1 + 2 * kernel.k.w + kernel.k.q)
        self.u, self.window = self.windows.data, self.windows.data + 1 + kernel.k.w + kernel.k.q
        self.u[0] = 1.0
        memcpy(self.window, at(w), kernel.k.w * sizeof(double))
        self.now, self.old = &self.work.one, &self.work.two
        self.tables, self.kernel, self.ahead = tables, kernel, False
        return True

    def step(self, z):
        """Predict, then update with ``z``.

        Parameters
        ----------
        z : array_like or None
            The observation; None or NaN where missing.

        Returns
        -------
        ndarray, shape (dim_x, 1)
            The new estimate ``x``.
        """
        cdef double value
        cdef const double *y
        cdef fk_kernel *k
        cdef int q, t
        cdef double *u
        cdef double *window
        cdef fk_state *swap
        cdef cnp.npy_intp shape[2]
        if self.kernel is None or self.predicted:
            return self._step_any(z)
        k = &self.kernel.k
        q = k.q
        if PyFloat_Check(z):
            value = PyFloat_AS_DOUBLE(z)
            if q != 1:
                return self._step_any(z)
            y = &value
        elif (
            cnp.PyArray_CheckExact(z) and cnp.PyArray_TYPE(<cnp.ndarray> z) == cnp.NPY_DOUBLE
            and cnp.PyArray_NDIM(<cnp.ndarray> z) == 1 and cnp.PyArray_DIM(<cnp.ndarray> z, 0) == q
            and cnp.PyArray_ISCARRAY_RO(<cnp.ndarray> z)
        ):
            y = <const double *> cnp.PyArray_DATA(<cnp.ndarray> z)
        else:
            return self._step_any(z)
        for t in range(q):
            if not isfinite(y[t]):
                return self._step_any(z)
        u, window = self.u, self.window
        if k.is_scalar:
            u[1], u[2] = window[0], y[0]
            window[0] = y[0]
        else:
            memcpy(u + 1, window, k.w * sizeof(double))
            memcpy(u + 1 + k.w, y, q * sizeof(double))
            memmove(window + q, window, (k.w - q) * sizeof(double))
            memcpy(window, y, q * sizeof(double))
        fk_advance(engine, k, self.now, self.old, u, self.work.scratch)
        swap = self.now
        self.now = self.old
        self.old = swap
        self.n += 1
        self.ahead = True
        shape[0], shape[1] = k.m, 1
        cdef cnp.ndarray x = cnp.PyArray_SimpleNew(2, shape, cnp.NPY_DOUBLE)
        engine.posterior(
            k.M2, k.m, fk_probabilities(engine, self.now, k.M2, self.work.p), self.now.table, at(x), NULL
        )
        return x

    cdef cnp.ndarray _table(self, fk_state *state):
        cdef int M = self.kernel.k.M2, rows = 1 + self.kernel.k.m + self.kernel.k.m * self.kernel.k.m
        cdef cnp.ndarray table = np.empty((rows, M))
        cdef fk_state copy = state[0]
        store(at(table), state.table, rows, M)
        if state.linear:
            copy.table = self.work.p
            memcpy(self.work.p, state.table, fk_padded(M) * sizeof(double))
            fk_to_logs(&copy, M)
            memcpy(at(table), self.work.p, M * sizeof(double))
        return table

    cdef cnp.ndarray _mass(self, fk_state *state):
        cdef int M = self.kernel.k.M2
        cdef cnp.ndarray mass = np.empty(M)
        memcpy(at(mass), fk_probabilities(engine, state, M, self.work.p), M * sizeof(double))
        return mass

    cdef int _sync(self) except -1:
        """Bring the attributes up to the compiled state."""
        if not self.ahead:
            return 0
        cdef int w = self.kernel.k.w, q = self.kernel.k.q
        cdef cnp.ndarray u = np.empty(w + q), window = np.empty(w)
        memcpy(at(u), self.u + 1, (w + q) * sizeof(double))
        memcpy(at(window), self.window, w * sizeof(double))
        belief = self._as_belief(self._table(self.now), window, self._mass(self.now))
        before = self._as_belief(self._table(self.old), u[:w].copy(), self._mass(self.old))
        before = self._as_source(before, self.tables)
        self.belief, self.before, self.z = belief, before, u[w:].copy()
        self.log_likelihood = fk_log_likelihood(self.now)
        self.ahead = False
        return 0

    cdef int _disarm(self) except -1:
        self._sync()
        self.kernel = None
        return 0

    @property
    def _n(self):
        return self.n

    @_n.setter
    def _n(self, value):
        self._disarm()
        self.n = value

    @property
    def _predicted(self):
        return self.predicted

    @_predicted.setter
    def _predicted(self, value):
        self.predicted = value

    @property
    def _belief(self):
        self._sync()
        return self.belief

    @_belief.setter
    def _belief(self, value):
        self._disarm()
        self.belief = value

    @property
    def _before(self):
        self._sync()
        return self.before

    @_before.setter
    def _before(self, value):
        self._disarm()
        self.before = value

    @property
    def _z(self):
        self._sync()
        return self.z

    @_z.setter
    def _z(self, value):
        self._disarm()
        self.z = value

    @property
    def _log_likelihood(self):
        self._sync()
        return self.log_likelihood

    @_log_likelihood.setter
    def _log_likelihood(self, value):
        self._disarm()
        self.log_likelihood = value

    def __getstate__(self):
        state = {
            "_n": self._n, "_predicted": self._predicted, "_belief": self._belief, "_before": self._before,
            "_z": self._z, "_log_likelihood": self._log_likelihood,
        }
        return self.__dict__, state
