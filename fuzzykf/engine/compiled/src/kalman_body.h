/* Prediction and update; included once per kind of processor (FK_NAME, FK_TARGET).
 *
 * The functions called sized are inlined with constant sizes for the usual ones, so that their
 * loops unroll.  Rows are sums of rows times numbers, which needs no sum across a vector.
 */

/* row = a B, and row += a B: a (k), B (k, c); in blocks of columns whose sums stay in registers */
#define FK_BLOCK(type, width, start)                                                     \
  for (; j + width <= c; j += width) {                                                   \
    type sum = start;                                                                    \
    FK_UNROLL for (int t = 0; t < k; t++) sum += a[t] * *(const type *)(B + t * c + j);  \
    *(type *)(row + j) = sum;                                                            \
  }

FK_INLINE_HERE void FK_NAME(fk_row)(const int k, const int c, const double *a, const double *B, double *row) {
  int j = 0;
  FK_BLOCK(fk_quad, 4, (fk_quad){0})
  FK_BLOCK(fk_pair, 2, (fk_pair){0})
  FK_BLOCK(double, 1, 0.0)
}

FK_INLINE_HERE void FK_NAME(fk_add_row)(const int k, const int c, const double *a, const double *B, double *row) {
  int j = 0;
  FK_BLOCK(fk_quad, 4, *(const fk_quad *)(row + j))
  FK_BLOCK(fk_pair, 2, *(const fk_pair *)(row + j))
  FK_BLOCK(double, 1, row[j])
}
#undef FK_BLOCK

FK_INLINE_HERE void FK_NAME(fk_transpose)(const int r, const int c, const double *A, double *T) {
  for (int i = 0; i < r; i++)
    for (int j = 0; j < c; j++) T[j * r + i] = A[i * c + j];
}

/* x_prior = F x, P_prior = alpha^2 F P F' + Q; FT is F' */
FK_INLINE_HERE void FK_NAME(fk_predict_sized)(const int n, fk_kalman *f, const double *FT) {
  double row[FK_KALMAN_LARGEST], FP[FK_KALMAN_LARGEST];
  FK_NAME(fk_row)(n, n, f->x, FT, row);
  for (int i = 0; i < n; i++) f->x_prior[i] = row[i];
  for (int i = 0; i < n; i++) {
    FK_NAME(fk_row)(n, n, f->F + i * n, f->P, FP);
    FK_NAME(fk_row)(n, n, FP, FT, row);
    for (int j = 0; j < n; j++) f->P_prior[i * n + j] = f->alpha_sq * row[j] + f->Q[i * n + j];
  }
}

/* L D L' of the components seen of S; 0 where it is not positive definite */
FK_INLINE_HERE int FK_NAME(fk_factor)(const int m, const int M, fk_kalman *f) {
  for (int i = 0; i < m; i++) {
    double pivot;
    const double *row = f->S + f->seen[i] * M;
    for (int j = 0; j < i; j++) {
      double sum = row[f->seen[j]];
      for (int t = 0; t < j; t++) sum -= f->L[i * m + t] * f->L[j * m + t] * f->D[t];
      f->L[i * m + j] = sum / f->D[j];
    }
    pivot = row[f->seen[i]];
    for (int t = 0; t < i; t++) pivot -= f->L[i * m + t] * f->L[i * m + t] * f->D[t];
    if (!(pivot > (m == 1 ? 0.0 : FK_PIVOT_TOLERANCE * row[f->seen[i]]) && pivot < INFINITY)) return 0;
    f->D[i] = pivot;
  }
  return 1;
}

/* m is the number of components, `seen` that of those observed, either of which may be constant. */
FK_INLINE_HERE int FK_NAME(fk_update_sized)(const int n, const int m, const int seen, fk_kalman *f,
                                            const double *HT, const double *z) {
  double W[FK_KALMAN_SQUARE];  /* (P H')', then K' of the components seen */
  double PHT[FK_KALMAN_SQUARE], A[FK_KALMAN_SQUARE], AT[FK_KALMAN_SQUARE], P[FK_KALMAN_SQUARE];
  double KT[FK_KALMAN_SQUARE], row[FK_KALMAN_LARGEST];
  const double *H = f->H, *R = f->R;
  for (int i = 0; i < n; i++) FK_NAME(fk_row)(n, m, f->P_prior + i * n, HT, PHT + i * m);
  for (int i = 0; i < m; i++) {
    FK_NAME(fk_row)(n, m, H + i * n, PHT, row);
    for (int j = 0; j < m; j++) f->S[i * m + j] = row[j] + R[i * m + j];
  }
  FK_NAME(fk_row)(n, m, f->x_prior, HT, row);
  for (int i = 0; i < m; i++) f->y[i] = z[i] - row[i];
  if (seen == m) {
    for (int i = 0; i < m; i++) f->seen[i] = i;
  } else {
    int count = 0;
    for (int i = 0; i < m; i++) {
      if (isnan(z[i])) f->y[i] = 0.0;
      else f->seen[count++] = i;
    }
  }
  f->n_seen = seen;
  if (!FK_NAME(fk_factor)(seen, m, f)) return 0;
  /* K' = S^-1 (P H')' */
  for (int i = 0; i < seen; i++) {
    for (int j = 0; j < n; j++) W[i * n + j] = PHT[j * m + f->seen[i]];
    for (int t = 0; t < i; t++)
      for (int j = 0; j < n; j++) W[i * n + j] -= f->L[i * seen + t] * W[t * n + j];
  }
  for (int i = seen - 1; i >= 0; i--) {
    for (int j = 0; j < n; j++) W[i * n + j] /= f->D[i];
    for (int t = i + 1; t < seen; t++)
      for (int j = 0; j < n; j++) W[i * n + j] -= f->L[t * seen + i] * W[t * n + j];
  }
  if (seen == m) {
    for (int i = 0; i < m * n; i++) KT[i] = W[i];
  } else {
    for (int i = 0; i < m * n; i++) KT[i] = 0.0;
    for (int i = 0; i < seen; i++)
      for (int j = 0; j < n; j++) KT[f->seen[i] * n + j] = W[i * n + j];
  }
  FK_NAME(fk_transpose)(m, n, KT, f->K);
  for (int i = 0; i < n; i++) FK_NAME(fk_row)(m, n, f->K + i * m, H, A + i * n);
  for (int i = 0; i < n; i++)
    for (int j = 0; j < n; j++) A[i * n + j] = (i == j ? 1.0 : 0.0) - A[i * n + j];
  FK_NAME(fk_transpose)(n, n, A, AT);
  for (int i = 0; i < n; i++) {
    double AP[FK_KALMAN_LARGEST], KR[FK_KALMAN_LARGEST];
    FK_NAME(fk_row)(n, n, A + i * n, f->P_prior, AP);
    FK_NAME(fk_row)(n, n, AP, AT, P + i * n);
    FK_NAME(fk_row)(m, m, f->K + i * m, R, KR);
    FK_NAME(fk_add_row)(m, n, KR, KT, P + i * n);
  }
  for (int i = 0; i < n; i++)
    for (int j = 0; j < n; j++) f->P[i * n + j] = 0.5 * (P[i * n + j] + P[j * n + i]);
  for (int j = 0; j < n; j++) f->x[j] = f->x_prior[j];
  FK_NAME(fk_add_row)(m, n, f->y, KT, f->x);
  double spread = 0.0; /* beyond the range of numbers the general way tells what is wrong */
  for (int i = 0; i < n; i++) spread += f->P[i * n + i];
  return isfinite(spread);
}

/* Some components are missing: rare, so one function for all sizes. */
FK_TARGET static FK_ALONE int FK_NAME(fk_update_some)(fk_kalman *f, const int seen,
                                                                       const double *HT, const double *z) {
  return FK_NAME(fk_update_sized)(f->n, f->m, seen, f, HT, z);
}

FK_INLINE_HERE int FK_NAME(fk_update_any)(const int n, const int m, const int seen, fk_kalman *f,
                                          const double *HT, const double *z) {
  if (seen == m) return FK_NAME(fk_update_sized)(n, m, m, f, HT, z);
  return FK_NAME(fk_update_some)(f, seen, HT, z);
}

FK_INLINE_HERE int FK_NAME(fk_count_seen)(const int m, const double *z) {
  int seen = 0;
  for (int i = 0; i < m; i++) seen += !isnan(z[i]);
  return seen;
}

FK_TARGET static FK_ALONE void FK_NAME(fk_kalman_predict)(fk_kalman *f) {
  double FT[FK_KALMAN_SQUARE];
#define FK_SIZE(n)                             \
  case n:                                      \
    FK_NAME(fk_transpose)(n, n, f->F, FT);     \
    FK_NAME(fk_predict_sized)(n, f, FT);       \
    return;
  switch (FK_OWN_SIZE(f->n)) {
    FK_SIZE(1) FK_SIZE(2) FK_SIZE(3) FK_SIZE(4) FK_SIZE(6)
    default:
      FK_NAME(fk_transpose)(f->n, f->n, f->F, FT);
      FK_NAME(fk_predict_sized)(f->n, f, FT);
  }
#undef FK_SIZE
}

FK_TARGET static FK_ALONE int FK_NAME(fk_kalman_update)(fk_kalman *f, const double *z) {
  double HT[FK_KALMAN_SQUARE];
  const int seen = FK_NAME(fk_count_seen)(f->m, z);
#define FK_SIZE(n, m)                          \
  case n * 32 + m:                             \
    FK_NAME(fk_transpose)(m, n, f->H, HT);     \
    return FK_NAME(fk_update_any)(n, m, seen, f, HT, z);
  switch (FK_OWN_SIZE(f->n * 32 + f->m)) {
    FK_SIZE(1, 1) FK_SIZE(2, 1) FK_SIZE(2, 2) FK_SIZE(3, 1) FK_SIZE(4, 1) FK_SIZE(4, 2) FK_SIZE(6, 2)
    FK_SIZE(6, 3)
    default:
      FK_NAME(fk_transpose)(f->m, f->n, f->H, HT);
      return FK_NAME(fk_update_some)(f, seen, HT, z);
  }
#undef FK_SIZE
}

FK_INLINE_HERE size_t FK_NAME(fk_settled_sized)(const int n, const int m, fk_kalman *f, const fk_kalman_gain *gains,
                                                const double *z, const size_t begin, const size_t n_steps,
                                                const double *controls, const fk_kalman_output *out) {
  const size_t N = n, NN = N * N;
  double FT[FK_KALMAN_SQUARE], HT[FK_KALMAN_SQUARE], KT[2][FK_KALMAN_SQUARE], row[FK_KALMAN_LARGEST];
  double x[FK_KALMAN_LARGEST], prior[FK_KALMAN_LARGEST], y[FK_KALMAN_LARGEST];
  size_t t = begin;
  FK_NAME(fk_transpose)(n, n, f->F, FT);
  FK_NAME(fk_transpose)(m, n, f->H, HT);
  for (int k = 0; k < 2; k++) FK_NAME(fk_transpose)(n, m, gains[k].K, KT[k]);
  for (int i = 0; i < n; i++) x[i] = f->x[i], prior[i] = f->x_prior[i];
  for (int i = 0; i < m; i++) y[i] = f->y[i];
  for (; t < n_steps && FK_NAME(fk_count_seen)(m, z) == m; t++, z += m) {
    const fk_kalman_gain *gain = gains + (t - begin) % 2;
    FK_NAME(fk_row)(n, n, x, FT, prior);
    if (controls)
      for (int i = 0; i < n; i++) prior[i] += controls[t * N + i];
    FK_NAME(fk_row)(n, m, prior, HT, row);
    for (int i = 0; i < m; i++) y[i] = z[i] - row[i];
    for (int i = 0; i < n; i++) x[i] = prior[i];
    FK_NAME(fk_add_row)(m, n, y, KT[(t - begin) % 2], x);
    if (out->x) memcpy(out->x + t * N, x, N * sizeof(double));
    if (out->P) memcpy(out->P + t * NN, gain->P, NN * sizeof(double));
    if (out->x_prior) memcpy(out->x_prior + t * N, prior, N * sizeof(double));
    if (out->P_prior) memcpy(out->P_prior + t * NN, gain->P_prior, NN * sizeof(double));
    if (out->log_likelihood) out->log_likelihood[t] = fk_kalman_log_density(m, y, gain->L, gain->D, gain->log_D);
  }
  for (int i = 0; i < n; i++) f->x[i] = x[i], f->x_prior[i] = prior[i];
  for (int i = 0; i < m; i++) f->y[i] = y[i];
  if ((t - begin) % 2) { /* else it ends with the gain with which it has come */
    memcpy(f->P, gains->P, NN * sizeof(double));
    memcpy(f->P_prior, gains->P_prior, NN * sizeof(double));
    for (int i = 0; i < m * m; i++) f->S[i] = gains->S[i], f->L[i] = gains->L[i];
    for (int i = 0; i < n * m; i++) f->K[i] = gains->K[i];
    for (int i = 0; i < m; i++) f->D[i] = gains->D[i];
  }
  return t;
}

FK_TARGET static FK_ALONE size_t FK_NAME(fk_kalman_settled)(fk_kalman *f, const fk_kalman_gain *gains, const double *z,
                                                            size_t t, size_t n_steps, const double *controls,
                                                            const fk_kalman_output *out) {
#define FK_SIZE(n, m) \
  case n * 32 + m: return FK_NAME(fk_settled_sized)(n, m, f, gains, z, t, n_steps, controls, out);
  switch (FK_OWN_SIZE(f->n * 32 + f->m)) {
    FK_SIZE(1, 1) FK_SIZE(2, 1) FK_SIZE(3, 1) FK_SIZE(4, 1) FK_SIZE(4, 2)
    default: return FK_NAME(fk_settled_sized)(f->n, f->m, f, gains, z, t, n_steps, controls, out);
  }
#undef FK_SIZE
}

#undef FK_NAME
#undef FK_TARGET
#undef FK_IS_SIZED
