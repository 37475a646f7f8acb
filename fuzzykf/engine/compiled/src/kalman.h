/* Linear Kalman filters of up to FK_KALMAN_LARGEST states and observed components.
 *
 * Matrices are row by row without gaps.  Nothing here allocates, and the arithmetic is that of
 * fuzzykf.engine.numpy.kalman: full matrices, Joseph's form, symmetrised at the end.
 */
#ifndef FUZZYKF_KALMAN_H
#define FUZZYKF_KALMAN_H

#include "lanes.h"

#define FK_KALMAN_LARGEST 16
#define FK_KALMAN_SQUARE (FK_KALMAN_LARGEST * FK_KALMAN_LARGEST)
#define FK_ALONE __attribute__((noinline)) /* so that its numbers are the same wherever it is called */
#define FK_LOG_2PI 1.83787706640934548356
/* A pivot that is smaller than this fraction of its diagonal entry is rounding error. */
#define FK_PIVOT_TOLERANCE (16.0 * DBL_EPSILON)

/* Neighbours in a row, wherever it begins; split up where the processor has no such vectors. */
typedef double fk_quad __attribute__((vector_size(32), aligned(8), may_alias));
typedef double fk_pair __attribute__((vector_size(16), aligned(8), may_alias));

/* One filter: n states, m observed components.  The results are members, the rest points to what
 * the caller owns. */
typedef struct {
  int n, m;
  const double *F, *Q, *H, *R;
  double alpha_sq;
  double x[FK_KALMAN_LARGEST], P[FK_KALMAN_SQUARE];
  double x_prior[FK_KALMAN_LARGEST], P_prior[FK_KALMAN_SQUARE];
  double y[FK_KALMAN_LARGEST], S[FK_KALMAN_SQUARE], K[FK_KALMAN_SQUARE];
  /* S = L D L' of the components seen; their numbers */
  double L[FK_KALMAN_SQUARE], D[FK_KALMAN_LARGEST];
  int seen[FK_KALMAN_LARGEST], n_seen;
} fk_kalman;

/* What is stored of every step of a series, as far as it is not NULL. */
typedef struct {
  double *x, *P, *x_prior, *P_prior, *log_likelihood;
} fk_kalman_output;

/* What a complete step leaves that does not depend on z. */
typedef struct {
  double P[FK_KALMAN_SQUARE], P_prior[FK_KALMAN_SQUARE], S[FK_KALMAN_SQUARE], K[FK_KALMAN_SQUARE];
  double L[FK_KALMAN_SQUARE], D[FK_KALMAN_LARGEST], log_D[FK_KALMAN_LARGEST];
} fk_kalman_gain;

/* One version of the arithmetic per kind of processor.
 *
 * predict: x, P -> x_prior, P_prior.
 * update: x_prior, P_prior -> x, P, and y, S, K, L, D; NaN in z is missing.  Returns 0 where S is
 * not positive definite; nothing but x and P is then as it was.
 * settled: the steps from t on while they are complete, with two gains in turn; the step after them. */
typedef struct {
  void (*predict)(fk_kalman *);
  int (*update)(fk_kalman *, const double *z);
  size_t (*settled)(fk_kalman *, const fk_kalman_gain *, const double *z, size_t t, size_t n_steps,
                    const double *controls, const fk_kalman_output *);
} fk_kalman_engine;

/* Log of N(y; 0, S): y, L and D of m components, and the logarithms of D. */
FK_STATIC FK_ALONE double fk_kalman_log_density(int m, const double *y, const double *L, const double *D,
                                                const double *log_D) {
  double w[FK_KALMAN_LARGEST], sum = m * FK_LOG_2PI;
  for (int i = 0; i < m; i++) {
    w[i] = y[i];
    for (int j = 0; j < i; j++) w[i] -= L[i * m + j] * w[j];
    sum += w[i] * w[i] / D[i] + log_D[i];
  }
  return -0.5 * sum;
}

/* Log of N(y; 0, S) of the components seen. */
FK_STATIC double fk_kalman_log_likelihood(const fk_kalman *f) {
  double y[FK_KALMAN_LARGEST], log_D[FK_KALMAN_LARGEST];
  for (int i = 0; i < f->n_seen; i++) y[i] = f->y[f->seen[i]], log_D[i] = log(f->D[i]);
  return fk_kalman_log_density(f->n_seen, y, f->L, f->D, log_D);
}

/* Inverse of S, of the components seen, bordered by zeros: columns of the identity, solved. */
FK_STATIC void fk_kalman_inverse(const fk_kalman *f, double *SI) {
  double w[FK_KALMAN_LARGEST];
  const int m = f->n_seen;
  if (m == 1 && f->m == 1) {
    SI[0] = 1.0 / f->D[0];
    return;
  }
  memset(SI, 0, (size_t)(f->m * f->m) * sizeof(double));
  for (int c = 0; c < m; c++) {
    for (int i = 0; i < m; i++) {
      w[i] = i == c ? 1.0 : 0.0;
      for (int j = c; j < i; j++) w[i] -= f->L[i * m + j] * w[j];
    }
    for (int i = m - 1; i >= c; i--) {
      w[i] /= f->D[i];
      for (int j = i + 1; j < m; j++) w[i] -= f->L[j * m + i] * w[j];
      SI[f->seen[i] * f->m + f->seen[c]] = SI[f->seen[c] * f->m + f->seen[i]] = w[i];
    }
  }
}

/* Keep the gain of a complete step. */
FK_STATIC void fk_kalman_keep(const fk_kalman *f, fk_kalman_gain *gain) {
  const size_t n = f->n, m = f->m;
  memcpy(gain->P, f->P, n * n * sizeof(double));
  memcpy(gain->P_prior, f->P_prior, n * n * sizeof(double));
  memcpy(gain->S, f->S, m * m * sizeof(double));
  memcpy(gain->K, f->K, n * m * sizeof(double));
  memcpy(gain->L, f->L, m * m * sizeof(double));
  memcpy(gain->D, f->D, m * sizeof(double));
  for (size_t i = 0; i < m; i++) gain->log_D[i] = log(f->D[i]);
}

/* Predict and update along n_steps observations, from x and P on; ``controls`` may be NULL.
 * Returns the number of steps done: fewer where S is not positive definite.
 *
 * The covariances of a complete series settle, often to the bit: to one value, or to two in turn where
 * rounding goes to and fro.  Then only means are left to be reckoned.  `settling` counts the steps since P
 * was what it was two steps before, of which the first two are kept; `complete` those before, up to two. */
FK_STATIC size_t fk_kalman_filter(const fk_kalman_engine *engine, fk_kalman *f, const double *z, size_t n_steps,
                                  const double *controls, const fk_kalman_output *out) {
  const size_t n = f->n, nn = n * n;
  double before[2][FK_KALMAN_SQUARE];
  fk_kalman_gain gains[2];
  int complete = 0, settling = 0;
  for (size_t t = 0; t < n_steps; t++, z += f->m) {
    int seen = 0;
    if (settling == 2) {
      const size_t end = engine->settled(f, gains, z, t, n_steps, controls, out);
      settling = complete = 0;
      z += (end - t) * f->m, t = end;
      if (t == n_steps) break;
    }
    engine->predict(f);
    if (controls)
      for (size_t i = 0; i < n; i++) f->x_prior[i] += controls[t * n + i];
    for (int i = 0; i < f->m; i++) seen += !isnan(z[i]);
    if (seen) {
      if (!engine->update(f, z)) return t;
    } else {
      memcpy(f->x, f->x_prior, n * sizeof(double));
      memcpy(f->P, f->P_prior, nn * sizeof(double));
    }
    if (out->x) memcpy(out->x + t * n, f->x, n * sizeof(double));
    if (out->P) memcpy(out->P + t * nn, f->P, nn * sizeof(double));
    if (out->x_prior) memcpy(out->x_prior + t * n, f->x_prior, n * sizeof(double));
    if (out->P_prior) memcpy(out->P_prior + t * nn, f->P_prior, nn * sizeof(double));
    if (out->log_likelihood) out->log_likelihood[t] = seen ? fk_kalman_log_likelihood(f) : 0.0;
    if (seen < f->m) {
      complete = settling = 0;
      continue;
    }
    if (settling || (complete == 2 && !memcmp(f->P, before[t % 2], nn * sizeof(double))))
      fk_kalman_keep(f, gains + settling++);
    memcpy(before[t % 2], f->P, nn * sizeof(double));
    complete += complete < 2;
  }
  return n_steps;
}

#endif
