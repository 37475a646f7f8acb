/* The exact switching recursion: tables, and one version of the arithmetic per kind of processor. */
#ifndef FUZZYKF_SWITCHING_H
#define FUZZYKF_SWITCHING_H

#include "hmm_logs.h"
#include "lanes.h"

#define FK_LOG_ZERO (-1e307)
#define FK_DEAD (0.5 * FK_LOG_ZERO)
#define FK_ALIKE 1e-14 /* coefficients that differ by less, relatively, differ by their rounding alone */
#define FK_ROUNDS 4 /* how often a better reference is looked for */
#define FK_NEAR (-500.0) /* logarithms of weights above this keep their digits beside one another */
#define FK_LARGEST_MEAN 1e153 /* of a node: its square, and that of differences, has to be a number */
#define FK_LARGEST_COVARIANCE 1e306
#define FK_FARTHEST (-1e303) /* below this a log-density comes near the end of the range; weights are NaN */
#define FK_TINY 1e-250
#define FK_HUGE 1e250

/* Tables of one step.  Columns j stand side by side in lanes, `blocks` vectors of them; the pairs of a
 * column stand one below the other in slots, as many in all columns of a block; see slots.h.
 *
 * A cell, a slot of a block, is `stride` vectors: log_scale, sign, white (q rows), offset (m rows),
 * Axx (m x m), C (m x m), each FK_LANES numbers; a row has the 1 + w + q coefficients of u = (1, w, y').
 */
typedef struct {
  int M1, M2, m, q, w, blocks, stride, is_signed, is_scalar, is_sparse;
  double *cells;
  double *mask;        /* 1 in the lanes of real columns, 0 elsewhere */
  const int *first;    /* blocks + 1: where the slots of each block begin */
  const int *source;   /* FK_LANES numbers a slot: the node i of each pair */
} fk_kernel;

/* Tables of the moments of X' before Y' is seen, and of the estimate of the switch.
 *
 * A cell, a slot of a block, is 1 + m (1 + w) rows: transition, offset of the mean.  The likeliest way from
 * node i leads to column widest[2 i], in slot widest[2 i + 1].  `noise` (m m, padded
 * M1) and `twice` (m m, m m, padded M1) carry p_i and p_i P_i to the covariance.  `ahead` (9, padded
 * M1), for scalar systems, sums up the cells; see fk_fill_ahead.  The numbers of the nodes stand in
 * `order` as the estimate of the switch looks through them, the atoms last; `ends` is not 0 at the last
 * node of a value of the switch, and 2 at the last of a stratum, of which `n_edges` are no atoms;
 * `is_plain` if every value is one node and there is one edge at most. */
typedef struct {
  int stride, n_atoms, n_edges, is_plain, M;
  const double *cells;
  const double *twice, *noise, *ahead;
  const double *nodes, *weights; /* padded M */
  const int *order, *ends, *widest;
} fk_summary;

/* Where the summaries of a series go; any of them may be NULL. */
typedef struct {
  double *x, *P, *x_prior, *P_prior, *mu, *modes, *means, *log_likelihood;
  double *table, *sign; /* the states themselves, with logarithms of probabilities */
} fk_output;

/* Sizes in doubles */
FK_INLINE int fk_padded(int M) { return (M + FK_LANES - 1) / FK_LANES * FK_LANES; }
FK_INLINE size_t fk_table_size(int M, int m) { return (size_t)(1 + m + m * m) * fk_padded(M); }
FK_INLINE int fk_cell_size(int m, int q, int w) { return 2 + (m + q) * (1 + w + q) + 2 * m * m; }
FK_INLINE size_t fk_scratch_size(int M, int m) {
  return (size_t)FK_LANES * (3 * m * m + 4 * m + 4) + (size_t)fk_padded(M) * M * (1 + m) + FK_LANES * (size_t)M +
         2 * (size_t)fk_padded(M);
}
/* Where, in the scratch of a step, the numbers of the references of the columns stand. */
FK_INLINE size_t fk_scratch_references(int M, int m) { return fk_scratch_size(M, m) - 2 * (size_t)fk_padded(M); }

#include "slots.h"

/* Fill slot s of column j from the coefficients of its pair; factor is the lower Cholesky
 * factor of Qyy.  The white rows solve L z = (y' - Ayy w - Ny), divided by sqrt(2). */
FK_STATIC void fk_fill(fk_kernel *k, int slot, int j, double transition, const double *factor, const double *Axx,
                    const double *H, const double *G, const double *c, const double *C, const double *Ayy,
                    const double *Ny) {
  const int m = k->m, q = k->q, w = k->w, n = 1 + w + q;
  double *cell = k->cells + fk_slot(k, slot, j, k->stride);
#define FK_ENTRY(index) cell[(size_t)(index)*FK_LANES]
  double log_scale = transition == 0.0 ? FK_LOG_ZERO : log(fabs(transition));
  for (int r = 0; r < q; r++) log_scale -= log(factor[r * q + r]) + 0.91893853320467274178;
  FK_ENTRY(0) = log_scale;
  FK_ENTRY(1) = transition < 0.0 ? -1.0 : (transition > 0.0 ? 1.0 : 0.0);
  for (int t = 0; t < n; t++)
    for (int r = 0; r < q; r++) {
      double a = t == 0 ? -Ny[r] : (t <= w ? -Ayy[r * w + t - 1] : (t - 1 - w == r ? 1.0 : 0.0));
      a *= 0.70710678118654752440;
      for (int s = 0; s < r; s++) a -= factor[r * q + s] * FK_ENTRY(2 + s * n + t);
      FK_ENTRY(2 + r * n + t) = a / factor[r * q + r];
    }
  const int offset = 2 + q * n;
  for (int r = 0; r < m; r++)
    for (int t = 0; t < n; t++)
      FK_ENTRY(offset + r * n + t) = t == 0 ? c[r] : (t <= w ? H[r * w + t - 1] : G[r * q + t - 1 - w]);
  const int matrix = offset + m * n;
  for (int r = 0; r < m * m; r++) {
    FK_ENTRY(matrix + r) = Axx[r];
    FK_ENTRY(matrix + m * m + r) = C[r];
  }
#undef FK_ENTRY
}

/* The cell of a pair; its entries are FK_LANES numbers apart. */
FK_INLINE const double *fk_pair(const fk_kernel *k, int slot, int j) {
  return k->cells + fk_slot(k, slot, j, k->stride);
}

/* -|z|^2 of a pair: its log-density, but for constants. */
FK_STATIC double fk_density(const fk_kernel *k, const double *cell, const double *u) {
  const int n = 1 + k->w + k->q;
  double l = 0.0;
  for (int r = 0; r < k->q; r++) {
    double z = 0.0;
    for (int t = 0; t < n; t++) z += cell[(size_t)(2 + r * n + t) * FK_LANES] * u[t];
    l -= z * z;
  }
  return l;
}

/* The same of a pair less that of another, with its digits kept: -(z_a - z_b)'(z_a + z_b), with z_a - z_b
 * from differences of coefficients.  See outliers.py of the engine in NumPy. */
FK_STATIC double fk_density_less(const fk_kernel *k, const double *a, const double *b, const double *u) {
  const int n = 1 + k->w + k->q;
  double l = 0.0;
  for (int r = 0; r < k->q; r++) {
    double less = 0.0, both = 0.0;
    for (int t = 0; t < n; t++) {
      const double of_a = a[(size_t)(2 + r * n + t) * FK_LANES], of_b = b[(size_t)(2 + r * n + t) * FK_LANES];
      if (fabs(of_a - of_b) > FK_ALIKE * fabs(of_a)) less += (of_a - of_b) * u[t];
      both += (of_a + of_b) * u[t];
    }
    l -= less * both;
  }
  return l;
}

/* log p_i + log |P_ij| + log N(y'; Ayy w + Ny, Qyy) of slot s of column j. */
FK_STATIC double fk_log_weight(const fk_kernel *k, const double *log_p, int s, int j, const double *u) {
  const double *cell = fk_pair(k, s, j);
  return log_p[fk_source(k, s, j)] + cell[0] + fk_density(k, cell, u);
}

/* The same less that of slot s' of column j', with its digits kept; FK_LOG_ZERO if the pair is not possible. */
FK_STATIC double fk_log_weight_less(const fk_kernel *k, const double *log_p, int s, int j, int other_s, int other_j,
                                    const double *u) {
  const double *a = fk_pair(k, s, j), *b = fk_pair(k, other_s, other_j);
  const double small = log_p[fk_source(k, s, j)] + a[0];
  if (!(small > FK_DEAD)) return FK_LOG_ZERO;
  return small - (log_p[fk_source(k, other_s, other_j)] + b[0]) + fk_density_less(k, a, b, u);
}

/* Log-weights of the pairs of column j relative to the best possible one, in slot `reference`, which is
 * negative if no pair is possible.  Entries of `log_w` are `stride` apart.  Returns the largest. */
FK_STATIC double fk_far_column(const fk_kernel *k, const double *log_p, const double *u, int j, double *log_w,
                               int stride, double *reference) {
  const int depth = fk_depth(k, j);
  int best = -1;
  double top = FK_LOG_ZERO, closest = 0.0;
  for (int s = 0; s < depth; s++) {
    const double l = fk_log_weight(k, log_p, s, j, u);
    if (log_p[fk_source(k, s, j)] + fk_pair(k, s, j)[0] > FK_DEAD && (best < 0 || l > closest)) best = s, closest = l;
  }
  *reference = best;
  for (int s = 0; best < 0 && s < depth; s++) log_w[(size_t)s * stride] = FK_LOG_ZERO;
  /* the best by its digits is found among those that seemed to be */
  for (int round = 0; best >= 0 && round < FK_ROUNDS; round++) {
    int better = best;
    top = FK_LOG_ZERO;
    for (int s = 0; s < depth; s++) {
      double *to = log_w + (size_t)s * stride;
      *to = fk_log_weight_less(k, log_p, s, j, best, j, u);
      if (*to > top) top = *to, better = s;
    }
    *reference = best;
    if (!(top > 0.0)) break;
    best = better;
  }
  return top;
}

/* Add to each column what its reference, a slot in `references`, is above the best of them, whose
 * log-weight is returned; none for columns without one.  log_p are the nodes that the pairs begin in. */
FK_STATIC double fk_far_references(const fk_kernel *k, const double *log_p, const double *u,
                                   const double *references, double *column) {
  int best = -1;
  double closest = 0.0, peak = FK_LOG_ZERO;
  for (int j = 0; j < k->M2; j++) {
    if (references[j] < 0.0) continue;
    const double l = fk_log_weight(k, log_p, (int)references[j], j, u);
    if (best < 0 || l > closest) best = j, closest = l;
  }
  if (best < 0) return closest;
  for (int round = 0, better = best; round < FK_ROUNDS; round++, best = better) {
    double top = 0.0;
    for (int j = 0; j < k->M2; j++) {
      if (references[j] < 0.0) continue;
      const double l = fk_log_weight_less(k, log_p, (int)references[j], j, (int)references[best], best, u);
      if (l > top) top = l, better = j;
    }
    if (!(top > 0.0)) break;
  }
  closest = fk_log_weight(k, log_p, (int)references[best], best, u);
  for (int j = 0; j < k->M2; j++) {
    if (references[j] < 0.0) continue;
    column[j] += fk_log_weight_less(k, log_p, (int)references[j], j, (int)references[best], best, u);
    if (column[j] > peak) peak = column[j];
  }
  for (int j = 0; j < k->M2; j++)
    if (references[j] >= 0.0) column[j] -= peak;
  return closest + peak;
}

/* z = L^-1 a for a lower triangle L. */
FK_STATIC void fk_whiten(int q, const double *L, const double *a, double *z) {
  for (int r = 0; r < q; r++) {
    z[r] = a[r];
    for (int s = 0; s < r; s++) z[r] -= L[r * q + s] * z[s];
    z[r] /= L[r * q + r];
  }
}

/* The log-weights of the nodes at a first observation that is far off, relative to `best`, the
 * log-density of the closest; returns the largest.  scratch holds 2 q numbers. */
FK_STATIC double fk_first_far(int M, int m, int q, const double *log_initial, const double *mean,
                              const double *factor, const double *y, double *table, double *scratch, double *best) {
  const int d = m + q;
  double *z = scratch, *z_best = scratch + q, top = FK_LOG_ZERO;
  int at = -1;
  for (int i = 0; i < M; i++) {
    double l = 0.0;
    if (!(log_initial[i] > FK_DEAD)) continue;
    for (int r = 0; r < q; r++) z[r] = y[r] - mean[(size_t)i * d + m + r];
    fk_whiten(q, factor + (size_t)i * q * q, z, z);
    for (int r = 0; r < q; r++) l -= 0.5 * z[r] * z[r];
    if (at >= 0 && l <= *best) continue;
    at = i, *best = l;
    memcpy(z_best, z, q * sizeof(double));
  }
  for (int i = 0; i < M; i++) {
    const double *L = factor + (size_t)i * q * q, *L_best = factor + (size_t)at * q * q;
    const double *mu = mean + (size_t)i * d + m, *mu_best = mean + (size_t)at * d + m;
    double log_w = log_initial[i];
    if (!(log_w > FK_DEAD)) {
      table[i] = FK_LOG_ZERO;
      continue;
    }
    int alike = 1;
    for (int r = 0; r < q * q; r++) alike &= fabs(L[r] - L_best[r]) <= 1e-14 * fabs(L[r]);
    for (int r = 0; r < q; r++) {
      log_w -= log(L[r * q + r]) + 0.91893853320467274178;
      z[r] = alike ? mu_best[r] - mu[r] : y[r] - mu[r];
    }
    fk_whiten(q, L, z, z);
    for (int r = 0; r < q; r++) {
      const double less = alike ? z[r] : z[r] - z_best[r];
      log_w -= 0.5 * less * (less + 2.0 * z_best[r]);
    }
    table[i] = log_w;
    if (log_w > top) top = log_w;
  }
  return top;
}

/* Condition the law of (r_1, Z_1) on the first observation, as first_step in NumPy.
 * mean (M, d), covariance (M, d, d), factor (M, q, q); scratch holds q (3 + m) numbers. */
FK_STATIC double fk_first(int M, int m, int q, const double *log_initial, const double *mean,
                       const double *covariance, const double *factor, const double *y, double *table, int ld,
                       double *scratch) {
  const int d = m + q;
  double peak = -INFINITY, total = 0.0, best = 0.0, *white = scratch, *root = scratch + q;
  for (int i = 0; i < M; i++) {
    const double *mu = mean + (size_t)i * d, *S = covariance + (size_t)i * d * d, *L = factor + (size_t)i * q * q;
    double log_w = log_initial[i];
    for (int r = 0; r < q; r++) {
      double a = y[r] - mu[m + r];
      for (int s = 0; s < r; s++) a -= L[r * q + s] * white[s];
      white[r] = a / L[r * q + r];
      log_w -= 0.5 * white[r] * white[r] + log(L[r * q + r]) + 0.91893853320467274178;
      for (int k = 0; k < m; k++) {
        double b = S[k * d + m + r];
        for (int s = 0; s < r; s++) b -= L[r * q + s] * root[s * m + k];
        root[r * m + k] = b / L[r * q + r];
      }
    }
    table[i] = log_w;
    if (log_w > peak) peak = log_w;
    for (int k = 0; k < m; k++) {
      double x = mu[k];
      for (int r = 0; r < q; r++) x += root[r * m + k] * white[r];
      table[(size_t)(1 + k) * ld + i] = x;
      for (int l = 0; l < m; l++) {
        double P = S[k * d + l], less = 0.0;
        for (int r = 0; r < q; r++) less += root[r * m + k] * root[r * m + l];
        P -= less;
        /* the subtraction may leave a rounding error below zero */
        table[(size_t)(1 + m + k * m + l) * ld + i] = m == 1 && P < 0.0 ? 0.0 : P;
      }
    }
  }
  if (peak < FK_NEAR && peak > FK_DEAD)
    peak = fk_first_far(M, m, q, log_initial, mean, factor, y, table, scratch + (size_t)q * (1 + m), &best);
  if (!(peak + best > FK_FARTHEST)) peak = NAN;
  for (int i = 0; i < M; i++) total += exp(table[i] - peak);
  const double log_total = peak + log(total);
  for (int i = 0; i < M; i++) table[i] -= log_total;
  return log_total + best;
}

/* Sum up the n pairs of row i of a scalar system: with the mean of X' linear in v = (1, w, x_i), the
 * average over j of its coefficients, and the triangle R of |R v|^2 = its variance over j.  a (n, 3)
 * holds the coefficients and is overwritten; rows of `ahead`: average (3), R00 R01 R02 R11 R12 R22. */
FK_STATIC void fk_fill_ahead(int i, int n, int ld, const double *transition, double *a, double *ahead) {
  double R[3][3] = {{0}};
  for (int c = 0; c < 3; c++) {
    const double first = a[c]; /* what all have in common cancels to the last bit */
    double mean = 0.0;
    for (int j = 0; j < n; j++) mean += transition[j] * (a[3 * j + c] -= first);
    for (int j = 0; j < n; j++) a[3 * j + c] = sqrt(transition[j]) * (a[3 * j + c] - mean);
    ahead[(size_t)c * ld + i] = first + mean;
  }
  for (int c = 0; c < 3; c++) { /* orthogonalise the columns */
    double norm = 0.0;
    for (int j = 0; j < n; j++) norm += a[3 * j + c] * a[3 * j + c];
    R[c][c] = sqrt(norm);
    if (norm == 0.0) continue;
    for (int j = 0; j < n; j++) a[3 * j + c] /= R[c][c];
    for (int e = c + 1; e < 3; e++) {
      for (int j = 0; j < n; j++) R[c][e] += a[3 * j + c] * a[3 * j + e];
      for (int j = 0; j < n; j++) a[3 * j + e] -= R[c][e] * a[3 * j + c];
    }
  }
  const double upper[] = {R[0][0], R[0][1], R[0][2], R[1][1], R[1][2], R[2][2]};
  for (int r = 0; r < 6; r++) ahead[(size_t)(3 + r) * ld + i] = upper[r];
}

/* The estimate of `fk_most_likely` where no nodes share a value and at most one edge is there: almost always. */
FK_INLINE int fk_most_likely_node(const fk_summary *s, const double *mu) {
  const int *order = s->order, soft = s->M - s->n_atoms;
  double atoms = 0.0, best = -INFINITY, best_inner = -INFINITY;
  int hard = 0, inner = 0;
  for (int a = soft; a < s->M; a++) {
    const double mass = mu[order[a]];
    atoms += mass;
    hard = mass > best ? order[a] : hard;
    best = mass > best ? mass : best;
  }
  for (int a = 0; a < soft; a++) {
    const double density = mu[order[a]] / s->weights[order[a]];
    inner = density > best_inner ? order[a] : inner;
    best_inner = density > best_inner ? density : best_inner;
  }
  return soft == 0 || atoms > 0.5 ? hard : inner;
}

/* The same in the likeliest stratum, on a tie the earlier one; no branch depends on mu. */
FK_STATIC double fk_most_likely_value(const fk_summary *s, const double *mu) {
  const int *order = s->order, soft = s->M - s->n_atoms;
  double stratum = 0.0, most = -INFINITY, level = 0.0, best = -INFINITY;
  int value = 0, winner = 0;
  for (int a = 0; a < s->M; a++) {
    const double mass = mu[order[a]];
    stratum += mass;
    level += a < soft ? mass / s->weights[order[a]] : mass; /* atoms by mass, the others by density */
    if (!s->ends[a]) continue;
    value = level > best ? order[a] : value;
    best = level > best ? level : best;
    level = 0.0;
    if (s->ends[a] < 2) continue;
    /* beside a single edge atoms need more than half of all, which is known without rounding */
    const double bar = a >= soft && s->n_edges == 1 ? 0.5 : most;
    winner = stratum > bar ? value : winner;
    most = stratum > most ? stratum : most;
    stratum = 0.0, best = -INFINITY;
  }
  return s->nodes[winner];
}

/* MPM, the estimate of the switch by the rule of the 2020 paper, section VI-B.  Inlined where it is called, as code
 * for other registers than those of its caller would wait for what is left in these. */
FK_INLINE double fk_most_likely(const fk_summary *s, const double *mu) {
  return s->is_plain ? s->nodes[fk_most_likely_node(s, mu)] : fk_most_likely_value(s, mu);
}

/* The arithmetic for one kind of processor; engines.h has them all. */
typedef struct {
  double (*step)(const fk_kernel *, const double *, const double *, const double *, double *, double *, double *);
  int (*step_scalar)(const fk_kernel *, const double *, double, double, double *, double *, double *);
  int (*run_scalar)(const fk_kernel *, const double *, int, double *, double *, double *);
  void (*summarise_scalar)(const fk_summary *, int, const double *, int, const double *, const double *, size_t,
                           const fk_output *);
  double (*exp_row)(const double *, int, double *);
  void (*log_pairs)(const fk_kernel *, const double *, double *);
  void (*smooth_back)(const fk_kernel *, size_t, const double *, const double *, double *, double *, double *);
  void (*best_path)(const fk_kernel *, size_t, double *, const double *, int64_t *, double *);
  void (*prior)(const fk_kernel *, const fk_summary *, const double *, const double *, const double *, double *,
                double *, double *);
  void (*posterior)(int, int, const double *, const double *, double *, double *);
  int (*in_range)(int, int, const double *);
  int (*forward_backward)(int, int, const fk_arrows *, const double *, const double *, const double *, double *, double *,
                           double *, double *);
} fk_engine;

#endif
