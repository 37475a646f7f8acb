/* The recursion for scalar x and y, on probabilities instead of their logarithms and without maxima;
 * included once per kind of processor.
 *
 * A table holds three rows of padded M numbers: probabilities p, means x and variances P of the nodes.
 * The weights of the pairs depend on observations alone, so those of many steps are computed ahead:
 * the processor then works on the next exponentials while it waits for the state. */

/* |P_ij| N(y'; Ayy w + Ny, Qyy) of all pairs, slot by slot of one vector of columns after the other. */
FK_INLINE_HERE void FK_NAME(fk_pair_weights)(const fk_kernel *k, double w, double y, FK_V *weights) {
  const int blocks = FK_AS_VECTORS(k->M2);
  const size_t row = (size_t)k->stride * FK_LANES;
  for (int b = 0; b < blocks; b++) {
    const double *cell = FK_CELL(k->cells, k->stride, 0, b);
    for (int left = FK_DEPTH(b); left > 0; left--, cell += row) {
      const FK_V z = FK_ROW(cell, 2) + FK_ROW(cell, 3) * w + FK_ROW(cell, 4) * y;
      *weights++ = FK_NAME(fk_exp)(FK_ROW(cell, 0) - z * z);
    }
  }
}

/* One step, given the weights of its pairs; X holds as many vectors as a column has slots, and `weights` is
 * overwritten.
 * Returns 0, and nothing else of use, where a sum comes near the ends of the range of numbers. */
FK_INLINE_HERE int FK_NAME(fk_step_weighted)(const fk_kernel *k, const int is_sparse, const double *table,
                                             double w, double y, FK_V *weights, FK_V *X, double *out,
                                             double *total) {
  const int blocks = FK_AS_VECTORS(k->M2), ld = fk_padded(k->M1), to = fk_padded(k->M2);
  const double *p = table, *x = table + ld, *P = table + 2 * ld;
  const size_t row = (size_t)k->stride * FK_LANES;
  FK_V *e = weights;
  FK_V sum = FK_NAME(fk_all)(0.0), least = FK_NAME(fk_all)(-DBL_MAX);
  for (int b = 0; b < blocks; b++) {
    const double *cells = FK_CELL(k->cells, k->stride, 0, b);
    const int *sources = FK_SOURCES(b), depth = FK_DEPTH(b);
    /* two sums each, of even and of odd slots: half as long a chain of additions */
    FK_V column = FK_NAME(fk_all)(0.0), S = column, V = column, column_ = column, S_ = column, V_ = column;
#define FK_HELD(row, i) FK_NAME(fk_held)(is_sparse, row, sources, i)
#define FK_PAIR(i, column, S)                                                                              \
  do {                                                                                                    \
    const double *cell = cells + (i) * row;                                                               \
    X[i] = FK_ROW(cell, 5) + FK_ROW(cell, 6) * w + FK_ROW(cell, 7) * y + FK_ROW(cell, 8) * FK_HELD(x, i) - first; \
    e[i] *= FK_HELD(p, i);                                                                                         \
    column += e[i];                                                                                       \
    S += e[i] * X[i];                                                                                     \
  } while (0)
#define FK_SPREAD(i, V)                                                                                    \
  do {                                                                                                    \
    const double *cell = cells + (i) * row;                                                               \
    const FK_V d = X[i] - off;                                                                            \
    V += e[i] * (d * d + (FK_ROW(cell, 8) * FK_HELD(P, i) * FK_ROW(cell, 8) + FK_ROW(cell, 9)));          \
  } while (0)
    /* means as differences from the first: pairs that agree then do so to the last bit, however far off */
    const FK_V first = FK_ROW(cells, 5) + FK_ROW(cells, 6) * w + FK_ROW(cells, 7) * y + FK_ROW(cells, 8) * FK_HELD(x, 0);
    int i;
    for (i = 0; i + 1 < depth; i += 2) {
      FK_PAIR(i, column, S);
      FK_PAIR(i + 1, column_, S_);
    }
    if (i < depth) FK_PAIR(i, column, S);
    const FK_V all = column + column_, inverse = 1.0 / all, off = (S + S_) * inverse;
    for (i = 0; i + 1 < depth; i += 2) {
      FK_SPREAD(i, V);
      FK_SPREAD(i + 1, V_);
    }
    if (i < depth) FK_SPREAD(i, V);
#undef FK_HELD
#undef FK_PAIR
#undef FK_SPREAD
    const FK_V mass = all * FK_READ(k->mask, b);
    FK_AT(out, b) = mass;
    FK_AT(out + to, b) = first + off;
    FK_AT(out + 2 * to, b) = (V + V_) * inverse;
    sum += mass;
    least = FK_NAME(fk_max)(-all, least); /* lanes beyond M2 have columns of one, or the last one's */
    e += depth;
  }
  const double whole = FK_NAME(fk_sum)(sum), scale = 1.0 / whole;
  for (int b = 0; b < blocks; b++) FK_AT(out, b) *= scale;
  *total = whole;
  double smallest = DBL_MAX;
  for (int t = 0; t < FK_WIDTH; t++) smallest = -least[t] < smallest ? -least[t] : smallest;
  return smallest > FK_TINY && smallest * scale > FK_TINY && whole < FK_HUGE;
}

FK_TARGET static int FK_NAME(fk_step_scalar)(const fk_kernel *k, const double *table, double w, double y,
                                             double *out, double *total, double *scratch) {
  FK_V *X = (FK_V *)scratch, *weights = X + k->M1;
  FK_NAME(fk_pair_weights)(k, w, y, weights);
  if (k->is_sparse) return FK_NAME(fk_step_weighted)(k, 1, table, w, y, weights, X, out, total);
  return FK_NAME(fk_step_weighted)(k, 0, table, w, y, weights, X, out, total);
}

FK_INLINE_HERE int FK_NAME(fk_run_scalar_laid_out)(const fk_kernel *k, const int is_sparse, const double *y, int n,
                                                   double *tables, double *totals, double *scratch) {
  const size_t size = 3 * (size_t)fk_padded(k->M2), pairs = (size_t)fk_slots(k) * (FK_LANES / FK_WIDTH);
  FK_V *X = (FK_V *)scratch, *weights = X + k->M1;
  for (int t = 0; t < n; t++) FK_NAME(fk_pair_weights)(k, y[t], y[t + 1], weights + t * pairs);
  for (int t = 0; t < n; t++)
    if (!FK_NAME(fk_step_weighted)(k, is_sparse, tables + t * size, y[t], y[t + 1], weights + t * pairs, X,
                                   tables + (t + 1) * size, totals + t))
      return t;
  return n;
}

/* Up to n steps along y[0], y[1], ..., from tables[0] on, the others going to tables[1], ...; returns
 * how many of them came to an end. */
FK_TARGET static int FK_NAME(fk_run_scalar)(const fk_kernel *k, const double *y, int n, double *tables,
                                            double *totals, double *scratch) {
  if (k->is_sparse) return FK_NAME(fk_run_scalar_laid_out)(k, 1, y, n, tables, totals, scratch);
  return FK_NAME(fk_run_scalar_laid_out)(k, 0, y, n, tables, totals, scratch);
}

/* Mean and variance of X' before y' is seen, in O(M), `top` being the likeliest node: the means a_ij of the pairs
 * are linear in v = (1, w, x_i), so their average over j is, too, and their variance over j is |R_i v|^2. */
FK_INLINE_HERE void FK_NAME(fk_prior_from)(const fk_summary *s, int M, int top, const double *p, const double *table,
                                           double w, double *x, double *P) {
  const int blocks = FK_AS_VECTORS(M), ld = fk_padded(M);
  const double *rows = s->ahead;
#define FK_AHEAD(r) FK_READ(rows + (size_t)(r)*ld, b)
  const double first = rows[top] + rows[ld + top] * w + rows[2 * ld + top] * table[ld + top];
  FK_V sum = FK_NAME(fk_all)(0.0);
  for (int b = 0; b < blocks; b++)
    sum += FK_READ(p, b) * (FK_AHEAD(0) + FK_AHEAD(1) * w + FK_AHEAD(2) * FK_READ(table + ld, b) - first);
  const double off = FK_NAME(fk_sum)(sum);
  sum = FK_NAME(fk_all)(0.0);
  for (int b = 0; b < blocks; b++) {
    const FK_V at = FK_READ(table + ld, b), d = FK_AHEAD(0) + FK_AHEAD(1) * w + FK_AHEAD(2) * at - first - off;
    const FK_V one = FK_AHEAD(3) + FK_AHEAD(4) * w + FK_AHEAD(5) * at;
    const FK_V two = FK_AHEAD(6) * w + FK_AHEAD(7) * at, three = FK_AHEAD(8) * at;
    const FK_V within = FK_READ(s->noise, b) + FK_READ(s->twice, b) * FK_READ(table + 2 * ld, b);
    sum += FK_READ(p, b) * (d * d + (one * one + (two * two + (three * three + within))));
  }
#undef FK_AHEAD
  *x = first + off;
  *P = FK_NAME(fk_sum)(sum);
}

FK_TARGET static void FK_NAME(fk_prior_scalar)(const fk_summary *s, int M, const double *p, const double *table,
                                               double w, double *x, double *P) {
  FK_NAME(fk_prior_from)(s, M, FK_NAME(fk_largest)(M, p), p, table, w, x, P);
}

/* Write what is known after n observations, number `first` and those after it; tables[0] stands for
 * the one before them, and y[0] is that observation. */
FK_TARGET static void FK_NAME(fk_summarise_scalar)(const fk_summary *s, int M, const double *y, int n,
                                                   const double *tables, const double *totals, size_t first,
                                                   const fk_output *out) {
  const int ld = fk_padded(M), blocks = FK_AS_VECTORS(M);
  const size_t size = 3 * (size_t)ld;
  int before, top = FK_NAME(fk_largest)(M, tables);
  for (int t = 0; t < n; t++) {
    const double *table = tables + (t + 1) * size;
    const size_t k = first + t;
    before = top, top = FK_NAME(fk_largest)(M, table);
    if (out->log_likelihood) out->log_likelihood[k] = log(totals[t]);
    if (out->mu) memcpy(out->mu + k * M, table, M * sizeof(double));
    if (out->modes) out->modes[k] = fk_most_likely(s, table); /* MPM */
    if (out->means) {
      FK_V sum = FK_NAME(fk_all)(0.0);
      for (int b = 0; b < blocks; b++) sum += FK_READ(table, b) * FK_READ(s->nodes, b);
      out->means[k] = FK_NAME(fk_sum)(sum);
    }
    if (out->x || out->P) {
      const double first = table[ld + top];
      FK_V sum = FK_NAME(fk_all)(0.0);
      for (int b = 0; b < blocks; b++) sum += FK_READ(table, b) * (FK_READ(table + ld, b) - first);
      const double off = FK_NAME(fk_sum)(sum);
      if (out->x) out->x[k] = first + off;
      sum = FK_NAME(fk_all)(0.0);
      for (int b = 0; b < blocks; b++) {
        const FK_V d = FK_READ(table + ld, b) - first - off;
        sum += FK_READ(table, b) * (d * d + FK_READ(table + 2 * ld, b));
      }
      if (out->P) out->P[k] = FK_NAME(fk_sum)(sum);
    }
    if (out->x_prior || out->P_prior) {
      double x, P;
      FK_NAME(fk_prior_from)(s, M, before, table - size, table - size, y[t], &x, &P);
      if (out->x_prior) out->x_prior[k] = x;
      if (out->P_prior) out->P_prior[k] = P;
    }
  }
}
