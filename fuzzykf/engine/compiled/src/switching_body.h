/* The recursion itself; included once per kind of processor (FK_NAME, FK_TARGET).
 *
 * A table (1 + m + m m, padded M) holds per node the logarithm of its probability (the scalar
 * step: the probability), the mean and the covariance of X.  u = (1, w, y').
 */

/* Inlined with constant sizes for the usual ones, so that the loops over m, q, w unroll. */
#define FK_HELD(r, i) FK_NAME(fk_held)(is_sparse, table + (size_t)(r) * ld, sources, i)
FK_TARGET static inline __attribute__((always_inline)) double FK_NAME(fk_step_sized)(
    const fk_kernel *k, const int is_sparse, const int m, const int q, const int w, const double *table, const double *sign,
    const double *u, double *out, double *out_sign, double *scratch) {
  const int n = 1 + w + q, M1 = k->M1, M2 = k->M2, ld = fk_padded(M1), to = fk_padded(M2);
  const size_t cell_size = (size_t)k->stride * FK_LANES;
  FK_V few_T[16], few_V[16], few_S[4], few_D[4]; /* sums of a small system stay in registers */
  FK_V *weight = (FK_V *)scratch, *X = weight + M1, *rest = X + (size_t)M1 * m;
  FK_V *T = m <= 4 ? few_T : rest, *V = m <= 4 ? few_V : rest + m * m;
  FK_V *S = m <= 4 ? few_S : rest + 2 * m * m, *D = m <= 4 ? few_D : rest + 2 * m * m + m;
  FK_V few_first[4], *first = m <= 4 ? few_first : rest + 2 * m * m + 2 * m;
  double peak = -INFINITY, total = 0.0, best = 0.0, *references = scratch + fk_scratch_references(M1 > M2 ? M1 : M2, m);
  int far = 0, near = 0; /* columns whose best weight is lost among its digits, and others that can be reached */
  for (int b = 0; b < FK_AS_VECTORS(k->M2); b++) {
    const double *cells = FK_CELL(k->cells, k->stride, 0, b);
    const int *sources = FK_SOURCES(b), depth = FK_DEPTH(b);
    FK_V top = FK_NAME(fk_all)(-DBL_MAX), column = FK_NAME(fk_all)(0.0);
    for (int i = 0; i < depth; i++) { /* slots */
      const double *cell = cells + i * cell_size;
      FK_V log_w = FK_ROW(cell, 0) + FK_HELD(0, i);
      FK_UNROLL for (int r = 0; r < q; r++) {
        const double *row = cell + (2 + r * n) * FK_LANES;
        FK_V z = FK_ROW(row, 0);
        FK_UNROLL for (int t = 1; t < n; t++) z += FK_ROW(row, t) * u[t];
        log_w -= z * z;
      }
      weight[i] = log_w;
      top = FK_NAME(fk_max)(top, log_w);
    }
    for (int t = 0, j = b * FK_WIDTH; t < FK_WIDTH && j < M2; t++, j++) {
      references[j] = -1.0;
      if (top[t] >= FK_NEAR || !(top[t] > FK_DEAD)) {
        near += top[t] >= FK_NEAR;
        continue;
      }
      far++;
      top[t] = fk_far_column(k, table, u, j, (double *)weight + t, FK_WIDTH, references + j);
    }
    FK_UNROLL for (int r = 0; r < m; r++) S[r] = first[r] = FK_NAME(fk_all)(0.0);
    for (int i = 0; i < depth; i++) {
      const double *cell = cells + i * cell_size;
      const double *offset = cell + (2 + q * n) * FK_LANES, *A = offset + m * n * FK_LANES;
      FK_V e = FK_NAME(fk_exp)(weight[i] - top);
      const FK_B is_top = (FK_B)(weight[i] == top);
      if (k->is_signed) {
        e *= FK_ROW(cell, 1);
        if (sign) e *= FK_NAME(fk_all)(sign[i]);
      }
      weight[i] = e;
      column += e;
      FK_UNROLL for (int r = 0; r < m; r++) {
        FK_V x = FK_ROW(offset, r * n);
        FK_UNROLL for (int t = 1; t < n; t++) x += FK_ROW(offset, r * n + t) * u[t];
        FK_UNROLL for (int l = 0; l < m; l++) x += FK_ROW(A, r * m + l) * FK_HELD(1 + l, i);
        X[(size_t)i * m + r] = x;
        first[r] = FK_NAME(fk_select)(is_top, x, first[r]);
      }
    }
    /* means as differences from the likeliest: pairs that agree then do so to the last bit, however far off */
    for (int i = 0; i < depth; i++)
      FK_UNROLL for (int r = 0; r < m; r++) {
        X[(size_t)i * m + r] -= first[r];
        S[r] += weight[i] * X[(size_t)i * m + r];
      }
    if (k->is_signed) column = FK_NAME(fk_select)((FK_B)(column == 0.0), FK_NAME(fk_all)(DBL_MIN), column);
    const FK_V inverse = 1.0 / column;
    FK_UNROLL for (int r = 0; r < m; r++) S[r] *= inverse;
    FK_UNROLL for (int r = 0; r < m * m; r++) V[r] = FK_NAME(fk_all)(0.0);
    for (int i = 0; i < depth; i++) {
      const double *A = cells + i * cell_size + (size_t)(2 + (q + m) * n) * FK_LANES;
      const FK_V o = weight[i] * inverse;
      FK_UNROLL for (int r = 0; r < m; r++) {
        D[r] = X[(size_t)i * m + r] - S[r];
        FK_UNROLL for (int l = 0; l < m; l++) {
          FK_V t = FK_NAME(fk_all)(0.0);
          FK_UNROLL for (int s = 0; s < m; s++) t += FK_ROW(A, r * m + s) * FK_HELD(1 + m + s * m + l, i);
          T[r * m + l] = t;
        }
      }
      FK_UNROLL for (int r = 0; r < m; r++)
        FK_UNROLL for (int l = r; l < m; l++) {
          FK_V P = FK_ROW(A, m * m + r * m + l) + D[r] * D[l];
          FK_UNROLL for (int s = 0; s < m; s++) P += T[r * m + s] * FK_ROW(A, l * m + s);
          V[r * m + l] += o * P;
        }
    }
    /* nodes that no path reaches get moments of zero, or they might grow without bound */
    const FK_V alive = (FK_V)((FK_B)FK_READ(k->mask, b) & (FK_B)(top >= FK_DEAD));
    for (int r = 0; r < m; r++) {
      FK_AT(out + (size_t)(1 + r) * to, b) = FK_NAME(fk_select)((FK_B)(alive != 0.0), first[r] + S[r], FK_NAME(fk_all)(0.0));
      for (int l = r; l < m; l++) {
        const FK_V P = FK_NAME(fk_select)((FK_B)(alive != 0.0), V[r * m + l], FK_NAME(fk_all)(0.0));
        FK_AT(out + (size_t)(1 + m + r * m + l) * to, b) = P;
        FK_AT(out + (size_t)(1 + m + l * m + r) * to, b) = P;
      }
    }
    for (int t = 0; t < FK_WIDTH; t++) {
      const int j = b * FK_WIDTH + t;
      out[j] = j < M2 && top[t] > FK_DEAD ? log(fabs(column[t])) + top[t] : FK_LOG_ZERO;
      if (out_sign) out_sign[j] = column[t] < 0.0 ? -1.0 : 1.0;
    }
  }
  if (far && near) { /* beside what is near the digits of the others do not count */
    for (int j = 0; j < M2; j++)
      if (references[j] >= 0.0) out[j] += fk_log_weight(k, table, (int)references[j], j, u);
  } else if (far) best = fk_far_references(k, table, u, references, out);
  for (int j = 0; j < M2; j++) peak = out[j] > peak ? out[j] : peak;
  for (int b = 0; b < FK_AS_VECTORS(k->M2); b++) {
    FK_V mass = FK_NAME(fk_exp)(FK_AT(out, b) - peak);
    if (out_sign) mass *= FK_AT(out_sign, b);
    total += FK_NAME(fk_sum)(mass * FK_READ(k->mask, b));
  }
  if (!(peak + best > FK_FARTHEST)) total = NAN;
  /* the caller looks at negative masses */
  const double log_total = peak + (total > 0.0 ? log(total) : NAN);
  for (int j = 0; j < to; j++) out[j] = j < M2 ? out[j] - log_total : 0.0; /* padding stays zero */
  return log_total + best;
}
#undef FK_HELD

FK_TARGET static double FK_NAME(fk_step)(const fk_kernel *k, const double *table, const double *sign,
                                         const double *u, double *out, double *out_sign, double *scratch) {
#define FK_SIZED(m, q, w) FK_NAME(fk_step_sized)(k, is_sparse, m, q, w, table, sign, u, out, out_sign, scratch)
#define FK_SIZES                                                                                          \
  switch (FK_OWN_SIZE(k->w == k->q && k->m <= 4 && k->q <= 2 ? 10 * k->m + k->q : 0)) {                    \
  case 11: return FK_SIZED(1, 1, 1);                                                                      \
  case 21: return FK_SIZED(2, 1, 1);                                                                      \
  case 31: return FK_SIZED(3, 1, 1);                                                                      \
  case 22: return FK_SIZED(2, 2, 2);                                                                      \
  case 42: return FK_SIZED(4, 2, 2);                                                                      \
  default: return FK_SIZED(k->m, k->q, k->w);                                                             \
  }
  if (k->is_sparse) {
    const int is_sparse = 1;
    FK_SIZES
  }
  const int is_sparse = 0;
  FK_SIZES
#undef FK_SIZES
#undef FK_SIZED
}

/* p = exp(log_p) for `blocks` vectors; the smallest of the first M. */
FK_TARGET static double FK_NAME(fk_exp_row)(const double *log_p, int M, double *p) {
  double smallest = DBL_MAX;
  for (int b = 0; b < FK_AS_VECTORS(M); b++)
    FK_AT(p, b) = FK_NAME(fk_exp)(FK_READ(log_p, b));
  for (int i = 0; i < M; i++) smallest = p[i] < smallest ? p[i] : smallest;
  return smallest;
}

/* Whether the moments of a mixture of such nodes are numbers, whose squares are there, too. */
FK_TARGET static int FK_NAME(fk_in_range)(int M, int m, const double *table) {
  const int ld = fk_padded(M), rows = 1 + m + m * m;
  FK_B fits = ~(FK_B){0};
  for (int r = 1; r < rows; r++) {
    const double limit = r <= m ? FK_LARGEST_MEAN : FK_LARGEST_COVARIANCE;
    for (int b = 0; b < FK_AS_VECTORS(M); b++) {
      const FK_V v = FK_READ(table + (size_t)r * ld, b);
      fits &= (FK_B)(v <= limit) & (FK_B)(v >= -limit);
    }
  }
  return FK_NAME(fk_every)(fits);
}

/* Mean (m) and covariance (m, m) of X' before Y' is seen. */
FK_TARGET static inline __attribute__((always_inline)) void FK_NAME(fk_prior_sized)(
    const fk_kernel *k, const fk_summary *s, const int is_sparse, const int m, const int w, const double *p, const double *table,
    const double *u, double *x, double *P, double *scratch) {
  const int M1 = k->M1, ld = fk_padded(M1), matrix = 2 + (k->q + m) * (1 + w + k->q);
  const int blocks = FK_AS_VECTORS(k->M2);
  FK_V few_V[16], few_S[4];
  double few_first[4] = {0};
  FK_V *rest = (FK_V *)scratch, *V = m <= 4 ? few_V : rest, *S = m <= 4 ? few_S : rest + m * m;
  double *first = m <= 4 ? few_first : (double *)(rest + m * m + m);
  FK_V *mean = rest + m * m + 2 * m, *now = mean; /* of the pairs: slots m */
  const int top = FK_NAME(fk_largest)(M1, p), side = s->widest[2 * top], way = s->widest[2 * top + 1];
  const int deepest = is_sparse ? fk_deepest(k) : M1;
  FK_UNROLL for (int r = 0; r < m; r++) S[r] = FK_NAME(fk_all)(0.0);
  FK_UNROLL for (int r = 0; r < m * m; r++) V[r] = FK_NAME(fk_all)(0.0);
  for (int i = 0; i < deepest; i++)
    for (int b = 0; b < blocks; b++) {
      if (is_sparse && i >= FK_DEPTH(b)) continue;
      const double *cell = FK_CELL(s->cells, s->stride, i, b);
      const double *A = FK_CELL(k->cells, k->stride, i, b) + (size_t)matrix * FK_LANES;
      const int *sources = FK_SOURCES(b);
      FK_UNROLL for (int r = 0; r < m; r++) {
        const double *row = cell + (1 + r * (1 + w)) * FK_LANES;
        FK_V a = FK_ROW(row, 0);
        FK_UNROLL for (int t = 1; t <= w; t++) a += FK_ROW(row, t) * u[t];
        FK_UNROLL for (int l = 0; l < m; l++) a += FK_ROW(A, r * m + l) * FK_NAME(fk_held)(is_sparse, table + (size_t)(1 + l) * ld, sources, i);
        now[r] = a;
        if (i == way && b == side / FK_WIDTH) first[r] = a[side % FK_WIDTH];
      }
      now += m;
    }
  now = mean; /* of one likely pair the others are differences */
  for (int i = 0; i < deepest; i++)
    for (int b = 0; b < blocks; b++) {
      if (is_sparse && i >= FK_DEPTH(b)) continue;
      const FK_V weight = FK_ROW(FK_CELL(s->cells, s->stride, i, b), 0) * FK_NAME(fk_held)(is_sparse, p, FK_SOURCES(b), i);
      FK_UNROLL for (int r = 0; r < m; r++) {
        now[r] -= first[r];
        S[r] += weight * now[r];
      }
      now += m;
    }
  FK_UNROLL for (int r = 0; r < m; r++) x[r] = FK_NAME(fk_sum)(S[r]);
  now = mean;
  for (int i = 0; i < deepest; i++)
    for (int b = 0; b < blocks; b++) {
      if (is_sparse && i >= FK_DEPTH(b)) continue;
      const double *cell = FK_CELL(s->cells, s->stride, i, b);
      FK_UNROLL for (int r = 0; r < m; r++) now[r] -= x[r];
      FK_UNROLL for (int r = 0; r < m; r++) {
        const FK_V weighted = FK_ROW(cell, 0) * FK_NAME(fk_held)(is_sparse, p, FK_SOURCES(b), i) * now[r];
        FK_UNROLL for (int l = r; l < m; l++) V[r * m + l] += weighted * now[l];
      }
      now += m;
    }
  FK_UNROLL for (int r = 0; r < m; r++)
    FK_UNROLL for (int l = r; l < m; l++) {
      FK_V within = FK_NAME(fk_all)(0.0);
      for (int b = 0; b < FK_AS_VECTORS(M1); b++) { /* here the nodes i are side by side, not j */
        FK_V all = FK_READ(s->noise + (size_t)(r * m + l) * ld, b);
        FK_UNROLL for (int a = 0; a < m * m; a++)
          all += FK_READ(table + (size_t)(1 + m + a) * ld, b) *
                 FK_READ(s->twice + ((size_t)a * m * m + r * m + l) * ld, b);
        within += FK_READ(p, b) * all;
      }
      P[r * m + l] = P[l * m + r] = FK_NAME(fk_sum)(V[r * m + l] + within);
    }
  FK_UNROLL for (int r = 0; r < m; r++) x[r] += first[r];
}

FK_TARGET static void FK_NAME(fk_prior)(const fk_kernel *k, const fk_summary *s, const double *p,
                                        const double *table, const double *u, double *x, double *P,
                                        double *scratch) {
  if (k->is_scalar) {
    FK_NAME(fk_prior_scalar)(s, k->M1, p, table, u[1], x, P);
    return;
  }
#define FK_SIZED(m, w) FK_NAME(fk_prior_sized)(k, s, is_sparse, m, w, p, table, u, x, P, scratch)
#define FK_SIZES                                                                                          \
  switch (FK_OWN_SIZE(k->w <= 2 && k->m <= 4 ? 10 * k->m + k->w : 0)) {                                    \
  case 21: FK_SIZED(2, 1); break;                                                                         \
  case 22: FK_SIZED(2, 2); break;                                                                         \
  case 31: FK_SIZED(3, 1); break;                                                                         \
  case 42: FK_SIZED(4, 2); break;                                                                         \
  default: FK_SIZED(k->m, k->w);                                                                          \
  }
  if (k->is_sparse) {
    const int is_sparse = 1;
    FK_SIZES
  } else {
    const int is_sparse = 0;
    FK_SIZES
  }
#undef FK_SIZES
#undef FK_SIZED
}

/* Mean and covariance of X, the mixture of M nodes with probabilities p (eqs. 21, 22). */
FK_TARGET static void FK_NAME(fk_posterior)(int M, int m, const double *p, const double *table, double *x,
                                            double *P) {
  const int ld = fk_padded(M), blocks = FK_AS_VECTORS(M), top = FK_NAME(fk_largest)(M, p);
  for (int r = 0; r < m; r++) {
    const double *means = table + (size_t)(1 + r) * ld, first = means[top];
    FK_V S = FK_NAME(fk_all)(0.0);
    for (int b = 0; b < blocks; b++) S += FK_READ(p, b) * (FK_READ(means, b) - first);
    x[r] = FK_NAME(fk_sum)(S);
  }
  /* so far x is what the mean is beyond that of the likeliest node */
  if (P)
  for (int r = 0; r < m; r++)
    for (int l = r; l < m; l++) {
      FK_V S = FK_NAME(fk_all)(0.0);
      for (int b = 0; b < blocks; b++) {
        const double *at = table + b * FK_WIDTH;
        const FK_V d = *(const FK_V *)(at + (size_t)(1 + r) * ld) - table[(size_t)(1 + r) * ld + top] - x[r];
        const FK_V e = *(const FK_V *)(at + (size_t)(1 + l) * ld) - table[(size_t)(1 + l) * ld + top] - x[l];
        const FK_V both = *(const FK_V *)(at + (size_t)(1 + m + r * m + l) * ld) +
                           *(const FK_V *)(at + (size_t)(1 + m + l * m + r) * ld);
        S += FK_READ(p, b) * (d * e + 0.5 * both);
      }
      P[r * m + l] = P[l * m + r] = FK_NAME(fk_sum)(S);
    }
  for (int r = 0; r < m; r++) x[r] += table[(size_t)(1 + r) * ld + top];
}
