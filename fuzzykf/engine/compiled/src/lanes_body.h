/* FK_WIDTH numbers side by side; included once per kind of processor (FK_NAME, FK_TARGET). */

typedef double FK_NAME(fk_vector) __attribute__((vector_size(8 * FK_WIDTH), aligned(8 * FK_WIDTH), may_alias));
typedef int64_t FK_NAME(fk_bits) __attribute__((vector_size(8 * FK_WIDTH), aligned(8 * FK_WIDTH), may_alias));
#define FK_V FK_NAME(fk_vector)
#define FK_B FK_NAME(fk_bits)

FK_INLINE_HERE FK_V FK_NAME(fk_all)(double a) { return a - (FK_V){0}; }

FK_INLINE_HERE double FK_NAME(fk_sum)(FK_V a) {
#if FK_WIDTH == 8
  return ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]));
#elif FK_WIDTH == 4
  return (a[0] + a[2]) + (a[1] + a[3]);
#else
  return a[0] + a[1];
#endif
}

FK_INLINE_HERE FK_V FK_NAME(fk_select)(FK_B mask, FK_V a, FK_V b) {
  return (FK_V)(((FK_B)a & mask) | ((FK_B)b & ~mask));
}

FK_INLINE_HERE FK_V FK_NAME(fk_max)(FK_V a, FK_V b) {
#if FK_WIDTH == 8
  return (FK_V)_mm512_max_pd((__m512d)a, (__m512d)b);
#elif FK_WIDTH == 4
  return (FK_V)_mm256_max_pd((__m256d)a, (__m256d)b);
#else
  return FK_NAME(fk_select)((FK_B)(a > b), a, b);
#endif
}

/* exp; zero where it would be less than the smallest normal number, and finite or infinite,
 * above 1e307, where it would be more than the largest one */
#if FK_WIDTH == 8
/* exp(x) = 2^(n / 16) exp(r): sixteenth roots from a table in two registers, and the Taylor sum up to
 * the 7th power, which is wrong by less than 1e-17 for |r| < log(2) / 32 */
FK_INLINE_HERE FK_V FK_NAME(fk_exp)(FK_V x) {
  const FK_V y = (FK_V)_mm512_max_pd((__m512d)x, _mm512_set1_pd(-750.0));
  const FK_V shifted = y * (16.0 * FK_LOG2E) + FK_ROUNDER; /* its low bits are those of n */
  const FK_V n = shifted - FK_ROUNDER;
  FK_V r = y - n * (FK_LN2_HIGH / 16.0);
  r = r - n * (FK_LN2_LOW / 16.0);
  const FK_V root = (FK_V)_mm512_permutex2var_pd(_mm512_load_pd(fk_roots), (__m512i)shifted,
                                                 _mm512_load_pd(fk_roots + 8));
  FK_V s = r * (1.0 / 5040.0) + 1.0 / 720.0;
  s = s * r + 1.0 / 120.0;
  s = s * r + 1.0 / 24.0;
  s = s * r + 1.0 / 6.0;
  s = s * r + 0.5;
  s = s * r * r + r;
  return (FK_V)_mm512_scalef_pd((__m512d)(root * s + root), (__m512d)(n * 0.0625));
}
#else
FK_INLINE_HERE FK_V FK_NAME(fk_exp)(FK_V x) {
  FK_V y = FK_NAME(fk_max)(x, FK_NAME(fk_all)(-708.0));
  y = -FK_NAME(fk_max)(-y, FK_NAME(fk_all)(-709.0));
  const FK_V shifted = y * FK_LOG2E + FK_ROUNDER; /* its low bits are those of n */
  const FK_V n = shifted - FK_ROUNDER;
  FK_V r = y - n * FK_LN2_HIGH;
  r = r - n * FK_LN2_LOW;
  /* the Taylor sum up to the 12th power is wrong by less than 1.7e-16 for |r| < log(2) / 2 */
  FK_V s = r * (1.0 / 479001600.0) + 1.0 / 39916800.0;
  s = s * r + 1.0 / 3628800.0;
  s = s * r + 1.0 / 362880.0;
  s = s * r + 1.0 / 40320.0;
  s = s * r + 1.0 / 5040.0;
  s = s * r + 1.0 / 720.0;
  s = s * r + 1.0 / 120.0;
  s = s * r + 1.0 / 24.0;
  s = s * r + 1.0 / 6.0;
  s = s * r + 0.5;
  s = s * r + 1.0;
  s = s * r + 1.0;
  return (FK_V)(((FK_B)s + ((FK_B)shifted << 52)) & (FK_B)(x >= -708.0));
}
#endif

#define FK_AS_VECTORS(M) (((M) + FK_WIDTH - 1) / FK_WIDTH)
/* Vector b of columns is a part of this block. */
#define FK_BLOCK_OF(b) ((b) / (FK_LANES / FK_WIDTH))
/* The cell of slot s and vector b of columns, and its entry r. */
#define FK_CELL(cells, stride, s, b)                                                                      \
  ((cells) + ((size_t)k->first[FK_BLOCK_OF(b)] + (s)) * (stride) * FK_LANES + (b) % (FK_LANES / FK_WIDTH) * FK_WIDTH)
/* How many slots vector b of columns has, and their sources, FK_LANES numbers a slot. */
#define FK_DEPTH(b) (k->first[FK_BLOCK_OF(b) + 1] - k->first[FK_BLOCK_OF(b)])
#define FK_SOURCES(b) (k->source + (size_t)k->first[FK_BLOCK_OF(b)] * FK_LANES + (b) % (FK_LANES / FK_WIDTH) * FK_WIDTH)
#define FK_ROW(cell, r) (*(const FK_V *)((cell) + (size_t)(r) * FK_LANES))
#define FK_AT(pointer, b) (*(FK_V *)((pointer) + (size_t)(b) * FK_WIDTH))
#define FK_READ(pointer, b) (*(const FK_V *)((pointer) + (size_t)(b) * FK_WIDTH))

/* What the nodes before hold, as the lanes of slot s see it: every node is slot s of all of them, unless
 * only those that lead to a column have slots in it. */
FK_INLINE_HERE FK_V FK_NAME(fk_held)(const int is_sparse, const double *row, const int *sources, int s) {
  if (!is_sparse) return FK_NAME(fk_all)(row[s]);
  const int *from = sources + (size_t)s * FK_LANES;
#if FK_WIDTH == 8
  return (FK_V){row[from[0]], row[from[1]], row[from[2]], row[from[3]],
                row[from[4]], row[from[5]], row[from[6]], row[from[7]]};
#elif FK_WIDTH == 4
  return (FK_V){row[from[0]], row[from[1]], row[from[2]], row[from[3]]};
#else
  return (FK_V){row[from[0]], row[from[1]]};
#endif
}

/* Whether a condition holds in all lanes. */
FK_INLINE_HERE int FK_NAME(fk_every)(FK_B mask) {
#if FK_WIDTH == 8
  return _mm512_movepi64_mask((__m512i)mask) == 0xff;
#elif FK_WIDTH == 4
  return _mm256_movemask_pd((__m256d)mask) == 0xf;
#else
  return mask[0] && mask[1];
#endif
}

/* The number of the first of the largest of M probabilities, padded with zeros. */
FK_INLINE_HERE int FK_NAME(fk_largest)(int M, const double *p) {
#if FK_WIDTH > 2
  FK_V most = FK_READ(p, 0);
  for (int b = 1; b < FK_AS_VECTORS(M); b++) most = FK_NAME(fk_max)(most, FK_READ(p, b));
#if FK_WIDTH == 8
  most = FK_NAME(fk_max)(most, (FK_V)_mm512_shuffle_f64x2((__m512d)most, (__m512d)most, 0x4e));
  most = FK_NAME(fk_max)(most, (FK_V)_mm512_shuffle_f64x2((__m512d)most, (__m512d)most, 0xb1));
  most = FK_NAME(fk_max)(most, (FK_V)_mm512_permute_pd((__m512d)most, 0x55));
#else
  most = FK_NAME(fk_max)(most, (FK_V)_mm256_permute2f128_pd((__m256d)most, (__m256d)most, 1));
  most = FK_NAME(fk_max)(most, (FK_V)_mm256_permute_pd((__m256d)most, 5));
#endif
  for (int b = 0; b < FK_AS_VECTORS(M); b++) {
    const FK_B is_top = (FK_B)(FK_READ(p, b) == most);
#if FK_WIDTH == 8
    const unsigned at = _mm512_movepi64_mask((__m512i)is_top);
#else
    const unsigned at = (unsigned)_mm256_movemask_pd((__m256d)is_top);
#endif
    if (at) return b * FK_WIDTH + __builtin_ctz(at);
  }
  return 0; /* of what are no numbers */
#else
  int top = 0;
  for (int i = 1; i < M; i++) top = p[i] > p[top] ? i : top;
  return top;
#endif
}
