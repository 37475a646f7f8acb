/* Where the pairs of nodes stand: included by switching.h.
 *
 * The pairs that lead to a column j stand in its slots.  Slot i is the pair (i, j) of all columns, unless
 * few pairs are of positive probability: then those alone have slots, by i, as many in each column of a
 * block as the column with the most of them needs.  What is left over repeats the first pair of the column
 * with a probability of zero, so that means differ from one another no more than they do without it; in a
 * column to which nothing leads that is an empty cell, of node 0.  The lanes beyond M2, whose sums no one reads, are
 * those of the last column: they never come nearer to the ends of the range of numbers than it does.
 */
#ifndef FUZZYKF_SLOTS_H
#define FUZZYKF_SLOTS_H

/* Up to this share of all pairs slots of their own pay: each lane reads the state of its own node instead of
 * one number for all, and at half of the pairs a step still takes 0.6 to 0.9 of the time. */
#define FK_SPARSE 0.5

/* Where slot s of column j stands in cells of `stride` vectors. */
FK_INLINE size_t fk_slot(const fk_kernel *k, int s, int j, int stride) {
  return ((size_t)k->first[j / FK_LANES] + s) * stride * FK_LANES + j % FK_LANES;
}

/* The node of slot s of column j. */
FK_INLINE int fk_source(const fk_kernel *k, int s, int j) { return k->source[fk_slot(k, s, j, 1)]; }

/* Number of slots of column j, those that are left over included. */
FK_INLINE int fk_depth(const fk_kernel *k, int j) {
  return k->first[j / FK_LANES + 1] - k->first[j / FK_LANES];
}

/* Number of slots of all blocks, and of the deepest. */
FK_INLINE int fk_slots(const fk_kernel *k) { return k->first[k->blocks]; }
FK_INLINE int fk_deepest(const fk_kernel *k) {
  int depth = 0;
  for (int b = 0; b < k->blocks; b++) depth = k->first[b + 1] - k->first[b] > depth ? k->first[b + 1] - k->first[b] : depth;
  return depth;
}

/* The slot of a pair; -1 if it has none. */
FK_STATIC int fk_slot_of(const fk_kernel *k, int i, int j) {
  if (!k->is_sparse) return i;
  for (int s = 0; s < fk_depth(k, j); s++)
    if (fk_source(k, s, j) == i) return s;
  return -1;
}

/* Number of pairs of positive probability that lead to column j. */
FK_INLINE int fk_predecessors(int M1, int M2, const double *transition, int j) {
  int n = 0;
  for (int i = 0; i < M1; i++) n += transition[(size_t)i * M2 + j] != 0.0;
  return n;
}

/* Choose a layout: fill `first` (blocks + 1), and return whether pairs of probability zero are left out. */
FK_STATIC int fk_lay_out(int M1, int M2, int is_signed, const double *transition, int *first) {
  const int blocks = fk_padded(M2) / FK_LANES;
  first[0] = 0;
  for (int b = 0; b < blocks; b++) {
    int depth = 1;
    for (int j = b * FK_LANES; j < M2 && j < (b + 1) * FK_LANES; j++) {
      const int n = fk_predecessors(M1, M2, transition, j);
      depth = n > depth ? n : depth;
    }
    first[b + 1] = first[b] + depth;
  }
  if (!is_signed && first[blocks] <= FK_SPARSE * M1 * blocks) return 1;
  for (int b = 0; b < blocks; b++) first[b + 1] = first[b] + M1;
  return 0;
}

/* Fill the sources (slots, FK_LANES) of all lanes. */
FK_STATIC void fk_fill_sources(const fk_kernel *k, const double *transition, int *source) {
  for (int lane = 0; lane < k->blocks * FK_LANES; lane++) {
    const int j = lane < k->M2 ? lane : k->M2 - 1, depth = fk_depth(k, lane);
    int *to = source + fk_slot(k, 0, lane, 1), s = 0;
    for (int i = 0; i < k->M1; i++)
      if (!k->is_sparse || transition[(size_t)i * k->M2 + j] != 0.0) to[FK_LANES * s++] = i;
    for (int left = s; left < depth; left++) to[FK_LANES * left] = s ? to[0] : 0;
  }
}

/* Fill what is left over of the cells once those of the pairs are there: slots of real columns, and, if
 * only some pairs have slots, the lanes beyond. */
FK_STATIC void fk_fill_rest(fk_kernel *k, const double *transition) {
  for (int j = 0; k->is_sparse && j < k->blocks * FK_LANES; j++) {
    const int of = j < k->M2 ? j : k->M2 - 1, n = fk_predecessors(k->M1, k->M2, transition, of);
    for (int s = j < k->M2 ? n : 0; s < fk_depth(k, j); s++) {
      const double *from = k->cells + fk_slot(k, s < n ? s : 0, of, k->stride);
      double *to = k->cells + fk_slot(k, s, j, k->stride);
      for (int r = 0; r < k->stride; r++) to[(size_t)r * FK_LANES] = from[(size_t)r * FK_LANES];
      if (s >= n) to[0] = FK_LOG_ZERO, to[FK_LANES] = 0.0;
    }
  }
}

#endif
