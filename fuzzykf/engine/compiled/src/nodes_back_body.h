/* The way back of a smoother on nodes; included once per kind of processor, after nodes_body.h.
 *
 * Nodes i at the earlier time stand in lanes, those at the later one, j, come one after the other.
 */

FK_INLINE_HERE FK_V FK_NAME(fk_roots)(FK_V a) {
  for (int t = 0; t < FK_WIDTH; t++) a[t] = sqrt(a[t]);
  return a;
}

/* root root' = P, its columns zero where components are certain. */
FK_INLINE_HERE void FK_NAME(fk_root)(const int m, const FK_V *P, FK_V *root) {
  const FK_V none = FK_NAME(fk_all)(0.0), one = FK_NAME(fk_all)(1.0);
  FK_V D[FK_NODES_LARGEST];
  FK_UNROLL for (int a = 0; a < m; a++) {
    FK_V pivot = P[a * m + a];
    FK_UNROLL for (int t = 0; t < a; t++) {
      FK_V sum = P[a * m + t];
      FK_UNROLL for (int s = 0; s < t; s++) sum -= root[a * m + s] * root[t * m + s] * D[s];
      const FK_B there = (FK_B)(D[t] > 0.0);
      root[a * m + t] = FK_NAME(fk_select)(there, sum / FK_NAME(fk_select)(there, D[t], one), none);
      pivot -= root[a * m + t] * root[a * m + t] * D[t];
    }
    D[a] = FK_NAME(fk_select)((FK_B)(pivot > FK_NODES_CERTAIN * m * P[a * m + a]), pivot, none);
    root[a * m + a] = one;
  }
  FK_UNROLL for (int c = 0; c < m; c++) {
    const FK_V deviation = FK_NAME(fk_roots)(D[c]);
    FK_UNROLL for (int r = 0; r < c; r++) root[r * m + c] = none;
    FK_UNROLL for (int r = c; r < m; r++) root[r * m + c] *= deviation;
  }
}

/* Condition the mean and the root of (X', X) on one component of X', of which f is root' row and s its square; by
 * Potter's update.  T, which the likelihood is divided by; 0 of what is zero beyond doubt and seen without noise. */
FK_INLINE_HERE FK_V FK_NAME(fk_take_in)(const int m, const FK_V noise, const FK_V weight, const FK_V off,
                                        const FK_V *f, const FK_V s, FK_V *x, FK_V *root) {
  const int d = 2 * m;
  const FK_V T = noise + weight * s;
  const FK_B there = (FK_B)(T > 0.0);
  const FK_V over = FK_NAME(fk_select)(there, 1.0 / FK_NAME(fk_select)(there, T, FK_NAME(fk_all)(1.0)), FK_NAME(fk_all)(0.0));
  const FK_V factor = weight * over / (1.0 + FK_NAME(fk_roots)(noise * over)), move = off * over;
  FK_UNROLL for (int r = 0; r < d; r++) {
    FK_V reach = root[r * d] * f[0];
    FK_UNROLL for (int c = 1; c < d; c++) reach += root[r * d + c] * f[c];
    x[r] += reach * move;
    reach *= factor;
    FK_UNROLL for (int c = 0; c < d; c++) root[r * d + c] -= reach * f[c];
  }
  return T;
}

/* f = root' row, of X'; its square. */
FK_INLINE_HERE FK_V FK_NAME(fk_along)(const int m, const double *row, const FK_V *root, FK_V *f) {
  const int d = 2 * m;
  FK_V s = FK_NAME(fk_all)(0.0);
  FK_UNROLL for (int c = 0; c < d; c++) {
    f[c] = row[0] * root[c];
    FK_UNROLL for (int r = 1; r < m; r++) f[c] += row[r] * root[r * d + c];
    s += f[c] * f[c];
  }
  return s;
}

/* The e of a factor as it counts for laws of variance s; see numpy/nodes_backward.py. */
FK_INLINE_HERE FK_V FK_NAME(fk_cautious)(const double e, const double v, const FK_V s) {
  const double bound = 1.0 / (1.0 + v * v), least = e < bound ? e : bound;
  const FK_V wider = 1.0 - FK_NODES_ALIKE / FK_NAME(fk_max)(s, FK_NAME(fk_all)(FK_NODES_ALIKE));
  if (!(e > 0.0)) return FK_NAME(fk_all)(0.0);
  return e * least / (least + (e - least) * wider);
}

/* A product of many, and the logarithm of what has been taken out of it. */
FK_INLINE_HERE void FK_NAME(fk_times)(FK_V *product, FK_V *log_product, const FK_V T) {
  *product *= T;
  if (FK_NAME(fk_any)((FK_B)(*product < FK_TINY) | (FK_B)(*product > FK_HUGE)))
    *log_product += FK_NAME(fk_logs)(*product), *product = FK_NAME(fk_all)(1.0);
}

/* Moments x1, P1 of the states of a vector given node j and all observations, from x and a root of P, what the
 * filter knew; the logarithm of how likely what comes after is. */
FK_INLINE_HERE void FK_NAME(fk_look_back_sized)(const fk_nodes *k, const int m, const int j, const int n,
                                                const fk_later *later, const FK_V *x, const FK_V *lower, FK_V *x1,
                                                FK_V *P1, FK_V *log_density) {
  const int d = 2 * m;
  const size_t ld = fk_padded(k->M);
  const FK_V none = FK_NAME(fk_all)(0.0), one = FK_NAME(fk_all)(1.0);
  FK_V mean[2 * FK_NODES_LARGEST], root[4 * FK_NODES_SQUARE], f[2 * FK_NODES_LARGEST];
  FK_V product = one, log_product = none, distance = none;
  FK_UNROLL for (int r = 0; r < m; r++) {
    FK_V sum = FK_NAME(fk_all)(k->b[(size_t)r * ld + j]);
    FK_UNROLL for (int c = 0; c < m; c++) sum += k->F[(size_t)(r * m + c) * ld + j] * x[c];
    mean[r] = sum, mean[m + r] = x[r];
    FK_UNROLL for (int c = 0; c < m; c++) {
      sum = none;
      FK_UNROLL for (int t = 0; t < m; t++) sum += k->F[(size_t)(r * m + t) * ld + j] * lower[t * m + c];
      root[r * d + c] = sum;
      root[r * d + m + c] = FK_NAME(fk_all)(later->root[r * m + c]);
      root[(m + r) * d + c] = lower[r * m + c];
      root[(m + r) * d + m + c] = none;
    }
  }
  for (int a = 0; a < n; a++) { /* the observation */
    const double *row = later->H + a * m;
    FK_V off = FK_NAME(fk_all)(later->y[a]);
    FK_UNROLL for (int r = 0; r < m; r++) off -= row[r] * mean[r];
    const FK_V s = FK_NAME(fk_along)(m, row, root, f);
    FK_V T = FK_NAME(fk_take_in)(m, FK_NAME(fk_all)(later->D[a]), one, off, f, s, mean, root);
    const FK_B there = (FK_B)(T > 0.0);
    T = FK_NAME(fk_select)(there, T, one);
    FK_NAME(fk_times)(&product, &log_product, T);
    distance += FK_NAME(fk_select)(there, off * off / T + FK_NODES_LOG_2PI, none);
  }
  FK_UNROLL for (int a = 0; a < m; a++) { /* all that come after it */
    const double *row = later->rows + a * m, v = later->v[a];
    FK_V at = none;
    FK_UNROLL for (int r = 0; r < m; r++) at += row[r] * (mean[r] - later->centre[r]);
    const FK_V s = FK_NAME(fk_along)(m, row, root, f), beyond = at - v;
    const FK_V e = FK_NAME(fk_cautious)(later->e[a], v, s);
    FK_V T = FK_NAME(fk_take_in)(m, e, 1.0 - e, v - (1.0 - e) * at, f, s, mean, root);
    const FK_B there = (FK_B)(T > 0.0);
    T = FK_NAME(fk_select)(there, T, one);
    FK_NAME(fk_times)(&product, &log_product, T);
    distance += FK_NAME(fk_select)(
        there, ((1.0 - e) * beyond * beyond - v * v * (s - e) - 2.0 * e * v * at) / T, none);
  }
  *log_density = -0.5 * (distance + (log_product + FK_NAME(fk_logs)(product)));
  FK_UNROLL for (int r = 0; r < m; r++) {
    x1[r] = mean[m + r];
    FK_UNROLL for (int c = r; c < m; c++) {
      FK_V sum = root[(m + r) * d] * root[(m + c) * d];
      FK_UNROLL for (int t = 1; t < d; t++) sum += root[(m + r) * d + t] * root[(m + c) * d + t];
      P1[r * m + c] = P1[c * m + r] = sum;
    }
  }
}

FK_TARGET static __attribute__((noinline)) void FK_NAME(fk_look_back)(const fk_nodes *k, const int j, const int n,
                                                                      const fk_later *later, const FK_V *x,
                                                                      const FK_V *lower, FK_V *x1, FK_V *P1,
                                                                      FK_V *log_density) {
#define FK_SIZE(m) case m: FK_NAME(fk_look_back_sized)(k, m, j, n, later, x, lower, x1, P1, log_density); return;
  switch (FK_OWN_SIZE(k->m)) {
    FK_STATES
    default: FK_NAME(fk_look_back_sized)(k, k->m, j, n, later, x, lower, x1, P1, log_density);
  }
#undef FK_SIZE
}

FK_TARGET static void FK_NAME(fk_nodes_back)(const fk_nodes *k, const int by_density, const double *table,
                                             const double *y, const double *filtered, const double *after,
                                             double *to, double *score, int *next, double *scratch) {
  const int M = k->M, m = k->m, blocks = FK_AS_VECTORS(M);
  const size_t ld = fk_padded(M), stride = 2 + m + m * m;
  FK_V *share = (FK_V *)scratch, *slots = share + M; /* of each vector, for each j: log-density, log-weight, mean, P */
  FK_V *lower = slots + (size_t)blocks * M * stride, x[FK_NODES_LARGEST], P[FK_NODES_SQUARE];
  const FK_V zero = FK_NAME(fk_all)(FK_LOG_ZERO);
  double *last = (double *)(lower + (size_t)blocks * m * m); /* scores at the later time */
  int seen[FK_NODES_LARGEST];
  const int n = fk_nodes_seen(k->q, y, seen);
  fk_later later;
  memcpy(last, score, ld * sizeof(double));
  for (int b = 0; b < blocks; b++) {
    FK_UNROLL for (int r = 0; r < m * m; r++) P[r] = FK_READ(table + (size_t)(1 + m + r) * ld, b);
    FK_NAME(fk_root)(m, P, lower + (size_t)b * m * m);
    FK_AT(score, b) = zero;
  }
  for (int j = 0; j < M; j++) {
    const int there = after[j] > FK_DEAD;
    if (there) fk_later_at(k, j, table, y, filtered, after, &later);
    for (int b = 0; b < blocks; b++) {
      FK_V *slot = slots + ((size_t)b * M + j) * stride;
      const FK_V log_w = FK_READ(table, b) + FK_READ(k->log_into + j * ld, b);
      const FK_B possible = (FK_B)(FK_READ(k->mask, b) != 0.0) & (FK_B)(log_w > FK_DEAD);
      if (!there || !FK_NAME(fk_any)(possible)) {
        memset(slot, 0, stride * sizeof(FK_V));
        slot[0] = slot[1] = zero;
        continue;
      }
      FK_UNROLL for (int r = 0; r < m; r++) x[r] = FK_READ(table + (size_t)(1 + r) * ld, b);
      FK_NAME(fk_look_back)(k, j, n, &later, x, lower + (size_t)b * m * m, slot + 2, slot + 2 + m, slot);
      if (!by_density) slot[0] = FK_NAME(fk_all)(0.0);
      slot[0] = FK_NAME(fk_select)(possible, slot[0], zero);
      slot[1] = FK_NAME(fk_select)(possible, log_w, zero);
      for (size_t r = 2; r < stride; r++) slot[r] = FK_NAME(fk_select)(possible, slot[r], FK_NAME(fk_all)(0.0));
    }
  }
  for (int j = 0; j < M; j++) { /* from log-densities to p(i | j), and to the weights of i and j given all */
    FK_V *slot = slots + (size_t)j * stride;
    double best = FK_LOG_ZERO, top = FK_LOG_ZERO, sum = 0.0;
    for (int b = 0; b < blocks; b++)
      for (int t = 0; t < FK_WIDTH; t++) {
        const double one = slot[(size_t)b * M * stride][t];
        if (slot[(size_t)b * M * stride + 1][t] > FK_DEAD && one > best) best = one;
      }
    if (!(best > FK_DEAD)) continue;
    for (int b = 0; b < blocks; b++) { /* what may be large, before the weights */
      FK_V *log_w = slot + (size_t)b * M * stride;
      *log_w = FK_NAME(fk_select)((FK_B)(log_w[1] > FK_DEAD), (*log_w - best) + log_w[1], zero);
      for (int t = 0; t < FK_WIDTH; t++) top = (*log_w)[t] > top ? (*log_w)[t] : top;
    }
    for (int b = 0; b < blocks; b++) sum += FK_NAME(fk_sum)(FK_NAME(fk_exp)(slot[(size_t)b * M * stride] - top));
    top += log(sum);
    for (int b = 0; b < blocks; b++) {
      FK_V *log_w = slot + (size_t)b * M * stride;
      const FK_B possible = (FK_B)(*log_w > FK_DEAD);
      const FK_V given = *log_w - top, total = FK_NAME(fk_select)(possible, given + last[j], zero);
      for (int t = 0; t < FK_WIDTH; t++) {
        const int i = b * FK_WIDTH + t;
        if (total[t] > score[i]) score[i] = total[t], next[i] = j;
      }
      *log_w = FK_NAME(fk_select)(possible, given + after[j], zero);
    }
  }
  for (int b = 0; b < blocks; b++) {
    const FK_V *slot = slots + (size_t)b * M * stride;
    FK_V top = zero, sum = FK_NAME(fk_all)(0.0);
    for (int j = 0; j < M; j++) top = FK_NAME(fk_max)(top, slot[j * stride]);
    const FK_B reached = (FK_B)(FK_READ(k->mask, b) != 0.0) & (FK_B)(top > FK_DEAD);
    for (int j = 0; j < M; j++) {
      const FK_B possible = reached & (FK_B)(slot[j * stride] > FK_DEAD);
      sum += share[j] = FK_NAME(fk_select)(possible, FK_NAME(fk_exp)(slot[j * stride] - top), FK_NAME(fk_all)(0.0));
    }
    sum = FK_NAME(fk_select)(reached, sum, FK_NAME(fk_all)(1.0));
    const FK_V inverse = 1.0 / sum;
    for (int j = 0; j < M; j++) share[j] *= inverse;
    FK_NAME(fk_merge_pairs)(m, M, share, slot, x, P);
    FK_AT(to, b) = FK_NAME(fk_log_sum)(reached, sum, top);
    FK_NAME(fk_put)(m, ld, b, reached, x, P, to);
  }
}

#undef FK_STATES
