/* State-space models on the nodes of a switch: IMM and GPB2; see fuzzykf/engine/numpy/nodes.py. */
#ifndef FUZZYKF_NODES_H
#define FUZZYKF_NODES_H

#include "series.h"

#define FK_NODES_LARGEST 16 /* states, and observed components */
#define FK_NODES_SQUARE (FK_NODES_LARGEST * FK_NODES_LARGEST)
#define FK_NODES_LOG_2PI 1.83787706640934548356
/* A variance given other components that is a smaller part of what it is the rest of, for each state, is
 * rounding error. */
#define FK_NODES_CERTAIN (4.0 * DBL_EPSILON)
/* A pivot of S that is smaller than this fraction of its diagonal entry is rounding error. */
#define FK_NODES_PIVOT (16.0 * DBL_EPSILON)

/* One step to M nodes.  Rows are padded, the nodes j stand side by side in lanes: entry (r, c) of F, or of the
 * transition from node r, is a row.  The nodes that lead to any of a block of FK_LANES columns are listed
 * in `source` from first[block] on. */
typedef struct {
  int M, m, q;
  const int *first, *source;
  const double *mask, *entered; /* 1 in the lanes of nodes, and of those that some node leads to, 0 elsewhere */
  const double *transition, *log_transition;
  const double *log_into; /* the transposed of it: who leads to node r */
  const double *F, *b, *Q, *H, *d, *R;
} fk_nodes;

/* The arithmetic for one kind of processor.
 *
 * move: merge what leads to each node, and move it there; logarithms of predicted weights in row 0.
 * see: update a table with what is there of y; the log-densities given each node.  0 where S is singular.
 * see_pairs: move, update and merge every pair of nodes instead.
 * back: from what is known at the next time, when y is seen, given the observations up to it (`filtered`) and given
 * all (`after`) to the latter now; the score of the
 * most likely way on from each node, and its next node.
 * weigh: from the predicted weights to those given y; the log-likelihood, NaN where no node is possible. */
typedef struct {
  void (*move)(const fk_nodes *, const double *table, double *to, double *scratch);
  int (*see)(const fk_nodes *, const double *y, double *table, double *log_density);
  int (*see_pairs)(const fk_nodes *, const double *table, const double *y, double *to, double *log_density,
                   double *scratch);
  double (*weigh)(const fk_nodes *, double *log_p, const double *log_density);
  void (*back)(const fk_nodes *, int by_density, const double *table, const double *y, const double *filtered,
               const double *after, double *to, double *score, int *next, double *scratch);
} fk_nodes_engine;

/* Sizes in doubles: of what a step needs, and of the parameters of one. */
FK_INLINE size_t fk_nodes_scratch(int M, int m) {
  return 2 * (size_t)fk_padded(M) + (size_t)FK_LANES * M * (3 + m + m * m);
}
FK_INLINE size_t fk_nodes_back_scratch(int M, int m) {
  return fk_padded(M) * (size_t)(1 + m * m) + (size_t)FK_LANES * M + (size_t)fk_padded(M) * M * (2 + m + m * m);
}
FK_INLINE size_t fk_nodes_parameters(int M, int m, int q) {
  return (size_t)fk_padded(M) * (2 * m * m + m + q * m + q + q * q);
}

FK_INLINE int fk_nodes_seen(int q, const double *y, int *seen) {
  int n = 0;
  for (int a = 0; a < q; a++)
    if (!isnan(y[a])) seen[n++] = a;
  return n;
}

/* Put `rows` parameters of each of M nodes side by side. */
FK_STATIC void fk_nodes_spread(int M, int rows, const double *from, double *to) {
  const int ld = fk_padded(M);
  for (int r = 0; r < rows; r++)
    for (int j = 0; j < M; j++) to[(size_t)r * ld + j] = from[(size_t)j * rows + r];
}

/* Condition `to`, what is known of the time of an observation before it is seen, on it; 0 where S is singular. */
FK_STATIC int fk_nodes_observe(const fk_nodes_engine *e, const fk_nodes *k, const double *y, fk_state *to,
                               double *scratch) {
  int seen[FK_NODES_LARGEST];
  const int n = fk_nodes_seen(k->q, y, seen);
  if (n && !e->see(k, y, to->table, scratch)) return 0;
  for (int j = 0; !n && j < k->M; j++) /* as from `see` */
    for (int r = 1; to->table[j] <= FK_DEAD && r < 1 + k->m + k->m * k->m; r++)
      to->table[(size_t)r * fk_padded(k->M) + j] = 0.0;
  to->total = e->weigh(k, to->table, n ? scratch : NULL);
  if (!n) to->total = 0.0;
  to->linear = 0, to->log_known = 1;
  return 1;
}

/* Move a state to the next observation; 0 where S is singular. */
FK_STATIC int fk_nodes_advance(const fk_nodes_engine *e, const fk_nodes *k, int every_pair, const fk_state *from,
                               fk_state *to, const double *y, double *scratch) {
  int seen[FK_NODES_LARGEST];
  if (!every_pair || !fk_nodes_seen(k->q, y, seen)) { /* what is not seen does not tell pairs apart */
    e->move(k, from->table, to->table, scratch);
    return fk_nodes_observe(e, k, y, to, scratch);
  }
  double *log_density = scratch, *rest = scratch + fk_padded(k->M);
  if (!e->see_pairs(k, from->table, y, to->table, log_density, rest)) return 0;
  to->total = e->weigh(k, to->table, log_density);
  to->linear = 0, to->log_known = 1;
  return 1;
}

#endif
