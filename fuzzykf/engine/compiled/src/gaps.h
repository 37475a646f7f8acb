/* Steps of the exact recursion in which something is missing: tables, states and their versions.
 *
 * A state is n branches for each node: rows (n, 1 + e + e e, padded M) of the logarithm of the probability, the
 * mean of (u, X), and a lower triangular root T of its covariance.  u are the parts of the window that are missing,
 * in the order of the window, which comes first, unlike in Python: what X has in common with u then is T's. */
#ifndef FUZZYKF_GAPS_H
#define FUZZYKF_GAPS_H

#include "series.h"

#define FK_GAPS_LARGEST 12 /* numbers of X, Y and the window together; larger systems are for NumPy */

/* Tables of one step, slot by slot: cells (depth, size, padded M2), sources (depth, padded M2).  A cell is the
 * transition and its logarithm, Ayy (q w), Ny (q), H + G Ayy (m w), c + G Ny (m), Axx (m m) and the root of the
 * noise of (X', Y'). */
typedef struct {
  int M1, M2, m, q, w, depth, is_sparse, size;
  const double *cells;
  const int *source;
  const double *sees; /* (q, w): the largest |Ayy| of all possible pairs */
} fk_gaps;

FK_INLINE int fk_gap_size(int m, int q, int w) { return 2 + (m + q) * (w + 1) + m * m + (m + q) * (m + q); }
FK_INLINE int fk_gap_rows(int e) { return 1 + e + e * e; }

/* Of one step, from n branches a node: pairs, the matrix of one, and a node. */
FK_INLINE size_t fk_gap_scratch(const fk_gaps *k, int n) {
  const size_t e = k->w + k->q + k->m, pairs = (size_t)(n > 1 ? n : 1) * k->depth;
  return FK_LANES * ((pairs + k->depth + 4) * (2 + e + e * e) + (e + k->q) * (2 * e + 2) + 2 * e) +
         (1 + e + e * e) * fk_padded(k->M1 > k->M2 ? k->M1 : k->M2);
}
/* States of e numbers at most. */
FK_INLINE size_t fk_gap_state(int M, int n, int e) { return (size_t)n * fk_gap_rows(e) * fk_padded(M); }

/* What is missing of a step: numbers of parts of the window and of y. */
typedef struct {
  int nu;        /* unknown parts of the window */
  int seen;      /* parts of y that are there */
  int kept;      /* unknown parts of the window that stay in it */
  int *u, *there, *gone; /* (nu), (seen), (q - seen) */
} fk_holes;

/* Look a window and an observation through; `places` holds w + 2 q numbers.  w_to is the next window's size. */
FK_STATIC fk_holes fk_find_holes(const fk_gaps *k, const double *window, const double *y, int w_to, int *places) {
  fk_holes h = {0, 0, 0, places, places + k->w, places + k->w + k->q};
  for (int t = 0; t < k->w; t++)
    if (window[t] != window[t]) {
      h.u[h.nu++] = t;
      h.kept += t + k->q < w_to;
    }
  int gone = 0;
  for (int r = 0; r < k->q; r++) {
    if (y[r] == y[r]) h.there[h.seen++] = r;
    else h.gone[gone++] = r;
  }
  return h;
}

/* Whether what is there of y depends on what is missing of the window. */
FK_STATIC int fk_tells(const fk_gaps *k, const fk_holes *h) {
  for (int r = 0; r < h->seen; r++)
    for (int t = 0; t < h->nu; t++)
      if (k->sees[h->there[r] * k->w + h->u[t]] != 0.0) return 1;
  return 0;
}

/* Make a state of one branch a node from a complete one, in logarithms. */
FK_STATIC void fk_open_complete(int M, int m, const double *table, double *rows) {
  const int ld = fk_padded(M);
  memcpy(rows, table, (size_t)(1 + m) * ld * sizeof(double));
  double *T = rows + (size_t)(1 + m) * ld;
  const double *P = table + (size_t)(1 + m) * ld;
  memset(T, 0, (size_t)m * m * ld * sizeof(double));
  for (int i = 0; i < M; i++)
    for (int c = 0; c < m; c++) {
      double left = P[(size_t)(c * m + c) * ld + i];
      const double all = left;
      for (int s = 0; s < c; s++) left -= T[(size_t)(c * m + s) * ld + i] * T[(size_t)(c * m + s) * ld + i];
      if (!(left > 4e-16 * m * all)) continue; /* nothing but rounding */
      const double root = sqrt(left);
      T[(size_t)(c * m + c) * ld + i] = root;
      for (int r = c + 1; r < m; r++) {
        double a = P[(size_t)(r * m + c) * ld + i];
        for (int s = 0; s < c; s++) a -= T[(size_t)(r * m + s) * ld + i] * T[(size_t)(c * m + s) * ld + i];
        T[(size_t)(r * m + c) * ld + i] = a / root;
      }
    }
}

/* Make a matrix (e, e), whose rows are `stride` apart, lower triangular by rotations of its columns. */
FK_STATIC void fk_to_lower(int e, double *A) {
  for (int p = 0; p < e; p++)
    for (int c = p + 1; c < e; c++) {
      const double a = A[p * e + p], b = A[p * e + c], h = sqrt(a * a + b * b);
      if (!(h > 0.0)) continue;
      for (int r = p; r < e; r++) {
        const double x = A[r * e + p], z = A[r * e + c];
        A[r * e + p] = a / h * x + b / h * z;
        A[r * e + c] = a / h * z - b / h * x;
      }
      A[p * e + c] = 0.0;
    }
}

FK_INLINE size_t fk_gap_prior_scratch(const fk_gaps *k) {
  const size_t e = k->w + k->m, ld = fk_padded(k->M1 > k->M2 ? k->M1 : k->M2);
  return (1 + e + e * e + (size_t)k->depth * (1 + k->m)) * ld + FK_LANES * (2 * k->m * k->m + e + e * e + k->m * e);
}

/* Steps for one kind of processor. */
typedef struct {
  int (*step)(const fk_gaps *, const double *, int, const double *, const double *, const double *, int, double *, double *, int *,
              double *, double *);
  void (*merge)(int, int, int, const double *, double *, double *);
  void (*prior)(const fk_gaps *, const double *, int, const double *, const double *, double *, double *, double *);
} fk_gaps_engine;

#endif
