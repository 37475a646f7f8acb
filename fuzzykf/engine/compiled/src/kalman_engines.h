/* The arithmetic of the Kalman filter for every kind of processor, in the order of processor.h. */
#ifndef FUZZYKF_KALMAN_ENGINES_H
#define FUZZYKF_KALMAN_ENGINES_H

#include "kalman.h"

#define FK_NAME(name) name##_portable
#define FK_TARGET
#define FK_IS_SIZED FK_PORTABLE_IS_SIZED
#include "kalman_body.h"

#ifdef FK_X86
#define FK_NAME(name) name##_v3
#define FK_TARGET __attribute__((target("avx2,fma")))
#define FK_IS_SIZED 1
#include "kalman_body.h"
#endif

#define FK_VERSION(suffix) {fk_kalman_predict_##suffix, fk_kalman_update_##suffix, fk_kalman_settled_##suffix}

static const fk_kalman_engine fk_kalman_engines[] = {
    FK_VERSION(portable),
#ifdef FK_X86
    FK_VERSION(v3),
    FK_VERSION(v3), /* eight numbers side by side gained nothing in small systems */
#endif
};
#undef FK_VERSION

#endif
