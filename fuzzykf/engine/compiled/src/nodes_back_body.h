/* The way back of a smoother on nodes; included once per kind of processor, after nodes_body.h.
 *
 * Nodes i at the earlier time stand in lanes, those at the later one, j, come one after the other.
 */

/* Entry r of a parameter at node j. */
#define FK_THERE(name, r) FK_NAME(fk_all)(k->name[(size_t)(r) * ld + j])

/* The pivot of a component of S, `size` being what it is the rest of: 0 where it is rounding error. */
FK_INLINE_HERE FK_V FK_NAME(fk_pivot)(const int m, FK_V pivot, FK_V size) {
  return FK_NAME(fk_select)((FK_B)(pivot > FK_NODES_CERTAIN * m * size), pivot, FK_NAME(fk_all)(0.0));
}

/* 1 / pivot, and 0 of none. */
FK_INLINE_HERE FK_V FK_NAME(fk_weight_of)(FK_V pivot) {
  const FK_B there = (FK_B)(pivot > 0.0);
  return FK_NAME(fk_select)(there, 1.0 / FK_NAME(fk_select)(there, pivot, FK_NAME(fk_all)(1.0)), FK_NAME(fk_all)(0.0));
}

/* log N(white; 0, D) of one component; 0 of one without variance. */
FK_INLINE_HERE FK_V FK_NAME(fk_log_part)(FK_V white, FK_V D, FK_V weight) {
  const FK_B there = (FK_B)(D > 0.0);
  const FK_V log_D = FK_NAME(fk_logs)(FK_NAME(fk_select)(there, D, FK_NAME(fk_all)(1.0)));
  return FK_NAME(fk_select)(there, -0.5 * (white * white * weight + log_D + FK_NODES_LOG_2PI), FK_NAME(fk_all)(0.0));
}

/* log N(white; 0, D) with the covariance that is known of certain components, of which D is 0: a case of its own. */
FK_TARGET static __attribute__((noinline)) FK_V FK_NAME(fk_density_of_certain)(
    const int m, const size_t ld, const int j, const double *after, const FK_V *L, const FK_V *D, const FK_V *white) {
  FK_V W[FK_NODES_SQUARE], L2[FK_NODES_SQUARE], D2[FK_NODES_LARGEST], weight[FK_NODES_LARGEST], left[FK_NODES_LARGEST];
  const FK_V none = FK_NAME(fk_all)(0.0);
  FK_V density = none;
  for (int r = 0; r < m * m; r++) W[r] = FK_NAME(fk_all)(after[(size_t)(1 + m + r) * ld + j]);
  for (int side = 0; side < 2; side++) { /* L^-1 P_j, transposed, L^-1 of that */
    for (int a = 1; a < m; a++)
      for (int t = 0; t < a; t++)
        for (int c = 0; c < m; c++) W[a * m + c] -= L[a * m + t] * W[t * m + c];
    for (int a = 0; a < m; a++)
      for (int c = 0; c < a; c++) {
        const FK_V swap = W[a * m + c];
        W[a * m + c] = W[c * m + a], W[c * m + a] = swap;
      }
  }
  for (int a = 0; a < m; a++) {
    const FK_B certain = (FK_B)(D[a] == 0.0);
    FK_V pivot = FK_NAME(fk_select)(certain, W[a * m + a], D[a]);
    const FK_V size = pivot;
    left[a] = white[a];
    for (int t = 0; t < a; t++) {
      FK_V sum = FK_NAME(fk_select)(certain & (FK_B)(D[t] == 0.0), W[a * m + t], none);
      for (int s = 0; s < t; s++) sum -= L2[a * m + s] * L2[t * m + s] * D2[s];
      L2[a * m + t] = sum * weight[t];
      pivot -= L2[a * m + t] * L2[a * m + t] * D2[t];
      left[a] -= L2[a * m + t] * left[t];
    }
    D2[a] = FK_NAME(fk_pivot)(m, pivot, size);
    weight[a] = FK_NAME(fk_weight_of)(D2[a]);
    density += FK_NAME(fk_log_part)(left[a], D2[a], weight[a]);
  }
  return density;
}

/* Moments x1, P1 of the states of vector b given node j and all observations, from x, P, what the filter knew;
 * the log-density of the state at j. */
FK_INLINE_HERE void FK_NAME(fk_look_back_sized)(const fk_nodes *k, const int m, const int j, const double *after,
                                                const FK_B possible, const FK_V *x, const FK_V *P,
                                                const FK_V *deviation, FK_V *x1, FK_V *P1, FK_V *log_density) {
  const size_t ld = fk_padded(k->M);
  FK_V Z[FK_NODES_SQUARE], S[FK_NODES_SQUARE], L[FK_NODES_SQUARE], A[FK_NODES_SQUARE]; /* Z: F P, then G' */
  FK_V D[FK_NODES_LARGEST], weight[FK_NODES_LARGEST], off[FK_NODES_LARGEST], white[FK_NODES_LARGEST], row[FK_NODES_LARGEST], sizes[FK_NODES_LARGEST];
  const FK_V none = FK_NAME(fk_all)(0.0);
  FK_V density = none;
  FK_B certain = possible & ~possible;
  FK_UNROLL for (int r = 0; r < m; r++) {
    FK_V sum = FK_NAME(fk_all)(after[(size_t)(1 + r) * ld + j]) - FK_THERE(b, r);
    FK_UNROLL for (int c = 0; c < m; c++) sum -= FK_THERE(F, r * m + c) * x[c];
    off[r] = white[r] = sum;
    FK_UNROLL for (int c = 0; c < m; c++) {
      sum = FK_THERE(F, r * m) * P[c];
      FK_UNROLL for (int t = 1; t < m; t++) sum += FK_THERE(F, r * m + t) * P[t * m + c];
      Z[r * m + c] = sum;
    }
    FK_UNROLL for (int c = 0; c <= r; c++) {
      sum = FK_THERE(Q, r * m + c);
      FK_UNROLL for (int t = 0; t < m; t++) sum += FK_THERE(F, c * m + t) * Z[r * m + t];
      S[r * m + c] = sum;
    }
  }
  FK_UNROLL for (int a = 0; a < m; a++) {
    FK_V size = none; /* of what S is the sum of */
    FK_UNROLL for (int t = 0; t < m; t++) size += fabs(k->F[(size_t)(a * m + t) * ld + j]) * deviation[t];
    sizes[a] = size * size + FK_THERE(Q, a * m + a);
  }
  /* S = L D L'; what is certain, given the components before it, is left out: its weight 1 / D is zero */
  FK_UNROLL for (int a = 0; a < m; a++) {
    FK_V pivot = S[a * m + a];
    FK_UNROLL for (int t = 0; t < a; t++) {
      FK_V sum = S[a * m + t];
      FK_UNROLL for (int s = 0; s < t; s++) sum -= L[a * m + s] * L[t * m + s] * D[s];
      L[a * m + t] = sum * weight[t];
      pivot -= L[a * m + t] * L[a * m + t] * D[t];
      white[a] -= L[a * m + t] * white[t];
      FK_UNROLL for (int r = 0; r < m; r++) Z[a * m + r] -= L[a * m + t] * Z[t * m + r];
    }
    D[a] = FK_NAME(fk_pivot)(m, pivot, sizes[a]);
    weight[a] = FK_NAME(fk_weight_of)(D[a]);
    certain |= possible & (FK_B)(D[a] == 0.0);
  }
  FK_UNROLL for (int a = 0; a < m; a++) density += FK_NAME(fk_log_part)(white[a], D[a], weight[a]);
  *log_density = FK_NAME(fk_any)(certain) ? FK_NAME(fk_density_of_certain)(m, ld, j, after, L, D, white) : density;
  FK_UNROLL for (int a = m - 1; a >= 0; a--)
    FK_UNROLL for (int r = 0; r < m; r++) {
      FK_V g = Z[a * m + r] * weight[a];
      FK_UNROLL for (int t = a + 1; t < m; t++) g -= L[t * m + a] * Z[t * m + r];
      Z[a * m + r] = g;
    }
  FK_UNROLL for (int r = 0; r < m; r++) {
    FK_V sum = x[r];
    FK_UNROLL for (int a = 0; a < m; a++) sum += Z[a * m + r] * off[a];
    x1[r] = sum;
    FK_UNROLL for (int c = 0; c < m; c++) {
      sum = FK_NAME(fk_all)(r == c ? 1.0 : 0.0);
      FK_UNROLL for (int a = 0; a < m; a++) sum -= Z[a * m + r] * FK_THERE(F, a * m + c);
      A[r * m + c] = sum;
    }
  }
  FK_UNROLL for (int r = 0; r < m; r++) { /* A P A' + G (Q + P_j) G' */
    FK_UNROLL for (int c = 0; c < m; c++) {
      FK_V sum = A[r * m] * P[c];
      FK_UNROLL for (int t = 1; t < m; t++) sum += A[r * m + t] * P[t * m + c];
      row[c] = sum;
    }
    FK_UNROLL for (int c = r; c < m; c++) {
      FK_V sum = row[0] * A[c * m];
      FK_UNROLL for (int t = 1; t < m; t++) sum += row[t] * A[c * m + t];
      S[r * m + c] = sum;
    }
    FK_UNROLL for (int c = 0; c < m; c++) {
      FK_V sum = none;
      FK_UNROLL for (int a = 0; a < m; a++)
        sum += Z[a * m + r] * (FK_THERE(Q, a * m + c) + after[(size_t)(1 + m + a * m + c) * ld + j]);
      row[c] = sum;
    }
    FK_UNROLL for (int c = r; c < m; c++) {
      FK_V sum = S[r * m + c];
      FK_UNROLL for (int a = 0; a < m; a++) sum += row[a] * Z[a * m + c];
      P1[r * m + c] = P1[c * m + r] = sum;
    }
  }
}

FK_TARGET static __attribute__((noinline)) void FK_NAME(fk_look_back)(const fk_nodes *k, const int j,
                                                                      const double *after, const FK_B *possible,
                                                                      const FK_V *x, const FK_V *P,
                                                                      const FK_V *deviation, FK_V *x1, FK_V *P1,
                                                                      FK_V *log_density) {
#define FK_SIZE(m) \
  case m: FK_NAME(fk_look_back_sized)(k, m, j, after, *possible, x, P, deviation, x1, P1, log_density); return;
  switch (k->m) {
    FK_STATES
    default: FK_NAME(fk_look_back_sized)(k, k->m, j, after, *possible, x, P, deviation, x1, P1, log_density);
  }
#undef FK_SIZE
}

FK_TARGET static void FK_NAME(fk_nodes_back)(const fk_nodes *k, const int by_density, const double *table,
                                             const double *after, double *to, double *score, int *next,
                                             double *scratch) {
  const int M = k->M, m = k->m, blocks = FK_AS_VECTORS(M);
  const size_t ld = fk_padded(M), stride = 2 + m + m * m;
  FK_V *share = (FK_V *)scratch, *slots = share + M; /* of each vector, for each j: log-weight, mean, covariance */
  FK_V x[FK_NODES_LARGEST], P[FK_NODES_SQUARE], deviation[FK_NODES_LARGEST], density;
  const FK_V zero = FK_NAME(fk_all)(FK_LOG_ZERO);
  double *last = (double *)(slots + (size_t)blocks * M * stride); /* scores at the later time */
  memcpy(last, score, ld * sizeof(double));
  for (int b = 0; b < blocks; b++) {
    const FK_V log_p = FK_READ(table, b);
    const FK_B node = (FK_B)(FK_READ(k->mask, b) != 0.0);
    FK_UNROLL for (int r = 0; r < m; r++) x[r] = FK_READ(table + (size_t)(1 + r) * ld, b);
    FK_UNROLL for (int r = 0; r < m * m; r++) P[r] = FK_READ(table + (size_t)(1 + m + r) * ld, b);
    for (int r = 0; r < m; r++)
      for (int t = 0; t < FK_WIDTH; t++) deviation[r][t] = sqrt(P[r * m + r][t]);
    FK_AT(score, b) = zero;
    for (int j = 0; j < M; j++) {
      FK_V *slot = slots + ((size_t)b * M + j) * stride, log_w = log_p + FK_READ(k->log_into + j * ld, b);
      const FK_B possible = node & (FK_B)(log_w > FK_DEAD);
      if (!(after[j] > FK_DEAD) || !FK_NAME(fk_any)(possible)) {
        memset(slot, 0, stride * sizeof(FK_V));
        slot[0] = zero;
        continue;
      }
      FK_NAME(fk_look_back)(k, j, after, &possible, x, P, deviation, slot + 2, slot + 2 + m, &density);
      if (by_density) log_w += density;
      slot[0] = FK_NAME(fk_select)(possible, log_w, zero);
      for (size_t r = 2; r < stride; r++) slot[r] = FK_NAME(fk_select)(possible, slot[r], FK_NAME(fk_all)(0.0));
    }
  }
  for (int j = 0; j < M; j++) { /* from joint weights to p(i | j), and to those of j given all */
    FK_V *slot = slots + (size_t)j * stride;
    double top = FK_LOG_ZERO, sum = 0.0;
    for (int b = 0; b < blocks; b++)
      for (int t = 0; t < FK_WIDTH; t++) {
        const double one = slot[(size_t)b * M * stride][t];
        top = one > top ? one : top;
      }
    if (!(top > FK_DEAD)) continue;
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

#undef FK_THERE
#undef FK_STATES
