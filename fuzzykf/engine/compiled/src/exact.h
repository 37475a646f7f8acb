/* What the kernels for grids share.
 *
 * They round as the NumPy kernels do, operation by operation: whether two second differences agree, or
 * whether a cell is flat, is then decided alike.  Products and sums must not be fused for that. */
#ifndef FUZZYKF_EXACT_H
#define FUZZYKF_EXACT_H

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if defined(__clang__) || !defined(__GNUC__)
#define FK_EXACT_BEGIN _Pragma("STDC FP_CONTRACT OFF")
#define FK_EXACT_END
#else
#define FK_EXACT_BEGIN _Pragma("GCC push_options") _Pragma("GCC optimize(\"fp-contract=off\")")
#define FK_EXACT_END _Pragma("GCC pop_options")
#endif

#define FK_STATIC static __attribute__((unused))
#define FK_INLINE static inline __attribute__((always_inline, unused))

/* Most axes of a lattice. */
#define FK_AXES 16

typedef ptrdiff_t fk_index;

enum { FK_LOG, FK_RECIPROCAL, FK_COMPLEMENT };
enum { FK_ADD, FK_MULTIPLY, FK_MAXIMUM };

FK_EXACT_BEGIN

FK_INLINE double fk_least(double a, double b) { return b < a ? b : a; }

FK_INLINE double fk_most(double a, double b) { return b > a ? b : a; }

FK_INLINE double fk_combine(int how, double a, double b) {
  return how == FK_ADD ? a + b : how == FK_MULTIPLY ? a * b : fk_most(a, b);
}

FK_INLINE double fk_to_membership(double cost, int scale) {
  if (scale == FK_LOG) return exp(-cost);
  if (scale == FK_RECIPROCAL) return 1.0 / (1.0 + cost);
  return fk_most(0.0, 1.0 - cost);
}

FK_INLINE double fk_from_membership(double membership, int scale) {
  if (scale == FK_COMPLEMENT) return 1.0 - membership;
  return scale == FK_LOG ? -log(membership) : 1.0 / membership - 1.0;
}

FK_EXACT_END

#endif
