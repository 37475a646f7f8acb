/* Steps in which something is missing; included once per kind of processor.  See gaps.py of the engine in NumPy.
 *
 * Covariances go through all this as roots, by rotations of two columns each, which leave small columns their
 * digits beside large ones. */

FK_INLINE_HERE FK_V FK_NAME(fk_sqrt)(FK_V a) {
#if FK_WIDTH == 8
  return (FK_V)_mm512_sqrt_pd((__m512d)a);
#elif FK_WIDTH == 4
  return (FK_V)_mm256_sqrt_pd((__m256d)a);
#else
  return (FK_V){sqrt(a[0]), sqrt(a[1])};
#endif
}

/* a where x > 0, else b. */
FK_INLINE_HERE FK_V FK_NAME(fk_if_positive)(FK_V x, FK_V a, FK_V b) {
#if FK_WIDTH == 8
  return (FK_V)_mm512_mask_blend_pd(_mm512_cmp_pd_mask((__m512d)x, _mm512_setzero_pd(), _CMP_GT_OQ), (__m512d)b, (__m512d)a);
#elif FK_WIDTH == 4
  return (FK_V)_mm256_blendv_pd((__m256d)b, (__m256d)a, _mm256_cmp_pd((__m256d)x, _mm256_setzero_pd(), _CMP_GT_OQ));
#else
  return (FK_V){x[0] > 0.0 ? a[0] : b[0], x[1] > 0.0 ? a[1] : b[1]};
#endif
}

/* What a row holds of the nodes that the lanes come from. */
FK_INLINE_HERE FK_V FK_NAME(fk_node)(const int is_sparse, const double *row, const int *from) {
  if (!is_sparse) return FK_NAME(fk_all)(row[from[0]]);
#if FK_WIDTH == 8
  return (FK_V){row[from[0]], row[from[1]], row[from[2]], row[from[3]],
                row[from[4]], row[from[5]], row[from[6]], row[from[7]]};
#elif FK_WIDTH == 4
  return (FK_V){row[from[0]], row[from[1]], row[from[2]], row[from[3]]};
#else
  return (FK_V){row[from[0]], row[from[1]]};
#endif
}

/* Rotate two columns of n numbers so that the first of b is zero, and that of a not negative; the inverse of that. */
FK_INLINE_HERE FK_V FK_NAME(fk_turn)(FK_V *a, const int stride_a, FK_V *b, const int stride_b, const int n) {
  const FK_V h = FK_NAME(fk_sqrt)(a[0] * a[0] + b[0] * b[0]), one = FK_NAME(fk_all)(1.0);
  const FK_V inverse = 1.0 / FK_NAME(fk_if_positive)(h, h, one);
  const FK_V c = FK_NAME(fk_if_positive)(h, a[0] * inverse, one), s = b[0] * inverse;
  a[0] = h, b[0] = FK_NAME(fk_all)(0.0);
  FK_UNROLL for (int r = 1; r < n; r++) {
    const FK_V x = a[r * stride_a], z = b[r * stride_b];
    a[r * stride_a] = c * x + s * z;
    b[r * stride_b] = c * z - s * x;
  }
  return inverse;
}

/* Merge n components, entries of 2 + e + e e vectors: the second of each is its weight, then mean and root.
 * Weights need not sum to one.  Mean and root go to `to`; work holds e (e + 2) vectors. */
FK_INLINE_HERE void FK_NAME(fk_merge)(const int e, int n, const FK_V *entry, FK_V *to, FK_V *work) {
  const int size = 2 + e + e * e, wide = e + 1;
  FK_V *mean = to, *T = to + e, *B = work, *first = work + e * wide, mass = entry[1], most = mass;
  const FK_V one = FK_NAME(fk_all)(1.0);
  for (int r = 0; r < e; r++) first[r] = entry[2 + r];
  for (int b = 1; b < n; b++) {
    const FK_V *other = entry + (size_t)b * size;
    for (int r = 0; r < e; r++) first[r] = FK_NAME(fk_if_positive)(other[1] - most, other[2 + r], first[r]);
    most = FK_NAME(fk_max)(most, other[1]);
  }
  /* means as differences from the likeliest: what all have in common cancels to the last bit */
  for (int r = 0; r < e; r++) mean[r] = entry[2 + r] - first[r];
  for (int r = 0; r < e * e; r++) T[r] = entry[2 + e + r];
  for (int b = 1; b < n; b++) {
    const FK_V *other = entry + (size_t)b * size, before = mass;
    mass += other[1];
    const FK_V whole = FK_NAME(fk_if_positive)(mass, mass, one);
    const FK_V f = other[1] / whole, g = FK_NAME(fk_if_positive)(mass, before / whole, one);
    const FK_V to_f = FK_NAME(fk_sqrt)(f), to_g = FK_NAME(fk_sqrt)(g);
    for (int r = 0; r < e; r++) {
      const FK_V off = other[2 + r] - first[r];
      B[r * wide + e] = to_f * to_g * (off - mean[r]);
      mean[r] = g * mean[r] + f * off;
      for (int c = 0; c <= r; c++) {
        T[r * e + c] *= to_g;
        B[r * wide + c] = to_f * other[2 + e + r * e + c];
      }
    }
    FK_UNROLL for (int p = 0; p < e - 1; p++) {
      FK_NAME(fk_turn)(T + p * e + p, e, B + p * wide + e, wide, e - p);
      FK_UNROLL for (int c = 0; c <= p; c++) FK_NAME(fk_turn)(T + p * e + p, e, B + p * wide + c, wide, e - p);
    }
    const int p = e - 1; /* in the last row nothing is below */
    FK_V squares = T[p * e + p] * T[p * e + p];
    FK_UNROLL for (int c = 0; c < wide; c++) squares += B[p * wide + c] * B[p * wide + c];
    T[p * e + p] = FK_NAME(fk_sqrt)(squares);
  }
  for (int r = 0; r < e; r++) mean[r] += first[r];
}

/* Where row r of branch b of a state of these sizes begins. */
#define FK_BRANCH(rows, e, b, r, ld) ((rows) + ((size_t)(b) * (1 + (e) + (e) * (e)) + (r)) * (ld))

/* Merge the n branches of every node into one, whose logarithms of probabilities are not filled in. */
FK_INLINE_HERE void FK_NAME(fk_merge_sized)(int M, int n, const int e, const double *rows, double *to, double *scratch) {
  const int ld = fk_padded(M), size = 2 + e + e * e;
  FK_V *entry = (FK_V *)scratch, *merged = entry + (size_t)n * size, *work = merged + e + e * e;
  for (int b = 0; b < FK_AS_VECTORS(M); b++) {
    FK_V top = FK_NAME(fk_all)(-DBL_MAX);
    for (int i = 0; i < n; i++) top = FK_NAME(fk_max)(top, FK_READ(FK_BRANCH(rows, e, i, 0, ld), b));
    for (int i = 0; i < n; i++) {
      FK_V *one = entry + (size_t)i * size;
      one[1] = FK_NAME(fk_exp)(FK_READ(FK_BRANCH(rows, e, i, 0, ld), b) - top);
      for (int r = 0; r < e + e * e; r++) one[2 + r] = FK_READ(FK_BRANCH(rows, e, i, 1 + r, ld), b);
    }
    FK_NAME(fk_merge)(e, n, entry, merged, work);
    for (int r = 0; r < e + e * e; r++) FK_AT(FK_BRANCH(to, e, 0, 1 + r, ld), b) = merged[r];
  }
}

FK_TARGET static void FK_NAME(fk_merge_nodes)(int M, int n, int e, const double *rows, double *to, double *scratch) {
  if (e == 2) FK_NAME(fk_merge_sized)(M, n, 2, rows, to, scratch);
  else FK_NAME(fk_merge_sized)(M, n, e, rows, to, scratch);
}

/* Mean (m) and covariance (m, m) of X' before Y' is seen, from n branches of each node, whose log-probabilities
 * are log_p. */
FK_INLINE_HERE void FK_NAME(fk_prior_gap_sized)(const fk_gaps *k, const int is_sparse, const int m, const int q, const int w,
                                                const int nu, const double *rows, int n, const double *log_p,
                                                const double *window, double *x, double *P, double *scratch) {
  const int M1 = k->M1, e = nu + m, ld = fk_padded(M1), to = fk_padded(k->M2);
  const int Hx = 2 + q * (w + 1), cx = Hx + m * w, Axx = cx + m, N = Axx + m * m, blocks = FK_AS_VECTORS(k->M2);
  double *node = scratch, *weights = node + (size_t)(1 + e + e * e) * ld, *means = weights + (size_t)k->depth * to;
  FK_V *V = (FK_V *)(means + (size_t)k->depth * m * to), *S = V + m * m, *F = S + e + e * e;
  const FK_V zero = FK_NAME(fk_all)(0.0);
  int where[FK_GAPS_LARGEST], found = 0;
  for (int t = 0; t < w; t++)
    if (window[t] != window[t]) where[found++] = t;
  for (int b = 0; b < FK_AS_VECTORS(M1); b++) { /* moments of the nodes */
    FK_V top = FK_NAME(fk_all)(-DBL_MAX), sum = zero, *mu = S, *C = S + e;
    for (int i = 0; i < n; i++) top = FK_NAME(fk_max)(top, FK_READ(FK_BRANCH(rows, e, i, 0, ld), b));
    FK_AT(node, b) = FK_NAME(fk_exp)(FK_READ(log_p, b));
    FK_V first[FK_GAPS_LARGEST];
    for (int r = 0; r < e; r++) first[r] = FK_READ(FK_BRANCH(rows, e, 0, 1 + r, ld), b), mu[r] = zero;
    for (int i = 1; i < n; i++) {
      const FK_V is_top = FK_READ(FK_BRANCH(rows, e, i, 0, ld), b) - top;
      for (int r = 0; r < e; r++) first[r] = FK_NAME(fk_if_positive)(is_top + DBL_MIN, FK_READ(FK_BRANCH(rows, e, i, 1 + r, ld), b), first[r]);
    }
    for (int i = 0; i < n; i++) {
      const FK_V o = FK_NAME(fk_exp)(FK_READ(FK_BRANCH(rows, e, i, 0, ld), b) - top);
      sum += o;
      for (int r = 0; r < e; r++) mu[r] += o * (FK_READ(FK_BRANCH(rows, e, i, 1 + r, ld), b) - first[r]);
    }
    const FK_V inverse = 1.0 / sum;
    for (int r = 0; r < e; r++) mu[r] = first[r] + mu[r] * inverse;
    for (int r = 0; r < e * e; r++) C[r] = zero;
    for (int i = 0; i < n; i++) {
      const FK_V o = FK_NAME(fk_exp)(FK_READ(FK_BRANCH(rows, e, i, 0, ld), b) - top) * inverse;
      for (int r = 0; r < e; r++)
        for (int c = 0; c <= r; c++) {
          FK_V a = (FK_READ(FK_BRANCH(rows, e, i, 1 + r, ld), b) - mu[r]) * (FK_READ(FK_BRANCH(rows, e, i, 1 + c, ld), b) - mu[c]);
          for (int t = 0; t <= c; t++)
            a += FK_READ(FK_BRANCH(rows, e, i, 1 + e + r * e + t, ld), b) * FK_READ(FK_BRANCH(rows, e, i, 1 + e + c * e + t, ld), b);
          C[r * e + c] += o * a;
        }
    }
    for (int r = 0; r < e; r++) FK_AT(node + (size_t)(1 + r) * ld, b) = mu[r];
    for (int r = 0; r < e; r++)
      for (int c = 0; c <= r; c++) {
        FK_AT(node + (size_t)(1 + e + r * e + c) * ld, b) = C[r * e + c];
        FK_AT(node + (size_t)(1 + e + c * e + r) * ld, b) = C[r * e + c];
      }
  }
#define FK_OF(r) FK_READ(k->cells + ((size_t)s * k->size + (r)) * to, b)
#define FK_FROM (k->source + (size_t)s * to + b * FK_WIDTH)
  double most = -1.0, first[FK_GAPS_LARGEST] = {0};
  for (int s = 0; s < k->depth; s++)
    for (int b = 0; b < blocks; b++) {
      FK_V weight = FK_NAME(fk_node)(is_sparse, node, FK_FROM) * FK_OF(0);
      for (int t = 0; t < FK_WIDTH; t++)
        if (b * FK_WIDTH + t >= k->M2) weight[t] = 0.0;
      FK_AT(weights + (size_t)s * to, b) = weight;
      for (int r = 0; r < m; r++) {
        FK_V a = FK_OF(cx + r);
        for (int t = 0, g = 0; t < w; t++) {
          if (g < nu && where[g] == t) a += FK_OF(Hx + r * w + t) * FK_NAME(fk_node)(is_sparse, node + (size_t)(1 + g) * ld, FK_FROM), g++;
          else a += FK_OF(Hx + r * w + t) * window[t];
        }
        for (int l = 0; l < m; l++) a += FK_OF(Axx + r * m + l) * FK_NAME(fk_node)(is_sparse, node + (size_t)(1 + nu + l) * ld, FK_FROM);
        FK_AT(means + ((size_t)s * m + r) * to, b) = a;
      }
      for (int t = 0; t < FK_WIDTH; t++)
        if (weight[t] > most) {
          most = weight[t];
          for (int r = 0; r < m; r++) first[r] = means[((size_t)s * m + r) * to + b * FK_WIDTH + t];
        }
    }
  for (int r = 0; r < m; r++) {
    FK_V sum = zero;
    for (int s = 0; s < k->depth; s++)
      for (int b = 0; b < blocks; b++)
        sum += FK_READ(weights + (size_t)s * to, b) * (FK_READ(means + ((size_t)s * m + r) * to, b) - first[r]);
    x[r] = first[r] + FK_NAME(fk_sum)(sum);
  }
  for (int r = 0; r < m * m; r++) V[r] = zero;
  for (int s = 0; s < k->depth; s++)
    for (int b = 0; b < blocks; b++) {
      for (int r = 0; r < m; r++) {
        for (int g = 0; g < nu; g++) F[r * e + g] = FK_OF(Hx + r * w + where[g]);
        for (int l = 0; l < m; l++) F[r * e + nu + l] = FK_OF(Axx + r * m + l);
      }
      for (int r = 0; r < m; r++)
        for (int c = 0; c <= r; c++) {
          FK_V a = (FK_READ(means + ((size_t)s * m + r) * to, b) - x[r]) * (FK_READ(means + ((size_t)s * m + c) * to, b) - x[c]);
          for (int t = 0; t < m + q; t++) a += FK_OF(N + r * (m + q) + t) * FK_OF(N + c * (m + q) + t);
          for (int t = 0; t < e; t++)
            for (int h = 0; h < e; h++) a += F[r * e + t] * F[c * e + h] * FK_NAME(fk_node)(is_sparse, node + (size_t)(1 + e + t * e + h) * ld, FK_FROM);
          V[r * m + c] += FK_READ(weights + (size_t)s * to, b) * a;
        }
    }
  for (int r = 0; r < m; r++)
    for (int c = 0; c <= r; c++) P[r * m + c] = P[c * m + r] = FK_NAME(fk_sum)(V[r * m + c]);
#undef FK_OF
#undef FK_FROM
}

FK_TARGET static void FK_NAME(fk_gap_prior)(const fk_gaps *k, const double *rows, int n, const double *log_p,
                                            const double *window, double *x, double *P, double *scratch) {
  int nu = 0;
  for (int t = 0; t < k->w; t++) nu += window[t] != window[t];
#define FK_PRIOR(is_sparse, m, q, w, nu) FK_NAME(fk_prior_gap_sized)(k, is_sparse, m, q, w, nu, rows, n, log_p, window, x, P, scratch)
  if (FK_OWN_SIZE(k->m == 1 && k->q == 1 && k->w == 1 && !k->is_sparse)) FK_PRIOR(0, 1, 1, 1, 1);
  else FK_PRIOR(k->is_sparse, k->m, k->q, k->w, nu);
#undef FK_PRIOR
}

/* Move a branch through a pair of nodes and condition it on what is there of y.  `entry` gets the log-weight but
 * for the determinant and constants, the inverse of the root of the determinant, the mean of (u', X') and the root,
 * or, where u' is empty, the covariance of X'.  A holds (q + w + m) (w + q + 2 m) vectors, mean q + w + m. */
FK_INLINE_HERE void FK_NAME(fk_move)(const fk_gaps *k, const int is_sparse, const int m, const int q, const int w,
                                     const int nu, const int seen, const int kept, const fk_holes *h,
                                     const double *rows, int bb, int s, int b, const double *window,
                                     const double *y, FK_V *entry, FK_V *A, FK_V *mean) {
  const int ld = fk_padded(k->M1), to = fk_padded(k->M2), e = nu + m, n = m + q;
  const int open = q - seen + kept, cols = nu + q + 2 * m, first_X = seen + open, tall = first_X + m;
  const double *cell = k->cells + (size_t)s * k->size * to;
  const int *from = k->source + (size_t)s * to + b * FK_WIDTH;
  const int Ayy = 2, Ny = Ayy + q * w, Hx = Ny + q, cx = Hx + m * w, Axx = cx + m, N = Axx + m * m;
#define FK_OF(r) FK_READ(cell + (size_t)(r) * to, b)
  FK_V held[1 + FK_GAPS_LARGEST + FK_GAPS_LARGEST * FK_GAPS_LARGEST], *at = held; /* of the branch: mean, root */
  {
    const double *row = FK_BRANCH(rows, e, bb, 0, ld);
    for (int r = 0; r < 1 + e + e * e; r++, row += ld) held[r] = FK_NAME(fk_node)(is_sparse, row, from);
  }
  const FK_V *mu = at + 1, *T = at + 1 + e, zero = FK_NAME(fk_all)(0.0);
  /* Y', what is there of it first */
  for (int r = 0; r < q; r++) {
    const int of = r < seen ? h->there[r] : h->gone[r - seen];
    FK_V *row = A + r * cols, a = FK_OF(Ny + of);
    for (int t = 0, g = 0; t < w; t++) a += FK_OF(Ayy + of * w + t) * (g < nu && h->u[g] == t ? mu[g++] : FK_NAME(fk_all)(window[t]));
    mean[r] = a;
    for (int c = 0; c < nu; c++) {
      FK_V sum = zero;
      for (int g = c; g < nu; g++) sum += FK_OF(Ayy + of * w + h->u[g]) * T[g * e + c];
      row[c] = sum;
    }
    for (int c = 0; c < q; c++) row[nu + c] = c <= of ? FK_OF(N + (m + of) * n + m + c) : zero;
  }
  for (int r = 0; r < kept; r++) {
    FK_V *row = A + (q + r) * cols;
    mean[q + r] = mu[r];
    for (int c = 0; c < nu + q; c++) row[c] = c <= r ? T[r * e + c] : zero;
  }
  for (int r = 0; r < m; r++) {
    FK_V *row = A + (first_X + r) * cols, a = FK_OF(cx + r);
    for (int t = 0, g = 0; t < w; t++) a += FK_OF(Hx + r * w + t) * (g < nu && h->u[g] == t ? mu[g++] : FK_NAME(fk_all)(window[t]));
    FK_UNROLL for (int l = 0; l < m; l++) a += FK_OF(Axx + r * m + l) * mu[nu + l];
    mean[first_X + r] = a;
    for (int c = 0; c < nu; c++) {
      FK_V sum = zero;
      for (int g = c; g < nu; g++) sum += FK_OF(Hx + r * w + h->u[g]) * T[g * e + c];
      FK_UNROLL for (int l = 0; l < m; l++) sum += FK_OF(Axx + r * m + l) * T[(nu + l) * e + c];
      row[c] = sum;
    }
    for (int c = 0; c < q; c++) row[nu + c] = FK_OF(N + r * n + m + c);
    for (int c = 0; c < m; c++) {
      FK_V sum = zero;
      FK_UNROLL for (int l = c; l < m; l++) sum += FK_OF(Axx + r * m + l) * T[(nu + l) * e + nu + c];
      row[nu + q + c] = sum;
      row[nu + q + m + c] = FK_OF(N + r * n + c);
    }
  }
  /* rows of Y' and of the window have no part in the last 2 m columns */
  FK_V inverses[2 * FK_GAPS_LARGEST];
  FK_UNROLL for (int p = 0; p < first_X; p++) {
    FK_UNROLL for (int c = p + 1; c < nu + q; c++)
      inverses[p] = FK_NAME(fk_turn)(A + p * cols + p, cols, A + p * cols + c, cols, tall - p);
    if (p + 1 >= nu + q) { /* no column to rotate with: the diagonal may be negative */
      const FK_V negative = -A[p * cols + p];
      for (int r = p; r < tall; r++) A[r * cols + p] = FK_NAME(fk_if_positive)(negative, -A[r * cols + p], A[r * cols + p]);
      if (p < seen) inverses[p] = 1.0 / A[p * cols + p];
    }
  }
  FK_V l = FK_OF(1) + held[0], inverse = FK_NAME(fk_all)(1.0);
  for (int p = 0; p < seen; p++) {
    const FK_V scale = inverses[p], white = (FK_NAME(fk_all)(y[h->there[p]]) - mean[p]) * scale;
    inverse *= scale;
    l -= 0.5 * white * white;
    for (int r = p + 1; r < tall; r++) mean[r] += A[r * cols + p] * white;
  }
  entry[0] = l, entry[1] = inverse;
  if (!open) {
    for (int r = 0; r < m; r++) entry[2 + r] = mean[first_X + r];
    for (int r = 0; r < m; r++)
      for (int c = 0; c <= r; c++) {
        FK_V sum = zero;
        for (int t = seen; t < cols; t++) sum += A[(first_X + r) * cols + t] * A[(first_X + c) * cols + t];
        entry[2 + m + r * m + c] = entry[2 + m + c * m + r] = sum;
      }
    return;
  }
  FK_UNROLL for (int p = first_X; p < tall - 1; p++)
    FK_UNROLL for (int c = p + 1; c < cols; c++) FK_NAME(fk_turn)(A + p * cols + p, cols, A + p * cols + c, cols, tall - p);
  FK_V squares = zero; /* in the last row nothing is below */
  FK_UNROLL for (int c = tall - 1; c < cols; c++) squares += A[(tall - 1) * cols + c] * A[(tall - 1) * cols + c];
  A[(tall - 1) * cols + tall - 1] = FK_NAME(fk_sqrt)(squares);
  const int size = open + m;
  for (int r = 0; r < size; r++) {
    entry[2 + r] = mean[seen + r];
    for (int c = 0; c < size; c++) entry[2 + size + r * size + c] = c <= r ? A[(seen + r) * cols + seen + c] : zero;
  }
#undef FK_OF
}

/* The same for systems of any size, once: each call of its own would be as long. */
FK_TARGET __attribute__((noinline)) static void FK_NAME(fk_move_any)(const fk_gaps *k, const fk_holes *h, const double *rows,
                                                                     int bb, int s, int b, const double *window,
                                                                     const double *y, FK_V *entry, FK_V *A, FK_V *mean) {
  FK_NAME(fk_move)(k, k->is_sparse, k->m, k->q, k->w, h->nu, h->seen, h->kept, h, rows, bb, s, b, window, y, entry, A, mean);
}

/* Mean and covariance of X of n components, whose weights are the second numbers of entries of `size` vectors, from
 * the likeliest on.  X is at `x` among the numbers of the mean, e in all; with roots or, if e is m, covariances. */
FK_INLINE_HERE void FK_NAME(fk_mix)(const int m, const int e, const int has_roots, int n, const FK_V *entry, FK_V column,
                                    FK_V *x, FK_V *P) {
  const int size = 2 + e + e * e, at = e - m;
  FK_V most = entry[1];
  for (int r = 0; r < m; r++) x[r] = entry[2 + at + r], P[r] = FK_NAME(fk_all)(0.0);
  for (int i = 1; i < n; i++) {
    const FK_V *one = entry + (size_t)i * size;
    FK_UNROLL for (int r = 0; r < m; r++) x[r] = FK_NAME(fk_if_positive)(one[1] - most, one[2 + at + r], x[r]);
    most = FK_NAME(fk_max)(most, one[1]);
  }
  const FK_V inverse = 1.0 / column;
  for (int i = 0; i < n; i++) {
    const FK_V *one = entry + (size_t)i * size;
    FK_UNROLL for (int r = 0; r < m; r++) P[r] += one[1] * (one[2 + at + r] - x[r]); /* sums, so far */
  }
  FK_UNROLL for (int r = 0; r < m; r++) x[r] += P[r] * inverse;
  for (int r = 0; r < m * m; r++) P[r] = FK_NAME(fk_all)(0.0);
  for (int i = 0; i < n; i++) {
    const FK_V *one = entry + (size_t)i * size, o = one[1] * inverse, *S = one + 2 + e;
    for (int r = 0; r < m; r++)
      for (int c = 0; c <= r; c++) {
        FK_V a = (one[2 + at + r] - x[r]) * (one[2 + at + c] - x[c]);
        if (has_roots)
          for (int t = 0; t <= at + c; t++) a += S[(at + r) * e + t] * S[(at + c) * e + t];
        else a += S[r * m + c];
        P[r * m + c] += o * a;
      }
  }
  for (int r = 0; r < m; r++)
    for (int c = 0; c < r; c++) P[c * m + r] = P[r * m + c];
}

FK_INLINE_HERE FK_V FK_NAME(fk_logs)(FK_V a) {
  FK_V out;
  for (int t = 0; t < FK_WIDTH; t++) out[t] = log(a[t]);
  return out;
}

/* See fk_gap_step.  `is_own`: whether this is code of its own for the size. */
FK_INLINE_HERE int FK_NAME(fk_gap_sized)(const fk_gaps *k, const int is_own, const int is_sparse, const int m, const int q, const int w,
                                         const int nu, const int seen, const int kept, const fk_holes *h,
                                         const double *rows, int n, const double *window, const double *y, double *table,
                                         double *branches, double *log_likelihood, double *scratch) {
#define FK_MOVE(bb, entry)                                                                                            \
  if (is_own) FK_NAME(fk_move)(k, is_sparse, m, q, w, nu, seen, kept, h, rows, bb, s, b, window, y, entry, A, mean);  \
  else FK_NAME(fk_move_any)(k, h, rows, bb, s, b, window, y, entry, A, mean)
  const int open = q - seen + kept, e = open + m, size = 2 + e + e * e, to = fk_padded(k->M2), depth = k->depth;
  FK_V *entry = (FK_V *)scratch, *slot = entry + (size_t)(n > 1 || !open ? n * (open ? 1 : depth) : 0) * size;
  FK_V *A = slot + (size_t)(open ? depth : 0) * size, *mean = A + (q + w + m) * (w + q + 2 * m), *work = mean + q + w + m;
  const FK_V dead = FK_NAME(fk_all)(FK_LOG_ZERO), zero = FK_NAME(fk_all)(0.0), lowest = FK_NAME(fk_all)(-DBL_MAX);
  const double constant = 0.91893853320467274178 * seen;
  double peak = -INFINITY, total = 0.0;
  for (int b = 0; b < FK_AS_VECTORS(k->M2); b++) {
    FK_V top = lowest, column = zero, x[FK_GAPS_LARGEST], P[FK_GAPS_LARGEST * FK_GAPS_LARGEST];
    const FK_V *from = slot;
    int pairs = depth;
    if (!open) { /* all pairs of branches and nodes at once */
      from = entry, pairs = n * depth;
      for (int bb = 0; bb < n; bb++)
        for (int s = 0; s < depth; s++) {
          FK_V *one = entry + (size_t)(bb * depth + s) * size;
          FK_MOVE(bb, one);
          top = FK_NAME(fk_max)(top, one[0]);
        }
      for (int i = 0; i < pairs; i++) {
        FK_V *one = entry + (size_t)i * size;
        one[1] *= FK_NAME(fk_exp)(one[0] - top);
        column += one[1];
      }
    } else {
      for (int s = 0; s < depth; s++) {
        FK_V *one = slot + (size_t)s * size;
        if (n == 1) {
          FK_MOVE(0, one);
          if (seen) one[0] += FK_NAME(fk_logs)(one[1]);
        } else { /* one way leads to a slot */
          FK_V best = lowest, sum = zero;
          for (int bb = 0; bb < n; bb++) {
            FK_V *of = entry + (size_t)bb * size;
            FK_MOVE(bb, of);
            best = FK_NAME(fk_max)(best, of[0]);
          }
          for (int bb = 0; bb < n; bb++) {
            FK_V *of = entry + (size_t)bb * size;
            of[1] *= FK_NAME(fk_exp)(of[0] - best);
            sum += of[1];
          }
          FK_NAME(fk_merge)(e, n, entry, one + 2, work);
          one[0] = FK_NAME(fk_logs)(sum) + best;
        }
        one[0] = FK_NAME(fk_max)(one[0], dead);
        top = FK_NAME(fk_max)(top, one[0]);
      }
      for (int s = 0; s < depth; s++) {
        FK_V *one = slot + (size_t)s * size;
        one[1] = FK_NAME(fk_exp)(one[0] - top);
        column += one[1];
      }
    }
    for (int t = 0, j = b * FK_WIDTH; t < FK_WIDTH && j < k->M2; t++, j++)
      if (top[t] > FK_DEAD && (top[t] - constant < FK_NEAR || !(column[t] > FK_TINY && column[t] < FK_HUGE))) return 0;
    FK_NAME(fk_mix)(m, e, open > 0, pairs, from, column, x, P);
    const FK_V alive = top - FK_DEAD;
    for (int r = 0; r < m; r++) FK_AT(table + (size_t)(1 + r) * to, b) = FK_NAME(fk_if_positive)(alive, x[r], zero);
    for (int r = 0; r < m * m; r++) FK_AT(table + (size_t)(1 + m + r) * to, b) = FK_NAME(fk_if_positive)(alive, P[r], zero);
    FK_AT(table, b) = FK_NAME(fk_if_positive)(alive, FK_NAME(fk_logs)(column) + top, dead);
    for (int s = 0; open && s < depth; s++) {
      const FK_V *one = slot + (size_t)s * size;
      const FK_V is_there = one[0] - FK_DEAD;
      FK_AT(FK_BRANCH(branches, e, s, 0, to), b) = one[0];
      for (int r = 0; r < e + e * e; r++) FK_AT(FK_BRANCH(branches, e, s, 1 + r, to), b) = FK_NAME(fk_if_positive)(is_there, one[2 + r], zero);
    }
  }
  for (int j = 0; j < k->M2; j++) peak = table[j] > peak ? table[j] : peak;
  for (int j = 0; j < k->M2; j++) total += exp(table[j] - peak);
  const double log_total = peak + log(total);
  if (!(log_total - constant > FK_FARTHEST)) return 0;
  for (int j = 0; j < to; j++) table[j] = j >= k->M2 ? 0.0 : table[j] > FK_DEAD ? table[j] - log_total : FK_LOG_ZERO;
  for (int s = 0; open && s < depth; s++) {
    double *row = FK_BRANCH(branches, e, s, 0, to);
    for (int j = 0; j < to; j++) row[j] = row[j] > FK_DEAD && j < k->M2 ? row[j] - log_total : FK_LOG_ZERO;
  }
  for (int r = 1; r < 1 + m + m * m; r++)
    for (int j = k->M2; j < to; j++) table[(size_t)r * to + j] = 0.0;
  *log_likelihood = seen ? log_total - constant : 0.0;
  return 1;
#undef FK_MOVE
}

/* Move a state of n branches to the next observation.
 *
 * rows, n: the state, log_p (M1) the log-probabilities of its nodes; window (w) and y (q) are NaN where missing; w_to is the size of the next window.
 * The table of X alone goes to `table`, the branches, `depth` of them where something is unknown, to `branches`, and
 * their number, or 0, to `n_to`.  Returns 0, and nothing of use, after an outlier, whose digits are for NumPy. */
FK_TARGET static int FK_NAME(fk_gap_step)(const fk_gaps *k, const double *rows, int n, const double *log_p,
                                          const double *window, const double *y, int w_to, double *table, double *branches, int *n_to, double *log_likelihood,
                                          double *scratch) {
  int places[3 * FK_GAPS_LARGEST];
  const fk_holes found = fk_find_holes(k, window, y, w_to, places), *h = &found;
  const int e = h->nu + k->m;
  *n_to = k->q - h->seen + h->kept ? k->depth : 0;
  if (n > 1 && !fk_tells(k, h)) { /* then nothing is lost by moments of the nodes */
    double *merged = scratch;
    scratch += fk_gap_state(k->M1, 1, e);
    memcpy(merged, log_p, fk_padded(k->M1) * sizeof(double));
    FK_NAME(fk_merge_nodes)(k->M1, n, e, rows, merged, scratch);
    rows = merged, n = 1;
  }
#define FK_ANY(is_own, is_sparse, m, q, w, nu, seen, kept)                                                             \
  FK_NAME(fk_gap_sized)(k, is_own, is_sparse, m, q, w, nu, seen, kept, h, rows, n, window, y, table, branches, log_likelihood, scratch)
#define FK_SCALAR(is_sparse, nu, seen) FK_ANY(1, is_sparse, 1, 1, 1, nu, seen, 0)
#define FK_IN_PAIRS(nu, seen)                                                                                         \
  return k->is_sparse ? FK_SCALAR(1, nu, seen) : FK_SCALAR(0, nu, seen)
  switch (FK_OWN_SIZE(k->m == 1 && k->q == 1 && k->w == 1 && !h->kept ? 1 + 10 * h->nu + h->seen : 0)) {
  case 1: FK_IN_PAIRS(0, 0);
  case 11: FK_IN_PAIRS(1, 0);
  case 12: FK_IN_PAIRS(1, 1);
  default: return FK_ANY(0, k->is_sparse, k->m, k->q, k->w, h->nu, h->seen, h->kept);
  }
#undef FK_IN_PAIRS
#undef FK_SCALAR
#undef FK_ANY
}
#undef FK_BRANCH
