/* The best source of every target under a tabulated kernel; see fuzzykf/engine/numpy/kernels.py. */
#ifndef FUZZYKF_SEARCH_H
#define FUZZYKF_SEARCH_H

#include "exact.h"

FK_EXACT_BEGIN

/* Sources in a block of the search by bounds, and those compared at a time. */
#define FK_BLOCK 32
#define FK_CHAINS 8

/* Least of combine(cost[j], table[j]), j < n; infinite if n is 0. */
FK_INLINE double fk_least_total(int how, const double *cost, const double *table, fk_index n) {
  double chain[FK_CHAINS], least = INFINITY;
  fk_index j = 0;
  for (int c = 0; c < FK_CHAINS; c++) chain[c] = INFINITY;
  for (; j + FK_CHAINS <= n; j += FK_CHAINS)
    for (int c = 0; c < FK_CHAINS; c++) chain[c] = fk_least(chain[c], fk_combine(how, cost[j + c], table[j + c]));
  for (; j < n; j++) least = fk_least(least, fk_combine(how, cost[j], table[j]));
  for (int c = 0; c < FK_CHAINS; c++) least = fk_least(least, chain[c]);
  return least;
}

/* First j < n with that total; 0 if there is none. */
FK_INLINE fk_index fk_first_with(int how, const double *cost, const double *table, fk_index n, double total) {
  for (fk_index j = 0; j < n; j++)
    if (fk_combine(how, cost[j], table[j]) == total) return j;
  return 0;
}

FK_INLINE void fk_search_table(int how, const double *cost, const double *table, fk_index stride, fk_index n,
                               fk_index m, fk_index *source) {
  for (fk_index i = 0; i < m; i++) {
    const double *row = table + i * stride;
    source[i] = fk_first_with(how, cost, row, n, fk_least_total(how, cost, row, n));
  }
}

/* One line against a table (m, n): the first best source of each target.  Here and below ``stride`` leads from
 * row to row of the table: rows may overlap, and come backwards. */
FK_STATIC void fk_table(int how, const double *cost, const double *table, fk_index stride, fk_index n, fk_index m,
                        fk_index *source) {
  if (how == FK_ADD)
    fk_search_table(FK_ADD, cost, table, stride, n, m, source);
  else if (how == FK_MULTIPLY)
    fk_search_table(FK_MULTIPLY, cost, table, stride, n, m, source);
  else
    fk_search_table(FK_MAXIMUM, cost, table, stride, n, m, source);
}

/* First and last finite entry of each row of a table (m, n); 0 and -1 for rows without any. */
FK_STATIC void fk_finite_range(const double *table, fk_index stride, fk_index n, fk_index m, fk_index *first,
                               fk_index *last) {
  for (fk_index i = 0; i < m; i++) {
    const double *row = table + i * stride;
    fk_index a = 0, b = n - 1;
    while (a < n && !isfinite(row[a])) a++;
    while (b >= 0 && !isfinite(row[b])) b--;
    first[i] = a < n ? a : 0;
    last[i] = b;
  }
}

/* One line by divide and conquer: the first best source of each target, 0 where there is none.  lowest
 * and highest, room for m + 2 each, bound the sources of the targets: entry 0 stands for the target
 * before the first, entry m + 1 for all beyond the last. */
FK_STATIC void fk_convex(const double *cost, const double *table, fk_index stride, fk_index n, fk_index m,
                         const fk_index *first, const fk_index *last, fk_index *source, fk_index *lowest,
                         fk_index *highest) {
  fk_index half = 1;
  while (half < m) half *= 2;
  lowest[0] = 0;
  highest[m + 1] = n - 1;
  for (; half; half /= 2)
    for (fk_index i = half - 1; i < m; i += 2 * half) {
      const fk_index before = lowest[i + 1 - half];
      const fk_index after = highest[i + 1 + half < m + 1 ? i + 1 + half : m + 1];
      const fk_index low = first[i] > before ? first[i] : before, high = last[i] < after ? last[i] : after;
      const fk_index count = high >= low ? high - low + 1 : 0;
      const double *costs = cost + low, *row = table + i * stride + low;
      const double least = fk_least_total(FK_ADD, costs, row, count);
      source[i] = count ? low + fk_first_with(FK_ADD, costs, row, count, least) : 0;
      if (count && isfinite(least)) {
        lowest[i + 1] = highest[i + 1] = source[i];
      } else { /* rules out all that it reaches, for its neighbours too */
        lowest[i + 1] = last[i] >= 0 && last[i] + 1 > before ? last[i] + 1 : before;
        highest[i + 1] = last[i] >= 0 && first[i] - 1 < after ? first[i] - 1 : after;
      }
    }
}

/* Least entry of each block of a row. */
FK_STATIC void fk_block_least(const double *row, fk_index n, double *least) {
  for (fk_index start = 0, b = 0; start < n; start += FK_BLOCK, b++) {
    double value = INFINITY;
    for (fk_index j = start; j < n && j < start + FK_BLOCK; j++) value = fk_least(value, row[j]);
    least[b] = value;
  }
}

FK_INLINE void fk_search_blocks(int how, const double *cost, const double *cost_least, const double *table,
                                const double *table_least, fk_index stride, fk_index n, fk_index m,
                                fk_index *guess) {
  const fk_index blocks = (n + FK_BLOCK - 1) / FK_BLOCK;
  for (fk_index i = 0; i < m; i++) {
    const double *row = table + i * stride, *bound = table_least + i * blocks;
    double best = fk_combine(how, row[guess[i]], cost[guess[i]]);
    if (i) { /* the source of the last target is a good guess, too */
      const double other = fk_combine(how, row[guess[i - 1]], cost[guess[i - 1]]);
      if (other < best) best = other, guess[i] = guess[i - 1];
    }
    for (fk_index b = 0; b < blocks; b++) {
      if (!(fk_combine(how, bound[b], cost_least[b]) < best)) continue;
      const fk_index start = b * FK_BLOCK, count = n - start < FK_BLOCK ? n - start : FK_BLOCK;
      const double least = fk_least_total(how, cost + start, row + start, count);
      if (least < best) {
        best = least;
        guess[i] = start + fk_first_with(how, cost + start, row + start, count, least);
      }
    }
  }
}

/* One line by bounds on blocks of sources, starting from a guess of the source of each target, which is
 * improved.  The bounds are the least entries of the blocks. */
FK_STATIC void fk_bounded(int how, const double *cost, const double *cost_least, const double *table,
                          const double *table_least, fk_index stride, fk_index n, fk_index m, fk_index *guess) {
  if (how == FK_ADD)
    fk_search_blocks(FK_ADD, cost, cost_least, table, table_least, stride, n, m, guess);
  else if (how == FK_MULTIPLY)
    fk_search_blocks(FK_MULTIPLY, cost, cost_least, table, table_least, stride, n, m, guess);
  else
    fk_search_blocks(FK_MAXIMUM, cost, cost_least, table, table_least, stride, n, m, guess);
}

/* Totals of the sources ``shift`` places from the given ones; infinite beyond the ends. */
FK_STATIC void fk_totals(int how, const double *cost, const double *table, fk_index stride, fk_index n, fk_index m,
                         const fk_index *source, fk_index shift, double *out) {
  for (fk_index i = 0; i < m; i++) {
    const fk_index j = source[i] + shift;
    out[i] = j >= 0 && j < n ? fk_combine(how, cost[j], table[i * stride + j]) : INFINITY;
  }
}

/* Whether every row of a table is convex where it is finite, and finite on an interval. */
FK_STATIC int fk_is_convex(const double *table, fk_index stride, fk_index n, fk_index m) {
  for (fk_index i = 0; i < m; i++) {
    const double *row = table + i * stride;
    int turns = 0;
    for (fk_index j = 0; j <= n; j++) {
      const int now = j < n && isfinite(row[j]), before = j > 0 && isfinite(row[j - 1]);
      turns += now != before;
    }
    if (turns > 2) return 0;
    for (fk_index j = 1; j + 1 < n; j++)
      if (row[j + 1] - 2.0 * row[j] + row[j - 1] < -1e-12 * (1.0 + fabs(row[j]))) return 0;
  }
  return 1;
}

/* Convolve a lattice of this shape with a kernel on the same lattice; zero offset is at ``center``. */
FK_STATIC void fk_joint(int how, int d, const fk_index *shape, const double *cost, const fk_index *kernel_shape,
                        const double *kernel, const fk_index *center, double *out) {
  fk_index size = 1, kernel_size = 1;
  for (int k = 0; k < d; k++) size *= shape[k], kernel_size *= kernel_shape[k];
  for (fk_index j = 0; j < size; j++) out[j] = INFINITY;
  for (fk_index j = 0; j < kernel_size; j++) {
    const double extra = kernel[j];
    fk_index from[FK_AXES], count[FK_AXES], at[FK_AXES], lines = 1, moved = 0, rest = j, stride = 1;
    if (!isfinite(extra)) continue;
    for (int k = d - 1; k >= 0; k--) {
      const fk_index shift = rest % kernel_shape[k] - center[k], room = shape[k] - (shift < 0 ? -shift : shift);
      rest /= kernel_shape[k];
      from[k] = shift < 0 ? -shift : 0;
      count[k] = room > 0 ? room : 0;
      if (k < d - 1 || !count[k]) lines *= count[k];
      moved += shift * stride;
      stride *= shape[k];
      at[k] = 0;
    }
    for (fk_index line = 0; line < lines; line++) {
      fk_index place = 0;
      for (int k = 0; k < d; k++) place = place * shape[k] + from[k] + at[k];
      const double *source = cost + place;
      double *to = out + place + moved;
      if (how == FK_ADD)
        for (fk_index k = 0; k < count[d - 1]; k++) to[k] = fk_least(to[k], source[k] + extra);
      else
        for (fk_index k = 0; k < count[d - 1]; k++) to[k] = fk_least(to[k], fk_most(source[k], extra));
      for (int k = d - 2; k >= 0; k--) {
        if (++at[k] < count[k]) break;
        at[k] = 0;
      }
    }
  }
}

FK_EXACT_END

#endif
