# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""The state of a switching filter, and its streaming step."""

from cpython.dict cimport PyDict_GetItemWithError
from cpython.float cimport PyFloat_AS_DOUBLE, PyFloat_Check
from libc.math cimport NAN, fabs, isfinite, isnan
from libc.string cimport memcpy, memmove, memset

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.gaps cimport (
    GapRoom, GapTables, fk_gap_rows, fk_gaps_engine, fk_open_complete, gaps_versions, open_state, shown_state,
)
from fuzzykf.engine.compiled.nodes cimport (
    NodeKernel, NodeSpan, fk_nodes_advance, nodes_versions,
)
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport (
    FK_FARTHEST, Kernel, Workspace, fk_advance, fk_engine, fk_kernel, fk_log_likelihood, fk_padded,
    fk_probabilities, fk_state, fk_table_size, fk_to_logs, load, start, store, versions,
)

cimport numpy as cnp

import numpy as np

from numpy import exp

from fuzzykf.switching.inference.mixture import Mixture

cnp.import_array()

#: Means and roots of covariances beyond this are for the verbs, which say what leaves the range of numbers.
cdef double LARGEST = 1e152

cdef enum:
    AFTER = -1

cdef extern from *:
    """
    /* Python gives a class a new number, or none for a while, whenever it or one of its bases is changed. */
    static inline unsigned int fk_version_of(PyTypeObject *type) { return type->tp_version_tag; }
    """
    unsigned int fk_version_of(type) noexcept

cdef extern from "Python.h":
    dict PyObject_GenericGetDict(object, void *)


cdef inline const fk_engine *engine() noexcept nogil:
    return versions + level


cdef bint fit(const double *rows, int n, int e, int M) noexcept:
    """Whether means and roots of n branches a node are numbers, whose squares are, too."""
    cdef int ld = fk_padded(M), b, r, i
    cdef const double *row
    for b in range(n):
        for r in range(1, fk_gap_rows(e)):
            row = rows + (<size_t> b * fk_gap_rows(e) + r) * ld
            for i in range(M):
                if not fabs(row[i]) <= LARGEST:
                    return False
    return True


cdef class Stepper:
    """The state of a switching filter, and `step`; see `fuzzykf.switching.filters.stepper.Stepper`.

    Once `_arm` has handed over a state and the tables of all steps to come, observations
    go through the compiled step alone, complete or not, as long as the verbs are those that they were
    then.  The attributes are made when they are read.
    """

    cdef Kernel kernel  # None unless armed with pairs of nodes
    cdef Workspace work
    cdef NodeKernel nodes  # None unless armed with a state-space model on nodes
    cdef NodeSpan span
    cdef bint every_pair
    cdef int M, m, q, w
    cdef double *p  # room for the probabilities of the nodes
    cdef Buffer windows
    cdef double *u  # (1, w, y) of the latest step
    cdef double *window  # the latest observations, newest first
    cdef double *nothing  # an observation of which nothing is there
    cdef fk_state *now
    cdef fk_state *old
    cdef fk_state *spare
    cdef GapTables gaps  # None as long as nothing has been missing
    cdef GapRoom room
    cdef double *rows[3]  # of the branches of now, old and spare
    cdef int branches[3]  # how many each node has; 0 where nothing of the window is unknown, AFTER right after a gap
    cdef double *kept  # u of the step before
    cdef bint ahead  # whether the compiled state is newer than the attributes
    cdef unsigned int version  # of the class, when the tables were handed over
    cdef Py_ssize_t n
    cdef bint predicted
    cdef object mixture, before, z, tables
    cdef double log_likelihood

    def _arm(self, tables, known, every_pair):
        """See `fuzzykf.switching.filters.stepper.Stepper`."""
        packed = tables.kernel
        self._disarm()
        if isinstance(packed, NodeKernel):
            self._arm_nodes(packed, known.table, every_pair)
        elif isinstance(packed, Kernel):
            if known.unknown and (known.root is None or not isinstance(tables.gaps, GapTables)):
                return False
            table = known.state_table((<Kernel> packed).k.m) if known.unknown else known.table
            self._arm_pairs(packed, table, known.window, known.mass)
            if known.unknown:
                self._arm_gap(tables.gaps, known)
        else:  # a system too large to be compiled
            return False
        self.tables, self.ahead = tables, False
        self.version = fk_version_of(type(self))
        return True

    cdef int _arm_nodes(self, NodeKernel kernel, table, bint every_pair) except -1:
        cdef int M = kernel.k.M, m = kernel.k.m, t
        cdef cnp.ndarray source = doubles(table, "table", (1 + m + m * m, M))
        self.span = NodeSpan(kernel, 1, 1)
        load(self.span.one.table, at(source), 1 + m + m * m, M)
        self.windows = Buffer(1 + 2 * kernel.k.q)
        self.u, self.p, self.nothing = self.windows.data, self.span.p, self.windows.data + 1 + kernel.k.q
        self.now, self.old, self.spare = &self.span.one, &self.span.two, &self.span.three
        self.M, self.m, self.q, self.w = M, m, kernel.k.q, 0
        for t in range(self.q):
            self.nothing[t] = NAN
        self.nodes, self.every_pair = kernel, every_pair
        return 0

    cdef int _arm_pairs(self, Kernel kernel, table, window, mass) except -1:
        cdef cnp.ndarray w = doubles(window, "window", (kernel.k.w,))
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
        cdef size_t width = 1 + kernel.k.w + kernel.k.q
        cdef int t
        self.windows = Buffer(2 * width + kernel.k.w + kernel.k.q)
        self.u, self.kept, self.window = self.windows.data, self.windows.data + width, self.windows.data + 2 * width
        self.nothing = self.window + kernel.k.w
        for t in range(kernel.k.q):
            self.nothing[t] = NAN
        self.u[0] = 1.0
        memcpy(self.window, at(w), kernel.k.w * sizeof(double))
        self.now, self.old, self.spare, self.p = &self.work.one, &self.work.two, &self.work.three, self.work.p
        self.M, self.m, self.q, self.w = kernel.k.M2, kernel.k.m, kernel.k.q, kernel.k.w
        self.kernel = kernel
        return 0

    cdef int _arm_gap(self, gaps, known) except -1:
        """Put what is known in a gap beside the state of X alone."""
        branches = known.branches
        self._make_room(gaps, 1 if branches is None else np.shape(branches.table)[1] // self.M)
        self.branches[0] = open_state(
            self.rows[0], known.table, known.root, branches, known.window, self.M, self.m
        )
        return 0

    cdef bint _has_own_verbs(self) except -1:
        """Whether the class has been changed since, or one of the verbs of this object."""
        cdef dict d = PyObject_GenericGetDict(self, NULL)
        return (
            self.version == 0 or fk_version_of(type(self)) != self.version
            or PyDict_GetItemWithError(d, "predict") != NULL or PyDict_GetItemWithError(d, "update") != NULL
        )

    def step(self, z, u=None):
        """Predict, then update with ``z``.

        Parameters
        ----------
        z : array_like or None
            The observation; None or NaN where missing.
        u : array_like, shape (k,) or (k, 1), optional
            Inputs of its time, of a model that has them.

        Returns
        -------
        ndarray, shape (dim_x, 1)
            The new estimate ``x``.
        """
        cdef double value
        cdef const double *y
        cdef int q = self.q, t
        cdef bint complete = True, moved
        if u is not None:
            return self._step_any(z, u)
        if (self.kernel is None and self.nodes is None) or self.predicted or self._has_own_verbs():
            return self._step_any(z)
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
        elif z is None:
            y = self.nothing
        else:
            return self._step_any(z)
        for t in range(q):
            if not isfinite(y[t]):
                if not isnan(y[t]):
                    return self._step_any(z)
                complete = False
        if self.nodes is not None:
            moved = self._advance_nodes(y)
        elif complete and self.branches[0] <= 0:
            moved = self._advance_pairs(y)
        elif self.gaps is None and not self._open_gaps():
            return self._step_by_verbs(z)
        else:
            moved = self._advance_gap(y)
        if not moved:
            # the verbs say what is wrong, from the state before
            return self._step_by_verbs(np.array([y[t] for t in range(q)]))
        self._turn()
        self.n += 1
        self.ahead = True
        cdef cnp.npy_intp *shape = [self.m, 1]
        cdef cnp.ndarray x = cnp.PyArray_SimpleNew(2, shape, cnp.NPY_DOUBLE)
        engine().posterior(
            self.M, self.m, self._probabilities(self.now, self.branches[0]), self.now.table, at(x), NULL
        )
        return x

    cdef const double *_probabilities(self, const fk_state *state, int n) except NULL:
        """Return the probabilities of the nodes, to the bit those of which the attributes are made."""
        if not n or state.linear:
            return fk_probabilities(engine(), state, self.M, self.p)
        # the engine carries none in gaps: a `Mixture` takes the exponentials of NumPy
        cdef cnp.npy_intp *shape = [self.M]
        cdef cnp.ndarray p = cnp.PyArray_SimpleNew(1, shape, cnp.NPY_DOUBLE)
        memcpy(at(p), state.table, self.M * sizeof(double))
        exp(p, p)
        memcpy(self.p, at(p), self.M * sizeof(double))
        memset(self.p + self.M, 0, (fk_padded(self.M) - self.M) * sizeof(double))
        return self.p

    cdef bint _advance_nodes(self, const double *y) noexcept:
        """Take an observation; whether what comes of it is made of numbers."""
        if not fk_nodes_advance(
            nodes_versions + level, &self.span.k, self.every_pair, self.now, self.spare, y, self.span.scratch
        ):
            return False
        if not self.spare.total > FK_FARTHEST or not engine().in_range(self.M, self.m, self.spare.table):
            return False
        memcpy(self.u + 1, y, self.q * sizeof(double))
        return True

    cdef bint _advance_pairs(self, const double *y) noexcept:
        """Take an observation, likewise."""
        cdef fk_kernel *k = &self.kernel.k
        cdef int q = k.q
        cdef double *u = self.u
        cdef double *window = self.window
        memcpy(self.kept, u, (1 + k.w + q) * sizeof(double))
        if k.is_scalar:
            u[1], u[2] = window[0], y[0]
            window[0] = y[0]
        else:
            memcpy(u + 1, window, k.w * sizeof(double))
            memcpy(u + 1 + k.w, y, q * sizeof(double))
            memmove(window + q, window, (k.w - q) * sizeof(double))
            memcpy(window, y, q * sizeof(double))
        fk_advance(engine(), k, self.now, self.spare, u, self.work.scratch)
        if self.spare.total != self.spare.total or not engine().in_range(k.M2, k.m, self.spare.table):
            memcpy(window, u + 1, k.w * sizeof(double))
            memcpy(u, self.kept, (1 + k.w + q) * sizeof(double))
            return False
        return True

    cdef bint _open_gaps(self) except -1:
        """Make room for gaps; whether the engine has tables for them."""
        gaps = self.tables.gaps
        if not isinstance(gaps, GapTables):
            return False
        self._make_room(gaps, 1)
        return True

    cdef int _make_room(self, GapTables gaps, int n) except -1:
        """Make room for states of n branches a node, and of as many as come after them."""
        self.room = GapRoom(gaps, n)
        self.rows[0], self.rows[1], self.rows[2] = self.room.rows[0], self.room.rows[1], self.room.rows[2]
        self.gaps = gaps
        return 0

    cdef bint _advance_gap(self, const double *y) noexcept:
        """Take an observation of which, or of the window before it, something is missing, likewise."""
        cdef fk_kernel *k = &self.kernel.k
        cdef int m = k.m, q = k.q, w = k.w, M = k.M2, n = self.branches[0], n_to = 0, e = k.m, t
        cdef double *u = self.u
        cdef double *window = self.window
        cdef const double *log_p = self.now.table
        cdef double value = 0.0
        cdef fk_state logs = self.now[0]
        memcpy(self.kept, u, (1 + w + q) * sizeof(double))
        memcpy(u + 1, window, w * sizeof(double))
        memcpy(u + 1 + w, y, q * sizeof(double))
        if n <= 0:  # its probabilities stay as they are, for whoever asks what was known before
            logs.table = self.room.table
            memcpy(logs.table, self.now.table, fk_table_size(M, m) * sizeof(double))
            fk_to_logs(&logs, M)
            fk_open_complete(M, m, logs.table, self.rows[0])
            log_p, n = logs.table, 1
        cdef bint moved = (gaps_versions + level).step(
            &self.gaps.k, self.rows[0], n, log_p, u + 1, y, w, self.spare.table, self.rows[2], &n_to, &value,
            self.room.scratch,
        )
        memmove(window + q, window, (w - q) * sizeof(double))
        memcpy(window, y, q * sizeof(double))
        for t in range(w):
            e += isnan(window[t])
        if not (moved and engine().in_range(M, m, self.spare.table) and fit(self.rows[2], n_to, e, M)):
            memcpy(window, u + 1, w * sizeof(double))
            memcpy(u, self.kept, (1 + w + q) * sizeof(double))
            return False
        self.spare.linear, self.spare.log_known, self.spare.total = 0, 1, value
        self.branches[2] = n_to if n_to else AFTER
        return True

    cdef void _turn(self) noexcept:
        """Let the state in `spare` be that of now, and that of now the one before."""
        cdef fk_state *swap = self.old
        self.old = self.now
        self.now = self.spare
        self.spare = swap
        if self.gaps is None:
            return
        cdef double *rows = self.rows[1]
        self.rows[1], self.rows[0] = self.rows[0], self.rows[2]
        self.rows[2] = rows
        self.branches[1], self.branches[0], self.branches[2] = self.branches[0], self.branches[2], 0

    cdef object _known(self, fk_state *state, const double *rows, int n, cnp.ndarray window):
        """Return what a state with n branches a node says, as Python has it."""
        if n <= 0:
            return self._as_mixture(self._table(state), window, None if n and not state.linear else self._mass(state))
        table, root, branches = shown_state(
            rows, n, state.table, self.M, self.m, at(window), self.w, self.room
        )
        return Mixture(table, window, None, None, int(np.isnan(window).sum()), root, branches)

    cdef cnp.ndarray _table(self, fk_state *state):
        cdef int M = self.M, rows = 1 + self.m + self.m * self.m
        cdef cnp.ndarray table = np.empty((rows, M))
        cdef fk_state copy = state[0]
        store(at(table), state.table, rows, M)
        if state.linear:
            copy.table = self.p
            memcpy(self.p, state.table, fk_padded(M) * sizeof(double))
            fk_to_logs(&copy, M)
            memcpy(at(table), self.p, M * sizeof(double))
        return table

    cdef object _mass(self, fk_state *state):
        """Return the probabilities of the nodes if the engine carries them; None on nodes, where it does not."""
        if self.nodes is not None:
            return None
        cdef cnp.ndarray mass = np.empty(self.M)
        memcpy(at(mass), fk_probabilities(engine(), state, self.M, self.p), self.M * sizeof(double))
        return mass

    cdef int _sync(self) except -1:
        """Bring the attributes up to the compiled state."""
        if not self.ahead:
            return 0
        cdef int w = self.w, q = self.q
        cdef cnp.ndarray u = np.empty(w + q), window = np.empty(w)
        memcpy(at(u), self.u + 1, (w + q) * sizeof(double))
        if w:
            memcpy(at(window), self.window, w * sizeof(double))
        mixture = self._known(self.now, self.rows[0], self.branches[0], window)
        before = self._known(self.old, self.rows[1], self.branches[1], u[:w].copy())
        before = self._as_source(before, self.tables)
        self.mixture, self.before, self.z = mixture, before, u[w:].copy()
        self.log_likelihood = fk_log_likelihood(self.now)
        self.ahead = False
        return 0

    cdef int _disarm(self) except -1:
        self._sync()
        self.kernel = self.nodes = self.gaps = self.room = None
        self.branches[0], self.branches[1], self.branches[2] = 0, 0, 0
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
    def _mixture(self):
        self._sync()
        return self.mixture

    @_mixture.setter
    def _mixture(self, value):
        self._disarm()
        self.mixture = value

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
