# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""The verbs of Kalman filters and of banks of them, on the attributes of the filters."""

from cpython.dict cimport PyDict_GetItemWithError, PyDict_SetItem
from cpython.mem cimport PyMem_Free, PyMem_Malloc
from cpython.object cimport PyObject
from libc.math cimport exp, isfinite
from libc.string cimport memcmp, memcpy

from fuzzykf.engine.compiled.arrays cimport at
from fuzzykf.engine.compiled.imm cimport (
    FK_BANK_UPDATED, fk_bank, fk_bank_place, fk_bank_predict, fk_bank_size, fk_bank_step, fk_bank_update,
    fk_bank_weights, fk_pairs_predict_all, fk_pairs_update_all,
)
from fuzzykf.engine.compiled.kalman cimport FK_KALMAN_LARGEST, fk_kalman, fk_kalman_engine, versions
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.kalman.compiled_attributes cimport (
    ENTRIES, Entry, Member, commit, entry, forget, forget_likelihoods, has_own_verbs, is_begun, is_missing, is_plain, overrides,
    posterior_entries, prior_entries, read_motion, read_observation, read_state, read_z, release, reserve, skip,
)

from fuzzykf.kalman.pair_moments import PairMoments

cimport numpy as cnp

cnp.import_array()

cdef extern from "Python.h":
    dict PyObject_GenericGetDict(object, void *)

cdef enum:
    OWN = 11  # attributes of a bank itself that a step writes


cdef inline const fk_kalman_engine *engine() noexcept nogil:
    return versions + level


cdef bint is_finite(const double *values, int size) noexcept nogil:
    cdef int k
    for k in range(size):
        if not isfinite(values[k]):
            return False
    return True


cdef inline bint is_in_range(const double *x, const double *P, int n) noexcept nogil:
    """Whether an estimate is made of numbers; the verbs say what is wrong with one that is not."""
    return is_finite(x, n) and is_finite(P, n * n)


class LinearStepper:
    """Owner of ``step``; see `fuzzykf.kalman.stepper.LinearStepper`."""

    def step(self, z):
        """Predict, then update with ``z``.

        Parameters
        ----------
        z : array_like or None
            The observation; None or NaN where missing.

        Returns
        -------
        ndarray, shape (dim_x, 1) or (dim_x,)
            The new estimate ``x``.
        """
        cdef dict d = PyObject_GenericGetDict(self, NULL)
        cdef Member member
        cdef Entry entries[ENTRIES]
        cdef int count
        if not (
            is_begun(d) and is_plain(self, d, True) and read_state(d, &member)
            and read_motion(d, &member) and read_observation(d, &member)
        ):
            return self._step_any(z)
        if not read_z(z, member.f.m, member.z):
            if not is_missing(z, member.f.m):
                return self._step_any(z)
            engine().predict(&member.f)
            if not is_in_range(member.f.x_prior, member.f.P_prior, member.f.n):
                return self._step_any(z)
            skip(d, &member, entries, prior_entries(&member, entries, False))
            return <object> PyDict_GetItemWithError(d, "x")
        engine().predict(&member.f)
        if not engine().update(&member.f, member.z) or not is_in_range(member.f.x, member.f.P, member.f.n):
            return self._step_any(z)
        count = prior_entries(&member, entries, False)
        count += posterior_entries(&member, entries + count)
        reserve(d, entries, count)
        commit(d, entries, count)
        forget_likelihoods(d)
        return <object> PyDict_GetItemWithError(d, "x")

    def _predict_at_once(self):
        """See `fuzzykf.kalman.stepper.LinearStepper`."""
        cdef dict d = PyObject_GenericGetDict(self, NULL)
        cdef Member member
        cdef Entry entries[ENTRIES]
        cdef int count
        if not (
            is_begun(d) and is_plain(self, d, False) and read_state(d, &member) and read_motion(d, &member)
        ):
            return False
        engine().predict(&member.f)
        if not is_in_range(member.f.x_prior, member.f.P_prior, member.f.n):
            return False
        count = prior_entries(&member, entries, True)
        reserve(d, entries, count)
        commit(d, entries, count)
        return True

    def _update_at_once(self, z):
        """See `fuzzykf.kalman.stepper.LinearStepper`."""
        cdef dict d = PyObject_GenericGetDict(self, NULL)
        cdef Member member
        cdef Entry entries[ENTRIES]
        cdef int count
        cdef fk_kalman *f = &member.f
        if not (
            is_begun(d) and is_plain(self, d, False) and read_state(d, &member) and read_observation(d, &member)
        ):
            return False
        memcpy(f.x_prior, f.x, f.n * sizeof(double))
        memcpy(f.P_prior, f.P, f.n * f.n * sizeof(double))
        if not read_z(z, f.m, member.z):
            if not (is_missing(z, f.m) and is_in_range(f.x, f.P, f.n)):
                return False
            skip(d, &member, entries, 0)
            return True
        if not engine().update(f, member.z) or not is_in_range(f.x, f.P, f.n):
            return False
        count = posterior_entries(&member, entries)
        reserve(d, entries, count)
        commit(d, entries, count)
        forget_likelihoods(d)
        return True


cdef class Bank:
    """Filters at work, with their attributes to be written."""

    cdef fk_bank b
    cdef Member *members
    cdef double *likelihood
    cdef double *room
    cdef Entry *entries
    cdef Entry *own
    cdef list dicts  # attributes of the filters
    cdef dict d  # those of the bank
    cdef int reserved

    def __cinit__(self, int modes, bint every_pair):
        cdef int k
        cdef size_t doubles_ = modes + fk_bank_size(modes, FK_KALMAN_LARGEST, every_pair)
        cdef size_t size = modes * (sizeof(Member) + sizeof(fk_kalman *) + ENTRIES * sizeof(Entry))
        cdef char *memory = <char *> PyMem_Malloc(size + OWN * sizeof(Entry) + doubles_ * sizeof(double))
        if memory == NULL:
            raise MemoryError
        self.members = <Member *> memory
        memory += modes * sizeof(Member)
        self.b.f = <fk_kalman **> memory
        memory += modes * sizeof(fk_kalman *)
        self.entries = <Entry *> memory
        self.own = self.entries + modes * ENTRIES
        memory = <char *> (self.own + OWN)
        self.b.modes, self.b.every_pair = modes, every_pair
        self.likelihood = <double *> memory
        self.room = self.likelihood + modes
        for k in range(modes):
            self.b.f[k] = &self.members[k].f
        self.dicts = []

    def __dealloc__(self):
        PyMem_Free(self.members)


cdef bint bank_is_in_range(Bank bank, bint prior) noexcept:
    cdef int k, n = bank.members[0].f.n
    cdef fk_kalman *f
    for k in range(bank.b.modes):
        f = &bank.members[k].f
        if not is_in_range(f.x_prior if prior else f.x, f.P_prior if prior else f.P, n):
            return False
    if prior:
        return is_in_range(bank.b.x_prior, bank.b.P_prior, n)
    return is_in_range(bank.b.x, bank.b.P, n)


cdef inline const double *row(PyObject *value, int rows, int columns) noexcept:
    """The numbers of a contiguous array, (rows, columns) or flat without columns; else NULL."""
    cdef cnp.ndarray a
    if value == NULL or not cnp.PyArray_CheckExact(<object> value):
        return NULL
    a = <cnp.ndarray> value
    if (
        cnp.PyArray_TYPE(a) == cnp.NPY_DOUBLE and cnp.PyArray_ISCARRAY_RO(a)
        and cnp.PyArray_NDIM(a) == (2 if columns else 1) and cnp.PyArray_DIM(a, 0) == rows
        and (columns == 0 or cnp.PyArray_DIM(a, 1) == columns)
    ):
        return <const double *> cnp.PyArray_DATA(a)
    return NULL


cdef bint same(const double *a, const double *b, int size) noexcept:
    return a != NULL and b != NULL and memcmp(a, b, size * sizeof(double)) == 0


cdef Bank read_bank(object filter_, dict d, bint motion, bint observation):
    """Read a bank of plain Kalman filters of one size; None where something is not usual."""
    cdef PyObject *filters_ = PyDict_GetItemWithError(d, "filters")
    cdef PyObject *method = PyDict_GetItemWithError(d, "method")
    cdef PyObject *log_mu
    cdef Bank bank
    cdef Member *member
    cdef Member *first
    cdef dict one
    cdef int K, k
    if filters_ == NULL or not isinstance(<object> filters_, (list, tuple)) or method == NULL:
        return None
    K = <int> len(<object> filters_)
    if K < 2 or PyDict_GetItemWithError(d, "_space") != <PyObject *> None:
        return None
    bank = Bank(K, <object> method != "imm")
    first = bank.members
    for k in range(K):
        each = (<object> filters_)[k]
        member = bank.members + k
        if overrides(each) & 3:
            return None
        one = PyObject_GenericGetDict(each, NULL)
        bank.dicts.append(one)
        if not (
            is_plain(each, one, True) and read_state(one, member)
            and (not motion or read_motion(one, member)) and (not observation or read_observation(one, member))
            and member.f.n == first.f.n and member.f.m == first.f.m and member.flat == first.flat
        ):
            return None
    fk_bank_place(&bank.b, first.f.n, bank.room)
    # mu and M may have been assigned or written into since their logarithms were taken
    bank.b.log_M = row(PyDict_GetItemWithError(d, "_log_M"), K, K)
    log_mu = PyDict_GetItemWithError(d, "_log_mu")
    if (
        bank.b.log_M == NULL or row(log_mu, K, 0) == NULL
        or not same(
            row(PyDict_GetItemWithError(d, "mu"), K, 0), row(PyDict_GetItemWithError(d, "_known_mu"), K, 0), K
        )
        or not same(
            row(PyDict_GetItemWithError(d, "M"), K, K), row(PyDict_GetItemWithError(d, "_checked_M"), K, K), K * K
        )
    ):
        return None
    memcpy(bank.b.log_mu, row(log_mu, K, 0), K * sizeof(double))
    bank.d = d
    return bank


cdef int write(Bank bank, bint prior, bint posterior) except -1:
    """Write what a prediction, an update, or both have found."""
    cdef int K = bank.b.modes, n = bank.members[0].f.n, k, count, own = 0
    cdef int column = 0 if bank.members[0].flat else 1
    cdef Entry *entries
    cdef Entry *e = bank.own
    cdef int counts = 0
    if prior:
        entry(e, "x_prior", bank.b.x_prior, n, column)
        entry(e + 1, "P_prior", bank.b.P_prior, n, n)
        own = 2
        if not posterior:
            entry(e + 2, "x", bank.b.x_prior, n, column)
            entry(e + 3, "P", bank.b.P_prior, n, n)
            own = 4
    if posterior:
        for k in range(K):
            bank.likelihood[k] = exp(bank.b.log_likelihood[k])
        e = bank.own + own
        entry(e, "x", bank.b.x, n, column)
        entry(e + 1, "P", bank.b.P, n, n)
        entry(e + 2, "x_post", bank.b.x, n, column)
        entry(e + 3, "P_post", bank.b.P, n, n)
        entry(e + 4, "mu", bank.b.weights, K, 0)
        entry(e + 5, "_known_mu", bank.b.weights, K, 0)
        entry(e + 6, "_log_mu", bank.b.log_mu, K, 0)
        entry(e + 7, "likelihood", bank.likelihood, K, 0)
        entry(e + 8, "mode_log_likelihood", bank.b.log_likelihood, K, 0)
        own += 9
    reserve(bank.d, bank.own, own)
    try:
        for k in range(K):
            entries = bank.entries + k * ENTRIES
            count = prior_entries(bank.members + k, entries, not posterior) if prior else 0
            if posterior:
                count += posterior_entries(bank.members + k, entries + count)
            reserve(<dict> bank.dicts[k], entries, count)
            counts = k + 1
    except BaseException:
        release(bank.own, own)
        for k in range(counts):
            release(bank.entries + k * ENTRIES, count)
        raise
    for k in range(K):
        commit(<dict> bank.dicts[k], bank.entries + k * ENTRIES, count)
        if posterior:
            PyDict_SetItem(<dict> bank.dicts[k], "_log_likelihood", bank.b.own[k])
            forget(<dict> bank.dicts[k], "_likelihood")
            forget(<dict> bank.dicts[k], "_mahalanobis")
    commit(bank.d, bank.own, own)
    if posterior:
        PyDict_SetItem(bank.d, "log_likelihood", bank.b.total)
        if not prior:  # a step finds none of them
            forget(bank.d, "_log_cbar")
            forget(bank.d, "_branches")
    return 0


cdef cnp.ndarray made(const double *values, int axes, cnp.npy_intp *shape):
    """Make an array with these numbers, or with none yet."""
    cdef cnp.ndarray array = cnp.PyArray_SimpleNew(axes, shape, cnp.NPY_DOUBLE)
    if values != NULL:
        memcpy(at(array), values, cnp.PyArray_NBYTES(array))
    return array


cdef object predict_pairs(Bank bank):
    """Predict every pair of modes, and return the moments of all."""
    cdef int K = bank.b.modes, n = bank.members[0].f.n, k
    cdef cnp.npy_intp pairs[4]
    cdef cnp.npy_intp merged[3]
    pairs[:] = [K, K, n, n]
    merged[:] = [K, n, n]
    cdef cnp.ndarray xs = made(NULL, 3, pairs), Ps = made(NULL, 4, pairs)
    cdef cnp.ndarray merged_xs = made(NULL, 2, merged), merged_Ps = made(NULL, 3, merged)
    fk_pairs_predict_all(engine(), &bank.b, at(xs), at(Ps))
    for k in range(K):
        memcpy(at(merged_xs) + k * n, bank.members[k].f.x_prior, n * sizeof(double))
        memcpy(at(merged_Ps) + k * n * n, bank.members[k].f.P_prior, n * n * sizeof(double))
    return PairMoments(made(bank.b.log_joint, 2, pairs), xs, Ps, merged_xs, merged_Ps)


cdef bint kept(object value, Py_ssize_t axes, Py_ssize_t rows, Py_ssize_t n) except -1:
    """Whether this is an array as `predict_pairs` makes them."""
    cdef cnp.ndarray a
    if not cnp.PyArray_CheckExact(value):
        return False
    a = value
    return (
        cnp.PyArray_TYPE(a) == cnp.NPY_DOUBLE and cnp.PyArray_ISCARRAY_RO(a) and cnp.PyArray_NDIM(a) == axes
        and cnp.PyArray_DIM(a, 0) == rows and cnp.PyArray_DIM(a, axes - 1) == n
    )


cdef int update_pairs(Bank bank, object pairs) except -2:
    """Update the pairs that were predicted; 0 where somebody has written into a filter since."""
    cdef int K = bank.b.modes, n = bank.members[0].f.n, k
    cdef cnp.ndarray xs, Ps, merged_xs, merged_Ps
    log_joint, xs, Ps, merged_xs, merged_Ps = pairs
    if not (
        kept(log_joint, 2, K, K) and kept(xs, 3, K, n) and kept(Ps, 4, K, n) and kept(merged_xs, 2, K, n)
        and kept(merged_Ps, 3, K, n)
    ):
        return 0
    for k in range(K):
        if not (
            same(bank.members[k].f.x, at(merged_xs) + k * n, n)
            and same(bank.members[k].f.P, at(merged_Ps) + k * n * n, n * n)
        ):
            return 0
    memcpy(bank.b.log_joint, at(log_joint), K * K * sizeof(double))
    return fk_pairs_update_all(engine(), &bank.b, at(xs), at(Ps), bank.members[0].z)


class BankStepper:
    """Owner of ``step``; see `fuzzykf.kalman.stepper.BankStepper`."""

    def step(self, z):
        """Predict, then update with ``z``.

        Parameters
        ----------
        z : array_like or None
            The observation; None or NaN where missing.

        Returns
        -------
        ndarray
            The new estimate ``x``, in the shape of those of the filters.
        """
        cdef dict d = PyObject_GenericGetDict(self, NULL)
        cdef Bank bank
        cdef int k
        if not (
            is_begun(d) and not overrides(self) & 3 and not has_own_verbs(d)
            and PyDict_GetItemWithError(d, "_log_cbar") == <PyObject *> None
            and PyDict_GetItemWithError(d, "_branches") == <PyObject *> None
        ):
            return self._step_any(z)
        bank = read_bank(self, d, True, True)
        if bank is None or not read_z(z, bank.members[0].f.m, bank.members[0].z):
            return self._step_any(z)
        for k in range(1, bank.b.modes):
            memcpy(bank.members[k].z, bank.members[0].z, bank.members[0].f.m * sizeof(double))
        if (
            fk_bank_step(engine(), &bank.b, bank.members[0].z) != FK_BANK_UPDATED
            or not bank_is_in_range(bank, False)
        ):
            return self._step_any(z)
        write(bank, True, True)
        return <object> PyDict_GetItemWithError(d, "x")

    def _predict_at_once(self):
        """See `fuzzykf.kalman.stepper.BankStepper`."""
        cdef dict d = PyObject_GenericGetDict(self, NULL)
        cdef Bank bank
        cdef cnp.ndarray log_cbar
        cdef cnp.npy_intp modes
        pairs = None
        if not (
            is_begun(d) and not overrides(self) & 1 and PyDict_GetItemWithError(d, "_log_cbar") == <PyObject *> None
            and PyDict_GetItemWithError(d, "_branches") == <PyObject *> None
        ):
            return False
        bank = read_bank(self, d, True, False)
        if bank is None:
            return False
        if bank.b.every_pair:
            pairs = predict_pairs(bank)
        else:
            fk_bank_predict(engine(), &bank.b)
        if not bank_is_in_range(bank, True):
            return False
        modes = bank.b.modes
        log_cbar = made(bank.b.log_cbar, 1, &modes)
        write(bank, True, False)
        PyDict_SetItem(d, "_log_cbar", log_cbar)
        PyDict_SetItem(d, "_branches", pairs)
        return True

    def _update_at_once(self, z):
        """See `fuzzykf.kalman.stepper.BankStepper`."""
        cdef dict d = PyObject_GenericGetDict(self, NULL)
        cdef Bank bank
        cdef Member *member
        cdef const double *log_cbar
        cdef PyObject *predicted = PyDict_GetItemWithError(d, "_log_cbar")
        cdef PyObject *branches = PyDict_GetItemWithError(d, "_branches")
        cdef int k, became
        if not is_begun(d) or overrides(self) & 1 or branches == NULL:
            return False
        bank = read_bank(self, d, False, True)
        if bank is None or not read_z(z, bank.members[0].f.m, bank.members[0].z):
            return False
        if predicted == <PyObject *> None:
            fk_bank_weights(&bank.b)
        else:
            log_cbar = row(predicted, bank.b.modes, 0)
            if log_cbar == NULL:
                return False
            memcpy(bank.b.log_cbar, log_cbar, bank.b.modes * sizeof(double))
        for k in range(bank.b.modes):
            member = bank.members + k
            if k:
                memcpy(member.z, bank.members[0].z, member.f.m * sizeof(double))
            memcpy(member.f.x_prior, member.f.x, member.f.n * sizeof(double))
            memcpy(member.f.P_prior, member.f.P, member.f.n * member.f.n * sizeof(double))
        if branches == <PyObject *> None:
            became = fk_bank_update(engine(), &bank.b, bank.members[0].z)
        elif type(<object> branches) is PairMoments and bank.b.every_pair:
            became = update_pairs(bank, <object> branches)
        else:
            return False
        if became != FK_BANK_UPDATED or not bank_is_in_range(bank, False):
            return False
        write(bank, False, True)
        return True
