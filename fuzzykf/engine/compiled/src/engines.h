/* The arithmetic of the switching recursion for every kind of processor, in the order of processor.h. */
#ifndef FUZZYKF_ENGINES_H
#define FUZZYKF_ENGINES_H

#include "switching.h"

/* One copy of the arithmetic for each kind of processor. */
#define FK_NAME(name) name##_portable
#define FK_TARGET
#define FK_IS_SIZED FK_PORTABLE_IS_SIZED
#define FK_WIDTH 2
#include "bodies.h"

#ifdef FK_X86
#define FK_NAME(name) name##_v3
#define FK_TARGET __attribute__((target("avx2,fma")))
#define FK_IS_SIZED 1
#define FK_WIDTH 4
#include "bodies.h"

#define FK_NAME(name) name##_v4
#define FK_TARGET __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma")))
#define FK_IS_SIZED 1
#define FK_WIDTH 8
#include "bodies.h"
#endif

#define FK_VERSION(suffix)                                                                                \
  {fk_step_##suffix,      fk_step_scalar_##suffix, fk_run_scalar_##suffix, fk_summarise_scalar_##suffix,    \
   fk_exp_row_##suffix,   fk_log_pairs_##suffix,   fk_smooth_back_##suffix, fk_best_path_##suffix,          \
   fk_prior_##suffix,     fk_posterior_##suffix,   fk_in_range_##suffix,   fk_forward_backward_##suffix}

static const fk_engine fk_engines[] = {
    FK_VERSION(portable),
#ifdef FK_X86
    FK_VERSION(v3),
    FK_VERSION(v4),
#endif
};

#endif
