/* Back along a filtered series, and the most likely path; included once per kind of processor. */

/* log |P_ij| + log N(y'; Ayy w + Ny, Qyy) of row i and vector b of columns. */
FK_INLINE_HERE FK_V FK_NAME(fk_log_pair)(const fk_kernel *k, int i, int b, const double *u) {
  const int q = k->q, n = 1 + k->w + q;
  const double *cell = FK_CELL(k->cells, k->stride, i, b);
  FK_V log_w = FK_ROW(cell, 0);
  for (int r = 0; r < q; r++) {
    const double *row = cell + (2 + r * n) * FK_LANES;
    FK_V z = FK_ROW(row, 0);
    for (int t = 1; t < n; t++) z += FK_ROW(row, t) * u[t];
    log_w -= z * z;
  }
  return log_w;
}

/* log |P_ij| + log N(y'; Ayy w + Ny, Qyy) of all pairs, (M1, M2). */
FK_TARGET static void FK_NAME(fk_log_pairs)(const fk_kernel *k, const double *u, double *out) {
  for (int i = 0; i < k->M1; i++)
    for (int b = 0; b < FK_AS_VECTORS(k->M2); b++) {
      const FK_V log_w = FK_NAME(fk_log_pair)(k, i, b, u);
      for (int t = 0; t < FK_WIDTH && b * FK_WIDTH + t < k->M2; t++)
        out[(size_t)i * k->M2 + b * FK_WIDTH + t] = log_w[t];
    }
}

/* gamma[t] = o_t gamma[t + 1] for t = n - 1, ..., 0, with `after` (padded M2) for gamma[n] and o_t the
 * probabilities of the nodes i given the node j after them.  log_p (n, M1), U (n, 1 + w + q), gamma
 * (n, M1); scratch: 2 M1 vectors. */
FK_TARGET static void FK_NAME(fk_smooth_back)(const fk_kernel *k, size_t n, const double *log_p, const double *U,
                                              double *after, double *gamma, double *scratch) {
  const int M1 = k->M1, width = 1 + k->w + k->q;
  FK_V *e = (FK_V *)scratch, *sum = e + M1;
  for (size_t t = n; t-- > 0;) {
    const double *u = U + t * width, *p = log_p + t * M1;
    double *now = gamma + t * M1;
    for (int i = 0; i < M1; i++) sum[i] = FK_NAME(fk_all)(0.0);
    for (int b = 0; b < FK_AS_VECTORS(k->M2); b++) {
      FK_V top = FK_NAME(fk_all)(-DBL_MAX), column = FK_NAME(fk_all)(0.0);
      for (int i = 0; i < M1; i++) {
        e[i] = FK_NAME(fk_log_pair)(k, i, b, u) + p[i];
        top = FK_NAME(fk_max)(top, e[i]);
      }
      double reference;
      for (int l = 0, j = b * FK_WIDTH; l < FK_WIDTH && j < k->M2; l++, j++)
        if (top[l] < FK_NEAR && top[l] > FK_DEAD) top[l] = fk_far_column(k, p, u, j, (double *)e + l, FK_WIDTH, &reference);
      for (int i = 0; i < M1; i++) {
        e[i] = FK_NAME(fk_exp)(e[i] - top);
        column += e[i];
      }
      const FK_V share = FK_READ(after, b) / column;
      for (int i = 0; i < M1; i++) sum[i] += e[i] * share;
    }
    double total = 0.0; /* one, but for rounding, which would add up */
    for (int i = 0; i < M1; i++) total += now[i] = FK_NAME(fk_sum)(sum[i]);
    for (int i = 0; i < M1; i++) now[i] /= total;
    if (t) memcpy(after, now, M1 * sizeof(double)); /* n > 1 only if M1 = M2: the padding stays zero */
  }
}

/* Viterbi's recursion along n steps: score (padded M1 = padded M2), pointers (n, M2) to the nodes before. */
FK_TARGET static void FK_NAME(fk_best_path)(const fk_kernel *k, size_t n, double *score, const double *U,
                                            int64_t *pointers, double *scratch) { /* scratch: 3 padded M */
  const int M1 = k->M1, M2 = k->M2, width = 1 + k->w + k->q;
  for (size_t t = 0; t < n; t++) {
    double peak = -INFINITY;
    for (int b = 0; b < FK_AS_VECTORS(M2); b++) {
      FK_V best = FK_NAME(fk_all)(-INFINITY), from = FK_NAME(fk_all)(0.0);
      for (int i = 0; i < M1; i++) {
        const FK_V total = FK_NAME(fk_log_pair)(k, i, b, U + t * width) + score[i];
        const FK_B better = (FK_B)(total > best);
        best = FK_NAME(fk_select)(better, total, best);
        from = FK_NAME(fk_select)(better, FK_NAME(fk_all)(i), from);
      }
      FK_AT(scratch, b) = best;
      for (int j = b * FK_WIDTH; j < (b + 1) * FK_WIDTH && j < M2; j++) {
        pointers[t * M2 + j] = (int64_t)from[j - b * FK_WIDTH];
        peak = scratch[j] > peak ? scratch[j] : peak;
      }
    }
    if (peak < FK_NEAR && peak > FK_DEAD) { /* an outlier: differences of densities first */
      double *references = scratch + fk_padded(M2), *total = references + fk_padded(M2);
      const double *u = U + t * width;
      for (int j = 0; j < M2; j++) {
        int from = 0;
        scratch[j] = fk_far_column(k, score, u, j, total, 1, references + j);
        while (from < M1 - 1 && total[from] != scratch[j]) from++;
        pointers[t * M2 + j] = from;
      }
      fk_far_references(k, score, u, references, scratch);
      peak = -INFINITY;
      for (int j = 0; j < M2; j++) peak = scratch[j] > peak ? scratch[j] : peak;
    }
    for (int j = 0; j < M2; j++) score[j] = scratch[j] - peak;
  }
}
