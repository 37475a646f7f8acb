/* The arithmetic on nodes for every kind of processor, in the order of processor.h. */
#ifndef FUZZYKF_NODES_ENGINES_H
#define FUZZYKF_NODES_ENGINES_H

#include "nodes_back.h"

#define FK_NAME(name) name##_portable
#define FK_TARGET
#define FK_IS_SIZED FK_PORTABLE_IS_SIZED
#define FK_WIDTH 2
#include "nodes_bodies.h"

#ifdef FK_X86
#define FK_NAME(name) name##_v3
#define FK_TARGET __attribute__((target("avx2,fma")))
#define FK_IS_SIZED 1
#define FK_WIDTH 4
#include "nodes_bodies.h"

#define FK_NAME(name) name##_v4
#define FK_TARGET __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma")))
#define FK_IS_SIZED 1
#define FK_WIDTH 8
#include "nodes_bodies.h"
#endif

#define FK_VERSION(suffix) \
  {fk_nodes_move_##suffix, fk_nodes_see_##suffix, fk_nodes_see_pairs_##suffix, fk_nodes_weigh_##suffix, \
   fk_nodes_back_##suffix}

static const fk_nodes_engine fk_nodes_engines[] = {
    FK_VERSION(portable),
#ifdef FK_X86
    FK_VERSION(v3),
    FK_VERSION(v4),
#endif
};
#undef FK_VERSION

#endif
