# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""The tables of the switching recursion in the layout of the compiled core."""

from libc.math cimport INFINITY
from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, at_or_null, doubles

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["Kernel", "Summary", "pack"]

cdef extern from "src/engines.h" nogil:
    const fk_engine *fk_engines

versions = fk_engines


cdef void load(double *to, const double *source, int rows, int M) noexcept nogil:
    """Spread the rows of a table (rows, M) over whole vectors."""
    cdef int r
    for r in range(rows):
        memcpy(to + r * fk_padded(M), source + r * M, M * sizeof(double))


cdef void store(double *to, const double *source, int rows, int M) noexcept nogil:
    cdef int r
    for r in range(rows):
        memcpy(to + r * M, source + r * fk_padded(M), M * sizeof(double))


cdef class Kernel:
    """Tables of one step in the layout of the compiled core; see `fuzzykf.engine.numpy.tables.Kernel`."""

    @property
    def shape(self):
        """M1, M2, m, q."""
        return self.k.M1, self.k.M2, self.k.m, self.k.q

    @property
    def depth(self):
        """Number of slots of the column that has the most: of pairs that lead to it, or of all nodes."""
        return fk_deepest(&self.k)

    def __copy__(self):
        return self

    def __deepcopy__(self, memo):
        return self

    def __reduce__(self):
        raise TypeError("the tables of the compiled core are made anew, not pickled")


def pack(transition, factor, Axx, H, G, c, C, Ayy, Ny):
    cdef int M1, M2, m, q, w, i, j, blocks
    cdef size_t cells, r
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
    blocks = fk_padded(M2) // 8
    k.M1, k.M2, k.m, k.q, k.w, k.blocks, k.stride = M1, M2, m, q, w, blocks, fk_cell_size(m, q, w)
    k.is_signed = bool((np.asarray(t) < 0.0).any())
    k.is_scalar = m == 1 and q == 1 and w == 1 and not k.is_signed
    cdef Buffer first = Buffer(blocks + 1)  # whole numbers, in room for doubles
    k.is_sparse = fk_lay_out(M1, M2, k.is_signed, at(t), <int *> first.data)
    k.first = <int *> first.data
    cells = <size_t> fk_slots(k) * k.stride * 8
    kernel.memory = Buffer(cells + blocks * 8)
    kernel.places = Buffer(<size_t> fk_slots(k) * 8 + blocks + 1)
    memcpy(<int *> kernel.places.data, k.first, (blocks + 1) * sizeof(int))
    cdef int *source = <int *> kernel.places.data + blocks + 1
    k.first, k.source = <int *> kernel.places.data, source
    fk_fill_sources(k, at(t), source)
    k.cells = kernel.memory.data
    cdef double *mask = kernel.memory.data + cells
    k.mask = mask
    for j in range(M2):
        mask[j] = 1.0
    for i in range(M1):
        for j in range(M2):
            r = <size_t> i * M2 + j
            if k.is_sparse and at(t)[r] == 0.0:
                continue
            fk_fill(
                k, fk_slot_of(k, i, j), j, at(t)[r], at(f_) + r * q * q, at(A_) + r * m * m, at(H_) + r * m * w,
                at(G_) + r * m * q, at(c_) + r * m, at(C_) + r * m * m, at(Y_) + r * q * w, at(N_) + r * q
            )
    fk_fill_rest(k, at(t))
    return kernel


cdef fk_output outputs(dict out, Py_ssize_t s, Py_ssize_t n, int m, int M) except *:
    """Addresses of the arrays to fill, (s, n, ...), after a check of each."""
    cdef dict shapes = {
        "x": (m,), "P": (m, m), "x_prior": (m,), "P_prior": (m, m), "mu": (M,), "switch": (),
        "switch_mean": (), "log_likelihood": (), "table": (1 + m + m * m, M), "sign": (M,),
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
    o.table, o.sign = at_or_null(out.get("table")), at_or_null(out.get("sign"))
    return o


cdef cnp.ndarray rank(fk_summary *s, int M, double *room, nodes, weights, atoms, ranking):
    """Fill in what the estimate of the switch reads; what is returned, and the 2 padded M numbers, are held by it."""
    cdef cnp.ndarray nodes_ = doubles(nodes, "nodes", (M,)), weights_ = doubles(weights, "weights", (M,))
    cdef cnp.ndarray atoms_ = np.array(atoms, dtype=bool), ranking_ = np.array(ranking, dtype=np.intc)
    cdef int n_atoms = int(np.count_nonzero(atoms_))
    if np.shape(atoms_) != (M,):
        raise ValueError(f"atoms: got shape {np.shape(atoms_)}, expected ({M},)")
    if np.shape(ranking_) != (2, M):
        raise ValueError(f"ranking: got shape {np.shape(ranking_)}, expected (2, {M})")
    order, ends = ranking_[0], ranking_[1]
    if not (
        np.array_equal(np.sort(order), np.arange(M)) and ends[M - 1] == 2 and atoms_[order][M - n_atoms:].all()
        and (n_atoms in (0, M) or ends[M - n_atoms - 1] == 2)
    ):
        raise ValueError("ranking: expected all nodes, the atoms last, with the ends of values and strata")
    memcpy(room, at(nodes_), M * sizeof(double))
    memcpy(room + fk_padded(M), at(weights_), M * sizeof(double))
    s.n_atoms, s.M, s.nodes, s.weights = n_atoms, M, room, room + fk_padded(M)
    s.n_edges = int(np.count_nonzero(ends[:M - n_atoms] == 2))
    s.is_plain = s.n_edges < 2 and bool(ends.all())
    s.order = <const int *> cnp.PyArray_DATA(ranking_)
    s.ends = s.order + M
    return ranking_


cdef class Summary:
    def __cinit__(self, Kernel kernel, transition, offset, twice, noise, nodes, weights, atoms, ranking):
        cdef fk_kernel *k = &kernel.k
        cdef int M1 = k.M1, M2 = k.M2, m = k.m, w = k.w, size = 1 + m * (1 + w), i, j, n, r, t, slot
        cdef double most
        cdef cnp.ndarray T = doubles(transition, "transition", (M1, M2))
        cdef cnp.ndarray b = doubles(offset, "offset", (1 + w, M1 * M2 * m))
        cdef cnp.ndarray twice_ = doubles(twice, "twice", (M1 * m * m, m * m))
        cdef cnp.ndarray noise_ = doubles(noise, "noise", (M1, m * m))
        cdef size_t cells = <size_t> fk_slots(k) * size * 8, ld = fk_padded(M1), to = fk_padded(M2)
        self.memory = Buffer(cells + (m * m + m * m * m * m + 9) * ld + 2 * to + 4 * <size_t> M2)
        cdef double *cell
        cdef double *to_noise = self.memory.data + cells
        cdef double *to_twice = to_noise + m * m * ld
        cdef double *ahead = to_twice + m * m * m * m * ld
        cdef double *to_nodes = ahead + 9 * ld
        cdef double *pairs = to_nodes + 2 * to  # temporaries of fk_fill_ahead
        for i in range(M1):
            for r in range(m * m):
                to_noise[r * ld + i] = at(noise_)[i * m * m + r]
                for t in range(m * m):
                    to_twice[(t * m * m + r) * ld + i] = at(twice_)[(i * m * m + t) * m * m + r]
        self.widest = np.zeros((M1, 2), dtype=np.intc)
        cdef int *to_widest = <int *> cnp.PyArray_DATA(self.widest)
        cdef double *moves = pairs + 3 * <size_t> M2
        for i in range(M1):
            n, most = 0, -INFINITY
            for j in range(M2):
                slot = fk_slot_of(k, i, j)
                if slot < 0:
                    if at(T)[i * M2 + j] != 0.0:
                        raise ValueError(f"transition: got one from {i} to {j} that the tables of the step do not have")
                    continue
                if at(T)[i * M2 + j] > most:
                    most, to_widest[2 * i], to_widest[2 * i + 1] = at(T)[i * M2 + j], j, slot
                cell = self.memory.data + fk_slot(k, slot, j, size)
                cell[0] = at(T)[i * M2 + j]
                for r in range(m):
                    for t in range(1 + w):
                        cell[8 * (1 + r * (1 + w) + t)] = at(b)[<size_t> t * M1 * M2 * m + (i * M2 + j) * m + r]
                if k.is_scalar:
                    moves[n], pairs[3 * n], pairs[3 * n + 1] = cell[0], cell[8], cell[16]
                    pairs[3 * n + 2] = k.cells[fk_slot(k, slot, j, k.stride) + 64]
                    n += 1
            if k.is_scalar:
                fk_fill_ahead(i, n, <int> ld, moves, pairs, ahead)
        self.ranking = rank(&self.s, M2, to_nodes, nodes, weights, atoms, ranking)
        self.s.stride, self.s.cells = size, self.memory.data
        self.s.twice, self.s.noise, self.s.ahead = to_twice, to_noise, ahead
        self.s.widest = to_widest


cdef class Workspace:
    """States that change places, and room for the arithmetic of a step."""

    def __cinit__(self, Kernel kernel):
        cdef fk_kernel *k = &kernel.k
        cdef int M = max(k.M1, k.M2)
        cdef size_t table = fk_table_size(M, k.m), row = fk_padded(M)
        cdef size_t moments = fk_padded(k.m + k.m * k.m)
        self.memory = Buffer(3 * table + 3 * row + moments + fk_scratch_size(M, k.m))
        cdef double *data = self.memory.data
        self.one.table, self.two.table, self.three.table = data, data + table, data + 2 * table
        data += 3 * table
        if k.is_signed:
            self.one.sign, self.two.sign = data, data + row
        self.p = data + 2 * row
        self.x = data + 3 * row
        self.scratch = data + 3 * row + moments


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
