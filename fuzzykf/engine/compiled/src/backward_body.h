/* Back along a filtered series, and the most likely path; included once per kind of processor. */

/* log |P_ij| + log N(y'; Ayy w + Ny, Qyy) of a slot of vector b of columns. */
FK_INLINE_HERE FK_V FK_NAME(fk_log_pair)(const fk_kernel *k, int slot, int b, const double *u) {
  const int q = k->q, n = 1 + k->w + q;
  const double *cell = FK_CELL(k->cells, k->stride, slot, b);
  FK_V log_w = FK_ROW(cell, 0);
  for (int r = 0; r < q; r++) {
    const double *row = cell + (2 + r * n) * FK_LANES;
    FK_V z = FK_ROW(row, 0);
    for (int t = 1; t < n; t++) z += FK_ROW(row, t) * u[t];
    log_w -= z * z;
  }
  return log_w;
}

/* log |P_ij| + log N(y'; Ayy w + Ny, Qyy) of all pairs, (M1, M2); FK_LOG_ZERO for those without a slot. */
FK_TARGET static void FK_NAME(fk_log_pairs)(const fk_kernel *k, const double *u, double *out) {
  for (size_t r = 0; k->is_sparse && r < (size_t)k->M1 * k->M2; r++) out[r] = FK_LOG_ZERO;
  for (int b = 0; b < FK_AS_VECTORS(k->M2); b++) {
    const int *sources = FK_SOURCES(b), depth = FK_DEPTH(b);
    for (int s = 0; s < depth; s++) {
      const FK_V log_w = FK_NAME(fk_log_pair)(k, s, b, u);
      for (int t = 0; t < FK_WIDTH && b * FK_WIDTH + t < k->M2; t++) {
        double *to = out + (size_t)sources[s * FK_LANES + t] * k->M2 + b * FK_WIDTH + t;
        if (!k->is_sparse || log_w[t] > FK_DEAD) *to = log_w[t]; /* a slot left over has no pair */
      }
    }
  }
}

/* gamma[t] = o_t gamma[t + 1] for t = n - 1, ..., 0, with `after` (padded M2) for gamma[n] and o_t the
 * probabilities of the nodes i given the node j after them.  log_p (n, M1), U (n, 1 + w + q), gamma
 * (n, M1); scratch: 2 M1 vectors. */
FK_INLINE_HERE void FK_NAME(fk_smooth_back_laid_out)(const fk_kernel *k, const int is_sparse, size_t n,
                                                     const double *log_p, const double *U, double *after,
                                                     double *gamma, double *scratch) {
  const int M1 = k->M1, width = 1 + k->w + k->q;
  FK_V *e = (FK_V *)scratch, *sum = e + M1;
  for (size_t t = n; t-- > 0;) {
    const double *u = U + t * width, *p = log_p + t * M1;
    double *now = gamma + t * M1;
    for (int i = 0; i < M1; i++) {
      if (is_sparse) now[i] = 0.0;
      else sum[i] = FK_NAME(fk_all)(0.0);
    }
    for (int b = 0; b < FK_AS_VECTORS(k->M2); b++) {
      const int *sources = FK_SOURCES(b), depth = FK_DEPTH(b);
      FK_V top = FK_NAME(fk_all)(-DBL_MAX), column = FK_NAME(fk_all)(0.0);
      for (int s = 0; s < depth; s++) {
        e[s] = FK_NAME(fk_log_pair)(k, s, b, u) + FK_NAME(fk_held)(is_sparse, p, sources, s);
        top = FK_NAME(fk_max)(top, e[s]);
      }
      double reference;
      for (int l = 0, j = b * FK_WIDTH; l < FK_WIDTH && j < k->M2; l++, j++)
        if (top[l] < FK_NEAR && top[l] > FK_DEAD) top[l] = fk_far_column(k, p, u, j, (double *)e + l, FK_WIDTH, &reference);
      for (int s = 0; s < depth; s++) {
        e[s] = FK_NAME(fk_exp)(e[s] - top);
        column += e[s];
      }
      const FK_V share = FK_READ(after, b) / column;
      for (int s = 0; s < depth; s++) {
        if (!is_sparse) sum[s] += e[s] * share;
        else {
          const FK_V joint = e[s] * share;
          for (int l = 0; l < FK_WIDTH; l++) now[sources[s * FK_LANES + l]] += joint[l];
        }
      }
    }
    double total = 0.0; /* one, but for rounding, which would add up */
    for (int i = 0; i < M1; i++) {
      if (!is_sparse) now[i] = FK_NAME(fk_sum)(sum[i]);
      total += now[i];
    }
    for (int i = 0; i < M1; i++) now[i] /= total;
    if (t) memcpy(after, now, M1 * sizeof(double)); /* n > 1 only if M1 = M2: the padding stays zero */
  }
}

FK_TARGET static void FK_NAME(fk_smooth_back)(const fk_kernel *k, size_t n, const double *log_p, const double *U,
                                              double *after, double *gamma, double *scratch) {
  if (k->is_sparse) FK_NAME(fk_smooth_back_laid_out)(k, 1, n, log_p, U, after, gamma, scratch);
  else FK_NAME(fk_smooth_back_laid_out)(k, 0, n, log_p, U, after, gamma, scratch);
}

/* Viterbi's recursion along n steps: score (padded M1 = padded M2), pointers (n, M2) to the nodes before. */
FK_INLINE_HERE void FK_NAME(fk_best_path_laid_out)(const fk_kernel *k, const int is_sparse, size_t n, double *score,
                                                   const double *U, int64_t *pointers, double *scratch) {
  const int M2 = k->M2, width = 1 + k->w + k->q;
  for (size_t t = 0; t < n; t++) {
    double peak = -INFINITY;
    for (int b = 0; b < FK_AS_VECTORS(M2); b++) {
      const int *sources = FK_SOURCES(b), depth = FK_DEPTH(b);
      FK_V best = FK_NAME(fk_all)(-INFINITY), from = FK_NAME(fk_all)(0.0);
      for (int s = 0; s < depth; s++) {
        const FK_V total = FK_NAME(fk_log_pair)(k, s, b, U + t * width) + FK_NAME(fk_held)(is_sparse, score, sources, s);
        const FK_B better = (FK_B)(total > best);
        best = FK_NAME(fk_select)(better, total, best);
        from = FK_NAME(fk_select)(better, FK_NAME(fk_all)(s), from);
      }
      FK_AT(scratch, b) = best;
      for (int j = b * FK_WIDTH; j < (b + 1) * FK_WIDTH && j < M2; j++) {
        pointers[t * M2 + j] = fk_source(k, (int)from[j - b * FK_WIDTH], j);
        peak = scratch[j] > peak ? scratch[j] : peak;
      }
    }
    if (peak < FK_NEAR && peak > FK_DEAD) { /* an outlier: differences of densities first */
      double *references = scratch + fk_padded(M2), *total = references + fk_padded(M2);
      const double *u = U + t * width;
      for (int j = 0; j < M2; j++) {
        const int depth = fk_depth(k, j);
        int from = 0;
        scratch[j] = fk_far_column(k, score, u, j, total, 1, references + j);
        while (from < depth - 1 && total[from] != scratch[j]) from++;
        pointers[t * M2 + j] = fk_source(k, from, j);
      }
      fk_far_references(k, score, u, references, scratch);
      peak = -INFINITY;
      for (int j = 0; j < M2; j++) peak = scratch[j] > peak ? scratch[j] : peak;
    }
    for (int j = 0; j < M2; j++) {
      const double ahead = scratch[j] - peak;
      score[j] = ahead > FK_LOG_ZERO ? ahead : FK_LOG_ZERO; /* where no path leads nothing adds up */
    }
  }
}

FK_TARGET static void FK_NAME(fk_best_path)(const fk_kernel *k, size_t n, double *score, const double *U,
                                            int64_t *pointers, double *scratch) { /* scratch: 3 padded M */
  if (k->is_sparse) FK_NAME(fk_best_path_laid_out)(k, 1, n, score, U, pointers, scratch);
  else FK_NAME(fk_best_path_laid_out)(k, 0, n, score, U, pointers, scratch);
}
