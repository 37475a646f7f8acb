/* Prediction and update of FK_LANES series side by side; included once per kind of processor, after
 * lanes_body.h.
 *
 * The functions called sized are inlined with constant sizes for the usual ones.  The arithmetic is that of
 * kalman_body.h: full matrices, Joseph's form, symmetrised at the end.
 */
#define FK_LANE(rows, r) (*(FK_V *)((rows) + (size_t)(r) * FK_LANES))

/* -2 log N(y; 0, S) but for the constant: the sum of w_i^2 / D_i, L w = y; zero for zeros. */
FK_INLINE_HERE FK_V FK_NAME(fk_distance)(const int m, const FK_V *y, const FK_V *L, const FK_V *D) {
  FK_V w[FK_KALMAN_LARGEST], sum = {0};
  for (int i = 0; i < m; i++) {
    w[i] = y[i];
    for (int j = 0; j < i; j++) w[i] -= L[i * m + j] * w[j];
    sum += w[i] * w[i] / D[i];
  }
  return sum;
}

/* x_prior = F x + u, and y = z - H x_prior */
FK_INLINE_HERE void FK_NAME(fk_means_sized)(const int n, const int m, const double *F, const double *H,
                                            const double *u, const double *z, const FK_V *x, FK_V *prior, FK_V *y) {
  for (int i = 0; i < n; i++) {
    FK_V sum = F[i * n] * x[0];
    for (int j = 1; j < n; j++) sum += F[i * n + j] * x[j];
    if (u) sum += FK_LANE(u, i);
    prior[i] = sum;
  }
  for (int i = 0; i < m; i++) {
    FK_V sum = H[i * n] * prior[0];
    for (int j = 1; j < n; j++) sum += H[i * n + j] * prior[j];
    y[i] = FK_LANE(z, i) - sum;
  }
}

FK_INLINE_HERE void FK_NAME(fk_shared_sized)(const int n, const int m, const fk_linear *model, const fk_gains *gains,
                                             size_t first, int steps, const fk_lanes_room *room, int lane) {
  FK_V x[FK_KALMAN_LARGEST], prior[FK_KALMAN_LARGEST], y[FK_KALMAN_LARGEST];
  for (int i = 0; i < n; i++) x[i] = FK_LANE(room->x_state + lane, i);
  for (int t = 0; t < steps; t++) {
    const double *K = gains->K + (size_t)t * n * m;
    FK_NAME(fk_means_sized)(n, m, model->F + (first + t) * model->F_stride, model->H + (first + t) * model->H_stride,
                            room->u ? room->u + lane + (size_t)t * n * FK_LANES : NULL,
                            room->z + lane + (size_t)t * m * FK_LANES, x, prior, y);
    for (int i = 0; i < n; i++) {
      x[i] = prior[i];
      for (int j = 0; j < m; j++) x[i] += K[i * m + j] * y[j];
      FK_LANE(room->x + lane, t * n + i) = x[i];
    }
    if (room->x_prior)
      for (int i = 0; i < n; i++) FK_LANE(room->x_prior + lane, t * n + i) = prior[i];
    if (room->log_likelihood) {
      FK_V L[FK_KALMAN_SQUARE], D[FK_KALMAN_LARGEST];
      for (int i = 0; i < m; i++) {
        for (int j = 0; j < i; j++) L[i * m + j] = FK_NAME(fk_all)(gains->L[(size_t)t * m * m + i * m + j]);
        D[i] = FK_NAME(fk_all)(gains->D[(size_t)t * m + i]);
      }
      FK_LANE(room->log_likelihood + lane, t) =
          -0.5 * (FK_NAME(fk_distance)(m, y, L, D) + gains->constant[t]);
    }
  }
  for (int i = 0; i < n; i++) FK_LANE(room->x_state + lane, i) = x[i];
}

/* P_prior = alpha^2 F P F' + Q */
FK_INLINE_HERE void FK_NAME(fk_predict_lanes)(const int n, const double *F, const double *Q, const double alpha_sq,
                                              const double *P, double *P_prior) {
  for (int i = 0; i < n; i++) {
    FK_V FP[FK_KALMAN_LARGEST];
    for (int j = 0; j < n; j++) {
      FP[j] = F[i * n] * FK_LANE(P, j);
      for (int k = 1; k < n; k++) FP[j] += F[i * n + k] * FK_LANE(P, k * n + j);
    }
    for (int j = 0; j < n; j++) {
      FK_V sum = FP[0] * F[j * n];
      for (int k = 1; k < n; k++) sum += FP[k] * F[j * n + k];
      FK_LANE(P_prior, i * n + j) = alpha_sq * sum + Q[i * n + j];
    }
  }
}

/* L D L' of the components seen, which are the identity elsewhere; the lanes in which S is not positive
 * definite */
FK_INLINE_HERE FK_B FK_NAME(fk_factor_lanes)(const int m, const FK_V *S, const FK_B *seen, FK_V *L, FK_V *D) {
  FK_B failed = {0};
  for (int i = 0; i < m; i++) {
    FK_V pivot = S[i * m + i];
    for (int j = 0; j < i; j++) {
      FK_V sum = S[i * m + j];
      for (int t = 0; t < j; t++) sum -= L[i * m + t] * L[j * m + t] * D[t];
      L[i * m + j] = FK_NAME(fk_select)(seen[i] & seen[j], sum / D[j], (FK_V){0});
      pivot -= L[i * m + j] * L[i * m + j] * D[j];
    }
    const FK_B good = (FK_B)(pivot > FK_PIVOT_TOLERANCE * S[i * m + i]) & (FK_B)(pivot < INFINITY - (FK_V){0});
    failed |= seen[i] & ~good;
    D[i] = FK_NAME(fk_select)(seen[i], pivot, FK_NAME(fk_all)(1.0));
  }
  return failed;
}

/* K' = S^-1 (P H')', zero in the rows of what is missing */
FK_INLINE_HERE void FK_NAME(fk_gain_lanes)(const int n, const int m, const FK_V *PHT, const FK_B *seen, const FK_V *L,
                                           const FK_V *D, FK_V *KT) {
  for (int i = 0; i < m; i++)
    for (int j = 0; j < n; j++) {
      FK_V sum = FK_NAME(fk_select)(seen[i], PHT[j * m + i], (FK_V){0});
      for (int t = 0; t < i; t++) sum -= L[i * m + t] * KT[t * n + j];
      KT[i * n + j] = sum;
    }
  for (int i = m - 1; i >= 0; i--)
    for (int j = 0; j < n; j++) {
      FK_V sum = KT[i * n + j] / D[i];
      for (int t = i + 1; t < m; t++) sum -= L[t * m + i] * KT[t * n + j];
      KT[i * n + j] = sum;
    }
}

/* P = (I - K H) P_prior (I - K H)' + K R K', symmetrised; P_prior where nothing was seen */
FK_INLINE_HERE void FK_NAME(fk_correct_lanes)(const int n, const int m, const double *H, const double *R,
                                              const FK_V *KT, const FK_B none, const double *P_prior, double *P) {
  FK_V A[FK_KALMAN_SQUARE], AP[FK_KALMAN_LARGEST], KR[FK_KALMAN_LARGEST], new[FK_KALMAN_SQUARE];
  for (int i = 0; i < n; i++)
    for (int j = 0; j < n; j++) {
      FK_V sum = KT[i] * H[j];
      for (int t = 1; t < m; t++) sum += KT[t * n + i] * H[t * n + j];
      A[i * n + j] = (i == j ? 1.0 : 0.0) - sum;
    }
  for (int i = 0; i < n; i++) {
    for (int j = 0; j < n; j++) {
      AP[j] = A[i * n] * FK_LANE(P_prior, j);
      for (int k = 1; k < n; k++) AP[j] += A[i * n + k] * FK_LANE(P_prior, k * n + j);
    }
    for (int j = 0; j < m; j++) {
      KR[j] = KT[i] * R[j];
      for (int k = 1; k < m; k++) KR[j] += KT[k * n + i] * R[k * m + j];
    }
    for (int j = 0; j < n; j++) {
      FK_V sum = AP[0] * A[j * n];
      for (int k = 1; k < n; k++) sum += AP[k] * A[j * n + k];
      for (int k = 0; k < m; k++) sum += KR[k] * KT[k * n + j];
      new[i * n + j] = sum;
    }
  }
  for (int i = 0; i < n; i++)
    for (int j = 0; j < n; j++)
      FK_LANE(P, i * n + j) = FK_NAME(fk_select)(none, FK_LANE(P_prior, i * n + j),
                                                 0.5 * (new[i * n + j] + new[j * n + i]));
}

FK_INLINE_HERE int FK_NAME(fk_any)(FK_B mask) {
  int64_t any = 0;
  for (int k = 0; k < FK_WIDTH; k++) any |= mask[k];
  return any != 0;
}

FK_INLINE_HERE int FK_NAME(fk_apart_sized)(const int n, const int m, const fk_linear *model, size_t first, int steps,
                                           const fk_lanes_room *room, int lane) {
  FK_V x[FK_KALMAN_LARGEST], prior[FK_KALMAN_LARGEST], y[FK_KALMAN_LARGEST];
  FK_V PHT[FK_KALMAN_SQUARE], S[FK_KALMAN_SQUARE], KT[FK_KALMAN_SQUARE], L[FK_KALMAN_SQUARE], D[FK_KALMAN_LARGEST];
  FK_B seen[FK_KALMAN_LARGEST];
  const double *P = room->P_state + lane;
  for (int i = 0; i < n; i++) x[i] = FK_LANE(room->x_state + lane, i);
  for (int t = 0; t < steps; t++) {
    const size_t s = first + t;
    const double *H = model->H + s * model->H_stride, *R = model->R + s * model->R_stride;
    const double *z = room->z + lane + (size_t)t * m * FK_LANES;
    double *P_prior = room->P_prior + lane + (size_t)t * room->P_prior_stride * FK_LANES;
    double *P_new = room->P + lane + (size_t)t * room->P_stride * FK_LANES;
    FK_B none = ~(FK_B){0};
    FK_NAME(fk_means_sized)(n, m, model->F + s * model->F_stride, H,
                            room->u ? room->u + lane + (size_t)t * n * FK_LANES : NULL, z, x, prior, y);
    FK_NAME(fk_predict_lanes)(n, model->F + s * model->F_stride, model->Q + s * model->Q_stride, model->alpha_sq, P,
                              P_prior);
    for (int i = 0; i < n; i++)
      for (int j = 0; j < m; j++) {
        FK_V sum = FK_LANE(P_prior, i * n) * H[j * n];
        for (int k = 1; k < n; k++) sum += FK_LANE(P_prior, i * n + k) * H[j * n + k];
        PHT[i * m + j] = sum;
      }
    for (int i = 0; i < m; i++) {
      const FK_V value = FK_LANE(z, i);
      seen[i] = (FK_B)(value == value);
      none &= ~seen[i];
      y[i] = FK_NAME(fk_select)(seen[i], y[i], (FK_V){0});
      for (int j = 0; j <= i; j++) {
        FK_V sum = H[i * n] * PHT[j];
        for (int k = 1; k < n; k++) sum += H[i * n + k] * PHT[k * m + j];
        S[i * m + j] = sum + R[i * m + j];
      }
    }
    FK_B failed = FK_NAME(fk_factor_lanes)(m, S, seen, L, D);
    FK_NAME(fk_gain_lanes)(n, m, PHT, seen, L, D, KT);
    FK_NAME(fk_correct_lanes)(n, m, H, R, KT, none, P_prior, P_new);
    FK_V spread = {0}; /* as in kalman_body.h; what is no number less itself is not zero */
    for (int i = 0; i < n; i++) spread += FK_LANE(P_new, i * n + i);
    failed |= ~none & ~(FK_B)(spread - spread == (FK_V){0});
    if (FK_NAME(fk_any)(failed)) return t;
    for (int i = 0; i < n; i++) {
      x[i] = prior[i];
      for (int j = 0; j < m; j++) x[i] += KT[j * n + i] * y[j];
      FK_LANE(room->x + lane, t * n + i) = x[i];
    }
    if (room->x_prior)
      for (int i = 0; i < n; i++) FK_LANE(room->x_prior + lane, t * n + i) = prior[i];
    if (room->log_likelihood) {
      FK_V sum = FK_NAME(fk_distance)(m, y, L, D);
      for (int i = 0; i < m; i++) {
        const FK_V size = D[i];
        FK_V logs = {0};
        for (int k = 0; k < FK_WIDTH; k++)
          if (seen[i][k]) logs[k] = FK_LOG_2PI + log(size[k]);
        sum += logs;
      }
      FK_LANE(room->log_likelihood + lane, t) = -0.5 * sum;
    }
    P = P_new;
  }
  for (int i = 0; i < n; i++) FK_LANE(room->x_state + lane, i) = x[i];
  for (int i = 0; i < n * n; i++) FK_LANE(room->P_state + lane, i) = FK_LANE(P, i);
  return steps;
}

#define FK_SIZES FK_SIZE(1, 1) FK_SIZE(2, 1) FK_SIZE(4, 2)

FK_TARGET static FK_ALONE void FK_NAME(fk_kalman_shared)(const fk_linear *model, const fk_gains *gains, size_t first,
                                                         int steps, const fk_lanes_room *room) {
#define FK_SIZE(n, m) \
  case n * 32 + m: FK_NAME(fk_shared_sized)(n, m, model, gains, first, steps, room, lane); continue;
  for (int lane = 0; lane < FK_LANES; lane += FK_WIDTH) switch (FK_OWN_SIZE(model->n * 32 + model->m)) {
      FK_SIZES
      default: FK_NAME(fk_shared_sized)(model->n, model->m, model, gains, first, steps, room, lane);
    }
#undef FK_SIZE
}

FK_TARGET static FK_ALONE int FK_NAME(fk_kalman_apart)(const fk_linear *model, size_t first, int steps,
                                                       const fk_lanes_room *room) {
  int least = steps;
#define FK_SIZE(n, m) \
  case n * 32 + m: done = FK_NAME(fk_apart_sized)(n, m, model, first, steps, room, lane); break;
  for (int lane = 0; lane < FK_LANES; lane += FK_WIDTH) {
    int done;
    switch (FK_OWN_SIZE(model->n * 32 + model->m)) {
      FK_SIZES
      default: done = FK_NAME(fk_apart_sized)(model->n, model->m, model, first, steps, room, lane);
    }
    if (done < least) least = done;
  }
#undef FK_SIZE
  return least;
}

#undef FK_SIZES
#undef FK_LANE
