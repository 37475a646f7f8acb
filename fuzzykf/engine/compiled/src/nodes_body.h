/* Steps of state-space models on nodes; included once per kind of processor (FK_NAME, FK_TARGET, FK_WIDTH).
 *
 * The functions called sized are inlined with constant sizes for the usual ones, so that their loops
 * unroll; those that call them stand alone, as they take long to compile.  Covariances are whole and
 * symmetric.
 */

#if FK_WIDTH > 2
#define FK_STATES FK_SIZE(1) FK_SIZE(2) FK_SIZE(3) FK_SIZE(4)
#define FK_SYSTEMS FK_SIZE(1, 1) FK_SIZE(2, 1) FK_SIZE(2, 2) FK_SIZE(3, 1) FK_SIZE(4, 1) FK_SIZE(4, 2)
#else
#define FK_STATES
#define FK_SYSTEMS
#endif
#define FK_APART FK_TARGET static __attribute__((noinline))

/* Entry r of a parameter at the nodes of vector b. */
#define FK_OF(name, r) FK_READ(k->name + (size_t)(r) * ld, b)

FK_INLINE_HERE int FK_NAME(fk_any)(FK_B mask) {
  int any = 0;
  for (int t = 0; t < FK_WIDTH; t++) any |= mask[t] != 0;
  return any;
}

FK_INLINE_HERE FK_V FK_NAME(fk_logs)(FK_V a) {
  for (int t = 0; t < FK_WIDTH; t++) a[t] = log(a[t]);
  return a;
}

/* Moments of the mixtures of `depth` slots by their shares: of the nodes `from` a table, or of pairs that
 * stand in `slots`. */
#define FK_SLOT(s, r) \
  (!of_pairs ? FK_NAME(fk_all)(table[(size_t)(1 + (r)) * ld + from[s]]) : slots[(size_t)(s) * (2 + m + m * m) + 2 + (r)])
FK_INLINE_HERE void FK_NAME(fk_merge_sized)(const int of_pairs, const int m, const int depth, const FK_V *share,
                                      const int *from, const double *table, const size_t ld, const FK_V *slots,
                                      FK_V *x, FK_V *P) {
  FK_V first[FK_NODES_LARGEST], d[FK_NODES_LARGEST], most = share[0];
  /* from the likeliest on: what all have in common then cancels to the last bit, however large */
  FK_UNROLL for (int r = 0; r < m; r++) first[r] = FK_SLOT(0, r), x[r] = FK_NAME(fk_all)(0.0);
  for (int s = 1; s < depth; s++) {
    const FK_B more = (FK_B)(share[s] > most);
    most = FK_NAME(fk_select)(more, share[s], most);
    FK_UNROLL for (int r = 0; r < m; r++) first[r] = FK_NAME(fk_select)(more, FK_SLOT(s, r), first[r]);
  }
  for (int s = 0; s < depth; s++)
    FK_UNROLL for (int r = 0; r < m; r++) x[r] += share[s] * (FK_SLOT(s, r) - first[r]);
  FK_UNROLL for (int r = 0; r < m * m; r++) P[r] = FK_NAME(fk_all)(0.0);
  for (int s = 0; s < depth; s++) {
    FK_UNROLL for (int r = 0; r < m; r++) d[r] = FK_SLOT(s, r) - first[r] - x[r];
    FK_UNROLL for (int r = 0; r < m; r++)
      FK_UNROLL for (int c = r; c < m; c++) P[r * m + c] += share[s] * (FK_SLOT(s, m + r * m + c) + d[r] * d[c]);
  }
  FK_UNROLL for (int r = 0; r < m; r++) {
    x[r] += first[r];
    FK_UNROLL for (int c = 0; c < r; c++) P[r * m + c] = P[c * m + r];
  }
}
#undef FK_SLOT

FK_APART void FK_NAME(fk_merge_nodes)(const int m, const int depth, const FK_V *share, const int *from,
                                      const double *table, const size_t ld, FK_V *x, FK_V *P) {
#define FK_SIZE(m) case m: FK_NAME(fk_merge_sized)(0, m, depth, share, from, table, ld, share, x, P); return;
  switch (FK_OWN_SIZE(m)) {
    FK_STATES
    default: FK_NAME(fk_merge_sized)(0, m, depth, share, from, table, ld, share, x, P);
  }
#undef FK_SIZE
}

FK_APART void FK_NAME(fk_merge_pairs)(const int m, const int depth, const FK_V *share, const FK_V *slots, FK_V *x,
                                      FK_V *P) {
#define FK_SIZE(m) case m: FK_NAME(fk_merge_sized)(1, m, depth, share, NULL, NULL, 0, slots, x, P); return;
  switch (FK_OWN_SIZE(m)) {
    FK_STATES
    default: FK_NAME(fk_merge_sized)(1, m, depth, share, NULL, NULL, 0, slots, x, P);
  }
#undef FK_SIZE
}

/* x1 = F x + b, P1 = F P F' + Q at the nodes of vector b. */
FK_INLINE_HERE void FK_NAME(fk_carry_sized)(const fk_nodes *k, const int m, const int b, const FK_V *x, const FK_V *P,
                                      FK_V *x1, FK_V *P1) {
  const size_t ld = fk_padded(k->M);
  FK_V row[FK_NODES_LARGEST];
  FK_UNROLL for (int r = 0; r < m; r++) {
    FK_V sum = FK_OF(b, r);
    FK_UNROLL for (int c = 0; c < m; c++) sum += FK_OF(F, r * m + c) * x[c];
    x1[r] = sum;
    FK_UNROLL for (int c = 0; c < m; c++) {
      sum = FK_OF(F, r * m) * P[c];
      FK_UNROLL for (int t = 1; t < m; t++) sum += FK_OF(F, r * m + t) * P[t * m + c];
      row[c] = sum;
    }
    FK_UNROLL for (int c = r; c < m; c++) {
      sum = FK_OF(Q, r * m + c);
      FK_UNROLL for (int t = 0; t < m; t++) sum += FK_OF(F, c * m + t) * row[t];
      P1[r * m + c] = P1[c * m + r] = sum;
    }
  }
}

FK_APART void FK_NAME(fk_carry)(const fk_nodes *k, const int b, const FK_V *x, const FK_V *P, FK_V *x1, FK_V *P1) {
#define FK_SIZE(m) case m: FK_NAME(fk_carry_sized)(k, m, b, x, P, x1, P1); return;
  switch (FK_OWN_SIZE(k->m)) {
    FK_STATES
    default: FK_NAME(fk_carry_sized)(k, k->m, b, x, P, x1, P1);
  }
#undef FK_SIZE
}

/* Condition x and P on the n components `seen` of y, at the nodes of vector b that are possible; 0 where the
 * covariance S of what is seen is singular at one of them. */
#define FK_SEEN(a) (is_all ? (a) : seen[a])
FK_INLINE_HERE int FK_NAME(fk_condition_sized)(const fk_nodes *k, const int m, const int n, const int is_all,
                                         const int *seen, const int b, const double *y, const FK_B possible,
                                         FK_V *x, FK_V *P, FK_V *log_density) {
  const size_t ld = fk_padded(k->M);
  const int q = k->q;
  FK_V v[FK_NODES_LARGEST], u[FK_NODES_LARGEST], D[FK_NODES_LARGEST], L[FK_NODES_SQUARE];
  FK_V W[FK_NODES_SQUARE], G[FK_NODES_SQUARE]; /* H P, then the gain, a row for each component seen */
  FK_V A[FK_NODES_SQUARE], after[FK_NODES_SQUARE], row[FK_NODES_LARGEST], noise[FK_NODES_LARGEST];
  FK_V distance = FK_NAME(fk_all)(0.0), product = FK_NAME(fk_all)(1.0), log_det = FK_NAME(fk_all)(0.0);
  FK_B singular = possible & ~possible;
  FK_UNROLL for (int a = 0; a < n; a++) {
    const int at = FK_SEEN(a);
    v[a] = y[at] - FK_OF(d, at);
    FK_UNROLL for (int r = 0; r < m; r++) {
      FK_V sum = FK_OF(H, at * m) * P[r];
      FK_UNROLL for (int c = 1; c < m; c++) sum += FK_OF(H, at * m + c) * P[c * m + r];
      W[a * m + r] = G[a * m + r] = sum;
    }
    FK_UNROLL for (int c = 0; c < m; c++) v[a] -= FK_OF(H, at * m + c) * x[c];
  }
  /* S = L D L', and L u = v */
  FK_UNROLL for (int a = 0; a < n; a++) {
    const int at = FK_SEEN(a);
    FK_V pivot = FK_NAME(fk_all)(0.0), diagonal = pivot;
    FK_UNROLL for (int e = 0; e <= a; e++) {
      FK_V S = FK_OF(R, at * q + FK_SEEN(e));
      FK_UNROLL for (int r = 0; r < m; r++) S += FK_OF(H, at * m + r) * W[e * m + r];
      if (e == a) diagonal = S;
      FK_UNROLL for (int t = 0; t < e; t++) S -= L[a * n + t] * L[e * n + t] * D[t];
      if (e < a) L[a * n + e] = S / D[e];
      else pivot = S;
    }
    /* what is singular stays so, whatever rounding makes of it; with one component it has to be exact */
    singular |= possible & ~(FK_B)(pivot > (n == 1 ? 0.0 : FK_NODES_PIVOT) * diagonal);
    D[a] = FK_NAME(fk_select)(possible, pivot, FK_NAME(fk_all)(1.0));
    u[a] = v[a];
    FK_UNROLL for (int t = 0; t < a; t++) {
      u[a] -= L[a * n + t] * u[t];
      FK_UNROLL for (int r = 0; r < m; r++) G[a * m + r] -= L[a * n + t] * G[t * m + r];
    }
    distance += u[a] * u[a] / D[a];
    if (n <= 2) product *= D[a];
    else log_det += FK_NAME(fk_logs)(D[a]);
  }
  if (FK_NAME(fk_any)(singular)) return 0;
  if (n <= 2) {
    if (FK_NAME(fk_any)((FK_B)(product < FK_TINY) | (FK_B)(product > FK_HUGE)))
      for (int a = 0; a < n; a++) log_det += FK_NAME(fk_logs)(D[a]);
    else log_det = FK_NAME(fk_logs)(product);
  }
  *log_density = -0.5 * (distance + (n * FK_NODES_LOG_2PI + log_det));
  FK_UNROLL for (int a = n - 1; a >= 0; a--)
    FK_UNROLL for (int r = 0; r < m; r++) {
      FK_V g = G[a * m + r] / D[a];
      FK_UNROLL for (int t = a + 1; t < n; t++) g -= L[t * n + a] * G[t * m + r];
      G[a * m + r] = g;
    }
  FK_UNROLL for (int a = 0; a < n; a++)
    FK_UNROLL for (int r = 0; r < m; r++) x[r] += G[a * m + r] * v[a];
  /* Joseph's form: A P A' + G' R G, A = I - G' H */
  FK_UNROLL for (int r = 0; r < m; r++)
    FK_UNROLL for (int c = 0; c < m; c++) {
      FK_V sum = FK_NAME(fk_all)(r == c ? 1.0 : 0.0);
      FK_UNROLL for (int a = 0; a < n; a++) sum -= G[a * m + r] * FK_OF(H, FK_SEEN(a) * m + c);
      A[r * m + c] = sum;
    }
  FK_UNROLL for (int r = 0; r < m; r++) {
    FK_UNROLL for (int c = 0; c < m; c++) {
      FK_V sum = A[r * m] * P[c];
      FK_UNROLL for (int t = 1; t < m; t++) sum += A[r * m + t] * P[t * m + c];
      row[c] = sum;
    }
    FK_UNROLL for (int a = 0; a < n; a++) {
      FK_V sum = FK_NAME(fk_all)(0.0);
      FK_UNROLL for (int e = 0; e < n; e++) sum += G[e * m + r] * FK_OF(R, FK_SEEN(e) * q + FK_SEEN(a));
      noise[a] = sum;
    }
    FK_UNROLL for (int c = r; c < m; c++) {
      FK_V sum = row[0] * A[c * m];
      FK_UNROLL for (int t = 1; t < m; t++) sum += row[t] * A[c * m + t];
      FK_UNROLL for (int a = 0; a < n; a++) sum += noise[a] * G[a * m + c];
      after[r * m + c] = sum;
    }
  }
  FK_UNROLL for (int r = 0; r < m; r++)
    FK_UNROLL for (int c = r; c < m; c++) P[r * m + c] = P[c * m + r] = after[r * m + c];
  return 1;
}

FK_APART int FK_NAME(fk_condition)(const fk_nodes *k, const int n, const int *seen, const int b, const double *y,
                                   const FK_B *possible, FK_V *x, FK_V *P, FK_V *log_density) {
#define FK_SIZE(m, q) \
  case 100 * m + q: return FK_NAME(fk_condition_sized)(k, m, q, 1, seen, b, y, *possible, x, P, log_density);
  switch (FK_OWN_SIZE(n == k->q ? 100 * k->m + n : 0)) {
    FK_SYSTEMS
    default: return FK_NAME(fk_condition_sized)(k, k->m, n, 0, seen, b, y, *possible, x, P, log_density);
  }
#undef FK_SIZE
}

/* Write the state at the nodes of vector b; nodes that no path reaches get moments of zero, or they might grow
 * without bound. */
FK_INLINE_HERE void FK_NAME(fk_put)(const int m, const size_t ld, const int b, const FK_B possible, const FK_V *x,
                                    const FK_V *P, double *to) {
  const FK_V none = FK_NAME(fk_all)(0.0);
  FK_UNROLL for (int r = 0; r < m; r++)
    FK_AT(to + (size_t)(1 + r) * ld, b) = FK_NAME(fk_select)(possible, x[r], none);
  FK_UNROLL for (int r = 0; r < m * m; r++)
    FK_AT(to + (size_t)(1 + m + r) * ld, b) = FK_NAME(fk_select)(possible, P[r], none);
}

/* From the sum of the weights exp(log_w - top) of a column to its logarithm, where a path leads. */
FK_INLINE_HERE FK_V FK_NAME(fk_log_sum)(const FK_B possible, FK_V sum, FK_V top) {
  return FK_NAME(fk_select)(possible, FK_NAME(fk_logs)(sum) + top, FK_NAME(fk_all)(FK_LOG_ZERO));
}

FK_TARGET static void FK_NAME(fk_nodes_move)(const fk_nodes *k, const double *table, double *to, double *scratch) {
  const int M = k->M, m = k->m;
  const size_t ld = fk_padded(M);
  double *w = scratch, peak = FK_LOG_ZERO;
  FK_V *share = (FK_V *)(scratch + ld), x[FK_NODES_LARGEST], P[FK_NODES_SQUARE], x1[FK_NODES_LARGEST], P1[FK_NODES_SQUARE];
  for (int i = 0; i < M; i++) peak = table[i] > peak ? table[i] : peak;
  for (int b = 0; b < FK_AS_VECTORS(M); b++) FK_AT(w, b) = FK_NAME(fk_exp)(FK_READ(table, b) - peak);
  for (int b = 0; b < FK_AS_VECTORS(M); b++) {
    const int *from = k->source + k->first[FK_BLOCK_OF(b)], depth = k->first[FK_BLOCK_OF(b) + 1] - k->first[FK_BLOCK_OF(b)];
    const FK_B node = (FK_B)(FK_READ(k->entered, b) != 0.0);
    FK_V sum = FK_NAME(fk_all)(0.0), top = FK_NAME(fk_all)(peak);
    for (int s = 0; s < depth; s++) sum += share[s] = w[from[s]] * FK_READ(k->transition + from[s] * ld, b);
    FK_B possible = node;
    if (FK_NAME(fk_any)(node & ~(FK_B)(sum > FK_TINY))) { /* each column relative to its own best pair */
      top = FK_NAME(fk_all)(-DBL_MAX), sum = FK_NAME(fk_all)(0.0);
      for (int s = 0; s < depth; s++) {
        share[s] = table[from[s]] + FK_READ(k->log_transition + from[s] * ld, b);
        top = FK_NAME(fk_max)(top, share[s]);
      }
      possible &= (FK_B)(top > FK_DEAD);
      for (int s = 0; s < depth; s++)
        sum += share[s] = FK_NAME(fk_select)(possible, FK_NAME(fk_exp)(share[s] - top), FK_NAME(fk_all)(0.0));
    }
    sum = FK_NAME(fk_select)(possible, sum, FK_NAME(fk_all)(1.0));
    const FK_V inverse = 1.0 / sum;
    for (int s = 0; s < depth; s++) share[s] *= inverse;
    FK_NAME(fk_merge_nodes)(m, depth, share, from, table, ld, x, P);
    FK_NAME(fk_carry)(k, b, x, P, x1, P1);
    FK_AT(to, b) = FK_NAME(fk_log_sum)(possible, sum, top);
    FK_NAME(fk_put)(m, ld, b, possible, x1, P1, to);
  }
}

FK_TARGET static int FK_NAME(fk_nodes_see)(const fk_nodes *k, const double *y, double *table, double *log_density) {
  int seen[FK_NODES_LARGEST];
  const int m = k->m, n = fk_nodes_seen(k->q, y, seen);
  const size_t ld = fk_padded(k->M);
  FK_V x[FK_NODES_LARGEST], P[FK_NODES_SQUARE];
  for (int b = 0; b < FK_AS_VECTORS(k->M); b++) {
    const FK_B possible = (FK_B)(FK_READ(k->mask, b) != 0.0) & (FK_B)(FK_READ(table, b) > FK_DEAD);
    FK_V density = FK_NAME(fk_all)(0.0);
    FK_UNROLL for (int r = 0; r < m; r++) x[r] = FK_READ(table + (size_t)(1 + r) * ld, b);
    FK_UNROLL for (int r = 0; r < m * m; r++) P[r] = FK_READ(table + (size_t)(1 + m + r) * ld, b);
    if (!FK_NAME(fk_condition)(k, n, seen, b, y, &possible, x, P, &density)) return 0;
    FK_AT(log_density, b) = density;
    FK_NAME(fk_put)(m, ld, b, possible, x, P, table);
  }
  return 1;
}

FK_TARGET static int FK_NAME(fk_nodes_see_pairs)(const fk_nodes *k, const double *table, const double *y, double *to,
                                                 double *log_density, double *scratch) {
  int seen[FK_NODES_LARGEST];
  const int m = k->m, n = fk_nodes_seen(k->q, y, seen);
  const size_t ld = fk_padded(k->M), stride = 2 + m + m * m;
  FK_V *share = (FK_V *)scratch, *slots = share + k->M; /* log-weight, log-density, mean, covariance */
  FK_V x[FK_NODES_LARGEST], P[FK_NODES_SQUARE];
  const FK_V none = FK_NAME(fk_all)(FK_LOG_ZERO);
  for (int b = 0; b < FK_AS_VECTORS(k->M); b++) {
    const int *from = k->source + k->first[FK_BLOCK_OF(b)], depth = k->first[FK_BLOCK_OF(b) + 1] - k->first[FK_BLOCK_OF(b)];
    const FK_B node = (FK_B)(FK_READ(k->entered, b) != 0.0);
    FK_V best = FK_NAME(fk_all)(-DBL_MAX), top = best, sum = FK_NAME(fk_all)(0.0);
    int count = 0;
    for (int s = 0; s < depth; s++) {
      const int i = from[s];
      FK_V *slot = slots + count * stride;
      const FK_V log_w = table[i] + FK_READ(k->log_transition + i * ld, b);
      const FK_B possible = node & (FK_B)(log_w > FK_DEAD);
      if (!FK_NAME(fk_any)(possible)) continue;
      FK_UNROLL for (int r = 0; r < m; r++) x[r] = FK_NAME(fk_all)(table[(1 + r) * ld + i]);
      FK_UNROLL for (int r = 0; r < m * m; r++) P[r] = FK_NAME(fk_all)(table[(1 + m + r) * ld + i]);
      FK_NAME(fk_carry)(k, b, x, P, slot + 2, slot + 2 + m);
      if (!FK_NAME(fk_condition)(k, n, seen, b, y, &possible, slot + 2, slot + 2 + m, slot + 1)) return 0;
      /* what is not possible counts for nothing, whatever came of it */
      FK_UNROLL for (size_t r = 2; r < stride; r++)
        slot[r] = FK_NAME(fk_select)(possible, slot[r], FK_NAME(fk_all)(0.0));
      slot[0] = FK_NAME(fk_select)(possible, log_w, none);
      best = FK_NAME(fk_max)(best, FK_NAME(fk_select)(possible, slot[1], FK_NAME(fk_all)(-DBL_MAX)));
      count++;
    }
    /* each column relative to its own best pair: the densities of an outlier would round the rest away */
    best = FK_NAME(fk_select)((FK_B)(best > FK_NAME(fk_all)(-DBL_MAX)), best, FK_NAME(fk_all)(0.0));
    for (int s = 0; s < count; s++) {
      const FK_V *slot = slots + s * stride;
      share[s] = FK_NAME(fk_select)((FK_B)(slot[0] > FK_DEAD), slot[0] + (slot[1] - best), none);
      top = FK_NAME(fk_max)(top, share[s]);
    }
    const FK_B reached = node & (FK_B)(top > FK_DEAD);
    for (int s = 0; s < count; s++) {
      const FK_B possible = reached & (FK_B)(slots[s * stride] > FK_DEAD);
      sum += share[s] = FK_NAME(fk_select)(possible, FK_NAME(fk_exp)(share[s] - top), FK_NAME(fk_all)(0.0));
    }
    sum = FK_NAME(fk_select)(reached, sum, FK_NAME(fk_all)(1.0));
    const FK_V inverse = 1.0 / sum;
    for (int s = 0; s < count; s++) share[s] *= inverse;
    if (!count) memset(slots, 0, stride * sizeof(FK_V)), share[0] = FK_NAME(fk_all)(0.0);
    FK_NAME(fk_merge_pairs)(m, count ? count : 1, share, slots, x, P);
    FK_AT(to, b) = FK_NAME(fk_log_sum)(reached, sum, top);
    FK_AT(log_density, b) = best;
    FK_NAME(fk_put)(m, ld, b, reached, x, P, to);
  }
  return 1;
}

FK_TARGET static double FK_NAME(fk_nodes_weigh)(const fk_nodes *k, double *log_p, const double *log_density) {
  double best = -DBL_MAX, peak = -DBL_MAX, total = 0.0, whole = 0.0;
  for (int j = 0; j < k->M; j++)
    if (log_p[j] > FK_DEAD && (!log_density || log_density[j] > best)) best = log_density ? log_density[j] : 0.0;
  if (!(best > -DBL_MAX)) return NAN;
  for (int b = 0; b < FK_AS_VECTORS(k->M); b++) {
    FK_V all = FK_READ(log_p, b);
    const FK_B possible = (FK_B)(FK_READ(k->mask, b) != 0.0) & (FK_B)(all > FK_DEAD);
    if (log_density) all += FK_READ(log_density, b) - best;
    all = FK_NAME(fk_select)(possible, all, FK_NAME(fk_all)(FK_LOG_ZERO));
    FK_AT(log_p, b) = all;
    for (int t = 0; t < FK_WIDTH; t++) peak = all[t] > peak ? all[t] : peak;
  }
  for (int b = 0; b < FK_AS_VECTORS(k->M); b++) total += FK_NAME(fk_sum)(FK_NAME(fk_exp)(FK_READ(log_p, b) - peak));
  const double log_total = peak + log(total);
  for (int b = 0; b < FK_AS_VECTORS(k->M); b++) {
    const FK_V all = FK_READ(log_p, b) - log_total;
    FK_AT(log_p, b) = all;
    whole += FK_NAME(fk_sum)(FK_NAME(fk_exp)(all));
  }
  const double rest = log(whole); /* rounding of large differences */
  for (int b = 0; b < FK_AS_VECTORS(k->M); b++) {
    const FK_V mask = FK_READ(k->mask, b), all = FK_READ(log_p, b) - rest;
    FK_AT(log_p, b) = FK_NAME(fk_select)((FK_B)(mask != 0.0), FK_NAME(fk_max)(all, FK_NAME(fk_all)(FK_LOG_ZERO)), FK_NAME(fk_all)(0.0));
  }
  return log_total + best;
}

#undef FK_OF
#undef FK_SEEN
#undef FK_SYSTEMS
#undef FK_APART
