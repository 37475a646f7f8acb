/* The arithmetic of gaps for every kind of processor, in the order of processor.h. */
#ifndef FUZZYKF_GAPS_ENGINES_H
#define FUZZYKF_GAPS_ENGINES_H

#include "gaps.h"

#define FK_NAME(name) name##_portable
#define FK_TARGET
#define FK_IS_SIZED 1
#define FK_WIDTH 2
#include "gaps_bodies.h"

#ifdef FK_X86
#define FK_NAME(name) name##_v3
#define FK_TARGET __attribute__((target("avx2,fma")))
#define FK_IS_SIZED 1
#define FK_WIDTH 4
#include "gaps_bodies.h"

#define FK_NAME(name) name##_v4
#define FK_TARGET __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma")))
#define FK_IS_SIZED 1
#define FK_WIDTH 8
#include "gaps_bodies.h"
#endif

#define FK_VERSION(suffix) {fk_gap_step_##suffix, fk_merge_nodes_##suffix, fk_gap_prior_##suffix}

static const fk_gaps_engine fk_gaps_engines[] = {
    FK_VERSION(portable),
#ifdef FK_X86
    FK_VERSION(v3),
    FK_VERSION(v4),
#endif
};
#undef FK_VERSION

#endif
