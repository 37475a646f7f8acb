/* Forward and backward pass of a hidden Markov chain whose observations depend on pairs of
 * states; included once per kind of processor.  first (M), transition (M, M), log_emission
 * (T, M, M); gamma (T + 1, M), xi (T, M, M), log_likelihood (T); scratch: T + 2 M + n.
 *
 * Of n pairs alone, `arrows`, something is asked: of all, or of those of positive probability.  Where they are
 * few, the weights of a step stand side by side at the beginning of its place in xi, until they are spread.
 *
 * Messages are scaled to sums of one.  Returns 0 where totals underflow, or the backward
 * messages grow so much that what has underflowed may matter: then logarithms have to be used. */

/* Weights of the pairs of a step, relative to the largest density, whose logarithm is returned. */
FK_INLINE_HERE double FK_NAME(fk_pair_moves)(const int is_sparse, int M, const fk_arrows *arrows,
                                             const double *transition, const double *log_e, double *moves) {
#define FK_PLACE(k) (is_sparse ? (size_t)arrows->from[k] * M + arrows->to[k] : (size_t)(k))
  const size_t n = arrows->n;
  double peak = -INFINITY;
  for (size_t k = 0; k < n; k++) {
    const double l = log_e[FK_PLACE(k)];
    peak = l > peak ? l : peak;
  }
  for (size_t k = 0; k < n; k += FK_WIDTH) {
    const int lanes = n - k < FK_WIDTH ? (int)(n - k) : FK_WIDTH;
    FK_V a = FK_NAME(fk_all)(0.0), small = FK_NAME(fk_all)(1.0);
    for (int t = 0; t < lanes; t++) {
      a[t] = log_e[FK_PLACE(k + t)] - peak;
      if (a[t] < -600.0) { /* numbers below the normal ones count if beta is large */
        a[t] += 300.0;
        small[t] = 5.148200222412013e-131; /* exp(-300) */
      }
    }
    a = FK_NAME(fk_exp)(a);
    for (int t = 0; t < lanes; t++) moves[k + t] = a[t] * small[t] * transition[FK_PLACE(k + t)];
  }
  return peak;
}

FK_INLINE_HERE int FK_NAME(fk_messages)(const int is_sparse, int T, int M, const fk_arrows *arrows,
                                        const double *first, const double *transition, const double *log_emission,
                                        double *gamma, double *xi, double *log_likelihood, double *scratch) {
  const size_t pairs = (size_t)M * M, count = arrows->n;
  const int *from = arrows->from, *to = arrows->to;
  double *scale = scratch, *beta = scratch + T, *now = beta + M, *side = now + M;
  for (int i = 0; i < M; i++) gamma[i] = first[i];
  for (int n = 0; n < T; n++) {
    const double *alpha = gamma + (size_t)n * M;
    double *moves = xi + n * pairs, *next = gamma + (size_t)(n + 1) * M, total = 0.0;
    const double peak = FK_NAME(fk_pair_moves)(is_sparse, M, arrows, transition, log_emission + n * pairs, moves);
    for (int j = 0; j < M; j++) next[j] = 0.0;
    if (is_sparse)
      for (size_t k = 0; k < count; k++) next[to[k]] += alpha[from[k]] * moves[k];
    else
      for (int i = 0; i < M; i++)
        for (int j = 0; j < M; j++) next[j] += alpha[i] * moves[(size_t)i * M + j];
    for (int j = 0; j < M; j++) total += next[j];
    if (!(total > 1e-290)) return 0;
    for (int j = 0; j < M; j++) next[j] /= total;
    scale[n] = total;
    log_likelihood[n] = log(total) + peak;
  }
  for (int i = 0; i < M; i++) beta[i] = 1.0;
  for (int n = T - 1; n >= 0; n--) {
    double *moves = xi + n * pairs, *after = gamma + (size_t)(n + 1) * M;
    const double *alpha = gamma + (size_t)n * M;
    if (is_sparse) {
      memcpy(side, moves, count * sizeof(double));
      memset(moves, 0, pairs * sizeof(double));
      for (int i = 0; i < M; i++) now[i] = 0.0;
      for (size_t k = 0; k < count; k++) {
        now[from[k]] += side[k] * beta[to[k]];
        moves[FK_PLACE(k)] = alpha[from[k]] * side[k] * (beta[to[k]] / scale[n]);
      }
      for (int i = 0; i < M; i++) now[i] /= scale[n];
    } else
      for (int i = 0; i < M; i++) {
        double sum = 0.0;
        for (int j = 0; j < M; j++) {
          const size_t k = (size_t)i * M + j;
          sum += moves[k] * beta[j];
          moves[k] = alpha[i] * moves[k] * (beta[j] / scale[n]);
        }
        now[i] = sum / scale[n];
      }
    for (int j = 0; j < M; j++) {
      if (!(now[j] < 1e250)) return 0;
      after[j] *= beta[j];
      beta[j] = now[j];
    }
  }
  for (int i = 0; i < M; i++) gamma[i] *= beta[i];
  return 1;
#undef FK_PLACE
}

FK_TARGET static int FK_NAME(fk_forward_backward)(int T, int M, const fk_arrows *arrows, const double *first,
                                                  const double *transition, const double *log_emission,
                                                  double *gamma, double *xi, double *log_likelihood,
                                                  double *scratch) {
  if (arrows->from)
    return FK_NAME(fk_messages)(1, T, M, arrows, first, transition, log_emission, gamma, xi, log_likelihood, scratch);
  return FK_NAME(fk_messages)(0, T, M, arrows, first, transition, log_emission, gamma, xi, log_likelihood, scratch);
}
