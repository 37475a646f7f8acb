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

#if !defined(__GNUC__) && !defined(__clang__)
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

/* 2^(k / 16) */
static const double fk_roots[16] __attribute__((aligned(64), unused)) = {
    0x1.0000000000000p+0, 0x1.0b5586cf9890fp+0, 0x1.172b83c7d517bp+0, 0x1.2387a6e756238p+0,
    0x1.306fe0a31b715p+0, 0x1.3dea64c123422p+0, 0x1.4bfdad5362a27p+0, 0x1.5ab07dd485429p+0,
    0x1.6a09e667f3bcdp+0, 0x1.7a11473eb0187p+0, 0x1.8ace5422aa0dbp+0, 0x1.9c49182a3f090p+0,
    0x1.ae89f995ad3adp+0, 0x1.c199bdd85529cp+0, 0x1.d5818dcfba487p+0, 0x1.ea4afa2a490dap+0,
};

#endif
