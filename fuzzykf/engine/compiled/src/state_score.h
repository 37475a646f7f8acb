/* What a filter says of measured states, and the gradient of that; see fuzzykf/engine/numpy/state_score.py.
 *
 * A node has the 1 + m + m m numbers log p, mean and covariance, one node after another; so have derivatives by
 * them.  Matrices are stored by rows, covariances whole.  Pairs are in any order. */
#ifndef FUZZYKF_STATE_SCORE_H
#define FUZZYKF_STATE_SCORE_H

#include <math.h>
#include <stddef.h>
#include <string.h>

#define FK_INLINE static inline __attribute__((always_inline, unused))
#define FK_HALF_LOG_2PI 0.91893853320467274178

typedef struct {
  int M, m;
  size_t T, P;
  const ptrdiff_t *source, *target;         /* (P) */
  const double *log_weight, *offset, *A, *C; /* (T, P), (T, P, m), (P, m, m), (P, m, m) */
  const double *xs;                         /* (T + 1, m) */
} fk_moves;

/* Derivatives by moves; `log_weight` holds the shares of the pairs before. */
typedef struct {
  double *log_weight, *offset, *A, *C;
} fk_moves_slope;

FK_INLINE size_t fk_law_size(int m) { return 1 + (size_t)m + (size_t)m * m; }

FK_INLINE int fk_is_measured(const int m, const double *x) {
  for (int r = 0; r < m; r++)
    if (!isfinite(x[r])) return 0;
  return 1;
}

/* Mean of X' given a pair. */
FK_INLINE void fk_pair_mean(const fk_moves *k, const int m, size_t p, const double *offset, const double *before,
                            double *x) {
  for (int r = 0; r < m; r++) {
    x[r] = offset[r];
    for (int c = 0; c < m; c++) x[r] += k->A[(p * m + r) * m + c] * before[1 + c];
  }
}

/* Means and covariances of X' given a pair; AV is A V. */
FK_INLINE void fk_pair_moments(const fk_moves *k, const int m, size_t p, const double *offset, const double *before,
                               double *x, double *V, double *AV) {
  const double *A = k->A + p * m * m, *mean = before + 1, *covariance = mean + m;
  for (int r = 0; r < m; r++) {
    x[r] = offset[r];
    for (int c = 0; c < m; c++) {
      double sum = 0.0;
      for (int t = 0; t < m; t++) sum += A[r * m + t] * covariance[t * m + c];
      AV[r * m + c] = sum;
      x[r] += A[r * m + c] * mean[c];
    }
  }
  for (int r = 0; r < m; r++)
    for (int c = r; c < m; c++) {
      double sum = k->C[(p * m + r) * m + c];
      for (int t = 0; t < m; t++) sum += AV[r * m + t] * A[c * m + t];
      V[r * m + c] = V[c * m + r] = sum;
    }
}

/* Log-weights of all nodes after a step, in `to` with their moments, and the shares of the pairs. */
FK_INLINE void fk_score_move(const fk_moves *k, const int m, size_t n, const double *before, double *to, double *share,
                             double *room) {
  const size_t size = fk_law_size(m), P = k->P;
  const double *w = k->log_weight + n * P, *offset = k->offset + n * P * m;
  double *top = room, *x = top + k->M, *V = x + m, *AV = V + m * m;
  memset(to, 0, k->M * size * sizeof(double));
  for (int j = 0; j < k->M; j++) top[j] = -INFINITY;
  for (size_t p = 0; p < P; p++) {
    share[p] = before[k->source[p] * size] + w[p];
    double *best = top + k->target[p];
    *best = share[p] > *best || isnan(share[p]) ? share[p] : *best;
  }
  for (size_t p = 0; p < P; p++) {
    const double peak = top[k->target[p]];
    share[p] = peak == -INFINITY ? 0.0 : exp(share[p] - peak);
    to[k->target[p] * size] += share[p];
  }
  for (size_t p = 0; p < P; p++) {
    if (share[p] == 0.0) continue;
    double *node = to + k->target[p] * size;
    share[p] /= node[0];
    fk_pair_mean(k, m, p, offset + p * m, before + k->source[p] * size, x);
    for (int r = 0; r < m; r++) node[1 + r] += share[p] * x[r];
  }
  for (size_t p = 0; p < P; p++) {
    if (share[p] == 0.0) continue;
    double *node = to + k->target[p] * size;
    fk_pair_moments(k, m, p, offset + p * m, before + k->source[p] * size, x, V, AV);
    for (int r = 0; r < m; r++) x[r] -= node[1 + r];
    for (int r = 0; r < m; r++)
      for (int c = 0; c < m; c++) node[1 + m + r * m + c] += share[p] * (V[r * m + c] + x[r] * x[c]);
  }
  for (int j = 0; j < k->M; j++) to[j * size] = log(to[j * size]) + top[j];
}

/* Log-weights of nodes to logarithms of probabilities; returns the logarithm of their sum. */
FK_INLINE double fk_score_weigh(int M, size_t size, double *state) {
  double top = -INFINITY, sum = 0.0;
  for (int j = 0; j < M; j++) {
    const double one = state[j * size];
    top = one > top || isnan(one) ? one : top;
  }
  if (!isfinite(top)) return NAN;
  for (int j = 0; j < M; j++) sum += exp(state[j * size] - top);
  const double total = top + log(sum);
  for (int j = 0; j < M; j++) state[j * size] -= total;
  return total;
}

/* Inverse of the factor of a covariance, L^-1, lower triangular; returns log |L|, NaN where there is none. */
FK_INLINE double fk_inverse_root(const int m, const double *V, double *L, double *root) {
  double log_det = 0.0;
  for (int r = 0; r < m; r++)
    for (int c = 0; c <= r; c++) {
      double sum = V[r * m + c];
      for (int t = 0; t < c; t++) sum -= L[r * m + t] * L[c * m + t];
      if (r > c) {
        L[r * m + c] = sum / L[c * m + c];
        continue;
      }
      if (!(sum > 0.0)) return NAN;
      L[r * m + r] = sqrt(sum);
      log_det += log(L[r * m + r]);
    }
  for (int c = 0; c < m; c++)
    for (int r = 0; r < m; r++) {
      double sum = r == c ? 1.0 : 0.0;
      for (int t = c; t < r; t++) sum -= L[r * m + t] * root[t * m + c];
      root[r * m + c] = r < c ? 0.0 : sum / L[r * m + r];
    }
  return log_det;
}

/* Score of a measured state; to `g`, unless it is NULL, the derivatives by the nodes are added.
 * Returns infinity if a covariance is not positive definite. */
FK_INLINE double fk_score_state(const int M, const int m, const double *state, const double *x, double *g,
                                double *room) {
  const size_t size = fk_law_size(m);
  double *terms = room, *L = terms + M, *root = L + m * m, *white = root + m * m, *h = white + m;
  double top = -INFINITY, sum = 0.0;
  for (int pass = 0; pass < (g ? 2 : 1); pass++)
    for (int j = 0; j < M; j++) {
      const double *node = state + j * size;
      if (isinf(node[0])) {
        terms[j] = -INFINITY;
        continue;
      }
      const double log_det = fk_inverse_root(m, node + 1 + m, L, root);
      if (isnan(log_det)) return INFINITY;
      double square = 0.0;
      for (int r = 0; r < m; r++) {
        white[r] = 0.0;
        for (int c = 0; c <= r; c++) white[r] += root[r * m + c] * (x[c] - node[1 + c]);
        square += white[r] * white[r];
      }
      if (pass == 0) {
        terms[j] = node[0] - 0.5 * square - log_det - m * FK_HALF_LOG_2PI;
        top = terms[j] > top ? terms[j] : top;
        continue;
      }
      if (sum == 0.0)
        for (int i = 0; i < M; i++) sum += exp(terms[i] - top);
      double *by = g + j * size;
      const double share = exp(terms[j] - top) / sum;
      for (int r = 0; r < m; r++) {
        h[r] = 0.0;
        for (int t = r; t < m; t++) h[r] += root[t * m + r] * white[t];
      }
      by[0] += share;
      for (int r = 0; r < m; r++) {
        by[1 + r] += share * h[r];
        for (int c = 0; c < m; c++) {
          double precision = 0.0;
          for (int t = r > c ? r : c; t < m; t++) precision += root[t * m + r] * root[t * m + c];
          by[1 + m + r * m + c] += 0.5 * share * (h[r] * h[c] - precision);
        }
      }
    }
  if (sum == 0.0)
    for (int i = 0; i < M; i++) sum += exp(terms[i] - top);
  return top + log(sum);
}

/* Forward: states (T + 1, M, 1 + m + m m), of which the first is given; shares (T, P).  Returns 0 where no node gives
 * an observation a density, -1 where a covariance is not positive definite. */
FK_INLINE int fk_score_forward(const fk_moves *k, const int m, double *states, double *share, double *log_density,
                               double *log_likelihood, double *room) {
  const size_t size = fk_law_size(m), all = k->M * size;
  for (size_t n = 0; n <= k->T; n++) {
    double *state = states + n * all;
    if (n) fk_score_move(k, m, n - 1, state - all, state, share + (n - 1) * k->P, room);
    log_likelihood[n] = fk_score_weigh(k->M, size, state);
    if (isnan(log_likelihood[n])) return 0;
    log_density[n] = NAN;
    if (!fk_is_measured(m, k->xs + n * m)) continue;
    log_density[n] = fk_score_state(k->M, m, state, k->xs + n * m, NULL, room);
    if (isinf(log_density[n]) && log_density[n] > 0.0) return -1;
  }
  return 1;
}

/* From derivatives g by the state after step n to those by the one before it, added to `to`. */
FK_INLINE void fk_score_back(const fk_moves *k, const fk_moves_slope *by, const int m, size_t n, const double *before,
                             const double *after, const double *g, double *to, double *room) {
  const size_t size = fk_law_size(m), P = k->P;
  double *share = by->log_weight + n * P, *common = room, *value = common + k->M, *x = value + P, *V = x + m,
         *AV = V + m * m, *by_x = AV + m * m, *GA = by_x + m;
  for (int j = 0; j < k->M; j++) common[j] = 0.0;
  for (size_t p = 0; p < P; p++) {
    const double *node = after + k->target[p] * size, *slope = g + k->target[p] * size;
    const double *one = before + k->source[p] * size, *A = k->A + p * m * m, *g_V = slope + 1 + m;
    double *at = to + k->source[p] * size, *by_A = by->A + p * m * m, *by_C = by->C + p * m * m, sum = 0.0;
    if (share[p] == 0.0) {
      for (int r = 0; r < m; r++) by->offset[(n * P + p) * m + r] = 0.0;
      continue;
    }
    fk_pair_moments(k, m, p, k->offset + (n * P + p) * m, one, x, V, AV);
    for (int r = 0; r < m; r++) x[r] -= node[1 + r];
    for (int r = 0; r < m; r++) {
      double turned = 0.0;
      for (int c = 0; c < m; c++) {
        turned += g_V[r * m + c] * x[c];
        sum += g_V[r * m + c] * V[r * m + c];
      }
      sum += (slope[1 + r] + turned) * x[r];
      by_x[r] = share[p] * (slope[1 + r] + 2.0 * turned);
      by->offset[(n * P + p) * m + r] = by_x[r];
    }
    value[p] = sum;
    common[k->target[p]] += share[p] * sum;
    for (int r = 0; r < m; r++)
      for (int c = 0; c < m; c++) {
        double twice = 0.0, turned = 0.0;
        for (int t = 0; t < m; t++) {
          twice += g_V[r * m + t] * AV[t * m + c];
          turned += g_V[r * m + t] * A[t * m + c];
        }
        by_A[r * m + c] += by_x[r] * one[1 + c] + 2.0 * share[p] * twice;
        by_C[r * m + c] += share[p] * g_V[r * m + c];
        GA[r * m + c] = share[p] * turned;
      }
    for (int r = 0; r < m; r++) {
      for (int t = 0; t < m; t++) at[1 + r] += A[t * m + r] * by_x[t];
      for (int c = 0; c < m; c++)
        for (int t = 0; t < m; t++) at[1 + m + r * m + c] += A[t * m + r] * GA[t * m + c];
    }
  }
  /* by the log of a share, less what all the shares of a node have in common, as they sum to one */
  for (size_t p = 0; p < P; p++) {
    if (share[p] == 0.0) continue;
    share[p] *= value[p] - common[k->target[p]] + g[k->target[p] * size];
    to[k->source[p] * size] += share[p];
  }
}

/* All the way back; `now` and `to` (M, 1 + m + m m) begin with zeros.  Returns the one that ends with the derivatives
 * by the first state. */
FK_INLINE const double *fk_score_backward(const fk_moves *k, const fk_moves_slope *by, const int m, double alpha,
                                          const double *states, double *now, double *to, double *room) {
  const size_t size = fk_law_size(m), all = k->M * size;
  for (size_t n = k->T;; n--) {
    const double *state = states + n * all, *x = k->xs + n * m;
    double total = 0.0, *other = now;
    if (fk_is_measured(m, x)) fk_score_state(k->M, m, state, x, now, room);
    for (int j = 0; j < k->M; j++) total += now[j * size];
    for (int j = 0; j < k->M; j++) now[j * size] += exp(state[j * size]) * (alpha - total);
    if (n == 0) return now;
    memset(to, 0, all * sizeof(double));
    fk_score_back(k, by, m, n - 1, state - all, state, now, to, room);
    now = to;
    to = other;
  }
}

/* Numbers of room that the functions above need. */
FK_INLINE size_t fk_score_room(int M, int m, size_t P) { return M + P + 4 * (size_t)m * m + 4 * (size_t)m; }

static int fk_score_forward_any(const fk_moves *k, double *states, double *share, double *log_density,
                                double *log_likelihood, double *room) {
  if (k->m == 1) return fk_score_forward(k, 1, states, share, log_density, log_likelihood, room);
  return fk_score_forward(k, k->m, states, share, log_density, log_likelihood, room);
}

static const double *fk_score_backward_any(const fk_moves *k, const fk_moves_slope *by, double alpha,
                                           const double *states, double *now, double *to, double *room) {
  if (k->m == 1) return fk_score_backward(k, by, 1, alpha, states, now, to, room);
  return fk_score_backward(k, by, k->m, alpha, states, now, to, room);
}

#endif
