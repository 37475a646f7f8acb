/* The filter of many series for every kind of processor, in the order of processor.h. */
#ifndef FUZZYKF_KALMAN_LANES_ENGINES_H
#define FUZZYKF_KALMAN_LANES_ENGINES_H

#include "kalman_lanes.h"

#define FK_NAME(name) name##_portable
#define FK_TARGET
#define FK_IS_SIZED FK_PORTABLE_IS_SIZED
#define FK_WIDTH 2
#include "lanes_body.h"
#include "kalman_lanes_body.h"
#include "lanes_end.h"

#ifdef FK_X86
#define FK_NAME(name) name##_v3
#define FK_TARGET __attribute__((target("avx2,fma")))
#define FK_IS_SIZED 1
#define FK_WIDTH 4
#include "lanes_body.h"
#include "kalman_lanes_body.h"
#include "lanes_end.h"

#define FK_NAME(name) name##_v4
#define FK_TARGET __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma")))
#define FK_IS_SIZED 1
#define FK_WIDTH 8
#include "lanes_body.h"
#include "kalman_lanes_body.h"
#include "lanes_end.h"
#endif

#define FK_VERSION(suffix) {fk_kalman_shared_##suffix, fk_kalman_apart_##suffix}

static const fk_lanes_engine fk_lanes_engines[] = {
    FK_VERSION(portable),
#ifdef FK_X86
    FK_VERSION(v3),
    FK_VERSION(v4),
#endif
};
#undef FK_VERSION

#endif
