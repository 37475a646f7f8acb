/* Eight numbers side by side, in one AVX-512 register or as many smaller ones as it takes.
 *
 * GCC and Clang compile these vectors for any processor.  Nothing here may be compiled
 * with reassociating options (-ffast-math): the reduction of the exponential relies on
 * the order of operations.
 */
#ifndef FUZZYKF_LANES_H
#define FUZZYKF_LANES_H

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if !defined(__GNUC__)
#error "the compiled core of fuzzykf needs GCC or Clang"
#endif

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wpsabi" /* vectors are passed between inlined functions only */
#endif

#define FK_LANES 8
#define FK_INLINE static inline __attribute__((always_inline, unused))

typedef double fk_v8 __attribute__((vector_size(64), aligned(64), may_alias));
typedef int64_t fk_i8 __attribute__((vector_size(64), aligned(64), may_alias));

FK_INLINE fk_v8 fk_all(double a) { return (fk_v8){a, a, a, a, a, a, a, a}; }

FK_INLINE double fk_sum(fk_v8 a) { return ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7])); }

FK_INLINE fk_v8 fk_select(fk_i8 mask, fk_v8 a, fk_v8 b) { return (fk_v8)(((fk_i8)a & mask) | ((fk_i8)b & ~mask)); }

/* The polynomial of exp on [-log(2)/2, log(2)/2]: its Taylor sum up to the 12th power is
 * wrong by less than 1.7e-16. */
#define FK_EXP_POLYNOMIAL(r)                                                                              \
  fk_v8 s = fk_all(1.0 / 479001600.0);                                                                    \
  s = s * (r) + 1.0 / 39916800.0;                                                                         \
  s = s * (r) + 1.0 / 3628800.0;                                                                          \
  s = s * (r) + 1.0 / 362880.0;                                                                           \
  s = s * (r) + 1.0 / 40320.0;                                                                            \
  s = s * (r) + 1.0 / 5040.0;                                                                             \
  s = s * (r) + 1.0 / 720.0;                                                                              \
  s = s * (r) + 1.0 / 120.0;                                                                              \
  s = s * (r) + 1.0 / 24.0;                                                                               \
  s = s * (r) + 1.0 / 6.0;                                                                                \
  s = s * (r) + 0.5;                                                                                      \
  s = s * (r) + 1.0;                                                                                      \
  s = s * (r) + 1.0

#define FK_LOG2E 1.4426950408889634074
#define FK_LN2_HIGH 6.93147180369123816490e-01 /* 32 bits, so that its multiples are exact */
#define FK_LN2_LOW 1.90821492927058770002e-10
#define FK_ROUNDER 6755399441055744.0 /* 1.5 * 2^52: adding it rounds to whole numbers */

FK_INLINE fk_v8 fk_max_portable(fk_v8 a, fk_v8 b) { return fk_select(a > b, a, b); }

/* exp, zero below -708 and exp(709) above 709 */
FK_INLINE fk_v8 fk_exp_portable(fk_v8 x) {
  fk_v8 y = fk_select(x > -708.0, x, fk_all(-708.0));
  y = fk_select(y < 709.0, y, fk_all(709.0));
  fk_v8 shifted = y * FK_LOG2E + FK_ROUNDER;
  fk_v8 n = shifted - FK_ROUNDER;
  fk_v8 r = y - n * FK_LN2_HIGH;
  r = r - n * FK_LN2_LOW;
  FK_EXP_POLYNOMIAL(r);
  fk_i8 exponent = (fk_i8)shifted << 52; /* the low bits of `shifted` are those of n */
  return (fk_v8)(((fk_i8)s + exponent) & (x >= -708.0));
}

#if defined(__x86_64__)
#define FK_X86 1
#include <immintrin.h>

#define FK_TARGET_V4 __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma")))
#define FK_TARGET_V3 __attribute__((target("avx2,fma")))

FK_TARGET_V4 static inline fk_v8 fk_max_v4(fk_v8 a, fk_v8 b) {
  return (fk_v8)_mm512_max_pd((__m512d)a, (__m512d)b);
}

FK_TARGET_V4 static inline fk_v8 fk_exp_v4(fk_v8 x) {
  fk_v8 y = (fk_v8)_mm512_max_pd((__m512d)x, _mm512_set1_pd(-750.0));
  fk_v8 n = (fk_v8)_mm512_roundscale_pd((__m512d)(y * FK_LOG2E), _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
  fk_v8 r = y - n * FK_LN2_HIGH;
  r = r - n * FK_LN2_LOW;
  FK_EXP_POLYNOMIAL(r);
  return (fk_v8)_mm512_scalef_pd((__m512d)s, (__m512d)n);
}
#endif

#endif
