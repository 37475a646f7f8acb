/* Forward and backward pass of a hidden Markov chain whose observations depend on pairs of
 * states; included once per kind of processor.  first (M), transition (M, M), log_emission
 * (T, M, M); gamma (T + 1, M), xi (T, M, M), log_likelihood (T); scratch: T + 2 M.
 *
 * Messages are scaled to sums of one.  Returns 0 where totals underflow, or the backward
 * messages grow so much that what has underflowed may matter: then logarithms have to be used. */
FK_TARGET static int FK_NAME(fk_forward_backward)(int T, int M, const double *first, const double *transition,
                                                  const double *log_emission, double *gamma, double *xi,
                                                  double *log_likelihood, double *scratch) {
  const size_t pairs = (size_t)M * M;
  double *scale = scratch, *beta = scratch + T, *now = beta + M;
  for (int i = 0; i < M; i++) gamma[i] = first[i];
  for (int n = 0; n < T; n++) {
    const double *log_e = log_emission + n * pairs, *alpha = gamma + (size_t)n * M;
    double *moves = xi + n * pairs, *next = gamma + (size_t)(n + 1) * M;
    double peak = -INFINITY, total = 0.0;
    for (size_t k = 0; k < pairs; k++) peak = log_e[k] > peak ? log_e[k] : peak;
    for (size_t k = 0; k < pairs; k += FK_WIDTH) {
      const int lanes = pairs - k < FK_WIDTH ? (int)(pairs - k) : FK_WIDTH;
      FK_V a = FK_NAME(fk_all)(0.0), small = FK_NAME(fk_all)(1.0);
      for (int t = 0; t < lanes; t++) {
        a[t] = log_e[k + t] - peak;
        if (a[t] < -600.0) { /* numbers below the normal ones count if beta is large */
          a[t] += 300.0;
          small[t] = 5.148200222412013e-131; /* exp(-300) */
        }
      }
      a = FK_NAME(fk_exp)(a);
      for (int t = 0; t < lanes; t++) moves[k + t] = a[t] * small[t] * transition[k + t];
    }
    for (int j = 0; j < M; j++) next[j] = 0.0;
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
}
