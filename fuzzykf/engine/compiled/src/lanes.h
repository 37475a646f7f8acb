/* What the vectors of all kinds of processors share; the vectors are in lanes_body.h.
 *
 * GCC and Clang compile vectors for any processor.  Nothing here may be compiled with
 * reassociating options (-ffast-math): the reduction of the exponential relies on the order
 * of operations.
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

#include "processor.h"

#ifdef FK_X86
#include <immintrin.h>
#endif

/* Tables are laid out in rows of 8 columns, whatever the processor: one AVX-512 register. */
#define FK_LANES 8
#define FK_STATIC static __attribute__((unused))
#define FK_INLINE static inline __attribute__((always_inline, unused))
#define FK_INLINE_HERE FK_TARGET static inline __attribute__((always_inline, unused))

/* Loops over the components of small systems, so that their sums stay in registers. */
#define FK_UNROLL _Pragma("GCC unroll 4")

#define FK_LOG2E 1.4426950408889634074
#define FK_LN2_HIGH 6.93147180369123816490e-01 /* 32 bits, so that its multiples are exact */
#define FK_LN2_LOW 1.90821492927058770002e-10
#define FK_ROUNDER 6755399441055744.0 /* 1.5 * 2^52: adding it rounds to whole numbers */

#endif
